! SPDX-License-Identifier: MIT
!> Finds the consistent position nearest to a given one: minimises sum_j w_j (q_j - q0_j)^2 / 2 over the free coordinates subject to
!> Phi(t, q) = 0, in bounded work.
!>
!> A first iteration reaches the constraints by Gauss-Newton steps of least norm within a trust region. A second iteration, Newton's
!> method in the tangent space of the constraints, minimises the distance; the first iteration returns each of its steps to the
!> constraints. The unknowns are y = (q - q0) / width with width = w^(-1/2). The rows are those of A = Phi_q diag(width), normalised
!> to unit length. At the nearest point y + A' lambda = 0, which gives the contribution of each row to the displacement of each
!> coordinate.
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

    !> A point with Phi (nh), Phi_q (nh, n), the natural scales of the rows (nh), and the largest error on these scales.
    type :: point_type
        real(wp), allocatable :: q(:), phi(:), jacobian(:, :), row_scale(:)
        real(wp) :: error = 0.0_wp
    end type point_type

    !> Search for the consistent position nearest to a given one.
    type :: nearest_position_type
        !> Number of points evaluated so far, and its limit.
        integer :: trials = 0, most_trials = 200
        !> True if q is known to be a local minimum of the distance to q0.
        logical :: is_nearest = .false.
        !> Contribution of each row to the displacement of each coordinate (nh, n).
        real(wp), allocatable :: contribution(:, :)
        !> Value of Phi to be attained (nh); 0 unless it is set after `initialize`.
        real(wp), allocatable :: goal(:)
        !> After inconsistent_start: the row with the largest violation, and its residual, also on its natural scale.
        integer :: failed_row = 0
        real(wp) :: failed_amount = 0.0_wp, failed_value = 0.0_wp
        integer, private :: n = 0, nh = 0
        !> Indices of the free coordinates, and w^(-1/2) for each of them; scales of all coordinates (n).
        integer, allocatable, private :: free(:)
        real(wp), allocatable, private :: width(:), scale(:)
        !> Largest residual of a satisfied constraint, on its natural scale.
        real(wp), private :: tolerance = 0.0_wp
        !> q0, the current point, and the point before the current step.
        real(wp), allocatable, private :: q0(:)
        type(point_type), private :: current, previous
        !> Status of the evaluation of the last trial point.
        integer, private :: trial_stat = status_ok
        !> Lengths of the rows of Phi_q diag(width), natural scales of the rows at q0 (nh), and A (nh, free coordinates).
        real(wp), allocatable, private :: length(:), first_scale(:), a(:, :)
        type(singular_type), private :: singular
    contains
        procedure :: initialize, find
        procedure, private :: evaluate, evaluate_trial, factor, radius, get_hessian, find_failed_row
        procedure, private :: move_to_constraints, perturb, minimise_distance, step_along_constraints
    end type nearest_position_type

