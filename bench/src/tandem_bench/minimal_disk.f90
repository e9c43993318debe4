! SPDX-License-Identifier: MIT
!> The rolling disk in seven minimal coordinates, derived by hand, with DOP853: the limit of what can be achieved. It solves this
!> problem only.
!>
!> (x, y, phi, theta, thetad, phid, w): centre, heading of the rolling direction t, angle of the axis n to the vertical, rates, and
!> the angular velocity w about the axis. With t, s = n x t, n as frame, the contact is r - R s, and rolling gives rd = R (thetad n
!> - w t). The moment of momentum about the contact gives three equations without unknown forces.
module tandem_bench_minimal_disk
    use tandem, only: model_type, options_type, rolling_disk_type, wp
    use tandem_bench_solver, only: problem_type, solver_type
    use tandem_rigid_euler_parameters, only: g_product, rotation
    use tandem_simulate_step_control, only: step_control_type
    use tandem_stepper_dop853, only: dop853_type
    implicit none (type, external)
    private

    public :: by_hand_type

    !> Number of unknowns, and the same padded to whole vectors.
    integer, parameter :: unknowns = 7, states = 8

    type, extends(solver_type) :: by_hand_type
        private
        real(wp) :: radius = 0.0_wp, axial = 0.0_wp, diametral = 0.0_wp, inertia = 0.0_wp, weight = 0.0_wp
        real(wp) :: y0(states) = 0.0_wp, y(states) = 0.0_wp, z(states) = 0.0_wp, last(states) = 0.0_wp
        real(wp) :: f(states, 12) = 0.0_wp, a(12, 12) = 0.0_wp, b(12) = 0.0_wp, c(12) = 0.0_wp, e(12, 2) = 0.0_wp
        real(wp) :: t_start = 0.0_wp, t_end = 0.0_wp, tolerance = 0.0_wp
        type(step_control_type) :: control
    contains
        procedure :: can_solve
        procedure :: prepare
        procedure :: run
        procedure, private :: integrate
        procedure, private :: first_step
        procedure, private :: step
        procedure, private :: estimate
        procedure, private :: finish_step
        procedure, private :: set_rate
    end type by_hand_type

contains

    !> True for the rolling disk only.
    logical function can_solve(self, problem)
        class(by_hand_type), intent(in) :: self
        type(problem_type), intent(in) :: problem

        can_solve = .false.
        select type (model => problem%model)
        class is (rolling_disk_type)
            can_solve = .true.
        end select
    end function can_solve

    !> Convert the redundant coordinates to the minimal ones.
    subroutine prepare(self, problem, control, stat)
        class(by_hand_type), intent(inout), target :: self
        type(problem_type), intent(in) :: problem
        real(wp), intent(in) :: control
        integer, intent(out) :: stat
        type(dop853_type) :: method
        type(options_type) :: options
        real(wp) :: a(3, 3), omega(3), tangent(3), side(3)

        stat = 1
        select type (model => problem%model)
        class is (rolling_disk_type)
            stat = 0
            self%radius = model%radius
            self%axial = model%inertia(1)
            self%diametral = model%inertia(2)
            self%inertia = model%mass*model%radius**2
            self%weight = model%mass*model%gravity*model%radius
        end select
        if (stat /= 0) return
        a = rotation(problem%q(4:7))
        omega = 2*matmul(a, g_product(problem%q(4:7), problem%qd(4:7)))
        associate (axis => a(:, 1))
            tangent = [-axis(2), axis(1), 0.0_wp]/norm2(axis(1:2))
            side = [axis(2)*tangent(3) - axis(3)*tangent(2), axis(3)*tangent(1) - axis(1)*tangent(3), &
                axis(1)*tangent(2) - axis(2)*tangent(1)]
            self%y0 = [problem%q(1), problem%q(2), atan2(tangent(2), tangent(1)), atan2(side(3), axis(3)), &
                dot_product(omega, tangent), dot_product(omega, side)/side(3), dot_product(omega, axis), 0.0_wp]
        end associate
        call method%set_tableau()
        self%a = method%a
        self%b = method%b
        self%c = method%c
        self%e = method%e(:12, :)
        options%rtol = control
        self%tolerance = control
        call self%control%initialize(options, [1.0_wp], 1.0_wp, method%properties())
        self%t_start = problem%t_start
        self%t_end = problem%t_end
        self%q = problem%q(:3)
    end subroutine prepare

    !> Run to the end.
    subroutine run(self, stat)
        class(by_hand_type), intent(inout), target :: self
        integer, intent(out) :: stat
        real(wp) :: t

        self%steps = 0
        self%rejected = 0
        self%evaluations = 0
        self%y = self%y0
        self%control%h = 0.0_wp
        call self%control%restart()
        t = self%t_start
        call self%integrate(t, self%t_end, stat)
        self%q = [self%y(1), self%y(2), self%radius*sin(self%y(4))]
    end subroutine run

    !> Nothing to do without constraints.
    subroutine finish_step(self, t, stat)
        class(by_hand_type), intent(inout) :: self
        real(wp), intent(in) :: t
        integer, intent(out) :: stat

        stat = 0
    end subroutine finish_step

    !> The equations of motion.
    subroutine set_rate(self, t, y, stage, stat)
        class(by_hand_type), intent(inout) :: self
        real(wp), intent(in) :: t, y(states)
        integer, intent(in) :: stage
        integer, intent(out) :: stat
        real(wp) :: s, c

        stat = 0
        self%evaluations = self%evaluations + 1
        s = sin(y(4))
        c = cos(y(4))
        associate (f => self%f(:, stage), sp => sin(y(3)), cp => cos(y(3)), thetad => y(5), phid => y(6), w => y(7))
            ! t = (cp, sp, 0), n = (s sp, -s cp, c).
            f(1) = self%radius*(thetad*s*sp - w*cp)
            f(2) = self%radius*(-thetad*s*cp - w*sp)
            f(3) = phid
            f(4) = thetad
            f(5) = (self%diametral*phid**2*s*c - (self%axial + self%inertia)*w*phid*s - self%weight*c)/ &
                (self%diametral + self%inertia)
            f(6) = thetad*(self%axial*w - 2*self%diametral*phid*c)/(self%diametral*s)
            f(7) = self%inertia*thetad*phid*s/(self%axial + self%inertia)
            f(8) = 0.0_wp
        end associate
    end subroutine set_rate

    include 'dop853.inc'
end module tandem_bench_minimal_disk
