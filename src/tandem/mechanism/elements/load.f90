! SPDX-License-Identifier: MIT
!> Loads, which are given forces and torques on a body: constants times a function of time, and expressions of the state.
module tandem_mechanism_elements_load
    use tandem_error, only: error_type
    use tandem_kinds, only: wp
    use tandem_mechanism_builder, only: builder_type
    use tandem_mechanism_context, only: context_type
    use tandem_mechanism_described_points, only: list_variables, take_point
    use tandem_mechanism_element_keys, only: key_length
    use tandem_mechanism_element_kind, only: attachment_type, element_kind_type, most_measured, word_length
    use tandem_mechanism_expression, only: expression_type
    use tandem_mechanism_formula, only: is_joint, is_joint_rate, is_time
    use tandem_mechanism_function, only: function_type
    use tandem_mechanism_key_reader, only: reader_type
    use tandem_mechanism_pair, only: n_local
    use tandem_mechanism_pose, only: gradient_matrix, gradient_of, pose_type, second_gradient, turned
    use tandem_mechanism_sensor, only: add_quantity, sensor_type
    use tandem_mechanism_vector, only: cross
    use tandem_mechanism_velocity_joint, only: angular_velocity
    use tandem_model, only: model_type, quantity_type
    use tandem_model_derivatives, only: derivatives_type, need_dynamics_q, need_dynamics_qd
    use tandem_rigid_euler_parameters, only: e_transposed_gradient, e_transposed_product, g_transposed_product, t_matrix
    implicit none (type, external)
    private

    public :: load_kind_type, load_type

    !> A force (N) at a point of a body and a torque (N m), in world axes or axes of the body: constants times a function of time,
    !> plus one expression for each of the six components.
    type :: load_type
        integer :: body = 0
        real(wp) :: point(3) = 0.0_wp, force(3) = 0.0_wp, torque(3) = 0.0_wp
        logical :: in_body = .false.
        !> Indices of the function and of the expressions, 0 if none.
        integer :: motion = 0, formula(6) = 0
    end type load_type

    !> All loads.
    type, extends(element_kind_type) :: load_kind_type
        type(load_type), allocatable, private :: list(:)
    contains
        procedure, nopass :: label, read => read_load
        procedure :: append, attachment, touch, add_forces, differentiate, list_quantities, measure
        procedure, private :: find_push
    end type load_kind_type

