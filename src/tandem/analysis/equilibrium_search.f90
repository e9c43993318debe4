! SPDX-License-Identifier: MIT
!> Search for equilibria (`equilibrium.f90`) and steady motions near a state: at rest, or in a motion that continues unchanged.
!>
!> A steady motion follows fields X of symmetries at constant rates, an equilibrium none. Unknowns are the coordinates, and rates
!> unless they are fixed:
!>
!>   Phi(q) = 0,   C X q = nu,   W' (M L X q - S - Q_A) = 0,   and rates of fields that are held at values.
!>
!> Newton's iteration with corrections of least norm leads to the nearest one of a family, stable or not; it is damped by the
!> natural monotonicity test, in which units do not matter (P. Deuflhard, Newton Methods for Nonlinear Problems, 2004, section 4.4).
!> A steady motion is approached by least squares of the residual with a bound on the step (D. W. Marquardt, J. SIAM 11, 1963).
!> From any steady motion steps along its family lead to the one nearest to the start. The work is bounded.
module tandem_analysis_equilibrium_search
    use tandem_analysis_closeness, only: find_step_nearer, squared_distance
    use tandem_analysis_equilibrium, only: moved_reason, settle
    use tandem_analysis_point, only: point_type
    use tandem_analysis_sparse_steady, only: find_steady_sparsely
    use tandem_analysis_symmetry, only: symmetry_type
    use tandem_error, only: error_type, set_error, to_text
    use tandem_kinds, only: wp
    use tandem_linalg_cholesky, only: cholesky_type
    use tandem_linalg_lu, only: lu_type
    use tandem_linalg_singular, only: singular_type
    use tandem_model, only: model_type
    use tandem_model_check, only: check_model
    use tandem_status, only: status_invalid_option, status_no_equilibrium, status_ok
    implicit none (type, external)
    private

    public :: equilibrium_search_type

    type :: equilibrium_search_type
        !> The solution (n), and the rates of the fields of `symmetry` along which it continues.
        real(wp), allocatable :: q(:), qd(:), rates(:)
        type(symmetry_type) :: symmetry
        !> Newton's iterations, and steps along the forces.
        integer :: iterations = 0, relaxations = 0
        !> Dimension of the family: the number of directions to other solutions, at least.
        integer :: n_free = 0
        !> Largest displacement of a coordinate, in scaled coordinates.
        real(wp) :: moved = 0.0_wp
        !> The fields with fixed rates, and the rates.
        integer, allocatable, private :: held(:)
        real(wp), allocatable, private :: held_at(:)
        !> Factors of the residuals of Phi and of C qd - nu: reciprocal lengths of their rows at the point of the derivatives, and
        !> for the latter also the time scale.
        real(wp), allocatable, private :: row_scale(:), rate_row_scale(:)
    contains
        procedure :: find_equilibrium, find_steady_motion
        procedure, private :: iterate, approach, go_nearer, hold, form, look, refuse
    end type equilibrium_search_type

    !> From the first number of coordinates on the sparse form is used for models that have one, without information about families;
    !> full matrices above the second number take minutes.
    integer, parameter :: large = 250, most_full = 1000
    !> Most iterations, and steps along a family.
    integer, parameter :: most_iterations = 60
    integer, parameter :: most_steps_nearer = 100
    !> Bases and factors of many coordinates are expensive: their number is limited to this over n^2, and at least to `least_bases`.
    real(wp), parameter :: most_bases = 2.0e7_wp
    integer, parameter :: least_bases = 60
    !> The longest step, in scaled coordinates, and one too short to count.
    real(wp), parameter :: longest = 0.5_wp, no_step = 1.0e-8_wp
    !> Forces are in balance if their residual is at most this part of their terms.
    real(wp), parameter :: balance_bound = 1.0e-9_wp

