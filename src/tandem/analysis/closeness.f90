! SPDX-License-Identifier: MIT
!> Distance of a steady motion from a state, and the direction along its family that leads nearer.
!>
!> The distance is measured by the mass matrix M, for positions and for velocities, with the time scale T of the model,
!>
!>   (q - q0)' M (q - q0) + T^2 (qd - qd0)' M (qd - qd0),   qd = X q,
!>
!> so that it does not depend on units, and twice the kinetic energy is the distance of velocities.
module tandem_analysis_closeness
    use tandem_analysis_point, only: point_type
    use tandem_analysis_symmetry, only: symmetry_type
    use tandem_kinds, only: wp
    use tandem_linalg_singular, only: decompose_symmetric, singular_type
    implicit none (type, external)
    private

    public :: squared_distance, find_step_nearer

contains

    !> The square of the distance of a state (q, qd) from another one (q0, qd0).
    real(wp) function squared_distance(point, q, qd, q0, qd0) result(square)
        !> Its mass matrix belongs to q.
        type(point_type), intent(in) :: point
        real(wp), intent(in) :: q(:), qd(:), q0(:), qd0(:)
        real(wp), dimension(point%n) :: away, faster

        away = (q - q0)/point%scale
        faster = (qd - qd0)/(point%rate*point%scale)
        square = dot_product(away, matmul(point%mass, away)) + dot_product(faster, matmul(point%mass, faster))
    end function squared_distance

    !> The step along a family that minimises the distance, to first order: of scaled coordinates and of the rates of the first k
    !> symmetries times T, k = size(step) - n.
    subroutine find_step_nearer(point, symmetry, rates, jacobian, q, qd, q0, qd0, step)
        type(point_type), intent(in) :: point
        type(symmetry_type), intent(in) :: symmetry
        !> Rates of the fields.
        real(wp), intent(in) :: rates(:)
        !> Derivatives of all residuals that must stay zero along the family (any, n + k).
        real(wp), intent(in) :: jacobian(:, :)
        real(wp), intent(in) :: q(:), qd(:), q0(:), qd0(:)
        !> (n + k)
        real(wp), intent(out) :: step(:)
        !> Directions with less than this part of the largest weight, such as those of massless bodies, are unchanged.
        real(wp), parameter :: least = 1.0e-10_wp
        type(singular_type) :: svd
        real(wp), allocatable :: family(:, :), faster(:, :), weights(:, :), values(:), b(:)
        integer :: i, k, n

        n = point%n
        k = size(step) - n
        step = 0.0_wp
        call svd%allocate(size(jacobian, 1), n + k)
        call svd%factor(jacobian)
        call svd%get_null_basis(family)
        if (size(family, 2) == 0) return
        allocate (faster(n, n + k))
        faster(:, :n) = symmetry%matrix(rates, n)/point%rate
        do i = 1, n
            faster(:, i) = faster(:, i)*point%scale(i)/point%scale
        end do
        do i = 1, k
            faster(:, n + i) = symmetry%field(symmetry%rates(:, i), q)/point%scale
        end do
        faster = matmul(faster, family)
        b = -matmul(matmul(point%mass, (q - q0)/point%scale), family(:n, :)) - &
            matmul(matmul(point%mass, (qd - qd0)/(point%rate*point%scale)), faster)
        weights = matmul(transpose(family(:n, :)), matmul(point%mass, family(:n, :))) + &
            matmul(transpose(faster), matmul(point%mass, faster))
        weights = (weights + transpose(weights))/2
        values = b
        call decompose_symmetric(weights, values)
        b = matmul(b, weights)
        where (values > least*maxval(values))
            b = b/values
        else where
            b = 0.0_wp
        end where
        step = matmul(family, matmul(weights, b))
    end subroutine find_step_nearer
end module tandem_analysis_closeness
