! SPDX-License-Identifier: MIT
!> SUNDIALS IDA, dense, on the stabilised index-2 equations of Gear, Gupta and Leimkuhler (1985) with the unknowns
!> (q, u, lambda, mu):
!>     qd - u + Phi_q' mu = 0,  M ud + C' lambda - S - Q_A = 0,  Phi = 0,  C u - nu = 0.
!> The matrix of the iteration is the model's own, like the residual; mu is zero in the solution, so its derivative is left out.
module tandem_bench_by_ida
    use tandem, only: derivatives_type, long, model_type, need_dynamics_q, need_dynamics_qd, need_force, need_gamma, &
        need_jacobian, need_mass, need_nu, need_phi, need_velocity_q, terms_type, wp
    use tandem_bench_elimination, only: dgesv
    use tandem_bench_ida_interface, only: dense_matrix, dense_solver, destroy_matrix, destroy_vector, free_solver, &
        ida_create, ida_failed_tests, ida_free, ida_init, ida_reinit, ida_set_id, ida_set_jacobian, ida_set_linear_solver, &
        ida_set_max_steps, ida_set_messages, ida_set_stop, ida_set_user_data, ida_solve, ida_steps, ida_suppress_algebraic, &
        ida_tolerances, make_vector, matrix_values, suncontext_create, suncontext_free, vector_values
    use tandem_bench_solver, only: next_stop, problem_type, solver_type
    use, intrinsic :: iso_c_binding, only: c_double, c_f_pointer, c_funloc, c_int, c_int64_t, c_loc, c_long, c_null_ptr, c_ptr
    implicit none (type, external)
    private

    public :: ida_type

    !> What IDASolve is asked for, and its answer at a stop.
    integer(c_int), parameter :: normal = 1, stopped = 1
    !> Multipliers take no part in the error test, and with this absolute tolerance hardly any in Newton's.
    real(wp), parameter :: of_multipliers = 1.0e6_wp

    !> What the residual and its matrix need.
    type :: system_type
        class(model_type), allocatable :: model
        type(terms_type) :: terms
        type(derivatives_type) :: derivatives
        integer :: n = 0, nh = 0, m = 0, size = 0
        integer(long) :: evaluations = 0
    end type system_type

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
        procedure, private :: make_consistent
        procedure, private :: release
    end type ida_type

