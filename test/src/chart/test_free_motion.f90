! SPDX-License-Identifier: MIT
!> Tests of velocities and accelerations from an elimination, against the equations that define them, for all small numbers of
!> constraints and degrees of freedom, and for large ones.
module test_free_motion
    use, intrinsic :: ieee_arithmetic, only: ieee_positive_inf, ieee_quiet_nan, ieee_value
    use asserts, only: check_below, check_count, check_true
    use differences, only: random_vector
    use tandem, only: wp
    use tandem_linalg_elimination, only: elimination_type
    use tandem_status, only: status_chart_left, status_not_finite, status_ok, status_singular_mass
    use tandem_chart_dense_free_motion, only: free_motion_type
    use testdrive, only: error_type, new_unittest, unittest_type
    implicit none (type, external)
    private

    public :: collect_free_motion

    !> Constraints and coordinates of large mechanisms.
    integer, parameter :: large(2, 6) = reshape([66, 68, 80, 100, 60, 125, 3, 70, 0, 66, 67, 67], [2, 6])

    !> A mechanism at a point, and its D at another one, the chart's origin.
    type :: case_type
        integer :: m = 0, n = 0
        type(elimination_type) :: elimination
        type(free_motion_type) :: free_motion
        !> C, M, D0 and D, coordinate scales, nu, gamma, forces.
        real(wp), allocatable :: c(:, :), mass(:, :), origin(:, :), null_space(:, :), scale(:), nu(:), gamma(:), force(:)
        !> The blocks of M with more than one entry, the first and the last coordinate of each.
        integer, allocatable :: blocks(:)
    end type case_type

