! SPDX-License-Identifier: MIT
!> The paper's refinement of an inverse, B <- 2 B - B A B until |A B - I| <= tolerance (20), (29): Newton's iteration, which
!> converges only if |I - A B| < 1 at its start. Source: G. Schulz, ZAMM 13 (1933).
module tandem_linalg_refinement
    use tandem_kinds, only: long, wp
    use tandem_linalg_kernels, only: set_product
    use tandem_status, only: status_chart_left, status_ok
    implicit none (type, external)
    private

    public :: refinement_type

    type :: refinement_type
        !> The inverse (m, m).
        real(wp), allocatable :: inverse(:, :)
        !> Corrections of the last refinement.
        integer :: last_corrections = 0
        real(wp), allocatable, private :: defect(:, :), correction(:, :)
    contains
        procedure :: allocate => allocate_refinement, refine
    end type refinement_type

contains

    !> Allocate for matrices of order m.
    subroutine allocate_refinement(self, m)
        class(refinement_type), intent(inout) :: self
        integer, intent(in) :: m

        if (allocated(self%inverse)) deallocate (self%inverse, self%defect, self%correction)
        allocate (self%inverse(m, m), self%defect(m, m), self%correction(m, m), source=0.0_wp)
    end subroutine allocate_refinement

    !> Refine the inverse for a new matrix.
    subroutine refine(self, matrix, tolerance, corrections, stat)
        class(refinement_type), intent(inout) :: self
        !> A (m, m).
        real(wp), intent(in), contiguous :: matrix(:, :)
        !> Largest remaining entry of A B - I.
        real(wp), intent(in) :: tolerance
        !> Counter of corrections.
        integer(long), intent(inout) :: corrections
        !> A status code.
        integer, intent(out) :: stat
        !> More corrections than quadratic convergence from |I - A B| = 0.9 requires.
        integer, parameter :: most_corrections = 20
        real(wp) :: error, last_error
        integer :: i, k

        stat = status_ok
        self%last_corrections = 0
        last_error = 1.0_wp
        do k = 0, most_corrections
            call set_product(matrix, self%inverse, self%defect)
            do i = 1, size(matrix, 1)
                self%defect(i, i) = self%defect(i, i) - 1.0_wp
            end do
            error = 0.0_wp
            if (size(matrix) > 0) error = maxval(abs(self%defect))
            if (error <= tolerance) return
            ! The iteration stagnates at rounding level, its best accuracy.
            if (k > 1 .and. error >= last_error .and. last_error < 1.0e-12_wp) return
            if (k == most_corrections .or. .not. error < 1.0e3_wp) exit
            last_error = error
            call set_product(self%inverse, self%defect, self%correction)
            self%inverse = self%inverse - self%correction
            corrections = corrections + 1
            self%last_corrections = k + 1
        end do
        stat = status_chart_left
    end subroutine refine
end module tandem_linalg_refinement
