! SPDX-License-Identifier: MIT
!> The algorithm of the code RADAU5, dense, on the stabilised index-2 equations (`tandem_bench_stabilised`): Radau IIA of 3 stages,
!> a simplified Newton iteration of one real and one complex system, starting from the collocation polynomial; the error estimate
!> through the real matrix; the predictive controller; matrices reused while the iteration converges fast and the step size hardly
!> changes. Its parameters have the default values of that code. Linear systems are solved by LAPACK.
!>
!> Source: Hairer, Wanner, Solving Ordinary Differential Equations II, 2nd ed., section IV.8, with the mass matrix in place of the
!> identity; written from this description. M depends on q, so that the unknowns of stages are rates and the equations are written
!> as F(t, y, yd) = 0. Multipliers are excluded from norms, as with IDA.
module tandem_bench_by_radau5
    use tandem, only: wp
    use tandem_bench_solver, only: next_stop, problem_type, solver_type
    use tandem_bench_stabilised, only: of_multipliers, system_type
    use tandem_linalg_lapack, only: dgetrf, dgetrs, zgetrf, zgetrs
    implicit none (type, external)
    private

    public :: radau5_type

    real(wp), parameter :: s6 = sqrt(6.0_wp), root81 = 81.0_wp**(1.0_wp/3), root9 = 9.0_wp**(1.0_wp/3)
    !> Nodes; the weights of the error estimate; the real eigenvalue of A^-1 and the complex one.
    real(wp), parameter :: c(3) = [(4 - s6)/10, (4 + s6)/10, 1.0_wp]
    real(wp), parameter :: dd(3) = [-(13 + 7*s6)/3, (-13 + 7*s6)/3, -1.0_wp/3]
    real(wp), parameter :: gamma = 30.0_wp/(6 + root81 - root9)
    complex(wp), parameter :: pair = 1.0_wp/cmplx((12 - root81 + root9)/60, -(root81 + root9)*sqrt(3.0_wp)/60, wp)
    !> T^-1 A^-1 T = diag(gamma, pair): T and T^-1 by columns.
    real(wp), parameter :: t_matrix(3, 3) = reshape([ &
        9.1232394870892942792e-02_wp, 0.24171793270710701896_wp, 0.96604818261509293619_wp, &
        -0.14125529502095420843_wp, 0.20412935229379993199_wp, 1.0_wp, &
        -3.0029194105147424492e-02_wp, 0.38294211275726193779_wp, 0.0_wp], [3, 3])
    real(wp), parameter :: t_inverse(3, 3) = reshape([ &
        4.3255798900631553510_wp, -4.1787185915519047273_wp, -0.50287263494578687595_wp, &
        0.33919925181580986954_wp, -0.32768282076106238708_wp, 2.5719269498556054292_wp, &
        0.54177053993587487119_wp, 0.47662355450055045196_wp, -0.59603920482822492497_wp], [3, 3])
    !> Largest number of Newton iterations; contraction below which matrices are reused; growth of the step for which they are.
    integer, parameter :: most_iterations = 7
    real(wp), parameter :: fast = 1.0e-3_wp, hardly(2) = [1.0_wp, 1.2_wp]
    !> Controller: safety factor, and bounds of the divisor of the step size.
    real(wp), parameter :: safety = 0.9_wp, least_quotient = 0.125_wp, largest_quotient = 5.0_wp
    !> First step size.
    real(wp), parameter :: first_step = 1.0e-6_wp

    type, extends(solver_type) :: radau5_type
        private
        type(system_type) :: system
        real(wp) :: t_start = 0.0_wp, t_end = 0.0_wp, rtol = 0.0_wp, atol = 0.0_wp
        !> Unknowns and their rates, weights, an error, a right-hand side (size).
        real(wp), allocatable :: y(:), yd(:), scale(:), error(:), rhs(:)
        !> Stages minus y, their transforms, rates, residuals and corrections (size, 3); divided differences of the last step.
        real(wp), allocatable :: z(:, :), w(:, :), rate(:, :), change(:, :), past(:, :)
        !> dF/dy, both factored matrices (size, size), a complex right-hand side.
        real(wp), allocatable :: gradient(:, :), real_matrix(:, :)
        complex(wp), allocatable :: pair_matrix(:, :), pair_rhs(:)
        integer, allocatable :: real_pivots(:), pair_pivots(:)
        !> theta/(1 - theta) of the last iteration, its theta, and its number of corrections.
        real(wp) :: remainder = 1.0_wp, theta = 0.0_wp
        integer :: iterations = 0
    contains
        procedure :: prepare
        procedure :: run
        procedure, private :: cross
        procedure, private :: factor
        procedure, private :: start_stages
        procedure, private :: solve_stages
        procedure, private :: correct
        procedure, private :: estimate
        procedure, private :: keep_past
    end type radau5_type

