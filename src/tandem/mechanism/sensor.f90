! SPDX-License-Identifier: MIT
!> Sensors are what is told of a motion besides its coordinates. Points with velocity and acceleration, the coordinates of joints
!> with turns counted, distances, energies. Each is measured at a state where the poses of the bodies with their derivatives are
!> known.
module tandem_mechanism_sensor
    use tandem_kinds, only: wp
    use tandem_mechanism_joint, only: name_length
    use tandem_mechanism_pose, only: pose_type, turned
    use tandem_mechanism_span, only: span_type, span_way
    use tandem_model, only: quantity_type
    use tandem_pack, only: pack_type
    implicit none (type, external)
    private

    public :: sensor_type, sensed_point, sensed_joint, sensed_distance, sensed_energy, quantities_of, width_of_sensor
    public :: measure_sensor, pack_sensor

    !> What a sensor measures.
    integer, parameter :: sensed_point = 1, sensed_joint = 2, sensed_distance = 3, sensed_energy = 4

    type :: sensor_type
        character(len=name_length) :: name = ''
        integer :: kind = 0
        !> The bodies and points; a point alone is the first.
        type(span_type) :: span
        !> Of a joint: whether it slides and whether it turns; the axis of sliding on the first body; x1, y1 on the first body and
        !> x2
        !> on the second, between which the angle is.
        logical :: slides = .false., turns = .false.
        real(wp) :: along(3) = 0.0_wp, x1(3) = 0.0_wp, y1(3) = 0.0_wp, x2(3) = 0.0_wp
        !> Whether both bodies move in the plane, so that their angles count the turns.
        logical :: planar = .false.
        !> What is added to the way and the angle; in the plane the angle of the drawing is in it.
        real(wp) :: zero = 0.0_wp
        !> The angle at the last time that was looked at, by which turns are counted, with its rate; before that, the angle is near
        !> 0.
        real(wp) :: last_time = -huge(1.0_wp), last_angle = 0.0_wp, last_rate = 0.0_wp
    end type sensor_type

    real(wp), parameter :: pi = acos(-1.0_wp)

