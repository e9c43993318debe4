! SPDX-License-Identifier: MIT
!> Systems A - U V' with few columns U, by the factor of A: with X = A^-1 U, a solution x of A is completed by X s, (I - V' X) s =
!> V' x. Coordinates without mass and friction on reactions are such terms:
!>
!> - A coordinate j without mass has a mass a in A: a column a e_j with V' x = x_j.
!> - The force B p(lambda) of friction changes with the multipliers by B p': columns [B; 0] with V' x = p' mu.
module tandem_chart_sparse_low_rank
    use tandem_kinds, only: wp
    use tandem_linalg_complex_lu, only: complex_lu_type
    use tandem_pack, only: pack_type
    implicit none (type, external)
    private

    public :: low_rank_type

    !> For a real system, or for a complex pair of systems.
    type :: low_rank_type
        !> Number of columns; if it is 0 the arrays are not allocated.
        integer :: n = 0
        !> The coordinates without mass, whose columns are the first ones, and their mass in the factor.
        integer, allocatable :: coordinates(:)
        real(wp), allocatable :: added(:)
        !> p' (frictions, m).
        real(wp), allocatable :: gradient(:, :)
        !> X by coordinates (n, columns) and by multipliers (m, columns), real and imaginary parts.
        real(wp), allocatable :: x(:, :), x_im(:, :), mu(:, :), mu_im(:, :)
        !> Work space: multipliers of a solution without (m).
        real(wp), allocatable, private :: no_mu(:)
        !> I - V' X and its factor.
        complex(wp), allocatable, private :: matrix(:, :)
        type(complex_lu_type), private :: lu
    contains
        procedure :: allocate => allocate_update, factor, complete, complete_motion, complete_pair, pack_state
        procedure, private :: find_part
    end type low_rank_type

contains

    !> Allocate.
    subroutine allocate_update(self, n, m, coordinates, added, n_frictions)
        class(low_rank_type), intent(inout) :: self
        !> Numbers of coordinates and of rows.
        integer, intent(in) :: n, m
        !> Coordinates without mass, and their mass in the factor; number of frictions.
        integer, intent(in) :: coordinates(:), n_frictions
        real(wp), intent(in) :: added(:)

        self%n = size(coordinates) + n_frictions
        self%coordinates = coordinates
        self%added = added
        if (allocated(self%x)) deallocate (self%x, self%x_im, self%mu, self%mu_im, self%matrix, self%gradient, &
            self%no_mu)
        if (self%n == 0) return
        allocate (self%no_mu(m), self%x(n, self%n), self%x_im(n, self%n), self%mu(m, self%n), self%mu_im(m, self%n), &
            self%gradient(n_frictions, m), source=0.0_wp)
        allocate (self%matrix(self%n, self%n))
        call self%lu%allocate(self%n)
    end subroutine allocate_update

    !> Factor I - V' X.
    subroutine factor(self, stat)
        class(low_rank_type), intent(inout) :: self
        !> Number of a column without effect if it is singular, else 0.
        integer, intent(out) :: stat
        !> The inverse of a coordinate's entry is 1 + a over the mass that the constraints give it.
        real(wp), parameter :: largest = 1.0e12_wp
        real(wp) :: s(self%n), s_im(self%n)
        integer :: i, j

        do j = 1, self%n
            call self%find_part(self%x(:, j), self%mu(:, j), s)
            call self%find_part(self%x_im(:, j), self%mu_im(:, j), s_im)
            do i = 1, self%n
                self%matrix(i, j) = -cmplx(s(i), s_im(i), wp)
            end do
            self%matrix(j, j) = self%matrix(j, j) + 1.0_wp
        end do
        call self%lu%factor(self%matrix, stat)
        do j = 1, size(self%coordinates)
            if (stat /= 0) return
            s = 0.0_wp
            s(j) = 1.0_wp
            s_im = 0.0_wp
            call self%lu%solve(s, s_im)
            if (.not. abs(s(j)) + abs(s_im(j)) <= largest) stat = j
        end do
    end subroutine factor

    !> V' x.
    subroutine find_part(self, x, mu, part)
        class(low_rank_type), intent(in) :: self
        !> (n) and (m).
        real(wp), intent(in), contiguous :: x(:), mu(:)
        !> (columns)
        real(wp), intent(out) :: part(:)
        integer :: i

        do i = 1, size(self%coordinates)
            part(i) = x(self%coordinates(i))
        end do
        do i = 1, size(self%gradient, 1)
            part(size(self%coordinates) + i) = dot_product(self%gradient(i, :), mu)
        end do
    end subroutine find_part

    !> Complete a solution of the real system.
    subroutine complete(self, x, mu)
        class(low_rank_type), intent(inout) :: self
        !> (n) and (m).
        real(wp), intent(inout), contiguous :: x(:), mu(:)
        real(wp) :: s(self%n), s_im(self%n)
        integer :: i

        if (self%n == 0) return
        call self%find_part(x, mu, s)
        s_im = 0.0_wp
        call self%lu%solve(s, s_im)
        do i = 1, self%n
            x(:) = x + s(i)*self%x(:, i)
            mu(:) = mu + s(i)*self%mu(:, i)
        end do
    end subroutine complete

    !> Complete a solution of the real system without its multipliers, if there is no friction.
    subroutine complete_motion(self, x)
        class(low_rank_type), intent(inout) :: self
        !> (n)
        real(wp), intent(inout), contiguous :: x(:)
        real(wp) :: s(self%n), s_im(self%n)
        integer :: i

        if (self%n == 0) return
        call self%find_part(x, self%no_mu, s)
        s_im = 0.0_wp
        call self%lu%solve(s, s_im)
        do i = 1, self%n
            x(:) = x + s(i)*self%x(:, i)
        end do
    end subroutine complete_motion

    !> Complete a solution of a complex pair of systems.
    subroutine complete_pair(self, x, x_im, mu, mu_im)
        class(low_rank_type), intent(inout) :: self
        !> (n) and (m).
        real(wp), intent(inout), contiguous :: x(:), x_im(:), mu(:), mu_im(:)
        real(wp) :: s(self%n), s_im(self%n)
        integer :: i

        call self%find_part(x, mu, s)
        call self%find_part(x_im, mu_im, s_im)
        call self%lu%solve(s, s_im)
        do i = 1, self%n
            x(:) = x + (s(i)*self%x(:, i) - s_im(i)*self%x_im(:, i))
            x_im(:) = x_im + (s(i)*self%x_im(:, i) + s_im(i)*self%x(:, i))
            mu(:) = mu + (s(i)*self%mu(:, i) - s_im(i)*self%mu_im(:, i))
            mu_im(:) = mu_im + (s(i)*self%mu_im(:, i) + s_im(i)*self%mu(:, i))
        end do
    end subroutine complete_pair

    !> The columns and the factor.
    subroutine pack_state(self, pack)
        class(low_rank_type), intent(inout) :: self
        type(pack_type), intent(inout) :: pack

        if (self%n == 0) return
        call pack%item(self%gradient, self%x, self%x_im, self%mu, self%mu_im)
        call self%lu%pack_state(pack)
    end subroutine pack_state
end module tandem_chart_sparse_low_rank
