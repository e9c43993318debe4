! SPDX-License-Identifier: MIT
!> Springs with dampers between two points. The tension f = k (l - l0) + c ld + u(t) + g(t, l, ld) is positive if it pulls the
!> ends together; the generalised force is -f l_q.
module tandem_mechanism_elements_spring
    use tandem_error, only: error_type
    use tandem_kinds, only: wp
    use tandem_mechanism_builder, only: builder_type
    use tandem_mechanism_context, only: context_type
    use tandem_mechanism_coordinate_force, only: coordinate_force_type, energy_along, force_along, measure_along, slopes_along
    use tandem_mechanism_described_points, only: take_points
    use tandem_mechanism_element_keys, only: key_length
    use tandem_mechanism_element_kind, only: attachment_type, element_kind_type, most_measured, word_length
    use tandem_mechanism_function, only: function_type
    use tandem_mechanism_key_reader, only: anything, not_negative, reader_type
    use tandem_mechanism_law, only: law_type
    use tandem_mechanism_pair, only: add_outer, columns, n_local, put_force
    use tandem_mechanism_point_vector, only: point_vector_type, vector_between, vector_gradient, vector_second
    use tandem_mechanism_pose, only: gradient_of, pose_type
    use tandem_mechanism_sensor, only: add_quantity, sensor_type
    use tandem_model, only: model_type, quantity_type
    use tandem_model_derivatives, only: derivatives_type
    implicit none (type, external)
    private

    public :: spring_kind_type, spring_type

    !> Force along the distance of two points. Its numbers are stiffness k (N/m), damping c (N s/m) and free length l0 (m).
    type :: spring_type
        type(point_vector_type) :: vector
        type(coordinate_force_type) :: force
    end type spring_type

    !> All springs.
    type, extends(element_kind_type) :: spring_kind_type
        type(spring_type), allocatable, private :: list(:)
    contains
        procedure, nopass :: label, read => read_spring, list_settings
        procedure :: append, attachment, add_forces, add_energy, differentiate, list_quantities, measure
    end type spring_kind_type

