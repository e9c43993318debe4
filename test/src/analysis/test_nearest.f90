! SPDX-License-Identifier: MIT
!> Tests of eigenvalues near a shift: the sparse factors against LAPACK's, the iteration against known spectra, the eigenvalues of
!> mechanisms against the dense analysis and against closed forms, and refusals.
module test_nearest
    use asserts, only: check_below, check_close, check_count, check_failure, check_no_failure, check_true
    use linearised, only: check_nearest, linearise_text
    use tandem, only: failure_type => error_type, linearisation_type, nearest_type, equilibrium_search_type, wp
    use tandem_io, only: body_motions, read_scene, scene_type
    use tandem_linalg_complex_lu, only: complex_lu_type
    use tandem_linalg_krylov, only: krylov_type, operator_type
    use tandem_linalg_random, only: random_vector
    use tandem_linalg_singular, only: decompose_symmetric
    use tandem_linalg_sparse_lu, only: sparse_lu_type, sparse_matrix_type
    use testdrive, only: error_type, new_unittest, test_failed, unittest_type
    implicit none (type, external)
    private

    public :: collect_nearest

    character(len=1), parameter :: nothing(0) = [character(len=1) ::], newline = new_line('a')

    !> A diagonal matrix.
    type, extends(operator_type) :: diagonal_type
        complex(wp), allocatable :: values(:)
    contains
        procedure :: apply => apply_diagonal
    end type diagonal_type

