! SPDX-License-Identifier: MIT
!> Tests of saddle-point systems: both implementations against the equations that they solve, with dependent rows, and with a
!> singular first block.
module test_saddle
    use asserts, only: check_below, check_close, check_count, check_true
    use tandem, only: wp
    use tandem_linalg_random, only: random_vector
    use tandem_model_pattern, only: pattern_type
    use tandem_saddle, only: saddle_singular, saddle_type
    use tandem_saddle_choice, only: allocate_saddle, suits_sparse
    use testdrive, only: error_type, new_unittest, unittest_type
    implicit none (type, external)
    private

    public :: collect_saddle

    !> Coordinates of a body; rows of a joint.
    integer, parameter :: width = 3, height = 2

contains

    !> The suite.
    subroutine collect_saddle(testsuite)
        type(unittest_type), allocatable, intent(out) :: testsuite(:)

        testsuite = [ &
            new_unittest('equations-hold', test_equations), &
            new_unittest('dependent-rows-change-no-solution', test_dependent), &
            new_unittest('singular-blocks-have-solutions-of-least-norm', test_singular), &
            new_unittest('the-choice-follows-the-work', test_choice)]
    end subroutine collect_saddle

    !> The pattern of a chain of bodies, whose last joint is there twice if it is to be redundant.
    subroutine make_chain(n_bodies, is_redundant, pattern)
        integer, intent(in) :: n_bodies
        logical, intent(in) :: is_redundant
        type(pattern_type), intent(out) :: pattern
        integer, allocatable :: rows(:), bodies(:)
        integer :: b, i, k, m

        m = height*(n_bodies + merge(1, 0, is_redundant))
        allocate (rows(0), bodies(0))
        do k = 1, m/height
            b = min(k, n_bodies)
            do i = 1, height
                rows = [rows, height*(k - 1) + i, height*(k - 1) + i]
                bodies = [bodies, b - 1, b]
            end do
        end do
        call pattern%build([(1 + width*(b - 1), b=1, n_bodies + 1)], spread(width, 1, n_bodies), m, rows, bodies, spread(0, 1, m))
    end subroutine make_chain

    !> Random full matrices with this pattern, and their entries: H symmetric and positive definite; the last joint twice the second
    !> last one.
    subroutine fill(saddle, is_redundant, h, c, entries, compressed)
        class(saddle_type), intent(in) :: saddle
        logical, intent(in) :: is_redundant
        real(wp), allocatable, intent(out) :: h(:, :), c(:, :), entries(:), compressed(:, :)
        integer :: i, j, k, seed

        seed = 31
        allocate (h(saddle%n, saddle%n), c(saddle%m, saddle%n), source=0.0_wp)
        allocate (entries(size(saddle%columns%row)), compressed(saddle%m, saddle%pattern%width), source=0.0_wp)
        do j = 1, saddle%n
            do k = saddle%columns%start(j), saddle%columns%start(j + 1) - 1
                i = saddle%columns%row(k)
                entries(k) = 0.3_wp*sin(real(i*j, wp)) + merge(4.0_wp, 0.0_wp, i == j)
                h(i, j) = entries(k)
            end do
        end do
        associate (pattern => saddle%pattern)
            do i = 1, saddle%m
                do k = pattern%row_start(i), pattern%row_start(i + 1) - 1
                    do j = pattern%first(pattern%row_body(k)), pattern%first(pattern%row_body(k) + 1) - 1
                        c(i, j:j) = random_vector(seed, 1)
                        if (is_redundant .and. i > saddle%m - height) c(i, j) = 2*c(i - height, j)
                        compressed(i, pattern%column(j)) = c(i, j)
                    end do
                end do
            end do
        end associate
    end subroutine fill

    !> H x + C' lambda = f, C x = g, and C times x.
    subroutine test_equations(error)
        type(error_type), allocatable, intent(out) :: error
        class(saddle_type), allocatable :: saddle
        type(pattern_type), target :: pattern
        real(wp), allocatable :: h(:, :), c(:, :), entries(:), compressed(:, :), f(:), g(:), x(:), lambda(:), product(:)
        integer :: i, seed, stat

        call make_chain(6, .false., pattern)
        do i = 1, 2
            call allocate_saddle(i == 1, saddle)
            call saddle%analyse(pattern, spread(2.0_wp, 1, 6*width))
            call fill(saddle, .false., h, c, entries, compressed)
            call saddle%load(entries, compressed)
            call saddle%factor(stat)
            call check_count(error, stat, 0, 'status')
            if (allocated(error)) return
            seed = 7
            f = random_vector(seed, saddle%n)
            g = random_vector(seed, saddle%m)
            x = f
            lambda = g
            product = g
            call saddle%solve(f, g, x, lambda)
            call check_close(error, matmul(h, x) + matmul(lambda, c), f, 1.0e-12_wp*(1 + maxval(abs(lambda))), 'forces')
            call check_close(error, matmul(c, x), g, 1.0e-12_wp, 'rows')
            call saddle%multiply(compressed, x, product)
            call check_close(error, product, g, 1.0e-12_wp, 'product')
            call check_true(error, saddle%independence() > 1.0e-4_wp .and. saddle%n_free == 0, 'independence')
        end do
    end subroutine test_equations

    !> A joint that is there twice: x does not depend on the factors. Multipliers have least norm if the matrix is dense, and the
    !> joint is left out if it is sparse.
    subroutine test_dependent(error)
        type(error_type), allocatable, intent(out) :: error
        class(saddle_type), allocatable :: saddle
        type(pattern_type), target :: pattern
        real(wp), allocatable :: h(:, :), c(:, :), entries(:), compressed(:, :), f(:), g(:), x(:), lambda(:), first_x(:)
        integer :: i, seed, stat

        call make_chain(5, .true., pattern)
        do i = 1, 2
            call allocate_saddle(i == 1, saddle)
            call saddle%analyse(pattern, spread(1.0_wp, 1, 5*width))
            call fill(saddle, .true., h, c, entries, compressed)
            call saddle%load(entries, compressed)
            saddle%drops_dependent = .true.
            call saddle%factor(stat)
            call check_count(error, stat, 0, 'status')
            if (allocated(error)) return
            seed = 7
            f = random_vector(seed, saddle%n)
            g = random_vector(seed, saddle%m)
            g(saddle%m - height + 1:) = 2*g(saddle%m - 2*height + 1:saddle%m - height)
            x = f
            lambda = g
            call saddle%solve(f, g, x, lambda)
            call check_close(error, matmul(h, x) + matmul(lambda, c), f, 1.0e-12_wp*(1 + maxval(abs(lambda))), 'forces')
            call check_close(error, matmul(c, x), g, 1.0e-12_wp, 'rows')
            if (i == 1) then
                call check_count(error, count(saddle%is_out), height, 'rows that are left out')
                first_x = x
            else
                call check_close(error, x, first_x, 1.0e-12_wp, 'x')
                associate (m => saddle%m)
                    ! Least norm of the multipliers of rows of unit length: copies share the load equally.
                    call check_close(error, 2*lambda(m - height + 1:), lambda(m - 2*height + 1:m - height), &
                        1.0e-12_wp*maxval(abs(lambda)), 'multipliers')
                end associate
            end if
        end do
    end subroutine test_dependent

    !> A block of zeros: the sparse matrix is singular, the dense one yields the shortest x in scaled coordinates.
    subroutine test_singular(error)
        type(error_type), allocatable, intent(out) :: error
        class(saddle_type), allocatable :: saddle
        type(pattern_type), target :: pattern
        real(wp), allocatable :: h(:, :), c(:, :), entries(:), compressed(:, :), g(:), x(:), lambda(:), scale(:), y(:)
        integer :: i, seed, stat

        call make_chain(4, .false., pattern)
        seed = 3
        scale = 1 + 0.5_wp*random_vector(seed, 4*width)
        do i = 1, 2
            call allocate_saddle(i == 1, saddle)
            call saddle%analyse(pattern, scale)
            call fill(saddle, .false., h, c, entries, compressed)
            entries = 0.0_wp
            call saddle%load(entries, compressed)
            call saddle%factor(stat)
            if (i == 1) then
                call check_count(error, stat, saddle_singular, 'status')
                cycle
            end if
            call check_count(error, stat, 0, 'status')
            call check_count(error, saddle%n_free, saddle%n - saddle%m, 'free directions')
            g = random_vector(seed, saddle%m)
            x = scale
            lambda = g
            call saddle%solve(spread(0.0_wp, 1, saddle%n), g, x, lambda)
            call check_close(error, matmul(c, x), g, 1.0e-12_wp, 'rows')
            ! x/scale is a combination of scaled rows: its product with any vector that these do not see is zero.
            y = random_vector(seed, saddle%n)
            call saddle%solve(spread(0.0_wp, 1, saddle%n), matmul(c, y), lambda=lambda, x=h(:, 1))
            y = y - h(:, 1)
            call check_below(error, abs(sum(x*y/scale**2)), 1.0e-12_wp, 'part that rows do not see')
        end do
    end subroutine test_singular

    !> Short chains and single bodies are dense, long chains sparse, a star of one hub is sparse if it is large.
    subroutine test_choice(error)
        type(error_type), allocatable, intent(out) :: error
        type(pattern_type) :: pattern

        call make_chain(3, .false., pattern)
        call check_true(error, .not. suits_sparse(pattern), 'three bodies')
        call make_chain(100, .false., pattern)
        call check_true(error, suits_sparse(pattern), 'a hundred bodies')
    end subroutine test_choice
end module test_saddle
