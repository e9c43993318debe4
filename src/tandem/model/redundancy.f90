! SPDX-License-Identifier: MIT
!> Analysis of redundant constraints at a start. Distinguishes dependent rows that can be dropped, rows that contradict each other,
!> and rows that are dependent only in a singular configuration, which are not redundant.
!>
!> A row is redundant if it depends on the other rows (`split_rows` selects the rows to keep) and still depends on them at
!> neighbouring states that these rows allow. The analysis uses the rows of the model, without a chart, and is made only if a chart
!> finds dependent rows.
module tandem_model_redundancy
    use tandem_kinds, only: wp
    use tandem_linalg_dependence, only: count_independent, split_rows
    use tandem_linalg_orthogonal, only: orthogonal_type
    use tandem_model, only: model_type
    use tandem_model_differences, only: differences_type
    use tandem_model_evaluator, only: evaluator_type
    use tandem_model_terms, only: need_gamma, need_jacobian, need_nu, need_phi
    use tandem_status, only: status_inconsistent_rows, status_not_evaluable, status_ok, status_rank_deficient
    use tandem_model_counts, only: counts_type
    use tandem_model_natural_scale, only: position_errors
    implicit none (type, external)
    private

    public :: redundancy_type

    type :: redundancy_type
        !> Indices, in the model, of the rows to use and of the rows to drop.
        integer, allocatable :: kept(:), dropped(:)
        !> C(dropped, :) = combination C(kept, :).
        real(wp), allocatable :: combination(:, :)
        !> Coordinates (n), projected onto all constraints.
        real(wp), allocatable :: q(:)
        !> After `inconsistent_rows` or `rank_deficient`: a dependent row, and the level at which it contradicts the others: 0 none,
        !> 1 position, 2 velocity, 3 acceleration.
        integer :: failed_row = 0, failed_level = 0
        !> Largest position error at the given start, on the natural scale of its row; its row.
        real(wp) :: error = 0.0_wp
        integer :: worst_row = 0
        type(evaluator_type), private :: evaluator
        type(differences_type), private :: differences
        !> Factor of the rows of the last correction of `restore`; true if it may be reused at nearby points.
        type(orthogonal_type), private :: nearby
        logical, private :: is_near = .false.
        real(wp), allocatable, private :: scale(:)
        real(wp), private :: rate = 1.0_wp
    contains
        procedure :: analyse, choose, partners
        procedure, private :: restore, find_contradiction, test_nearby
    end type redundancy_type

    !> Rows of unit length are dependent if the remainder of one of them is below this limit, as in the rank decision of charts.
    real(wp), parameter :: dependent = 1.0e-10_wp