contains

    pure function label()
        character(len=word_length) :: label

        label = 'spring'
    end function label

    subroutine read_spring(reader, mechanism, n_points)
        type(reader_type), intent(inout) :: reader
        class(model_type), intent(inout) :: mechanism
        integer, intent(inout) :: n_points
        character(len=:), allocatable :: name
        character(len=key_length) :: points(2)
        real(wp), allocatable :: stiffness, damping, length
        class(function_type), allocatable :: motion
        class(law_type), allocatable :: law
        type(error_type), allocatable :: error

        select type (mechanism)
        class is (builder_type)
            name = reader%name
            call take_points(reader, 'between', mechanism, n_points, points, 'two points', .true.)
            stiffness = 0.0_wp
            call reader%get_number('stiffness', stiffness, anything, 'N/m', '')
            damping = 0.0_wp
            call reader%get_number('damping', damping, anything, 'N s/m', '')
            call reader%get_number('length', length, not_negative, 'm', &
                'length without force; default: length in the reference configuration')
            call reader%get_function('tension', motion, 'N', 'additional tension')
            call reader%get_law('law', 'length', law, 'N', 'additional tension, a function of t, length and rate')
            call reader%close_table()
            if (reader%failed()) return
            call mechanism%add_spring(name, trim(points(1)), trim(points(2)), error, stiffness, damping, length, motion, law)
        end select
        call reader%blame(error)
    end subroutine read_spring

    !> Append a spring with its numbers.
    pure subroutine append(self, spring, numbers)
        class(spring_kind_type), intent(inout) :: self
        type(spring_type), intent(in) :: spring
        real(wp), intent(in) :: numbers(3)

        call self%add(numbers)
        if (.not. allocated(self%list)) allocate (self%list(1))
        if (self%n > size(self%list)) self%list = [self%list, self%list]
        self%list(self%n) = spring
    end subroutine append

    pure function attachment(self, number)
        class(spring_kind_type), intent(in) :: self
        integer, intent(in) :: number
        type(attachment_type) :: attachment

        associate (vector => self%list(number)%vector)
            attachment%body = [vector%first, vector%second]
            attachment%point(:, 1) = vector%s1
            attachment%point(:, 2) = vector%s2
        end associate
        attachment%is_drawn = .true.
        attachment%is_line = .true.
        attachment%stiffness(1) = self%numbers(1, number)
    end function attachment

    !> stat > 0 if the length of a spring is zero, because the direction of its force is then undefined.
    pure subroutine add_forces(self, context, force, stat)
        class(spring_kind_type), intent(inout) :: self
        type(context_type), intent(inout) :: context
        real(wp), intent(inout) :: force(:)
        integer, intent(inout) :: stat
        real(wp) :: d(3), d1(3), u(3), length, rate, tension
        integer :: i

        do i = 1, self%n
            associate (spring => self%list(i))
                d = vector_between(spring%vector, context%pose, 0)
                d1 = vector_between(spring%vector, context%pose, 1)
                length = sqrt(d(1)**2 + d(2)**2 + d(3)**2)
                if (.not. length > 0.0_wp) then
                    stat = 1
                    return
                end if
                u = d/length
                rate = u(1)*d1(1) + u(2)*d1(2) + u(3)*d1(3)
                tension = force_along(spring%force, self%numbers(:, i), context, length, rate)
                u = tension*u
                call add_force(context%pose(spring%vector%first), spring%vector%s1, u, force)
                u = -u
                call add_force(context%pose(spring%vector%second), spring%vector%s2, u, force)
            end associate
        end do
    end subroutine add_forces

    !> Add a force, given in the world frame, that acts at a body-fixed point s.
    pure subroutine add_force(pose, s, along, force)
        type(pose_type), intent(in) :: pose
        real(wp), intent(in) :: s(3), along(3)
        real(wp), intent(inout) :: force(:)
        real(wp) :: row(4)
        integer :: k

        do k = 1, pose%n_place
            force(pose%place + k - 1) = force(pose%place + k - 1) + along(k)
        end do
        if (pose%n_turn == 0) return
        row = gradient_of(pose, 0, s, along)
        do k = 1, pose%n_turn
            force(pose%turn + k - 1) = force(pose%turn + k - 1) + row(k)
        end do
    end subroutine add_force

    !> Energy k (l - l0)^2/2.
    pure subroutine add_energy(self, context, energy)
        class(spring_kind_type), intent(inout) :: self
        type(context_type), intent(in) :: context
        real(wp), intent(inout) :: energy
        integer :: i

        do i = 1, self%n
            associate (spring => self%list(i))
                energy = energy + energy_along(self%numbers(:, i), norm2(vector_between(spring%vector, context%pose, 0)))
            end associate
        end do
    end subroutine add_energy

    pure subroutine differentiate(self, first, last, need, context, lambda, derivatives)
        class(spring_kind_type), intent(inout) :: self
        integer, intent(in) :: first, last, need
        type(context_type), intent(inout) :: context
        real(wp), intent(in) :: lambda(:)
        type(derivatives_type), intent(inout) :: derivatives
        real(wp) :: d(3, 0:1), gradient(n_local, 0:1), second(n_local, n_local), length, rate
        integer :: i

        do i = first, last
            associate (spring => self%list(i))
                d(:, 0) = vector_between(spring%vector, context%pose, 0)
                d(:, 1) = vector_between(spring%vector, context%pose, 1)
                length = norm2(d(:, 0))
                rate = dot_product(d(:, 0), d(:, 1))/length
                call vector_gradient(spring%vector, context%pose, 1, d, gradient)
                call vector_second(spring%vector, context%pose, d(:, 0), second)
                ! With w = d.d/2: l_q = w_q/l, l_qq = (w_qq - l_q l_q')/l.
                gradient(:, 0) = gradient(:, 0)/length
                gradient(:, 1) = (gradient(:, 1) - rate*gradient(:, 0))/length
                call add_outer(-1.0_wp, gradient(:, 0), gradient(:, 0), second)
                second = second/length
                call put_force(need, columns(context%pose(spring%vector%first), context%pose(spring%vector%second)), gradient, &
                    second, slopes_along(spring%force, self%numbers(:, i), context, length, rate), derivatives)
            end associate
        end do
    end subroutine differentiate

    subroutine list_quantities(self, sensor, list)
        class(spring_kind_type), intent(in) :: self
        type(sensor_type), intent(in) :: sensor
        type(quantity_type), allocatable, intent(inout) :: list(:)

        call add_quantity(sensor, list, 0, 'tension', 'N', 'tension between the points')
        call add_quantity(sensor, list, 3, 'force', 'N', 'force on the second point, in world axes')
        call add_quantity(sensor, list, 0, 'length', 'm', 'distance of the points')
        call add_quantity(sensor, list, 0, 'rate', 'm/s', 'rate of the distance')
        call add_quantity(sensor, list, 0, 'energy', 'J', 'potential energy')
        call add_quantity(sensor, list, 0, 'power', 'W', 'power of its dampers, laws and functions of time')
    end subroutine list_quantities

    pure subroutine measure(self, number, context, lambda, values, power)
        class(spring_kind_type), intent(inout) :: self
        integer, intent(in) :: number
        type(context_type), intent(inout) :: context
        real(wp), intent(in) :: lambda(:)
        real(wp), intent(out) :: values(most_measured), power
        real(wp) :: d(3), length, rate, tension

        associate (spring => self%list(number))
            d = vector_between(spring%vector, context%pose, 0)
            length = norm2(d)
            if (length > 0.0_wp) d = d/length
            rate = dot_product(d, vector_between(spring%vector, context%pose, 1))
            call measure_along(spring%force, self%numbers(:, number), context, length, rate, 0.0_wp, tension, power)
            values = [tension, -tension*d, length, rate, energy_along(self%numbers(:, number), length), power]
        end associate
    end subroutine measure

    pure subroutine list_settings(names)
        character(len=9), intent(out) :: names(3)

        names = [character(len=9) :: 'stiffness', 'damping', 'length']
    end subroutine list_settings
end module tandem_mechanism_elements_spring

!> Builder procedure for springs.
submodule(tandem_mechanism_builder) tandem_mechanism_elements_spring_builder
    use tandem_mechanism_elements_spring, only: spring_kind_type, spring_type
    use tandem_mechanism_refusal, only: refuse
    use tandem_mechanism_sensor, only: of_kind
    implicit none (type, external)

contains

    module procedure add_spring
        type(spring_type) :: spring
        real(wp) :: numbers(3)
        character(len=:), allocatable :: label
        integer :: k
        logical :: points(2)

        label = 'spring '//trim(name)
        call self%check_name(name, label, error)
        if (allocated(error)) return
        call self%take_pair(label, first, second, spring%vector, points, error)
        if (allocated(error)) return
        numbers = [0.0_wp, 0.0_wp, self%reference_length(spring%vector)]
        if (.not. numbers(3) > 0.0_wp) then
            call refuse(label//' has length zero in the reference configuration, hence no direction', 'move one of its ends', error)
            return
        end if
        if (present(stiffness)) numbers(1) = stiffness
        if (present(damping)) numbers(2) = damping
        if (present(length)) numbers(3) = length
        if (present(motion)) call self%take_motion(name, motion, -1, spring%force%motion)
        if (present(law)) call self%take_law(law, spring%force%law)
        k = self%kind_number('spring')
        select type (springs => self%kinds(k)%of)
        type is (spring_kind_type)
            call springs%append(spring, numbers)
            call self%keep_name(name, of_kind + k, springs%n)
        end select
    end procedure add_spring
end submodule tandem_mechanism_elements_spring_builder
