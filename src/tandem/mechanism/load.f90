! SPDX-License-Identifier: MIT
!> Given forces and torques on a body: constants times a function of time, and expressions of the state.
module tandem_mechanism_load
    use tandem_kinds, only: wp
    use tandem_mechanism_coordinate, only: coordinate_type
    use tandem_mechanism_formula, only: formula_type
    use tandem_mechanism_pair, only: n_local
    use tandem_mechanism_pose, only: gradient_matrix, gradient_of, pose_type, second_gradient, turned
    use tandem_mechanism_vector, only: cross
    use tandem_model_derivatives, only: derivatives_type, need_dynamics_q, need_dynamics_qd
    use tandem_rigid_euler_parameters, only: e_transposed_gradient, e_transposed_product, g_transposed_product, t_matrix
    implicit none (type, external)
    private

    public :: load_type, add_loads, differentiate_loads, find_push

    !> A force (N) at a point of a body and a torque (N m), in world axes or axes of the body: constants times a function of time,
    !> plus one expression for each of the six components.
    type :: load_type
        integer :: body = 0
        real(wp) :: point(3) = 0.0_wp, force(3) = 0.0_wp, torque(3) = 0.0_wp
        logical :: in_body = .false.
        !> Indices of the function and of the expressions, 0 if none.
        integer :: motion = 0, formula(6) = 0
    end type load_type

