! SPDX-License-Identifier: MIT
!> Tests of steady motions of large mechanisms: found by the sparse form from other starts, against closed forms and against the
!> dense search, which uses full matrices and other steps; and driven at constant rates. Functions of time without constant rates
!> are refused.
module test_sparse_steady
    use asserts, only: check_below, check_failure, check_no_failure, check_true
    use linearised, only: linearise_text
    use tandem, only: failure_type => error_type, find_steady_from_words, in_steady_motion, linearisation_type, nearest_type, &
        of_motion, equilibrium_search_type, wp
    use tandem_analysis_sparse_steady, only: find_steady_sparsely
    use tandem_io, only: read_scene, scene_type
    use testdrive, only: error_type, new_unittest, unittest_type
    implicit none (type, external)
    private

    public :: collect_sparse_steady

    character(len=1), parameter :: nothing(0) = [character(len=1) ::], nl = new_line('a')
    !> Bodies of 1 kg on springs in a row that rotate about the origin; the definition is that of rest.
    character(len=*), parameter :: elastic = '[scene]'//nl//'model = "mechanism"'//nl//'planar = true'//nl//'[parameters]'//nl// &
        'w = 2'//nl//'n = 6'//nl//'[body.b1]'//nl//'mass = 1'//nl//'inertia = 0.1'//nl//'position = [1, 0]'//nl// &
        'velocity = [0, "w"]'//nl//'omega = "w"'//nl//'[force.s1]'//nl//'type = "spring"'//nl// &
        'between = ["ground:[0, 0]", "b1"]'//nl//'stiffness = 400'//nl//'[repeat.more]'//nl// &
        'count = "n - 1"'//nl//'first = 2'//nl// &
        '[repeat.more.body."b{i}"]'//nl//'mass = 1'//nl//'inertia = 0.1'//nl//'position = ["i", 0]'//nl// &
        'velocity = [0, "w*i"]'//nl//'omega = "w"'//nl//'[repeat.more.force."s{i}"]'//nl//'type = "spring"'//nl// &
        'between = ["b{i - 1}", "b{i}"]'//nl//'stiffness = 400'//nl//'[time]'//nl//'end = 1'//nl
    !> Rods that hang from each other on ball joints and rotate about the vertical, defined on a straight line aside.
    character(len=*), parameter :: cone = '[scene]'//nl//'model = "mechanism"'//nl//'[parameters]'//nl//'w = 2.5'//nl// &
        'n = 4'//nl//'a = 0.9'//nl//'[gravity]'//nl//'vector = [0, 0, -9.81]'//nl//'[repeat.link]'//nl//'count = "n"'//nl// &
        '[repeat.link.body."rod{i}"]'//nl//'mass = 1'//nl//'inertia = ["1/12", "1/12", 0.01]'//nl// &
        'position = ["(i - 0.5)*sin(a)", 0, "-(i - 0.5)*cos(a)"]'//nl//'rotation = [0, "-a", 0]'//nl// &
        'velocity = [0, "w*(i - 0.5)*sin(a)", 0]'//nl//'omega = [0, 0, "w"]'//nl//'[joint.pin1]'//nl//'type = "spherical"'//nl// &
        'bodies = ["ground", "rod1"]'//nl//'at = [0, 0, 0]'//nl//'[repeat.pin]'//nl//'count = "n - 1"'//nl//'first = 2'//nl// &
        '[repeat.pin.joint."pin{i}"]'//nl//'type = "spherical"'//nl//'bodies = ["rod{i - 1}", "rod{i}"]'//nl// &
        'at = ["(i - 1)*sin(a)", 0, "-(i - 1)*cos(a)"]'//nl//'[time]'//nl//'end = 1'//nl
    !> A tractor whose engine keeps its speed constant, and trailers, in a turn given by its steering wheel; defined straight ahead.
    character(len=*), parameter :: engine = '[scene]'//nl//'model = "mechanism"'//nl//'planar = true'//nl//'[parameters]'//nl// &
        'steer = 0.2'//nl//'v = 2'//nl//'turn = "v*tan(steer)/2"'//nl//'[body.car0]'//nl//'mass = 1000'//nl//'inertia = 400'//nl// &
        'position = [0, "v/turn"]'//nl//'velocity = ["-v", 0]'//nl//'omega = "turn"'//nl//'[body.car1]'//nl//'mass = 500'//nl// &
        'inertia = 200'//nl//'position = [1.1, "v/turn"]'//nl//'velocity = ["-v", "1.1*turn"]'//nl//'omega = "turn"'//nl// &
        '[joint.pin]'//nl//'type = "revolute"'//nl//'bodies = ["car0", "car1"]'//nl//'at = "car0:[0.1, 0]"'//nl//'[wheel]'//nl// &
        'front = { type = "knife_edge", at = "car0:[-2, 0]", across = ["-sin(steer)", "cos(steer)"] }'//nl// &
        'rear = { type = "knife_edge", at = "car0:[0, 0]", across = [0, 1] }'//nl// &
        'trailer = { type = "knife_edge", at = "car1:[1, 0]", across = [0, 1] }'//nl//'[constraint.engine]'//nl// &
        'type = "velocity"'//nl//'velocities = ["car0.vx", "car0.vy"]'//nl// &
        'coefficients = ["-cos(car0.angle)", "-sin(car0.angle)"]'//nl//'value = "v"'//nl//'[time]'//nl//'end = 1'//nl

