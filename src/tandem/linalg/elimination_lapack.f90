! SPDX-License-Identifier: MIT
!> Elimination of a C with many rows by LAPACK: factors of Cd, computed with row pivoting, are stored in place of its inverse.
submodule(tandem_linalg_elimination) tandem_linalg_elimination_lapack
    use tandem_linalg_lapack, only: dgetrf, dgetrs
    use tandem_linalg_null_space_kernels, only: multiply
    implicit none (type, external)

contains

    module procedure factor
        !> With row exchanges a small pivot does not amplify rounding, but shows that the pivot columns are dependent.
        real(wp), parameter :: smallest_pivot = 1.0e-8_wp, largest_growth = 10.0_wp
        real(wp) :: least, most
        integer :: i, info, j, p

        stat = 0
        least = tiny(1.0_wp)
        most = huge(1.0_wp)
        if (is_choosy) then
            least = smallest_pivot
            most = largest_growth
        end if
        associate (m => self%m, a => self%eliminated)
            ! The largest entry is not meaningful for rows of different units.
            do i = 1, m
                self%row_factor(i) = scale(1.0_wp, -max(exponent(self%row_size(i)), -1000))
            end do
            do j = 1, self%n
                p = self%order(j)
                do i = 1, m
                    self%matrix(i, p) = matrix(i, p)
                    a(i, j) = matrix(i, p)*self%row_factor(i)
                end do
            end do
            call dgetrf(m, m, a, self%height, self%exchanges, info)
            do i = 1, m
                ! Every exchange changes the sign of the determinant, which the pivots represent, also for unusable ones.
                self%pivots(i) = merge(a(i, i), -a(i, i), self%exchanges(i) == i)
                if (.not. (abs(a(i, i))*self%pivot_scale(i) >= least .and. abs(a(i, i)) <= huge(1.0_wp))) stat = i
            end do
            if (stat > 0) return
            call dgetrs('N', m, self%n - m, a, self%height, self%exchanges, a(:, m + 1:), self%height, info)
            do j = m + 1, self%n
                do i = 1, m
                    if (.not. abs(a(i, j))*self%scale(self%order(j)) <= most*self%pivot_scale(i)) stat = i
                end do
            end do
        end associate
    end procedure factor

    module procedure solve_all
        real(wp) :: inverse(self%m, self%m)
        integer :: i, info

        inverse = 0.0_wp
        do i = 1, self%m
            inverse(i, i) = self%row_factor(i)
        end do
        call dgetrs('N', self%m, self%m, self%eliminated, self%height, self%exchanges, inverse, self%m, info)
        do i = 1, self%m
            right_inverse(self%order(i), :) = inverse(i, :)
        end do
    end procedure solve_all

    !> y := Cd^-1 x.
    module procedure solve
        integer :: i, info

        if (self%m > largest_small) then
            do i = 1, self%m
                y(i) = x(i)*self%row_factor(i)
            end do
            call dgetrs('N', self%m, 1, self%eliminated, self%height, self%exchanges, y, self%height, info)
        else
            call multiply(self%height, self%m, self%eliminated, x, y)
        end if
    end procedure solve
end submodule tandem_linalg_elimination_lapack