contains

    pure function label()
        character(len=word_length) :: label

        label = 'load'
    end function label

    subroutine read_load(reader, mechanism, n_points)
        type(reader_type), intent(inout) :: reader
        class(model_type), intent(inout) :: mechanism
        integer, intent(inout) :: n_points
        character(len=:), allocatable :: name, text
        character(len=key_length) :: point
        character(len=key_length), allocatable :: variables(:)
        real(wp), allocatable :: force(:), torque(:)
        class(function_type), allocatable :: motion
        type(expression_type), allocatable :: by_force(:), by_torque(:)
        type(error_type), allocatable :: error
        logical :: in_body

        select type (mechanism)
        class is (builder_type)
            name = reader%name
            call reader%get('on', text, 'a body, or a point of it', required=.true.)
            if (reader%failed()) return
            call take_point(reader, 'on', text, mechanism, n_points, point)
            allocate (variables(0))
            ! The number of variables grows with the number of bodies, and most loads need none.
            if (reader%has_text('force') .or. reader%has_text('torque')) call list_variables(mechanism, variables)
            call reader%get_expressions('force', [merge(2, 3, mechanism%planar)], variables, by_force, 'N', &
                'numbers, or expressions of t and the state, such as "rod.x" or "rod.vx"')
            call reader%get_expressions('torque', [merge(1, 3, mechanism%planar)], variables, by_torque, 'N m', &
                'torque, in the same form')
            call take_constants(by_force, force)
            call take_constants(by_torque, torque)
            if (.not. (reader%gives('force') .or. reader%gives('torque'))) then
                call reader%fail('', 'has neither force nor torque', 'give force = [...], torque = [...], or both')
            end if
            in_body = .false.
            call reader%get('in_body', in_body, 'true: they rotate with the body')
            call reader%get_function('factor', motion, '', 'factor, a function of time')
            call reader%close_table()
            if (reader%failed()) return
            call mechanism%add_load(name, trim(point), error, force, torque, in_body, motion, by_force, by_torque)
        end select
        call reader%blame(error)
    end subroutine read_load

    !> Convert expressions without variables to numbers.
    pure subroutine take_constants(expressions, numbers)
        type(expression_type), allocatable, intent(inout) :: expressions(:)
        real(wp), allocatable, intent(out) :: numbers(:)
        integer :: i

        if (.not. allocated(expressions)) return
        do i = 1, size(expressions)
            if (.not. expressions(i)%is_constant()) return
        end do
        numbers = [(expressions(i)%value([real(wp) ::]), i=1, size(expressions))]
        deallocate (expressions)
    end subroutine take_constants

    !> Append a load.
    pure subroutine append(self, load)
        class(load_kind_type), intent(inout) :: self
        type(load_type), intent(in) :: load

        call self%add()
        if (.not. allocated(self%list)) allocate (self%list(1))
        if (self%n > size(self%list)) self%list = [self%list, self%list]
        self%list(self%n) = load
    end subroutine append

    pure function attachment(self, number)
        class(load_kind_type), intent(in) :: self
        integer, intent(in) :: number
        type(attachment_type) :: attachment

        attachment%body(2) = self%list(number)%body
        attachment%point(:, 2) = self%list(number)%point
        attachment%is_drawn(2) = .true.
    end function attachment

    !> Bodies without repetition, beginning with the body on which the load acts.
    subroutine touch(self, number, context, n, bodies)
        class(load_kind_type), intent(in) :: self
        integer, intent(in) :: number
        type(context_type), intent(in) :: context
        integer, intent(out) :: n
        integer, allocatable, intent(inout) :: bodies(:)
        integer :: i, k

        n = 1
        bodies(1) = self%list(number)%body
        do k = 1, 6
            if (self%list(number)%formula(k) == 0) cycle
            associate (variables => context%formulas(self%list(number)%formula(k))%variables)
                do i = 1, size(variables)
                    select case (variables(i)%kind)
                    case (is_time)
                        cycle
                    case (is_joint, is_joint_rate)
                        call join(context%coordinates(variables(i)%owner)%first)
                        call join(context%coordinates(variables(i)%owner)%second)
                    case default
                        call join(variables(i)%owner)
                    end select
                end do
            end associate
        end do

    contains

        subroutine join(body)
            integer, intent(in) :: body

            if (body == 0 .or. any(bodies(:n) == body)) return
            if (n == size(bodies)) bodies = [bodies, bodies]
            n = n + 1
            bodies(n) = body
        end subroutine join
    end subroutine touch

    !> In body axes a force F at s adds 2 G' (s x F) to the force on p, and a torque T adds 2 G' T.
    pure subroutine add_forces(self, context, force, stat)
        class(load_kind_type), intent(inout) :: self
        type(context_type), intent(inout) :: context
        real(wp), intent(inout) :: force(:)
        integer, intent(inout) :: stat
        real(wp) :: push(6)
        integer :: i

        do i = 1, self%n
            call self%find_push(i, context, push)
            call add_push(self%list(i), context%pose(self%list(i)%body), push, force)
        end do
    end subroutine add_forces

    !> Force and torque, in the axes in which they are given, or their partial derivatives with respect to time.
    pure subroutine find_push(self, number, context, push)
        class(load_kind_type), intent(in) :: self
        integer, intent(in) :: number
        type(context_type), intent(inout) :: context
        real(wp), intent(out) :: push(6)
        real(wp) :: value
        integer :: k, time

        associate (load => self%list(number))
            push(1:3) = load%force
            push(4:6) = load%torque
            if (load%motion > 0) then
                push = context%f(0, load%motion)*push
            else if (context%only_rates) then
                push = 0.0_wp
            end if
            do k = 1, 6
                if (load%formula(k) == 0) cycle
                associate (formula => context%formulas(load%formula(k)))
                    call formula%read_state(context%t, context%pose, context%coordinates, .false.)
                    if (.not. context%only_rates) then
                        push(k) = push(k) + formula%value()
                        cycle
                    end if
                    time = findloc(formula%variables%kind, is_time, dim=1)
                    if (time == 0) cycle
                    call formula%evaluate_gradient(value)
                    push(k) = push(k) + formula%gradient(time)
                end associate
            end do
        end associate
    end subroutine find_push

    !> Add the generalised force of a force and a torque.
    pure subroutine add_push(load, body, push, force)
        type(load_type), intent(in) :: load
        type(pose_type), intent(in) :: body
        real(wp), intent(in) :: push(6)
        real(wp), intent(inout) :: force(:)
        real(wp) :: along(3), row(4)
        integer :: k

        call resolve(load, body, push, along, row)
        do k = 1, body%n_place
            force(body%place + k - 1) = force(body%place + k - 1) + along(k)
        end do
        do k = 1, body%n_turn
            force(body%turn + k - 1) = force(body%turn + k - 1) + row(k)
        end do
    end subroutine add_push

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

    pure subroutine differentiate(self, first, last, need, context, lambda, derivatives)
        class(load_kind_type), intent(inout) :: self
        integer, intent(in) :: first, last, need
        type(context_type), intent(inout) :: context
        real(wp), intent(in) :: lambda(:)
        type(derivatives_type), intent(inout) :: derivatives
        real(wp) :: h(4, 4), b(3, 4), moment(3), push(6), value
        integer :: i, j, k, l

        do i = first, last
            associate (load => self%list(i), body => context%pose(self%list(i)%body), d => derivatives%dynamics_q)
                push(1:3) = load%force
                push(4:6) = load%torque
                if (load%motion > 0) push = context%f(0, load%motion)*push
                do k = 1, 6
                    if (load%formula(k) == 0) cycle
                    call differentiate_entry(load, k, need, context, value, derivatives)
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
    end subroutine differentiate

    !> Add the derivatives of the expression of one component: its direction times its gradient.
    pure subroutine differentiate_entry(load, entry, need, context, value, derivatives)
        type(load_type), intent(in) :: load
        !> Component, 1 to 6.
        integer, intent(in) :: entry, need
        type(context_type), intent(inout) :: context
        real(wp), intent(out) :: value
        type(derivatives_type), intent(inout) :: derivatives
        real(wp) :: unit(6), along(3), row(4), by_q(n_local), by_qd(n_local)
        integer :: i, j, l, c(n_local)

        unit = 0.0_wp
        unit(entry) = 1.0_wp
        call resolve(load, context%pose(load%body), unit, along, row)
        associate (formula => context%formulas(load%formula(entry)))
            call formula%read_state(context%t, context%pose, context%coordinates, .false.)
            call formula%evaluate_gradient(value)
            do i = 1, size(formula%variables)
                call formula%variable_gradient(i, context%pose, context%coordinates, by_q, by_qd, c)
                do j = 1, n_local
                    if (c(j) == 0) cycle
                    l = derivatives%column_of(c(j))
                    if (iand(need, need_dynamics_q) /= 0) call add(derivatives%dynamics_q(:, l), formula%gradient(i)*by_q(j))
                    if (iand(need, need_dynamics_qd) /= 0) call add(derivatives%dynamics_qd(:, l), formula%gradient(i)*by_qd(j))
                end do
            end do
        end associate

    contains

        !> The force is on the right-hand side.
        pure subroutine add(column, factor)
            real(wp), intent(inout) :: column(:)
            real(wp), intent(in) :: factor
            integer :: k

            associate (body => context%pose(load%body))
                do k = 1, body%n_place
                    column(body%place + k - 1) = column(body%place + k - 1) - factor*along(k)
                end do
                do k = 1, body%n_turn
                    column(body%turn + k - 1) = column(body%turn + k - 1) - factor*row(k)
                end do
            end associate
        end subroutine add
    end subroutine differentiate_entry

    subroutine list_quantities(self, sensor, list)
        class(load_kind_type), intent(in) :: self
        type(sensor_type), intent(in) :: sensor
        type(quantity_type), allocatable, intent(inout) :: list(:)

        call add_quantity(sensor, list, 3, 'force', 'N', 'force on the second body, or on the loaded body, in world axes')
        call add_quantity(sensor, list, 3, 'torque', 'N m', 'torque about the point of application, in world axes')
        call add_quantity(sensor, list, 0, 'power', 'W', 'power of its dampers, laws and functions of time')
    end subroutine list_quantities

    pure subroutine measure(self, number, context, lambda, values, power)
        class(load_kind_type), intent(inout) :: self
        integer, intent(in) :: number
        type(context_type), intent(inout) :: context
        real(wp), intent(in) :: lambda(:)
        real(wp), intent(out) :: values(most_measured), power
        real(wp) :: push(6)

        call self%find_push(number, context, push)
        associate (load => self%list(number), body => context%pose(self%list(number)%body))
            if (load%in_body) then
                push(1:3) = turned(body, 0, push(1:3))
                push(4:6) = turned(body, 0, push(4:6))
            end if
            power = dot_product(push(1:3), body%r(:, 1) + turned(body, 1, load%point)) + &
                dot_product(push(4:6), angular_velocity(body, 0))
        end associate
        values = [push, power, 0.0_wp]
    end subroutine measure
