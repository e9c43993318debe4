! SPDX-License-Identifier: MIT
!> Tests of implicit steps on the sparse chart: the gradient blocks by bodies against the matrices of the same mechanism, motions
!> against those of the dense chart and of an explicit stepper, orders, constraint errors, checkpoints, counters, refusals.
module test_sparse_implicit
    use asserts, only: check_below, check_close, check_count, check_failure, check_no_failure, check_true
    use large_mechanisms, only: make_large
    use large_runs, only: begin, check_resumption, check_timed, controlled, go_on, start
    use tandem, only: expression_type, failure_type => error_type, long, mechanism_type, options_type, parse_expression, &
        simulation_type, statistics_type, wp
    use tandem_model_derivatives, only: derivatives_type, need_all_derivatives
    use tandem_model_stiffness, only: stiffness_type
    use testdrive, only: error_type, new_unittest, unittest_type
    implicit none (type, external)
    private

    public :: collect_sparse_implicit

    character(len=14), parameter :: scenes(7) = [character(len=14) :: 'sprung_chain', 'sprung_plane', 'spatial_chain', &
        'four_bars', 'star', 'net', 'trailers']

contains

    !> The suite.
    subroutine collect_sparse_implicit(testsuite)
        type(unittest_type), allocatable, intent(out) :: testsuite(:)

        testsuite = [ &
            new_unittest('blocks-alike', test_blocks), &
            new_unittest('both-charts-alike', test_alike), &
            new_unittest('orders', test_orders), &
            new_unittest('many-bodies', test_many), &
            new_unittest('checkpoint', test_checkpoint), &
            new_unittest('redundant-rows', test_redundant), &
            new_unittest('more-rows-than-coordinates', test_more_rows), &
            new_unittest('the-norm-of-a-hub-may-be-redundant', test_norm), &
            new_unittest('stiff-springs-cost-no-steps', test_stiff), &
            new_unittest('matrices-made-amid-stages-cost-no-steps', test_matrices), &
            new_unittest('auto-exchanges-and-resumes-bitwise', test_auto), &
            new_unittest('radau-changes-its-order-and-resumes-bitwise', test_radau), &
            new_unittest('choice', test_choice), &
            new_unittest('profile', test_profile), &
            new_unittest('refusals', test_refusals)]
    end subroutine collect_sparse_implicit

    !> A chain in the plane with every kind of force: springs to far bodies and to the ground, along joints, bushings, loads that
    !> turn with bodies, and one that an expression of other bodies' states controls.
    subroutine draw_forces(planar, mechanism, error)
        logical, intent(in) :: planar
        type(mechanism_type), intent(inout) :: mechanism
        type(error_type), allocatable, intent(inout) :: error
        type(failure_type), allocatable :: failure
        character(len=2), parameter :: name(5) = ['b1', 'b2', 'b3', 'b4', 'b5']
        real(wp), parameter :: zero(3) = 0.0_wp
        character(len=32) :: control(3)
        type(expression_type) :: force(3)
        integer :: i, n

        n = merge(2, 3, planar)
        mechanism%planar = planar
        do i = 1, 5
            if (planar) then
                call mechanism%add_body(name(i), 1.0_wp + 0.1_wp*i, [real(i, wp), 0.1_wp*i], failure, inertia=[0.1_wp], &
                    omega=[0.3_wp*i], velocity=[0.1_wp, -0.2_wp*i])
            else
                call mechanism%add_body(name(i), 1.0_wp + 0.1_wp*i, [real(i, wp), 0.1_wp*i, 0.0_wp], failure, &
                    inertia=[0.1_wp, 0.2_wp, 0.15_wp], omega=[0.3_wp*i, 0.2_wp, -0.5_wp], velocity=[0.1_wp, -0.2_wp*i, 0.3_wp])
            end if
            call check_no_failure(error, failure)
        end do
        call mechanism%add_joint('j', merge('revolute ', 'spherical', planar), 'ground', 'b1', failure, at=zero(:n))
        call check_no_failure(error, failure)
        if (planar) call mechanism%add_joint('k', 'revolute', 'b2', 'b3', failure, at=[2.5_wp, 0.3_wp])
        if (.not. planar) call mechanism%add_joint('k', 'spherical', 'b2', 'b3', failure, at=[2.5_wp, 0.3_wp, 0.1_wp])
        call check_no_failure(error, failure)
        call mechanism%add_spring('far', 'b1', 'b5', failure, stiffness=20.0_wp, damping=0.3_wp, length=3.0_wp)
        call check_no_failure(error, failure)
        call mechanism%add_spring('near', 'ground', 'b2', failure, stiffness=30.0_wp, damping=0.1_wp)
        call check_no_failure(error, failure)
        if (planar) then
            call mechanism%add_torsion('twist', 'k', failure, stiffness=7.0_wp, damping=0.2_wp, angle=0.3_wp)
            call check_no_failure(error, failure)
            call mechanism%add_bushing('soft', 'b3', 'b4', failure, stiffness=[5.0_wp, 6.0_wp, 7.0_wp], &
                damping=[0.1_wp, 0.2_wp, 0.3_wp], at=[3.5_wp, 0.3_wp])
        else
            call mechanism%add_bushing('soft', 'b3', 'b4', failure, stiffness=[5.0_wp, 6.0_wp, 7.0_wp, 1.0_wp, 2.0_wp, 3.0_wp], &
                damping=[0.1_wp, 0.2_wp, 0.3_wp, 0.1_wp, 0.2_wp, 0.3_wp], at=[3.5_wp, 0.3_wp, 0.0_wp])
        end if
        call check_no_failure(error, failure)
        call mechanism%add_load('push', 'b4', failure, force=[(1.0_wp*i, i=1, n)], in_body=.true.)
        call check_no_failure(error, failure)
        control = [character(len=32) :: '-3*(b5.x - b2.x) + b1.vy*b4.y', '0.5*b3.vx', 't']
        do i = 1, n
            call parse_expression(force(i), trim(control(i)), mechanism%variable_names(), failure)
            call check_no_failure(error, failure)
        end do
        call mechanism%add_load('control', 'b5', failure, force_by=force(:n))
        call check_no_failure(error, failure)
        call mechanism%define(failure)
        call check_no_failure(error, failure)
    end subroutine draw_forces

    !> Without multipliers the blocks are the complete gradients of the forces, and in the plane with those of hinges too: the same
    !> numbers as in the matrices, added in another order, and nothing outside of the blocks.
    subroutine test_blocks(error)
        type(error_type), allocatable, intent(out) :: error
        type(mechanism_type) :: mechanism
        integer :: k

        do k = 1, 2
            mechanism = mechanism_type()
            call draw_forces(k == 1, mechanism, error)
            if (allocated(error)) return
            call compare_blocks(mechanism, merge(1.5_wp, 0.0_wp, k == 1), error)
            if (allocated(error)) return
        end do
    end subroutine test_blocks

    !> Blocks against matrices.
    subroutine compare_blocks(mechanism, multiplier, error)
        type(mechanism_type), intent(inout) :: mechanism
        real(wp), intent(in) :: multiplier
        type(error_type), allocatable, intent(inout) :: error
        type(stiffness_type) :: stiffness
        type(derivatives_type) :: derivatives
        real(wp), dimension(mechanism%n) :: q, qd, qdd, x, y
        real(wp) :: lambda(mechanism%n_constraints()), largest
        integer :: a, b, i, j, k, l, stat

        call mechanism%start(q, qd)
        qdd = [(0.1_wp*modulo(3*i, 7), i=1, mechanism%n)]
        lambda = multiplier*[(modulo(2*i, 5) - 1.0_wp, i=1, size(lambda))]
        call derivatives%allocate(mechanism%n, size(lambda))
        call mechanism%evaluate_derivatives(need_all_derivatives, 0.0_wp, q, qd, qdd, lambda, derivatives, stat)
        call stiffness%build(mechanism%pattern%first, mechanism%pattern%coupled)
        call mechanism%evaluate_stiffness(0.0_wp, q, qd, qdd, lambda, stiffness, stat)
        largest = maxval(abs(derivatives%dynamics_q))
        x = [(sin(real(i, wp)), i=1, mechanism%n)]
        y = 0.0_wp
        call stiffness%multiply(2.0_wp, x, y)
        call check_close(error, y, 2*matmul(derivatives%dynamics_q, x), 1.0e-13_wp*largest, 'K x')
        do a = 1, size(stiffness%first) - 1
            do k = stiffness%start(a), stiffness%start(a + 1) - 1
                b = stiffness%partner(k)
                l = stiffness%offset(k)
                do j = stiffness%first(b), stiffness%first(b + 1) - 1
                    do i = stiffness%first(a), stiffness%first(a + 1) - 1
                        l = l + 1
                        derivatives%dynamics_q(i, j) = derivatives%dynamics_q(i, j) - stiffness%by_q(l)
                        derivatives%dynamics_qd(i, j) = derivatives%dynamics_qd(i, j) - stiffness%by_qd(l)
                    end do
                end do
            end do
        end do
        call check_below(error, maxval(abs(derivatives%dynamics_q)), 1.0e-14_wp*largest, 'K')
        call check_below(error, maxval(abs(derivatives%dynamics_qd)), 1.0e-14_wp*largest, 'D')
    end subroutine compare_blocks

    !> Both charts have their own errors of steps: they and an explicit stepper at a thousandth of the tolerance agree within the
    !> sum of local errors of the tolerance.
    subroutine test_alike(error)
        type(error_type), allocatable, intent(out) :: error
        type(mechanism_type), target :: one, two, three
        type(simulation_type) :: sparse, dense, exact
        character(len=9), parameter :: steppers(3) = ['sdirk54  ', 'trapezoid', 'radau5   ']
        real(wp), parameter :: rtol(3) = [1.0e-8_wp, 1.0e-6_wp, 1.0e-8_wp], allowed = 100.0_wp
        integer :: i, k

        do i = 1, size(scenes)
            call begin(scenes(i), 9, controlled(1.0e-11_wp, 'dense', 'dop853'), three, exact, error)
            call go_on(exact, 0.1_wp, error)
            do k = 1, 3
                call begin(scenes(i), 9, controlled(rtol(k), 'sparse', trim(steppers(k))), one, sparse, error)
                call begin(scenes(i), 9, controlled(rtol(k), 'dense', trim(steppers(k))), two, dense, error)
                call go_on(sparse, 0.1_wp, error)
                call go_on(dense, 0.1_wp, error)
                if (allocated(error)) return
                call check_close(error, sparse%state%q, exact%state%q, allowed*rtol(k), trim(scenes(i))//' '//steppers(k)//' q')
                call check_close(error, sparse%state%q, dense%state%q, allowed*rtol(k), trim(scenes(i))//' '//steppers(k)// &
                    ' q of the charts')
            end do
        end do
    end subroutine test_alike

    !> Halving the step divides the error by sixteen, by four, or by thirty-two.
    subroutine test_orders(error)
        type(error_type), allocatable, intent(out) :: error
        type(mechanism_type), target :: mechanism
        type(simulation_type) :: simulation
        type(options_type) :: options
        character(len=9), parameter :: steppers(3) = ['sdirk54  ', 'trapezoid', 'radau5   ']
        integer, parameter :: orders(3) = [4, 2, 5]
        real(wp), parameter :: longest(3) = [1.0e-2_wp, 1.0e-2_wp, 2.0e-2_wp]
        real(wp), allocatable :: exact(:)
        real(wp) :: errors(2)
        integer :: k, way

        call begin('spatial_chain', 4, controlled(1.0e-13_wp, 'dense', 'dop853'), mechanism, simulation, error)
        call go_on(simulation, 0.4_wp, error)
        if (allocated(error)) return
        allocate (exact, source=simulation%state%q)
        do way = 1, 3
            do k = 1, 2
                options = options_type(stepper=steppers(way), chart_kind='sparse')
                options%step = longest(way)/k
                call begin('spatial_chain', 4, options, mechanism, simulation, error)
                call go_on(simulation, 0.4_wp, error)
                if (allocated(error)) return
                errors(k) = maxval(abs(simulation%state%q - exact))
            end do
            ! Errors of higher order are a tenth of it at these steps.
            call check_below(error, abs(log(errors(1)/errors(2))/log(2.0_wp) - orders(way)), 0.3_wp, &
                'order of '//steppers(way))
        end do
    end subroutine test_orders

    !> Four hundred bodies: the constraints are satisfied at every step, a matrix is reused for several steps, and Newton needs few
    !> corrections.
    subroutine test_many(error)
        type(error_type), allocatable, intent(out) :: error
        type(mechanism_type), target :: mechanism
        type(simulation_type) :: simulation
        type(statistics_type) :: statistics
        character(len=7), parameter :: steppers(2) = ['sdirk54', 'radau5 ']
        character(len=24) :: what
        integer :: i, k

        do k = 1, 2
            do i = 1, size(scenes)
                call begin(scenes(i), 400, options_type(stepper=steppers(k), step=1.0e-3_wp, chart_kind='sparse'), mechanism, &
                    simulation, error)
                call go_on(simulation, 0.02_wp, error)
                if (allocated(error)) return
                statistics = simulation%statistics()
                what = trim(scenes(i))//' '//steppers(k)
                call check_below(error, max(statistics%position_error, statistics%velocity_error, statistics%acceleration_error), &
                    1.0e-10_wp, trim(what)//' constraint errors')
                ! Twenty steps of five or three stages.
                call check_below(error, real(statistics%newton_corrections, wp), 300.0_wp, trim(what)//' corrections')
                call check_below(error, real(statistics%newton_matrices, wp), 15.0_wp, trim(what)//' matrices')
                call check_true(error, statistics%basis_factorizations == 0, trim(what)//' has a dense chart')
                if (allocated(error)) return
            end do
        end do
    end subroutine test_many

    !> With fixed and with controlled steps.
    subroutine test_checkpoint(error)
        type(error_type), allocatable, intent(out) :: error
        type(options_type) :: options(4)
        integer :: i, way

        options(1) = options_type(stepper='sdirk54', step=1.0e-3_wp, chart_kind='sparse')
        options(2) = controlled(1.0e-5_wp, 'sparse', 'trapezoid')
        options(3) = controlled(1.0e-7_wp, 'sparse', 'radau5')
        options(4) = options_type(stepper='radau5', step=1.0e-3_wp, chart_kind='sparse')
        do i = 1, size(scenes)
            do way = 1, 4
                call check_resumption(trim(scenes(i)), options(way), error)
                if (allocated(error)) return
            end do
        end do
    end subroutine test_checkpoint

    !> Pendulums on springs of 10, 1000 and 10 000 times their frequency: the motion is that of the dense chart with a hundredth of
    !> the tolerance, where that can be had, and a thousandfold stiffness takes no more than twice as many steps.
    subroutine test_stiff(error)
        type(error_type), allocatable, intent(out) :: error
        type(mechanism_type), target :: one, two
        type(simulation_type) :: sparse, dense
        real(wp), parameter :: ratio(3) = [10.0_wp, 1.0e3_wp, 1.0e4_wp], rtol = 1.0e-6_wp
        integer(long) :: steps(3)
        type(statistics_type) :: statistics
        integer :: k

        do k = 1, 3
            call begin('sliders', 12, controlled(rtol, 'sparse', 'radau5'), one, sparse, error, ratio(k))
            call go_on(sparse, 0.5_wp, error)
            if (allocated(error)) return
            statistics = sparse%statistics()
            steps(k) = statistics%steps + statistics%rejected + statistics%failed
            call check_below(error, max(statistics%position_error, statistics%velocity_error, statistics%acceleration_error), &
                1.0e-11_wp, 'constraint errors')
            if (k == 3) exit
            call begin('sliders', 12, controlled(0.01_wp*rtol, 'dense', 'radau5'), two, dense, error, ratio(k))
            call go_on(dense, 0.5_wp, error)
            if (allocated(error)) return
            call check_close(error, sparse%state%q, dense%state%q, 10*rtol, 'q')
        end do
        call check_below(error, real(maxval(steps), wp), 2.0_wp*steps(1) + 20.0_wp, 'steps of the stiffest')
    end subroutine test_stiff

    !> If a matrix is made in the middle of the stages, the next stage starts from the correction of a stage, and not from another
    !> branch: no step fails, nor is any shorter than on the dense chart.
    subroutine test_matrices(error)
        type(error_type), allocatable, intent(out) :: error
        type(mechanism_type), target :: mechanism
        type(simulation_type) :: simulation
        type(failure_type), allocatable :: failure
        type(statistics_type) :: dense, sparse
        integer :: k

        mechanism = mechanism_type(planar=.true., gravity=[1.0_wp, -9.81_wp, 0.0_wp])
        call mechanism%add_body('slider', 0.7_wp, [-0.22_wp, 0.04_wp], failure, inertia=[0.03_wp])
        call mechanism%add_joint('guide', 'prismatic', 'ground', 'slider', failure, at=[0.0_wp, 0.2_wp], axis=[0.91_wp, 0.41_wp])
        call mechanism%add_body('first', 2.0_wp, [-0.53_wp, 0.23_wp], failure, inertia=[0.03_wp])
        call mechanism%add_joint('pin', 'revolute', 'slider', 'first', failure, at=[0.0_wp, -0.13_wp])
        call mechanism%add_body('second', 2.4_wp, [-0.13_wp, -0.6_wp], failure, inertia=[0.2_wp])
        call mechanism%add_joint('hinge', 'revolute', 'first', 'second', failure, at=[-0.21_wp, 0.35_wp])
        call mechanism%add_bushing('rubber', 'ground', 'second', failure, at=[-0.19_wp, -0.86_wp], &
            stiffness=[390.0_wp, 140.0_wp, 140.0_wp], damping=[12.0_wp, 4.3_wp, 4.4_wp])
        call mechanism%define(failure)
        call check_no_failure(error, failure)
        do k = 1, 2
            if (allocated(error)) return
            call start(mechanism, controlled(merge(5.0e-8_wp, 1.0e-8_wp, k == 1), 'dense', 'sdirk54'), simulation, error)
            call go_on(simulation, 0.35_wp, error)
            dense = simulation%statistics()
            call start(mechanism, controlled(merge(5.0e-8_wp, 1.0e-8_wp, k == 1), 'sparse', 'sdirk54'), simulation, error)
            call go_on(simulation, 0.35_wp, error)
            sparse = simulation%statistics()
            call check_count(error, int(sparse%failed), 0, 'steps that fail')
            call check_below(error, 0.9_wp*dense%smallest_step, sparse%smallest_step, 'the smallest step')
        end do
    end subroutine test_matrices

    !> The stepper `auto` takes radau5 for stiff springs, and a run that is continued across the exchange is bitwise equal.
    subroutine test_auto(error)
        type(error_type), allocatable, intent(out) :: error
        type(mechanism_type), target :: one, two
        type(simulation_type) :: first, again
        type(failure_type), allocatable :: failure
        integer(long), allocatable :: words(:)
        type(statistics_type) :: statistics

        call begin('sliders', 12, controlled(1.0e-6_wp, 'sparse', 'auto'), one, first, error, 1.0e3_wp)
        call begin('sliders', 12, controlled(1.0e-6_wp, 'sparse', 'auto'), two, again, error, 1.0e3_wp)
        call go_on(first, 0.01_wp, error)
        if (allocated(error)) return
        call first%save_state(words, failure)
        call check_no_failure(error, failure)
        call again%restore_state(words, failure)
        call check_no_failure(error, failure)
        call go_on(first, 0.4_wp, error)
        call go_on(again, 0.25_wp, error)
        if (allocated(error)) return
        call again%save_state(words, failure)
        call first%restore_state(words, failure)
        call check_no_failure(error, failure)
        call go_on(first, 0.4_wp, error)
        call go_on(again, 0.4_wp, error)
        if (allocated(error)) return
        statistics = first%statistics()
        call check_true(error, statistics%newton_corrections > 0, 'auto stays explicit')
        call check_true(error, first%is_sparse, 'auto has a dense chart')
        call check_true(error, all(abs(first%state%q - again%state%q) <= 0.0_wp) .and. &
            all(abs(first%state%qd - again%state%qd) <= 0.0_wp), 'it goes on otherwise')
    end subroutine test_auto

    !> The stages of `radau` increase on the sparse chart too, with fewer corrections than radau5 and the motion of the dense chart;
    !> a run that is continued across the change is bitwise equal.
    subroutine test_radau(error)
        type(error_type), allocatable, intent(out) :: error
        type(mechanism_type), target :: one, two, three, four
        type(simulation_type) :: first, again, five, dense
        type(failure_type), allocatable :: failure
        integer(long), allocatable :: words(:)
        type(statistics_type) :: statistics, of_five
        real(wp), parameter :: rtol = 1.0e-11_wp, t_end = 0.3_wp

        call begin('spatial_chain', 9, controlled(rtol, 'sparse', 'radau'), one, first, error)
        call begin('spatial_chain', 9, controlled(rtol, 'sparse', 'radau'), two, again, error)
        call begin('spatial_chain', 9, controlled(rtol, 'sparse', 'radau5'), three, five, error)
        call begin('spatial_chain', 9, controlled(rtol, 'dense', 'radau5'), four, dense, error)
        call go_on(five, t_end, error)
        call go_on(dense, t_end, error)
        call go_on(first, 1.0e-4_wp, error)
        if (allocated(error)) return
        statistics = first%statistics()
        call check_true(error, statistics%implicit_stages == 3*(statistics%steps + statistics%rejected + statistics%failed), &
            'three stages at first')
        call first%save_state(words, failure)
        if (.not. allocated(failure)) call again%restore_state(words, failure)
        call check_no_failure(error, failure)
        call go_on(again, 0.15_wp, error)
        call go_on(first, t_end, error)
        if (allocated(error)) return
        call again%save_state(words, failure)
        call check_no_failure(error, failure)
        call go_on(again, t_end, error)
        call first%restore_state(words, failure)
        call check_no_failure(error, failure)
        call go_on(first, t_end, error)
        if (allocated(error)) return
        statistics = first%statistics()
        of_five = five%statistics()
        call check_true(error, statistics%implicit_stages > 3*(statistics%steps + statistics%rejected + statistics%failed), &
            'more stages than three')
        call check_below(error, real(statistics%newton_corrections, wp), 0.9_wp*of_five%newton_corrections, 'corrections')
        call check_close(error, first%state%q, dense%state%q, 100*rtol, 'q of radau5 on the dense chart')
        call check_true(error, all(abs(first%state%q - again%state%q) <= 0.0_wp) .and. &
            all(abs(first%state%qd - again%state%qd) <= 0.0_wp), 'it goes on otherwise')
    end subroutine test_radau

    !> A door on two hinges, with a weight on a spring: five rows are redundant, and the motion is that of a door on one hinge. With
    !> a stiff spring `auto` exchanges its charts, and the rows are dropped again.
    subroutine test_redundant(error)
        type(error_type), allocatable, intent(out) :: error
        type(mechanism_type), target :: one, two
        type(simulation_type) :: double, single
        character(len=7), parameter :: steppers(3) = ['sdirk54', 'radau5 ', 'auto   ']
        real(wp), parameter :: stiffness(3) = [1.0e3_wp, 1.0e3_wp, 1.0e8_wp], damping(3) = [1.0_wp, 1.0_wp, 1.0e4_wp]
        type(statistics_type) :: statistics
        integer :: k

        do k = 1, 3
            call draw_door(2, stiffness(k), damping(k), one, error)
            call draw_door(1, stiffness(k), damping(k), two, error)
            if (allocated(error)) return
            call start(two, controlled(1.0e-11_wp, 'dense', merge('radau5', 'dop853', k == 3)), single, error)
            call go_on(single, 0.2_wp, error)
            call start(one, controlled(1.0e-8_wp, 'sparse', trim(steppers(k))), double, error)
            call go_on(double, 0.2_wp, error)
            if (allocated(error)) return
            call check_count(error, double%n_redundant, 5, 'rows left out')
            call check_close(error, double%state%q, single%state%q, 1.0e-6_wp, 'q')
            statistics = double%statistics()
            call check_true(error, statistics%newton_corrections > 0, 'auto stays explicit')
        end do
    end subroutine test_redundant

    !> With four hinges a door has more rows than coordinates: residuals of stages have more than 3 n entries on the sparse chart.
    !> Both charts agree with a door on one hinge.
    subroutine test_more_rows(error)
        type(error_type), allocatable, intent(out) :: error
        character(len=9), parameter :: steppers(6) = [character(len=9) :: 'radau5', 'radau', 'auto', 'sdirk54', 'trapezoid', &
            'dop853']
        character(len=6), parameter :: kinds(2) = [character(len=6) :: 'dense', 'sparse']
        real(wp), parameter :: rtol(6) = [1.0e-9_wp, 1.0e-9_wp, 1.0e-9_wp, 1.0e-9_wp, 1.0e-7_wp, 1.0e-9_wp]
        type(mechanism_type), target :: one, four
        type(simulation_type) :: reference, run
        integer :: i, k

        call draw_door(1, 1.0e3_wp, 1.0_wp, one, error)
        call draw_door(4, 1.0e3_wp, 1.0_wp, four, error)
        if (allocated(error)) return
        call check_true(error, four%n_constraints() > four%n, 'as many coordinates as rows')
        call start(one, controlled(1.0e-12_wp, 'dense'), reference, error)
        call go_on(reference, 0.2_wp, error)
        do i = 1, size(kinds)
            do k = 1, size(steppers)
                call start(four, controlled(rtol(k), trim(kinds(i)), trim(steppers(k))), run, error)
                call go_on(run, 0.2_wp, error)
                call check_close(error, run%state%q, reference%state%q, 1.0e3_wp*rtol(k), trim(kinds(i))//' '//steppers(k))
                if (allocated(error)) return
                call check_count(error, run%n_redundant, 15, 'rows left out')
            end do
        end do
    end subroutine test_more_rows

    !> A hub on two slides, with an arm on four hinges along one axis and a tray on three parallel slides: the rows dropped by the
    !> sparse chart include the norm of the hub's Euler parameters. The motion is that of the dense chart.
    subroutine test_norm(error)
        type(error_type), allocatable, intent(out) :: error
        character(len=9), parameter :: steppers(3) = [character(len=9) :: 'radau5', 'radau', 'sdirk54']
        real(wp), parameter :: inertia(3) = [0.1_wp, 0.11_wp, 0.12_wp], slide(3) = [0.48_wp, -0.6_wp, 0.64_wp], &
            hinge(3) = [0.48_wp, 0.8_wp, 0.36_wp], rail(3) = [0.6_wp, 0.0_wp, -0.8_wp]
        type(mechanism_type), target :: mechanism
        type(simulation_type) :: dense, sparse
        type(failure_type), allocatable :: failure
        logical :: leaves_out_norm
        integer :: i, k

        mechanism%gravity = [1.0_wp, 2.0_wp, -9.81_wp]
        call mechanism%add_body('hub', 1.0_wp, [-0.3_wp, -0.5_wp, -0.3_wp], failure, inertia=inertia)
        call check_no_failure(error, failure)
        call mechanism%add_body('arm', 2.0_wp, [-0.4_wp, 0.4_wp, 0.1_wp], failure, inertia=inertia)
        call check_no_failure(error, failure)
        call mechanism%add_body('tray', 2.0_wp, [-0.9_wp, 0.1_wp, -0.6_wp], failure, inertia=inertia)
        call check_no_failure(error, failure)
        do i = 0, 1
            call join('s', 'prismatic', 'ground', 'hub', [-0.5_wp*i, 0.2_wp*i - 0.4_wp, 0.3_wp*i + 0.1_wp], (1 - 2*i)*slide)
        end do
        do i = 0, 3
            call join('r', 'revolute', 'hub', 'arm', [-0.2_wp, -0.1_wp, 0.0_wp] + 0.2_wp*i*hinge, hinge)
        end do
        do i = 0, 2
            call join('t', 'prismatic', 'hub', 'tray', [-0.6_wp - 0.2_wp*i, 0.1_wp*i, 0.2_wp*i - 0.5_wp], rail)
        end do
        call mechanism%define(failure)
        call check_no_failure(error, failure)
        if (allocated(error)) return
        call start(mechanism, controlled(1.0e-10_wp, 'dense', 'radau5'), dense, error)
        call go_on(dense, 0.1_wp, error)
        do k = 1, size(steppers)
            call start(mechanism, controlled(1.0e-8_wp, 'sparse', trim(steppers(k))), sparse, error)
            if (allocated(error)) return
            leaves_out_norm = .false.
            do i = 1, size(sparse%warnings)
                leaves_out_norm = leaves_out_norm .or. index(sparse%warnings(i)%text, '"hub norm" repeats') > 0
            end do
            call check_true(error, leaves_out_norm, 'no norm is left out')
            call go_on(sparse, 0.1_wp, error)
            call check_close(error, sparse%state%q, dense%state%q, 1.0e-6_wp, trim(steppers(k)))
        end do

    contains

        subroutine join(name, kind, first, second, at, axis)
            character(len=*), intent(in) :: name, kind, first, second
            real(wp), intent(in) :: at(3), axis(3)

            call mechanism%add_joint(name//achar(iachar('0') + i), kind, first, second, failure, at=at, axis=axis)
            call check_no_failure(error, failure)
        end subroutine join
    end subroutine test_norm

    !> A door on hinges along one axis, with a weight on a spring.
    subroutine draw_door(hinges, stiffness, damping, mechanism, error)
        integer, intent(in) :: hinges
        real(wp), intent(in) :: stiffness, damping
        type(mechanism_type), intent(out) :: mechanism
        type(error_type), allocatable, intent(inout) :: error
        type(failure_type), allocatable :: failure
        integer :: i

        mechanism%gravity = [3.0_wp, 0.0_wp, -9.81_wp]
        call mechanism%add_body('door', 1.0_wp, [0.0_wp, 0.5_wp, 0.5_wp], failure, inertia=[0.1_wp, 0.2_wp, 0.3_wp])
        call check_no_failure(error, failure)
        call mechanism%add_body('weight', 1.0_wp, [0.5_wp, 1.0_wp, 0.0_wp], failure, inertia=[0.1_wp, 0.1_wp, 0.1_wp])
        call check_no_failure(error, failure)
        call mechanism%add_spring('spring', 'door', 'weight', failure, stiffness=stiffness, damping=damping)
        call check_no_failure(error, failure)
        do i = 1, hinges
            call mechanism%add_joint('hinge'//achar(iachar('0') + i), 'revolute', 'ground', 'door', failure, &
                at=[0.0_wp, 0.0_wp, 0.5_wp*(i - 1)], axis=[0.0_wp, 0.0_wp, 1.0_wp])
            call check_no_failure(error, failure)
        end do
        call mechanism%define(failure)
        call check_no_failure(error, failure)
    end subroutine draw_door

    !> Many bodies get the sparse chart by default, few the dense one.
    subroutine test_choice(error)
        type(error_type), allocatable, intent(out) :: error
        type(mechanism_type), target :: mechanism
        type(simulation_type) :: simulation

        call begin('sprung_chain', 20, options_type(stepper='sdirk54', step=1.0e-3_wp), mechanism, simulation, error)
        call check_true(error, simulation%is_sparse, 'many bodies have a dense chart')
        call begin('sprung_chain', 20, options_type(stepper='radau5', step=1.0e-3_wp), mechanism, simulation, error)
        call check_true(error, simulation%is_sparse, 'many bodies have a dense chart with radau5')
        call begin('sprung_chain', 2, options_type(stepper='sdirk54', step=1.0e-3_wp), mechanism, simulation, error)
        call check_true(error, .not. simulation%is_sparse, 'few bodies have a sparse chart')
    end subroutine test_choice

    !> With stages one by one, and with stages together.
    subroutine test_profile(error)
        type(error_type), allocatable, intent(out) :: error

        call check_timed('sprung_chain', options_type(stepper='sdirk54', step=1.0e-3_wp, chart_kind='sparse'), error)
        if (.not. allocated(error)) call check_timed('sprung_chain', options_type(stepper='radau5', step=1.0e-3_wp, &
            chart_kind='sparse'), error)
    end subroutine test_profile

    !> Unavailable combinations are refused with their names.
    subroutine test_refusals(error)
        type(error_type), allocatable, intent(out) :: error
        type(failure_type), allocatable :: failure
        type(mechanism_type), target :: mechanism

        call make_large('sprung_plane', 5, mechanism, failure)
        call check_no_failure(error, failure)
        mechanism%derives_by_bodies = .false.
        call initialize('radau5')
        call check_failure(error, failure, 'invalid_option', 'evaluate_stiffness')
        call initialize('sdirk54')
        call check_failure(error, failure, 'invalid_option', 'evaluate_stiffness')

    contains

        subroutine initialize(stepper)
            character(len=*), intent(in) :: stepper
            type(simulation_type) :: simulation
            real(wp) :: q(mechanism%n), qd(mechanism%n)

            call mechanism%start(q, qd)
            call simulation%initialize(mechanism, options_type(stepper=stepper, step=1.0e-3_wp, chart_kind='sparse'), 0.0_wp, &
                q, qd, failure)
        end subroutine initialize
    end subroutine test_refusals
end module test_sparse_implicit
