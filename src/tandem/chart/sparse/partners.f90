! SPDX-License-Identifier: MIT
!> The combinations of rows in use that equal rows left out, and the multipliers of least norm, which distribute the load of a
!> combination over all its rows. One solution gives many combinations: the rows of each are connected by bodies, which separates
!> combinations without a common body. The others are solved for again, in several lots.
module tandem_chart_sparse_partners
    use tandem_chart_sparse_system, only: system_type
    use tandem_kinds, only: wp
    use tandem_model_counts, only: counts_type
    use tandem_model_lists, only: sort_to_lists
    use tandem_status, only: status_ok, status_rank_deficient
    implicit none (type, external)
    private

    public :: choose_independent, find_partners, share_load

    !> Number of lots of rows whose combinations may touch. Rows of one joint, three at most in a bay of hinges, are adjacent, and
    !> those of neighbouring bays touch.
    integer, parameter :: lots = 6

contains

    !> Choose the rows that are left out at the last point of a system. Rows of Phi are left out only if they depend on other rows
    !> of Phi: where one depends on rows of E that are eliminated before it, one of these is left out in its place.
    subroutine choose_independent(system, counts, stat)
        type(system_type), intent(inout) :: system
        type(counts_type), intent(inout) :: counts
        !> A status code.
        integer, intent(out) :: stat
        logical :: is_out(system%m), repeats(system%nh)
        real(wp) :: lambda(system%m), force(size(system%x))
        integer :: k, row, other

        is_out = .false.
        repeats = .false.
        if (system%m > system%nh) then
            is_out(system%nh + 1:) = .true.
            call system%choose_rows(is_out, counts, stat)
            if (stat /= status_ok) return
            repeats = system%factor(system%here)%is_out(:system%nh)
            is_out(:system%nh) = repeats
            is_out(system%nh + 1:) = .false.
        end if
        do k = 0, system%m - system%nh
            call system%choose_rows(is_out, counts, stat)
            if (stat /= status_ok) return
            is_out = system%factor(system%here)%is_out
            row = 0
            if (system%m > system%nh) row = findloc(is_out(:system%nh) .and. .not. repeats, .true., dim=1)
            if (row == 0) return
            call combine(system, [row], .false., lambda, force)
            other = system%nh + maxloc(abs(lambda(system%nh + 1:)), dim=1)
            if (.not. abs(lambda(other)) > 0.0_wp) exit
            is_out(row) = .false.
            is_out(other) = .true.
        end do
        stat = status_rank_deficient
    end subroutine choose_independent

    !> The partners of rows that were left out at the last factorisation of the system.
    subroutine find_partners(system, rows, start, partners)
        type(system_type), intent(inout) :: system
        integer, intent(in) :: rows(:)
        !> The partners of rows(i) are partners(start(i):start(i + 1) - 1), ascending.
        integer, allocatable, intent(out) :: start(:), partners(:)
        !> Smaller factors than this part of the largest are rounding.
        real(wp), parameter :: least_share = 1.0e-6_wp
        integer, allocatable :: pairs(:, :)
        real(wp), allocatable :: share(:)

        call find_combinations(system, rows, .false., least_share, pairs, share)
        call sort_to_lists(size(rows), pairs(1, :), pairs(2, :), start, partners)
    end subroutine find_partners

    !> Change multipliers, which are zero for the rows left out, to those of least norm with the same reactions. Their components
    !> along combinations v with C' v = 0 are subtracted: (V'V) y = V' lambda, lambda := lambda - V y. The row that was left out
    !> makes V'V at least the unit matrix, so that conjugate gradients take few iterations.
    subroutine share_load(system, rows, lambda)
        !> Factored at the point of the multipliers.
        type(system_type), intent(inout) :: system
        !> The rows that were left out.
        integer, intent(in) :: rows(:)
        !> (m)
        real(wp), intent(inout), contiguous :: lambda(:)
        real(wp), parameter :: least_share = 1.0e-13_wp, enough = 1.0e-30_wp
        integer, parameter :: most = 200
        integer, allocatable :: pairs(:, :)
        real(wp), allocatable :: share(:)
        real(wp) :: y(size(rows)), left(size(rows)), way(size(rows)), image(size(rows)), v(size(lambda))
        real(wp) :: norm, last_norm, first_norm, step
        integer :: i

        call find_combinations(system, rows, .true., least_share, pairs, share)
        y = 0.0_wp
        call of_combinations(lambda, left)
        way = left
        norm = dot_product(left, left)
        first_norm = norm
        do i = 1, most
            if (.not. norm > enough*first_norm) exit
            call combine_all(way, v)
            call of_combinations(v, image)
            step = norm/dot_product(way, image)
            y = y + step*way
            left = left - step*image
            last_norm = norm
            norm = dot_product(left, left)
            way = left + norm/last_norm*way
        end do
        call combine_all(y, v)
        lambda = lambda - v

    contains

        !> x := V' z.
        pure subroutine of_combinations(z, x)
            real(wp), intent(in) :: z(:)
            real(wp), intent(out) :: x(:)
            integer :: k

            x = -z(rows)
            do k = 1, size(share)
                x(pairs(1, k)) = x(pairs(1, k)) + share(k)*z(pairs(2, k))
            end do
        end subroutine of_combinations

        !> z := V x.
        pure subroutine combine_all(x, z)
            real(wp), intent(in) :: x(:)
            real(wp), intent(out) :: z(:)
            integer :: k

            z = 0.0_wp
            z(rows) = -x
            do k = 1, size(share)
                z(pairs(2, k)) = z(pairs(2, k)) + share(k)*x(pairs(1, k))
            end do
        end subroutine combine_all
    end subroutine share_load

    !> The combinations of rows in use that equal the given ones, at the last factorisation of the system.
    subroutine find_combinations(system, rows, with_owned, least_share, pairs, share)
        type(system_type), intent(inout) :: system
        integer, intent(in) :: rows(:)
        !> True to include the rows that bodies own.
        logical, intent(in) :: with_owned
        !> Smaller factors than this part of the largest are rounding.
        real(wp), intent(in) :: least_share
        !> (2, :) numbers in `rows` and rows of their combinations, with their factors.
        integer, allocatable, intent(out) :: pairs(:, :)
        real(wp), allocatable, intent(out) :: share(:)
        integer, allocatable :: lot(:), group(:)
        real(wp), allocatable :: lambda(:), force(:)
        integer :: i, n_lots, now

        allocate (force(size(system%x)), lambda(system%m), source=0.0_wp)
        allocate (group(0:system%analysis%n_bodies), pairs(2, 0), share(0))
        lot = [(modulo(i, lots) + 1, i=1, size(rows))]
        n_lots = lots
        now = 1
        do while (now <= n_lots)
            if (any(lot == now)) call part_lot(system, rows, with_owned, least_share, now, lot, n_lots, lambda, force, group, &
                pairs, share)
            now = now + 1
        end do
    end subroutine find_combinations

    !> Solve for the rows of a lot. A row is done if its combination touches no other one.
    subroutine part_lot(system, rows, with_owned, least_share, now, lot, n_lots, lambda, force, group, pairs, share)
        type(system_type), intent(inout) :: system
        integer, intent(in) :: rows(:), now
        logical, intent(in) :: with_owned
        real(wp), intent(in) :: least_share
        !> The lot of each row, 0 if it is done; the number of lots so far.
        integer, intent(inout) :: lot(:), n_lots
        !> Work space (m), (n), (0:n_bodies).
        real(wp), intent(inout), contiguous :: lambda(:), force(:)
        integer, intent(inout) :: group(0:)
        !> Rows and their partners, as numbers in `rows` and as rows, and the factors.
        integer, allocatable, intent(inout) :: pairs(:, :)
        real(wp), allocatable, intent(inout) :: share(:)
        real(wp), allocatable :: largest(:)
        integer, allocatable :: members(:), met(:), more(:, :), of(:)
        logical :: takes_part(system%m)
        integer :: i, k, n

        members = pack([(i, i=1, size(rows))], lot == now)
        call combine(system, rows(members), with_owned, lambda, force)
        associate (a => system%analysis, pattern => system%pattern)
            takes_part(:) = abs(lambda) > least_share*max(maxval(abs(lambda)), least_share)
            takes_part(rows(members)) = .true.
            group = [(i, i=0, a%n_bodies)]
            do i = 1, system%m
                if (.not. takes_part(i)) cycle
                do k = pattern%row_start(i) + 1, pattern%row_start(i + 1) - 1
                    call join(group, pattern%row_body(k - 1), pattern%row_body(k))
                end do
            end do
            do i = 1, a%n_bodies
                group(i) = group(group(i))
            end do
            ! Number of rows of the lot in each group, and the last of these rows; the largest factor in the group.
            allocate (met(0:a%n_bodies), of(0:a%n_bodies), source=0)
            allocate (largest(0:a%n_bodies), source=least_share)
            do i = 1, size(members)
                associate (root => group_of(rows(members(i))))
                    met(root) = met(root) + 1
                    of(root) = members(i)
                    lot(members(i)) = 0
                    if (met(root) > 1) lot(members(i)) = n_lots + modulo(met(root) - 1, lots) + 1
                end associate
            end do
            do i = 1, size(members)
                if (met(group_of(rows(members(i)))) > 1) lot(members(i)) = max(lot(members(i)), n_lots + 1)
            end do
            n_lots = n_lots + lots
            do i = 1, system%m
                if (takes_part(i)) largest(group_of(i)) = max(largest(group_of(i)), abs(lambda(i)))
            end do
            allocate (more(2, count(takes_part)))
            n = 0
            do i = 1, system%m
                if (.not. takes_part(i)) cycle
                associate (root => group_of(i))
                    if (met(root) /= 1 .or. .not. abs(lambda(i)) > least_share*largest(root)) cycle
                    n = n + 1
                    more(:, n) = [of(root), i]
                end associate
            end do
        end associate
        ! Factors of a row may have been taken for rounding beside larger ones.
        do i = 1, size(members)
            if (size(members) == 1 .or. lot(members(i)) > 0 .or. any(more(1, :n) == members(i))) cycle
            n_lots = n_lots + 1
            lot(members(i)) = n_lots
        end do
        pairs = reshape([pairs, more(:, :n)], [2, size(pairs, 2) + n])
        share = [share, lambda(more(2, :n))]

    contains

        !> The group of a row, 0 for a row without a body.
        pure integer function group_of(row)
            integer, intent(in) :: row

            group_of = 0
            associate (k => system%pattern%row_start(row))
                if (k < system%pattern%row_start(row + 1)) group_of = group(system%pattern%row_body(k))
            end associate
        end function group_of
    end subroutine part_lot

    !> The factors of the rows in use whose combination is the sum of some rows that are not in use.
    subroutine combine(system, rows, with_owned, lambda, force)
        type(system_type), intent(inout) :: system
        integer, intent(in) :: rows(:)
        logical, intent(in) :: with_owned
        real(wp), intent(inout), contiguous :: lambda(:), force(:)
        integer :: b, first, i, last, n

        lambda = 0.0_wp
        lambda(rows) = -1.0_wp
        force = 0.0_wp
        associate (a => system%analysis, factor => system%factor(system%here))
            call factor%add_reactions(a, lambda, force)
            lambda = 0.0_wp
            system%g = 0.0_wp
            call factor%solve(a, .true., force, system%g, system%x, system%z)
            do n = 1, a%n_nodes
                if (a%is_body(n)) cycle
                do i = 1, a%height(n)
                    lambda(a%origin(n) + i - 1) = system%z(a%place(n) + i)
                end do
            end do
            if (.not. with_owned) return
            call factor%add_reactions(a, lambda, force)
            do b = 1, a%n_bodies
                if (a%own_row(b) == 0) cycle
                first = a%first(b)
                last = a%first(b + 1) - 1
                lambda(a%own_row(b)) = dot_product(factor%own(first:last), force(first:last))/sum(factor%own(first:last)**2)
            end do
        end associate
    end subroutine combine

    !> Merge the groups of two bodies, with the smaller body as representative.
    pure subroutine join(group, one, two)
        integer, intent(inout) :: group(0:)
        integer, intent(in) :: one, two
        integer :: a, b

        a = one
        do while (group(a) < a)
            a = group(a)
        end do
        b = two
        do while (group(b) < b)
            b = group(b)
        end do
        group(max(a, b)) = min(a, b)
    end subroutine join
end module tandem_chart_sparse_partners
