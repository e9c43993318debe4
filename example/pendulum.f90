!> A pendulum in space, by five procedures: a ball on a rod about the origin, q = (x, y, z), z upward.
module pendulum_terms
    use tandem, only: model_type, wp
    implicit none (type, external)
    private
    public :: rod, rod_jacobian, rod_acceleration, masses, weight
    real(wp), parameter, public :: mass = 3.0_wp, length = 2.0_wp, gravity = 9.81_wp
contains
    !> Phi = (q'q - length^2)/2.
    subroutine rod(self, t, q, value, stat)
        class(model_type), intent(inout) :: self
        real(wp), intent(in) :: t, q(:)
        real(wp), intent(out) :: value(:)
        integer, intent(out) :: stat

        value(1) = (dot_product(q, q) - length**2)/2
        stat = 0
    end subroutine rod

    !> Phi_q = q'.
    subroutine rod_jacobian(self, t, q, value, stat)
        class(model_type), intent(inout) :: self
        real(wp), intent(in) :: t, q(:)
        real(wp), intent(out) :: value(:, :)
        integer, intent(out) :: stat

        value(1, :) = q
        stat = 0
    end subroutine rod_jacobian

    !> gamma = (Phi_q qd)_q qd = qd'qd.
    subroutine rod_acceleration(self, t, q, qd, value, stat)
        class(model_type), intent(inout) :: self
        real(wp), intent(in) :: t, q(:), qd(:)
        real(wp), intent(out) :: value(:)
        integer, intent(out) :: stat

        value(1) = dot_product(qd, qd)
        stat = 0
    end subroutine rod_acceleration

    !> M = mass I.
    subroutine masses(self, q, value, stat)
        class(model_type), intent(inout) :: self
        real(wp), intent(in) :: q(:)
        real(wp), intent(out) :: value(:, :)
        integer, intent(out) :: stat

        value = mass*reshape([1.0_wp, 0.0_wp, 0.0_wp, 0.0_wp, 1.0_wp, 0.0_wp, 0.0_wp, 0.0_wp, 1.0_wp], [3, 3])
        stat = 0
    end subroutine masses

    !> Q_A = (0, 0, -mass gravity).
    subroutine weight(self, t, q, qd, value, stat)
        class(model_type), intent(inout) :: self
        real(wp), intent(in) :: t, q(:), qd(:)
        real(wp), intent(out) :: value(:)
        integer, intent(out) :: stat

        value = [0.0_wp, 0.0_wp, -mass*gravity]
        stat = 0
    end subroutine weight
end module pendulum_terms

!> The ball circles at a constant height with the rod at 60 degrees; then omega^2 = gravity/(length cos(angle)).
program main
    use pendulum_terms, only: gravity, length, masses, rod, rod_acceleration, rod_jacobian, weight
    use tandem, only: error_type, options_type, procedure_model_type, simulation_type, wp
    implicit none (type, external)
    type(procedure_model_type), target :: model
    type(simulation_type) :: simulation
    type(error_type), allocatable :: error
    real(wp), parameter :: angle = acos(-1.0_wp)/3, omega = sqrt(gravity/(length*cos(angle))), t = 10.0_wp
    real(wp), parameter :: radius = length*sin(angle), start(3) = [radius, 0.0_wp, -length*cos(angle)]
    real(wp), parameter :: exact(3) = [radius*cos(omega*t), radius*sin(omega*t), start(3)]

    model%n = 3
    model%n_holonomic = 1
    model%holonomic => rod
    model%holonomic_jacobian => rod_jacobian
    model%constraint_acceleration => rod_acceleration
    model%mass_matrix => masses
    model%applied_force => weight
    call simulation%initialize(model, options_type(stepper='sdirk54', step=5.0e-3_wp), 0.0_wp, start, &
        [0.0_wp, omega*radius, 0.0_wp], error)
    if (.not. allocated(error)) call simulation%integrate(t, error)
    if (allocated(error)) error stop error%message
    print '(a, 3f12.6)', 'x, y, z at t = 10:', simulation%state%q
    print '(a, es8.1)', 'error:', maxval(abs(simulation%state%q - exact))
end program main
