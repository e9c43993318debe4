! SPDX-License-Identifier: MIT
!> Tests of Radau IIA with 3, 5 and 7 stages, and of the stepper that chooses between them.
module test_radau
    use asserts, only: check_below, check_between, check_close, check_count, check_failure, check_no_failure, check_true
    use event_kinds, only: bounce_type
    use model_pendulum, only: pendulum_type
    use model_stiff_pendulum, only: stiff_pendulum_type
    use reference, only: read_reference, reference_type
    use runs, only: get_start, new_scene, run
    use tandem, only: failure_type => error_type, long, model_type, procedure_model_type, motorcycle_type, new_stepper, &
        options_type, profile_type, &
        properties_type, simulation_type, statistics_type, stepper_choices, to_text, wp
    use tandem_chart, only: step_end
    use tandem_chart_dense, only: dense_chart_type
    use tandem_stepper, only: stepper_type
    use tandem_stepper_radau, only: radau_type
    use tandem_stepper_radau_tableau, only: tableau_of, tableau_type
    use tandem_stepper_state, only: state_type
    use testdrive, only: error_type, new_unittest, unittest_type
    implicit none (type, external)
    private

    public :: collect_radau

    integer, parameter :: stages(3) = [3, 5, 7]

    !> State saved during a run.
    type :: row_type
        integer(long), allocatable :: words(:)
    end type row_type

    !> The pendulum by its angle, whose steps are not bounded by charts.
    type, extends(procedure_model_type) :: angle_type
    contains
        procedure :: define => define_angle
    end type angle_type

