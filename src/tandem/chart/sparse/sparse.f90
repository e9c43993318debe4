! SPDX-License-Identifier: MIT
!> The sparse tangent-space chart at (t0, q0, qd0), for mechanisms of many bodies: the cost of a step is proportional to their
!> number. Operations at points and between steps; `tandem_chart_sparse_motion` contains the operations of steps.
module tandem_chart_sparse
    use tandem_chart, only: measure_type, need_change, need_independence, need_line, need_rank
    use tandem_chart_sparse_factor, only: least_pivot
    use tandem_chart_sparse_coupled_stages, only: sparse_coupled_type
    use tandem_chart_sparse_motion, only: find_obstacle
    use tandem_chart_sparse_partners, only: share_load
    use tandem_chart_sparse_progress, only: largest
    use tandem_chart_sparse_rank, only: rank_type
    use tandem_kinds, only: wp
    use tandem_model_terms, only: need_phi
    use tandem_pack, only: pack_type
    use tandem_status, only: status_not_finite, status_ok, status_position_diverged, status_rank_deficient, status_singular_mass
    implicit none (type, external)
    private

    public :: sparse_chart_type, find_obstacle

    !> The chart by blocks of a factor.
    type, extends(sparse_coupled_type) :: sparse_chart_type
    contains
        procedure :: do_project, remove_normal, do_find_multipliers, do_find_errors, do_measure, forget_rank, pack_state
    end type sparse_chart_type

