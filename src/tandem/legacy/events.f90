! SPDX-License-Identifier: MIT
!> Events in the C and Fortran 77 interfaces: a coordinate, a velocity or a multiplier reaches a value, or a function of the caller
!> passes through zero. Events are recorded, or stop the run.
module tandem_legacy_events
    use tandem_error, only: error_type, set_error, to_text
    use tandem_kinds, only: wp
    use tandem_legacy_callback_model, only: callback_model_type
    use tandem_model, only: label_length
    use tandem_names, only: lower_case
    use tandem_simulate_event, only: threshold_event_type
    use tandem_simulation, only: simulation_type
    use tandem_status, only: status_invalid_option
    use, intrinsic :: ieee_arithmetic, only: ieee_is_finite
    use, intrinsic :: iso_c_binding, only: c_associated, c_funptr, c_null_funptr
    implicit none (type, external)
    private

    public :: callback_event_type, event_list_type

    !> Quantities that can be watched.
    character(len=6), parameter :: quantities(3) = [character(len=6) :: 'q', 'qd', 'lambda']

    !> Event of a caller: at zeros of its function, or, without a function, at a threshold.
    type, extends(threshold_event_type) :: callback_event_type
        class(callback_model_type), pointer :: model => null()
        type(c_funptr) :: function_ = c_null_funptr
    contains
        procedure :: evaluate
    end type callback_event_type

    !> Requested events, which take effect at the next start, and the events of the current run, whose addresses must not change.
    type :: event_list_type
        type(callback_event_type), allocatable, private :: wanted(:)
        type(callback_event_type), pointer, private :: watched(:) => null()
    contains
        procedure :: add, clear, watch, release, stopped_by
    end type event_list_type

contains

    !> Add an event: a function, or a quantity with its entry and value.
    subroutine add(self, name, event, error, quantity)
        class(event_list_type), intent(inout) :: self
        !> Unique name.
        character(len=*), intent(in) :: name
        !> Event. Its model, direction, `stops`, and its entry and value or its function are set on entry; all other components are
        !> set here.
        type(callback_event_type), intent(inout) :: event
        !> invalid_option if the event is invalid.
        type(error_type), allocatable, intent(out) :: error
        !> Quantity to watch, in upper or lower case, see `threshold_event_type`. Absent for a function.
        character(len=*), intent(in), optional :: quantity
        integer :: n

        if (.not. allocated(self%wanted)) allocate (self%wanted(0))
        event%name = name
        if (name == '') then
            call refuse('the event has no name', 'give it one')
        else if (len_trim(name) > label_length) then
            call refuse('the name of the event "'//trim(name)//'" is too long', &
                'use '//to_text(label_length)//' characters at most')
        else if (any(self%wanted%name == event%name)) then
            call refuse('"'//trim(name)//'" is the name of another event', 'give it another one')
        else if (all(event%direction /= [-1, 0, 1])) then
            call refuse('the direction '//to_text(event%direction)//' of the event "'//trim(name)//'" is unknown', &
                'use 1 where it rises, -1 where it falls, 0 for both')
        else if (.not. present(quantity)) then
            if (.not. c_associated(event%function_)) call refuse('the event "'//trim(name)//'" has no function', 'give it one')
        else if (all(lower_case(quantity) /= quantities)) then
            call refuse('the quantity "'//trim(quantity)//'" of the event "'//trim(name)//'" is unknown', 'use q, qd or lambda')
        else
            event%quantity = lower_case(quantity)
            n = event%model%n
            if (event%quantity == 'lambda') n = event%model%n_constraints()
            if (event%index < 1 .or. event%index > n) then
                call refuse('the event "'//trim(name)//'" watches an entry of '//trim(event%quantity)//' that does not exist', &
                    'it has '//to_text(n)//' entries')
            else if (.not. ieee_is_finite(event%value)) then
                call refuse('the value of the event "'//trim(name)//'" is not finite', 'give a finite number')
            end if
        end if
        if (.not. allocated(error)) self%wanted = [self%wanted, event]

    contains

        subroutine refuse(message, advice)
            character(len=*), intent(in) :: message, advice

            call set_error(error, status_invalid_option, message, advice)
        end subroutine refuse
    end subroutine add

    !> Remove all requested events.
    subroutine clear(self)
        class(event_list_type), intent(inout) :: self

        if (allocated(self%wanted)) deallocate (self%wanted)
    end subroutine clear

    !> Attach the requested events to a run that has just started, in place of all previous events.
    subroutine watch(self, simulation)
        class(event_list_type), intent(inout) :: self
        type(simulation_type), intent(inout) :: simulation
        integer :: i

        call self%release()
        if (.not. allocated(self%wanted)) return
        allocate (self%watched, source=self%wanted)
        do i = 1, size(self%watched)
            call simulation%add_event(self%watched(i))
        end do
    end subroutine watch

    !> Release the events of a run that has ended.
    subroutine release(self)
        class(event_list_type), intent(inout) :: self

        if (associated(self%watched)) deallocate (self%watched)
        self%watched => null()
    end subroutine release

    !> Index of the event that has stopped the run; 0 if none has.
    integer function stopped_by(self, simulation)
        class(event_list_type), intent(in) :: self
        type(simulation_type), intent(in) :: simulation

        stopped_by = 0
        if (.not. (simulation%is_stopped .and. associated(self%watched))) return
        do stopped_by = size(self%watched), 1, -1
            if (self%watched(stopped_by)%name == simulation%stopped_by) return
        end do
    end function stopped_by

    !> Function of the caller, or the quantity minus the value.
    subroutine evaluate(self, t, q, qd, lambda, value, stat)
        class(callback_event_type), intent(inout) :: self
        real(wp), intent(in) :: t, q(:), qd(:), lambda(:)
        real(wp), intent(out) :: value
        integer, intent(out) :: stat
        real(wp) :: values(1)

        if (c_associated(self%function_)) then
            call self%model%evaluate_function(self%function_, t, q, qd, values, stat)
            value = values(1)
        else
            call self%threshold_event_type%evaluate(t, q, qd, lambda, value, stat)
        end if
    end subroutine evaluate
end module tandem_legacy_events
