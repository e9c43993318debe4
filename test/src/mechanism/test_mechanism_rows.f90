! SPDX-License-Identifier: MIT
!> Tests of rows of mechanisms beyond those of simple joints, each in isolation against differences at random states: freedoms of
!> the primitive at either level, couplings, rows by expression, rolling on moving planes; and runs against closed forms.
module test_mechanism_rows
    use asserts, only: check_below, check_close, check_count, check_no_failure, check_true
    use mechanism_checks, only: check_drawing, draw, verify
    use tandem, only: assembly_type, expression_function, expression_type, failure_type => error_type, finding_type, &
        mechanism_type, options_type, parse_expression, plane_type, polynomial_type, ramp, simulation_type, sine_type, terms_type, &
        verify_model, wp
    use terms_at, only: get_terms
    use testdrive, only: error_type, new_unittest, unittest_type
    implicit none (type, external)
    private

    public :: collect_mechanism_rows

    real(wp), parameter :: at(3) = [0.7_wp, 0.5_wp, 0.2_wp], axis(3) = [1.0_wp, 2.0_wp, -0.5_wp], pi = acos(-1.0_wp)

contains

    !> The suite.
    subroutine collect_mechanism_rows(testsuite)
        type(unittest_type), allocatable, intent(out) :: testsuite(:)

        testsuite = [ &
            new_unittest('freedoms-of-the-primitive', test_primitive), &
            new_unittest('freedoms-at-velocity-level', test_glides), &
            new_unittest('couplings', test_couplings), &
            new_unittest('a-check-leaves-turns-as-they-were', test_turns_after_check), &
            new_unittest('turns-are-counted-where-steps-arrive', test_turns_of_steps), &
            new_unittest('turns-of-gears-are-summed-without-rounding', test_many_turns), &
            new_unittest('an-imposed-angle-starts-where-it-is-asked-to', test_imposed_angles), &
            new_unittest('rows-by-expression', test_rate_rows), &
            new_unittest('ellipsoids-round-rims-moving-planes', test_rolling), &
            new_unittest('names-and-units', test_names), &
            new_unittest('what-cannot-be', test_words)]
    end subroutine collect_mechanism_rows

    !> Two gears of 7 to 3 after so many turns that an angle has no digit below 1e-11 rad: next to their meshing position their
    !> error is as exact as at the start.
    subroutine test_many_turns(error)
        type(error_type), allocatable, intent(out) :: error
        type(mechanism_type) :: mechanism
        type(failure_type), allocatable :: failure
        type(terms_type) :: terms
        real(wp), parameter :: pi = acos(-1.0_wp), z(3) = [0.0_wp, 0.0_wp, 1.0_wp], beside(2) = [0.2_wp, 0.1_wp]
        integer, parameter :: last = 200000
        real(wp), allocatable :: q(:), qd(:)
        integer :: i, stat

        call mechanism%add_body('a', 1.0_wp, [0.0_wp, 0.0_wp, 0.0_wp], failure, inertia=[0.1_wp, 0.1_wp, 0.2_wp])
        call mechanism%add_body('b', 1.0_wp, [1.0_wp, 0.0_wp, 0.0_wp], failure, inertia=[0.1_wp, 0.1_wp, 0.2_wp])
        call mechanism%add_joint('ja', 'revolute', 'ground', 'a', failure, at=[0.0_wp, 0.0_wp, 0.0_wp], axis=z)
        call mechanism%add_joint('jb', 'revolute', 'ground', 'b', failure, at=[1.0_wp, 0.0_wp, 0.0_wp], axis=z)
        call mechanism%add_coupling('gear', ['ja', 'jb'], [7.0_wp, 3.0_wp], failure)
        call check_no_failure(error, failure)
        call mechanism%define(failure)
        call check_no_failure(error, failure)
        if (allocated(error)) return
        allocate (q(mechanism%n), qd(mechanism%n))
        call mechanism%start(q, qd)
        call mechanism%arrive(0.0_wp, q, .true.)
        do i = 1, last
            q(4:7) = parameters(0.15_wp*modulo(i, 20))
            q(11:14) = parameters(-0.35_wp*modulo(i, 20))
            call mechanism%arrive(0.0_wp, q, .false.)
        end do
        q(4:7) = parameters(beside(1)/(2*pi))
        q(11:14) = parameters(beside(2)/(2*pi))
        call get_terms(mechanism, 0.0_wp, q, qd, terms, stat)
        call check_count(error, stat, 0, 'status')
        ! Rounding of two angles and two products.
        call check_below(error, abs(terms%phi(11) - (7*beside(1) + 3*beside(2))), 8*epsilon(1.0_wp), 'the row')

    contains

        !> Euler parameters of so many turns about z.
        function parameters(turns)
            real(wp), intent(in) :: turns
            real(wp) :: parameters(4)

            parameters = [cos(pi*turns), 0.0_wp, 0.0_wp, sin(pi*turns)]
        end function parameters
    end subroutine test_many_turns

    !> Every freedom in isolation, with and without a motion, and all pairs; revolute joints as primitives have the same rows.
    subroutine test_primitive(error)
        type(error_type), allocatable, intent(out) :: error
        type(mechanism_type) :: mechanism
        type(failure_type), allocatable :: failure
        type(polynomial_type) :: law
        integer :: hold(6), i, k, n, rows
        logical :: planar

        allocate (law%coefficient, source=[0.0_wp, 2.0_wp, -0.3_wp, 0.2_wp])
        do k = 1, 2
            planar = k == 1
            n = merge(3, 6, planar)
            do i = 1, 2*n
                hold = 0
                hold(1 + mod(i - 1, n)) = 1
                call draw(mechanism, planar)
                if (i > n) then
                    call mechanism%add_joint('it', 'primitive', 'first', 'second', failure, at=at(:merge(2, 3, planar)), &
                        axis=axis(:merge(2, 3, planar)), hold=hold(:n), drive=i - n, motion=law)
                else
                    call mechanism%add_joint('it', 'primitive', 'first', 'second', failure, at=at(:merge(2, 3, planar)), &
                        axis=axis(:merge(2, 3, planar)), hold=hold(:n))
                end if
                call check_no_failure(error, failure)
                call verify(mechanism, 'one freedom', error)
                call check_count(error, mechanism%n_holonomic, merge(1, 3, planar), 'rows')
                call check_drawing(mechanism, 'one freedom', error)
                if (allocated(error)) return
            end do
        end do
        do i = 0, 63
            hold = [(merge(1, 0, btest(i, k)), k=0, 5)]
            if (i == 0) cycle
            rows = count(hold == 1)
            call draw(mechanism, .false.)
            call mechanism%add_joint('it', 'primitive', 'second', 'first', failure, at=at, axis=axis, hold=hold)
            call check_no_failure(error, failure)
            call verify(mechanism, 'some freedoms', error)
            call check_count(error, mechanism%n_holonomic, rows + 2, 'rows')
            call check_drawing(mechanism, 'some freedoms', error)
            if (allocated(error)) return
        end do
    end subroutine test_primitive

    !> At velocity level: each freedom in isolation, between two bodies and against the ground, with and without a motion.
    subroutine test_glides(error)
        type(error_type), allocatable, intent(out) :: error
        type(mechanism_type) :: mechanism
        type(failure_type), allocatable :: failure
        type(sine_type), parameter :: swing = sine_type(offset=0.9_wp, amplitude=0.3_wp, rate=2.0_wp, phase=0.5_wp)
        character(len=*), parameter :: between(2, 3) = reshape([character(len=6) :: 'first', 'second', 'ground', 'first', &
            'second', 'ground'], [2, 3])
        integer :: hold(6), i, k, j, n
        logical :: planar

        do k = 1, 2
            planar = k == 1
            n = merge(3, 6, planar)
            do i = 1, n
                do j = 1, 3
                    hold = 0
                    hold(i) = 2
                    call draw(mechanism, planar)
                    if (j == 1) then
                        call mechanism%add_joint('it', 'primitive', trim(between(1, j)), trim(between(2, j)), failure, &
                            at=at(:merge(2, 3, planar)), axis=axis(:merge(2, 3, planar)), hold=hold(:n), drive=i, motion=swing)
                    else
                        call mechanism%add_joint('it', 'primitive', trim(between(1, j)), trim(between(2, j)), failure, &
                            at=at(:merge(2, 3, planar)), axis=axis(:merge(2, 3, planar)), hold=hold(:n))
                    end if
                    call check_no_failure(error, failure)
                    call verify(mechanism, 'velocity '//trim(between(1, j)), error)
                    call check_count(error, mechanism%n_nonholonomic, 1, 'rows')
                    if (allocated(error)) return
                end do
            end do
        end do
    end subroutine test_glides

    !> The random states of a check are far apart: the turn count of a coupling must be that of the reference configuration
    !> afterwards.
    subroutine test_turns_after_check(error)
        type(error_type), allocatable, intent(out) :: error
        type(mechanism_type), target :: mechanism
        type(simulation_type) :: simulation
        type(options_type) :: options
        type(failure_type), allocatable :: failure
        type(finding_type), allocatable :: findings(:)
        real(wp), allocatable :: q(:), qd(:)
        real(wp), parameter :: inertia(3) = 0.1_wp

        call mechanism%add_body('a', 1.0_wp, [0.0_wp, 0.0_wp, 0.0_wp], failure, inertia=inertia, &
            orientation=turned_by([-0.163_wp, -0.482_wp, 0.599_wp]))
        call check_no_failure(error, failure)
        call mechanism%add_body('b', 1.0_wp, [1.0_wp, 0.0_wp, 0.0_wp], failure, inertia=inertia, &
            orientation=turned_by([0.040_wp, -0.292_wp, -0.782_wp]))
        call check_no_failure(error, failure)
        call mechanism%add_joint('ja', 'revolute', 'ground', 'a', failure, at=[0.581_wp, 0.365_wp, 0.294_wp], &
            axis=[0.346_wp, 0.822_wp, 0.330_wp])
        call check_no_failure(error, failure)
        call mechanism%add_joint('jb', 'revolute', 'a', 'b', failure, at=[1.0_wp, 0.0_wp, 0.0_wp], &
            axis=[-0.652_wp, 0.453_wp, 0.223_wp])
        call check_no_failure(error, failure)
        call mechanism%add_coupling('c', ['ja', 'jb'], [1.0_wp, 0.5_wp], failure)
        call check_no_failure(error, failure)
        call mechanism%define(failure)
        call check_no_failure(error, failure)
        if (allocated(error)) return
        allocate (q(mechanism%n), qd(mechanism%n))
        call mechanism%start(q, qd)
        call verify_model(mechanism, 0.0_wp, q, qd, 10, findings, failure)
        call check_no_failure(error, failure)
        call simulation%initialize(mechanism, options, 0.0_wp, q, qd, failure)
        call check_no_failure(error, failure)

    contains

        !> Euler parameters of a rotation vector.
        pure function turned_by(vector) result(p)
            real(wp), intent(in) :: vector(3)
            real(wp) :: p(4)

            p = [cos(0.5_wp*norm2(vector)), sin(0.5_wp*norm2(vector))/norm2(vector)*vector]
        end function turned_by
    end subroutine test_turns_after_check

    !> In a program: a body on an arm is rotated by 2 pi t from t = 0.3 s on, by pi, and by 20 rad, from a reference configuration
    !> at 0; the orientation and the turns of a spring along the angle are those of the motion, and a second run starts there again.
    subroutine test_imposed_angles(error)
        type(error_type), allocatable, intent(out) :: error
        character(len=*), parameter :: motions(3) = [character(len=16) :: '2*pi*t', 'pi + t - 0.3', '20 - 3*(t - 0.3)']
        real(wp), parameter :: expected(3) = [0.6_wp*pi, pi, 20.0_wp], z(3) = [0.0_wp, 0.0_wp, 1.0_wp], from = 0.3_wp
        real(wp), parameter :: stiffness = 2.0_wp
        type(failure_type), allocatable :: failure
        type(expression_type) :: expression
        integer :: i, run

        do i = 1, size(motions)
            block
                type(mechanism_type), target :: mechanism
                type(simulation_type) :: simulation
                type(assembly_type) :: assembly
                type(options_type) :: options
                real(wp), allocatable :: q(:), qd(:)
                real(wp) :: energy
                integer :: stat

                call mechanism%add_body('a', 1.0_wp, [0.2_wp, 0.0_wp, 0.0_wp], failure, inertia=[0.1_wp, 0.1_wp, 0.2_wp])
                call check_no_failure(error, failure)
                call parse_expression(expression, trim(motions(i)), ['t'], failure)
                call check_no_failure(error, failure)
                call mechanism%add_joint('j', 'revolute', 'ground', 'a', failure, at=[0.0_wp, 0.0_wp, 0.0_wp], axis=z, &
                    motion=expression_function(expression))
                call check_no_failure(error, failure)
                call mechanism%add_torsion('t', 'j', failure, stiffness=stiffness)
                call check_no_failure(error, failure)
                call mechanism%define(failure)
                call check_no_failure(error, failure)
                if (allocated(error)) return
                allocate (q(mechanism%n), qd(mechanism%n))
                call mechanism%start(q, qd)
                options%stepper = 'dop853'
                options%rtol = 1.0e-9_wp
                options%atol = 1.0e-9_wp
                do run = 1, 2
                    call simulation%initialize(mechanism, options, from, q, qd, failure, assembly)
                    call check_no_failure(error, failure)
                    if (allocated(error)) return
                    call check_close(error, simulation%state%q(1:2), 0.2_wp*[cos(expected(i)), sin(expected(i))], 1.0e-11_wp, &
                        'place')
                    call mechanism%potential_energy(from, simulation%state%q, energy, stat)
                    call check_below(error, abs(energy - stiffness*expected(i)**2/2), 1.0e-8_wp, 'energy of the spring')
                    do while (simulation%state%t < 1.0_wp .and. .not. allocated(failure))
                        call simulation%step(1.0_wp, failure)
                    end do
                    call check_no_failure(error, failure)
                    if (allocated(error)) return
                end do
            end block
        end do
    end subroutine test_imposed_angles

    !> A body spins fast about a hinge with a weak torsion spring: steps of sdirk54 at a coarse tolerance try points far ahead,
    !> which must not count as turns; and a second start counts from the reference configuration again. The angle satisfies J x'' =
    !> -k x.
    subroutine test_turns_of_steps(error)
        type(error_type), allocatable, intent(out) :: error
        type(mechanism_type), target :: mechanism
        type(simulation_type) :: simulation
        type(options_type) :: options
        type(failure_type), allocatable :: failure
        real(wp), allocatable :: q(:), qd(:)
        real(wp), parameter :: z(3) = [0.0_wp, 0.0_wp, 1.0_wp], spring = 0.02_wp, spin = 30.0_wp, inertia = 0.2_wp
        real(wp) :: angle, pull, tolerance(2)
        integer :: k

        call mechanism%add_body('a', 1.0_wp, [0.0_wp, 0.0_wp, 0.0_wp], failure, inertia=[0.1_wp, 0.1_wp, inertia], omega=spin*z)
        call check_no_failure(error, failure)
        call mechanism%add_joint('j', 'revolute', 'ground', 'a', failure, at=[0.0_wp, 0.0_wp, 0.0_wp], axis=z)
        call check_no_failure(error, failure)
        call mechanism%add_torsion('t', 'j', failure, stiffness=spring)
        call check_no_failure(error, failure)
        call mechanism%define(failure)
        call check_no_failure(error, failure)
        if (allocated(error)) return
        allocate (q(mechanism%n), qd(mechanism%n))
        call mechanism%start(q, qd)
        tolerance = [1.0e-9_wp, 1.0e-2_wp]
        do k = 1, 2
            options%stepper = merge('dop853 ', 'sdirk54', k == 1)
            options%rtol = tolerance(k)
            options%atol = tolerance(k)
            call simulation%initialize(mechanism, options, 0.0_wp, q, qd, failure)
            call check_no_failure(error, failure)
            if (allocated(error)) return
            do while (simulation%state%t < 3.3_wp .and. .not. allocated(failure))
                call simulation%step(3.3_wp, failure)
                ! The torque shows the number of counted turns.
                associate (state => simulation%state, rate => sqrt(spring/inertia))
                    angle = spin/rate*sin(rate*state%t)
                    pull = inertia*2*(state%q(4)*state%qdd(7) - state%qdd(4)*state%q(7))
                    call check_below(error, abs(pull + spring*angle), merge(1.0e-6_wp, 0.05_wp, k == 1), 'torque of the spring')
                end associate
                if (allocated(error)) return
            end do
            call check_no_failure(error, failure)
        end do
    end subroutine test_turns_of_steps

    !> Gears and racks of joints that share a body, a screw.
    subroutine test_couplings(error)
        type(error_type), allocatable, intent(out) :: error
        type(mechanism_type) :: mechanism
        type(failure_type), allocatable :: failure
        type(sine_type), parameter :: swing = sine_type(offset=0.0_wp, amplitude=0.3_wp, rate=2.0_wp, phase=0.0_wp)
        integer :: i, k
        logical :: planar

        do k = 1, 2
            planar = k == 1
            associate (n => merge(2, 3, planar))
                call draw(mechanism, planar)
                call mechanism%add_joint('pin', 'revolute', 'ground', 'first', failure, at=at(:n), axis=axis(:n))
                call check_no_failure(error, failure)
                call mechanism%add_joint('pivot', 'revolute', 'first', 'second', failure, at=at(:n), axis=axis(n:1:-1))
                call check_no_failure(error, failure)
                call mechanism%add_body('cart', 0.4_wp, at(:n), failure, inertia=[(0.3_wp, i=1, merge(1, 3, planar))])
                call check_no_failure(error, failure)
                call mechanism%add_joint('rail', 'prismatic', 'cart', 'ground', failure, at=at(:n), axis=axis(:n))
                call check_no_failure(error, failure)
                call mechanism%add_coupling('gear', [character(len=8) :: 'pin', 'pivot'], [2.0_wp, -3.0_wp], failure)
                call check_no_failure(error, failure)
                call mechanism%add_coupling('rack', [character(len=17) :: 'rail.displacement', 'pivot', 'pin'], [1.0_wp, 0.3_wp, &
                    -0.1_wp], failure, motion=swing)
                call check_no_failure(error, failure)
            end associate
            call verify(mechanism, 'couplings', error)
            call check_drawing(mechanism, 'couplings', error)
        end do
        call draw(mechanism, .false.)
        call mechanism%add_joint('thread', 'screw', 'first', 'second', failure, at=at, axis=axis, pitch=0.02_wp)
        call check_no_failure(error, failure)
        call verify(mechanism, 'screw', error)
        call check_count(error, mechanism%n_holonomic, 7, 'rows')
    end subroutine test_couplings

    !> Names and units of coordinates and rows: bodies, a point mass, a wheel that slides, a coupling that events lock.
    subroutine test_names(error)
        type(error_type), allocatable, intent(out) :: error
        type(mechanism_type) :: mechanism
        type(failure_type), allocatable :: failure
        character(len=*), parameter :: space(19) = [character(len=20) :: 'first.x m', 'first.y m', 'first.z m', 'first.e0 1', &
            'first.e1 1', 'first.e2 1', 'first.e3 1', 'second.x m', 'second.y m', 'second.z m', 'second.e0 1', 'second.e1 1', &
            'second.e2 1', 'second.e3 1', 'mass.x m', 'mass.y m', 'mass.z m', 'front.displacement m', 'clutch.slack 1']
        character(len=*), parameter :: rows(10) = [character(len=20) :: 'pin x N', 'pin y N', 'pin z N', 'pin rotation y N m', &
            'pin rotation x N m', 'front height N', 'clutch N m', 'first norm J', 'second norm J', 'front slip N']
        character(len=*), parameter :: plane(8) = [character(len=16) :: 'first.x m', 'first.y m', 'first.angle rad', 'second.x m', &
            'second.y m', 'second.angle rad', 'mass.x m', 'mass.y m']

        call draw(mechanism, .false.)
        call mechanism%add_joint('pin', 'revolute', 'ground', 'first', failure, at=at, axis=axis)
        call check_no_failure(error, failure)
        call mechanism%add_body('mass', 0.4_wp, at, failure)
        call check_no_failure(error, failure)
        call mechanism%add_massless_wheel('front', 'second', 0.8_wp, [0.0_wp, 1.0_wp, 0.0_wp], failure, &
            along=[0.0_wp, 0.0_wp, 1.0_wp], plane=plane_type(open=.true.))
        call check_no_failure(error, failure)
        call mechanism%add_coupling('clutch', ['pin'], [1.0_wp], failure, locked=.false.)
        call check_no_failure(error, failure)
        call compare(space, rows)
        call draw(mechanism, .true.)
        call mechanism%add_body('mass', 0.4_wp, at(:2), failure)
        call check_no_failure(error, failure)
        call mechanism%add_joint('pin', 'revolute', 'ground', 'first', failure, at=at(:2))
        call check_no_failure(error, failure)
        call compare(plane, [character(len=16) :: 'pin x N', 'pin y N'])

    contains

        subroutine compare(coordinates, rows)
            character(len=*), intent(in) :: coordinates(:), rows(:)
            integer :: i

            if (allocated(error)) return
            call mechanism%define(failure)
            call check_no_failure(error, failure)
            call check_count(error, mechanism%n, size(coordinates), 'coordinates')
            call check_count(error, mechanism%n_constraints(), size(rows), 'rows')
            if (allocated(error)) return
            do i = 1, size(coordinates)
                call check_true(error, mechanism%coordinate_label(i)//' '//mechanism%unit_of_coordinate(i) == coordinates(i), &
                    'coordinate '//trim(coordinates(i))//', not '//mechanism%coordinate_label(i))
            end do
            do i = 1, size(rows)
                call check_true(error, mechanism%row_name(i)//' '//mechanism%unit_of_multiplier(i) == rows(i), &
                    'row '//trim(rows(i))//', not '//mechanism%row_name(i))
            end do
        end subroutine compare
    end subroutine test_names

    subroutine test_rate_rows(error)
        type(error_type), allocatable, intent(out) :: error
        type(mechanism_type) :: mechanism
        type(failure_type), allocatable :: failure
        type(expression_type) :: c(2), rhs
        integer :: i

        call draw(mechanism, .true.)
        call parse_expression(c(1), 'sin(first.angle)*(1 + t*second.x)', mechanism%variable_names(), failure)
        call check_no_failure(error, failure)
        call parse_expression(c(2), '-cos(second.angle*first.y) + t^2', mechanism%variable_names(), failure)
        call check_no_failure(error, failure)
        call parse_expression(rhs, '0.3*sin(2*t)*first.x', mechanism%variable_names(), failure)
        call check_no_failure(error, failure)
        call mechanism%add_rate_row('blade', [character(len=12) :: 'first.vx', 'second.omega'], c, failure, rhs=rhs)
        call check_no_failure(error, failure)
        call mechanism%add_rate_row('constant', [character(len=12) :: 'first.vx', 'first.vx'], c, failure)
        call check_no_failure(error, failure)
        call verify(mechanism, 'rows by expression in the plane', error)
        call draw(mechanism, .false.)
        call parse_expression(c(1), 'first.e1*second.e2 + second.z', mechanism%variable_names(), failure)
        call check_no_failure(error, failure)
        call parse_expression(c(2), 'exp(first.x*t)', mechanism%variable_names(), failure)
        call check_no_failure(error, failure)
        call mechanism%add_rate_row('it', [character(len=12) :: 'first.vx', 'second.vz'], c, failure)
        call check_no_failure(error, failure)
        call verify(mechanism, 'rows by expression in space', error)
        call draw(mechanism, .false.)
        call parse_expression(c(1), 'first.e1*second.y + cos(second.e3)*t', mechanism%variable_names(), failure)
        call check_no_failure(error, failure)
        call parse_expression(c(2), '1 + first.x*second.e0^2', mechanism%variable_names(), failure)
        call check_no_failure(error, failure)
        call parse_expression(rhs, 'sin(t)*first.e2', mechanism%variable_names(), failure)
        call check_no_failure(error, failure)
        call mechanism%add_rate_row('x', [character(len=9) :: 'first.wx', 'second.wx'], c, failure, rhs=rhs)
        call check_no_failure(error, failure)
        call mechanism%add_rate_row('y', [character(len=9) :: 'first.wy', 'first.wy'], c, failure)
        call check_no_failure(error, failure)
        call mechanism%add_rate_row('z', [character(len=9) :: 'second.vy', 'first.wz'], c, failure)
        call check_no_failure(error, failure)
        call verify(mechanism, 'rows of angular velocities', error)
        if (allocated(error)) return
        i = mechanism%n_holonomic
        call check_true(error, mechanism%unit_of_multiplier(i + 1) == 'N m', 'a torque in a row of angular velocities')
        call check_true(error, mechanism%unit_of_multiplier(i + 3) == 'N', 'a force in a row with another velocity')
    end subroutine test_rate_rows

    subroutine test_rolling(error)
        type(error_type), allocatable, intent(out) :: error
        type(mechanism_type) :: mechanism
        type(failure_type), allocatable :: failure
        type(sine_type), parameter :: swing = sine_type(offset=0.1_wp, amplitude=0.3_wp, rate=2.0_wp, phase=0.5_wp)
        type(polynomial_type) :: law
        real(wp), parameter :: normal(3) = [0.1_wp, 0.9_wp, -0.4_wp], along(3) = [4.0_wp, 0.0_wp, 1.0_wp]

        allocate (law%coefficient, source=[0.1_wp, 2.0_wp, -0.3_wp, 0.2_wp])
        call draw(mechanism, .true.)
        call mechanism%add_knife_edge('wheel', 'first.tip', [0.3_wp, 1.0_wp], failure, steer=law)
        call check_no_failure(error, failure)
        call verify(mechanism, 'steered wheel in the plane', error)
        call draw(mechanism, .false.)
        call mechanism%add_knife_edge('wheel', 'first.tip', [0.3_wp, 1.0_wp, 0.0_wp], failure, steer=law, &
            about=[1.0_wp, -0.3_wp, 2.0_wp])
        call check_no_failure(error, failure)
        call verify(mechanism, 'steered wheel in space', error)
        call draw(mechanism, .false.)
        call mechanism%add_rolling_ellipsoid('egg', 'first', [0.8_wp, 0.5_wp, 0.3_wp], failure, plane=plane_type(open=.true.))
        call check_no_failure(error, failure)
        call mechanism%add_rolling_ellipsoid('pebble', 'second.tip', [0.3_wp, 0.5_wp, 0.4_wp], failure, &
            plane=plane_type(normal=normal, open=.true., rotation=law, pivot=at, rise=swing, slide=swing, along=along))
        call check_no_failure(error, failure)
        call verify(mechanism, 'ellipsoids', error)
        call draw(mechanism, .false.)
        call mechanism%add_rolling_disk('tyre', 'first', 0.8_wp, [1.0_wp, 0.2_wp, 0.3_wp], failure, crown=0.2_wp, &
            plane=plane_type(open=.true.))
        call check_no_failure(error, failure)
        call mechanism%add_rolling_disk('wheel', 'second.tip', 0.4_wp, [1.0_wp, 0.2_wp, 0.3_wp], failure, crown=0.1_wp, &
            plane=plane_type(normal=normal, height=-0.2_wp, open=.true., rotation=law, pivot=at, rise=law, slide=law, along=along))
        call check_no_failure(error, failure)
        call verify(mechanism, 'round rims', error)
        call draw(mechanism, .false.)
        call mechanism%add_rolling_sphere('ball', 'first.tip', 0.8_wp, failure, plane=plane_type(open=.true., rotation=swing))
        call check_no_failure(error, failure)
        call verify(mechanism, 'sphere on a turntable', error)
    end subroutine test_rolling

    !> Every error states the element and the remedy.
    subroutine test_words(error)
        type(error_type), allocatable, intent(out) :: error
        type(mechanism_type) :: mechanism
        type(failure_type), allocatable :: failure
        type(expression_type) :: c(1)

        call draw(mechanism, .false.)
        call mechanism%add_joint('it', 'primitive', 'first', 'second', failure, at=at)
        call expect('joint it: hold has 0 entries; give 6')
        call mechanism%add_joint('it', 'primitive', 'first', 'second', failure, at=at, hold=[0, 0, 0, 0, 0, 0])
        call expect('holds nothing')
        call mechanism%add_joint('it', 'primitive', 'first', 'second', failure, at=at, hold=[1, 0, 0, 0, 3, 0])
        call expect('an entry that is not 0, 1, 2')
        call mechanism%add_joint('it', 'primitive', 'first', 'second', failure, at=at, hold=[1, 0, 0, 0, 0, 0], drive=2, &
            motion=ramp(0.0_wp, 1.0_wp))
        call expect('motion that drives no direction')
        call mechanism%add_joint('it', 'primitive', 'first', 'second', failure, at=at, hold=[0, 0, 0, 1, 1, 0], drive=4, &
            motion=ramp(0.0_wp, 1.0_wp))
        call expect('drives a rotation, and one')
        call mechanism%add_joint('it', 'revolute', 'first', 'second', failure, at=at, axis=axis, hold=[0, 0, 0, 1, 1, 0])
        call expect('which its type defines')
        call mechanism%add_joint('it', 'screw', 'first', 'second', failure, at=at, axis=axis)
        call expect('joint it has a pitch, or lacks one')
        call mechanism%add_joint('pin', 'revolute', 'first', 'second', failure, at=at, axis=axis)
        call check_no_failure(error, failure)
        call mechanism%add_joint('ball', 'spherical', 'ground', 'second', failure, at=at)
        call check_no_failure(error, failure)
        call mechanism%add_coupling('gear', ['pin ', 'ball'], [1.0_wp, 1.0_wp], failure)
        call expect('coupling gear: the joint ball has no coordinate')
        call mechanism%add_coupling('gear', ['pin.way'], [1.0_wp], failure)
        call expect('coupling gear: the joint pin has no coordinate way; name pin.angle')
        call mechanism%add_coupling('gear', ['pin ', 'pen '], [1.0_wp, 1.0_wp], failure)
        call expect('coupling gear: there is no joint pen')
        call mechanism%add_coupling('gear', ['pin'], [0.0_wp], failure)
        call expect('a factor that is zero')
        call mechanism%add_coupling('gear', ['pin'], [1.0_wp, 2.0_wp], failure)
        call expect('1 joints and 2 factors')
        call parse_expression(c(1), 'first.vx', mechanism%variable_names(), failure)
        call check_no_failure(error, failure)
        call mechanism%add_rate_row('it', ['first.vx'], c, failure)
        call expect('row it depends on first.vx')
        call parse_expression(c(1), 'first.x', mechanism%variable_names(), failure)
        call check_no_failure(error, failure)
        call mechanism%add_rate_row('it', ['first.x'], c, failure)
        call expect('first.x is not a velocity')
        call mechanism%add_rate_row('it', ['first.e1'], c, failure)
        call expect('body.wx in space')
        call mechanism%add_rate_row('it', ['first.omega'], c, failure)
        call expect('first.omega is not a velocity')
        call parse_expression(c(1), 'first.wz', mechanism%variable_names(), failure)
        call check_no_failure(error, failure)
        call mechanism%add_rate_row('it', ['first.wz'], c, failure)
        call expect('row it depends on first.wz')
        call mechanism%add_rolling_ellipsoid('egg', 'first', [1.0_wp, 0.0_wp, 1.0_wp], failure)
        call expect('a semi-axis that is not positive')
        call mechanism%add_rolling_disk('rim', 'first', 0.3_wp, axis, failure, crown=0.3_wp)
        call expect('a crown that is not between')
        call mechanism%add_rolling_sphere('ball2', 'first', 1.0_wp, failure, plane=plane_type(slide=ramp(0.0_wp, 1.0_wp)))
        call expect('has only one of slide and along')
        call mechanism%add_rolling_sphere('ball2', 'first', 1.0_wp, failure, &
            plane=plane_type(slide=ramp(0.0_wp, 1.0_wp), along=axis))
        call expect('slides out of itself')

    contains

        subroutine expect(text)
            character(len=*), intent(in) :: text

            call check_true(error, allocated(failure), 'no error: '//text)
            if (.not. allocated(failure)) return
            call check_true(error, index(failure%message, text) > 0, failure%message//' instead of '//text)
        end subroutine expect
    end subroutine test_words
end module test_mechanism_rows
