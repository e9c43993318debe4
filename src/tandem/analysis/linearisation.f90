! SPDX-License-Identifier: MIT
!> The linear equations of small motions about a point, in tangent-space coordinates, without multipliers and constraints.
!>
!> With V of null(Phi_q), W of null(C), orthonormal, and R = C^+, so that W'R = 0, small motions are dq = V dv, dqd = W dw + G dv:
!>
!>   G = -R vel_q V,   Hv = -R (acc_q V + acc_qd G),   Hw = -R acc_qd W,
!>   (W'M W) dwd = -W' [(dyn_q V + dyn_qd G + M Hv) dv + (dyn_qd W + M Hw) dw],
!>   A = [V'G, V'W; Av, Aw].
!>
!> About a steady motion q(t) = T(t) q0 of a group of symmetries, with T' = L T, the matrix is constant in co-rotating coordinates:
!>
!>   A = [V'(G - L V), V'W; Av - W'L G, Aw - W'L W].
!>
!> The rates of the steady motion follow from the point: those of the symmetries with X q0 = qd0 and L qd0 = qdd0. An equilibrium is
!> the case without rates. Otherwise A is that of the instant.
module tandem_analysis_linearisation
    use tandem_analysis_drift, only: find_drift
    use tandem_analysis_point, only: point_type
    use tandem_analysis_spectrum, only: spectrum_type
    use tandem_analysis_symmetry, only: symmetry_type
    use tandem_error, only: error_type, set_error, to_text
    use tandem_kinds, only: wp
    use tandem_linalg_singular, only: singular_type
    use tandem_model, only: model_type
    use tandem_model_check, only: check_model
    use tandem_status, only: status_ok, status_work_limit
    implicit none (type, external)
    private

    public :: linearisation_type, at_equilibrium, in_steady_motion, at_an_instant, kind_name, most_coordinates

    !> Kinds of the motion at the point.
    integer, parameter :: at_equilibrium = 1, in_steady_motion = 2, at_an_instant = 3
    character(len=13), parameter :: kind_name(3) = [character(len=13) :: 'equilibrium', 'steady motion', 'instant']

    !> Matrices of more coordinates take minutes and gigabytes.
    integer, parameter :: most_coordinates = 1000

    type :: linearisation_type
        !> One of the three above.
        integer :: kind = at_an_instant
        !> Dimensions are n - nh of v, n - m of w, redundant rows not counted.
        integer :: nv = 0, nw = 0
        !> The point (n) and its accelerations.
        real(wp) :: t = 0.0_wp
        real(wp), allocatable :: q(:), qd(:), qdd(:)
        !> A (nv + nw, nv + nw).
        real(wp), allocatable :: a(:, :)
        !> dq = V dv, dqd = G dv + W dw: V, G (n, nv), W (n, nw) in the model's own coordinates.
        real(wp), allocatable :: v(:, :), g(:, :), w(:, :)
        !> dv = V' dq, dw = W' dqd: V' (nv, n) and W' (nw, n) for the model's own coordinates.
        real(wp), allocatable :: dual_w(:, :), dual_v(:, :)
        !> The symmetries, and the rates of the fields along which the motion continues.
        type(symmetry_type) :: symmetry
        real(wp), allocatable :: rates(:)
        !> Residual of the rates of an equilibrium or a steady motion at the point, over the size of its terms.
        real(wp) :: residual = 0.0_wp
        !> True if the equations depend on the time in a way that no symmetry compensates: A is then frozen at t.
        logical :: depends_on_time = .false.
        !> True if all gradients were the model's own; differences leave errors of some 1e-10 of A's norm.
        logical :: has_gradients = .true.
        !> Eigenvalues and modes.
        type(spectrum_type) :: spectrum
    contains
        procedure :: make
        procedure, private :: form, find_rates, go_along, find_spectrum
    end type linearisation_type

    !> Residuals of the rates of a steady motion up to this part of the size of their terms are rounding.
    real(wp), parameter :: steady_bound = 1.0e-9_wp
    !> Errors of entries of A over the sizes of all their terms, in units of their rounding, and the rounding of differences.
    real(wp), parameter :: rounding_of_terms = 4.0_wp, rounding_of_differences = 1.0e-11_wp

contains

    !> Linearise a model at a state that satisfies its constraints. Errors: work_limit for more than `most_coordinates`,
    !> invalid_model, and statuses of evaluating the model.
    subroutine make(self, model, t, q, qd, error, names)
        class(linearisation_type), intent(out) :: self
        class(model_type), intent(inout), target :: model
        real(wp), intent(in) :: t, q(:), qd(:)
        type(error_type), allocatable, intent(out) :: error
        !> Names of the fields along which the motion may continue; all if absent.
        character(len=*), intent(in), optional :: names(:)
        type(point_type), allocatable :: point
        !> The sizes of the terms in the sums for entries of A, the sizes of all terms that cause errors, and bounds on errors.
        real(wp), allocatable :: terms(:, :), all_terms(:, :), uncertainty(:, :)
        integer :: stat

        call check_model(model, error)
        if (allocated(error)) return
        if (model%n > most_coordinates) then
            call set_error(error, status_work_limit, 'the model "'//model%name//'" has '//to_text(model%n)//' coordinates, too '// &
                'many for matrices that are full ('//to_text(most_coordinates)//' at most)', &
                'compute eigenvalues near a shift (nearest_type, tandem linearise --near)')
            return
        end if
        call model%set_time_scale(t, q, qd)
        allocate (point)
        call point%initialize(model)
        self%has_gradients = point%has_gradients
        self%t = t
        self%q = q
        self%qd = qd
        call self%symmetry%find(point, t, q, qd, stat, names)
        call point%describe(stat, 'cannot be evaluated at states around the point', error)
        if (allocated(error)) return
        self%depends_on_time = .not. allocated(self%symmetry%rates_of_time)
        call point%evaluate(t, q, qd, stat)
        if (stat == status_ok) then
            call point%make_bases()
            call point%refuse_friction(stat)
        end if
        if (stat == status_ok) call point%solve_dynamics(stat)
        if (stat == status_ok) call point%differentiate(stat)
        call point%describe(stat, 'cannot be linearised at the point', error)
        if (allocated(error)) return
        self%qdd = point%qdd
        call self%form(point, terms, all_terms)
        call self%find_rates(point)
        if (self%kind == in_steady_motion) call self%go_along(point, terms, all_terms)
        uncertainty = rounding_of_terms*merge(epsilon(1.0_wp), rounding_of_differences, self%has_gradients)*all_terms
        ! An error of the point of this relative size changes each term as much.
        if (self%kind /= at_an_instant) uncertainty = uncertainty + rounding_of_terms*self%residual*terms
        ! Balances leave rounding if the terms of an entry cancel: its square root would be an eigenvalue.
        if (self%has_gradients) then
            where (abs(self%a) <= 100*epsilon(1.0_wp)*terms)
                uncertainty = max(uncertainty, abs(self%a))
                self%a = 0.0_wp
            end where
        end if
        call self%find_spectrum(point, uncertainty, error)
    end subroutine make

    !> A of the point, and the sizes of the terms of its entries.
    subroutine form(self, point, terms, all_terms)
        class(linearisation_type), intent(inout) :: self
        type(point_type), intent(in) :: point
        real(wp), allocatable, intent(out) :: terms(:, :)
        !> Including terms that contribute only rounding of bases and inverses.
        real(wp), allocatable, intent(out) :: all_terms(:, :)
        real(wp), allocatable :: g(:, :), by_v(:, :), by_w(:, :), none(:, :)
        integer :: i

        associate (n => point%n, nv => point%nv, nw => point%nw, v => point%v, w => point%w)
            allocate (g(n, nv), by_v(n, nv), by_w(n, nw))
            allocate (none(n, nw), source=0.0_wp)
            call point%apply_right_inverse(-matmul(point%velocity_q, v), g)
            call point%vary_acceleration(v, g, by_v)
            call point%vary_acceleration(none, w, by_w)
            self%nv = nv
            self%nw = nw
            if (allocated(self%a)) deallocate (self%a)
            allocate (self%a(nv + nw, nv + nw))
            self%a(:nv, :nv) = matmul(transpose(v), g)
            self%a(:nv, nv + 1:) = matmul(transpose(v), w)
            self%a(nv + 1:, :nv) = matmul(transpose(w), by_v)
            self%a(nv + 1:, nv + 1:) = matmul(transpose(w), by_w)
            allocate (terms(nv + nw, nv + nw), source=0.0_wp)
            terms(:nv, :nv) = matmul(transpose(abs(v)), abs(g))
            call point%size_of_acceleration(abs(v), abs(g), terms(nv + 1:, :nv))
            call point%size_of_acceleration(none, abs(w), terms(nv + 1:, nv + 1:))
            allocate (all_terms, source=terms)
            all_terms(:nv, nv + 1:) = matmul(transpose(abs(v)), abs(w))
            call point%add_hidden_sizes(abs(v), abs(g), self%a(nv + 1:, :nv), all_terms(:, :nv))
            call point%add_hidden_sizes(none, abs(w), self%a(nv + 1:, nv + 1:), all_terms(:, nv + 1:))
            self%v = v
            self%g = g
            self%w = w
            self%dual_v = transpose(v)
            self%dual_w = transpose(w)
            do i = 1, n
                self%v(i, :) = point%scale(i)*v(i, :)
                self%g(i, :) = point%scale(i)*g(i, :)
                self%w(i, :) = point%scale(i)*w(i, :)
                self%dual_v(:, i) = self%dual_v(:, i)/point%scale(i)
                self%dual_w(:, i) = self%dual_w(:, i)/point%scale(i)
            end do
        end associate
    end subroutine form

    !> Find the rates of the symmetries along which the motion continues, if there are any.
    subroutine find_rates(self, point)
        class(linearisation_type), intent(inout) :: self
        type(point_type), intent(in) :: point
        real(wp), allocatable :: rates(:)
        real(wp) :: residual
        logical :: turns
        integer :: k

        self%kind = at_an_instant
        self%rates = spread(0.0_wp, 1, size(self%symmetry%motions))
        self%residual = huge(1.0_wp)
        if (.not. allocated(self%symmetry%rates_of_time)) then
            ! The equations may still be those of rest, as long as they do not change.
            self%residual = residual_of(self, point, self%rates)
            return
        end if
        ! At rest, by spins and translations, or with rotations of the world if these are not sufficient. So the frame rotates only
        ! if necessary: a spin about a body's own axis and a rotation of the world about the same line are one motion in two frames.
        do k = 0, 2
            turns = k == 2
            call fit(self, point, merge(0, size(self%symmetry%rates, 2), k == 0), turns, rates)
            residual = residual_of(self, point, rates)
            if (.not. (residual < self%residual)) cycle
            if (k > 0 .and. self%residual <= steady_bound) cycle
            self%residual = residual
            self%rates = rates
        end do
        if (self%residual > steady_bound) then
            self%rates = 0.0_wp
        else
            self%kind = merge(in_steady_motion, at_equilibrium, any(abs(self%rates) > 0.0_wp))
        end if
    end subroutine find_rates

    !> Rates that fit qd = X q and qdd = L qd best.
    subroutine fit(self, point, n_allowed, turns, rates)
        class(linearisation_type), intent(in) :: self
        type(point_type), intent(in) :: point
        !> Number of symmetries that may be used; true if those that turn the world are among them.
        integer, intent(in) :: n_allowed
        logical, intent(in) :: turns
        real(wp), allocatable, intent(out) :: rates(:)
        real(wp), allocatable :: columns(:, :), c(:)
        real(wp) :: b(2*point%n), length
        type(singular_type) :: svd
        integer :: k

        associate (symmetry => self%symmetry, n => point%n, s => point%scale)
            rates = symmetry%rates_of_time
            allocate (columns(2*n, n_allowed), c(n_allowed), source=0.0_wp)
            b(:n) = (point%qd - symmetry%field(rates, point%q))/s
            b(n + 1:) = (point%qdd - symmetry%turned(rates, point%qd))/(point%rate*s)
            do k = 1, n_allowed
                if (.not. turns .and. any(symmetry%motions%turns_world .and. abs(symmetry%rates(:, k)) > 0.0_wp)) cycle
                columns(:n, k) = symmetry%field(symmetry%rates(:, k), point%q)/s
                columns(n + 1:, k) = symmetry%turned(symmetry%rates(:, k), point%qd)/(point%rate*s)
                ! A symmetry without effect here has columns of rounding.
                length = norm2(columns(:, k))
                if (length < 1.0e-12_wp) columns(:, k) = 0.0_wp
            end do
            if (n_allowed == 0) return
            call svd%allocate(2*n, n_allowed)
            call svd%factor(columns)
            call svd%solve(b, c)
            where (abs(c) <= 1.0e-14_wp*maxval(abs(c))) c = 0.0_wp
            rates = rates + matmul(symmetry%rates, c)
        end associate
    end subroutine fit

    !> Residual of (vd, wd) for given rates, over the size of their terms: a relative error of the point of this size would explain
    !> it.
    real(wp) function residual_of(self, point, rates) result(residual)
        class(linearisation_type), intent(in) :: self
        type(point_type), intent(in) :: point
        real(wp), intent(in) :: rates(:)
        real(wp), dimension(point%n) :: x, y
        real(wp), dimension(self%nv + self%nw) :: left, sizes
        real(wp) :: of_q, of_qd

        x = (point%qd - self%symmetry%field(rates, point%q))/point%scale
        y = (point%qdd - self%symmetry%turned(rates, point%qd))/point%scale
        left = [matmul(transpose(point%v), x), matmul(transpose(point%w), y)]
        of_q = max(1.0_wp, maxval(abs(point%q/point%scale)))
        of_qd = max(point%rate, maxval(abs(point%qd/point%scale)))
        sizes = sum(abs(self%a(:, :self%nv)), dim=2)*of_q + sum(abs(self%a(:, self%nv + 1:)), dim=2)*of_qd
        ! Rates of coordinates, then of velocities.
        sizes(:self%nv) = max(sizes(:self%nv), point%rate)
        sizes(self%nv + 1:) = max(sizes(self%nv + 1:), point%rate**2)
        residual = max(maxval(abs(left)/sizes), maxval(abs(x))/of_qd, &
            maxval(abs(y))/(of_qd**2 + maxval([of_qd*sizes(:self%nv), sizes(self%nv + 1:)])))
    end function residual_of

    !> Transform A to co-rotating coordinates of the steady motion.
    subroutine go_along(self, point, terms, all_terms)
        class(linearisation_type), intent(inout) :: self
        type(point_type), intent(in) :: point
        real(wp), intent(inout) :: terms(:, :), all_terms(:, :)
        real(wp), allocatable :: l(:, :), g(:, :), more(:, :)
        integer :: j

        allocate (l, source=self%symmetry%matrix(self%rates, point%n))
        allocate (g, source=self%g)
        do j = 1, point%n
            l(:, j) = l(:, j)*point%scale(j)/point%scale
            g(j, :) = g(j, :)/point%scale(j)
        end do
        associate (nv => self%nv, v => point%v, w => point%w, a => self%a)
            a(:nv, :nv) = a(:nv, :nv) - matmul(transpose(v), matmul(l, v))
            a(nv + 1:, :nv) = a(nv + 1:, :nv) - matmul(transpose(w), matmul(l, g))
            a(nv + 1:, nv + 1:) = a(nv + 1:, nv + 1:) - matmul(transpose(w), matmul(l, w))
            allocate (more(size(a, 1), size(a, 1)), source=0.0_wp)
            more(:nv, :nv) = matmul(transpose(abs(v)), matmul(abs(l), abs(v)))
            more(nv + 1:, :nv) = matmul(transpose(abs(w)), matmul(abs(l), abs(g)))
            more(nv + 1:, nv + 1:) = matmul(transpose(abs(w)), matmul(abs(l), abs(w)))
            terms = terms + more
            all_terms = all_terms + more
        end associate
    end subroutine go_along

    !> Compute eigenvalues, with known ones due to symmetries.
    subroutine find_spectrum(self, point, uncertainty, error)
        class(linearisation_type), intent(inout) :: self
        type(point_type), intent(in) :: point
        real(wp), intent(in) :: uncertainty(:, :)
        type(error_type), allocatable, intent(out) :: error
        real(wp), allocatable :: directions(:, :), drift(:, :), dq(:, :), dqd(:, :)
        real(wp) :: x(point%n), y(point%n), rate
        integer :: k

        associate (rates => self%symmetry%rates)
            allocate (directions(self%nv + self%nw, size(rates, 2)))
            do k = 1, size(rates, 2)
                x = self%symmetry%field(rates(:, k), self%q)
                y = self%symmetry%turned(rates(:, k), self%qd)
                directions(:self%nv, k) = matmul(self%dual_v, x)
                directions(self%nv + 1:, k) = matmul(self%dual_w, y)
            end do
        end associate
        if (self%kind == at_an_instant) directions = directions(:, :0)
        rate = 0.0_wp
        if (self%kind == in_steady_motion) then
            allocate (dq(point%n, self%nv + self%nw), dqd(point%n, self%nv + self%nw), source=0.0_wp)
            dq(:, :self%nv) = self%v
            dqd(:, :self%nv) = self%g
            dqd(:, self%nv + 1:) = self%w
            call find_drift(self%symmetry, self%rates, self%q, self%qd, self%a, dq, dqd, drift, rate)
        else
            allocate (drift(self%nv + self%nw, 0))
        end if
        call self%spectrum%find(self%a, uncertainty, self%nv, directions, drift, rate, &
            merge(1.0e-12_wp, 1.0e-8_wp, self%has_gradients), error)
        if (allocated(error)) return
        call self%spectrum%make_shapes(self%v, self%g, self%w)
    end subroutine find_spectrum
end module tandem_analysis_linearisation
