! SPDX-License-Identifier: MIT
!> Tests of eigenvalues against small motions: Floquet multipliers of the variational equations, and simulated motions.
module test_small_motions
    use asserts, only: check_below, check_failure, check_no_failure, check_true
    use linearised, only: linearise_scene, linearise_text
    use tandem, only: failure_type => error_type, floquet_type, linearisation_type, of_motion, options_type, simulation_type, wp
    use tandem_analysis_floquet, only: exponential
    use tandem_chart, only: step_end
    use tandem_chart_dense, only: dense_chart_type
    use tandem_io, only: scene_type
    use tandem_linalg_eigenvalues, only: find_eigenvalues
    use testdrive, only: error_type, new_unittest, unittest_type
    implicit none (type, external)
    private

    public :: collect_small_motions

    character(len=*), parameter :: nl = new_line('a')
    !> A sleigh that goes straight, and a top that precesses steadily, both as in the suite of linearised systems.
    character(len=*), parameter :: sleigh = '[scene]'//nl//'model = "mechanism"'//nl//'planar = true'//nl// &
        '[body.sleigh]'//nl//'mass = 1'//nl//'inertia = 0.1'//nl//'position = [0, 0]'//nl//'velocity = [2, 0]'//nl// &
        'points = { blade = [-0.1, 0] }'//nl//'[wheel.blade]'//nl//'type = "knife_edge"'//nl//'at = "sleigh.blade"'//nl// &
        'across = [0, 1]'//nl//'[time]'//nl//'end = 1'//nl
    character(len=*), parameter :: top = '[scene]'//nl//'model = "mechanism"'//nl//'[gravity]'//nl//'vector = [0, 0, -9.81]'//nl// &
        '[body.top]'//nl//'mass = 2'//nl//'inertia = [0.1, 0.1, 0.06]'//nl//'position = ["0.4*sin(0.6)", 0, "0.4*cos(0.6)"]'//nl// &
        'rotation = [0, 0.6, 0]'//nl//'velocity = [0, "0.52*sin(0.6)", 0]'//nl//'omega = ["100*sin(0.6)", 0, '// &
        '"1.3 + 100*cos(0.6)"]'//nl//'[joint.tip]'//nl//'type = "spherical"'//nl//'bodies = ["ground", "top"]'//nl// &
        'at = [0, 0, 0]'//nl//'[initial]'//nl//'steady = ["world.rotation_z", "top.spin_z"]'//nl//'[time]'//nl//'end = 1'//nl

    character(len=10), parameter :: subjects(6) = [character(len=10) :: 'bicycle', 'disk', 'sleigh', 'top', 'rattleback', &
        'governor']

