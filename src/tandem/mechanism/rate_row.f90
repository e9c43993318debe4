! SPDX-License-Identifier: MIT
!> Rows at velocity level by expressions: V = sum of c_i(t, q) v_i - e(t, q), where each v_i is an entry of qd.
module tandem_mechanism_rate_row
    use tandem_kinds, only: wp
    use tandem_mechanism_coordinate, only: coordinate_type
    use tandem_mechanism_formula, only: formula_type, is_place, is_time, is_velocity, variable_type
    use tandem_mechanism_pose, only: pose_type
    use tandem_model_derivatives, only: derivatives_type, need_acceleration_q, need_acceleration_qd, need_dynamics_q, &
        need_velocity_q
    use tandem_model_terms, only: need_gamma, need_jacobian, need_nu, terms_type
    implicit none (type, external)
    private

    public :: rate_row_type, evaluate_rate_rows, differentiate_rate_rows

    type :: rate_row_type
        !> The row of C.
        integer :: row = 0
        !> v_i, and the numbers of the expressions of c_i and of e, 0 for none.
        type(variable_type), allocatable :: velocities(:)
        integer, allocatable :: coefficients(:)
        integer :: rhs = 0
    end type rate_row_type

contains

    !> The column of a coordinate or of its velocity, 0 for the time.
    pure integer function column(variable, pose)
        type(variable_type), intent(in) :: variable
        type(pose_type), intent(in) :: pose(0:)

        select case (variable%kind)
        case (is_time)
            column = 0
        case (is_place, is_velocity)
            column = pose(variable%of)%place + variable%entry - 1
        case default
            column = pose(variable%of)%turn + variable%entry - 1
        end select
    end function column

    !> That of a velocity in the C that is set, which may be compressed.
    pure integer function column_of_c(variable, pose)
        type(variable_type), intent(in) :: variable
        type(pose_type), intent(in) :: pose(0:)

        if (variable%kind == is_place .or. variable%kind == is_velocity) then
            column_of_c = pose(variable%of)%place_column + variable%entry - 1
        else
            column_of_c = pose(variable%of)%turn_column + variable%entry - 1
        end if
    end function column_of_c

    !> Every row's part of the terms; the Jacobian is zero before.
    pure subroutine evaluate_rate_rows(rows, need, t, pose, qd, formulas, coordinates, terms)
        type(rate_row_type), intent(in) :: rows(:)
        integer, intent(in) :: need
        real(wp), intent(in) :: t
        type(pose_type), intent(in) :: pose(0:)
        real(wp), intent(in) :: qd(:)
        type(formula_type), intent(inout) :: formulas(:)
        !> Of the joints, which such rows do not look at.
        type(coordinate_type), intent(inout) :: coordinates(:)
        type(terms_type), intent(inout) :: terms
        real(wp) :: value, rate, curve, gamma
        integer :: i, k, c
        logical :: with_rates

        with_rates = iand(need, need_gamma) /= 0
        do i = 1, size(rows)
            associate (it => rows(i))
                gamma = 0.0_wp
                do k = 1, size(it%coefficients)
                    if (iand(need, need_jacobian + need_gamma) == 0) exit
                    c = column(it%velocities(k), pose)
                    associate (formula => formulas(it%coefficients(k)))
                        call formula%read_state(t, pose, coordinates, with_rates)
                        if (with_rates) then
                            call formula%pieces%evaluate_along(formula%x, formula%v, value, rate, curve)
                            gamma = gamma + rate*qd(c)
                        else
                            value = formula%value()
                        end if
                    end associate
                    if (iand(need, need_jacobian) /= 0) then
                        c = column_of_c(it%velocities(k), pose)
                        terms%jacobian(it%row, c) = terms%jacobian(it%row, c) + value
                    end if
                end do
                value = 0.0_wp
                if (it%rhs > 0 .and. iand(need, need_nu + need_gamma) /= 0) then
                    associate (formula => formulas(it%rhs))
                        call formula%read_state(t, pose, coordinates, with_rates)
                        if (with_rates) then
                            call formula%pieces%evaluate_along(formula%x, formula%v, value, rate, curve)
                            gamma = gamma - rate
                        else
                            value = formula%value()
                        end if
                    end associate
                end if
                if (iand(need, need_nu) /= 0) terms%nu(it%row) = value
                if (with_rates) terms%gamma(it%row) = gamma
            end associate
        end do
    end subroutine evaluate_rate_rows

    !> Every row's part of the gradient blocks, which are zero before.
    pure subroutine differentiate_rate_rows(rows, need, t, pose, qd, qdd, lambda, formulas, coordinates, derivatives)
        type(rate_row_type), intent(in) :: rows(:)
        integer, intent(in) :: need
        real(wp), intent(in) :: t
        type(pose_type), intent(in) :: pose(0:)
        real(wp), intent(in) :: qd(:), qdd(:), lambda(:)
        type(formula_type), intent(inout) :: formulas(:)
        type(coordinate_type), intent(inout) :: coordinates(:)
        type(derivatives_type), intent(inout) :: derivatives
        integer :: i, k, c

        do i = 1, size(rows)
            associate (it => rows(i))
                do k = 1, size(it%coefficients)
                    c = column(it%velocities(k), pose)
                    call add_part(it%row, need, t, pose, formulas(it%coefficients(k)), coordinates, qd(c), qdd(c), c, &
                        lambda(it%row), derivatives)
                end do
                if (it%rhs > 0) call add_part(it%row, need, t, pose, formulas(it%rhs), coordinates, -1.0_wp, 0.0_wp, 0, &
                    lambda(it%row), derivatives)
            end associate
        end do
    end subroutine differentiate_rate_rows

    !> The part c v of V, or for column 0 the part -e.
    pure subroutine add_part(row, need, t, pose, formula, coordinates, v, v_rate, c, lambda, derivatives)
        integer, intent(in) :: row, need
        real(wp), intent(in) :: t
        type(pose_type), intent(in) :: pose(0:)
        type(formula_type), intent(inout) :: formula
        type(coordinate_type), intent(inout) :: coordinates(:)
        !> The velocity, its rate, its column, and the row's multiplier.
        real(wp), intent(in) :: v, v_rate
        integer, intent(in) :: c
        real(wp), intent(in) :: lambda
        type(derivatives_type), intent(inout) :: derivatives
        real(wp) :: value, rate
        integer :: k, j

        call formula%read_state(t, pose, coordinates, .true.)
        call formula%pieces%evaluate_gradient_along(formula%x, formula%v, value, rate, formula%by, formula%by_rate)
        if (c > 0 .and. iand(need, need_acceleration_qd) /= 0) derivatives%acceleration_qd(row, c) = &
            derivatives%acceleration_qd(row, c) + rate
        do k = 1, size(formula%variables)
            j = column(formula%variables(k), pose)
            if (j == 0) cycle
            if (iand(need, need_velocity_q) /= 0) derivatives%velocity_q(row, j) = derivatives%velocity_q(row, j) + v*formula%by(k)
            if (iand(need, need_acceleration_q) /= 0) derivatives%acceleration_q(row, j) = &
                derivatives%acceleration_q(row, j) + v_rate*formula%by(k) + v*formula%by_rate(k)
            if (iand(need, need_acceleration_qd) /= 0) then
                derivatives%acceleration_qd(row, j) = derivatives%acceleration_qd(row, j) + v*formula%by(k)
            end if
            if (c > 0 .and. iand(need, need_dynamics_q) /= 0) then
                derivatives%dynamics_q(c, j) = derivatives%dynamics_q(c, j) + lambda*formula%by(k)
            end if
        end do
    end subroutine add_part
end module tandem_mechanism_rate_row
