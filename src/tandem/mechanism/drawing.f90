! SPDX-License-Identifier: MIT
!> Geometry of a mechanism for pictures: bodies in the reference configuration, and points, shapes, joints, wheels, forces and
!> sensors in the axes of the bodies to which they belong. All numbers are those with which the program computes; expressions,
!> parameters and repetitions are resolved.
module tandem_mechanism_drawing
    use tandem_kinds, only: wp
    use tandem_mechanism, only: mechanism_type
    use tandem_mechanism_body, only: body_type
    use tandem_mechanism_element_kind, only: element_kind_type
    use tandem_mechanism_function, only: function_type
    use tandem_mechanism_joint, only: joint_type, name_length
    use tandem_mechanism_massless_wheel, only: massless_wheel_type
    use tandem_mechanism_point_vector, only: point_vector_type
    use tandem_mechanism_rolling, only: roller_type
    use tandem_mechanism_sensor, only: of_distance, of_joint, of_kind, of_knife_edge, of_massless_wheel, of_wheel, &
        sensed_force, sensed_point, sensed_reaction, sensor_type
    use tandem_mechanism_vector, only: cross
    implicit none (type, external)
    private

    public :: drawing_type, element_type, take_drawing

    !> Columns of the table of bodies: mass; moments xx, yy, zz, xy, xz, yz of inertia; position; Euler parameters.
    integer, parameter :: body_columns = 14
    !> Number of times at which functions of time are listed.
    integer, parameter :: n_samples = 501

    !> An element at a body. Elements between two bodies have two entries with the same kind and name, in the order of the bodies.
    type :: element_type
        !> Table of the scene and type, such as `joint revolute`; a sensor of a reaction or a force also has the name of the
        !> element.
        character(len=2*name_length) :: kind = ''
        character(len=name_length) :: name = ''
        !> Index of the body, 0 for the ground.
        integer :: body = 0
        !> Position (m) and axis in the axes of the body; sizes (m), whose meaning depends on the kind.
        real(wp) :: position(3) = 0.0_wp, axis(3) = 0.0_wp, sizes(3) = 0.0_wp
    end type element_type

    !> Everything that a viewer needs besides the motion.
    type :: drawing_type
        real(wp) :: gravity(3) = 0.0_wp
        character(len=name_length), allocatable :: bodies(:)
        !> (bodies, body_columns)
        real(wp), allocatable :: body_values(:, :)
        type(element_type), allocatable :: elements(:)
        !> Functions of time that steer wheels or move planes, such as `front steer`.
        character(len=2*name_length), allocatable :: functions(:)
        !> Time (s), then value and rate of each function (samples, 1 + 2 functions).
        real(wp), allocatable :: samples(:, :)
    end type drawing_type