end module tandem_mechanism_elements_load

!> Builder procedure for loads.
submodule(tandem_mechanism_builder) tandem_mechanism_elements_load_builder
    use tandem_error, only: to_text
    use tandem_mechanism_elements_load, only: load_kind_type, load_type
    use tandem_mechanism_refusal, only: refuse, take_vector
    use tandem_mechanism_sensor, only: of_kind
    use, intrinsic :: ieee_arithmetic, only: ieee_is_finite
    implicit none (type, external)

contains

    module procedure add_load
        type(load_type) :: load
        character(len=:), allocatable :: label
        integer :: k
        logical :: is_point

        label = 'load '//trim(name)
        call self%check_name(name, label, error)
        if (allocated(error)) return
        call self%take_point(label, on, load%body, load%point, is_point, error)
        if (allocated(error)) return
        if (load%body == 0) then
            call refuse(label//' acts on the ground', 'name a body', error)
            return
        end if
        if (present(force)) call take_vector(self%planar, label, 'force', force, load%force, error)
        if (allocated(error)) return
        if (present(torque)) then
            if (size(torque) /= merge(1, 3, self%planar) .or. .not. all(ieee_is_finite(torque))) then
                call refuse(label//': torque has '//to_text(size(torque))//' entries, or one that is not finite', &
                    'give one in the plane, three in space', error)
                return
            end if
            if (.not. self%bodies(load%body)%turns) then
                call refuse(label//' applies a torque to the point mass '//trim(self%bodies(load%body)%name), &
                    'give the body an inertia', error)
                return
            end if
            if (self%planar) then
                load%torque(3) = torque(1)
            else
                load%torque = torque
            end if
        end if
        if (present(in_body)) load%in_body = in_body
        if (present(force_by)) then
            if (size(force_by) /= merge(2, 3, self%planar)) call refuse(label//': force has '//to_text(size(force_by))// &
                ' expressions', 'give two in the plane, three in space', error)
        end if
        if (present(torque_by) .and. .not. allocated(error)) then
            if (size(torque_by) /= merge(1, 3, self%planar) .or. .not. self%bodies(load%body)%turns) then
                call refuse(label//': torque has '//to_text(size(torque_by))//' expressions, or applies a torque to a point mass', &
                    'give one in the plane, three in space, and name a body with inertia', error)
            end if
        end if
        if (allocated(error)) return
        if (present(force_by)) then
            do k = 1, size(force_by)
                call self%take_formula(force_by(k), load%formula(k))
            end do
        end if
        if (present(torque_by)) then
            do k = 1, size(torque_by)
                call self%take_formula(torque_by(k), load%formula(6 - size(torque_by) + k))
            end do
        end if
        if (present(motion)) call self%take_motion(name, motion, -1, load%motion)
        k = self%kind_number('load')
        select type (loads => self%kinds(k)%of)
        type is (load_kind_type)
            call loads%append(load)
            call self%keep_name(name, of_kind + k, loads%n)
        end select
    end procedure add_load
end submodule tandem_mechanism_elements_load_builder