contains

    !> Make IDA's memory.
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
        system%model = problem%model
        system%n = problem%model%n
        system%nh = problem%model%n_holonomic
        system%m = problem%model%n_constraints()
        system%size = 2*system%n + system%m + system%nh
        system%evaluations = 0
        call system%terms%allocate(system%n, system%nh, system%m - system%nh)
        call system%derivatives%allocate(system%n, system%m)
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
        call self%make_consistent(self%t_start, stat)
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

    !> One smooth piece after the other.
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
            ! Starting anew sets the counters back.
            answer = ida_steps(self%memory, steps)
            answer = ida_failed_tests(self%memory, rejected)
            self%steps = self%steps + steps
            self%rejected = self%rejected + rejected
            if (stat /= 0 .or. t >= self%t_end) exit
            self%system%model%segment = self%system%model%segment + 1
            call self%make_consistent(t, stat)
            if (stat /= 0) exit
            if (ida_reinit(self%memory, t, self%y_vector, self%yd_vector) /= 0) stat = 1
            if (stat /= 0) exit
        end do
        self%evaluations = self%system%evaluations
        self%q = self%y(:self%system%n)
    end subroutine run

    !> At a start or a breakpoint: the nearest velocity in the mass metric, then the accelerations and multipliers.
    subroutine make_consistent(self, t, stat)
        class(ida_type), intent(inout), target :: self
        real(wp), intent(in) :: t
        integer, intent(out) :: stat
        real(wp), allocatable :: a(:, :), b(:, :)
        integer, allocatable :: pivots(:)
        integer :: level, k, need

        associate (n => self%system%n, m => self%system%m, terms => self%system%terms, model => self%system%model)
            k = n + m
            allocate (a(k, k), b(k, 1), pivots(k))
            need = iand(need_jacobian + need_nu + need_gamma + need_mass + need_force, model%provides)
            do level = 1, 2
                call model%evaluate(need, t, self%y(:n), self%y(n + 1:2*n), terms, stat)
                if (stat /= 0) return
                a = 0.0_wp
                a(:n, :n) = terms%mass
                a(n + 1:, :n) = terms%jacobian
                a(:n, n + 1:) = transpose(terms%jacobian)
                if (level == 1) then
                    b(:n, 1) = 0.0_wp
                    b(n + 1:, 1) = terms%nu - matmul(terms%jacobian, self%y(n + 1:2*n))
                else
                    b(:n, 1) = terms%force
                    b(n + 1:, 1) = -terms%gamma
                end if
                call dgesv(k, 1, a, k, pivots, b, k, stat)
                if (stat /= 0) return
                if (level == 1) self%y(n + 1:2*n) = self%y(n + 1:2*n) + b(:n, 1)
            end do
            self%yd = 0.0_wp
            self%yd(:n) = self%y(n + 1:2*n)
            self%yd(n + 1:2*n) = b(:n, 1)
            self%y(2*n + 1:2*n + m) = b(n + 1:, 1)
            self%y(2*n + m + 1:) = 0.0_wp
        end associate
    end subroutine make_consistent

    !> Give back what SUNDIALS has allocated for the last problem.
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

    !> The residual; > 0 where it cannot be evaluated.
    function residual(t, y_vector, yd_vector, r_vector, data) result(stat) bind(c)
        real(c_double), value :: t
        type(c_ptr), value :: y_vector, yd_vector, r_vector, data
        integer(c_int) :: stat
        type(system_type), pointer :: system
        real(wp), pointer, contiguous :: y(:), yd(:), r(:)
        integer :: evaluation, i, j

        call c_f_pointer(data, system)
        associate (n => system%n, m => system%m, nh => system%nh, terms => system%terms)
            call c_f_pointer(vector_values(y_vector), y, [system%size])
            call c_f_pointer(vector_values(yd_vector), yd, [system%size])
            call c_f_pointer(vector_values(r_vector), r, [system%size])
            system%evaluations = system%evaluations + 1
            call system%model%evaluate(iand(need_phi + need_jacobian + need_nu + need_mass + need_force, &
                system%model%provides), t, y(:n), y(n + 1:2*n), terms, evaluation)
            do i = 1, n
                r(i) = yd(i) - y(n + i)
                do j = 1, nh
                    r(i) = r(i) + terms%jacobian(j, i)*y(2*n + m + j)
                end do
                r(n + i) = -terms%force(i)
                do j = 1, n
                    r(n + i) = r(n + i) + terms%mass(j, i)*yd(n + j)
                end do
                do j = 1, m
                    r(n + i) = r(n + i) + terms%jacobian(j, i)*y(2*n + j)
                end do
            end do
            r(2*n + 1:2*n + nh) = terms%phi
            r(2*n + nh + 1:) = -terms%nu
            do j = 1, n
                do i = 1, m
                    r(2*n + nh + i) = r(2*n + nh + i) + terms%jacobian(i, j)*y(n + j)
                end do
            end do
        end associate
        stat = merge(1_c_int, 0_c_int, evaluation /= 0)
    end function residual

    !> The matrix dF/dy + cj dF/dyd.
    function jacobian(t, cj, y_vector, yd_vector, r_vector, matrix, data, work1, work2, work3) result(stat) bind(c)
        real(c_double), value :: t, cj
        type(c_ptr), value :: y_vector, yd_vector, r_vector, matrix, data, work1, work2, work3
        integer(c_int) :: stat
        type(system_type), pointer :: system
        real(wp), pointer, contiguous :: y(:), yd(:), a(:, :)
        integer :: evaluation, i

        call c_f_pointer(data, system)
        associate (n => system%n, m => system%m, nh => system%nh, terms => system%terms, d => system%derivatives)
            call c_f_pointer(vector_values(y_vector), y, [system%size])
            call c_f_pointer(vector_values(yd_vector), yd, [system%size])
            call c_f_pointer(matrix_values(matrix), a, [system%size, system%size])
            call system%model%evaluate(iand(need_jacobian + need_mass, system%model%provides), t, y(:n), y(n + 1:2*n), terms, &
                evaluation)
            if (evaluation == 0) call system%model%evaluate_derivatives(need_velocity_q + need_dynamics_q + need_dynamics_qd, t, &
                y(:n), y(n + 1:2*n), yd(n + 1:2*n), y(2*n + 1:2*n + m), d, evaluation)
            a = 0.0_wp
            do i = 1, n
                a(i, i) = cj
                a(i, n + i) = -1.0_wp
            end do
            a(:n, 2*n + m + 1:) = transpose(terms%jacobian(:nh, :))
            a(n + 1:2*n, :n) = d%dynamics_q
            a(n + 1:2*n, n + 1:2*n) = cj*terms%mass + d%dynamics_qd
            a(n + 1:2*n, 2*n + 1:2*n + m) = transpose(terms%jacobian)
            a(2*n + 1:2*n + nh, :n) = terms%jacobian(:nh, :)
            a(2*n + nh + 1:, :n) = d%velocity_q
            a(2*n + nh + 1:, n + 1:2*n) = terms%jacobian
        end associate
        stat = merge(1_c_int, 0_c_int, evaluation /= 0)
    end function jacobian
end module tandem_bench_by_ida
