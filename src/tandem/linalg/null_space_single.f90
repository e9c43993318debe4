! SPDX-License-Identifier: MIT
!> Velocities and accelerations at stages with one degree of freedom, for which D is a vector d, and D0' M0 D and D' M D are
!> numbers: the results of `tandem_linalg_null_space_kernels` without padding.
module tandem_linalg_null_space_single
    use tandem_kinds, only: lane, short, wp
    implicit none (type, external)
    private

    public :: find_single_velocity, find_single_acceleration

contains

    !> qd = R nu + d z with d0' M0 (qd - qd_wanted) = 0.
    pure subroutine find_single_velocity(m, n, height, width, order, a, basis, origin, has_nu, nu, r, qd, stat)
        !> Constraints, coordinates, padded lengths; order of the columns.
        integer, intent(in) :: m, n, height, width, order(n)
        !> True if nu is not zero.
        logical, intent(in) :: has_nu
        !> C eliminated, d' and d0' M0 in first rows, nu.
        real(wp), intent(in) :: a(height, n), basis(width, n), origin(width, n), nu(m)
        !> Work space; on entry the wanted velocity, on return the velocity.
        real(wp), intent(inout) :: r(height), qd(n)
        !> 1 if d0' M0 d is zero or not finite: the velocity is then unchanged.
        integer, intent(out) :: stat
        real(wp) :: along, overlap
        integer :: i, j

        overlap = 0.0_wp
        along = 0.0_wp
        !GCC$ NOVECTOR
        !GCC$ UNROLL 2
        do j = 1, n
            overlap = overlap + origin(1, j)*basis(1, j)
            along = along + origin(1, j)*qd(j)
        end do
        stat = merge(0, 1, abs(overlap) > 0.0_wp .and. abs(overlap) <= huge(1.0_wp))
        if (stat /= 0) return
        if (has_nu) then
            call multiply(height, m, a, nu, r)
            !GCC$ NOVECTOR
            !GCC$ UNROLL 1
            do i = 1, m
                along = along - origin(1, order(i))*r(i)
            end do
        end if
        along = along/overlap
        !GCC$ NOVECTOR
        !GCC$ UNROLL 2
        do j = 1, n
            qd(j) = basis(1, j)*along
        end do
        if (has_nu) then
            !GCC$ NOVECTOR
            !GCC$ UNROLL 1
            do i = 1, m
                qd(order(i)) = qd(order(i)) + r(i)
            end do
        end if
    end subroutine find_single_velocity

    !> qdd = d w - R gamma with d' (M qdd - S - Q_A) = 0.
    pure subroutine find_single_acceleration(m, n, height, width, order, a, basis, n_blocks, blocks, mass, gamma, force, &
        basis_mass, r, qdd, stat)
        !> Constraints, coordinates, padded lengths; order of the columns.
        integer, intent(in) :: m, n, height, width, order(n)
        !> The diagonal blocks of M with more than one entry, see `tandem_model_evaluator`.
        integer, intent(in) :: n_blocks, blocks(2, n_blocks)
        !> C eliminated, d' in a first row, M, gamma, S + Q_A.
        real(wp), intent(in) :: a(height, n), basis(width, n), mass(n*n), gamma(m), force(n)
        !> Work space, and the acceleration.
        real(wp), intent(inout) :: basis_mass(n), r(height), qdd(n)
        !> 1 if d' M d is not positive, or not finite; -1 if the acceleration is not finite.
        integer, intent(out) :: stat
        real(wp) :: along, f, reduced_mass
        integer :: b, i, j

        i = 1
        !GCC$ NOVECTOR
        !GCC$ UNROLL 1
        do j = 1, n
            basis_mass(j) = basis(1, j)*mass(i)
            i = i + n + 1
        end do
        !GCC$ NOVECTOR
        !GCC$ UNROLL 1
        do b = 1, n_blocks
            !GCC$ NOVECTOR
            !GCC$ UNROLL 1
            do j = blocks(1, b), blocks(2, b)
                f = 0.0_wp
                !GCC$ NOVECTOR
                !GCC$ UNROLL 2
                do i = blocks(1, b), blocks(2, b)
                    f = f + basis(1, i)*mass(n*(j - 1) + i)
                end do
                basis_mass(j) = f
            end do
        end do
        reduced_mass = 0.0_wp
        along = 0.0_wp
        !GCC$ NOVECTOR
        !GCC$ UNROLL 2
        do j = 1, n
            reduced_mass = reduced_mass + basis_mass(j)*basis(1, j)
            along = along + force(j)*basis(1, j)
        end do
        stat = merge(0, 1, reduced_mass > 0.0_wp .and. reduced_mass <= huge(1.0_wp))
        if (stat /= 0) return
        if (height == lane) then
            call multiply(lane, m, a, gamma, r)
        else
            call multiply(height, m, a, gamma, r)
        end if
        !GCC$ NOVECTOR
        !GCC$ UNROLL 1
        do i = 1, m
            along = along + basis_mass(order(i))*r(i)
        end do
        along = along/reduced_mass
        ! Values of gamma or the forces that are not finite enter this sum.
        if (.not. abs(along) <= huge(1.0_wp)) stat = -1
        !GCC$ NOVECTOR
        !GCC$ UNROLL 2
        do j = 1, n
            qdd(j) = basis(1, j)*along
        end do
        !GCC$ NOVECTOR
        !GCC$ UNROLL 1
        do i = 1, m
            qdd(order(i)) = qdd(order(i)) - r(i)
        end do
    end subroutine find_single_acceleration

    !> y := A x, A (height, l), x (l), two columns at a time.
    pure subroutine multiply(height, l, a, x, y)
        integer, intent(in), value :: height
        integer, intent(in) :: l
        real(wp), intent(in) :: a(height, l), x(l)
        real(wp), intent(inout) :: y(height)
        real(wp) :: x1, x2
        integer :: i, j, p, s

        do s = 0, height - short, short
            x1 = 0.0_wp
            if (iand(l, 1) == 1) x1 = x(1)
            !GCC$ UNROLL 1
            do i = 1, short
                y(s + i) = a(s + i, 1)*x1
            end do
        end do
        !GCC$ NOVECTOR
        !GCC$ UNROLL 1
        do p = 1, l/2
            j = 2*p - 1 + iand(l, 1)
            x1 = x(j)
            x2 = x(j + 1)
            do s = 0, height - short, short
                !GCC$ UNROLL 1
                do i = 1, short
                    y(s + i) = y(s + i) + (a(s + i, j)*x1 + a(s + i, j + 1)*x2)
                end do
            end do
        end do
    end subroutine multiply
end module tandem_linalg_null_space_single
