! SPDX-License-Identifier: MIT
!> SUNDIALS IDA, dense, on the stabilised index-2 equations (`tandem_bench_stabilised`).
module tandem_bench_by_ida
    use tandem, only: wp
    use tandem_bench_ida_interface, only: dense_matrix, dense_solver, destroy_matrix, destroy_vector, free_solver, &
        ida_create, ida_failed_tests, ida_free, ida_init, ida_reinit, ida_set_id, ida_set_jacobian, ida_set_linear_solver, &
        ida_set_max_steps, ida_set_messages, ida_set_stop, ida_set_user_data, ida_solve, ida_steps, ida_suppress_algebraic, &
        ida_tolerances, make_vector, matrix_values, suncontext_create, suncontext_free, vector_values
    use tandem_bench_solver, only: next_stop, problem_type, solver_type
    use tandem_bench_stabilised, only: of_multipliers, system_type
    use, intrinsic :: iso_c_binding, only: c_double, c_f_pointer, c_funloc, c_int, c_int64_t, c_loc, c_long, c_null_ptr, c_ptr
    implicit none (type, external)
    private

    public :: ida_type

    !> Task of IDASolve, and its status at a stop.
    integer(c_int), parameter :: normal = 1, stopped = 1

    type, extends(solver_type) :: ida_type
        private
        type(system_type) :: system
        real(wp) :: t_start = 0.0_wp, t_end = 0.0_wp
        real(wp), allocatable :: y(:), yd(:), id(:), atol(:)
        ! Without a default: gfortran 12 fails on one.
        type(c_ptr) :: context, memory, matrix, solver, y_vector, yd_vector, id_vector, atol_vector
        logical :: is_made = .false.
    contains
        procedure :: prepare
        procedure :: run
        procedure, private :: release
    end type ida_type

