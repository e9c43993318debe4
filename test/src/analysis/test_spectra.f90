! SPDX-License-Identifier: MIT
!> Tests of linearised systems with driven motions, rotating frames or locked couplings, and of the stated errors.
module test_spectra
    use asserts, only: check_below, check_count, check_no_failure, check_true
    use linearised, only: check_eigenvalues, linearise_text
    use tandem, only: at_an_instant, failure_type => error_type, in_steady_motion, linearisation_type, nearest_type, of_motion, &
        equilibrium_search_type, wp
    use tandem_io, only: read_scene, scene_type
    use tandem_linalg_random, only: random_vector
    use tandem_mechanism, only: mechanism_type
    use tandem_mechanism_census, only: census_type, take_census
    use testdrive, only: error_type, new_unittest, unittest_type
    implicit none (type, external)
    private

    public :: collect_spectra

    character(len=*), parameter :: nl = new_line('a')
    character(len=1), parameter :: nothing(0) = [character(len=1) ::]
    complex(wp), parameter :: i = (0.0_wp, 1.0_wp)
    !> A motor-driven shaft that rotates about the vertical, and an arm that hangs from it.
    character(len=*), parameter :: hoop = '[scene]'//nl//'model = "mechanism"'//nl//'[parameters]'//nl//'w = 3.0'//nl// &
        '[gravity]'//nl//'vector = [0, 0, -9.81]'//nl//'[body.shaft]'//nl//'mass = 1'//nl//'inertia = [1, 1, 1]'//nl// &
        'position = [0, 0, 0]'//nl//'omega = [0, 0, "w"]'//nl//'[body.arm]'//nl//'mass = 1'//nl//'inertia = [0.1, 0.1, 0.1]'// &
        nl//'position = [0, 0, -1]'//nl//'omega = [0, 0, "w"]'//nl//'[joint.motor]'//nl//'type = "revolute"'//nl// &
        'bodies = ["ground", "shaft"]'//nl//'at = [0, 0, 0]'//nl//'axis = [0, 0, 1]'//nl//'motion = "w*t"'//nl// &
        '[joint.hinge]'//nl//'type = "revolute"'//nl//'bodies = ["shaft", "arm"]'//nl//'at = [0, 0, 0]'//nl// &
        'axis = [0, 1, 0]'//nl//'[time]'//nl//'end = 1'//nl
    !> A disk in a rubber ring on a motor-driven shaft.
    character(len=*), parameter :: ring = '[scene]'//nl//'model = "mechanism"'//nl//'[parameters]'//nl//'w = 3.0'//nl// &
        '[body.shaft]'//nl//'mass = 1'//nl//'inertia = [1, 1, 1]'//nl//'position = [0, 0, 0]'//nl//'omega = [0, 0, "w"]'//nl// &
        '[body.disk]'//nl//'mass = 2'//nl//'inertia = [0.1, 0.1, 0.15]'//nl//'position = [0, 0, 0]'//nl//'omega = [0, 0, "w"]'// &
        nl//'[joint.motor]'//nl//'type = "revolute"'//nl//'bodies = ["ground", "shaft"]'//nl//'at = [0, 0, 0]'//nl// &
        'axis = [0, 0, 1]'//nl//'motion = "w*t"'//nl//'[joint.slide]'//nl//'type = "primitive"'//nl// &
        'bodies = ["shaft", "disk"]'//nl//'at = [0, 0, 0]'//nl//'axis = [0, 0, 1]'//nl//'hold = [0, 0, 1, 1, 1, 1]'//nl// &
        '[force.rubber]'//nl//'type = "bushing"'//nl//'between = ["shaft", "disk"]'//nl//'at = [0, 0, 0]'//nl// &
        'axis = [0, 0, 1]'//nl//'stiffness = [800, 800, 0, 0, 0, 0]'//nl//'damping = [3, 3, 0, 0, 0, 0]'//nl//'[time]'//nl// &
        'end = 1'//nl
    !> Two links; a coupling may lock the second to the first.
    character(len=*), parameter :: links = '[scene]'//nl//'model = "mechanism"'//nl//'planar = true'//nl//'[gravity]'//nl// &
        'vector = [0, -9.81]'//nl//'[body.a]'//nl//'mass = 1'//nl//'inertia = 0.1'//nl//'position = [0, -1]'//nl//'[body.b]'//nl// &
        'mass = 1'//nl//'inertia = 0.1'//nl//'position = [0, -2]'//nl//'[joint.p]'//nl//'type = "revolute"'//nl// &
        'bodies = ["ground", "a"]'//nl//'at = [0, 0]'//nl//'[joint.q]'//nl//'type = "revolute"'//nl//'bodies = ["a", "b"]'//nl// &
        'at = [0, -1.5]'//nl//'[force.d]'//nl//'type = "torsion"'//nl//'joint = "p"'//nl//'damping = 0.3'//nl// &
        '[constraint.latch]'//nl//'type = "coupling"'//nl//'joints = ["q"]'//nl//'factors = [1]'//nl//'locked = true'//nl// &
        '[time]'//nl//'end = 1'//nl
    !> A plate without mass but with inertia between two joints, one of which has a damper; all else is free.
    character(len=*), parameter :: plate = '[scene]'//nl//'model = "mechanism"'//nl//'[body.plate]'//nl//'mass = 0'//nl// &
        'position = [0, 0, 0]'//nl//'inertia = [0.03, 0.02, 0.01]'//nl//'[body.block]'//nl//'mass = 1'//nl// &
        'position = [0, 0, 0]'//nl//'inertia = [0.01, 0.02, 0.03]'//nl//'[joint.flat]'//nl//'type = "planar"'//nl// &
        'bodies = ["block", "plate"]'//nl//'at = [0, 0, 0]'//nl//'axis = [1, 0, 0]'//nl//'[joint.line]'//nl// &
        'type = "point_on_line"'//nl//'bodies = ["ground", "plate"]'//nl//'at = [0, 0, 0]'//nl//'axis = [1, 0, 0]'//nl// &
        '[force.damper]'//nl//'type = "torsion"'//nl//'joint = "line"'//nl//'damping = 1'//nl//'[time]'//nl//'end = 1'//nl