contains

    !> The suite.
    subroutine collect_radau(testsuite)
        type(unittest_type), allocatable, intent(out) :: testsuite(:)

        testsuite = [ &
            new_unittest('coefficients-satisfy-the-conditions-of-their-order', test_conditions), &
            new_unittest('transformations-make-the-coefficients-block-diagonal', test_transformations), &
            new_unittest('a-pendulum-in-closed-form-shows-orders-five-nine-and-thirteen', test_orders), &
            new_unittest('radau-is-a-stepper-by-name-without-fixed-steps', test_name), &
            new_unittest('radau-meets-the-reference-of-a-stiff-pendulum', test_reference), &
            new_unittest('radau-takes-fewer-corrections-to-tight-tolerances', test_tight), &
            new_unittest('radau-takes-no-more-corrections-to-loose-tolerances', test_loose), &
            new_unittest('radau-is-right-between-its-steps', test_between), &
            new_unittest('radau-goes-on-bitwise-across-changes-of-its-order', test_checkpoint), &
            new_unittest('radau-begins-anew-after-events', test_events), &
            new_unittest('a-profile-of-radau-changes-nothing', test_profile)]
    end subroutine collect_radau

    !> Quadrature of order 2 s - 1 and stages of order s, which make Radau IIA (Hairer, Wanner II, section IV.5); the last stage is
    !> the end of the step. The embedded formula integrates polynomials of degree s - 1.
    subroutine test_conditions(error)
        type(error_type), allocatable, intent(out) :: error
        type(tableau_type) :: m
        integer :: i, k, q

        do k = 1, size(stages)
            m = tableau_of(stages(k))
            associate (s => stages(k), rounding => 1.0e-14_wp)
                call check_count(error, m%stages, s, 'stages')
                call check_close(error, [m%c(s)], [1.0_wp], 0.0_wp, 'the last node')
                do q = 1, 2*s - 1
                    call check_close(error, [sum(m%a(:s, s)*m%c(:s)**(q - 1))], [1.0_wp/real(q, wp)], rounding, &
                        to_text(s)//' stages, quadrature of degree '//to_text(q - 1))
                end do
                call check_true(error, abs(sum(m%a(:s, s)*m%c(:s)**(2*s - 1)) - 1.0_wp/real(2*s, wp)) > 1.0e-10_wp, &
                    'the quadrature is no better than that')
                do q = 1, s
                    do i = 1, s
                        call check_close(error, [sum(m%a(:s, i)*m%c(:s)**(q - 1))], [m%c(i)**q/real(q, wp)], rounding, &
                            to_text(s)//' stages, degree '//to_text(q - 1)//' in stage '//to_text(i))
                    end do
                    call check_close(error, [sum((m%a(:s, s) + m%diagonal*m%weight(:s))*m%c(:s)**(q - 1)) + &
                        merge(m%diagonal, 0.0_wp, q == 1)], [1.0_wp/real(q, wp)], rounding, 'the embedded formula')
                end do
                if (allocated(error)) return
            end associate
        end do
    end subroutine test_conditions

    !> T^-1 A T has the real eigenvalue and the pairs, whose solutions x + i y belong to two columns.
    subroutine test_transformations(error)
        type(error_type), allocatable, intent(out) :: error
        type(tableau_type) :: m
        real(wp) :: expected(7, 7), found(7, 7), unit(7, 7)
        integer :: i, k

        do k = 1, size(stages)
            m = tableau_of(stages(k))
            associate (s => stages(k))
                ! All of them by rows.
                unit(:s, :s) = matmul(transpose(m%t_inverse(:s, :s)), transpose(m%t(:s, :s)))
                found(:s, :s) = matmul(transpose(m%t_inverse(:s, :s)), matmul(transpose(m%a(:s, :s)), transpose(m%t(:s, :s))))
                expected = 0.0_wp
                expected(1, 1) = m%diagonal
                do i = 1, (s - 1)/2
                    associate (pair => m%diagonal*m%ratio(i))
                        expected(2*i, 2*i:2*i + 1) = [real(pair, wp), -aimag(pair)]
                        expected(2*i + 1, 2*i:2*i + 1) = [aimag(pair), real(pair, wp)]
                    end associate
                end do
                call check_close(error, reshape(found(:s, :s), [s*s]), reshape(expected(:s, :s), [s*s]), 1.0e-12_wp, &
                    to_text(s)//' stages: eigenvalues')
                do i = 1, s
                    unit(i, i) = unit(i, i) - 1.0_wp
                end do
                call check_below(error, maxval(abs(unit(:s, :s))), 1.0e-12_wp, to_text(s)//' stages: T and its inverse')
                if (allocated(error)) return
            end associate
        end do
    end subroutine test_transformations

    !> n = 1 and no constraint.
    subroutine define_angle(self)
        class(angle_type), intent(inout) :: self

        self%name = 'angle'
        self%n = 1
        self%constant_mass = .true.
        self%mass_matrix => unit_mass
        self%applied_force => torque
    end subroutine define_angle

    subroutine unit_mass(self, q, value, stat)
        class(model_type), intent(inout) :: self
        real(wp), intent(in) :: q(:)
        real(wp), intent(out) :: value(:, :)
        integer, intent(out) :: stat

        stat = 0
        value = 1.0_wp
    end subroutine unit_mass

    subroutine torque(self, t, q, qd, value, stat)
        class(model_type), intent(inout) :: self
        real(wp), intent(in) :: t, q(:), qd(:)
        real(wp), intent(out) :: value(:)
        integer, intent(out) :: stat
        type(pendulum_type) :: pendulum

        stat = 0
        value = -pendulum%g/pendulum%length*sin(q)
    end subroutine torque

    !> Fixed steps with a number of stages and a chart at each step: a pendulum through its lowest point, which reverses at 2 rad.
    subroutine swing(s, h, n, angle, error)
        integer, intent(in) :: s, n
        real(wp), intent(in) :: h
        !> Angle after n steps.
        real(wp), intent(out) :: angle
        type(error_type), allocatable, intent(inout) :: error
        type(angle_type), target :: model
        type(pendulum_type) :: pendulum
        type(dense_chart_type) :: chart
        type(radau_type) :: stepper
        type(state_type) :: state, next
        type(failure_type), allocatable :: failure
        integer :: k, stat

        call model%define()
        call chart%attach(model, options_type(), .true., .false., failure)
        call check_no_failure(error, failure)
        if (allocated(error)) return
        stepper%least = s
        stepper%most = s
        call stepper%initialize([1.0_wp], 1.0e-14_wp)
        call state%allocate(1)
        call next%allocate(1)
        state%qd = 2*sin(1.0_wp)*sqrt(pendulum%g/pendulum%length)
        call chart%set_origin(0.0_wp, state%q, state%qd, .false., state%dq, stat)
        call chart%accelerate(0.0_wp, state%q, state%qd, step_end, state%qdd, stat)
        do k = 1, n
            if (stat == 0) call chart%set_origin(state%t, state%q, state%qd, .false., state%dq, stat)
            state%dq = 0.0_wp
            state%dqd = 0.0_wp
            next%t = real(k, wp)*h
            if (stat == 0) call stepper%advance(chart, state, next%t - state%t, next, stat)
            call check_count(error, stat, 0, 'status of the step')
            if (allocated(error)) return
            call state%copy(next)
        end do
        angle = state%q(1)
    end subroutine swing

    !> The angle of that pendulum at t: sin(angle/2) = k sn(omega t, k), sn by the arithmetic-geometric mean (Abramowitz, Stegun,
    !> 16.4).
    pure real(wp) function exact_angle(t)
        real(wp), intent(in) :: t
        type(pendulum_type) :: model
        integer, parameter :: n = 6
        real(wp) :: a(0:n), b, c(0:n), phi
        integer :: i

        a(0) = 1.0_wp
        b = cos(1.0_wp)
        c(0) = sin(1.0_wp)
        do i = 1, n
            a(i) = (a(i - 1) + b)/2
            c(i) = (a(i - 1) - b)/2
            b = sqrt(a(i - 1)*b)
        end do
        phi = 2.0_wp**n*a(n)*sqrt(model%g/model%length)*t
        do i = n, 1, -1
            phi = (phi + asin(c(i)/a(i)*sin(phi)))/2
        end do
        exact_angle = 2*asin(sin(1.0_wp)*sin(phi))
    end function exact_angle

    !> From a step to a shorter one, at t = 2.
    subroutine test_orders(error)
        type(error_type), allocatable, intent(out) :: error
        real(wp), parameter :: t = 2.0_wp
        integer, parameter :: steps(2, 3) = reshape([40, 80, 14, 28, 8, 12], [2, 3])
        real(wp) :: angle, errors(2)
        integer :: i, k

        do k = 1, size(stages)
            do i = 1, 2
                call swing(stages(k), t/real(steps(i, k), wp), steps(i, k), angle, error)
                if (allocated(error)) return
                errors(i) = abs(angle - exact_angle(t))
            end do
            call check_true(error, errors(2) > 1.0e-13_wp, 'truncation, not rounding')
            call check_between(error, log(errors(1)/errors(2))/log(real(steps(2, k), wp)/steps(1, k)), &
                2*stages(k) - 1.6_wp, 2*stages(k) + 0.5_wp, 'order with '//to_text(stages(k))//' stages')
            if (allocated(error)) return
        end do
    end subroutine test_orders

    !> Its name, and the refusal of fixed steps.
    subroutine test_name(error)
        type(error_type), allocatable, intent(out) :: error
        class(model_type), allocatable, target :: model
        class(stepper_type), allocatable :: stepper
        type(properties_type) :: properties
        type(simulation_type) :: simulation
        type(failure_type), allocatable :: failure
        real(wp), allocatable :: q(:), qd(:)

        call check_true(error, any(stepper_choices == 'radau'), 'radau can be asked for')
        call new_stepper('radau', stepper)
        properties = stepper%properties()
        call check_true(error, properties%name == 'radau' .and. properties%varies .and. .not. properties%has_fixed_steps(), &
            'radau and its properties')
        call new_scene('disk', model)
        call get_start('disk', q, qd)
        call simulation%initialize(model, options_type(stepper='radau', step=1.0e-3_wp), 0.0_wp, q, qd, failure)
        call check_failure(error, failure, 'invalid_option', 'step is given, but radau chooses between orders')
    end subroutine test_name

    !> Positions at 1e-6 and 1e-10 against Radau IIA with more digits in other coordinates.
    subroutine test_reference(error)
        type(error_type), allocatable, intent(out) :: error
        class(model_type), allocatable, target :: model
        type(reference_type) :: table
        type(simulation_type) :: simulation
        type(failure_type), allocatable :: failure
        real(wp), parameter :: rtols(2) = [1.0e-6_wp, 1.0e-10_wp]
        real(wp), allocatable :: q(:), qd(:)
        integer :: i

        call read_reference('stiff_pendulum', table)
        call get_start('stiff_pendulum', q, qd)
        do i = 1, size(rtols)
            call new_scene('stiff_pendulum', model)
            associate (last => size(table%t))
                call run(simulation, model, options_type(stepper='radau', rtol=rtols(i)), 0.0_wp, q, qd, table%t(last), failure)
                call check_no_failure(error, failure)
                if (allocated(error)) return
                call check_below(error, maxval(abs(simulation%state%q - table%q(:, last))), 30*rtols(i), 'position')
            end associate
            if (allocated(error)) return
        end do
    end subroutine test_reference

    !> A run of radau or radau5: its end and its cost.
    subroutine measure(scene, stepper, rtol, t_end, q_end, statistics, error)
        !> A scene, or the slow pendulum on a spring of frequency ratio 1e2 or 1e4, or the motorcycle on a suspension 100 times as
        !> stiff and as damped.
        character(len=*), intent(in) :: scene, stepper
        real(wp), intent(in) :: rtol, t_end
        real(wp), allocatable, intent(out) :: q_end(:)
        type(statistics_type), intent(out) :: statistics
        type(error_type), allocatable, intent(inout) :: error
        class(model_type), allocatable, target :: model
        type(motorcycle_type), allocatable :: motorcycle
        type(stiff_pendulum_type), allocatable :: pendulum
        type(simulation_type) :: simulation
        type(failure_type), allocatable :: failure
        real(wp), allocatable :: q(:), qd(:)
        real(wp) :: ratio, stretch

        if (allocated(error)) return
        select case (scene)
        case ('slow_1e2', 'slow_1e4')
            ratio = merge(1.0e2_wp, 1.0e4_wp, scene == 'slow_1e2')
            allocate (pendulum)
            pendulum%k = 9.81_wp*ratio**2
            pendulum%c = sqrt(pendulum%k)
            pendulum%has_stretch = .true.
            pendulum%has_derivatives = .true.
            call pendulum%define()
            stretch = 9.81_wp*cos(1.0_wp)/pendulum%k
            q = [(1 + stretch)*sin(1.0_wp), -(1 + stretch)*cos(1.0_wp), stretch]
            qd = 0*q
            call move_alloc(pendulum, model)
        case ('stiff_motorcycle')
            allocate (motorcycle)
            motorcycle%stiffness = 100*motorcycle%stiffness
            motorcycle%damping = 100*motorcycle%damping
            call motorcycle%define()
            call get_start('motorcycle', q, qd)
            call move_alloc(motorcycle, model)
        case default
            call new_scene(scene, model)
            call get_start(scene, q, qd)
        end select
        call run(simulation, model, options_type(stepper=stepper, rtol=rtol), 0.0_wp, q, qd, t_end, failure)
        statistics = simulation%statistics()
        q_end = simulation%state%q
        call check_no_failure(error, failure)
    end subroutine measure

    !> The same results as radau5 at a tenth of the tolerance, for a lower cost.
    subroutine test_tight(error)
        type(error_type), allocatable, intent(out) :: error
        character(len=16), parameter :: scenes(4) = [character(len=16) :: 'slow_1e2', 'slow_1e4', 'motorcycle', 'disk']
        real(wp), parameter :: t_end(4) = [2.0_wp, 2.0_wp, 4.0_wp, 4.0_wp], rtols(2) = [1.0e-8_wp, 1.0e-10_wp]
        !> Ratio of the corrections to those of radau5.
        real(wp), parameter :: most(2, 4) = reshape([0.8_wp, 0.5_wp, 0.8_wp, 0.5_wp, 0.7_wp, 0.4_wp, 0.95_wp, 0.6_wp], [2, 4])
        type(statistics_type) :: five, fine, varied
        real(wp), allocatable :: exact(:), q(:), q_five(:)
        integer :: i, k

        do k = 1, size(scenes)
            call measure(trim(scenes(k)), 'radau5', 1.0e-12_wp, t_end(k), exact, fine, error)
            do i = 1, size(rtols)
                call measure(trim(scenes(k)), 'radau5', rtols(i), t_end(k), q_five, five, error)
                call measure(trim(scenes(k)), 'radau', rtols(i), t_end(k), q, varied, error)
                if (allocated(error)) return
                call check_below(error, maxval(abs(q - exact)/(1 + abs(exact))), &
                    max(20*rtols(i), 3*maxval(abs(q_five - exact)/(1 + abs(exact)))), trim(scenes(k))//': error')
                call check_below(error, real(varied%newton_corrections, wp), most(i, k)*real(five%newton_corrections, wp), &
                    trim(scenes(k))//': corrections')
                call check_true(error, varied%implicit_stages > 3*varied%steps, 'more stages than three')
                if (allocated(error)) return
            end do
        end do
    end subroutine test_tight

    !> For few digits three stages are best; and the test of other numbers costs nothing.
    subroutine test_loose(error)
        type(error_type), allocatable, intent(out) :: error
        character(len=16), parameter :: scenes(6) = [character(len=16) :: 'slow_1e2', 'slow_1e4', 'stiff_pendulum', 'motorcycle', &
            'stiff_motorcycle', 'disk']
        real(wp), parameter :: t_end(6) = [2.0_wp, 2.0_wp, 1.0_wp, 4.0_wp, 4.0_wp, 4.0_wp], rtols(2) = [1.0e-4_wp, 1.0e-6_wp]
        type(statistics_type) :: five, varied
        real(wp), allocatable :: q(:)
        integer :: i, k

        do k = 1, size(scenes)
            do i = 1, size(rtols)
                call measure(trim(scenes(k)), 'radau5', rtols(i), t_end(k), q, five, error)
                call measure(trim(scenes(k)), 'radau', rtols(i), t_end(k), q, varied, error)
                if (allocated(error)) return
                call check_below(error, real(varied%newton_corrections, wp), 1.05_wp*real(five%newton_corrections, wp), &
                    trim(scenes(k))//': corrections at '//to_text(rtols(i)))
                if (allocated(error)) return
            end do
        end do
    end subroutine test_loose

    !> Dense output of steps of all numbers of stages: the motion of a run with a tighter tolerance, and on the manifold.
    subroutine test_between(error)
        type(error_type), allocatable, intent(out) :: error
        real(wp), parameter :: rtol = 1.0e-10_wp
        type(pendulum_type), target :: model
        type(simulation_type) :: simulation
        type(statistics_type) :: before, after
        type(failure_type), allocatable :: failure
        real(wp) :: angle, q(2), qd(2), t, worst
        integer :: k
        logical :: seen(7)

        call model%define()
        call model%start(0.0_wp, 2*sin(1.0_wp)*sqrt(model%g/model%length), q, qd)
        call simulation%initialize(model, options_type(stepper='radau', rtol=rtol), 0.0_wp, q, qd, failure)
        call check_no_failure(error, failure)
        worst = 0.0_wp
        seen = .false.
        do while (simulation%state%t < 4.0_wp)
            before = simulation%statistics()
            call simulation%step(4.0_wp, failure)
            call check_no_failure(error, failure)
            if (allocated(error)) return
            after = simulation%statistics()
            k = int(after%implicit_stages - before%implicit_stages)
            if (after%steps - before%steps == 1 .and. k <= 7) seen(k) = .true.
            do k = 1, 3
                t = simulation%state%t - 0.25_wp*k*simulation%last_step
                call simulation%look_at(t, failure)
                call check_no_failure(error, failure)
                if (allocated(error)) return
                angle = atan2(simulation%state%q(1), -simulation%state%q(2))
                worst = max(worst, abs(angle - exact_angle(t)))
                call check_below(error, abs(norm2(simulation%state%q) - model%length), 1.0e-12_wp, 'length of the rod')
                call simulation%look_back()
            end do
        end do
        call check_true(error, all(seen(stages)), 'steps of all numbers of stages')
        call check_below(error, worst, 100*rtol, 'error between steps')
    end subroutine test_between

    !> Continued after each of its steps, including those of all numbers of stages and those before a change, a run is bitwise
    !> equal.
    subroutine test_checkpoint(error)
        type(error_type), allocatable, intent(out) :: error
        type(pendulum_type), target :: one, two
        type(simulation_type) :: first, second
        type(failure_type), allocatable :: failure
        integer(long), allocatable :: expected(:), words(:)
        integer, parameter :: n = 70
        !> State saved after each step, and its number of stages.
        type(row_type) :: saved(n)
        integer :: stages_of(n), i, k

        call begin(one, first)
        call begin(two, second)
        if (allocated(error)) return
        do k = 1, n
            stages_of(k) = -int(stages_so_far(first))
            call first%step(100.0_wp, failure)
            stages_of(k) = stages_of(k) + int(stages_so_far(first))
            if (.not. allocated(failure)) call first%save_state(words, failure)
            call check_no_failure(error, failure)
            if (allocated(error)) return
            saved(k)%words = words
        end do
        call check_true(error, all([(any(stages_of == stages(i)), i=1, 3)]), 'steps of all numbers of stages')
        allocate (expected, source=saved(n)%words)
        do k = 1, n - 1
            call second%restore_state(saved(k)%words, failure)
            do i = k + 1, n
                if (.not. allocated(failure)) call second%step(100.0_wp, failure)
            end do
            if (.not. allocated(failure)) call second%save_state(words, failure)
            call check_no_failure(error, failure)
            if (allocated(error)) return
            call check_count(error, size(words), size(expected), 'words')
            if (allocated(error)) return
            call check_true(error, all(words == expected), 'taken up after step '//to_text(k)//' with '// &
                to_text(stages_of(k))//' stages, it goes on otherwise')
            if (allocated(error)) return
        end do

    contains

        subroutine begin(model, simulation)
            type(pendulum_type), target, intent(inout) :: model
            type(simulation_type), intent(inout) :: simulation
            real(wp) :: q(2), qd(2)

            if (allocated(error)) return
            call model%define()
            call model%start(0.0_wp, 2*sin(1.0_wp)*sqrt(model%g/model%length), q, qd)
            call simulation%initialize(model, options_type(stepper='radau', rtol=1.0e-10_wp), 0.0_wp, q, qd, failure)
            call check_no_failure(error, failure)
        end subroutine begin
    end subroutine test_checkpoint

    !> Stages of all steps so far.
    integer(long) function stages_so_far(simulation)
        type(simulation_type), intent(in) :: simulation
        type(statistics_type) :: statistics

        statistics = simulation%statistics()
        stages_so_far = statistics%implicit_stages
    end function stages_so_far

    !> The pendulum is reflected at its lowest point each time: the free motion, on one side. After each bounce, the stages begin
    !> with three again, and increase.
    subroutine test_events(error)
        type(error_type), allocatable, intent(out) :: error
        real(wp), parameter :: rtol = 1.0e-10_wp, t_end = 5.0_wp
        type(pendulum_type), target :: model
        type(bounce_type), target :: wall
        type(simulation_type) :: simulation
        type(failure_type), allocatable :: failure
        real(wp) :: q(2), qd(2)
        integer(long) :: so_far
        integer :: n_events, n_grown
        logical :: is_first, has_grown

        call model%define()
        call model%start(0.0_wp, 2*sin(1.0_wp)*sqrt(model%g/model%length), q, qd)
        call simulation%initialize(model, options_type(stepper='radau', rtol=rtol), 0.0_wp, q, qd, failure)
        call check_no_failure(error, failure)
        wall = bounce_type(name='wall', direction=-1, changes=.true., quantity='q', index=1, value=0.0_wp, restitution=1.0_wp)
        call simulation%add_event(wall)
        n_events = 0
        n_grown = 0
        is_first = .true.
        has_grown = .false.
        do while (simulation%state%t < t_end)
            so_far = stages_so_far(simulation)
            call simulation%step(t_end, failure)
            call check_no_failure(error, failure)
            if (allocated(error)) return
            so_far = stages_so_far(simulation) - so_far
            if (is_first) call check_true(error, mod(so_far, 3_long) == 0, 'the first step has three stages')
            if (so_far == 5 .or. so_far == 7) has_grown = .true.
            is_first = simulation%n_events > n_events
            if (.not. is_first) cycle
            n_events = simulation%n_events
            if (has_grown) n_grown = n_grown + 1
            has_grown = .false.
        end do
        call check_true(error, n_events >= 3 .and. n_grown == n_events, 'bounces, and more stages before each')
        call check_below(error, abs(atan2(simulation%state%q(1), -simulation%state%q(2)) - abs(exact_angle(t_end))), 100*rtol, &
            'angle')
    end subroutine test_events

    !> A chart whose time is measured gives identical results for all numbers of stages, word by word.
    subroutine test_profile(error)
        type(error_type), allocatable, intent(out) :: error
        class(model_type), allocatable, target :: one, two
        type(simulation_type) :: plain, profiled
        type(profile_type), target :: profile
        type(failure_type), allocatable :: failure
        type(options_type) :: options
        type(statistics_type) :: statistics
        integer(long), allocatable :: expected(:), found(:)
        real(wp), allocatable :: q(:), qd(:)
        integer :: k

        call new_scene('motorcycle', one)
        call new_scene('motorcycle', two)
        call get_start('motorcycle', q, qd)
        call profile%begin()
        two%state%timer => profile
        options = options_type(stepper='radau', rtol=1.0e-10_wp)
        call plain%initialize(one, options, 0.0_wp, q, qd, failure)
        if (.not. allocated(failure)) call profiled%initialize(two, options, 0.0_wp, q, qd, failure)
        do k = 1, 35
            if (.not. allocated(failure)) call plain%step(100.0_wp, failure)
            if (.not. allocated(failure)) call profiled%step(100.0_wp, failure)
        end do
        if (.not. allocated(failure)) call plain%save_state(expected, failure)
        if (.not. allocated(failure)) call profiled%save_state(found, failure)
        call check_no_failure(error, failure)
        if (allocated(error)) return
        statistics = plain%statistics()
        call check_true(error, statistics%implicit_stages > 3*statistics%steps, 'more stages than three')
        call check_count(error, size(found), size(expected), 'words')
        if (allocated(error)) return
        call check_true(error, all(found == expected), 'the same state and counters')
    end subroutine test_profile
end module test_radau
