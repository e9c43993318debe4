! SPDX-License-Identifier: MIT
!> Tests of faults outside of steps: in dense output, after a breakpoint, after the action of an event.
module test_late_faults
    use asserts, only: check_close, check_failure, check_no_failure, check_text
    use event_kinds, only: new_time_event, time_event_type
    use faulty_runs, only: check_state_left, faults, start_swing, status_of_fault
    use model_moving_pivot, only: moving_pivot_type
    use model_spy, only: no_fault, spy_type
    use runs, only: choose, run
    use tandem, only: failure_type => error_type, model_type, n_terms, simulation_type, term_name, wp
    use testdrive, only: error_type, new_unittest, unittest_type
    implicit none (type, external)
    private

    public :: collect_late_faults

    character(len=9), parameter :: steppers(5) = [character(len=9) :: 'rk4', 'dopri5', 'dop853', 'trapezoid', 'sdirk54']

    !> An event after which a procedure of the model fails.
    type, extends(time_event_type) :: break_type
        integer :: fault = no_fault, term = 0
    contains
        procedure :: act => break_model
    end type break_type

contains

    !> The suite.
    subroutine collect_late_faults(testsuite)
        type(unittest_type), allocatable, intent(out) :: testsuite(:)

        testsuite = [ &
            new_unittest('a-fault-between-steps-leaves-the-run-as-it-was', test_looking), &
            new_unittest('a-fault-behind-a-breakpoint-is-named', test_breakpoint), &
            new_unittest('a-fault-behind-an-event-is-named', test_event)]
    end subroutine collect_late_faults

    !> Dense output at a point of failure: the run returns to the end of its step, and continues bitwise equal.
    subroutine test_looking(error)
        type(error_type), allocatable, intent(out) :: error
        type(moving_pivot_type), target :: inner
        type(spy_type), target :: spy
        type(simulation_type) :: simulation, alone
        type(failure_type), allocatable :: failure
        real(wp) :: q(2), qd(2)
        integer :: k, term

        call start_swing(inner, q, qd)
        call run(alone, inner, choose(step=1.0e-2_wp), 0.0_wp, q, qd, 0.2_wp, failure)
        call check_no_failure(error, failure)
        do k = 1, size(faults)
            do term = 1, n_terms
                call spy%wrap(inner)
                call simulation%initialize(spy, choose(step=1.0e-2_wp), 0.0_wp, q, qd, failure)
                if (.not. allocated(failure)) call simulation%step(0.2_wp, failure)
                call check_no_failure(error, failure)
                if (allocated(error)) return
                spy%fault = faults(k)
                spy%fault_term = 2**(term - 1)
                call simulation%look_at(0.005_wp, failure)
                call check_failure(error, failure, trim(status_of_fault(k)), 'between steps at t = 0.5000000E-2')
                call check_close(error, [simulation%state%t], [1.0e-2_wp], 0.0_wp, 'time')
                spy%fault = no_fault
                call simulation%integrate(0.2_wp, failure)
                call check_no_failure(error, failure)
                call check_close(error, simulation%state%q, alone%state%q, 0.0_wp, 'q')
                call check_close(error, simulation%state%qd, alone%state%qd, 0.0_wp, 'qd')
                if (allocated(error)) then
                    error%message = error%message//' ['//trim(status_of_fault(k))//', '//trim(term_name(term))//']'
                    return
                end if
            end do
        end do
    end subroutine test_looking

    !> A procedure that fails from a breakpoint on, and there for the first time. After its recovery the run continues bitwise
    !> equal.
    subroutine test_breakpoint(error)
        type(error_type), allocatable, intent(out) :: error
        type(moving_pivot_type), target :: inner
        type(spy_type), target :: spy
        type(simulation_type) :: simulation, alone
        type(failure_type), allocatable :: failure
        real(wp) :: q(2), qd(2)
        integer :: i, k, term

        call start_swing(inner, q, qd)
        inner%breakpoints = [0.0505_wp]
        do i = 1, size(steppers)
            call run(alone, inner, choose(step=1.0e-2_wp, stepper=steppers(i)), 0.0_wp, q, qd, 0.2_wp, failure)
            call check_no_failure(error, failure)
            do k = 1, size(faults)
                do term = 1, n_terms
                    call spy%wrap(inner)
                    spy%fault = faults(k)
                    spy%fault_term = 2**(term - 1)
                    spy%fault_segment = 2
                    call run(simulation, spy, choose(step=1.0e-2_wp, stepper=steppers(i)), 0.0_wp, q, qd, 0.2_wp, failure)
                    call check_failure(error, failure, trim(status_of_fault(k)), 't = 0.5050000E-1')
                    if (.not. allocated(error)) call check_text(error, failure%message, trim(term_name(term)))
                    call check_state_left(error, simulation)
                    spy%fault = no_fault
                    if (.not. allocated(error)) call simulation%integrate(0.2_wp, failure)
                    call check_no_failure(error, failure)
                    call check_close(error, simulation%state%q, alone%state%q, 0.0_wp, 'q')
                    call check_close(error, simulation%state%qd, alone%state%qd, 0.0_wp, 'qd')
                    if (allocated(error)) then
                        error%message = error%message//' ['//trim(steppers(i))//', '//trim(status_of_fault(k))//', '// &
                            trim(term_name(term))//']'
                        return
                    end if
                end do
            end do
        end do
    end subroutine test_breakpoint

    !> A procedure that fails after the action of an event.
    subroutine test_event(error)
        type(error_type), allocatable, intent(out) :: error
        type(moving_pivot_type), target :: inner
        type(spy_type), target :: spy
        type(simulation_type) :: simulation
        type(break_type) :: event
        type(failure_type), allocatable :: failure
        real(wp) :: q(2), qd(2)
        integer :: i, k, term

        call start_swing(inner, q, qd)
        event%time_event_type = new_time_event('line', 0.0505_wp)
        event%changes = .true.
        do i = 1, size(steppers)
            do k = 1, size(faults)
                do term = 1, n_terms
                    call spy%wrap(inner)
                    spy%fault = no_fault
                    event%fault = faults(k)
                    event%term = term
                    call simulation%initialize(spy, choose(step=1.0e-2_wp, stepper=steppers(i)), 0.0_wp, q, qd, failure)
                    call simulation%add_event(event)
                    if (.not. allocated(failure)) call simulation%integrate(0.2_wp, failure)
                    call check_failure(error, failure, trim(status_of_fault(k)), 'after the event at t = 0.5050000E-1')
                    if (.not. allocated(error)) call check_text(error, failure%message, trim(term_name(term)))
                    call check_state_left(error, simulation)
                    if (allocated(error)) then
                        error%message = error%message//' ['//trim(steppers(i))//', '//trim(status_of_fault(k))//', '// &
                            trim(term_name(term))//']'
                        return
                    end if
                end do
            end do
        end do
    end subroutine test_event

    subroutine break_model(self, model, t, q, qd, error)
        class(break_type), intent(inout) :: self
        class(model_type), intent(inout) :: model
        real(wp), intent(in) :: t
        real(wp), intent(inout) :: q(:), qd(:)
        type(failure_type), allocatable, intent(out) :: error

        select type (model)
        class is (spy_type)
            model%fault = self%fault
            model%fault_term = 2**(self%term - 1)
            model%fault_time = t
        end select
    end subroutine break_model
end module test_late_faults