contains

    !> Analyse the rows at (t, q, qd). Status: ok if the rows in `dropped` can be dropped; inconsistent_rows; rank_deficient; or a
    !> status of an evaluation of the model.
    subroutine analyse(self, model, scale, t, q, qd, tolerance, counts, stat)
        class(redundancy_type), intent(inout) :: self
        class(model_type), intent(inout), target :: model
        !> Coordinate scales (n).
        real(wp), intent(in) :: scale(:)
        real(wp), intent(in) :: t, q(:), qd(:)
        !> Tolerance for contradictions due to rounding of the given start, on the natural scale of a row.
        real(wp), intent(in) :: tolerance
        type(counts_type), intent(inout) :: counts
        !> A status code.
        integer, intent(out) :: stat
        real(wp), allocatable :: jacobian(:, :)
        real(wp) :: magnitude(size(q))
        integer :: i

        self%scale = scale
        self%rate = 1.0_wp/model%time_scale
        self%failed_row = 0
        self%failed_level = 0
        self%is_near = .false.
        self%q = q
        call self%evaluator%initialize(model, wants_mass=.false.)
        ! Allocated only if needed, because it takes as much memory as a model.
        if (iand(self%evaluator%has, need_gamma) == 0) call self%differences%initialize(model, scale)
        call self%evaluator%evaluate(need_phi + need_jacobian, t, q, qd, counts, stat)
        if (stat /= status_ok) return
        self%error = 0.0_wp
        associate (terms => self%evaluator%terms)
            call self%evaluator%set_magnitudes(self%q, magnitude)
            if (model%n_holonomic > 0) call position_errors(terms%phi, terms%jacobian, magnitude, self%scale, &
                self%error, self%worst_row)
        end associate
        call self%restore([(i, i=1, model%n_holonomic)], t, self%q, counts, stat)
        if (stat == status_ok) call self%evaluator%evaluate(need_phi + need_jacobian + need_nu, t, self%q, qd, counts, stat)
        if (stat /= status_ok) return
        jacobian = self%evaluator%terms%jacobian
        call split_rows(jacobian, scale, model%n_holonomic, dependent, self%kept, self%dropped, self%combination)
        if (size(self%dropped) == 0) return
        call self%find_contradiction(t, self%q, qd, tolerance, 2, counts, stat)
        if (stat == status_ok) call self%test_nearby(jacobian, t, counts, stat)
        if (stat == status_ok) call self%find_contradiction(t, self%q, qd, tolerance, 3, counts, stat)
    end subroutine analyse

    !> Choose the rows to drop again, at a state on the constraints: those that the other rows represent best.
    subroutine choose(self, model, scale, t, q, counts, stat)
        class(redundancy_type), intent(inout) :: self
        class(model_type), intent(inout), target :: model
        !> Coordinate scales (n), time and coordinates (n).
        real(wp), intent(in) :: scale(:), t, q(:)
        type(counts_type), intent(inout) :: counts
        !> A status code.
        integer, intent(out) :: stat

        call self%evaluator%initialize(model, wants_mass=.false.)
        call self%evaluator%evaluate(need_jacobian, t, q, q, counts, stat)
        if (stat /= status_ok) return
        call split_rows(self%evaluator%terms%jacobian, scale, model%n_holonomic, dependent, self%kept, self%dropped, &
            self%combination)
    end subroutine choose

    !> Rows of which a dropped row is a combination.
    pure function partners(self, number) result(rows)
        class(redundancy_type), intent(in) :: self
        !> Index into `dropped`.
        integer, intent(in) :: number
        integer, allocatable :: rows(:)

        associate (part => abs(self%combination(number, :)))
            rows = pack(self%kept, part > max(1.0e-3_wp*maxval(part), tiny(1.0_wp)))
        end associate
    end function partners

    !> Project q onto holonomic rows by corrections of least norm. The factor of a nearby point is reused while corrections converge
    !> fast. Stops if the rows are contradictory.
    subroutine restore(self, rows, t, q, counts, stat)
        class(redundancy_type), intent(inout) :: self
        !> Rows to satisfy.
        integer, intent(in) :: rows(:)
        real(wp), intent(in) :: t
        real(wp), intent(inout), contiguous :: q(:)
        type(counts_type), intent(inout) :: counts
        integer, intent(out) :: stat
        integer, parameter :: most_steps = 12
        real(wp), parameter :: fast = 0.05_wp
        real(wp) :: step(size(q)), error, last_error, magnitude(size(q)), phi(size(rows)), jacobian(size(rows), size(q))
        logical :: is_old
        integer :: k, row

        stat = status_ok
        if (size(rows) == 0) return
        last_error = huge(1.0_wp)
        is_old = .true.
        associate (terms => self%evaluator%terms)
            do k = 1, most_steps
                call self%evaluator%evaluate(need_phi + need_jacobian, t, q, q, counts, stat)
                if (stat /= status_ok) return
                phi = terms%phi(rows)
                jacobian = terms%jacobian(rows, :)
                call self%evaluator%set_magnitudes(q, magnitude)
                call position_errors(phi, jacobian, magnitude, self%scale, error, row)
                if (error <= 4*epsilon(1.0_wp) .or. .not. (error < 0.5_wp*last_error .or. is_old)) return
                is_old = self%is_near .and. error < fast*last_error
                if (.not. is_old) then
                    if (.not. sum(abs(jacobian)) <= huge(1.0_wp)) return
                    call self%nearby%factor(jacobian*spread(self%scale, 1, size(rows)))
                    self%is_near = .true.
                end if
                last_error = error
                call self%nearby%solve(-phi, step)
                q = q + self%scale*step
            end do
        end associate
    end subroutine restore

    !> Find a dropped row that differs from its combination of the other rows, at any level up to the given one.
    subroutine find_contradiction(self, t, q, qd, tolerance, level, counts, stat)
        class(redundancy_type), intent(inout) :: self
        real(wp), intent(in) :: t, q(:), qd(:), tolerance
        !> 2 for positions and velocities, 3 for accelerations too.
        integer, intent(in) :: level
        type(counts_type), intent(inout) :: counts
        integer, intent(out) :: stat
        !> Tolerance if gamma is computed by differences.
        real(wp), parameter :: noise = 1.0e-6_wp
        real(wp), dimension(size(self%evaluator%terms%nu)) :: full, gamma
        real(wp) :: position(size(q)), speed(size(qd))
        integer :: nh

        nh = size(self%evaluator%terms%phi)
        associate (terms => self%evaluator%terms)
            if (level == 3) then
                if (iand(self%evaluator%has, need_gamma) /= 0) then
                    call self%evaluator%evaluate(need_jacobian + need_gamma, t, q, qd, counts, stat)
                else
                    call self%evaluator%evaluate(need_jacobian, t, q, qd, counts, stat)
                    position = q
                    speed = qd
                    if (stat == status_ok) call self%differences%evaluate_gamma(t, position, speed, gamma, counts, stat)
                    terms%gamma = gamma
                end if
                if (stat == status_ok) call compare(terms%gamma, qd, max(tolerance, noise), 3)
                return
            end if
            stat = status_ok
            ! A holonomic row may depend on holonomic rows only, which come first.
            full = 0.0_wp
            full(:nh) = terms%phi
            call compare(full, q, tolerance, 1)
            if (stat == status_ok) call compare(terms%nu, qd, tolerance, 2)
        end associate

    contains

        !> Compare one value per dropped row.
        subroutine compare(value, y, allowed, number)
            real(wp), intent(in) :: value(:), y(:), allowed
            integer, intent(in) :: number
            real(wp) :: expected, natural
            integer :: i

            associate (c => self%evaluator%terms%jacobian)
                do i = 1, size(self%dropped)
                    associate (row => self%dropped(i))
                        if (number == 1 .and. row > nh) cycle
                        expected = dot_product(self%combination(i, :), value(self%kept))
                        natural = sum(abs(c(row, :))*max(abs(y), merge(1.0_wp, self%rate, number == 1)*self%scale)) + &
                            abs(value(row)) + abs(expected)
                        if (abs(value(row) - expected) <= allowed*natural) cycle
                        self%failed_row = row
                        self%failed_level = number
                        stat = status_inconsistent_rows
                        return
                    end associate
                end do
            end associate
        end subroutine compare
    end subroutine find_contradiction

    !> Check at neighbouring states that the dropped rows are still satisfied and dependent.
    subroutine test_nearby(self, jacobian, t, counts, stat)
        class(redundancy_type), intent(inout) :: self
        !> C at the start (m, n).
        real(wp), intent(in) :: jacobian(:, :)
        real(wp), intent(in) :: t
        type(counts_type), intent(inout) :: counts
        integer, intent(out) :: stat
        !> Distance of the states in coordinate scales, and tolerances there. In a singular configuration the position error is of
        !> the order of the distance squared, and the remainder of a dependent row of the order of the distance. For redundant rows
        !> both are rounding errors.
        real(wp), parameter :: distance = 1.0e-3_wp, largest_error = 1.0e-9_wp, largest_rest = 1.0e-7_wp
        integer, parameter :: n_states = 3
        type(orthogonal_type) :: of_kept
        real(wp) :: direction(size(self%q)), q(size(self%q)), magnitude(size(self%q)), error
        integer :: i, j, nh, rank, row

        stat = status_ok
        if (size(self%kept) == size(self%q)) return
        nh = size(self%evaluator%terms%phi)
        call of_kept%factor(jacobian(self%kept, :)*spread(self%scale, 1, size(self%kept)))
        self%is_near = .false.
        do i = 1, n_states
            ! An arbitrary direction, minus its component in the space of the rows.
            direction = [(sin(real(i + j*(i + 1), wp)), j=1, size(direction))]
            call of_kept%project(direction)
            if (.not. norm2(direction) > 0.0_wp) cycle
            q = self%q + distance*self%scale*direction/norm2(direction)
            call self%restore(pack(self%kept, self%kept <= nh), t, q, counts, stat)
            if (stat == status_ok) call self%evaluator%evaluate(need_phi + need_jacobian, t, q, q, counts, stat)
            ! Skip states that cannot be evaluated.
            if (stat == status_not_evaluable) then
                stat = status_ok
                cycle
            end if
            if (stat /= status_ok) return
            associate (terms => self%evaluator%terms)
                if (.not. sum(abs(terms%jacobian)) + sum(abs(terms%phi)) <= huge(1.0_wp)) cycle
                error = 0.0_wp
                row = 0
                call self%evaluator%set_magnitudes(q, magnitude)
                if (nh > 0) call position_errors(terms%phi, terms%jacobian, magnitude, self%scale, error, row)
                rank = count_independent(terms%jacobian, self%scale, nh, largest_rest)
                if (error <= largest_error .and. rank == size(self%kept)) cycle
            end associate
            self%failed_row = self%dropped(1)
            stat = status_rank_deficient
            return
        end do
    end subroutine test_nearby
end module tandem_model_redundancy