contains

    !> Allocate, and make the start consistent.
    subroutine prepare(self, problem, control, stat)
        class(radau5_type), intent(inout), target :: self
        type(problem_type), intent(in) :: problem
        real(wp), intent(in) :: control
        integer, intent(out) :: stat

        call self%system%define(problem%model)
        self%t_start = problem%t_start
        self%t_end = problem%t_end
        ! The estimate is of order 3: the code uses a smaller tolerance for it, so that errors are about the given one.
        self%rtol = 0.1_wp*control**(2.0_wp/3)
        self%atol = self%rtol
        associate (n => self%system%n, size => self%system%size)
            if (allocated(self%y)) deallocate (self%y, self%yd, self%scale, self%error, self%rhs, self%z, self%w, self%rate, &
                self%change, self%past, self%gradient, self%real_matrix, self%pair_matrix, self%pair_rhs, self%real_pivots, &
                self%pair_pivots)
            allocate (self%y(size), self%yd(size), self%scale(size), self%error(size), self%rhs(size), self%z(size, 3), &
                self%w(size, 3), self%rate(size, 3), self%change(size, 3), self%past(size, 3), self%gradient(size, size), &
                self%real_matrix(size, size), source=0.0_wp)
            allocate (self%pair_matrix(size, size), self%pair_rhs(size), source=(0.0_wp, 0.0_wp))
            allocate (self%real_pivots(size), self%pair_pivots(size), source=0)
            self%y(:n) = problem%q
            self%y(n + 1:2*n) = problem%qd
            self%q = problem%q
        end associate
        call self%system%make_consistent(self%t_start, self%y, self%yd, stat)
    end subroutine prepare

    !> Integrate one smooth piece after the other.
    subroutine run(self, stat)
        class(radau5_type), intent(inout), target :: self
        integer, intent(out) :: stat
        real(wp) :: t, stop_at

        self%steps = 0
        self%rejected = 0
        t = self%t_start
        do
            stop_at = next_stop(self%system%model, self%t_end)
            call self%cross(t, stop_at, stat)
            t = stop_at
            if (stat /= 0 .or. t >= self%t_end) exit
            self%system%model%segment = self%system%model%segment + 1
            call self%system%make_consistent(t, self%y, self%yd, stat)
            if (stat /= 0) exit
        end do
        self%evaluations = self%system%evaluations
        self%q = self%y(:self%system%n)
    end subroutine run

    !> Integrate one smooth piece.
    subroutine cross(self, t_start, t_end, stat)
        class(radau5_type), intent(inout) :: self
        real(wp), intent(in) :: t_start, t_end
        integer, intent(out) :: stat
        real(wp) :: t, h, last_h, last_error, error, shrink, quotient
        logical :: is_first, is_last, is_retry, has_gradient, needs_gradient, needs_factor, is_solved

        t = t_start
        h = min(first_step, t_end - t_start)
        last_h = h
        last_error = 1.0_wp
        self%remainder = 1.0_wp
        is_first = .true.
        is_last = .false.
        is_retry = .false.
        has_gradient = .false.
        needs_gradient = .true.
        needs_factor = .true.
        call weigh(self)
        do
            stat = merge(1, 0, 0.1_wp*h <= abs(t)*epsilon(t))
            if (stat == 0 .and. needs_gradient) then
                call self%system%find_gradient(t, self%y, self%yd, self%gradient, stat)
                has_gradient = .true.
            end if
            if (stat == 0 .and. needs_factor) call self%factor(h, stat)
            if (stat /= 0) return
            call self%start_stages(h/last_h, is_first)
            call self%solve_stages(t, h, is_solved, shrink)
            if (is_solved) then
                call self%estimate(t, h, is_first .or. is_retry, error)
                ! More iterations than usual lead to shorter steps.
                quotient = error**0.25_wp/min(safety, safety*(1 + 2*most_iterations)/(self%iterations + 2*most_iterations))
                quotient = max(least_quotient, min(largest_quotient, quotient))
                shrink = merge(0.1_wp, 1.0_wp/quotient, is_first)
            end if
            if (.not. (is_solved .and. error < 1.0_wp)) then
                self%rejected = self%rejected + 1
                h = shrink*h
                is_retry = .true.
                is_last = .false.
                needs_gradient = .not. has_gradient
                needs_factor = .true.
                cycle
            end if
            self%steps = self%steps + 1
            if (.not. is_first) quotient = max(quotient, max(least_quotient, min(largest_quotient, &
                last_h/h*(error**2/last_error)**0.25_wp/safety)))
            last_h = h
            last_error = max(1.0e-2_wp, error)
            t = t + h
            self%y = self%y + self%z(:, 3)
            self%yd = self%rate(:, 3)
            if (is_last) return
            call self%keep_past()
            call weigh(self)
            h = h/quotient
            if (is_retry) h = min(h, last_h)
            is_first = .false.
            is_retry = .false.
            has_gradient = .false.
            needs_gradient = self%theta > fast
            is_last = t + h >= t_end
            needs_factor = is_last .or. needs_gradient .or. h < hardly(1)*last_h .or. h > hardly(2)*last_h
            if (is_last) h = t_end - t
            if (.not. needs_factor) h = last_h
        end do
    end subroutine cross

    !> Scales of the errors.
    pure subroutine weigh(self)
        class(radau5_type), intent(inout) :: self
        integer :: n

        n = 2*self%system%n
        self%scale(:n) = self%atol + self%rtol*abs(self%y(:n))
        self%scale(n + 1:) = of_multipliers
    end subroutine weigh

    !> Weighted root mean square of a vector.
    pure real(wp) function norm(self, x)
        class(radau5_type), intent(in) :: self
        real(wp), intent(in) :: x(:)

        norm = sqrt(sum((x/self%scale)**2)/(2*self%system%n))
    end function norm

    !> Factor both matrices for a step h.
    subroutine factor(self, h, stat)
        class(radau5_type), intent(inout) :: self
        real(wp), intent(in) :: h
        integer, intent(out) :: stat

        associate (n => self%system%size)
            self%real_matrix = 0.0_wp
            call self%system%add_rates(1.0_wp, self%real_matrix)
            self%pair_matrix = (pair/h)*self%real_matrix + self%gradient
            self%real_matrix = (gamma/h)*self%real_matrix + self%gradient
            call dgetrf(n, n, self%real_matrix, n, self%real_pivots, stat)
            if (stat == 0) call zgetrf(n, n, self%pair_matrix, n, self%pair_pivots, stat)
        end associate
    end subroutine factor

    !> Start values of the stages: extrapolate the last step's polynomial.
    subroutine start_stages(self, ratio, is_first)
        class(radau5_type), intent(inout) :: self
        !> Ratio of the step to the last one.
        real(wp), intent(in) :: ratio
        logical, intent(in) :: is_first
        real(wp) :: x
        integer :: i

        self%z = 0.0_wp
        self%w = 0.0_wp
        if (is_first) return
        do i = 1, 3
            x = c(i)*ratio
            self%z(:, i) = x*(self%past(:, 1) + (x - (c(2) - 1))*(self%past(:, 2) + (x - (c(1) - 1))*self%past(:, 3)))
        end do
        self%w = matmul(self%z, transpose(t_inverse))
    end subroutine start_stages

    !> Divided differences of this polynomial, about the end of the step.
    pure subroutine keep_past(self)
        class(radau5_type), intent(inout) :: self
        integer :: i
        real(wp) :: slope

        do i = 1, size(self%y)
            self%past(i, 1) = (self%z(i, 2) - self%z(i, 3))/(c(2) - 1)
            slope = (self%z(i, 1) - self%z(i, 2))/(c(1) - c(2))
            self%past(i, 2) = (slope - self%past(i, 1))/(c(1) - 1)
            self%past(i, 3) = self%past(i, 2) - (slope - self%z(i, 1)/c(1))/c(2)
        end do
    end subroutine keep_past

    !> The simplified Newton iteration.
    subroutine solve_stages(self, t, h, is_solved, shrink)
        class(radau5_type), intent(inout) :: self
        real(wp), intent(in) :: t, h
        logical, intent(out) :: is_solved
        !> Factor of the step size after a failure to converge.
        real(wp), intent(out) :: shrink
        real(wp) :: size_of, last_size, ratio, last_ratio, enough, left
        integer :: k, stat

        is_solved = .false.
        shrink = 0.5_wp
        enough = max(10*epsilon(h)/self%rtol, min(0.03_wp, sqrt(self%rtol)))
        self%remainder = max(self%remainder, epsilon(h))**0.8_wp
        self%theta = fast
        last_ratio = 1.0_wp
        last_size = 1.0_wp
        do k = 1, most_iterations
            self%iterations = k
            call self%correct(t, h, size_of, stat)
            if (stat /= 0 .or. .not. size_of <= huge(h)) return
            if (k > 1 .and. k < most_iterations) then
                ratio = size_of/last_size
                self%theta = merge(ratio, sqrt(ratio*last_ratio), k == 2)
                last_ratio = ratio
                if (.not. self%theta < 0.99_wp) return
                self%remainder = self%theta/(1.0_wp - self%theta)
                left = self%remainder*size_of*self%theta**(most_iterations - 1 - k)/enough
                if (left >= 1.0_wp) then
                    shrink = 0.8_wp*max(1.0e-4_wp, min(20.0_wp, left))**(-1.0_wp/(4 + most_iterations - 1 - k))
                    return
                end if
            end if
            last_size = max(size_of, epsilon(h))
            self%w = self%w + self%change
            self%z = matmul(self%w, transpose(t_matrix))
            is_solved = self%remainder*size_of <= enough
            if (is_solved) exit
        end do
        ! The rates at the end are those of the final stage.
        if (is_solved) self%rate(:, 3) = rates(self, 3, h)
    end subroutine solve_stages

    !> The rates of a stage, (A^-1 z)/h.
    pure function rates(self, i, h)
        class(radau5_type), intent(in) :: self
        integer, intent(in) :: i
        real(wp), intent(in) :: h
        real(wp) :: rates(size(self%y))
        real(wp) :: weight(3)

        weight(1) = gamma*t_matrix(i, 1)
        weight(2) = real(pair)*t_matrix(i, 2) + aimag(pair)*t_matrix(i, 3)
        weight(3) = real(pair)*t_matrix(i, 3) - aimag(pair)*t_matrix(i, 2)
        rates = (weight(1)*self%w(:, 1) + weight(2)*self%w(:, 2) + weight(3)*self%w(:, 3))/h
    end function rates

    !> One correction of all stages.
    subroutine correct(self, t, h, size_of, stat)
        class(radau5_type), intent(inout) :: self
        real(wp), intent(in) :: t, h
        real(wp), intent(out) :: size_of
        integer, intent(out) :: stat
        integer :: i

        size_of = 0.0_wp
        associate (n => self%system%size)
            do i = 1, 3
                self%rate(:, i) = rates(self, i, h)
                self%error = self%y + self%z(:, i)
                call self%system%find_residual(t + c(i)*h, self%error, self%rate(:, i), self%change(:, i), stat)
                if (stat /= 0) return
            end do
            self%change = -matmul(self%change, transpose(t_inverse))
            call dgetrs('N', n, 1, self%real_matrix, n, self%real_pivots, self%change(:, 1), n, stat)
            self%pair_rhs = cmplx(self%change(:, 2), self%change(:, 3), wp)
            call zgetrs('N', n, 1, self%pair_matrix, n, self%pair_pivots, self%pair_rhs, n, stat)
            self%change(:, 2) = real(self%pair_rhs)
            self%change(:, 3) = aimag(self%pair_rhs)
            size_of = sqrt((norm(self, self%change(:, 1))**2 + norm(self, self%change(:, 2))**2 + &
                norm(self, self%change(:, 3))**2)/3)
        end associate
    end subroutine correct

    !> Error of the step; if it is large in a first step or after a rejection, evaluated again with the force at the result.
    subroutine estimate(self, t, h, may_repeat, error)
        class(radau5_type), intent(inout) :: self
        real(wp), intent(in) :: t, h
        logical, intent(in) :: may_repeat
        real(wp), intent(out) :: error
        integer :: stat

        associate (n => self%system%size)
            self%change(:, 1) = (dd(1)*self%z(:, 1) + dd(2)*self%z(:, 2) + dd(3)*self%z(:, 3))/h
            self%change(:, 2) = self%change(:, 1) + self%yd
            call self%system%multiply_rates(self%change(:, 2), self%error)
            call dgetrs('N', n, 1, self%real_matrix, n, self%real_pivots, self%error, n, stat)
            error = max(norm(self, self%error), 1.0e-10_wp)
            if (error < 1.0_wp .or. .not. may_repeat) return
            self%change(:, 2) = 0.0_wp
            self%change(:, 3) = self%y + self%error
            call self%system%find_residual(t, self%change(:, 3), self%change(:, 2), self%rhs, stat)
            if (stat /= 0) return
            call self%system%multiply_rates(self%change(:, 1), self%error)
            self%error = self%error - self%rhs
            call dgetrs('N', n, 1, self%real_matrix, n, self%real_pivots, self%error, n, stat)
            error = max(norm(self, self%error), 1.0e-10_wp)
        end associate
    end subroutine estimate
end module tandem_bench_by_radau5
