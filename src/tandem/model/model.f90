! SPDX-License-Identifier: MIT
!> The model: sizes, names, and one procedure for any set of its terms. A scene extends `model_type` with its parameters and
!> associates `evaluate`. A model with one procedure for each term extends `procedure_model_type`, which calls these instead.
!>
!> Every procedure is a subroutine whose last argument is a status: 0 ok, > 0 this point cannot be evaluated (a smaller step may
!> help), < 0 stop. Associate module procedures only: a pointer to an internal procedure needs a trampoline on the stack, which
!> crashes if the stack is not executable.
!>
!> The passed object is `intent(inout)`, so that a model may keep intermediate results; one instance belongs to one simulation. A
!> defined model is a description that can be copied, `allocate (instance, source=model)`, before or after a run: the copy is an
!> instance of its own, unless an extension has pointers to data. What a run or an analysis changes is `segment` and `state`, and in
!> extensions what they keep.
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

    !> Arguments of `composed`.
    integer, parameter :: name_of_coordinate = 1, its_unit = 2, name_of_row = 3, unit_of_its_multiplier = 4

    !> A scene extends this with its parameters; sizes define the existing terms, procedure pointers their values.
    type :: model_type
        !> Name of the model in reports and files.
        character(len=:), allocatable :: name
        !> Number of generalized coordinates.
        integer :: n = 0
        !> Doubtful property of the model, a warning of every run; not allocated: none.
        character(len=:), allocatable :: doubt
        !> Number of holonomic constraints Phi(t, q) = 0.
        integer :: n_holonomic = 0
        !> Number of nonholonomic constraints E(t, q) qd = e(t, q).
        integer :: n_nonholonomic = 0
        !> True if there may be more rows than coordinates, as for joints in closed loops: redundant rows are found at the start. If
        !> false, so many rows are refused.
        logical :: rows_may_repeat = .false.
        !> True if M does not depend on q: it is then evaluated once.
        logical :: constant_mass = .false.
        !> Sizes of the diagonal blocks of M in their order, n in total, if all entries outside of them are zero at every q:
        !> explicit steps omit those. Not allocated: one block of n. For a constant M the blocks are computed.
        integer, allocatable :: mass_blocks(:)
        !> Entries of C and M that may be nonzero, for sparse charts; not allocated: all entries. A model with a pattern must store
        !> entry (i, j) of C in (i, pattern%column(j)), and that of M in (i, pattern%mass_column(j)), if `terms%is_compressed` is
        !> true.
        type(pattern_type), allocatable :: pattern
        !> True if derivatives follow the bodies of `pattern`: `evaluate_derivatives` sets the entries of coordinate j in column
        !> `derivatives%column_of(j)`, for matrices that are compressed by the pattern, and `evaluate_stiffness` is overridden.
        logical :: derives_by_bodies = .false.
        !> Names and units of the coordinates (n); defaults q1, q2, ... and no unit.
        character(len=label_length), allocatable :: coordinate_name(:), coordinate_unit(:)
        !> Typical magnitude of each coordinate (n), > 0; default 1. Bases, norms and the rank decision use q / scale.
        real(wp), allocatable :: coordinate_scale(:)
        !> Period of each coordinate (n), 0 if none: full turns of an angle do not reduce its accuracy. In error norms |q| is at
        !> most half a period.
        real(wp), allocatable :: coordinate_period(:)
        !> Typical time of the motion, > 0: velocities are compared with scale / time_scale, accelerations with that / time_scale.
        real(wp) :: time_scale = 1.0_wp
        !> Names of the constraint rows (nh) and (nd); defaults holonomic 1, ..., nonholonomic 1, ...
        character(len=label_length), allocatable :: holonomic_name(:), nonholonomic_name(:)
        !> Units of the multipliers (nh + nd), for files: J over the unit of a row of Phi, W over that of a row of E qd.
        character(len=label_length), allocatable :: multiplier_unit(:)
        !> True if `composed` provides names and units that are not given there; true if tandem provides the procedures, so that no
        !> message asks users to check them.
        logical :: composes_labels = .false., is_ready_made = .false.
        !> Ascending times of kinks or jumps of functions of time: steps end there exactly.
        real(wp), allocatable :: breakpoints(:)
        !> True for each breakpoint at which nu, and therefore qd, jumps; default false.
        logical, allocatable :: nu_jumps(:)
        !> Number of the current smooth piece, 1 before the first breakpoint; set by the simulation. Procedures use this number and
        !> never compare t with a breakpoint.
        integer :: segment = 1
        !> Quantities of `measure`, in its order; not allocated: none. True if it must be called at every step to count turns.
        type(quantity_type), allocatable :: quantities(:)
        logical :: measures_every_step = .false.
        !> True if `measure` uses the multipliers.
        logical :: measures_multipliers = .false.
        !> Inputs of the linearised system: names of functions of time, of which an element may have several.
        character(len=label_length), allocatable :: input_name(:)
        !> All that changes during a run or an analysis besides `segment`.
        type(model_state_type) :: state

        !> T(q, qd) for reports; default qd' M qd / 2.
        procedure(energy_of_motion), pointer :: kinetic_energy => null()
        !> V(t, q) for reports.
        procedure(energy_of_position), pointer :: potential_energy => null()
        !> Any set of terms at one point in one call: those in `provides`.
        procedure(evaluate_interface), pointer :: evaluate => null()
        !> Terms provided by `evaluate`, a sum of need bits (see `tandem_model_terms`). A term that neither `evaluate` nor a single
        !> procedure (see `procedure_model_type`) provides is zero; Phi, C and M are required.
        integer :: provides = 0

        !> Any set of the five sums in `tandem_model_derivatives` at one point in one call: those in `provides_derivatives`. For
        !> implicit steppers only; differences replace the others.
        procedure(evaluate_derivatives_interface), pointer :: evaluate_derivatives => null()
        !> Derivatives provided by `evaluate_derivatives`, a sum of need bits (see `tandem_model_derivatives`).
        integer :: provides_derivatives = 0
        !> Number of frictions on reactions, see `friction_directions`.
        integer :: n_frictions = 0
    contains
        procedure :: n_constraints, row_name, coordinate_label, unit_of_coordinate, unit_of_multiplier, has_units, composed
        procedure :: scales, largest_on_scales, set_magnitudes, set_time_scale, note_blocks, pack_state, arrive, is_idle
        procedure :: know_breakpoints, hides, list_imposed
        procedure :: has_terms, gives, evaluate_single, evaluate_part, evaluate_stiffness
        procedure :: measure, integrands, begin_measuring, change
        procedure :: friction_directions, normal_forces, list_motions, force_rate
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

        !> Several terms at once.
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

        !> Several derivatives at once.
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

    !> nh + nd, the number of rows of C.
    pure integer function n_constraints(self)
        class(model_type), intent(in) :: self

        n_constraints = self%n_holonomic + self%n_nonholonomic
    end function n_constraints

    !> Terms of the model, a sum of need bits: those of `evaluate`, and the required ones.
    pure integer function has_terms(self)
        class(model_type), intent(in) :: self

        has_terms = ior(self%provides, need_mass)
        if (self%n_holonomic > 0) has_terms = ior(has_terms, need_phi)
        if (self%n_constraints() > 0) has_terms = ior(has_terms, need_jacobian)
    end function has_terms

    !> Evaluate terms that `evaluate` does not provide, by single procedures: see `procedure_model_type`. Without any, this fails.
    subroutine evaluate_single(self, wanted, t, q, qd, terms, part, failed_term, stat)
        class(model_type), intent(inout) :: self
        !> Terms, a sum of need bits.
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

    !> True if there is a single procedure for a part of the five derivatives, see `procedure_model_type`.
    pure logical function gives(self, part)
        class(model_type), intent(in) :: self
        !> Its number in `tandem_model_timer`, from `of_jacobian_derivative` to `of_force_qd`.
        integer, intent(in) :: part

        gives = .false.
    end function gives

    !> Evaluate a part of the derivatives that the model gives.
    subroutine evaluate_part(self, part, t, q, v, value, stat)
        class(model_type), intent(inout) :: self
        integer, intent(in) :: part
        !> Time, coordinates (n), and what the part depends on besides: velocities or accelerations (n), or multipliers (nh + nd).
        real(wp), intent(in) :: t, q(:), v(:)
        !> Rows of C or coordinates, by coordinates.
        real(wp), intent(out) :: value(:, :)
        integer, intent(out) :: stat

        value = 0.0_wp
        stat = -1
    end subroutine evaluate_part

    !> Set the values of `quantities`, one after the other, at a state of the motion. This and the next procedures are for models
    !> that set `quantities` or `n_frictions`, or that events may change.
    subroutine measure(self, t, q, qd, qdd, values, stat, lambda)
        class(model_type), intent(inout) :: self
        !> Time, coordinates, velocities, accelerations (n). Times ascend.
        real(wp), intent(in) :: t, q(:), qd(:), qdd(:)
        !> All quantities; if `asked` is allocated, others need not be set, and accelerations are not used.
        real(wp), intent(inout) :: values(:)
        integer, intent(out) :: stat
        !> Multipliers (nh + nd): without them quantities of multipliers are NaN.
        real(wp), intent(in), optional :: lambda(:)

        stat = -1
    end subroutine measure

    !> Rates of `state%integrals`.
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

    !> Called once before the first `measure`, with the state at the start, to set the quantities that depend on it. By default
    !> nothing is done.
    subroutine begin_measuring(self, t, q, qd, lambda, stat)
        class(model_type), intent(inout) :: self
        !> Time, coordinates, velocities (n), multipliers (nh + nd).
        real(wp), intent(in) :: t, q(:), qd(:), lambda(:)
        integer, intent(out) :: stat

        stat = 0
    end subroutine begin_measuring

    !> Change the model at an event. The state must satisfy the position constraints after the change.
    subroutine change(self, what, is_trial, t, q, problem)
        class(model_type), intent(inout) :: self
        !> Description of the change, in the format of the model.
        character(len=*), intent(in) :: what
        !> True to check the change only; t and q are then not used.
        logical, intent(in) :: is_trial
        real(wp), intent(in) :: t, q(:)
        !> Problem and remedy; blank after success.
        character(len=*), intent(out) :: problem

        problem = 'the model has no parameters that events may change'
    end subroutine change

    !> Friction on reactions: the force B(t, q, qd) p(lambda) in addition to S + Q_A, with `n_frictions` columns. B (n, n_frictions)
    !> is the force of each friction for a normal force of one. The sums of `evaluate_derivatives` include -B p, for constant
    !> multipliers.
    subroutine friction_directions(self, t, q, qd, value, stat)
        class(model_type), intent(inout) :: self
        real(wp), intent(in) :: t, q(:), qd(:)
        real(wp), intent(out) :: value(:, :)
        integer, intent(out) :: stat

        value = 0.0_wp
        stat = -1
    end subroutine friction_directions

    !> Normal forces p of friction for given multipliers, each a norm: p(a x) = |a| p(x), p(x + y) <= p(x) + p(y).
    subroutine normal_forces(self, lambda, value, gradient)
        class(model_type), intent(inout) :: self
        !> Multipliers (nh + nd).
        real(wp), intent(in) :: lambda(:)
        !> p (n_frictions), not negative, and its gradient (n_frictions, nh + nd), zero where p is zero.
        real(wp), intent(out) :: value(:), gradient(:, :)

        value = 0.0_wp
        gradient = 0.0_wp
    end subroutine normal_forces

    !> Motions of the model as a whole, for the analysis of steady motions: it finds the symmetries among these and their sums. If
    !> none are listed, as by default, all translations and rotations of the coordinates are tried, if these are few.
    subroutine list_motions(self, motions)
        class(model_type), intent(inout) :: self
        !> Not allocated: none are listed.
        type(affine_motion_type), allocatable, intent(out) :: motions(:)
    end subroutine list_motions

    !> Partial derivative of S + Q_A with respect to time, for the same analysis; by default differences replace it.
    subroutine force_rate(self, t, q, qd, value, is_given, stat)
        class(model_type), intent(inout) :: self
        real(wp), intent(in) :: t, q(:), qd(:)
        !> (n)
        real(wp), intent(out) :: value(:)
        !> True if the model gives it.
        logical, intent(out) :: is_given
        integer, intent(out) :: stat

        value = 0.0_wp
        is_given = .false.
        stat = 0
    end subroutine force_rate

    !> K = (M qdd + C' lambda - S - Q_A)_q and D = -(S + Q_A)_qd by blocks of the bodies of `pattern`, required for implicit
    !> steppers on sparse charts. Omitted parts cost corrections but never change the solution.
    subroutine evaluate_stiffness(self, t, q, qd, qdd, lambda, stiffness, stat)
        class(model_type), intent(inout) :: self
        !> Time, coordinates, velocities, accelerations (n), multipliers (nh + nd).
        real(wp), intent(in) :: t, q(:), qd(:), qdd(:), lambda(:)
        !> Set all blocks, including zeros; bodies are those of the pattern, pairs those of `pattern%coupled`.
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

    !> The name of a row of C.
    pure function row_name(self, row) result(name)
        class(model_type), intent(in) :: self
        !> Row of C, holonomic rows first.
        integer, intent(in) :: row
        character(len=name_length(self, row)) :: name

        name = padded_name(self, row)
    end function row_name

    !> Scales of the coordinates (n): 1 if none are given.
    pure function scales(self)
        class(model_type), intent(in) :: self
        real(wp) :: scales(self%n)

        scales = 1.0_wp
        if (allocated(self%coordinate_scale)) scales = self%coordinate_scale
    end function scales

    !> Largest entry of a vector relative to these scales. Allocates nothing.
    pure real(wp) function largest_on_scales(self, x)
        class(model_type), intent(in) :: self
        !> Increments of coordinates or rates (n).
        real(wp), intent(in) :: x(:)

        largest_on_scales = maxval(abs(x))
        if (allocated(self%coordinate_scale)) largest_on_scales = maxval(abs(x)/self%coordinate_scale)
    end function largest_on_scales

    !> A run or an analysis starts at (t, q, qd): a model may set its time scale here. By default nothing is done.
    subroutine set_time_scale(self, t, q, qd)
        class(model_type), intent(inout) :: self
        !> Time, coordinates and velocities (n), which need not satisfy the constraints.
        real(wp), intent(in) :: t, q(:), qd(:)
    end subroutine set_time_scale

    !> Sizes of the coordinates for the rounding errors of rows of Phi, used if they exceed the scales. By default q itself; to be
    !> overridden by a model with rows so nonlinear in a large coordinate that their gradients do not show its effect everywhere.
    pure subroutine set_magnitudes(self, q, magnitude)
        class(model_type), intent(in) :: self
        !> Coordinates, and their sizes (n).
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
        !> Its index.
        integer, intent(in) :: i
        character(len=coordinate_label_length(self, i)) :: name

        name = padded_label(self, i)
    end function coordinate_label

    !> True if the model defines the units of its coordinates, or those of its multipliers.
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

    !> Names and units, composed on request, because those of thousands of bodies would take more memory than their states. For
    !> models that set `composes_labels`; by default blank.
    pure function composed(self, what, i) result(label)
        class(model_type), intent(in) :: self
        !> One of the constants of this module, and the index of the coordinate or row.
        integer, intent(in) :: what, i
        character(len=label_length) :: label

        label = ''
    end function composed

    !> Called after a chart has set the places of rows of C in `terms%blocks`: mark those that `evaluate` sets there in the pattern,
    !> `in_blocks` and `all_in_blocks`. By default none.
    pure subroutine note_blocks(self)
        class(model_type), intent(inout) :: self
    end subroutine note_blocks

    !> State of the model that its procedures, or actions of events, change and later calls depend on: pack it by `pack%item` for
    !> checkpoints. By default nothing; constant parameters need not be packed.
    subroutine pack_state(self, pack)
        class(model_type), intent(inout) :: self
        !> Writes or reads.
        type(pack_type), intent(inout) :: pack
    end subroutine pack_state

    !> Mark rows at position level that impose a motion, and those of them that impose an angle (rad): the search for a start
    !> follows them if they are far from satisfied. By default none.
    pure subroutine list_imposed(self, is_imposed, is_angle)
        class(model_type), intent(in) :: self
        !> One entry per holonomic row.
        logical, intent(out) :: is_imposed(:), is_angle(:)

        is_imposed = .false.
        is_angle = .false.
    end subroutine list_imposed

    !> A run has arrived at q, at its start or by an accepted step. Procedures that count along the motion, such as turns, count
    !> here and not at trial points of steps. By default nothing is done.
    subroutine arrive(self, t, q, starts)
        class(model_type), intent(inout) :: self
        !> Time, coordinates (n).
        real(wp), intent(in) :: t, q(:)
        !> True if a run starts there, which resets such counts.
        logical, intent(in) :: starts
    end subroutine arrive

    !> True for coordinates (n) that take no part in the motion of the current model: the analysis omits them. By default none.
    pure function is_idle(self)
        class(model_type), intent(in) :: self
        logical :: is_idle(self%n)

        is_idle = .false.
    end function is_idle

    !> Make sure that the first `number` breakpoints are in the list, if there are so many. By default nothing is done.
    subroutine know_breakpoints(self, number, error)
        class(model_type), intent(inout) :: self
        integer, intent(in) :: number
        !> Set if they cannot be found, or the model is invalid there.
        type(error_type), allocatable, intent(out) :: error
    end subroutine know_breakpoints

    !> True if functions of time take values between two times of the current segment that a step does not sample, such as a narrow
    !> pulse: the step should be shorter. False by default.
    logical function hides(self, from, to, between)
        class(model_type), intent(inout) :: self
        real(wp), intent(in) :: from, to
        !> True if the step evaluates at times between its ends.
        logical, intent(in) :: between

        hides = .false.
    end function hides
end module tandem_model
