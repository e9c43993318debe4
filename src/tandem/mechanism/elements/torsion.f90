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
        measure_coordinate => measure, number_slide, subtract_force
    use tandem_mechanism_element_kind, only: attachment_type, element_kind_type, most_measured, visit_interface, word_length
    use tandem_mechanism_function, only: function_type
    use tandem_mechanism_key_reader, only: anything, reader_type
    use tandem_mechanism_law, only: law_type
    use tandem_mechanism_normal_force, only: normal_force, normal_force_type
    use tandem_mechanism_pair, only: columns, n_local, put_force
    use tandem_mechanism_sensor, only: add_quantity, sensor_type
    use tandem_model, only: model_type, quantity_type
    use tandem_model_derivatives, only: derivatives_type
    use tandem_pack, only: pack_type
    implicit none (type, external)
    private

    public :: torsion_kind_type, torsion_type

    !> Stiffness k (N m/rad, N/m), damping c (N m s/rad, N s/m), value x0 of x at which the spring exerts no torque or force (rad,
    !> m); indices of the function u(t) and of the force law g, 0 if none.
    type :: torsion_type
        type(coordinate_type) :: coordinate
        !> Index of the joint, 0 for a wheel or a coupling.
        integer :: joint = 0
        real(wp) :: stiffness = 0.0_wp, damping = 0.0_wp, angle = 0.0_wp
        integer :: motion = 0, law = 0
        !> For joint friction: the reaction whose magnitude is the normal force.
        type(normal_force_type) :: reaction
    end type torsion_type

    !> All torsions.
    type, extends(element_kind_type) :: torsion_kind_type
        type(torsion_type), allocatable, private :: list(:)
    contains
        procedure, nopass :: label, read => read_torsion, list_settings
        procedure :: append, fit, renumber, attachment, add_forces, add_rates, add_energy, differentiate, stiffest
        procedure :: list_quantities, measure, set, visit_coordinates, pack_state
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

    !> Append a torsion.
    pure subroutine append(self, torsion)
        class(torsion_kind_type), intent(inout) :: self
        type(torsion_type), intent(in) :: torsion

        if (.not. allocated(self%list)) allocate (self%list(1))
        if (self%n == size(self%list)) self%list = [self%list, self%list]
        self%n = self%n + 1
        self%list(self%n) = torsion
        self%counts_turns = .true.
    end subroutine append

    !> Multiply the law of the last torsion by the normal force of a reaction.
    pure subroutine set_reaction(self, reaction)
        class(torsion_kind_type), intent(inout) :: self
        type(normal_force_type), intent(in) :: reaction

        self%list(self%n)%reaction = reaction
    end subroutine set_reaction

    pure subroutine fit(self)
        class(torsion_kind_type), intent(inout) :: self

        if (self%n > 0) self%list = self%list(:self%n)
    end subroutine fit

    pure subroutine renumber(self, n_bodies, n_holonomic)
        class(torsion_kind_type), intent(inout) :: self
        integer, intent(in) :: n_bodies, n_holonomic
        integer :: i

        do i = 1, self%n
            call number_slide(self%list(i)%coordinate, n_bodies)
            associate (rows => self%list(i)%reaction%rows)
                where (rows < 0) rows = n_holonomic - rows
            end associate
        end do
    end subroutine renumber

    pure function attachment(self, number)
        class(torsion_kind_type), intent(in) :: self
        integer, intent(in) :: number
        type(attachment_type) :: attachment

        associate (it => self%list(number))
            attachment%body = [it%coordinate%first, it%coordinate%second]
            attachment%joint = it%joint
            attachment%slides = it%coordinate%kind == is_displacement
            attachment%needs_multipliers = it%reaction%n > 0
        end associate
    end function attachment

    pure subroutine add_forces(self, context, force, stat)
        class(torsion_kind_type), intent(inout) :: self
        type(context_type), intent(inout) :: context
        real(wp), intent(inout) :: force(:)
        integer, intent(inout) :: stat
        real(wp) :: x(0:1), gradient(n_local), resistance, g(0:2)
        integer :: i

        do i = 1, self%n
            associate (torsion => self%list(i))
                call find_slope(torsion%coordinate, context%pose, x, gradient)
                resistance = torsion%stiffness*(x(0) - torsion%angle) + torsion%damping*x(1)
                if (torsion%motion > 0) resistance = resistance - context%f(0, torsion%motion)
                ! Charts add friction on reactions.
                if (torsion%law > 0 .and. torsion%reaction%n == 0) then
                    call context%laws(torsion%law)%law%evaluate(context%t, x(0), x(1), g)
                    resistance = resistance - g(0)
                end if
                call subtract_force(torsion%coordinate, context%pose, resistance, gradient, force)
            end associate
        end do
    end subroutine add_forces

    pure subroutine add_rates(self, context, force, stat)
        class(torsion_kind_type), intent(inout) :: self
        type(context_type), intent(inout) :: context
        real(wp), intent(inout) :: force(:)
        integer, intent(inout) :: stat
        type(torsion_kind_type) :: rates

        if (self%n == 0) return
        rates%n = self%n
        allocate (rates%list, source=self%list)
        rates%list%stiffness = 0.0_wp
        rates%list%damping = 0.0_wp
        call rates%add_forces(context, force, stat)
    end subroutine add_rates

    !> Energy k (x - x0)^2/2.
    pure subroutine add_energy(self, context, energy)
        class(torsion_kind_type), intent(inout) :: self
        type(context_type), intent(in) :: context
        real(wp), intent(inout) :: energy
        real(wp) :: x
        integer :: i

        do i = 1, self%n
            call measure_coordinate(self%list(i)%coordinate, context%pose, x)
            energy = energy + self%list(i)%stiffness*(x - self%list(i)%angle)**2/2
        end do
    end subroutine add_energy

    pure subroutine differentiate(self, first, last, need, context, lambda, derivatives)
        class(torsion_kind_type), intent(inout) :: self
        integer, intent(in) :: first, last, need
        type(context_type), intent(inout) :: context
        real(wp), intent(in) :: lambda(:)
        type(derivatives_type), intent(inout) :: derivatives
        real(wp) :: x(0:2), gradient(n_local, 0:2), second(n_local, n_local), resistance(0:2), g(0:2)
        integer :: i

        do i = first, last
            associate (torsion => self%list(i))
                call differentiate_coordinate(torsion%coordinate, context%pose, 1, 1, x, gradient, second)
                resistance = [torsion%stiffness*(x(0) - torsion%angle) + torsion%damping*x(1), torsion%stiffness, torsion%damping]
                if (torsion%motion > 0) resistance(0) = resistance(0) - context%f(0, torsion%motion)
                if (torsion%law > 0) then
                    call context%laws(torsion%law)%law%evaluate(context%t, x(0), x(1), g)
                    if (torsion%reaction%n > 0) g = normal_force(torsion%reaction, lambda)*g
                    resistance = resistance - g
                end if
                call put_force(need, columns(context%pose(torsion%coordinate%first), context%pose(torsion%coordinate%second)), &
                    gradient(:, 0:1), second, resistance, derivatives)
            end associate
        end do
    end subroutine differentiate

    pure real(wp) function stiffest(self, mass, inertia) result(square)
        class(torsion_kind_type), intent(in) :: self
        real(wp), intent(in) :: mass, inertia
        integer :: i

        square = 0.0_wp
        do i = 1, self%n
            square = max(square, self%list(i)%stiffness/merge(inertia, mass, is_rotation(self%list(i)%coordinate)))
        end do
    end function stiffest

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

    !> The power of the part without a potential is this part times the rate.
    pure subroutine measure(self, number, context, lambda, values, power)
        class(torsion_kind_type), intent(inout) :: self
        integer, intent(in) :: number
        type(context_type), intent(inout) :: context
        real(wp), intent(in) :: lambda(:)
        real(wp), intent(out) :: values(most_measured), power
        real(wp) :: x(0:2), gradient(n_local, 0:2), g(0:2), given, rest

        associate (torsion => self%list(number))
            call differentiate_coordinate(torsion%coordinate, context%pose, 1, 0, x, gradient)
            given = 0.0_wp
            if (torsion%motion > 0) given = context%f(0, torsion%motion)
            if (torsion%law > 0) then
                call context%laws(torsion%law)%law%evaluate(context%t, x(0), x(1), g)
                if (torsion%reaction%n > 0) g(0) = normal_force(torsion%reaction, lambda)*g(0)
                given = given + g(0)
            end if
            rest = -torsion%damping*x(1) + given
            power = rest*x(1)
            values = 0.0_wp
            values(1:5) = [-torsion%stiffness*(x(0) - torsion%angle) + rest, x(0), x(1), &
                torsion%stiffness*(x(0) - torsion%angle)**2/2, power]
        end associate
    end subroutine measure

    pure subroutine list_settings(names)
        character(len=9), intent(out) :: names(3)

        names = [character(len=9) :: 'stiffness', 'damping', 'angle']
    end subroutine list_settings

    pure subroutine set(self, number, setting, value)
        class(torsion_kind_type), intent(inout) :: self
        integer, intent(in) :: number, setting
        real(wp), intent(in) :: value

        select case (setting)
        case (1)
            self%list(number)%stiffness = value
        case (2)
            self%list(number)%damping = value
        case default
            self%list(number)%angle = value
        end select
    end subroutine set

    pure subroutine visit_coordinates(self, visit, context)
        class(torsion_kind_type), intent(inout) :: self
        procedure(visit_interface) :: visit
        type(context_type), intent(in) :: context
        integer :: i

        do i = 1, self%n
            call visit(self%list(i)%coordinate, context%pose, context%f)
        end do
    end subroutine visit_coordinates

    subroutine pack_state(self, pack)
        class(torsion_kind_type), intent(inout) :: self
        type(pack_type), intent(inout) :: pack
        integer :: i

        do i = 1, self%n
            call pack%item(self%list(i)%coordinate%last)
            call pack%item(self%list(i)%stiffness)
            call pack%item(self%list(i)%damping)
            call pack%item(self%list(i)%angle)
        end do
    end subroutine pack_state

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
                call find_slope(torsion%coordinate, context%pose, x, gradient)
                call context%laws(torsion%law)%law%evaluate(context%t, x(0), x(1), g)
                call subtract_force(torsion%coordinate, context%pose, -g(0), gradient, directions(:, k))
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
        character(len=:), allocatable :: label
        integer :: k, type_of, number

        label = 'torsion '//trim(name)
        call self%check_name(name, label, error)
        if (allocated(error)) return
        call self%find_coordinate(label, joint, k, error)
        if (allocated(error)) return
        torsion%coordinate = self%at%coordinates(k)
        call self%find_element(joint(:index(joint//'.', '.') - 1), type_of, number)
        if (type_of == of_joint) torsion%joint = number
        if (present(angle)) torsion%angle = angle
        if (present(stiffness)) torsion%stiffness = stiffness
        if (present(damping)) torsion%damping = damping
        if (present(motion)) call self%take_motion(name, motion, -1, torsion%motion)
        if (present(law)) call self%take_law(law, torsion%law)
        k = self%kind_number('torsion')
        select type (torsions => self%kinds(k)%of)
        type is (torsion_kind_type)
            call torsions%append(torsion)
            call self%keep_name(name, of_kind + k, torsions%n)
        end select
    end procedure add_torsion
end submodule tandem_mechanism_elements_torsion_builder
