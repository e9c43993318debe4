! SPDX-License-Identifier: MIT
!> Runs of a model with a fault in one of its terms, and the remaining state after a failure.
module faulty_runs
    use asserts, only: check_true
    use model_moving_pivot, only: moving_pivot_type
    use model_spy, only: fault_infinity, fault_nan, fault_retry, fault_stop, spy_type
    use runs, only: run
    use tandem, only: failure_type => error_type, options_type, simulation_type, wp
    use testdrive, only: error_type
    use, intrinsic :: ieee_arithmetic, only: ieee_is_finite
    implicit none (type, external)
    private

    public :: faults, status_of_fault, start_swing, run_with_fault, check_state_left

    !> Faults of a procedure.
    integer, parameter :: faults(4) = [fault_nan, fault_infinity, fault_retry, fault_stop]
    character(len=15), parameter :: status_of_fault(4) = [character(len=15) :: 'not_finite', 'not_finite', 'not_evaluable', &
        'callback_failed']

contains

    !> A pendulum on a moving pivot that evaluates M at every point, and its start at t = 0.
    subroutine start_swing(model, q, qd)
        type(moving_pivot_type), intent(inout) :: model
        real(wp), intent(out) :: q(2), qd(2)

        model%swing = 0.1_wp
        call model%define()
        model%constant_mass = .false.
        call model%motion(0.0_wp, 0.3_wp, 1.0_wp, q, qd)
    end subroutine start_swing

    !> Integrate this pendulum to t = 0.2, with a fault in one of its terms.
    subroutine run_with_fault(simulation, spy, model, options, fault, term, time, failure)
        type(simulation_type), intent(inout) :: simulation
        !> Counts the calls with the fault; parameters of the pendulum.
        type(spy_type), intent(inout), target :: spy
        type(moving_pivot_type), intent(inout), target :: model
        type(options_type), intent(in) :: options
        !> Kind of the fault, its term (from 1), and its first time.
        integer, intent(in) :: fault, term
        real(wp), intent(in) :: time
        type(failure_type), allocatable, intent(out) :: failure
        real(wp) :: q(2), qd(2)

        call start_swing(model, q, qd)
        call spy%wrap(model)
        spy%fault = fault
        spy%fault_term = 2**(term - 1)
        spy%fault_time = time
        call run(simulation, spy, options, 0.0_wp, q, qd, 0.2_wp, failure)
    end subroutine run_with_fault

    !> Fail unless the remaining state is finite.
    subroutine check_state_left(error, simulation)
        type(error_type), allocatable, intent(inout) :: error
        type(simulation_type), intent(in) :: simulation

        call check_true(error, all(ieee_is_finite([simulation%state%q, simulation%state%qd, simulation%state%qdd])), &
            'the state left behind is finite')
    end subroutine check_state_left
end module faulty_runs
