! SPDX-License-Identifier: MIT
!> Builder for mechanisms: bodies, points, joints and forces are added one after the other. All geometry is given in one reference
!> configuration, in the world frame. Every procedure checks its arguments; its error states the element and the remedy.
!>
!> Points are named by text: `crank` is the centre of mass of the body crank, `crank.pin` a point of it, `ground.post` a point of
!> the ground.
module tandem_mechanism_builder
    use tandem_error, only: error_type
    use tandem_kinds, only: wp
    use tandem_mechanism_body, only: body_type, point_type
    use tandem_mechanism_coordinate, only: coordinate_type
    use tandem_mechanism_perpendicular, only: perpendicular_type
    use tandem_mechanism_definition, only: angle_type, definition_type, motion_type
    use tandem_mechanism_expression, only: expression_type
    use tandem_mechanism_formula, only: variable_type
    use tandem_mechanism_function, only: function_type
    use tandem_mechanism_velocity_joint, only: velocity_joint_type
    use tandem_mechanism_joint, only: name_length, placed_joint_type
    use tandem_mechanism_law, only: friction_law_type, law_type
    use tandem_mechanism_massless_wheel, only: massless_wheel_type
    use tandem_mechanism_plane, only: plane_type
    use tandem_mechanism_rate_row, only: rate_row_type
    use tandem_mechanism_rolling, only: knife_edge_type, roller_type
    use tandem_mechanism_sensor, only: sensor_type
    use tandem_mechanism_point_vector, only: point_vector_type
    use tandem_model, only: label_length
    implicit none (type, external)
    private

    public :: builder_type

    !> The builder.
    type, extends(definition_type) :: builder_type
    contains
        procedure :: add_body, add_point, add_joint, add_distance, add_coupling, add_rate_row
        procedure :: add_spring, add_torsion, add_friction, add_bushing, add_load
        procedure :: add_knife_edge, add_rolling_disk, add_rolling_sphere, add_massless_wheel
        procedure :: add_point_sensor, add_joint_sensor, add_distance_sensor, add_energy_sensor, add_balance_sensor
        procedure :: add_body_sensor, add_reaction_sensor, add_force_sensor
        procedure :: add_results, add_rolling_ellipsoid
        procedure, private :: check_name, take_point, take_pair, place_joint
    end type builder_type

    !> Tolerance of coincident points and perpendicular directions in the reference configuration (m, of the sizes of coordinates).
    real(wp), parameter :: tolerance = 1.0e-9_wp

    interface
        !> Add a joint between two bodies. Its position in the reference configuration is given by `at` or by points of the bodies;
        !> if one side is a point, the other side is at the same position.
        module subroutine add_joint(self, name, kind, first, second, error, at, axis, across, motion, open, pitch, hold, drive)
            implicit none (type, external)
            class(builder_type), intent(inout) :: self
            !> Name and kind: fixed, revolute, prismatic, cylindrical, spherical, universal, gimbal, planar, screw, point_on_line,
            !> point_on_plane, primitive; in the plane fixed, revolute, prismatic, point_on_line, primitive.
            character(len=*), intent(in) :: name, kind
            !> The two sides: bodies, or points of them.
            character(len=*), intent(in) :: first, second
            type(error_type), allocatable, intent(out) :: error
            !> In the world frame: position (m); axis (of rotation, of sliding, along the line, normal to the plane; for a universal
            !> joint that on the first body); direction closest to x1 (for a universal joint the axis on the second body).
            real(wp), intent(in), optional :: at(:), axis(:), across(:)
            !> Drives the freedom of a revolute or prismatic joint, or the freedom `drive` of a primitive: angle (rad) or
            !> displacement (m) of the second body from the reference configuration; at velocity level its rate drives the velocity.
            class(function_type), intent(in), optional :: motion
            !> True if its sides may be apart in the reference configuration; they coincide after the start has been assembled.
            logical, intent(in), optional :: open
            !> Of a screw: displacement of the second body along the axis per turn (m), negative for a left-hand thread.
            real(wp), intent(in), optional :: pitch
            !> Of a primitive: 0 (free), 1 (held at position level) or 2 (at velocity level) for the displacements along x1, y1,
            !> z1 and the rotations about x, y, z (in the plane x1, y1 and the angle). Level 2 constrains the velocity of the point
            !> of the second body, or its angular velocity, relative to the first body, along an axis of the second.
            integer, intent(in), optional :: hold(:)
            !> Driven freedom, as a place in `hold` with a nonzero entry.
            integer, intent(in), optional :: drive
        end subroutine add_joint

        !> Locate a joint or a bushing: its bodies, and its frame on each.
        module subroutine place_joint(self, label, joint, first, second, error, at, axis, across)
            implicit none (type, external)
            class(builder_type), intent(in) :: self
            character(len=*), intent(in) :: label, first, second
            !> Joint with its kind and `may_be_open`.
            type(placed_joint_type), intent(inout) :: joint
            type(error_type), allocatable, intent(out) :: error
            real(wp), intent(in), optional :: at(:), axis(:), across(:)
        end subroutine place_joint

        !> Constrain a sum of joint coordinates: gears, racks, belts, screws. sum of factor_i x_i = f(t), from the reference
        !> configuration on. The force on a coordinate is factor_i times that along the sum, positive if it accelerates the
        !> coordinate.
        module subroutine add_coupling(self, name, joints, factors, error, motion, locked, inertia)
            implicit none (type, external)
            class(builder_type), intent(inout) :: self
            character(len=*), intent(in) :: name
            !> Joints, at most 8, `joint.angle` or `joint.displacement` for a joint with both coordinates; their factors (the unit
            !> of the row is the unit of the first factor times that of its coordinate).
            character(len=*), intent(in) :: joints(:)
            real(wp), intent(in) :: factors(:)
            type(error_type), allocatable, intent(out) :: error
            !> f; 0 by default.
            class(function_type), intent(in), optional :: motion
            !> State at the start. If present, events can lock and free the coupling, which then has a coordinate of its own.
            logical, intent(in), optional :: locked
            !> Inertia of the sum >= 0 (kg m^2 if it is an angle). If present, the sum is free: a coordinate that forces and other
            !> couplings may name by `name`.
            real(wp), intent(in), optional :: inertia
        end subroutine add_coupling

        !> Add the row of a sum of coordinates, as a coupling without a name: sum of factor_i x_i = f(t).
        module subroutine add_sum(self, name, unit, coordinates, factors, motion, drops_turns)
            implicit none (type, external)
            class(builder_type), intent(inout) :: self
            !> Name of the row, and unit of its multiplier.
            character(len=*), intent(in) :: name, unit
            type(coordinate_type), intent(in) :: coordinates(:)
            real(wp), intent(in) :: factors(:)
            !> Index of f, 0 if none.
            integer, intent(in) :: motion
            !> True if full turns do not count.
            logical, intent(in) :: drops_turns
        end subroutine add_sum

        !> Add a row at velocity level by expressions: sum of c_i v_i = e, where c_i and e are expressions of t and of positions,
        !> angles and Euler parameters.
        module subroutine add_rate_row(self, name, velocities, coefficients, error, rhs)
            implicit none (type, external)
            class(builder_type), intent(inout) :: self
            character(len=*), intent(in) :: name
            !> The velocities v_i, as `body.vx` or in the plane `body.omega`.
            character(len=*), intent(in) :: velocities(:)
            !> Parsed with the current `variable_names()` of the mechanism.
            type(expression_type), intent(in) :: coefficients(:)
            type(error_type), allocatable, intent(out) :: error
            !> e; 0 by default.
            type(expression_type), intent(in), optional :: rhs
        end subroutine add_rate_row

        !> Constrain the distance of two points to a constant, by default that of the reference configuration, or a function of
        !> time.
        module subroutine add_distance(self, name, first, second, error, length, motion)
            implicit none (type, external)
            class(builder_type), intent(inout) :: self
            character(len=*), intent(in) :: name, first, second
            type(error_type), allocatable, intent(out) :: error
            !> Distance (m), > 0, or a function of time.
            real(wp), intent(in), optional :: length
            class(function_type), intent(in), optional :: motion
        end subroutine add_distance

        !> Add a spring and damper between two points.
        module subroutine add_spring(self, name, first, second, error, stiffness, damping, length, motion, law)
            implicit none (type, external)
            class(builder_type), intent(inout) :: self
            character(len=*), intent(in) :: name, first, second
            type(error_type), allocatable, intent(out) :: error
            !> N/m, N s/m (default 0), and the free length (m), by default that of the reference configuration.
            real(wp), intent(in), optional :: stiffness, damping, length
            !> Additional tension (N): a function of time, and a law of time, length and its rate.
            class(function_type), intent(in), optional :: motion
            class(law_type), intent(in), optional :: law
        end subroutine add_spring

        !> Add a spring and damper along the coordinate of a joint, such as the angle about its axis.
        module subroutine add_torsion(self, name, joint, error, stiffness, damping, angle, motion, law)
            implicit none (type, external)
            class(builder_type), intent(inout) :: self
            !> Name of the spring; name of the joint, which has an axis of rotation or of sliding, or `joint.angle` or
            !> `joint.displacement` for a joint with both.
            character(len=*), intent(in) :: name, joint
            type(error_type), allocatable, intent(out) :: error
            !> N m, N m s (default 0), and the torque-free angle from the reference configuration (rad, default 0); else N/m, N s/m,
            !> m.
            real(wp), intent(in), optional :: stiffness, damping, angle
            !> Additional torques (N m) or forces (N), positive if they accelerate the coordinate: a function of time, and a law of
            !> time, angle (or displacement) and its rate.
            class(function_type), intent(in), optional :: motion
            class(law_type), intent(in), optional :: law
        end subroutine add_torsion

        !> Add friction along the coordinate of a joint, regularised (see `friction_law_type`), either for a given normal force or
        !> for the reaction of the joint.
        module subroutine add_friction(self, name, joint, error, law, normal, radius, arm)
            implicit none (type, external)
            class(builder_type), intent(inout) :: self
            !> Name of the friction; name of the joint, as for `add_torsion`.
            character(len=*), intent(in) :: name, joint
            type(error_type), allocatable, intent(out) :: error
            !> Coefficients, transition speed and additional damping; the coefficient `static`, the largest one, at the transition
            !> speed, is equal to `dynamic` if it is 0. The law's normal force is not used.
            type(friction_law_type), intent(in) :: law
            !> Given normal force (N; times the radius, N m, for a rotation). If absent, the normal force is the reaction: its
            !> force, and its torque over `arm` (m) if `arm` is present; a rotation has friction at `radius` (m).
            real(wp), intent(in), optional :: normal, radius, arm
        end subroutine add_friction

        !> Add forces and torques between two frames, which coincide in the reference configuration.
        module subroutine add_bushing(self, name, first, second, error, stiffness, damping, at, axis, across)
            implicit none (type, external)
            class(builder_type), intent(inout) :: self
            !> Name of the bushing; the two sides, bodies or points of them.
            character(len=*), intent(in) :: name, first, second
            type(error_type), allocatable, intent(out) :: error
            !> Six entries (N/m, N m/rad) along and about x, y, z of the frame on the first body, or a symmetric matrix of 36
            !> entries, and the same for rates (N s/m, N m s/rad). In the plane three (x, y, angle), or 9.
            real(wp), intent(in), optional :: stiffness(:), damping(:)
            !> Position (m), z axis of the frame, and direction closest to x, in the world frame (in the plane `axis` is x).
            real(wp), intent(in), optional :: at(:), axis(:), across(:)
        end subroutine add_bushing

        !> Add a force at a point of a body, and a torque.
        module subroutine add_load(self, name, on, error, force, torque, in_body, motion, force_by, torque_by)
            implicit none (type, external)
            class(builder_type), intent(inout) :: self
            !> Name of the load; the body or the point of it.
            character(len=*), intent(in) :: name, on
            type(error_type), allocatable, intent(out) :: error
            !> N, and N m (one entry in the plane).
            real(wp), intent(in), optional :: force(:), torque(:)
            !> True if the components are along the axes of the body and rotate with it; default false, along the axes of the world.
            logical, intent(in), optional :: in_body
            !> Function of time by which both are multiplied.
            class(function_type), intent(in), optional :: motion
            !> Expressions added to the components, parsed with the current `variable_names()` of the mechanism.
            type(expression_type), intent(in), optional :: force_by(:), torque_by(:)
        end subroutine add_load

        !> Add a knife edge, or a wheel without lateral slip: the point does not move along `across`.
        module subroutine add_knife_edge(self, name, on, across, error, steer, about)
            implicit none (type, external)
            class(builder_type), intent(inout) :: self
            !> Name; point of a body at which the edge acts.
            character(len=*), intent(in) :: name, on
            !> Lateral direction, along the axle, in the world frame of the reference configuration; it is fixed to the body.
            real(wp), intent(in) :: across(:)
            type(error_type), allocatable, intent(out) :: error
            !> Steering by the angle (rad) by which `across` rotates relative to the body, and in space the axis of this rotation,
            !> perpendicular to `across`, in the world frame of the reference configuration.
            class(function_type), intent(in), optional :: steer
            real(wp), intent(in), optional :: about(:)
        end subroutine add_knife_edge

        !> Add a disk that rolls on a plane, with a sharp or a round rim.
        module subroutine add_rolling_disk(self, name, centre, radius, axis, error, plane, crown)
            implicit none (type, external)
            class(builder_type), intent(inout) :: self
            !> Name of the disk; its centre, a body or a point of it.
            character(len=*), intent(in) :: name, centre
            !> Radius (m), and axis of the disk in the world frame of the reference configuration.
            real(wp), intent(in) :: radius, axis(:)
            type(error_type), allocatable, intent(out) :: error
            !> z = 0 by default.
            type(plane_type), intent(in), optional :: plane
            !> Radius of the section of the rim, a torus with a middle line of radius `radius - crown` (m, default 0: a sharp rim).
            real(wp), intent(in), optional :: crown
        end subroutine add_rolling_disk

        !> Add a sphere that rolls on a plane.
        module subroutine add_rolling_sphere(self, name, centre, radius, error, plane)
            implicit none (type, external)
            class(builder_type), intent(inout) :: self
            character(len=*), intent(in) :: name, centre
            real(wp), intent(in) :: radius
            type(error_type), allocatable, intent(out) :: error
            !> z = 0 by default.
            type(plane_type), intent(in), optional :: plane
        end subroutine add_rolling_sphere

        !> Add an ellipsoid that rolls on a plane.
        module subroutine add_rolling_ellipsoid(self, name, centre, semi_axes, error, plane)
            implicit none (type, external)
            class(builder_type), intent(inout) :: self
            character(len=*), intent(in) :: name, centre
            !> Along the axes of the body (m).
            real(wp), intent(in) :: semi_axes(3)
            type(error_type), allocatable, intent(out) :: error
            !> z = 0 by default.
            type(plane_type), intent(in), optional :: plane
        end subroutine add_rolling_ellipsoid

        !> Add a massless wheel: it touches a plane, does not slip sideways, and rotates freely about its axle. It may be steered,
        !> and may slide on the body along a massless strut, whose displacement is a coordinate that forces and couplings may name
        !> like that of a joint.
        module subroutine add_massless_wheel(self, name, centre, radius, axis, error, along, steer, about, plane, crown)
            implicit none (type, external)
            class(builder_type), intent(inout) :: self
            !> Name of the wheel; its centre in the reference configuration, a body or a point of it.
            character(len=*), intent(in) :: name, centre
            !> Radius (m), and axle in the world frame of the reference configuration.
            real(wp), intent(in) :: radius, axis(:)
            type(error_type), allocatable, intent(out) :: error
            !> Direction of sliding in the world frame of the reference configuration; a wheel without it does not slide.
            real(wp), intent(in), optional :: along(:)
            !> Steering by the angle (rad) that the axle rotates relative to the body, and the axis of this rotation in the world
            !> frame of the reference configuration, by default the direction of sliding.
            class(function_type), intent(in), optional :: steer
            real(wp), intent(in), optional :: about(:)
            !> z = 0 by default; its only motion is the rise.
            type(plane_type), intent(in), optional :: plane
            !> Radius of the section of the rim, a torus with a middle line of radius `radius - crown` (m, default 0: a sharp rim).
            real(wp), intent(in), optional :: crown
        end subroutine add_massless_wheel

        !> Add a sensor of a point: its position, velocity and acceleration.
        module subroutine add_point_sensor(self, name, on, error)
            implicit none (type, external)
            class(builder_type), intent(inout) :: self
            !> Name of the sensor in files; the body or the point of it.
            character(len=*), intent(in) :: name, on
            type(error_type), allocatable, intent(out) :: error
        end subroutine add_point_sensor

        !> Add a sensor of a joint: displacement and angle of its second side, full turns included, and their rates.
        module subroutine add_joint_sensor(self, name, joint, error, zero, group)
            implicit none (type, external)
            class(builder_type), intent(inout) :: self
            !> Name of the sensor; name of the joint: revolute, prismatic, cylindrical or point_on_line.
            character(len=*), intent(in) :: name, joint
            type(error_type), allocatable, intent(out) :: error
            !> Value in the reference configuration (rad or m, default 0).
            real(wp), intent(in), optional :: zero
            !> Group of files, "sensors" by default.
            character(len=*), intent(in), optional :: group
        end subroutine add_joint_sensor

        !> Add a sensor of the distance between two points and its rate.
        module subroutine add_distance_sensor(self, name, first, second, error)
            implicit none (type, external)
            class(builder_type), intent(inout) :: self
            character(len=*), intent(in) :: name, first, second
            type(error_type), allocatable, intent(out) :: error
        end subroutine add_distance_sensor

        !> Add a sensor of the kinetic and the potential energy of the whole mechanism.
        module subroutine add_energy_sensor(self, name, error)
            implicit none (type, external)
            class(builder_type), intent(inout) :: self
            character(len=*), intent(in) :: name
            type(error_type), allocatable, intent(out) :: error
        end subroutine add_energy_sensor

        !> Add a sensor of the energy balance: both energies, work of motions and of forces without a potential, and residual.
        module subroutine add_balance_sensor(self, name, error, group)
            implicit none (type, external)
            class(builder_type), intent(inout) :: self
            character(len=*), intent(in) :: name
            type(error_type), allocatable, intent(out) :: error
            character(len=*), intent(in), optional :: group
        end subroutine add_balance_sensor

        !> Add a sensor of a body: position, orientation, velocities, acceleration, energies.
        module subroutine add_body_sensor(self, name, body, error, group)
            implicit none (type, external)
            class(builder_type), intent(inout) :: self
            character(len=*), intent(in) :: name, body
            type(error_type), allocatable, intent(out) :: error
            character(len=*), intent(in), optional :: group
        end subroutine add_body_sensor

        !> Add a sensor of the reaction of a joint, a wheel, a distance, a coupling or a row, and of the power of its motion.
        module subroutine add_reaction_sensor(self, name, element, error, group)
            implicit none (type, external)
            class(builder_type), intent(inout) :: self
            character(len=*), intent(in) :: name, element
            type(error_type), allocatable, intent(out) :: error
            character(len=*), intent(in), optional :: group
        end subroutine add_reaction_sensor

        !> Add a sensor of a spring, a torsion, a bushing or a load: force, length, energy, power.
        module subroutine add_force_sensor(self, name, element, error, group)
            implicit none (type, external)
            class(builder_type), intent(inout) :: self
            character(len=*), intent(in) :: name, element
            type(error_type), allocatable, intent(out) :: error
            character(len=*), intent(in), optional :: group
        end subroutine add_force_sensor

        !> Add results of many elements: each is a group of files named after the element, in the group of its kind.
        module subroutine add_results(self, kind, names, error)
            implicit none (type, external)
            class(builder_type), intent(inout) :: self
            !> bodies, joints, wheels, constraints or forces.
            character(len=*), intent(in) :: kind
            !> Names of elements, or the single name "all".
            character(len=*), intent(in) :: names(:)
            type(error_type), allocatable, intent(out) :: error
        end subroutine add_results

        !> Add a body. Without an inertia it is a point mass, which has no rotation.
        module subroutine add_body(self, name, mass, position, error, inertia, orientation, velocity, omega)
            implicit none (type, external)
            class(builder_type), intent(inout) :: self
            character(len=*), intent(in) :: name
            !> Mass (kg), and centre of mass in the reference configuration (m).
            real(wp), intent(in) :: mass, position(:)
            type(error_type), allocatable, intent(out) :: error
            !> About the centre of mass (kg m^2): one value in the plane; in space three principal values, or Jxx, Jyy, Jzz, Jxy,
            !> Jxz, Jyz, where Jxy is the entry of the matrix.
            real(wp), intent(in), optional :: inertia(:)
            !> Orientation in the reference configuration: an angle (rad) in the plane, four Euler parameters in space; by default
            !> that of the world.
            real(wp), intent(in), optional :: orientation(:)
            !> At the start: velocity of the centre (m/s), angular velocity in the world frame (rad/s, one entry in the plane).
            real(wp), intent(in), optional :: velocity(:), omega(:)
        end subroutine add_body

        !> Add a named point of a body or of the ground.
        module subroutine add_point(self, body, name, place, error)
            implicit none (type, external)
            class(builder_type), intent(inout) :: self
            !> Names of the body and of the point.
            character(len=*), intent(in) :: body, name
            !> In the frame of the body (m).
            real(wp), intent(in) :: place(:)
            type(error_type), allocatable, intent(out) :: error
        end subroutine add_point

        !> Check that a name is valid and new.
        module subroutine check_name(self, name, label, error)
            implicit none (type, external)
            class(builder_type), intent(inout) :: self
            character(len=*), intent(in) :: name, label
            type(error_type), allocatable, intent(out) :: error
        end subroutine check_name

        !> Find a body and a point of it from `body` or `body.point`.
        module subroutine take_point(self, label, text, body, place, is_point, error)
            implicit none (type, external)
            class(builder_type), intent(in) :: self
            character(len=*), intent(in) :: label, text
            integer, intent(out) :: body
            !> In the frame of the body.
            real(wp), intent(out) :: place(3)
            !> True if the text names a point.
            logical, intent(out) :: is_point
            type(error_type), allocatable, intent(out) :: error
        end subroutine take_point

        !> Find two points of two different bodies.
        module subroutine take_pair(self, label, one, other, pair, points, error)
            implicit none (type, external)
            class(builder_type), intent(in) :: self
            character(len=*), intent(in) :: label, one, other
            !> Its bodies and points are set.
            type(point_vector_type), intent(inout) :: pair
            !> True for each text that names a point.
            logical, intent(out) :: points(2)
            type(error_type), allocatable, intent(out) :: error
        end subroutine take_pair
    end interface
end module tandem_mechanism_builder
