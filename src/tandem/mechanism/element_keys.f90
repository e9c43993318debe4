! SPDX-License-Identifier: MIT
!> The keys of one element of a mechanism, named `kind.name.key`.
module tandem_mechanism_element_keys
    use tandem_mechanism_entries, only: entry_type
    implicit none (type, external)
    private

    public :: element_type, add_to, joined, key_length, key_of, listed, path_of, place_among, text_length, up_to_dot

    !> Length of the names of kinds, elements and keys, and of points such as `body.point`.
    integer, parameter :: key_length = 136
    !> Length of texts in lists, such as points with three numbers of full precision.
    integer, parameter :: text_length = 256

    !> The entries of an element.
    type :: element_type
        character(len=key_length) :: kind = '', name = ''
        integer, allocatable :: entries(:)
        integer :: n = 0
        !> Source that gives the element first.
        integer :: source = 0
        !> Requested keys while the element is open: the first `n_known`.
        character(len=key_length), allocatable :: known(:)
        integer :: n_known = 0
    end type element_type

contains

    !> Key of an entry within its element.
    pure function key_of(entry, element) result(key)
        type(entry_type), intent(in) :: entry
        type(element_type), intent(in) :: element
        character(len=len(entry%key) - len_trim(element%kind) - len_trim(element%name) - 1 - count([element%name /= ''])) :: key

        key = entry%key(len(entry%key) - len(key) + 1:)
    end function key_of

    !> Name of an element in messages and headings.
    pure function path_of(element) result(path)
        type(element_type), intent(in) :: element
        character(len=len_trim(element%kind) + len_trim(element%name) + count([element%name /= ''])) :: path

        path = joined(trim(element%kind), trim(element%name))
    end function path_of

    !> Join two parts of a key, the second of which may be empty.
    pure function joined(first, second) result(path)
        character(len=*), intent(in) :: first, second
        character(len=len(first) + len(second) + count([len(second) > 0])) :: path

        path = first
        if (len(second) > 0) path = first//'.'//second
    end function joined

    !> Part of a key before its first dot.
    pure function up_to_dot(key) result(part)
        character(len=*), intent(in) :: key
        character(len=index(key//'.', '.') - 1) :: part

        part = key
    end function up_to_dot

    !> List names, each after a blank, separated by commas.
    pure function listed(names) result(text)
        character(len=*), intent(in) :: names(:)
        character(len=max(0, sum(len_trim(names) + 2) - 1)) :: text
        integer :: i, n

        n = 0
        do i = 1, size(names)
            text(n + 1:) = ' '//trim(names(i))//','
            n = n + len_trim(names(i)) + 2
        end do
    end function listed

    !> Place of a name in a list; 0 if it is absent. In gfortran 12 findloc uses wrong lengths if one module calls it with texts of
    !> several lengths.
    pure integer function place_among(names, name) result(place)
        character(len=*), intent(in) :: names(:), name

        do place = size(names), 1, -1
            if (names(place) == name) return
        end do
    end function place_among

    !> Append an entry, by its index, to an element; `entries` must be allocated.
    pure subroutine add_to(element, entry)
        type(element_type), intent(inout) :: element
        integer, intent(in) :: entry

        if (element%n == size(element%entries)) element%entries = [element%entries, element%entries]
        element%n = element%n + 1
        element%entries(element%n) = entry
    end subroutine add_to
end module tandem_mechanism_element_keys
