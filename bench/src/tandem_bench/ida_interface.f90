! SPDX-License-Identifier: MIT
!> Interfaces to the C functions of SUNDIALS (6.x) that solve a differential-algebraic system by IDA with dense matrices.
!> A negative status is a failure. Source: Hindmarsh et al., User Documentation for IDA.
module tandem_bench_ida_interface
    use, intrinsic :: iso_c_binding, only: c_double, c_funptr, c_int, c_int64_t, c_long, c_ptr
    implicit none (type, external)
    public

    interface
        !> Context of all objects of SUNDIALS; `comm` is a null pointer without MPI.
        function suncontext_create(comm, context) result(stat) bind(c, name='SUNContext_Create')
            import :: c_int, c_ptr
            implicit none (type, external)
            type(c_ptr), value :: comm
            type(c_ptr), intent(out) :: context
            integer(c_int) :: stat
        end function suncontext_create

        !> Free it.
        function suncontext_free(context) result(stat) bind(c, name='SUNContext_Free')
            import :: c_int, c_ptr
            implicit none (type, external)
            type(c_ptr), intent(inout) :: context
            integer(c_int) :: stat
        end function suncontext_free

        !> A vector that uses existing values.
        function make_vector(length, values, context) result(vector) bind(c, name='N_VMake_Serial')
            import :: c_double, c_int64_t, c_ptr
            implicit none (type, external)
            integer(c_int64_t), value :: length
            real(c_double), intent(in) :: values(*)
            type(c_ptr), value :: context
            type(c_ptr) :: vector
        end function make_vector

        !> The values of a vector.
        function vector_values(vector) result(values) bind(c, name='N_VGetArrayPointer')
            import :: c_ptr
            implicit none (type, external)
            type(c_ptr), value :: vector
            type(c_ptr) :: values
        end function vector_values

        !> Free a vector without its values.
        subroutine destroy_vector(vector) bind(c, name='N_VDestroy')
            import :: c_ptr
            implicit none (type, external)
            type(c_ptr), value :: vector
        end subroutine destroy_vector

        !> A matrix, by columns.
        function dense_matrix(rows, columns, context) result(matrix) bind(c, name='SUNDenseMatrix')
            import :: c_int64_t, c_ptr
            implicit none (type, external)
            integer(c_int64_t), value :: rows, columns
            type(c_ptr), value :: context
            type(c_ptr) :: matrix
        end function dense_matrix

        !> The entries of a matrix, by columns.
        function matrix_values(matrix) result(values) bind(c, name='SUNDenseMatrix_Data')
            import :: c_ptr
            implicit none (type, external)
            type(c_ptr), value :: matrix
            type(c_ptr) :: values
        end function matrix_values

        !> Free a matrix.
        subroutine destroy_matrix(matrix) bind(c, name='SUNMatDestroy')
            import :: c_ptr
            implicit none (type, external)
            type(c_ptr), value :: matrix
        end subroutine destroy_matrix

        !> A solver by LU factors for a matrix and vectors of its size.
        function dense_solver(vector, matrix, context) result(solver) bind(c, name='SUNLinSol_Dense')
            import :: c_ptr
            implicit none (type, external)
            type(c_ptr), value :: vector, matrix, context
            type(c_ptr) :: solver
        end function dense_solver

        !> Free a solver.
        function free_solver(solver) result(stat) bind(c, name='SUNLinSolFree')
            import :: c_int, c_ptr
            implicit none (type, external)
            type(c_ptr), value :: solver
            integer(c_int) :: stat
        end function free_solver

        !> The memory of a run.
        function ida_create(context) result(memory) bind(c, name='IDACreate')
            import :: c_ptr
            implicit none (type, external)
            type(c_ptr), value :: context
            type(c_ptr) :: memory
        end function ida_create

        !> Free it.
        subroutine ida_free(memory) bind(c, name='IDAFree')
            import :: c_ptr
            implicit none (type, external)
            type(c_ptr), intent(inout) :: memory
        end subroutine ida_free

        !> Set up a run of F(t, y, yd) = 0 from a consistent start.
        function ida_init(memory, residual, t, y, yd) result(stat) bind(c, name='IDAInit')
            import :: c_double, c_funptr, c_int, c_ptr
            implicit none (type, external)
            type(c_ptr), value :: memory, y, yd
            type(c_funptr), value :: residual
            real(c_double), value :: t
            integer(c_int) :: stat
        end function ida_init

        !> Restart a run with the same settings.
        function ida_reinit(memory, t, y, yd) result(stat) bind(c, name='IDAReInit')
            import :: c_double, c_int, c_ptr
            implicit none (type, external)
            type(c_ptr), value :: memory, y, yd
            real(c_double), value :: t
            integer(c_int) :: stat
        end function ida_reinit

        !> A relative tolerance, and an absolute one for each component.
        function ida_tolerances(memory, rtol, atol) result(stat) bind(c, name='IDASVtolerances')
            import :: c_double, c_int, c_ptr
            implicit none (type, external)
            type(c_ptr), value :: memory, atol
            real(c_double), value :: rtol
            integer(c_int) :: stat
        end function ida_tolerances

        !> Argument of the callbacks.
        function ida_set_user_data(memory, data) result(stat) bind(c, name='IDASetUserData')
            import :: c_int, c_ptr
            implicit none (type, external)
            type(c_ptr), value :: memory, data
            integer(c_int) :: stat
        end function ida_set_user_data

        !> Set the solver of linear systems.
        function ida_set_linear_solver(memory, solver, matrix) result(stat) bind(c, name='IDASetLinearSolver')
            import :: c_int, c_ptr
            implicit none (type, external)
            type(c_ptr), value :: memory, solver, matrix
            integer(c_int) :: stat
        end function ida_set_linear_solver

        !> The procedure for dF/dy + c dF/dyd.
        function ida_set_jacobian(memory, jacobian) result(stat) bind(c, name='IDASetJacFn')
            import :: c_funptr, c_int, c_ptr
            implicit none (type, external)
            type(c_ptr), value :: memory
            type(c_funptr), value :: jacobian
            integer(c_int) :: stat
        end function ida_set_jacobian

        !> Kind of the components: 1 for differential, 0 for algebraic.
        function ida_set_id(memory, id) result(stat) bind(c, name='IDASetId')
            import :: c_int, c_ptr
            implicit none (type, external)
            type(c_ptr), value :: memory, id
            integer(c_int) :: stat
        end function ida_set_id

        !> 1 to exclude algebraic components from the error test, 0 to include them.
        function ida_suppress_algebraic(memory, suppress) result(stat) bind(c, name='IDASetSuppressAlg')
            import :: c_int, c_ptr
            implicit none (type, external)
            type(c_ptr), value :: memory
            integer(c_int), value :: suppress
            integer(c_int) :: stat
        end function ida_suppress_algebraic

        !> Largest number of steps of one call of `ida_solve`.
        function ida_set_max_steps(memory, most) result(stat) bind(c, name='IDASetMaxNumSteps')
            import :: c_int, c_long, c_ptr
            implicit none (type, external)
            type(c_ptr), value :: memory
            integer(c_long), value :: most
            integer(c_int) :: stat
        end function ida_set_max_steps

        !> Time that no step may pass.
        function ida_set_stop(memory, t) result(stat) bind(c, name='IDASetStopTime')
            import :: c_double, c_int, c_ptr
            implicit none (type, external)
            type(c_ptr), value :: memory
            real(c_double), value :: t
            integer(c_int) :: stat
        end function ida_set_stop

        !> Destination of messages; a null pointer for none.
        function ida_set_messages(memory, file) result(stat) bind(c, name='IDASetErrFile')
            import :: c_int, c_ptr
            implicit none (type, external)
            type(c_ptr), value :: memory, file
            integer(c_int) :: stat
        end function ida_set_messages

        !> Integrate to `t_wanted`, or by one step, depending on the task; `t` is the time reached.
        function ida_solve(memory, t_wanted, t, y, yd, task) result(stat) bind(c, name='IDASolve')
            import :: c_double, c_int, c_ptr
            implicit none (type, external)
            type(c_ptr), value :: memory, y, yd
            real(c_double), value :: t_wanted
            real(c_double), intent(out) :: t
            integer(c_int), value :: task
            integer(c_int) :: stat
        end function ida_solve

        !> Steps so far.
        function ida_steps(memory, number) result(stat) bind(c, name='IDAGetNumSteps')
            import :: c_int, c_long, c_ptr
            implicit none (type, external)
            type(c_ptr), value :: memory
            integer(c_long), intent(out) :: number
            integer(c_int) :: stat
        end function ida_steps

        !> Number of steps that the error test has rejected.
        function ida_failed_tests(memory, number) result(stat) bind(c, name='IDAGetNumErrTestFails')
            import :: c_int, c_long, c_ptr
            implicit none (type, external)
            type(c_ptr), value :: memory
            integer(c_long), intent(out) :: number
            integer(c_int) :: stat
        end function ida_failed_tests
    end interface
end module tandem_bench_ida_interface
