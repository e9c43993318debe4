! SPDX-License-Identifier: MIT
!> A model at one point (t, q, qd) for the analysis: its terms and their gradients, orthonormal bases V of null(Phi_q) and W of
!> null(C), and the right inverse R of C by singular values, which include redundant rows.
!>
!> All of it is in scaled coordinates q / scale, so that the bases do not depend on units. Costs n^3: for set-up, not for steps.
module tandem_analysis_point
    use tandem_analysis_row_space, only: row_space_type
    use tandem_error, only: error_type, set_error
    use tandem_kinds, only: wp
    use tandem_linalg_cholesky, only: cholesky_type
    use tandem_model, only: model_type
    use tandem_model_counts, only: counts_type
    use tandem_model_derivatives, only: derivatives_type
    use tandem_model_differences, only: differences_type
    use tandem_model_evaluator, only: evaluator_type
    use tandem_model_terms, only: need_force, need_gamma, need_jacobian, need_mass, need_nu, need_phi
    use tandem_status, only: status_not_evaluable, status_not_finite, status_ok, status_position_diverged, status_singular_mass
    use, intrinsic :: ieee_arithmetic, only: ieee_is_finite
    implicit none (type, external)
    private

    public :: point_type

    !> Evaluation of the gradients: the model's own, and differences.
    type :: gradients_type
        type(differences_type) :: differences
        type(derivatives_type) :: derivatives
    end type gradients_type

    !> Row spaces of Phi_q and of C, and the factor of W' M W.
    type :: factors_type
        type(row_space_type) :: of_phi, of_c
        type(cholesky_type) :: reduced_mass
    end type factors_type

    !> A point of the motion with its terms, gradients and bases.
    type :: point_type
        !> Numbers of coordinates, rows of Phi, rows of C, and the dimensions of null(Phi_q) and of null(C).
        integer :: n = 0, nh = 0, m = 0, nv = 0, nw = 0
        real(wp) :: t = 0.0_wp
        !> The point in the model's own coordinates (n), and the multipliers of least norm (m).
        real(wp), allocatable :: q(:), qd(:), qdd(:), lambda(:)
        !> Divisors of the coordinates (n).
        real(wp), allocatable :: scale(:)
        !> 1 over the time scale of the model.
        real(wp) :: rate = 1.0_wp
        !> Phi (nh), nu and gamma (m); C (m, n), M (n, n) and the forces (n) in scaled coordinates.
        real(wp), allocatable :: phi(:), nu(:), gamma(:), jacobian(:, :), mass(:, :), force(:)
        !> The five gradients in scaled coordinates, see `tandem_model_derivatives`.
        real(wp), allocatable :: velocity_q(:, :), acceleration_q(:, :), acceleration_qd(:, :), dynamics_q(:, :), dynamics_qd(:, :)
        !> V (n, nv) and W (n, nw), orthonormal in scaled coordinates.
        real(wp), allocatable :: v(:, :), w(:, :)
        !> Coordinates that take no part, see `is_idle` of a model: V and W keep them at rest.
        integer, allocatable :: idle(:)
        !> True if all gradients are the model's own; differences have fewer digits.
        logical :: has_gradients = .false.
        !> True if the point was refused because of friction.
        logical, private :: has_wrong_friction = .false.
        class(model_type), pointer :: model => null()
        type(counts_type) :: counts
        !> Number of computed bases: the cost of an analysis, each some n^3.
        integer :: n_bases = 0
        type(evaluator_type), private :: evaluator
        type(gradients_type), private :: gradients
        type(factors_type), private :: factors
        !> 1 over the length of each row of C.
        real(wp), allocatable :: row_scale(:)
    contains
        procedure :: initialize, evaluate, refuse_friction, make_bases, solve_dynamics
        procedure :: vary_acceleration, differentiate
        procedure :: apply_right_inverse, apply_position_inverse, restore_position
        procedure :: set_acceleration, size_of_acceleration, add_hidden_sizes, describe
        procedure, private :: factor_positions, finish_bases
    end type point_type

