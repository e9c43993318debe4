! SPDX-License-Identifier: MIT
!> Events at zeros of a function g(t, q, qd, lambda) along the motion. A program extends `event_type` or uses
!> `threshold_event_type`, and passes events to a simulation by `add_event`.
module tandem_simulate_event
    use tandem_error, only: error_type, set_error
    use tandem_kinds, only: wp
    use tandem_model, only: label_length, model_type
    use tandem_pack, only: pack_type
    use tandem_status, only: status_invalid_option
    implicit none (type, external)
    private

    public :: event_type, event_record_type, threshold_event_type

    !> Largest length of the text that describes a change of the model.
    integer, parameter :: change_length = 256

    !> A function of the motion, and the effect of its zeros.
    type, abstract :: event_type
        !> Name in reports and files.
        character(len=label_length) :: name = 'event'
        !> Zeros of interest: +1 rising, -1 falling, 0 all, including those without a change of sign.
        integer :: direction = 0
        !> True if the run ends at the event.
        logical :: stops = .false.
        !> True if `act` changes the state or the model, after which the integration restarts.
        logical :: changes = .false.
        !> True if g depends on the multipliers, which are then computed.
        logical :: needs_multipliers = .false.
    contains
        procedure(evaluate_interface), deferred :: evaluate
        procedure :: act, pack_state
    end type event_type

    abstract interface
        !> Evaluate g at a state that satisfies the constraints.
        subroutine evaluate_interface(self, t, q, qd, lambda, value, stat)
            import :: event_type, wp
            implicit none (type, external)
            class(event_type), intent(inout) :: self
            !> Time, coordinates (n), velocities (n), multipliers (nh + nd; zero unless `needs_multipliers`).
            real(wp), intent(in) :: t, q(:), qd(:), lambda(:)
            !> g, continuous along the motion.
            real(wp), intent(out) :: value
            !> 0 after success; otherwise the run ends.
            integer, intent(out) :: stat
        end subroutine evaluate_interface
    end interface

    !> Record of an event that has occurred.
    type :: event_record_type
        !> Index of the event in the order of `add_event`, and its name.
        integer :: number = 0
        character(len=label_length) :: name = ''
        !> +1 if g rose through zero, -1 if it fell, 0 if it touched zero or was zero at the start of the run.
        integer :: direction = 0
        !> Time and state (n) of the event, before its action.
        real(wp) :: t = 0.0_wp
        real(wp), allocatable :: q(:), qd(:)
    end type event_record_type

    !> A coordinate, a velocity, a multiplier or a measured quantity of the model reaches a value.
    type, extends(event_type) :: threshold_event_type
        !> Watched quantity: 'q', 'qd', 'lambda' or 'shown' (measured), and its index.
        character(len=6) :: quantity = 'q'
        integer :: index = 1
        !> The value; g is the quantity minus this value.
        real(wp) :: value = 0.0_wp
        !> Changes of the model at the event, in the model's syntax, in the order of execution; used if `changes` is true.
        character(len=change_length), allocatable :: words(:)
        !> The model, set by `add_event`; work space for its measured quantities.
        class(model_type), pointer :: told_by => null()
        real(wp), allocatable, private :: shown(:), still(:)
        logical, allocatable, private :: asked(:)
    contains
        procedure :: evaluate => evaluate_threshold, act => change_model, measured_quantity
    end type threshold_event_type

contains

    !> Action of the event if `changes` is true. It may change qd, q along the constraints, or parameters of the model. The
    !> simulation then projects qd onto the velocity constraints in the mass metric and restarts. Does nothing by default.
    subroutine act(self, model, t, q, qd, error)
        class(event_type), intent(inout) :: self
        !> Model of the simulation.
        class(model_type), intent(inout) :: model
        !> Time, coordinates and velocities (n) at the event.
        real(wp), intent(in) :: t
        real(wp), intent(inout) :: q(:), qd(:)
        !> Ends the run if allocated.
        type(error_type), allocatable, intent(out) :: error
    end subroutine act

    !> The quantity minus the value; status 1 if the quantity or its index does not exist.
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
            call measure_quantity(self, t, q, qd, lambda, value, stat)
            value = value - self%value
            return
        case default
            return
        end select
        stat = 0
    end subroutine evaluate_threshold

    !> Evaluate a measured quantity of the model.
    subroutine measure_quantity(self, t, q, qd, lambda, value, stat)
        class(threshold_event_type), intent(inout) :: self
        real(wp), intent(in) :: t, q(:), qd(:), lambda(:)
        real(wp), intent(out) :: value
        integer, intent(out) :: stat
        integer :: i

        stat = 1
        value = 0.0_wp
        if (.not. associated(self%told_by)) return
        associate (model => self%told_by)
            if (allocated(model%state%shown) .and. .not. self%needs_multipliers) then
                if (self%index > size(model%state%shown)) return
                value = model%state%shown(self%index)
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
            call move_alloc(self%asked, model%state%asked)
            call model%measure(t, q, qd, self%still, self%shown, stat, lambda)
            call move_alloc(model%state%asked, self%asked)
        end associate
        value = self%shown(self%index)
    end subroutine measure_quantity

    !> Index of the watched quantity among the model's measured quantities; 0 if another quantity is watched.
    pure integer function measured_quantity(self)
        class(threshold_event_type), intent(in) :: self
        integer :: i, n

        measured_quantity = 0
        if (self%quantity /= 'shown' .or. .not. associated(self%told_by)) return
        if (.not. allocated(self%told_by%quantities)) return
        associate (quantities => self%told_by%quantities)
            n = 0
            do i = 1, size(quantities)
                n = n + max(1, quantities(i)%width)
                if (n >= self%index) exit
            end do
            if (i <= size(quantities)) measured_quantity = i
        end associate
    end function measured_quantity

    !> Change the model, the action of the event.
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
            call model%change(self%words(i), .false., t, q, problem)
            if (problem == '') cycle
            call set_error(error, status_invalid_option, 'the event '//trim(self%name)//': '//trim(problem), 'correct it')
            return
        end do
    end subroutine change_model

    !> Pack the state of the event, if `evaluate` or `act` stores data between calls, by `pack%item`, so that checkpoints include
    !> it. Packs nothing by default.
    subroutine pack_state(self, pack)
        class(event_type), intent(inout) :: self
        !> Writes or reads.
        type(pack_type), intent(inout) :: pack
    end subroutine pack_state
end module tandem_simulate_event
