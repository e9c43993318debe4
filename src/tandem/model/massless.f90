! SPDX-License-Identifier: MIT
!> The motion without mass that makes D' M D singular, where D spans the null space of C. For the message of `singular_mass`.
module tandem_model_massless
    use tandem_kinds, only: wp
    use tandem_linalg_singular, only: decompose_symmetric, singular_type
    use tandem_model, only: model_type
    use tandem_model_counts, only: counts_type
    use tandem_model_evaluator, only: evaluator_type
    use tandem_model_terms, only: need_jacobian, need_mass
    use tandem_status, only: status_ok
    implicit none (type, external)
    private

    public :: find_massless_motion

contains

    !> The eigenvector of the smallest eigenvalue of D' M D. Of size 0 if this is not small, if a term cannot be evaluated, and for
    !> many coordinates.
    subroutine find_massless_motion(model, t, q, qd, direction)
        class(model_type), intent(inout), target :: model
        !> Time, coordinates and velocities (n).
        real(wp), intent(in) :: t, q(:), qd(:)
        !> Rates of the coordinates (n).
        real(wp), allocatable, intent(out) :: direction(:)
        !> Largest number of coordinates, for which the decomposition takes a second; largest ratio of eigenvalues.
        integer, parameter :: most = 700
        real(wp), parameter :: small = 1.0e-10_wp
        type(evaluator_type) :: evaluator
        type(singular_type) :: rows
        type(counts_type) :: counts
        real(wp), allocatable :: basis(:, :), reduced(:, :), values(:)
        real(wp) :: scale(size(q))
        integer :: i, stat

        direction = [real(wp) ::]
        if (size(q) > most) return
        call evaluator%initialize(model)
        call evaluator%evaluate(need_jacobian + need_mass, t, q, qd, counts, stat)
        if (stat /= status_ok) return
        scale = model%scales()
        associate (c => evaluator%terms%jacobian, mass => evaluator%terms%mass)
            do i = 1, size(c, 1)
                c(i, :) = c(i, :)*scale
                c(i, :) = c(i, :)/max(norm2(c(i, :)), tiny(1.0_wp))
            end do
            call rows%allocate(size(c, 1), size(q))
            call rows%factor(c)
            call rows%get_null_basis(basis)
            if (size(basis, 2) == 0) return
            basis = spread(scale, 2, size(basis, 2))*basis
            reduced = matmul(transpose(basis), matmul(mass, basis))
        end associate
        allocate (values(size(basis, 2)))
        call decompose_symmetric(reduced, values)
        if (values(1) <= small*max(maxval(values), 0.0_wp)) direction = matmul(basis, reduced(:, 1))
    end subroutine find_massless_motion
end module tandem_model_massless
