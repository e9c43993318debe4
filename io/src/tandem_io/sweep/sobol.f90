! SPDX-License-Identifier: MIT
!> Sobol' points: I. M. Sobol', USSR Comput. Math. Math. Phys. 7 (1967) 86-112, in Gray code order (Antonov, Saleev 1979), in which
!> point k follows from k alone.
module tandem_io_sweep_sobol
    use tandem, only: long
    implicit none (type, external)
    private

    public :: sobol_type, most_columns

    !> Number of columns of the table.
    integer, parameter :: most_columns = 40
    !> Bits of a coordinate, and largest number of initial direction numbers.
    integer, parameter :: bits = 32, longest = 8

    !> For each column: a primitive polynomial, as the bits of a number with the highest power first, and the initial direction
    !> numbers m: S. Joe, F. Y. Kuo, Constructing Sobol sequences with better two-dimensional projections, SIAM J. Sci. Comput. 30
    !> (2008) 2635-2654, table new-joe-kuo-6. The first column is the van der Corput sequence.
    integer, parameter :: table(longest + 1, most_columns) = reshape([ &
        1, 1, 0, 0, 0, 0, 0, 0, 0, &
        3, 1, 0, 0, 0, 0, 0, 0, 0, &
        7, 1, 3, 0, 0, 0, 0, 0, 0, &
        11, 1, 3, 1, 0, 0, 0, 0, 0, &
        13, 1, 1, 1, 0, 0, 0, 0, 0, &
        19, 1, 1, 3, 3, 0, 0, 0, 0, &
        25, 1, 3, 5, 13, 0, 0, 0, 0, &
        37, 1, 1, 5, 5, 17, 0, 0, 0, &
        41, 1, 1, 5, 5, 5, 0, 0, 0, &
        47, 1, 1, 7, 11, 19, 0, 0, 0, &
        55, 1, 1, 5, 1, 1, 0, 0, 0, &
        59, 1, 1, 1, 3, 11, 0, 0, 0, &
        61, 1, 3, 5, 5, 31, 0, 0, 0, &
        67, 1, 3, 3, 9, 7, 49, 0, 0, &
        91, 1, 1, 1, 15, 21, 21, 0, 0, &
        97, 1, 3, 1, 13, 27, 49, 0, 0, &
        103, 1, 1, 1, 15, 7, 5, 0, 0, &
        109, 1, 3, 1, 15, 13, 25, 0, 0, &
        115, 1, 1, 5, 5, 19, 61, 0, 0, &
        131, 1, 3, 7, 11, 23, 15, 103, 0, &
        137, 1, 3, 7, 13, 13, 15, 69, 0, &
        143, 1, 1, 3, 13, 7, 35, 63, 0, &
        145, 1, 3, 5, 9, 1, 25, 53, 0, &
        157, 1, 3, 1, 13, 9, 35, 107, 0, &
        167, 1, 3, 1, 5, 27, 61, 31, 0, &
        171, 1, 1, 5, 11, 19, 41, 61, 0, &
        185, 1, 3, 5, 3, 3, 13, 69, 0, &
        191, 1, 1, 7, 13, 1, 19, 1, 0, &
        193, 1, 3, 7, 5, 13, 19, 59, 0, &
        203, 1, 1, 3, 9, 25, 29, 41, 0, &
        211, 1, 3, 5, 13, 23, 1, 55, 0, &
        213, 1, 3, 7, 3, 13, 59, 17, 0, &
        229, 1, 3, 1, 3, 5, 53, 69, 0, &
        239, 1, 1, 5, 5, 23, 33, 13, 0, &
        241, 1, 1, 7, 7, 1, 61, 123, 0, &
        247, 1, 1, 7, 9, 13, 61, 49, 0, &
        253, 1, 3, 3, 5, 3, 55, 33, 0, &
        285, 1, 3, 1, 15, 31, 13, 49, 245, &
        299, 1, 3, 5, 15, 31, 59, 63, 97, &
        301, 1, 3, 1, 11, 11, 11, 77, 249], &
        [longest + 1, most_columns])

    !> Direction numbers of some columns.
    type :: sobol_type
        integer(long), allocatable, private :: directions(:, :)
    contains
        procedure :: prepare, point
    end type sobol_type

contains

    !> Compute the direction numbers of the first columns.
    pure subroutine prepare(self, columns)
        class(sobol_type), intent(inout) :: self
        !> Number of columns, at most `most_columns`.
        integer, intent(in) :: columns
        integer(long) :: m(bits)
        integer :: column, degree, i, j

        if (allocated(self%directions)) deallocate (self%directions)
        allocate (self%directions(bits, columns))
        do column = 1, columns
            degree = bit_size(0) - 1 - leadz(table(1, column))
            m = 1
            m(:degree) = table(2:degree + 1, column)
            do i = degree + 1, merge(bits, 0, degree > 0)
                ! m_i = 2 a_1 m_(i-1) + ... + 2^s m_(i-s) + m_(i-s), where sums are without carry.
                m(i) = m(i - degree)
                do j = 1, degree
                    if (btest(table(1, column), degree - j)) m(i) = ieor(m(i), ishft(m(i - j), j))
                end do
            end do
            do i = 1, bits
                self%directions(i, column) = ishft(m(i), bits - i)
            end do
        end do
    end subroutine prepare

    !> Coordinate of a point, times 2^32.
    pure integer(long) function point(self, k, column) result(bits_of_point)
        class(sobol_type), intent(in) :: self
        !> Index of the point, from 0 to 2^32 - 1.
        integer(long), intent(in) :: k
        integer, intent(in) :: column
        integer(long) :: gray
        integer :: i

        gray = ieor(k, ishft(k, -1))
        bits_of_point = 0
        do i = 1, bits
            if (btest(gray, i - 1)) bits_of_point = ieor(bits_of_point, self%directions(i, column))
        end do
    end function point
end module tandem_io_sweep_sobol
