! SPDX-License-Identifier: MIT
!> Tests of the analysis of rows: the combination closest to zero, and the orientation of their span.
module test_linalg_row_space
    use asserts, only: check_below, check_close, check_true
    use differences, only: random_vector
    use tandem, only: wp
    use tandem_linalg_row_space, only: row_space_type
    use testdrive, only: error_type, new_unittest, unittest_type
    implicit none (type, external)
    private

    public :: collect_linalg_row_space

contains

    !> The suite.
    subroutine collect_linalg_row_space(testsuite)
        type(unittest_type), allocatable, intent(out) :: testsuite(:)

        testsuite = [ &
            new_unittest('the-weakest-combination-of-two-rows-at-an-angle', test_angle), &
            new_unittest('a-row-of-zeros-is-the-weakest', test_zero_row), &
            new_unittest('scales-and-lengths-do-not-matter', test_scales), &
            new_unittest('a-turn-keeps-the-orientation', test_turn), &
            new_unittest('a-row-that-passes-through-the-others-changes-it', test_passage), &
            new_unittest('another-shape-after-forget', test_shapes)]
    end subroutine collect_linalg_row_space

    !> Unit rows at the angle a: the smallest singular value is sqrt(1 - cos a), by their difference.
    subroutine test_angle(error)
        type(error_type), allocatable, intent(out) :: error
        type(row_space_type) :: space
        real(wp) :: rows(2, 3), share(2), smallest, a
        integer :: i

        do i = 0, 8
            a = 10.0_wp**(-i)
            rows(1, :) = [0.6_wp, 0.8_wp, 0.0_wp]
            rows(2, :) = cos(a)*rows(1, :) + sin(a)*[0.0_wp, 0.0_wp, 1.0_wp]
            call space%find_weakest(2, 3, rows, [1.0_wp, 1.0_wp, 1.0_wp], share, smallest)
            call check_close(error, [smallest], [sqrt(2.0_wp)*sin(0.5_wp*a)], 1.0e-15_wp, 'the smallest singular value')
            ! Rounding of the rows changes the combination of nearly parallel ones by no more than that.
            call check_below(error, abs(share(1) + share(2)), 1.0e-14_wp, 'the sum of the parts')
            call check_close(error, [maxval(abs(share))], [1.0_wp], 0.0_wp, 'the largest part')
            if (allocated(error)) return
        end do
    end subroutine test_angle

    subroutine test_zero_row(error)
        type(error_type), allocatable, intent(out) :: error
        type(row_space_type) :: space
        real(wp) :: rows(3, 4), share(3), smallest
        integer :: j, seed

        seed = 31
        do j = 1, 4
            call random_vector(seed, rows(:, j))
        end do
        rows(2, :) = 0.0_wp
        call space%find_weakest(3, 4, rows, spread(1.0_wp, 1, 4), share, smallest)
        call check_close(error, share, [0.0_wp, 1.0_wp, 0.0_wp], 0.0_wp, 'parts')
        call check_close(error, [smallest], [0.0_wp], 0.0_wp, 'the smallest singular value')
    end subroutine test_zero_row

    subroutine test_scales(error)
        type(error_type), allocatable, intent(out) :: error
        type(row_space_type) :: space
        real(wp) :: rows(3, 5), scaled(3, 5), scale(5), share(3), same(3), smallest, again
        integer :: i, j, seed

        seed = 32
        do j = 1, 5
            call random_vector(seed, rows(:, j))
        end do
        scale = [1.0e-3_wp, 1.0_wp, 1.0e6_wp, 2.0_wp, 1.0e-9_wp]
        do j = 1, 5
            do i = 1, 3
                scaled(i, j) = 10.0_wp**(3*i - 5)*rows(i, j)/scale(j)
            end do
        end do
        call space%find_weakest(3, 5, rows, spread(1.0_wp, 1, 5), share, smallest)
        call space%find_weakest(3, 5, scaled, scale, same, again)
        call check_close(error, [again], [smallest], 1.0e-15_wp, 'the smallest singular value')
        call check_below(error, min(maxval(abs(same - share)), maxval(abs(same + share))), 1.0e-14_wp, 'parts')
    end subroutine test_scales

    !> Two rows rotate around the third axis, to and fro, by less than a quarter turn, in any basis.
    subroutine test_turn(error)
        type(error_type), allocatable, intent(out) :: error
        type(row_space_type) :: space
        real(wp) :: from(2, 3), to(2, 3), turn(3, 3), mix(2, 2), a
        integer :: i

        mix = reshape([2.0_wp, 1.0_wp, -3.0_wp, 1.0e-3_wp], [2, 2])
        from = matmul(mix, reshape([1.0_wp, 0.0_wp, 0.0_wp, 1.0_wp, 0.5_wp, -0.2_wp], [2, 3]))
        do i = -7, 7
            a = 0.1_wp*i
            turn = reshape([cos(a), sin(a), 0.0_wp, -sin(a), cos(a), 0.0_wp, 0.0_wp, 0.0_wp, 1.0_wp], [3, 3])
            to = matmul(from, turn)
            call check_true(error, space%keeps_orientation(2, 3, from, to, [1.0_wp, 1.0_wp, 1.0_wp]), 'turned rows')
            to = to([2, 1], :)
            call check_true(error, .not. space%keeps_orientation(2, 3, from, to, [1.0_wp, 1.0_wp, 1.0_wp]), 'exchanged rows')
            if (allocated(error)) return
        end do
    end subroutine test_turn

    !> A row passes straight through the plane of the two others.
    subroutine test_passage(error)
        type(error_type), allocatable, intent(out) :: error
        type(row_space_type) :: space
        real(wp) :: from(3, 3), to(3, 3)
        integer :: i

        from = reshape([1.0_wp, 0.2_wp, 0.3_wp, 0.1_wp, 1.0_wp, 0.4_wp, 0.0_wp, 0.0_wp, 1.0_wp], [3, 3])
        do i = -5, 5
            to = from
            to(3, 3) = 0.1_wp*i + 0.05_wp
            call check_true(error, space%keeps_orientation(3, 3, from, to, [1.0_wp, 1.0_wp, 1.0_wp]) .eqv. i >= 0, &
                'before and behind the plane')
            if (allocated(error)) return
        end do
    end subroutine test_passage

    subroutine test_shapes(error)
        type(error_type), allocatable, intent(out) :: error
        type(row_space_type) :: space
        real(wp) :: rows(4, 6), share(4), smallest
        integer :: j, m, n, seed

        seed = 33
        do j = 1, 6
            call random_vector(seed, rows(:, j))
        end do
        do m = 1, 4
            do n = m, 6
                call space%forget()
                call space%find_weakest(m, n, rows(:m, :n), spread(1.0_wp, 1, n), share(:m), smallest)
                call check_true(error, smallest > 0.0_wp .and. smallest <= 1.0_wp + 1.0e-14_wp, 'the smallest singular value')
                call check_true(error, space%keeps_orientation(m, n, rows(:m, :n), rows(:m, :n), spread(1.0_wp, 1, n)), &
                    'the same rows')
                call check_true(error, .not. space%keeps_orientation(m, n, rows(:m, :n), -rows(:m, :n), spread(1.0_wp, 1, n)) &
                    .eqv. modulo(m, 2) == 1, 'all rows negated')
                if (allocated(error)) return
            end do
        end do
    end subroutine test_shapes
end module test_linalg_row_space
