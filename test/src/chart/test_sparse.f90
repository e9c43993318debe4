! SPDX-License-Identifier: MIT
!> Tests of the sparse chart: the motions of large mechanisms against those of the dense chart, against closed forms and against
!> their own energy; what it refuses; checkpoints, statuses, dense output.
module test_sparse
    use asserts, only: check_below, check_close, check_count, check_failure, check_no_failure, check_true
    use event_kinds, only: shove_type
    use large_mechanisms, only: make_large
    use model_beads, only: beads_type
    use tandem, only: chart_type, failure_type => error_type, long, mechanism_type, new_profiled_chart, options_type, &
        polynomial_type, profile_type, simulation_type, statistics_type, wp
    use tandem_chart_factory, only: new_chart
    use tandem_chart_sparse_factor, only: factor_type
    use tandem_pack, only: pack_type
    use testdrive, only: error_type, new_unittest, unittest_type
    implicit none (type, external)
    private

    public :: collect_sparse

    character(len=14), parameter :: scenes(6) = [character(len=14) :: 'planar_chain', 'spatial_chain', 'four_bars', 'star', &
        'net', 'trailers']

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
            new_unittest('energy-of-a-chain', test_energy), &
            new_unittest('constraint-errors', test_constraint_errors), &
            new_unittest('work-of-a-step', test_work), &
            new_unittest('multipliers', test_multipliers), &
            new_unittest('impulses', test_impulses), &
            new_unittest('change-of-the-rows', test_change), &
            new_unittest('factor-of-a-checkpoint', test_factor_of_checkpoint), &
            new_unittest('dense-output', test_dense_output), &
            new_unittest('checkpoint', test_checkpoint), &
            new_unittest('choice', test_choice), &
            new_unittest('profile', test_profile), &
            new_unittest('redundant-rows', test_redundant), &
            new_unittest('refusals', test_refusals)]
    end subroutine collect_sparse

    !> Begin a run of a scene.
    subroutine begin(name, n, options, mechanism, simulation, error)
        character(len=*), intent(in) :: name
        integer, intent(in) :: n
        type(options_type), intent(in) :: options
        type(mechanism_type), intent(inout), target :: mechanism
        type(simulation_type), intent(inout) :: simulation
        type(error_type), allocatable, intent(inout) :: error
        type(failure_type), allocatable :: failure

        if (allocated(error)) return
        call make_large(name, n, mechanism, failure)
        call check_no_failure(error, failure)
        if (.not. allocated(error)) call start(mechanism, options, simulation, error)
    end subroutine begin

    !> Begin a run of a mechanism.
    subroutine start(mechanism, options, simulation, error)
        type(mechanism_type), intent(inout), target :: mechanism
        type(options_type), intent(in) :: options
        type(simulation_type), intent(inout) :: simulation
        type(error_type), allocatable, intent(inout) :: error
        type(failure_type), allocatable :: failure
        real(wp) :: q(mechanism%n), qd(mechanism%n)

        call mechanism%start(q, qd)
        call simulation%initialize(mechanism, options, 0.0_wp, q, qd, failure)
        call check_no_failure(error, failure)
    end subroutine start

    !> Options of controlled steps.
    pure function controlled(rtol, kind) result(options)
        real(wp), intent(in) :: rtol
        character(len=*), intent(in) :: kind
        type(options_type) :: options

        options%stepper = 'dop853'
        options%rtol = rtol
        options%chart_kind = kind
    end function controlled

    !> Run to a time.
    subroutine go_on(simulation, t, error)
        type(simulation_type), intent(inout) :: simulation
        real(wp), intent(in) :: t
        type(error_type), allocatable, intent(inout) :: error
        type(failure_type), allocatable :: failure

        if (allocated(error)) return
        call simulation%integrate(t, failure)
        call check_no_failure(error, failure)
    end subroutine go_on

    !> The charts are others, and so are the errors of steps: local ones of 1e-12 add up and grow a little.
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

    !> Halving the step divides the error of rk4 by sixteen; the chart costs no order.
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

        !> From the drawing with velocities that fit the drive.
        subroutine start_assembled(mechanism, kind, simulation)
            type(mechanism_type), intent(inout), target :: mechanism
            character(len=*), intent(in) :: kind
            type(simulation_type), intent(inout) :: simulation
            real(wp) :: q(mechanism%n), qd(mechanism%n)

            if (allocated(error)) return
            call mechanism%start(q, qd)
            ! The drive turns b0 at 0.5 rad/s about a point 0.5 m beside its centre; the chain follows as one body, by which the
            ! gear is at rest.
            call set_rigid(mechanism%n, qd)
            call simulation%initialize(mechanism, controlled(1.0e-12_wp, kind), 0.0_wp, q, qd, failure)
            call check_no_failure(error, failure)
        end subroutine start_assembled

        !> Everything turns as one about (-0.5, 0) at 0.5 rad/s.
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
                ! What is lost is the condition of the matrices, up to 1e4.
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

    !> N = 400: 801 bodies. The place of the first upright is also known from elsewhere.
    subroutine test_four_hundred(error)
        type(error_type), allocatable, intent(out) :: error

        call run_four_bars(400, error)
    end subroutine test_four_hundred

    !> The tolerance of 1e-11 a step leaves 1e-9.
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
        ! The tip of the first upright, B0, is twice as far as its centre.
        x = 2*simulation%state%q(1)
        y = 2*simulation%state%q(2)
        call check_close(error, [x, y], [sin(angle), cos(angle)], 1.0e-9_wp, 'B0')
        if (n == 400) call check_close(error, [x, y], [0.874791235722069_wp, 0.484500045308415_wp], 1.0e-9_wp, 'B0 as given')
    end subroutine run_four_bars

    !> theta'' = c sin(theta), theta(0) = 0, theta'(0) = 1, by rk4 with steps that leave 1e-13.
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

    !> At t = 0.71 to 0.72 uprights and couplers align, and the motion is not determined: the run ends there by name, with fixed
    !> steps and with controlled ones, however many loops go flat at once.
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
                options = options_type(chart_kind='sparse')
                if (way == 2) options = controlled(1.0e-8_wp, 'sparse')
                call begin('four_bars', 2*n(i) + 1, options, mechanism, simulation, error)
                if (allocated(error)) return
                call simulation%integrate(1.0_wp, failure)
                call check_failure(error, failure, 'rank_deficient', 'depend')
                call check_close(error, [simulation%state%t], [0.718_wp], 0.006_wp, 'end')
                if (allocated(error)) return
            end do
        end do
    end subroutine test_singular

    !> A free-swinging chain in space from the horizontal at rest: what potential energy is lost is kinetic. Within 1e-6 of m g l
    !> summed over the bodies, with fixed steps of 1 ms.
    subroutine test_energy(error)
        type(error_type), allocatable, intent(out) :: error
        integer, parameter :: n = 20
        type(mechanism_type), target :: mechanism
        type(simulation_type) :: simulation
        type(failure_type), allocatable :: failure
        real(wp) :: potential, kinetic
        integer :: stat

        call begin('spatial_chain', n, options_type(chart_kind='sparse'), mechanism, simulation, error)
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

        call begin('spatial_chain', 1000, options_type(chart_kind='sparse'), mechanism, simulation, error)
        call go_on(simulation, 0.02_wp, error)
        if (allocated(error)) return
        statistics = simulation%statistics()
        call check_below(error, max(statistics%position_error, statistics%velocity_error, statistics%acceleration_error), &
            1.0e-12_wp, 'largest error')
    end subroutine test_constraint_errors

    !> A step of rk4 in calm motion takes four factorizations, one of each stage, and one correction of the position a stage; the
    !> end may need one more.
    subroutine test_work(error)
        type(error_type), allocatable, intent(out) :: error
        type(mechanism_type), target :: mechanism
        type(simulation_type) :: simulation
        type(statistics_type) :: statistics

        call begin('spatial_chain', 30, options_type(chart_kind='sparse'), mechanism, simulation, error)
        call go_on(simulation, 0.1_wp, error)
        if (allocated(error)) return
        statistics = simulation%statistics()
        ! The start takes some of its own.
        call check_below(error, real(statistics%constraint_factorizations, wp), 4.1_wp*real(statistics%steps, wp), &
            'factorizations')
        call check_below(error, real(statistics%position_corrections, wp), 4.1_wp*real(statistics%steps, wp), 'corrections')
    end subroutine test_work

    !> The multipliers of all rows, those of Euler parameters too, are those of the dense chart.
    subroutine test_multipliers(error)
        type(error_type), allocatable, intent(out) :: error
        type(mechanism_type), target :: one, two
        type(simulation_type) :: sparse, dense
        real(wp), allocatable :: of_sparse(:), of_dense(:)
        integer :: i

        do i = 1, size(scenes)
            one = mechanism_type()
            two = mechanism_type()
            call begin(scenes(i), 17, options_type(chart_kind='sparse'), one, sparse, error)
            call begin(scenes(i), 17, options_type(chart_kind='dense'), two, dense, error)
            call go_on(sparse, 0.05_wp, error)
            call go_on(dense, 0.05_wp, error)
            if (allocated(error)) return
            of_sparse = spread(0.0_wp, 1, one%n_constraints())
            of_dense = of_sparse
            call sparse%multipliers(of_sparse)
            call dense%multipliers(of_dense)
            ! rk4 leaves 1e-9 of the motion.
            call check_close(error, of_sparse/(1 + maxval(abs(of_dense))), of_dense/(1 + maxval(abs(of_dense))), 1.0e-8_wp, &
                trim(scenes(i))//' multipliers')
        end do
    end subroutine test_multipliers

    !> A kick that misses the constraints: the velocity behind it, and the impulses of the rods, are those of the dense chart and of
    !> M (qd - before) = -C' impulse.
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
            impulses(:, i) = model%impulses
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

    !> How far C turns in a step is told as by the dense chart, of rows of unit length: a heavy row hides no other.
    subroutine test_change(error)
        type(error_type), allocatable, intent(out) :: error
        type(mechanism_type), target :: mechanism
        class(chart_type), allocatable :: chart
        type(failure_type), allocatable :: failure
        real(wp) :: change(2)
        real(wp), allocatable :: q(:), qd(:)
        integer :: i, j, stat

        call make_large('net', 9, mechanism, failure)
        call check_no_failure(error, failure)
        if (allocated(error)) return
        allocate (q(mechanism%n), qd(mechanism%n), mechanism%coordinate_scale(mechanism%n))
        mechanism%coordinate_scale = [(1.0_wp + mod(i, 7), i=1, mechanism%n)]
        call mechanism%start(q, qd)
        do i = 1, 2
            call new_chart(i == 2, chart)
            call chart%initialize(mechanism, options_type(chart_kind=merge('dense ', 'sparse', i == 1)), .false., failure)
            call check_no_failure(error, failure)
            if (allocated(error)) return
            call chart%renew(0.0_wp, q, qd, stat)
            call check_count(error, stat, 0, 'status')
            call chart%refresh(0.0_wp, q, stat)
            call chart%project_velocity(0.1_wp, q + 0.01_wp*[(sin(real(j, wp)), j=1, mechanism%n)], qd, stat)
            call check_count(error, stat, 0, 'status')
            change(i) = chart%relative_change()
        end do
        call check_below(error, 1.0e-3_wp, change(1), 'the rows turn')
        call check_close(error, change(2:2), change(1:1), 1.0e-12_wp, 'change of the rows')
    end subroutine test_change

    !> A factor that is restored knows what of rows that were left out there was left, as a loss of rank is judged by that.
    subroutine test_factor_of_checkpoint(error)
        type(error_type), allocatable, intent(out) :: error
        type(factor_type) :: factor, again
        type(pack_type) :: pack
        integer(long), allocatable :: words(:)
        character(len=64) :: problem

        allocate (factor%is_out(1), again%is_out(1), source=.false.)
        factor%rest = 0.25_wp
        factor%loosest = 7
        call pack%begin_writing()
        call factor%pack_state(pack)
        call pack%end_writing('factor', words)
        call pack%begin_reading('factor', words, problem)
        call again%pack_state(pack)
        call check_close(error, [again%rest], [factor%rest], 0.0_wp, 'rest')
        call check_count(error, again%loosest, factor%loosest, 'loosest')
    end subroutine test_factor_of_checkpoint

    !> Between steps the constraints hold as at their ends, the motion is that of the dense chart, and the look leaves no trace.
    subroutine test_dense_output(error)
        type(error_type), allocatable, intent(out) :: error
        type(mechanism_type), target :: one, two, three
        type(simulation_type) :: sparse, dense, blind
        type(failure_type), allocatable :: failure

        call begin('spatial_chain', 12, controlled(1.0e-10_wp, 'sparse'), one, sparse, error)
        call begin('spatial_chain', 12, controlled(1.0e-10_wp, 'sparse'), three, blind, error)
        call begin('spatial_chain', 12, controlled(1.0e-10_wp, 'dense'), two, dense, error)
        if (allocated(error)) return
        do while (sparse%state%t < 0.1_wp)
            call sparse%step(1.0_wp, failure)
            call check_no_failure(error, failure)
            call blind%step(1.0_wp, failure)
            call check_no_failure(error, failure)
            if (allocated(error)) return
            call sparse%look_at(sparse%state%t - 0.3_wp*sparse%last_step, failure)
            call check_no_failure(error, failure)
            call check_below(error, maxval(sparse%errors), 1.0e-12_wp, 'errors between steps')
            if (allocated(error)) return
            if (sparse%state%t > 0.08_wp) exit
            call sparse%look_back()
        end do
        call go_on(dense, sparse%state%t, error)
        call check_close(error, sparse%state%q, dense%state%q, 1.0e-8_wp, 'q between steps')
        call sparse%look_back()
        call check_true(error, all(abs(sparse%state%q - blind%state%q) <= 0.0_wp), 'a look changes the steps')
    end subroutine test_dense_output

    !> A run that is taken up from a checkpoint goes on bitwise.
    subroutine test_checkpoint(error)
        type(error_type), allocatable, intent(out) :: error
        type(mechanism_type), target :: one, two
        type(simulation_type) :: first, again
        type(failure_type), allocatable :: failure
        integer(long), allocatable :: words(:), expected(:), found(:)
        integer :: i, way
        type(options_type) :: options

        do i = 1, size(scenes)
            do way = 1, 2
                one = mechanism_type()
                two = mechanism_type()
                options = options_type(chart_kind='sparse')
                if (way == 2) options = controlled(1.0e-9_wp, 'sparse')
                call begin(scenes(i), 14, options, one, first, error)
                call begin(scenes(i), 14, options, two, again, error)
                call go_on(first, 0.021_wp, error)
                if (allocated(error)) return
                call first%save_state(words, failure)
                call check_no_failure(error, failure)
                call again%restore_state(words, failure)
                call check_no_failure(error, failure)
                call go_on(first, 0.05_wp, error)
                call go_on(again, 0.05_wp, error)
                if (allocated(error)) return
                call first%save_state(expected, failure)
                call again%save_state(found, failure)
                call check_true(error, all(abs(first%state%q - again%state%q) <= 0.0_wp) .and. &
                    all(abs(first%state%qd - again%state%qd) <= 0.0_wp), trim(scenes(i))//' goes on otherwise')
                call check_count(error, size(found), size(expected), 'words of the state')
            end do
        end do
    end subroutine test_checkpoint

    !> Few bodies get the dense chart, many the sparse one, and those that cannot have it the dense one: a run with charts that cost
    !> the square of the bodies in memory would not begin with two thousand.
    subroutine test_choice(error)
        type(error_type), allocatable, intent(out) :: error
        type(mechanism_type), target :: mechanism
        type(simulation_type) :: simulation
        type(statistics_type) :: statistics
        integer :: i

        call begin('planar_chain', 4, options_type(), mechanism, simulation, error)
        call go_on(simulation, 0.01_wp, error)
        if (allocated(error)) return
        statistics = simulation%statistics()
        call check_true(error, statistics%basis_factorizations > 0, 'few bodies have a sparse chart')
        mechanism = mechanism_type()
        call begin('spatial_chain', 2000, options_type(), mechanism, simulation, error)
        call go_on(simulation, 0.002_wp, error)
        if (allocated(error)) return
        statistics = simulation%statistics()
        call check_true(error, statistics%basis_factorizations == 0, 'many bodies have a dense chart')
        ! Implicit steps.
        mechanism = mechanism_type()
        call begin('planar_chain', 25, options_type(stepper='sdirk54'), mechanism, simulation, error)
        call go_on(simulation, 0.002_wp, error)
        if (allocated(error)) return
        ! Where the choice turns over, with explicit steps, with implicit ones, with redundant rows, and under error control.
        do i = 1, 8
            mechanism = mechanism_type()
            select case (i)
            case (1, 2)
                call begin('planar_chain', 10 + i, options_type(), mechanism, simulation, error)
            case (3, 4)
                call begin('planar_chain', 16 + i, options_type(stepper='sdirk54'), mechanism, simulation, error)
            case (7, 8)
                call begin('planar_chain', 4 + i, controlled(1.0e-6_wp, 'automatic'), mechanism, simulation, error)
            case default
                call draw_parallelograms(i - 3, mechanism, error)
                if (.not. allocated(error)) call start(mechanism, options_type(), simulation, error)
            end select
            if (allocated(error)) return
            call check_true(error, simulation%is_sparse .eqv. modulo(i, 2) == 0, 'another chart was chosen')
            if (i == 5 .or. i == 6) call check_count(error, simulation%n_redundant, i - 3, 'redundant rows')
        end do
    end subroutine test_choice

    !> A run whose time is taken has the chart that it would have, and takes the same steps.
    subroutine test_profile(error)
        type(error_type), allocatable, intent(out) :: error
        type(mechanism_type), target :: one, two
        type(simulation_type) :: plain, timed
        type(profile_type), target :: profile
        class(chart_type), allocatable :: chart
        type(failure_type), allocatable :: failure
        real(wp), allocatable :: q(:), qd(:)

        call begin('spatial_chain', 20, options_type(), one, plain, error)
        call make_large('spatial_chain', 20, two, failure)
        call check_no_failure(error, failure)
        if (allocated(error)) return
        allocate (q(two%n), qd(two%n))
        call two%start(q, qd)
        call profile%begin()
        two%timer => profile
        call new_profiled_chart(two, options_type(), profile, chart)
        call timed%initialize(two, options_type(), 0.0_wp, q, qd, failure, chart=chart)
        call check_no_failure(error, failure)
        call check_true(error, timed%is_sparse .and. plain%is_sparse, 'a chart is dense')
        call go_on(plain, 0.02_wp, error)
        call go_on(timed, 0.02_wp, error)
        if (allocated(error)) return
        call check_true(error, all(abs(plain%state%q - timed%state%q) <= 0.0_wp), 'it takes other steps')
    end subroutine test_profile

    !> What this chart cannot do is refused at the set-up, with what to do.
    subroutine test_refusals(error)
        type(error_type), allocatable, intent(out) :: error
        type(failure_type), allocatable :: failure
        type(mechanism_type), target :: mechanism
        integer :: i

        call refuse(options_type(chart_kind='sparse', chart='adaptive'), 'adaptive')
        call refuse(options_type(chart_kind='sparse', refresh='refine'), 'refine')
        call refuse(options_type(chart_kind='round'), 'chart_kind')
        ! A body without inertia.
        do i = 1, 2
            mechanism = mechanism_type()
            mechanism%planar = .true.
            call mechanism%add_body('mass', 1.0_wp, [-1.0_wp, 0.0_wp], failure, inertia=[0.0_wp])
            call check_no_failure(error, failure)
            call mechanism%add_joint('pivot', 'revolute', 'ground', 'mass', failure, at=[0.0_wp, 0.0_wp])
            call check_no_failure(error, failure)
            call mechanism%define(failure)
            call check_no_failure(error, failure)
            if (allocated(error)) return
            call initialize(options_type(chart_kind=merge('sparse   ', 'automatic', i == 1)))
            if (i == 1) call check_failure(error, failure, 'invalid_option', 'mass.angle')
            if (i == 2) call check_no_failure(error, failure)
        end do

    contains

        subroutine refuse(options, piece)
            type(options_type), intent(in) :: options
            character(len=*), intent(in) :: piece

            if (allocated(error)) return
            mechanism = mechanism_type()
            call make_large('planar_chain', 5, mechanism, failure)
            call check_no_failure(error, failure)
            call initialize(options)
            call check_failure(error, failure, 'invalid_option', piece)
        end subroutine refuse

        subroutine initialize(options)
            type(options_type), intent(in) :: options
            type(simulation_type) :: simulation
            real(wp) :: q(mechanism%n), qd(mechanism%n)

            call mechanism%start(q, qd)
            call simulation%initialize(mechanism, options, 0.0_wp, q, qd, failure)
        end subroutine initialize
    end subroutine test_refusals

    !> Parallelograms in space on three hinges and a ball joint, one of whose rows is redundant each: as many rows are left out and
    !> named, the motion is that of the dense chart, and a run that is taken up goes on bitwise.
    subroutine test_redundant(error)
        type(error_type), allocatable, intent(out) :: error
        integer, parameter :: n = 5
        type(mechanism_type), target :: one, two, three
        type(simulation_type) :: sparse, dense, again
        type(failure_type), allocatable :: failure
        integer(long), allocatable :: words(:)
        integer :: i

        call draw_parallelograms(n, one, error)
        call draw_parallelograms(n, two, error)
        call draw_parallelograms(n, three, error)
        if (allocated(error)) return
        call start(one, controlled(1.0e-12_wp, 'sparse'), sparse, error)
        call start(two, controlled(1.0e-12_wp, 'dense'), dense, error)
        call start(three, controlled(1.0e-12_wp, 'sparse'), again, error)
        if (allocated(error)) return
        call check_count(error, sparse%n_redundant, n, 'rows left out')
        call check_count(error, size(sparse%warnings), n, 'warnings')
        if (allocated(error)) return
        do i = 1, size(sparse%warnings)
            call check_true(error, index(sparse%warnings(i)%text, 'repeats') > 0, 'a warning tells of no redundant row')
        end do
        call go_on(sparse, 0.1_wp, error)
        if (allocated(error)) return
        call sparse%save_state(words, failure)
        call check_no_failure(error, failure)
        call again%restore_state(words, failure)
        call check_no_failure(error, failure)
        call go_on(sparse, 0.2_wp, error)
        call go_on(again, 0.2_wp, error)
        call go_on(dense, 0.2_wp, error)
        if (allocated(error)) return
        call check_close(error, sparse%state%q, dense%state%q, 1.0e-10_wp, 'q')
        call check_true(error, all(abs(sparse%state%q - again%state%q) <= 0.0_wp), 'it goes on otherwise')
    end subroutine test_redundant

    !> They stand side by side.
    subroutine draw_parallelograms(n, mechanism, error)
        integer, intent(in) :: n
        type(mechanism_type), intent(inout) :: mechanism
        type(error_type), allocatable, intent(inout) :: error
        type(failure_type), allocatable :: failure
        real(wp), parameter :: along(3) = [0.0_wp, 1.0_wp, 0.0_wp], inertia(3) = [0.1_wp, 0.2_wp, 0.3_wp]
        character(len=1) :: number
        real(wp) :: y
        integer :: i

        mechanism%gravity = [3.0_wp, 0.0_wp, -9.81_wp]
        do i = 1, n
            if (allocated(error)) return
            write (number, '(i0)') i
            y = i
            call mechanism%add_body('a'//number, 1.0_wp, [0.0_wp, y, 0.5_wp], failure, inertia=inertia)
            call check_no_failure(error, failure)
            call mechanism%add_body('b'//number, 1.0_wp, [0.5_wp, y, 1.0_wp], failure, inertia=inertia)
            call check_no_failure(error, failure)
            call mechanism%add_body('c'//number, 1.0_wp, [1.0_wp, y, 0.5_wp], failure, inertia=inertia)
            call check_no_failure(error, failure)
            call mechanism%add_joint('j'//number, 'revolute', 'ground', 'a'//number, failure, at=[0.0_wp, y, 0.0_wp], axis=along)
            call check_no_failure(error, failure)
            call mechanism%add_joint('k'//number, 'revolute', 'a'//number, 'b'//number, failure, at=[0.0_wp, y, 1.0_wp], axis=along)
            call check_no_failure(error, failure)
            call mechanism%add_joint('l'//number, 'revolute', 'b'//number, 'c'//number, failure, at=[1.0_wp, y, 1.0_wp], axis=along)
            call check_no_failure(error, failure)
            call mechanism%add_joint('m'//number, 'spherical', 'c'//number, 'ground', failure, at=[1.0_wp, y, 0.0_wp])
            call check_no_failure(error, failure)
        end do
        call mechanism%define(failure)
        call check_no_failure(error, failure)
    end subroutine draw_parallelograms
end module test_sparse