contains

    !> How many numbers a sensor gives.
    pure integer function width_of_sensor(sensor) result(width)
        type(sensor_type), intent(in) :: sensor

        select case (sensor%kind)
        case (sensed_point)
            width = 9
        case (sensed_joint)
            width = 2*count([sensor%slides, sensor%turns])
        case (sensed_distance)
            width = 2
        case default
            width = 3
        end select
    end function width_of_sensor

    !> The datasets of a sensor.
    pure function quantities_of(sensor) result(list)
        type(sensor_type), intent(in) :: sensor
        type(quantity_type), allocatable :: list(:)
        character(len=:), allocatable :: name

        name = trim(sensor%name)
        select case (sensor%kind)
        case (sensed_point)
            list = [quantity_type(name//'/position', 3, 'm', 'place of the point: x, y, z'), &
                quantity_type(name//'/velocity', 3, 'm/s', 'its velocity'), &
                quantity_type(name//'/acceleration', 3, 'm/s^2', 'its acceleration')]
        case (sensed_joint)
            allocate (list(0))
            if (sensor%slides) list = [list, quantity_type(name//'/way', 0, 'm', 'how far the second side has slid'), &
                quantity_type(name//'/speed', 0, 'm/s', 'how fast it slides')]
            if (sensor%turns) list = [list, &
                quantity_type(name//'/angle', 0, 'rad', 'by how much the second side is turned, turns counted'), &
                quantity_type(name//'/rate', 0, 'rad/s', 'how fast it turns')]
        case (sensed_distance)
            list = [quantity_type(name//'/distance', 0, 'm', 'distance of the points'), &
                quantity_type(name//'/rate', 0, 'm/s', 'how fast it grows')]
        case default
            list = [quantity_type(name//'/kinetic', 0, 'J', 'kinetic energy'), &
                quantity_type(name//'/potential', 0, 'J', 'potential energy of gravity and springs'), &
                quantity_type(name//'/total', 0, 'J', 'their sum')]
        end select
    end function quantities_of

    !> Measure. Turns are counted from the last time, which must not be far: no body turns by half a turn more than its rates say.
    pure subroutine measure_sensor(sensor, t, pose, energies, values)
        type(sensor_type), intent(inout) :: sensor
        real(wp), intent(in) :: t
        !> With first and second derivatives.
        type(pose_type), intent(in) :: pose(0:)
        !> Kinetic and potential energy.
        real(wp), intent(in) :: energies(2)
        real(wp), intent(out) :: values(:)
        real(wp) :: d(3, 0:1)
        integer :: k, n

        select case (sensor%kind)
        case (sensed_point)
            associate (body => pose(sensor%span%first))
                do k = 0, 2
                    values(3*k + 1:3*k + 3) = body%r(:, k) + turned(body, k, sensor%span%s1)
                end do
            end associate
        case (sensed_joint)
            n = 0
            if (sensor%slides) then
                call measure_way(sensor, pose, values(1), values(2))
                n = 2
            end if
            if (sensor%turns) call measure_angle(sensor, t, pose, values(n + 1), values(n + 2))
        case (sensed_distance)
            d(:, 0) = span_way(sensor%span, pose, 0)
            d(:, 1) = span_way(sensor%span, pose, 1)
            values(1) = norm2(d(:, 0))
            values(2) = norm2(d(:, 1))
            if (values(1) > 0.0_wp) values(2) = dot_product(d(:, 0), d(:, 1))/values(1)
        case default
            values = [energies(1), energies(2), energies(1) + energies(2)]
        end select
    end subroutine measure_sensor

    !> The way along the axis, and its rate.
    pure subroutine measure_way(sensor, pose, way, rate)
        type(sensor_type), intent(in) :: sensor
        type(pose_type), intent(in) :: pose(0:)
        real(wp), intent(out) :: way, rate
        real(wp) :: a(3), d(3)

        a = turned(pose(sensor%span%first), 0, sensor%along)
        d = span_way(sensor%span, pose, 0)
        way = sensor%zero + dot_product(a, d)
        rate = dot_product(turned(pose(sensor%span%first), 1, sensor%along), d) + dot_product(a, span_way(sensor%span, pose, 1))
    end subroutine measure_way

    !> The angle about the axis with turns counted, and its rate.
    pure subroutine measure_angle(sensor, t, pose, angle, rate)
        type(sensor_type), intent(inout) :: sensor
        real(wp), intent(in) :: t
        type(pose_type), intent(in) :: pose(0:)
        real(wp), intent(out) :: angle, rate
        real(wp) :: c, s, expected, v(3), w(3), u(3), ud(3)

        associate (one => pose(sensor%span%first), two => pose(sensor%span%second))
            if (sensor%planar) then
                angle = sensor%zero + two%p(1, 0) - one%p(1, 0)
                rate = two%p(1, 1) - one%p(1, 1)
                return
            end if
            u = turned(two, 0, sensor%x2)
            ud = turned(two, 1, sensor%x2)
            v = turned(one, 0, sensor%x1)
            w = turned(one, 0, sensor%y1)
            c = dot_product(v, u)
            s = dot_product(w, u)
            rate = c*(dot_product(turned(one, 1, sensor%y1), u) + dot_product(w, ud)) - &
                s*(dot_product(turned(one, 1, sensor%x1), u) + dot_product(v, ud))
        end associate
        rate = rate/(c**2 + s**2)
        expected = sensor%last_angle
        if (sensor%last_time > -huge(t)) expected = expected + (t - sensor%last_time)*(sensor%last_rate + rate)/2
        angle = atan2(s, c)
        angle = angle + 2*pi*anint((expected - angle)/(2*pi))
        sensor%last_time = t
        sensor%last_angle = angle
        sensor%last_rate = rate
        angle = sensor%zero + angle
    end subroutine measure_angle

    !> What a run that goes on needs.
    subroutine pack_sensor(sensor, pack)
        type(sensor_type), intent(inout) :: sensor
        type(pack_type), intent(inout) :: pack

        call pack%item(sensor%last_time)
        call pack%item(sensor%last_angle)
        call pack%item(sensor%last_rate)
    end subroutine pack_sensor
end module tandem_mechanism_sensor
