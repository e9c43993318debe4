! SPDX-License-Identifier: MIT
!> Velocity-level rows given by expressions: V = sum over i of c_i(t, q) v_i - e(t, q), where each v_i is an entry of qd or a
!> component of the angular velocity w = 2 E(p) pd of a body in the world frame.
!>
!> The component of w along the axis a is g(p)'pd with g = 2 E(p)'a. As E(p) x = -E(x) p, its derivative with respect to p is -2
!> E(pd)'a. Its rate is g'pdd, because the terms quadratic in pd vanish; the derivative of this rate with respect to p is -2
!> E(pdd)'a.
module tandem_mechanism_rate_row
    use tandem_kinds, only: wp
    use tandem_mechanism_coordinate, only: coordinate_type
    use tandem_mechanism_formula, only: formula_type, is_place, is_spin, is_time, is_velocity, variable_type
    use tandem_mechanism_pose, only: pose_type
    use tandem_model_derivatives, only: derivatives_type, need_acceleration_q, need_acceleration_qd, need_dynamics_q, &
        need_velocity_q
    use tandem_model_terms, only: need_gamma, need_jacobian, need_nu, terms_type
    use tandem_rigid_euler_parameters, only: e_transposed_gradient, e_transposed_product
    implicit none (type, external)
    private

    public :: rate_row_type, evaluate_rate_rows, differentiate_rate_rows

    type :: rate_row_type
        !> Row of C.
        integer :: row = 0
        !> Velocities v_i; indices of the formulas of c_i and of e, 0 if e is zero.
        type(variable_type), allocatable :: velocities(:)
        integer, allocatable :: coefficients(:)
        integer :: rhs = 0
    end type rate_row_type

