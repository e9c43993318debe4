! SPDX-License-Identifier: MIT
!> The consistent position nearest to a given one: minimise sum_j w_j (q_j - q0_j)^2 / 2 over the free coordinates subject to
!> Phi(t, q) = 0, in bounded work.
!>
!> First the constraints are reached by Gauss-Newton steps of smallest norm within a trust region, then the distance is minimised
!> along them by Newton's iteration in their tangent space, each step brought back by the first procedure. Coordinates here are
!> y = (q - q0) / width with width = w^(-1/2), rows those of A = Phi_q diag(width) at unit length. At the nearest point
!> y + A' lambda = 0, which gives the part of each row in the move of each coordinate.
!>
!> Source: J. Nocedal, S. J. Wright, Numerical Optimization, 2nd ed., Springer, 2006: trust regions for least squares (section
!> 10.3), the reduced Hessian (section 18.3).
module tandem_simulate_nearest_position
    use tandem_kinds, only: wp
    use tandem_linalg_singular, only: decompose_symmetric, singular_type
    use tandem_model_evaluator, only: evaluator_type
    use tandem_model_terms, only: need_jacobian, need_phi
    use tandem_status, only: status_callback_failed, status_inconsistent_start, status_not_finite, status_ok
    use tandem_model_counts, only: counts_type
    use tandem_model_natural_scale, only: position_errors
    use, intrinsic :: ieee_arithmetic, only: ieee_is_finite
    implicit none (type, external)
    private

    public :: nearest_position_type

    !> A point with Phi (nh), Phi_q (nh, n), the natural scales of the rows (nh) and the largest error on them.
    type :: point_type
        real(wp), allocatable :: q(:), phi(:), jacobian(:, :), row_scale(:)
        real(wp) :: error = 0.0_wp
    end type point_type

    !> The search for the nearest position on the constraints.
    type :: nearest_position_type
        !> Number of points tried so far, and its limit.
        integer :: trials = 0, most_trials = 200
        !> True if q is known to be nearest to q0, among the points around it.
        logical :: is_nearest = .false.
        !> Part of each row in the move of each coordinate (nh, n).
        real(wp), allocatable :: pull(:, :)
        !> The value of Phi to reach (nh), 0 unless it is set after `initialize`.
        real(wp), allocatable :: goal(:)
        !> After inconsistent_start: the row that is violated most, its residual, also on its natural scale.
        integer :: failed_row = 0
        real(wp) :: failed_amount = 0.0_wp, failed_value = 0.0_wp
        integer, private :: n = 0, nh = 0
        !> Indices of the free coordinates, and w^(-1/2) of each (size of `free`); scales of all coordinates (n).
        integer, allocatable, private :: free(:)
        real(wp), allocatable, private :: width(:), scale(:)
        !> Largest violation of a satisfied constraint, on the natural scale.
        real(wp), private :: tolerance = 0.0_wp
        !> q0, the current point, and the best one so far.
        real(wp), allocatable, private :: q0(:)
        type(point_type), private :: here, kept
        !> The status of a trial point that could not be evaluated, if that was the last.
        integer, private :: obstacle = status_ok
        !> Lengths of the rows and their natural scales at q0 (nh), A (nh, free).
        real(wp), allocatable, private :: length(:), first_scale(:), a(:, :)
        type(singular_type), private :: singular
    contains
        procedure :: initialize, find
        procedure, private :: evaluate, try, factor, radius, reach, kick, approach, walk, get_hessian, blame
    end type nearest_position_type

