!> A bead on a straight wire at 30 degrees slides down, hits a stop at the height 0 and bounces, q = (x, y), y upward.
module bead_on_wire
    use tandem, only: error_type, model_type, threshold_event_type, wp
    implicit none (type, external)
    private
    public :: stop_type, wire, wire_jacobian, wire_acceleration, masses, weight
    real(wp), parameter, public :: mass = 0.2_wp, gravity = 9.81_wp, angle = acos(-1.0_wp)/6

    !> The stop gives back a part of the speed.
    type, extends(threshold_event_type) :: stop_type
        real(wp) :: restitution = 0.7_wp
    contains
        procedure :: act => bounce
    end type stop_type
contains
    !> Reverse the velocity at the stop.
    subroutine bounce(self, model, t, q, qd, error)
        class(stop_type), intent(inout) :: self
        class(model_type), intent(inout) :: model
        real(wp), intent(in) :: t
        real(wp), intent(inout) :: q(:), qd(:)
        type(error_type), allocatable, intent(out) :: error

        qd = -self%restitution*qd
    end subroutine bounce

    !> Phi = y cos(angle) - x sin(angle).
    subroutine wire(self, t, q, value, stat)
        class(model_type), intent(inout) :: self
        real(wp), intent(in) :: t, q(:)
        real(wp), intent(out) :: value(:)
        integer, intent(out) :: stat

        value(1) = q(2)*cos(angle) - q(1)*sin(angle)
        stat = 0
    end subroutine wire

    !> Phi_q.
    subroutine wire_jacobian(self, t, q, value, stat)
        class(model_type), intent(inout) :: self
        real(wp), intent(in) :: t, q(:)
        real(wp), intent(out) :: value(:, :)
        integer, intent(out) :: stat

        value(1, :) = [-sin(angle), cos(angle)]
        stat = 0
    end subroutine wire_jacobian

    !> gamma = 0, since the wire is straight.
    subroutine wire_acceleration(self, t, q, qd, value, stat)
        class(model_type), intent(inout) :: self
        real(wp), intent(in) :: t, q(:), qd(:)
        real(wp), intent(out) :: value(:)
        integer, intent(out) :: stat

        value = 0.0_wp
        stat = 0
    end subroutine wire_acceleration

    !> M = mass I.
    subroutine masses(self, q, value, stat)
        class(model_type), intent(inout) :: self
        real(wp), intent(in) :: q(:)
        real(wp), intent(out) :: value(:, :)
        integer, intent(out) :: stat

        value = mass*reshape([1.0_wp, 0.0_wp, 0.0_wp, 1.0_wp], [2, 2])
        stat = 0
    end subroutine masses

    !> Q_A = (0, -mass gravity).
    subroutine weight(self, t, q, qd, value, stat)
        class(model_type), intent(inout) :: self
        real(wp), intent(in) :: t, q(:), qd(:)
        real(wp), intent(out) :: value(:)
        integer, intent(out) :: stat

        value = [0.0_wp, -mass*gravity]
        stat = 0
    end subroutine weight
end module bead_on_wire

!> From rest 1 m up the wire: each flight takes 0.7 of the time of the one before. The run ends at the top of the fourth.
program main
    use bead_on_wire, only: angle, gravity, masses, stop_type, weight, wire, wire_acceleration, wire_jacobian
    use tandem, only: error_type, options_type, procedure_model_type, simulation_type, wp
    implicit none (type, external)
    type(procedure_model_type), target :: model
    type(stop_type), target :: stop_at_foot
    type(simulation_type) :: simulation
    type(error_type), allocatable :: error
    real(wp), parameter :: slope = gravity*sin(angle), fall = sqrt(2.0_wp/slope), along(2) = [cos(angle), sin(angle)], r = 0.7_wp
    real(wp), parameter :: times(3) = fall*[1.0_wp, 1 + 2*r, 1 + 2*r + 2*r**2], top = times(3) + fall*r**3

    model%n = 2
    model%n_holonomic = 1
    model%holonomic => wire
    model%holonomic_jacobian => wire_jacobian
    model%constraint_acceleration => wire_acceleration
    model%mass_matrix => masses
    model%applied_force => weight
    call simulation%initialize(model, options_type(stepper='dopri5', rtol=1.0e-8_wp), 0.0_wp, along, [0.0_wp, 0.0_wp], error)
    if (allocated(error)) error stop error%message
    stop_at_foot%name = 'stop'
    stop_at_foot%quantity = 'q'
    stop_at_foot%index = 2
    stop_at_foot%value = 0.0_wp
    stop_at_foot%direction = -1
    stop_at_foot%changes = .true.
    call simulation%add_event(stop_at_foot)
    call simulation%integrate(top, error)
    if (allocated(error)) error stop error%message
    print '(a, *(f12.9))', 'hits at t =', simulation%events(:simulation%n_events)%t
    if (simulation%n_events /= 3) error stop 'there are three hits'
    print '(a, es8.1)', 'error:', max(maxval(abs(simulation%events(:3)%t - times)), &
        maxval(abs(simulation%state%q - r**6*along)))
end program main
