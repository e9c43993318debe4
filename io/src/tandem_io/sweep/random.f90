! SPDX-License-Identifier: MIT
!> Random numbers without internal state: each number follows from a seed and an index, so that a case depends neither on the
!> process that runs it nor on earlier cases.
!>
!> The generator is Philox4x32-10: J. K. Salmon, M. A. Moraes, R. O. Dror, D. E. Shaw, Parallel random numbers: as easy as 1, 2, 3,
!> SC 2011, doi 10.1145/2063384.2063405. Words of 32 bits are stored in 64-bit integers. Their products are computed from halves,
!> which do not overflow.
module tandem_io_sweep_random
    use tandem, only: long, wp
    implicit none (type, external)
    private

    public :: philox, random_words, random_number_at, permuted, stream_draw, stream_order, stream_stratum, stream_shift

    !> Independent streams, one for each purpose.
    integer, parameter :: stream_draw = 1, stream_order = 2, stream_stratum = 3, stream_shift = 4

    integer(long), parameter :: mask = 2_long**32 - 1, half = 2_long**16 - 1

contains

    !> Four random 32-bit words from a counter of four words and a key of two.
    pure function philox(counter, key) result(words)
        integer(long), intent(in) :: counter(4), key(2)
        integer(long) :: words(4)
        integer(long), parameter :: multiplier(2) = [int(z'D2511F53', long), int(z'CD9E8D57', long)]
        integer(long), parameter :: weyl(2) = [int(z'9E3779B9', long), int(z'BB67AE85', long)]
        integer, parameter :: rounds = 10
        integer(long) :: keys(2), high(2), low(2)
        integer :: i

        words = counter
        keys = key
        do i = 1, rounds
            call multiply(multiplier(1), words(1), high(1), low(1))
            call multiply(multiplier(2), words(3), high(2), low(2))
            words = [ieor(ieor(high(2), words(2)), keys(1)), low(2), ieor(ieor(high(1), words(4)), keys(2)), low(1)]
            keys = iand(keys + weyl, mask)
        end do
    end function philox

    !> Upper and lower half of the product of two 32-bit words.
    pure subroutine multiply(a, b, high, low)
        integer(long), intent(in) :: a, b
        integer(long), intent(out) :: high, low
        integer(long) :: lower, upper

        lower = a*iand(b, half)
        upper = a*ishft(b, -16)
        lower = lower + ishft(iand(upper, half), 16)
        low = iand(lower, mask)
        high = ishft(upper, -16) + ishft(lower, -32)
    end subroutine multiply

    !> Four random 32-bit words for a case and a column.
    pure function random_words(seed, case, column, stream) result(words)
        integer, intent(in) :: seed
        integer(long), intent(in) :: case
        integer, intent(in) :: column, stream
        integer(long) :: words(4)

        words = philox([iand(case, mask), iand(ishft(case, -32), mask), int(column, long), int(stream, long)], &
            [iand(int(seed, long), mask), 0_long])
    end function random_words

    !> Random number between 0 and 1, exclusive: the midpoint of one of 2^52 intervals of equal length.
    pure real(wp) function random_number_at(seed, case, column, stream) result(number)
        integer, intent(in) :: seed
        integer(long), intent(in) :: case
        integer, intent(in) :: column, stream
        integer(long) :: words(4)

        words = random_words(seed, case, column, stream)
        number = (real(ior(ishft(words(1), 20), ishft(words(2), -12)), wp) + 0.5_wp)*2.0_wp**(-52)
    end function random_number_at

    !> Image of `i` under a random permutation of 0 ... n - 1. A Feistel network of six rounds permutes the numbers below the next
    !> power of four; it is applied repeatedly until the result is below n, less than four times on average. Each image is computed
    !> independently and without storage.
    pure integer(long) function permuted(seed, i, n, column) result(image)
        integer, intent(in) :: seed
        integer(long), intent(in) :: i, n
        !> Index of the permutation.
        integer, intent(in) :: column
        integer, parameter :: rounds = 6
        integer(long) :: left, right, next, words(4)
        integer :: bits, round

        bits = 1
        do while (ishft(1_long, 2*bits) < n)
            bits = bits + 1
        end do
        image = i
        do
            left = ishft(image, -bits)
            right = iand(image, ishft(1_long, bits) - 1)
            do round = 1, rounds
                words = random_words(seed, ior(right, ishft(int(round, long), 40)), column, stream_order)
                next = ieor(left, iand(words(1), ishft(1_long, bits) - 1))
                left = right
                right = next
            end do
            image = ior(ishft(left, bits), right)
            if (image < n) return
        end do
    end function permuted
end module tandem_io_sweep_random
