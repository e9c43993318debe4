! SPDX-License-Identifier: MIT
!> An independent solver for any model, for the tests: the index-1 equations with multipliers, [M C'; C 0] [qdd; lambda] = [S + Q_A;
!> -gamma], for (q, qd) in ambient coordinates, unprojected, by extrapolation of order 16. It uses only the model's own procedures
!> of the library.
module kkt
    use extrapolation, only: equation_type, extrapolate
    use tandem, only: model_type, terms_type, wp
    use terms_at, only: get_terms
    implicit none (type, external)
    private

    public :: kkt_type, solve_independently

    !> y = (q, qd).
    type, extends(equation_type) :: kkt_type
        class(model_type), pointer :: model => null()
    contains
        procedure :: slope
        procedure :: accelerate
        procedure :: project
    end type kkt_type

contains

    !> Integrate (q, qd) from t to t_end, across the breakpoints between; at jumps of nu, qd is projected in the mass metric. The
    !> model must be in its first segment.
    subroutine solve_independently(model, t, t_end, macro_step, q, qd)
        class(model_type), intent(inout), target :: model
        real(wp), intent(in) :: t, t_end
        !> Largest step of the extrapolation.
        real(wp), intent(in) :: macro_step
        real(wp), intent(inout) :: q(:), qd(:)
        type(kkt_type) :: equation
        real(wp) :: y(2*size(q)), from, to
        integer :: i

        equation%model => model
        y = [q, qd]
        from = t
        if (allocated(model%breakpoints)) then
            do i = 1, size(model%breakpoints)
                to = model%breakpoints(i)
                if (to > t_end) exit
                call extrapolate(equation, from, to, ceiling((to - from)/macro_step), y)
                model%segment = i + 1
                if (allocated(model%nu_jumps)) then
                    if (model%nu_jumps(i)) call equation%project(to, y(:size(q)), y(size(q) + 1:))
                end if
                from = to
            end do
        end if
        if (from < t_end) call extrapolate(equation, from, t_end, ceiling((t_end - from)/macro_step), y)
        q = y(:size(q))
        qd = y(size(q) + 1:)
    end subroutine solve_independently

    !> y' = (qd, qdd).
    subroutine slope(self, t, y, yd)
        class(kkt_type), intent(in) :: self
        real(wp), intent(in) :: t, y(:)
        real(wp), intent(out) :: yd(:)
        real(wp) :: lambda(self%model%n_constraints())

        associate (n => self%model%n)
            yd(:n) = y(n + 1:)
            call self%accelerate(t, y(:n), y(n + 1:), yd(n + 1:), lambda)
        end associate
    end subroutine slope

    !> qdd and lambda at a point.
    subroutine accelerate(self, t, q, qd, qdd, lambda)
        class(kkt_type), intent(in) :: self
        real(wp), intent(in) :: t, q(:), qd(:)
        real(wp), intent(out) :: qdd(:), lambda(:)
        type(terms_type) :: terms
        real(wp) :: x(size(q) + size(lambda))
        integer :: stat

        call get_terms(self%model, t, q, qd, terms, stat)
        if (stat /= 0) error stop 'kkt: the model cannot be evaluated'
        x = [terms%force, -terms%gamma]
        call solve_bordered(terms, x)
        qdd = x(:size(q))
        lambda = x(size(q) + 1:)
    end subroutine accelerate

    !> qd := the minimizer of (x - qd)' M (x - qd) subject to C x = nu: [M C'; C 0] [x; mu] = [M qd; nu].
    subroutine project(self, t, q, qd)
        class(kkt_type), intent(in) :: self
        real(wp), intent(in) :: t, q(:)
        real(wp), intent(inout) :: qd(:)
        type(terms_type) :: terms
        real(wp) :: x(size(q) + self%model%n_constraints())
        integer :: stat

        call get_terms(self%model, t, q, qd, terms, stat)
        if (stat /= 0) error stop 'kkt: the model cannot be evaluated'
        x = [matmul(terms%mass, qd), terms%nu]
        call solve_bordered(terms, x)
        qd = x(:size(q))
    end subroutine project

    !> x := [M C'; C 0]^-1 x, by Gaussian elimination with partial pivoting and rows scaled to equal size.
    subroutine solve_bordered(terms, x)
        type(terms_type), intent(in) :: terms
        real(wp), intent(inout) :: x(:)
        real(wp) :: a(size(x), size(x) + 1), row(size(x) + 1)
        integer :: n, i, k, p

        n = size(terms%force)
        a = 0.0_wp
        a(:n, :n) = terms%mass
        a(:n, n + 1:size(x)) = transpose(terms%jacobian)
        a(n + 1:, :n) = terms%jacobian
        a(:, size(x) + 1) = x
        do i = 1, size(x)
            a(i, :) = a(i, :)/maxval(abs(a(i, :size(x))))
        end do
        do k = 1, size(x)
            p = k - 1 + maxloc(abs(a(k:, k)), dim=1)
            row = a(p, :)
            a(p, :) = a(k, :)
            a(k, :) = row/row(k)
            do i = k + 1, size(x)
                a(i, k:) = a(i, k:) - a(i, k)*a(k, k:)
            end do
        end do
        do k = size(x), 1, -1
            x(k) = a(k, size(x) + 1) - dot_product(a(k, k + 1:size(x)), x(k + 1:))
        end do
    end subroutine solve_bordered
end module kkt
