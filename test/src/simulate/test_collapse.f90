! SPDX-License-Identifier: MIT
!> Tests of collapsing step sizes: the run ends with a status after some thousand steps, and states the cause; runs that take tiny
!> steps temporarily continue.
module test_collapse
    use asserts, only: check_below, check_no_failure, check_true
    use tandem, only: expression_function, expression_type, failure_type => error_type, mechanism_type, model_type, &
        procedure_model_type, options_type, &
        parse_expression, simulation_type, statistics_type, to_text, wp
    use tandem_simulate_slowing, only: slowing_type
    use testdrive, only: error_type, new_unittest, unittest_type
    implicit none (type, external)
    private

    public :: collect_collapse

    real(wp), parameter :: pi = acos(-1.0_wp)
    integer, parameter :: some_thousands = 30000
    character(len=9), parameter :: steppers(5) = [character(len=9) :: 'dop853', 'dopri5', 'radau5', 'sdirk54', 'auto']

    !> A planar pendulum whose Jacobian is `factor` q instead of 2 q.
    type, extends(procedure_model_type) :: wrong_pendulum_type
        real(wp) :: factor = 2.0_wp
    contains
        procedure :: define
    end type wrong_pendulum_type

    !> A force that is large for a moment and stiff from then on.
    type, extends(procedure_model_type) :: spring_type
        real(wp) :: rate = 1.0e5_wp
    contains
        procedure :: define => define_spring
    end type spring_type

