! SPDX-License-Identifier: MIT
!> The errors of all constraint levels on the natural scales of their rows, in one pass through C node by node: the sums of a node
!> stay in registers.
module tandem_chart_sparse_errors
    use tandem_chart_sparse_analysis, only: analysis_type, most_rows
    use tandem_chart_sparse_blocks, only: most_coordinates
    use tandem_chart_sparse_factor, only: factor_type
    use tandem_chart_sparse_meetings, only: n_of_place, of_hinges
    use tandem_kinds, only: wp
    use tandem_model_terms, only: terms_type
    implicit none (type, external)
    private

    public :: judge_rows, judge_velocity

    !> Largest number of rows that are processed together.
    integer, parameter :: most = max(most_rows, most_coordinates)

    !> For each row C qd - nu and C qdd + gamma, and the sums of the sizes of their terms and of the terms of Phi.
    type :: sums_type
        real(wp) :: residual(most, 2) = 0.0_wp, scale(most, 3) = 0.0_wp
    end type sums_type

contains

    !> The largest error of each level, and its row.
    subroutine judge_rows(a, factor, terms, nh, q, qd, qdd, scale, rate, errors, rows, scales)
        type(analysis_type), intent(in) :: a
        !> With C of the point.
        type(factor_type), intent(in) :: factor
        !> Phi, nu and gamma of the point.
        type(terms_type), intent(in) :: terms
        !> The number of holonomic rows.
        integer, intent(in) :: nh
        !> (n) each.
        real(wp), intent(in), contiguous :: q(:), qd(:), qdd(:), scale(:)
        !> 1 over the time scale.
        real(wp), intent(in) :: rate
        real(wp), intent(out) :: errors(3)
        integer, intent(out) :: rows(3)
        !> The natural scales of Phi and of C qd - nu (m, 2); the scales of Phi are undefined for rows at velocity level.
        real(wp), intent(inout), contiguous :: scales(:, :)
        type(sums_type) :: sums
        integer :: b, n

        errors = 0.0_wp
        rows = 0
        do n = 1, a%n_nodes
            if (a%is_body(n)) cycle
            associate (s => a%node(2, n), origin => a%node(4, n), links => a%node_start(n + 1) - a%node_start(n), &
                from => a%node_start(n), n_place => n_of_place(a%joint_of_node(n)))
                call start_sums(s, terms%nu(origin:origin + s - 1), terms%gamma(origin:origin + s - 1), sums)
                if (a%joint_of_node(n) == of_hinges) then
                    call add_hinge(links, a%node_link(1, from), factor%c, q, qd, qdd, scale, rate, sums)
                    call take(origin, 5)
                    cycle
                end if
                select case (s)
                case (5)
                    call add_node(5, n_place, links, a%node_link(1, from), factor%c, q, qd, qdd, scale, rate, sums)
                case (2)
                    call add_node(2, n_place, links, a%node_link(1, from), factor%c, q, qd, qdd, scale, rate, sums)
                case default
                    call add_node(s, n_place, links, a%node_link(1, from), factor%c, q, qd, qdd, scale, rate, sums)
                end select
                call take(origin, s)
            end associate
        end do
        do b = 1, a%n_bodies
            if (a%own_row(b) == 0) cycle
            ! The norm of Euler parameters does not depend on the position.
            associate (row => a%own_row(b), from => a%first(b) + merge(3, 0, a%joints_of_body(b) == of_hinges), &
                to => a%first(b + 1) - 1)
                call start_sums(1, terms%nu(row:row), terms%gamma(row:row), sums)
                call add_owned(to - from + 1, factor%own(from:to), q(from:to), qd(from:to), qdd(from:to), scale(from:to), &
                    rate, sums)
                call take(row, 1)
            end associate
        end do

    contains

        !> Compare the sums of rows with the worst rows so far.
        subroutine take(first, count)
            integer, intent(in) :: first, count
            integer :: i
            logical :: is_better

            if (count == 5) then
                call keep_scales(5, size(scales, 1), first, sums, scales)
                is_better = are_better(5, sums, errors)
            else
                call keep_scales(count, size(scales, 1), first, sums, scales)
                is_better = are_better(count, sums, errors)
            end if
            do i = first, min(first + count - 1, nh)
                is_better = is_better .and. abs(terms%phi(i)) <= errors(1)*sums%scale(i - first + 1, 1)
            end do
            ! Rows at velocity level have no position error.
            if (is_better .and. all(rows(2:) > 0) .and. (rows(1) > 0 .or. first > nh)) return
            do i = 1, count
                if (first + i - 1 <= nh) call compare(terms%phi(first + i - 1), sums%scale(i, 1), first + i - 1, errors(1), rows(1))
                call compare(sums%residual(i, 1), sums%scale(i, 2), first + i - 1, errors(2), rows(2))
                call compare(sums%residual(i, 2), sums%scale(i, 3), first + i - 1, errors(3), rows(3))
            end do
        end subroutine take
    end subroutine judge_rows

    !> True if no velocity or acceleration error of the rows exceeds the worst so far; false for NaN. As products, which cost less.
    pure logical function are_better(count, sums, errors)
        integer, intent(in), value :: count
        type(sums_type), intent(in) :: sums
        real(wp), intent(in) :: errors(3)
        integer :: i, n

        n = 0
        do i = 1, count
            n = n + merge(1, 0, abs(sums%residual(i, 1)) <= errors(2)*sums%scale(i, 2))
            n = n + merge(1, 0, abs(sums%residual(i, 2)) <= errors(3)*sums%scale(i, 3))
            n = n + merge(1, 0, (sums%scale(i, 1) + sums%scale(i, 2)) + sums%scale(i, 3) <= huge(1.0_wp))
        end do
        are_better = n == 3*count
    end function are_better

    pure subroutine keep_scales(count, m, first, sums, scales)
        integer, intent(in), value :: count, m, first
        type(sums_type), intent(in) :: sums
        real(wp), intent(inout) :: scales(m, 2)
        integer :: i

        do i = 1, count
            scales(first + i - 1, 1) = sums%scale(i, 1)
            scales(first + i - 1, 2) = sums%scale(i, 2)
        end do
    end subroutine keep_scales

    !> The residual nu - C qd of a velocity, and the reciprocals of the natural scales of the rows.
    pure subroutine judge_velocity(a, factor, nu, qd, scale, rate, left, weight)
        type(analysis_type), intent(in) :: a
        !> With C of the point.
        type(factor_type), intent(in) :: factor
        !> nu, left and weight (m); qd and scale (n).
        real(wp), intent(in), contiguous :: nu(:), qd(:), scale(:)
        !> 1 over the time scale.
        real(wp), intent(in) :: rate
        real(wp), intent(out), contiguous :: left(:), weight(:)
        real(wp) :: total(2)
        integer :: b, i, j, n

        left(:) = nu
        weight(:) = abs(nu)
        do n = 1, a%n_nodes
            if (a%is_body(n)) cycle
            associate (s => a%node(2, n), origin => a%node(4, n), links => a%node_start(n + 1) - a%node_start(n), &
                from => a%node_start(n), n_place => n_of_place(a%joint_of_node(n)))
                if (a%joint_of_node(n) == of_hinges) then
                    call add_velocity_of_hinge(links, a%node_link(1, from), factor%c, qd, scale, rate, &
                        left(origin:origin + 4), weight(origin:origin + 4))
                    cycle
                end if
                select case (s)
                case (5)
                    call add_velocity(5, n_place, links, a%node_link(1, from), factor%c, qd, scale, rate, &
                        left(origin:origin + s - 1), weight(origin:origin + s - 1))
                case (2)
                    call add_velocity(2, n_place, links, a%node_link(1, from), factor%c, qd, scale, rate, &
                        left(origin:origin + s - 1), weight(origin:origin + s - 1))
                case default
                    call add_velocity(s, n_place, links, a%node_link(1, from), factor%c, qd, scale, rate, &
                        left(origin:origin + s - 1), weight(origin:origin + s - 1))
                end select
            end associate
        end do
        do b = 1, a%n_bodies
            if (a%own_row(b) == 0) cycle
            total = [left(a%own_row(b)), weight(a%own_row(b))]
            do j = a%first(b) + merge(3, 0, a%joints_of_body(b) == of_hinges), a%first(b + 1) - 1
                total(1) = total(1) - factor%own(j)*qd(j)
                total(2) = total(2) + abs(factor%own(j))*max(abs(qd(j)), rate*scale(j))
            end do
            left(a%own_row(b)) = total(1)
            weight(a%own_row(b)) = total(2)
        end do
        do i = 1, size(weight)
            weight(i) = 1.0_wp/max(weight(i), tiny(1.0_wp))
        end do
    end subroutine judge_velocity

    !> The rows of a node: residuals, and the sums of the sizes of their terms.
    pure subroutine add_velocity(s, n_place, n_links, node_link, c, qd, scale, rate, left, total)
        !> Number of columns of a position that are the unit matrix with a sign (`tandem_chart_sparse_meetings`).
        integer, intent(in), value :: s, n_place, n_links
        integer, intent(in) :: node_link(4, n_links)
        real(wp), intent(in) :: c(*), qd(*), scale(*), rate
        real(wp), intent(inout) :: left(s), total(s)
        real(wp) :: residual(most), terms(most), x
        integer :: i, j, k, l

        do i = 1, s
            residual(i) = left(i)
            terms(i) = total(i)
        end do
        do l = 1, n_links
            k = node_link(3, l)
            do i = 1, n_place
                j = node_link(1, l) + i - 1
                residual(i) = residual(i) - node_link(4, l)*qd(j)
                terms(i) = terms(i) + max(abs(qd(j)), rate*scale(j))
            end do
            k = k + s*n_place
            do j = node_link(1, l) + n_place, node_link(1, l) + node_link(2, l) - 1
                x = max(abs(qd(j)), rate*scale(j))
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

    !> max(|x|, scale) without the treatment of NaN in `max`: residuals show NaN.
    elemental real(wp) function larger(x, scale)
        real(wp), intent(in) :: x, scale

        larger = merge(abs(x), scale, abs(x) > scale)
    end function larger

    !> The five rows of a hinge: the columns of a position are the unit matrix with a sign, followed by the columns of a rotation.
    pure subroutine add_velocity_of_hinge(n_links, node_link, c, qd, scale, rate, left, total)
        integer, intent(in), value :: n_links
        integer, intent(in) :: node_link(4, n_links)
        real(wp), intent(in) :: c(*), qd(*), scale(*), rate
        real(wp), intent(inout) :: left(5), total(5)
        real(wp) :: residual(4), terms(4), last(2), sign(4), x(4)
        integer :: i, j, l

        sign(4) = 0.0_wp
        !GCC$ UNROLL 1
        do i = 1, 4
            residual(i) = left(i)
            terms(i) = total(i)
        end do
        last = [left(5), total(5)]
        do l = 1, n_links
            associate (first => node_link(1, l), k => node_link(3, l) + 15)
                sign(1:3) = real(node_link(4, l), wp)
                !GCC$ UNROLL 1
                do i = 1, 4
                    residual(i) = residual(i) - sign(i)*qd(first - 1 + i)
                    terms(i) = terms(i) + abs(sign(i))*larger(qd(first - 1 + i), rate*scale(first - 1 + i))
                    x(i) = larger(qd(first + 2 + i), rate*scale(first + 2 + i))
                end do
                !GCC$ UNROLL 4
                do j = 1, 4
                    !GCC$ UNROLL 1
                    do i = 1, 4
                        residual(i) = residual(i) - c(k + 5*(j - 1) + i)*qd(first + 2 + j)
                        terms(i) = terms(i) + abs(c(k + 5*(j - 1) + i))*x(j)
                    end do
                    last(1) = last(1) - c(k + 5*j)*qd(first + 2 + j)
                    last(2) = last(2) + abs(c(k + 5*j))*x(j)
                end do
            end associate
        end do
        !GCC$ UNROLL 1
        do i = 1, 4
            left(i) = residual(i)
            total(i) = terms(i)
        end do
        left(5) = last(1)
        total(5) = last(2)
    end subroutine add_velocity_of_hinge

    !> Compare the error of a row with the worst one so far.
    pure subroutine compare(residual, scale, row, worst, worst_row)
        real(wp), intent(in) :: residual, scale
        integer, intent(in) :: row
        real(wp), intent(inout) :: worst
        integer, intent(inout) :: worst_row

        if (abs(residual)/max(scale, tiny(1.0_wp)) <= worst .and. worst_row > 0 .and. scale <= huge(1.0_wp)) return
        worst = abs(residual)/max(scale, tiny(1.0_wp))
        if (.not. worst <= huge(1.0_wp) .or. .not. scale <= huge(1.0_wp)) worst = huge(1.0_wp)
        worst_row = row
    end subroutine compare

    !> Start the sums of rows by the terms that do not depend on velocities and accelerations.
    pure subroutine start_sums(s, nu, gamma, sums)
        integer, intent(in) :: s
        real(wp), intent(in) :: nu(s), gamma(s)
        type(sums_type), intent(inout) :: sums
        integer :: i

        do i = 1, s
            sums%residual(i, 1) = -nu(i)
            sums%residual(i, 2) = gamma(i)
            sums%scale(i, 1) = 0.0_wp
            sums%scale(i, 2) = abs(nu(i))
            sums%scale(i, 3) = abs(gamma(i))
        end do
    end subroutine start_sums

    !> The sums of the rows of a node.
    pure subroutine add_node(s, n_place, n_links, node_link, c, q, qd, qdd, scale, rate, sums)
        integer, intent(in), value :: s, n_place, n_links
        integer, intent(in) :: node_link(4, n_links)
        real(wp), intent(in) :: c(*), q(*), qd(*), qdd(*), scale(*), rate
        type(sums_type), intent(inout) :: sums
        real(wp) :: entry, x(3)
        real(wp), dimension(most) :: velocity, acceleration, of_q, of_qd, of_qdd
        integer :: i, j, k, l

        do i = 1, s
            velocity(i) = sums%residual(i, 1)
            acceleration(i) = sums%residual(i, 2)
            of_q(i) = 0.0_wp
            of_qd(i) = sums%scale(i, 2)
            of_qdd(i) = sums%scale(i, 3)
        end do
        do l = 1, n_links
            k = node_link(3, l)
            do i = 1, n_place
                j = node_link(1, l) + i - 1
                velocity(i) = velocity(i) + node_link(4, l)*qd(j)
                acceleration(i) = acceleration(i) + node_link(4, l)*qdd(j)
                of_q(i) = of_q(i) + max(abs(q(j)), scale(j))
                of_qd(i) = of_qd(i) + max(abs(qd(j)), rate*scale(j))
                of_qdd(i) = of_qdd(i) + max(abs(qdd(j)), rate*(rate*scale(j)))
            end do
            k = k + s*n_place
            do j = node_link(1, l) + n_place, node_link(1, l) + node_link(2, l) - 1
                x = max([abs(q(j)), abs(qd(j)), abs(qdd(j))], [1.0_wp, rate, rate*rate]*scale(j))
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

    !> The sums of a hinge, like `add_velocity_of_hinge`.
    pure subroutine add_hinge(n_links, node_link, c, q, qd, qdd, scale, rate, sums)
        integer, intent(in), value :: n_links
        integer, intent(in) :: node_link(4, n_links)
        real(wp), intent(in) :: c(*), q(*), qd(*), qdd(*), scale(*), rate
        type(sums_type), intent(inout) :: sums
        real(wp), dimension(4) :: velocity, acceleration, of_q, of_qd, of_qdd, sign
        real(wp) :: entry, last(5), x(4, 3)
        integer :: i, j, l

        sign(4) = 0.0_wp
        !GCC$ UNROLL 1
        do i = 1, 4
            velocity(i) = sums%residual(i, 1)
            acceleration(i) = sums%residual(i, 2)
            of_q(i) = 0.0_wp
            of_qd(i) = sums%scale(i, 2)
            of_qdd(i) = sums%scale(i, 3)
        end do
        last = [sums%residual(5, :), sums%scale(5, :)]
        do l = 1, n_links
            associate (first => node_link(1, l), k => node_link(3, l) + 15)
                sign(1:3) = real(node_link(4, l), wp)
                !GCC$ UNROLL 1
                do i = 1, 4
                    associate (place => first - 1 + i, turn => first + 2 + i)
                        velocity(i) = velocity(i) + sign(i)*qd(place)
                        acceleration(i) = acceleration(i) + sign(i)*qdd(place)
                        of_q(i) = of_q(i) + abs(sign(i))*larger(q(place), scale(place))
                        of_qd(i) = of_qd(i) + abs(sign(i))*larger(qd(place), rate*scale(place))
                        of_qdd(i) = of_qdd(i) + abs(sign(i))*larger(qdd(place), rate*(rate*scale(place)))
                        x(i, 1) = larger(q(turn), scale(turn))
                        x(i, 2) = larger(qd(turn), rate*scale(turn))
                        x(i, 3) = larger(qdd(turn), rate*(rate*scale(turn)))
                    end associate
                end do
                !GCC$ UNROLL 4
                do j = 1, 4
                    !GCC$ UNROLL 1
                    do i = 1, 4
                        entry = c(k + 5*(j - 1) + i)
                        velocity(i) = velocity(i) + entry*qd(first + 2 + j)
                        acceleration(i) = acceleration(i) + entry*qdd(first + 2 + j)
                        of_q(i) = of_q(i) + abs(entry)*x(j, 1)
                        of_qd(i) = of_qd(i) + abs(entry)*x(j, 2)
                        of_qdd(i) = of_qdd(i) + abs(entry)*x(j, 3)
                    end do
                    entry = c(k + 5*j)
                    last(1) = last(1) + entry*qd(first + 2 + j)
                    last(2) = last(2) + entry*qdd(first + 2 + j)
                    do i = 1, 3
                        last(2 + i) = last(2 + i) + abs(entry)*x(j, i)
                    end do
                end do
            end associate
        end do
        !GCC$ UNROLL 1
        do i = 1, 4
            sums%residual(i, 1) = velocity(i)
            sums%residual(i, 2) = acceleration(i)
            sums%scale(i, 1) = of_q(i)
            sums%scale(i, 2) = of_qd(i)
            sums%scale(i, 3) = of_qdd(i)
        end do
        sums%residual(5, :) = last(:2)
        sums%scale(5, :) = last(3:)
    end subroutine add_hinge

    !> The sums of a row that a body owns.
    pure subroutine add_owned(nb, own, q, qd, qdd, scale, rate, sums)
        integer, intent(in) :: nb
        real(wp), intent(in) :: own(nb), q(nb), qd(nb), qdd(nb), scale(nb), rate
        type(sums_type), intent(inout) :: sums
        real(wp) :: entry, residual(2), terms(3)
        integer :: j

        residual = sums%residual(1, :)
        terms = sums%scale(1, :)
        do j = 1, nb
            entry = own(j)
            residual(1) = residual(1) + entry*qd(j)
            residual(2) = residual(2) + entry*qdd(j)
            entry = abs(entry)
            terms(1) = terms(1) + entry*max(abs(q(j)), scale(j))
            terms(2) = terms(2) + entry*max(abs(qd(j)), rate*scale(j))
            terms(3) = terms(3) + entry*max(abs(qdd(j)), rate*(rate*scale(j)))
        end do
        sums%residual(1, :) = residual
        sums%scale(1, :) = terms
    end subroutine add_owned
end module tandem_chart_sparse_errors