contains

    !> Bring a point beside the manifold onto it, or its velocity.
    subroutine do_project(self, t, q, qd, moves_q, exactly, stat)
        class(sparse_chart_type), intent(inout) :: self
        real(wp), intent(in) :: t
        real(wp), intent(inout) :: q(self%n), qd(self%n)
        logical, intent(in) :: moves_q, exactly
        integer, intent(out) :: stat

        if (moves_q) then
            call self%restore_near(t, .false., exactly, q, qd, stat)
        else
            call project_velocity(self, t, q, qd, stat)
        end if
    end subroutine do_project

    !> Remove from errors of rates at the point of the last projection their components normal to a curve.
    subroutine remove_normal(self, error_q, error_qd)
        class(sparse_chart_type), intent(inout) :: self
        real(wp), intent(inout), contiguous :: error_q(:), error_qd(:)

        associate (s => self%system, here => self%system%factor(self%system%here))
            if (.not. (here%is_factored .or. s%serves)) return
            s%g = 0.0_wp
            call here%multiply(s%analysis, error_q, s%g)
            s%g(s%nh + 1:) = 0.0_wp
            call here%solve(s%analysis, .false., error_q, s%g, s%x, s%z)
            error_q = error_q + s%x
            s%g = 0.0_wp
            call here%multiply(s%analysis, error_qd, s%g)
            call here%solve(s%analysis, .false., error_qd, s%g, s%x, s%z)
            error_qd = error_qd + s%x
        end associate
    end subroutine remove_normal

    !> lambda at (t, q, qd, qdd).
    subroutine do_find_multipliers(self, t, q, qd, qdd, lambda, stat)
        class(sparse_chart_type), intent(inout) :: self
        real(wp), intent(in) :: t
        real(wp), intent(in), contiguous :: q(:), qd(:), qdd(:)
        real(wp), intent(out), contiguous :: lambda(:)
        integer, intent(out) :: stat

        lambda = 0.0_wp
        associate (s => self%system)
            call s%move_with(t, q, qd, self%counts, stat)
            if (stat == status_ok) call s%factorize(self%counts, stat)
            if (stat == status_ok) call s%add_friction(stat)
            if (stat /= status_ok) then
                call self%fail_here(stat)
                return
            end if
            self%counts%multipliers = self%counts%multipliers + 1
            call s%find_multipliers(qdd, lambda)
            if (self%n_dropped > 0) call share_load(s, self%left_out, lambda)
        end associate
    end subroutine do_find_multipliers

    !> The nearest velocity in the mass metric that satisfies the constraints at (t, q).
    subroutine project_velocity(self, t, q, qd, stat)
        class(sparse_chart_type), intent(inout) :: self
        real(wp), intent(in) :: t
        real(wp), intent(in), contiguous :: q(:)
        real(wp), intent(inout), contiguous :: qd(:)
        integer, intent(out) :: stat
        !> Of each pass.
        real(wp), parameter :: rest = 1.0e-13_wp
        real(wp) :: no_force(size(qd))
        integer :: pass

        self%failure%row = 0
        no_force = 0.0_wp
        associate (s => self%system)
            call s%visit(t, q, self%counts, stat)
            if (stat == status_ok) call s%factorize(self%counts, stat)
            if (stat /= status_ok) then
                call self%fail_here(stat)
                return
            end if
            ! The second pass removes the rounding error of the first.
            do pass = 1, 2
                s%g(:) = s%model%terms%nu
                call s%factor(s%here)%multiply(s%analysis, qd, s%g)
                call s%solve_here(no_force, s%g, s%x, s%z, rest, .false., stat)
                if (stat /= status_ok) then
                    call self%fail_here(stat)
                    return
                end if
                qd = qd + s%x
            end do
            if (.not. sum(abs(qd)) <= huge(1.0_wp)) stat = status_not_finite
        end associate
    end subroutine project_velocity

    !> The errors of the three constraint levels at the last point.
    subroutine do_find_errors(self, t, q, qd, qdd, errors, rows, stat)
        class(sparse_chart_type), intent(inout) :: self
        real(wp), intent(in) :: t
        real(wp), intent(in), contiguous :: q(:), qd(:), qdd(:)
        real(wp), intent(out) :: errors(3)
        integer, intent(out) :: rows(3), stat

        errors = 0.0_wp
        rows = 0
        stat = status_ok
        associate (s => self%system)
            if (s%m == 0) return
            call s%move_with(t, q, qd, self%counts, stat)
            if (stat == status_ok .and. s%nh > 0 .and. .not. s%has_phi) then
                call s%model%evaluate(need_phi, t, q, qd, self%counts, stat)
                s%has_phi = stat == status_ok
            end if
            if (stat == status_ok) then
                call s%find_errors(q, qd, qdd, self%scale, errors, rows)
                if (.not. maxval(errors) < huge(1.0_wp)) call s%name_infinite(stat)
            end if
            if (stat /= status_ok) self%failure%term = trim(s%model%failed_term)
        end associate
    end subroutine do_find_errors

    !> Measures along a step. Charts are renewed at every step, so that a policy needs none.
    subroutine do_measure(self, need, t_from, q_from, t, q, qd, measure, stat)
        class(sparse_chart_type), intent(inout) :: self
        integer, intent(in) :: need
        real(wp), intent(in) :: t_from, t
        real(wp), intent(in), contiguous :: q_from(:), q(:), qd(:)
        type(measure_type), intent(out) :: measure
        integer, intent(out) :: stat

        stat = status_ok
        if (self%system%m == 0) return
        if (iand(need, need_rank) /= 0) call measure_rank(self, t_from, q_from, t, q, measure, stat)
        if (iand(need, need_line) /= 0) stat = loss_ahead(self, t_from, q_from, t, q)
        if (iand(need, need_independence) /= 0) call measure_independence(self, t, q, measure%independence, stat)
        if (stat /= status_ok) return
        if (iand(need, need_change) /= 0) measure%change = relative_change(self)
    end subroutine do_measure

    !> Number of steps like the one to (t, q) until C loses rank.
    subroutine measure_rank(self, t_from, q_from, t, q, measure, stat)
        class(sparse_chart_type), intent(inout) :: self
        real(wp), intent(in) :: t_from, t
        real(wp), intent(in), contiguous :: q_from(:), q(:)
        type(measure_type), intent(inout) :: measure
        integer, intent(out) :: stat
        !> A loss of rank more steps away than this is not searched for.
        real(wp), parameter :: horizon = 8.0_wp
        !> The remainder of a row that depends on others is smaller, due to rounding.
        real(wp), parameter :: largest_rest = least_pivot
        !> Part of the independence at both ends below which that of a stage is a dip.
        real(wp), parameter :: of_dip = 0.5_wp
        real(wp) :: fall, now
        logical :: falls

        self%failure%row = 0
        self%failure%coordinate = 0
        associate (s => self%system, rank => self%rank)
            call s%visit(t, q, self%counts, stat)
            if (stat == status_ok) call s%factorize(self%counts, stat)
            if (stat /= status_ok) then
                call self%fail_here(stat)
                return
            end if
            if (s%factor(s%here)%rest > largest_rest) then
                ! A row that was left out has become independent: it restricts the motion now.
                self%failure%row = s%factor(s%here)%loosest
                self%failure%rows = [self%failure%row]
                measure%room = 0.0_wp
                return
            end if
            now = sqrt(s%factor(s%here)%least)
            measure%dips = sqrt(s%lowest) < of_dip*min(self%independence, now)
            if (may_pass_loss(self, now)) then
                stat = loss_ahead(self, t_from, q_from, t, q)
                if (stat == status_ok) call s%visit(t, q, self%counts, stat)
                if (stat == status_ok) call s%factorize(self%counts, stat)
                if (stat /= status_ok) return
            end if
            s%lowest = 1.0_wp
            fall = self%independence - now
            falls = .not. now > horizon*fall
            if (falls .and. s%serves) then
                ! Here the factor of a nearby point is not accurate enough.
                call s%insist(self%counts, stat)
                if (stat /= status_ok) then
                    call self%fail_here(stat)
                    return
                end if
                now = sqrt(s%factor(s%here)%least)
                fall = self%independence - now
                falls = .not. now > horizon*fall
            end if
            ! After a near loss one more step is checked.
            if (falls .or. rank%has_combination) then
                if (.not. (rank%has_combination .or. s%shares_terms)) call rank%begin(s)
                if (rank%has_passed_loss(s)) stat = status_rank_deficient
                if (.not. falls) rank%has_combination = .false.
            end if
            if (falls .or. stat /= status_ok) then
                self%failure%rows = rank%find_rows(s)
                if (stat /= status_ok) self%failure%row = s%factor(s%here)%weakest
            end if
            if (stat /= status_ok .or. .not. falls) return
            if (fall > 0.0_wp) measure%room = now/fall
            measure%fallen = now/max(self%best_independence, tiny(1.0_wp))
        end associate
    end subroutine measure_rank

    !> True if the step to the last point may have passed a loss of rank although the independence is not small at its ends.
    logical function may_pass_loss(self, now)
        class(sparse_chart_type), intent(inout) :: self
        !> The independence at the last point.
        real(wp), intent(in) :: now
        !> Part of the independence at both ends together that a step over a loss leaves at most at its end or at one of its
        !> stages: half the distance of stages, relative to the step, and some more. Long steps at loose tolerances may leave more:
        !> if the run is to stop, any stage below this part of the smaller one counts, and any change of C that suffices.
        real(wp), parameter :: of_sum = 0.33_wp, of_ends = 0.95_wp
        logical :: is_decided

        associate (s => self%system, rank => self%rank)
            ! Fixed explicit steps are short, and do not store C of the start.
            may_pass_loss = .not. (s%shares_terms .or. rank%has_combination)
            if (.not. may_pass_loss) return
            if (self%stops_at_losses) then
                may_pass_loss = sqrt(s%lowest) < of_ends*min(self%independence, now) .or. &
                    largest_change(self) > self%independence + now
                return
            end if
            if (.not. allocated(self%bend)) then
                may_pass_loss = min(sqrt(s%lowest), now) < of_sum*(self%independence + now)
                return
            end if
            ! C is not factored at implicit stages: it must have changed enough, and be related to C at the start in no clear way.
            may_pass_loss = largest_change(self) > self%independence + now
            if (.not. may_pass_loss) return
            call rank%begin(s)
            may_pass_loss = rank%has_passed_loss(s, is_decided)
            may_pass_loss = may_pass_loss .or. .not. is_decided
            rank%has_combination = .false.
        end associate
    end function may_pass_loss

    !> The root of the smallest pivot at (t, q), relative to its diagonal entry.
    subroutine measure_independence(self, t, q, independence, stat)
        class(sparse_chart_type), intent(inout) :: self
        real(wp), intent(in) :: t
        real(wp), intent(in), contiguous :: q(:)
        real(wp), intent(out) :: independence
        integer, intent(out) :: stat

        independence = 0.0_wp
        associate (s => self%system)
            call s%visit(t, q, self%counts, stat)
            if (stat == status_ok) call s%insist(self%counts, stat)
            if (stat == status_ok) independence = sqrt(s%factor(s%here)%least)
            if (stat == status_rank_deficient) stat = status_ok
            if (stat /= status_ok) call self%fail_here(stat)
        end associate
    end subroutine measure_independence

    !> Comparisons of C begin anew.
    subroutine forget_rank(self)
        class(sparse_chart_type), intent(inout) :: self

        self%rank%has_combination = .false.
    end subroutine forget_rank

    !> Loss of C on the straight line between two points.
    integer function loss_ahead(self, t_from, q_from, t, q)
        class(sparse_chart_type), intent(inout) :: self
        real(wp), intent(in) :: t_from, t
        real(wp), intent(in), contiguous :: q_from(:), q(:)
        integer, parameter :: n_places = 4
        type(rank_type) :: way
        integer :: k, stat

        loss_ahead = status_ok
        associate (s => self%system)
            do k = 0, n_places
                associate (x => real(k, wp)/n_places)
                    call s%visit(t_from + x*(t - t_from), q_from + x*(q - q_from), self%counts, stat)
                end associate
                if (stat /= status_ok) return
                call s%factorize(self%counts, stat)
                if (stat == status_rank_deficient .or. stat == status_singular_mass) then
                    call self%fail_here(stat)
                    loss_ahead = stat
                end if
                if (stat /= status_ok) return
                if (.not. way%has_passed_loss(s)) cycle
                loss_ahead = status_rank_deficient
                self%failure%row = s%factor(s%here)%weakest
                self%failure%rows = way%find_rows(s)
                return
            end do
        end associate
    end function loss_ahead

    !> Change of C from the start of the step to the current point: rows of unit length at the start, Frobenius norm. Explicit steps
    !> without error control do not store C of the start.
    real(wp) function relative_change(self)
        class(sparse_chart_type), intent(in) :: self

        relative_change = sqrt(sum(changes(self)))
    end function relative_change

    !> A bound of the norm of that change: rows share coordinates with few others, so that it is about that of the row that changes
    !> most.
    real(wp) function largest_change(self)
        class(sparse_chart_type), intent(in) :: self
        real(wp), parameter :: shared = 2.0_wp

        largest_change = shared*sqrt(maxval(changes(self)))
    end function largest_change

    !> Squares of the changes of the rows (m).
    function changes(self)
        class(sparse_chart_type), intent(in) :: self
        real(wp) :: changes(self%system%m)
        real(wp) :: length(self%system%m)

        changes = 0.0_wp
        length = 0.0_wp
        associate (s => self%system)
            call s%factor(s%base)%add_squares(s%analysis, self%scale, length)
            call s%factor(s%here)%add_squares(s%analysis, self%scale, changes, s%factor(s%base))
        end associate
        changes = changes/max(length, tiny(1.0_wp))
    end function changes

    !> The origin, the factors there and at the last point, and the state of iterations.
    subroutine pack_state(self, pack)
        class(sparse_chart_type), intent(inout) :: self
        type(pack_type), intent(inout) :: pack

        call self%pack_contract(pack)
        call self%system%pack_state(pack)
        call self%rank%pack_state(pack)
        call pack%item(self%t0)
        call pack%item(self%q0, self%qd0)
        call pack%item(self%delta)
        call pack%item(self%curve)
        call pack%item(self%delta_rate)
        call pack%item(self%bend)
        call pack%item(self%has_curve, self%has_delta_rate, self%has_bend, self%is_curve_old, self%is_bend_old)
        call pack%item(self%defect_of_delta, self%defect_of_rate)
        call pack%item(self%phi_weight, self%velocity_weight)
        call pack%item(self%position%ageing, self%velocity%ageing)
        call pack%item(self%secants%weight)
        call self%pack_newton(pack)
        call self%pack_coupled(pack)
    end subroutine pack_state
end module tandem_chart_sparse
