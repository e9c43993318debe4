! SPDX-License-Identifier: MIT
!> Conversion of the state of an object to an array of words, and back: the contents of checkpoints.
!>
!> A type with a state lists its components once, in a procedure `pack_state(self, pack)` that calls `item` for each; the same
!> procedure writes and reads, so that the two cannot disagree. Every bit is kept. The array contains its kind, its version, its
!> length and a checksum, so that other or damaged data is detected.
module tandem_pack
    use tandem_fletcher, only: fletcher_type
    use tandem_kinds, only: long, wp
    implicit none (type, external)
    private

    public :: pack_type, checksum, is_whole

    !> Signature at the start, version of all contents, and places of kind, version, length and checksum in the header.
    character(len=8), parameter :: signature = 'tandem!P'
    integer(long), parameter :: version = 34
    integer, parameter :: head = 5

    !> Target of written items, or source of read ones.
    type :: pack_type
        !> True if items are read.
        logical :: is_reading = .false.
        !> True if a requested item does not exist; the objects read are then invalid.
        logical :: has_failed = .false.
        integer(long), allocatable, private :: words(:)
        integer, private :: n = 0
    contains
        procedure :: begin_writing, end_writing, begin_reading, end_reading
        !> Numbers, logicals and texts, and allocatable arrays of numbers with their shapes or their unallocated status; up to five
        !> of one kind in a call, texts and cubes one by one.
        generic :: item => item_real, item_integer, item_long, item_logical, item_text, item_reals, item_matrix, item_cube, &
            item_integers, item_longs
        !> Arrays of constant shape.
        generic :: fixed => fixed_reals, fixed_longs
        !> An allocatable text with its length.
        procedure :: text
        procedure, private :: item_real, item_integer, item_long, item_logical, item_text, item_reals, item_matrix, item_cube
        procedure, private :: item_integers, item_longs, fixed_reals, fixed_longs, begin_array, reserve
    end type pack_type

