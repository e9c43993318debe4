! SPDX-License-Identifier: MIT
!> The rank of a model's constraints, and the motion of mechanisms of one degree of freedom from their geometry, without the solver.
module ranks
    use asserts, only: check_below
    use model_bricard, only: bricard_type
    use model_four_bar, only: four_bar_type
    use svd, only: pseudo_solve, singular_values
    use tandem, only: model_type, terms_type, wp
    use terms_at, only: get_terms
    use testdrive, only: error_type
    use watch, only: natural_errors
    implicit none (type, external)
    private

    public :: cut, judge, check_state, travel_time, bricard_angle

    !> Singular values up to this part of the largest count as zero: rounding leaves 1e-16, the smallest true one
    !> of the tests is 1e-5.
    real(wp), parameter :: cut = 1.0e-10_wp

contains

    !> The rank of C, its smallest counted and its largest uncounted singular value over the largest.
    subroutine judge(model, t, q, rank, smallest, noise)
        class(model_type), intent(inout) :: model
        real(wp), intent(in) :: t, q(:)
        integer, intent(out) :: rank
        real(wp), intent(out) :: smallest, noise
        type(terms_type) :: terms
        real(wp), allocatable :: s(:)
        integer :: stat

        call get_terms(model, t, q, 0*q, terms, stat)
        s = singular_values(terms%jacobian)
        rank = count(s > cut*s(1))
        smallest = s(rank)/s(1)
        noise = 0.0_wp
        if (rank < size(s)) noise = s(rank + 1)/s(1)
    end subroutine judge

    !> All three levels of the constraints at a state, with the acceleration that solves the equations of motion by the
    !> pseudo-inverse: [M C'; C 0] [qdd; lambda] = [S + Q_A; -gamma].
    subroutine check_state(model, t, q, qd, what, error)
        class(model_type), intent(inout) :: model
        real(wp), intent(in) :: t, q(:), qd(:)
        character(len=*), intent(in) :: what
        type(error_type), allocatable, intent(inout) :: error
        type(terms_type) :: terms
        real(wp), allocatable :: matrix(:, :), x(:)
        real(wp) :: errors(3)
        integer :: stat, n, m

        if (allocated(error)) return
        call get_terms(model, t, q, qd, terms, stat)
        n = size(q)
        m = size(terms%nu)
        allocate (matrix(n + m, n + m), source=0.0_wp)
        matrix(:n, :n) = terms%mass
        matrix(:n, n + 1:) = transpose(terms%jacobian)
        matrix(n + 1:, :n) = terms%jacobian
        x = pseudo_solve(matrix, [terms%force, -terms%gamma], cut)
        call natural_errors(terms, model%n_holonomic, spread(1.0_wp, 1, n), q, qd, x(:n), errors)
        ! Rounding of sums of a few terms, and of an SVD for qdd.
        call check_below(error, maxval(errors(:2)), 2.0e-15_wp, what//': position and velocity error')
        call check_below(error, errors(3), 1.0e-12_wp, what//': acceleration error')
    end subroutine check_state

    !> Duration of the motion of a mechanism of one degree of freedom from one angle to another, from its geometry and energy alone:
    !> t = integral of sqrt(m(a)/(2 (E - V(a)))) da, m = q_a' M q_a, by Gauss's rule. The rate must not change its sign.
    real(wp) function travel_time(model, from, to, rate)
        class(model_type), intent(inout) :: model
        !> Angles, and the rate at the first.
        real(wp), intent(in) :: from, to, rate
        !> Nodes and weights of five points on (-1, 1).
        real(wp), parameter :: node(5) = [-0.906179845938663993_wp, -0.538469310105683091_wp, 0.0_wp, 0.538469310105683091_wp, &
            0.906179845938663993_wp]
        real(wp), parameter :: weight(5) = [0.236926885056189088_wp, 0.478628670499366468_wp, 0.568888888888888889_wp, &
            0.478628670499366468_wp, 0.236926885056189088_wp]
        integer, parameter :: panels = 200
        real(wp) :: total, inertia, potential, width
        integer :: i, k

        call look(from, inertia, potential)
        total = inertia*rate**2/2 + potential
        width = (to - from)/panels
        travel_time = 0.0_wp
        do i = 1, panels
            do k = 1, 5
                call look(from + (i - 0.5_wp + node(k)/2)*width, inertia, potential)
                travel_time = travel_time + width/2*weight(k)*sqrt(inertia/(2*(total - potential)))
            end do
        end do
        travel_time = abs(travel_time)

    contains

        !> Inertia and potential energy at an angle.
        subroutine look(angle, inertia, potential)
            real(wp), intent(in) :: angle
            real(wp), intent(out) :: inertia, potential
            type(terms_type) :: terms
            real(wp) :: q(model%n), qd(model%n)
            integer :: stat

            select type (model)
            class is (four_bar_type)
                call model%start(angle, 1.0_wp, q, qd)
            class is (bricard_type)
                call model%start(angle, 1.0_wp, q, qd)
            class default
                error stop 'travel_time: no such mechanism'
            end select
            call get_terms(model, 0.0_wp, q, qd, terms, stat)
            inertia = dot_product(qd, matmul(terms%mass, qd))
            call model%potential_energy(0.0_wp, q, potential, stat)
        end subroutine look
    end function travel_time

    !> The angle at P1 of a state: rod 1 runs along (cos, 0, sin).
    pure real(wp) function bricard_angle(q)
        real(wp), intent(in) :: q(:)

        bricard_angle = atan2(q(3), q(1))
    end function bricard_angle
end module ranks
