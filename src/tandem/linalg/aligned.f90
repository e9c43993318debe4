! SPDX-License-Identifier: MIT
!> Arrays that begin with a line of the cache: a column of `lane` numbers then lies in one line and not across two, which by itself
!> is worth 5 to 8 % of the time of an explicit step. Fortran cannot ask for that, and where the system puts an array depends on
!> what was allocated before.
module tandem_linalg_aligned
    use, intrinsic :: iso_c_binding, only: c_intptr_t, c_loc
    use tandem_kinds, only: wp
    implicit none (type, external)
    private

    public :: allocate_aligned

    !> Allocate and set to zero; what was there before is lost.
    interface allocate_aligned
        module procedure allocate_vector
        module procedure allocate_matrix
    end interface allocate_aligned

    !> The length of a line, in bytes.
    integer(c_intptr_t), parameter :: line = 64
    !> So often another place is tried; the last one serves wherever it is.
    integer, parameter :: most_tries = 16
    !> With more numbers it does not matter.
    integer, parameter :: most_numbers = 4096

    !> A place that did not serve, and what keeps the next one from lying a multiple of its length away.
    type :: place_type
        real(wp), allocatable :: vector(:), matrix(:, :), spacer(:)
    end type place_type

contains

    !> For n numbers.
    subroutine allocate_vector(x, n)
        real(wp), allocatable, intent(out) :: x(:)
        integer, intent(in) :: n
        type(place_type) :: places(most_tries)
        integer :: i

        do i = 1, most_tries
            allocate (x(n))
            if (serves(n, x) .or. i == most_tries) exit
            call move_alloc(x, places(i)%vector)
            allocate (places(i)%spacer(2*i))
        end do
        x = 0.0_wp
    end subroutine allocate_vector

    !> For a matrix of so many rows and columns.
    subroutine allocate_matrix(a, rows, columns)
        real(wp), allocatable, intent(out) :: a(:, :)
        integer, intent(in) :: rows, columns
        type(place_type) :: places(most_tries)
        integer :: i

        do i = 1, most_tries
            allocate (a(rows, columns))
            if (serves(rows*columns, a) .or. i == most_tries) exit
            call move_alloc(a, places(i)%matrix)
            allocate (places(i)%spacer(2*i))
        end do
        a = 0.0_wp
    end subroutine allocate_matrix

    !> Whether n numbers may stay where they are.
    logical function serves(n, x)
        integer, intent(in) :: n
        real(wp), intent(in), target :: x(n)

        serves = n == 0 .or. n > most_numbers
        if (.not. serves) serves = modulo(transfer(c_loc(x), 0_c_intptr_t), line) == 0
    end function serves
end module tandem_linalg_aligned
