! SPDX-License-Identifier: MIT
!> tandem's own steppers, called as by a user, with default settings.
module tandem_bench_by_tandem
    use tandem, only: error_type, model_type, new_stepper, options_type, properties_type, simulation_type, statistics_type, wp
    use tandem_bench_solver, only: problem_type, solver_type
    use tandem_stepper, only: stepper_type
    implicit none (type, external)
    private

    public :: tandem_type, new_tandem

    type, extends(solver_type) :: tandem_type
        private
        character(len=16) :: stepper = ''
        character(len=9) :: projection = 'stages'
        type(simulation_type) :: simulation
        class(model_type), allocatable :: model
        real(wp) :: t_end = 0.0_wp
    contains
        procedure :: prepare
        procedure :: run
    end type tandem_type

contains

    !> A solver with one of tandem's steppers, by default with stages projected.
    function new_tandem(stepper, at_ends) result(solver)
        character(len=*), intent(in) :: stepper
        !> True if steps are projected at their ends only.
        logical, intent(in), optional :: at_ends
        type(tandem_type) :: solver
        class(stepper_type), allocatable :: method
        type(properties_type) :: properties

        solver%stepper = stepper
        solver%name = 'tandem '//stepper
        if (present(at_ends)) then
            if (at_ends) solver%projection = 'step_ends'
            if (at_ends) solver%name = 'tandem '//stepper//', step ends'
        end if
        call new_stepper(stepper, method)
        properties = method%properties()
        solver%is_implicit = properties%implicit .or. len_trim(properties%partner) > 0
        solver%is_fixed = properties%estimate_order == 0
    end function new_tandem

    !> Set up a simulation.
    subroutine prepare(self, problem, control, stat)
        class(tandem_type), intent(inout), target :: self
        type(problem_type), intent(in) :: problem
        real(wp), intent(in) :: control
        integer, intent(out) :: stat
        type(options_type) :: options
        type(error_type), allocatable :: error

        options%stepper = self%stepper
        options%projection = self%projection
        if (self%is_fixed) then
            options%step = control
        else
            options%rtol = control
        end if
        self%model = problem%model
        self%t_end = problem%t_end
        call self%simulation%initialize(self%model, options, problem%t_start, problem%q, problem%qd, error)
        stat = merge(1, 0, allocated(error))
    end subroutine prepare

    !> Integrate.
    subroutine run(self, stat)
        class(tandem_type), intent(inout), target :: self
        integer, intent(out) :: stat
        type(error_type), allocatable :: error
        type(statistics_type) :: statistics

        call self%simulation%integrate(self%t_end, error)
        stat = merge(1, 0, allocated(error))
        statistics = self%simulation%statistics()
        self%steps = statistics%steps
        self%rejected = statistics%rejected + statistics%failed
        self%evaluations = statistics%right_hand_sides
        self%q = self%simulation%state%q
    end subroutine run
end module tandem_bench_by_tandem
