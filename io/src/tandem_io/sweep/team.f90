! SPDX-License-Identifier: MIT
!> The team that runs the cases of a sweep: workers that run ranges of cases and return their records in order. Extensions of the
!> type implement workers as processes of this machine or as MPI ranks.
module tandem_io_sweep_team
    use tandem, only: error_type, long, wp
    implicit none (type, external)
    private

    public :: team_type, event_type, event_none, event_record, event_loss

    !> Kinds of events reported by workers.
    integer, parameter :: event_none = 0, event_record = 1, event_loss = 2

    !> An event reported by a worker.
    type :: event_type
        !> One of the kinds above.
        integer :: kind = event_none
        !> Number of the worker.
        integer :: worker = 0
        !> Words of the record. After a loss, the first word is the signal that ended the worker.
        integer(long), allocatable :: words(:)
        integer :: n = 0
    end type event_type

    type, abstract :: team_type
    contains
        procedure(size_interface), deferred :: size
        procedure(start_interface), deferred :: start
        procedure(assign_interface), deferred :: assign
        procedure(next_interface), deferred :: next
        procedure(end_interface), deferred :: end_worker
        procedure(dismiss_interface), deferred :: dismiss
        procedure :: delay
    end type team_type

    abstract interface
        !> Number of workers.
        integer function size_interface(self)
            import :: team_type
            implicit none (type, external)
            class(team_type), intent(in) :: self
        end function size_interface

        !> Start a worker that is not running.
        subroutine start_interface(self, worker, error)
            import :: team_type, error_type
            implicit none (type, external)
            class(team_type), intent(inout) :: self
            integer, intent(in) :: worker
            type(error_type), allocatable, intent(out) :: error
        end subroutine start_interface

        !> Append a range of cases to the work of a worker.
        subroutine assign_interface(self, worker, first, last)
            import :: long, team_type
            implicit none (type, external)
            class(team_type), intent(inout) :: self
            integer, intent(in) :: worker
            integer(long), intent(in) :: first, last
        end subroutine assign_interface

        !> Wait for the next event of any worker, at most `milliseconds`.
        subroutine next_interface(self, milliseconds, event)
            import :: event_type, team_type
            implicit none (type, external)
            class(team_type), intent(inout) :: self
            integer, intent(in) :: milliseconds
            type(event_type), intent(inout) :: event
        end subroutine next_interface

        !> Terminate a worker whose case does not return. Records that it has sent may be lost.
        subroutine end_interface(self, worker)
            import :: team_type
            implicit none (type, external)
            class(team_type), intent(inout) :: self
            integer, intent(in) :: worker
        end subroutine end_interface

        !> Terminate all workers.
        subroutine dismiss_interface(self)
            import :: team_type
            implicit none (type, external)
            class(team_type), intent(inout) :: self
        end subroutine dismiss_interface
    end interface

contains

    !> Largest time until an event of a worker is received, seconds; 0 unless overridden.
    pure real(wp) function delay(self)
        class(team_type), intent(in) :: self

        delay = 0.0_wp
    end function delay
end module tandem_io_sweep_team
