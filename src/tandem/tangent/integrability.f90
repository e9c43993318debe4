! SPDX-License-Identifier: MIT
!> Nonholonomic rows that are integrable: constraints on the position in disguise, which belong among the holonomic ones. Only
!> there is their position held.
!>
!> Frobenius: a row E_i qd = e_i, the form w = E_i dq - e_i dt, is integrable on the manifold of Phi where dw(x, y) = 0 for all
!> directions x, y of (q, t) with w(x) = w(y) = 0 and dPhi(x) = dPhi(y) = 0; rows are integrable together where every dw_i
!> vanishes on the directions that all of them allow. Derivatives by central differences; an accident of one point is told from
!> integrability by a look at others. Source: R. M. Murray, Z. Li, S. S. Sastry, A Mathematical Introduction to Robotic
!> Manipulation, CRC Press 1994, section 6.2 and chapter 7.
module tandem_tangent_integrability
    use tandem_kinds, only: wp
    use tandem_linalg_basis, only: basis_type
    use tandem_model, only: model_type
    use tandem_model_evaluator, only: evaluator_type
    use tandem_model_terms, only: need_jacobian, need_nu
    use tandem_status, only: status_ok
    use tandem_tangent_counts, only: counts_type
    implicit none (type, external)
    private

    public :: find_integrable_rows

contains

    !> Find the nonholonomic rows that are integrable at and near (t, q).
    subroutine find_integrable_rows(model, scale, t, q, counts, alone, together)
        class(model_type), intent(inout), target :: model
        !> Coordinate scales (n), time and coordinates (n).
        real(wp), intent(in) :: scale(:), t, q(:)
        type(counts_type), intent(inout) :: counts
        !> Rows of C that are integrable by themselves.
        integer, allocatable, intent(out) :: alone(:)
        !> Whether all nonholonomic rows are integrable together, none of them alone.
        logical, intent(out) :: together
        integer, parameter :: n_points = 3
        real(wp), parameter :: distance = 0.01_wp
        logical :: is_alone(model%n_nonholonomic), are_together
        real(wp) :: point(size(q))
        type(evaluator_type) :: evaluator
        integer :: i, j, stat

        is_alone = .true.
        together = model%n_nonholonomic > 1
        call evaluator%initialize(model)
        do i = 1, n_points
            point = q + (i - 1)*distance*scale*[(sin(real(i + 3*j, wp)), j=1, size(q))]
            call test_point(evaluator, model%n_holonomic, scale, t, point, counts, is_alone, are_together, stat)
            together = together .and. are_together
            ! What cannot be evaluated cannot be judged.
            if (stat /= status_ok) is_alone = .false.
            if (stat /= status_ok) together = .false.
            if (.not. (any(is_alone) .or. together)) exit
        end do
        alone = pack([(model%n_holonomic + j, j=1, size(is_alone))], is_alone)
        together = together .and. size(alone) == 0
    end subroutine find_integrable_rows

    !> The test at one point.
    subroutine test_point(evaluator, nh, scale, t, q, counts, is_alone, are_together, stat)
        type(evaluator_type), intent(inout) :: evaluator
        integer, intent(in) :: nh
        real(wp), intent(in) :: scale(:), t, q(:)
        type(counts_type), intent(inout) :: counts
        !> Rows that have passed so far (nd).
        logical, intent(inout) :: is_alone(:)
        logical, intent(out) :: are_together
        integer, intent(out) :: stat
        !> Displacement of central differences, eps**(1/3).
        real(wp), parameter :: delta = epsilon(1.0_wp)**(1.0_wp/3)
        !> Rows of [C, -nu] in scaled (q, t), their derivatives, and the scales with that of the time.
        real(wp) :: forms(size(evaluator%terms%nu), size(q) + 1), unit_scale(size(q) + 1)
        real(wp) :: derivative(size(evaluator%terms%nu), size(q) + 1, size(q) + 1), displaced(size(q)), moved, length
        real(wp) :: ahead(size(evaluator%terms%nu), size(q) + 1), behind(size(evaluator%terms%nu), size(q) + 1)
        integer :: i, j, m, n

        n = size(q)
        m = size(evaluator%terms%nu)
        unit_scale = 1.0_wp
        are_together = .false.
        call load(t, q, forms)
        if (stat /= status_ok) return
        do j = 1, n + 1
            displaced = q
            moved = t
            if (j <= n) displaced(j) = q(j) + delta*scale(j)
            if (j > n) moved = t + delta
            call load(moved, displaced, ahead)
            if (stat /= status_ok) return
            if (j <= n) displaced(j) = q(j) - delta*scale(j)
            if (j > n) moved = t - delta
            call load(moved, displaced, behind)
            if (stat /= status_ok) return
            derivative(:, :, j) = (ahead - behind)/(2*delta)
        end do
        do i = 1, m
            length = norm2(forms(i, :))
            if (.not. length > 0.0_wp) cycle
            forms(i, :) = forms(i, :)/length
            derivative(i, :, :) = derivative(i, :, :)/length
        end do
        do i = nh + 1, m
            if (is_alone(i - nh)) is_alone(i - nh) = vanishes([i], [(j, j=1, nh), i])
        end do
        are_together = vanishes([(i, i=nh + 1, m)], [(i, i=1, m)])

    contains

        !> The rows of [C diag(s), -nu].
        subroutine load(time, place, rows)
            real(wp), intent(in) :: time, place(:)
            real(wp), intent(out) :: rows(:, :)
            integer :: k

            counts%start_evaluations = counts%start_evaluations + 1
            call evaluator%evaluate(need_jacobian + need_nu, time, place, place, counts, stat)
            associate (terms => evaluator%terms)
                do k = 1, n
                    rows(:, k) = terms%jacobian(:, k)*scale(k)
                end do
                rows(:, n + 1) = -terms%nu
            end associate
            if (.not. sum(abs(rows)) <= huge(1.0_wp)) stat = -1
        end subroutine load

        !> Whether the derivatives of forms vanish on what the forms `within` allow.
        logical function vanishes(tested, within)
            integer, intent(in) :: tested(:), within(:)
            !> Differences are good to 1e-9.
            real(wp), parameter :: small = 1.0e-6_wp
            real(wp) :: rows(size(within), n + 1), curl(n + 1, n + 1), size_of_derivative
            type(basis_type) :: basis
            integer :: k, row

            vanishes = .false.
            ! On fewer than two directions there is nothing to test.
            if (n + 1 - size(within) < 2) return
            rows = forms(within, :)
            call basis%allocate(n + 1, size(within), size(within))
            call basis%factor_qr(rows, unit_scale, n + 1)
            if (basis%deficient) return
            do k = 1, size(tested)
                row = tested(k)
                size_of_derivative = max(1.0_wp, maxval(abs(derivative(row, :, :))))
                curl = derivative(row, :, :) - transpose(derivative(row, :, :))
                associate (allowed => basis%q(:, size(within) + 1:))
                    if (maxval(abs(matmul(transpose(allowed), matmul(curl, allowed)))) > small*size_of_derivative) return
                end associate
            end do
            vanishes = .true.
        end function vanishes
    end subroutine test_point
end module tandem_tangent_integrability
