! SPDX-License-Identifier: MIT
!> The base type of models: sizes, names, and one procedure that evaluates any set of terms. A scene extends `model_type` with its
!> parameters and associates `evaluate`. Models with one procedure per term extend `procedure_model_type`, which calls these
!> procedures.
!>
!> The last argument of every procedure is a status: 0 ok, > 0 this point cannot be evaluated (a smaller step may help), < 0 stop.
!> Associate module procedures only. A pointer to an internal procedure requires code on the stack, which crashes if the stack is
!> not executable.
!>
!> The passed object is `intent(inout)`, so that a model may store intermediate results. One instance belongs to one simulation. A
!> completed model can be copied before or after a run by `allocate (instance, source=model)`. The copy is independent, unless an
!> extension contains pointers to data. A run or an analysis changes only `segment` and `state`, and intermediate results of
!> extensions.
!>
!> Source of the equations: E. J. Haug, An index 0 differential-algebraic equation formulation for multibody dynamics: nonholonomic
!> constraints, Mech. Based Des. Struct. Mach., 2016, doi 10.1080/15397734.2016.1273783.
module tandem_model
    use tandem_error, only: error_type
    use tandem_kinds, only: wp
    use tandem_model_affine_motion, only: affine_motion_type
    use tandem_model_derivatives, only: derivatives_type
    use tandem_model_pattern, only: pattern_type
    use tandem_model_quantity, only: label_length, quantity_type
    use tandem_model_stiffness, only: stiffness_type
    use tandem_model_state, only: model_state_type
    use tandem_model_terms, only: need_jacobian, need_mass, need_phi, terms_type
    use tandem_pack, only: pack_type
    implicit none (type, external)
    private

    public :: model_type, quantity_type, label_length
    public :: name_of_coordinate, name_of_row, its_unit, unit_of_its_multiplier
    public :: energy_of_motion, energy_of_position, evaluate_interface, evaluate_derivatives_interface

    !> Arguments of `composed`: the label that is requested.
    integer, parameter :: name_of_coordinate = 1, its_unit = 2, name_of_row = 3, unit_of_its_multiplier = 4

    !> Extend this type with the parameters of a scene. Sizes determine which terms exist; procedure pointers provide their values.
    type :: model_type
        !> Name of the model in reports and files.
        character(len=:), allocatable :: name
        !> Number of generalized coordinates.
        integer :: n = 0
        !> Questionable property of the model, which every run reports as a warning; not allocated if there is none.
        character(len=:), allocatable :: warning
        !> Number of holonomic constraints Phi(t, q) = 0.
        integer :: n_holonomic = 0
        !> Number of nonholonomic constraints E(t, q) qd = e(t, q).
        integer :: n_nonholonomic = 0
        !> True if there may be more rows than coordinates, as for joints in closed loops. Redundant rows are found at the start. If
        !> false, models with more rows than coordinates are refused.
        logical :: rows_may_repeat = .false.
        !> True if M does not depend on q: it is then evaluated once.
        logical :: constant_mass = .false.
        !> Sizes of the diagonal blocks of M in order, n in total, if all entries outside of the blocks are zero at every q.
        !> Explicit steps then omit these entries. Not allocated: one block of size n. For a constant M the blocks are computed.
        integer, allocatable :: mass_blocks(:)
        !> Entries of C and M that may be nonzero, for sparse charts; not allocated: all entries. If `terms%is_compressed` is true,
        !> a model with a pattern must store entry (i, j) of C in (i, pattern%column(j)), and entry (i, j) of M in (i,
        !> pattern%mass_column(j)).
        type(pattern_type), allocatable :: pattern
        !> True if derivatives follow the bodies of `pattern`: `evaluate_derivatives` stores the entries of coordinate j in column
        !> `derivatives%column_of(j)`, since matrices are compressed by the pattern, and `evaluate_stiffness` is overridden.
        logical :: derives_by_bodies = .false.
        !> Names and units of the coordinates (n); defaults q1, q2, ... and no unit.
        character(len=label_length), allocatable :: coordinate_name(:), coordinate_unit(:)
        !> Typical magnitude of each coordinate (n), positive; default 1. Bases, norms and rank decisions use q/scale.
        real(wp), allocatable :: coordinate_scale(:)
        !> Period of each coordinate (n), 0 if none. Full revolutions of an angle do not reduce its accuracy: in error norms |q| is
        !> at most half a period.
        real(wp), allocatable :: coordinate_period(:)
        !> Typical time of the motion, positive. Velocities are related to scale/time_scale, accelerations to scale/time_scale**2.
        real(wp) :: time_scale = 1.0_wp
        !> Names of the constraint rows (nh) and (nd); defaults holonomic 1, ..., nonholonomic 1, ...
        character(len=label_length), allocatable :: holonomic_name(:), nonholonomic_name(:)
        !> Units of the multipliers (nh + nd), for files: J divided by the unit of the row of Phi, W divided by the unit of the row
        !> of E qd.
        character(len=label_length), allocatable :: multiplier_unit(:)
        !> True if `composed` provides names and units that are not given here. True if tandem provides the procedures of the model,
        !> so that messages do not advise users to check them.
        logical :: composes_labels = .false., is_ready_made = .false.
        !> Times of kinks or jumps of functions of time, in increasing order. Steps end exactly at these times.
        real(wp), allocatable :: breakpoints(:)
        !> True for each breakpoint at which nu, and therefore qd, jumps; default false.
        logical, allocatable :: nu_jumps(:)
        !> Index of the current smooth piece, 1 before the first breakpoint. The simulation sets it. Procedures use this index and
        !> never compare t with a breakpoint.
        integer :: segment = 1
        !> Quantities that `measure` returns, in its order; not allocated: none. True if `measure` must be called in every step, to
        !> count revolutions.
        type(quantity_type), allocatable :: quantities(:)
        logical :: measures_every_step = .false.
        !> True if `measure` uses the multipliers.
        logical :: measures_multipliers = .false.
        !> Inputs of the linearised system: names of functions of time. An element may have several.
        character(len=label_length), allocatable :: input_name(:)
        !> The state: everything besides `segment` that changes during a run or an analysis.
        type(model_state_type) :: state

        !> Kinetic energy T(q, qd) for reports; default qd' M qd / 2.
        procedure(energy_of_motion), pointer :: kinetic_energy => null()
        !> Potential energy V(t, q) for reports.
        procedure(energy_of_position), pointer :: potential_energy => null()
        !> Evaluates any set of the terms in `provides` at one point.
        procedure(evaluate_interface), pointer :: evaluate => null()
        !> Terms that `evaluate` provides, a sum of need bits (see `tandem_model_terms`). A term that neither `evaluate` nor a
        !> single procedure (see `procedure_model_type`) provides is zero. Phi, C and M are required.
        integer :: provides = 0

        !> Evaluates any set of the derivatives in `provides_derivatives` (see `tandem_model_derivatives`) at one point. For
        !> implicit steppers only; differences replace derivatives that are not provided.
        procedure(evaluate_derivatives_interface), pointer :: evaluate_derivatives => null()
        !> Derivatives that `evaluate_derivatives` provides, a sum of need bits (see `tandem_model_derivatives`).
        integer :: provides_derivatives = 0
        !> Number of frictions that depend on reactions, see `friction_directions`.
        integer :: n_frictions = 0
    contains
        procedure :: n_constraints, row_name, coordinate_label, unit_of_coordinate, unit_of_multiplier, has_units, composed
        procedure :: scales, largest_on_scales, set_magnitudes, set_time_scale, note_blocks, pack_state, arrive, is_idle
        procedure :: know_breakpoints, hides, list_imposed
        procedure :: has_terms, gives, evaluate_single, evaluate_part, evaluate_stiffness
        procedure :: measure, integrands, begin_measuring, change
        procedure :: friction_directions, normal_forces, list_motions, force_rate, describe_motion
    end type model_type

    abstract interface
        !> An energy that depends on the velocity.
        subroutine energy_of_motion(self, q, qd, value, stat)
            import :: model_type, wp
            implicit none (type, external)
            class(model_type), intent(inout) :: self
            real(wp), intent(in) :: q(:), qd(:)
            real(wp), intent(out) :: value
            integer, intent(out) :: stat
        end subroutine energy_of_motion

        !> An energy that depends on the position.
        subroutine energy_of_position(self, t, q, value, stat)
            import :: model_type, wp
            implicit none (type, external)
            class(model_type), intent(inout) :: self
            real(wp), intent(in) :: t, q(:)
            real(wp), intent(out) :: value
            integer, intent(out) :: stat
        end subroutine energy_of_position

        !> Evaluate several terms at once.
        subroutine evaluate_interface(self, need, t, q, qd, terms, stat)
            import :: model_type, wp, terms_type
            implicit none (type, external)
            class(model_type), intent(inout) :: self
            !> Requested terms, a sum of need bits; only those in `provides` are requested.
            integer, intent(in) :: need
            !> qd is defined only if gamma or force is requested.
            real(wp), intent(in) :: t, q(:), qd(:)
            !> Set the requested terms, including zeros; leave the others unchanged.
            type(terms_type), intent(inout) :: terms
            integer, intent(out) :: stat
        end subroutine evaluate_interface

        !> Evaluate several derivatives at once.
        subroutine evaluate_derivatives_interface(self, need, t, q, qd, qdd, lambda, derivatives, stat)
            import :: model_type, wp, derivatives_type
            implicit none (type, external)
            class(model_type), intent(inout) :: self
            !> Requested derivatives, a sum of need bits; only those in `provides_derivatives` are requested.
            integer, intent(in) :: need
            !> Time, coordinates, velocities, accelerations (n), multipliers (nh + nd).
            real(wp), intent(in) :: t, q(:), qd(:), qdd(:), lambda(:)
            !> Set the requested derivatives, including zeros; leave the others unchanged.
            type(derivatives_type), intent(inout) :: derivatives
            integer, intent(out) :: stat
        end subroutine evaluate_derivatives_interface
    end interface

