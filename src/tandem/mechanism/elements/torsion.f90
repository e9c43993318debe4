! SPDX-License-Identifier: MIT
!> Torsions, forces along the coordinate x of a joint: f = -k (x - x0) - c xd + u(t) + g(t, x, xd), positive if it accelerates the
!> coordinate. The generalised force is f x_q and its power f xd. Friction on the reaction of a joint is a torsion whose law g gives
!> the friction for a normal force of 1 N.
module tandem_mechanism_elements_torsion
    use tandem_error, only: error_type
    use tandem_kinds, only: wp
    use tandem_mechanism_builder, only: builder_type
    use tandem_mechanism_context, only: context_type
    use tandem_mechanism_coordinate, only: coordinate_type, differentiate_coordinate, find_slope, is_displacement, is_rotation, &
        measure_coordinate => measure, subtract_force
    use tandem_mechanism_coordinate_force, only: coordinate_force_type, energy_along, force_along, measure_along, slopes_along
    use tandem_mechanism_element_kind, only: attachment_type, element_kind_type, most_measured, word_length
    use tandem_mechanism_function, only: function_type
    use tandem_mechanism_key_reader, only: anything, reader_type
    use tandem_mechanism_law, only: law_type
    use tandem_mechanism_normal_force, only: normal_force, normal_force_type
    use tandem_mechanism_pair, only: columns, n_local, put_force
    use tandem_mechanism_sensor, only: add_quantity, sensor_type
    use tandem_model, only: model_type, quantity_type
    use tandem_model_derivatives, only: derivatives_type
    implicit none (type, external)
    private

    public :: torsion_kind_type, torsion_type

    !> Force along a joint coordinate. Its numbers are stiffness k (N m/rad, N/m), damping c (N m s/rad, N s/m), and the value x0
    !> of x at which the spring exerts no torque or force (rad, m).
    type :: torsion_type
        !> Index of the joint, 0 for a wheel or a coupling.
        integer :: joint = 0
        type(coordinate_force_type) :: force = coordinate_force_type(sense=-1.0_wp)
        !> For joint friction: the reaction whose magnitude is the normal force, and the law for a normal force of 1 N.
        type(normal_force_type) :: reaction
        integer :: friction = 0
    end type torsion_type

    !> All torsions; coordinate i is that of torsion i.
    type, extends(element_kind_type) :: torsion_kind_type
        type(torsion_type), allocatable, private :: list(:)
    contains
        procedure, nopass :: label, read => read_torsion, list_settings
        procedure :: append, renumber, attachment, add_forces, add_energy, differentiate, list_quantities, measure
        procedure :: set_reaction, n_frictions, add_friction_directions, set_normal_forces
    end type torsion_kind_type

