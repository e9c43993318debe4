! SPDX-License-Identifier: MIT
!> Sorts items to lists that are stored consecutively, such as the bodies of each row.
module tandem_model_lists
    implicit none (type, external)
    private

    public :: sort_to_lists

contains

    !> Set up each list with each of its items once and in ascending order. Lists are short: each is sorted by insertion.
    pure subroutine sort_to_lists(n_lists, lists, given, start, items)
        integer, intent(in) :: n_lists
        !> Pairs of a list and an item, in any order, repetitions allowed; pairs with a 0 are ignored.
        integer, intent(in) :: lists(:), given(:)
        !> List i is items(start(i) : start(i + 1) - 1).
        integer, allocatable, intent(out) :: start(:), items(:)
        integer, allocatable :: next(:), list(:)
        integer :: i, item, j, k, last, n

        allocate (next(n_lists + 1), source=0)
        do k = 1, size(lists)
            if (lists(k) > 0 .and. given(k) > 0) next(lists(k) + 1) = next(lists(k) + 1) + 1
        end do
        next(1) = 1
        do i = 2, n_lists + 1
            next(i) = next(i) + next(i - 1)
        end do
        allocate (start, source=next)
        allocate (list(next(n_lists + 1) - 1))
        do k = 1, size(lists)
            if (lists(k) == 0 .or. given(k) == 0) cycle
            list(next(lists(k))) = given(k)
            next(lists(k)) = next(lists(k)) + 1
        end do
        ! The sorted part never overtakes the unsorted part, so that both use the same array.
        n = 0
        do i = 1, n_lists
            last = n
            do k = start(i), next(i) - 1
                item = list(k)
                j = n
                do while (j > last)
                    if (list(j) <= item) exit
                    j = j - 1
                end do
                if (j > last) then
                    if (list(j) == item) cycle
                end if
                list(j + 2:n + 1) = list(j + 1:n)
                list(j + 1) = item
                n = n + 1
            end do
            start(i) = last + 1
        end do
        start(n_lists + 1) = n + 1
        items = list(:n)
    end subroutine sort_to_lists
end module tandem_model_lists