contains

    !> Number of rows of C, nh + nd.
    pure integer function n_constraints(self)
        class(model_type), intent(in) :: self

        n_constraints = self%n_holonomic + self%n_nonholonomic
    end function n_constraints

    !> Terms that the model provides, a sum of need bits: those of `evaluate`, and the required ones.
    pure integer function has_terms(self)
        class(model_type), intent(in) :: self

        has_terms = ior(self%provides, need_mass)
        if (self%n_holonomic > 0) has_terms = ior(has_terms, need_phi)
        if (self%n_constraints() > 0) has_terms = ior(has_terms, need_jacobian)
    end function has_terms

    !> Evaluate terms that `evaluate` does not provide by single procedures, see `procedure_model_type`. Fails by default.
    subroutine evaluate_single(self, wanted, t, q, qd, terms, part, failed_term, stat)
        class(model_type), intent(inout) :: self
        !> Requested terms, a sum of need bits.
        integer, intent(in) :: wanted
        real(wp), intent(in) :: t, q(:), qd(:)
        type(terms_type), intent(inout) :: terms
        !> Work space (n).
        real(wp), intent(inout) :: part(:)
        !> Index of the term whose procedure failed.
        integer, intent(out) :: failed_term
        !> Status of the procedure.
        integer, intent(out) :: stat

        failed_term = trailz(wanted) + 1
        stat = -1
    end subroutine evaluate_single

    !> True if the model has a single procedure for a part of the derivatives, see `procedure_model_type`.
    pure logical function gives(self, part)
        class(model_type), intent(in) :: self
        !> Index of the part in `tandem_model_timer`, from `of_jacobian_derivative` to `of_force_qd`.
        integer, intent(in) :: part

        gives = .false.
    end function gives

    !> Evaluate a part of the derivatives by a single procedure.
    subroutine evaluate_part(self, part, t, q, v, value, stat)
        class(model_type), intent(inout) :: self
        integer, intent(in) :: part
        !> Time, coordinates (n), and the vector on which the part also depends: velocities or accelerations (n), or multipliers (nh
        !> + nd).
        real(wp), intent(in) :: t, q(:), v(:)
        !> Matrix with one row per row of C or per coordinate, and one column per coordinate.
        real(wp), intent(out) :: value(:, :)
        integer, intent(out) :: stat

        value = 0.0_wp
        stat = -1
    end subroutine evaluate_part

    !> Evaluate `quantities`, one after the other, at a state of the motion. This procedure and the following ones are for models
    !> that set `quantities` or `n_frictions`, or that events may change.
    subroutine measure(self, t, q, qd, qdd, values, stat, lambda)
        class(model_type), intent(inout) :: self
        !> Time, coordinates, velocities, accelerations (n). Times of successive calls increase.
        real(wp), intent(in) :: t, q(:), qd(:), qdd(:)
        !> Values of all quantities. If `asked` is allocated, other quantities need not be set, and accelerations are not used.
        real(wp), intent(inout) :: values(:)
        integer, intent(out) :: stat
        !> Multipliers (nh + nd). If absent, quantities that depend on multipliers are NaN.
        real(wp), intent(in), optional :: lambda(:)

        stat = -1
    end subroutine measure

    !> Evaluate the rates of `state%integrals`.
    subroutine integrands(self, t, q, qd, lambda, values, stat)
        class(model_type), intent(inout) :: self
        !> Time, coordinates, velocities (n), multipliers (nh + nd).
        real(wp), intent(in) :: t, q(:), qd(:), lambda(:)
        !> One value per integral.
        real(wp), intent(out) :: values(:)
        integer, intent(out) :: stat

        values = 0.0_wp
        stat = 0
    end subroutine integrands

    !> Set quantities that depend on the start. Called once before the first `measure`, with the state at the start. Does nothing by
    !> default.
    subroutine begin_measuring(self, t, q, qd, lambda, stat)
        class(model_type), intent(inout) :: self
        !> Time, coordinates, velocities (n), multipliers (nh + nd).
        real(wp), intent(in) :: t, q(:), qd(:), lambda(:)
        integer, intent(out) :: stat

        stat = 0
    end subroutine begin_measuring

    !> Change the model at an event. Afterwards the state must satisfy the position constraints.
    subroutine change(self, what, is_trial, t, q, problem)
        class(model_type), intent(inout) :: self
        !> Description of the change, in the syntax of the model.
        character(len=*), intent(in) :: what
        !> True to check the description only; t and q are then not used.
        logical, intent(in) :: is_trial
        real(wp), intent(in) :: t, q(:)
        !> Problem and remedy; blank after success.
        character(len=*), intent(out) :: problem

        problem = 'the model has no parameters that events may change'
    end subroutine change

    !> Friction that depends on reactions: the force B(t, q, qd) p(lambda), added to S + Q_A. Column i of B (n, n_frictions) is the
    !> force of friction i for a normal force of 1. The sums of `evaluate_derivatives` include -B p for constant multipliers.
    subroutine friction_directions(self, t, q, qd, value, stat)
        class(model_type), intent(inout) :: self
        real(wp), intent(in) :: t, q(:), qd(:)
        real(wp), intent(out) :: value(:, :)
        integer, intent(out) :: stat

        value = 0.0_wp
        stat = -1
    end subroutine friction_directions

    !> Normal forces p for given multipliers. Each is a norm: p(a x) = |a| p(x), p(x + y) <= p(x) + p(y).
    subroutine normal_forces(self, lambda, value, gradient)
        class(model_type), intent(inout) :: self
        !> Multipliers (nh + nd).
        real(wp), intent(in) :: lambda(:)
        !> Normal forces p (n_frictions), not negative, and their gradients (n_frictions, nh + nd), zero where p is zero.
        real(wp), intent(out) :: value(:), gradient(:, :)

        value = 0.0_wp
        gradient = 0.0_wp
    end subroutine normal_forces

    !> List motions of the whole model for the analysis of steady motions, which finds symmetries among these motions and their
    !> sums. If none are listed, as by default, all translations and rotations of the coordinates are tried, provided that there are
    !> few.
    subroutine list_motions(self, motions)
        class(model_type), intent(inout) :: self
        !> Motions; not allocated if none are listed.
        type(affine_motion_type), allocatable, intent(out) :: motions(:)
    end subroutine list_motions

    !> Partial derivative of S + Q_A with respect to time, for the analysis of steady motions. Differences replace it by default.
    subroutine force_rate(self, t, q, qd, value, is_given, stat)
        class(model_type), intent(inout) :: self
        real(wp), intent(in) :: t, q(:), qd(:)
        !> Derivative (n).
        real(wp), intent(out) :: value(:)
        !> True if the model provides the derivative.
        logical, intent(out) :: is_given
        integer, intent(out) :: stat

        value = 0.0_wp
        is_given = .false.
        stat = 0
    end subroutine force_rate

    !> K = (M qdd + C' lambda - S - Q_A)_q and D = -(S + Q_A)_qd by blocks of the bodies of `pattern`. Required for implicit
    !> steppers on sparse charts. Omitted parts may cost corrections but cannot change the solution.
    subroutine evaluate_stiffness(self, t, q, qd, qdd, lambda, stiffness, stat)
        class(model_type), intent(inout) :: self
        !> Time, coordinates, velocities, accelerations (n), multipliers (nh + nd).
        real(wp), intent(in) :: t, q(:), qd(:), qdd(:), lambda(:)
        !> Set all blocks, including zeros. Bodies are those of the pattern, and pairs of bodies those of `pattern%coupled`.
        type(stiffness_type), intent(inout) :: stiffness
        integer, intent(out) :: stat

        stat = -1
    end subroutine evaluate_stiffness

    !> Name of a row, padded with blanks.
    pure function padded_name(self, row) result(name)
        class(model_type), intent(in) :: self
        integer, intent(in) :: row
        character(len=label_length) :: name

        associate (nh => self%n_holonomic)
            if (row <= nh .and. allocated(self%holonomic_name)) then
                name = self%holonomic_name(row)
            else if (row > nh .and. allocated(self%nonholonomic_name)) then
                name = self%nonholonomic_name(row - nh)
            else if (self%composes_labels) then
                name = self%composed(name_of_row, row)
            else if (row <= nh) then
                write (name, '(a, i0)') 'holonomic ', row
            else
                write (name, '(a, i0)') 'nonholonomic ', row - nh
            end if
        end associate
    end function padded_name

    !> Length of the name of a row (a deferred length would be static memory, see `tandem_status`).
    pure integer function name_length(self, row)
        class(model_type), intent(in) :: self
        integer, intent(in) :: row

        name_length = len_trim(padded_name(self, row))
    end function name_length

    !> Name of a row of C.
    pure function row_name(self, row) result(name)
        class(model_type), intent(in) :: self
        !> Row of C, holonomic rows first.
        integer, intent(in) :: row
        character(len=name_length(self, row)) :: name

        name = padded_name(self, row)
    end function row_name

    !> Scales of the coordinates (n); 1 by default.
    pure function scales(self)
        class(model_type), intent(in) :: self
        real(wp) :: scales(self%n)

        scales = 1.0_wp
        if (allocated(self%coordinate_scale)) scales = self%coordinate_scale
    end function scales

    !> Largest entry of a vector relative to the coordinate scales. Does not allocate.
    pure real(wp) function largest_on_scales(self, x)
        class(model_type), intent(in) :: self
        !> Increments of coordinates or rates (n).
        real(wp), intent(in) :: x(:)

        largest_on_scales = maxval(abs(x))
        if (allocated(self%coordinate_scale)) largest_on_scales = maxval(abs(x)/self%coordinate_scale)
    end function largest_on_scales

    !> Describe a motion without mass for a message: the coordinate with the largest rate on its scale.
    subroutine describe_motion(self, q, direction, text)
        class(model_type), intent(in) :: self
        !> Coordinates, and their rates in the motion (n).
        real(wp), intent(in) :: q(:), direction(:)
        character(len=:), allocatable, intent(out) :: text

        text = 'the coordinate "'//self%coordinate_label(maxloc(abs(direction)/self%scales(), dim=1))//'" moves without mass'
    end subroutine describe_motion

    !> Set the time scale. Called when a run or an analysis starts at (t, q, qd). Does nothing by default.
    subroutine set_time_scale(self, t, q, qd)
        class(model_type), intent(inout) :: self
        !> Time, coordinates and velocities (n), which need not satisfy the constraints.
        real(wp), intent(in) :: t, q(:), qd(:)
    end subroutine set_time_scale

    !> Magnitudes of the coordinates for the rounding errors of rows of Phi, used if they exceed the scales. The default is q.
    !> Override this if rows are so nonlinear in a large coordinate that their gradients do not show its effect everywhere.
    pure subroutine set_magnitudes(self, q, magnitude)
        class(model_type), intent(in) :: self
        !> Coordinates, and their magnitudes (n).
        real(wp), intent(in), contiguous :: q(:)
        real(wp), intent(out), contiguous :: magnitude(:)

        magnitude = q
    end subroutine set_magnitudes

    !> Name of a coordinate, padded with blanks.
    pure function padded_label(self, i) result(name)
        class(model_type), intent(in) :: self
        integer, intent(in) :: i
        character(len=label_length) :: name

        if (allocated(self%coordinate_name)) then
            name = self%coordinate_name(i)
        else if (self%composes_labels) then
            name = self%composed(name_of_coordinate, i)
        else
            write (name, '(a, i0)') 'q', i
        end if
    end function padded_label

    !> Length of the name of a coordinate.
    pure integer function coordinate_label_length(self, i)
        class(model_type), intent(in) :: self
        integer, intent(in) :: i

        coordinate_label_length = len_trim(padded_label(self, i))
    end function coordinate_label_length

    !> Name of a coordinate, q1, q2, ... by default.
    pure function coordinate_label(self, i) result(name)
        class(model_type), intent(in) :: self
        !> Index of the coordinate.
        integer, intent(in) :: i
        character(len=coordinate_label_length(self, i)) :: name

        name = padded_label(self, i)
    end function coordinate_label

    !> True if the model defines units of its coordinates or, with `of_multipliers`, of its multipliers.
    pure logical function has_units(self, of_multipliers)
        class(model_type), intent(in) :: self
        logical, intent(in) :: of_multipliers

        has_units = self%composes_labels .or. merge(allocated(self%multiplier_unit), allocated(self%coordinate_unit), &
            of_multipliers)
    end function has_units

    !> Unit of a coordinate, blank if none is given.
    pure function unit_of_coordinate(self, i) result(unit)
        class(model_type), intent(in) :: self
        integer, intent(in) :: i
        character(len=label_length) :: unit

        unit = ''
        if (allocated(self%coordinate_unit)) then
            unit = self%coordinate_unit(i)
        else if (self%composes_labels) then
            unit = self%composed(its_unit, i)
        end if
    end function unit_of_coordinate

    !> Unit of the multiplier of a row, blank if none is given.
    pure function unit_of_multiplier(self, row) result(unit)
        class(model_type), intent(in) :: self
        integer, intent(in) :: row
        character(len=label_length) :: unit

        unit = ''
        if (allocated(self%multiplier_unit)) then
            unit = self%multiplier_unit(row)
        else if (self%composes_labels) then
            unit = self%composed(unit_of_its_multiplier, row)
        end if
    end function unit_of_multiplier

    !> Compose a name or a unit on request, since labels of thousands of bodies would take more memory than their states. For models
    !> that set `composes_labels`; blank by default.
    pure function composed(self, what, i) result(label)
        class(model_type), intent(in) :: self
        !> Kind of label, one of the constants of this module; index of the coordinate or row.
        integer, intent(in) :: what, i
        character(len=label_length) :: label

        label = ''
    end function composed

    !> Mark in the pattern, by `in_blocks` and `all_in_blocks`, the rows that `evaluate` stores in `terms%blocks`. Called after a
    !> chart has set the positions of blocks. Marks no rows by default.
    pure subroutine note_blocks(self)
        class(model_type), intent(inout) :: self
    end subroutine note_blocks

    !> Pack, by `pack%item`, the data that procedures of the model or actions of events change and on which later calls depend, for
    !> checkpoints. Packs nothing by default; constant parameters need not be packed.
    subroutine pack_state(self, pack)
        class(model_type), intent(inout) :: self
        !> Writes or reads.
        type(pack_type), intent(inout) :: pack
    end subroutine pack_state

    !> Mark holonomic rows that impose a motion, and among these the rows that impose an angle (rad). The search for a start follows
    !> imposed motions that are far from satisfied. Marks no rows by default.
    pure subroutine list_imposed(self, is_imposed, is_angle)
        class(model_type), intent(in) :: self
        !> One entry per holonomic row.
        logical, intent(out) :: is_imposed(:), is_angle(:)

        is_imposed = .false.
        is_angle = .false.
    end subroutine list_imposed

    !> Called at the start of a run and after every accepted step, at its end. Count events along the motion, such as full
    !> revolutions, here and not at trial points of steps. Does nothing by default.
    subroutine arrive(self, t, q, starts)
        class(model_type), intent(inout) :: self
        !> Time, coordinates (n).
        real(wp), intent(in) :: t, q(:)
        !> True at the start of a run, which resets such counts.
        logical, intent(in) :: starts
    end subroutine arrive

    !> True for coordinates (n) that do not move in the current model; the analysis omits them. False by default.
    pure function is_idle(self)
        class(model_type), intent(in) :: self
        logical :: is_idle(self%n)

        is_idle = .false.
    end function is_idle

    !> Make sure that the first `number` breakpoints, if there are as many, are in the list. Does nothing by default.
    subroutine know_breakpoints(self, number, error)
        class(model_type), intent(inout) :: self
        integer, intent(in) :: number
        !> Set if they cannot be found, or if the model is invalid at a breakpoint.
        type(error_type), allocatable, intent(out) :: error
    end subroutine know_breakpoints

    !> True if functions of time vary between two times of the current segment in a way that a step of this length would miss, such
    !> as a narrow pulse. The step should then be shorter. False by default.
    logical function hides(self, from, to, between)
        class(model_type), intent(inout) :: self
        real(wp), intent(in) :: from, to
        !> True if the step also evaluates between its ends.
        logical, intent(in) :: between

        hides = .false.
    end function hides
end module tandem_model
