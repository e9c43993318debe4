! SPDX-License-Identifier: MIT
!> Eigenvalues of largest modulus of an operator given by its products only: Arnoldi's method with full reorthogonalisation and
!> restarts from a Schur form.
!>
!> A Krylov space contains one vector of each eigenvalue. When the requested ones have converged, they are locked, and the search
!> continues from another random vector until the next one beyond them has converged too: this finds multiple eigenvalues.
!>
!> Source: G. W. Stewart, A Krylov-Schur algorithm for large eigenproblems, SIAM J. Matrix Anal. Appl. 23, 2001; LAPACK Users'
!> Guide.
module tandem_linalg_krylov
    use tandem_kinds, only: wp
    use tandem_linalg_lapack, only: zgees, ztrevc, ztrexc
    use tandem_linalg_random, only: random_vector
    implicit none (type, external)
    private

    public :: operator_type, krylov_type

    !> y = O x.
    type, abstract :: operator_type
        !> Length of vectors.
        integer :: n = 0
        !> Dimension of the space of the images of O and its powers, if known to be less than n: other components are rounding.
        integer :: rank = huge(1)
    contains
        procedure(apply_operator), deferred :: apply
        !> A random vector of this space.
        procedure :: draw => draw_image
    end type operator_type

    abstract interface
        subroutine apply_operator(self, x, y)
            import :: operator_type, wp
            implicit none (type, external)
            class(operator_type), intent(inout) :: self
            !> (n) each.
            complex(wp), intent(in), contiguous :: x(:)
            complex(wp), intent(out), contiguous :: y(:)
        end subroutine apply_operator
    end interface

    !> Eigenvalues of largest modulus of an operator, with their vectors.
    type :: krylov_type
        !> Converged ones, the largest first, and their vectors of length 1 (n, size(values)).
        complex(wp), allocatable :: values(:), vectors(:, :)
        !> |O x - value x| over the modulus of the value.
        real(wp), allocatable :: residual(:)
        !> Products with the operator, and restarts.
        integer :: products = 0, restarts = 0
        !> True if all requested ones have converged, or the whole space was searched.
        logical :: is_complete = .false.
        !> Basis (n, m + 1), operator in it (m + 1, m), Schur form and vectors (m, m), coupling to the last vector (m).
        complex(wp), allocatable, private :: basis(:, :), h(:, :), t(:, :), z(:, :), tie(:)
        integer, private :: seed = 4711
    contains
        procedure :: find
        procedure, private :: span, expand, orthogonalize, add_random, form_schur, restart, take
    end type krylov_type

    !> A vector whose orthogonalisation leaves less than this of its length lies in the space of the others.
    real(wp), parameter :: nothing_left = 1.0e-10_wp
    !> Largest number of restarts.
    integer, parameter :: most_restarts = 300