contains

    !> Allocate the memory of IDA.
    subroutine prepare(self, problem, control, stat)
        class(ida_type), intent(inout), target :: self
        type(problem_type), intent(in) :: problem
        real(wp), intent(in) :: control
        integer, intent(out) :: stat
        type(system_type), pointer :: system
        integer(c_int64_t) :: length
        integer(c_int) :: answers(9)

        call self%release()
        system => self%system
        call system%define(problem%model)
        self%t_start = problem%t_start
        self%t_end = problem%t_end
        self%q = problem%q
        self%y = spread(0.0_wp, 1, system%size)
        self%yd = self%y
        self%y(:system%n) = problem%q
        self%y(system%n + 1:2*system%n) = problem%qd
        self%id = self%y
        self%id(:2*system%n) = 1.0_wp
        self%id(2*system%n + 1:) = 0.0_wp
        self%atol = merge(control, of_multipliers, self%id > 0.5_wp)
        call system%make_consistent(self%t_start, self%y, self%yd, stat)
        if (stat /= 0) return
        answers(1) = suncontext_create(c_null_ptr, self%context)
        length = int(system%size, c_int64_t)
        self%y_vector = make_vector(length, self%y, self%context)
        self%yd_vector = make_vector(length, self%yd, self%context)
        self%id_vector = make_vector(length, self%id, self%context)
        self%atol_vector = make_vector(length, self%atol, self%context)
        self%matrix = dense_matrix(length, length, self%context)
        self%solver = dense_solver(self%y_vector, self%matrix, self%context)
        self%memory = ida_create(self%context)
        answers(2) = ida_init(self%memory, c_funloc(residual), self%t_start, self%y_vector, self%yd_vector)
        answers(3) = ida_tolerances(self%memory, control, self%atol_vector)
        answers(4) = ida_set_user_data(self%memory, c_loc(system))
        answers(5) = ida_set_linear_solver(self%memory, self%solver, self%matrix)
        answers(6) = ida_set_jacobian(self%memory, c_funloc(jacobian))
        answers(7) = ida_set_id(self%memory, self%id_vector)
        answers(8) = ida_suppress_algebraic(self%memory, 1_c_int)
        answers(9) = ida_set_max_steps(self%memory, 100000000_c_long)
        if (all(answers == 0)) answers(9) = ida_set_messages(self%memory, c_null_ptr)
        self%is_made = .true.
        stat = merge(0, 1, all(answers == 0))
    end subroutine prepare

    !> Integrate one smooth piece after the other.
    subroutine run(self, stat)
        class(ida_type), intent(inout), target :: self
        integer, intent(out) :: stat
        real(wp) :: t, stop_at
        integer(c_long) :: steps, rejected
        integer(c_int) :: answer

        stat = 0
        self%steps = 0
        self%rejected = 0
        t = self%t_start
        do
            stop_at = next_stop(self%system%model, self%t_end)
            answer = ida_set_stop(self%memory, stop_at)
            answer = ida_solve(self%memory, stop_at, t, self%y_vector, self%yd_vector, normal)
            if (answer /= 0 .and. answer /= stopped) stat = 1
            ! Restarts reset the counters.
            answer = ida_steps(self%memory, steps)
            answer = ida_failed_tests(self%memory, rejected)
            self%steps = self%steps + steps
            self%rejected = self%rejected + rejected
            if (stat /= 0 .or. t >= self%t_end) exit
            self%system%model%segment = self%system%model%segment + 1
            call self%system%make_consistent(t, self%y, self%yd, stat)
            if (stat /= 0) exit
            if (ida_reinit(self%memory, t, self%y_vector, self%yd_vector) /= 0) stat = 1
            if (stat /= 0) exit
        end do
        self%evaluations = self%system%evaluations
        self%q = self%y(:self%system%n)
    end subroutine run

    !> Free the objects of SUNDIALS for the last problem.
    subroutine release(self)
        class(ida_type), intent(inout) :: self
        integer(c_int) :: answer

        if (.not. self%is_made) return
        call ida_free(self%memory)
        answer = free_solver(self%solver)
        call destroy_matrix(self%matrix)
        call destroy_vector(self%y_vector)
        call destroy_vector(self%yd_vector)
        call destroy_vector(self%id_vector)
        call destroy_vector(self%atol_vector)
        answer = suncontext_free(self%context)
        self%is_made = .false.
    end subroutine release

    !> Residual; > 0 if it cannot be evaluated.
    function residual(t, y_vector, yd_vector, r_vector, data) result(stat) bind(c)
        real(c_double), value :: t
        type(c_ptr), value :: y_vector, yd_vector, r_vector, data
        integer(c_int) :: stat
        type(system_type), pointer :: system
        real(wp), pointer, contiguous :: y(:), yd(:), r(:)
        integer :: evaluation

        call c_f_pointer(data, system)
        call c_f_pointer(vector_values(y_vector), y, [system%size])
        call c_f_pointer(vector_values(yd_vector), yd, [system%size])
        call c_f_pointer(vector_values(r_vector), r, [system%size])
        call system%find_residual(t, y, yd, r, evaluation)
        stat = merge(1_c_int, 0_c_int, evaluation /= 0)
    end function residual

    !> The matrix dF/dy + cj dF/dyd.
    function jacobian(t, cj, y_vector, yd_vector, r_vector, matrix, data, work1, work2, work3) result(stat) bind(c)
        real(c_double), value :: t, cj
        type(c_ptr), value :: y_vector, yd_vector, r_vector, matrix, data, work1, work2, work3
        integer(c_int) :: stat
        type(system_type), pointer :: system
        real(wp), pointer, contiguous :: y(:), yd(:), a(:, :)
        integer :: evaluation

        call c_f_pointer(data, system)
        call c_f_pointer(vector_values(y_vector), y, [system%size])
        call c_f_pointer(vector_values(yd_vector), yd, [system%size])
        call c_f_pointer(matrix_values(matrix), a, [system%size, system%size])
        call system%find_gradient(t, y, yd, a, evaluation)
        call system%add_rates(cj, a)
        stat = merge(1_c_int, 0_c_int, evaluation /= 0)
    end function jacobian
end module tandem_bench_by_ida
