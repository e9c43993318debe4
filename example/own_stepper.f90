!> A user-defined stepper: the pair of Bogacki and Shampine, order 3 with an embedded order 2. It satisfies the constraints at every
!> stage, has error control, dense output and events like the shipped ones; only a tableau is needed.
module bogacki_shampine
    use tandem, only: explicit_type, properties_type, wp
    implicit none (type, external)
    private
    public :: bogacki_shampine_type

    type, extends(explicit_type) :: bogacki_shampine_type
    contains
        procedure, nopass :: properties
        procedure :: set_tableau
    end type bogacki_shampine_type
contains
    !> Order 3 with 3 stages, explicit, an estimate of order 2.
    pure function properties() result(properties_)
        type(properties_type) :: properties_

        properties_ = properties_type('bogacki_shampine', 3, 3, .false., 2, 'conditional (|h lambda| < 2.5)', &
            'P. Bogacki, L. F. Shampine, Appl. Math. Lett. 2 (1989) 321-325', stability_limit=2.5_wp)
    end function properties

    !> Nodes, weights, stages in columns, and the difference of the two orders; its last weight is of the rate at the end.
    subroutine set_tableau(self)
        class(bogacki_shampine_type), intent(inout) :: self

        self%c = [0.0_wp, 1.0_wp/2, 3.0_wp/4]
        self%b = [2.0_wp/9, 1.0_wp/3, 4.0_wp/9]
        self%a = reshape([0.0_wp, 0.0_wp, 0.0_wp, 1.0_wp/2, 0.0_wp, 0.0_wp, 0.0_wp, 3.0_wp/4, 0.0_wp], [3, 3])
        self%e = reshape([-5.0_wp/72, 1.0_wp/12, 1.0_wp/9, -1.0_wp/8], [4, 1])
    end subroutine set_tableau
end module bogacki_shampine

!> A bead on a ring, which goes round at constant speed.
module ring
    use tandem, only: model_type, need_force, need_gamma, need_jacobian, need_mass, need_phi, terms_type, wp
    implicit none (type, external)
    private
    public :: ring_terms
contains
    !> Phi = (x^2 + y^2 - 1)/2, C = (x, y), gamma = xd^2 + yd^2, M = 1, no force.
    subroutine ring_terms(self, need, t, q, qd, terms, stat)
        class(model_type), intent(inout) :: self
        integer, intent(in) :: need
        real(wp), intent(in) :: t, q(:), qd(:)
        type(terms_type), intent(inout) :: terms
        integer, intent(out) :: stat

        stat = 0
        if (iand(need, need_phi) /= 0) terms%phi(1) = 0.5_wp*(q(1)**2 + q(2)**2 - 1.0_wp)
        if (iand(need, need_jacobian) /= 0) terms%jacobian(1, :) = q
        if (iand(need, need_gamma) /= 0) terms%gamma(1) = qd(1)**2 + qd(2)**2
        if (iand(need, need_mass) /= 0) terms%mass = reshape([1.0_wp, 0.0_wp, 0.0_wp, 1.0_wp], [2, 2])
        if (iand(need, need_force) /= 0) terms%force = 0.0_wp
    end subroutine ring_terms
end module ring

program main
    use bogacki_shampine, only: bogacki_shampine_type
    use ring, only: ring_terms
    use tandem, only: error_type, model_type, need_force, need_gamma, need_jacobian, need_mass, need_phi, options_type, &
        simulation_type, statistics_type, wp
    implicit none (type, external)
    type(model_type), target :: model
    type(bogacki_shampine_type) :: stepper
    type(simulation_type) :: simulation
    type(statistics_type) :: statistics
    type(error_type), allocatable :: error
    real(wp), parameter :: t = 10.0_wp

    model%n = 2
    model%n_holonomic = 1
    model%evaluate => ring_terms
    model%provides = need_phi + need_jacobian + need_gamma + need_mass + need_force
    call simulation%initialize(model, options_type(rtol=1.0e-8_wp, atol=1.0e-8_wp), 0.0_wp, [1.0_wp, 0.0_wp], [0.0_wp, 1.0_wp], &
        error, stepper=stepper)
    if (.not. allocated(error)) call simulation%integrate(t, error)
    if (allocated(error)) error stop error%message
    statistics = simulation%statistics()
    print '(3a, i0, a)', 'stepper ', trim(simulation%options%stepper), ': ', statistics%steps, ' steps'
    print '(a, 2f12.8)', 'x, y at t = 10:', simulation%state%q
    print '(a, es8.1)', 'error:', maxval(abs(simulation%state%q - [cos(t), sin(t)]))
end program main
