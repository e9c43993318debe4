! SPDX-License-Identifier: MIT
!> Fletcher's checksum of the halves of 64-bit words, computed incrementally: J. G. Fletcher, IEEE Transactions on Communications 30
!> (1982) 247-252.
module tandem_fletcher
    use tandem_kinds, only: long, wp
    implicit none (type, external)
    private

    public :: fletcher_type

    integer(long), parameter :: modulus = 2_long**32 - 1
    !> Number of words between reductions by the modulus: after n halves the second sum is at most (1 + n + n (n + 1)/2) 2^32, which
    !> for 2^14 words is 2.3e18, below the limit of 9.2e18.
    integer, parameter :: block = 2**14

    !> Checksum of the words added so far.
    type :: fletcher_type
        integer(long), private :: first = 1, second = 0
    contains
        generic :: add => add_words, add_reals
        procedure, private :: add_words, add_reals
        procedure :: value => value_of
    end type fletcher_type

contains

    !> Add words, the lower half of each first.
    pure subroutine add_words(self, words)
        class(fletcher_type), intent(inout) :: self
        integer(long), intent(in) :: words(:)
        integer(long) :: first, second
        integer :: start, i

        first = self%first
        second = self%second
        do start = 1, size(words), block
            do i = start, min(start + block - 1, size(words))
                first = first + iand(words(i), modulus)
                second = second + first
                first = first + iand(ishft(words(i), -32), modulus)
                second = second + first
            end do
            first = mod(first, modulus)
            second = mod(second, modulus)
        end do
        self%first = first
        self%second = second
    end subroutine add_words

    !> Add the bits of numbers.
    pure subroutine add_reals(self, values)
        class(fletcher_type), intent(inout) :: self
        real(wp), intent(in) :: values(:)
        integer(long) :: words(64)
        integer :: start, i, n

        do start = 1, size(values), size(words)
            n = min(size(words), size(values) - start + 1)
            do i = 1, n
                words(i) = transfer(values(start + i - 1), words(1))
            end do
            call self%add(words(:n))
        end do
    end subroutine add_reals

    !> Both sums in one word.
    pure integer(long) function value_of(self)
        class(fletcher_type), intent(in) :: self

        value_of = ior(ishft(self%second, 32), self%first)
    end function value_of
end module tandem_fletcher
