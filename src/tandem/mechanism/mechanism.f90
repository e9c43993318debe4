! SPDX-License-Identifier: MIT
!> A mechanism as a model: its definition (`tandem_mechanism_builder`) is converted to coordinates, rows and forces, with an exact
!> gamma and exact gradient blocks.
!>
!> q contains the bodies in their order: (x, y, angle) in the plane, (r, Euler parameters) in space, the position only for a point
!> mass; then the coordinates that elements have of their own: displacements of massless wheels, sums and slacks of couplings.
!>
!> Rows: joints and distances in the order of their definition, one row for the Euler parameters of each rotating body, then the
!> rows at velocity level.
!>
!> The rotation of every body and every function of time are computed once per point if an element uses them; then the elements are
!> evaluated in one loop per type.
module tandem_mechanism
    use tandem_error, only: error_type, set_error
    use tandem_kinds, only: wp
    use tandem_mechanism_body, only: add_gyroscopic, differentiate_inertia, set_mass, set_single_masses
    use tandem_mechanism_coordinate, only: coordinate_type
    use tandem_mechanism_perpendicular, only: differentiate_perpendiculars, evaluate_perpendiculars
    use tandem_mechanism_builder, only: builder_type
    use tandem_mechanism_velocity_joint, only: differentiate_velocity_joints, evaluate_velocity_joints
    use tandem_mechanism_element_kind, only: constraint_type
    use tandem_mechanism_hinge, only: evaluate_hinges, hinge_type
    use tandem_mechanism_hinge_group, only: evaluate_hinge_groups, hinge_group_type
    use tandem_mechanism_massless_wheel, only: differentiate_massless_wheels, evaluate_massless_wheels
    use tandem_mechanism_pin, only: angles_type, evaluate_pins, pin_type
    use tandem_mechanism_pose, only: pose_type, set_angle, set_accelerations, set_displacements, set_position, set_rates
    use tandem_mechanism_rate_row, only: differentiate_rate_rows, evaluate_rate_rows
    use tandem_mechanism_rolling, only: differentiate_knife_edges, differentiate_rollers, evaluate_knife_edges, evaluate_rollers
    use tandem_mechanism_formula, only: is_joint
    use tandem_mechanism_sensor, only: pack_sensor, sensed_joint
    use tandem_mechanism_point_vector, only: differentiate_distances, differentiate_coincidences, evaluate_distances, &
        evaluate_coincidences
    use tandem_mechanism_rotating_bodies, only: add_inertia_forces, evaluate_norms, set_masses, rotating_group_type
    use tandem_model, only: label_length, model_type, quantity_type
    use tandem_model_affine_motion, only: affine_motion_type
    use tandem_model_derivatives, only: derivatives_type, need_acceleration_q, need_acceleration_qd, need_all_derivatives, &
        need_dynamics_q, need_dynamics_qd, need_velocity_q
    use tandem_model_stiffness, only: stiffness_type
    use tandem_model_terms, only: need_force, need_gamma, need_jacobian, need_mass, need_nu, need_phi, terms_type
    use tandem_pack, only: pack_type
    use tandem_rigid_euler_parameters, only: e_transposed_product
    use tandem_status, only: status_invalid_model
    implicit none (type, external)
    private

    public :: mechanism_type

    !> Add bodies, joints and forces, and call `define`; then `start` returns the state of the reference configuration.
    type, extends(builder_type) :: mechanism_type
        !> First coordinate of each pose except the ground; the last entry is the next coordinate.
        integer, allocatable, private :: first(:)
        !> The force of gravity (n).
        real(wp), allocatable, private :: weight(:)
        !> Kinds of elements with rows, and kinds with forces, that have elements.
        integer, allocatable, private :: row_kinds(:), force_kinds(:)
        !> Typical length of the bodies and rods (m).
        real(wp), private :: size_of_bodies = 1.0_wp
        !> Hinges in space, single or in groups, and the indices of the remaining coincident points and perpendicularity rows.
        type(hinge_type), allocatable, private :: hinges(:)
        type(hinge_group_type), allocatable, private :: hinge_groups(:)
        integer, allocatable, private :: single_coincidences(:), single_perpendiculars(:)
        !> In the plane all coincident points as pins, and the angles of bodies.
        type(pin_type), allocatable, private :: pins(:)
        type(angles_type), private :: angles_of_bodies
        !> Offset of the rows of Euler parameters, and the bodies with these rows.
        integer, private :: before_norms = 0
        integer, allocatable, private :: turning(:)
        !> The same bodies in groups; their number if they are not grouped; all bodies outside groups.
        type(rotating_group_type), allocatable, private :: rotating_groups(:)
        integer, private :: n_turning_alone = 0
        integer, allocatable, private :: alone(:)
        !> True if an element uses poses; groups do not. True if poses always exist, for elements and sensors: otherwise they are
        !> made at the first request.
        logical, private :: takes_poses = .true., keeps_poses = .true.
        !> True once `define` has renumbered the rows in the lists of elements, which it does once.
        logical, private :: is_defined = .false.
        !> Segment between breakpoints to which the smooth pieces of functions belong; 0 if none.
        integer, private :: held_segment = 0
        !> True if the stored terms are compressed.
        logical :: is_compressed = .false.
        !> True if elements or sensors count turns; true if they count at every point, as in the search for a start.
        logical, private :: counts_turns = .false., follows_turns = .true.
        !> Time of the last evaluation of the functions.
        real(wp), private :: time_of_f = huge(1.0_wp)
        integer, private :: inputs_of_f = 0
        !> C and nu at an output time; only for sensors of reactions.
        type(terms_type), private :: at_row
        !> Gradient blocks of one element, in the coordinates of its bodies, and list of these bodies.
        type(derivatives_type), private :: window
        integer, allocatable, private :: touched(:)
    contains
        procedure :: define, start, composed, note_blocks, find_body_motions, pack_state, arrive, is_idle, hides, list_imposed
        procedure :: set_magnitudes, set_time_scale, measure, integrands, begin_measuring, change, list_motions, force_rate
        procedure :: evaluate_stiffness, friction_directions, normal_forces, describe_motion
        procedure, private :: set_motion
    end type mechanism_type

    interface
        !> Set columns of the coordinates, blocks of M, and weights of the bodies.
        module subroutine number_coordinates(self)
            implicit none (type, external)
            class(mechanism_type), intent(inout) :: self
        end subroutine number_coordinates

        !> Set the scales of the numbered coordinates.
        module subroutine set_scales(self)
            implicit none (type, external)
            class(mechanism_type), intent(inout) :: self
        end subroutine set_scales

        !> Doubt inertias that no body has: a moment larger than the sum of the two others.
        module subroutine check_inertias(self)
            implicit none (type, external)
            class(mechanism_type), intent(inout) :: self
        end subroutine check_inertias

        !> Sizes of the coordinates in rows of Phi. After many turns of a body in the plane, rounding of its angle moves its points
        !> as far as rounding of an equally large position.
        pure module subroutine set_magnitudes(self, q, magnitude)
            implicit none (type, external)
            class(mechanism_type), intent(in) :: self
            real(wp), intent(in), contiguous :: q(:)
            real(wp), intent(out), contiguous :: magnitude(:)
        end subroutine set_magnitudes

        !> The time scale of a motion that starts at (t, q, qd).
        module subroutine set_time_scale(self, t, q, qd)
            implicit none (type, external)
            class(mechanism_type), intent(inout) :: self
            real(wp), intent(in) :: t, q(:), qd(:)
        end subroutine set_time_scale

        !> Number the rows; rows at velocity level come last.
        module subroutine number_rows(self)
            implicit none (type, external)
            class(mechanism_type), intent(inout) :: self
        end subroutine number_rows

        !> Rows of the elements of all kinds.
        pure module function rows_of_kinds(self, length) result(rows)
            implicit none (type, external)
            class(mechanism_type), intent(in) :: self
            !> Length that gives the scales of the rows.
            real(wp), intent(in) :: length
            type(constraint_type), allocatable :: rows(:)
        end function rows_of_kinds

        !> Names and units of coordinates and rows.
        pure module function composed(self, what, i) result(label)
            implicit none (type, external)
            class(mechanism_type), intent(in) :: self
            integer, intent(in) :: what, i
            character(len=label_length) :: label
        end function composed

        !> Declare the bodies, the pattern of rows, and the columns of C and M.
        module subroutine declare_pattern(self)
            implicit none (type, external)
            class(mechanism_type), intent(inout) :: self
        end subroutine declare_pattern

        !> Make the poses with the columns of the coordinates, unless they exist.
        pure module subroutine make_poses(self)
            implicit none (type, external)
            class(mechanism_type), intent(inout) :: self
        end subroutine make_poses

        !> Set the places of the bodies' coordinates in the terms.
        pure module subroutine set_columns(self, is_compressed)
            implicit none (type, external)
            class(mechanism_type), intent(inout) :: self
            logical, intent(in) :: is_compressed
        end subroutine set_columns

        !> Group elements that are evaluated together; the rows are numbered.
        pure module subroutine form_groups(self)
            implicit none (type, external)
            class(mechanism_type), intent(inout) :: self
        end subroutine form_groups

        !> Mark the rows of C that are set in the blocks of a chart.
        pure module subroutine note_blocks(self)
            implicit none (type, external)
            class(mechanism_type), intent(inout) :: self
        end subroutine note_blocks

        !> List the quantities of sensors; the coordinates and rows are numbered.
        module subroutine list_quantities(self)
            implicit none (type, external)
            class(mechanism_type), intent(inout) :: self
        end subroutine list_quantities

        !> Convert a small motion of the coordinates to motions of the bodies: displacements, and rotation vectors in world axes.
        module subroutine find_body_motions(self, q, shape, motions)
            implicit none (type, external)
            class(mechanism_type), intent(in) :: self
            !> Coordinates, and their small changes (n).
            real(wp), intent(in) :: q(:)
            complex(wp), intent(in) :: shape(:)
            !> x, y, z and the rotations about these axes (6, bodies).
            complex(wp), intent(out) :: motions(:, :)
        end subroutine find_body_motions

        !> Name the joint whose two bodies move most differently, and that which moves more.
        module subroutine describe_motion(self, q, direction, text)
            implicit none (type, external)
            class(mechanism_type), intent(in) :: self
            real(wp), intent(in) :: q(:), direction(:)
            character(len=:), allocatable, intent(out) :: text
        end subroutine describe_motion

        !> List the frictions on reactions of joints; the rows are numbered.
        module subroutine list_frictions(self)
            implicit none (type, external)
            class(mechanism_type), intent(inout) :: self
        end subroutine list_frictions

        !> List the pairs of bodies with coupled forces, and allocate the gradient blocks of one element.
        module subroutine list_coupled(self)
            implicit none (type, external)
            class(mechanism_type), intent(inout) :: self
        end subroutine list_coupled

        !> Add the elements to the five gradient blocks, at the current poses.
        module subroutine add_derivatives(self, need, t, lambda, derivatives)
            implicit none (type, external)
            class(mechanism_type), intent(inout) :: self
            integer, intent(in) :: need
            real(wp), intent(in) :: t, lambda(:)
            type(derivatives_type), intent(inout) :: derivatives
        end subroutine add_derivatives

        !> Pack the angles from which turns are counted, and the changes by events.
        module subroutine pack_state(self, pack)
            implicit none (type, external)
            class(mechanism_type), intent(inout) :: self
            type(pack_type), intent(inout) :: pack
        end subroutine pack_state

        !> Count the turns of angles in space; in the plane angles are coordinates.
        module subroutine arrive(self, t, q, starts)
            implicit none (type, external)
            class(mechanism_type), intent(inout) :: self
            real(wp), intent(in) :: t, q(:)
            logical, intent(in) :: starts
        end subroutine arrive

        !> Mark the rows of motions, and of locked elements, which depend on them.
        pure module subroutine list_imposed(self, is_imposed, is_angle)
            implicit none (type, external)
            class(mechanism_type), intent(in) :: self
            logical, intent(out) :: is_imposed(:), is_angle(:)
        end subroutine list_imposed

        !> Count turns at the current poses.
        pure module subroutine follow_turns(self)
            implicit none (type, external)
            class(mechanism_type), intent(inout) :: self
        end subroutine follow_turns

        !> Blocks of the elements.
        module subroutine evaluate_stiffness(self, t, q, qd, qdd, lambda, stiffness, stat)
            implicit none (type, external)
            class(mechanism_type), intent(inout) :: self
            real(wp), intent(in) :: t, q(:), qd(:), qdd(:), lambda(:)
            type(stiffness_type), intent(inout) :: stiffness
            integer, intent(out) :: stat
        end subroutine evaluate_stiffness

        !> Rigid motions of the world and of the bodies.
        module subroutine list_motions(self, motions)
            implicit none (type, external)
            class(mechanism_type), intent(inout) :: self
            type(affine_motion_type), allocatable, intent(out) :: motions(:)
        end subroutine list_motions

        !> Partial time derivative of the forces, exact.
        module subroutine force_rate(self, t, q, qd, value, is_given, stat)
            implicit none (type, external)
            class(mechanism_type), intent(inout) :: self
            real(wp), intent(in) :: t, q(:), qd(:)
            real(wp), intent(out) :: value(:)
            logical, intent(out) :: is_given
            integer, intent(out) :: stat
        end subroutine force_rate

        !> Evaluate the sensors.
        module subroutine measure(self, t, q, qd, qdd, values, stat, lambda)
            implicit none (type, external)
            class(mechanism_type), intent(inout) :: self
            real(wp), intent(in) :: t, q(:), qd(:), qdd(:)
            real(wp), intent(inout) :: values(:)
            integer, intent(out) :: stat
            real(wp), intent(in), optional :: lambda(:)
        end subroutine measure

        !> Power of imposed motions, and power of forces without a potential.
        module subroutine integrands(self, t, q, qd, lambda, values, stat)
            implicit none (type, external)
            class(mechanism_type), intent(inout) :: self
            real(wp), intent(in) :: t, q(:), qd(:), lambda(:)
            real(wp), intent(out) :: values(:)
            integer, intent(out) :: stat
        end subroutine integrands

        !> Report the components of reactions that redundant rows leave undetermined: those that a combination of multipliers
        !> with C' lambda = 0 changes.
        module subroutine begin_measuring(self, t, q, qd, lambda, stat)
            implicit none (type, external)
            class(mechanism_type), intent(inout) :: self
            real(wp), intent(in) :: t, q(:), qd(:), lambda(:)
            integer, intent(out) :: stat
        end subroutine begin_measuring

        !> One change by an event.
        module subroutine change(self, what, is_trial, t, q, problem)
            implicit none (type, external)
            class(mechanism_type), intent(inout) :: self
            character(len=*), intent(in) :: what
            logical, intent(in) :: is_trial
            real(wp), intent(in) :: t, q(:)
            character(len=*), intent(out) :: problem
        end subroutine change

        !> B of friction on reactions.
        module subroutine friction_directions(self, t, q, qd, value, stat)
            implicit none (type, external)
            class(mechanism_type), intent(inout) :: self
            real(wp), intent(in) :: t, q(:), qd(:)
            real(wp), intent(out) :: value(:, :)
            integer, intent(out) :: stat
        end subroutine friction_directions

        !> p of friction on reactions, and its gradient.
        module subroutine normal_forces(self, lambda, value, gradient)
            implicit none (type, external)
            class(mechanism_type), intent(inout) :: self
            real(wp), intent(in) :: lambda(:)
            real(wp), intent(out) :: value(:), gradient(:, :)
        end subroutine normal_forces

        !> Set the coordinates that elements have of their own at the start.
        module subroutine start_slides(self, q, qd)
            implicit none (type, external)
            class(mechanism_type), intent(in) :: self
            real(wp), intent(inout) :: q(:), qd(:)
        end subroutine start_slides

        !> True for the coordinates of locked elements that events may free.
        pure module function is_idle(self)
            implicit none (type, external)
            class(mechanism_type), intent(in) :: self
            logical :: is_idle(self%n)
        end function is_idle
    end interface

