! SPDX-License-Identifier: MIT
!> What happens when a function g(t, q, qd, lambda) of the motion passes through zero. A program extends `event_type`, or
!> takes `threshold_event_type`, and gives the event to a simulation by `add_event`.
module tandem_simulate_event
    use tandem_error, only: error_type, set_error
    use tandem_kinds, only: wp
    use tandem_model, only: label_length, model_type
    use tandem_pack, only: pack_type
    use tandem_status, only: status_invalid_option
    implicit none (type, external)
    private

    public :: event_type, event_record_type, threshold_event_type

    !> Longest change of the model in words.
    integer, parameter :: change_length = 256

    !> A function of the motion and what its zeros mean.
    type, abstract :: event_type
        !> Its name in reports and files.
        character(len=label_length) :: name = 'event'
        !> Which zeros count: +1 rising ones, -1 falling ones, 0 all, those that only touch too.
        integer :: direction = 0
        !> Whether the run ends there.
        logical :: stops = .false.
        !> Whether `act` changes the state or the model, so that the integration must restart there.
        logical :: changes = .false.
        !> Whether g looks at the multipliers, which are computed for it then.
        logical :: needs_multipliers = .false.
    contains
        procedure(evaluate_interface), deferred :: evaluate
        procedure :: act, pack_state
    end type event_type

    abstract interface
        !> g at a state that satisfies the constraints.
        subroutine evaluate_interface(self, t, q, qd, lambda, value, stat)
            import :: event_type, wp
            implicit none (type, external)
            class(event_type), intent(inout) :: self
            !> Time, coordinates (n), velocities (n), multipliers (nh + nd; zero unless `needs_multipliers`).
            real(wp), intent(in) :: t, q(:), qd(:), lambda(:)
            !> g, continuous along the motion.
            real(wp), intent(out) :: value
            !> 0 fine, else the run ends.
            integer, intent(out) :: stat
        end subroutine evaluate_interface
    end interface

    !> What has happened.
    type :: event_record_type
        !> Number of the event in the order of `add_event`, and its name.
        integer :: number = 0
        character(len=label_length) :: name = ''
        !> +1 where g rose through zero, -1 where it fell, 0 where it touched zero or was zero at the start of the run.
        integer :: direction = 0
        !> Time, and the state (n) there, before the action.
        real(wp) :: t = 0.0_wp
        real(wp), allocatable :: q(:), qd(:)
    end type event_record_type

    !> One coordinate or velocity, one multiplier, or one number of what the model measures reaches a value.
    type, extends(event_type) :: threshold_event_type
        !> What to look at: 'q', 'qd', 'lambda' or 'shown', and its number; of what is measured the number among all.
        character(len=6) :: quantity = 'q'
        integer :: index = 1
        !> The value; g is the quantity less this.
        real(wp) :: value = 0.0_wp
        !> What to change of the model there, one after the other, in its own words; with `changes`.
        character(len=change_length), allocatable :: words(:)
        !> The model, which `add_event` sets; room for what it measures.
        class(model_type), pointer :: told_by => null()
        real(wp), allocatable, private :: shown(:), still(:)
        logical, allocatable, private :: asked(:)
    contains
        procedure :: evaluate => evaluate_threshold, act => change_model, measured_quantity
    end type threshold_event_type

