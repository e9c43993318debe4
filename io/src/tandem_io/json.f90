! SPDX-License-Identifier: MIT
!> Writes a JSON object (RFC 8259), member by member. Numbers are written with the digits that reproduce them exactly; infinities
!> and NaN, which JSON lacks, are written as null.
module tandem_io_json
    use tandem, only: long, wp
    use, intrinsic :: ieee_arithmetic, only: ieee_is_finite
    implicit none (type, external)
    private

    public :: json_type

    type :: json_type
        !> Complete text; call only after all objects and arrays have ended.
        character(len=:), allocatable :: text
        !> Text written so far, as the first `n` characters of a growing buffer; number of open objects and arrays.
        character(len=:), allocatable, private :: buffer
        integer, private :: length = 0, depth = 0
        logical, private :: is_first = .true.
    contains
        !> Begin an object or an array. A name makes it a member of the enclosing object.
        procedure :: begin_object, begin_array, end_object, end_array
        !> Add a member to an object, or with an empty name an element to an array.
        generic :: add => add_real, add_integer, add_long, add_logical, add_text, add_reals, add_texts
        procedure, private :: add_real, add_integer, add_long, add_logical, add_text, add_reals, add_texts, put, append, end_one
    end type json_type

contains

    !> Begin an object.
    subroutine begin_object(self, name)
        class(json_type), intent(inout) :: self
        character(len=*), intent(in), optional :: name

        call begin(self, '{', name)
    end subroutine begin_object

    !> Begin an array.
    subroutine begin_array(self, name)
        class(json_type), intent(inout) :: self
        character(len=*), intent(in), optional :: name

        call begin(self, '[', name)
    end subroutine begin_array

    !> End an object.
    subroutine end_object(self)
        class(json_type), intent(inout) :: self

        call self%end_one('}')
    end subroutine end_object

    !> End an array.
    subroutine end_array(self)
        class(json_type), intent(inout) :: self

        call self%end_one(']')
    end subroutine end_array

    !> Begin an object or an array.
    subroutine begin(self, bracket, name)
        class(json_type), intent(inout) :: self
        character(len=1), intent(in) :: bracket
        character(len=*), intent(in), optional :: name

        if (present(name)) then
            call self%put(name, bracket)
        else
            call self%put('', bracket)
        end if
        self%is_first = .true.
        self%depth = self%depth + 1
    end subroutine begin

    !> End an object or an array.
    subroutine end_one(self, bracket)
        class(json_type), intent(inout) :: self
        character(len=1), intent(in) :: bracket

        call self%append(bracket)
        self%is_first = .false.
        self%depth = self%depth - 1
        if (self%depth > 0) return
        self%text = self%buffer(:self%length)
        deallocate (self%buffer)
        self%length = 0
    end subroutine end_one

    !> Append characters to the text.
    subroutine append(self, characters)
        class(json_type), intent(inout) :: self
        character(len=*), intent(in) :: characters
        character(len=:), allocatable :: longer
        integer :: last

        last = self%length + len(characters)
        if (.not. allocated(self%buffer)) allocate (character(len=1000) :: self%buffer)
        if (last > len(self%buffer)) then
            allocate (character(len=2*last) :: longer)
            longer(:self%length) = self%buffer(:self%length)
            call move_alloc(longer, self%buffer)
        end if
        self%buffer(self%length + 1:last) = characters
        self%length = last
    end subroutine append

    !> Add a member whose value is JSON text.
    subroutine put(self, name, value)
        class(json_type), intent(inout) :: self
        character(len=*), intent(in) :: name, value

        if (.not. self%is_first) call self%append(', ')
        if (name /= '') call self%append(quoted(name)//': ')
        call self%append(value)
        self%is_first = .false.
    end subroutine put

    subroutine add_real(self, name, value)
        class(json_type), intent(inout) :: self
        character(len=*), intent(in) :: name
        real(wp), intent(in) :: value

        call self%put(name, number(value))
    end subroutine add_real

    subroutine add_integer(self, name, value)
        class(json_type), intent(inout) :: self
        character(len=*), intent(in) :: name
        integer, intent(in) :: value

        call self%add_long(name, int(value, long))
    end subroutine add_integer

    subroutine add_long(self, name, value)
        class(json_type), intent(inout) :: self
        character(len=*), intent(in) :: name
        integer(long), intent(in) :: value
        character(len=24) :: buffer

        write (buffer, '(i0)') value
        call self%put(name, trim(buffer))
    end subroutine add_long

    subroutine add_logical(self, name, value)
        class(json_type), intent(inout) :: self
        character(len=*), intent(in) :: name
        logical, intent(in) :: value

        call self%put(name, trim(merge('true ', 'false', value)))
    end subroutine add_logical

    !> Trailing blanks are dropped.
    subroutine add_text(self, name, value)
        class(json_type), intent(inout) :: self
        character(len=*), intent(in) :: name, value

        call self%put(name, quoted(trim(value)))
    end subroutine add_text

    subroutine add_reals(self, name, values)
        class(json_type), intent(inout) :: self
        character(len=*), intent(in) :: name
        real(wp), intent(in) :: values(:)
        integer :: i

        call self%begin_array(name)
        do i = 1, size(values)
            call self%add_real('', values(i))
        end do
        call self%end_array()
    end subroutine add_reals

    !> Trailing blanks are dropped.
    subroutine add_texts(self, name, values)
        class(json_type), intent(inout) :: self
        character(len=*), intent(in) :: name, values(:)
        integer :: i

        call self%begin_array(name)
        do i = 1, size(values)
            call self%add_text('', values(i))
        end do
        call self%end_array()
    end subroutine add_texts

    !> Number with digits that reproduce it exactly.
    pure function number(value) result(text)
        real(wp), intent(in) :: value
        character(len=:), allocatable :: text
        character(len=32) :: buffer

        text = 'null'
        if (.not. ieee_is_finite(value)) return
        write (buffer, '(es24.16e3)') value
        text = trim(adjustl(buffer))
    end function number

    !> Quoted text in which control characters, quotes and backslashes are escaped.
    pure function quoted(words) result(text)
        character(len=*), intent(in) :: words
        character(len=:), allocatable :: text
        character(len=6) :: escape
        integer :: i

        text = '"'
        do i = 1, len(words)
            select case (iachar(words(i:i)))
            case (10)
                text = text//'\n'
            case (0:9, 11:31)
                write (escape, '("\u", z4.4)') iachar(words(i:i))
                text = text//escape
            case (34, 92)
                text = text//'\'//words(i:i)
            case default
                text = text//words(i:i)
            end select
        end do
        text = text//'"'
    end function quoted
end module tandem_io_json