contains

    !> List the geometry of a complete mechanism.
    subroutine take_drawing(mechanism, drawing)
        class(mechanism_type), intent(in) :: mechanism
        type(drawing_type), intent(out) :: drawing
        integer, allocatable :: motions(:)
        integer :: i, n

        drawing%gravity = mechanism%gravity
        n = size(mechanism%bodies)
        allocate (drawing%bodies(n), drawing%body_values(n, body_columns))
        do i = 1, n
            drawing%bodies(i) = mechanism%bodies(i)%name
            drawing%body_values(i, :) = values_of(mechanism%bodies(i), mechanism%planar)
        end do
        ! Upper bounds: five entries per element, one per point, two per sensor.
        n = 5*mechanism%index_of%names%n + size(mechanism%points) + 2*size(mechanism%sensors)
        allocate (drawing%elements(n), drawing%functions(0), motions(0))
        n = 0
        do i = 1, mechanism%index_of%names%n
            call add_element(mechanism, i, drawing, n, motions)
        end do
        do i = 1, size(mechanism%points)
            associate (point => mechanism%points(i))
                ! Points given by coordinates have names with a colon.
                if (index(point%name, ':') == 0) call add(drawing, n, element_type('point', point%name, point%body, point%place))
            end associate
        end do
        call add_sensors(mechanism, drawing, n)
        drawing%elements = drawing%elements(:n)
        call sample(mechanism, motions, drawing%samples)
    end subroutine take_drawing

    !> Row of the table of bodies.
    pure function values_of(body, planar) result(values)
        type(body_type), intent(in) :: body
        logical, intent(in) :: planar
        real(wp) :: values(body_columns), p(4)

        p = body%p
        if (planar) p = [cos(body%angle/2), 0.0_wp, 0.0_wp, sin(body%angle/2)]
        associate (j => body%inertia)
            values = [body%mass, j(1, 1), j(2, 2), j(3, 3), j(1, 2), j(1, 3), j(2, 3), body%position, p]
        end associate
    end function values_of

    !> Append the entries of a named element.
    subroutine add_element(mechanism, k, drawing, n, motions)
        class(mechanism_type), intent(in) :: mechanism
        !> Index of the name.
        integer, intent(in) :: k
        type(drawing_type), intent(inout) :: drawing
        integer, intent(inout) :: n
        !> Functions of time that are used.
        integer, allocatable, intent(inout) :: motions(:)
        character(len=:), allocatable :: name
        integer :: i

        allocate (name, source=mechanism%index_of%names%name(k))
        i = mechanism%numbers(k)
        select case (mechanism%types(k))
        case (0)
            associate (body => mechanism%bodies(i))
                if (body%shape /= '') call add(drawing, n, element_type('shape '//body%shape, name, i, sizes=body%sizes))
            end associate
        case (of_joint)
            call add_joint(mechanism, mechanism%joints(i), 'joint '//mechanism%joints(i)%kind_name, name, drawing, n)
        case (of_distance)
            call add_pair(mechanism%distances(i), 'constraint distance', name, drawing, n)
        case (of_knife_edge)
            associate (edge => mechanism%knife_edges(i))
                call add(drawing, n, element_type('wheel knife_edge', name, edge%body, edge%point, edge%across))
            end associate
        case (of_wheel)
            call add_roller(mechanism%rollers(i), name, drawing, n, motions)
        case (of_massless_wheel)
            call add_massless_wheel(mechanism%massless_wheels(i), name, drawing, n, motions)
        case (of_kind + 1:)
            call add_kind(mechanism, mechanism%kinds(mechanism%types(k) - of_kind)%of, i, name, drawing, n)
        case default
            ! Rows by expressions are not visible.
        end select
    end subroutine add_element

    !> Append an entry.
    subroutine add(drawing, n, element)
        type(drawing_type), intent(inout) :: drawing
        integer, intent(inout) :: n
        type(element_type), intent(in) :: element

        n = n + 1
        drawing%elements(n) = element
    end subroutine add

    !> Append a function of time, unless it is absent.
    subroutine add_motion(drawing, name, motion, motions)
        type(drawing_type), intent(inout) :: drawing
        character(len=*), intent(in) :: name
        !> Index of the function, 0 if none.
        integer, intent(in) :: motion
        integer, allocatable, intent(inout) :: motions(:)
        character(len=len(drawing%functions)), allocatable :: longer(:)

        if (motion == 0) return
        allocate (longer(size(motions) + 1))
        longer(:size(motions)) = drawing%functions
        longer(size(longer)) = name
        call move_alloc(longer, drawing%functions)
        motions = [motions, motion]
    end subroutine add_motion

    !> Append the two ends of an element between two points.
    subroutine add_pair(vector, kind, name, drawing, n)
        type(point_vector_type), intent(in) :: vector
        character(len=*), intent(in) :: kind, name
        type(drawing_type), intent(inout) :: drawing
        integer, intent(inout) :: n

        call add(drawing, n, element_type(kind, name, vector%first, vector%s1))
        call add(drawing, n, element_type(kind, name, vector%second, vector%s2))
    end subroutine add_pair

    !> Append an element of the list of kinds: at its points, or at its joint.
    subroutine add_kind(mechanism, kind, i, name, drawing, n)
        class(mechanism_type), intent(in) :: mechanism
        class(element_kind_type), intent(in) :: kind
        !> Index of the element.
        integer, intent(in) :: i
        character(len=*), intent(in) :: name
        type(drawing_type), intent(inout) :: drawing
        integer, intent(inout) :: n
        integer :: k

        associate (it => kind%attachment(i), word => trim(kind%table())//' '//trim(kind%label()))
            do k = 1, 2
                if (it%is_drawn(k)) call add(drawing, n, element_type(word, name, it%body(k), it%point(:, k)))
            end do
            if (it%joint > 0) call add_joint(mechanism, mechanism%joints(it%joint), word, name, drawing, n)
        end associate
    end subroutine add_kind

    !> Append the two sides of a joint. The axis is that of rotation or sliding in the reference configuration.
    subroutine add_joint(mechanism, joint, kind, name, drawing, n)
        class(mechanism_type), intent(in) :: mechanism
        type(joint_type), intent(in) :: joint
        character(len=*), intent(in) :: kind, name
        type(drawing_type), intent(inout) :: drawing
        integer, intent(inout) :: n
        real(wp) :: r(3), a1(3, 3), a2(3, 3), axis(3)

        axis = joint%axes1(:, 3)
        if (mechanism%planar .and. joint%rotation == 0 .and. joint%kind_name /= 'revolute') axis = joint%axes1(:, 1)
        ! The first axis of these joints is that of the first body.
        if (any(joint%kind_name == [character(len=9) :: 'universal', 'gimbal'])) axis = joint%axes1(:, 1)
        call mechanism%frame_of(joint%first, r, a1)
        call mechanism%frame_of(joint%second, r, a2)
        call add(drawing, n, element_type(kind, name, joint%first, joint%s1, axis))
        call add(drawing, n, element_type(kind, name, joint%second, joint%s2, matmul(matmul(a1, axis), a2)))
    end subroutine add_joint

    !> Append a rolling body, its plane, and the motions of the plane. Sizes of a disk and a sphere are the radius and the radius of
    !> the rim's section, those of an ellipsoid its semi-axes; those of a plane are the direction in which it slides.
    subroutine add_roller(roller, name, drawing, n, motions)
        type(roller_type), intent(in) :: roller
        character(len=*), intent(in) :: name
        type(drawing_type), intent(inout) :: drawing
        integer, intent(inout) :: n
        integer, allocatable, intent(inout) :: motions(:)
        character(len=16) :: kind
        real(wp) :: sizes(3)

        kind = 'wheel disk'
        if (.not. norm2(roller%axis) > 0.0_wp) kind = 'wheel sphere'
        sizes = [roller%radius + roller%crown, roller%crown, 0.0_wp]
        if (roller%is_ellipsoid) then
            kind = 'wheel ellipsoid'
            sizes = sqrt(roller%squares)
        end if
        call add(drawing, n, element_type(kind, name, roller%body, roller%centre, roller%axis, sizes))
        associate (normal => roller%normal, pivot => roller%pivot)
            call add(drawing, n, element_type('plane', name, 0, pivot + (roller%height - dot_product(pivot, normal))*normal, &
                normal, roller%along))
        end associate
        call add_motion(drawing, name//' rise', roller%rise, motions)
        call add_motion(drawing, name//' rotation', roller%rotation, motions)
        call add_motion(drawing, name//' slide', roller%slide, motions)
    end subroutine add_roller

    !> Append a massless wheel with its strut, its steering axis, and its plane.
    subroutine add_massless_wheel(wheel, name, drawing, n, motions)
        type(massless_wheel_type), intent(in) :: wheel
        character(len=*), intent(in) :: name
        type(drawing_type), intent(inout) :: drawing
        integer, intent(inout) :: n
        integer, allocatable, intent(inout) :: motions(:)
        real(wp) :: pivot(3)

        call add(drawing, n, element_type('wheel massless', name, wheel%body, wheel%centre, wheel%axle, &
            [wheel%radius + wheel%crown, wheel%crown, 0.0_wp]))
        if (wheel%slide /= 0) call add(drawing, n, element_type('strut', name, wheel%body, wheel%centre, wheel%along))
        ! With the part u of the axle across the unit pivot p, `towards` is p x u, and u x (p x u) = |u|^2 p.
        pivot = cross(wheel%axle - wheel%fixed, wheel%towards)
        if (wheel%steer > 0 .and. norm2(pivot) > 0.0_wp) then
            call add(drawing, n, element_type('steering', name, wheel%body, wheel%centre, pivot/norm2(pivot)))
            call add_motion(drawing, name//' steer', wheel%steer, motions)
        end if
        call add(drawing, n, element_type('plane', name, 0, wheel%height*wheel%normal, wheel%normal))
        call add_motion(drawing, name//' rise', wheel%rise, motions)
    end subroutine add_massless_wheel

    !> Append the sensors of points, reactions and forces.
    subroutine add_sensors(mechanism, drawing, n)
        class(mechanism_type), intent(in) :: mechanism
        type(drawing_type), intent(inout) :: drawing
        integer, intent(inout) :: n
        integer :: i

        do i = 1, size(mechanism%sensors)
            associate (sensor => mechanism%sensors(i))
                ! The others are the results of elements.
                if (sensor%group /= 'sensors') cycle
                select case (sensor%kind)
                case (sensed_point)
                    call add(drawing, n, element_type('sensor point', sensor%name, sensor%vector%first, sensor%vector%s1))
                case (sensed_reaction)
                    call add(drawing, n, element_type('sensor reaction '//measured(sensor), sensor%name))
                case (sensed_force)
                    call add(drawing, n, element_type('sensor force '//measured(sensor), sensor%name))
                case default
                    ! Other sensors measure no single place.
                end select
            end associate
        end do

    contains

        !> Name of the measured element.
        function measured(sensor) result(name)
            type(sensor_type), intent(in) :: sensor
            character(len=name_length) :: name
            integer :: k

            name = ''
            associate (names => mechanism%index_of%names)
                do k = 1, names%n
                    if (mechanism%types(k) == sensor%of .and. mechanism%numbers(k) == sensor%number) name = names%name(k)
                end do
            end associate
        end function measured
    end subroutine add_sensors

    !> List values and rates of functions of time over the run.
    subroutine sample(mechanism, motions, samples)
        class(mechanism_type), intent(in) :: mechanism
        integer, intent(in) :: motions(:)
        real(wp), allocatable, intent(out) :: samples(:, :)
        class(function_type), allocatable :: f
        real(wp) :: values(0:2)
        integer :: i, k

        allocate (samples(merge(n_samples, 0, size(motions) > 0), 1 + 2*size(motions)))
        do k = 1, size(motions)
            if (allocated(f)) deallocate (f)
            ! A copy, because each time belongs to a smooth piece of its own.
            allocate (f, source=mechanism%motions(motions(k))%f)
            do i = 1, n_samples
                associate (s => real(i - 1, wp)/(n_samples - 1))
                    samples(i, 1) = (1 - s)*mechanism%times(1) + s*mechanism%times(2)
                end associate
                call f%hold(samples(i, 1))
                call f%evaluate(samples(i, 1), values)
                samples(i, 2*k:2*k + 1) = values(:1)
            end do
        end do
    end subroutine sample
end module tandem_mechanism_drawing