contains

    !> The suite.
    subroutine collect_small_motions(testsuite)
        type(unittest_type), allocatable, intent(out) :: testsuite(:)

        testsuite = [ &
            new_unittest('multipliers-agree-with-eigenvalues', test_multipliers), &
            new_unittest('multipliers-of-a-swing-agree-with-its-energy', test_swing), &
            new_unittest('simulated-motions-grow-and-turn-as-eigenvalues-say', test_fits)]
    end subroutine collect_small_motions

    !> A subject in its steady motion.
    subroutine get_subject(name, scene, it, error)
        character(len=*), intent(in) :: name
        type(scene_type), intent(inout), target :: scene
        type(linearisation_type), intent(inout) :: it
        type(error_type), allocatable, intent(inout) :: error
        character(len=1), parameter :: nothing(0) = [character(len=1) ::]

        select case (name)
        case ('bicycle')
            call linearise_scene('bicycle', [character(len=20) :: 'parameters.speed=4', 'parameters.push=0'], scene, it, error)
        case ('disk')
            call linearise_scene('mechanism_disk', [character(len=40) :: 'body.disk.omega=[-1.9,0,0]', &
                'body.disk.velocity=[0,1.9,0]'], scene, it, error)
        case ('sleigh')
            call linearise_text(sleigh, nothing, scene, it, error)
        case ('top')
            call linearise_text(top, nothing, scene, it, error)
        case ('rattleback')
            call linearise_scene('rattleback', ['parameters.a=0'], scene, it, error)
        case default
            call linearise_scene('a05_governor', ['initial.steady=["world.rotation_z"]'], scene, it, error)
        end select
    end subroutine get_subject

    !> exp(lambda tau) against the multipliers, to 1e-10 of the largest: the variational equations are integrated to 1e-13 per step,
    !> and their eigenvectors are far from orthogonal.
    subroutine test_multipliers(error)
        type(error_type), allocatable, intent(out) :: error
        real(wp), parameter :: periods(6) = [0.5_wp, 0.5_wp, 0.5_wp, 0.1_wp, 0.02_wp, 0.01_wp]
        type(scene_type), allocatable, target :: scene
        type(linearisation_type) :: it
        type(floquet_type) :: floquet
        type(failure_type), allocatable :: failure
        complex(wp) :: expected
        integer :: k, i

        do k = 1, size(subjects)
            if (allocated(scene)) deallocate (scene)
            allocate (scene)
            call get_subject(subjects(k), scene, it, error)
            if (allocated(error)) return
            call floquet%find(it, scene%model, periods(k), failure)
            call check_no_failure(error, failure)
            if (allocated(error)) return
            do i = 1, size(it%spectrum%values)
                if (it%spectrum%cause(i) /= of_motion) cycle
                expected = exp(it%spectrum%values(i)*periods(k))
                call check_below(error, minval(abs(floquet%multipliers - expected))/max(1.0_wp, abs(expected)), 1.0e-10_wp, &
                    trim(subjects(k))//': multiplier')
            end do
        end do
        ! A disturbed motion is not periodic.
        call linearise_scene('mechanism_disk', [character(len=1) ::], scene, it, error)
        if (allocated(error)) return
        call floquet%find(it, scene%model, 0.5_wp, failure)
        call check_failure(error, failure, 'invalid_option', 'is not periodic')
    end subroutine test_multipliers

    !> A pendulum that swings through 60 degrees is periodic without a named motion: both multipliers are 1, in a Jordan block whose
    !> entry is the derivative of the period with respect to the energy. The computed eigenvalues are 1 +- the root of the error.
    subroutine test_swing(error)
        type(error_type), allocatable, intent(out) :: error
        !> 4 K(sin(30 degrees)) sqrt(l/g), by the arithmetic-geometric mean.
        real(wp) :: period, a, b, c
        type(scene_type), target :: scene
        type(linearisation_type) :: it
        type(floquet_type) :: floquet
        type(failure_type), allocatable :: failure
        integer :: i

        a = 1.0_wp
        b = cos(acos(-1.0_wp)/6)
        do i = 1, 6
            c = (a + b)/2
            b = sqrt(a*b)
            a = c
        end do
        period = 2*acos(-1.0_wp)/a/sqrt(9.81_wp)
        call linearise_scene('a01_pendulum', ['body.bob.position=["sin(pi/3)", "-cos(pi/3)"]'], scene, it, error)
        if (allocated(error)) return
        call floquet%find(it, scene%model, period, failure)
        call check_no_failure(error, failure)
        if (allocated(error)) return
        call check_below(error, floquet%gap, 1.0e-11_wp, 'gap after the period')
        call check_below(error, abs(product(floquet%multipliers) - 1), 1.0e-11_wp, 'product, as energy stays')
        call check_below(error, maxval(abs(floquet%multipliers - 1)), 1.0e-5_wp, 'multipliers')
    end subroutine test_swing

    !> Motions slightly to either side of a steady one: half their difference, projected onto a left eigenvector in the co-rotating
    !> frame, is a constant times exp(lambda t). A line through its logarithms has the slope lambda to 1e-7 of its size:
    !> displacements of 3e-5 cause errors of some tens of their square, steps with a tolerance of 1e-12 that over 3e-5.
    subroutine test_fits(error)
        type(error_type), allocatable, intent(out) :: error
        type(scene_type), allocatable, target :: scene
        type(linearisation_type) :: it
        integer :: k, i

        do k = 1, 5
            if (allocated(scene)) deallocate (scene)
            allocate (scene)
            call get_subject(subjects(k), scene, it, error)
            if (allocated(error)) return
            ! The mode with the largest growth, or the smallest decay.
            i = findloc(it%spectrum%cause, of_motion, dim=1, back=.true.)
            call fit(scene, it, i, trim(subjects(k)), error)
            if (allocated(error)) return
        end do
    end subroutine test_fits

    !> The same of one mode.
    subroutine fit(scene, it, mode, name, error)
        type(scene_type), intent(inout), target :: scene
        type(linearisation_type), intent(in) :: it
        integer, intent(in) :: mode
        character(len=*), intent(in) :: name
        type(error_type), allocatable, intent(inout) :: error
        integer, parameter :: n_times = 8
        real(wp), dimension(size(it%q), n_times, 2) :: q, qd
        complex(wp) :: left(it%nv + it%nw), amplitude, last, slope
        complex(wp) :: logarithm(n_times)
        real(wp) :: t(n_times), turn(size(it%q), size(it%q)), span, small
        integer :: i

        associate (lambda => it%spectrum%values(mode), n => size(it%q))
            ! The contact of the rattleback moves along the stone within a tenth of a unit.
            small = merge(1.0e-5_wp, 3.0e-5_wp, name == 'rattleback')
            call get_left_eigenvector(it%a, lambda, left)
            ! About one turn, or a growth by about e.
            span = 2/abs(lambda)
            t = [(span*i/n_times, i=1, n_times)]
            call simulate(scene, it, mode, small, t, q(:, :, 1), qd(:, :, 1), error)
            call simulate(scene, it, mode, -small, t, q(:, :, 2), qd(:, :, 2), error)
            if (allocated(error)) return
            last = (0.0_wp, 0.0_wp)
            do i = 1, n_times
                turn = exponential(-t(i)*it%symmetry%matrix(it%rates, n))
                associate (x => matmul(turn, q(:, i, 1) - q(:, i, 2)), y => matmul(turn, qd(:, i, 1) - qd(:, i, 2)))
                    amplitude = dot_product(left, cmplx([matmul(it%dual_v, x), matmul(it%dual_w, y)], 0.0_wp, wp))
                end associate
                logarithm(i) = log(amplitude)
                ! Continue on the branch of the last one.
                if (i > 1) logarithm(i) = last + log(amplitude/exp(last))
                last = logarithm(i)
            end do
            slope = sum((t - sum(t)/n_times)*logarithm)/sum((t - sum(t)/n_times)**2)
            call check_below(error, abs(slope - lambda)/abs(lambda), 1.0e-7_wp, name//': slope of the logarithm')
        end associate
    end subroutine fit

    !> l with l' A = lambda l', conjugated as `dot_product` takes it.
    subroutine get_left_eigenvector(a, lambda, left)
        real(wp), intent(in) :: a(:, :)
        complex(wp), intent(in) :: lambda
        complex(wp), intent(out) :: left(:)
        complex(wp) :: values(size(a, 1)), vectors(size(a, 1), size(a, 1))
        real(wp) :: condition(size(a, 1))
        integer :: stat

        call find_eigenvalues(transpose(a), values, vectors, condition, stat)
        if (stat /= 0) error stop 'get_left_eigenvector: no convergence'
        left = conjg(vectors(:, minloc(abs(values - lambda), dim=1)))
    end subroutine get_left_eigenvector

    !> Start next to the steady motion along a mode, and continue to given times.
    subroutine simulate(scene, it, mode, small, t, q, qd, error)
        type(scene_type), intent(inout), target :: scene
        type(linearisation_type), intent(in) :: it
        integer, intent(in) :: mode
        real(wp), intent(in) :: small, t(:)
        real(wp), intent(out) :: q(:, :), qd(:, :)
        type(error_type), allocatable, intent(inout) :: error
        type(dense_chart_type) :: chart
        type(options_type) :: options
        type(simulation_type), allocatable :: simulation
        type(failure_type), allocatable :: failure
        real(wp), dimension(size(it%q)) :: x, y, move, move_qd
        integer :: i, stat

        if (allocated(error)) return
        call chart%attach(scene%model, options, .false., .false., failure)
        call check_no_failure(error, failure)
        if (allocated(error)) return
        x = it%q
        y = it%qd
        move = 0.0_wp
        call chart%set_origin(0.0_wp, x, y, .false., move, stat)
        move = small*real(it%spectrum%shapes(:, mode), wp)
        move_qd = small*matmul(it%w, matmul(it%dual_w, real(it%spectrum%rates(:, mode), wp)))
        call chart%restore(0.0_wp, move, move_qd, step_end, x, y, stat)
        call check_true(error, stat == 0, 'a state beside the steady motion')
        options%stepper = 'dop853'
        options%rtol = 1.0e-12_wp
        options%atol = 1.0e-13_wp
        allocate (simulation)
        call simulation%initialize(scene%model, options, 0.0_wp, x, y, failure)
        do i = 1, size(t)
            if (.not. allocated(failure)) call simulation%integrate(t(i), failure)
            q(:, i) = simulation%state%q
            qd(:, i) = simulation%state%qd
        end do
        call check_no_failure(error, failure)
    end subroutine simulate
end module test_small_motions
