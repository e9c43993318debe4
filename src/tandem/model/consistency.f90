! SPDX-License-Identifier: MIT
!> Whether the constraint procedures of a model contradict each other along a motion: Phi_q, nu and gamma against differences of
!> Phi and of C qd - nu on a short straight way. A look that a run can afford, where its steps show that something is amiss; all
!> procedures are compared by `tandem_model_verification`.
!>
!> No correct model is to be named. What is told is a contradiction at three places that have no time and no point of the way in
!> common, so that a kink or a jump is at one of them alone, and there for differences of all lengths, that agree with each other
!> much better than with the procedure, so that it is neither what they leave nor rounding. A model that cannot be evaluated there
!> is not judged.
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

    !> Length of the text that tells of a contradiction.
    integer, parameter :: contradiction_length = 320

    !> What is compared: Phi_q qd with differences of Phi at a fixed time, C qd - nu with those along the motion, gamma with those
    !> of C qd - nu. Each is a suspect only where those before it are right.
    integer, parameter :: of_jacobian = 1, of_nu = 2, of_gamma = 3, n_kinds = 3

    !> Places on the way, parts of it, and half the lengths of differences there.
    real(wp), parameter :: place(3) = [1.0_wp, 3.0_wp, 5.0_wp]/6.0_wp
    real(wp), parameter :: length(5) = [0.15_wp, 4.0e-2_wp, 1.0e-2_wp, 2.5e-3_wp, 6.0e-4_wp]
    !> The length of the first look, in the middle.
    integer, parameter :: of_look = 3

contains

    !> Look at a model on the straight way from (t, q) with the velocity qd.
    subroutine find_contradiction(model, t, q, qd, span, counts, contradiction)
        !> In the segment of the way.
        class(model_type), intent(inout), target :: model
        !> Time, coordinates and velocities (n): a point of a motion.
        real(wp), intent(in) :: t, q(:), qd(:)
        !> The time that the way takes at most, below zero for the way that lies behind.
        real(wp), intent(in) :: span
        !> What is evaluated is counted here.
        type(counts_type), intent(inout) :: counts
        !> Which procedure contradicts which others, where, and by how much; blank where none does.
        character(len=contradiction_length), intent(out) :: contradiction
        !> A way moves no coordinate by more than this part of it or of its scale.
        real(wp), parameter :: longest = 0.05_wp
        integer, parameter :: of_pattern = need_jacobian + need_mass
        type(evaluator_type) :: probe
        real(wp) :: speed, way, magnitude(model%n)
        real(wp), dimension(model%n_constraints(), n_kinds) :: value, rate
        logical, dimension(model%n_constraints(), n_kinds) :: is_wrong, is_wrong_here
        integer :: i, found(2)

        contradiction = ''
        if (model%n_constraints() == 0) return
        magnitude = model%scales()
        magnitude = max(abs(q), magnitude)
        speed = maxval(abs(qd)/magnitude)
        way = span
        if (speed*abs(span) > longest) way = sign(longest/speed, span)
        ! Single procedures set terms that are not compressed.
        call probe%initialize(model, compressed=allocated(model%pattern) .and. iand(model%provides, of_pattern) == of_pattern)
        call judge(probe, model%n_holonomic, t, q, qd, magnitude, way, 0.5_wp, length(of_look:of_look), counts, value, rate, &
            is_wrong)
        do i = 1, size(place)
            if (.not. any(is_wrong)) return
            call judge(probe, model%n_holonomic, t, q, qd, magnitude, way, place(i), length, counts, value, rate, &
                is_wrong_here)
            is_wrong = is_wrong .and. is_wrong_here
        end do
        found = findloc(is_wrong, .true.)
        if (found(1) == 0) return
        associate (row => found(1), kind => found(2))
            contradiction = 'the model contradicts itself: '//trim(told(kind, model%row_name(row), to_text(value(row, kind)), &
                to_text(rate(row, kind))))//', t = '//to_text(t + place(size(place))*way)// &
                '; correct the procedure (tandem check, verify_model compare them all)'
        end associate
    end subroutine find_contradiction

    !> What a procedure gives, and what it should.
    pure function told(kind, row, value, rate) result(text)
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
    end function told

    !> The rows whose procedures contradict differences of every length at one place of the way.
    subroutine judge(probe, nh, t, q, qd, magnitude, way, place, lengths, counts, value, rate, is_wrong)
        type(evaluator_type), intent(inout) :: probe
        integer, intent(in) :: nh
        !> Where the way begins, the larger of |q| and the scale of each coordinate (n), and how long the way takes.
        real(wp), intent(in) :: t, q(:), qd(:), magnitude(:), way
        !> Parts of the way; lengths from the longest to the shortest.
        real(wp), intent(in) :: place, lengths(:)
        type(counts_type), intent(inout) :: counts
        !> What procedures give, and the differences of the last length (m, n_kinds).
        real(wp), intent(out) :: value(:, :), rate(:, :)
        logical, intent(out) :: is_wrong(:, :)
        !> A wrong formula leaves more than the first part of what it gives or should give, or of the terms that cancel in it; below
        !> the second part of those a gamma does not matter.
        real(wp), parameter :: share = 1.0e-3_wp, least_share = 1.0e-6_wp
        !> What rounding may leave of the terms that cancel.
        real(wp), parameter :: rounding = 100*epsilon(1.0_wp)
        real(wp), dimension(size(value, 1), n_kinds) :: least, most, error, allowed
        real(wp) :: product(size(value, 1)), s
        integer :: k, stat

        is_wrong = .false.
        value = 0.0_wp
        rate = 0.0_wp
        call probe%evaluate(need_jacobian + need_nu + need_gamma, t + place*way, q + place*way*qd, qd, counts, stat)
        if (stat /= status_ok) return
        s = lengths(size(lengths))*abs(way)
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
            call differentiate(probe, nh, t + place*way, q + place*way*qd, qd, lengths(k)*abs(way), counts, rate, stat)
            if (stat /= status_ok) return
            least = min(least, rate)
            most = max(most, rate)
            error = min(error, abs(rate - value))
        end do
        ! NaN stay in the sums, and hide from the comparisons.
        if (.not. sum(abs(value)) + sum(abs(rate)) + sum(abs(most) + abs(least)) <= huge(1.0_wp)) return
        allowed = max(allowed, max(share, 10*spacing(t)/s)*max(abs(value), abs(least), abs(most)))
        is_wrong = error > allowed .and. most - least < 0.5_wp*error
        if (iand(probe%has, need_gamma) == 0) is_wrong(:, of_gamma) = .false.
    end subroutine judge

    !> The same by central differences over times of 2 s.
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
        ! As they are after rounding.
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
