! SPDX-License-Identifier: MIT
!> The eigenvalues nearest to a shift, for small motions about an equilibrium, or about a steady motion of all bodies together in
!> co-rotating coordinates, by shift and invert on the sparse form: for mechanisms of thousands of bodies, in memory and time
!> proportional to their number. Neither V nor W is formed.
!>
!> With dq = q exp(lambda t), and (q, u) for the state, (A - sigma) (q1, u1) = (q0, u0) is
!>
!>   [sigma^2 M + sigma D + K, C'; C, 0] (q1; nu) = (-M (sigma q0 + u0) - D q0; g),   u1 = sigma q1 + q0,
!>
!> with g = 0 in rows of Phi, and -C q0/sigma in those at velocity level, which below are C + (C X q - nu)_q/sigma, X = 0 at rest
!> (`sparse_point.f90`, `corotating_frame.f90`). The largest eigenvalues theta of that operator give the eigenvalues of A nearest to
!> sigma, lambda = sigma + 1/theta.
module tandem_analysis_nearest
    use tandem_analysis_corotating_frame, only: corotating_frame_type
    use tandem_analysis_nearest_errors, only: bound_errors
    use tandem_analysis_sparse_point, only: sparse_point_type
    use tandem_analysis_steadiness, only: check_rows, check_symmetry
    use tandem_error, only: error_type, set_error, to_text
    use tandem_kinds, only: wp
    use tandem_linalg_krylov, only: krylov_type, operator_type
    use tandem_linalg_random, only: random_vector
    use tandem_model, only: model_type
    use tandem_model_check, only: check_model
    use tandem_saddle_sparse, only: most_factor_entries, sparse_saddle_type
    use tandem_status, only: status_inconsistent_start, status_invalid_option, status_no_equilibrium, status_ok, status_work_limit
    use, intrinsic :: ieee_arithmetic, only: ieee_is_finite
    implicit none (type, external)
    private

    public :: nearest_type, most_nearest

    !> Largest number of eigenvalues of a search.
    integer, parameter :: most_nearest = 100

    type :: nearest_type
        real(wp) :: t = 0.0_wp
        !> The equilibrium or a position of the steady motion (n), and the residual of its forces over the size of their terms.
        real(wp), allocatable :: q(:)
        real(wp) :: residual = 0.0_wp
        !> The co-rotating frame.
        type(corotating_frame_type) :: frame
        !> The shift: the requested one, or one beside it if that is an eigenvalue itself.
        complex(wp) :: shift = (0.0_wp, 0.0_wp)
        !> Eigenvalues, the nearest first, each the first of its copies.
        complex(wp), allocatable :: values(:)
        !> Bounds on the errors.
        real(wp), allocatable :: error(:)
        !> Motions of the coordinates, the largest entry 1 (n, size(values)).
        complex(wp), allocatable :: shapes(:, :)
        !> Numbers of redundant rows, of products with the operator, and of entries of the factors.
        integer :: n_redundant = 0, products = 0, factor_entries = 0
        !> True if all requested eigenvalues have been found.
        logical :: is_complete = .false.
    contains
        procedure :: find
        procedure, private :: take
    end type nearest_type

    !> (A - sigma)^-1.
    type, extends(operator_type) :: inverse_type
        type(sparse_point_type) :: point
        complex(wp) :: shift = (0.0_wp, 0.0_wp)
        !> H = s^2 M + s D + K at the shift s; H = M with the rows of Phi, and with all rows.
        type(sparse_saddle_type) :: saddle, ties(2)
        !> Work space: coordinates, rows.
        complex(wp), allocatable :: x(:), f(:), g(:), lambda(:)
    contains
        procedure :: apply, factor, draw, factor_ties
    end type inverse_type

    !> Forces are in balance if their residual is at most this part of their terms.
    real(wp), parameter :: balance_bound = 1.0e-9_wp
    !> Limit of residuals of the iteration: rounding leaves some 1e-14.
    real(wp), parameter :: tolerance = 1.0e-12_wp
    character(len=*), parameter :: advice = 'eigenvalues near a shift require an equilibrium (--equilibrium) '// &
        'or a steady motion (--steady)'

contains

    !> Find k eigenvalues at the equilibrium q, or about the steady motion with velocities. Errors: no_equilibrium if it is none,
    !> invalid_option, invalid_model, work_limit, inconsistent_start, and statuses of evaluating the model.
    subroutine find(self, model, t, q, shift, k, error, qd)
        class(nearest_type), intent(out) :: self
        class(model_type), intent(inout), target :: model
        real(wp), intent(in) :: t, q(:)
        complex(wp), intent(in) :: shift
        !> From 1 to `most_nearest`.
        integer, intent(in) :: k
        type(error_type), allocatable, intent(out) :: error
        !> Velocities (n): of all bodies together, which may also spin; at rest if absent.
        real(wp), intent(in), optional :: qd(:)
        type(inverse_type), allocatable :: inverse
        type(krylov_type), allocatable :: krylov
        integer :: n_finite, stat

        call check_model(model, error)
        if (allocated(error)) return
        if (k < 1 .or. k > most_nearest) then
            call set_error(error, status_invalid_option, to_text(k)//' eigenvalues were requested', 'request 1 to '// &
                to_text(most_nearest))
        else if (.not. (ieee_is_finite(real(shift, wp)) .and. ieee_is_finite(aimag(shift)))) then
            call set_error(error, status_invalid_option, 'the shift is not a finite number')
        end if
        if (allocated(error)) return
        allocate (inverse, krylov)
        call inverse%point%initialize(model, error)
        if (allocated(error)) return
        call settle(inverse%point, t, q, self%residual, error, qd)
        if (allocated(error)) return
        self%frame = inverse%point%frame
        if (.not. allocated(self%frame%rates)) allocate (self%frame%names(0), self%frame%rates(0))
        call inverse%point%check_structure(error)
        if (allocated(error)) return
        self%t = t
        self%q = q
        self%n_redundant = count(inverse%point%is_out)
        self%shift = shift
        ! Dimension of the null spaces of rows for dq and for dqd. All other eigenvalues of the pencil are infinite.
        associate (point => inverse%point)
            n_finite = 2*point%n - count(.not. point%is_out(:point%nh)) - count(.not. point%is_out)
            if (n_finite <= 0) then
                allocate (self%values(0), self%error(0), self%shapes(point%n, 0))
                self%is_complete = .true.
                return
            end if
            inverse%rank = n_finite
        end associate
        call inverse%factor(shift, error)
        if (allocated(error)) return
        self%shift = inverse%shift
        self%factor_entries = inverse%saddle%lu%n_entries()
        call inverse%factor_ties(stat)
        if (stat == 0) call krylov%find(inverse, k, tolerance, stat)
        if (stat /= 0) then
            call set_error(error, status_work_limit, 'the eigenvalues near the shift did not converge', 'use another shift')
            return
        end if
        call self%take(inverse, krylov, stat)
        if (stat /= 0) call set_error(error, status_work_limit, 'the errors of the eigenvalues near the shift could not be '// &
            'bounded', 'use another shift')
    end subroutine find

    !> Treat the point as an equilibrium or as a steady motion. Bodies that turn equally about an axis through all positions turn
    !> with the world, or each about itself: the latter is tried first.
    subroutine settle(point, t, q, residual, error, qd)
        type(sparse_point_type), intent(inout) :: point
        real(wp), intent(in) :: t, q(:)
        real(wp), intent(out) :: residual
        type(error_type), allocatable, intent(out) :: error
        real(wp), intent(in), optional :: qd(:)
        type(error_type), allocatable :: second

        if (present(qd)) call find_frame(point, t, q, qd, .false., error)
        if (.not. allocated(error)) call rest_at(point, t, q, residual, error)
        if (.not. (allocated(error) .and. present(qd))) return
        if (error%stat /= status_no_equilibrium) return
        call find_frame(point, t, q, qd, .true., second)
        if (.not. allocated(second)) call rest_at(point, t, q, residual, second)
        if (.not. allocated(second)) deallocate (error)
    end subroutine settle

    !> Find the frame of the motion from its velocities and the corresponding accelerations.
    subroutine find_frame(point, t, q, qd, turns_tell, error)
        type(sparse_point_type), intent(inout) :: point
        real(wp), intent(in) :: t, q(:), qd(:)
        !> As of `fit_rates`.
        logical, intent(in) :: turns_tell
        type(error_type), allocatable, intent(inout) :: error
        real(wp), allocatable :: acceleration(:)
        integer :: stat

        if (.not. any(abs(qd) > 0.0_wp)) return
        call point%look(t, q, stat, qd)
        if (stat == status_ok) call point%find_dependent_rows(acceleration, stat)
        if (stat == status_ok) then
            call point%frame%find(point%model, q, qd, acceleration, turns_tell, error)
        else
            call set_error(error, stat, 'the model "'//point%model%name//'" cannot be evaluated at the point')
        end if
    end subroutine find_frame

    !> Evaluate the model at rest, possibly in a co-rotating frame, with multipliers, K and D; refuse points that do not stay.
    subroutine rest_at(point, t, q, residual, error)
        type(sparse_point_type), intent(inout) :: point
        real(wp), intent(in) :: t, q(:)
        real(wp), intent(out) :: residual
        type(error_type), allocatable, intent(out) :: error
        real(wp), allocatable :: acceleration(:)
        integer :: i, stat

        residual = huge(residual)
        call point%look(t, q, stat)
        if (stat == status_ok) call point%find_dependent_rows(acceleration, stat)
        if (stat == status_ok .and. point%frame%moves) then
            call check_rows(point, error)
            if (.not. allocated(error)) call check_symmetry(point, error)
            if (allocated(error)) return
        end if
        if (stat == status_ok) call point%differentiate(.true., stat)
        if (stat /= status_ok) then
            call set_error(error, stat, 'the model "'//point%model%name//'" cannot be linearised at the point')
            return
        end if
        call point%balance()
        residual = point%imbalance()
        associate (terms => point%evaluator%terms)
            i = maxloc(abs(terms%nu) + abs(terms%gamma), dim=1)
            if (.not. point%frame%moves .and. any(abs(terms%nu) + abs(terms%gamma) > 0.0_wp)) then
                call set_error(error, status_no_equilibrium, 'the constraint "'//point%model%row_name(i)//'" of the model "'// &
                    point%model%name//'" moves it, so that it is not at rest', advice)
            else if (point%violation() > balance_bound) then
                call set_error(error, status_inconsistent_start, 'the model "'//point%model%name//'" violates its '// &
                    'position constraints by '//to_text(point%violation())//' of their scale', 'use coordinates that satisfy them')
            else if (residual > balance_bound) then
                call set_error(error, status_no_equilibrium, 'the model "'//point%model%name//'" is not at rest: '// &
                    'its forces are unbalanced by '//to_text(residual)//' of their size', advice)
            end if
        end associate
    end subroutine rest_at

    !> Factor for a shift, or for one beside it if that is an eigenvalue or invalid for rows at velocity level.
    subroutine factor(self, shift, error)
        class(inverse_type), intent(inout) :: self
        complex(wp), intent(in) :: shift
        type(error_type), allocatable, intent(out) :: error
        !> Offsets of the shift, relative to its modulus, or to 1/s.
        real(wp), parameter :: beside(4) = [0.0_wp, 1.0e-2_wp, 3.0e-2_wp, 0.1_wp]
        !> The matrix is numerically singular if a pivot falls to this part of its column.
        real(wp), parameter :: least = 1.0e-12_wp
        integer :: k, stat

        associate (point => self%point)
            self%n = 2*point%n
            if (allocated(self%x)) deallocate (self%x, self%f, self%g, self%lambda)
            allocate (self%x(point%n), self%f(point%n), self%g(point%m), self%lambda(point%m))
            do k = 1, size(beside)
                self%shift = shift + beside(k)*max(abs(shift), 1.0_wp)
                if (point%m > point%nh .and. .not. abs(self%shift) > 0.0_wp) cycle
                call point%load([self%shift**2, self%shift, (1.0_wp, 0.0_wp)], self%saddle)
                call self%saddle%factor(stat)
                if (stat < 0) exit
                if (stat == 0 .and. self%saddle%independence() > least) return
            end do
            if (stat < 0) then
                call set_error(error, status_work_limit, 'the factors of the model "'//point%model%name//'" would fill more '// &
                    'than '//to_text(most_factor_entries)//' entries: its bodies have too many neighbours')
            else
                call set_error(error, status_invalid_option, 'the matrix of the model "'//point%model%name//'" is singular at '// &
                    'the shift and beside it', 'use another shift')
            end if
        end associate
    end subroutine factor

    !> Factor the matrices that project states onto the rows.
    subroutine factor_ties(self, stat)
        class(inverse_type), intent(inout) :: self
        !> 0, or the status of a singular matrix.
        integer, intent(out) :: stat
        complex(wp), parameter :: mass_only(3) = [(1.0_wp, 0.0_wp), (0.0_wp, 0.0_wp), (0.0_wp, 0.0_wp)]
        logical :: is_out(self%point%m)
        integer :: l

        is_out = self%point%is_out
        do l = 1, 2
            if (l == 1) self%point%is_out(self%point%nh + 1:) = .true.
            call self%point%load(mass_only, self%ties(l))
            call self%ties(l)%factor(stat)
            self%point%is_out = is_out
            if (stat /= 0) return
        end do
    end subroutine factor_ties

    !> A random state (q, u) with Phi_q q = 0 and C u + (C X q - nu)_q q = 0.
    subroutine draw(self, seed, x)
        class(inverse_type), intent(inout) :: self
        integer, intent(inout) :: seed
        complex(wp), intent(out) :: x(:)
        real(wp), dimension(self%point%n) :: none, change
        real(wp) :: g(self%point%m), unused(self%point%m)
        integer :: i, l

        associate (point => self%point, n => self%point%n)
            none = 0.0_wp
            x(:n) = point%scale*random_vector(seed, n)
            x(n + 1:) = max(abs(self%shift), 1.0_wp)*point%scale*random_vector(seed, n)
            ! Twice, because of rounding.
            do l = 1, 4
                if (modulo(l, 2) == 1) then
                    g = [(-real(point%row_times(i, x(:n)), wp), i=1, point%m)]
                    call self%ties(1)%solve(none, g, change, unused)
                    x(:n) = x(:n) + change
                else
                    g = [(-real(point%row_times(i, x(n + 1:)) + point%turning_times(i, x(:n)), wp), i=1, point%m)]
                    call self%ties(2)%solve(none, g, change, unused)
                    x(n + 1:) = x(n + 1:) + change
                end if
            end do
        end associate
    end subroutine draw

    !> y = (A - sigma)^-1 x of states (q, u).
    subroutine apply(self, x, y)
        class(inverse_type), intent(inout) :: self
        complex(wp), intent(in), contiguous :: x(:)
        complex(wp), intent(out), contiguous :: y(:)
        integer :: i

        associate (point => self%point, n => self%point%n, f => self%f, g => self%g, shift => self%shift)
            self%x = shift*x(:n) + x(n + 1:)
            call point%multiply([(1.0_wp, 0.0_wp), (0.0_wp, 0.0_wp), (0.0_wp, 0.0_wp)], self%x, f)
            call point%multiply([(0.0_wp, 0.0_wp), (1.0_wp, 0.0_wp), (0.0_wp, 0.0_wp)], x(:n), self%x)
            f = -f - self%x
            g = (0.0_wp, 0.0_wp)
            do i = point%nh + 1, point%m
                g(i) = -point%row_times(i, x(:n))/shift
            end do
            call self%saddle%solve_complex(f, g, y(:n), self%lambda)
            y(n + 1:) = shift*y(:n) + x(:n)
        end associate
    end subroutine apply

    !> Eigenvalues of A from those of the operator, with bounds on their errors.
    subroutine take(self, inverse, krylov, stat)
        class(nearest_type), intent(inout) :: self
        type(inverse_type), intent(inout) :: inverse
        type(krylov_type), intent(in) :: krylov
        !> 0, or the status of a singular matrix.
        integer, intent(out) :: stat
        complex(wp) :: largest
        integer :: i, n

        n = inverse%point%n
        self%is_complete = krylov%is_complete
        self%products = krylov%products
        self%values = self%shift + 1/krylov%values
        allocate (self%error(size(krylov%values)))
        self%shapes = krylov%vectors(:n, :)
        call bound_errors(inverse%point, self%shift, self%values, self%shapes, self%residual, self%error, stat)
        do i = 1, size(self%values)
            largest = self%shapes(maxloc(abs(self%shapes(:, i)), dim=1), i)
            if (abs(largest) > 0.0_wp) self%shapes(:, i) = self%shapes(:, i)/largest
        end do
    end subroutine take
end module tandem_analysis_nearest
