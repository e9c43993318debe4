! SPDX-License-Identifier: MIT
!> Sorts items into lists that are stored one after the other, such as the bodies of each row.
module tandem_model_lists
    implicit none (type, external)
    private

    public :: sort_to_lists

contains

    !> Sort items into their lists, each item once per list and in increasing order. Lists are short and are sorted by insertion.
    pure subroutine sort_to_lists(n_lists, lists, given, start, items)
        integer, intent(in) :: n_lists
        !> Pairs of a list and an item, in any order. Repetitions are allowed; pairs with a zero are ignored.
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
        ! Sorted lists never extend into pairs that are still to be sorted, so that both share the same array.
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