contains

    !> Add given forces and torques. In body axes a force F at s adds 2 G' (s x F) to the force on p, and a torque T adds 2 G' T.
    pure subroutine add_loads(loads, t, pose, f, formulas, coordinates, force)
        type(load_type), intent(in) :: loads(:)
        real(wp), intent(in) :: t
        type(pose_type), intent(in) :: pose(0:)
        !> Values and derivatives of the functions of time.
        real(wp), intent(in), contiguous :: f(0:, :)
        type(formula_type), intent(inout) :: formulas(:)
        !> Coordinates of the joints.
        type(coordinate_type), intent(inout) :: coordinates(:)
        real(wp), intent(inout) :: force(:)
        real(wp) :: push(6), along(3), row(4)
        integer :: i, k

        do i = 1, size(loads)
            associate (load => loads(i), body => pose(loads(i)%body))
                call find_push(load, t, pose, f, formulas, coordinates, push)
                call resolve(load, body, push, along, row)
                do k = 1, body%n_place
                    force(body%place + k - 1) = force(body%place + k - 1) + along(k)
                end do
                do k = 1, body%n_turn
                    force(body%turn + k - 1) = force(body%turn + k - 1) + row(k)
                end do
            end associate
        end do
    end subroutine add_loads

    !> Force and torque, in the axes in which they are given.
    pure subroutine find_push(load, t, pose, f, formulas, coordinates, push)
        type(load_type), intent(in) :: load
        real(wp), intent(in) :: t
        type(pose_type), intent(in) :: pose(0:)
        real(wp), intent(in), contiguous :: f(0:, :)
        type(formula_type), intent(inout) :: formulas(:)
        type(coordinate_type), intent(inout) :: coordinates(:)
        real(wp), intent(out) :: push(6)
        integer :: k

        push(1:3) = load%force
        push(4:6) = load%torque
        if (load%motion > 0) push = f(0, load%motion)*push
        do k = 1, 6
            if (load%formula(k) == 0) cycle
            call formulas(load%formula(k))%read_state(t, pose, coordinates, .false.)
            push(k) = push(k) + formulas(load%formula(k))%value()
        end do
    end subroutine find_push

    !> Generalised force of a force and a torque.
    pure subroutine resolve(load, body, push, along, row)
        type(load_type), intent(in) :: load
        type(pose_type), intent(in) :: body
        !> Force and torque.
        real(wp), intent(in) :: push(6)
        real(wp), intent(out) :: along(3), row(4)

        along = push(1:3)
        if (load%in_body) along = turned(body, 0, along)
        row = 0.0_wp
        if (body%n_turn == 1) then
            row = gradient_of(body, 0, load%point, along)
            row(1) = row(1) + push(6)
        else if (body%n_turn == 4) then
            if (load%in_body) then
                row = 2*g_transposed_product(body%p(:, 0), push(4:6) + cross(load%point, push(1:3)))
            else
                row = gradient_of(body, 0, load%point, along)
                row = row + 2*e_transposed_product(body%p(:, 0), push(4:6))
            end if
        end if
    end subroutine resolve

    !> Add the requested gradient blocks of loads.
    pure subroutine differentiate_loads(loads, need, t, pose, f, formulas, coordinates, derivatives)
        type(load_type), intent(in) :: loads(:)
        integer, intent(in) :: need
        real(wp), intent(in) :: t
        type(pose_type), intent(in) :: pose(0:)
        real(wp), intent(in), contiguous :: f(0:, :)
        type(formula_type), intent(inout) :: formulas(:)
        type(coordinate_type), intent(inout) :: coordinates(:)
        type(derivatives_type), intent(inout) :: derivatives
        real(wp) :: h(4, 4), b(3, 4), moment(3), push(6), value
        integer :: i, j, k, l

        do i = 1, size(loads)
            associate (load => loads(i), body => pose(loads(i)%body), d => derivatives%dynamics_q)
                push(1:3) = load%force
                push(4:6) = load%torque
                if (load%motion > 0) push = f(0, load%motion)*push
                do k = 1, 6
                    if (load%formula(k) == 0) cycle
                    call differentiate_entry(load, k, need, t, pose, formulas(load%formula(k)), coordinates, value, derivatives)
                    push(k) = push(k) + value
                end do
                if (iand(need, need_dynamics_q) == 0) cycle
                if (load%in_body) then
                    b = gradient_matrix(body, 0, push(1:3))
                    do j = 1, body%n_turn
                        l = derivatives%column_of(body%turn + j - 1)
                        do k = 1, body%n_place
                            d(body%place + k - 1, l) = d(body%place + k - 1, l) - b(k, j)
                        end do
                    end do
                    ! In the plane the moment of a force fixed to the body is constant.
                    h = 0.0_wp
                    moment = push(4:6) + cross(load%point, push(1:3))
                    if (body%n_turn == 4) h = 2*t_matrix(moment)
                else
                    h = second_gradient(body, load%point, push(1:3))
                    if (body%n_turn == 4) h = h + 2*e_transposed_gradient(push(4:6))
                end if
                do j = 1, body%n_turn
                    l = derivatives%column_of(body%turn + j - 1)
                    do k = 1, body%n_turn
                        d(body%turn + k - 1, l) = d(body%turn + k - 1, l) - h(k, j)
                    end do
                end do
            end associate
        end do
    end subroutine differentiate_loads

    !> Add the derivatives of the expression of one component: its direction times its gradient.
    pure subroutine differentiate_entry(load, entry, need, t, pose, formula, coordinates, value, derivatives)
        type(load_type), intent(in) :: load
        !> Component, 1 to 6.
        integer, intent(in) :: entry, need
        real(wp), intent(in) :: t
        type(pose_type), intent(in) :: pose(0:)
        type(formula_type), intent(inout) :: formula
        type(coordinate_type), intent(inout) :: coordinates(:)
        real(wp), intent(out) :: value
        type(derivatives_type), intent(inout) :: derivatives
        real(wp) :: unit(6), along(3), row(4), by_q(n_local), by_qd(n_local)
        integer :: i, j, l, c(n_local)

        call formula%read_state(t, pose, coordinates, .false.)
        call formula%evaluate_gradient(value)
        unit = 0.0_wp
        unit(entry) = 1.0_wp
        call resolve(load, pose(load%body), unit, along, row)
        do i = 1, size(formula%variables)
            call formula%variable_gradient(i, pose, coordinates, by_q, by_qd, c)
            do j = 1, n_local
                if (c(j) == 0) cycle
                l = derivatives%column_of(c(j))
                if (iand(need, need_dynamics_q) /= 0) call add(derivatives%dynamics_q(:, l), formula%gradient(i)*by_q(j))
                if (iand(need, need_dynamics_qd) /= 0) call add(derivatives%dynamics_qd(:, l), formula%gradient(i)*by_qd(j))
            end do
        end do

    contains

        !> The force is on the right-hand side.
        pure subroutine add(column, factor)
            real(wp), intent(inout) :: column(:)
            real(wp), intent(in) :: factor
            integer :: k

            associate (body => pose(load%body))
                do k = 1, body%n_place
                    column(body%place + k - 1) = column(body%place + k - 1) - factor*along(k)
                end do
                do k = 1, body%n_turn
                    column(body%turn + k - 1) = column(body%turn + k - 1) - factor*row(k)
                end do
            end associate
        end subroutine add
    end subroutine differentiate_entry
end module tandem_mechanism_load