contains

    !> The suite.
    subroutine collect_spectra(testsuite)
        type(unittest_type), allocatable, intent(out) :: testsuite(:)

        testsuite = [ &
            new_unittest('an-arm-on-a-driven-shaft-agrees-with-its-closed-form', test_hoop), &
            new_unittest('derivatives-with-respect-to-time-are-exact-at-any-speed', test_ring), &
            new_unittest('a-load-that-turns-along-is-a-steady-motion', test_load), &
            new_unittest('a-rate-that-changes-later-is-no-steady-motion', test_rate), &
            new_unittest('drift-in-a-turning-frame-is-no-motion', test_drift), &
            new_unittest('locked-couplings-have-no-freedom', test_latch), &
            new_unittest('only-finite-eigenvalues-are-near', test_finite), &
            new_unittest('stated-errors-bound-those-of-chains-of-masses', test_chains), &
            new_unittest('stated-errors-bound-those-of-double-eigenvalues', test_double)]
    end subroutine collect_spectra

    !> (I + m l^2) lambda^2 = w^2 m l^2 - m g l for isotropic inertia; above the critical speed it leaves the vertical.
    subroutine test_hoop(error)
        type(error_type), allocatable, intent(out) :: error
        real(wp), parameter :: speeds(5) = [0.5_wp, 3.0_wp, 4.0_wp, 5.0_wp, 30.0_wp]
        type(scene_type), target :: scene
        type(linearisation_type) :: it
        type(nearest_type) :: near
        type(failure_type), allocatable :: failure
        character(len=40) :: setting
        complex(wp) :: value
        integer :: k

        do k = 1, size(speeds)
            write (setting, '(a, f0.1)') 'parameters.w=0', speeds(k)
            call linearise_text(hoop, [setting], scene, it, error)
            if (allocated(error)) return
            value = sqrt(cmplx((speeds(k)**2 - 9.81_wp)/1.1_wp, 0.0_wp, wp))
            call check_eigenvalues(it, [value, -value], 1.0e-12_wp*(1 + speeds(k)), setting, error)
            call check_count(error, it%kind, in_steady_motion, 'kind of motion')
            call check_below(error, maxval(abs(it%spectrum%values**2 - value**2)/(2*abs(value)*it%spectrum%error)), 1.0_wp, &
                'error over the stated one')
            call near%find(scene%model, 0.0_wp, scene%q, (0.0_wp, 0.5_wp), 2, failure, scene%qd)
            call check_no_failure(error, failure)
            if (allocated(error)) return
            call check_below(error, maxval(abs(near%values**2 - value**2)/(2*abs(value)*near%error)), 1.0_wp, &
                'error near a shift over the stated one')
        end do
    end subroutine test_hoop

    !> m (z'' + 2 i w z' - w^2 z) + c z' + k z = 0 in co-rotating axes.
    subroutine test_ring(error)
        type(error_type), allocatable, intent(out) :: error
        real(wp), parameter :: speeds(4) = [3.0_wp, 20.5_wp, 150.0_wp, 1000.0_wp]
        type(scene_type), target :: scene
        type(linearisation_type) :: it
        character(len=40) :: setting
        complex(wp) :: values(4), root
        integer :: k, j

        do k = 1, size(speeds)
            write (setting, '(a, f0.1)') 'parameters.w=', speeds(k)
            call linearise_text(ring, [setting], scene, it, error)
            if (allocated(error)) return
            root = sqrt(9 - 8*(800 - 3*i*speeds(k)))
            values(:2) = (-3 + [root, -root])/4 - i*speeds(k)
            values(3:) = conjg(values(:2))
            ! Terms of w**2 cancel in roots that are 40 apart: so much of them is the last digit of an eigenvalue.
            call check_eigenvalues(it, values, 50*epsilon(1.0_wp)*max(40.0_wp, speeds(k)**2/40), setting, error)
            if (allocated(error)) return
            do j = 1, 4
                call check_below(error, minval(abs(values - it%spectrum%values(j))), it%spectrum%error(j), 'error')
            end do
        end do
    end subroutine test_ring

    !> An unbalanced force that rotates with the shaft holds the disk aside, (k - m w^2) x = F: the frame has to rotate at its rate,
    !> and small motions are those without the force.
    subroutine test_load(error)
        type(error_type), allocatable, intent(out) :: error
        character(len=*), parameter :: load = '[force.unbalance]'//nl//'type = "load"'//nl//'on = "disk"'//nl// &
            'force = ["6*cos(w*t)", "6*sin(w*t)", 0]'//nl
        real(wp), parameter :: w = 10.0_wp, k = 800.0_wp, m = 2.0_wp
        type(scene_type), target :: scene
        type(linearisation_type) :: it
        complex(wp) :: values(4), root

        call linearise_text(ring//load//'[initial]'//nl//'steady = ["any"]'//nl, [character(len=20) :: 'parameters.w=10'], &
            scene, it, error)
        if (allocated(error)) return
        root = sqrt(9 - 8*(k - 3*i*w))
        values(:2) = (-3 + [root, -root])/4 - i*w
        values(3:) = conjg(values(:2))
        call check_eigenvalues(it, values, 1.0e-11_wp, 'with a load', error)
        call check_count(error, it%kind, in_steady_motion, 'kind of motion')
        ! The disk is the second body.
        call check_below(error, abs(it%q(8) - 6/(k - m*w**2)) + abs(it%q(9)), 1.0e-12_wp, 'place of the disk')
    end subroutine test_load

    !> w t + t^3/10 has a constant rate to second order at t = 0 only.
    subroutine test_rate(error)
        type(error_type), allocatable, intent(out) :: error
        type(scene_type), target :: scene
        type(linearisation_type) :: it

        call linearise_text(hoop, [character(len=40) :: 'joint.motor.motion="w*t + t^3/10"'], scene, it, error)
        if (allocated(error)) return
        call check_count(error, it%kind, at_an_instant, 'kind of motion')
        call linearise_text(hoop, [character(len=40) :: 'joint.motor.motion="w*t + t^5/10"'], scene, it, error)
        if (allocated(error)) return
        call check_count(error, it%kind, at_an_instant, 'kind of motion')
    end subroutine test_rate

    !> A body rotates beside the shaft without any force: in the frame its drift circles, in Jordan blocks of i w, as does its
    !> motion about another axis. One motion remains, its nutation, sqrt((C - A) (C - B)/(A B)) w, in the frame as in its own axes.
    subroutine test_drift(error)
        type(error_type), allocatable, intent(out) :: error
        character(len=*), parameter :: free = '[body.free]'//nl//'mass = 2'//nl//'inertia = [0.1, 0.12, 0.15]'//nl// &
            'position = [0, 0, 1]'//nl//'omega = [0, 0, "w"]'//nl
        real(wp), parameter :: speeds(3) = [1.0_wp, 3.0_wp, 7.7_wp]
        type(scene_type), target :: scene
        type(linearisation_type) :: it
        character(len=40) :: setting
        complex(wp) :: values(6), root
        real(wp) :: nutation
        integer :: k

        do k = 1, size(speeds)
            write (setting, '(a, f0.1)') 'parameters.w=', speeds(k)
            call linearise_text(ring//free, [setting], scene, it, error)
            if (allocated(error)) return
            root = sqrt(9 - 8*(800 - 3*i*speeds(k)))
            nutation = sqrt(0.05_wp*0.03_wp/(0.1_wp*0.12_wp))*speeds(k)
            values = [(-3 + root)/4 - i*speeds(k), (-3 - root)/4 - i*speeds(k), i*nutation, (0.0_wp, 0.0_wp), (0.0_wp, 0.0_wp), &
                (0.0_wp, 0.0_wp)]
            values(4:) = conjg(values(:3))
            call check_eigenvalues(it, values, 1.0e-11_wp, setting, error)
            if (allocated(error)) return
            call check_count(error, it%kind, in_steady_motion, 'kind of motion')
            call check_count(error, count(abs(it%spectrum%values - i*speeds(k)) < 1.0e-12_wp), 3, &
                'values at the rate of the frame')
        end do
    end subroutine test_drift

    !> One degree of freedom; (0.1 + 1 + 0.1 + 4) s'' + 0.3 s' + (1 + 2) 9.81 s = 0.
    subroutine test_latch(error)
        type(error_type), allocatable, intent(out) :: error
        type(scene_type), target :: scene
        type(linearisation_type) :: it
        type(equilibrium_search_type) :: search
        type(census_type) :: census
        type(failure_type), allocatable :: failure
        complex(wp) :: value
        integer :: stat

        call linearise_text(links, nothing, scene, it, error)
        if (allocated(error)) return
        value = cmplx(-0.3_wp, sqrt(4*5.2_wp*3*9.81_wp - 0.09_wp), wp)/(2*5.2_wp)
        call check_eigenvalues(it, [value, conjg(value)], 1.0e-13_wp, 'locked', error)
        call check_count(error, size(it%spectrum%values), 2, 'eigenvalues')
        select type (mechanism => scene%model)
        class is (mechanism_type)
            call take_census(mechanism, 0.0_wp, scene%q, scene%qd, census, stat)
            call check_count(error, census%position_freedom, 1, 'degrees of freedom')
            call check_count(error, census%velocity_freedom, 1, 'degrees of freedom at velocity level')
        end select
        call search%find_equilibrium(scene%model, 0.0_wp, scene%q, failure)
        call check_no_failure(error, failure)
        call check_count(error, search%n_free, 0, 'directions that lead to other equilibria')
        call linearise_text(links, [character(len=40) :: 'constraint.latch.locked=false'], scene, it, error)
        if (allocated(error)) return
        call check_count(error, count(it%spectrum%cause == of_motion), 4, 'eigenvalues of the free links')
    end subroutine test_latch

    !> -c/m, and zeros in Jordan blocks; there are 14 finite ones, whatever the shift is.
    subroutine test_finite(error)
        type(error_type), allocatable, intent(out) :: error
        complex(wp), parameter :: shifts(4) = [(-1.9_wp, 14.1_wp), (0.5_wp, 0.0_wp), (-3.0_wp, 0.2_wp), (0.0_wp, 100.0_wp)]
        type(scene_type), target :: scene
        type(nearest_type) :: near
        type(failure_type), allocatable :: failure
        integer :: k, j

        do k = 1, size(shifts)
            call read_scene('test.toml', nothing, scene, failure, text=plate)
            if (.not. allocated(failure)) call near%find(scene%model, 0.0_wp, scene%q, shifts(k), 20, failure)
            call check_no_failure(error, failure)
            if (allocated(error)) return
            call check_count(error, size(near%values), 14, 'eigenvalues')
            call check_true(error, near%is_complete, 'all of them were found')
            call check_count(error, count(abs(near%values + 1) < 1.0e-9_wp), 1, 'eigenvalues at -1')
            do j = 1, size(near%values)
                call check_below(error, min(abs(near%values(j)), abs(near%values(j) + 1)), near%error(j), 'error')
            end do
        end do
    end subroutine test_finite

    !> Masses on a rail between springs and dampers of all sizes, which are uncoupled: m s^2 + c s + k = 0 of each.
    function masses(m, c, k) result(text)
        real(wp), intent(in) :: m(:), c(:), k(:)
        character(len=:), allocatable :: text
        character(len=24) :: of_m, of_c, of_k, number
        integer :: j

        text = '[scene]'//nl//'model = "mechanism"'//nl//'planar = true'//nl
        do j = 1, size(m)
            write (number, '(i0)') j
            write (of_m, '(es24.16)') m(j)
            write (of_c, '(es24.16)') c(j)
            write (of_k, '(es24.16)') k(j)
            text = text//'[body.b'//trim(number)//']'//nl//'mass = '//trim(adjustl(of_m))//nl//'inertia = 1'//nl// &
                'position = [0, '//trim(number)//']'//nl//'[joint.j'//trim(number)//']'//nl//'type = "prismatic"'//nl// &
                'bodies = ["ground", "b'//trim(number)//'"]'//nl//'at = [0, '//trim(number)//']'//nl//'axis = [1, 0]'//nl// &
                '[force.f'//trim(number)//']'//nl//'type = "torsion"'//nl//'joint = "j'//trim(number)//'"'//nl// &
                'stiffness = '//trim(adjustl(of_k))//nl//'damping = '//trim(adjustl(of_c))//nl
        end do
        text = text//'[time]'//nl//'end = 1'//nl
    end function masses

    !> The two zeros of m s^2 + c s + k, without cancellation.
    pure function zeros_of(m, c, k) result(values)
        real(wp), intent(in) :: m, c, k
        complex(wp) :: values(2), root

        root = sqrt(cmplx(c**2 - 4*m*k, 0.0_wp, wp))
        values(1) = -(c + root)/(2*m)
        values(2) = k/(m*values(1))
    end function zeros_of

    !> Largest ratio of the error to the stated one, for both analyses.
    subroutine check_errors(m, c, k, shift, what, error)
        real(wp), intent(in) :: m(:), c(:), k(:)
        complex(wp), intent(in) :: shift
        character(len=*), intent(in) :: what
        type(error_type), allocatable, intent(inout) :: error
        type(scene_type), target :: scene
        type(linearisation_type) :: it
        type(nearest_type) :: near
        type(failure_type), allocatable :: failure
        complex(wp) :: values(2*size(m))
        real(wp) :: worst
        integer :: j

        do j = 1, size(m)
            values(2*j - 1:2*j) = zeros_of(m(j), c(j), k(j))
        end do
        call linearise_text(masses(m, c, k), nothing, scene, it, error)
        if (allocated(error)) return
        worst = 0.0_wp
        do j = 1, size(it%spectrum%values)
            worst = max(worst, minval(abs(values - it%spectrum%values(j)))/max(it%spectrum%error(j), tiny(1.0_wp)))
        end do
        call check_below(error, worst, 1.0_wp, what//': error over the stated one')
        call near%find(scene%model, 0.0_wp, scene%q, shift, 2*size(m), failure)
        call check_no_failure(error, failure)
        if (allocated(error)) return
        worst = 0.0_wp
        do j = 1, size(near%values)
            worst = max(worst, minval(abs(values - near%values(j)))/max(near%error(j), tiny(1.0_wp)))
        end do
        call check_below(error, worst, 1.0_wp, what//' near a shift: error over the stated one')
    end subroutine check_errors

    !> Random masses, dampers and springs over six powers of ten.
    subroutine test_chains(error)
        type(error_type), allocatable, intent(out) :: error
        real(wp), dimension(4) :: m, c, k
        integer :: seed, sample

        seed = 1123
        do sample = 1, 20
            m = 10**(1.5_wp*random_vector(seed, 4))
            c = 10**(1.5_wp*random_vector(seed, 4))
            k = 10**(3*random_vector(seed, 4))
            call check_errors(m, c, k, cmplx(-1.0_wp, 3.0_wp, wp), 'masses', error)
            if (allocated(error)) return
        end do
    end subroutine test_chains

    !> c^2 = 4 m k: a Jordan block, once, twice, and two almost equal ones.
    subroutine test_double(error)
        type(error_type), allocatable, intent(out) :: error
        real(wp), parameter :: one(1) = 1.0_wp
        real(wp) :: d
        integer :: j

        call check_errors(one, 2*one, one, (-1.5_wp, 0.0_wp), 'a double one', error)
        call check_errors([1.0_wp, 1.0_wp], [2.0_wp, 2.0_wp], [1.0_wp, 1.0_wp], (-1.5_wp, 0.0_wp), 'two double ones', error)
        call check_errors(0.3_wp*one, 2*sqrt(0.3_wp*0.7_wp)*one, 0.7_wp*one, (-1.5_wp, 0.3_wp), 'a rounded double one', error)
        do j = 2, 15
            d = 10.0_wp**(-j)
            call check_errors(one, (2 + d)*one, one, (-1.5_wp, 0.0_wp), 'nearly a double one', error)
            call check_errors([1.0_wp, 1.0_wp], [2 - d, 2.0_wp], [1.0_wp, 1.0_wp + d], (-1.5_wp, 0.0_wp), &
                'two near each other', error)
        end do
    end subroutine test_double
end module test_spectra