contains

    !> The suite.
    subroutine collect_nearest(testsuite)
        type(unittest_type), allocatable, intent(out) :: testsuite(:)

        testsuite = [ &
            new_unittest('sparse-factors-agree-with-lapack', test_factors), &
            new_unittest('columns-that-depend-on-others-are-found', test_dependent), &
            new_unittest('largest-eigenvalues-come-out-with-their-copies', test_copies), &
            new_unittest('a-small-space-is-seen-as-a-whole', test_whole_space), &
            new_unittest('chains-agree-with-the-dense-analysis', test_chains), &
            new_unittest('springs-dampers-and-loads-agree-with-the-dense-analysis', test_forces), &
            new_unittest('a-hanging-chain-agrees-with-its-closed-form', test_closed_form), &
            new_unittest('modes-that-swing-two-ways-come-twice', test_two_ways), &
            new_unittest('redundant-rows-are-left-out', test_redundant), &
            new_unittest('a-free-body-has-a-shift-beside-zero', test_free), &
            new_unittest('a-body-that-is-fixed-has-none', test_fixed), &
            new_unittest('what-is-no-equilibrium-is-refused', test_refused), &
            new_unittest('forces-that-nobody-named-are-noticed', test_unnamed), &
            new_unittest('a-large-chain-is-found-at-rest', test_rest), &
            new_unittest('modes-move-bodies', test_body_motions)]
    end subroutine collect_nearest

    subroutine apply_diagonal(self, x, y)
        class(diagonal_type), intent(inout) :: self
        complex(wp), intent(in), contiguous :: x(:)
        complex(wp), intent(out), contiguous :: y(:)

        y = self%values*x
    end subroutine apply_diagonal

    !> Hanging chains of n rods, in the plane or in space, with hinges or ball joints; further text of the scene.
    function chain(n, dimensions, joint, more) result(text)
        integer, intent(in) :: n, dimensions
        character(len=*), intent(in) :: joint, more
        character(len=:), allocatable :: text
        character(len=:), allocatable :: zeros, inertia, axis
        character(len=12) :: number

        write (number, '(i0)') n
        zeros = '0, '
        inertia = '"1/12"'
        axis = ''
        if (dimensions == 3) then
            zeros = '0, 0, '
            inertia = '["1/12", "1/12", 0.01]'
            if (joint == 'revolute') axis = 'axis = [0, 1, 0]'//newline
        end if
        text = '[scene]'//newline//'model = "mechanism"'//newline
        if (dimensions == 2) text = text//'planar = true'//newline
        text = text//'[gravity]'//newline//'vector = ['//zeros//'-9.81]'//newline// &
            '[body.rod1]'//newline//'mass = 1'//newline//'inertia = '//inertia//newline//'position = ['//zeros//'-0.5]'//newline// &
            '[joint.pin1]'//newline//'type = "'//joint//'"'//newline//'bodies = ["ground", "rod1"]'//newline// &
            'at = ['//zeros//'0]'//newline//axis// &
            '[repeat.link]'//newline//'count = '//trim(number)//newline//'first = 2'//newline// &
            '[repeat.link.body."rod{i}"]'//newline//'mass = 1'//newline//'inertia = '//inertia//newline// &
            'position = ['//zeros//'"0.5 - i"]'//newline//'[repeat.link.joint."pin{i}"]'//newline//'type = "'//joint//'"'// &
            newline//'bodies = ["rod{i - 1}", "rod{i}"]'//newline//'at = ['//zeros//'"1 - i"]'//newline//axis// &
            more//newline//'[time]'//newline//'end = 1'//newline
        ! The first rod is defined separately.
        write (number, '(i0)') n - 1
        text = replaced(text, 'count = ', trim(number))
    end function chain

    !> The text with another number after a key.
    function replaced(text, key, number) result(new)
        character(len=*), intent(in) :: text, key, number
        character(len=:), allocatable :: new
        integer :: first, last

        first = index(text, key) + len(key)
        last = first + index(text(first:), newline) - 1
        new = text(:first - 1)//number//text(last:)
    end function replaced

    !> A matrix of random entries, with some in every row and column.
    subroutine draw_matrix(n, a, dense)
        integer, intent(in) :: n
        type(sparse_matrix_type), intent(out) :: a
        complex(wp), allocatable, intent(out) :: dense(:, :)
        real(wp) :: numbers(3)
        integer :: i, j, k, seed

        seed = 99
        allocate (dense(n, n), source=(0.0_wp, 0.0_wp))
        do j = 1, n
            do k = 1, 4
                numbers = random_vector(seed, 3)
                i = 1 + modulo(int(1.0e6_wp*numbers(1)), n)
                if (k == 1) i = 1 + modulo(j, n)
                dense(i, j) = cmplx(numbers(2), numbers(3), wp)
            end do
        end do
        a%n = n
        a%start = [1]
        allocate (a%row(0), a%value(0))
        do j = 1, n
            a%row = [a%row, pack([(i, i=1, n)], abs(dense(:, j)) > 0.0_wp)]
            a%value = [a%value, pack(dense(:, j), abs(dense(:, j)) > 0.0_wp)]
            a%start = [a%start, size(a%row) + 1]
        end do
    end subroutine draw_matrix

    subroutine test_factors(error)
        type(error_type), allocatable, intent(out) :: error
        type(sparse_matrix_type) :: a
        type(sparse_lu_type) :: lu
        type(complex_lu_type) :: reference
        complex(wp), allocatable :: dense(:, :)
        integer, parameter :: n = 60
        real(wp) :: re(n), im(n)
        complex(wp) :: b(n), x(n)
        integer :: i, seed, stat

        call draw_matrix(n, a, dense)
        call lu%factor(a, [(1 + modulo(7*i, n), i=1, n)], 100000, stat)
        call check_count(error, stat, 0, 'status of the factors')
        call reference%allocate(n)
        call reference%factor(dense, stat)
        seed = 5
        re = random_vector(seed, n)
        im = random_vector(seed, n)
        b = cmplx(re, im, wp)
        call reference%solve(re, im)
        call lu%solve_refined(a, b, x)
        ! Both have rounding errors times the condition, which is about 100 here.
        call check_below(error, maxval(abs(x - cmplx(re, im, wp)))/maxval(abs(x)), 1.0e-12_wp, 'difference of the solutions')
        call lu%factor(a, [(i, i=1, n)], 10, stat)
        call check_count(error, stat, -1, 'status where there is no room')
    end subroutine test_factors

    subroutine test_dependent(error)
        type(error_type), allocatable, intent(out) :: error
        type(sparse_matrix_type) :: a
        type(sparse_lu_type) :: lu
        integer :: stat

        ! Column 3 is the sum of the others.
        a%n = 3
        a%start = [1, 3, 5, 8]
        a%row = [1, 2, 2, 3, 1, 2, 3]
        a%value = [(1.0_wp, 0.0_wp), (2.0_wp, 0.0_wp), (3.0_wp, 0.0_wp), (1.0_wp, 0.0_wp), (1.0_wp, 0.0_wp), (5.0_wp, 0.0_wp), &
            (1.0_wp, 0.0_wp)]
        call lu%factor(a, [1, 2, 3], 100, stat)
        call check_count(error, stat, 3, 'the column that is named')
        call lu%factor(a, [1, 2, 3], 100, stat, [.false., .false., .true.], 1.0e-10_wp)
        call check_count(error, stat, 0, 'status where it may be left out')
        call check_count(error, lu%rank, 2, 'rank')
        call check_count(error, size(lu%left_rows), 1, 'rows without a pivot')
    end subroutine test_dependent

    subroutine test_copies(error)
        type(error_type), allocatable, intent(out) :: error
        type(diagonal_type) :: operator
        type(krylov_type) :: krylov
        integer :: i, stat

        operator%n = 400
        operator%values = [(cmplx(1.0_wp/i, 0.0_wp, wp), i=1, 400)]
        ! Three copies of the second, two of the fourth.
        operator%values([70, 71]) = operator%values(2)
        operator%values(300) = operator%values(4)
        call krylov%find(operator, 6, 1.0e-12_wp, stat)
        call check_count(error, stat, 0, 'status')
        call check_true(error, krylov%is_complete, 'all are found')
        if (allocated(error)) return
        call check_close(error, real(krylov%values(:6), wp), [1.0_wp, 0.5_wp, 0.5_wp, 0.5_wp, 1/3.0_wp, 0.25_wp], 1.0e-13_wp, &
            'eigenvalues')
        ! The copy of the last one is included.
        call check_count(error, size(krylov%values), 7, 'eigenvalues')
    end subroutine test_copies

    subroutine test_whole_space(error)
        type(error_type), allocatable, intent(out) :: error
        type(diagonal_type) :: operator
        type(krylov_type) :: krylov
        integer :: stat

        operator%n = 3
        operator%values = [(2.0_wp, 1.0_wp), (2.0_wp, -1.0_wp), (0.5_wp, 0.0_wp)]
        call krylov%find(operator, 10, 1.0e-12_wp, stat)
        call check_count(error, stat, 0, 'status')
        call check_true(error, krylov%is_complete, 'all are found')
        call check_count(error, size(krylov%values), 3, 'eigenvalues')
        operator%n = 0
        operator%values = [complex(wp) ::]
        call krylov%find(operator, 10, 1.0e-12_wp, stat)
        call check_count(error, size(krylov%values), 0, 'eigenvalues of nothing')
    end subroutine test_whole_space

    !> Compare the eigenvalues nearest to a shift with those of the dense analysis.
    subroutine check_agreement(text, shift, k, bound, what, error)
        character(len=*), intent(in) :: text, what
        complex(wp), intent(in) :: shift
        integer, intent(in) :: k
        !> Relative.
        real(wp), intent(in) :: bound
        type(error_type), allocatable, intent(inout) :: error
        type(scene_type), target :: scene
        type(linearisation_type) :: it
        type(nearest_type) :: nearest
        type(failure_type), allocatable :: failure

        call linearise_text(text, nothing, scene, it, error)
        if (allocated(error)) return
        call nearest%find(scene%model, scene%t_start, scene%q, shift, k, failure)
        call check_no_failure(error, failure)
        if (allocated(error)) return
        call check_true(error, size(nearest%values) >= min(k, size(it%spectrum%values)), what//': as many as were asked for')
        call check_nearest(nearest, it, shift, k, [bound, 1.0e-5_wp], spread(.true., 1, size(it%spectrum%values)), what, error)
    end subroutine check_agreement

    !> Gradients are differences with some 13 digits, and the dense analysis has 12.
    subroutine test_chains(error)
        type(error_type), allocatable, intent(out) :: error

        call check_agreement(chain(7, 2, 'revolute', ''), (0.0_wp, 0.0_wp), 6, 1.0e-11_wp, 'a chain in the plane', error)
        call check_agreement(chain(7, 2, 'revolute', ''), (0.0_wp, 9.0_wp), 4, 1.0e-11_wp, 'its middle', error)
        call check_agreement(chain(7, 2, 'revolute', ''), (0.0_wp, 0.0_wp), 50, 1.0e-11_wp, 'all of it', error)
        call check_agreement(chain(6, 3, 'revolute', ''), (0.0_wp, 0.0_wp), 6, 1.0e-11_wp, 'a chain of hinges', error)
        call check_agreement(chain(1, 2, 'revolute', ''), (0.0_wp, 0.0_wp), 2, 1.0e-11_wp, 'a pendulum', error)
    end subroutine test_chains

    subroutine test_forces(error)
        type(error_type), allocatable, intent(out) :: error
        character(len=*), parameter :: forces = '[force]'//newline// &
            'far = { type = "spring", between = ["rod1", "rod5"], stiffness = 30, damping = 2, length = 4 }'//newline// &
            'bend = { type = "torsion", joint = "pin3", stiffness = 50, damping = 0.5 }'//newline// &
            'side = { type = "spring", between = ["ground:[1, -3.5]", "rod4"], stiffness = 5, damping = 0.3, length = 1 }'//newline
        character(len=*), parameter :: cart = '[scene]'//newline//'model = "mechanism"'//newline//'planar = true'//newline// &
            '[gravity]'//newline//'vector = [0, -9.81]'//newline//'[body.cart]'//newline//'mass = 2'//newline//'inertia = 1'// &
            newline//'position = [0, 0]'//newline//'[body.bob]'//newline//'mass = 1'//newline//'inertia = 0.1'//newline// &
            'position = [0, -1]'//newline//'[joint]'//newline// &
            'rail = { type = "prismatic", bodies = ["ground", "cart"], at = [0, 0], axis = [1, 0] }'//newline// &
            'pin = { type = "revolute", bodies = ["cart", "bob"], at = [0, 0] }'//newline//'[force]'//newline// &
            'hold = { type = "spring", between = ["ground:[-1, 0]", "cart"], stiffness = 20, damping = 1, length = 1 }'//newline// &
            'feed = { type = "load", on = "cart", force = ["-3*pin.angle - 0.2*pin.rate", 0] }'//newline// &
            '[time]'//newline//'end = 1'

        call check_agreement(chain(7, 2, 'revolute', forces), (0.0_wp, 0.0_wp), 8, 1.0e-10_wp, 'a chain with springs', error)
        call check_agreement(chain(7, 2, 'revolute', forces), (-1.0_wp, 12.0_wp), 3, 1.0e-10_wp, 'beside a complex shift', error)
        call check_agreement(cart, (0.0_wp, 0.0_wp), 4, 1.0e-10_wp, 'a cart that a load holds', error)
    end subroutine test_forces

    !> Angles a from the vertical: m l^2 (n - max(i, j) + 1/2) a_j'' + m l^2 (n - i + 1/3) a_i'' + m g l (n - i + 1/2) a_i = 0, and
    !> the limit of a rope, J0(2 w sqrt(L/g)) = 0.
    subroutine test_closed_form(error)
        type(error_type), allocatable, intent(out) :: error
        integer, parameter :: n = 100
        real(wp), parameter :: zeros(3) = [2.404825557695773_wp, 5.520078110286311_wp, 8.653727912911013_wp], g = 9.81_wp
        real(wp) :: squares(n), stiffness(n), found(10)
        real(wp), allocatable :: matrix(:, :)
        type(scene_type), target :: scene
        type(nearest_type) :: nearest
        type(failure_type), allocatable :: failure
        integer :: i, j

        allocate (matrix(n, n))
        do i = 1, n
            stiffness(i) = g*(n - i + 0.5_wp)
            do j = 1, n
                matrix(i, j) = n - max(i, j) + 0.5_wp
            end do
            matrix(i, i) = n - i + 1.0_wp/3
        end do
        do i = 1, n
            matrix(:, i) = matrix(:, i)/sqrt(stiffness*stiffness(i))
        end do
        squares = 0.0_wp
        call decompose_symmetric(matrix, squares)
        call read_scene('test.toml', nothing, scene, failure, text=chain(n, 2, 'revolute', ''))
        if (.not. allocated(failure)) call nearest%find(scene%model, 0.0_wp, scene%q, (0.0_wp, 0.0_wp), 20, failure)
        call check_no_failure(error, failure)
        if (allocated(error)) return
        call check_true(error, size(nearest%values) >= 20, 'ten pairs are found')
        if (allocated(error)) return
        found = aimag(pack(nearest%values(:20), aimag(nearest%values(:20)) > 0.0_wp))
        squares = 1/sqrt(squares(n:1:-1))
        ! Gradients by differences, and rounding times the condition of the closed form's matrix.
        call check_close(error, found, squares(:10), 1.0e-10_wp, 'the ten lowest frequencies')
        call check_below(error, maxval(abs(real(nearest%values(:20), wp))), 1.0e-11_wp, 'damping of a chain without any')
        ! A chain of n links differs from a rope by some j^2/n^2.
        call check_close(error, found(:3), zeros/2*sqrt(g/n), 1.0e-3_wp, 'frequencies of a rope')
    end subroutine test_closed_form

    !> Rods with two equal axes swing in two planes alike.
    subroutine test_two_ways(error)
        type(error_type), allocatable, intent(out) :: error
        type(scene_type), target :: scene
        type(nearest_type) :: two, one
        type(failure_type), allocatable :: failure
        integer :: i

        call read_scene('test.toml', nothing, scene, failure, text=chain(12, 2, 'revolute', ''))
        if (.not. allocated(failure)) call one%find(scene%model, 0.0_wp, scene%q, (0.0_wp, 0.0_wp), 6, failure)
        call check_no_failure(error, failure)
        ! Springs keep the rods from spinning about themselves, faster than they swing.
        call read_scene('test.toml', nothing, scene, failure, text=chain(12, 3, 'spherical', '[repeat.twist]'//newline// &
            'count = 11'//newline//'first = 2'//newline//'[repeat.twist.force."twist{i}"]'//newline//'type = "bushing"'//newline// &
            'between = ["rod{i - 1}", "rod{i}"]'//newline//'at = [0, 0, "1 - i"]'//newline//'axis = [0, 0, 1]'//newline// &
            'stiffness = [0, 0, 0, 0, 0, 5e3]'//newline//'[force.twist1]'//newline//'type = "bushing"'//newline// &
            'between = ["ground", "rod1"]'//newline//'at = [0, 0, 0]'//newline//'axis = [0, 0, 1]'//newline// &
            'stiffness = [0, 0, 0, 0, 0, 5e3]'))
        if (.not. allocated(failure)) call two%find(scene%model, 0.0_wp, scene%q, (0.0_wp, 0.0_wp), 12, failure)
        call check_no_failure(error, failure)
        if (allocated(error)) return
        call check_true(error, size(two%values) >= 12, 'six pairs are found')
        if (allocated(error)) return
        do i = 1, 6
            call check_count(error, count(abs(two%values(:12) - one%values(i)) < 1.0e-9_wp*abs(one%values(i))), 2, &
                'copies of an eigenvalue')
        end do
    end subroutine test_two_ways

    subroutine test_redundant(error)
        type(error_type), allocatable, intent(out) :: error
        type(scene_type), target :: scene
        type(nearest_type) :: nearest
        type(failure_type), allocatable :: failure
        character(len=*), parameter :: twice = '[joint.pin]'//newline//'type = "revolute"'//newline// &
            'bodies = ["rod2", "rod3"]'//newline//'at = [0, -2]'//newline

        call check_agreement(chain(6, 2, 'revolute', twice), (0.0_wp, 0.0_wp), 6, 1.0e-11_wp, 'a joint that is there twice', error)
        call read_scene('test.toml', nothing, scene, failure, text=chain(6, 2, 'revolute', twice))
        if (.not. allocated(failure)) call nearest%find(scene%model, 0.0_wp, scene%q, (0.0_wp, 0.0_wp), 4, failure)
        call check_no_failure(error, failure)
        call check_count(error, nearest%n_redundant, 2, 'redundant rows')
    end subroutine test_redundant

    !> Zeros of rigid motions are at the shift itself, or nearly.
    subroutine test_free(error)
        type(error_type), allocatable, intent(out) :: error
        type(scene_type), target :: scene
        type(nearest_type) :: nearest
        type(failure_type), allocatable :: failure

        call read_scene('test.toml', nothing, scene, failure, text='[scene]'//newline//'model = "mechanism"'//newline// &
            'planar = true'//newline//'[body.stone]'//newline//'mass = 1'//newline//'inertia = 1'//newline//'position = [0, 0]'// &
            newline//'[time]'//newline//'end = 1')
        if (.not. allocated(failure)) call nearest%find(scene%model, 0.0_wp, scene%q, (0.0_wp, 0.0_wp), 6, failure)
        call check_no_failure(error, failure)
        if (allocated(error)) return
        call check_true(error, abs(nearest%shift) > 0.0_wp, 'the shift is beside zero')
        ! Zeros in Jordan blocks of size 2 at a shift of 0.01: they leave the root of rounding of it.
        call check_below(error, maxval(abs(nearest%values)), 1.0e-6_wp, 'an eigenvalue')
    end subroutine test_free

    subroutine test_fixed(error)
        type(error_type), allocatable, intent(out) :: error
        type(scene_type), target :: scene
        type(nearest_type) :: nearest
        type(failure_type), allocatable :: failure

        call read_scene('test.toml', nothing, scene, failure, text='[scene]'//newline//'model = "mechanism"'//newline// &
            'planar = true'//newline//'[body.stone]'//newline//'mass = 1'//newline//'inertia = 1'//newline//'position = [0, 0]'// &
            newline//'[joint.stand]'//newline//'type = "fixed"'//newline//'bodies = ["ground", "stone"]'//newline//'at = [0, 0]'// &
            newline//'[time]'//newline//'end = 1')
        if (.not. allocated(failure)) call nearest%find(scene%model, 0.0_wp, scene%q, (0.0_wp, 0.0_wp), 6, failure)
        call check_no_failure(error, failure)
        if (allocated(error)) return
        call check_true(error, nearest%is_complete, 'all are found')
        call check_count(error, size(nearest%values), 0, 'eigenvalues')
    end subroutine test_fixed

    subroutine test_refused(error)
        type(error_type), allocatable, intent(out) :: error
        type(scene_type), target :: scene
        type(nearest_type) :: nearest
        type(failure_type), allocatable :: failure
        real(wp), allocatable :: q(:)
        real(wp) :: infinity

        call read_scene('test.toml', nothing, scene, failure, text=chain(4, 2, 'revolute', ''))
        call check_no_failure(error, failure)
        if (allocated(error)) return
        q = scene%q
        call nearest%find(scene%model, 0.0_wp, q, (0.0_wp, 0.0_wp), 0, failure)
        call check_failure(error, failure, 'invalid_option', '0 eigenvalues')
        call nearest%find(scene%model, 0.0_wp, q, (0.0_wp, 0.0_wp), 1000, failure)
        call check_failure(error, failure, 'invalid_option', '1000 eigenvalues')
        infinity = huge(infinity)
        infinity = 2*infinity
        call nearest%find(scene%model, 0.0_wp, q, cmplx(infinity, 0.0_wp, wp), 2, failure)
        call check_failure(error, failure, 'invalid_option', 'finite')
        q(1) = q(1) + 0.1_wp
        call nearest%find(scene%model, 0.0_wp, q, (0.0_wp, 0.0_wp), 2, failure)
        call check_failure(error, failure, 'inconsistent_start', 'position constraints')
        ! A wind, and a rail that moves.
        call read_scene('test.toml', [character(len=26) :: 'gravity.vector=[3, -9.81]'], scene, failure, text=chain(4, 2, &
            'revolute', ''))
        call check_no_failure(error, failure)
        call nearest%find(scene%model, 0.0_wp, scene%q, (0.0_wp, 0.0_wp), 2, failure)
        call check_failure(error, failure, 'no_equilibrium', 'unbalanced')
        call read_scene('test.toml', [character(len=26) :: 'joint.pin1.motion="0.3*t"'], scene, failure, text=chain(4, 2, &
            'revolute', ''))
        call check_no_failure(error, failure)
        call nearest%find(scene%model, 0.0_wp, scene%q, (0.0_wp, 0.0_wp), 2, failure)
        call check_failure(error, failure, 'no_equilibrium', 'moves it')
    end subroutine test_refused

    !> A spring that the model does not declare.
    subroutine test_unnamed(error)
        type(error_type), allocatable, intent(out) :: error
        type(scene_type), target :: scene
        type(nearest_type) :: nearest
        type(failure_type), allocatable :: failure
        character(len=*), parameter :: spring = '[force]'//newline// &
            'far = { type = "spring", between = ["rod1", "rod4"], stiffness = 30, length = 3 }'//newline

        call read_scene('test.toml', nothing, scene, failure, text=chain(6, 2, 'revolute', spring))
        call check_no_failure(error, failure)
        if (allocated(error)) return
        deallocate (scene%model%pattern%coupled)
        call nearest%find(scene%model, 0.0_wp, scene%q, (0.0_wp, 0.0_wp), 2, failure)
        call check_failure(error, failure, 'invalid_model', 'neighbours')
        deallocate (scene%model%pattern)
        call nearest%find(scene%model, 0.0_wp, scene%q, (0.0_wp, 0.0_wp), 2, failure)
        call check_failure(error, failure, 'invalid_model', 'which rows')
    end subroutine test_unnamed

    !> Wind on a hanging chain: all rods point along the sum of wind and gravity.
    subroutine test_rest(error)
        type(error_type), allocatable, intent(out) :: error
        integer, parameter :: n = 100
        type(scene_type), target :: scene
        type(equilibrium_search_type) :: search
        type(failure_type), allocatable :: failure
        real(wp) :: angle
        integer :: i

        call read_scene('test.toml', [character(len=26) :: 'gravity.vector=[3, -9.81]'], scene, failure, text=chain(n, 2, &
            'revolute', ''))
        if (.not. allocated(failure)) call search%find_equilibrium(scene%model, 0.0_wp, scene%q, failure)
        call check_no_failure(error, failure)
        if (allocated(error)) return
        angle = atan2(3.0_wp, 9.81_wp)
        do i = 1, n
            call check_close(error, search%q(3*i - 2:3*i), [(i - 0.5_wp)*sin(angle), -(i - 0.5_wp)*cos(angle), angle], &
                1.0e-9_wp, 'a rod')
        end do
    end subroutine test_rest

    !> Rotations of bodies by Euler parameters are those about the hinges, with consistent displacements.
    subroutine test_body_motions(error)
        type(error_type), allocatable, intent(out) :: error
        type(scene_type), target :: scene
        type(nearest_type) :: nearest
        type(failure_type), allocatable :: failure
        complex(wp), allocatable :: motions(:, :)
        complex(wp) :: place
        integer :: i

        call read_scene('test.toml', nothing, scene, failure, text=chain(5, 3, 'revolute', ''))
        if (.not. allocated(failure)) call nearest%find(scene%model, 0.0_wp, scene%q, (0.0_wp, 0.0_wp), 4, failure)
        call check_no_failure(error, failure)
        if (allocated(error)) return
        call body_motions(scene%model, nearest%q, nearest%shapes, motions)
        place = (0.0_wp, 0.0_wp)
        do i = 1, 5
            associate (motion => motions(6*i - 5:6*i, 1))
                ! A rotation by r about y moves the centre of mass, half a rod below its pin, by -r/2.
                call check_below(error, abs(motion(1) - (place - motion(5)/2)), 1.0e-11_wp, 'a place that goes with its turn')
                call check_below(error, maxval(abs(motion([2, 3, 4, 6]))), 1.0e-11_wp, 'a motion out of the plane')
                place = place - motion(5)
            end associate
        end do
        call check_true(error, abs(place) > 0.5_wp, 'the end moves')
    end subroutine test_body_motions
end module test_nearest
