! SPDX-License-Identifier: MIT
!> Tests of linearised systems: eigenvalues against closed forms and other formulations, the matrix against differences of the
!> reduced equations, and the causes of zeros.
module test_linearisation
    use asserts, only: check_below, check_count, check_no_failure, check_true
    use linearised, only: check_eigenvalues, has_eigenvalue, linearise_scene, linearise_text
    use subjects, only: new_subject, subject_names
    use tandem, only: at_an_instant, at_equilibrium, failure_type => error_type, in_steady_motion, linearisation_type, model_type, &
        procedure_model_type, of_family, of_symmetry, options_type, simulation_type, wp
    use tandem_chart, only: step_end
    use tandem_chart_dense, only: dense_chart_type
    use tandem_io, only: find_scene, read_scene, scene_type
    use tandem_linalg_eigenvalues, only: find_eigenvalues, split_zeros
    use testdrive, only: error_type, new_unittest, test_failed, unittest_type
    implicit none (type, external)
    private

    public :: collect_linearisation

    !> No settings; used for this and a sleigh's speed.
    character(len=1), parameter :: nothing(0) = [character(len=1) ::]
    complex(wp), parameter :: i = (0.0_wp, 1.0_wp)

contains

    !> The suite.
    subroutine collect_linearisation(testsuite)
        type(unittest_type), allocatable, intent(out) :: testsuite(:)

        testsuite = [ &
            new_unittest('bicycle-agrees-with-its-two-equations', test_bicycle), &
            new_unittest('bicycle-agrees-with-the-benchmark', test_benchmark), &
            new_unittest('sleigh-loses-its-turn', test_sleigh), &
            new_unittest('disk-rolls-stably-from-a-spin-on', test_disk), &
            new_unittest('rattleback-agrees-with-equations-in-the-body', test_rattleback), &
            new_unittest('top-precesses-and-nutates-as-its-integrals-say', test_top), &
            new_unittest('matrix-agrees-with-differences-of-reduced-equations', test_matrix), &
            new_unittest('differences-stand-in-for-gradients', test_stand_in), &
            new_unittest('zeros-are-explained', test_zeros), &
            new_unittest('jordan-blocks-of-zero-are-split-off', test_jordan), &
            new_unittest('what-is-not-steady-is-an-instant', test_instant)]
    end subroutine collect_linearisation

    !> The 2 x 2 form of Meijaard and others (2007): M q'' + v C1 q' + (g K0 + v^2 K2) q = 0.
    subroutine get_benchmark(speed, values)
        real(wp), intent(in) :: speed
        complex(wp), intent(out) :: values(4)
        real(wp), parameter :: g = 9.81_wp
        real(wp), parameter :: m(2, 2) = reshape([80.81722_wp, 2.31941332208709_wp, 2.31941332208709_wp, 0.29784188199686_wp], &
            [2, 2]), c1(2, 2) = reshape([0.0_wp, -0.85035641456978_wp, 33.86641391492494_wp, 1.68540397397560_wp], [2, 2]), &
            k0(2, 2) = reshape([-80.95_wp, -2.59951685249872_wp, -2.59951685249872_wp, -0.80329488458618_wp], [2, 2]), &
            k2(2, 2) = reshape([0.0_wp, 0.0_wp, 76.59734589573222_wp, 2.65431523794604_wp], [2, 2])
        real(wp) :: inverse(2, 2), a(4, 4), condition(4)
        complex(wp) :: vectors(4, 4)
        integer :: stat

        inverse = reshape([m(2, 2), -m(2, 1), -m(1, 2), m(1, 1)], [2, 2])/(m(1, 1)*m(2, 2) - m(1, 2)**2)
        a = 0.0_wp
        a(1, 3) = 1.0_wp
        a(2, 4) = 1.0_wp
        a(3:4, 1:2) = -matmul(inverse, g*k0 + speed**2*k2)
        a(3:4, 3:4) = -matmul(inverse, speed*c1)
        call find_eigenvalues(a, values, vectors, condition, stat)
        if (stat /= 0) error stop 'get_benchmark: no convergence'
    end subroutine get_benchmark

    !> Eigenvalues at many speeds. The coefficients of the 2 x 2 form have 15 digits, and the eigenvalues near the double one at v =
    !> 0.68 half of these.
    subroutine test_bicycle(error)
        type(error_type), allocatable, intent(out) :: error
        real(wp), parameter :: speeds(9) = [0.0_wp, 0.5_wp, 1.0_wp, 2.0_wp, 3.3_wp, 4.0_wp, 5.0_wp, 7.3_wp, 10.0_wp]
        type(scene_type), target :: scene
        type(linearisation_type) :: it
        complex(wp) :: values(4)
        character(len=40) :: setting
        integer :: k

        do k = 1, size(speeds)
            write (setting, '(a, f0.3)') 'parameters.speed=0', speeds(k)
            call linearise_scene('bicycle', [setting], scene, it, error)
            if (allocated(error)) return
            call get_benchmark(speeds(k), values)
            call check_eigenvalues(it, values, 1.0e-10_wp, setting, error)
            call check_count(error, it%kind, merge(at_equilibrium, in_steady_motion, k == 1), 'kind of motion')
        end do
    end subroutine test_bicycle

    !> Digits published by the authors of the benchmark.
    subroutine test_benchmark(error)
        type(error_type), allocatable, intent(out) :: error
        type(scene_type), target :: scene
        type(linearisation_type) :: it
        !> Half a unit of the last digit, and errors of the matrix.
        real(wp), parameter :: bound = 1.0e-12_wp

        call linearise_scene('bicycle', ['parameters.speed=0'], scene, it, error)
        call check_eigenvalues(it, [3.131643247907_wp*(1, 0), -3.131643247907_wp*(1, 0), 5.530943717654_wp*(1, 0), &
            -5.530943717654_wp*(1, 0)], bound, 'v = 0', error)
        call linearise_scene('bicycle', ['parameters.speed=2'], scene, it, error)
        call check_eigenvalues(it, [-8.673879848317_wp*(1, 0), 2.682345175127_wp + i*1.680662965907_wp, &
            2.682345175127_wp - i*1.680662965907_wp, -3.071586456415_wp*(1, 0)], bound, 'v = 2', error)
        call linearise_scene('bicycle', ['parameters.speed=4'], scene, it, error)
        call check_eigenvalues(it, [-12.158614265764_wp*(1, 0), 0.413253315211_wp + i*3.079108186032_wp, &
            0.413253315211_wp - i*3.079108186032_wp, -1.429444273613_wp*(1, 0)], bound, 'v = 4', error)
    end subroutine test_benchmark

    !> A sleigh with its blade behind the centre of mass: u along, turn rate w: (I + m a^2) w' = -m a u w.
    subroutine test_sleigh(error)
        type(error_type), allocatable, intent(out) :: error
        character(len=*), parameter :: nl = new_line('a'), text = '[scene]'//nl//'model = "mechanism"'//nl//'planar = true'//nl// &
            '[parameters]'//nl//'u = 2.0'//nl//'[body.sleigh]'//nl//'mass = 1'//nl//'inertia = 0.1'//nl//'position = [0, 0]'//nl// &
            'velocity = ["u", 0]'//nl//'points = { blade = [-0.1, 0] }'//nl//'[wheel.blade]'//nl//'type = "knife_edge"'//nl// &
            'at = "sleigh.blade"'//nl//'across = [0, 1]'//nl//'[time]'//nl//'end = 1'//nl
        type(scene_type), target :: scene
        type(linearisation_type) :: it

        call linearise_text(text, nothing, scene, it, error)
        if (allocated(error)) return
        call check_eigenvalues(it, [-0.2_wp/0.11_wp*(1, 0)], 1.0e-13_wp, 'sleigh', error)
        call check_count(error, count(abs(it%spectrum%values) > 0.0_wp), 1, 'eigenvalues that are not exactly zero')
        call check_count(error, size(it%spectrum%values), 5, 'eigenvalues')
        call check_count(error, it%kind, in_steady_motion, 'kind of motion')
    end subroutine test_sleigh

    !> A disk rolls straight: lambda^2 = (m g r - C (C + m r^2)/A W^2)/(A + m r^2), by the model derived by hand and as a mechanism.
    subroutine test_disk(error)
        type(error_type), allocatable, intent(out) :: error
        real(wp), parameter :: spins(4) = [1.0_wp, 1.7_wp, 1.9_wp, 3.0_wp]
        real(wp), parameter :: m = 10.0_wp, r = 1.0_wp, g = 9.6_wp, c = 5.0_wp, a = 2.5001_wp
        type(scene_type), target :: scene
        type(linearisation_type) :: it
        complex(wp) :: value
        character(len=60) :: settings(2)
        integer :: k

        do k = 1, size(spins)
            value = sqrt(cmplx((m*g*r - c*(c + m*r**2)/a*spins(k)**2)/(a + m*r**2), 0.0_wp, wp))
            write (settings(1), '(a, f0.2, a)') 'initial.omega=[-', spins(k), ', 0, 0]'
            call linearise_scene('rolling_disk', settings(:1), scene, it, error)
            call check_eigenvalues(it, [value, -value], 1.0e-12_wp, settings(1), error)
            write (settings(1), '(a, f0.2, a)') 'body.disk.omega=[-', spins(k), ', 0, 0]'
            write (settings(2), '(a, f0.2, a)') 'body.disk.velocity=[0, ', spins(k), ', 0]'
            call linearise_scene('mechanism_disk', settings, scene, it, error)
            call check_eigenvalues(it, [value, -value], 1.0e-12_wp, settings(1), error)
            if (allocated(error)) return
            call check_count(error, it%kind, in_steady_motion, 'kind of motion')
        end do
        call linearise_scene('mechanism_disk', [character(len=40) :: 'body.disk.omega=[-1,0,0]', 'body.disk.velocity=[0,1,0]'], &
            scene, it, error)
        call check_eigenvalues(it, [2.297836755675_wp*(1, 0), -2.297836755675_wp*(1, 0)], 1.0e-12_wp, 'as given', error)
    end subroutine test_disk

    !> The rates of (omega, u) of a rattleback in its own axes, u the unit vector downwards: another formulation, with the contact
    !> force eliminated by hand; complex, for derivatives without differences.
    function rattleback_rates(z) result(rates)
        complex(wp), intent(in) :: z(6)
        complex(wp) :: rates(6)
        real(wp), parameter :: squares(3) = [0.2_wp**2, 0.03_wp**2, 0.02_wp**2], m = 1.0_wp, g = 9.81_wp
        real(wp), parameter :: inertia(3, 3) = reshape([2.0e-4_wp, -2.0e-5_wp, 0.0_wp, -2.0e-5_wp, 16.0e-4_wp, 0.0_wp, &
            0.0_wp, 0.0_wp, 17.0e-4_wp], [3, 3])
        complex(wp), dimension(3) :: w, u, rho, rho_rate, u_rate, force, right
        complex(wp) :: length, matrix(3, 3), x(3, 3), determinant
        integer :: k

        w = z(:3)
        u = z(4:)
        length = sqrt(sum(squares*u*u))
        rho = squares*u/length - [0.0_wp, 0.0_wp, 0.01_wp]
        u_rate = -cross(w, u)
        rho_rate = squares*u_rate/length - squares*u*sum(squares*u*u_rate)/length**3
        ! The centre of mass moves with -omega x rho; the force follows from its acceleration, minus the part with omega'.
        force = m*(-cross(w, rho_rate) - cross(w, cross(w, rho)) - g*u)
        do k = 1, 3
            matrix(:, k) = inertia(:, k) - m*cross(rho, cross(rho, unit(k)))
        end do
        right = cross(rho, force) - cross(w, matmul(inertia, w))
        determinant = sum(matrix(:, 1)*cross(matrix(:, 2), matrix(:, 3)))
        x(:, 1) = cross(matrix(:, 2), matrix(:, 3))
        x(:, 2) = cross(matrix(:, 3), matrix(:, 1))
        x(:, 3) = cross(matrix(:, 1), matrix(:, 2))
        rates(:3) = matmul(right, x)/determinant
        rates(4:) = u_rate
    end function rattleback_rates

    pure function unit(k) result(e)
        integer, intent(in) :: k
        complex(wp) :: e(3)

        e = 0.0_wp
        e(k) = 1.0_wp
    end function unit

    pure function cross(a, b) result(c)
        complex(wp), intent(in) :: a(3), b(3)
        complex(wp) :: c(3)

        c = [a(2)*b(3) - a(3)*b(2), a(3)*b(1) - a(1)*b(3), a(1)*b(2) - a(2)*b(1)]
    end function cross

    !> Upright at a spin of -5 rad/s.
    subroutine test_rattleback(error)
        type(error_type), allocatable, intent(out) :: error
        real(wp), parameter :: h = 1.0e-30_wp
        type(scene_type), target :: scene
        type(linearisation_type) :: it
        complex(wp) :: z(6), values(6), vectors(6, 6)
        real(wp) :: matrix(6, 6), condition(6)
        integer :: k, stat

        do k = 1, 6
            z = [0.0_wp, 0.0_wp, -5.0_wp, 0.0_wp, 0.0_wp, 1.0_wp]
            z(k) = z(k) + i*h
            matrix(:, k) = aimag(rattleback_rates(z))/h
        end do
        call find_eigenvalues(matrix, values, vectors, condition, stat)
        call linearise_scene('rattleback', ['parameters.a=0'], scene, it, error)
        if (allocated(error)) return
        values(:4) = pack(values, abs(values) > 1.0_wp)
        call check_eigenvalues(it, values(:4), 1.0e-10_wp, 'rattleback', error)
        call check_count(error, it%kind, in_steady_motion, 'kind of motion')
        ! The frame rotates with the spin, in which a shift of the position rotates.
        call check_true(error, has_eigenvalue(it, 5.0_wp*i, 1.0e-12_wp), 'rate of the frame')
        ! Given with eight digits, five of which are right: the others are errors of differences with steps of 1e-4.
        call check_true(error, has_eigenvalue(it, (2.12069719_wp, 109.39108156_wp), 2.0e-3_wp), 'value given')
    end subroutine test_rattleback

    !> A heavy top with its tip fixed: A P^2 cos(theta) - C w P + m g l = 0 for the precession P and the spin w about its axis, and
    !> the nutation nu^2 = ((C w - 2 A P cos(theta))/A)^2 + P^2 sin(theta)^2 from the potential reduced by its integrals.
    subroutine test_top(error)
        type(error_type), allocatable, intent(out) :: error
        real(wp), parameter :: m = 2.0_wp, l = 0.4_wp, g = 9.81_wp, c = 0.06_wp, a = 0.1_wp + m*l**2, theta = 0.6_wp, p = 1.3_wp
        real(wp), parameter :: w = (a*p**2*cos(theta) + m*g*l)/(c*p), nu = sqrt(((c*w - 2*a*p*cos(theta))/a)**2 + (p*sin(theta))**2)
        character(len=*), parameter :: nl = new_line('a'), text = '[scene]'//nl//'model = "mechanism"'//nl//'[parameters]'//nl// &
            'theta = 0.6'//nl//'p = 1.3'//nl//'s = 0.0'//nl//'[gravity]'//nl//'vector = [0, 0, -9.81]'//nl//'[body.top]'//nl// &
            'mass = 2'//nl//'inertia = [0.1, 0.1, 0.06]'//nl//'position = ["0.4*sin(theta)", 0, "0.4*cos(theta)"]'//nl// &
            'rotation = [0, "theta", 0]'//nl//'velocity = [0, "0.4*p*sin(theta)", 0]'//nl// &
            'omega = ["s*sin(theta)", 0, "p + s*cos(theta)"]'//nl//'[joint.tip]'//nl//'type = "spherical"'//nl// &
            'bodies = ["ground", "top"]'//nl//'at = [0, 0, 0]'//nl//'[time]'//nl//'end = 1'//nl
        type(scene_type), target :: scene
        type(linearisation_type) :: it
        character(len=60) :: settings(3)
        real(wp) :: r(3), found

        write (settings(1), '(a, es24.16)') 'parameters.s=', w - p*cos(theta)
        call linearise_text(text, settings(:1), scene, it, error)
        call check_eigenvalues(it, [i*nu, -i*nu], 1.0e-11_wp, 'nutation', error)
        if (allocated(error)) return
        call check_count(error, it%kind, in_steady_motion, 'kind of motion')
        ! From another tilt, at given rates: the tilt at which they precess.
        settings(2) = 'parameters.theta=0.63'
        settings(3) = 'initial.steady=["world.rotation_z", "top.spin_z"]'
        call linearise_text(text, settings, scene, it, error)
        if (allocated(error)) return
        r = scene%q(:3)/norm2(scene%q(:3))
        found = acos(r(3))
        associate (spin => w - p*cos(theta))
            call check_below(error, abs(a*p**2*cos(found) - c*(spin + p*cos(found))*p + m*g*l), 1.0e-11_wp, 'precession')
        end associate
        call check_true(error, abs(found - theta) < 1.0e-11_wp, 'tilt of the steady precession')
        call check_eigenvalues(it, [i*nu, -i*nu], 1.0e-10_wp, 'nutation where it settles', error)
        if (allocated(error)) return
        ! At a given spin the precession is free: it belongs to the tilt found.
        settings(3) = 'initial.steady=["world.rotation_z", "top.spin_z=95"]'
        call linearise_text(text, settings, scene, it, error)
        if (allocated(error)) return
        r = scene%q(:3)/norm2(scene%q(:3))
        call check_count(error, size(scene%search%rates), 2, 'motions')
        if (allocated(error)) return
        associate (rates => scene%search%rates, spins => scene%search%symmetry%motions%name == 'top.spin_z')
            call check_below(error, abs(sum(rates, spins) - 95.0_wp), 1.0e-12_wp, 'the spin that is held')
            if (allocated(error)) return
            associate (precession => sum(rates, .not. spins))
                call check_below(error, abs(a*precession**2*r(3) - c*(95.0_wp + precession*r(3))*precession + m*g*l), 1.0e-11_wp, &
                    'precession at a spin')
            end associate
        end associate
    end subroutine test_top

    !> A against differences of eighth order of V'qd and W'qdd in the coordinates of a dense chart, another formulation: <= 1e-10 of
    !> its norm, where differences with steps of 1/512 of a unit have errors of 1e-12.
    subroutine test_matrix(error)
        type(error_type), allocatable, intent(out) :: error
        character(len=*), parameter :: scenes(8) = [character(len=20) :: 'a01_pendulum', 'a05_governor', 'bicycle', &
            'spatial_slider_crank', 'turntable', 'trailers', 'chaplygin_sphere', 'rattleback']
        class(model_type), allocatable, target :: model
        type(scene_type), allocatable, target :: scene
        type(simulation_type), allocatable :: simulation
        type(failure_type), allocatable :: failure
        character(len=:), allocatable :: path
        real(wp), allocatable :: q(:), qd(:)
        integer :: k

        do k = 1, size(subject_names)
            call new_subject(subject_names(k), model, q, qd)
            call compare(model, q, qd, 2.0_wp**(-9), subject_names(k), error)
            if (allocated(error)) return
        end do
        do k = 1, size(scenes)
            if (allocated(scene)) deallocate (scene)
            allocate (scene)
            call find_scene(trim(scenes(k)), path, failure)
            if (scenes(k) == 'bicycle') then
                call read_scene(path, ['parameters.lean=0.3'], scene, failure)
            else
                call read_scene(path, nothing, scene, failure)
            end if
            call check_no_failure(error, failure)
            if (allocated(error)) return
            if (allocated(simulation)) deallocate (simulation)
            allocate (simulation)
            call simulation%initialize(scene%model, scene%options, 0.0_wp, scene%q, scene%qd, failure, scene%assembly)
            call check_no_failure(error, failure)
            if (allocated(error)) return
            ! The rattleback's contact moves along the stone within a tenth of a unit of its Euler parameters.
            call compare(scene%model, simulation%state%q, simulation%state%qd, 2.0_wp**merge(-13, -9, scenes(k) == 'rattleback'), &
                scenes(k), error)
            if (allocated(error)) return
        end do
    end subroutine test_matrix

    !> The same at one point, in a fixed frame.
    subroutine compare(model, q, qd, unit_step, name, error)
        class(model_type), intent(inout), target :: model
        real(wp), intent(in) :: q(:), qd(:)
        !> Step of a coordinate.
        real(wp), intent(in) :: unit_step
        character(len=*), intent(in) :: name
        type(error_type), allocatable, intent(inout) :: error
        type(linearisation_type) :: it
        type(dense_chart_type) :: chart
        type(options_type) :: options
        type(failure_type), allocatable :: failure
        real(wp), allocatable :: expected(:, :), f(:), l(:, :)
        real(wp) :: none(model%n)
        real(wp), parameter :: weight(4) = [4.0_wp/5, -1.0_wp/5, 4.0_wp/105, -1.0_wp/280]
        !> Coordinates change by up to 4 h and velocities by that over the rate of the motion.
        real(wp) :: h, scale, worst
        integer :: j, k, side, stat, n

        ! Kept charts have the paper's complement, with coordinates v and w.
        options%chart = 'adaptive'
        call chart%attach(model, options, .false., .false., failure)
        call check_no_failure(error, failure)
        if (allocated(error)) return
        call it%make(model, 0.0_wp, q, qd, failure)
        call check_no_failure(error, failure)
        if (allocated(error)) return
        n = it%nv + it%nw
        allocate (expected(n, n), source=0.0_wp)
        allocate (f(n))
        do j = 1, n
            scale = 1.0_wp
            if (j > it%nv) scale = max(1.0_wp, maxval(abs(qd)))
            h = unit_step*scale
            do k = 1, 4
                do side = -1, 1, 2
                    none = 0.0_wp
                    call chart%set_origin(0.0_wp, q, qd, .false., none, stat)
                    call evaluate(side*k*h)
                    if (stat /= 0) then
                        call test_failed(error, name//': cannot be evaluated beside the point')
                        return
                    end if
                    expected(:, j) = expected(:, j) + side*weight(k)/h*f
                end do
            end do
        end do
        if (it%kind == in_steady_motion) then
            l = it%symmetry%matrix(it%rates, model%n)
            expected(:it%nv, :it%nv) = expected(:it%nv, :it%nv) - matmul(it%dual_v, matmul(l, it%v))
            expected(it%nv + 1:, :it%nv) = expected(it%nv + 1:, :it%nv) - matmul(it%dual_w, matmul(l, it%g))
            expected(it%nv + 1:, it%nv + 1:) = expected(it%nv + 1:, it%nv + 1:) - matmul(it%dual_w, matmul(l, it%w))
        end if
        worst = maxval(abs(it%a - expected))/norm2(it%a)
        call check_below(error, worst, 1.0e-10_wp, trim(name)//': A')

    contains

        subroutine evaluate(move)
            real(wp), intent(in) :: move
            real(wp), dimension(model%n) :: increment, increment_qd, x, v, a

            increment = 0.0_wp
            increment_qd = 0.0_wp
            if (j <= it%nv) then
                increment = move*it%v(:, j)
            else
                increment_qd = move*it%w(:, j - it%nv)
            end if
            call chart%restore(0.0_wp, increment, increment_qd, step_end, x, v, stat)
            if (stat == 0) call chart%accelerate(0.0_wp, x, v, step_end, a, stat)
            f = [matmul(it%dual_v, v), matmul(it%dual_w, a)]
        end subroutine evaluate
    end subroutine compare

    !> A model without derivatives: central differences of fourth order have errors of 1e-9 of the norm.
    subroutine test_stand_in(error)
        type(error_type), allocatable, intent(out) :: error
        class(model_type), allocatable, target :: model
        type(linearisation_type) :: exact, other
        type(failure_type), allocatable :: failure
        real(wp), allocatable :: q(:), qd(:)
        integer :: k

        do k = 1, size(subject_names)
            call new_subject(subject_names(k), model, q, qd)
            call exact%make(model, 0.0_wp, q, qd, failure)
            call check_no_failure(error, failure)
            call check_true(error, exact%has_gradients, 'gradients of its own')
            model%evaluate_derivatives => null()
            model%provides_derivatives = 0
            select type (model)
            class is (procedure_model_type)
                model%jacobian_derivative => null()
                model%nu_derivative => null()
                model%gamma_q => null()
                model%gamma_qd => null()
                model%mass_derivative => null()
                model%reaction_derivative => null()
                model%force_q => null()
                model%force_qd => null()
            end select
            call other%make(model, 0.0_wp, q, qd, failure)
            call check_no_failure(error, failure)
            if (allocated(error)) return
            call check_true(error, .not. other%has_gradients, 'says that it has none')
            call check_below(error, maxval(abs(exact%a - other%a))/norm2(exact%a), 1.0e-9_wp, 'A by differences')
            call check_count(error, size(other%symmetry%rates, 2), size(exact%symmetry%rates, 2), 'symmetries found')
        end do
    end subroutine test_stand_in

    !> Numbers of zeros due to symmetries and to families, and sizes of their blocks.
    subroutine test_zeros(error)
        type(error_type), allocatable, intent(out) :: error
        type(scene_type), target :: scene
        type(linearisation_type) :: it

        call linearise_scene('bicycle', ['parameters.speed=4'], scene, it, error)
        if (allocated(error)) return
        ! Positions in the plane, the heading, rotations of two wheels; the speed. A faster motion is ahead, a turned one is off to
        ! the side.
        call check_count(error, count(it%spectrum%cause == of_symmetry), 5, 'symmetries')
        call check_count(error, count(it%spectrum%cause == of_family), 1, 'families')
        call check_count(error, it%spectrum%n_zeros, 6, 'zeros')
        call check_count(error, it%spectrum%blocks(1), 4, 'Jordan blocks')
        call check_count(error, it%spectrum%blocks(2), 2, 'Jordan blocks of size two')
        call check_count(error, count(abs(it%rates) > 0.0_wp), 3, 'fields along which it goes on')
        call check_below(error, abs(it%rates(1) - 4.0_wp), 1.0e-12_wp, 'speed')
        ! At rest.
        call linearise_scene('bicycle', ['parameters.speed=0'], scene, it, error)
        if (allocated(error)) return
        call check_count(error, it%spectrum%n_zeros, 6, 'zeros at rest')
        call check_true(error, it%nv - it%nw <= it%spectrum%n_zeros, 'at least as many as nonholonomic rows')
    end subroutine test_zeros

    !> A nilpotent matrix of blocks of size 3, 2 and 1 and a regular part, under an orthogonal transformation.
    subroutine test_jordan(error)
        type(error_type), allocatable, intent(out) :: error
        integer, parameter :: n = 9
        real(wp) :: a(n, n), q(n, n), h(n, n), x(n), b(n, n)
        complex(wp) :: values(3), vectors(3, 3)
        real(wp) :: condition(3)
        integer, allocatable :: dimensions(:)
        integer :: k, stat

        a = 0.0_wp
        a(1, 2) = 1.5_wp
        a(2, 3) = -0.7_wp
        a(4, 5) = 2.0_wp
        a(7, 7) = -1.0_wp
        a(8, 9) = 2.0_wp
        a(9, 8) = -2.0_wp
        a(3, 7) = 0.3_wp
        h = 0.0_wp
        do k = 1, n
            x(k) = sin(3.0_wp*k) + 0.2_wp
            h(k, k) = 1.0_wp
        end do
        h = h - 2*matmul(reshape(x, [n, 1]), reshape(x, [1, n]))/sum(x**2)
        a = matmul(h, matmul(a, h))
        b = a
        call split_zeros(b, 1.0e-12_wp, q, k, dimensions)
        call check_count(error, k, 6, 'zeros')
        call check_count(error, size(dimensions), 3, 'length of the longest chain')
        if (allocated(error)) return
        call check_true(error, all(dimensions == [3, 2, 1]), 'blocks of each size')
        ! Rounding error of two products for each of the three stages.
        call check_below(error, maxval(abs(matmul(transpose(q), matmul(a, q)) - b)), 6*n*epsilon(1.0_wp)*norm2(a), &
            'transformation')
        call find_eigenvalues(b(7:, 7:), values, vectors, condition, stat)
        call check_below(error, minval(abs(values - (-1.0_wp))), 1.0e-14_wp, 'eigenvalue -1')
        call check_below(error, minval(abs(values - 2.0_wp*i)), 1.0e-14_wp, 'eigenvalue 2i')
    end subroutine test_jordan

    !> The disturbed disk is neither at rest nor steady; the driven vehicle depends on the time.
    subroutine test_instant(error)
        type(error_type), allocatable, intent(out) :: error
        type(scene_type), target :: scene
        type(linearisation_type) :: it

        call linearise_scene('mechanism_disk', nothing, scene, it, error)
        if (allocated(error)) return
        call check_count(error, it%kind, at_an_instant, 'kind of the disk''s motion')
        call check_true(error, .not. it%depends_on_time .and. it%residual > 1.0e-4_wp, 'what is left of its rates')
        call linearise_scene('mechanism_vehicle', nothing, scene, it, error)
        if (allocated(error)) return
        call check_count(error, it%kind, at_an_instant, 'kind of the vehicle''s motion')
        call check_true(error, it%depends_on_time, 'dependence on the time')
    end subroutine test_instant
end module test_linearisation