contains

    !> Column of a coordinate or of its rate in q and qd; for an angular velocity in space, first column of the Euler parameters; 0
    !> for the time.
    pure integer function column(variable, pose)
        type(variable_type), intent(in) :: variable
        type(pose_type), intent(in) :: pose(0:)

        select case (variable%kind)
        case (is_time)
            column = 0
        case (is_place, is_velocity)
            column = pose(variable%owner)%place + variable%entry - 1
        case (is_spin)
            column = pose(variable%owner)%turn
        case default
            column = pose(variable%owner)%turn + variable%entry - 1
        end select
    end function column

    !> Column of a velocity in the stored matrix C, which may be compressed; first column for an angular velocity in space.
    pure integer function column_of_c(variable, pose)
        type(variable_type), intent(in) :: variable
        type(pose_type), intent(in) :: pose(0:)

        select case (variable%kind)
        case (is_place, is_velocity)
            column_of_c = pose(variable%owner)%place_column + variable%entry - 1
        case (is_spin)
            column_of_c = pose(variable%owner)%turn_column
        case default
            column_of_c = pose(variable%owner)%turn_column + variable%entry - 1
        end select
    end function column_of_c

    !> Coefficients g of the rates of which a velocity is composed, and their number: 1, or 4 for an angular velocity in space.
    pure subroutine get_coefficients(variable, pose, n, g)
        type(variable_type), intent(in) :: variable
        type(pose_type), intent(in) :: pose(0:)
        integer, intent(out) :: n
        real(wp), intent(out) :: g(4)

        n = 1
        g(1) = 1.0_wp
        if (variable%kind /= is_spin) return
        n = 4
        g = e_transposed_product(pose(variable%owner)%p(:, 0), doubled_axis(variable))
    end subroutine get_coefficients

    !> g'x, where x is the k-th derivative of the coordinates along the motion: the velocity for k = 1, its rate for constant g if k
    !> = 2.
    pure real(wp) function derivative(variable, pose, k, g)
        type(variable_type), intent(in) :: variable
        type(pose_type), intent(in) :: pose(0:)
        integer, intent(in) :: k
        real(wp), intent(in) :: g(:)

        select case (variable%kind)
        case (is_place, is_velocity)
            derivative = pose(variable%owner)%r(variable%entry, k)
        case (is_spin)
            derivative = dot_product(g, pose(variable%owner)%p(:, k))
        case default
            derivative = pose(variable%owner)%p(variable%entry, k)
        end select
    end function derivative

    !> 2 a, where a is the unit axis of a component of an angular velocity.
    pure function doubled_axis(variable) result(a)
        type(variable_type), intent(in) :: variable
        real(wp) :: a(3)

        a = 0.0_wp
        a(variable%entry) = 2.0_wp
    end function doubled_axis

    !> Add the terms of every row. The Jacobian is zero on entry.
    pure subroutine evaluate_rate_rows(rows, need, t, pose, formulas, coordinates, terms)
        type(rate_row_type), intent(in) :: rows(:)
        integer, intent(in) :: need
        real(wp), intent(in) :: t
        type(pose_type), intent(in) :: pose(0:)
        type(formula_type), intent(inout) :: formulas(:)
        !> Joint coordinates, which `read_state` requires although these rows do not depend on them.
        type(coordinate_type), intent(inout) :: coordinates(:)
        type(terms_type), intent(inout) :: terms
        real(wp) :: value, rate, curve, gamma, g(4)
        integer :: i, k, c, n
        logical :: with_rates

        with_rates = iand(need, need_gamma) /= 0
        do i = 1, size(rows)
            associate (this => rows(i))
                gamma = 0.0_wp
                do k = 1, size(this%coefficients)
                    if (iand(need, need_jacobian + need_gamma) == 0) exit
                    call get_coefficients(this%velocities(k), pose, n, g)
                    associate (formula => formulas(this%coefficients(k)))
                        call formula%read_state(t, pose, coordinates, with_rates)
                        if (with_rates) then
                            call formula%pieces%evaluate_along(formula%x, formula%v, value, rate, curve)
                            gamma = gamma + rate*derivative(this%velocities(k), pose, 1, g)
                        else
                            value = formula%value()
                        end if
                    end associate
                    if (iand(need, need_jacobian) /= 0) then
                        c = column_of_c(this%velocities(k), pose)
                        terms%jacobian(this%row, c:c + n - 1) = terms%jacobian(this%row, c:c + n - 1) + value*g(:n)
                    end if
                end do
                value = 0.0_wp
                if (this%rhs > 0 .and. iand(need, need_nu + need_gamma) /= 0) then
                    associate (formula => formulas(this%rhs))
                        call formula%read_state(t, pose, coordinates, with_rates)
                        if (with_rates) then
                            call formula%pieces%evaluate_along(formula%x, formula%v, value, rate, curve)
                            gamma = gamma - rate
                        else
                            value = formula%value()
                        end if
                    end associate
                end if
                if (iand(need, need_nu) /= 0) terms%nu(this%row) = value
                if (with_rates) terms%gamma(this%row) = gamma
            end associate
        end do
    end subroutine evaluate_rate_rows

    !> Add the requested gradient blocks of every row. The blocks are zero on entry, and the poses have second derivatives.
    subroutine differentiate_rate_rows(rows, need, t, pose, lambda, formulas, coordinates, derivatives)
        type(rate_row_type), intent(in) :: rows(:)
        integer, intent(in) :: need
        real(wp), intent(in) :: t
        type(pose_type), intent(in) :: pose(0:)
        real(wp), intent(in) :: lambda(:)
        type(formula_type), intent(inout) :: formulas(:)
        type(coordinate_type), intent(inout) :: coordinates(:)
        type(derivatives_type), intent(inout) :: derivatives
        real(wp) :: g(4)
        integer :: i, k, c, n

        do i = 1, size(rows)
            associate (this => rows(i))
                do k = 1, size(this%coefficients)
                    associate (velocity => this%velocities(k), formula => formulas(this%coefficients(k)))
                        c = column(velocity, pose)
                        call get_coefficients(velocity, pose, n, g)
                        call add_part(this%row, formula, derivative(velocity, pose, 1, g), derivative(velocity, pose, 2, g), c, &
                            g(:n))
                        if (n > 1) call add_rotation(this%row, velocity, formula, c)
                    end associate
                end do
                if (this%rhs > 0) call add_part(this%row, formulas(this%rhs), -1.0_wp, 0.0_wp, 1, [real(wp) ::])
            end associate
        end do

    contains

        !> Add the gradient of c v for constant g, or of -e.
        subroutine add_part(row, formula, v, v_rate, c, g)
            integer, intent(in) :: row
            type(formula_type), intent(inout) :: formula
            !> v = g'qd(c:) and its rate; first column c of the velocity and its coefficients g, which are empty for -e.
            real(wp), intent(in) :: v, v_rate
            integer, intent(in) :: c
            real(wp), intent(in) :: g(:)
            real(wp) :: value, rate
            integer :: k, j, l, m

            call formula%read_state(t, pose, coordinates, .true.)
            call formula%pieces%evaluate_gradient_along(formula%x, formula%v, value, rate, formula%gradient, formula%gradient_rate)
            associate (d => derivatives, by => formula%gradient, by_rate => formula%gradient_rate)
                if (iand(need, need_acceleration_qd) /= 0) then
                    do m = 1, size(g)
                        l = d%column_of(c + m - 1)
                        d%acceleration_qd(row, l) = d%acceleration_qd(row, l) + rate*g(m)
                    end do
                end if
                do k = 1, size(formula%variables)
                    j = d%column_of(column(formula%variables(k), pose))
                    if (j == 0) cycle
                    if (iand(need, need_velocity_q) /= 0) d%velocity_q(row, j) = d%velocity_q(row, j) + v*by(k)
                    if (iand(need, need_acceleration_q) /= 0) then
                        d%acceleration_q(row, j) = d%acceleration_q(row, j) + v_rate*by(k) + v*by_rate(k)
                    end if
                    if (iand(need, need_acceleration_qd) /= 0) d%acceleration_qd(row, j) = d%acceleration_qd(row, j) + v*by(k)
                    if (iand(need, need_dynamics_q) /= 0) then
                        do m = 1, size(g)
                            d%dynamics_q(c + m - 1, j) = d%dynamics_q(c + m - 1, j) + lambda(row)*g(m)*by(k)
                        end do
                    end if
                end do
            end associate
        end subroutine add_part

        !> Add the gradient of c v due to g, for v a component of an angular velocity. Uses the variables of the formula of c that
        !> `add_part` has read.
        subroutine add_rotation(row, velocity, formula, c)
            integer, intent(in) :: row
            type(variable_type), intent(in) :: velocity
            type(formula_type), intent(inout) :: formula
            !> First column of the Euler parameters.
            integer, intent(in) :: c
            real(wp) :: value, rate, curve, by_p(4), rate_by_p(4)
            integer :: l

            call formula%pieces%evaluate_along(formula%x, formula%v, value, rate, curve)
            by_p = -e_transposed_product(pose(velocity%owner)%p(:, 1), doubled_axis(velocity))
            rate_by_p = -e_transposed_product(pose(velocity%owner)%p(:, 2), doubled_axis(velocity))
            ! The columns of a body are consecutive.
            l = derivatives%column_of(c)
            associate (d => derivatives)
                if (iand(need, need_velocity_q) /= 0) d%velocity_q(row, l:l + 3) = d%velocity_q(row, l:l + 3) + value*by_p
                if (iand(need, need_acceleration_q) /= 0) then
                    d%acceleration_q(row, l:l + 3) = d%acceleration_q(row, l:l + 3) + value*rate_by_p + rate*by_p
                end if
                if (iand(need, need_dynamics_q) /= 0) d%dynamics_q(c:c + 3, l:l + 3) = d%dynamics_q(c:c + 3, l:l + 3) + &
                    lambda(row)*value*e_transposed_gradient(doubled_axis(velocity))
            end associate
        end subroutine add_rotation
    end subroutine differentiate_rate_rows
end module tandem_mechanism_rate_row
