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
!> `tandem_model_derivatives`. One factorisation serves every stage of a step with the same ha = h a_ii.
module tandem_tangent_stage
    use tandem_kinds, only: wp
    use tandem_linalg_kernels, only: add_product, add_transposed_product, set_gram, set_product
    use tandem_linalg_lu, only: lu_type
    use tandem_model_derivatives, only: derivatives_type
    use tandem_model_terms, only: terms_type
    use tandem_status, only: status_newton_failed, status_ok
    implicit none (type, external)
    private

    public :: stage_type

    type :: stage_type
        !> The blocks of (76), (77): R1_v (nv, nv), R1_w (nv, nw), R2_v (n, nv), R2_w (n, nw).
        real(wp), allocatable :: r1_v(:, :), r1_w(:, :), r2_v(:, :), r2_w(:, :)
        !> Fbar (n, nv) and Pbar (n, nv) of the point of the last `form`.
        real(wp), allocatable :: fbar(:, :), pbar(:, :)
        integer, private :: n = 0, nv = 0, nw = 0
        real(wp), allocatable, private :: mr(:, :), gradient_q(:, :), gradient_qd(:, :), mass_d(:, :), work_mv(:, :)
        !> D (n, nw) and D' M D (nw, nw) of the last `factor`.
        real(wp), allocatable, private :: origin_d(:, :), origin_mass(:, :)
        real(wp), allocatable, private :: matrix(:, :), block_wv(:, :), block_ww(:, :), rhs(:), force(:)
        type(lu_type), private :: lu
    contains
        procedure :: allocate => allocate_stage
        procedure :: form
        procedure :: factor
        procedure :: correct
        procedure :: filter
        procedure :: reciprocal_condition
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
            self%rhs, self%force, self%origin_d, self%origin_mass)
        allocate (self%r1_v(nv, nv), self%r1_w(nv, nw), self%r2_v(n, nv), self%r2_w(n, nw), self%fbar(n, nv), &
            self%pbar(n, nv), self%mr(n, m), self%gradient_q(n, n), self%gradient_qd(n, n), self%mass_d(n, nw), &
            self%work_mv(m, nv), self%matrix(nv + nw, nv + nw), self%block_wv(nw, nv), self%block_ww(nw, nw), &
            self%rhs(nv + nw), self%force(n), self%origin_d(n, nw), self%origin_mass(nw, nw), source=0.0_wp)
        call self%lu%allocate(nv + nw)
    end subroutine allocate_stage

    !> Form the blocks at the current point.
    subroutine form(self, terms, derivatives, v_basis, v_dual, u_basis, b_phi, null_space, right_inverse)
        class(stage_type), intent(inout) :: self
        !> The terms and derivatives of the point.
        type(terms_type), intent(in) :: terms
        type(derivatives_type), intent(in) :: derivatives
        !> V as a basis and as the dual that gives coordinates (n, nv), U (n, nh), B Phi_q (nh, n) at the point.
        real(wp), intent(in), contiguous :: v_basis(:, :), v_dual(:, :), u_basis(:, :), b_phi(:, :)
        !> D (n, nw) and R (n, m) at the point.
        real(wp), intent(in), contiguous :: null_space(:, :), right_inverse(:, :)
        integer :: j, l

        ! Fbar = (I - U B Phi_q) V (54).
        self%fbar = v_basis
        do j = 1, self%nv
            do l = 1, size(u_basis, 2)
                self%fbar(:, j) = self%fbar(:, j) - u_basis(:, l)*dot_product(b_phi(l, :), v_basis(:, j))
            end do
        end do
        ! Pbar = -R (C qd - nu)_q Fbar (75).
        call set_product(derivatives%velocity_q, self%fbar, self%work_mv)
        call set_product(right_inverse, self%work_mv, self%pbar)
        self%pbar = -self%pbar
        ! The gradients of M qdd + C' lambda - S - Q_A along the manifold of accelerations.
        call set_product(terms%mass, right_inverse, self%mr)
        call set_product(self%mr, derivatives%acceleration_q, self%gradient_q)
        self%gradient_q = derivatives%dynamics_q - self%gradient_q
        call set_product(self%mr, derivatives%acceleration_qd, self%gradient_qd)
        self%gradient_qd = derivatives%dynamics_qd - self%gradient_qd
        call set_product(self%gradient_qd, null_space, self%r2_w)
        call set_product(self%gradient_q, self%fbar, self%r2_v)
        do j = 1, self%nv
            call add_product(self%gradient_qd, self%pbar(:, j), 1.0_wp, self%r2_v(:, j))
        end do
        call set_gram(v_dual, self%pbar, self%r1_v)
        self%r1_v = -self%r1_v
        call set_gram(v_dual, null_space, self%r1_w)
        self%r1_w = -self%r1_w
        ! D' M D, D' R2_v and D' R2_w.
        call set_product(terms%mass, null_space, self%mass_d)
        call set_gram(null_space, self%r2_v, self%block_wv)
        call set_gram(null_space, self%r2_w, self%block_ww)
    end subroutine form

    !> Factor the reduced Newton matrix for ha = h a_ii.
    subroutine factor(self, null_space, ha, stat)
        class(stage_type), intent(inout) :: self
        !> D (n, nw) of the last `form`.
        real(wp), intent(in), contiguous :: null_space(:, :)
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
            self%origin_d = null_space
            call set_gram(null_space, self%mass_d, self%origin_mass)
            do j = 1, nw
                do i = 1, nw
                    a(nv + i, nv + j) = ha*self%block_ww(i, j) + self%origin_mass(i, j)
                end do
            end do
        end associate
        call self%lu%factor(self%matrix, stat)
        stat = merge(status_ok, status_newton_failed, stat == 0)
    end subroutine factor

    !> One Newton correction at the current point. The stage's rates are ambient: their coordinates vd = V' rate_q and
    !> wd = W' rate_qd are corrected, and the parts that the chart ignores are set to those of qd and qdd, which makes the rates
    !> good start values for other stages, on other charts too.
    subroutine correct(self, terms, v_basis, v_dual, w_dual, null_space, right_inverse, qd, rate_q, rate_qd, &
        change_q, change_qd)
        class(stage_type), intent(inout) :: self
        type(terms_type), intent(in) :: terms
        !> V (n, nv), the duals of V (n, nv) and W (n, nw), D (n, nw), R (n, m).
        real(wp), intent(in), contiguous :: v_basis(:, :), v_dual(:, :), w_dual(:, :), null_space(:, :), right_inverse(:, :)
        !> The velocity restored at the stage (n).
        real(wp), intent(in), contiguous :: qd(:)
        real(wp), intent(inout), contiguous :: rate_q(:), rate_qd(:)
        !> V times the correction of vd and D times that of wd (n).
        real(wp), intent(out), contiguous :: change_q(:), change_qd(:)

        associate (nv => self%nv)
            ! -r1 = V' (qd - rate_q), and the ambient rate with that vd and the rest of qd is qd - V (-r1).
            change_q = qd - rate_q
            self%rhs = 0.0_wp
            call add_transposed_product(v_dual, change_q, 1.0_wp, self%rhs(:nv))
            rate_q = qd
            call add_product(v_basis, self%rhs(:nv), -1.0_wp, rate_q)
            ! qdd = D wd - R gamma and -r2 = D' (S + Q_A - M qdd).
            call add_transposed_product(w_dual, rate_qd, 1.0_wp, self%rhs(nv + 1:))
            rate_qd = 0.0_wp
            call add_product(null_space, self%rhs(nv + 1:), 1.0_wp, rate_qd)
            call add_product(right_inverse, terms%gamma, -1.0_wp, rate_qd)
            self%force = terms%force
            call add_product(terms%mass, rate_qd, -1.0_wp, self%force)
            self%rhs(nv + 1:) = 0.0_wp
            call add_transposed_product(null_space, self%force, 1.0_wp, self%rhs(nv + 1:))
            call self%lu%solve(self%rhs)
            change_q = 0.0_wp
            call add_product(v_basis, self%rhs(:nv), 1.0_wp, change_q)
            change_qd = 0.0_wp
            call add_product(null_space, self%rhs(nv + 1:), 1.0_wp, change_qd)
            rate_q = rate_q + change_q
            rate_qd = rate_qd + change_qd
        end associate
    end subroutine correct

    !> Send errors (e_q, e_qd) through the factored matrix: right sides V' e_q and D' M D W' e_qd.
    subroutine filter(self, v_basis, v_dual, w_dual, error_q, error_qd)
        class(stage_type), intent(inout) :: self
        !> V (n, nv) and the duals of V and W (n, nw).
        real(wp), intent(in), contiguous :: v_basis(:, :), v_dual(:, :), w_dual(:, :)
        real(wp), intent(inout), contiguous :: error_q(:), error_qd(:)
        real(wp) :: w(self%nw)

        associate (nv => self%nv)
            self%rhs = 0.0_wp
            call add_transposed_product(v_dual, error_q, 1.0_wp, self%rhs(:nv))
            w = 0.0_wp
            call add_transposed_product(w_dual, error_qd, 1.0_wp, w)
            call add_product(self%origin_mass, w, 1.0_wp, self%rhs(nv + 1:))
            call self%lu%solve(self%rhs)
            error_q = 0.0_wp
            call add_product(v_basis, self%rhs(:nv), 1.0_wp, error_q)
            error_qd = 0.0_wp
            call add_product(self%origin_d, self%rhs(nv + 1:), 1.0_wp, error_qd)
        end associate
    end subroutine filter

    !> An estimate of 1/cond of the factored matrix.
    real(wp) function reciprocal_condition(self)
        class(stage_type), intent(inout) :: self

        reciprocal_condition = self%lu%reciprocal_condition()
    end function reciprocal_condition
end module tandem_tangent_stage
