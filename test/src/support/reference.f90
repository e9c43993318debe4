! SPDX-License-Identifier: MIT
!> Reads the reference solutions of test/reference: plain tables, computed with methods independent of tandem.
module reference
    use tandem, only: wp
    implicit none (type, external)
    private

    public :: reference_type, read_reference

    !> A reference solution at some times; its file begins with a description and its accuracy.
    type :: reference_type
        !> Times (k).
        real(wp), allocatable :: t(:)
        !> Coordinates, velocities, accelerations (n, k) and multipliers (m, k).
        real(wp), allocatable :: q(:, :), qd(:, :), qdd(:, :), lambda(:, :)
    contains
        procedure :: find
        procedure :: q_at
        procedure :: qd_at
    end type reference_type

contains

    !> Read test/reference/NAME.txt; the tests run in the project's root, as with fpm.
    subroutine read_reference(name, table)
        character(len=*), intent(in) :: name
        type(reference_type), intent(out) :: table
        integer :: unit, k, n, m, i

        open (newunit=unit, file='test/reference/'//name//'.txt', status='old', action='read')
        call skip_comments(unit)
        read (unit, *) k, n, m
        allocate (table%t(k), table%q(n, k), table%qd(n, k), table%qdd(n, k), table%lambda(m, k))
        do i = 1, k
            read (unit, *) table%t(i), table%q(:, i), table%qd(:, i), table%qdd(:, i), table%lambda(:, i)
        end do
        close (unit)
    end subroutine read_reference

    !> Advance to the first line that is not a comment.
    subroutine skip_comments(unit)
        integer, intent(in) :: unit
        character(len=1) :: first

        do
            read (unit, '(a)') first
            if (first /= '#') exit
        end do
        backspace (unit)
    end subroutine skip_comments

    !> Row of a time, 0 if there is none. Times that differ by rounding are equal.
    pure integer function find(self, t)
        class(reference_type), intent(in) :: self
        real(wp), intent(in) :: t
        real(wp), parameter :: rounding = 1.0e-12_wp

        do find = size(self%t), 1, -1
            if (abs(self%t(find) - t) <= rounding) return
        end do
    end function find

    !> q at a time of the table. (As an index, a call of `find` ends a program of gfortran 14 that checks bounds.)
    pure function q_at(self, t) result(q)
        class(reference_type), intent(in) :: self
        real(wp), intent(in) :: t
        real(wp) :: q(size(self%q, 1))
        integer :: i

        i = self%find(t)
        q = self%q(:, i)
    end function q_at

    !> qd there.
    pure function qd_at(self, t) result(qd)
        class(reference_type), intent(in) :: self
        real(wp), intent(in) :: t
        real(wp) :: qd(size(self%qd, 1))
        integer :: i

        i = self%find(t)
        qd = self%qd(:, i)
    end function qd_at
end module reference
