! SPDX-License-Identifier: MIT
!> Drift about a steady motion that rotates: small motions in which no body has an additional acceleration. Such a body continues
!> beside its old path at a constant distance or at a constant velocity. In the rotating frame it seems to circle, in Jordan blocks
!> of the rates of the frame, which rounding makes look like growth and decay.
!>
!> With A the matrix of small motions, u(z) the velocities of all positions and the angular velocities of all bodies in the axes of
!> the frame, and w its rate, drift is the largest invariant subspace of A on which
!>
!>   u(A z) + w x u(z) = 0.
module tandem_analysis_drift
    use tandem_analysis_symmetry, only: symmetry_type
    use tandem_kinds, only: wp
    use tandem_linalg_singular, only: singular_type
    implicit none (type, external)
    private

    public :: find_drift

    !> Singular values of at most this part of the largest count as zero.
    real(wp), parameter :: bound = 1.0e-9_wp
    !> Rows of at most this part of their terms are rounding.
    real(wp), parameter :: nothing = 1.0e-13_wp

contains

    !> An orthonormal basis of the drift, and the rate of the frame.
    subroutine find_drift(symmetry, rates, q, qd, a, dq, dqd, basis, rate)
        !> The motions along which the steady motion continues, and their rates.
        type(symmetry_type), intent(in) :: symmetry
        real(wp), intent(in) :: rates(:)
        !> The point (n), A (nv + nw, nv + nw), and the matrices (n, nv + nw) of dq = V dv and dqd = G dv + W dw.
        real(wp), intent(in) :: q(:), qd(:), a(:, :), dq(:, :), dqd(:, :)
        !> (nv + nw, any)
        real(wp), allocatable, intent(out) :: basis(:, :)
        real(wp), intent(out) :: rate
        real(wp), allocatable :: rows(:, :), unused(:, :), sizes(:)
        real(wp) :: length
        integer, allocatable :: turns(:)
        integer :: i, n

        n = size(a, 1)
        allocate (basis(n, 0))
        allocate (turns, source=world_rotations(symmetry, size(rates)))
        rate = 0.0_wp
        do i = 1, size(turns)
            rate = hypot(rate, rates(turns(i)))
        end do
        if (size(turns) == 0) rate = largest_rate(symmetry%matrix(rates, size(q)))
        if (.not. rate > 0.0_wp .or. n == 0) return
        call list_accelerations(symmetry, rates, q, qd, a, dq, dqd, rows, sizes)
        do i = 1, size(rows, 1)
            length = norm2(rows(i, :))
            ! Terms may cancel, and rows of bodies that are fixed are rounding alone.
            if (length > nothing*(10*sizes(i) + maxval(sizes))) then
                rows(i, :) = rows(i, :)/length
            else
                rows(i, :) = 0.0_wp
            end if
        end do
        deallocate (basis)
        call find_null_space(rows, 1.0_wp, basis)
        ! Reduce to the invariant subspace.
        do
            if (size(basis, 2) == 0) return
            rows = matmul(a, basis)
            rows = rows - matmul(basis, matmul(transpose(basis), rows))
            if (norm2(rows) <= bound*norm2(a)) return
            call find_null_space(rows, norm2(a), unused)
            if (size(unused, 2) == size(basis, 2)) return
            basis = matmul(basis, unused)
        end do
    end subroutine find_drift

    !> Indices of the rotations of the world among the first n motions.
    pure function world_rotations(symmetry, n) result(numbers)
        type(symmetry_type), intent(in) :: symmetry
        integer, intent(in) :: n
        integer, allocatable :: numbers(:)
        integer :: i

        allocate (numbers(0))
        do i = 1, n
            if (symmetry%motions(i)%turns_world) numbers = [numbers, i]
        end do
    end function world_rotations

    !> u(A z) + w x u(z), a row for each coordinate or for each of the corresponding angular velocities.
    subroutine list_accelerations(symmetry, rates, q, qd, a, dq, velocity, rows, sizes)
        type(symmetry_type), intent(in) :: symmetry
        real(wp), intent(in) :: rates(:)
        !> As of `find_drift`.
        real(wp), intent(in) :: q(:), qd(:), a(:, :), dq(:, :), velocity(:, :)
        !> The rows and the sizes of their terms.
        real(wp), allocatable, intent(out) :: rows(:, :), sizes(:)
        real(wp), allocatable :: l(:, :), spin(:, :), terms(:, :)
        integer, allocatable :: kept(:), turns(:)
        logical :: is_place(size(q))
        real(wp) :: along(3)
        integer :: i, first, last

        allocate (l, source=symmetry%matrix(rates, size(q)))
        allocate (rows, source=matmul(velocity, a) + matmul(l, velocity))
        allocate (terms, source=matmul(abs(velocity), abs(a)) + matmul(abs(l), abs(velocity)))
        is_place = .true.
        allocate (turns, source=world_rotations(symmetry, size(rates)))
        if (size(turns) == 3) then
            along = rates(turns)
            last = 0
            do i = 1, size(symmetry%motions)
                ! Spins of bodies in space, of which each has three, on the same Euler parameters.
                if (symmetry%motions(i)%turns_world .or. size(symmetry%motions(i)%row) == 0) cycle
                first = minval(symmetry%motions(i)%row)
                if (.not. is_place(first)) cycle
                last = maxval(symmetry%motions(i)%row)
                is_place(first:last) = .false.
                call find_spin(symmetry, turns, first, last, q, qd, dq, velocity, spin)
                rows(first:first + 2, :) = matmul(spin, a) + turned(along, spin)
                terms(first:first + 2, :) = matmul(abs(spin), abs(a)) + norm2(along)*abs(spin)
            end do
            kept = pack([(i, i=1, size(q))], is_place .or. is_first_of_three())
            rows = rows(kept, :)
            terms = terms(kept, :)
        end if
        sizes = norm2(terms, dim=2)

    contains

        !> True for the positions, among four parameters each, at which the three angular velocities are stored.
        pure function is_first_of_three() result(is_one)
            logical :: is_one(size(q))
            integer :: k, j

            is_one = .false.
            k = 0
            do j = 1, size(q)
                k = merge(0, k + 1, is_place(j))
                is_one(j) = k > 0 .and. modulo(k, 4) /= 0
            end do
        end function is_first_of_three
    end subroutine list_accelerations

    !> Changes of an angular velocity with the state (3, nv + nw): entry k is 4 (Y p).pd, Y p the rotation of the parameters p with
    !> the world about axis k.
    subroutine find_spin(symmetry, turns, first, last, q, qd, dq, velocity, spin)
        type(symmetry_type), intent(in) :: symmetry
        !> Rotations of the world, and the first and the last of the parameters.
        integer, intent(in) :: turns(3), first, last
        real(wp), intent(in) :: q(:), qd(:), dq(:, :), velocity(:, :)
        real(wp), allocatable, intent(out) :: spin(:, :)
        real(wp) :: turn(size(q)), back(size(q))
        integer :: k, j

        allocate (spin(3, size(dq, 2)))
        do k = 1, 3
            associate (motion => symmetry%motions(turns(k)))
                turn = 0.0_wp
                back = 0.0_wp
                do j = 1, size(motion%row)
                    if (motion%row(j) < first .or. motion%row(j) > last) cycle
                    turn(motion%row(j)) = turn(motion%row(j)) + motion%entry(j)*q(motion%column(j))
                    back(motion%column(j)) = back(motion%column(j)) + motion%entry(j)*qd(motion%row(j))
                end do
            end associate
            spin(k, :) = 4*(matmul(turn, velocity) + matmul(back, dq))
        end do
    end subroutine find_spin

    !> w x each column.
    pure function turned(along, x) result(y)
        real(wp), intent(in) :: along(3), x(:, :)
        real(wp) :: y(3, size(x, 2))
        integer :: k

        do k = 1, 3
            associate (i => modulo(k, 3) + 1, j => modulo(k + 1, 3) + 1)
                y(k, :) = along(i)*x(j, :) - along(j)*x(i, :)
            end associate
        end do
    end function turned

    !> An orthonormal basis of the null space of rows of a given size.
    subroutine find_null_space(rows, length, basis)
        real(wp), intent(in) :: rows(:, :), length
        real(wp), allocatable, intent(out) :: basis(:, :)
        type(singular_type) :: svd

        call svd%allocate(size(rows, 1), size(rows, 2))
        call svd%factor(rows)
        svd%rank = count(svd%values > bound*length)
        call svd%get_null_basis(basis)
    end subroutine find_null_space

    !> The largest rate of rotations of coordinates whose matrix is antisymmetric.
    real(wp) function largest_rate(l) result(rate)
        real(wp), intent(in) :: l(:, :)
        type(singular_type) :: svd

        call svd%allocate(size(l, 1), size(l, 2))
        call svd%factor(l)
        rate = maxval([0.0_wp, svd%values])
    end function largest_rate
end module tandem_analysis_drift
