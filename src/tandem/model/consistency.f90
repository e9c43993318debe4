! SPDX-License-Identifier: MIT
!> Finds contradictions between the constraint procedures of a model along a motion: compares Phi_q, nu and gamma with differences
!> of Phi and of C qd - nu on a short straight path. The check is cheap enough for runs whose steps indicate an error.
!> `tandem_model_verification` compares all procedures.
!>
!> The check must never report a correct model. A contradiction is reported only if it occurs at three positions that share no time
!> and no point of the path, so that a kink or jump can affect at most one of them, and only if differences with all step lengths
!> agree much better with each other than with the procedure, which excludes truncation and rounding errors. A model that cannot be
!> evaluated on the path is not reported.
module tandem_model_consistency
    use tandem_error, only: to_text
    use tandem_kinds, only: wp
    use tandem_model, only: model_type
    use tandem_model_evaluator, only: evaluator_type
    use tandem_model_terms, only: need_gamma, need_jacobian, need_mass, need_nu, need_phi
    use tandem_status, only: status_ok
    use tandem_model_counts, only: counts_type
    implicit none (type, external)
    private

    public :: contradiction_length, find_contradiction

    !> Length of the report of a contradiction.
    integer, parameter :: contradiction_length = 320

    !> Kinds of comparisons: Phi_q qd with differences of Phi at a fixed time; C qd - nu with differences of Phi along the motion;
    !> gamma with differences of C qd - nu. A comparison is made only if the preceding ones agree.
    integer, parameter :: of_jacobian = 1, of_nu = 2, of_gamma = 3, n_kinds = 3

    !> Positions on the path, as fractions of it, and half the step lengths of the differences there.
    real(wp), parameter :: position(3) = [1.0_wp, 3.0_wp, 5.0_wp]/6.0_wp
    real(wp), parameter :: length(5) = [0.15_wp, 4.0e-2_wp, 1.0e-2_wp, 2.5e-3_wp, 6.0e-4_wp]
    !> Index of the step length of the first comparison, a medium one.
    integer, parameter :: medium = 3

