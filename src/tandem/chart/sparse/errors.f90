! SPDX-License-Identifier: MIT
!> The errors of all constraint levels on the natural scales of their rows, in one pass through C node by node: what a node adds up
!> stays in registers.
module tandem_chart_sparse_errors
    use tandem_chart_sparse_analysis, only: analysis_type, most_rows
    use tandem_chart_sparse_blocks, only: most_coordinates
    use tandem_chart_sparse_factor, only: factor_type
    use tandem_kinds, only: wp
    use tandem_model_terms, only: terms_type
    implicit none (type, external)
    private

    public :: judge_rows, judge_velocity

    !> The most rows that are looked at together.
    integer, parameter :: most = max(most_rows, most_coordinates)

    !> Of each row C qd - nu and C qdd + gamma, and what their terms, and those of Phi, add up to.
    type :: sums_type
        real(wp) :: residual(most, 2) = 0.0_wp, scale(most, 3) = 0.0_wp
    end type sums_type

contains

    !> The largest error of each level, and its row.
    subroutine judge_rows(a, factor, terms, nh, q, qd, qdd, scale, errors, rows, scales)
        type(analysis_type), intent(in) :: a
        !> With C of the point.
        type(factor_type), intent(in) :: factor
        !> Phi, nu and gamma of the point.
        type(terms_type), intent(in) :: terms
        !> The number of holonomic rows.
        integer, intent(in) :: nh
        !> (n) each.
        real(wp), intent(in), contiguous :: q(:), qd(:), qdd(:), scale(:)
        real(wp), intent(out) :: errors(3)
        integer, intent(out) :: rows(3)
        !> The natural scales of Phi and of C qd - nu (m, 2); those of Phi without a meaning for rows at velocity level.
        real(wp), intent(inout), contiguous :: scales(:, :)
        type(sums_type) :: sums
        integer :: b, n

        errors = 0.0_wp
        rows = 0
        do n = 1, a%n_nodes
            if (a%is_body(n)) cycle
            associate (s => a%node(2, n), origin => a%node(4, n), links => a%node_start(n + 1) - a%node_start(n), &
                from => a%node_start(n))
                select case (s)
                case (5)
                    call add_node(5, links, a%node_link(1, from), factor%c, q, qd, qdd, scale, terms%nu(origin:origin + s - 1), &
                        terms%gamma(origin:origin + s - 1), sums)
                case (2)
                    call add_node(2, links, a%node_link(1, from), factor%c, q, qd, qdd, scale, terms%nu(origin:origin + s - 1), &
                        terms%gamma(origin:origin + s - 1), sums)
                case default
                    call add_node(s, links, a%node_link(1, from), factor%c, q, qd, qdd, scale, terms%nu(origin:origin + s - 1), &
                        terms%gamma(origin:origin + s - 1), sums)
                end select
                call take(origin, s)
            end associate
        end do
        do b = 1, a%n_bodies
            if (a%own_row(b) == 0) cycle
            associate (row => a%own_row(b), from => a%first(b), to => a%first(b + 1) - 1)
                call add_owned(to - from + 1, factor%own(from:to), q(from:to), qd(from:to), qdd(from:to), scale(from:to), &
                    terms%nu(row), terms%gamma(row), sums)
                call take(row, 1)
            end associate
        end do

    contains

        !> Compare what rows have added up to with the worst ones so far.
        subroutine take(first, count)
            integer, intent(in) :: first, count
            integer :: i

            do i = 1, count
                scales(first + i - 1, 1) = sums%scale(i, 1)
                scales(first + i - 1, 2) = sums%scale(i, 2)
                if (first + i - 1 <= nh) call compare(terms%phi(first + i - 1), sums%scale(i, 1), first + i - 1, errors(1), rows(1))
                call compare(sums%residual(i, 1), sums%scale(i, 2), first + i - 1, errors(2), rows(2))
                call compare(sums%residual(i, 2), sums%scale(i, 3), first + i - 1, errors(3), rows(3))
            end do
        end subroutine take
    end subroutine judge_rows

    !> What a velocity leaves of the rows, nu - C qd, and the reciprocals of their natural scales.
    pure subroutine judge_velocity(a, factor, nu, qd, scale, left, weight)
        type(analysis_type), intent(in) :: a
        !> With C of the point.
        type(factor_type), intent(in) :: factor
        !> nu, left and weight (m); qd and scale (n).
        real(wp), intent(in), contiguous :: nu(:), qd(:), scale(:)
        real(wp), intent(out), contiguous :: left(:), weight(:)
        real(wp) :: total(2)
        integer :: b, i, j, n

        left(:) = nu
        weight(:) = abs(nu)
        do n = 1, a%n_nodes
            if (a%is_body(n)) cycle
            associate (s => a%node(2, n), origin => a%node(4, n), links => a%node_start(n + 1) - a%node_start(n), &
                from => a%node_start(n))
                select case (s)
                case (5)
                    call add_velocity(5, links, a%node_link(1, from), factor%c, qd, scale, &
                        left(origin:origin + s - 1), weight(origin:origin + s - 1))
                case (2)
                    call add_velocity(2, links, a%node_link(1, from), factor%c, qd, scale, &
                        left(origin:origin + s - 1), weight(origin:origin + s - 1))
                case default
                    call add_velocity(s, links, a%node_link(1, from), factor%c, qd, scale, &
                        left(origin:origin + s - 1), weight(origin:origin + s - 1))
                end select
            end associate
        end do
        do b = 1, a%n_bodies
            if (a%own_row(b) == 0) cycle
            total = [left(a%own_row(b)), weight(a%own_row(b))]
            do j = a%first(b), a%first(b + 1) - 1
                total(1) = total(1) - factor%own(j)*qd(j)
                total(2) = total(2) + abs(factor%own(j))*max(abs(qd(j)), scale(j))
            end do
            left(a%own_row(b)) = total(1)
            weight(a%own_row(b)) = total(2)
        end do
        do i = 1, size(weight)
            weight(i) = 1.0_wp/max(weight(i), tiny(1.0_wp))
        end do
    end subroutine judge_velocity

    !> How many coordinates of a body's place enter rows of a joint that makes points meet, with a sign alone
    !> (`tandem_chart_sparse_meetings`).
    pure integer function n_of_place(s, sign)
        integer, intent(in), value :: s, sign

        n_of_place = 0
        if (sign /= 0) n_of_place = merge(3, 2, s == 5)
    end function n_of_place

    !> The rows of a node: residuals, and what their terms add up to.
    pure subroutine add_velocity(s, n_links, node_link, c, qd, scale, left, total)
        integer, intent(in), value :: s, n_links
        integer, intent(in) :: node_link(4, n_links)
        real(wp), intent(in) :: c(*), qd(*), scale(*)
        real(wp), intent(inout) :: left(s), total(s)
        real(wp) :: residual(most), terms(most), x
        integer :: i, j, k, l, n_place

        do i = 1, s
            residual(i) = left(i)
            terms(i) = total(i)
        end do
        do l = 1, n_links
            k = node_link(3, l)
            n_place = n_of_place(s, node_link(4, l))
            do i = 1, n_place
                j = node_link(1, l) + i - 1
                residual(i) = residual(i) - node_link(4, l)*qd(j)
                terms(i) = terms(i) + max(abs(qd(j)), scale(j))
            end do
            k = k + s*n_place
            do j = node_link(1, l) + n_place, node_link(1, l) + node_link(2, l) - 1
                x = max(abs(qd(j)), scale(j))
                do i = 1, s
                    residual(i) = residual(i) - c(k + i)*qd(j)
                    terms(i) = terms(i) + abs(c(k + i))*x
                end do
                k = k + s
            end do
        end do
        do i = 1, s
            left(i) = residual(i)
            total(i) = terms(i)
        end do
    end subroutine add_velocity

    !> The error of a row against the worst one so far.
    pure subroutine compare(residual, scale, row, worst, worst_row)
        real(wp), intent(in) :: residual, scale
        integer, intent(in) :: row
        real(wp), intent(inout) :: worst
        integer, intent(inout) :: worst_row

        ! As a product, which costs less; NaN go on.
        if (abs(residual) <= worst*scale .and. worst_row > 0 .and. scale <= huge(1.0_wp)) return
        if (abs(residual)/max(scale, tiny(1.0_wp)) <= worst .and. worst_row > 0 .and. scale <= huge(1.0_wp)) return
        worst = abs(residual)/max(scale, tiny(1.0_wp))
        if (.not. worst <= huge(1.0_wp) .or. .not. scale <= huge(1.0_wp)) worst = huge(1.0_wp)
        worst_row = row
    end subroutine compare

    !> What the rows of a node add up to.
    pure subroutine add_node(s, n_links, node_link, c, q, qd, qdd, scale, nu, gamma, sums)
        integer, intent(in), value :: s, n_links
        integer, intent(in) :: node_link(4, n_links)
        real(wp), intent(in) :: c(*), q(*), qd(*), qdd(*), scale(*), nu(s), gamma(s)
        type(sums_type), intent(inout) :: sums
        real(wp) :: entry, x(3)
        real(wp), dimension(most) :: velocity, acceleration, of_q, of_qd, of_qdd
        integer :: i, j, k, l, n_place

        do i = 1, s
            velocity(i) = -nu(i)
            acceleration(i) = gamma(i)
            of_q(i) = 0.0_wp
            of_qd(i) = abs(nu(i))
            of_qdd(i) = abs(gamma(i))
        end do
        do l = 1, n_links
            k = node_link(3, l)
            n_place = n_of_place(s, node_link(4, l))
            do i = 1, n_place
                j = node_link(1, l) + i - 1
                velocity(i) = velocity(i) + node_link(4, l)*qd(j)
                acceleration(i) = acceleration(i) + node_link(4, l)*qdd(j)
                of_q(i) = of_q(i) + max(abs(q(j)), scale(j))
                of_qd(i) = of_qd(i) + max(abs(qd(j)), scale(j))
                of_qdd(i) = of_qdd(i) + max(abs(qdd(j)), scale(j))
            end do
            k = k + s*n_place
            do j = node_link(1, l) + n_place, node_link(1, l) + node_link(2, l) - 1
                x = max([abs(q(j)), abs(qd(j)), abs(qdd(j))], scale(j))
                do i = 1, s
                    entry = c(k + i)
                    velocity(i) = velocity(i) + entry*qd(j)
                    acceleration(i) = acceleration(i) + entry*qdd(j)
                    entry = abs(entry)
                    of_q(i) = of_q(i) + entry*x(1)
                    of_qd(i) = of_qd(i) + entry*x(2)
                    of_qdd(i) = of_qdd(i) + entry*x(3)
                end do
                k = k + s
            end do
        end do
        do i = 1, s
            sums%residual(i, 1) = velocity(i)
            sums%residual(i, 2) = acceleration(i)
            sums%scale(i, 1) = of_q(i)
            sums%scale(i, 2) = of_qd(i)
            sums%scale(i, 3) = of_qdd(i)
        end do
    end subroutine add_node

    !> The same of a row that a body owns.
    pure subroutine add_owned(nb, own, q, qd, qdd, scale, nu, gamma, sums)
        integer, intent(in) :: nb
        real(wp), intent(in) :: own(nb), q(nb), qd(nb), qdd(nb), scale(nb), nu, gamma
        type(sums_type), intent(inout) :: sums
        real(wp) :: entry, residual(2), terms(3)
        integer :: j

        residual = [-nu, gamma]
        terms = [0.0_wp, abs(nu), abs(gamma)]
        do j = 1, nb
            entry = own(j)
            residual(1) = residual(1) + entry*qd(j)
            residual(2) = residual(2) + entry*qdd(j)
            entry = abs(entry)
            terms(1) = terms(1) + entry*max(abs(q(j)), scale(j))
            terms(2) = terms(2) + entry*max(abs(qd(j)), scale(j))
            terms(3) = terms(3) + entry*max(abs(qdd(j)), scale(j))
        end do
        sums%residual(1, :) = residual
        sums%scale(1, :) = terms
    end subroutine add_owned
end module tandem_chart_sparse_errors
