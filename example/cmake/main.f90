! SPDX-License-Identifier: MIT
! The skate of the README, compiled with the installed module files: `use tandem` is all that it needs.
!> A skate on an inclined plane cannot slip sideways, and so it does not slide down: it moves along a cycloid.
module skate
    use tandem, only: model_type, need_force, need_gamma, need_jacobian, need_mass, terms_type, wp
    implicit none (type, external)
    private
    public :: skate_terms, slope, spin
    real(wp), parameter :: slope = 9.81_wp*sin(0.3_wp), spin = 1.5_wp
    real(wp), parameter :: mass(3, 3) = reshape([1.0_wp, 0.0_wp, 0.0_wp, 0.0_wp, 1.0_wp, 0.0_wp, 0.0_wp, 0.0_wp, 0.2_wp], [3, 3])
contains
    !> q = (x, y, angle), x downhill. The constraint is sin(angle) xd - cos(angle) yd = 0, and gamma is its rate at qdd = 0.
    subroutine skate_terms(self, need, t, q, qd, terms, stat)
        class(model_type), intent(inout) :: self
        integer, intent(in) :: need
        real(wp), intent(in) :: t, q(:), qd(:)
        type(terms_type), intent(inout) :: terms
        integer, intent(out) :: stat

        stat = 0
        if (iand(need, need_jacobian) /= 0) terms%jacobian(1, :) = [sin(q(3)), -cos(q(3)), 0.0_wp]
        if (iand(need, need_gamma) /= 0) terms%gamma(1) = qd(3)*(cos(q(3))*qd(1) + sin(q(3))*qd(2))
        if (iand(need, need_mass) /= 0) terms%mass = mass
        if (iand(need, need_force) /= 0) terms%force = [slope, 0.0_wp, 0.0_wp]
    end subroutine skate_terms
end module skate

program main
    use skate, only: skate_terms, slope, spin
    use tandem, only: error_type, model_type, need_force, need_gamma, need_jacobian, need_mass, options_type, &
        simulation_type, wp
    implicit none (type, external)
    type(model_type), target :: model
    type(simulation_type) :: simulation
    type(error_type), allocatable :: error
    real(wp), parameter :: t = 10.0_wp, start(3) = 0.0_wp, a = slope/(4*spin**2), b = 2*spin*t
    real(wp), parameter :: exact(3) = [a*(1 - cos(b)), a*(b - sin(b)), spin*t]

    model%n = 3
    model%n_nonholonomic = 1
    model%evaluate => skate_terms
    model%provides = need_jacobian + need_gamma + need_mass + need_force
    call simulation%initialize(model, options_type(step=1.0e-3_wp), 0.0_wp, start, [0.0_wp, 0.0_wp, spin], error)
    if (.not. allocated(error)) call simulation%integrate(t, error)
    if (allocated(error)) error stop error%message
    print '(a, 3f12.6)', 'x, y, angle at t = 10:', simulation%state%q
    print '(a, es8.1)', 'error:', maxval(abs(simulation%state%q - exact))
end program main
