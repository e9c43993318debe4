! SPDX-License-Identifier: MIT
!> An independent integrator for the tests: Gragg's method, extrapolated, with a fixed number of macro steps and columns.
!> Source: Hairer, Norsett, Wanner, Solving Ordinary Differential Equations I, section II.9.
module extrapolation
    use tandem, only: wp
    implicit none (type, external)
    private

    public :: equation_type, extrapolate

    !> An ordinary differential equation y' = f(t, y).
    type, abstract :: equation_type
    contains
        procedure(slope_interface), deferred :: slope
    end type equation_type

    abstract interface
        !> f(t, y).
        subroutine slope_interface(self, t, y, yd)
            import :: equation_type, wp
            implicit none (type, external)
            class(equation_type), intent(in) :: self
            real(wp), intent(in) :: t, y(:)
            real(wp), intent(out) :: yd(:)
        end subroutine slope_interface
    end interface

    !> Columns of the tableau: order 16.
    integer, parameter :: columns = 8

contains

    !> Carry y from t to t_end in equal macro steps.
    subroutine extrapolate(equation, t, t_end, macro_steps, y)
        class(equation_type), intent(in) :: equation
        real(wp), intent(in) :: t, t_end
        integer, intent(in) :: macro_steps
        real(wp), intent(inout) :: y(:)
        real(wp) :: table(size(y), columns), h, factor
        integer :: i, j, k

        h = (t_end - t)/macro_steps
        do k = 0, macro_steps - 1
            do i = 1, columns
                call midpoint(equation, t + k*h, h, 2*i, y, table(:, i))
                ! The error has even powers of the small step only.
                do j = i - 1, 1, -1
                    factor = (real(i, wp)/real(j, wp))**2 - 1
                    table(:, j) = table(:, j + 1) + (table(:, j + 1) - table(:, j))/factor
                end do
            end do
            y = table(:, 1)
        end do
    end subroutine extrapolate

    !> Gragg's modified midpoint rule with an even number of small steps.
    subroutine midpoint(equation, t, h, small_steps, y, y_end)
        class(equation_type), intent(in) :: equation
        real(wp), intent(in) :: t, h, y(:)
        integer, intent(in) :: small_steps
        real(wp), intent(out) :: y_end(:)
        real(wp) :: before(size(y)), now(size(y)), after(size(y)), yd(size(y)), small
        integer :: i

        small = h/small_steps
        before = y
        call equation%slope(t, before, yd)
        now = y + small*yd
        do i = 1, small_steps - 1
            call equation%slope(t + i*small, now, yd)
            after = before + 2*small*yd
            before = now
            now = after
        end do
        call equation%slope(t + h, now, yd)
        y_end = (before + now + small*yd)/2
    end subroutine midpoint
end module extrapolation
