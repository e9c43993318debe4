! SPDX-License-Identifier: MIT
!> Runs for the tests of checkpoints: models with internal state, with redundant rows and with breakpoints, and events with internal
!> state.
module checkpoint_cases
    use event_kinds, only: bounce_type, new_time_event, time_event_type
    use model_belt_wheel, only: belt_wheel_type
    use model_pendulum, only: pendulum_type
    use model_redundant, only: redundant_type
    use model_sleigh, only: sleigh_type
    use model_turning_rows, only: turning_rows_type
    use runs, only: get_start, new_scene
    use tandem, only: failure_type => error_type, model_type, options_type, pack_type, simulation_type, threshold_event_type, wp
    implicit none (type, external)
    private

    public :: case_type, set_up, take_steps

    !> Kicks the motion occasionally, with increasing strength: an event with internal state, like its model.
    type, extends(time_event_type) :: kick_type
        real(wp) :: strength = 0.1_wp
        !> True if it packs an item that it lacks elsewhere, which is an error.
        logical :: lists_more = .false.
    contains
        procedure :: act => kick
        procedure :: pack_state => pack_kick
    end type kick_type

    !> A pendulum whose weight an event changes.
    type, extends(pendulum_type) :: changing_type
    contains
        procedure :: pack_state => pack_changing
    end type changing_type

    !> A run with all its data, so that there can be several at once.
    type :: case_type
        type(simulation_type) :: simulation
        class(model_type), allocatable :: model
        class(model_type), allocatable :: inner
        type(kick_type) :: kick
        type(bounce_type) :: bounce
        type(threshold_event_type) :: loaded
        type(time_event_type) :: beat
        real(wp), allocatable :: q(:), qd(:)
    end type case_type

contains

    !> A new simulation at its start.
    subroutine set_up(self, scene, options, failure)
        type(case_type), intent(inout), target :: self
        character(len=*), intent(in) :: scene
        type(options_type), intent(in) :: options
        type(failure_type), allocatable, intent(out) :: failure
        type(redundant_type), allocatable :: redundant
        type(belt_wheel_type), allocatable :: wheel
        type(sleigh_type), allocatable :: sleigh
        type(changing_type), allocatable :: pendulum
        type(turning_rows_type), allocatable :: turning
        real(wp) :: qdd(2), lambda(2)

        select case (scene)
        case ('redundant')
            ! A knife edge with a duplicated row: the choice between the two is part of the chart.
            call new_scene('knife_edge', self%inner)
            call get_start('knife_edge', self%q, self%qd)
            allocate (redundant)
            call move_alloc(redundant, self%model)
            select type (model => self%model)
            class is (redundant_type)
                call model%wrap(self%inner, [1], [2.0_wp], 'a copy')
            end select
        case ('turning_rows')
            ! The motion makes another row redundant within half a turn.
            allocate (turning)
            call turning%define(with_gamma=.true.)
            self%q = [1.0_wp, 0.0_wp, 0.0_wp]
            self%qd = [0.0_wp, 10.0_wp, 0.0_wp]
            call move_alloc(turning, self%model)
        case ('belt_wheel')
            allocate (wheel)
            call wheel%define()
            allocate (self%q(2), self%qd(2))
            call wheel%solution(0.0_wp, self%q, self%qd, qdd, lambda)
            call move_alloc(wheel, self%model)
        case ('sleigh')
            allocate (sleigh)
            call sleigh%define(0.1_wp)
            self%q = [0.0_wp, 0.0_wp, 0.3_wp]
            self%qd = [0.0_wp, 0.0_wp, -sleigh%speed(1)/sleigh%arm]
            call move_alloc(sleigh, self%model)
        case ('pendulum')
            allocate (pendulum)
            call pendulum%define()
            self%q = [pendulum%length, 0.0_wp]
            self%qd = [0.0_wp, 0.0_wp]
            call move_alloc(pendulum, self%model)
        case default
            call new_scene(scene, self%model)
            call get_start(scene, self%q, self%qd)
        end select
        call self%simulation%initialize(self%model, options, 0.0_wp, self%q, self%qd, failure)
        if (allocated(failure) .or. scene /= 'pendulum') return
        self%bounce%name = 'stop'
        self%bounce%index = 1
        self%bounce%value = 0.2_wp
        self%bounce%direction = -1
        self%bounce%restitution = 0.95_wp
        self%bounce%changes = .true.
        self%loaded%name = 'load'
        self%loaded%quantity = 'lambda'
        self%loaded%value = 1.0_wp
        self%kick%name = 'kick'
        self%kick%kind = 'sine'
        self%kick%at = 0.07_wp
        self%kick%changes = .true.
        self%beat = new_time_event('square', 0.3_wp)
        call self%simulation%add_event(self%bounce)
        call self%simulation%add_event(self%kick)
        call self%simulation%add_event(self%loaded)
        call self%simulation%add_event(self%beat)
    end subroutine set_up

    !> Some steps.
    subroutine take_steps(self, n, failure)
        type(case_type), intent(inout) :: self
        integer, intent(in) :: n
        type(failure_type), allocatable, intent(inout) :: failure
        integer :: i

        do i = 1, n
            if (.not. allocated(failure)) call self%simulation%step(100.0_wp, failure)
        end do
    end subroutine take_steps

    !> The pendulum grows heavier, and its velocity jumps, more each time.
    subroutine kick(self, model, t, q, qd, error)
        class(kick_type), intent(inout) :: self
        class(model_type), intent(inout) :: model
        real(wp), intent(in) :: t
        real(wp), intent(inout) :: q(:), qd(:)
        type(failure_type), allocatable, intent(out) :: error

        qd = (1.0_wp + self%strength)*qd
        self%strength = 1.1_wp*self%strength
        select type (model)
        class is (changing_type)
            model%g = 1.02_wp*model%g
        end select
    end subroutine kick

    subroutine pack_kick(self, pack)
        class(kick_type), intent(inout) :: self
        type(pack_type), intent(inout) :: pack

        call pack%item(self%strength)
        if (self%lists_more) call pack%item(self%lists_more)
    end subroutine pack_kick

    subroutine pack_changing(self, pack)
        class(changing_type), intent(inout) :: self
        type(pack_type), intent(inout) :: pack

        call pack%item(self%g)
    end subroutine pack_changing
end module checkpoint_cases
