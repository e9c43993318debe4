! SPDX-License-Identifier: MIT
!> The dense tangent-space chart at (t0, q0, qd0), for mechanisms of up to some dozens of coordinates.
!>
!> Increments are ambient: xi = dq and eta = dqd, sums of the stages' qd and qdd, unprojected. A position is
!> q = q0 + xi - U u with Phi(t, q) = 0 (11), (14), a velocity is qd = qd0 + eta - X x with C qd = nu (25), (6). As v = V' xi
!> and w = W' eta, this is the trajectory of the chart with bases V and W, although neither is formed here.
!>
!> With `factor`, C is eliminated at each point, which gives R (C R = I) and D (C D = 0); the condition that qd - qd0 - eta lies
!> in range(C0') reads N0' (qd - qd0 - eta) = 0 with a null-space basis N0 of C0. With `refine`, B and H follow by the paper's
!> iterations, R = X H and D = (I - X H C) W.
!>
!> Coordinate scales s: bases are those of C diag(s), U and X act as diag(s) U, N0 as diag(s)^-1 N0.
module tandem_tangent_dense
    use tandem_error, only: error_type
    use tandem_kinds, only: wp
    use tandem_linalg_basis, only: basis_type
    use tandem_linalg_elimination, only: elimination_type
    use tandem_linalg_kernels, only: add_product, add_transposed_product, set_gram, set_product
    use tandem_linalg_lu, only: lu_type
    use tandem_model, only: model_type
    use tandem_model_evaluator, only: evaluator_type
    use tandem_model_terms, only: need_force, need_gamma, need_jacobian, need_mass, need_nu, need_phi
    use tandem_options, only: options_type
    use tandem_status, only: status_chart_left, status_not_finite, status_ok, status_position_diverged, &
        status_rank_deficient
    use tandem_tangent_chart, only: chart_type, health_type
    use tandem_tangent_dynamics, only: dynamics_type
    use tandem_tangent_natural_scale, only: acceleration_errors, position_errors, velocity_errors
    use tandem_tangent_refinement, only: refinement_type
    implicit none
    private

    public :: dense_chart_type

    type, extends(chart_type) :: dense_chart_type
        private
        type(evaluator_type) :: model
        type(dynamics_type) :: dynamics
        !> n coordinates, nh holonomic and m constraints, k = n - m.
        integer :: n = 0, nh = 0, m = 0, k = 0
        logical :: refines = .false., watches_v = .false., watches_w = .false., watches_secants = .false.
        real(wp) :: utol = 0.0_wp, btol = 0.0_wp, htol = 0.0_wp
        !> Coordinate scales (n).
        real(wp), allocatable :: scale(:)
        !> The origin.
        real(wp), allocatable :: q0(:), qd0(:)
        !> Orthonormal bases at the origin, and at another point for |D| and |Fbar|.
        type(basis_type) :: basis, other_basis
        !> diag(s) U (n, nh), diag(s) X (n, m), diag(s) W (n, k); X and W only where needed.
        real(wp), allocatable :: u_basis(:, :), x_basis(:, :), w_basis(:, :)
        !> diag(s)^-2 times a null-space basis of C0 (n, k).
        real(wp), allocatable :: null_origin(:, :)
        !> u (nh), carried from stage to stage as a start value; Phi_q U (nh, nh) and its factors; scales of Phi's rows (nh).
        real(wp), allocatable :: u(:), correction(:), phi_u(:, :), phi_scale(:), scaled_phi(:)
        type(lu_type) :: phi_u_lu
        !> B and H of the paper.
        type(refinement_type) :: b, h
        !> C X (m, m).
        real(wp), allocatable :: c_x(:, :)
        type(lu_type) :: c_x_lu
        !> C at the current point: its elimination, D (n, k) and R (n, m).
        type(elimination_type) :: elimination
        real(wp), allocatable :: null_space(:, :), right_inverse(:, :)
        !> N0' D (k, k) and its factors; right sides (k), (m), (n).
        real(wp), allocatable :: overlap(:, :), z(:), x(:), trial(:)
        type(lu_type) :: overlap_lu
        !> The point where C, nu and M were evaluated last; whether R and D are those of it, and whether Phi is.
        logical :: has_point = .false., is_split = .false., phi_is_current = .false.
        real(wp) :: t_point = 0.0_wp
        real(wp), allocatable :: q_point(:)
        !> Work space for |D| and |Fbar|.
        real(wp), allocatable :: angles(:, :), no_velocity(:)
    contains
        procedure :: initialize
        procedure :: renew
        procedure :: refresh
        procedure :: forget
        procedure :: restore_position
        procedure :: restore_velocity
        procedure :: solve_dynamics
        procedure :: multipliers
        procedure :: project_velocity
        procedure :: constraint_errors
        procedure :: measure_health
        procedure :: kinetic_energy
        procedure, private :: move_to
        procedure, private :: split_constraints
        procedure, private :: start_refinement
        procedure, private :: factor_position
        procedure, private :: set_phi_u
        procedure, private :: blame
    end type dense_chart_type

contains

    !> Attach the model and allocate the work space.
    subroutine initialize(self, model, options, error)
        class(dense_chart_type), intent(inout) :: self
        class(model_type), intent(inout), target :: model
        type(options_type), intent(in) :: options
        type(error_type), allocatable, intent(out) :: error

        call self%model%initialize(model)
        associate (n => model%n, nh => model%n_holonomic, m => model%n_constraints())
            self%n = n
            self%nh = nh
            self%m = m
            self%k = n - m
            self%scale = spread(1.0_wp, 1, n)
            self%q0 = spread(0.0_wp, 1, n)
            self%u = spread(0.0_wp, 1, nh)
            self%x = spread(0.0_wp, 1, m)
            self%z = spread(0.0_wp, 1, n - m)
            call self%phi_u_lu%allocate(nh)
            call self%overlap_lu%allocate(n - m)
            call self%elimination%allocate(m, n)
            call self%basis%allocate(n, nh, m)
            call self%dynamics%allocate(n, n - m)
            allocate (self%u_basis(n, nh), self%null_origin(n, n - m), self%phi_u(nh, nh), source=0.0_wp)
            allocate (self%null_space(n, n - m), self%right_inverse(n, m), self%overlap(n - m, n - m), source=0.0_wp)
        end associate
        if (allocated(model%coordinate_scale)) self%scale = model%coordinate_scale
        self%qd0 = self%q0
        self%trial = self%q0
        self%q_point = self%q0
        self%no_velocity = self%q0
        self%correction = self%u
        self%phi_scale = self%u
        self%scaled_phi = self%u
        ! Rows are judged by their scales at the start of the step here, by those at its end afterwards.
        self%utol = 0.25_wp*options%position_tolerance()
        self%btol = options%b_tolerance()
        self%htol = options%h_tolerance()
        self%refines = options%refresh == 'refine'
        self%watches_v = options%chart == 'paper' .and. options%v_limit > 0.0_wp
        self%watches_w = options%chart == 'paper' .and. options%w_limit > 0.0_wp
        self%watches_secants = options%chart == 'adaptive'
        if (self%watches_secants) then
            call self%other_basis%allocate(self%n, self%nh, self%m)
            allocate (self%angles(self%m, self%m), source=0.0_wp)
        end if
        if (self%refines) then
            allocate (self%x_basis(self%n, self%m), self%w_basis(self%n, self%k), self%c_x(self%m, self%m), source=0.0_wp)
            call self%c_x_lu%allocate(self%m)
            call self%b%allocate(self%nh)
            call self%h%allocate(self%m)
        end if
    end subroutine initialize

    !> Make (t, q, qd) the origin: bases and the rank decision, then what the chosen refresh mode starts from.
    subroutine renew(self, t, q, qd, stat)
        class(dense_chart_type), intent(inout) :: self
        real(wp), intent(in) :: t
        real(wp), intent(in), contiguous :: q(:), qd(:)
        integer, intent(out) :: stat
        integer :: columns, j

        self%failed_row = 0
        self%q0 = q
        self%qd0 = qd
        self%u = 0.0_wp
        call self%move_to(t, q, stat)
        if (stat /= status_ok) return
        ! U is all that explicit steps need; |w| and |D| need X, `refine` needs W.
        columns = self%nh
        if (self%watches_w .or. self%watches_secants) columns = self%m
        if (self%refines) columns = self%n
        if (self%m > 0) then
            call self%basis%factor_qr(self%model%terms%jacobian, self%scale, columns)
            self%counts%basis_factorizations = self%counts%basis_factorizations + 1
        else
            call self%basis%factor_qr(self%model%terms%jacobian, self%scale, 0)
        end if
        if (self%basis%deficient) then
            self%failed_row = self%basis%dependent_row
            stat = status_rank_deficient
            return
        end if
        do j = 1, self%nh
            self%u_basis(:, j) = self%scale*self%basis%q(:, j)
        end do
        if (self%refines) then
            do j = 1, self%m
                self%x_basis(:, j) = self%scale*self%basis%q(:, j)
            end do
            do j = 1, self%k
                self%w_basis(:, j) = self%scale*self%basis%q(:, self%m + j)
            end do
        end if
        call self%refresh(stat)
        if (stat /= status_ok) return
        if (self%refines) then
            call self%start_refinement(stat)
            if (stat /= status_ok) return
        end if
        call self%split_constraints(stat)
        if (stat /= status_ok) return
        if (.not. self%refines) then
            do j = 1, self%k
                self%null_origin(:, j) = self%null_space(:, j)/self%scale**2
            end do
        end if
    end subroutine renew

    !> Bring the factor of Phi_q U to the current point: frozen at the origin it would be too weak on a large chart.
    subroutine refresh(self, stat)
        class(dense_chart_type), intent(inout) :: self
        integer, intent(out) :: stat
        integer :: i, j

        stat = status_ok
        if (self%nh == 0) return
        do i = 1, self%nh
            self%phi_scale(i) = 0.0_wp
        end do
        do j = 1, self%n
            do i = 1, self%nh
                self%phi_scale(i) = self%phi_scale(i) + abs(self%model%terms%jacobian(i, j))* &
                    max(abs(self%q_point(j)), self%scale(j))
            end do
        end do
        ! With `refine`, B follows the motion at every point by itself.
        if (.not. self%refines) call self%factor_position(stat)
    end subroutine refresh

    !> B and H at the origin, where the paper's iterations start.
    subroutine start_refinement(self, stat)
        class(dense_chart_type), intent(inout) :: self
        integer, intent(out) :: stat

        self%is_split = .false.
        call self%factor_position(stat)
        if (stat /= status_ok) return
        call self%phi_u_lu%invert(self%b%inverse)
        call set_product(self%model%terms%jacobian, self%x_basis, self%c_x)
        call self%c_x_lu%factor(self%c_x, stat)
        stat = merge(status_ok, status_chart_left, stat == 0)
        if (stat == status_ok) call self%c_x_lu%invert(self%h%inverse)
    end subroutine start_refinement

    !> Factor Phi_q U at the current point.
    subroutine factor_position(self, stat)
        class(dense_chart_type), intent(inout) :: self
        integer, intent(out) :: stat

        call self%set_phi_u()
        call self%phi_u_lu%factor(self%phi_u, stat)
        self%counts%position_factorizations = self%counts%position_factorizations + min(self%nh, 1)
        stat = merge(status_ok, status_chart_left, stat == 0)
    end subroutine factor_position

    !> Phi_q U at the current point.
    subroutine set_phi_u(self)
        class(dense_chart_type), intent(inout) :: self
        integer :: i, j, l

        self%phi_u = 0.0_wp
        do j = 1, self%nh
            do l = 1, self%n
                do i = 1, self%nh
                    self%phi_u(i, j) = self%phi_u(i, j) + self%model%terms%jacobian(i, l)*self%u_basis(l, j)
                end do
            end do
        end do
    end subroutine set_phi_u

    !> Forget the last point.
    subroutine forget(self)
        class(dense_chart_type), intent(inout) :: self

        self%has_point = .false.
        self%is_split = .false.
        self%phi_is_current = .false.
    end subroutine forget

    !> q = q0 + xi - U u with Phi(t, q) = 0 by a simplified Newton iteration for u (17).
    subroutine restore_position(self, t, increment, q, stat)
        class(dense_chart_type), intent(inout) :: self
        real(wp), intent(in) :: t
        real(wp), intent(in), contiguous :: increment(:)
        real(wp), intent(out), contiguous :: q(:)
        integer, intent(out) :: stat
        !> A contraction by 0.5 reaches 1e-12 from 1 in 40; whatever is slower has left the chart.
        integer, parameter :: most_corrections = 40
        real(wp) :: error, first_error
        integer :: k

        stat = status_ok
        self%failed_row = 0
        self%trial = self%q0 + increment
        q = self%trial
        self%phi_is_current = .false.
        if (self%nh == 0) return
        first_error = huge(1.0_wp)
        do k = 0, most_corrections
            if (k > 0 .or. any(abs(self%u) > 0.0_wp)) then
                q = self%trial
                call add_product(self%u_basis, self%u, -1.0_wp, q)
            end if
            call self%model%evaluate(need_phi, t, q, self%no_velocity, self%counts, stat)
            if (stat /= status_ok) then
                self%failed_term = trim(self%model%failed_term)
                return
            end if
            self%scaled_phi = abs(self%model%terms%phi)/self%phi_scale
            error = maxval(self%scaled_phi)
            if (all(self%scaled_phi <= self%utol)) then
                self%phi_is_current = .true.
                return
            end if
            if (k == 0) first_error = error
            if (k == most_corrections .or. .not. error <= 1.0e3_wp*max(first_error, self%utol)) exit
            if (self%refines) then
                self%correction = 0.0_wp
                call add_product(self%b%inverse, self%model%terms%phi, 1.0_wp, self%correction)
            else
                self%correction = self%model%terms%phi
                call self%phi_u_lu%solve(self%correction)
            end if
            self%u = self%u + self%correction
            self%counts%position_corrections = self%counts%position_corrections + 1
        end do
        stat = status_position_diverged
        call self%blame(self%scaled_phi)
        ! Nothing of a failed iteration may reach the next step.
        self%u = 0.0_wp
    end subroutine restore_position

    !> Evaluate C, nu and M at (t, q), unless it was done last.
    subroutine move_to(self, t, q, stat)
        class(dense_chart_type), intent(inout) :: self
        real(wp), intent(in) :: t
        real(wp), intent(in), contiguous :: q(:)
        integer, intent(out) :: stat

        stat = status_ok
        if (self%has_point .and. .not. (t > self%t_point .or. t < self%t_point)) then
            if (all(abs(q - self%q_point) <= 0.0_wp)) return
        end if
        self%has_point = .false.
        self%is_split = .false.
        call self%model%evaluate(need_jacobian + need_nu + need_mass, t, q, self%no_velocity, &
            self%counts, stat)
        if (stat /= status_ok) then
            self%failed_term = trim(self%model%failed_term)
            return
        end if
        self%has_point = .true.
        self%t_point = t
        self%q_point = q
    end subroutine move_to

    !> R and D of C at the current point.
    subroutine split_constraints(self, stat)
        class(dense_chart_type), intent(inout) :: self
        integer, intent(out) :: stat

        stat = status_ok
        if (self%is_split) return
        self%counts%constraint_factorizations = self%counts%constraint_factorizations + min(self%m, 1)
        if (.not. self%refines) then
            call self%elimination%eliminate(self%model%terms%jacobian, self%scale, stat)
            if (stat /= 0) then
                self%failed_row = stat
                self%failed_value = 0.0_wp
                stat = status_chart_left
                return
            end if
            call self%elimination%get_right_inverse(self%right_inverse)
            call self%elimination%get_null_space(self%null_space)
            self%is_split = .true.
            return
        end if
        if (self%nh > 0) then
            call self%set_phi_u()
            call self%b%refine(self%phi_u, self%btol, self%counts%b_corrections, stat)
            if (stat /= status_ok) return
        end if
        call set_product(self%model%terms%jacobian, self%x_basis, self%c_x)
        call self%h%refine(self%c_x, self%htol, self%counts%h_corrections, stat)
        if (stat /= status_ok) return
        call set_product(self%x_basis, self%h%inverse, self%right_inverse)
        self%null_space = self%w_basis - matmul(self%right_inverse, matmul(self%model%terms%jacobian, self%w_basis))
        self%is_split = .true.
    end subroutine split_constraints

    !> qd = qd0 + eta - X x with C qd = nu.
    subroutine restore_velocity(self, t, q, increment, qd, stat)
        class(dense_chart_type), intent(inout) :: self
        real(wp), intent(in) :: t
        real(wp), intent(in), contiguous :: q(:), increment(:)
        real(wp), intent(out), contiguous :: qd(:)
        integer, intent(out) :: stat

        self%failed_row = 0
        call self%move_to(t, q, stat)
        if (stat /= status_ok) return
        call self%split_constraints(stat)
        if (stat /= status_ok) return
        if (self%m == 0) then
            qd = self%qd0 + increment
            return
        end if
        if (self%refines) then
            qd = self%qd0 + increment
            self%x = -self%model%terms%nu
            call add_product(self%model%terms%jacobian, qd, 1.0_wp, self%x)
            call add_product(self%right_inverse, self%x, -1.0_wp, qd)
            return
        end if
        ! qd = R nu + D z with N0' (qd - qd0 - eta) = 0; the second pass removes what rounding left of C qd - nu.
        call set_gram(self%null_origin, self%null_space, self%overlap)
        call self%overlap_lu%factor(self%overlap, stat)
        if (stat /= 0) then
            stat = status_chart_left
            return
        end if
        self%trial = self%qd0 + increment
        qd = 0.0_wp
        call add_product(self%right_inverse, self%model%terms%nu, 1.0_wp, qd)
        self%trial = self%trial - qd
        self%z = 0.0_wp
        call add_transposed_product(self%null_origin, self%trial, 1.0_wp, self%z)
        call self%overlap_lu%solve(self%z)
        call add_product(self%null_space, self%z, 1.0_wp, qd)
        self%x = -self%model%terms%nu
        call add_product(self%model%terms%jacobian, qd, 1.0_wp, self%x)
        call add_product(self%right_inverse, self%x, -1.0_wp, qd)
    end subroutine restore_velocity

    !> The acceleration at the point of `restore_velocity`.
    subroutine solve_dynamics(self, t, q, qd, qdd, stat)
        class(dense_chart_type), intent(inout) :: self
        real(wp), intent(in) :: t
        real(wp), intent(in), contiguous :: q(:), qd(:)
        real(wp), intent(out), contiguous :: qdd(:)
        integer, intent(out) :: stat

        self%failed_row = 0
        call self%move_to(t, q, stat)
        if (stat /= status_ok) return
        call self%model%evaluate(need_gamma + need_force, t, q, qd, self%counts, stat)
        if (stat /= status_ok) then
            self%failed_term = trim(self%model%failed_term)
            return
        end if
        self%counts%right_hand_sides = self%counts%right_hand_sides + 1
        associate (terms => self%model%terms)
            call self%dynamics%factor(terms%mass, self%null_space, stat)
            self%counts%mass_factorizations = self%counts%mass_factorizations + min(self%k, 1)
            if (stat /= status_ok) then
                if (.not. sum(abs(terms%mass)) + sum(abs(terms%jacobian)) <= huge(1.0_wp)) stat = status_not_finite
                return
            end if
            call self%dynamics%solve(terms%mass, terms%jacobian, self%null_space, self%right_inverse, terms%gamma, &
                terms%force, qdd, stat)
        end associate
    end subroutine solve_dynamics

    !> lambda at the last point of `solve_dynamics`.
    subroutine multipliers(self, qdd, lambda)
        class(dense_chart_type), intent(inout) :: self
        real(wp), intent(in), contiguous :: qdd(:)
        real(wp), intent(out), contiguous :: lambda(:)

        self%counts%multipliers = self%counts%multipliers + 1
        call self%dynamics%multipliers(self%model%terms%mass, self%right_inverse, self%model%terms%force, qdd, lambda)
    end subroutine multipliers

    !> The nearest velocity in the mass metric that satisfies the constraints at (t, q).
    subroutine project_velocity(self, t, q, qd, stat)
        class(dense_chart_type), intent(inout) :: self
        real(wp), intent(in) :: t
        real(wp), intent(in), contiguous :: q(:)
        real(wp), intent(inout), contiguous :: qd(:)
        integer, intent(out) :: stat

        self%failed_row = 0
        call self%move_to(t, q, stat)
        if (stat /= status_ok) return
        call self%split_constraints(stat)
        if (stat /= status_ok) return
        call self%dynamics%factor(self%model%terms%mass, self%null_space, stat)
        if (stat /= status_ok) return
        call self%dynamics%project(self%null_space, self%right_inverse, self%model%terms%nu, qd)
        if (.not. sum(abs(qd)) <= huge(1.0_wp)) stat = status_not_finite
    end subroutine project_velocity

    !> The errors of the three constraint levels at the last point.
    subroutine constraint_errors(self, t, q, qd, qdd, errors, rows, stat)
        class(dense_chart_type), intent(inout) :: self
        real(wp), intent(in) :: t
        real(wp), intent(in), contiguous :: q(:), qd(:), qdd(:)
        real(wp), intent(out) :: errors(3)
        integer, intent(out) :: rows(3)
        integer, intent(out) :: stat

        errors = 0.0_wp
        rows = 0
        call self%move_to(t, q, stat)
        if (stat /= status_ok .or. self%m == 0) return
        if (self%nh > 0 .and. .not. self%phi_is_current) then
            call self%model%evaluate(need_phi, t, q, qd, self%counts, stat)
            if (stat /= status_ok) then
                self%failed_term = trim(self%model%failed_term)
                return
            end if
        end if
        associate (terms => self%model%terms)
            if (self%nh > 0) call position_errors(terms%phi, terms%jacobian, q, self%scale, errors(1), rows(1))
            call velocity_errors(terms%nu, terms%jacobian, qd, self%scale, errors(2), rows(2))
            call acceleration_errors(terms%gamma, terms%jacobian, qdd, self%scale, errors(3), rows(3))
        end associate
    end subroutine constraint_errors

    !> What the policy watches: |v|, |w|, or |D| and |Fbar|.
    subroutine measure_health(self, q, qd, health)
        class(dense_chart_type), intent(inout) :: self
        real(wp), intent(in), contiguous :: q(:), qd(:)
        type(health_type), intent(out) :: health

        if (self%watches_v) health%v = length_outside(self%basis%q(:, :self%nh), (q - self%q0)/self%scale)
        if (self%watches_w) health%w = length_outside(self%basis%q(:, :self%m), (qd - self%qd0)/self%scale)
        if (self%watches_secants .and. self%m > 0) then
            ! The singular values of Y' X are the cosines of the angles between range(C') here (Y) and at the origin (X).
            call self%other_basis%factor_qr(self%model%terms%jacobian, self%scale, self%m)
            self%counts%basis_factorizations = self%counts%basis_factorizations + 1
            self%angles = matmul(transpose(self%other_basis%q(:, :self%m)), self%basis%q(:, :self%m))
            health%d = self%other_basis%largest_secant(self%angles)
            health%fbar = self%other_basis%largest_secant(self%angles(:self%nh, :self%nh))
        end if
    end subroutine measure_health

    !> The length of a vector's part outside the span of orthonormal columns.
    pure real(wp) function length_outside(columns, vector)
        real(wp), intent(in) :: columns(:, :)
        real(wp), intent(in), contiguous :: vector(:)
        real(wp) :: rest(size(vector))
        integer :: j

        rest = vector
        do j = 1, size(columns, 2)
            rest = rest - columns(:, j)*dot_product(columns(:, j), vector)
        end do
        length_outside = norm2(rest)
    end function length_outside

    !> qd' M qd / 2 at the last point.
    subroutine kinetic_energy(self, qd, energy)
        class(dense_chart_type), intent(inout) :: self
        real(wp), intent(in), contiguous :: qd(:)
        real(wp), intent(out) :: energy

        energy = 0.5_wp*dot_product(qd, matmul(self%model%terms%mass, qd))
    end subroutine kinetic_energy

    !> Remember the worst row.
    subroutine blame(self, row_errors)
        class(dense_chart_type), intent(inout) :: self
        real(wp), intent(in), contiguous :: row_errors(:)

        self%failed_row = maxloc(row_errors, dim=1)
        self%failed_value = maxval(row_errors)
    end subroutine blame
end module tandem_tangent_dense
