! SPDX-License-Identifier: MIT
!> Indices of names, found in constant time: a hash table with open addressing.
!>
!> Source: D. E. Knuth, The Art of Computer Programming, volume 3, 1998, section 6.4, algorithm L; the hash is that of G. Fowler, L.
!> C. Noll and K.-P. Vo (FNV-1a, 32 bits).
module tandem_name_index
    use tandem_kinds, only: long
    implicit none (type, external)
    private

    public :: name_index_type, longest_name

    !> Longer names are not stored. Two parts of a key fit, with their separator.
    integer, parameter :: longest_name = 160

    !> Names and their numbers.
    type :: name_index_type
        !> Number of names.
        integer :: n = 0
        !> Concatenated names in the order of insertion, and their start positions, including that of the next one.
        character(len=:), allocatable, private :: text
        integer, allocatable, private :: from(:), numbers(:)
        !> Places in these by hash, 0 if none; their number is a power of 2, at least twice the number of names.
        integer, allocatable, private :: slots(:)
    contains
        procedure :: put, get, name, clear, close
        procedure, private :: slot_of, grow
    end type name_index_type

contains

    !> Remove all names.
    pure subroutine clear(self)
        class(name_index_type), intent(inout) :: self

        self%n = 0
        if (allocated(self%text)) deallocate (self%text, self%from)
        if (allocated(self%slots)) deallocate (self%numbers, self%slots)
    end subroutine clear

    !> Keep only the names in their order: no name is added or found afterwards.
    pure subroutine close(self)
        class(name_index_type), intent(inout) :: self

        if (.not. allocated(self%slots)) return
        self%text = self%text(:self%from(self%n + 1) - 1)
        self%from = self%from(:self%n + 1)
        deallocate (self%numbers, self%slots)
    end subroutine close

    !> Name number k in the order of insertion.
    pure function name(self, k)
        class(name_index_type), intent(in) :: self
        integer, intent(in) :: k
        character(len=self%from(k + 1) - self%from(k)) :: name

        name = self%text(self%from(k):self%from(k + 1) - 1)
    end function name

    !> Add a name unless it exists.
    pure subroutine put(self, name, number)
        class(name_index_type), intent(inout) :: self
        !> Trailing blanks are ignored.
        character(len=*), intent(in) :: name
        !> Its index, > 0.
        integer, intent(in) :: number
        integer :: k, last

        if (len_trim(name) > longest_name) return
        call self%grow()
        k = self%slot_of(name)
        if (self%slots(k) > 0) return
        self%n = self%n + 1
        last = self%from(self%n) + len_trim(name) - 1
        self%text(self%from(self%n):last) = name
        self%from(self%n + 1) = last + 1
        self%numbers(self%n) = number
        self%slots(k) = self%n
    end subroutine put

    !> Index of a name, 0 if it does not exist.
    pure integer function get(self, name) result(number)
        class(name_index_type), intent(in) :: self
        character(len=*), intent(in) :: name
        integer :: k

        number = 0
        if (self%n == 0 .or. len_trim(name) > longest_name) return
        k = self%slots(self%slot_of(name))
        if (k > 0) number = self%numbers(k)
    end function get

    !> Slot of a name, or the free slot for it.
    pure integer function slot_of(self, name) result(k)
        class(name_index_type), intent(in) :: self
        character(len=*), intent(in) :: name
        integer(long), parameter :: begin = 2166136261_long, factor = 16777619_long, mask = 4294967295_long
        integer(long) :: hash
        integer :: i, length

        length = len_trim(name)
        hash = begin
        do i = 1, length
            hash = iand(ieor(hash, int(iachar(name(i:i)), long))*factor, mask)
        end do
        k = int(iand(hash, int(size(self%slots) - 1, long))) + 1
        do while (self%slots(k) > 0)
            associate (from => self%from(self%slots(k)), next => self%from(self%slots(k) + 1))
                if (self%text(from:next - 1) == name(:length)) return
            end associate
            k = iand(k, size(self%slots) - 1) + 1
        end do
    end function slot_of

    !> Allocate room for another name: the room is doubled if it is full, so that adding a name does not copy all others each time.
    pure subroutine grow(self)
        class(name_index_type), intent(inout) :: self
        character(len=:), allocatable :: text
        integer :: i, room

        if (.not. allocated(self%slots)) then
            room = 32
            allocate (self%numbers(room), self%from(room + 1), self%slots(2*room), source=0)
            allocate (character(len=2*longest_name) :: self%text)
            self%from(1) = 1
            return
        end if
        if (len(self%text) < self%from(self%n + 1) + longest_name) then
            allocate (character(len=2*len(self%text)) :: text)
            text(:len(self%text)) = self%text
            call move_alloc(text, self%text)
        end if
        room = size(self%numbers)
        if (self%n < room) return
        self%from = [self%from, spread(0, 1, room)]
        self%numbers = [self%numbers, spread(0, 1, room)]
        deallocate (self%slots)
        allocate (self%slots(4*room), source=0)
        do i = 1, self%n
            self%slots(self%slot_of(self%text(self%from(i):self%from(i + 1) - 1))) = i
        end do
    end subroutine grow
end module tandem_name_index
