! SPDX-License-Identifier: MIT
!> Acceleration of slow corrections by earlier ones. A correction s of x is S g, S an approximate inverse and g the residual. From
!> moves of x and the resulting reductions of s, the combination that leaves least of s is applied at once, and the rest is the
!> correction. If g is linear in x these are the iterates of GMRES, so that a few directions in which S is wrong cost a few
!> corrections, however small the effect of each one (D. G. Anderson, J. ACM 12 (1965) 547; H. F. Walker, P. Ni, SIAM J. Numer.
!> Anal. 49 (2011) 1715).
!>
!> For positions and velocities on the sparse chart, S is the factor of the step's start, and bodies have turned since: in the mass
!> metric S C0 is an orthogonal projection, and S C is rotated like the bodies. For coupled stages, S is the factored Newton matrix.
module tandem_linalg_secants
    use tandem_kinds, only: wp
    implicit none (type, external)
    private

    public :: secants_type

    !> Number of stored moves: a few bodies that turn, with a few directions each.
    integer, parameter :: most = 6
    !> Number of partial sums of an inner product.
    integer, parameter :: lanes = 8

    type :: secants_type
        private
        !> Number of stored moves, and the index of the next one.
        integer :: n_kept = 0, next = 1
        !> The moves, and their reductions of the correction, orthonormal in the weights (n, most).
        real(wp), allocatable :: dx(:, :), ds(:, :)
        !> The last move, and the correction before it (n).
        real(wp), allocatable :: move(:), before(:)
        !> Weights of the inner product (n), 0 for unknowns that follow others.
        real(wp), allocatable, public :: weight(:)
        !> Remaining part of the correction after the first move.
        real(wp), public :: left = 0.0_wp
        !> True if the space is allocated.
        logical, public :: is_used = .false.
    contains
        procedure :: allocate => allocate_secants, mend, begin, improve, shortening
    end type secants_type