contains

    !> The suite.
    subroutine collect_sparse_steady(testsuite)
        type(unittest_type), allocatable, intent(out) :: testsuite(:)

        testsuite = [ &
            new_unittest('an-elastic-rotor-is-stretched', test_elastic), &
            new_unittest('a-thousand-coordinates-and-more', test_large), &
            new_unittest('a-chain-in-a-cone-agrees-with-the-dense-search', test_cone), &
            new_unittest('rates-that-are-not-held-are-found', test_rates), &
            new_unittest('trailers-in-a-turn-agree-with-the-dense-search', test_trailers), &
            new_unittest('a-joint-may-be-driven-at-a-constant-rate', test_driven), &
            new_unittest('a-ball-on-a-turntable-agrees-with-the-dense-analysis', test_turntable), &
            new_unittest('what-depends-on-the-time-is-refused-by-name', test_refused)]
    end subroutine collect_sparse_steady

    !> All eigenvalues near a shift are among those of the dense analysis about a steady motion.
    subroutine check_agreement(scene, q, qd, it, shift, k, bound, what, error)
        type(scene_type), intent(inout), target :: scene
        real(wp), intent(in) :: q(:), qd(:)
        type(linearisation_type), intent(in) :: it
        complex(wp), intent(in) :: shift
        integer, intent(in) :: k
        !> Relative.
        real(wp), intent(in) :: bound
        character(len=*), intent(in) :: what
        type(error_type), allocatable, intent(inout) :: error
        type(nearest_type) :: nearest
        type(failure_type), allocatable :: failure
        integer :: i, j, n_seen

        if (allocated(error)) return
        call check_true(error, it%kind == in_steady_motion, what//': it is a steady motion')
        call nearest%find(scene%model, scene%t_start, q, shift, k, failure, qd)
        call check_no_failure(error, failure)
        if (allocated(error)) return
        n_seen = 0
        do i = 1, size(nearest%values)
            j = minloc(abs(it%spectrum%values - nearest%values(i)), dim=1)
            if (it%spectrum%cause(j) /= of_motion) cycle
            n_seen = n_seen + 1
            call check_below(error, abs(it%spectrum%values(j) - nearest%values(i)), bound*abs(it%spectrum%values(j)), &
                what//': difference of an eigenvalue')
        end do
        call check_true(error, n_seen > 0, what//': some that are no zeros')
    end subroutine check_agreement

    !> The steady motion of a scene by both searches, and eigenvalues about it.
    subroutine check_both(text, settings, word, shift, k, what, error, scene, q, qd)
        character(len=*), intent(in) :: text, settings(:), word, what
        complex(wp), intent(in) :: shift
        integer, intent(in) :: k
        type(error_type), allocatable, intent(inout) :: error
        type(scene_type), intent(inout), target :: scene
        !> Result of the sparse search.
        real(wp), allocatable, intent(out) :: q(:), qd(:)
        type(equilibrium_search_type) :: search
        type(linearisation_type) :: it
        type(failure_type), allocatable :: failure
        character(len=20) :: words(1)
        integer :: iterations

        if (allocated(error)) return
        call read_scene('test.toml', settings, scene, failure, text=text)
        call check_no_failure(error, failure)
        if (allocated(error)) return
        iterations = 0
        q = scene%q
        qd = scene%qd
        words = word
        call find_steady_sparsely(scene%model, 0.0_wp, q, qd, iterations, failure, words)
        call check_no_failure(error, failure)
        call check_true(error, iterations > 1, what//': the start was none')
        if (allocated(error)) return
        call find_steady_from_words(search, scene%model, 0.0_wp, scene%q, scene%qd, words, failure)
        call check_no_failure(error, failure)
        if (allocated(error)) return
        call it%make(scene%model, 0.0_wp, search%q, search%qd, failure)
        call check_no_failure(error, failure)
        call check_agreement(scene, q, qd, it, shift, k, 1.0e-8_wp, what, error)
    end subroutine check_both

    !> Radii r of the bodies: k (r_i - r_(i-1) - 1) - k (r_(i+1) - r_i - 1) = w^2 r_i, by elimination from the outside.
    subroutine find_radii(n, w, radius)
        integer, intent(in) :: n
        real(wp), intent(in) :: w
        real(wp), intent(out) :: radius(n)
        real(wp), parameter :: k = 400.0_wp
        real(wp) :: ratio(n), known(n)
        integer :: i

        ! r_i = ratio_i r_(i-1) + known_i.
        do i = n, 1, -1
            if (i == n) then
                ratio(i) = k/(k - w**2)
                known(i) = ratio(i)
            else
                ratio(i) = k/(2*k - k*ratio(i + 1) - w**2)
                known(i) = k*known(i + 1)/(2*k - k*ratio(i + 1) - w**2)
            end if
        end do
        radius(1) = known(1)
        do i = 2, n
            radius(i) = ratio(i)*radius(i - 1) + known(i)
        end do
    end subroutine find_radii

    subroutine test_elastic(error)
        type(error_type), allocatable, intent(out) :: error
        type(scene_type), target :: scene
        real(wp), allocatable :: q(:), qd(:)
        real(wp) :: radius(6)
        integer :: i

        call check_both(elastic, nothing, 'world.rotation', (0.1_wp, 10.0_wp), 6, 'an elastic rotor', error, scene, q, qd)
        if (allocated(error)) return
        call find_radii(6, 2.0_wp, radius)
        do i = 1, 6
            call check_below(error, abs(norm2(q(3*i - 2:3*i - 1)) - radius(i)), 1.0e-11_wp, 'radius')
            call check_below(error, abs(norm2(qd(3*i - 2:3*i - 1)) - 2*radius(i)), 1.0e-11_wp, 'speed')
        end do
    end subroutine test_elastic

    !> As requested by scenes, with more coordinates than full matrices take.
    subroutine test_large(error)
        type(error_type), allocatable, intent(out) :: error
        integer, parameter :: n = 350
        type(scene_type), target :: scene
        type(nearest_type) :: nearest
        type(failure_type), allocatable :: failure
        real(wp) :: radius(n)

        call read_scene('test.toml', [character(len=40) :: 'parameters.n=350', 'parameters.w=0.05', 'initial.steady=["any"]'], &
            scene, failure, text=elastic)
        call check_no_failure(error, failure)
        if (allocated(error)) return
        call find_radii(n, 0.05_wp, radius)
        call check_below(error, maxval(abs(hypot(scene%q(1::3), scene%q(2::3)) - radius)), 1.0e-9_wp, 'differences of radii')
        call check_true(error, radius(n) > n + 10, 'it is stretched')
        call nearest%find(scene%model, 0.0_wp, scene%q, (0.0_wp, 0.2_wp), 4, failure, scene%qd)
        call check_no_failure(error, failure)
    end subroutine test_large

    subroutine test_cone(error)
        type(error_type), allocatable, intent(out) :: error
        type(scene_type), target :: scene
        real(wp), allocatable :: q(:), qd(:)

        call check_both(cone, nothing, 'world.rotation_z', (0.1_wp, 5.0_wp), 4, 'a cone', error, scene, q, qd)
        if (allocated(error)) return
        ! The outermost rod has left its initial line.
        call check_true(error, norm2(q(:3) - scene%q(:3)) > 1.0e-3_wp, 'it has moved')
    end subroutine test_cone

    !> One rod in a cone with the angle of its coordinates: cos(a) = 3 g/(2 l (1 - 3 I/(m l^2)...) w^2) of a thin rod.
    subroutine test_rates(error)
        type(error_type), allocatable, intent(out) :: error
        type(scene_type), target :: scene
        type(failure_type), allocatable :: failure
        real(wp), allocatable :: q(:), qd(:)
        real(wp) :: rate, cosine
        integer :: iterations

        ! Its own inertia about its axis 0.01, across 1/12: (1/4 + 1/12 - 0.01) w^2 cos(a) = g/2.
        call read_scene('test.toml', [character(len=40) :: 'parameters.n=1', 'parameters.w=9'], scene, failure, text=cone)
        call check_no_failure(error, failure)
        if (allocated(error)) return
        q = scene%q
        qd = scene%qd
        iterations = 0
        call find_steady_sparsely(scene%model, 0.0_wp, q, qd, iterations, failure, ['world.rotation_z'], &
            ['world.rotation_z'], [7.0_wp])
        call check_no_failure(error, failure)
        if (allocated(error)) return
        rate = norm2(qd(:2))/norm2(q(:2))
        call check_below(error, abs(rate - 7.0_wp), 1.0e-11_wp, 'the rate that is held')
        cosine = 9.81_wp/(2*(0.25_wp + 1.0_wp/12 - 0.01_wp)*49)
        call check_below(error, abs(-2*q(3) - cosine), 1.0e-10_wp, 'cosine of its angle')
    end subroutine test_rates

    !> The trailer's axle follows on a circle to which it is tangent; the tractor's velocity is that of the engine.
    subroutine test_trailers(error)
        type(error_type), allocatable, intent(out) :: error
        type(scene_type), target :: scene
        real(wp), allocatable :: q(:), qd(:)
        real(wp) :: axle(2)

        call check_both(engine, nothing, 'world.rotation', (-1.0_wp, 0.1_wp), 2, 'trailers in a turn', error, scene, q, qd)
        if (allocated(error)) return
        call check_below(error, abs(norm2(qd(:2)) - 2.0_wp), 1.0e-10_wp, 'speed of the engine')
        axle = q(4:5) + [cos(q(6)), sin(q(6))]
        call check_below(error, abs(dot_product(axle, [cos(q(6)), sin(q(6))])), 1.0e-8_wp, 'the axle looks at the middle')
    end subroutine test_trailers

    !> Rotating rods in a row, the first of them driven.
    subroutine test_driven(error)
        type(error_type), allocatable, intent(out) :: error
        type(scene_type), target :: scene
        type(linearisation_type) :: it

        call linearise_text(driven('2*t'), nothing, scene, it, error)
        if (allocated(error)) return
        call check_agreement(scene, scene%q, scene%qd, it, (0.1_wp, 4.0_wp), 4, 1.0e-10_wp, 'a driven rotor', error)
    end subroutine test_driven

    !> Three rods whose first follows a function of the time.
    function driven(motion) result(text)
        character(len=*), intent(in) :: motion
        character(len=:), allocatable :: text

        text = '[scene]'//nl//'model = "mechanism"'//nl//'planar = true'//nl//'[repeat.link]'//nl//'count = 3'//nl// &
            '[repeat.link.body."rod{i}"]'//nl//'mass = 1'//nl//'inertia = "1/12"'//nl//'position = ["i - 0.5", 0]'//nl// &
            'velocity = [0, "2*(i - 0.5)"]'//nl//'omega = 2'//nl//'[joint]'//nl// &
            'motor = { type = "revolute", bodies = ["ground", "rod1"], at = [0, 0], motion = "'//motion//'" }'//nl// &
            'two = { type = "revolute", bodies = ["rod1", "rod2"], at = [1, 0] }'//nl// &
            'three = { type = "revolute", bodies = ["rod2", "rod3"], at = [2, 0] }'//nl//'[time]'//nl//'end = 1'//nl
    end function driven

    !> On a table that rotates with W a ball circles around its middle with w under a spring, k = 7/5 m w^2 - 2/5 m W w.
    subroutine test_turntable(error)
        type(error_type), allocatable, intent(out) :: error
        type(scene_type), target :: scene
        type(linearisation_type) :: it

        call linearise_text(table('3*t'), nothing, scene, it, error)
        if (allocated(error)) return
        call check_agreement(scene, scene%q, scene%qd, it, (0.1_wp, 0.9_wp), 4, 1.0e-8_wp, 'a ball on a turntable', error)
    end subroutine test_turntable

    !> A ball on a table whose angle is a function of the time.
    function table(turn) result(text)
        character(len=*), intent(in) :: turn
        character(len=:), allocatable :: text

        text = '[scene]'//nl//'model = "mechanism"'//nl//'[parameters]'//nl//'w = 1.2'//nl//'x = 0.5'//nl//'r = 0.2'//nl// &
            '[gravity]'//nl//'vector = [0, 0, -9.81]'//nl//'[body.ball]'//nl//'mass = 2'//nl//'shape = { sphere = "r" }'//nl// &
            'position = ["x", 0, "r"]'//nl//'velocity = [0, "w*x", 0]'//nl//'omega = ["-(w*x - 3*x)/r", 0, 0.7]'//nl// &
            '[wheel.contact]'//nl//'type = "sphere"'//nl//'at = "ball"'//nl//'radius = "r"'//nl//'rotation = "'//turn//'"'//nl// &
            '[force.pull]'//nl//'type = "spring"'//nl//'between = ["ground:[0, 0, 0.2]", "ball"]'//nl//'length = 0'//nl// &
            'stiffness = "2*(7/5*w^2 - 6/5*w)"'//nl//'[time]'//nl//'end = 1'//nl
    end function table

    subroutine test_refused(error)
        type(error_type), allocatable, intent(out) :: error

        call refused(driven('2*t + 0.1*t^2'), nothing, 'motor')
        call refused(driven('2*sin(t)'), nothing, 'motor')
        call refused(table('3*t + 0.1*t^2'), nothing, 'contact')
        call refused(engine, [character(len=40) :: 'constraint.engine.value="v + t^2"'], 'engine')

    contains

        subroutine refused(text, settings, piece)
            character(len=*), intent(in) :: text, settings(:), piece
            type(scene_type), target :: scene
            type(nearest_type) :: nearest
            type(failure_type), allocatable :: failure
            integer :: iterations

            if (allocated(error)) return
            call read_scene('test.toml', settings, scene, failure, text=text)
            call check_no_failure(error, failure)
            if (allocated(error)) return
            ! The start is not a steady motion, and is moved to one.
            iterations = 0
            if (size(settings) > 0) then
                call find_steady_sparsely(scene%model, 0.0_wp, scene%q, scene%qd, iterations, failure, ['world.rotation'])
            else
                call nearest%find(scene%model, 0.0_wp, scene%q, (0.0_wp, 4.0_wp), 2, failure, scene%qd)
            end if
            call check_failure(error, failure, 'no_equilibrium', piece)
        end subroutine refused
    end subroutine test_refused
end module test_sparse_steady