contains

    !> Begin an empty array; its memory is reused.
    subroutine begin_writing(self)
        class(pack_type), intent(inout) :: self

        self%is_reading = .false.
        self%has_failed = .false.
        self%n = head
        if (.not. allocated(self%words)) allocate (self%words(4096))
    end subroutine begin_writing

    !> Finish the array.
    subroutine end_writing(self, kind_of_row, words)
        class(pack_type), intent(inout) :: self
        !> Kind of object; the first 8 characters are used.
        character(len=*), intent(in) :: kind_of_row
        integer(long), allocatable, intent(inout) :: words(:)
        integer :: i

        self%words(1) = word_of(signature)
        self%words(2) = word_of(kind_of_row)
        self%words(3) = version
        self%words(4) = int(self%n, long)
        self%words(head) = checksum(self%words(head + 1:self%n))
        if (allocated(words)) then
            if (size(words) /= self%n) deallocate (words)
        end if
        if (.not. allocated(words)) allocate (words(self%n))
        do i = 1, self%n
            words(i) = self%words(i)
        end do
    end subroutine end_writing

    !> Begin to read an array.
    subroutine begin_reading(self, kind_of_row, words, problem)
        class(pack_type), intent(inout) :: self
        !> Expected kind of object.
        character(len=*), intent(in) :: kind_of_row
        !> The array; more words may follow.
        integer(long), intent(in) :: words(:)
        !> Reason why it cannot be read; blank if it can.
        character(len=*), intent(out) :: problem

        problem = ''
        self%is_reading = .true.
        self%has_failed = .false.
        self%n = head
        if (size(words) < head) then
            problem = 'it is empty or truncated'
        else if (words(1) /= word_of(signature) .or. words(2) /= word_of(kind_of_row)) then
            problem = 'it is not a checkpoint'
        else if (words(3) > version) then
            problem = 'it was written by a newer version of tandem'
        else if (words(3) /= version) then
            problem = 'it was written by an older version of tandem'
        else if (words(4) < head .or. words(4) > size(words)) then
            problem = 'it is truncated'
        else if (words(head) /= checksum(words(head + 1:int(words(4))))) then
            problem = 'it is damaged: wrong checksum'
        end if
        if (problem /= '') return
        self%words = words(:int(words(4)))
    end subroutine begin_reading

    !> Check that all items have been read; otherwise `has_failed` is set.
    subroutine end_reading(self)
        class(pack_type), intent(inout) :: self

        if (self%n /= size(self%words)) self%has_failed = .true.
    end subroutine end_reading

    recursive subroutine item_real(self, value, b, c, d, e)
        class(pack_type), intent(inout) :: self
        real(wp), intent(inout) :: value
        real(wp), intent(inout), optional :: b, c, d, e

        call self%reserve(1)
        if (self%has_failed) return
        if (self%is_reading) then
            value = transfer(self%words(self%n), value)
        else
            self%words(self%n) = transfer(value, self%words(1))
        end if
        if (present(b)) call self%item(b, c, d, e)
    end subroutine item_real

    recursive subroutine item_long(self, value, b, c, d, e)
        class(pack_type), intent(inout) :: self
        integer(long), intent(inout) :: value
        integer(long), intent(inout), optional :: b, c, d, e

        call self%reserve(1)
        if (self%has_failed) return
        if (self%is_reading) then
            value = self%words(self%n)
        else
            self%words(self%n) = value
        end if
        if (present(b)) call self%item(b, c, d, e)
    end subroutine item_long

    recursive subroutine item_integer(self, value, b, c, d, e)
        class(pack_type), intent(inout) :: self
        integer, intent(inout) :: value
        integer, intent(inout), optional :: b, c, d, e
        integer(long) :: word

        word = int(value, long)
        call self%item(word)
        value = int(word)
        if (present(b)) call self%item(b, c, d, e)
    end subroutine item_integer

    recursive subroutine item_logical(self, value, b, c, d, e)
        class(pack_type), intent(inout) :: self
        logical, intent(inout) :: value
        logical, intent(inout), optional :: b, c, d, e
        integer(long) :: word

        word = merge(1_long, 0_long, value)
        call self%item(word)
        value = word /= 0
        if (present(b)) call self%item(b, c, d, e)
    end subroutine item_logical

    subroutine item_text(self, value)
        class(pack_type), intent(inout) :: self
        character(len=*), intent(inout) :: value
        character(len=8) :: part
        integer(long) :: word
        integer :: i, last

        do i = 1, len(value), 8
            last = min(i + 7, len(value))
            part = value(i:last)
            word = transfer(part, word)
            call self%item(word)
            part = transfer(word, part)
            value(i:last) = part(:last - i + 1)
        end do
    end subroutine item_text

    !> An allocatable text.
    subroutine text(self, value)
        class(pack_type), intent(inout) :: self
        character(len=:), allocatable, intent(inout) :: value
        integer :: length(1)
        logical :: is_there

        is_there = allocated(value)
        length = 0
        if (is_there) length = len(value)
        call self%begin_array(is_there, length)
        if (self%is_reading) then
            if (allocated(value)) deallocate (value)
            if (is_there) allocate (character(len=length(1)) :: value)
        end if
        if (is_there) call self%item(value)
    end subroutine text

    recursive subroutine item_reals(self, values, b, c, d, e)
        class(pack_type), intent(inout) :: self
        real(wp), allocatable, intent(inout) :: values(:)
        real(wp), allocatable, intent(inout), optional :: b(:), c(:), d(:), e(:)
        integer :: extents(1)
        logical :: is_there

        is_there = allocated(values)
        extents = 0
        if (is_there) extents = shape(values)
        call self%begin_array(is_there, extents)
        if (self%is_reading .and. allocated(values)) then
            if (.not. is_there .or. any(shape(values) /= extents)) deallocate (values)
        end if
        if (is_there) then
            if (.not. allocated(values)) allocate (values(extents(1)))
            call self%fixed(values)
        end if
        if (present(b)) call self%item(b, c, d, e)
    end subroutine item_reals

    recursive subroutine item_matrix(self, values, b, c, d, e)
        class(pack_type), intent(inout) :: self
        real(wp), allocatable, intent(inout) :: values(:, :)
        real(wp), allocatable, intent(inout), optional :: b(:, :), c(:, :), d(:, :), e(:, :)
        integer :: extents(2), j
        logical :: is_there

        is_there = allocated(values)
        extents = 0
        if (is_there) extents = shape(values)
        call self%begin_array(is_there, extents)
        if (self%is_reading .and. allocated(values)) then
            if (.not. is_there .or. any(shape(values) /= extents)) deallocate (values)
        end if
        if (is_there) then
            if (.not. allocated(values)) allocate (values(extents(1), extents(2)))
            do j = 1, extents(2)
                call self%fixed(values(:, j))
            end do
        end if
        if (present(b)) call self%item(b, c, d, e)
    end subroutine item_matrix

    subroutine item_cube(self, values)
        class(pack_type), intent(inout) :: self
        real(wp), allocatable, intent(inout) :: values(:, :, :)
        integer :: extents(3), j, k
        logical :: is_there

        is_there = allocated(values)
        extents = 0
        if (is_there) extents = shape(values)
        call self%begin_array(is_there, extents)
        if (self%is_reading .and. allocated(values)) then
            if (.not. is_there .or. any(shape(values) /= extents)) deallocate (values)
        end if
        if (.not. is_there) return
        if (.not. allocated(values)) allocate (values(extents(1), extents(2), extents(3)))
        do k = 1, extents(3)
            do j = 1, extents(2)
                call self%fixed(values(:, j, k))
            end do
        end do
    end subroutine item_cube

    subroutine item_longs(self, values)
        class(pack_type), intent(inout) :: self
        integer(long), allocatable, intent(inout) :: values(:)
        integer :: extents(1)
        logical :: is_there

        is_there = allocated(values)
        extents = 0
        if (is_there) extents = shape(values)
        call self%begin_array(is_there, extents)
        if (self%is_reading .and. allocated(values)) then
            if (.not. is_there .or. any(shape(values) /= extents)) deallocate (values)
        end if
        if (.not. is_there) return
        if (.not. allocated(values)) allocate (values(extents(1)))
        call self%fixed(values)
    end subroutine item_longs

    recursive subroutine item_integers(self, values, b, c, d, e)
        class(pack_type), intent(inout) :: self
        integer, allocatable, intent(inout) :: values(:)
        integer, allocatable, intent(inout), optional :: b(:), c(:), d(:), e(:)
        integer(long), allocatable :: words(:)

        if (allocated(values)) allocate (words, source=int(values, long))
        call self%item(words)
        if (self%is_reading .and. .not. self%has_failed) then
            if (allocated(values)) deallocate (values)
            if (allocated(words)) allocate (values, source=int(words))
        end if
        if (present(b)) call self%item(b, c, d, e)
    end subroutine item_integers

    subroutine fixed_reals(self, values)
        class(pack_type), intent(inout) :: self
        real(wp), intent(inout) :: values(:)
        integer :: first, i

        call self%reserve(size(values))
        if (self%has_failed) return
        first = self%n - size(values)
        if (self%is_reading) then
            do i = 1, size(values)
                values(i) = transfer(self%words(first + i), values(1))
            end do
        else
            do i = 1, size(values)
                self%words(first + i) = transfer(values(i), self%words(1))
            end do
        end if
    end subroutine fixed_reals

    subroutine fixed_longs(self, values)
        class(pack_type), intent(inout) :: self
        integer(long), intent(inout) :: values(:)
        integer :: i

        do i = 1, size(values)
            call self%item(values(i))
        end do
    end subroutine fixed_longs

    !> Allocation status and shape of an array; on reading, the size is limited by the remaining words.
    subroutine begin_array(self, is_there, extents)
        class(pack_type), intent(inout) :: self
        logical, intent(inout) :: is_there
        integer, intent(inout) :: extents(:)
        integer :: i

        call self%item(is_there)
        do i = 1, size(extents)
            call self%item(extents(i))
        end do
        if (.not. self%is_reading) return
        ! 8 characters of a text are a word.
        if (any(extents < 0) .or. product(real(extents, wp)) > 8.0_wp*real(size(self%words) - self%n, wp)) self%has_failed = .true.
        if (self%has_failed) is_there = .false.
    end subroutine begin_array

    !> Advance by a number of words: allocate room for them, or check that they exist.
    subroutine reserve(self, count_)
        class(pack_type), intent(inout) :: self
        integer, intent(in) :: count_
        integer(long), allocatable :: longer(:)

        if (self%has_failed) return
        if (self%n + count_ > size(self%words)) then
            if (self%is_reading) then
                self%has_failed = .true.
                return
            end if
            allocate (longer(2*(self%n + count_)))
            longer(:self%n) = self%words(:self%n)
            call move_alloc(longer, self%words)
        end if
        self%n = self%n + count_
    end subroutine reserve

    !> Eight characters as a number.
    pure integer(long) function word_of(characters)
        character(len=*), intent(in) :: characters
        character(len=8) :: eight

        eight = characters
        word_of = transfer(eight, word_of)
    end function word_of

    !> True if an array of any kind and version is undamaged; more words may follow.
    pure logical function is_whole(words)
        integer(long), intent(in) :: words(:)

        is_whole = .false.
        if (size(words) < head) return
        if (words(1) /= word_of(signature) .or. words(4) < head .or. words(4) > size(words)) return
        is_whole = words(head) == checksum(words(head + 1:int(words(4))))
    end function is_whole

    !> Checksum of an array of words.
    pure integer(long) function checksum(words)
        integer(long), intent(in) :: words(:)
        type(fletcher_type) :: sum

        call sum%add(words)
        checksum = sum%value()
    end function checksum
end module tandem_pack