contains

    !> Attach a model that `check_model` has accepted.
    subroutine initialize(self, model)
        class(point_type), intent(inout) :: self
        !> It must outlive the point.
        class(model_type), intent(inout), target :: model
        integer :: i

        self%model => model
        self%n = model%n
        self%nh = model%n_holonomic
        self%m = model%n_constraints()
        self%scale = model%scales()
        self%rate = 1.0_wp/model%time_scale
        self%q = spread(0.0_wp, 1, self%n)
        self%qd = self%q
        self%qdd = self%q
        self%lambda = spread(0.0_wp, 1, self%m)
        self%row_scale = self%lambda
        call self%evaluator%initialize(model)
        call self%gradients%differences%initialize(model, self%scale, saves_memory=.true.)
        self%gradients%differences%is_central = .true.
        call self%gradients%derivatives%allocate(self%n, self%m)
        self%idle = pack([(i, i=1, self%n)], model%is_idle())
        if (allocated(model%pattern) .and. size(self%idle) == 0) then
            call self%factors%of_phi%initialize(self%nh, self%n, model%pattern)
            if (self%m > self%nh) call self%factors%of_c%initialize(self%m, self%n, model%pattern)
        else
            call self%factors%of_phi%initialize(self%nh + size(self%idle), self%n)
            if (self%m > self%nh) call self%factors%of_c%initialize(self%m + size(self%idle), self%n)
        end if
        self%has_gradients = self%gradients%differences%has_all_derivatives()
    end subroutine initialize

    !> The terms at a point.
    subroutine evaluate(self, t, q, qd, stat)
        class(point_type), intent(inout) :: self
        real(wp), intent(in) :: t, q(:), qd(:)
        !> A status code.
        integer, intent(out) :: stat
        integer :: i, j

        self%t = t
        self%q = q
        self%qd = qd
        call self%evaluator%evaluate(need_phi + need_jacobian + need_nu + need_gamma + need_mass + need_force, t, self%q, self%qd, &
            self%counts, stat)
        if (stat /= status_ok) return
        associate (terms => self%evaluator%terms, s => self%scale)
            self%phi = terms%phi
            self%nu = terms%nu
            self%gamma = terms%gamma
            if (iand(self%evaluator%has, need_gamma) == 0 .and. self%m > 0) then
                call self%gradients%differences%evaluate_gamma(t, self%q, self%qd, self%gamma, self%counts, stat)
                if (stat /= status_ok) return
            end if
            self%jacobian = terms%jacobian
            self%mass = terms%mass
            do j = 1, self%n
                self%jacobian(:, j) = self%jacobian(:, j)*s(j)
                self%mass(:, j) = self%mass(:, j)*(s*s(j))
            end do
            self%force = terms%force*s
        end associate
        do i = 1, self%m
            self%row_scale(i) = norm2(self%jacobian(i, :))
            self%row_scale(i) = merge(1/self%row_scale(i), 1.0_wp, self%row_scale(i) > 0.0_wp)
        end do
        if (.not. (all(ieee_is_finite(self%jacobian)) .and. all(ieee_is_finite(self%mass)) .and. &
            all(ieee_is_finite(self%force)) .and. all(ieee_is_finite(self%gamma)) .and. all(ieee_is_finite(self%phi)) .and. &
            all(ieee_is_finite(self%nu)))) stat = status_not_finite
    end subroutine evaluate

    !> Refuse the point of the last `evaluate` if friction on reactions slides: it is a damper if all of it rests, but sliding it
    !> has normal forces, which the linearised equations do not contain. Refuse redundant rows, too, because they leave reactions
    !> undetermined. Call after `make_bases`.
    subroutine refuse_friction(self, stat)
        class(point_type), intent(inout) :: self
        !> A status code.
        integer, intent(inout) :: stat

        if (stat /= status_ok .or. self%model%n_frictions == 0) return
        call self%evaluator%find_directions(self%t, self%q, self%qd, stat)
        if (stat /= status_ok) return
        if (any(abs(self%evaluator%directions) > 0.0_wp) .or. (self%nw > self%n - self%m - size(self%idle))) stat = &
            status_not_evaluable
        self%has_wrong_friction = stat /= status_ok
    end subroutine refuse_friction

    !> V, W, and the factors for R and the multipliers.
    subroutine make_bases(self)
        class(point_type), intent(inout) :: self

        call self%factor_positions()
        call self%finish_bases()
    end subroutine make_bases

    !> Factor Phi_q.
    subroutine factor_positions(self)
        class(point_type), intent(inout) :: self

        self%n_bases = self%n_bases + 1
        call self%factors%of_phi%factor(rows_of(self, self%nh))
    end subroutine factor_positions

    !> V and W, with Phi_q factored.
    subroutine finish_bases(self)
        class(point_type), intent(inout) :: self

        call self%factors%of_phi%get_null_basis(self%v)
        self%nv = size(self%v, 2)
        if (self%m == self%nh) then
            self%w = self%v
        else
            call self%factors%of_c%factor(rows_of(self, self%m))
            call self%factors%of_c%get_null_basis(self%w)
        end if
        self%nw = size(self%w, 2)
    end subroutine finish_bases

    !> The first rows of C, each over its length. Rows behind them fix coordinates that take no part.
    pure function rows_of(self, k) result(rows)
        class(point_type), intent(in) :: self
        integer, intent(in) :: k
        real(wp) :: rows(k + size(self%idle), self%n)
        integer :: i

        do i = 1, k
            rows(i, :) = self%row_scale(i)*self%jacobian(i, :)
        end do
        rows(k + 1:, :) = 0.0_wp
        do i = 1, size(self%idle)
            rows(k + i, self%idle(i)) = 1.0_wp
        end do
    end function rows_of

    !> x (n, k) = R b for b (m, k): the displacements of least norm for which the rows of C change by b.
    subroutine apply_right_inverse(self, b, x)
        class(point_type), intent(in) :: self
        real(wp), intent(in) :: b(:, :)
        real(wp), intent(out) :: x(:, :)
        real(wp) :: rows(self%m + size(self%idle))
        integer :: j

        rows = 0.0_wp
        do j = 1, size(b, 2)
            rows(:self%m) = self%row_scale*b(:, j)
            if (self%m == self%nh) then
                call self%factors%of_phi%solve(rows, x(:, j))
            else
                call self%factors%of_c%solve(rows, x(:, j))
            end if
        end do
    end subroutine apply_right_inverse

    !> x (n) = Phi_q^+ b for b (nh).
    subroutine apply_position_inverse(self, b, x)
        class(point_type), intent(in) :: self
        real(wp), intent(in) :: b(:)
        real(wp), intent(out) :: x(:)

        real(wp) :: rows(self%nh + size(self%idle))

        rows = 0.0_wp
        rows(:self%nh) = self%row_scale(:self%nh)*b
        call self%factors%of_phi%solve(rows, x)
    end subroutine apply_position_inverse

    !> Bring coordinates onto the position constraints by corrections of least norm; the point and its bases are evaluated there.
    subroutine restore_position(self, t, qd, q, stat)
        class(point_type), intent(inout) :: self
        real(wp), intent(in) :: t, qd(:)
        real(wp), intent(inout) :: q(:)
        integer, intent(out) :: stat
        integer, parameter :: limit = 30
        real(wp) :: correction(self%n), most, length, last
        logical :: is_new
        integer :: i

        most = 10*(1 + maxval(abs(q/self%scale)))
        last = 0.0_wp
        do i = 1, limit
            call self%evaluate(t, q, qd, stat)
            if (stat /= status_ok) return
            ! Factors of the previous point are reused as long as they reduce the residual fast.
            is_new = i == 1
            if (is_new) call self%factor_positions()
            call self%apply_position_inverse(-self%phi, correction)
            length = maxval(abs(correction))
            if (length > 0.1_wp*last .and. .not. is_new) then
                call self%factor_positions()
                is_new = .true.
                call self%apply_position_inverse(-self%phi, correction)
                length = maxval(abs(correction))
            end if
            if (length <= 1.0e-13_wp*(1 + maxval(abs(q/self%scale)))) then
                if (.not. is_new) call self%factor_positions()
                call self%finish_bases()
                return
            end if
            if (length > most) exit
            last = length
            q = q + self%scale*correction
        end do
        stat = status_position_diverged
    end subroutine restore_position

    !> Set a given acceleration (n), and the multipliers that fit it best.
    subroutine set_acceleration(self, qdd)
        class(point_type), intent(inout) :: self
        real(wp), intent(in) :: qdd(:)
        real(wp) :: y(self%m + size(self%idle))

        self%qdd = qdd
        if (self%m == self%nh) then
            call self%factors%of_phi%solve_transposed(self%force - matmul(self%mass, qdd/self%scale), y)
        else
            call self%factors%of_c%solve_transposed(self%force - matmul(self%mass, qdd/self%scale), y)
        end if
        self%lambda = self%row_scale*y(:self%m)
    end subroutine set_acceleration

    !> qdd and lambda: W'M qdd = W'(S + Q_A), C qdd = -gamma.
    subroutine solve_dynamics(self, stat)
        class(point_type), intent(inout) :: self
        integer, intent(out) :: stat
        real(wp) :: x(self%n, 1), w(self%nw)

        call self%factors%reduced_mass%allocate(self%nw)
        call self%factors%reduced_mass%factor(matmul(transpose(self%w), matmul(self%mass, self%w)), stat)
        if (stat /= 0) then
            stat = status_singular_mass
            return
        end if
        call self%apply_right_inverse(reshape(-self%gamma, [self%m, 1]), x)
        w = matmul(transpose(self%w), self%force - matmul(self%mass, x(:, 1)))
        call self%factors%reduced_mass%solve(w)
        x(:, 1) = x(:, 1) + matmul(self%w, w)
        call self%set_acceleration(self%scale*x(:, 1))
    end subroutine solve_dynamics

    !> Changes of qdd (n, k) with the coordinates and velocities (n, k), all in scaled coordinates; after `solve_dynamics` and
    !> `differentiate`.
    subroutine vary_acceleration(self, dq, dqd, dqdd, acceleration, dynamics)
        class(point_type), intent(in) :: self
        real(wp), intent(in) :: dq(:, :), dqd(:, :)
        real(wp), intent(out) :: dqdd(:, :)
        !> Additional terms of C qdd + gamma (m) and of M qdd - S - Q_A (n), k = 1.
        real(wp), intent(in), optional :: acceleration(:), dynamics(:)
        real(wp) :: rows(self%m, size(dq, 2)), force(self%nw, size(dq, 2))
        integer :: j

        ! C dqdd = -(acc_q dq + acc_qd dqd), and the remainder of W'M dqdd = -W'(dyn_q dq + dyn_qd dqd).
        rows = -matmul(self%acceleration_q, dq) - matmul(self%acceleration_qd, dqd)
        if (present(acceleration)) rows(:, 1) = rows(:, 1) - acceleration
        call self%apply_right_inverse(rows, dqdd)
        force = -matmul(transpose(self%w), matmul(self%dynamics_q, dq) + matmul(self%dynamics_qd, dqd) + matmul(self%mass, dqdd))
        if (present(dynamics)) force(:, 1) = force(:, 1) - matmul(dynamics, self%w)
        do j = 1, size(dq, 2)
            call self%factors%reduced_mass%solve(force(:, j))
        end do
        dqdd = dqdd + matmul(self%w, force)
    end subroutine vary_acceleration

    !> Sizes of the terms in the sum W' dqdd: the rounding error of a balance is a small part of them.
    subroutine size_of_acceleration(self, dq, dqd, size_of)
        class(point_type), intent(in) :: self
        !> Sizes of changes of q and qd (n, k).
        real(wp), intent(in) :: dq(:, :), dqd(:, :)
        !> (nw, k).
        real(wp), intent(out) :: size_of(:, :)
        real(wp) :: inverse(self%nw, self%nw), forces(self%n), changes(self%n, size(dq, 2))
        integer :: j

        inverse = 0.0_wp
        do j = 1, self%nw
            inverse(j, j) = 1.0_wp
            call self%factors%reduced_mass%solve(inverse(:, j))
        end do
        ! Models add up the stiffness of balanced forces, which is as large as the forces if these turn with their bodies.
        forces = matmul(abs(self%lambda), abs(self%jacobian)) + abs(self%force)
        changes = matmul(abs(self%dynamics_q), dq) + matmul(abs(self%dynamics_qd), dqd)
        do j = 1, size(dq, 2)
            changes(:, j) = changes(:, j) + forces*sum(dq(:, j))
        end do
        size_of = matmul(abs(inverse), matmul(transpose(abs(self%w)), changes))
    end subroutine size_of_acceleration

    !> Add the sizes of terms that contribute only rounding: those of the right inverse of C and of the reduced mass.
    subroutine add_hidden_sizes(self, dq, dqd, result_of, size_of)
        class(point_type), intent(in) :: self
        !> Sizes of changes of q and qd (n, k), and the changes of w' that they cause (nw, k).
        real(wp), intent(in) :: dq(:, :), dqd(:, :), result_of(:, :)
        !> (nv + nw, k): rows of v' first.
        real(wp), intent(inout) :: size_of(:, :)
        real(wp) :: inverse(self%nw, self%nw), right(self%n, self%m), ones(self%m, self%m), forces(self%nw, size(dq, 2))
        integer :: j

        ones = 0.0_wp
        do j = 1, self%m
            ones(j, j) = 1.0_wp
        end do
        call self%apply_right_inverse(ones, right)
        right = abs(right)
        inverse = 0.0_wp
        do j = 1, self%nw
            inverse(j, j) = 1.0_wp
            call self%factors%reduced_mass%solve(inverse(:, j))
        end do
        associate (w => abs(self%w), mass => abs(self%mass))
            forces = matmul(transpose(w), matmul(mass, matmul(right, matmul(abs(self%acceleration_q), dq) + &
                matmul(abs(self%acceleration_qd), dqd)) + matmul(w, abs(result_of))))
            size_of(self%nv + 1:, :) = size_of(self%nv + 1:, :) + matmul(abs(inverse), forces)
        end associate
        size_of(:self%nv, :) = size_of(:self%nv, :) + matmul(transpose(abs(self%v)), matmul(right, &
            matmul(abs(self%velocity_q), dq)))
    end subroutine add_hidden_sizes

    !> The gradients at the point, for its qdd and lambda.
    subroutine differentiate(self, stat)
        class(point_type), intent(inout) :: self
        !> A status code.
        integer, intent(out) :: stat

        ! Scaled in place.
        if (allocated(self%velocity_q)) then
            call move_alloc(self%velocity_q, self%gradients%derivatives%velocity_q)
            call move_alloc(self%acceleration_q, self%gradients%derivatives%acceleration_q)
            call move_alloc(self%acceleration_qd, self%gradients%derivatives%acceleration_qd)
            call move_alloc(self%dynamics_q, self%gradients%derivatives%dynamics_q)
            call move_alloc(self%dynamics_qd, self%gradients%derivatives%dynamics_qd)
        end if
        call self%gradients%differences%evaluate_derivatives(self%t, self%q, self%qd, self%qdd, self%lambda, &
            self%gradients%derivatives, self%counts, stat)
        call move_alloc(self%gradients%derivatives%velocity_q, self%velocity_q)
        call move_alloc(self%gradients%derivatives%acceleration_q, self%acceleration_q)
        call move_alloc(self%gradients%derivatives%acceleration_qd, self%acceleration_qd)
        call move_alloc(self%gradients%derivatives%dynamics_q, self%dynamics_q)
        call move_alloc(self%gradients%derivatives%dynamics_qd, self%dynamics_qd)
        if (stat /= status_ok) return
        call scale_in_place(self%velocity_q, .false.)
        call scale_in_place(self%acceleration_q, .false.)
        call scale_in_place(self%acceleration_qd, .false.)
        call scale_in_place(self%dynamics_q, .true.)
        call scale_in_place(self%dynamics_qd, .true.)
        if (.not. (all(ieee_is_finite(self%velocity_q)) .and. all(ieee_is_finite(self%acceleration_q)) .and. &
            all(ieee_is_finite(self%acceleration_qd)) .and. all(ieee_is_finite(self%dynamics_q)) .and. &
            all(ieee_is_finite(self%dynamics_qd)))) stat = status_not_finite

    contains

        pure subroutine scale_in_place(a, rows_too)
            real(wp), intent(inout) :: a(:, :)
            logical, intent(in) :: rows_too
            integer :: i, j

            do j = 1, size(a, 2)
                do i = 1, size(a, 1)
                    a(i, j) = a(i, j)*self%scale(j)
                    if (rows_too) a(i, j) = a(i, j)*self%scale(i)
                end do
            end do
        end subroutine scale_in_place
    end subroutine differentiate

    !> Description of a status.
    subroutine describe(self, stat, where, error)
        class(point_type), intent(in) :: self
        integer, intent(in) :: stat
        !> Description of the point.
        character(len=*), intent(in) :: where
        type(error_type), allocatable, intent(out) :: error

        if (stat == status_ok) return
        if (self%has_wrong_friction) then
            call set_error(error, stat, 'the model "'//self%model%name//'" '//where//': friction on reactions slides there, or '// &
                'redundant constraints leave them undetermined', 'give the friction a normal force')
        else if (stat == status_not_finite) then
            call set_error(error, stat, 'the model "'//self%model%name//'" '//where, 'start elsewhere: a term is not a number '// &
                'there, such as the direction of a rod of length zero')
        else
            call set_error(error, stat, 'the model "'//self%model%name//'" '//where)
        end if
    end subroutine describe
end module tandem_analysis_point
