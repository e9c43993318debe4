! SPDX-License-Identifier: MIT
!> Tests of the sparse chart: the motions of large mechanisms against those of the dense chart, against closed forms and against
!> their own energy; cost of steps; loss of rank.
module test_sparse
    use asserts, only: check_below, check_close, check_count, check_failure, check_no_failure
    use event_kinds, only: shove_type
    use large_mechanisms, only: make_large
    use large_runs, only: begin, controlled, go_on, scenes, start
    use model_beads, only: beads_type
    use tandem, only: chart_type, failure_type => error_type, mechanism_type, options_type, polynomial_type, simulation_type, &
        statistics_type, wp
    use tandem_chart, only: measure_type, need_change
    use tandem_chart_factory, only: new_chart
    use testdrive, only: error_type, new_unittest, test_failed, unittest_type
    implicit none (type, external)
    private

    public :: collect_sparse

contains

    !> The suite.
    subroutine collect_sparse(testsuite)
        type(unittest_type), allocatable, intent(out) :: testsuite(:)

        testsuite = [ &
            new_unittest('both-charts-alike', test_alike), &
            new_unittest('order-of-rk4', test_order), &
            new_unittest('all-elements', test_elements), &
            new_unittest('accelerations', test_accelerations), &
            new_unittest('forty-four-bars', test_forty), &
            new_unittest('four-hundred-four-bars', test_four_hundred), &
            new_unittest('singular-four-bars', test_singular), &
            new_unittest('thousand-four-bars-close-to-flat', test_close_to_flat), &
            new_unittest('forty-four-bars-creep-to-flat', test_creep_to_flat), &
            new_unittest('one-four-bar-of-a-hundred-goes-flat', test_one_flat), &
            new_unittest('energy-of-a-chain', test_energy), &
            new_unittest('constraint-errors', test_constraint_errors), &
            new_unittest('work-of-a-step', test_work), &
            new_unittest('multipliers', test_multipliers), &
            new_unittest('impulses', test_impulses), &
            new_unittest('change-of-the-rows', test_change)]
    end subroutine collect_sparse

    !> The charts differ, and so do the errors of steps: local ones of 1e-12 add up and grow a little.
    subroutine test_alike(error)
        type(error_type), allocatable, intent(out) :: error
        type(mechanism_type), target :: one, two
        type(simulation_type) :: sparse, dense
        integer :: i

        do i = 1, size(scenes)
            one = mechanism_type()
            two = mechanism_type()
            call begin(scenes(i), 13, controlled(1.0e-12_wp, 'sparse'), one, sparse, error)
            call begin(scenes(i), 13, controlled(1.0e-12_wp, 'dense'), two, dense, error)
            call go_on(sparse, 0.3_wp, error)
            call go_on(dense, 0.3_wp, error)
            if (allocated(error)) return
            call check_close(error, sparse%state%q, dense%state%q, 1.0e-10_wp, trim(scenes(i))//' q')
            call check_close(error, sparse%state%qd/(1 + maxval(abs(dense%state%qd))), &
                dense%state%qd/(1 + maxval(abs(dense%state%qd))), 1.0e-10_wp, trim(scenes(i))//' qd')
        end do
    end subroutine test_alike

    !> Halving the step divides the error of rk4 by sixteen: the chart preserves the order.
    subroutine test_order(error)
        type(error_type), allocatable, intent(out) :: error
        type(mechanism_type), target :: mechanism
        type(simulation_type) :: simulation
        type(options_type) :: options
        real(wp), allocatable :: exact(:)
        real(wp) :: errors(2)
        integer :: k

        call begin('spatial_chain', 4, controlled(1.0e-13_wp, 'dense'), mechanism, simulation, error)
        call go_on(simulation, 0.4_wp, error)
        if (allocated(error)) return
        allocate (exact, source=simulation%state%q)
        options%chart_kind = 'sparse'
        do k = 1, 2
            mechanism = mechanism_type()
            options%step = 2.0e-2_wp/k
            call begin('spatial_chain', 4, options, mechanism, simulation, error)
            call go_on(simulation, 0.4_wp, error)
            if (allocated(error)) return
            errors(k) = maxval(abs(simulation%state%q - exact))
        end do
        ! Errors of higher order are a tenth of it at these steps.
        call check_below(error, abs(log(errors(1)/errors(2))/log(2.0_wp) - 4), 0.3_wp, 'order')
    end subroutine test_order

    !> Springs between far bodies, couplings, driven joints, knife edges, distances, point masses and user rows on one mechanism.
    subroutine draw_elements(mechanism, error)
        type(mechanism_type), intent(inout) :: mechanism
        type(error_type), allocatable, intent(inout) :: error
        type(failure_type), allocatable :: failure
        type(polynomial_type) :: motion
        character(len=2) :: name(0:5)
        integer :: i

        name = [character(len=2) :: 'b0', 'b1', 'b2', 'b3', 'b4', 'b5']
        mechanism%planar = .true.
        mechanism%gravity = [0.0_wp, -9.81_wp, 0.0_wp]
        mechanism%times = [0.0_wp, 1.0_wp]
        do i = 0, 5
            call mechanism%add_body(name(i), 1.0_wp + 0.1_wp*i, [real(i, wp), 0.0_wp], failure, inertia=[0.1_wp])
            call check_no_failure(error, failure)
        end do
        call mechanism%add_body('mass', 0.3_wp, [6.5_wp, 0.0_wp], failure)
        call check_no_failure(error, failure)
        motion = polynomial_type([0.0_wp, 0.5_wp, 0.3_wp])
        call mechanism%add_joint('drive', 'revolute', 'ground', 'b0', failure, at=[-0.5_wp, 0.0_wp], motion=motion)
        call check_no_failure(error, failure)
        do i = 1, 5
            call mechanism%add_joint('j'//name(i), 'revolute', name(i - 1), name(i), failure, at=[i - 0.5_wp, 0.0_wp])
            call check_no_failure(error, failure)
        end do
        call mechanism%add_distance('rope', 'b5', 'mass', failure)
        call check_no_failure(error, failure)
        call mechanism%add_coupling('gear', ['jb1', 'jb4'], [1.0_wp, 0.5_wp], failure)
        call check_no_failure(error, failure)
        call mechanism%add_spring('far', 'b0', 'b5', failure, stiffness=20.0_wp, damping=0.3_wp)
        call check_no_failure(error, failure)
    end subroutine draw_elements

    !> Every kind of element on both charts.
    subroutine test_elements(error)
        type(error_type), allocatable, intent(out) :: error
        type(mechanism_type), target :: one, two
        type(simulation_type) :: sparse, dense
        type(failure_type), allocatable :: failure

        call draw_elements(one, error)
        call draw_elements(two, error)
        if (allocated(error)) return
        call one%define(failure)
        call two%define(failure)
        call start_assembled(one, 'sparse', sparse)
        call start_assembled(two, 'dense', dense)
        call go_on(sparse, 0.3_wp, error)
        call go_on(dense, 0.3_wp, error)
        if (allocated(error)) return
        call check_close(error, sparse%state%q, dense%state%q, 1.0e-10_wp, 'q')

    contains

        !> From the reference configuration with velocities that fit the drive.
        subroutine start_assembled(mechanism, kind, simulation)
            type(mechanism_type), intent(inout), target :: mechanism
            character(len=*), intent(in) :: kind
            type(simulation_type), intent(inout) :: simulation
            real(wp) :: q(mechanism%n), qd(mechanism%n)

            if (allocated(error)) return
            call mechanism%start(q, qd)
            ! The drive turns b0 at 0.5 rad/s about a point 0.5 m beside its centre; the chain follows as one body, so that the gear
            ! is at rest.
            call set_rigid(mechanism%n, qd)
            call simulation%initialize(mechanism, controlled(1.0e-12_wp, kind), 0.0_wp, q, qd, failure)
            call check_no_failure(error, failure)
        end subroutine start_assembled

        !> Everything rotates as one body about (-0.5, 0) at 0.5 rad/s.
        subroutine set_rigid(n, qd)
            integer, intent(in) :: n
            real(wp), intent(out) :: qd(n)
            integer :: i

            qd = 0.0_wp
            do i = 0, 5
                qd(3*i + 2) = 0.5_wp*(i + 0.5_wp)
                qd(3*i + 3) = 0.5_wp
            end do
            qd(20) = 0.5_wp*7.0_wp
        end subroutine set_rigid
    end subroutine test_elements

    !> Accelerations and constraint levels of hubs, loops and grounds against the dense chart at the same state.
    subroutine test_accelerations(error)
        type(error_type), allocatable, intent(out) :: error
        type(mechanism_type), target :: one, two
        type(simulation_type) :: sparse, dense
        integer, parameter :: n(3) = [10, 20, 37]
        integer :: i, k

        do i = 1, size(scenes)
            do k = 1, size(n)
                one = mechanism_type()
                two = mechanism_type()
                call begin(scenes(i), n(k), controlled(1.0e-8_wp, 'sparse'), one, sparse, error)
                call begin(scenes(i), n(k), controlled(1.0e-8_wp, 'dense'), two, dense, error)
                if (allocated(error)) return
                ! The loss of digits is due to the condition of the matrices, up to 1e4.
                call check_close(error, sparse%state%qdd/(1 + maxval(abs(dense%state%qdd))), &
                    dense%state%qdd/(1 + maxval(abs(dense%state%qdd))), 1.0e-11_wp, trim(scenes(i))//' qdd')
            end do
        end do
    end subroutine test_accelerations

    !> N = 40 at t = 0.6: theta'' = c sin(theta), see `exact_angle`.
    subroutine test_forty(error)
        type(error_type), allocatable, intent(out) :: error

        call run_four_bars(40, error)
    end subroutine test_forty

    !> N = 400: 801 bodies. The position of the first upright is also known from another source.
    subroutine test_four_hundred(error)
        type(error_type), allocatable, intent(out) :: error

        call run_four_bars(400, error)
    end subroutine test_four_hundred

    !> The tolerance of 1e-11 per step gives 1e-9.
    subroutine run_four_bars(n, error)
        integer, intent(in) :: n
        type(error_type), allocatable, intent(inout) :: error
        type(mechanism_type), target :: mechanism
        type(simulation_type) :: simulation
        real(wp) :: angle, x, y

        call begin('four_bars', 2*n + 1, controlled(1.0e-11_wp, 'sparse'), mechanism, simulation, error)
        call go_on(simulation, 0.6_wp, error)
        if (allocated(error)) return
        angle = exact_angle(n, 0.6_wp)
        ! The tip of the first upright, B0, is at twice the distance of its centre.
        x = 2*simulation%state%q(1)
        y = 2*simulation%state%q(2)
        call check_close(error, [x, y], [sin(angle), cos(angle)], 1.0e-9_wp, 'B0')
        if (n == 400) call check_close(error, [x, y], [0.874791235722069_wp, 0.484500045308415_wp], 1.0e-9_wp, 'B0 as given')
    end subroutine run_four_bars

    !> theta'' = c sin(theta), theta(0) = 0, theta'(0) = 1, by rk4 with an error of 1e-13.
    real(wp) function exact_angle(n, t) result(angle)
        integer, intent(in) :: n
        real(wp), intent(in) :: t
        integer, parameter :: steps = 4000
        real(wp) :: c, h, k(2, 4), y(2)
        integer :: i

        c = 9.81_wp*((n + 1)/2.0_wp + n)/((n + 1)/3.0_wp + n)
        h = t/steps
        y = [0.0_wp, 1.0_wp]
        do i = 1, steps
            k(:, 1) = rate(y)
            k(:, 2) = rate(y + 0.5_wp*h*k(:, 1))
            k(:, 3) = rate(y + 0.5_wp*h*k(:, 2))
            k(:, 4) = rate(y + h*k(:, 3))
            y = y + h*(k(:, 1) + 2*k(:, 2) + 2*k(:, 3) + k(:, 4))/6
        end do
        angle = y(1)

    contains

        function rate(y) result(yd)
            real(wp), intent(in) :: y(2)
            real(wp) :: yd(2)

            yd = [y(2), c*sin(y(1))]
        end function rate
    end function exact_angle

    !> At t = 0.71 to 0.72 uprights and couplers align: with singular = 'stop' the run ends there with `rank_deficient`, with fixed
    !> and with controlled steps, for any number of loops that become flat at once.
    subroutine test_singular(error)
        type(error_type), allocatable, intent(out) :: error
        integer, parameter :: n(3) = [2, 5, 40]
        type(mechanism_type), target :: mechanism
        type(simulation_type) :: simulation
        type(options_type) :: options
        type(failure_type), allocatable :: failure
        integer :: i, way

        do i = 1, size(n)
            do way = 1, 2
                mechanism = mechanism_type()
                options = options_type(step=1.0e-3_wp, chart_kind='sparse')
                if (way == 2) options = controlled(1.0e-8_wp, 'sparse')
                options%singular = 'stop'
                call begin('four_bars', 2*n(i) + 1, options, mechanism, simulation, error)
                if (allocated(error)) return
                call simulation%integrate(1.0_wp, failure)
                call check_failure(error, failure, 'rank_deficient', 'depend')
                call check_close(error, [simulation%state%t], [0.718_wp], 0.006_wp, 'end')
                if (allocated(error)) return
            end do
        end do
    end subroutine test_singular

    !> Among a thousand loops rounding grows so near the flat position that the constraints cannot be satisfied before steps shrink:
    !> the reported reason is the loss of rank, not a missed tolerance. Accelerations are 23 m/s^2 before it, and 300 when rounding
    !> dominates.
    subroutine test_close_to_flat(error)
        type(error_type), allocatable, intent(out) :: error

        call run_close_to_flat(1000, 1.0e-8_wp, error)
    end subroutine test_close_to_flat

    !> With a tolerance near rounding the estimates of errors grow: with forty loops 56000 steps were taken for the last 2e-6 s.
    subroutine test_creep_to_flat(error)
        type(error_type), allocatable, intent(out) :: error

        call run_close_to_flat(40, 1.0e-12_wp, error)
    end subroutine test_creep_to_flat

    !> From a state 0.02 s before the flat position, to 1e-5 s before it.
    subroutine run_close_to_flat(n, rtol, error)
        integer, intent(in) :: n
        real(wp), intent(in) :: rtol
        type(error_type), allocatable, intent(inout) :: error
        real(wp), parameter :: before = 0.02_wp, right = acos(0.0_wp)
        integer, parameter :: most_steps = 4000
        type(mechanism_type), target :: mechanism
        type(simulation_type) :: simulation
        type(statistics_type) :: statistics
        type(failure_type), allocatable :: failure
        type(options_type) :: options
        real(wp) :: angle, c, rate, q(3*(2*n + 1)), qd(3*(2*n + 1))
        integer :: i

        options = controlled(rtol, 'sparse')
        options%singular = 'stop'
        call begin('four_bars', 2*n + 1, options, mechanism, simulation, error)
        if (allocated(error)) return
        ! theta'^2 = 1 + 2 c (1 - cos(theta)), see `exact_angle`.
        c = 9.81_wp*((n + 1)/2.0_wp + n)/((n + 1)/3.0_wp + n)
        rate = sqrt(1 + 2*c)
        angle = right - before*(rate - 0.5_wp*before*c)
        rate = sqrt(1 + 2*c*(1 - cos(angle)))
        do i = 0, 2*n
            associate (place => merge(i + 0.5_wp*sin(angle), i - n - 0.5_wp + sin(angle), i <= n), &
                    part => merge(0.5_wp, 1.0_wp, i <= n), turns => merge(1.0_wp, 0.0_wp, i <= n))
                q(3*i + 1:3*i + 3) = [place, part*cos(angle), -turns*angle]
                qd(3*i + 1:3*i + 3) = rate*[part*cos(angle), -part*sin(angle), -turns]
            end associate
        end do
        call simulation%initialize(mechanism, options, 0.0_wp, q, qd, failure)
        call check_no_failure(error, failure)
        if (allocated(error)) return
        call simulation%integrate(2*before, failure)
        call check_failure(error, failure, 'rank_deficient', 'depend')
        call check_close(error, [simulation%state%t], [before], 2.0e-5_wp, 'end')
        statistics = simulation%statistics()
        call check_below(error, real(statistics%steps, wp), real(most_steps, wp), 'steps')
    end subroutine run_close_to_flat

    !> Of a hundred parallelograms side by side, without forces, one is flat after half a second, while the others hardly turn: one
    !> of its joints is named, with fixed steps in the step that would pass the position, with controlled ones directly before it.
    subroutine test_one_flat(error)
        type(error_type), allocatable, intent(out) :: error
        integer, parameter :: n = 100, fast = 37
        real(wp), parameter :: before = 0.5_wp, right = acos(0.0_wp), h = 1.0e-3_wp
        character(len=*), parameter :: pins = 'abcd'
        type(mechanism_type), target :: mechanism
        type(simulation_type) :: simulation
        type(options_type) :: options
        type(failure_type), allocatable :: failure
        integer :: i, way

        do way = 1, 3
            mechanism = mechanism_type()
            mechanism%planar = .true.
            do i = 1, n
                if (i == fast) then
                    call draw_parallelogram(mechanism, i, right - before, 1.0_wp, failure)
                else
                    call draw_parallelogram(mechanism, i, 0.3_wp, 0.1_wp, failure)
                end if
                if (allocated(failure)) exit
            end do
            if (.not. allocated(failure)) call mechanism%define(failure)
            call check_no_failure(error, failure)
            options = options_type(chart_kind='sparse', step=h)
            if (way == 2) options = controlled(1.0e-8_wp, 'sparse')
            if (way == 3) options = controlled(1.0e-8_wp, 'sparse', 'sdirk54')
            options%singular = 'stop'
            call start(mechanism, options, simulation, error)
            if (allocated(error)) return
            call simulation%integrate(1.0_wp, failure)
            call check_failure(error, failure, 'rank_deficient', 'depend')
            call check_close(error, [simulation%state%t], [before], 1.0001_wp*h, 'end')
            if (allocated(error)) return
            if (.not. names_pin_of(fast)) call test_failed(error, failure%message)
            do i = 1, n
                if (i /= fast .and. names_pin_of(i)) call test_failed(error, failure%message)
            end do
        end do

    contains

        !> True if the message names a row of a pin of a linkage.
        logical function names_pin_of(i)
            integer, intent(in) :: i
            integer :: k

            names_pin_of = .false.
            do k = 1, 4
                names_pin_of = names_pin_of .or. index(failure%message, '"'//trim(numbered(pins(k:k), i))//' ') > 0
            end do
        end function names_pin_of
    end subroutine test_one_flat

    !> Two rods of 1 m on the ground and one between their ends, all of 1 kg.
    subroutine draw_parallelogram(mechanism, i, angle, rate, error)
        type(mechanism_type), intent(inout) :: mechanism
        integer, intent(in) :: i
        !> Angle of the rods on the ground from the upright (rad), and its rate (rad/s).
        real(wp), intent(in) :: angle, rate
        type(failure_type), allocatable, intent(out) :: error
        real(wp) :: along(2), beside(2), foot(2), moves(2)
        character(len=8) :: left, right, top

        along = [sin(angle), cos(angle)]
        moves = rate*[cos(angle), -sin(angle)]
        foot = [4.0_wp*i, 0.0_wp]
        beside = foot + [1.0_wp, 0.0_wp]
        left = numbered('l', i)
        right = numbered('r', i)
        top = numbered('t', i)
        call add_rod(left, foot + 0.5_wp*along, 0.5_wp*moves, angle, rate)
        call add_rod(right, beside + 0.5_wp*along, 0.5_wp*moves, angle, rate)
        call add_rod(top, 0.5_wp*(foot + beside) + along, moves, 0.0_wp, 0.0_wp)
        call add_pin('a', 'ground', left, foot)
        call add_pin('b', left, top, foot + along)
        call add_pin('c', top, right, beside + along)
        call add_pin('d', right, 'ground', beside)

    contains

        subroutine add_rod(name, place, velocity, turned, omega)
            character(len=*), intent(in) :: name
            real(wp), intent(in) :: place(2), velocity(2), turned, omega

            if (allocated(error)) return
            call mechanism%add_body(name, 1.0_wp, place, error, inertia=[1/12.0_wp], orientation=[-turned], velocity=velocity, &
                omega=[-omega])
        end subroutine add_rod

        subroutine add_pin(name, first, second, place)
            character(len=*), intent(in) :: name, first, second
            real(wp), intent(in) :: place(2)

            if (.not. allocated(error)) call mechanism%add_joint(numbered(name, i), 'revolute', first, second, error, at=place)
        end subroutine add_pin
    end subroutine draw_parallelogram

    !> A name with a number.
    pure function numbered(name, i) result(text)
        character(len=*), intent(in) :: name
        integer, intent(in) :: i
        character(len=8) :: text

        write (text, '(a, i0)') name, i
    end function numbered

    !> A free-swinging chain in space from the horizontal at rest: lost potential energy becomes kinetic. Within 1e-6 of m g l
    !> summed over the bodies, with fixed steps of 1 ms.
    subroutine test_energy(error)
        type(error_type), allocatable, intent(out) :: error
        integer, parameter :: n = 20
        type(mechanism_type), target :: mechanism
        type(simulation_type) :: simulation
        type(failure_type), allocatable :: failure
        real(wp) :: potential, kinetic
        integer :: stat

        call begin('spatial_chain', n, options_type(step=1.0e-3_wp, chart_kind='sparse'), mechanism, simulation, error)
        call go_on(simulation, 0.5_wp, error)
        if (allocated(error)) return
        call check_no_failure(error, failure)
        call simulation%potential_energy(potential, stat)
        call check_count(error, stat, 0, 'status of the potential energy')
        call simulation%kinetic_energy(kinetic, stat)
        call check_count(error, stat, 0, 'status of the kinetic energy')
        call check_below(error, 1.0_wp, kinetic, 'the chain moves, its kinetic energy')
        call check_below(error, abs(kinetic + potential)/(n*9.81_wp), 1.0e-6_wp, 'energy')
    end subroutine test_energy

    !> Errors of all steps on the natural scales of the rows, within the default tolerance, with a thousand bodies.
    subroutine test_constraint_errors(error)
        type(error_type), allocatable, intent(out) :: error
        type(mechanism_type), target :: mechanism
        type(simulation_type) :: simulation
        type(statistics_type) :: statistics

        call begin('spatial_chain', 1000, options_type(step=1.0e-3_wp, chart_kind='sparse'), mechanism, simulation, error)
        call go_on(simulation, 0.02_wp, error)
        if (allocated(error)) return
        statistics = simulation%statistics()
        call check_below(error, max(statistics%position_error, statistics%velocity_error, statistics%acceleration_error), &
            1.0e-12_wp, 'largest error')
    end subroutine test_constraint_errors

    !> A step of rk4 in calm motion takes four factorizations, one per stage, and one correction of the position per stage; the end
    !> may need one more.
    subroutine test_work(error)
        type(error_type), allocatable, intent(out) :: error
        type(mechanism_type), target :: mechanism
        type(simulation_type) :: simulation
        type(statistics_type) :: statistics

        call begin('spatial_chain', 30, options_type(step=1.0e-3_wp, chart_kind='sparse'), mechanism, simulation, error)
        call go_on(simulation, 0.1_wp, error)
        if (allocated(error)) return
        statistics = simulation%statistics()
        ! The start has some of its own.
        call check_below(error, real(statistics%constraint_factorizations, wp), 4.1_wp*real(statistics%steps, wp), &
            'factorizations')
        call check_below(error, real(statistics%position_corrections, wp), 4.1_wp*real(statistics%steps, wp), 'corrections')
    end subroutine test_work

    !> The multipliers of all rows, including those of Euler parameters, are those of the dense chart.
    subroutine test_multipliers(error)
        type(error_type), allocatable, intent(out) :: error
        type(mechanism_type), target :: one, two
        type(simulation_type) :: sparse, dense
        real(wp), allocatable :: of_sparse(:), of_dense(:)
        integer :: i

        do i = 1, size(scenes)
            one = mechanism_type()
            two = mechanism_type()
            call begin(scenes(i), 17, options_type(step=1.0e-3_wp, chart_kind='sparse'), one, sparse, error)
            call begin(scenes(i), 17, options_type(step=1.0e-3_wp, chart_kind='dense'), two, dense, error)
            call go_on(sparse, 0.05_wp, error)
            call go_on(dense, 0.05_wp, error)
            if (allocated(error)) return
            of_sparse = spread(0.0_wp, 1, one%n_constraints())
            of_dense = of_sparse
            call sparse%multipliers(of_sparse)
            call dense%multipliers(of_dense)
            ! The error of rk4 is 1e-9 of the motion.
            call check_close(error, of_sparse/(1 + maxval(abs(of_dense))), of_dense/(1 + maxval(abs(of_dense))), 1.0e-8_wp, &
                trim(scenes(i))//' multipliers')
        end do
    end subroutine test_multipliers

    !> A kick that violates the constraints: the velocity after it, and the impulses of the rods, are those of the dense chart and
    !> of M (qd - before) = -C' impulse.
    subroutine test_impulses(error)
        type(error_type), allocatable, intent(out) :: error
        character(len=6), parameter :: kinds(2) = ['dense ', 'sparse']
        integer, parameter :: beads = 5
        type(beads_type), target :: model
        type(shove_type), target :: kick
        type(simulation_type) :: simulation
        type(options_type) :: options
        type(failure_type), allocatable :: failure
        real(wp) :: q(2*beads), qd(2*beads), impulses(beads, 2), jump(2*beads, 2)
        integer :: i, j, next

        do i = 1, 2
            model = beads_type()
            call model%define(beads)
            call model%start(q, qd)
            options = controlled(1.0e-12_wp, kinds(i))
            kick = shove_type(name='kick', at=0.1_wp, changes=.true., dqd=[(0.3_wp*j, j=1, 2*beads)])
            call simulation%initialize(model, options, 0.0_wp, q, qd, failure)
            call check_no_failure(error, failure)
            if (allocated(error)) return
            call simulation%add_event(kick)
            call go_on(simulation, 0.1_wp - 1.0e-9_wp, error)
            if (allocated(error)) return
            jump(:, i) = simulation%state%qd + kick%dqd
            call go_on(simulation, 0.1_wp + 1.0e-9_wp, error)
            if (allocated(error)) return
            impulses(:, i) = model%state%impulses
            jump(:, i) = simulation%state%qd - jump(:, i)
            ! C' impulse by hand; the motion of 2e-9 s is 1e-7 of the velocities.
            q = simulation%state%q
            do j = 1, beads
                associate (at => 2*j - 1)
                    qd(at:at + 1) = -impulses(j, i)*rod(j)
                    if (j < beads) then
                        next = min(j + 1, beads)
                        qd(at:at + 1) = qd(at:at + 1) + impulses(next, i)*rod(next)
                    end if
                    qd(at:at + 1) = qd(at:at + 1)/j
                end associate
            end do
            call check_close(error, jump(:, i), qd, 1.0e-6_wp, kinds(i)//' M (qd - before) = -C'' impulse')
        end do
        if (allocated(error)) return
        call check_below(error, 0.1_wp, maxval(abs(impulses(:, 1))), 'the rods hold the kick, the largest impulse')
        ! The motions differ by 1e-12 of the velocities.
        call check_close(error, impulses(:, 2), impulses(:, 1), 1.0e-9_wp*maxval(abs(impulses)), 'impulses')

    contains

        function rod(bead) result(d)
            integer, intent(in) :: bead
            real(wp) :: d(2)

            d = q(2*bead - 1:2*bead)
            if (bead > 1) d = d - q(2*bead - 3:2*bead - 2)
        end function rod
    end subroutine test_impulses

    !> The change of C in a step is reported as by the dense chart, for rows of unit length: a heavy row hides no other.
    subroutine test_change(error)
        type(error_type), allocatable, intent(out) :: error
        type(mechanism_type), target :: mechanism
        class(chart_type), allocatable :: chart
        type(failure_type), allocatable :: failure
        real(wp) :: change(2)
        real(wp), allocatable :: q(:), qd(:), turned(:)
        type(measure_type) :: measure
        integer :: i, j, stat

        call make_large('net', 9, mechanism, failure)
        call check_no_failure(error, failure)
        if (allocated(error)) return
        allocate (q(mechanism%n), qd(mechanism%n), turned(mechanism%n))
        mechanism%coordinate_scale = [(1.0_wp + mod(i, 7), i=1, mechanism%n)]
        call mechanism%start(q, qd)
        do i = 1, 2
            call new_chart(i == 2, chart)
            call chart%attach(mechanism, options_type(rtol=1.0e-6_wp, chart_kind=merge('dense ', 'sparse', i == 1)), .false., &
                .false., failure)
            call check_no_failure(error, failure)
            if (allocated(error)) return
            turned = 0.0_wp
            call chart%set_origin(0.0_wp, q, qd, .false., turned, stat)
            call check_count(error, stat, 0, 'status')
            turned = q + 0.01_wp*[(sin(real(j, wp)), j=1, mechanism%n)]
            call chart%project(0.1_wp, turned, qd, .false., stat)
            call check_count(error, stat, 0, 'status')
            call chart%measure(need_change, 0.0_wp, q, 0.1_wp, turned, qd, measure, stat)
            call check_count(error, stat, 0, 'status')
            change(i) = measure%change
        end do
        call check_below(error, 1.0e-3_wp, change(1), 'the rows turn')
        call check_close(error, change(2:2), change(1:1), 1.0e-12_wp, 'change of the rows')
    end subroutine test_change

end module test_sparse