contains

    !> What the event does where `changes` is true: change qd, or q on the constraints, or the model's parameters. The simulation
    !> then brings qd onto the velocity constraints, nearest in the mass metric, and restarts. Does nothing unless overridden.
    subroutine act(self, model, t, q, qd, error)
        class(event_type), intent(inout) :: self
        !> The simulation's model.
        class(model_type), intent(inout) :: model
        !> Time, coordinates and velocities (n) at the event.
        real(wp), intent(in) :: t
        real(wp), intent(inout) :: q(:), qd(:)
        !> Ends the run.
        type(error_type), allocatable, intent(out) :: error
    end subroutine act

    !> The quantity less the value; a quantity or an index that does not exist is a status of 1.
    subroutine evaluate_threshold(self, t, q, qd, lambda, value, stat)
        class(threshold_event_type), intent(inout) :: self
        real(wp), intent(in) :: t, q(:), qd(:), lambda(:)
        real(wp), intent(out) :: value
        integer, intent(out) :: stat

        stat = 1
        value = 0.0_wp
        if (self%index < 1) return
        select case (self%quantity)
        case ('q')
            if (self%index > size(q)) return
            value = q(self%index) - self%value
        case ('qd')
            if (self%index > size(qd)) return
            value = qd(self%index) - self%value
        case ('lambda')
            if (self%index > size(lambda)) return
            value = lambda(self%index) - self%value
        case ('shown')
            call look(self, t, q, qd, lambda, value, stat)
            value = value - self%value
            return
        case default
            return
        end select
        stat = 0
    end subroutine evaluate_threshold

    !> A number of what the model measures.
    subroutine look(self, t, q, qd, lambda, value, stat)
        class(threshold_event_type), intent(inout) :: self
        real(wp), intent(in) :: t, q(:), qd(:), lambda(:)
        real(wp), intent(out) :: value
        integer, intent(out) :: stat
        integer :: i

        stat = 1
        value = 0.0_wp
        if (.not. associated(self%told_by)) return
        associate (model => self%told_by)
            if (allocated(model%shown) .and. .not. self%needs_multipliers) then
                if (self%index > size(model%shown)) return
                value = model%shown(self%index)
                stat = 0
                return
            end if
            i = self%measured_quantity()
            if (i == 0) return
            if (.not. allocated(self%shown)) then
                allocate (self%shown(sum(max(1, model%quantities%width))), self%still(size(q)), source=0.0_wp)
                allocate (self%asked(size(model%quantities)), source=.false.)
                self%asked(i) = .true.
            end if
            call move_alloc(self%asked, model%asked)
            call model%measure(t, q, qd, self%still, self%shown, stat, lambda)
            call move_alloc(model%asked, self%asked)
        end associate
        value = self%shown(self%index)
    end subroutine look

    !> Which of the quantities that the model measures is watched; 0 for none.
    pure integer function measured_quantity(self)
        class(threshold_event_type), intent(in) :: self
        integer :: i, n

        measured_quantity = 0
        if (self%quantity /= 'shown' .or. .not. associated(self%told_by)) return
        if (.not. associated(self%told_by%measure)) return
        associate (quantities => self%told_by%quantities)
            n = 0
            do i = 1, size(quantities)
                n = n + max(1, quantities(i)%width)
                if (n >= self%index) exit
            end do
            if (i <= size(quantities)) measured_quantity = i
        end associate
    end function measured_quantity

    !> Change the model.
    subroutine change_model(self, model, t, q, qd, error)
        class(threshold_event_type), intent(inout) :: self
        class(model_type), intent(inout) :: model
        real(wp), intent(in) :: t
        real(wp), intent(inout) :: q(:), qd(:)
        type(error_type), allocatable, intent(out) :: error
        character(len=2*change_length) :: problem
        integer :: i

        if (.not. allocated(self%words)) return
        do i = 1, size(self%words)
            problem = 'the model has nothing that events may change'
            if (associated(model%change)) call model%change(self%words(i), .false., t, q, problem)
            if (problem == '') cycle
            call set_error(error, status_invalid_option, 'the event '//trim(self%name)//': '//trim(problem), 'correct it')
            return
        end do
    end subroutine change_model

    !> What the event itself remembers, where its `evaluate` or `act` keeps something between calls: list it by `pack%item`, and a
    !> checkpoint keeps it. Nothing unless overridden.
    subroutine pack_state(self, pack)
        class(event_type), intent(inout) :: self
        !> Writes or reads.
        type(pack_type), intent(inout) :: pack
    end subroutine pack_state
end module tandem_simulate_event
