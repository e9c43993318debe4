! SPDX-License-Identifier: MIT
!> Tests of eigenvalues near a shift about steady motions, in co-rotating coordinates: against the dense analysis, which finds the
!> frame in another way and has exact gradients, and against closed forms; motions that are not steady are refused.
module test_nearest_steady
    use asserts, only: check_below, check_failure, check_no_failure, check_true
    use linearised, only: check_nearest, linearise_scene, linearise_text
    use tandem, only: failure_type => error_type, in_steady_motion, linearisation_type, nearest_type, of_motion, wp
    use tandem_io, only: read_scene, scene_type
    use testdrive, only: error_type, new_unittest, unittest_type
    implicit none (type, external)
    private

    public :: collect_nearest_steady

    character(len=1), parameter :: nothing(0) = [character(len=1) ::], nl = new_line('a')
    !> Rods of 1 m in a row that rotate about a pivot, without gravity.
    character(len=*), parameter :: rotor = '[scene]'//nl//'model = "mechanism"'//nl//'planar = true'//nl//'[parameters]'//nl// &
        'w = 2'//nl//'n = 7'//nl//'[body.rod1]'//nl//'mass = 1'//nl//'inertia = "1/12"'//nl//'position = [0.5, 0]'//nl// &
        'velocity = [0, "0.5*w"]'//nl//'omega = "w"'//nl//'[joint.pin1]'//nl//'type = "revolute"'//nl// &
        'bodies = ["ground", "rod1"]'//nl//'at = [0, 0]'//nl//'[repeat.link]'//nl//'count = "n - 1"'//nl//'first = 2'//nl// &
        '[repeat.link.body."rod{i}"]'//nl//'mass = 1'//nl//'inertia = "1/12"'//nl//'position = ["i - 0.5", 0]'//nl// &
        'velocity = [0, "w*(i - 0.5)"]'//nl//'omega = "w"'//nl//'[repeat.link.joint."pin{i}"]'//nl//'type = "revolute"'//nl// &
        'bodies = ["rod{i - 1}", "rod{i}"]'//nl//'at = ["i - 1", 0]'//nl//'[time]'//nl//'end = 1'//nl
    !> A tractor and trailers of two lengths go straight ahead.
    character(len=*), parameter :: trailers = '[scene]'//nl//'model = "mechanism"'//nl//'planar = true'//nl//'[body.car0]'//nl// &
        'mass = 1000'//nl//'inertia = 400'//nl//'position = [0, 0]'//nl//'velocity = [2, 0]'//nl//'[body.car1]'//nl// &
        'mass = 500'//nl//'inertia = 200'//nl//'position = [-2, 0]'//nl// &
        'velocity = [2, 0]'//nl//'[body.car2]'//nl//'mass = 400'//nl// &
        'inertia = 150'//nl//'position = [-3.75, 0]'//nl//'velocity = [2, 0]'//nl//'[joint]'//nl// &
        'one = { type = "revolute", bodies = ["car0", "car1"], at = [-1, 0] }'//nl// &
        'two = { type = "revolute", bodies = ["car1", "car2"], at = [-3, 0] }'//nl//'[wheel]'//nl// &
        'front = { type = "knife_edge", at = "car0:[1, 0]", across = [0, 1] }'//nl// &
        'rear = { type = "knife_edge", at = "car0:[-1, 0]", across = [0, 1] }'//nl// &
        'first = { type = "knife_edge", at = "car1:[-1, 0]", across = [0, 1] }'//nl// &
        'second = { type = "knife_edge", at = "car2:[-0.75, 0]", across = [0, 1] }'//nl//'[time]'//nl//'end = 1'//nl

