! SPDX-License-Identifier: MIT
!> Integrability of velocity constraints by the theorem of Frobenius, from the model's own E and e. Row i is the form omega_i = E_i
!> dq - e_i dt on the space of (t, q).
module integrability
    use svd, only: get_null_space
    use tandem, only: model_type, terms_type, wp
    use terms_at, only: get_terms
    implicit none (type, external)
    private

    public :: frobenius_defects

contains

    !> Defect of the integrability of each nonholonomic row at (t, q), on the manifold of the holonomic rows: individually, and
    !> together with the other nonholonomic rows. It is the largest entry of d omega_i on an orthonormal basis of the common null
    !> space, relative to the length of omega_i; zero for an integrable one. (All of `together` must vanish, and not at one point
    !> only, for the rows to be completely integrable together.)
    subroutine frobenius_defects(model, t, q, alone, together)
        class(model_type), intent(inout) :: model
        real(wp), intent(in) :: t, q(:)
        !> One per nonholonomic row.
        real(wp), allocatable, intent(out) :: alone(:), together(:)
        real(wp), parameter :: place(4) = [-2.0_wp, -1.0_wp, 1.0_wp, 2.0_wp]
        real(wp), parameter :: factor(4) = [1.0_wp, -8.0_wp, 8.0_wp, -1.0_wp]/12.0_wp
        real(wp), parameter :: step = epsilon(1.0_wp)**0.2_wp
        real(wp) :: point(0:size(q)), slope(0:size(q), 0:size(q), model%n_nonholonomic)
        real(wp), allocatable :: forms(:, :), moved(:, :)
        integer :: a, i, k, nh, m

        nh = model%n_holonomic
        m = model%n_constraints()
        call get_forms([t, q], forms)
        slope = 0.0_wp
        do a = 0, size(q)
            do k = 1, 4
                point = [t, q]
                point(a) = point(a) + place(k)*step
                call get_forms(point, moved)
                slope(a, :, :) = slope(a, :, :) + factor(k)/step*transpose(moved(nh + 1:, :))
            end do
        end do
        allocate (alone(m - nh), together(m - nh))
        do i = 1, m - nh
            alone(i) = defect(slope(:, :, i), forms([(k, k=1, nh), nh + i], :))/norm2(forms(nh + i, :))
            together(i) = defect(slope(:, :, i), forms)/norm2(forms(nh + i, :))
        end do

    contains

        !> The rows (-nu, C) at a point (t, q).
        subroutine get_forms(at, rows)
            real(wp), intent(in) :: at(0:)
            real(wp), allocatable, intent(out) :: rows(:, :)
            type(terms_type) :: terms
            integer :: stat

            call get_terms(model, at(0), at(1:), 0*at(1:), terms, stat)
            if (stat /= 0) error stop 'frobenius_defects: the model cannot be evaluated'
            allocate (rows(m, 0:size(q)))
            rows(:, 0) = -terms%nu
            rows(:, 1:) = terms%jacobian
        end subroutine get_forms
    end subroutine frobenius_defects

    !> The largest entry of d omega on the null space of rows; slope(a, b) is the derivative of omega_b along coordinate a.
    real(wp) function defect(slope, rows)
        real(wp), intent(in) :: slope(:, :), rows(:, :)
        real(wp), allocatable :: basis(:, :)

        call get_null_space(rows, 1.0e-10_wp, basis)
        defect = 0.0_wp
        if (size(basis, 2) > 1) defect = maxval(abs(matmul(transpose(basis), matmul(slope - transpose(slope), basis))))
    end function defect
end module integrability