contains

    !> The suite.
    subroutine collect_collapse(testsuite)
        type(unittest_type), allocatable, intent(out) :: testsuite(:)

        testsuite = [ &
            new_unittest('a-wrong-jacobian-is-named', test_wrong_jacobian), &
            new_unittest('a-kink-of-an-imposed-position', test_imposed_kink), &
            new_unittest('a-rope-that-is-reeled-in', test_rope), &
            new_unittest('a-spinning-rope-that-is-reeled-in', test_spinning_rope), &
            new_unittest('times-that-converge', test_slowing), &
            new_unittest('tiny-steps-of-a-stiff-start-go-on', test_stiff_start)]
    end subroutine collect_collapse

    subroutine define(self)
        class(wrong_pendulum_type), intent(inout) :: self

        self%name = 'pendulum'
        self%n = 2
        self%n_holonomic = 1
        self%constant_mass = .true.
        self%holonomic => position
        self%holonomic_jacobian => jacobian
        self%constraint_acceleration => acceleration
        self%mass_matrix => mass
        self%applied_force => weight
    end subroutine define

    subroutine position(self, t, q, value, stat)
        class(model_type), intent(inout) :: self
        real(wp), intent(in) :: t, q(:)
        real(wp), intent(out) :: value(:)
        integer, intent(out) :: stat

        value(1) = dot_product(q, q) - 1
        stat = 0
    end subroutine position

    subroutine jacobian(self, t, q, value, stat)
        class(model_type), intent(inout) :: self
        real(wp), intent(in) :: t, q(:)
        real(wp), intent(out) :: value(:, :)
        integer, intent(out) :: stat

        select type (self)
        type is (wrong_pendulum_type)
            value(1, :) = self%factor*q
        end select
        stat = 0
    end subroutine jacobian

    subroutine acceleration(self, t, q, qd, value, stat)
        class(model_type), intent(inout) :: self
        real(wp), intent(in) :: t, q(:), qd(:)
        real(wp), intent(out) :: value(:)
        integer, intent(out) :: stat

        value(1) = 2*dot_product(qd, qd)
        stat = 0
    end subroutine acceleration

    subroutine mass(self, q, value, stat)
        class(model_type), intent(inout) :: self
        real(wp), intent(in) :: q(:)
        real(wp), intent(out) :: value(:, :)
        integer, intent(out) :: stat
        integer :: i

        value = 0.0_wp
        do i = 1, size(q)
            value(i, i) = 1.0_wp
        end do
        stat = 0
    end subroutine mass

    subroutine weight(self, t, q, qd, value, stat)
        class(model_type), intent(inout) :: self
        real(wp), intent(in) :: t, q(:), qd(:)
        real(wp), intent(out) :: value(:)
        integer, intent(out) :: stat

        value = [0.0_wp, -9.81_wp]
        stat = 0
    end subroutine weight

    !> A completed run takes a bounded number of steps too, and warns about the Jacobian unless it is nearly right.
    subroutine test_wrong_jacobian(error)
        type(error_type), allocatable, intent(out) :: error
        real(wp), parameter :: factors(7) = [1.0_wp, 1.9_wp, 1.999_wp, 2.001_wp, 2.1_wp, 3.0_wp, -2.0_wp]
        type(wrong_pendulum_type), target :: model
        type(simulation_type) :: simulation
        type(statistics_type) :: statistics
        type(failure_type), allocatable :: failure
        type(options_type) :: options
        character(len=:), allocatable :: place
        integer :: i, k

        do k = 1, size(steppers)
            do i = 1, size(factors)
                place = trim(steppers(k))//' with the factor '//to_text(factors(i))
                model = wrong_pendulum_type(factor=factors(i))
                call model%define()
                options%stepper = steppers(k)
                options%rtol = 1.0e-6_wp
                call simulation%initialize(model, options, 0.0_wp, [-1.0_wp, 0.0_wp], [0.0_wp, 0.0_wp], failure)
                if (.not. allocated(failure)) call simulation%integrate(1.0_wp, failure)
                statistics = simulation%statistics()
                call check_true(error, statistics%steps < some_thousands, place//' takes '//to_text(int(statistics%steps)))
                ! Together with a wrong Jacobian a right gamma is as wrong.
                if (allocated(failure)) then
                    call check_true(error, index(failure%message, 'the Jacobian of the constraint') > 0 .or. &
                        index(failure%message, 'gamma of the constraint') > 0, place//': '//failure%message)
                else if (abs(factors(i) - 2.0_wp) > 0.01_wp) then
                    call check_true(error, index(statistics%contradiction, 'the Jacobian of the constraint') > 0 .or. &
                        index(statistics%contradiction, 'gamma of the constraint') > 0, place//' completes silently')
                end if
                if (allocated(error)) return
            end do
        end do
    end subroutine test_wrong_jacobian

    !> A cart that is driven by acos(cos(3 t + 0.1)), which turns back at (pi - 0.1)/3: derivatives are lost in rounding there, so
    !> that explicit steps collapse. Implicit ones may pass.
    subroutine test_imposed_kink(error)
        type(error_type), allocatable, intent(out) :: error
        integer :: k

        do k = 1, 2
            call check(steppers(k))
            if (allocated(error)) return
        end do

    contains

        subroutine check(stepper)
            character(len=*), intent(in) :: stepper
            type(mechanism_type), target :: mechanism
            type(expression_type) :: expression
            type(failure_type), allocatable :: failure

            mechanism%planar = .true.
            mechanism%gravity = [0.0_wp, -9.81_wp, 0.0_wp]
            mechanism%times = [0.0_wp, 2.0_wp]
            call mechanism%add_body('cart', 1.0_wp, [0.1_wp, 0.0_wp], failure, inertia=[0.1_wp])
            call check_no_failure(error, failure)
            call mechanism%add_body('bob', 0.5_wp, [0.4_wp, -0.4_wp], failure, inertia=[0.1_wp])
            call check_no_failure(error, failure)
            call parse_expression(expression, 'acos(cos(3*t + 0.1)) - 0.1', ['t'], failure)
            call check_no_failure(error, failure)
            call mechanism%add_joint('rail', 'prismatic', 'ground', 'cart', failure, at=[0.0_wp, 0.0_wp], &
                axis=[1.0_wp, 0.0_wp], motion=expression_function(expression))
            call check_no_failure(error, failure)
            call mechanism%add_joint('pin', 'revolute', 'cart', 'bob', failure, at=[0.1_wp, 0.0_wp])
            call check_no_failure(error, failure)
            call stops(mechanism, trim(stepper), 1.0e-8_wp, (pi - 0.1_wp)/3, 2.0_wp, error)
        end subroutine check
    end subroutine test_imposed_kink

    !> A bob that hangs on a rope whose length goes to zero: the row of the rope vanishes there.
    subroutine test_rope(error)
        type(error_type), allocatable, intent(out) :: error
        character(len=9), parameter :: all_steppers(6) = [steppers, 'trapezoid']
        integer :: k

        do k = 1, size(all_steppers)
            call check(all_steppers(k))
            if (allocated(error)) return
        end do

    contains

        subroutine check(stepper)
            character(len=*), intent(in) :: stepper
            type(mechanism_type), target :: mechanism
            type(expression_type) :: expression
            type(failure_type), allocatable :: failure

            mechanism%planar = .true.
            mechanism%gravity = [0.0_wp, -9.81_wp, 0.0_wp]
            mechanism%times = [0.0_wp, 2.0_wp]
            call mechanism%add_body('bob', 1.0_wp, [0.0_wp, -1.0_wp], failure)
            call check_no_failure(error, failure)
            call parse_expression(expression, '1 - t', ['t'], failure)
            call check_no_failure(error, failure)
            call mechanism%add_distance('rope', 'ground', 'bob', failure, motion=expression_function(expression))
            call check_no_failure(error, failure)
            call stops(mechanism, trim(stepper), 1.0e-8_wp, 1.0_wp, 2.0_wp, error)
        end subroutine check
    end subroutine test_rope

    !> A mass that rotates on a rope whose length goes to zero rotates ever faster: its angle grows as 1/(1 - t).
    subroutine test_spinning_rope(error)
        type(error_type), allocatable, intent(out) :: error
        character(len=9), parameter :: all_steppers(6) = [steppers, 'trapezoid']
        real(wp), parameter :: rates(2) = [0.5_wp, 3.0_wp]
        integer :: i, k

        do k = 1, size(all_steppers)
            do i = 1, size(rates)
                call check(all_steppers(k), rates(i))
                if (allocated(error)) return
            end do
        end do

    contains

        subroutine check(stepper, rate)
            character(len=*), intent(in) :: stepper
            real(wp), intent(in) :: rate
            type(mechanism_type), target :: mechanism
            type(simulation_type) :: simulation
            type(statistics_type) :: statistics
            type(expression_type) :: expression
            type(failure_type), allocatable :: failure
            type(options_type) :: options

            mechanism%planar = .true.
            mechanism%times = [0.0_wp, 2.0_wp]
            call mechanism%add_body('bob', 1.0_wp, [0.0_wp, -1.0_wp], failure)
            call check_no_failure(error, failure)
            call parse_expression(expression, '1 - t', ['t'], failure)
            call check_no_failure(error, failure)
            call mechanism%add_distance('rope', 'ground', 'bob', failure, motion=expression_function(expression))
            call check_no_failure(error, failure)
            call mechanism%define(failure)
            call check_no_failure(error, failure)
            if (allocated(error)) return
            options%stepper = stepper
            options%rtol = 1.0e-6_wp
            call simulation%initialize(mechanism, options, 0.0_wp, [0.0_wp, -1.0_wp], [rate, 1.0_wp], failure)
            call check_no_failure(error, failure)
            if (allocated(error)) return
            call simulation%integrate(2.0_wp, failure)
            statistics = simulation%statistics()
            call check_true(error, allocated(failure), trim(stepper)//' does not stop')
            if (allocated(error)) return
            call check_true(error, simulation%state%t > 0.9_wp .and. simulation%state%t < 1.0_wp, trim(stepper)//' stops at '// &
                to_text(simulation%state%t))
            call check_true(error, statistics%steps + statistics%rejected + statistics%failed < some_thousands, trim(stepper)// &
                ' takes '//to_text(int(statistics%steps))//' steps: '//failure%message)
        end subroutine check
    end subroutine test_spinning_rope

    !> Times of attempts in closed form: those that converge as powers of 1/n are found with their limit, others are not.
    subroutine test_slowing(error)
        type(error_type), allocatable, intent(out) :: error
        integer, parameter :: most = 50000

        call check('1 - 3/n', .true.)
        call check('1 - 1/n^2 from the try 3000 on', .true.)
        call check('equal steps', .false.)
        call check('rates that grow exponentially', .false.)
        call check('rates that grow as a power', .false.)
        call check('steps that are short from one time on', .false.)
        call check('steps that become short twice', .false.)

    contains

        subroutine check(kind, expected)
            character(len=*), intent(in) :: kind
            logical, intent(in) :: expected
            type(slowing_type) :: slowing
            real(wp) :: t, t_end
            logical :: converges
            integer :: n

            if (allocated(error)) return
            converges = .false.
            do n = 1, most
                t = time_of(kind, n)
                call slowing%observe(t)
                call slowing%find_end(t, t_end, converges)
                if (converges) exit
            end do
            call check_true(error, converges .eqv. expected, kind)
            if (.not. expected .or. allocated(error)) return
            call check_below(error, abs(t_end - 1.0_wp), 0.3_wp*(1.0_wp - t), 'the limit of '//kind)
            call check_true(error, n < 20000, kind//' is found after '//to_text(n))
        end subroutine check

        pure real(wp) function time_of(kind, n) result(t)
            character(len=*), intent(in) :: kind
            integer, intent(in) :: n
            real(wp) :: x

            x = real(n, wp)
            select case (kind)
            case ('1 - 3/n')
                t = 1 - 3/x
            case ('1 - 1/n^2 from the try 3000 on')
                t = 0.25_wp*x/3000
                if (n > 3000) t = 1 - 0.75_wp/(1 + (x - 3000)/600)**2
            case ('rates that grow exponentially')
                t = log(x)
            case ('rates that grow as a power')
                t = x**0.25_wp
            case ('steps that are short from one time on')
                t = min(x, 700 + (x - 700)*1.0e-6_wp)
            case ('steps that become short twice')
                t = min(x, 700 + (x - 700)*1.0e-3_wp, 702.3_wp + (x - 3000)*1.0e-6_wp)
            case default
                t = x
            end select
        end function time_of
    end subroutine test_slowing

    !> Expect a run to stop close to a time, with a status, after some thousand steps.
    subroutine stops(mechanism, stepper, rtol, t, t_end, error)
        type(mechanism_type), intent(inout), target :: mechanism
        character(len=*), intent(in) :: stepper
        real(wp), intent(in) :: rtol, t, t_end
        type(error_type), allocatable, intent(inout) :: error
        type(simulation_type) :: simulation
        type(statistics_type) :: statistics
        type(failure_type), allocatable :: failure
        type(options_type) :: options
        real(wp), allocatable :: q(:), qd(:)

        if (allocated(error)) return
        call mechanism%define(failure)
        call check_no_failure(error, failure)
        if (allocated(error)) return
        allocate (q(mechanism%n), qd(mechanism%n))
        call mechanism%start(q, qd)
        options%stepper = stepper
        options%rtol = rtol
        if (mechanism%planar .and. mechanism%n == 6) then
            ! The velocity of the drive: everything moves along.
            qd(1) = 3.0_wp
            qd(4) = 3.0_wp
        else
            qd(2) = 1.0_wp
        end if
        call simulation%initialize(mechanism, options, 0.0_wp, q, qd, failure)
        call check_no_failure(error, failure)
        if (allocated(error)) return
        call simulation%integrate(t_end, failure)
        statistics = simulation%statistics()
        call check_true(error, allocated(failure), trim(stepper)//' does not stop')
        if (allocated(error)) return
        call check_below(error, abs(simulation%state%t - t), 1.0e-3_wp, trim(stepper)//' stops at '//to_text(simulation%state%t))
        call check_true(error, statistics%steps + statistics%rejected + statistics%failed < some_thousands, trim(stepper)// &
            ' takes '//to_text(int(statistics%steps))//' steps: '//failure%message)
    end subroutine stops

    subroutine define_spring(self)
        class(spring_type), intent(inout) :: self

        self%name = 'spring'
        self%n = 1
        self%constant_mass = .true.
        self%mass_matrix => mass
        self%applied_force => spring_force
    end subroutine define_spring

    subroutine spring_force(self, t, q, qd, value, stat)
        class(model_type), intent(inout) :: self
        real(wp), intent(in) :: t, q(:), qd(:)
        real(wp), intent(out) :: value(:)
        integer, intent(out) :: stat

        value(1) = 0.0_wp
        select type (self)
        type is (spring_type)
            value(1) = -self%rate*(qd(1) - cos(t))
        end select
        stat = 0
    end subroutine spring_force

    !> A drag that pulls a velocity to cos(t) in 1e-12 s: implicit steps begin with 1e-13 s and complete.
    subroutine test_stiff_start(error)
        type(error_type), allocatable, intent(out) :: error
        type(spring_type), target :: model
        type(simulation_type) :: simulation
        type(failure_type), allocatable :: failure
        type(options_type) :: options
        integer :: k

        do k = 3, 5
            model = spring_type(rate=1.0e12_wp)
            call model%define()
            options%stepper = steppers(k)
            options%rtol = 1.0e-6_wp
            options%first_step = 1.0e-13_wp
            call simulation%initialize(model, options, 0.0_wp, [0.0_wp], [-5.0_wp], failure)
            call check_no_failure(error, failure)
            if (allocated(error)) return
            call simulation%integrate(10.0_wp, failure)
            call check_no_failure(error, failure)
            if (allocated(error)) return
            call check_below(error, abs(simulation%state%q(1) - sin(10.0_wp)), 1.0e-4_wp, trim(steppers(k)))
        end do
    end subroutine test_stiff_start
end module test_collapse
