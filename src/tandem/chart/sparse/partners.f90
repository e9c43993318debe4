! SPDX-License-Identifier: MIT
!> Of which rows those that were left out are combinations. One solution tells it of many of them: the rows of a combination hang
!> together by bodies, so that combinations which touch no common body are told apart. Those that do are solved for again, in
!> several lots.
module tandem_chart_sparse_partners
    use tandem_chart_sparse_system, only: system_type
    use tandem_kinds, only: wp
    use tandem_model_lists, only: sort_to_lists
    implicit none (type, external)
    private

    public :: find_partners

    !> So many lots are made of rows whose combinations may touch. Those of one joint, three at most in a bay of hinges, stand side
    !> by side, and those of neighbouring bays touch.
    integer, parameter :: lots = 6

contains

    !> The partners of rows that were left out where the system was factored last.
    subroutine find_partners(system, rows, start, partners)
        type(system_type), intent(inout) :: system
        integer, intent(in) :: rows(:)
        !> Those of rows(i) are partners(start(i):start(i + 1) - 1), ascending.
        integer, allocatable, intent(out) :: start(:), partners(:)
        integer, allocatable :: lot(:), group(:), pairs(:, :)
        real(wp), allocatable :: lambda(:), force(:)
        integer :: i, n_lots, now

        allocate (force(size(system%x)), lambda(system%m), source=0.0_wp)
        allocate (group(0:system%analysis%n_bodies), pairs(2, 0))
        lot = [(modulo(i, lots) + 1, i=1, size(rows))]
        n_lots = lots
        now = 1
        do while (now <= n_lots)
            if (any(lot == now)) call part_lot(system, rows, now, lot, n_lots, lambda, force, group, pairs)
            now = now + 1
        end do
        call sort_to_lists(size(rows), pairs(1, :), pairs(2, :), start, partners)
    end subroutine find_partners

    !> Solve for the rows of a lot. Those whose combinations touch no other's are done.
    subroutine part_lot(system, rows, now, lot, n_lots, lambda, force, group, pairs)
        type(system_type), intent(inout) :: system
        integer, intent(in) :: rows(:), now
        !> The lot of each row, 0 where it is done; the lots so far.
        integer, intent(inout) :: lot(:), n_lots
        !> Work space (m), (n), (0:n_bodies).
        real(wp), intent(inout), contiguous :: lambda(:), force(:)
        integer, intent(inout) :: group(0:)
        !> Rows and their partners, as numbers in `rows` and as rows.
        integer, allocatable, intent(inout) :: pairs(:, :)
        !> Smaller shares than this of the largest are rounding.
        real(wp), parameter :: least_share = 1.0e-6_wp
        real(wp), allocatable :: largest(:)
        integer, allocatable :: members(:), met(:), more(:, :), of(:)
        logical :: takes_part(system%m)
        integer :: i, k, n

        members = pack([(i, i=1, size(rows))], lot == now)
        call combine(system, rows(members), lambda, force)
        associate (a => system%analysis, pattern => system%pattern)
            takes_part(:) = lambda > least_share*max(maxval(lambda), least_share)
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
            ! How many rows of the lot each group has met, and which one was the last; the largest share there.
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
                if (takes_part(i)) largest(group_of(i)) = max(largest(group_of(i)), lambda(i))
            end do
            allocate (more(2, count(takes_part)))
            n = 0
            do i = 1, system%m
                if (.not. takes_part(i)) cycle
                associate (root => group_of(i))
                    if (met(root) /= 1 .or. .not. lambda(i) > least_share*largest(root)) cycle
                    n = n + 1
                    more(:, n) = [of(root), i]
                end associate
            end do
        end associate
        ! Beside larger shares those of a row may have passed for rounding.
        do i = 1, size(members)
            if (size(members) == 1 .or. lot(members(i)) > 0 .or. any(more(1, :n) == members(i))) cycle
            n_lots = n_lots + 1
            lot(members(i)) = n_lots
        end do
        pairs = reshape([pairs, more(:, :n)], [2, size(pairs, 2) + n])

    contains

        !> The group that a row is in, 0 for a row without a body.
        pure integer function group_of(row)
            integer, intent(in) :: row

            group_of = 0
            associate (k => system%pattern%row_start(row))
                if (k < system%pattern%row_start(row + 1)) group_of = group(system%pattern%row_body(k))
            end associate
        end function group_of
    end subroutine part_lot

    !> The multipliers of the rows in use that make up the sum of some that are not, their moduli.
    subroutine combine(system, rows, lambda, force)
        type(system_type), intent(inout) :: system
        integer, intent(in) :: rows(:)
        real(wp), intent(inout), contiguous :: lambda(:), force(:)
        integer :: i, n

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
                    lambda(a%origin(n) + i - 1) = abs(system%z(a%place(n) + i))
                end do
            end do
        end associate
    end subroutine combine

    !> Let two bodies be in one group, for which the first of its bodies stands.
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
