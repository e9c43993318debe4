! SPDX-License-Identifier: MIT
!> The Newton system of an implicit stage: the residual (53), its Jacobian (76), (77), and the reduced matrix that is factored.
!>
!> Unknowns of a stage are vd, wd and lambda. With D and R = X H (C R = I, C D = 0) of the current point, the rows R' R2 = 0 give
!> lambda = R' (S + Q_A - M qdd) exactly, whatever vd and wd are, and leave
!>
!>   r1 = vd - V' qd = 0,   r2 = D' (M qdd - S - Q_A) = 0,   qdd = D wd - R gamma.
!>
!> The Newton matrix of (r1, r2) is that of (97) reduced by D' (D' C' = 0):
!>
!>   [ I + ha R1_v        ha R1_w            ]      R1_v = -V' Pbar,   R1_w = -V' D
!>   [ ha D' R2_v         D' M D + ha D' R2_w ]     R2_w = (dyn_qd - M R acc_qd) D
!>                                                  R2_v = (dyn_q - M R acc_q) Fbar + (dyn_qd - M R acc_qd) Pbar
!>
!> with Pbar = -R vel_q Fbar (56), (75), Fbar (54), and the gradients vel_q, acc_q, acc_qd, dyn_q, dyn_qd of
!> `tandem_model_derivatives`. One factorisation is used for every stage with the same ha = h a_ii; the blocks are kept, so that
!> another ha requires a factorisation but no derivatives.
!>
!> A matrix outlives its chart: it stays in the coordinates of the chart where it was formed. T_v = V_then' V_now takes coordinates
!> there and S_v = V_now' V_then takes them back, the primes being the charts' duals; alike T_w and S_w. So r1 is transformed to T_v
!> r1, the force r2 to S_w' r2, and corrections return by S. The neglected terms are of second order in the angle between the charts
!> and affect the contraction only. They vanish along stiff directions, which the duals of a metric preserve.
module tandem_chart_dense_newton_matrix
    use tandem_chart_dense_bases, only: bases_type
    use tandem_kinds, only: long, wp
    use tandem_linalg_kernels, only: add_product, add_transposed_product, set_gram, set_product
    use tandem_linalg_complex_lu, only: complex_lu_type
    use tandem_linalg_lu, only: lu_type
    use tandem_model_derivatives, only: derivatives_type
    use tandem_model_terms, only: terms_type
    use tandem_pack, only: pack_type
    use tandem_chart_dense_stage_iterate, only: stage_iterate_type
    use tandem_chart_dense_velocity_basis, only: velocity_basis_type
    use tandem_status, only: status_newton_failed, status_ok
    implicit none (type, external)
    private

    public :: stage_type

    !> Largest number of pairs of systems of any method: seven stages.
    integer, parameter :: most_pairs = 3

    !> Relation between the chart where a matrix was formed and the one where it is used.
    type :: carry_type
        !> True if the charts differ; true if T_v (nv, nv), T_w (nw, nw) and the way back S_v, S_w are current.
        logical :: is_carried = .false., is_current = .false.
        !> True if duals equal bases up to coordinate scales, there and here: S_v and S_w are then the transposes of T_v, T_w.
        logical :: is_plain_there = .true., is_plain_here = .true.
        real(wp), allocatable :: v(:, :), w(:, :), back_v(:, :), back_w(:, :)
        !> Duals of V and W where the matrix was formed, and V and W there; a right side in its coordinates.
        real(wp), allocatable :: formed_v(:, :), formed_w(:, :), formed_v_basis(:, :), formed_w_basis(:, :), rhs(:)
    end type carry_type

    !> The Newton system of a stage.
    type :: stage_type
        !> The blocks of (76), (77): R1_v (nv, nv), R1_w (nv, nw), R2_v (n, nv), R2_w (n, nw).
        real(wp), allocatable :: r1_v(:, :), r1_w(:, :), r2_v(:, :), r2_w(:, :)
        !> Fbar (n, nv) and Pbar (n, nv) of the point of the last `form`.
        real(wp), allocatable :: fbar(:, :), pbar(:, :)
        integer, private :: n = 0, nv = 0, nw = 0
        real(wp), allocatable, private :: mr(:, :), gradient_q(:, :), gradient_qd(:, :), mass_d(:, :), work_mv(:, :)
        !> D' M D (nw, nw) of the last `form`.
        real(wp), allocatable, private :: origin_mass(:, :)
        real(wp), allocatable, private :: matrix(:, :), block_wv(:, :), block_ww(:, :), rhs(:), force(:), defect(:)
        !> ha of the last `factor`, 0 if there is none.
        real(wp), private :: ha = 0.0_wp
        !> Relation of this chart to that of the last `form`.
        type(carry_type), private :: carry
        type(lu_type), private :: lu
        !> Number of complex pairs of systems, ratio of the ha of each to the real ha, work space for one of their matrices.
        integer, private :: n_pairs = 0
        complex(wp), private :: pairs(most_pairs) = (0.0_wp, 0.0_wp)
        complex(wp), allocatable, private :: pair_matrix(:, :)
        type(complex_lu_type), private :: pair_lu(most_pairs)
        !> True if the factors belong to other pairs.
        logical, private :: is_outdated = .false.
    contains
        procedure :: allocate => allocate_stage, form, factor, adapt, enter_chart
        procedure :: expect_pairs
        procedure :: find_residual, solve_real, solve_pair
        procedure :: get_residual, move_rates, filter, restore_error, reciprocal_condition, pack_state
        procedure, private :: solve, take_there, bring_back, is_near, set_carry
    end type stage_type

contains

    !> Allocate for n coordinates, nh holonomic and m constraints in all.
    subroutine allocate_stage(self, n, nh, m)
        class(stage_type), intent(inout) :: self
        integer, intent(in) :: n, nh, m
        integer :: nv, nw

        nv = n - nh
        nw = n - m
        self%n = n
        self%nv = nv
        self%nw = nw
        if (allocated(self%rhs)) deallocate (self%r1_v, self%r1_w, self%r2_v, self%r2_w, self%fbar, self%pbar, self%mr, &
            self%gradient_q, self%gradient_qd, self%mass_d, self%work_mv, self%matrix, self%block_wv, self%block_ww, &
            self%rhs, self%force, self%defect, self%origin_mass)
        self%carry = carry_type()
        allocate (self%r1_v(nv, nv), self%r1_w(nv, nw), self%r2_v(n, nv), self%r2_w(n, nw), self%fbar(n, nv), &
            self%pbar(n, nv), self%mr(n, m), self%gradient_q(n, n), self%gradient_qd(n, n), self%mass_d(n, nw), &
            self%work_mv(m, nv), self%matrix(nv + nw, nv + nw), self%block_wv(nw, nv), self%block_ww(nw, nw), &
            self%rhs(nv + nw), self%force(n), self%defect(m), self%origin_mass(nw, nw), source=0.0_wp)
        associate (carry => self%carry)
            allocate (carry%v(nv, nv), carry%w(nw, nw), carry%back_v(nv, nv), carry%back_w(nw, nw), carry%formed_v_basis(n, nv), &
                carry%formed_w_basis(n, nw), carry%formed_v(n, nv), carry%formed_w(n, nw), carry%rhs(nv + nw), source=0.0_wp)
        end associate
        call self%lu%allocate(nv + nw)
        self%ha = 0.0_wp
        self%n_pairs = 0
        self%is_outdated = .false.
        if (allocated(self%pair_matrix)) deallocate (self%pair_matrix)
    end subroutine allocate_stage

    !> From now on also factor the matrices of complex pairs of systems, whose ha are `ratios` times the real ha. Uses the same
    !> blocks.
    subroutine expect_pairs(self, ratios)
        class(stage_type), intent(inout) :: self
        !> At most three.
        complex(wp), intent(in), contiguous :: ratios(:)
        integer :: k

        if (self%n_pairs == size(ratios)) then
            if (all(abs(self%pairs(:self%n_pairs) - ratios) <= 0.0_wp)) return
        end if
        if (.not. allocated(self%pair_matrix)) allocate (self%pair_matrix(self%nv + self%nw, self%nv + self%nw), &
            source=(0.0_wp, 0.0_wp))
        do k = self%n_pairs + 1, size(ratios)
            call self%pair_lu(k)%allocate(self%nv + self%nw)
        end do
        self%n_pairs = size(ratios)
        self%pairs(:self%n_pairs) = ratios
        self%is_outdated = .true.
    end subroutine expect_pairs

    !> Form the blocks at the current point.
    subroutine form(self, terms, derivatives, bases, u_basis, b_phi, velocity_basis, left_basis, is_plain)
        class(stage_type), intent(inout) :: self
        !> The terms and derivatives of the point.
        type(terms_type), intent(in) :: terms
        type(derivatives_type), intent(in) :: derivatives
        type(bases_type), intent(in) :: bases
        !> U (n, nh), B Phi_q (nh, n) at the point.
        real(wp), intent(in), contiguous :: u_basis(:, :), b_phi(:, :)
        !> With D (n, nw) and R (n, m) at the point.
        type(velocity_basis_type), intent(in) :: velocity_basis
        !> The matrix to the left of R2_v and R2_w (n, nw), which is D without friction on reactions.
        real(wp), intent(in), contiguous :: left_basis(:, :)
        !> True if the chart's duals equal its bases up to coordinate scales.
        logical, intent(in) :: is_plain
        integer :: j, l

        ! Fbar = (I - U B Phi_q) V (54).
        self%fbar = bases%v
        do j = 1, self%nv
            do l = 1, size(u_basis, 2)
                self%fbar(:, j) = self%fbar(:, j) - u_basis(:, l)*dot_product(b_phi(l, :), bases%v(:, j))
            end do
        end do
        ! Pbar = -R (C qd - nu)_q Fbar (75).
        call set_product(derivatives%velocity_q, self%fbar, self%work_mv)
        call set_product(velocity_basis%right_inverse, self%work_mv, self%pbar)
        self%pbar = -self%pbar
        ! The gradients of M qdd + C' lambda - S - Q_A along the manifold of accelerations.
        call set_product(terms%mass, velocity_basis%right_inverse, self%mr)
        call set_product(self%mr, derivatives%acceleration_q, self%gradient_q)
        self%gradient_q = derivatives%dynamics_q - self%gradient_q
        call set_product(self%mr, derivatives%acceleration_qd, self%gradient_qd)
        self%gradient_qd = derivatives%dynamics_qd - self%gradient_qd
        call set_product(self%gradient_qd, velocity_basis%null_space, self%r2_w)
        call set_product(self%gradient_q, self%fbar, self%r2_v)
        do j = 1, self%nv
            call add_product(self%gradient_qd, self%pbar(:, j), 1.0_wp, self%r2_v(:, j))
        end do
        call set_gram(bases%v_dual, self%pbar, self%r1_v)
        self%r1_v = -self%r1_v
        call set_gram(bases%v_dual, velocity_basis%null_space, self%r1_w)
        self%r1_w = -self%r1_w
        ! D' M D, D' R2_v and D' R2_w.
        call set_product(terms%mass, velocity_basis%null_space, self%mass_d)
        call set_gram(left_basis, self%r2_v, self%block_wv)
        call set_gram(left_basis, self%r2_w, self%block_ww)
        call set_gram(velocity_basis%null_space, self%mass_d, self%origin_mass)
        self%carry%formed_v = bases%v_dual
        self%carry%formed_w = bases%w_dual
        self%carry%formed_v_basis = bases%v
        self%carry%formed_w_basis = bases%w
        self%carry%is_carried = .false.
        self%carry%is_plain_there = is_plain
        self%ha = 0.0_wp
    end subroutine form

    !> Factor the reduced Newton matrix for ha = h a_ii.
    subroutine factor(self, ha, stat)
        class(stage_type), intent(inout) :: self
        real(wp), intent(in) :: ha
        !> A status code.
        integer, intent(out) :: stat
        integer :: i, j

        associate (nv => self%nv, nw => self%nw, a => self%matrix)
            a(:nv, :nv) = ha*self%r1_v
            do i = 1, nv
                a(i, i) = a(i, i) + 1.0_wp
            end do
            a(:nv, nv + 1:) = ha*self%r1_w
            a(nv + 1:, :nv) = ha*self%block_wv
            do j = 1, nw
                do i = 1, nw
                    a(nv + i, nv + j) = ha*self%block_ww(i, j) + self%origin_mass(i, j)
                end do
            end do
        end associate
        call self%lu%factor(self%matrix, stat)
        do i = 1, self%n_pairs
            if (stat == 0) call factor_pair(self, i, ha, stat)
        end do
        self%ha = merge(ha, 0.0_wp, stat == 0)
        self%is_outdated = .false.
        stat = merge(status_ok, status_newton_failed, stat == 0)
    end subroutine factor

    !> Factor the matrix of a pair; ha belongs to the real system.
    subroutine factor_pair(self, k, ha, stat)
        class(stage_type), intent(inout) :: self
        !> The number of the pair.
        integer, intent(in) :: k
        real(wp), intent(in) :: ha
        integer, intent(out) :: stat
        complex(wp) :: of_pair
        integer :: i, j

        of_pair = self%pairs(k)*ha
        associate (nv => self%nv, nw => self%nw, a => self%pair_matrix)
            do j = 1, nv
                do i = 1, nv
                    a(i, j) = of_pair*self%r1_v(i, j)
                end do
                a(j, j) = a(j, j) + 1.0_wp
                do i = 1, nw
                    a(nv + i, j) = of_pair*self%block_wv(i, j)
                end do
            end do
            do j = 1, nw
                do i = 1, nv
                    a(i, nv + j) = of_pair*self%r1_w(i, j)
                end do
                do i = 1, nw
                    a(nv + i, nv + j) = of_pair*self%block_ww(i, j) + self%origin_mass(i, j)
                end do
            end do
        end associate
        call self%pair_lu(k)%factor(self%pair_matrix, stat)
    end subroutine factor_pair

    !> Reuse the last matrix for another ha: factor its blocks again if ha has changed by more than rounding.
    subroutine adapt(self, ha, bases, factorizations, can)
        class(stage_type), intent(inout) :: self
        real(wp), intent(in) :: ha
        !> V and its dual (n, nv), W and its dual (n, nw), of the current chart.
        type(bases_type), intent(in) :: bases
        !> Counts factorisations.
        integer(long), intent(inout) :: factorizations
        !> False if there is no matrix, or its chart is too far away.
        logical, intent(out) :: can
        !> Successive steps of a grid differ by rounding of the time.
        real(wp), parameter :: rounding = 1.0e-6_wp
        integer :: stat

        can = self%ha > 0.0_wp
        if (can) can = self%is_near(bases)
        if (.not. can .or. (abs(ha - self%ha) <= rounding*self%ha .and. .not. self%is_outdated)) return
        call self%factor(ha, stat)
        factorizations = factorizations + 1
        can = stat == status_ok
    end subroutine adapt

    !> The chart has changed: the matrix belongs to an old chart from now on.
    pure subroutine enter_chart(self, is_plain)
        class(stage_type), intent(inout) :: self
        !> True if its duals equal its bases up to coordinate scales.
        logical, intent(in) :: is_plain

        self%carry%is_plain_here = is_plain
        self%carry%is_carried = .true.
        self%carry%is_current = .false.
    end subroutine enter_chart

    !> Solve for a right side in the current chart's coordinates, in place.
    subroutine solve(self, bases)
        class(stage_type), intent(inout) :: self
        !> V and its dual (n, nv), W and its dual (n, nw), of the current chart.
        type(bases_type), intent(in) :: bases

        if (self%carry%is_carried) call self%set_carry(bases)
        call self%take_there(self%rhs)
        call self%lu%solve(self%rhs)
        call self%bring_back(self%rhs)
    end subroutine solve

    !> Solve for a right side of stages that are solved together, in the current chart's coordinates, in place.
    subroutine solve_real(self, bases, x)
        class(stage_type), intent(inout) :: self
        !> V and its dual (n, nv), W and its dual (n, nw), of the current chart.
        type(bases_type), intent(in) :: bases
        !> Its first nv + nw entries.
        real(wp), intent(inout), contiguous :: x(:)

        if (self%carry%is_carried) call self%set_carry(bases)
        associate (n => self%nv + self%nw)
            call self%take_there(x(:n))
            call self%lu%solve(x(:n))
            call self%bring_back(x(:n))
        end associate
    end subroutine solve_real

    !> Solve with the matrix of one of the pairs, for x + i y.
    subroutine solve_pair(self, bases, k, x, y)
        class(stage_type), intent(inout) :: self
        !> V and its dual (n, nv), W and its dual (n, nw), of the current chart.
        type(bases_type), intent(in) :: bases
        !> The number of the pair.
        integer, intent(in) :: k
        !> Their first nv + nw entries.
        real(wp), intent(inout), contiguous :: x(:), y(:)

        if (self%carry%is_carried) call self%set_carry(bases)
        associate (n => self%nv + self%nw)
            call self%take_there(x(:n))
            call self%take_there(y(:n))
            call self%pair_lu(k)%solve(x(:n), y(:n))
            call self%bring_back(x(:n))
            call self%bring_back(y(:n))
        end associate
    end subroutine solve_pair

    !> Transform a right side of the current chart to the coordinates of the chart where the matrix was formed.
    subroutine take_there(self, rhs)
        class(stage_type), intent(inout) :: self
        real(wp), intent(inout), contiguous :: rhs(:)

        if (.not. self%carry%is_carried) return
        associate (nv => self%nv)
            self%carry%rhs = 0.0_wp
            call add_product(self%carry%v, rhs(:nv), 1.0_wp, self%carry%rhs(:nv))
            call add_transposed_product(self%carry%back_w, rhs(nv + 1:), 1.0_wp, self%carry%rhs(nv + 1:))
            rhs = self%carry%rhs
        end associate
    end subroutine take_there

    !> Transform a correction from the coordinates of the chart where the matrix was formed to the current coordinates.
    subroutine bring_back(self, correction)
        class(stage_type), intent(inout) :: self
        real(wp), intent(inout), contiguous :: correction(:)

        if (.not. self%carry%is_carried) return
        associate (nv => self%nv)
            self%carry%rhs = 0.0_wp
            call add_product(self%carry%back_v, correction(:nv), 1.0_wp, self%carry%rhs(:nv))
            call add_product(self%carry%back_w, correction(nv + 1:), 1.0_wp, self%carry%rhs(nv + 1:))
            correction = self%carry%rhs
        end associate
    end subroutine bring_back

    !> Compute T_v, T_w, S_v and S_w for the current chart, once.
    subroutine set_carry(self, bases)
        class(stage_type), intent(inout) :: self
        !> V and its dual (n, nv), W and its dual (n, nw), of the current chart.
        type(bases_type), intent(in) :: bases

        if (self%carry%is_current) return
        call set_gram(self%carry%formed_v, bases%v, self%carry%v)
        call set_gram(self%carry%formed_w, bases%w, self%carry%w)
        if (self%carry%is_plain_there .and. self%carry%is_plain_here) then
            call set_transpose(self%carry%v, self%carry%back_v)
            call set_transpose(self%carry%w, self%carry%back_w)
        else
            call set_gram(bases%v_dual, self%carry%formed_v_basis, self%carry%back_v)
            call set_gram(bases%w_dual, self%carry%formed_w_basis, self%carry%back_w)
        end if
        self%carry%is_current = .true.
    end subroutine set_carry

    !> B := A' for a square matrix; the intrinsic function allocates.
    pure subroutine set_transpose(a, b)
        real(wp), intent(in), contiguous :: a(:, :)
        real(wp), intent(inout), contiguous :: b(:, :)
        integer :: i, j

        do j = 1, size(a, 1)
            do i = 1, size(a, 1)
                b(i, j) = a(j, i)
            end do
        end do
    end subroutine set_transpose

    !> True if the chart has turned so little since the matrix was formed that the matrix can be reused. Corrections become smaller
    !> by the squared cosines of the angles between the tangent spaces: near right angles an iteration would stagnate and seem to
    !> converge.
    logical function is_near(self, bases)
        class(stage_type), intent(inout) :: self
        !> V and its dual (n, nv), W and its dual (n, nw), of the current chart.
        type(bases_type), intent(in) :: bases
        !> Limit of the sum of squared sines, a bound of the increase of the contraction due to the rotation of the chart.
        real(wp), parameter :: most = 0.1_wp

        is_near = .true.
        if (.not. self%carry%is_carried) return
        call self%set_carry(bases)
        is_near = abs(self%nv - sum(self%carry%v*transpose(self%carry%back_v))) <= most .and. &
            abs(self%nw - sum(self%carry%w*transpose(self%carry%back_w))) <= most
    end function is_near

    !> The residual of a stage at the current point, left in `rhs`. The stage's rates are ambient: their coordinates vd = V' rate_q
    !> and wd = W' rate_qd are corrected, and the parts that the chart ignores are copied from qd and qdd, which makes the rates
    !> good start values for other stages, on other charts too.
    subroutine find_residual(self, terms, velocity_basis, bases, qd, rate_q, rate_qd, change_q, iterate)
        class(stage_type), intent(inout) :: self
        type(terms_type), intent(in) :: terms
        type(velocity_basis_type), intent(inout) :: velocity_basis
        type(bases_type), intent(in) :: bases
        real(wp), intent(in), contiguous :: qd(:)
        real(wp), intent(inout), contiguous :: rate_q(:), rate_qd(:)
        !> Work space (n).
        real(wp), intent(out), contiguous :: change_q(:)
        !> Iterate near the manifold, with factors of its own instead of those of `velocity_basis`.
        type(stage_iterate_type), intent(inout), optional :: iterate

        associate (nv => self%nv)
            ! -r1 = V' (qd - rate_q), and the ambient rate with that vd and the rest of qd is qd - V (-r1).
            change_q = qd - rate_q
            self%rhs = 0.0_wp
            call add_transposed_product(bases%v_dual, change_q, 1.0_wp, self%rhs(:nv))
            rate_q = qd
            call add_product(bases%v, self%rhs(:nv), -1.0_wp, rate_q)
            ! qdd = D wd - R gamma = W wd - R (C W wd + gamma) and -r2 = D' (S + Q_A - M qdd).
            call add_transposed_product(bases%w_dual, rate_qd, 1.0_wp, self%rhs(nv + 1:))
            rate_qd = 0.0_wp
            call add_product(bases%w, self%rhs(nv + 1:), 1.0_wp, rate_qd)
            if (present(iterate)) then
                call iterate%correct_acceleration(terms%jacobian, terms%gamma, bases%x, rate_qd)
            else
                self%defect = terms%gamma
                call add_product(terms%jacobian, rate_qd, 1.0_wp, self%defect)
                call velocity_basis%subtract_right_inverse(bases%x, self%defect, rate_qd)
            end if
            self%force = terms%force
            call add_product(terms%mass, rate_qd, -1.0_wp, self%force)
            if (present(iterate)) then
                call iterate%remove_reaction(terms%jacobian, bases%x, self%force)
            else
                call velocity_basis%subtract_reaction(terms%jacobian, bases%x, self%force)
            end if
            self%rhs(nv + 1:) = 0.0_wp
            call add_transposed_product(bases%w, self%force, 1.0_wp, self%rhs(nv + 1:))
        end associate
    end subroutine find_residual

    !> Add a correction of vd and wd to rates.
    subroutine move_rates(self, bases, correction, rate_q, rate_qd, change_q, change_qd)
        class(stage_type), intent(in) :: self
        !> V (n, nv) and W (n, nw), the correction (nv + nw).
        type(bases_type), intent(in) :: bases
        real(wp), intent(in), contiguous :: correction(:)
        real(wp), intent(inout), contiguous :: rate_q(:), rate_qd(:)
        !> Changes of the rates (n).
        real(wp), intent(out), contiguous :: change_q(:), change_qd(:)

        associate (nv => self%nv)
            change_q = 0.0_wp
            call add_product(bases%v, correction(:nv), 1.0_wp, change_q)
            change_qd = 0.0_wp
            call add_product(bases%w, correction(nv + 1:nv + self%nw), 1.0_wp, change_qd)
            rate_q = rate_q + change_q
            rate_qd = rate_qd + change_qd
        end associate
    end subroutine move_rates

    !> The residual of the last `find_residual`, to solve for several stages at once: the first entries of `residual`.
    pure subroutine get_residual(self, residual)
        class(stage_type), intent(in) :: self
        real(wp), intent(inout), contiguous :: residual(:)

        residual(:self%nv + self%nw) = self%rhs
    end subroutine get_residual

    !> Filter errors (e_q, e_qd) by the factored matrix: right sides V' e_q and D' M D W' e_qd. If Newton's iteration with an old
    !> matrix contracts by theta, the filtered error differs from that of the exact matrix by at most a part theta/(1 - theta).
    subroutine filter(self, bases, error_q, error_qd)
        class(stage_type), intent(inout) :: self
        !> V and its dual (n, nv), W and its dual (n, nw).
        type(bases_type), intent(in) :: bases
        real(wp), intent(inout), contiguous :: error_q(:), error_qd(:)

        associate (nv => self%nv, w => self%force(:self%nw), carried => self%carry%rhs(:self%nw))
            self%rhs = 0.0_wp
            call add_transposed_product(bases%v_dual, error_q, 1.0_wp, self%rhs(:nv))
            w = 0.0_wp
            call add_transposed_product(bases%w_dual, error_qd, 1.0_wp, w)
            if (self%carry%is_carried) then
                call self%set_carry(bases)
                carried = 0.0_wp
                call add_product(self%carry%w, w, 1.0_wp, carried)
                w = 0.0_wp
                call add_product(self%origin_mass, carried, 1.0_wp, w)
                call add_transposed_product(self%carry%w, w, 1.0_wp, self%rhs(nv + 1:))
            else
                call add_product(self%origin_mass, w, 1.0_wp, self%rhs(nv + 1:))
            end if
            call self%solve(bases)
            error_q = 0.0_wp
            call add_product(bases%v, self%rhs(:nv), 1.0_wp, error_q)
            error_qd = 0.0_wp
            call add_product(bases%w, self%rhs(nv + 1:), 1.0_wp, error_qd)
        end associate
    end subroutine filter

    !> The error of a velocity that the chart restores from one whose increment has the error W w: D w = W w - R C W w. It grows
    !> with the angle between the tangent spaces, without bound as the chart becomes singular.
    subroutine restore_error(self, jacobian, velocity_basis, x_basis, error_qd)
        class(stage_type), intent(inout) :: self
        !> C (m, n) of the point, and R there; X (n, m).
        real(wp), intent(in), contiguous :: jacobian(:, :), x_basis(:, :)
        type(velocity_basis_type), intent(inout) :: velocity_basis
        !> W w, then D w.
        real(wp), intent(inout), contiguous :: error_qd(:)

        self%defect = 0.0_wp
        call add_product(jacobian, error_qd, 1.0_wp, self%defect)
        call velocity_basis%subtract_right_inverse(x_basis, self%defect, error_qd)
    end subroutine restore_error

    !> An estimate of 1/cond of the factored matrix.
    real(wp) function reciprocal_condition(self)
        class(stage_type), intent(inout) :: self

        reciprocal_condition = self%lu%reciprocal_condition()
    end function reciprocal_condition

    !> The Newton matrix, its blocks, and the transformation to the chart where it was formed.
    subroutine pack_state(self, pack)
        class(stage_type), intent(inout) :: self
        type(pack_type), intent(inout) :: pack
        real(wp) :: ratios(most_pairs, 2)
        integer :: k, n_pairs

        ! A restored chart has not received the pairs of its stepper yet.
        n_pairs = self%n_pairs
        ratios(:, 1) = real(self%pairs, wp)
        ratios(:, 2) = aimag(self%pairs)
        call pack%item(n_pairs)
        call pack%fixed(ratios(:, 1))
        call pack%fixed(ratios(:, 2))
        if (n_pairs > 0) call self%expect_pairs(cmplx(ratios(:n_pairs, 1), ratios(:n_pairs, 2), wp))
        call pack%item(self%is_outdated)
        call pack%item(self%r1_v, self%r1_w, self%block_wv, self%block_ww, self%origin_mass)
        call pack%item(self%ha)
        call pack%item(self%carry%is_carried, self%carry%is_current, self%carry%is_plain_there, self%carry%is_plain_here)
        call pack%item(self%carry%v, self%carry%w, self%carry%formed_v, self%carry%formed_w, self%carry%back_v)
        call pack%item(self%carry%back_w, self%carry%formed_v_basis, self%carry%formed_w_basis)
        call self%lu%pack_state(pack)
        do k = 1, self%n_pairs
            call self%pair_lu(k)%pack_state(pack)
        end do
    end subroutine pack_state
end module tandem_chart_dense_newton_matrix