contains

    !> Number the coordinates and rows, and associate the procedures. Nothing may be added afterwards.
    subroutine define(self, error)
        class(mechanism_type), intent(inout) :: self
        type(error_type), allocatable, intent(out) :: error
        type(constraint_type), allocatable :: rows(:)
        integer :: k, n_bodies

        n_bodies = 0
        if (allocated(self%bodies)) then
            call self%fit()
            n_bodies = size(self%bodies)
        end if
        if (n_bodies == 0) then
            call set_error(error, status_invalid_model, 'the mechanism has no body', 'add one')
            return
        else if (self%is_defined) then
            call set_error(error, status_invalid_model, 'the mechanism is already defined', &
                'call define once, after adding all elements')
            return
        end if
        call self%begin_breakpoints(error)
        if (allocated(error)) return
        self%is_defined = .true.
        if (.not. allocated(self%name)) self%name = 'mechanism'
        self%row_kinds = pack([(k, k=1, size(self%kinds))], [(self%kinds(k)%of%has_rows, k=1, size(self%kinds))])
        self%force_kinds = pack([(k, k=1, size(self%kinds))], &
            [(self%kinds(k)%of%n > 0 .and. .not. self%kinds(k)%of%has_rows, k=1, size(self%kinds))])
        call number_coordinates(self)
        call set_scales(self)
        call check_inertias(self)
        call number_rows(self)
        call self%held%close()
        call self%rolling%close()
        call form_groups(self)
        call declare_pattern(self)
        allocate (self%at%f(0:2, size(self%motions)), source=0.0_wp)
        self%constant_mass = self%planar .or. size(self%turning) == 0
        self%evaluate => evaluate
        self%provides = need_mass
        if (has_forces(self)) self%provides = self%provides + need_force
        if (self%n_holonomic > 0) self%provides = self%provides + need_phi
        if (self%n_constraints() > 0) self%provides = self%provides + need_jacobian + need_gamma
        allocate (rows, source=rows_of_kinds(self, 1.0_wp))
        if (any([self%perpendiculars%motion, self%angles%motion, self%distances%motion, self%velocity_joints%motion, &
            self%rollers%rise, self%rollers%rotation, self%rollers%slide, self%massless_wheels%steer, self%massless_wheels%rise, &
            self%rate_rows%rhs, rows%motion] > 0)) then
          self%provides = self%provides + need_nu
        end if
        self%evaluate_derivatives => evaluate_derivatives
        self%provides_derivatives = need_all_derivatives
        self%potential_energy => potential_energy
        self%input_name = [character(len=label_length) :: self%motions%name]
        if (allocated(self%pattern)) then
            call list_coupled(self)
            self%derives_by_bodies = .true.
        end if
        call list_quantities(self)
        self%counts_turns = .not. self%planar .and. (size(self%at%formulas) > 0 .or. &
            any([(self%kinds(k)%of%counts_turns, k=1, size(self%kinds))]) .or. any(self%sensors%kind == sensed_joint))
        call list_frictions(self)
        if (.not. self%keeps_poses) deallocate (self%at%pose)
        ! Elements along joint coordinates have copies of them; only expressions use the list.
        if (size(self%at%formulas) == 0) self%at%coordinates = [coordinate_type ::]
    end subroutine define

    !> Evaluate the functions of time, once per time.
    pure subroutine evaluate_functions(self, t)
        class(mechanism_type), intent(inout) :: self
        real(wp), intent(in) :: t
        integer :: i

        if (.not. (t < self%time_of_f .or. t > self%time_of_f) .and. self%inputs_of_f == self%state%input_version) return
        self%time_of_f = t
        self%inputs_of_f = self%state%input_version
        do i = 1, size(self%motions)
            call self%motions(i)%f%evaluate(t, self%at%f(:, i))
        end do
        if (allocated(self%state%input)) self%at%f = self%at%f + self%state%input
    end subroutine evaluate_functions

    !> True if there may be forces: gravity, force elements, or inertia forces of bodies rotating in space. Events add none.
    pure logical function has_forces(self)
        class(mechanism_type), intent(in) :: self

        has_forces = size(self%turning) > 0 .or. size(self%force_kinds) > 0 .or. maxval(abs(self%weight)) > 0.0_wp
    end function has_forces

    !> Clear rows before they are set: in compressed rows every entry is set again, except in rows that are sums.
    pure subroutine clear_jacobian(self, terms)
        class(mechanism_type), intent(in) :: self
        type(terms_type), intent(inout) :: terms
        integer :: i

        if (.not. terms%is_compressed) then
            terms%jacobian = 0.0_wp
            return
        end if
        do i = 1, size(self%rate_rows)
            terms%jacobian(self%rate_rows(i)%row, :) = 0.0_wp
        end do
    end subroutine clear_jacobian

    !> State of the reference configuration; `define` has been called.
    subroutine start(self, q, qd)
        class(mechanism_type), intent(in) :: self
        !> Coordinates and velocities (n).
        real(wp), intent(out) :: q(:), qd(:)
        integer :: i

        q = 0.0_wp
        qd = 0.0_wp
        do i = 1, size(self%bodies)
            associate (place => self%first(i), turn => self%first(i) + merge(2, 3, self%planar), body => self%bodies(i))
                q(place:turn - 1) = body%position(:turn - place)
                qd(place:turn - 1) = body%velocity(:turn - place)
                if (.not. body%turns) cycle
                if (self%planar) then
                    q(turn) = body%angle
                    qd(turn) = body%omega(3)
                else
                    q(turn:turn + 3) = body%p
                    qd(turn:turn + 3) = 0.5_wp*e_transposed_product(body%p, body%omega)
                end if
            end associate
        end do
        call start_slides(self, q, qd)
    end subroutine start

    !> Evaluate any set of terms.
    subroutine evaluate(self, need, t, q, qd, terms, stat)
        class(model_type), intent(inout) :: self
        integer, intent(in) :: need
        real(wp), intent(in) :: t, q(:), qd(:)
        type(terms_type), intent(inout) :: terms
        integer, intent(out) :: stat

        stat = 0
        select type (self)
        class is (mechanism_type)
            call evaluate_mechanism(self, need, t, q, qd, terms, stat)
        end select
    end subroutine evaluate

    !> Set the smooth pieces of functions to the current segment.
    pure subroutine hold_segment(self)
        class(mechanism_type), intent(inout) :: self

        call self%hold_pieces()
        self%held_segment = self%segment
        self%time_of_f = huge(self%time_of_f)
    end subroutine hold_segment

    logical function hides(self, from, to, between)
        class(mechanism_type), intent(inout) :: self
        real(wp), intent(in) :: from, to
        logical, intent(in) :: between

        if (self%segment /= self%held_segment) call hold_segment(self)
        hides = self%pieces_hide(from, to, between)
    end function hides

    subroutine evaluate_mechanism(self, need, t, q, qd, terms, stat)
        type(mechanism_type), intent(inout) :: self
        integer, intent(in) :: need
        real(wp), intent(in) :: t, q(:), qd(:)
        type(terms_type), intent(inout) :: terms
        integer, intent(inout) :: stat
        integer :: i, j, k
        logical :: follows

        if (self%segment /= self%held_segment) call hold_segment(self)
        self%at%t = t
        if (terms%is_compressed .neqv. self%is_compressed) call set_columns(self, terms%is_compressed)
        ! A call for no term needs the poses themselves.
        ! A search evaluates Phi and forces; a call for no term is an arrival.
        follows = self%counts_turns .and. self%follows_turns .and. (need == 0 .or. iand(need, need_phi + need_force) /= 0)
        if (self%takes_poses .or. need == 0 .or. follows) then
            call set_places(self, q)
            if (iand(need, need_gamma + need_force) /= 0) then
                do i = 1, size(self%bodies)
                    call set_rates(self%at%pose(i), qd)
                end do
            end if
        end if
        if (self%n_of%slides > 0) then
            call set_displacements(self%at%pose(size(self%bodies) + 1:), 0, q)
            if (iand(need, need_gamma + need_force) /= 0) call set_displacements(self%at%pose(size(self%bodies) + 1:), 1, qd)
        end if
        call evaluate_functions(self, t)
        if (follows) call follow_turns(self)
        if (iand(need, need_phi + need_jacobian + need_nu + need_gamma) /= 0) then
            if (iand(need, need_jacobian) /= 0) call clear_jacobian(self, terms)
            if (iand(need, need_nu) /= 0) terms%nu = 0.0_wp
            if (size(self%hinge_groups) > 0) call evaluate_hinge_groups(self%hinge_groups, need, self%n, q, qd, terms)
            if (size(self%hinges) > 0) call evaluate_hinges(self%hinges, need, self%at%pose, terms)
            if (size(self%pins) > 0) then
                call self%angles_of_bodies%set(self%n, q)
                call evaluate_pins(self%pins, need, self%angles_of_bodies, self%n, q, qd, terms)
            end if
            if (size(self%single_coincidences) > 0) call evaluate_coincidences(self%single_coincidences, self%coincidences, need, &
                self%at%pose, terms)
            if (size(self%single_perpendiculars) > 0) call evaluate_perpendiculars(self%single_perpendiculars, &
                self%perpendiculars, need, self%at%pose, self%at%f, terms)
            if (size(self%distances) > 0) call evaluate_distances(self%distances, need, self%at%pose, self%at%f, terms)
            if (size(self%angles) > 0) call evaluate_angles(self, need, terms)
            do i = 1, size(self%row_kinds)
                call self%kinds(self%row_kinds(i))%of%add_rows(need, self%at, terms, stat)
            end do
            if (size(self%knife_edges) > 0) call evaluate_knife_edges(self%knife_edges, need, self%at%pose, self%at%f, terms)
            if (size(self%rollers) > 0) call evaluate_rollers(self%rollers, need, self%at%pose, self%at%f, terms, stat)
            if (size(self%massless_wheels) > 0) call evaluate_massless_wheels(self%massless_wheels, need, self%at%pose, self%at%f, &
                terms, stat)
            if (size(self%velocity_joints) > 0) call evaluate_velocity_joints(self%velocity_joints, need, self%at%pose, &
                self%at%f, terms)
            if (size(self%rate_rows) > 0) call evaluate_rate_rows(self%rate_rows, need, t, self%at%pose, self%at%formulas, &
                self%at%coordinates, terms)
            if (size(self%rotating_groups) > 0) call evaluate_norms(self%rotating_groups, need, self%n, q, qd, terms)
            do i = 1, self%n_turning_alone
                k = self%before_norms + i
                associate (p => self%at%pose(self%turning(i))%p, turn => self%at%pose(self%turning(i))%turn_column)
                    if (iand(need, need_phi) /= 0) terms%phi(k) = 0.5_wp*(p(1, 0)**2 + p(2, 0)**2 + p(3, 0)**2 + p(4, 0)**2 - 1)
                    if (iand(need, need_jacobian) /= 0) then
                        do j = 0, 3
                            terms%jacobian(k, turn + j) = p(j + 1, 0)
                        end do
                    end if
                    if (iand(need, need_gamma) /= 0) terms%gamma(k) = p(1, 1)**2 + p(2, 1)**2 + p(3, 1)**2 + p(4, 1)**2
                end associate
            end do
        end if
        if (iand(need, need_mass) /= 0) then
            ! In a compressed M every entry that may be nonzero is set again.
            if (.not. terms%is_compressed) terms%mass = 0.0_wp
            if (size(self%rotating_groups) > 0) call set_masses(self%rotating_groups, self%n, size(terms%mass, 2), q, terms%mass)
            do i = 1, size(self%alone)
                k = self%alone(i)
                if (self%planar .or. .not. self%bodies(k)%turns) then
                    call set_single_masses(self%bodies(k), self%first(k), self%first(k + 1) - 1, terms%is_compressed, self%n, &
                        size(terms%mass, 2), terms%mass)
                else
                    call set_mass(self%bodies(k), self%at%pose(k), self%n, size(terms%mass, 2), terms%mass)
                end if
            end do
            do i = 1, size(self%slides)
                k = self%first(size(self%bodies) + i)
                terms%mass(k, merge(1, k, terms%is_compressed)) = self%slides(i)%inertia
            end do
        end if
        if (iand(need, need_force) == 0) return
        do i = 1, self%n
            terms%force(i) = self%weight(i)
        end do
        if (size(self%rotating_groups) > 0) call add_inertia_forces(self%rotating_groups, self%n, q, qd, terms%force)
        do i = 1, self%n_turning_alone
            call add_gyroscopic(self%bodies(self%turning(i)), self%at%pose(self%turning(i)), terms%force)
        end do
        do i = 1, size(self%force_kinds)
            call self%kinds(self%force_kinds(i))%of%add_forces(self%at, terms%force, stat)
        end do
    end subroutine evaluate_mechanism

    !> Set the poses at q.
    pure subroutine set_places(self, q)
        type(mechanism_type), intent(inout) :: self
        real(wp), intent(in) :: q(:)
        integer :: i

        call make_poses(self)
        associate (angles => self%angles_of_bodies)
            if (angles%n > 0) call angles%set(self%n, q)
            do i = 1, angles%n
                call set_angle(self%at%pose(angles%body(i)), angles%angle(i), angles%c(i), angles%s(i))
            end do
        end associate
        do i = 1, size(self%bodies)
            call set_position(self%at%pose(i), q)
        end do
    end subroutine set_places

    !> Angles in the plane: linear rows.
    subroutine evaluate_angles(self, need, terms)
        type(mechanism_type), intent(in) :: self
        integer, intent(in) :: need
        type(terms_type), intent(inout) :: terms
        real(wp) :: f(0:2)
        integer :: i

        do i = 1, size(self%angles)
            associate (angle => self%angles(i), one => self%at%pose(self%angles(i)%first), &
                two => self%at%pose(self%angles(i)%second))
                f = 0.0_wp
                if (angle%motion > 0) f = self%at%f(:, angle%motion)
                if (iand(need, need_phi) /= 0) terms%phi(angle%row) = two%p(1, 0) - one%p(1, 0) - angle%offset - f(0)
                if (iand(need, need_jacobian) /= 0) then
                    if (one%turn > 0) terms%jacobian(angle%row, one%turn_column) = -1.0_wp
                    if (two%turn > 0) terms%jacobian(angle%row, two%turn_column) = 1.0_wp
                end if
                if (iand(need, need_nu) /= 0) terms%nu(angle%row) = f(1)
                if (iand(need, need_gamma) /= 0) terms%gamma(angle%row) = -f(2)
            end associate
        end do
    end subroutine evaluate_angles

    !> The five gradient blocks.
    subroutine evaluate_derivatives(self, need, t, q, qd, qdd, lambda, derivatives, stat)
        class(model_type), intent(inout) :: self
        integer, intent(in) :: need
        real(wp), intent(in) :: t, q(:), qd(:), qdd(:), lambda(:)
        type(derivatives_type), intent(inout) :: derivatives
        integer, intent(out) :: stat

        stat = 0
        if (iand(need, need_velocity_q) /= 0) derivatives%velocity_q = 0.0_wp
        if (iand(need, need_acceleration_q) /= 0) derivatives%acceleration_q = 0.0_wp
        if (iand(need, need_acceleration_qd) /= 0) derivatives%acceleration_qd = 0.0_wp
        if (iand(need, need_dynamics_q) /= 0) derivatives%dynamics_q = 0.0_wp
        if (iand(need, need_dynamics_qd) /= 0) derivatives%dynamics_qd = 0.0_wp
        select type (self)
        class is (mechanism_type)
            call set_motion(self, t, q, qd, qdd)
            call add_derivatives(self, need, t, lambda, derivatives)
        end select
    end subroutine evaluate_derivatives

    !> Set the poses with all derivatives, and the functions of time.
    subroutine set_motion(self, t, q, qd, qdd)
        class(mechanism_type), intent(inout) :: self
        real(wp), intent(in) :: t, q(:), qd(:), qdd(:)
        integer :: i

        if (self%segment /= self%held_segment) call hold_segment(self)
        self%at%t = t
        call set_places(self, q)
        do i = 1, size(self%bodies)
            call set_rates(self%at%pose(i), qd)
            call set_accelerations(self%at%pose(i), qdd)
        end do
        call set_displacements(self%at%pose(size(self%bodies) + 1:), 0, q)
        call set_displacements(self%at%pose(size(self%bodies) + 1:), 1, qd)
        call set_displacements(self%at%pose(size(self%bodies) + 1:), 2, qdd)
        call evaluate_functions(self, t)
    end subroutine set_motion

    !> Potential energy of gravity and of linear elements; laws have none.
    subroutine potential_energy(self, t, q, value, stat)
        class(model_type), intent(inout) :: self
        real(wp), intent(in) :: t, q(:)
        real(wp), intent(out) :: value
        integer, intent(out) :: stat
        integer :: i

        stat = 0
        value = 0.0_wp
        select type (self)
        class is (mechanism_type)
            value = -dot_product(self%weight, q)
            if (size(self%force_kinds) == 0) return
            call set_places(self, q)
            call set_displacements(self%at%pose(size(self%bodies) + 1:), 0, q)
            do i = 1, size(self%force_kinds)
                call self%kinds(self%force_kinds(i))%of%add_energy(self%at, value)
            end do
        end select
    end subroutine potential_energy
end module tandem_mechanism