contains

    !> The equilibrium near q. Errors: no_equilibrium, invalid_model, and statuses of evaluating the model.
    subroutine find_equilibrium(self, model, t, q, error)
        class(equilibrium_search_type), intent(out) :: self
        class(model_type), intent(inout), target :: model
        !> Time, at which functions of it are frozen, and coordinates (n), which need not satisfy the constraints.
        real(wp), intent(in) :: t, q(:)
        type(error_type), allocatable, intent(out) :: error

        call check_model(model, error)
        if (allocated(error)) return
        call no_fields(self, model%n)
        call model%set_time_scale(t, q, self%qd)
        self%q = q
        call settle(model, t, self%q, self%iterations, self%relaxations, self%n_free, error)
        if (.not. allocated(error)) self%moved = maxval(abs((self%q - q)/model%scales()))
    end subroutine find_equilibrium

    !> The steady motion near (q, qd), along all symmetries or along named fields. If none is fixed, their rates stay those of qd,
    !> if possible; else they change too. Of a family it is the one nearest to (q, qd).
    subroutine find_steady_motion(self, model, t, q, qd, error, names, held, held_at)
        class(equilibrium_search_type), intent(out) :: self
        class(model_type), intent(inout), target :: model
        real(wp), intent(in) :: t, q(:), qd(:)
        type(error_type), allocatable, intent(out) :: error
        character(len=*), intent(in), optional :: names(:)
        !> Single fields, and their fixed rates; the others are free. Both or neither.
        character(len=*), intent(in), optional :: held(:)
        real(wp), intent(in), optional :: held_at(:)
        type(point_type), allocatable :: point
        real(wp), allocatable :: rates(:), found(:), found_rates(:)
        real(wp) :: nearest, distance
        integer :: stat, attempt, n_free

        call check_model(model, error)
        if (allocated(error)) return
        call model%set_time_scale(t, q, qd)
        if (model%n >= large .and. allocated(model%pattern) .and. .not. any(model%is_idle())) then
            call no_fields(self, model%n)
            self%q = q
            self%qd = qd
            call find_steady_sparsely(model, t, self%q, self%qd, self%iterations, error, names, held, held_at)
            if (.not. allocated(error)) self%moved = maxval(abs((self%q - q)/model%scales()))
            if (.not. allocated(error) .or. model%n > most_full) return
            deallocate (self%held, self%held_at, self%symmetry%motions, self%symmetry%rates, error)
        end if
        allocate (self%held(0), self%held_at(0), point)
        call point%initialize(model)
        call self%symmetry%find(point, t, q, qd, stat, names)
        if (present(names)) call self%symmetry%check_names(model, names, error)
        if (.not. allocated(error) .and. stat == status_ok .and. .not. allocated(self%symmetry%rates_of_time)) call set_error( &
            error, status_no_equilibrium, 'the model "'//model%name//'" depends on time, and no symmetry '// &
            'compensates for this', 'make its functions of time constant')
        if (.not. allocated(error) .and. stat == status_ok .and. present(held) .and. present(held_at)) call self%hold( &
            model, held, held_at, error)
        if (allocated(error)) return
        nearest = huge(nearest)
        if (stat == status_ok) then
            call start_rates(self%symmetry, point, q, qd, rates)
            ! With constant rates; then with free rates, also from a point of small residual: there may be several families.
            do attempt = merge(1, 2, size(self%held) == 0), 3
                self%q = q
                self%rates = rates
                stat = status_ok
                if (attempt == 3) call self%approach(point, t, stat)
                if (stat == status_ok) call self%iterate(point, t, attempt > 1, stat)
                if (stat == status_ok) call self%go_nearer(point, t, q, qd, attempt > 1, stat)
                if (stat /= status_ok .and. stat /= status_no_equilibrium) exit
                if (stat /= status_ok) cycle
                distance = squared_distance(point, self%q, self%qd, q, qd)
                if (distance < nearest) then
                    nearest = distance
                    found = self%q
                    found_rates = self%rates
                    n_free = self%n_free
                end if
                if (attempt == 1) exit
            end do
            if (nearest < huge(nearest)) then
                self%q = found
                self%rates = found_rates
                self%n_free = n_free
                call self%look(point, t, stat)
            end if
        end if
        if (stat /= status_ok) then
            call self%refuse(point, stat, 'steady motion', error)
            return
        end if
        self%moved = maxval(abs((self%q - q)/point%scale))
    end subroutine find_steady_motion

    !> Fix the rates of fields.
    subroutine hold(self, model, names, values, error)
        class(equilibrium_search_type), intent(inout) :: self
        class(model_type), intent(inout) :: model
        character(len=*), intent(in) :: names(:)
        real(wp), intent(in) :: values(:)
        type(error_type), allocatable, intent(inout) :: error
        integer :: k, i, j

        do k = 1, size(names)
            j = 0
            do i = 1, size(self%symmetry%motions)
                if (self%symmetry%motions(i)%name == names(k)) j = i
            end do
            if (j == 0) then
                call set_error(error, status_invalid_option, 'there is no rate of "'//trim(names(k))//'" to be prescribed')
                return
            end if
            if (.not. any(abs(self%symmetry%rates(j, :)) > 0.0_wp) .and. &
                abs(self%symmetry%rates_of_time(j) - values(k)) > 1.0e-9_wp*max(1.0_wp/model%time_scale, abs(values(k)))) then
                call set_error(error, status_no_equilibrium, 'the rate of "'//trim(names(k))// &
                    '" cannot be prescribed: it is part '//'of no symmetry of the model "'//model%name//'"')
                return
            end if
            self%held = [self%held, j]
            self%held_at = [self%held_at, values(k)]
        end do
    end subroutine hold

    !> Move along the family to the steady motion nearest to (q, qd).
    subroutine go_nearer(self, point, t, q, qd, frees_rates, stat)
        class(equilibrium_search_type), intent(inout) :: self
        type(point_type), intent(inout) :: point
        real(wp), intent(in) :: t, q(:), qd(:)
        logical, intent(in) :: frees_rates
        integer, intent(out) :: stat
        real(wp), allocatable :: residual(:), jacobian(:, :), step(:), old(:), rates(:)
        real(wp) :: unit, left, distance, factor
        integer :: i, k, tries

        k = merge(size(self%symmetry%rates, 2), 0, frees_rates)
        allocate (step(point%n + k))
        do i = 1, most_steps_nearer
            call self%look(point, t, stat)
            if (stat == status_ok) call self%form(point, k, residual, jacobian, unit, left, stat)
            if (stat /= status_ok) return
            call find_step_nearer(point, self%symmetry, self%rates, jacobian, self%q, self%qd, q, qd, step)
            if (maxval(abs(step)) <= no_step*(1 + maxval(abs(self%q/point%scale)))) return
            self%relaxations = self%relaxations + 1
            distance = squared_distance(point, self%q, self%qd, q, qd)
            old = self%q
            rates = self%rates
            factor = min(1.0_wp, longest/maxval(abs(step)))
            do tries = 1, 10
                self%q = old + factor*point%scale*step(:point%n)
                if (k > 0) self%rates = rates + factor*point%rate*matmul(self%symmetry%rates, step(point%n + 1:))
                call self%iterate(point, t, frees_rates, stat)
                if (stat == status_ok) then
                    if (squared_distance(point, self%q, self%qd, q, qd) < distance) exit
                end if
                factor = factor/2
            end do
            if (tries <= 10) cycle
            ! As near as possible within rounding, or at the end of the family.
            self%q = old
            self%rates = rates
            call self%look(point, t, stat)
            return
        end do
    end subroutine go_nearer

    !> No symmetries: an equilibrium.
    subroutine no_fields(self, n)
        class(equilibrium_search_type), intent(inout) :: self
        integer, intent(in) :: n

        allocate (self%symmetry%motions(0), self%symmetry%rates(0, 0), self%held(0), self%held_at(0))
        self%rates = [real(wp) ::]
        self%qd = spread(0.0_wp, 1, n)
    end subroutine no_fields

    !> The rates of symmetries that best fit qd.
    subroutine start_rates(symmetry, point, q, qd, rates)
        type(symmetry_type), intent(in) :: symmetry
        type(point_type), intent(in) :: point
        real(wp), intent(in) :: q(:), qd(:)
        real(wp), allocatable, intent(out) :: rates(:)
        type(singular_type) :: svd
        real(wp) :: columns(point%n, size(symmetry%rates, 2)), c(size(symmetry%rates, 2))
        integer :: k

        rates = symmetry%rates_of_time
        if (size(c) == 0) return
        do k = 1, size(c)
            columns(:, k) = symmetry%field(symmetry%rates(:, k), q)/point%scale
        end do
        call svd%allocate(point%n, size(c))
        call svd%factor(columns)
        call svd%solve((qd - symmetry%field(rates, q))/point%scale, c)
        rates = rates + matmul(symmetry%rates, c)
    end subroutine start_rates

    !> Newton's iteration.
    subroutine iterate(self, point, t, frees_rates, stat)
        class(equilibrium_search_type), intent(inout) :: self
        type(point_type), intent(inout) :: point
        real(wp), intent(in) :: t
        !> True if the rates change with the coordinates.
        logical, intent(in) :: frees_rates
        !> A status code; no_equilibrium if the iteration does not converge.
        integer, intent(out) :: stat
        type(singular_type) :: svd
        real(wp), allocatable :: residual(:), jacobian(:, :), step(:), next(:), q(:), rates(:), w(:, :)
        real(wp) :: factor, unit, left, size_of_q
        logical :: is_last
        integer :: k, tries, i

        is_last = .false.
        k = merge(size(self%symmetry%rates, 2), 0, frees_rates)
        allocate (step(point%n + k), next(point%n + k))
        do i = 1, most_iterations
            self%iterations = self%iterations + 1
            call self%look(point, t, stat)
            if (stat /= status_ok) return
            call self%form(point, k, residual, jacobian, unit, left, stat)
            if (stat /= status_ok) return
            call svd%allocate(size(residual), size(step))
            call svd%factor(jacobian)
            point%n_bases = point%n_bases + 1
            self%n_free = size(step) - svd%rank - size(point%idle)
            call svd%solve(-residual, step)
            size_of_q = 1 + maxval(abs(self%q/point%scale))
            if (maxval(abs(step)) <= 1.0e-14_wp*size_of_q .or. (is_last .and. maxval(abs(step)) <= 1.0e-10_wp*size_of_q)) then
                ! Residuals that corrections do not change must be zero as well.
                if (.not. left <= balance_bound) stat = status_no_equilibrium
                return
            end if
            q = self%q
            w = point%w
            rates = self%rates
            factor = min(1.0_wp, longest/maxval(abs(step(:point%n))))
            do tries = 1, 30
                self%q = q + factor*point%scale*step(:point%n)
                if (k > 0) self%rates = rates + factor*point%rate*matmul(self%symmetry%rates, step(point%n + 1:))
                call self%look(point, t, stat)
                if (stat == status_ok) then
                    call residual_of(self, point, unit, residual, w)
                    call svd%solve(-residual, next)
                    if (norm2(next) <= (1 - factor/4)*norm2(step)) exit
                    ! Rounding, if the previous correction was small already: no further improvement.
                    is_last = maxval(abs(step)) <= 1.0e-10_wp*size_of_q
                    if (is_last) exit
                end if
                factor = factor/2
            end do
            if (tries > 30) exit
        end do
        stat = status_no_equilibrium
    end subroutine iterate

    !> Evaluate the model in the motion of the current coordinates and rates.
    subroutine look(self, point, t, stat)
        class(equilibrium_search_type), intent(inout) :: self
        type(point_type), intent(inout) :: point
        real(wp), intent(in) :: t
        integer, intent(out) :: stat

        if (is_spent(point)) then
            stat = status_no_equilibrium
            return
        end if
        self%qd = self%symmetry%field(self%rates, self%q)
        call point%evaluate(t, self%q, self%qd, stat)
        if (stat /= status_ok) return
        call point%make_bases()
        call point%set_acceleration(self%symmetry%turned(self%rates, self%qd))
    end subroutine look

    !> True if the search has reached its limit of bases.
    pure logical function is_spent(point)
        type(point_type), intent(in) :: point

        is_spent = point%n_bases >= max(least_bases, int(most_bases/real(max(point%n, 1), wp)**2))
    end function is_spent

    !> The residual, rows over their lengths and forces over `unit`. Forces at another point are projected, like the derivatives,
    !> along the basis Z of null(C) there for which W'Z = I, with the basis W of the old point.
    subroutine residual_of(self, point, unit, residual, w)
        class(equilibrium_search_type), intent(in) :: self
        type(point_type), intent(in) :: point
        real(wp), intent(in) :: unit
        real(wp), allocatable, intent(inout) :: residual(:)
        !> W of the old point (n, nw).
        real(wp), intent(in), optional :: w(:, :)
        type(lu_type) :: lu
        real(wp) :: forces(point%nw)
        integer :: stat

        forces = matmul(transpose(point%w), matmul(point%mass, point%qdd/point%scale) - point%force)/unit
        if (present(w)) then
            if (size(w, 2) /= point%nw) then
                ! Another rank: the step is not comparable.
                residual = spread(huge(1.0_wp)**0.25_wp, 1, size(residual))
                return
            end if
            call lu%allocate(point%nw)
            call lu%factor(matmul(transpose(point%w), w), stat)
            if (stat == 0) call lu%solve(forces)
        end if
        residual = [self%row_scale(:point%nh)*point%phi, &
            self%rate_row_scale*(matmul(point%jacobian, self%qd/point%scale) - point%nu), forces, &
            (self%rates(self%held) - self%held_at)/point%rate]
    end subroutine residual_of

    !> The residual and its derivatives with respect to scaled coordinates and the rates of k symmetries times the time scale.
    subroutine form(self, point, k, residual, jacobian, unit, left, stat)
        class(equilibrium_search_type), intent(inout) :: self
        type(point_type), intent(inout) :: point
        integer, intent(in) :: k
        real(wp), allocatable, intent(inout) :: residual(:), jacobian(:, :)
        !> The divisor of forces, and the largest residual over the size of its terms.
        real(wp), intent(out) :: unit, left
        integer, intent(out) :: stat
        real(wp), allocatable :: l(:, :), gradient(:, :)
        real(wp), dimension(point%n) :: x, y, sizes
        integer :: i, n, nh, m, last

        unit = 1.0_wp
        left = huge(left)
        call point%differentiate(stat)
        if (stat /= status_ok) return
        n = point%n
        nh = point%nh
        m = point%m
        l = self%symmetry%matrix(self%rates, n)
        do i = 1, n
            l(:, i) = l(:, i)*point%scale(i)/point%scale
        end do
        gradient = point%dynamics_q + matmul(point%dynamics_qd, l) + matmul(point%mass, matmul(l, l))
        unit = max(norm2(matmul(transpose(point%w), gradient)), norm2(point%force), tiny(1.0_wp))
        self%row_scale = point%row_scale
        self%rate_row_scale = point%row_scale/point%rate
        call residual_of(self, point, unit, residual)
        if (allocated(jacobian)) deallocate (jacobian)
        last = nh + m + point%nw
        allocate (jacobian(last + size(self%held), n + k), source=0.0_wp)
        jacobian(:nh, :n) = point%jacobian(:nh, :)
        jacobian(nh + 1:nh + m, :n) = point%velocity_q + matmul(point%jacobian, l)
        do i = 1, n
            jacobian(:nh, i) = self%row_scale(:nh)*jacobian(:nh, i)
            jacobian(nh + 1:nh + m, i) = self%rate_row_scale*jacobian(nh + 1:nh + m, i)
        end do
        jacobian(nh + m + 1:last, :n) = matmul(transpose(point%w), gradient)/unit
        do i = 1, k
            associate (rates => self%symmetry%rates(:, i))
                x = self%symmetry%field(rates, self%q)
                y = (self%symmetry%turned(rates, self%qd) + self%symmetry%turned(self%rates, x))*(point%rate/point%scale)
                x = x*(point%rate/point%scale)
            end associate
            jacobian(nh + 1:nh + m, n + i) = self%rate_row_scale*matmul(point%jacobian, x)
            jacobian(nh + m + 1:last, n + i) = matmul(transpose(point%w), matmul(point%dynamics_qd, x) + &
                matmul(point%mass, y))/unit
            jacobian(last + 1:, n + i) = self%symmetry%rates(self%held, i)
        end do
        ! Errors of the coordinates of 1e-9 would leave as large residuals.
        sizes = abs(point%force) + matmul(abs(point%mass), abs(point%qdd/point%scale)) + &
            matmul(abs(gradient), spread(1.0_wp, 1, n))*(1 + maxval(abs(self%q/point%scale)))
        left = maxval([0.0_wp, abs(residual(:nh + m))/(1 + maxval(abs(self%q/point%scale))), abs(residual(last + 1:)), &
            abs(residual(nh + m + 1:last))*unit/max(matmul(transpose(abs(point%w)), sizes), tiny(1.0_wp))])
    end subroutine form

    !> Reduce the residual by changes of coordinates and rates, to a start of Newton's iteration.
    subroutine approach(self, point, t, stat)
        class(equilibrium_search_type), intent(inout) :: self
        type(point_type), intent(inout) :: point
        real(wp), intent(in) :: t
        integer, intent(out) :: stat
        !> Number of steps, and the residual from which Newton's iteration continues.
        integer, parameter :: most = 200
        real(wp), parameter :: near = 1.0e-7_wp
        type(cholesky_type) :: cholesky
        real(wp), allocatable :: residual(:), jacobian(:, :), normal(:, :), step(:), q(:), rates(:)
        real(wp) :: unit, left, mu, before
        integer :: i, j, k, tries

        k = size(self%symmetry%rates, 2)
        mu = 0.0_wp
        do i = 1, most
            self%relaxations = self%relaxations + 1
            call self%look(point, t, stat)
            if (stat == status_ok) call self%form(point, k, residual, jacobian, unit, left, stat)
            if (stat /= status_ok) return
            before = norm2(residual)
            if (before <= near) return
            normal = matmul(transpose(jacobian), jacobian)
            if (i == 1) mu = 1.0e-2_wp*maxval([(normal(j, j), j=1, size(normal, 1))])
            q = self%q
            rates = self%rates
            call cholesky%allocate(size(normal, 1))
            do tries = 1, 30
                step = -matmul(residual, jacobian)
                do j = 1, size(step)
                    normal(j, j) = normal(j, j) + mu
                end do
                call cholesky%factor(normal, stat)
                do j = 1, size(step)
                    normal(j, j) = normal(j, j) - mu
                end do
                if (stat == 0) then
                    call cholesky%solve(step)
                    self%q = q + point%scale*step(:point%n)
                    self%rates = rates + point%rate*matmul(self%symmetry%rates, step(point%n + 1:))
                    call self%look(point, t, stat)
                    ! The size of forces along an orthonormal basis does not depend on its choice.
                    if (stat == status_ok) then
                        if (norm_at(self, point, unit, size(residual)) < before) exit
                    end if
                end if
                mu = 4*mu
            end do
            if (tries > 30) then
                self%q = q
                self%rates = rates
                exit
            end if
            mu = mu/8
        end do
        stat = status_ok
    end subroutine approach

    !> The size of the residual at the point.
    real(wp) function norm_at(self, point, unit, n) result(norm)
        class(equilibrium_search_type), intent(in) :: self
        type(point_type), intent(in) :: point
        real(wp), intent(in) :: unit
        !> Its earlier number of entries.
        integer, intent(in) :: n
        real(wp), allocatable :: residual(:)

        allocate (residual(0))
        call residual_of(self, point, unit, residual)
        norm = norm2(residual)
        ! Another rank: not comparable.
        if (size(residual) /= n .or. .not. norm <= huge(norm)) norm = huge(norm)
    end function norm_at

    !> Set the error of a failed search.
    subroutine refuse(self, point, stat, what, error)
        class(equilibrium_search_type), intent(in) :: self
        type(point_type), intent(in) :: point
        integer, intent(in) :: stat
        character(len=*), intent(in) :: what
        type(error_type), allocatable, intent(out) :: error
        character(len=:), allocatable :: reason

        if (stat /= status_no_equilibrium) then
            call point%describe(stat, 'cannot be evaluated in the search for its '//what, error)
            return
        end if
        reason = ''
        if (is_spent(point)) reason = ', the limit for so many coordinates'
        if (any(abs(point%nu) > 0.0_wp)) reason = moved_reason
        call set_error(error, stat, 'no '//what//' of the model "'//point%model%name//'" was found in '// &
            to_text(self%iterations)//' iterations and '//to_text(self%relaxations)//' steps along the forces'//reason)
    end subroutine refuse
end module tandem_analysis_equilibrium_search
