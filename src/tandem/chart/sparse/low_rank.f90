! SPDX-License-Identifier: MIT
!> Systems A - U V' with few columns U, by the factor of A: with X = A^-1 U, a solution x of A is completed by X s, (I - V' X) s =
!> V' x. Friction on reactions is such a term: its force B p(lambda) changes with the multipliers by B p', columns [B; 0] with
!> V' x = p' mu.
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
        !> p' (frictions, m).
        real(wp), allocatable :: gradient(:, :)
        !> X by coordinates (n, columns) and by multipliers (m, columns), real and imaginary parts.
        real(wp), allocatable :: x(:, :), x_im(:, :), mu(:, :), mu_im(:, :)
        !> I - V' X and its factor.
        complex(wp), allocatable, private :: matrix(:, :)
        type(complex_lu_type), private :: lu
    contains
        procedure :: allocate => allocate_update, factor, complete, complete_pair, pack_state
        procedure, private :: find_part
    end type low_rank_type

contains

    !> Allocate.
    subroutine allocate_update(self, n, m, n_frictions)
        class(low_rank_type), intent(inout) :: self
        !> Numbers of coordinates, of rows and of frictions.
        integer, intent(in) :: n, m, n_frictions

        self%n = n_frictions
        if (allocated(self%x)) deallocate (self%x, self%x_im, self%mu, self%mu_im, self%matrix, self%gradient)
        if (self%n == 0) return
        allocate (self%x(n, self%n), self%x_im(n, self%n), self%mu(m, self%n), self%mu_im(m, self%n), &
            self%gradient(n_frictions, m), source=0.0_wp)
        allocate (self%matrix(self%n, self%n))
        call self%lu%allocate(self%n)
    end subroutine allocate_update

    !> Factor I - V' X.
    subroutine factor(self, stat)
        class(low_rank_type), intent(inout) :: self
        !> Number of a column without effect if it is singular, else 0.
        integer, intent(out) :: stat
        integer :: i, j

        do j = 1, self%n
            do i = 1, self%n
                self%matrix(i, j) = -cmplx(dot_product(self%gradient(i, :), self%mu(:, j)), &
                    dot_product(self%gradient(i, :), self%mu_im(:, j)), wp)
            end do
            self%matrix(j, j) = self%matrix(j, j) + 1.0_wp
        end do
        call self%lu%factor(self%matrix, stat)
    end subroutine factor

    !> V' x.
    subroutine find_part(self, mu, part)
        class(low_rank_type), intent(in) :: self
        !> (m)
        real(wp), intent(in), contiguous :: mu(:)
        !> (columns)
        real(wp), intent(out) :: part(:)
        integer :: i

        do i = 1, size(self%gradient, 1)
            part(i) = dot_product(self%gradient(i, :), mu)
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
        call self%find_part(mu, s)
        s_im = 0.0_wp
        call self%lu%solve(s, s_im)
        do i = 1, self%n
            x(:) = x + s(i)*self%x(:, i)
            mu(:) = mu + s(i)*self%mu(:, i)
        end do
    end subroutine complete

    !> Complete a solution of a complex pair of systems.
    subroutine complete_pair(self, x, x_im, mu, mu_im)
        class(low_rank_type), intent(inout) :: self
        !> (n) and (m).
        real(wp), intent(inout), contiguous :: x(:), x_im(:), mu(:), mu_im(:)
        real(wp) :: s(self%n), s_im(self%n)
        integer :: i

        call self%find_part(mu, s)
        call self%find_part(mu_im, s_im)
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
