! SPDX-License-Identifier: MIT
!> The index-1 equations for the motorcycles, with sizes that are constants for the compiler.
module tandem_bench_index1_motorcycle
    use tandem, only: model_type, need_force, need_gamma, need_jacobian, need_mass, need_nu, need_phi, options_type, &
        terms_type, wp
    use tandem_bench_elimination, only: by_lapack, by_lu, by_sweeps, dgesv
    use tandem_bench_solver, only: next_stop, problem_type, solver_type
    use tandem_simulate_step_control, only: step_control_type
    use tandem_stepper_dop853, only: dop853_type
    implicit none (type, external)
    private

    public :: by_hand_type

    !> Coordinates, holonomic and nonholonomic constraints.
    integer, parameter :: n = 10, nh = 6, nd = 2

    include 'index1.inc'
    include 'dop853.inc'
end module tandem_bench_index1_motorcycle
