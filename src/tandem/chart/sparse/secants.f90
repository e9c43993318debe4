! SPDX-License-Identifier: MIT
!> What slow corrections have shown mends those after them. A correction s of x is S g, S the factor of the step's start and g what
!> the rows leave. Of moves of x and of what each took from s, the combination that leaves least of s is applied at once, and what
!> remains is the correction. Where g is linear in x these are the iterates of GMRES, so that a few bodies that have turned far cost
!> a few corrections, however little each corrects by itself (D. G. Anderson, J. ACM 12 (1965) 547; H. F. Walker, P. Ni, SIAM J.
!> Numer. Anal. 49 (2011) 1715). In the mass metric S C0 is an orthogonal projection, and S C one that is turned as the bodies are.
module tandem_chart_sparse_secants
    use tandem_kinds, only: wp
    implicit none (type, external)
    private

    public :: secants_type

    !> Moves that are kept: those of some bodies that turn, each with a few directions of its own.
    integer, parameter :: most = 6

    type :: secants_type
        private
        !> How many are kept, and the place of the next one.
        integer :: n_kept = 0, next = 1
        !> The moves, and what they took from the correction, orthonormal in the weights (n, most).
        real(wp), allocatable :: dx(:, :), ds(:, :)
        !> The last move, and the correction before it (n).
        real(wp), allocatable :: move(:), before(:)
        !> The diagonal of M (n).
        real(wp), allocatable, public :: weight(:)
        !> What the first move has left of the correction.
        real(wp), public :: left = 0.0_wp
        !> Whether there is space for any.
        logical, public :: is_used = .false.
    contains
        procedure :: allocate => allocate_secants, mend
        procedure, private :: begin, improve
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

    !> Mend a correction by those before it, once one has left much.
    pure subroutine mend(self, k, error, last_error, n, s, has_left)
        class(secants_type), intent(inout) :: self
        !> Corrections so far, the error now, and before the last one.
        integer, intent(in) :: k
        real(wp), intent(in) :: error, last_error
        !> The correction.
        integer, intent(in) :: n
        real(wp), intent(inout) :: s(n)
        !> Whether C has turned so far since the origin that its complement there is none here.
        logical, intent(out) :: has_left
        !> What corrects less than the first shows little but rounding, less than the second nothing of angles. An error that grows
        !> so much shows that the moves are wrong.
        real(wp), parameter :: rounding = 1.0e-11_wp, small = 1.0e-8_wp, growth = 2.0_wp

        has_left = .false.
        if (k == 0 .or. (k > 1 .and. error > growth*last_error)) then
            call self%begin(n, s)
        else
            call self%improve(n, last_error > rounding, s)
            has_left = k == 1 .and. last_error > small .and. self%left > 1.0_wp
        end if
    end subroutine mend

    !> Remember the first correction: of other rows than before.
    pure subroutine begin(self, n, s)
        class(secants_type), intent(inout) :: self
        integer, intent(in) :: n
        real(wp), intent(in) :: s(n)

        self%n_kept = 0
        self%next = 1
        self%left = 0.0_wp
        self%move(:) = s
        self%before(:) = s
    end subroutine begin

    !> Learn from the last move, and make the correction the move that leaves least, before the next one corrects that.
    pure subroutine improve(self, n, learns, s)
        class(secants_type), intent(inout) :: self
        integer, intent(in) :: n
        !> False where the last correction may have been rounding.
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

    !> Keep the last move, unless it is much as others.
    pure subroutine learn_move(self, n, s)
        type(secants_type), intent(inout) :: self
        integer, intent(in) :: n
        !> The correction after it.
        real(wp), intent(in) :: s(n)
        !> A move of which less than this is new shows little but rounding.
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
                ds(:) = part*ds
                dx(:) = part*dx
                self%n_kept = max(self%n_kept, self%next)
                self%next = modulo(self%next, most) + 1
            else if (self%n_kept == most) then
                ! It has overwritten the oldest one.
                ds(:) = 0.0_wp
                dx(:) = 0.0_wp
            end if
        end associate
    end subroutine learn_move

    !> a' W b.
    pure real(wp) function product_of(n, weight, a, b)
        integer, intent(in) :: n
        real(wp), intent(in) :: weight(n), a(n), b(n)
        integer :: i

        product_of = 0.0_wp
        do i = 1, n
            product_of = product_of + weight(i)*a(i)*b(i)
        end do
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
end module tandem_chart_sparse_secants