contains

    !> The suite.
    subroutine collect_free_motion(testsuite)
        type(unittest_type), allocatable, intent(out) :: testsuite(:)

        testsuite = [ &
            new_unittest('velocities-by-their-equations', test_velocity), &
            new_unittest('accelerations-by-their-equations', test_acceleration), &
            new_unittest('a-mass-that-is-not-positive-is-refused', test_singular), &
            new_unittest('what-is-not-finite-is-refused', test_not_finite), &
            new_unittest('velocities-across-the-origin-are-refused', test_across)]
    end subroutine collect_free_motion

    !> A case of m constraints and n coordinates in blocks of one to seven.
    subroutine set_up(self, m, n, seed)
        type(case_type), intent(out) :: self
        integer, intent(in) :: m, n
        integer, intent(inout) :: seed
        real(wp) :: part(n, n), change(n)
        integer :: b, first, i, j, last, stat

        self%m = m
        self%n = n
        allocate (self%c(m, n), self%mass(n, n), self%origin(n, n - m), self%null_space(n, n - m), self%scale(n), self%nu(m), &
            self%gamma(m), self%force(n), source=0.0_wp)
        call random_vector(seed, self%scale)
        self%scale = 10.0_wp**self%scale
        do i = 1, m
            call random_vector(seed, self%c(i, :))
            self%c(i, :) = self%c(i, :)/self%scale
        end do
        call random_vector(seed, self%nu)
        call random_vector(seed, self%gamma)
        call random_vector(seed, self%force)
        do j = 1, n
            call random_vector(seed, part(:, j))
        end do
        self%blocks = [integer ::]
        b = 0
        last = 0
        do while (last < n)
            b = b + 1
            first = last + 1
            last = min(first + modulo(b, 7), n)
            self%mass(first:last, first:last) = matmul(transpose(part(first:last, first:last)), part(first:last, first:last))
            do i = first, last
                self%mass(i, i) = self%mass(i, i) + 1.0_wp
            end do
            if (last > first) self%blocks = [self%blocks, first, last]
        end do
        call self%elimination%allocate(m, n)
        call self%free_motion%allocate(m, n, self%scale)
        call self%elimination%eliminate(self%c, self%scale, stat)
        call self%elimination%get_null_space(self%origin)
        call self%free_motion%load(self%elimination)
        call self%free_motion%set_origin(self%blocks, self%mass)
        do i = 1, m
            call random_vector(seed, change)
            self%c(i, :) = self%c(i, :) + 0.05_wp*change/self%scale
        end do
        call self%elimination%eliminate(self%c, self%scale, stat)
        call self%elimination%get_null_space(self%null_space)
        call self%free_motion%load(self%elimination)
    end subroutine set_up

    !> Velocities of all small mechanisms, and of some with many constraints, many degrees of freedom, or both.
    subroutine test_velocity(error)
        type(error_type), allocatable, intent(out) :: error
        integer :: i, m, n, seed

        seed = 31
        do n = 1, 12
            do m = 1, n
                call check_velocity(m, n, seed, error)
                if (allocated(error)) return
            end do
        end do
        do i = 1, size(large, 2)
            call check_velocity(large(1, i), large(2, i), seed, error)
            if (allocated(error)) return
        end do
    end subroutine test_velocity

    !> C qd = nu, and D0' M0 (qd - wanted) = 0.
    subroutine check_velocity(m, n, seed, error)
        integer, intent(in) :: m, n
        integer, intent(inout) :: seed
        type(error_type), allocatable, intent(out) :: error
        type(case_type) :: case
        real(wp) :: qd(n), wanted(n), allowed
        integer :: choice, stat
        logical :: has_nu

        call set_up(case, m, n, seed)
        call random_vector(seed, wanted)
        allowed = merge(1.0_wp, 10.0_wp, n <= 12)
        do choice = 0, 3
            has_nu = choice >= 2
            if (.not. has_nu) case%nu = 0.0_wp
            if (has_nu) call random_vector(seed, case%nu)
            qd = wanted
            call case%free_motion%restore_velocity(case%elimination, has_nu, modulo(choice, 2) == 1, case%nu, qd, stat)
            call check_count(error, stat, status_ok, 'status')
            associate (size_ => 1.0_wp + maxval(abs(qd)))
                call check_below(error, maxval(abs(matmul(case%c, qd) - case%nu))/size_, allowed*1.0e-12_wp, 'C qd - nu')
                if (m < n) call check_below(error, maxval(abs(matmul(transpose(case%origin), &
                    matmul(case%mass, qd - wanted))))/size_, allowed*1.0e-10_wp, 'momentum along D0')
            end associate
            if (allocated(error)) return
        end do
    end subroutine check_velocity

    !> Accelerations of all small mechanisms and of some large ones.
    subroutine test_acceleration(error)
        type(error_type), allocatable, intent(out) :: error
        integer :: i, m, n, seed

        seed = 32
        do n = 1, 12
            do m = 0, n
                call check_acceleration(m, n, seed, error)
                if (allocated(error)) return
            end do
        end do
        do i = 1, size(large, 2)
            call check_acceleration(large(1, i), large(2, i), seed, error)
            if (allocated(error)) return
        end do
    end subroutine test_acceleration

    !> C qdd + gamma = 0, and D' (M qdd - force) = 0, with the blocks of M and with M as one.
    subroutine check_acceleration(m, n, seed, error)
        integer, intent(in) :: m, n
        integer, intent(inout) :: seed
        type(error_type), allocatable, intent(out) :: error
        type(case_type) :: case
        real(wp) :: qdd(n), allowed
        integer :: choice, stat
        logical :: polishes

        call set_up(case, m, n, seed)
        allowed = merge(1.0_wp, 10.0_wp, n <= 12)
        do choice = 0, 3
            polishes = modulo(choice, 2) == 1
            if (choice < 2) then
                call case%free_motion%solve(case%elimination, polishes, case%blocks, case%mass, case%gamma, &
                    case%force, qdd, stat)
            else
                call case%free_motion%solve(case%elimination, polishes, pack([1, n], n > 1), case%mass, case%gamma, &
                    case%force, qdd, stat)
            end if
            call check_count(error, stat, status_ok, 'status')
            associate (size_ => 1.0_wp + maxval(abs(qdd)))
                if (m > 0) call check_below(error, maxval(abs(matmul(case%c, qdd) + case%gamma))/size_, allowed*1.0e-12_wp, &
                    'C qdd + gamma')
                if (m < n) call check_below(error, maxval(abs(matmul(transpose(case%null_space), &
                    matmul(case%mass, qdd) - case%force)))/size_, allowed*1.0e-11_wp, 'D'' (M qdd - force)')
            end associate
            if (allocated(error)) return
        end do
    end subroutine check_acceleration

    !> The mass along one free direction is set to zero, or to a negative value.
    subroutine test_singular(error)
        type(error_type), allocatable, intent(out) :: error
        type(case_type) :: case
        real(wp) :: qdd(7)
        integer :: choice, m, seed, stat

        seed = 33
        do m = 0, 6
            call set_up(case, m, 7, seed)
            do choice = 0, 3
                case%mass = 0.0_wp
                if (choice >= 2) case%mass(1, 1) = -1.0_wp
                call case%free_motion%solve(case%elimination, modulo(choice, 2) == 1, [1, 7], case%mass, case%gamma, &
                    case%force, qdd, stat)
                call check_count(error, stat, status_singular_mass, 'status')
                if (allocated(error)) return
            end do
        end do
    end subroutine test_singular

    !> NaN and Inf in M, gamma and the forces.
    subroutine test_not_finite(error)
        type(error_type), allocatable, intent(out) :: error
        type(case_type) :: case
        real(wp) :: qdd(7), bad, mass(7, 7), gamma(7), force(7)
        integer :: choice, m, seed, stat, where_

        seed = 34
        do m = 1, 6
            call set_up(case, m, 7, seed)
            do choice = 0, 3
                bad = ieee_value(1.0_wp, ieee_quiet_nan)
                if (choice >= 2) bad = ieee_value(1.0_wp, ieee_positive_inf)
                do where_ = 1, 3
                    mass = case%mass
                    gamma(:m) = case%gamma
                    force = case%force
                    if (where_ == 1) mass(2, 2) = bad
                    if (where_ == 2) gamma(1) = bad
                    if (where_ == 3) force(3) = bad
                    call case%free_motion%solve(case%elimination, modulo(choice, 2) == 1, [1, 7], mass, gamma(:m), force, &
                        qdd, stat)
                    call check_true(error, any(stat == [status_singular_mass, status_not_finite]), 'refused')
                    if (allocated(error)) return
                end do
            end do
        end do
    end subroutine test_not_finite

    !> If the free direction has turned by a right angle, no velocity along it fits the wanted one.
    subroutine test_across(error)
        type(error_type), allocatable, intent(out) :: error
        type(elimination_type) :: elimination
        type(free_motion_type) :: free_motion
        real(wp) :: qd(2)
        integer :: choice, stat

        call elimination%allocate(1, 2)
        call free_motion%allocate(1, 2, [1.0_wp, 1.0_wp])
        call elimination%eliminate(reshape([1.0_wp, 0.0_wp], [1, 2]), [1.0_wp, 1.0_wp], stat)
        call free_motion%load(elimination)
        call free_motion%set_origin([integer ::], reshape([1.0_wp, 0.0_wp, 0.0_wp, 1.0_wp], [2, 2]))
        call elimination%eliminate(reshape([0.0_wp, 1.0_wp], [1, 2]), [1.0_wp, 1.0_wp], stat)
        call free_motion%load(elimination)
        do choice = 0, 1
            qd = [1.0_wp, 2.0_wp]
            call free_motion%restore_velocity(elimination, .false., choice == 1, [0.0_wp], qd, stat)
            call check_count(error, stat, status_chart_left, 'status')
        end do
    end subroutine test_across
end module test_free_motion
