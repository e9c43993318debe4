! SPDX-License-Identifier: MIT
!> Common interface of all solvers: a problem is prepared, which is not timed, then run, which is.
module tandem_bench_solver
    use tandem, only: long, model_type, wp
    implicit none (type, external)
    private

    public :: problem_type, solver_type, solver_holder_type, next_stop

    !> An initial value problem and its solution.
    type :: problem_type
        !> Name of the scene.
        character(len=24) :: name = ''
        !> The model, in its first segment.
        class(model_type), allocatable :: model
        !> Start and end of the run.
        real(wp) :: t_start = 0.0_wp, t_end = 0.0_wp
        !> The consistent start, and the coordinates of the reference at the end (n).
        real(wp), allocatable :: q(:), qd(:), q_end(:)
        !> Distance of a second, different solution from the reference.
        real(wp) :: agreement = 0.0_wp
        !> Number of leading coordinates that are compared: for the disk those of its centre, which all solvers have.
        integer :: compared = 0
        !> True for a stiff problem: for implicit solvers only.
        logical :: is_stiff = .false.
    end type problem_type

    !> A solver of problems.
    type, abstract :: solver_type
        !> Name in tables.
        character(len=24) :: name = ''
        !> True if its steps have a fixed size, given in place of the tolerance.
        logical :: is_fixed = .false.
        !> True for a solver of stiff problems.
        logical :: is_implicit = .false.
        !> Coordinates at the end of the last run (n, or as many as are compared).
        real(wp), allocatable :: q(:)
        !> Accepted and rejected steps of the last run, and evaluations of the equations of motion.
        integer(long) :: steps = 0, rejected = 0, evaluations = 0
    contains
        procedure :: can_solve
        procedure(prepare_interface), deferred :: prepare
        procedure(run_interface), deferred :: run
    end type solver_type

    !> A solver in a list of different ones.
    type :: solver_holder_type
        class(solver_type), allocatable :: solver
    end type solver_holder_type

    abstract interface
        !> Prepare a run from the start: allocations, checks of the model.
        subroutine prepare_interface(self, problem, control, stat)
            import :: solver_type, problem_type, wp
            implicit none (type, external)
            class(solver_type), intent(inout), target :: self
            type(problem_type), intent(in) :: problem
            !> Relative and absolute tolerance, or step size.
            real(wp), intent(in) :: control
            !> 0 on success.
            integer, intent(out) :: stat
        end subroutine prepare_interface

        !> Run to the end.
        subroutine run_interface(self, stat)
            import :: solver_type
            implicit none (type, external)
            class(solver_type), intent(inout), target :: self
            !> 0 if the end was reached.
            integer, intent(out) :: stat
        end subroutine run_interface
    end interface

contains

    !> True if a solver applies to a problem.
    logical function can_solve(self, problem)
        class(solver_type), intent(in) :: self
        type(problem_type), intent(in) :: problem

        can_solve = self%is_implicit .or. .not. problem%is_stiff
    end function can_solve

    !> End of the current smooth piece: the next breakpoint of the model, or the end of the run.
    pure real(wp) function next_stop(model, t_end)
        class(model_type), intent(in) :: model
        real(wp), intent(in) :: t_end

        next_stop = t_end
        if (.not. allocated(model%breakpoints)) return
        if (model%segment > size(model%breakpoints)) return
        next_stop = min(t_end, model%breakpoints(model%segment))
    end function next_stop
end module tandem_bench_solver