contains

    !> Space for n unknowns.
    subroutine allocate_secants(self, n)
        class(secants_type), intent(inout) :: self
        integer, intent(in) :: n

        if (allocated(self%dx)) deallocate (self%dx, self%ds, self%move, self%before, self%weight)
        allocate (self%dx(n, most), self%ds(n, most), self%move(n), self%before(n), source=0.0_wp)
        allocate (self%weight(n), source=1.0_wp)
        self%is_used = .true.
    end subroutine allocate_secants

    !> Accelerate a correction by earlier ones, once one has left much.
    pure subroutine mend(self, k, error, last_error, n, s, has_left)
        class(secants_type), intent(inout) :: self
        !> Corrections so far, the error now, and before the last one.
        integer, intent(in) :: k
        real(wp), intent(in) :: error, last_error
        !> The correction.
        integer, intent(in) :: n
        real(wp), intent(inout) :: s(n)
        !> True if C has turned so far since the origin that the origin's complement is none here.
        logical, intent(out) :: has_left
        !> Corrections below the first limit are mostly rounding, below the second they carry no information about angles. A larger
        !> growth of the error shows that the moves are wrong.
        real(wp), parameter :: rounding = 1.0e-11_wp, small = 1.0e-8_wp, growth = 2.0_wp

        has_left = .false.
        if (k == 0 .or. (k > 1 .and. error > growth*last_error)) then
            call self%begin(n, s)
        else
            call self%improve(n, last_error > rounding, s)
            has_left = k == 1 .and. last_error > small .and. self%left > 5.0_wp
        end if
    end subroutine mend

    !> Store a first correction, and discard all moves.
    pure subroutine begin(self, n, s)
        class(secants_type), intent(inout) :: self
        integer, intent(in) :: n
        real(wp), intent(in) :: s(n)

        self%n_kept = 0
        self%next = 1
        self%left = 0.0_wp
        self%move(:n) = s
        self%before(:n) = s
    end subroutine begin

    !> Store the last move, and replace the correction by the move that leaves least, before the next one corrects it.
    pure subroutine improve(self, n, learns, s)
        class(secants_type), intent(inout) :: self
        integer, intent(in) :: n
        !> False if the last correction may have been rounding.
        logical, intent(in) :: learns
        real(wp), intent(inout) :: s(n)
        real(wp) :: part
        integer :: i, k

        if (learns) call learn_move(self, n, s)
        do i = 1, n
            self%before(i) = s(i)
            self%move(i) = s(i)
        end do
        do k = 1, self%n_kept
            part = product_of(n, self%weight, s, self%ds(:, k))
            call add(n, -part, self%ds(:, k), s)
            call add(n, -part, self%ds(:, k), self%move)
            call add(n, part, self%dx(:, k), self%move)
        end do
        do i = 1, n
            s(i) = self%move(i)
        end do
    end subroutine improve

    !> Length of the last correction over that of its move, at most 1: a move that continues earlier ones may be much longer than
    !> the remaining error.
    pure real(wp) function shortening(self, n)
        class(secants_type), intent(in) :: self
        integer, intent(in) :: n

        shortening = min(1.0_wp, sqrt(product_of(n, self%weight, self%before, self%before)/ &
            max(product_of(n, self%weight, self%move, self%move), tiny(1.0_wp))))
    end function shortening

    !> Store the last move, unless it nearly depends on others.
    pure subroutine learn_move(self, n, s)
        type(secants_type), intent(inout) :: self
        integer, intent(in) :: n
        !> The correction after it.
        real(wp), intent(in) :: s(n)
        !> A move with a smaller new part is mostly rounding.
        real(wp), parameter :: new = 1.0e-2_wp
        real(wp) :: length, part
        integer :: i, k

        associate (dx => self%dx(:, self%next), ds => self%ds(:, self%next))
            do i = 1, n
                ds(i) = self%before(i) - s(i)
                dx(i) = self%move(i)
            end do
            length = product_of(n, self%weight, ds, ds)
            if (self%n_kept == 0) self%left = sqrt(product_of(n, self%weight, s, s)/ &
                max(product_of(n, self%weight, self%before, self%before), tiny(1.0_wp)))
            do k = 1, self%n_kept
                if (k == self%next) cycle
                part = product_of(n, self%weight, ds, self%ds(:, k))
                call add(n, -part, self%ds(:, k), ds)
                call add(n, -part, self%dx(:, k), dx)
            end do
            part = product_of(n, self%weight, ds, ds)
            if (part > new**2*length .and. part > tiny(1.0_wp)) then
                part = 1.0_wp/sqrt(part)
                ds(:n) = part*ds(:n)
                dx(:n) = part*dx(:n)
                self%n_kept = max(self%n_kept, self%next)
                self%next = modulo(self%next, most) + 1
            else if (self%n_kept == most) then
                ! The oldest one has been overwritten.
                ds(:) = 0.0_wp
                dx(:) = 0.0_wp
            end if
        end associate
    end subroutine learn_move

    !> a' W b. Several partial sums allow pipelining.
    pure real(wp) function product_of(n, weight, a, b)
        integer, intent(in) :: n
        real(wp), intent(in) :: weight(n), a(n), b(n)
        real(wp) :: sums(lanes)
        integer :: i, l

        sums = 0.0_wp
        do i = 0, n - lanes, lanes
            do l = 1, lanes
                sums(l) = sums(l) + weight(i + l)*a(i + l)*b(i + l)
            end do
        end do
        do i = n - modulo(n, lanes) + 1, n
            sums(1) = sums(1) + weight(i)*a(i)*b(i)
        end do
        product_of = sum(sums)
    end function product_of

    !> y := y + a x.
    pure subroutine add(n, a, x, y)
        integer, intent(in) :: n
        real(wp), intent(in) :: a, x(n)
        real(wp), intent(inout) :: y(n)
        integer :: i

        do i = 1, n
            y(i) = y(i) + a*x(i)
        end do
    end subroutine add
end module tandem_linalg_secants
