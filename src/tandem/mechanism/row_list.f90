! SPDX-License-Identifier: MIT
!> Rows by their numbers, and those of each element, whose names begin with its own, without looking through those of all others.
module tandem_mechanism_row_list
    use tandem_model, only: label_length
    use tandem_name_index, only: name_index_type
    implicit none (type, external)
    private

    public :: row_list_type

    !> Rows in the order of their numbers, from 1.
    type :: row_list_type
        !> How many there are; their names and units, with room for more.
        integer :: n = 0
        character(len=label_length), allocatable :: name(:), unit(:)
        !> The first row of an element; the row of the same element that comes behind each, 0 for none; behind the first, the last.
        type(name_index_type), private :: heads
        integer, allocatable, private :: behind(:), last(:)
    contains
        procedure :: add, first, next, clear
    end type row_list_type

contains

    !> Forget all rows.
    pure subroutine clear(self)
        class(row_list_type), intent(inout) :: self

        self%n = 0
        call self%heads%clear()
        if (allocated(self%behind)) deallocate (self%behind, self%last, self%name, self%unit)
        allocate (self%behind(16), self%last(16), self%name(16), self%unit(16))
    end subroutine clear

    !> One row more, after `clear`.
    pure subroutine add(self, name, unit)
        class(row_list_type), intent(inout) :: self
        !> An element's name, and what follows behind a blank.
        character(len=*), intent(in) :: name, unit
        integer :: head

        ! Room for many more: a row more must not cost a copy of all before.
        if (self%n == size(self%behind)) then
            self%behind = [self%behind, self%behind]
            self%last = [self%last, self%last]
            self%name = [character(len=label_length) :: self%name, self%name]
            self%unit = [character(len=label_length) :: self%unit, self%unit]
        end if
        self%n = self%n + 1
        self%name(self%n) = name
        self%unit(self%n) = unit
        self%behind(self%n) = 0
        self%last(self%n) = self%n
        head = self%first(name)
        if (head > 0) then
            self%behind(self%last(head)) = self%n
            self%last(head) = self%n
        else
            call self%heads%put(name(:word_length(name)), self%n)
        end if
    end subroutine add

    !> The first row of an element, 0 for none.
    pure integer function first(self, element)
        class(row_list_type), intent(in) :: self
        !> What stands behind a blank in it does not count.
        character(len=*), intent(in) :: element

        first = self%heads%get(element(:word_length(element)))
    end function first

    !> The row of the same element that comes behind a row, 0 for none.
    pure integer function next(self, row)
        class(row_list_type), intent(in) :: self
        integer, intent(in) :: row

        next = self%behind(row)
    end function next

    !> How long the first word of a text is.
    pure integer function word_length(text)
        character(len=*), intent(in) :: text

        word_length = index(text, ' ') - 1
        if (word_length < 0) word_length = len(text)
    end function word_length
end module tandem_mechanism_row_list
