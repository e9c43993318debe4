! SPDX-License-Identifier: MIT
!> Sensors measure quantities of a motion other than its coordinates: points with velocity and acceleration, coordinates of joints
!> including full turns, distances, energies, bodies, reactions, forces. They are evaluated at a state for which the poses of the
!> bodies with their derivatives are set.
module tandem_mechanism_sensor
    use tandem_kinds, only: wp
    use tandem_mechanism_coordinate, only: coordinate_type, find_slope
    use tandem_mechanism_velocity_joint, only: angular_velocity
    use tandem_mechanism_joint, only: name_length
    use tandem_mechanism_pair, only: n_local
    use tandem_mechanism_pose, only: pose_type, turned
    use tandem_mechanism_point_vector, only: point_vector_type, vector_between
    use tandem_model, only: label_length, quantity_type
    use tandem_pack, only: pack_type
    implicit none (type, external)
    private

    public :: sensor_type, sensed_point, sensed_joint, sensed_distance, sensed_energy, quantities_of
    public :: begin_sensor, measure_sensor, pack_sensor, sensed_body, sensed_reaction, sensed_force, sensed_balance
    public :: of_joint, of_wheel, of_knife_edge, of_distance, of_row, of_massless_wheel, of_kind, most_rows, add_quantity

    !> Kinds of sensors.
    integer, parameter :: sensed_point = 1, sensed_joint = 2, sensed_distance = 3, sensed_energy = 4, sensed_body = 5
    integer, parameter :: sensed_reaction = 6, sensed_force = 7, sensed_balance = 8
    !> Elements with a reaction; `of_row` is a row by expressions.
    integer, parameter :: of_joint = 1, of_wheel = 2, of_knife_edge = 3, of_distance = 4, of_row = 5, of_massless_wheel = 6
    !> An element of the kind k in the list of kinds has the type of_kind + k.
    integer, parameter :: of_kind = 6
    !> Largest number of rows of an element: six freedoms, driven or not, and the row of a screw.
    integer, parameter :: most_rows = 7

    type :: sensor_type
        character(len=name_length) :: name = ''
        integer :: kind = 0
        !> Bodies and points; a single point is the first one.
        type(point_vector_type) :: vector
        !> Of a joint: true if it has a displacement; true if it has a rotation; copies of its coordinates.
        logical :: slides = .false., turns = .false.
        type(coordinate_type) :: displacement, rotation
        !> True if both bodies move in the plane, so that their angles include full turns.
        logical :: planar = .false.
        !> Offset of displacement and angle.
        real(wp) :: zero = 0.0_wp
        !> Time, angle and rate at the last evaluation, from which turns are counted; before it, the coordinate counts them.
        real(wp) :: last_time = -huge(1.0_wp), last_angle = 0.0_wp, last_rate = 0.0_wp
        !> Number of values, index of the first quantity and number of quantities, set by `define`; group of files.
        integer :: width = 0, first = 0, n_quantities = 0
        character(len=16) :: group = 'sensors'
        !> Element of the reaction or force, and its index in the list of its type; for a body its index.
        integer :: of = 0, number = 0
        !> Of a reaction: rows of C, true if a function of time drives one of them, true if events lock and free it, and unit of a
        !> multiplier.
        integer :: n_rows = 0, rows(most_rows) = 0
        logical :: is_driven = .false., can_be_freed = .false.
        character(len=label_length) :: unit = ''
        !> True for friction on a reaction.
        logical :: has_reaction_friction = .false.
        !> Names of the two bodies.
        character(len=label_length) :: between(2) = ''
        !> Of the balance: true once the energy at the start is set; this energy.
        logical :: has_begun = .false.
        real(wp) :: first_energy = 0.0_wp
    end type sensor_type

    real(wp), parameter :: pi = acos(-1.0_wp)