contains

    !> The suite.
    subroutine collect_nearest_steady(testsuite)
        type(unittest_type), allocatable, intent(out) :: testsuite(:)

        testsuite = [ &
            new_unittest('a-rotor-agrees-with-the-dense-analysis', test_rotor), &
            new_unittest('trailers-straighten-by-their-lengths', test_trailers), &
            new_unittest('bicycle-and-disk-agree-with-the-dense-analysis', test_wheels), &
            new_unittest('a-governor-agrees-with-the-dense-analysis', test_governor), &
            new_unittest('what-does-not-go-on-steadily-is-refused', test_refused)]
    end subroutine collect_nearest_steady

    !> All eigenvalues found are eigenvalues of the dense analysis; zeros of symmetries and families are not split off here.
    subroutine check_agreement(scene, it, shift, k, bound, what, error)
        type(scene_type), intent(inout), target :: scene
        type(linearisation_type), intent(in) :: it
        complex(wp), intent(in) :: shift
        integer, intent(in) :: k
        !> Relative.
        real(wp), intent(in) :: bound
        character(len=*), intent(in) :: what
        type(error_type), allocatable, intent(inout) :: error
        type(nearest_type) :: nearest
        type(failure_type), allocatable :: failure

        if (allocated(error)) return
        call check_true(error, it%kind == in_steady_motion, what//': it is a steady motion')
        call nearest%find(scene%model, scene%t_start, it%q, shift, k, failure, it%qd)
        call check_no_failure(error, failure)
        if (allocated(error)) return
        call check_true(error, nearest%frame%moves, what//': says that it moves')
        call check_nearest(nearest, it, shift, k, [bound, 1.0e-4_wp], it%spectrum%cause == of_motion, what, error)
    end subroutine check_agreement

    subroutine test_rotor(error)
        type(error_type), allocatable, intent(out) :: error
        type(scene_type), target :: scene
        type(linearisation_type) :: it

        call linearise_text(rotor, nothing, scene, it, error)
        call check_agreement(scene, it, (0.0_wp, 4.0_wp), 6, 1.0e-10_wp, 'a rotor', error)
        call check_agreement(scene, it, (0.3_wp, 20.0_wp), 4, 1.0e-10_wp, 'its fast modes', error)
    end subroutine test_rotor

    !> Behind a tractor that goes straight a trailer's angle a satisfies l a' = -v a, l from its hitch to its axle: 2 m and 1.5 m.
    subroutine test_trailers(error)
        type(error_type), allocatable, intent(out) :: error
        type(scene_type), target :: scene
        type(linearisation_type) :: it
        type(nearest_type) :: nearest
        type(failure_type), allocatable :: failure

        call linearise_text(trailers, nothing, scene, it, error)
        call check_agreement(scene, it, (-1.1_wp, 0.2_wp), 2, 1.0e-10_wp, 'trailers', error)
        if (allocated(error)) return
        call nearest%find(scene%model, 0.0_wp, scene%q, (-1.1_wp, 0.2_wp), 2, failure, scene%qd)
        call check_no_failure(error, failure)
        if (allocated(error)) return
        call check_below(error, minval(abs(nearest%values + 1)), 1.0e-10_wp, 'the first trailer')
        call check_below(error, minval(abs(nearest%values + 2/1.5_wp)), 1.0e-10_wp, 'the second trailer')
    end subroutine test_trailers

    !> Wheels that also spin; the ground contact of a bicycle and a disk gives rows that depend on the coordinates.
    subroutine test_wheels(error)
        type(error_type), allocatable, intent(out) :: error
        type(scene_type), allocatable, target :: scene
        type(linearisation_type) :: it

        allocate (scene)
        call linearise_scene('bicycle', [character(len=20) :: 'parameters.speed=4', 'parameters.push=0'], scene, it, error)
        call check_agreement(scene, it, (0.4_wp, 3.0_wp), 1, 1.0e-9_wp, 'weave of the bicycle', error)
        call check_agreement(scene, it, (-1.4_wp, 0.1_wp), 1, 1.0e-9_wp, 'its capsize', error)
        call check_agreement(scene, it, (-12.0_wp, 0.1_wp), 1, 1.0e-9_wp, 'its castering', error)
        if (allocated(error)) return
        deallocate (scene)
        allocate (scene)
        call linearise_scene('mechanism_disk', [character(len=40) :: 'body.disk.omega=[-1.9,0,0]', &
            'body.disk.velocity=[0,1.9,0]'], scene, it, error)
        call check_agreement(scene, it, (0.1_wp, 1.0_wp), 1, 1.0e-9_wp, 'a disk', error)
    end subroutine test_wheels

    !> Rotation in space about the vertical, with gravity along it, and stiff springs with dampers.
    subroutine test_governor(error)
        type(error_type), allocatable, intent(out) :: error
        type(scene_type), target :: scene
        type(linearisation_type) :: it

        call linearise_scene('a05_governor', ['initial.steady=["world.rotation_z"]'], scene, it, error)
        call check_agreement(scene, it, (-10.0_wp, 10.0_wp), 3, 1.0e-8_wp, 'a governor', error)
    end subroutine test_governor

    !> Gravity in the plane, rods that rotate at several rates, a rod that rotates about another point than its pivot.
    subroutine test_refused(error)
        type(error_type), allocatable, intent(out) :: error

        call refused([character(len=40) :: 'gravity.vector=[0, -9.81]'], 'no_equilibrium', 'change along the motion')
        call refused([character(len=40) :: 'body.rod1.omega=3', 'body.rod1.velocity=[0, 1.5]'], 'no_equilibrium', &
            'is not a rigid motion')
        call refused([character(len=40) :: 'parameters.n=1', 'body.rod1.velocity=[0, 1.5]'], 'inconsistent_start', 'violate')

    contains

        subroutine refused(settings, status, piece)
            character(len=*), intent(in) :: settings(:), status, piece
            type(scene_type), target :: scene
            type(nearest_type) :: nearest
            type(failure_type), allocatable :: failure

            if (allocated(error)) return
            call read_scene('test.toml', settings, scene, failure, text=rotor)
            call check_no_failure(error, failure)
            if (allocated(error)) return
            call nearest%find(scene%model, 0.0_wp, scene%q, (0.0_wp, 4.0_wp), 2, failure, scene%qd)
            call check_failure(error, failure, status, piece)
        end subroutine refused
    end subroutine test_refused
end module test_nearest_steady
