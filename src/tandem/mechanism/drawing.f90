! SPDX-License-Identifier: MIT
!> The words of mechanisms: bodies, points, joints, forces are added one after the other, each drawn in one and the same position
!> in the world's frame. Every word checks what it is given; its error names the element and what to do.
!>
!> Points are named by text: `crank` is the centre of mass of the body crank, `crank.pin` a point of it, `ground.post` one of the
!> ground.
module tandem_mechanism_drawing
    use tandem_error, only: error_type
    use tandem_kinds, only: wp
    use tandem_mechanism_body, only: body_type, point_type
    use tandem_mechanism_coordinate, only: coordinate_type
    use tandem_mechanism_coupling, only: coupling_type
    use tandem_mechanism_dot, only: dot_type
    use tandem_mechanism_drawn, only: angle_type, drawn_type, motion_type
    use tandem_mechanism_expression, only: expression_type
    use tandem_mechanism_force, only: bushing_type, spring_type, torsion_type
    use tandem_mechanism_formula, only: variable_type
    use tandem_mechanism_function, only: function_type
    use tandem_mechanism_glide, only: glide_type
    use tandem_mechanism_joint, only: name_length, placed_joint_type
    use tandem_mechanism_law, only: law_type
    use tandem_mechanism_load, only: load_type
    use tandem_mechanism_massless_wheel, only: massless_wheel_type
    use tandem_mechanism_rate_row, only: rate_row_type
    use tandem_mechanism_rolling, only: edge_type, roller_type
    use tandem_mechanism_sensor, only: sensor_type
    use tandem_mechanism_span, only: span_type
    use tandem_model, only: label_length
    implicit none (type, external)
    private

    public :: drawing_type

    !> The words.
    type, extends(drawn_type) :: drawing_type
    contains
        procedure :: add_body, add_point, add_joint, add_distance, add_coupling, add_rate_row
        procedure :: add_spring, add_torsion, add_friction, add_bushing, add_load
        procedure :: add_knife_edge, add_rolling_disk, add_rolling_sphere, add_massless_wheel
        procedure :: add_point_sensor, add_joint_sensor, add_distance_sensor, add_energy_sensor, add_balance_sensor
        procedure :: add_body_sensor, add_reaction_sensor, add_force_sensor
        procedure :: add_results, add_rolling_ellipsoid
        procedure, private :: check_name, take_point, take_pair, place_joint
    end type drawing_type

    !> Two points of the drawing meet, and directions are perpendicular, up to this (m, of the sizes of the coordinates).
    real(wp), parameter :: tolerance = 1.0e-9_wp

    interface
        !> A joint between two bodies. Where it is in the drawing is said by `at` or by points of the bodies; with one point, the
        !> other side is where that is.
        module subroutine add_joint(self, name, kind, first, second, error, at, axis, across, motion, open, pitch, hold, drive)
            implicit none (type, external)
            class(drawing_type), intent(inout) :: self
            !> Its name and what it is: fixed, revolute, prismatic, cylindrical, spherical, universal, planar, screw, point_on_line,
            !> point_on_plane, primitive; in the plane fixed, revolute, prismatic, point_on_line, primitive.
            character(len=*), intent(in) :: name, kind
            !> The two sides: bodies, or points of them.
            character(len=*), intent(in) :: first, second
            type(error_type), allocatable, intent(out) :: error
            !> In the world's frame: where it is (m); its axis (of turning, of sliding, along the line, normal to the plane; of a
            !> universal joint that on the first body); what x1 is nearest to (of a universal joint the axis on the second body).
            real(wp), intent(in), optional :: at(:), axis(:), across(:)
            !> Drives the freedom of a revolute or prismatic joint, or that of a primitive which `drive` says: angle (rad) or way
            !> (m) of the second body from the drawing; at velocity level its rate drives the velocity.
            class(function_type), intent(in), optional :: motion
            !> Whether its sides need not meet in the drawing: they do after the start was assembled.
            logical, intent(in), optional :: open
            !> Of a screw: how far the second body goes along the axis in a turn (m), negative for a left hand.
            real(wp), intent(in), optional :: pitch
            !> Of a primitive: for the ways along x1, y1, z1 and the turns about x, y, z (in the plane x1, y1 and the angle) 0 where
            !> it is free, 1 where it is held at position level, 2 at velocity level. Held there is the velocity of the second
            !> body's point, or its angular velocity, as seen from the first body, along an axis of the second.
            integer, intent(in), optional :: hold(:)
            !> Which of them the motion drives, as a place in `hold`, where it is not 0.
            integer, intent(in), optional :: drive
        end subroutine add_joint

        !> Where a joint or a bushing is: its bodies, and its frame on each.
        module subroutine place_joint(self, label, joint, first, second, error, at, axis, across, open)
            implicit none (type, external)
            class(drawing_type), intent(in) :: self
            character(len=*), intent(in) :: label, first, second
            !> Its kind is known.
            type(placed_joint_type), intent(inout) :: joint
            type(error_type), allocatable, intent(out) :: error
            real(wp), intent(in), optional :: at(:), axis(:), across(:)
            logical, intent(in), optional :: open
        end subroutine place_joint

        !> A sum of coordinates of joints that is held: gears, racks, belts, screws. sum of factor_i x_i = f(t), all counted from
        !> the drawing. The force on a coordinate is factor_i times that along the sum, positive where it accelerates it.
        module subroutine add_coupling(self, name, joints, factors, error, motion, locked)
            implicit none (type, external)
            class(drawing_type), intent(inout) :: self
            character(len=*), intent(in) :: name
            !> The joints, at most 4, `joint.angle` or `joint.way` where a joint has both; and their factors (the unit of the first
            !> factor times that of its coordinate is that of the row).
            character(len=*), intent(in) :: joints(:)
            real(wp), intent(in) :: factors(:)
            type(error_type), allocatable, intent(out) :: error
            !> f, which is 0 by default.
            class(function_type), intent(in), optional :: motion
            !> Events can lock and free it, and how it starts. It takes one coordinate more.
            logical, intent(in), optional :: locked
        end subroutine add_coupling

        !> A row at velocity level by expressions: sum of c_i v_i = e, where c_i and e are expressions of t and of places, angles
        !> and Euler parameters.
        module subroutine add_rate_row(self, name, velocities, coefficients, error, rhs)
            implicit none (type, external)
            class(drawing_type), intent(inout) :: self
            character(len=*), intent(in) :: name
            !> The velocities v_i, as `body.vx` or in the plane `body.omega`.
            character(len=*), intent(in) :: velocities(:)
            !> Parsed with `variable_names()` of the mechanism as it is.
            type(expression_type), intent(in) :: coefficients(:)
            type(error_type), allocatable, intent(out) :: error
            !> e, which is 0 by default.
            type(expression_type), intent(in), optional :: rhs
        end subroutine add_rate_row

        !> A distance between two points that is held, by default that of the drawing, or imposed.
        module subroutine add_distance(self, name, first, second, error, length, motion)
            implicit none (type, external)
            class(drawing_type), intent(inout) :: self
            character(len=*), intent(in) :: name, first, second
            type(error_type), allocatable, intent(out) :: error
            !> The distance (m), > 0, or a function of time for it.
            real(wp), intent(in), optional :: length
            class(function_type), intent(in), optional :: motion
        end subroutine add_distance

        !> A spring and damper along the way between two points.
        module subroutine add_spring(self, name, first, second, error, stiffness, damping, length, motion, law)
            implicit none (type, external)
            class(drawing_type), intent(inout) :: self
            character(len=*), intent(in) :: name, first, second
            type(error_type), allocatable, intent(out) :: error
            !> N/m, N s/m (default 0), and the length without force (m), by default that of the drawing.
            real(wp), intent(in), optional :: stiffness, damping, length
            !> Forces of traction (N) beside it: a function of time, and a law of time, length and its rate.
            class(function_type), intent(in), optional :: motion
            class(law_type), intent(in), optional :: law
        end subroutine add_spring

        !> A spring and damper along the coordinate of a joint, such as the angle about its axis.
        module subroutine add_torsion(self, name, joint, error, stiffness, damping, angle, motion, law)
            implicit none (type, external)
            class(drawing_type), intent(inout) :: self
            !> Its name, and the joint's: one with an axis to turn about or to slide along; `joint.angle` or `joint.way` where it
            !> has both.
            character(len=*), intent(in) :: name, joint
            type(error_type), allocatable, intent(out) :: error
            !> N m, N m s (default 0), and the angle from the drawing without torque (rad, default 0); of a way N/m, N s/m, m.
            real(wp), intent(in), optional :: stiffness, damping, angle
            !> Torques (N m) or forces (N) beside that, positive where they accelerate the coordinate: a function of time, and a law
            !> of time, angle (or way) and its rate.
            class(function_type), intent(in), optional :: motion
            class(law_type), intent(in), optional :: law
        end subroutine add_torsion

        !> Friction along the coordinate of a joint, regularised (see `friction_law_type`): under a given normal force, or on the
        !> reaction of the joint itself.
        module subroutine add_friction(self, name, joint, error, dynamic, speed, static, viscous, normal, radius, arm)
            implicit none (type, external)
            class(drawing_type), intent(inout) :: self
            !> Its name, and the joint's, as for `add_torsion`.
            character(len=*), intent(in) :: name, joint
            type(error_type), allocatable, intent(out) :: error
            !> The coefficient of sliding, and the transition speed (m/s, rad/s).
            real(wp), intent(in) :: dynamic, speed
            !> The largest coefficient, at that speed (default: that of sliding), and a damping beside it (N s/m, N m s).
            real(wp), intent(in), optional :: static, viscous
            !> A given normal force (N; of what turns times the radius, N m). Where it is not given, the reaction presses: its
            !> force, and its torque over `arm` (m) where that is given; what turns rubs at a `radius` (m).
            real(wp), intent(in), optional :: normal, radius, arm
        end subroutine add_friction

        !> Forces and torques that hold two frames together, which are one in the drawing.
        module subroutine add_bushing(self, name, first, second, error, stiffness, damping, at, axis, across)
            implicit none (type, external)
            class(drawing_type), intent(inout) :: self
            !> Its name and the two sides: bodies, or points of them.
            character(len=*), intent(in) :: name, first, second
            type(error_type), allocatable, intent(out) :: error
            !> Six entries (N/m, N m/rad) along and about x, y, z of the frame on the first body, or a symmetric matrix of 36, and
            !> the same for rates (N s/m, N m s/rad). In the plane three (x, y, angle), or 9.
            real(wp), intent(in), optional :: stiffness(:), damping(:)
            !> Where it is (m), z of the frame, and what x is nearest to, in the world's frame (in the plane `axis` is x).
            real(wp), intent(in), optional :: at(:), axis(:), across(:)
        end subroutine add_bushing

        !> A force at a point of a body, and a torque on it.
        module subroutine add_load(self, name, on, error, force, torque, in_body, motion, force_by, torque_by)
            implicit none (type, external)
            class(drawing_type), intent(inout) :: self
            !> Its name, and the body or the point of it.
            character(len=*), intent(in) :: name, on
            type(error_type), allocatable, intent(out) :: error
            !> N, and N m (one entry in the plane).
            real(wp), intent(in), optional :: force(:), torque(:)
            !> Whether they are in the body's axes and turn with it; default false, the world's.
            logical, intent(in), optional :: in_body
            !> A function of time that both are multiplied with.
            class(function_type), intent(in), optional :: motion
            !> Expressions for their entries, which are added. They were parsed with `variable_names()` of the mechanism as it is.
            type(expression_type), intent(in), optional :: force_by(:), torque_by(:)
        end subroutine add_load

        !> A knife edge, or a wheel that does not slip sideways: the point does not move along `across`.
        module subroutine add_knife_edge(self, name, on, across, error, steer, about)
            implicit none (type, external)
            class(drawing_type), intent(inout) :: self
            !> Its name, and the point of a body where it stands.
            character(len=*), intent(in) :: name, on
            !> The direction across it, along the wheel's axle, in the world's frame of the drawing; it turns with the body.
            real(wp), intent(in) :: across(:)
            type(error_type), allocatable, intent(out) :: error
            !> It is steered: the angle (rad) by which `across` turns in the body, and in space what it turns about, a direction
            !> perpendicular to it in the world's frame of the drawing.
            class(function_type), intent(in), optional :: steer
            real(wp), intent(in), optional :: about(:)
        end subroutine add_knife_edge

        !> A disk that rolls on a plane, with a sharp rim or one that is round across.
        module subroutine add_rolling_disk(self, name, centre, radius, axis, error, normal, height, open, rise, turn, pivot, &
            slide, along, crown)
            implicit none (type, external)
            class(drawing_type), intent(inout) :: self
            !> Its name, and its centre: a body, or a point of it.
            character(len=*), intent(in) :: name, centre
            !> Radius (m), and the disk's axis in the world's frame of the drawing.
            real(wp), intent(in) :: radius, axis(:)
            type(error_type), allocatable, intent(out) :: error
            !> The plane: its normal on the body's side, by default z, and its distance from the origin along it (m, default 0).
            real(wp), intent(in), optional :: normal(:), height
            !> Whether it need not touch the plane in the drawing.
            logical, intent(in), optional :: open
            !> The plane moves: how far it has risen along its normal (m), the angle by which it has turned about that (rad), and
            !> what it turns about (m, default the origin); how far it has gone (m) along a direction in it, the pivot with it.
            class(function_type), intent(in), optional :: rise, turn, slide
            real(wp), intent(in), optional :: pivot(:), along(:)
            !> The radius of the rim's section, a torus whose middle line has `radius - crown` (m, default 0: a sharp rim).
            real(wp), intent(in), optional :: crown
        end subroutine add_rolling_disk

        !> A sphere that rolls on a plane.
        module subroutine add_rolling_sphere(self, name, centre, radius, error, normal, height, open, rise, turn, &
            pivot, slide, along)
            implicit none (type, external)
            class(drawing_type), intent(inout) :: self
            character(len=*), intent(in) :: name, centre
            real(wp), intent(in) :: radius
            type(error_type), allocatable, intent(out) :: error
            !> The plane: its normal on the body's side, by default z, and its distance from the origin along it (m, default 0).
            real(wp), intent(in), optional :: normal(:), height
            !> Whether it need not touch the plane in the drawing.
            logical, intent(in), optional :: open
            !> The plane moves: how far it has risen along its normal (m), the angle by which it has turned about that (rad), and
            !> what it turns about (m, default the origin); how far it has gone (m) along a direction in it, the pivot with it.
            class(function_type), intent(in), optional :: rise, turn, slide
            real(wp), intent(in), optional :: pivot(:), along(:)
        end subroutine add_rolling_sphere

        !> A wheel without mass: it stands on a plane, does not slip sideways, and turns freely about its axle. It may be steered,
        !> and slide on the body along a strut without mass, whose way is a coordinate that forces and couplings may name as that
        !> of a joint.
        module subroutine add_massless_wheel(self, name, centre, radius, axis, error, along, steer, about, normal, height, open, &
            rise, crown)
            implicit none (type, external)
            class(drawing_type), intent(inout) :: self
            !> Its name, and its centre in the drawing: a body, or a point of it.
            character(len=*), intent(in) :: name, centre
            !> Radius (m), and its axle in the world's frame of the drawing.
            real(wp), intent(in) :: radius, axis(:)
            type(error_type), allocatable, intent(out) :: error
            !> In the world's frame of the drawing the direction in which it slides; without it it does not.
            real(wp), intent(in), optional :: along(:)
            !> It is steered: the angle (rad) by which the axle turns in the body, and what it turns about, a direction in the
            !> world's frame of the drawing, by default that in which it slides.
            class(function_type), intent(in), optional :: steer
            real(wp), intent(in), optional :: about(:)
            !> The plane: its normal on the body's side, by default z, and its distance from the origin along it (m, default 0);
            !> whether the wheel need not touch it in the drawing; and how far it has risen (m).
            real(wp), intent(in), optional :: normal(:), height
            logical, intent(in), optional :: open
            class(function_type), intent(in), optional :: rise
            !> The radius of the rim's section, a torus whose middle line has `radius - crown` (m, default 0: a sharp rim).
            real(wp), intent(in), optional :: crown
        end subroutine add_massless_wheel

        !> A sensor of a point: where it is, with velocity and acceleration.
        module subroutine add_point_sensor(self, name, on, error)
            implicit none (type, external)
            class(drawing_type), intent(inout) :: self
            !> Its name, by which files call it, and the body or the point of it.
            character(len=*), intent(in) :: name, on
            type(error_type), allocatable, intent(out) :: error
        end subroutine add_point_sensor

        !> A sensor of a joint's coordinate: how far its second side has slid and turned, turns counted, and how fast.
        module subroutine add_joint_sensor(self, name, joint, error, zero, group)
            implicit none (type, external)
            class(drawing_type), intent(inout) :: self
            !> Its name, and the joint's: revolute, prismatic, cylindrical or point_on_line.
            character(len=*), intent(in) :: name, joint
            type(error_type), allocatable, intent(out) :: error
            !> What it shows in the drawing (rad or m, default 0).
            real(wp), intent(in), optional :: zero
            !> The group of files that it stands in, "sensors" by default.
            character(len=*), intent(in), optional :: group
        end subroutine add_joint_sensor

        !> A sensor of the distance of two points, with its rate.
        module subroutine add_distance_sensor(self, name, first, second, error)
            implicit none (type, external)
            class(drawing_type), intent(inout) :: self
            character(len=*), intent(in) :: name, first, second
            type(error_type), allocatable, intent(out) :: error
        end subroutine add_distance_sensor

        !> A sensor of the kinetic and the potential energy of the whole mechanism.
        module subroutine add_energy_sensor(self, name, error)
            implicit none (type, external)
            class(drawing_type), intent(inout) :: self
            character(len=*), intent(in) :: name
            type(error_type), allocatable, intent(out) :: error
        end subroutine add_energy_sensor

        !> A sensor of the energy balance: both energies, the work of motions and of forces without a potential, and what is left.
        module subroutine add_balance_sensor(self, name, error, group)
            implicit none (type, external)
            class(drawing_type), intent(inout) :: self
            character(len=*), intent(in) :: name
            type(error_type), allocatable, intent(out) :: error
            character(len=*), intent(in), optional :: group
        end subroutine add_balance_sensor

        !> A sensor of a body: place, orientation, velocities, acceleration, energies.
        module subroutine add_body_sensor(self, name, body, error, group)
            implicit none (type, external)
            class(drawing_type), intent(inout) :: self
            character(len=*), intent(in) :: name, body
            type(error_type), allocatable, intent(out) :: error
            character(len=*), intent(in), optional :: group
        end subroutine add_body_sensor

        !> A sensor of the reaction of a joint, a wheel, a distance, a coupling or a row, and of the power of its motion.
        module subroutine add_reaction_sensor(self, name, element, error, group)
            implicit none (type, external)
            class(drawing_type), intent(inout) :: self
            character(len=*), intent(in) :: name, element
            type(error_type), allocatable, intent(out) :: error
            character(len=*), intent(in), optional :: group
        end subroutine add_reaction_sensor

        !> A sensor of a spring, a torsion, a bushing or a load: force, length, energy, power.
        module subroutine add_force_sensor(self, name, element, error, group)
            implicit none (type, external)
            class(drawing_type), intent(inout) :: self
            character(len=*), intent(in) :: name, element
            type(error_type), allocatable, intent(out) :: error
            character(len=*), intent(in), optional :: group
        end subroutine add_force_sensor

        !> Results of many elements: each a group of files of its name in the group of its kind.
        module subroutine add_results(self, kind, names, error)
            implicit none (type, external)
            class(drawing_type), intent(inout) :: self
            !> bodies, joints, wheels, constraints or forces.
            character(len=*), intent(in) :: kind
            !> Their names, or one that is "all".
            character(len=*), intent(in) :: names(:)
            type(error_type), allocatable, intent(out) :: error
        end subroutine add_results

        !> An ellipsoid that rolls on a plane.
        module subroutine add_rolling_ellipsoid(self, name, centre, semi_axes, error, normal, height, open, rise, turn, &
            pivot, slide, along)
            implicit none (type, external)
            class(drawing_type), intent(inout) :: self
            character(len=*), intent(in) :: name, centre
            !> Along the axes of the body (m).
            real(wp), intent(in) :: semi_axes(3)
            type(error_type), allocatable, intent(out) :: error
            !> The plane: its normal on the body's side, by default z, and its distance from the origin along it (m, default 0).
            real(wp), intent(in), optional :: normal(:), height
            !> Whether it need not touch the plane in the drawing.
            logical, intent(in), optional :: open
            !> The plane moves: how far it has risen along its normal (m), the angle by which it has turned about that (rad), and
            !> what it turns about (m, default the origin); how far it has gone (m) along a direction in it, the pivot with it.
            class(function_type), intent(in), optional :: rise, turn, slide
            real(wp), intent(in), optional :: pivot(:), along(:)
        end subroutine add_rolling_ellipsoid
    end interface

    interface
        !> A body. Without an inertia it is a point mass and does not turn.
        module subroutine add_body(self, name, mass, position, error, inertia, angle, euler_parameters, velocity, omega)
            implicit none (type, external)
            class(drawing_type), intent(inout) :: self
            character(len=*), intent(in) :: name
            !> Mass (kg), and the centre of mass in the drawing (m).
            real(wp), intent(in) :: mass, position(:)
            type(error_type), allocatable, intent(out) :: error
            !> About the centre of mass (kg m^2): one value in the plane; in space three principal values, or Jxx, Jyy, Jzz, Jxy,
            !> Jxz, Jyz, where Jxy is the entry of the matrix.
            real(wp), intent(in), optional :: inertia(:)
            !> How it is turned in the drawing: angle (rad) in the plane, Euler parameters in space; not by default.
            real(wp), intent(in), optional :: angle, euler_parameters(4)
            !> At the start: velocity of the centre (m/s), angular velocity in the world's frame (rad/s, one entry in the plane).
            real(wp), intent(in), optional :: velocity(:), omega(:)
        end subroutine add_body

        !> A named point of a body or of the ground.
        module subroutine add_point(self, body, name, place, error)
            implicit none (type, external)
            class(drawing_type), intent(inout) :: self
            !> The body's name, and the point's.
            character(len=*), intent(in) :: body, name
            !> In the body's frame (m).
            real(wp), intent(in) :: place(:)
            type(error_type), allocatable, intent(out) :: error
        end subroutine add_point

        !> A name that no other element has.
        module subroutine check_name(self, name, label, error)
            implicit none (type, external)
            class(drawing_type), intent(inout) :: self
            character(len=*), intent(in) :: name, label
            type(error_type), allocatable, intent(out) :: error
        end subroutine check_name

        !> A body and a point of it from `body` or `body.point`.
        module subroutine take_point(self, label, text, body, place, is_point, error)
            implicit none (type, external)
            class(drawing_type), intent(in) :: self
            character(len=*), intent(in) :: label, text
            integer, intent(out) :: body
            !> In the body's frame.
            real(wp), intent(out) :: place(3)
            !> Whether a point was named.
            logical, intent(out) :: is_point
            type(error_type), allocatable, intent(out) :: error
        end subroutine take_point

        !> Two points of two different bodies.
        module subroutine take_pair(self, label, one, other, first, second, s1, s2, points, error)
            implicit none (type, external)
            class(drawing_type), intent(in) :: self
            character(len=*), intent(in) :: label, one, other
            integer, intent(out) :: first, second
            real(wp), intent(out) :: s1(3), s2(3)
            logical, intent(out) :: points(2)
            type(error_type), allocatable, intent(out) :: error
        end subroutine take_pair
    end interface
end module tandem_mechanism_drawing