contains

    pure function label()
        character(len=word_length) :: label

        label = 'torsion'
    end function label

    subroutine read_torsion(reader, mechanism, n_points)
        type(reader_type), intent(inout) :: reader
        class(model_type), intent(inout) :: mechanism
        integer, intent(inout) :: n_points
        character(len=:), allocatable :: name, joint
        real(wp), allocatable :: stiffness, damping, angle
        class(function_type), allocatable :: motion
        class(law_type), allocatable :: law
        type(error_type), allocatable :: error

        select type (mechanism)
        class is (builder_type)
            name = reader%name
            call reader%get('joint', joint, 'that rotates or slides; "joint.angle" or "joint.displacement" if it does both', &
                required=.true.)
            stiffness = 0.0_wp
            call reader%get_number('stiffness', stiffness, anything, 'N m/rad', '')
            damping = 0.0_wp
            call reader%get_number('damping', damping, anything, 'N m s/rad', '')
            angle = 0.0_wp
            call reader%get_number('angle', angle, anything, 'rad', 'angle without torque, from the reference configuration')
            call reader%get_function('torque', motion, 'N m', 'additional torque, positive if it accelerates the angle')
            call reader%get_law('law', 'angle', law, 'N m', &
                'additional torque, a function of t, angle and rate, with the same sign')
            call reader%close_table()
            if (reader%failed()) return
            call mechanism%add_torsion(name, joint, error, stiffness, damping, angle, motion, law)
        end select
        call reader%blame(error)
    end subroutine read_torsion

    !> Append a torsion with its numbers and its coordinate.
    pure subroutine append(self, torsion, numbers, coordinate)
        class(torsion_kind_type), intent(inout) :: self
        type(torsion_type), intent(in) :: torsion
        real(wp), intent(in) :: numbers(3)
        type(coordinate_type), intent(in) :: coordinate

        call self%add(numbers, [coordinate])
        if (.not. allocated(self%list)) allocate (self%list(1))
        if (self%n > size(self%list)) self%list = [self%list, self%list]
        self%list(self%n) = torsion
        self%counts_turns = .true.
    end subroutine append

    !> Multiply the law of the last torsion by the normal force of a reaction.
    pure subroutine set_reaction(self, reaction)
        class(torsion_kind_type), intent(inout) :: self
        type(normal_force_type), intent(in) :: reaction

        if (reaction%n == 0) return
        associate (it => self%list(self%n))
            it%reaction = reaction
            it%friction = it%force%law
            it%force%law = 0
        end associate
    end subroutine set_reaction

    pure subroutine renumber(self, n_holonomic)
        class(torsion_kind_type), intent(inout) :: self
        integer, intent(in) :: n_holonomic
        integer :: i

        do i = 1, self%n
            associate (rows => self%list(i)%reaction%rows)
                where (rows < 0) rows = n_holonomic - rows
            end associate
        end do
    end subroutine renumber

    pure function attachment(self, number)
        class(torsion_kind_type), intent(in) :: self
        integer, intent(in) :: number
        type(attachment_type) :: attachment

        associate (coordinate => self%coordinates(number))
            attachment%body = [coordinate%first, coordinate%second]
            attachment%joint = self%list(number)%joint
            attachment%slides = coordinate%kind == is_displacement
            attachment%needs_multipliers = self%list(number)%reaction%n > 0
            attachment%stiffness(merge(2, 1, is_rotation(coordinate))) = self%numbers(1, number)
        end associate
    end function attachment

    !> Charts add friction on reactions.
    pure subroutine add_forces(self, context, force, stat)
        class(torsion_kind_type), intent(inout) :: self
        type(context_type), intent(inout) :: context
        real(wp), intent(inout) :: force(:)
        integer, intent(inout) :: stat
        real(wp) :: x(0:1), gradient(n_local), f
        integer :: i

        do i = 1, self%n
            call find_slope(self%coordinates(i), context%pose, x, gradient)
            f = force_along(self%list(i)%force, self%numbers(:, i), context, x(0), x(1))
            call subtract_force(self%coordinates(i), context%pose, -f, gradient, force)
        end do
    end subroutine add_forces

    !> Energy k (x - x0)^2/2.
    pure subroutine add_energy(self, context, energy)
        class(torsion_kind_type), intent(inout) :: self
        type(context_type), intent(in) :: context
        real(wp), intent(inout) :: energy
        real(wp) :: x
        integer :: i

        do i = 1, self%n
            call measure_coordinate(self%coordinates(i), context%pose, x)
            energy = energy + energy_along(self%numbers(:, i), x)
        end do
    end subroutine add_energy

    pure subroutine differentiate(self, first, last, need, context, lambda, derivatives)
        class(torsion_kind_type), intent(inout) :: self
        integer, intent(in) :: first, last, need
        type(context_type), intent(inout) :: context
        real(wp), intent(in) :: lambda(:)
        type(derivatives_type), intent(inout) :: derivatives
        real(wp) :: x(0:2), gradient(n_local, 0:2), second(n_local, n_local), f(0:2), g(0:2)
        integer :: i

        do i = first, last
            associate (torsion => self%list(i), coordinate => self%coordinates(i))
                call differentiate_coordinate(coordinate, context%pose, 1, 1, x, gradient, second)
                f = slopes_along(torsion%force, self%numbers(:, i), context, x(0), x(1))
                if (torsion%friction > 0) then
                    call context%laws(torsion%friction)%law%evaluate(context%t, x(0), x(1), g)
                    g = normal_force(torsion%reaction, lambda)*g
                    f = f + g
                end if
                call put_force(need, columns(context%pose(coordinate%first), context%pose(coordinate%second)), &
                    gradient(:, 0:1), second, -f, derivatives)
            end associate
        end do
    end subroutine differentiate

    subroutine list_quantities(self, sensor, list)
        class(torsion_kind_type), intent(in) :: self
        type(sensor_type), intent(in) :: sensor
        type(quantity_type), allocatable, intent(inout) :: list(:)

        if (sensor%slides) then
            call add_quantity(sensor, list, 0, 'force', 'N', 'along the coordinate, positive if it accelerates the coordinate')
            call add_quantity(sensor, list, 0, 'displacement', 'm', 'coordinate of the joint')
            call add_quantity(sensor, list, 0, 'speed', 'm/s', 'its rate')
        else
            call add_quantity(sensor, list, 0, 'torque', 'N m', 'about the axis, positive if it accelerates the angle')
            call add_quantity(sensor, list, 0, 'angle', 'rad', 'coordinate of the joint')
            call add_quantity(sensor, list, 0, 'rate', 'rad/s', 'its rate')
        end if
        call add_quantity(sensor, list, 0, 'energy', 'J', 'potential energy')
        call add_quantity(sensor, list, 0, 'power', 'W', 'power of its dampers, laws and functions of time')
    end subroutine list_quantities

    pure subroutine measure(self, number, context, lambda, values, power)
        class(torsion_kind_type), intent(inout) :: self
        integer, intent(in) :: number
        type(context_type), intent(inout) :: context
        real(wp), intent(in) :: lambda(:)
        real(wp), intent(out) :: values(most_measured), power
        real(wp) :: x(0:2), gradient(n_local, 0:2), g(0:2), friction

        associate (torsion => self%list(number), numbers => self%numbers(:, number))
            call differentiate_coordinate(self%coordinates(number), context%pose, 1, 0, x, gradient)
            friction = 0.0_wp
            if (torsion%friction > 0) then
                call context%laws(torsion%friction)%law%evaluate(context%t, x(0), x(1), g)
                friction = normal_force(torsion%reaction, lambda)*g(0)
            end if
            values = 0.0_wp
            call measure_along(torsion%force, numbers, context, x(0), x(1), friction, values(1), power)
            values(2:5) = [x(0), x(1), energy_along(numbers, x(0)), power]
        end associate
    end subroutine measure

    pure subroutine list_settings(names)
        character(len=9), intent(out) :: names(3)

        names = [character(len=9) :: 'stiffness', 'damping', 'angle']
    end subroutine list_settings

    !> Number of frictions on reactions.
    pure integer function n_frictions(self)
        class(torsion_kind_type), intent(in) :: self
        integer :: i

        n_frictions = count([(self%list(i)%reaction%n > 0, i=1, self%n)])
    end function n_frictions

    !> Generalised force of each friction on a reaction for a normal force of 1 N, g x_q, one column per friction.
    pure subroutine add_friction_directions(self, context, directions)
        class(torsion_kind_type), intent(inout) :: self
        type(context_type), intent(in) :: context
        !> Must be zero on entry.
        real(wp), intent(inout) :: directions(:, :)
        real(wp) :: x(0:1), gradient(n_local), g(0:2)
        integer :: i, k

        k = 0
        do i = 1, self%n
            associate (torsion => self%list(i))
                if (torsion%reaction%n == 0) cycle
                k = k + 1
                call find_slope(self%coordinates(i), context%pose, x, gradient)
                call context%laws(torsion%friction)%law%evaluate(context%t, x(0), x(1), g)
                call subtract_force(self%coordinates(i), context%pose, -g(0), gradient, directions(:, k))
            end associate
        end do
    end subroutine add_friction_directions

    !> Normal forces and their gradients with respect to the multipliers.
    pure subroutine set_normal_forces(self, lambda, value, gradient)
        class(torsion_kind_type), intent(in) :: self
        real(wp), intent(in) :: lambda(:)
        real(wp), intent(inout) :: value(:)
        !> Must be zero on entry.
        real(wp), intent(inout) :: gradient(:, :)
        integer :: i, j, k

        k = 0
        do i = 1, self%n
            associate (reaction => self%list(i)%reaction)
                if (reaction%n == 0) cycle
                k = k + 1
                value(k) = normal_force(reaction, lambda)
                if (.not. value(k) > 0.0_wp) cycle
                do j = 1, reaction%n
                    gradient(k, reaction%rows(j)) = reaction%weights(j)**2*lambda(reaction%rows(j))/value(k)
                end do
            end associate
        end do
    end subroutine set_normal_forces