contains

    !> Allocate the work space.
    subroutine initialize(self, nh, is_fixed, weight, scale, tolerance, most_trials)
        class(nearest_position_type), intent(inout) :: self
        !> Number of holonomic constraints.
        integer, intent(in) :: nh
        !> True for fixed coordinates (n); positive weights and typical magnitudes of the coordinates (n).
        logical, intent(in) :: is_fixed(:)
        real(wp), intent(in) :: weight(:), scale(:)
        !> Largest residual of a satisfied constraint, on its natural scale; largest number of points.
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
        if (allocated(self%contribution)) deallocate (self%contribution)
        allocate (self%contribution(nh, self%n), source=0.0_wp)
        if (nh > 0) call self%singular%allocate(nh, size(self%free))
    end subroutine initialize

    !> Replace q by the nearest consistent position. A consistent q is not changed, not even by rounding. Statuses:
    !> inconsistent_start, callback_failed, not_evaluable, not_finite; q is then unchanged.
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
        call self%evaluate(model, t, q, self%current, counts, stat)
        if (stat /= status_ok .or. self%current%error <= self%tolerance) return
        self%first_scale = self%current%row_scale
        self%is_nearest = .false.
        call self%move_to_constraints(model, t, self%most_trials, counts, stat)
        if (stat == status_inconsistent_start) then
            ! If Phi_q loses rank, as at the centre of a circle, no step is determined although a solution may be near.
            call self%perturb(model, t, counts, stat)
            if (stat == status_ok) call self%move_to_constraints(model, t, self%most_trials, counts, stat)
        end if
        if (stat == status_ok) call self%minimise_distance(model, t, counts, stat)
        if (stat == status_ok) q = self%current%q
        if (stat == status_inconsistent_start) call self%find_failed_row()
    end subroutine find

    !> Evaluate Phi and Phi_q at a point.
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

        ! Neither term depends on the velocity; q is passed in its place.
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

    !> Evaluate the point after the step width dy. `trial_stat` is not ok if it cannot be evaluated; a shorter step is then
    !> required.
    subroutine evaluate_trial(self, model, t, dy, point, counts, stat)
        class(nearest_position_type), intent(inout) :: self
        type(evaluator_type), intent(inout) :: model
        real(wp), intent(in) :: t, dy(:)
        type(point_type), intent(out) :: point
        type(counts_type), intent(inout) :: counts
        !> callback_failed if the search must end.
        integer, intent(out) :: stat
        real(wp) :: q(self%n)

        self%trials = self%trials + 1
        q = self%current%q
        q(self%free) = q(self%free) + self%width*dy
        call self%evaluate(model, t, q, point, counts, self%trial_stat)
        stat = merge(status_callback_failed, status_ok, self%trial_stat == status_callback_failed)
    end subroutine evaluate_trial

    !> Set A and decompose it at the current point. A row that does not depend on free coordinates is zero; its length is its scale.
    subroutine factor(self)
        class(nearest_position_type), intent(inout) :: self
        integer :: i, j

        do j = 1, size(self%free)
            self%a(:, j) = self%current%jacobian(:, self%free(j))*self%width(j)
        end do
        do i = 1, self%nh
            self%length(i) = norm2(self%a(i, :))
            if (.not. self%length(i) > 0.0_wp) self%length(i) = max(self%first_scale(i), self%current%row_scale(i))
            self%a(i, :) = self%a(i, :)/self%length(i)
        end do
        call self%singular%factor(self%a)
    end subroutine factor

    !> Initial radius of the trust region: no coordinate changes by more than its scale, so that angles do not change by full
    !> revolutions.
    pure real(wp) function radius(self)
        class(nearest_position_type), intent(in) :: self

        radius = minval(self%scale(self%free)/self%width)
    end function radius

    !> Move from the current point to the constraints by steps of least norm. Status inconsistent_start if no step reduces the
    !> error.
    subroutine move_to_constraints(self, model, t, most_trials, counts, stat)
        class(nearest_position_type), intent(inout) :: self
        type(evaluator_type), intent(inout) :: model
        real(wp), intent(in) :: t
        !> Value of `trials` at which the search ends.
        integer, intent(in) :: most_trials
        type(counts_type), intent(inout) :: counts
        integer, intent(out) :: stat
        !> Error due to rounding; ratio of successive errors that counts as no progress; number of such steps after which the search
        !> ends.
        real(wp), parameter :: rounding = 4*epsilon(1.0_wp), slow_ratio = 0.99_wp
        integer, parameter :: most_slow = 10
        type(point_type) :: trial
        real(wp) :: dy(size(self%free)), phi(self%nh), radius, before, after, predicted, noise
        integer :: slow, failed_stat
        logical :: is_factored

        radius = self%radius()
        slow = 0
        failed_stat = status_ok
        is_factored = .false.
        do while (self%current%error > rounding .and. self%trials < most_trials .and. slow < most_slow .and. size(dy) > 0)
            if (.not. is_factored) call self%factor()
            is_factored = .true.
            phi = self%current%phi/self%length
            before = norm2(phi)
            noise = 4*epsilon(1.0_wp)*maxval(self%current%row_scale/self%length)
            if (self%current%error > self%tolerance) noise = 0.0_wp
            call self%singular%solve_within(-phi, radius, noise, dy)
            if (.not. is_step(self, dy)) exit
            call self%evaluate_trial(model, t, dy, trial, counts, stat)
            if (stat /= status_ok) return
            predicted = norm2(phi + matmul(self%a, dy))
            after = huge(1.0_wp)
            if (self%trial_stat == status_ok) after = norm2(trial%phi/self%length)
            if (self%trial_stat /= status_ok) failed_stat = self%trial_stat
            if (.not. after < before) then
                ! Within the tolerance, an error that does not decrease is a rounding error.
                if (self%current%error <= self%tolerance) exit
                radius = 0.25_wp*norm2(dy)
                cycle
            end if
            if (before**2 - after**2 > 0.75_wp*(before**2 - predicted**2)) radius = max(radius, 4*norm2(dy))
            if (before**2 - after**2 < 0.25_wp*(before**2 - predicted**2)) radius = 0.5_wp*norm2(dy)
            slow = slow + 1
            if (after < slow_ratio*before) then
                slow = 0
                failed_stat = status_ok
            end if
            self%current = trial
            is_factored = .false.
        end do
        stat = merge(status_ok, status_inconsistent_start, self%current%error <= self%tolerance)
        if (stat /= status_ok .and. failed_stat /= status_ok) stat = failed_stat
    end subroutine move_to_constraints

    !> True if a step changes any coordinate by more than rounding.
    pure logical function is_step(self, dy)
        type(nearest_position_type), intent(in) :: self
        real(wp), intent(in) :: dy(:)

        is_step = relative_size(self, dy) > 0.25_wp*epsilon(1.0_wp)
    end function is_step

    !> Largest change of a coordinate in a step, relative to the coordinate or to its scale.
    pure real(wp) function relative_size(self, dy)
        type(nearest_position_type), intent(in) :: self
        real(wp), intent(in) :: dy(:)

        relative_size = maxval(abs(self%width*dy)/max(abs(self%current%q(self%free)), self%scale(self%free)))
    end function relative_size

    !> Move by about a hundredth of the coordinate scales, away from a point at which Phi_q gives no descent direction.
    subroutine perturb(self, model, t, counts, stat)
        class(nearest_position_type), intent(inout) :: self
        type(evaluator_type), intent(inout) :: model
        real(wp), intent(in) :: t
        type(counts_type), intent(inout) :: counts
        integer, intent(out) :: stat
        type(point_type) :: trial
        real(wp) :: dy(size(self%free))
        integer :: j

        stat = status_inconsistent_start
        if (size(dy) == 0 .or. self%trials >= self%most_trials) return
        ! A different, nonzero displacement for each coordinate.
        dy = [(0.01_wp*self%scale(self%free(j))/self%width(j)*(1.0_wp + 0.3_wp*cos(2.4_wp*j)), j=1, size(dy))]
        call self%evaluate_trial(model, t, dy, trial, counts, stat)
        if (stat /= status_ok) return
        stat = merge(status_ok, status_inconsistent_start, self%trial_stat == status_ok)
        if (stat == status_ok) self%current = trial
    end subroutine perturb

    !> Move from a point on the constraints to the nearest one. All accepted points satisfy the constraints.
    subroutine minimise_distance(self, model, t, counts, stat)
        class(nearest_position_type), intent(inout) :: self
        type(evaluator_type), intent(inout) :: model
        real(wp), intent(in) :: t
        type(counts_type), intent(inout) :: counts
        !> callback_failed or ok.
        integer, intent(out) :: stat
        !> Relative change of a step that is rounding; relative change of a small step; relative decrease of the squared distance
        !> that rounding errors hide.
        real(wp), parameter :: rounding = 1.0e-15_wp, small = 1.0e-6_wp, hidden = 1.0e-11_wp
        !> Curvature of the distance below which a stationary point is a saddle point or a maximum.
        real(wp), parameter :: negative = -1.0e-6_wp
        real(wp), allocatable :: z(:, :), hessian(:, :), curvature(:), slope(:)
        real(wp) :: dy(size(self%free)), y(size(self%free)), lambda(self%nh), change, last_change, lowest
        logical :: has_moved, must_decrease
        integer :: i

        stat = status_ok
        last_change = huge(1.0_wp)
        do
            call self%factor()
            y = (self%current%q(self%free) - self%q0(self%free))/self%width
            call self%singular%solve_transposed(-y, lambda)
            do i = 1, self%nh
                self%contribution(i, self%free) = -self%width*self%a(i, :)*lambda(i)
            end do
            call self%singular%get_null_basis(z)
            if (size(z, 2) == 0) exit
            call self%get_hessian(model, t, z, lambda/self%length, hessian, counts, stat)
            if (stat /= status_ok) return
            curvature = spread(0.0_wp, 1, size(z, 2))
            call decompose_symmetric(hessian, curvature)
            slope = matmul(matmul(y, z), hessian)
            ! Newton step, modified to be a descent direction if the distance has negative curvature.
            lowest = curvature(1)
            curvature = max(abs(curvature), 1.0e-3_wp*maxval(abs(curvature)), tiny(1.0_wp))
            dy = -matmul(z, matmul(hessian, slope/curvature))
            change = relative_size(self, dy)
            must_decrease = sum(slope**2/curvature) > hidden*sum(y**2)
            if (lowest < negative .and. norm2(slope) <= small*norm2(y)) then
                ! Stationary point that is not a minimum, such as the end of the long axis of an ellipse. Points on either side are
                ! nearer.
                dy = 0.1_wp*norm2(y)*matmul(z, hessian(:, 1))
                change = 1.0_wp
                must_decrease = .true.
            end if
            self%is_nearest = change <= small
            if (change <= rounding .or. (.not. must_decrease .and. change > 0.5_wp*last_change)) return
            if (self%trials >= self%most_trials) return
            call self%step_along_constraints(model, t, dy, must_decrease, counts, has_moved, stat)
            if (stat /= status_ok .or. .not. has_moved) return
            last_change = change
        end do
        self%is_nearest = .true.
    end subroutine minimise_distance

    !> Take the step width dy along the constraints: halve it until the point, moved back to the constraints, is nearer to q0.
    subroutine step_along_constraints(self, model, t, dy, must_decrease, counts, has_moved, stat)
        class(nearest_position_type), intent(inout) :: self
        type(evaluator_type), intent(inout) :: model
        real(wp), intent(in) :: t, dy(:)
        !> False if the step is so small that rounding hides the change of the distance.
        logical, intent(in) :: must_decrease
        type(counts_type), intent(inout) :: counts
        logical, intent(out) :: has_moved
        integer, intent(out) :: stat
        integer, parameter :: most_halvings = 20, trials_back = 30
        type(point_type) :: trial
        real(wp) :: fraction, distance
        integer :: i

        stat = status_ok
        has_moved = .false.
        self%previous = self%current
        distance = distance_of(self)
        fraction = 1.0_wp
        do i = 1, most_halvings
            call self%evaluate_trial(model, t, fraction*dy, trial, counts, stat)
            if (stat /= status_ok) return
            has_moved = self%trial_stat == status_ok
            if (has_moved) then
                self%current = trial
                call self%move_to_constraints(model, t, min(self%most_trials, self%trials + trials_back), counts, stat)
                if (stat == status_callback_failed) return
                has_moved = stat == status_ok
            end if
            stat = status_ok
            if (has_moved .and. must_decrease) has_moved = distance_of(self) < distance
            if (has_moved) return
            self%current = self%previous
            if (self%trials >= self%most_trials .or. .not. must_decrease) return
            fraction = 0.5_wp*fraction
        end do
    end subroutine step_along_constraints

    !> Distance of the current point from q0.
    pure real(wp) function distance_of(self)
        type(nearest_position_type), intent(in) :: self

        distance_of = norm2((self%current%q(self%free) - self%q0(self%free))/self%width)
    end function distance_of

    !> Hessian of the distance on the constraints, Z'(I + sum_i lambda_i Phi_i,yy) Z, by differences of Phi_q; the identity if Phi_q
    !> cannot be evaluated. It affects the speed of the iteration but not its result.
    subroutine get_hessian(self, model, t, z, lambda, hessian, counts, stat)
        class(nearest_position_type), intent(inout) :: self
        type(evaluator_type), intent(inout) :: model
        real(wp), intent(in) :: t, z(:, :), lambda(:)
        real(wp), allocatable, intent(out) :: hessian(:, :)
        type(counts_type), intent(inout) :: counts
        !> callback_failed or ok.
        integer, intent(out) :: stat
        !> Step of the differences: the truncation error h and the rounding error eps/h are both about 1e-8.
        real(wp), parameter :: h = 3.0e-8_wp
        real(wp) :: q(self%n), change(self%n), difference
        integer :: i, k

        stat = status_ok
        allocate (hessian(size(z, 2), size(z, 2)), source=0.0_wp)
        do k = 1, size(z, 2)
            difference = h/relative_size(self, z(:, k))
            q = self%current%q
            q(self%free) = q(self%free) + difference*self%width*z(:, k)
            call model%evaluate(need_jacobian, t, q, q, counts, stat)
            if (stat == status_callback_failed) return
            change = 0.0_wp
            if (stat == status_ok) change = matmul(lambda, model%terms%jacobian(:self%nh, :) - self%current%jacobian)
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

    !> Set the row with the largest violation at the end of the search. Its natural scale may vanish there; the scale at q0 is then
    !> used.
    subroutine find_failed_row(self)
        class(nearest_position_type), intent(inout) :: self
        real(wp) :: value(self%nh)

        value = abs(self%current%phi)/max(self%first_scale, self%current%row_scale)
        self%failed_row = maxloc(value, dim=1)
        self%failed_value = value(self%failed_row)
        self%failed_amount = abs(self%current%phi(self%failed_row))
    end subroutine find_failed_row
end module tandem_simulate_nearest_position
