! SPDX-License-Identifier: MIT
!> Tests of the sparse chart with friction on reactions, coordinates without mass, redundant rows at velocity level and couplings
!> that can be freed: motions, multipliers and continued runs, against the dense chart.
module test_sparse_features
    use asserts, only: check_below, check_close, check_count, check_failure, check_no_failure, check_true
    use large_runs, only: controlled, go_on
    use tandem, only: failure_type => error_type, long, options_type, simulation_type, statistics_type, wp
    use tandem_chart_sparse_system, only: system_type
    use tandem_io, only: find_scene, read_scene, scene_type
    use tandem_model_counts, only: counts_type
    use testdrive, only: error_type, new_unittest, unittest_type
    implicit none (type, external)
    private

    public :: collect_sparse_features

    character(len=*), parameter :: nl = new_line('a')
    character(len=*), parameter :: head = '[scene]'//nl//'model = "mechanism"'//nl//'[gravity]'//nl// &
        'vector = [0.3, 0.2, -9.81]'//nl//'[initial]'//nl//'assemble = true'//nl//'[time]'//nl//'end = 0.3'//nl

    !> Two links and a slider, each joint with friction on its reaction.
    character(len=*), parameter :: rubbing = head// &
        '[body.one]'//nl//'mass = 1'//nl//'inertia = [0.1, 0.2, 0.15]'//nl//'position = [0.4, 0.1, 0]'//nl// &
        'omega = [0.3, 0.9, 3]'//nl// &
        '[body.two]'//nl//'mass = 0.8'//nl//'inertia = [0.1, 0.12, 0.09]'//nl//'position = [1.1, 0.5, 0.1]'//nl// &
        '[body.three]'//nl//'mass = 0.6'//nl//'inertia = [0.05, 0.04, 0.06]'//nl//'position = [1.4, 0.9, 0.3]'//nl// &
        'velocity = [2, 0, 0]'//nl// &
        '[joint.a]'//nl//'type = "revolute"'//nl//'bodies = ["ground", "one"]'//nl//'at = [0, 0, 0]'//nl//'axis = [0.1, 0.3, 1]'// &
        nl//'[joint.b]'//nl//'type = "revolute"'//nl//'bodies = ["one", "two"]'//nl//'at = [0.8, 0.3, 0.1]'//nl// &
        'axis = [0, 1, 0.4]'//nl// &
        '[joint.c]'//nl//'type = "prismatic"'//nl//'bodies = ["two", "three"]'//nl//'at = [1.2, 0.7, 0.2]'//nl// &
        'axis = [1, 0.2, 0.1]'//nl// &
        '[force.fa]'//nl//'type = "friction"'//nl//'joint = "a"'//nl//'dynamic = 0.3'//nl//'speed = 1.3'//nl//'static = 0.6'//nl// &
        'radius = 0.1'//nl//'[force.fb]'//nl//'type = "friction"'//nl//'joint = "b"'//nl//'dynamic = 0.3'//nl//'speed = 0.7'//nl// &
        'radius = 0.15'//nl//'arm = 0.5'//nl//'[force.fc]'//nl//'type = "friction"'//nl//'joint = "c"'//nl//'dynamic = 0.3'//nl// &
        'speed = 0.9'//nl//'arm = 0.8'//nl//'[force.coil]'//nl//'type = "torsion"'//nl//'joint = "c"'//nl//'stiffness = 40'//nl

    !> A cart with a load on two wheels, each on a strut with a spring: the displacements have no mass.
    character(len=*), parameter :: strut = 'type = "massless"'//nl//'radius = 0.3'//nl//'axis = [0, 1, 0]'//nl// &
        'along = [0, 0, -1]'//nl//'at = '
    character(len=*), parameter :: cart_on_struts = head//'[body.cart]'//nl//'mass = 200'//nl//'inertia = [30, 60, 70]'//nl// &
        'position = [0, 0, 0.5]'//nl//'velocity = [5, 0, 0]'//nl//'omega = [0.02, 0.1, 0.2]'//nl// &
        '[body.load]'//nl//'mass = 5'//nl//'inertia = [0.3, 0.4, 0.5]'//nl//'position = [0.3, 0.2, 1.2]'//nl// &
        '[joint.pole]'//nl//'type = "spherical"'//nl//'bodies = ["cart", "load"]'//nl//'at = [0.1, 0.1, 0.8]'//nl// &
        '[wheel.front]'//nl//strut//'"cart:[1, 0, -0.2]"'//nl//'[wheel.left]'//nl//strut//'"cart:[-1, 0.6, -0.2]"'//nl// &
        '[force.front_spring]'//nl//'type = "torsion"'//nl//'joint = "front"'//nl//'stiffness = 2e4'//nl//'damping = 1e3'//nl// &
        '[force.left_spring]'//nl//'type = "torsion"'//nl//'joint = "left"'//nl//'stiffness = 2e4'//nl//'damping = 1e3'//nl

    !> Knife edges along one line repeat each other, and a row at velocity level repeats a guide.
    character(len=*), parameter :: skates = head// &
        '[body.sled]'//nl//'mass = 3'//nl//'inertia = [0.3, 0.4, 0.5]'//nl//'position = [0, 0, 0]'//nl// &
        'omega = [0, 0, 1.5]'//nl// &
        'velocity = [0, 2, 0]'//nl//'[joint.floor]'//nl//'type = "planar"'//nl//'bodies = ["ground", "sled"]'//nl// &
        'at = [0, 0, 0]'//nl//'axis = [0, 0, 1]'//nl// &
        '[wheel.one]'//nl//'type = "knife_edge"'//nl//'at = "sled:[0.2, 0, 0]"'//nl//'across = [1, 0, 0]'//nl// &
        '[wheel.two]'//nl//'type = "knife_edge"'//nl//'at = "sled:[0.2, 0.5, 0]"'//nl//'across = [1, 0, 0]'//nl// &
        '[wheel.three]'//nl//'type = "knife_edge"'//nl//'at = "sled:[-0.4, 0.5, 0]"'//nl//'across = [1, 0, 0]'//nl// &
        '[body.arm]'//nl//'mass = 1'//nl//'inertia = [0.1, 0.1, 0.1]'//nl//'position = [0, 0, -0.5]'//nl// &
        'omega = [1, 0, 1.5]'//nl// &
        'velocity = [0, 2, 0]'//nl//'[joint.pin]'//nl//'type = "spherical"'//nl//'bodies = ["sled", "arm"]'//nl// &
        'at = [0, 0, 0]'//nl// &
        '[constraint.again]'//nl//'type = "velocity"'//nl//'velocities = ["sled.vz"]'//nl//'coefficients = [1]'//nl

    !> A double pendulum whose elbow is locked.
    character(len=*), parameter :: locked = head// &
        '[body.upper]'//nl//'mass = 1'//nl//'inertia = [0.1, 0.1, 0.1]'//nl//'position = [0.1, 0, -0.5]'//nl// &
        'omega = [1, 1, 0]'//nl//'[joint.shoulder]'//nl//'type = "universal"'//nl//'bodies = ["ground", "upper"]'//nl// &
        'at = [0, 0, 0]'//nl// &
        'axis = [1, 0, 0]'//nl//'across = [0, 1, 0]'//nl// &
        '[body.lower]'//nl//'mass = 0.7'//nl//'inertia = [0.05, 0.06, 0.05]'//nl//'position = [0.3, 0, -1.4]'//nl// &
        '[joint.elbow]'//nl//'type = "revolute"'//nl//'bodies = ["upper", "lower"]'//nl//'at = [0.2, 0, -1]'//nl// &
        'axis = [0, 1, 0]'//nl// &
        '[constraint.latch]'//nl//'type = "coupling"'//nl//'joints = ["elbow"]'//nl//'factors = [1]'//nl//'locked = '

