! SPDX-License-Identifier: MIT
!> Rows by number and by element; row names begin with the name of the element. Finding the rows of an element needs no search.
module tandem_mechanism_row_list
    use tandem_model, only: label_length
    use tandem_name_index, only: name_index_type
    implicit none (type, external)
    private

    public :: row_list_type

    !> Rows in the order of their numbers, from 1.
    type :: row_list_type
        !> Number of rows.
        integer :: n = 0
        !> Parts of names, which are composed on request: the element of each row, and the index of its suffix and unit, of which
        !> there are few.
        integer, allocatable, private :: element(:), kind(:)
        integer, private :: n_kinds = 0
        character(len=label_length), allocatable, private :: suffixes(:), units(:)
        !> Elements with their first rows; the next row of the same element for each row, 0 if none; for the first row of an
        !> element, its last.
        type(name_index_type), private :: heads
        integer, allocatable, private :: behind(:), last(:)
    contains
        procedure :: add, name, unit, first, next, clear, close
        procedure, private :: kind_of
    end type row_list_type

contains

    !> Remove all rows.
    pure subroutine clear(self)
        class(row_list_type), intent(inout) :: self

        self%n = 0
        self%n_kinds = 0
        call self%heads%clear()
        if (allocated(self%behind)) deallocate (self%behind, self%last)
        if (allocated(self%element)) deallocate (self%element, self%kind, self%suffixes, self%units)
        allocate (self%behind(16), self%last(16), self%element(16), self%kind(16), self%suffixes(16), self%units(16))
    end subroutine clear

    !> Keep names and units only: no row is added and no element is looked up afterwards.
    pure subroutine close(self)
        class(row_list_type), intent(inout) :: self

        call self%heads%close()
        self%element = self%element(:self%n)
        self%kind = self%kind(:self%n)
        deallocate (self%behind, self%last)
    end subroutine close

    !> Append a row, after `clear`.
    pure subroutine add(self, name, unit)
        class(row_list_type), intent(inout) :: self
        !> Name of the element, followed by a suffix after a blank.
        character(len=*), intent(in) :: name, unit
        integer :: head

        ! Allocate spare room, so that adding a row does not copy the list each time.
        if (self%n == size(self%behind)) then
            self%behind = [self%behind, self%behind]
            self%last = [self%last, self%last]
            self%element = [self%element, self%element]
            self%kind = [self%kind, self%kind]
        end if
        self%n = self%n + 1
        call self%kind_of(name(word_length(name) + 1:), unit, self%kind(self%n))
        self%behind(self%n) = 0
        self%last(self%n) = self%n
        head = self%first(name)
        if (head > 0) then
            self%behind(self%last(head)) = self%n
            self%last(head) = self%n
            self%element(self%n) = self%element(head)
        else
            call self%heads%put(name(:word_length(name)), self%n)
            self%element(self%n) = self%heads%n
        end if
    end subroutine add

    !> Index of a suffix with a unit.
    pure subroutine kind_of(self, suffix, unit, kind)
        class(row_list_type), intent(inout) :: self
        character(len=*), intent(in) :: suffix, unit
        integer, intent(out) :: kind

        do kind = 1, self%n_kinds
            if (self%suffixes(kind) == suffix .and. self%units(kind) == unit) return
        end do
        if (self%n_kinds == size(self%units)) then
            self%suffixes = [character(len=label_length) :: self%suffixes, self%suffixes]
            self%units = [character(len=label_length) :: self%units, self%units]
        end if
        self%n_kinds = kind
        self%suffixes(kind) = suffix
        self%units(kind) = unit
    end subroutine kind_of

    !> Name of a row.
    pure function name(self, row)
        class(row_list_type), intent(in) :: self
        integer, intent(in) :: row
        character(len=label_length) :: name

        name = self%heads%name(self%element(row))//self%suffixes(self%kind(row))
    end function name

    !> Unit of the multiplier of a row.
    pure function unit(self, row)
        class(row_list_type), intent(in) :: self
        integer, intent(in) :: row
        character(len=label_length) :: unit

        unit = self%units(self%kind(row))
    end function unit

    !> First row of an element; 0 if none.
    pure integer function first(self, element)
        class(row_list_type), intent(in) :: self
        !> Only the part before the first blank is used.
        character(len=*), intent(in) :: element

        first = self%heads%get(element(:word_length(element)))
    end function first

    !> Next row of the same element; 0 if none.
    pure integer function next(self, row)
        class(row_list_type), intent(in) :: self
        integer, intent(in) :: row

        next = self%behind(row)
    end function next

    !> Length of the first word of a text.
    pure integer function word_length(text)
        character(len=*), intent(in) :: text

        word_length = index(text, ' ') - 1
        if (word_length < 0) word_length = len(text)
    end function word_length
end module tandem_mechanism_row_list
