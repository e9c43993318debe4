! SPDX-License-Identifier: MIT
!> The team that runs the cases of a sweep: workers that take ranges of cases and return their records in order. Extensions of
!> this type implement them as processes of this machine or as ranks of MPI.
module tandem_io_sweep_team
    use tandem, only: error_type, long, wp
    implicit none (type, external)
    private

    public :: team_type, event_type, nothing, a_record, a_loss

    !> Kinds of events of a worker.
    integer, parameter :: nothing = 0, a_record = 1, a_loss = 2

    !> An event of a worker.
    type :: event_type
        !> One of the above.
        integer :: kind = nothing
        !> Who.
        integer :: worker = 0
        !> The record; of a loss, the first word is the signal that ended the worker.
        integer(long), allocatable :: words(:)
        integer :: n = 0
    end type event_type

    type, abstract :: team_type
    contains
        procedure(size_interface), deferred :: size
        procedure(start_interface), deferred :: start
        procedure(give_interface), deferred :: give
        procedure(next_interface), deferred :: next
        procedure(end_interface), deferred :: end_worker
        procedure(dismiss_interface), deferred :: dismiss
        procedure :: delay
    end type team_type

    abstract interface
        !> How many workers there are.
        integer function size_interface(self)
            import :: team_type
            implicit none (type, external)
            class(team_type), intent(in) :: self
        end function size_interface

        !> Start a worker, which is not there yet or was lost.
        subroutine start_interface(self, worker, error)
            import :: team_type, error_type
            implicit none (type, external)
            class(team_type), intent(inout) :: self
            integer, intent(in) :: worker
            type(error_type), allocatable, intent(out) :: error
        end subroutine start_interface

        !> Append cases to those of a worker.
        subroutine give_interface(self, worker, first, last)
            import :: long, team_type
            implicit none (type, external)
            class(team_type), intent(inout) :: self
            integer, intent(in) :: worker
            integer(long), intent(in) :: first, last
        end subroutine give_interface

        !> The next event of a worker; wait for it so many milliseconds at most.
        subroutine next_interface(self, milliseconds, event)
            import :: event_type, team_type
            implicit none (type, external)
            class(team_type), intent(inout) :: self
            integer, intent(in) :: milliseconds
            type(event_type), intent(inout) :: event
        end subroutine next_interface

        !> End a worker that does not return. Its earlier records may be lost.
        subroutine end_interface(self, worker)
            import :: team_type
            implicit none (type, external)
            class(team_type), intent(inout) :: self
            integer, intent(in) :: worker
        end subroutine end_interface

        !> Dismiss all workers.
        subroutine dismiss_interface(self)
            import :: team_type
            implicit none (type, external)
            class(team_type), intent(inout) :: self
        end subroutine dismiss_interface
    end interface

contains

    !> Seconds that may pass until an event of a worker is received; 0 unless overridden.
    pure real(wp) function delay(self)
        class(team_type), intent(in) :: self

        delay = 0.0_wp
    end function delay
end module tandem_io_sweep_team
