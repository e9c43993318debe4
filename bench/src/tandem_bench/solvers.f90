! SPDX-License-Identifier: MIT
!> The solvers of a problem, in the order of the tables.
module tandem_bench_solvers
    use tandem, only: stepper_choices
    use tandem_bench_by_ida, only: ida_type
    use tandem_bench_by_radau5, only: radau5_type
    use tandem_bench_by_tandem, only: new_tandem
    use tandem_bench_elimination, only: by_lapack, by_lu, by_sweeps, kernel_name
    use tandem_bench_index1_disk, only: index1_disk_type => by_hand_type
    use tandem_bench_index1_motorcycle, only: index1_motorcycle_type => by_hand_type
    use tandem_bench_index1_vehicle, only: index1_vehicle_type => by_hand_type
    use tandem_bench_minimal_disk, only: minimal_disk_type => by_hand_type
    use tandem_bench_solver, only: problem_type, solver_holder_type, solver_type
    implicit none (type, external)
    private

    public :: make_solvers, yardstick, by_hand

    !> Reference solver of the comparison: index-1 equations with LU written out; for stiff problems, IDA.
    character(len=24), parameter :: yardstick(2) = [character(len=24) :: 'index-1 LU', 'IDA']
    !> Solvers written by hand for speed.
    character(len=24), parameter :: by_hand(2) = [character(len=24) :: 'index-1 LU', 'index-1 sweeps']

contains

    !> Make all solvers that can solve a problem.
    subroutine make_solvers(problem, solvers)
        type(problem_type), intent(in) :: problem
        type(solver_holder_type), allocatable, intent(out) :: solvers(:)
        type(minimal_disk_type) :: minimal
        type(ida_type) :: ida
        type(radau5_type) :: radau5
        integer :: i

        allocate (solvers(0))
        do i = 1, size(stepper_choices)
            call add(problem, new_tandem(trim(stepper_choices(i))), solvers)
            if (stepper_choices(i) == 'dop853') call add(problem, new_tandem('dop853', at_ends=.true.), solvers)
        end do
        do i = by_lu, by_lapack
            select case (problem%model%n)
            case (6)
                call add(problem, index1_vehicle_type(name=kernel_name(i), kernel=i), solvers)
            case (9)
                call add(problem, index1_disk_type(name=kernel_name(i), kernel=i), solvers)
            case default
                call add(problem, index1_motorcycle_type(name=kernel_name(i), kernel=i), solvers)
            end select
        end do
        ida%name = 'IDA'
        ida%is_implicit = .true.
        call add(problem, ida, solvers)
        radau5%name = 'RADAU5'
        radau5%is_implicit = .true.
        call add(problem, radau5, solvers)
        minimal%name = 'minimal coordinates'
        call add(problem, minimal, solvers)
    end subroutine make_solvers

    !> Add a solver if it can solve the problem.
    subroutine add(problem, solver, solvers)
        type(problem_type), intent(in) :: problem
        class(solver_type), intent(in) :: solver
        type(solver_holder_type), allocatable, intent(inout) :: solvers(:)
        type(solver_holder_type), allocatable :: more(:)
        integer :: i

        if (.not. solver%can_solve(problem)) return
        allocate (more(size(solvers) + 1))
        do i = 1, size(solvers)
            call move_alloc(solvers(i)%solver, more(i)%solver)
        end do
        allocate (more(size(more))%solver, source=solver)
        call move_alloc(more, solvers)
    end subroutine add
end module tandem_bench_solvers