contains

    !> Examine a model on the straight path from (t, q) with the velocity qd.
    subroutine find_contradiction(model, t, q, qd, duration, counts, contradiction)
        !> Model in the segment of the path.
        class(model_type), intent(inout), target :: model
        !> Time, coordinates and velocities (n): a point of a motion.
        real(wp), intent(in) :: t, q(:), qd(:)
        !> Largest duration of the path; negative for a path backwards in time.
        real(wp), intent(in) :: duration
        !> Counters of the evaluations.
        type(counts_type), intent(inout) :: counts
        !> Names of the contradictory procedures, position and size of the contradiction; blank if there is none.
        character(len=contradiction_length), intent(out) :: contradiction
        !> Largest change of a coordinate along the path, relative to its magnitude or its scale.
        real(wp), parameter :: longest = 0.05_wp
        integer, parameter :: of_pattern = need_jacobian + need_mass
        type(evaluator_type) :: probe
        real(wp) :: speed, path, magnitude(model%n)
        real(wp), dimension(model%n_constraints(), n_kinds) :: value, rate
        logical, dimension(model%n_constraints(), n_kinds) :: is_wrong, is_wrong_here
        integer :: i, found(2)

        contradiction = ''
        if (model%n_constraints() == 0) return
        magnitude = model%scales()
        magnitude = max(abs(q), magnitude)
        speed = maxval(abs(qd)/magnitude)
        path = duration
        if (speed*abs(duration) > longest) path = sign(longest/speed, duration)
        ! Single procedures set terms that are not compressed.
        call probe%initialize(model, compressed=allocated(model%pattern) .and. iand(model%provides, of_pattern) == of_pattern)
        call compare_at(probe, model%n_holonomic, t, q, qd, magnitude, path, 0.5_wp, length(medium:medium), counts, value, rate, &
            is_wrong)
        do i = 1, size(position)
            if (.not. any(is_wrong)) return
            call compare_at(probe, model%n_holonomic, t, q, qd, magnitude, path, position(i), length, counts, value, rate, &
                is_wrong_here)
            is_wrong = is_wrong .and. is_wrong_here
        end do
        found = findloc(is_wrong, .true.)
        if (found(1) == 0) return
        associate (row => found(1), kind => found(2))
            contradiction = 'the model contradicts itself: '//trim(report(kind, model%row_name(row), to_text(value(row, kind)), &
                to_text(rate(row, kind))))//', t = '//to_text(t + position(size(position))*path)// &
                '; correct the procedure (tandem check, verify_model compare them all)'
        end associate
    end subroutine find_contradiction

    !> Message about the value of a procedure and the expected value.
    pure function report(kind, row, value, rate) result(text)
        integer, intent(in) :: kind
        character(len=*), intent(in) :: row, value, rate
        character(len=contradiction_length) :: text

        select case (kind)
        case (of_jacobian)
            text = 'the Jacobian of the constraint "'//row//'" gives Phi_q qd = '//value//', but Phi changes by '//rate
        case (of_nu)
            text = 'nu of the constraint "'//row//'" gives C qd - nu = '//value//', but Phi changes by '//rate// &
                ' along the motion'
        case default
            text = 'gamma of the constraint "'//row//'" is '//value//', but C qd - nu changes by '//rate
        end select
    end function report

    !> Find the rows whose procedure contradicts the differences of all step lengths at one position of the path.
    subroutine compare_at(probe, nh, t, q, qd, magnitude, path, position, lengths, counts, value, rate, is_wrong)
        type(evaluator_type), intent(inout) :: probe
        integer, intent(in) :: nh
        !> Start of the path; the larger of |q| and the scale of each coordinate (n); duration of the path.
        real(wp), intent(in) :: t, q(:), qd(:), magnitude(:), path
        !> Position as a fraction of the path; step lengths in decreasing order.
        real(wp), intent(in) :: position, lengths(:)
        type(counts_type), intent(inout) :: counts
        !> Values of the procedures; differences with the smallest step length (m, n_kinds).
        real(wp), intent(out) :: value(:, :), rate(:, :)
        logical, intent(out) :: is_wrong(:, :)
        !> A wrong formula deviates by more than `share` of the given value, of the expected value and of the terms that cancel in
        !> it. A gamma below `least_share` of these terms is negligible.
        real(wp), parameter :: share = 1.0e-3_wp, least_share = 1.0e-6_wp
        !> Bound of the rounding error relative to the terms that cancel.
        real(wp), parameter :: rounding = 100*epsilon(1.0_wp)
        real(wp), dimension(size(value, 1), n_kinds) :: least, most, error, allowed
        real(wp) :: product(size(value, 1)), s
        integer :: k, stat

        is_wrong = .false.
        value = 0.0_wp
        rate = 0.0_wp
        call probe%evaluate(need_jacobian + need_nu + need_gamma, t + position*path, q + position*path*qd, qd, counts, stat)
        if (stat /= status_ok) return
        s = lengths(size(lengths))*abs(path)
        associate (terms => probe%terms, speed => maxval(abs(qd)/magnitude))
            call probe%times_jacobian(qd, .false., product)
            value(:nh, of_jacobian) = product(:nh)
            value(:nh, of_nu) = value(:nh, of_jacobian) - terms%nu(:nh)
            value(:, of_gamma) = terms%gamma
            call probe%times_jacobian(qd, .true., allowed(:, of_jacobian))
            allowed(:, of_nu) = allowed(:, of_jacobian) + abs(terms%nu)
            allowed(:, of_gamma) = (least_share*speed + rounding/s)*allowed(:, of_nu)
            call probe%times_jacobian(magnitude, .true., product)
            do k = of_jacobian, of_nu
                allowed(:, k) = share*allowed(:, k) + rounding/s*product
            end do
        end associate
        least = huge(1.0_wp)
        most = -huge(1.0_wp)
        error = huge(1.0_wp)
        do k = 1, size(lengths)
            call differentiate(probe, nh, t + position*path, q + position*path*qd, qd, lengths(k)*abs(path), counts, rate, stat)
            if (stat /= status_ok) return
            least = min(least, rate)
            most = max(most, rate)
            error = min(error, abs(rate - value))
        end do
        ! A NaN remains in the sums, whereas comparisons would miss it.
        if (.not. sum(abs(value)) + sum(abs(rate)) + sum(abs(most) + abs(least)) <= huge(1.0_wp)) return
        allowed = max(allowed, max(share, 10*spacing(t)/s)*max(abs(value), abs(least), abs(most)))
        is_wrong = error > allowed .and. most - least < 0.5_wp*error
        if (iand(probe%has, need_gamma) == 0) is_wrong(:, of_gamma) = .false.
    end subroutine compare_at

    !> Central differences over time intervals of 2 s.
    subroutine differentiate(probe, nh, t, q, qd, s, counts, rate, stat)
        type(evaluator_type), intent(inout) :: probe
        integer, intent(in) :: nh
        real(wp), intent(in) :: t, q(:), qd(:), s
        type(counts_type), intent(inout) :: counts
        real(wp), intent(out) :: rate(:, :)
        integer, intent(out) :: stat
        real(wp) :: ahead, behind, side, product(size(rate, 1))
        integer :: i

        rate = 0.0_wp
        stat = status_ok
        ! Use the time steps that result from rounding.
        ahead = t + s
        behind = t - s
        if (.not. ahead > behind) then
            stat = 1
            return
        end if
        do i = 1, 2
            side = merge(1.0_wp, -1.0_wp, i == 1)/(ahead - behind)
            associate (terms => probe%terms, moved => merge(ahead, behind, i == 1))
                if (nh > 0) then
                    call probe%evaluate(need_phi, t, q + (moved - t)*qd, qd, counts, stat)
                    if (stat /= status_ok) return
                    rate(:nh, of_jacobian) = rate(:nh, of_jacobian) + side*terms%phi
                end if
                call probe%evaluate(need_phi + need_jacobian + need_nu, moved, q + (moved - t)*qd, qd, counts, stat)
                if (stat /= status_ok) return
                if (nh > 0) rate(:nh, of_nu) = rate(:nh, of_nu) + side*terms%phi
                call probe%times_jacobian(qd, .false., product)
                rate(:, of_gamma) = rate(:, of_gamma) + side*(product - terms%nu)
            end associate
        end do
    end subroutine differentiate
end module tandem_model_consistency