end module tandem_mechanism_elements_torsion

!> Builder procedure for torsions.
submodule(tandem_mechanism_builder) tandem_mechanism_elements_torsion_builder
    use tandem_mechanism_elements_torsion, only: torsion_kind_type, torsion_type
    use tandem_mechanism_sensor, only: of_joint, of_kind
    implicit none (type, external)

contains

    module procedure add_torsion
        type(torsion_type) :: torsion
        real(wp) :: numbers(3)
        character(len=:), allocatable :: label
        integer :: coordinate, k, type_of, number

        label = 'torsion '//trim(name)
        call self%check_name(name, label, error)
        if (allocated(error)) return
        call self%find_coordinate(label, joint, coordinate, error)
        if (allocated(error)) return
        call self%find_element(joint(:index(joint//'.', '.') - 1), type_of, number)
        if (type_of == of_joint) torsion%joint = number
        numbers = 0.0_wp
        if (present(stiffness)) numbers(1) = stiffness
        if (present(damping)) numbers(2) = damping
        if (present(angle)) numbers(3) = angle
        if (present(motion)) call self%take_motion(name, motion, -1, torsion%force%motion)
        if (present(law)) call self%take_law(law, torsion%force%law)
        k = self%kind_number('torsion')
        select type (torsions => self%kinds(k)%of)
        type is (torsion_kind_type)
            call torsions%append(torsion, numbers, self%at%coordinates(coordinate))
            call self%keep_name(name, of_kind + k, torsions%n)
        end select
    end procedure add_torsion
end submodule tandem_mechanism_elements_torsion_builder