contains

    !> Allocate for a problem.
    subroutine initialize(self, nh, is_fixed, weight, scale, tolerance, most_trials)
        class(nearest_position_type), intent(inout) :: self
        !> Number of holonomic constraints.
        integer, intent(in) :: nh
        !> True for coordinates that are fixed (n); weights > 0 and typical magnitudes of the coordinates (n).
        logical, intent(in) :: is_fixed(:)
        real(wp), intent(in) :: weight(:), scale(:)
        !> Largest violation of a satisfied constraint, on the natural scale; limit of the number of points.
        real(wp), intent(in) :: tolerance
        integer, intent(in) :: most_trials
        integer :: j

        self%n = size(scale)
        self%nh = nh
        self%free = pack([(j, j=1, self%n)], .not. is_fixed)
        self%width = 1.0_wp/sqrt(weight(self%free))
        self%scale = scale
        self%tolerance = tolerance
        self%most_trials = most_trials
        self%length = spread(0.0_wp, 1, nh)
        self%goal = self%length
        if (allocated(self%a)) deallocate (self%a)
        allocate (self%a(nh, size(self%free)), source=0.0_wp)
        if (allocated(self%pull)) deallocate (self%pull)
        allocate (self%pull(nh, self%n), source=0.0_wp)
        if (nh > 0) call self%singular%allocate(nh, size(self%free))
    end subroutine initialize

    !> q := the nearest consistent position; a consistent one is unchanged bitwise. Statuses: inconsistent_start, callback_failed,
    !> not_evaluable, not_finite; with each of them q is unchanged.
    subroutine find(self, model, t, q, counts, stat)
        class(nearest_position_type), intent(inout) :: self
        type(evaluator_type), intent(inout) :: model
        !> Time, coordinates (n).
        real(wp), intent(in) :: t
        real(wp), intent(inout), contiguous :: q(:)
        type(counts_type), intent(inout) :: counts
        !> A status code.
        integer, intent(out) :: stat

        self%trials = 0
        self%is_nearest = .true.
        stat = status_ok
        if (self%nh == 0) return
        self%q0 = q
        call self%evaluate(model, t, q, self%here, counts, stat)
        if (stat /= status_ok .or. self%here%error <= self%tolerance) return
        self%first_scale = self%here%row_scale
        self%is_nearest = .false.
        call self%reach(model, t, self%most_trials, counts, stat)
        if (stat == status_inconsistent_start) then
            ! If Phi_q loses rank, as in the centre of a circle, no step is determined although a solution may be near.
            call self%kick(model, t, counts, stat)
            if (stat == status_ok) call self%reach(model, t, self%most_trials, counts, stat)
        end if
        if (stat == status_ok) call self%approach(model, t, counts, stat)
        if (stat == status_ok) q = self%here%q
        if (stat == status_inconsistent_start) call self%blame()
    end subroutine find

    !> Phi and Phi_q at a point.
    subroutine evaluate(self, model, t, q, point, counts, stat)
        class(nearest_position_type), intent(inout) :: self
        type(evaluator_type), intent(inout) :: model
        real(wp), intent(in) :: t
        real(wp), intent(in), contiguous :: q(:)
        type(point_type), intent(out) :: point
        type(counts_type), intent(inout) :: counts
        integer, intent(out) :: stat
        real(wp) :: magnitude(self%n)
        integer :: i, j, row

        ! Neither depends on the velocity; q is passed in its place.
        call model%evaluate(need_phi, t, q, q, counts, stat)
        if (stat /= status_ok) return
        point%q = q
        point%phi = model%terms%phi - self%goal
        if (.not. all(ieee_is_finite(point%phi))) then
            stat = status_not_finite
            model%failed_term = 'phi'
            return
        end if
        call model%evaluate(need_jacobian, t, q, q, counts, stat)
        if (stat /= status_ok) return
        point%jacobian = model%terms%jacobian(:self%nh, :)
        if (.not. all(ieee_is_finite(point%jacobian))) then
            stat = status_not_finite
            model%failed_term = 'jacobian'
            return
        end if
        call model%set_magnitudes(point%q, magnitude)
        call position_errors(point%phi, point%jacobian, magnitude, self%scale, point%error, row)
        point%row_scale = spread(tiny(1.0_wp), 1, self%nh)
        do j = 1, self%n
            magnitude(j) = max(abs(magnitude(j)), self%scale(j))
            do i = 1, self%nh
                point%row_scale(i) = point%row_scale(i) + abs(point%jacobian(i, j))*magnitude(j)
            end do
        end do
    end subroutine evaluate

    !> Try the step width dy; a point that is not evaluable is an obstacle to be avoided by a shorter step.
    subroutine try(self, model, t, dy, point, counts, stat)
        class(nearest_position_type), intent(inout) :: self
        type(evaluator_type), intent(inout) :: model
        real(wp), intent(in) :: t, dy(:)
        type(point_type), intent(out) :: point
        type(counts_type), intent(inout) :: counts
        !> callback_failed ends the search.
        integer, intent(out) :: stat
        real(wp) :: q(self%n)

        self%trials = self%trials + 1
        q = self%here%q
        q(self%free) = q(self%free) + self%width*dy
        call self%evaluate(model, t, q, point, counts, self%obstacle)
        stat = merge(status_callback_failed, status_ok, self%obstacle == status_callback_failed)
    end subroutine try

    !> A and its singular values at the current point. A row that no free coordinate moves is zero, with its scale as length.
    subroutine factor(self)
        class(nearest_position_type), intent(inout) :: self
        integer :: i, j

        do j = 1, size(self%free)
            self%a(:, j) = self%here%jacobian(:, self%free(j))*self%width(j)
        end do
        do i = 1, self%nh
            self%length(i) = norm2(self%a(i, :))
            if (.not. self%length(i) > 0.0_wp) self%length(i) = max(self%first_scale(i), self%here%row_scale(i))
            self%a(i, :) = self%a(i, :)/self%length(i)
        end do
        call self%singular%factor(self%a)
    end subroutine factor

    !> The first trust region: no coordinate moves by more than its scale, so that no angle makes a full turn at once.
    pure real(wp) function radius(self)
        class(nearest_position_type), intent(in) :: self

        radius = minval(self%scale(self%free)/self%width)
    end function radius

    !> From the current point to the constraints by steps of smallest norm. inconsistent_start: no step reduces the error.
    subroutine reach(self, model, t, most_trials, counts, stat)
        class(nearest_position_type), intent(inout) :: self
        type(evaluator_type), intent(inout) :: model
        real(wp), intent(in) :: t
        !> The value of `trials` that ends the search.
        integer, intent(in) :: most_trials
        type(counts_type), intent(inout) :: counts
        integer, intent(out) :: stat
        !> Rounding level of an error; ratio of errors without progress, and the number of such steps that ends the search.
        real(wp), parameter :: finest = 4*epsilon(1.0_wp), slow_ratio = 0.99_wp
        integer, parameter :: most_slow = 10
        type(point_type) :: there
        real(wp) :: dy(size(self%free)), phi(self%nh), radius, before, after, predicted, noise
        integer :: slow, blocked
        logical :: is_factored

        radius = self%radius()
        slow = 0
        blocked = status_ok
        is_factored = .false.
        do while (self%here%error > finest .and. self%trials < most_trials .and. slow < most_slow .and. size(dy) > 0)
            if (.not. is_factored) call self%factor()
            is_factored = .true.
            phi = self%here%phi/self%length
            before = norm2(phi)
            noise = 4*epsilon(1.0_wp)*maxval(self%here%row_scale/self%length)
            if (self%here%error > self%tolerance) noise = 0.0_wp
            call self%singular%solve_within(-phi, radius, noise, dy)
            if (.not. is_step(self, dy)) exit
            call self%try(model, t, dy, there, counts, stat)
            if (stat /= status_ok) return
            predicted = norm2(phi + matmul(self%a, dy))
            after = huge(1.0_wp)
            if (self%obstacle == status_ok) after = norm2(there%phi/self%length)
            if (self%obstacle /= status_ok) blocked = self%obstacle
            if (.not. after < before) then
                ! Within the tolerance an error that no longer falls is at rounding level.
                if (self%here%error <= self%tolerance) exit
                radius = 0.25_wp*norm2(dy)
                cycle
            end if
            if (before**2 - after**2 > 0.75_wp*(before**2 - predicted**2)) radius = max(radius, 4*norm2(dy))
            if (before**2 - after**2 < 0.25_wp*(before**2 - predicted**2)) radius = 0.5_wp*norm2(dy)
            slow = slow + 1
            if (after < slow_ratio*before) then
                slow = 0
                blocked = status_ok
            end if
            self%here = there
            is_factored = .false.
        end do
        stat = merge(status_ok, status_inconsistent_start, self%here%error <= self%tolerance)
        if (stat /= status_ok .and. blocked /= status_ok) stat = blocked
    end subroutine reach

    !> True if a step moves any coordinate by more than rounding.
    pure logical function is_step(self, dy)
        type(nearest_position_type), intent(in) :: self
        real(wp), intent(in) :: dy(:)

        is_step = relative_size(self, dy) > 0.25_wp*epsilon(1.0_wp)
    end function is_step

    !> The largest change of a coordinate relative to its magnitude.
    pure real(wp) function relative_size(self, dy)
        type(nearest_position_type), intent(in) :: self
        real(wp), intent(in) :: dy(:)

        relative_size = maxval(abs(self%width*dy)/max(abs(self%here%q(self%free)), self%scale(self%free)))
    end function relative_size

    !> Leave a point without a descent direction, by a hundredth of the scales.
    subroutine kick(self, model, t, counts, stat)
        class(nearest_position_type), intent(inout) :: self
        type(evaluator_type), intent(inout) :: model
        real(wp), intent(in) :: t
        type(counts_type), intent(inout) :: counts
        integer, intent(out) :: stat
        type(point_type) :: there
        real(wp) :: dy(size(self%free))
        integer :: j

        stat = status_inconsistent_start
        if (size(dy) == 0 .or. self%trials >= self%most_trials) return
        ! Different for all coordinates, and nonzero.
        dy = [(0.01_wp*self%scale(self%free(j))/self%width(j)*(1.0_wp + 0.3_wp*cos(2.4_wp*j)), j=1, size(dy))]
        call self%try(model, t, dy, there, counts, stat)
        if (stat /= status_ok) return
        stat = merge(status_ok, status_inconsistent_start, self%obstacle == status_ok)
        if (stat == status_ok) self%here = there
    end subroutine kick

    !> From a point on the constraints to the nearest one. In every case the point stays on them.
    subroutine approach(self, model, t, counts, stat)
        class(nearest_position_type), intent(inout) :: self
        type(evaluator_type), intent(inout) :: model
        real(wp), intent(in) :: t
        type(counts_type), intent(inout) :: counts
        !> callback_failed, or ok.
        integer, intent(out) :: stat
        !> Steps below the first are rounding, steps below the second small; a relative fall of the squared distance below the third
        !> is no longer visible.
        real(wp), parameter :: rounding = 1.0e-15_wp, small = 1.0e-6_wp, invisible = 1.0e-11_wp
        !> Curvature below which a stationary point is a saddle or a maximum of the distance.
        real(wp), parameter :: hollow = -1.0e-6_wp
        real(wp), allocatable :: z(:, :), hessian(:, :), curvature(:), slope(:)
        real(wp) :: dy(size(self%free)), y(size(self%free)), lambda(self%nh), change, last_change, lowest
        logical :: has_moved, must_fall
        integer :: i

        stat = status_ok
        last_change = huge(1.0_wp)
        do
            call self%factor()
            y = (self%here%q(self%free) - self%q0(self%free))/self%width
            call self%singular%solve_transposed(-y, lambda)
            do i = 1, self%nh
                self%pull(i, self%free) = -self%width*self%a(i, :)*lambda(i)
            end do
            call self%singular%get_null_basis(z)
            if (size(z, 2) == 0) exit
            call self%get_hessian(model, t, z, lambda/self%length, hessian, counts, stat)
            if (stat /= status_ok) return
            curvature = spread(0.0_wp, 1, size(z, 2))
            call decompose_symmetric(hessian, curvature)
            slope = matmul(matmul(y, z), hessian)
            ! Newton's step, modified to descend if the distance has negative curvature.
            lowest = curvature(1)
            curvature = max(abs(curvature), 1.0e-3_wp*maxval(abs(curvature)), tiny(1.0_wp))
            dy = -matmul(z, matmul(hessian, slope/curvature))
            change = relative_size(self, dy)
            must_fall = sum(slope**2/curvature) > invisible*sum(y**2)
            if (lowest < hollow .and. norm2(slope) <= small*norm2(y)) then
                ! A point that is stationary but not nearest, such as the end of an ellipse's long axis: either side is nearer.
                dy = 0.1_wp*norm2(y)*matmul(z, hessian(:, 1))
                change = 1.0_wp
                must_fall = .true.
            end if
            self%is_nearest = change <= small
            if (change <= rounding .or. (.not. must_fall .and. change > 0.5_wp*last_change)) return
            if (self%trials >= self%most_trials) return
            call self%walk(model, t, dy, must_fall, counts, has_moved, stat)
            if (stat /= status_ok .or. .not. has_moved) return
            last_change = change
        end do
        self%is_nearest = .true.
    end subroutine approach

    !> Walk along the constraints: width dy, shortened until the distance to q0 falls, brought back to the constraints.
    subroutine walk(self, model, t, dy, must_fall, counts, has_moved, stat)
        class(nearest_position_type), intent(inout) :: self
        type(evaluator_type), intent(inout) :: model
        real(wp), intent(in) :: t, dy(:)
        !> False if the step is too small to change the distance measurably.
        logical, intent(in) :: must_fall
        type(counts_type), intent(inout) :: counts
        logical, intent(out) :: has_moved
        integer, intent(out) :: stat
        integer, parameter :: most_halvings = 20, trials_back = 30
        type(point_type) :: there
        real(wp) :: part, distance
        integer :: i

        stat = status_ok
        has_moved = .false.
        self%kept = self%here
        distance = distance_of(self)
        part = 1.0_wp
        do i = 1, most_halvings
            call self%try(model, t, part*dy, there, counts, stat)
            if (stat /= status_ok) return
            has_moved = self%obstacle == status_ok
            if (has_moved) then
                self%here = there
                call self%reach(model, t, min(self%most_trials, self%trials + trials_back), counts, stat)
                if (stat == status_callback_failed) return
                has_moved = stat == status_ok
            end if
            stat = status_ok
            if (has_moved .and. must_fall) has_moved = distance_of(self) < distance
            if (has_moved) return
            self%here = self%kept
            if (self%trials >= self%most_trials .or. .not. must_fall) return
            part = 0.5_wp*part
        end do
    end subroutine walk

    !> The distance to q0.
    pure real(wp) function distance_of(self)
        type(nearest_position_type), intent(in) :: self

        distance_of = norm2((self%here%q(self%free) - self%q0(self%free))/self%width)
    end function distance_of

    !> The Hessian of the distance along the constraints: Z'(I + sum_i lambda_i Phi_i,yy) Z, by differences of Phi_q; the identity
    !> if Phi_q is not evaluable. It affects the speed of the iteration, not its result.
    subroutine get_hessian(self, model, t, z, lambda, hessian, counts, stat)
        class(nearest_position_type), intent(inout) :: self
        type(evaluator_type), intent(inout) :: model
        real(wp), intent(in) :: t, z(:, :), lambda(:)
        real(wp), allocatable, intent(out) :: hessian(:, :)
        type(counts_type), intent(inout) :: counts
        !> callback_failed, or ok.
        integer, intent(out) :: stat
        !> Truncation h and rounding eps/h: both are about 1e-8.
        real(wp), parameter :: h = 3.0e-8_wp
        real(wp) :: q(self%n), change(self%n), difference
        integer :: i, k

        stat = status_ok
        allocate (hessian(size(z, 2), size(z, 2)), source=0.0_wp)
        do k = 1, size(z, 2)
            difference = h/relative_size(self, z(:, k))
            q = self%here%q
            q(self%free) = q(self%free) + difference*self%width*z(:, k)
            call model%evaluate(need_jacobian, t, q, q, counts, stat)
            if (stat == status_callback_failed) return
            change = 0.0_wp
            if (stat == status_ok) change = matmul(lambda, model%terms%jacobian(:self%nh, :) - self%here%jacobian)
            if (stat /= status_ok .or. .not. all(ieee_is_finite(change))) then
                hessian = 0.0_wp
                exit
            end if
            hessian(:, k) = matmul(self%width*change(self%free), z)/difference
        end do
        stat = status_ok
        hessian = 0.5_wp*(hessian + transpose(hessian))
        do i = 1, size(z, 2)
            hessian(i, i) = hessian(i, i) + 1.0_wp
        end do
    end subroutine get_hessian

    !> The row violated most at the end of the search. Its natural scale may vanish there, so its scale at q0 counts too.
    subroutine blame(self)
        class(nearest_position_type), intent(inout) :: self
        real(wp) :: value(self%nh)

        value = abs(self%here%phi)/max(self%first_scale, self%here%row_scale)
        self%failed_row = maxloc(value, dim=1)
        self%failed_value = value(self%failed_row)
        self%failed_amount = abs(self%here%phi(self%failed_row))
    end subroutine blame
end module tandem_simulate_nearest_position
