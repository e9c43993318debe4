!> A skate whose heading is steered by angle = amplitude sin(t) for one period and held afterwards, as the paper steers its
!> vehicles: q = (x, y, angle). It cannot slip sideways, and it glides at a constant speed.
module steered_skate
    use tandem, only: derivatives_type, label_length, model_type, need_acceleration_q, need_acceleration_qd, need_dynamics_q, &
        need_gamma, need_jacobian, need_mass, need_nu, need_velocity_q, terms_type, wp
    implicit none (type, external)
    private

    public :: steered_skate_type

    type, extends(model_type) :: steered_skate_type
        !> Steering amplitude (rad), mass (kg), moment of inertia (kg m^2).
        real(wp) :: amplitude = 0.8_wp, mass = 70.0_wp, inertia = 2.0_wp
    contains
        procedure :: define
    end type steered_skate_type

contains

    !> Sizes, names and procedures; to be called after the parameters are set.
    subroutine define(self)
        class(steered_skate_type), intent(inout) :: self

        self%name = 'steered_skate'
        self%n = 3
        self%n_nonholonomic = 2
        self%constant_mass = .true.
        self%coordinate_name = [character(len=label_length) :: 'x', 'y', 'angle']
        self%coordinate_unit = [character(len=label_length) :: 'm', 'm', 'rad']
        self%nonholonomic_name = [character(len=label_length) :: 'no slip', 'steering']
        self%breakpoints = [2*acos(-1.0_wp)]
        self%nu_jumps = [.true.]
        self%evaluate => terms_of_skate
        self%provides = need_jacobian + need_nu + need_gamma + need_mass
        self%evaluate_derivatives => derivatives_of_skate
        self%provides_derivatives = need_velocity_q + need_acceleration_q + need_acceleration_qd + need_dynamics_q
    end subroutine define

    !> sin(angle) xd - cos(angle) yd = 0 and angled = amplitude cos(t), or 0 in the second segment.
    subroutine terms_of_skate(self, need, t, q, qd, terms, stat)
        class(model_type), intent(inout) :: self
        integer, intent(in) :: need
        real(wp), intent(in) :: t, q(:), qd(:)
        type(terms_type), intent(inout) :: terms
        integer, intent(out) :: stat
        real(wp) :: c, s

        stat = 0
        c = cos(q(3))
        s = sin(q(3))
        select type (self)
        class is (steered_skate_type)
            if (iand(need, need_jacobian) /= 0) then
                terms%jacobian(1, :) = [s, -c, 0.0_wp]
                terms%jacobian(2, :) = [0.0_wp, 0.0_wp, 1.0_wp]
            end if
            if (iand(need, need_nu) /= 0) then
                terms%nu = 0.0_wp
                if (self%segment == 1) terms%nu(2) = self%amplitude*cos(t)
            end if
            if (iand(need, need_gamma) /= 0) then
                terms%gamma(1) = qd(3)*(c*qd(1) + s*qd(2))
                terms%gamma(2) = 0.0_wp
                if (self%segment == 1) terms%gamma(2) = self%amplitude*sin(t)
            end if
            if (iand(need, need_mass) /= 0) then
                terms%mass = 0.0_wp
                terms%mass(1, 1) = self%mass
                terms%mass(2, 2) = self%mass
                terms%mass(3, 3) = self%inertia
            end if
        end select
    end subroutine terms_of_skate

    !> Only the first row depends on q, by the angle alone; there are no forces.
    subroutine derivatives_of_skate(self, need, t, q, qd, qdd, lambda, derivatives, stat)
        class(model_type), intent(inout) :: self
        integer, intent(in) :: need
        real(wp), intent(in) :: t, q(:), qd(:), qdd(:), lambda(:)
        type(derivatives_type), intent(inout) :: derivatives
        integer, intent(out) :: stat
        real(wp) :: c, s

        stat = 0
        c = cos(q(3))
        s = sin(q(3))
        if (iand(need, need_velocity_q) /= 0) then
            derivatives%velocity_q = 0.0_wp
            derivatives%velocity_q(1, 3) = c*qd(1) + s*qd(2)
        end if
        if (iand(need, need_acceleration_q) /= 0) then
            derivatives%acceleration_q = 0.0_wp
            derivatives%acceleration_q(1, 3) = c*qdd(1) + s*qdd(2) + qd(3)*(c*qd(2) - s*qd(1))
        end if
        if (iand(need, need_acceleration_qd) /= 0) then
            derivatives%acceleration_qd = 0.0_wp
            derivatives%acceleration_qd(1, :) = [c*qd(3), s*qd(3), c*qd(1) + s*qd(2)]
        end if
        if (iand(need, need_dynamics_q) /= 0) then
            derivatives%dynamics_q = 0.0_wp
            derivatives%dynamics_q(1:2, 3) = lambda(1)*[c, s]
        end if
    end subroutine derivatives_of_skate
end module steered_skate

!> Checks the procedures against differences, then glides for 10 s. Over one period of steering, x grows by
!> 2 pi speed J0(amplitude), J0 being Bessel's function, y by nothing; afterwards the skate goes straight on.
program main
    use steered_skate, only: steered_skate_type
    use tandem, only: error_type, finding_type, options_type, simulation_type, statistics_type, verify_model, wp
    implicit none (type, external)
    type(steered_skate_type), target :: model
    type(simulation_type) :: simulation
    type(statistics_type) :: statistics
    type(error_type), allocatable :: error
    type(finding_type), allocatable :: findings(:)
    real(wp), parameter :: speed = 5.0_wp, t = 10.0_wp, period = 2*acos(-1.0_wp)
    real(wp) :: q(3), qd(3), exact(3)
    integer :: i

    call model%define()
    q = [0.0_wp, 0.0_wp, 0.0_wp]
    qd = [speed, 0.0_wp, model%amplitude]
    call verify_model(model, 0.0_wp, q, qd, 10, findings, error)
    if (allocated(error)) error stop error%message
    do i = 1, size(findings)
        print '(a, t42, a, es8.1)', trim(findings(i)%name), merge('right,', 'WRONG,', findings(i)%passed), findings(i)%error
    end do

    call simulation%initialize(model, options_type(stepper='sdirk54', step=1.0e-2_wp), 0.0_wp, q, qd, error)
    if (.not. allocated(error)) call simulation%integrate(t, error)
    if (allocated(error)) error stop error%message
    statistics = simulation%statistics()
    exact = [speed*(period*bessel_j0(model%amplitude) + t - period), 0.0_wp, 0.0_wp]
    print '(a, 3f12.6)', 'x, y, angle at t = 10:', simulation%state%q
    print '(a, f9.6)', 'jump of the velocity at the breakpoint:', statistics%velocity_jump
    print '(a, es8.1)', 'error:', maxval(abs(simulation%state%q - exact))
end program main