contains

    !> Datasets of a sensor.
    function quantities_of(sensor) result(list)
        type(sensor_type), intent(in) :: sensor
        type(quantity_type), allocatable :: list(:)

        allocate (list(0))
        select case (sensor%kind)
        case (sensed_point)
            call add_quantity(sensor, list, 3, 'position', 'm', 'position of the point: x, y, z')
            call add_quantity(sensor, list, 3, 'velocity', 'm/s', 'its velocity')
            call add_quantity(sensor, list, 3, 'acceleration', 'm/s^2', 'its acceleration')
        case (sensed_joint)
            if (sensor%slides) then
                call add_quantity(sensor, list, 0, 'displacement', 'm', 'displacement of the second side')
                call add_quantity(sensor, list, 0, 'speed', 'm/s', 'rate of the displacement')
            end if
            if (sensor%turns) then
                call add_quantity(sensor, list, 0, 'angle', 'rad', 'rotation of the second side, full rotations counted')
                call add_quantity(sensor, list, 0, 'rate', 'rad/s', 'rate of the angle')
            end if
        case (sensed_distance)
            call add_quantity(sensor, list, 0, 'distance', 'm', 'distance of the points')
            call add_quantity(sensor, list, 0, 'rate', 'm/s', 'rate of the distance')
        case (sensed_energy, sensed_balance)
            call add_quantity(sensor, list, 0, 'kinetic', 'J', 'kinetic energy')
            call add_quantity(sensor, list, 0, 'potential', 'J', 'potential energy of gravity and springs')
            if (sensor%kind == sensed_energy) then
                call add_quantity(sensor, list, 0, 'total', 'J', 'their sum')
            else
                call add_quantity(sensor, list, 0, 'work_of_motions', 'J', 'work that imposed motions have done since the start')
                call add_quantity(sensor, list, 0, 'work_of_forces', 'J', &
                    'work of loads, dampers and other forces without potential')
                call add_quantity(sensor, list, 0, 'residual', 'J', &
                    'change of energy minus this work since the start: 0 except for errors')
            end if
        case (sensed_body)
            call list_body(sensor, list)
        case (sensed_reaction)
            call list_reaction(sensor, list)
        case default
            ! The kind of a force lists its quantities.
        end select
    end function quantities_of

    !> Append a quantity.
    subroutine add_quantity(sensor, list, width, what, unit, meaning)
        type(sensor_type), intent(in) :: sensor
        type(quantity_type), allocatable, intent(inout) :: list(:)
        integer, intent(in) :: width
        character(len=*), intent(in) :: what, unit, meaning

        list = [quantity_type :: list, quantity_type(path=trim(sensor%name)//'/'//what, width=width, unit=unit, &
            meaning=meaning, group=sensor%group, between=sensor%between, &
            of_multipliers=sensor%kind == sensed_reaction .or. sensor%has_reaction_friction, &
            of_state=sensor%kind /= sensed_balance .and. what /= 'acceleration')]
    end subroutine add_quantity

    !> Datasets of a body.
    subroutine list_body(sensor, list)
        type(sensor_type), intent(in) :: sensor
        type(quantity_type), allocatable, intent(inout) :: list(:)

        call add_quantity(sensor, list, 3, 'position', 'm', 'position of the centre of mass: x, y, z')
        if (sensor%turns .and. sensor%planar) then
            call add_quantity(sensor, list, 0, 'orientation', 'rad', 'angle of its axes')
        else if (sensor%turns) then
            call add_quantity(sensor, list, 4, 'orientation', '1', 'Euler parameters, from its axes to the world''s')
        end if
        call add_quantity(sensor, list, 3, 'velocity', 'm/s', 'velocity of the centre of mass')
        if (sensor%turns) call add_quantity(sensor, list, 3, 'angular_velocity', 'rad/s', 'in the world''s axes')
        call add_quantity(sensor, list, 3, 'acceleration', 'm/s^2', 'acceleration of the centre of mass')
        call add_quantity(sensor, list, 0, 'kinetic_energy', 'J', 'kinetic energy')
        call add_quantity(sensor, list, 0, 'potential_energy', 'J', 'potential energy of gravity, 0 at the origin')
    end subroutine list_body

    !> Datasets of a reaction.
    subroutine list_reaction(sensor, list)
        type(sensor_type), intent(in) :: sensor
        type(quantity_type), allocatable, intent(inout) :: list(:)

        select case (sensor%of)
        case (of_joint)
            call add_quantity(sensor, list, 3, 'force', 'N', 'force of the first body on the second at the joint, in world axes')
            call add_quantity(sensor, list, 3, 'torque', 'N m', 'torque about the point of the joint, in world axes')
            call add_quantity(sensor, list, 3, 'force_body', 'N', 'the force in the axes of the second body')
            call add_quantity(sensor, list, 3, 'torque_body', 'N m', 'the torque in the axes of the second body')
        case (of_wheel, of_knife_edge, of_massless_wheel)
            call add_quantity(sensor, list, 3, 'position', 'm', 'contact point: x, y, z')
            call add_quantity(sensor, list, 3, 'force', 'N', 'force on the body there, in world axes')
            call add_quantity(sensor, list, 3, 'force_body', 'N', 'force on the body there, in body axes')
        case (of_distance)
            call add_quantity(sensor, list, 0, 'tension', 'N', 'tension between the points')
            call add_quantity(sensor, list, 3, 'force', 'N', 'force on the second point, in world axes')
        case default
            call add_quantity(sensor, list, 0, trim(merge('torque', 'force ', sensor%unit == 'N m')), trim(sensor%unit), &
                'along the sum of the row, positive if it accelerates the sum')
            if (sensor%can_be_freed) call add_quantity(sensor, list, 0, 'impulse', trim(sensor%unit)//' s', &
                'of the row at the last event with a velocity jump')
        end select
        if (sensor%is_driven) call add_quantity(sensor, list, 0, 'power', 'W', 'power that its motion gives to the mechanism')
    end subroutine list_reaction

    !> Evaluate a sensor. Turns are counted from the last evaluation: bodies rotate by at most half a turn more than their rates
    !> give.
    pure subroutine measure_sensor(sensor, t, pose, f, energies, values)
        type(sensor_type), intent(inout) :: sensor
        real(wp), intent(in) :: t
        !> First and second derivatives are set.
        type(pose_type), intent(in) :: pose(0:)
        !> Values and derivatives of the functions of time.
        real(wp), intent(in), contiguous :: f(0:, :)
        !> Kinetic and potential energy, of the mechanism or of the body.
        real(wp), intent(in) :: energies(2)
        real(wp), intent(out) :: values(:)
        real(wp) :: d(3, 0:1), x(0:1), gradient(n_local)
        integer :: k, n

        select case (sensor%kind)
        case (sensed_point)
            associate (body => pose(sensor%vector%first))
                do k = 0, 2
                    values(3*k + 1:3*k + 3) = body%r(:, k) + turned(body, k, sensor%vector%s1)
                end do
            end associate
        case (sensed_joint)
            n = 0
            if (sensor%slides) then
                call find_slope(sensor%displacement, pose, x, gradient)
                values(1:2) = [sensor%zero + x(0), x(1)]
                n = 2
            end if
            if (sensor%turns) call measure_angle(sensor, t, pose, f, values(n + 1), values(n + 2))
        case (sensed_distance)
            d(:, 0) = vector_between(sensor%vector, pose, 0)
            d(:, 1) = vector_between(sensor%vector, pose, 1)
            values(1) = norm2(d(:, 0))
            values(2) = norm2(d(:, 1))
            if (values(1) > 0.0_wp) values(2) = dot_product(d(:, 0), d(:, 1))/values(1)
        case (sensed_body)
            associate (body => pose(sensor%number))
                values(1:3) = body%r(:, 0)
                n = 3
                if (sensor%turns .and. sensor%planar) then
                    values(4) = body%p(1, 0)
                    n = 4
                else if (sensor%turns) then
                    values(4:7) = body%p(:, 0)
                    n = 7
                end if
                values(n + 1:n + 3) = body%r(:, 1)
                n = n + 3
                if (sensor%turns) then
                    values(n + 1:n + 3) = angular_velocity(body, 0)
                    n = n + 3
                end if
                values(n + 1:n + 3) = body%r(:, 2)
                values(n + 4:n + 5) = energies
            end associate
        case default
            values = [energies(1), energies(2), energies(1) + energies(2)]
        end select
    end subroutine measure_sensor

    !> Angle about the axis including full turns, and its rate.
    pure subroutine measure_angle(sensor, t, pose, f, angle, rate)
        type(sensor_type), intent(inout) :: sensor
        real(wp), intent(in) :: t
        type(pose_type), intent(in) :: pose(0:)
        real(wp), intent(in), contiguous :: f(0:, :)
        real(wp), intent(out) :: angle, rate
        real(wp) :: expected, x(0:1), gradient(n_local)

        call find_slope(sensor%rotation, pose, x, gradient)
        rate = x(1)
        if (sensor%rotation%motion > 0) then
            expected = f(0, sensor%rotation%motion)
        else if (sensor%last_time > -huge(t)) then
            expected = sensor%last_angle + (t - sensor%last_time)*(sensor%last_rate + rate)/2
        else
            expected = x(0)
        end if
        ! In the plane the angle includes full turns.
        angle = x(0)
        if (.not. sensor%planar) angle = angle + 2*pi*anint((expected - angle)/(2*pi))
        sensor%last_time = t
        sensor%last_angle = angle
        sensor%last_rate = rate
        angle = sensor%zero + angle
    end subroutine measure_angle

    !> Reset a sensor at the start of a run.
    pure subroutine begin_sensor(sensor)
        type(sensor_type), intent(inout) :: sensor

        sensor%last_time = -huge(1.0_wp)
    end subroutine begin_sensor

    !> Pack the state for the continuation of a run.
    subroutine pack_sensor(sensor, pack)
        type(sensor_type), intent(inout) :: sensor
        type(pack_type), intent(inout) :: pack

        call pack%item(sensor%last_time, sensor%last_angle, sensor%last_rate)
        call pack%item(sensor%has_begun)
        call pack%item(sensor%first_energy)
    end subroutine pack_sensor
end module tandem_mechanism_sensor
