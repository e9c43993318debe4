! SPDX-License-Identifier: MIT
!> Handling of SIGINT (Ctrl-C), SIGTERM and SIGHUP: the first signal ends a run at its next step with a complete file, a second one
!> ends the program at once.
module tandem_cli_interruption
    use tandem, only: error_type, global_error_type, observer_type, set_error, simulation_type, to_text
    use tandem_status, only: status_interrupted
    use, intrinsic :: iso_c_binding, only: c_int
    implicit none (type, external)
    private

    public :: interruption_type, interruptible_error_type, watch_signals, caught_signal

    !> Ends the observed run after a signal.
    type, extends(observer_type) :: interruption_type
    contains
        procedure :: observe => end_run
    end type interruption_type

    !> Error estimator whose second run can be ended by a signal.
    type, extends(global_error_type) :: interruptible_error_type
    contains
        procedure :: observe => end_estimate
    end type interruptible_error_type

    interface
        !> Install the signal handlers.
        subroutine watch_signals() bind(c, name='tandem_watch_signals')
        end subroutine watch_signals

        function c_caught_signal() result(number) bind(c, name='tandem_caught_signal')
            import :: c_int
            implicit none (type, external)
            integer(c_int) :: number
        end function c_caught_signal
    end interface

contains

    !> Number of the received signal; 0 if none.
    integer function caught_signal()
        caught_signal = int(c_caught_signal())
    end function caught_signal

    !> Set an error after a signal.
    subroutine end_run(self, simulation, occasion, error)
        class(interruption_type), intent(inout) :: self
        class(simulation_type), intent(inout) :: simulation
        !> `at_start`, `at_step`, `at_end` or `at_event`.
        integer, intent(in) :: occasion
        type(error_type), allocatable, intent(out) :: error

        call interrupt(simulation, error)
    end subroutine end_run

    !> Observe the run, and end it after a signal.
    subroutine end_estimate(self, simulation, occasion, error)
        class(interruptible_error_type), intent(inout) :: self
        class(simulation_type), intent(inout) :: simulation
        !> `at_start`, `at_step`, `at_end` or `at_event`.
        integer, intent(in) :: occasion
        type(error_type), allocatable, intent(out) :: error

        call self%global_error_type%observe(simulation, occasion, error)
        if (.not. allocated(error)) call interrupt(simulation, error)
    end subroutine end_estimate

    !> Set the error.
    subroutine interrupt(simulation, error)
        class(simulation_type), intent(in) :: simulation
        type(error_type), allocatable, intent(out) :: error
        integer, parameter :: numbers(3) = [1, 2, 15]
        character(len=*), parameter :: names(3) = [character(len=7) :: 'SIGHUP', 'SIGINT', 'SIGTERM']
        integer :: signal

        signal = caught_signal()
        if (signal == 0) return
        call set_error(error, status_interrupted, trim(names(max(1, findloc(numbers, signal, dim=1))))//' came at t = '// &
            to_text(simulation%state%t))
    end subroutine interrupt
end module tandem_cli_interruption