contains

    !> Find k eigenvalues of largest modulus, and those with the modulus of the last one.
    subroutine find(self, operator, k, tolerance, stat)
        class(krylov_type), intent(inout) :: self
        class(operator_type), intent(inout) :: operator
        integer, intent(in) :: k
        !> Tolerance of residuals over the modulus of the value.
        real(wp), intent(in) :: tolerance
        !> 0; > 0 if LAPACK's iteration did not converge or a value was not finite.
        integer, intent(out) :: stat
        integer :: locked, kept, m, next, wanted
        logical :: is_space

        m = min(max(2*k + 24, 36), operator%n, operator%rank)
        call start_basis(self, operator%n, m)
        locked = 0
        kept = 0
        wanted = 0
        is_space = operator%rank <= m
        if (is_space) then
            call self%span(operator, m)
        else
            call self%add_random(operator, 0, is_space)
        end if
        stat = 0
        do
            next = merge(m, kept, operator%rank <= m)
            if (.not. is_space) call self%expand(operator, kept, m, next, is_space)
            if (next == 0) exit
            call self%form_schur(next, stat)
            if (stat /= 0) return
            wanted = number_wanted(self%t, k, next)
            if (is_space) then
                ! The basis is a complete invariant space.
                self%tie(:) = (0.0_wp, 0.0_wp)
                self%is_complete = .true.
                exit
            end if
            if (n_converged(self, next, tolerance) >= min(wanted + merge(1, 0, locked > 0), next)) then
                self%is_complete = locked > 0
                if (self%is_complete) exit
                locked = wanted
                kept = wanted
                call self%restart(kept, next, .true.)
                call self%add_random(operator, kept, is_space)
                cycle
            end if
            if (self%restarts >= most_restarts) exit
            kept = min(next - 2, wanted + 1 + (next - wanted)/3)
            call self%restart(kept, next, .false.)
        end do
        call self%take(min(wanted, n_converged(self, size(self%tie), tolerance)), stat)
    end subroutine find

    !> Initialise empty arrays.
    subroutine start_basis(self, n, m)
        class(krylov_type), intent(inout) :: self
        integer, intent(in) :: n, m

        if (allocated(self%basis)) deallocate (self%basis)
        if (allocated(self%h)) deallocate (self%h, self%tie)
        allocate (self%basis(n, m + 1), self%h(m + 1, m), source=(0.0_wp, 0.0_wp))
        allocate (self%tie(0))
        self%products = 0
        self%restarts = 0
        self%is_complete = .false.
    end subroutine start_basis

    !> Add a random vector of the operator's image after the first `kept` of the basis.
    subroutine add_random(self, operator, kept, is_space)
        class(krylov_type), intent(inout) :: self
        class(operator_type), intent(inout) :: operator
        integer, intent(in) :: kept
        !> True if these already span the image.
        logical, intent(out) :: is_space
        complex(wp) :: x(operator%n), y(operator%n), coefficients(kept)
        real(wp) :: length
        integer :: i

        x = cmplx(random_vector(self%seed, operator%n), 0.0_wp, wp)
        ! Twice, so that it is in the space of the operator's vectors.
        do i = 1, 2
            call operator%apply(x, y)
            self%products = self%products + 1
            length = norm_of(y)
            is_space = .not. length > tiny(1.0_wp)
            if (is_space) return
            x = y/length
        end do
        call self%orthogonalize(kept, x, coefficients, length)
        is_space = .not. length > nothing_left
        if (.not. is_space) self%basis(:, kept + 1) = x/length
    end subroutine add_random

    !> The operator in the whole space, spanned by random vectors: for small spaces; finds multiple eigenvalues and Jordan blocks.
    subroutine span(self, operator, m)
        class(krylov_type), intent(inout) :: self
        class(operator_type), intent(inout) :: operator
        !> Dimension of the space.
        integer, intent(in) :: m
        complex(wp) :: x(operator%n), coefficients(m)
        real(wp) :: length
        integer :: j

        do j = 1, m
            call operator%draw(self%seed, x)
            x = x/norm_of(x)
            call self%orthogonalize(j - 1, x, coefficients(:j - 1), length)
            self%basis(:, j) = x/length
        end do
        do j = 1, m
            call operator%apply(self%basis(:, j), x)
            self%products = self%products + 1
            call self%orthogonalize(m, x, self%h(:m, j), length)
        end do
    end subroutine span

    !> A random vector multiplied twice by the operator.
    subroutine draw_image(self, seed, x)
        class(operator_type), intent(inout) :: self
        integer, intent(inout) :: seed
        !> (n)
        complex(wp), intent(out) :: x(:)
        complex(wp) :: y(self%n)

        y = cmplx(random_vector(seed, self%n), 0.0_wp, wp)
        call self%apply(y, x)
        y = x/norm_of(x)
        call self%apply(y, x)
    end subroutine draw_image

    !> Expand the basis from `kept` vectors and the following one to m.
    subroutine expand(self, operator, kept, m, last, is_space)
        class(krylov_type), intent(inout) :: self
        class(operator_type), intent(inout) :: operator
        integer, intent(in) :: kept, m
        !> Number of vectors then.
        integer, intent(out) :: last
        !> True if they are a complete invariant space.
        logical, intent(out) :: is_space
        complex(wp) :: y(operator%n), coefficients(m)
        real(wp) :: length, before
        integer :: j

        is_space = .false.
        do j = kept + 1, m
            last = j
            call operator%apply(self%basis(:, j), y)
            self%products = self%products + 1
            before = norm_of(y)
            call self%orthogonalize(j, y, coefficients(:j), length)
            self%h(:j, j) = coefficients(:j)
            if (length > nothing_left*before) then
                self%h(j + 1, j) = length
                self%basis(:, j + 1) = y/length
                cycle
            end if
            ! An invariant space was found; try another one beside it.
            self%h(j + 1, j) = (0.0_wp, 0.0_wp)
            call self%add_random(operator, j, is_space)
            if (is_space) return
        end do
    end subroutine expand

    !> Remove the components of x along the first j vectors, twice.
    subroutine orthogonalize(self, j, x, coefficients, length)
        class(krylov_type), intent(in) :: self
        integer, intent(in) :: j
        complex(wp), intent(inout) :: x(:)
        !> Components along each (j), and the length of the remainder.
        complex(wp), intent(out) :: coefficients(:)
        real(wp), intent(out) :: length
        complex(wp) :: part
        integer :: i, pass

        coefficients = (0.0_wp, 0.0_wp)
        do pass = 1, 2
            do i = 1, j
                part = dot_product(self%basis(:, i), x)
                coefficients(i) = coefficients(i) + part
                x = x - part*self%basis(:, i)
            end do
        end do
        length = norm_of(x)
    end subroutine orthogonalize

    !> Schur form of the first m columns, entries of largest modulus first.
    subroutine form_schur(self, m, stat)
        class(krylov_type), intent(inout) :: self
        integer, intent(in) :: m
        integer, intent(out) :: stat
        complex(wp) :: values(m), work(66*m), last
        real(wp) :: rwork(m)
        logical :: bwork(m)
        integer :: i, largest, none

        if (allocated(self%t)) deallocate (self%t, self%z)
        allocate (self%t(m, m), source=self%h(:m, :m))
        allocate (self%z(m, m), source=(0.0_wp, 0.0_wp))
        stat = 1
        if (.not. sum(abs(self%t)) <= huge(1.0_wp)) return
        call zgees('V', 'N', is_wanted, m, self%t, m, none, values, self%z, m, work, size(work), rwork, bwork, stat)
        do i = 1, m
            if (stat /= 0) return
            largest = i - 1 + maxloc([(abs(self%t(none, none)), none=i, m)], dim=1)
            if (largest > i) call ztrexc('V', m, self%t, m, self%z, m, largest, i, stat)
        end do
        last = self%h(m + 1, m)
        self%tie = last*self%z(m, :)
    end subroutine form_schur

    !> Never called.
    logical function is_wanted(value)
        complex(wp), intent(in) :: value

        is_wanted = abs(value) > 0.0_wp
    end function is_wanted

    !> k plus the number of further entries with the modulus of the last one.
    pure integer function number_wanted(t, k, m) result(number)
        complex(wp), intent(in) :: t(:, :)
        integer, intent(in) :: k, m

        number = min(k, m)
        if (number == 0) return
        do while (number < m)
            if (abs(t(number + 1, number + 1)) < (1 - 1.0e-6_wp)*abs(t(k, k))) exit
            if (number >= 2*k) exit
            number = number + 1
        end do
    end function number_wanted

    !> Number of first ones that have converged.
    pure integer function n_converged(self, m, tolerance) result(number)
        class(krylov_type), intent(in) :: self
        integer, intent(in) :: m
        real(wp), intent(in) :: tolerance

        number = 0
        do while (number < m)
            if (abs(self%tie(number + 1)) > tolerance*abs(self%t(number + 1, number + 1))) exit
            number = number + 1
        end do
    end function n_converged

    !> Keep the first vectors of the Schur form.
    subroutine restart(self, kept, m, locks)
        class(krylov_type), intent(inout) :: self
        integer, intent(in) :: kept, m
        !> True to treat them as an invariant space.
        logical, intent(in) :: locks
        integer :: i

        self%restarts = self%restarts + 1
        call combine(self%basis(:, :m), self%z(:, :kept))
        self%h = (0.0_wp, 0.0_wp)
        do i = 1, kept
            self%h(:i, i) = self%t(:i, i)
        end do
        if (locks) return
        self%h(kept + 1, :kept) = self%tie(:kept)
        self%basis(:, kept + 1) = self%basis(:, m + 1)
    end subroutine restart

    !> basis(:, :kept) := basis z, row by row, so that no second basis is needed.
    pure subroutine combine(basis, z)
        complex(wp), intent(inout) :: basis(:, :)
        complex(wp), intent(in) :: z(:, :)
        complex(wp) :: row(size(z, 2))
        integer :: i

        do i = 1, size(basis, 1)
            row = matmul(basis(i, :), z)
            basis(i, :size(row)) = row
        end do
    end subroutine combine

    !> Eigenvalues and vectors of the first k.
    subroutine take(self, k, stat)
        class(krylov_type), intent(inout) :: self
        integer, intent(in) :: k
        integer, intent(out) :: stat
        complex(wp) :: y(k, k), left(1, 1), work(2*k), t(k, k)
        real(wp) :: rwork(k)
        integer :: i, none
        logical :: all_of_them(1)

        stat = 0
        if (allocated(self%values)) deallocate (self%values, self%vectors, self%residual)
        allocate (self%values(k), self%residual(k))
        if (k == 0) then
            allocate (self%vectors(size(self%basis, 1), 0))
            return
        end if
        t = self%t(:k, :k)
        all_of_them = .true.
        call ztrevc('R', 'A', all_of_them, k, t, k, left, 1, y, k, k, none, work, rwork, stat)
        if (stat /= 0) return
        call combine(self%basis(:, :size(self%z, 1)), self%z(:, :k))
        call combine(self%basis(:, :k), y)
        allocate (self%vectors, source=self%basis(:, :k))
        do i = 1, k
            self%values(i) = self%t(i, i)
            self%residual(i) = abs(sum(self%tie(:k)*y(:, i)))/norm_of(y(:, i))/max(abs(self%values(i)), tiny(1.0_wp))
            self%vectors(:, i) = self%vectors(:, i)/norm_of(self%vectors(:, i))
        end do
        deallocate (self%basis)
    end subroutine take

    !> The length of a vector.
    pure real(wp) function norm_of(x)
        complex(wp), intent(in) :: x(:)

        norm_of = sqrt(sum(real(x, wp)**2 + aimag(x)**2))
    end function norm_of
end module tandem_linalg_krylov