contains

    !> The suite.
    subroutine collect_sparse_features(testsuite)
        type(unittest_type), allocatable, intent(out) :: testsuite(:)

        testsuite = [ &
            new_unittest('friction-on-reactions', test_friction), &
            new_unittest('coordinates-without-mass', test_massless), &
            new_unittest('bodies-without-mass', test_hinges), &
            new_unittest('unbalanced-forces-of-bodies-without-mass', test_unbalanced), &
            new_unittest('points-within-steps-beside-bodies-without-mass', test_looks), &
            new_unittest('bodies-without-mass-come-to-rest', test_rest), &
            new_unittest('a-load-far-from-a-body-without-mass', test_far_load), &
            new_unittest('a-small-load-on-two-slides', test_small_load), &
            new_unittest('a-body-without-mass-that-turns-freely-is-refused', test_free_body), &
            new_unittest('redundant-rows-at-velocity-level', test_redundant), &
            new_unittest('couplings-that-can-be-freed', test_coupling), &
            new_unittest('a-stiff-mechanism-that-turns-costs-no-steps', test_governor)]
    end subroutine collect_sparse_features

    subroutine test_friction(error)
        type(error_type), allocatable, intent(out) :: error

        call compare(rubbing, 0, error)
    end subroutine test_friction

    subroutine test_massless(error)
        type(error_type), allocatable, intent(out) :: error

        call compare(cart_on_struts, 0, error)
    end subroutine test_massless

    !> Each of three links has three hinges with two bodies without mass between them, 42 coordinates in all.
    subroutine test_hinges(error)
        type(error_type), allocatable, intent(out) :: error

        call compare(hinges(), 0, error)
    end subroutine test_hinges

    !> Their text.
    pure function hinges() result(text)
        character(len=:), allocatable :: text
        character(len=*), parameter :: axes(3) = [character(len=11) :: '[0, 0.6, 1]', '[0, 1, 0.3]', '[1, 0.2, 0]']
        character(len=:), allocatable :: last, next
        character(len=1) :: link, number
        integer :: i, k

        text = head
        last = 'ground'
        do k = 1, 3
            write (link, '(i1)') k
            do i = 1, 3
                write (number, '(i1)') i
                next = 'b'//link//number
                text = text//'[body.'//next//']'//nl
                if (i < 3) then
                    text = text//'mass = 0'//nl//'inertia = [0, 0, 0]'//nl//'position = ['//link//', 0, 0]'//nl
                else
                    text = text//'mass = 1.5'//nl//'inertia = [0.02, 0.1, 0.08]'//nl//'position = ['//link//'.5, 0, 0]'//nl
                end if
                text = text//'[joint.j'//link//number//']'//nl//'type = "revolute"'//nl//'bodies = ["'//last//'", "'//next// &
                    '"]'//nl//'at = ['//link//', 0, 0]'//nl//'axis = '//axes(i)//nl//'[force.f'//link//number//']'//nl// &
                    'type = "torsion"'//nl//'joint = "j'//link//number//'"'//nl//'stiffness = 5'//nl//'damping = 0.2'//nl
                last = next
            end do
        end do
    end function hinges

    !> A solution of low accuracy leaves unbalanced forces on coordinates without mass alone.
    subroutine test_unbalanced(error)
        type(error_type), allocatable, intent(out) :: error
        type(scene_type), target :: scene
        type(failure_type), allocatable :: failure
        type(system_type) :: system
        type(counts_type) :: counts
        real(wp), allocatable :: qdd(:), left(:)
        integer :: stat

        call read_scene('test.toml', [character(len=1) ::], scene, failure, text=hinges())
        call check_no_failure(error, failure)
        if (allocated(error)) return
        call system%initialize(scene%model, .false.)
        call system%move_with(0.0_wp, scene%q, scene%qd, counts, stat)
        call system%factorize(counts, stat)
        call check_count(error, stat, 0, 'the status')
        if (allocated(error)) return
        qdd = scene%q
        left = scene%q
        system%g(:) = -system%model%terms%gamma
        associate (force => system%model%terms%force)
            call system%solve_here(force, system%g, qdd, system%z, 1.0_wp, .true., stat)
            call system%factor(system%here)%find_unbalanced(system%analysis, system%model%terms%mass, force, qdd, system%z, left)
            call check_true(error, maxval(abs(left(system%massless))) > 1.0e-12_wp*maxval(abs(force)), 'nothing is left')
            left(system%massless) = 0.0_wp
            ! Rounding of reactions, which are as large as the forces.
            call check_close(error, left, 0.0_wp*left, 1.0e-13_wp*maxval(abs(force)), 'forces on other coordinates')
        end associate
    end subroutine test_unbalanced

    !> Points within a step leave no trace in later steps.
    subroutine test_looks(error)
        type(error_type), allocatable, intent(out) :: error
        type(scene_type), target :: scenes(2)
        type(simulation_type) :: looking, blind
        type(failure_type), allocatable :: failure
        integer :: k, step
        integer, parameter :: n_looks = 8

        call begin(hinges(), controlled(1.0e-6_wp, 'sparse'), scenes(1), looking, error)
        call begin(hinges(), controlled(1.0e-6_wp, 'sparse'), scenes(2), blind, error)
        if (allocated(error)) return
        do step = 1, 6
            call looking%step(1.0_wp, failure)
            call check_no_failure(error, failure)
            call blind%step(1.0_wp, failure)
            call check_no_failure(error, failure)
            do k = 1, n_looks
                call looking%look_at(blind%state%t - looking%last_step*(1 - real(k, wp)/(n_looks + 1)), failure)
                call check_no_failure(error, failure)
                if (allocated(error)) return
            end do
            call looking%look_back()
        end do
        call check_true(error, all(abs(looking%state%q - blind%state%q) <= 0.0_wp), 'a look changes the steps')
    end subroutine test_looks

    !> Two slides with a body without mass between them, across gravity: accelerations decay until their squares underflow, or are
    !> rounding.
    subroutine test_rest(error)
        type(error_type), allocatable, intent(out) :: error
        real(wp), parameter :: speeds(2) = [0.09918737534611899_wp, -0.9448817735138633_wp]
        type(options_type) :: options

        call go_straight(controlled(1.0e-6_wp, 'sparse', 'auto'), 0*speeds, 1.0_wp, error)
        options = options_type(stepper='rk4', step=1.0e-9_wp, chart_kind='sparse')
        if (.not. allocated(error)) call go_straight(options, speeds, 1.0e-9_wp, error)
    end subroutine test_rest

    !> A load on two slides keeps its velocity, within ten constraint tolerances.
    subroutine go_straight(options, speeds, t_end, error)
        type(options_type), intent(in) :: options
        real(wp), intent(in) :: speeds(2), t_end
        type(error_type), allocatable, intent(out) :: error
        type(scene_type), target :: scene
        type(simulation_type) :: run
        type(failure_type), allocatable :: failure
        character(len=80) :: velocity(2)

        write (velocity(1), '(a, f20.16, a)') 'velocity = [', speeds(1), ', 0, 0]'
        write (velocity(2), '(a, 2(f20.16, a))') 'velocity = [', speeds(1), ',', speeds(2), ', 0]'
        call read_scene('test.toml', [character(len=1) ::], scene, failure, text='[scene]'//nl//'model = "mechanism"'//nl// &
            '[gravity]'//nl//'vector = [0, 0, -9.81]'//nl//'[time]'//nl//'end = 1'//nl// &
            '[body.between]'//nl//'mass = 0'//nl//'inertia = [0, 0, 0]'//nl//'position = [0.2535131086748066, 0, 0]'//nl// &
            trim(velocity(1))//nl//'[body.load]'//nl//'mass = 1'//nl//'inertia = [1, 1, 1]'//nl// &
            'position = [0.2535131086748066, 0.03814331321927822, 0]'//nl//trim(velocity(2))//nl// &
            '[joint.x]'//nl//'type = "prismatic"'//nl//'bodies = ["ground", "between"]'//nl//'at = [0, 0, 0]'//nl// &
            'axis = [1, 0, 0]'//nl//'[joint.y]'//nl//'type = "prismatic"'//nl//'bodies = ["between", "load"]'//nl// &
            'at = [0.2535131086748066, 0, 0]'//nl//'axis = [0, 1, 0]'//nl)
        call check_no_failure(error, failure)
        if (allocated(error)) return
        call run%initialize(scene%model, options, scene%t_start, scene%q, scene%qd, failure, scene%assembly)
        call check_no_failure(error, failure)
        call go_on(run, t_end, error)
        if (.not. allocated(error)) call check_close(error, run%state%q, scene%q + t_end*scene%qd, 1.0e-11_wp, 'q')
    end subroutine go_straight

    !> A slide without mass with a load on a hinge, far from its centre of mass, so that the reactions are far larger than the
    !> forces that are left: accelerations as on the dense chart.
    subroutine test_far_load(error)
        type(error_type), allocatable, intent(out) :: error
        type(scene_type), target :: scene
        type(simulation_type) :: run
        type(failure_type), allocatable :: failure
        real(wp), allocatable :: expected(:)
        character(len=80) :: state
        real(wp) :: angle
        integer :: k

        do k = 1, 10
            angle = 0.03_wp*real(k, wp)**2 - 1
            write (state, '(a, 3(f19.16, a))') 'position = [', cos(angle), ', 0, ', -sin(angle), ']'
            call read_scene('test.toml', [character(len=1) ::], scene, failure, text= &
                '[scene]'//nl//'model = "mechanism"'//nl//'[time]'//nl//'end = 1'//nl// &
                '[gravity]'//nl//'vector = [0, 0, -9.81]'//nl// &
                '[body.slide]'//nl//'mass = 0'//nl//'inertia = [0, 0, 0]'//nl//'position = [0, 0, 0]'//nl// &
                'velocity = [0, 0, 0.1]'//nl// &
                '[body.load]'//nl//'mass = 1'//nl//'inertia = [0.006, 0.007, 0.008]'//nl//trim(state)//nl// &
                'velocity = [0, 0, 0.1]'//nl// &
                '[joint.guide]'//nl//'type = "prismatic"'//nl//'bodies = ["ground", "slide"]'//nl//'at = [0, 0, 0]'//nl// &
                'axis = [0, 0, 1]'//nl//'[joint.hinge]'//nl//'type = "revolute"'//nl//'bodies = ["slide", "load"]'//nl// &
                'at = [0, 0, 0]'//nl//'axis = [0, 1, 0]'//nl)
            call check_no_failure(error, failure)
            if (allocated(error)) return
            call run%initialize(scene%model, controlled(1.0e-6_wp, 'dense', 'dop853'), scene%t_start, scene%q, scene%qd, failure)
            call check_no_failure(error, failure)
            expected = run%state%qdd
            call run%initialize(scene%model, controlled(1.0e-6_wp, 'sparse', 'dop853'), scene%t_start, scene%q, scene%qd, failure)
            call check_no_failure(error, failure)
            if (.not. allocated(error)) call check_close(error, run%state%qdd, expected, 1.0e-11_wp, 'qdd '//trim(state))
            if (allocated(error)) return
        end do
    end subroutine test_far_load

    !> A load of small inertia on two slides with dampers, which are couplings with a sum without mass: closed forms.
    subroutine test_small_load(error)
        type(error_type), allocatable, intent(out) :: error
        real(wp), parameter :: mass = 0.3_wp, speeds(2) = [0.1_wp, -0.7_wp]
        type(scene_type), target :: scene
        type(simulation_type) :: run
        character(len=:), allocatable :: text
        character(len=1) :: axis
        integer :: k

        text = '[scene]'//nl//'model = "mechanism"'//nl//'[time]'//nl//'end = 1'//nl// &
            '[body.between]'//nl//'mass = 0'//nl//'inertia = [0, 0, 0]'//nl//'position = [0.25, 0, 0.01]'//nl// &
            'velocity = [0.1, 0, 0]'//nl// &
            '[body.load]'//nl//'mass = 0.3'//nl//'inertia = [1.2e-5, 1.2e-5, 1.2e-5]'//nl//'position = [0.25, 0.2, 0.01]'//nl// &
            'velocity = [0.1, -0.7, 0]'//nl// &
            '[joint.x]'//nl//'type = "prismatic"'//nl//'bodies = ["ground", "between"]'//nl//'at = [0, 0, 0.01]'//nl// &
            'axis = [1, 0, 0]'//nl//'[joint.y]'//nl//'type = "prismatic"'//nl//'bodies = ["between", "load"]'//nl// &
            'at = [0.25, 0, 0.01]'//nl//'axis = [0, 1, 0]'//nl
        do k = 1, 2
            axis = 'xy'(k:k)
            text = text//'[constraint.s'//axis//']'//nl//'type = "coupling"'//nl//'joints = ["'//axis//'"]'//nl//'factors = [1]'// &
                nl//'inertia = 0'//nl//'[force.f'//axis//']'//nl//'type = "torsion"'//nl//'joint = "s'//axis//'"'//nl// &
                'damping = 1'//nl
        end do
        call begin(text, controlled(1.0e-6_wp, 'sparse', 'dop853'), scene, run, error)
        if (allocated(error)) return
        ! Rounding of the factor, whose smallest pivot is 2e-8 of the row.
        call check_close(error, run%state%qdd(8:9), -speeds/mass, 1.0e-12_wp, 'accelerations')
    end subroutine test_small_load

    !> Without forces it would not move: the start is refused nevertheless.
    subroutine test_free_body(error)
        type(error_type), allocatable, intent(out) :: error
        type(scene_type), target :: scene
        type(simulation_type) :: simulation
        type(failure_type), allocatable :: failure
        type(options_type) :: options

        call read_scene('test.toml', [character(len=1) ::], scene, failure, text=head//'[body.ring]'//nl//'mass = 0'//nl// &
            'inertia = [0, 0, 0]'//nl//'position = [0, 0, 0]'//nl//'[joint.axle]'//nl//'type = "revolute"'//nl// &
            'bodies = ["ground", "ring"]'//nl//'at = [0, 0, 0]'//nl//'axis = [0, 0, 1]'//nl//'[body.other]'//nl//'mass = 1'//nl// &
            'inertia = [1, 1, 1]'//nl//'position = [1, 0, 0]'//nl)
        options%chart_kind = 'sparse'
        if (.not. allocated(failure)) call simulation%initialize(scene%model, options, scene%t_start, scene%q, scene%qd, failure, &
            scene%assembly)
        call check_failure(error, failure, 'invalid_option', 'has no mass')
    end subroutine test_free_body

    subroutine test_redundant(error)
        type(error_type), allocatable, intent(out) :: error

        call compare(skates, 2, error)
    end subroutine test_redundant

    subroutine test_coupling(error)
        type(error_type), allocatable, intent(out) :: error

        call compare(locked//'true'//nl, 0, error)
        if (.not. allocated(error)) call compare(locked//'false'//nl, 0, error)
    end subroutine test_coupling

    !> Springs of 960 times the frequency of the motion rotate with a governor, by a third of a radian in a step. Both charts take
    !> nearly the same steps, and end nearly in the same state.
    subroutine test_governor(error)
        type(error_type), allocatable, intent(out) :: error
        character(len=*), parameter :: steppers(4) = [character(len=9) :: 'radau5', 'radau5', 'sdirk54', 'trapezoid']
        real(wp), parameter :: rtols(4) = [1.0e-4_wp, 1.0e-6_wp, 1.0e-3_wp, 1.0e-3_wp]
        type(simulation_type) :: run
        type(scene_type), target :: scene
        type(failure_type), allocatable :: failure
        type(statistics_type) :: statistics
        character(len=:), allocatable :: path
        real(wp), allocatable :: q(:)
        real(wp) :: attempts(2)
        integer :: i, k

        call find_scene('a05_governor', path, failure)
        if (.not. allocated(failure)) call read_scene(path, [character(len=1) ::], scene, failure)
        call check_no_failure(error, failure)
        do k = 1, size(steppers)
            do i = 1, 2
                if (allocated(error)) return
                call run%initialize(scene%model, controlled(rtols(k), merge('dense ', 'sparse', i == 1), trim(steppers(k))), &
                    scene%t_start, scene%q, scene%qd, failure, scene%assembly)
                call check_no_failure(error, failure)
                call go_on(run, 2.0_wp, error)
                statistics = run%statistics()
                attempts(i) = real(statistics%steps + statistics%rejected + statistics%failed, wp)
                if (i == 1) q = run%state%q
            end do
            ! Measured: 39, 116, 33 and 61 on the dense chart.
            call check_below(error, attempts(2), 1.2_wp*attempts(1) + 5.0_wp, trim(steppers(k))//': steps on the sparse chart')
            call check_close(error, run%state%q, q, 100*rtols(k), trim(steppers(k))//': q')
        end do
    end subroutine test_governor

    !> Runs of a scene on both charts end in the same state, with the same accelerations and multipliers, and a run that is
    !> continued from a checkpoint is bitwise equal.
    subroutine compare(text, n_redundant, error)
        character(len=*), intent(in) :: text
        !> Redundant rows.
        integer, intent(in) :: n_redundant
        type(error_type), allocatable, intent(inout) :: error
        character(len=*), parameter :: steppers(5) = [character(len=9) :: 'rk4', 'dop853', 'sdirk54', 'radau5', 'trapezoid']
        !> Errors of motions with rtol = 1e-10: at most some hundred steps of this error, amplified by as much again.
        real(wp), parameter :: near = 1.0e-7_wp
        type(simulation_type) :: dense, sparse, again
        type(scene_type), target :: scenes(3)
        type(options_type) :: options
        type(failure_type), allocatable :: failure
        type(statistics_type) :: statistics
        real(wp), allocatable :: lambda(:), expected(:)
        integer(long), allocatable :: words(:)
        real(wp) :: t_end
        integer :: k

        do k = 1, size(steppers)
            options = controlled(1.0e-10_wp, 'dense', trim(steppers(k)))
            ! Fixed steps, with which both charts have nearly the same errors.
            if (any(k == [1, 5])) options = options_type(stepper=trim(steppers(k)), step=merge(1.0e-3_wp, 2.0e-4_wp, k == 1), &
                chart_kind='dense')
            call begin(text, options, scenes(1), dense, error)
            options%chart_kind = 'sparse'
            call begin(text, options, scenes(2), sparse, error)
            call begin(text, options, scenes(3), again, error)
            if (allocated(error)) return
            call check_true(error, sparse%is_sparse .and. .not. dense%is_sparse, 'kinds of charts')
            call check_count(error, sparse%n_redundant, n_redundant, 'redundant rows')
            if (allocated(error)) return
            allocate (lambda(scenes(1)%model%n_constraints()), expected(scenes(1)%model%n_constraints()))
            ! At the start both states are equal up to rounding.
            call check_close(error, sparse%state%qdd, dense%state%qdd, 1.0e-9_wp*maxval(abs(dense%state%qdd)), 'qdd')
            call dense%multipliers(expected)
            call sparse%multipliers(lambda)
            call check_close(error, lambda, expected, 1.0e-9_wp*maxval(abs(expected)), 'lambda')
            t_end = 0.3_wp
            call go_on(dense, t_end, error)
            call go_on(sparse, 0.5_wp*t_end, error)
            if (allocated(error)) return
            call sparse%save_state(words, failure)
            call check_no_failure(error, failure)
            call again%restore_state(words, failure)
            call check_no_failure(error, failure)
            call go_on(sparse, t_end, error)
            call go_on(again, t_end, error)
            if (allocated(error)) return
            call check_close(error, sparse%state%q, dense%state%q, near, trim(steppers(k))//': q')
            call check_close(error, sparse%state%qd, dense%state%qd, 100*near, trim(steppers(k))//': qd')
            call check_true(error, all(abs(again%state%q - sparse%state%q) <= 0.0_wp), trim(steppers(k))//' goes on otherwise')
            statistics = sparse%statistics()
            call check_below(error, max(statistics%position_error, statistics%velocity_error, statistics%acceleration_error), &
                1.0e-11_wp, 'constraint errors')
            deallocate (lambda, expected)
        end do
    end subroutine compare

    !> Begin a run of a scene.
    subroutine begin(text, options, scene, simulation, error)
        character(len=*), intent(in) :: text
        type(options_type), intent(in) :: options
        type(scene_type), intent(inout), target :: scene
        type(simulation_type), intent(inout) :: simulation
        type(error_type), allocatable, intent(inout) :: error
        type(failure_type), allocatable :: failure

        if (allocated(error)) return
        call read_scene('test.toml', [character(len=1) ::], scene, failure, text=text)
        if (.not. allocated(failure)) call simulation%initialize(scene%model, options, scene%t_start, scene%q, scene%qd, failure, &
            scene%assembly)
        call check_no_failure(error, failure)
    end subroutine begin
end module test_sparse_features
