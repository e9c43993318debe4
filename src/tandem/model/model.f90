! SPDX-License-Identifier: MIT
!> The model: sizes, names and procedure pointers. A scene extends `model_type` with its parameters and associates the
!> procedures that it has; an unassociated pointer means that the scene has no such term.
!>
!> Every procedure is a subroutine whose last argument is a status: 0 fine, > 0 this point cannot be evaluated (a smaller
!> step may help), < 0 stop. The passed object is `intent(inout)`, so that a model may keep intermediate results; one model
!> instance belongs to one simulation. Associate module procedures only: a pointer to an internal procedure needs a
!> trampoline on the stack, which crashes where the stack is not executable.
!>
!> Source of the equations: E. J. Haug, An index 0 differential-algebraic equation formulation for multibody dynamics:
!> nonholonomic constraints, Mech. Based Des. Struct. Mach., 2016, doi 10.1080/15397734.2016.1273783.
module tandem_model
    use tandem_error, only: error_type
    use tandem_kinds, only: wp
    use tandem_model_affine_motion, only: affine_motion_type
    use tandem_model_derivatives, only: derivatives_type
    use tandem_model_pattern, only: pattern_type
    use tandem_model_quantity, only: label_length, quantity_type
    use tandem_model_stiffness, only: stiffness_type
    use tandem_model_terms, only: terms_type
    use tandem_model_timer, only: timer_type
    use tandem_pack, only: pack_type
    implicit none (type, external)
    private

    public :: model_type, quantity_type, label_length
    public :: name_of_coordinate, name_of_row, its_unit, unit_of_its_multiplier
    public :: vector_of_position, matrix_of_position, vector_of_motion, mass_interface, inertia_interface
    public :: energy_of_motion, energy_of_position, evaluate_interface
    public :: direction_derivative, mass_derivative_interface, matrix_of_motion, evaluate_derivatives_interface
    public :: measure_interface, integrand_interface, change_interface, list_motions_interface, normal_forces_interface

    !> What `composed` is asked for.
    integer, parameter :: name_of_coordinate = 1, its_unit = 2, name_of_row = 3, unit_of_its_multiplier = 4

    !> A scene extends this with its parameters; sizes say what exists, procedure pointers what each term is.
    type :: model_type
        !> The model's name in reports and files.
        character(len=:), allocatable :: name
        !> Number of generalized coordinates.
        integer :: n = 0
        !> Number of holonomic constraints Phi(t, q) = 0.
        integer :: n_holonomic = 0
        !> Number of nonholonomic constraints E(t, q) qd = e(t, q).
        integer :: n_nonholonomic = 0
        !> Whether there may be more rows than coordinates, as joints in closed loops bring them: which of them repeat others is
        !> found at the start. Otherwise so many are taken for a mistake.
        logical :: rows_may_repeat = .false.
        !> True where M does not depend on q: it is then evaluated once.
        logical :: constant_mass = .false.
        !> Sizes of the diagonal blocks of M in their order, n in all, where every entry outside of them is zero at every q:
        !> explicit steps leave those out. One block of n where not allocated. In a constant M they are found without being told.
        integer, allocatable :: mass_blocks(:)
        !> Which entries of C and M may differ from zero, for sparse charts; every entry where not allocated. A model that has it
        !> sets the entry (i, j) of C as (i, pattern%column(j)), and of M as (i, pattern%mass_column(j)), wherever it finds
        !> `terms%is_compressed`.
        type(pattern_type), allocatable :: pattern
        !> Names and units of the coordinates (n); defaults q1, q2, ... and no unit.
        character(len=label_length), allocatable :: coordinate_name(:), coordinate_unit(:)
        !> A typical magnitude of each coordinate (n), > 0; default 1. Bases, norms and the rank decision use q / scale.
        real(wp), allocatable :: coordinate_scale(:)
        !> The period of each coordinate (n), 0 for one without: an angle that has turned often is not known less exactly for that.
        !> In error norms |q| counts for half a period at most.
        real(wp), allocatable :: coordinate_period(:)
        !> A typical time of the motion, > 0: velocities are judged by scale / time_scale, accelerations by scale / time_scale**2.
        real(wp) :: time_scale = 1.0_wp
        !> Names of the constraint rows (nh) and (nd); defaults holonomic 1, ..., nonholonomic 1, ...
        character(len=label_length), allocatable :: holonomic_name(:), nonholonomic_name(:)
        !> Units of the multipliers (nh + nd), for files: J over that of a row of Phi, W over that of a row of E qd.
        character(len=label_length), allocatable :: multiplier_unit(:)
        !> Names and units that are not given there are those of `composed`; the procedures come with tandem, so that no message
        !> asks users to check them.
        logical :: composes_labels = .false., is_ready_made = .false.
        !> Ascending times at which a function of time has a kink or a jump: steps end there exactly.
        real(wp), allocatable :: breakpoints(:)
        !> Whether nu jumps at each breakpoint, so that qd must jump with it; default false.
        logical, allocatable :: nu_jumps(:)
        !> Which smooth piece is current, 1 before the first breakpoint; set by the simulation. Procedures look at this
        !> and never compare t with a breakpoint.
        integer :: segment = 1
        !> Until when `breakpoints` has all of them; a model that looks for them as a run goes on sets it, see `know_breakpoints`.
        real(wp) :: breakpoints_until = huge(1.0_wp)
        !> What `measure` gives, in its order; nothing where it is not allocated. Whether it looks at every step to count turns.
        type(quantity_type), allocatable :: quantities(:)
        logical :: measures_every_step = .false.
        !> True if `measure` takes the multipliers.
        logical :: measures_multipliers = .false.
        !> The quantities that `measure` is asked for at the moment; all where this is not allocated.
        logical, allocatable :: asked(:)
        !> Values of `measure` for the events that are evaluated at the moment; only allocated while they are those of the point.
        real(wp), allocatable :: shown(:)
        !> Integrals over time that `measure` looks at, zero at the start: whoever calls it adds up `integrands`, and sets them
        !> before. None where it is not allocated.
        real(wp), allocatable :: integrals(:)
        !> The impulses of the rows (nh + nd) where an event made velocities jump last; only where it is allocated, by a model that
        !> tells of them.
        real(wp), allocatable :: impulses(:)
        !> Inputs of the linearised system: names of functions of time, which may be several of one element. `input` (0:2, inputs),
        !> where it is allocated, is what the model's procedures add to the value and the first two derivatives of each;
        !> `input_version` changes whenever it does.
        character(len=label_length), allocatable :: input_name(:)
        real(wp), allocatable :: input(:, :)
        integer :: input_version = 0
        !> Takes the time of each call, see `profile_type`; nobody does where it is not associated.
        class(timer_type), pointer :: timer => null()

        !> Phi(t, q) (nh); required where nh > 0.
        procedure(vector_of_position), pointer :: holonomic => null()
        !> Phi_q(t, q) (nh, n); required where nh > 0.
        procedure(matrix_of_position), pointer :: holonomic_jacobian => null()
        !> Phi_t(t, q) (nh); only where Phi depends on time.
        procedure(vector_of_position), pointer :: holonomic_rate => null()
        !> E(t, q) (nd, n); required where nd > 0.
        procedure(matrix_of_position), pointer :: nonholonomic_jacobian => null()
        !> e(t, q) (nd); only where e is not zero.
        procedure(vector_of_position), pointer :: nonholonomic_rhs => null()
        !> gamma(t, q, qd) (nh + nd) of C qdd = -gamma (8); where it is missing, differences of C and nu along the motion stand
        !> in, and their noise limits the accuracy (the report says by how much).
        procedure(vector_of_motion), pointer :: constraint_acceleration => null()
        !> M(q) (n, n), symmetric; required.
        procedure(mass_interface), pointer :: mass_matrix => null()
        !> S(q, qd) (n); only where there is one.
        procedure(inertia_interface), pointer :: inertia_force => null()
        !> Q_A(t, q, qd) (n); only where there is one.
        procedure(vector_of_motion), pointer :: applied_force => null()
        !> T(q, qd) for reports; default qd' M qd / 2.
        procedure(energy_of_motion), pointer :: kinetic_energy => null()
        !> V(t, q) for reports.
        procedure(energy_of_position), pointer :: potential_energy => null()
        !> Any set of terms at one point in one call, for models that share work between them; preferred to the single
        !> procedures for the terms in `provides`.
        procedure(evaluate_interface), pointer :: evaluate => null()
        !> The terms that `evaluate` gives, a sum of need bits (see `tandem_model_terms`). A term that is neither in
        !> `provides` nor has a procedure of its own is zero.
        integer :: provides = 0

        !> The values of `quantities`, one after the other, at a state of the motion with its accelerations; for files only.
        procedure(measure_interface), pointer :: measure => null()
        !> The rates of `integrals`, and what is called once before the first `measure`, at the state of the start: it sets what of
        !> `quantities` depends on that. Only where there is something to do.
        procedure(integrand_interface), pointer :: integrands => null(), begin_measuring => null()
        !> What events may change of the model, in words of its own. Only where there is something.
        procedure(change_interface), pointer :: change => null()

        !> C2(q, x) = (C x)_q (nh + nd, n) for a constant x (72). This and the next seven serve implicit steppers only; where
        !> one is missing, differences stand in.
        procedure(direction_derivative), pointer :: jacobian_derivative => null()
        !> nu_q (nh + nd, n).
        procedure(matrix_of_position), pointer :: nu_derivative => null()
        !> gamma_q and gamma_qd (nh + nd, n) (71).
        procedure(matrix_of_motion), pointer :: gamma_q => null(), gamma_qd => null()
        !> M2(q, x) = (M x)_q (n, n) for a constant x (60).
        procedure(mass_derivative_interface), pointer :: mass_derivative => null()
        !> (C' lambda)_q (n, n) for constant multipliers (64).
        procedure(direction_derivative), pointer :: reaction_derivative => null()
        !> (S + Q_A)_q and (S + Q_A)_qd (n, n).
        procedure(matrix_of_motion), pointer :: force_q => null(), force_qd => null()
        !> Any set of the five sums in `tandem_model_derivatives` at one point in one call; preferred for those in
        !> `provides_derivatives`.
        procedure(evaluate_derivatives_interface), pointer :: evaluate_derivatives => null()
        !> The derivatives that `evaluate_derivatives` gives, a sum of need bits (see `tandem_model_derivatives`).
        integer :: provides_derivatives = 0
        !> The derivatives of the forces by blocks of the bodies of `pattern`: with it implicit steppers run on sparse charts.
        procedure(evaluate_stiffness_interface), pointer :: evaluate_stiffness => null()
        !> Friction on reactions: the force B(t, q, qd) p(lambda) beside S + Q_A, of `n_frictions` columns. `friction_directions` is
        !> B (n, n_frictions), the force of each for a normal force of one; `normal_forces` are p, each a norm of multipliers:
        !> p(a x) = |a| p(x), p(x + y) <= p(x) + p(y). The sums of `evaluate_derivatives` hold -B p too, for constant multipliers.
        !> Dense charts only.
        integer :: n_frictions = 0
        procedure(matrix_of_motion), pointer :: friction_directions => null()
        procedure(normal_forces_interface), pointer :: normal_forces => null()
        !> Ways in which all of it can be moved together, for the analysis of steady motions: it finds the symmetries among these
        !> and their sums. Where it is missing, all translations and rotations of the coordinates are tried, if these are few.
        procedure(list_motions_interface), pointer :: list_motions => null()
        !> The derivative of S + Q_A with respect to the time alone (n), for the same analysis; differences stand in.
        procedure(vector_of_motion), pointer :: force_rate => null()
    contains
        procedure :: n_constraints, row_name, coordinate_label, unit_of_coordinate, unit_of_multiplier, has_units, composed
        procedure :: scales, largest_on_scales, set_magnitudes, set_time_scale, note_blocks, pack_state, arrive, is_idle
        procedure :: know_breakpoints, hides, list_imposed
    end type model_type

    abstract interface
        !> A vector that depends on time and position.
        subroutine vector_of_position(self, t, q, value, stat)
            import :: model_type, wp
            implicit none (type, external)
            class(model_type), intent(inout) :: self
            !> Time.
            real(wp), intent(in) :: t
            !> Coordinates (n).
            real(wp), intent(in) :: q(:)
            !> The vector, all of it.
            real(wp), intent(out) :: value(:)
            !> 0 fine, > 0 cannot be evaluated here, < 0 stop.
            integer, intent(out) :: stat
        end subroutine vector_of_position

        !> A matrix that depends on time and position: one row a constraint, one column a coordinate.
        subroutine matrix_of_position(self, t, q, value, stat)
            import :: model_type, wp
            implicit none (type, external)
            class(model_type), intent(inout) :: self
            real(wp), intent(in) :: t, q(:)
            !> The matrix, zeros included.
            real(wp), intent(out) :: value(:, :)
            integer, intent(out) :: stat
        end subroutine matrix_of_position

        !> A vector that depends on time, position and velocity.
        subroutine vector_of_motion(self, t, q, qd, value, stat)
            import :: model_type, wp
            implicit none (type, external)
            class(model_type), intent(inout) :: self
            !> Time, coordinates (n), velocities (n).
            real(wp), intent(in) :: t, q(:), qd(:)
            real(wp), intent(out) :: value(:)
            integer, intent(out) :: stat
        end subroutine vector_of_motion

        !> The mass matrix.
        subroutine mass_interface(self, q, value, stat)
            import :: model_type, wp
            implicit none (type, external)
            class(model_type), intent(inout) :: self
            real(wp), intent(in) :: q(:)
            real(wp), intent(out) :: value(:, :)
            integer, intent(out) :: stat
        end subroutine mass_interface

        !> The inertia force, without the time.
        subroutine inertia_interface(self, q, qd, value, stat)
            import :: model_type, wp
            implicit none (type, external)
            class(model_type), intent(inout) :: self
            real(wp), intent(in) :: q(:), qd(:)
            real(wp), intent(out) :: value(:)
            integer, intent(out) :: stat
        end subroutine inertia_interface

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

        !> Quantities of the motion.
        subroutine measure_interface(self, t, q, qd, qdd, values, stat, lambda)
            import :: model_type, wp
            implicit none (type, external)
            class(model_type), intent(inout) :: self
            !> Time, coordinates, velocities, accelerations (n). Times ascend.
            real(wp), intent(in) :: t, q(:), qd(:), qdd(:)
            !> All quantities; where `asked` is allocated, others may be left alone, and accelerations are of no account.
            real(wp), intent(inout) :: values(:)
            integer, intent(out) :: stat
            !> Multipliers (nh + nd): what is made of them is NaN without.
            real(wp), intent(in), optional :: lambda(:)
        end subroutine measure_interface

        !> Rates of integrals.
        subroutine integrand_interface(self, t, q, qd, lambda, values, stat)
            import :: model_type, wp
            implicit none (type, external)
            class(model_type), intent(inout) :: self
            !> Time, coordinates, velocities (n), multipliers (nh + nd).
            real(wp), intent(in) :: t, q(:), qd(:), lambda(:)
            !> One for each integral.
            real(wp), intent(out) :: values(:)
            integer, intent(out) :: stat
        end subroutine integrand_interface

        !> A change of the model at an event. The state stays on the constraints of position as they are afterwards.
        subroutine change_interface(self, what, is_trial, t, q, problem)
            import :: model_type, wp
            implicit none (type, external)
            class(model_type), intent(inout) :: self
            !> What to change, in the model's own words.
            character(len=*), intent(in) :: what
            !> Whether only to see if it can be done; t and q do not count then.
            logical, intent(in) :: is_trial
            real(wp), intent(in) :: t, q(:)
            !> What is wrong, and what to do; blank where it is done.
            character(len=*), intent(out) :: problem
        end subroutine change_interface

        !> The normal forces that reactions are to friction.
        subroutine normal_forces_interface(self, lambda, value, gradient)
            import :: model_type, wp
            implicit none (type, external)
            class(model_type), intent(inout) :: self
            !> Multipliers (nh + nd).
            real(wp), intent(in) :: lambda(:)
            !> p (n_frictions), not negative, and its gradient (n_frictions, nh + nd), zero where p is.
            real(wp), intent(out) :: value(:), gradient(:, :)
        end subroutine normal_forces_interface

        !> Several terms at once.
        subroutine evaluate_interface(self, need, t, q, qd, terms, stat)
            import :: model_type, wp, terms_type
            implicit none (type, external)
            class(model_type), intent(inout) :: self
            !> The terms wanted, a sum of need bits; only those in `provides` are asked for.
            integer, intent(in) :: need
            !> qd is meaningful only where gamma or force are asked for.
            real(wp), intent(in) :: t, q(:), qd(:)
            !> The wanted terms are set, zeros included; the others are left alone.
            type(terms_type), intent(inout) :: terms
            integer, intent(out) :: stat
        end subroutine evaluate_interface

        !> A derivative of C x or C' x with respect to q for a constant x.
        subroutine direction_derivative(self, t, q, x, value, stat)
            import :: model_type, wp
            implicit none (type, external)
            class(model_type), intent(inout) :: self
            !> Time, coordinates (n), and x: (n) for C x, (nh + nd) for C' x.
            real(wp), intent(in) :: t, q(:), x(:)
            real(wp), intent(out) :: value(:, :)
            integer, intent(out) :: stat
        end subroutine direction_derivative

        !> The derivative of M x with respect to q for a constant x.
        subroutine mass_derivative_interface(self, q, x, value, stat)
            import :: model_type, wp
            implicit none (type, external)
            class(model_type), intent(inout) :: self
            real(wp), intent(in) :: q(:), x(:)
            real(wp), intent(out) :: value(:, :)
            integer, intent(out) :: stat
        end subroutine mass_derivative_interface

        !> A matrix that depends on time, position and velocity.
        subroutine matrix_of_motion(self, t, q, qd, value, stat)
            import :: model_type, wp
            implicit none (type, external)
            class(model_type), intent(inout) :: self
            real(wp), intent(in) :: t, q(:), qd(:)
            real(wp), intent(out) :: value(:, :)
            integer, intent(out) :: stat
        end subroutine matrix_of_motion

        !> Ways to move the model as a whole.
        subroutine list_motions_interface(self, motions)
            import :: model_type, affine_motion_type
            implicit none (type, external)
            class(model_type), intent(inout) :: self
            type(affine_motion_type), allocatable, intent(out) :: motions(:)
        end subroutine list_motions_interface

        !> Several derivatives at once.
        subroutine evaluate_derivatives_interface(self, need, t, q, qd, qdd, lambda, derivatives, stat)
            import :: model_type, wp, derivatives_type
            implicit none (type, external)
            class(model_type), intent(inout) :: self
            !> The derivatives wanted, a sum of need bits; only those in `provides_derivatives` are asked for.
            integer, intent(in) :: need
            !> Time, coordinates, velocities, accelerations (n), multipliers (nh + nd).
            real(wp), intent(in) :: t, q(:), qd(:), qdd(:), lambda(:)
            !> The wanted derivatives are set, zeros included; the others are left alone.
            type(derivatives_type), intent(inout) :: derivatives
            integer, intent(out) :: stat
        end subroutine evaluate_derivatives_interface

        !> K = (M qdd + C' lambda - S - Q_A)_q and D = -(S + Q_A)_qd by blocks. What is left out of them costs corrections, and
        !> never changes the solution.
        subroutine evaluate_stiffness_interface(self, t, q, qd, qdd, lambda, stiffness, stat)
            import :: model_type, wp, stiffness_type
            implicit none (type, external)
            class(model_type), intent(inout) :: self
            !> Time, coordinates, velocities, accelerations (n), multipliers (nh + nd).
            real(wp), intent(in) :: t, q(:), qd(:), qdd(:), lambda(:)
            !> All blocks are set, zeros included; its bodies are those of the pattern, its pairs those of `pattern%coupled`.
            type(stiffness_type), intent(inout) :: stiffness
            integer, intent(out) :: stat
        end subroutine evaluate_stiffness_interface
    end interface

contains

    !> nh + nd, the number of rows of C.
    pure integer function n_constraints(self)
        class(model_type), intent(in) :: self

        n_constraints = self%n_holonomic + self%n_nonholonomic
    end function n_constraints

    !> The name of a row, with blanks behind.
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

    !> The length of a row's name (a deferred length would be static memory, see `tandem_status`).
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

    !> The scales of the coordinates (n): 1 where none are given.
    pure function scales(self)
        class(model_type), intent(in) :: self
        real(wp) :: scales(self%n)

        scales = 1.0_wp
        if (allocated(self%coordinate_scale)) scales = self%coordinate_scale
    end function scales

    !> The largest entry of a vector on these scales. Nothing is allocated.
    pure real(wp) function largest_on_scales(self, x)
        class(model_type), intent(in) :: self
        !> Increments of coordinates or rates (n).
        real(wp), intent(in) :: x(:)

        largest_on_scales = maxval(abs(x))
        if (allocated(self%coordinate_scale)) largest_on_scales = maxval(abs(x)/self%coordinate_scale)
    end function largest_on_scales

    !> A run or an analysis begins at (t, q, qd): a model that takes its time scale from there does it now. Nothing unless
    !> overridden.
    subroutine set_time_scale(self, t, q, qd)
        class(model_type), intent(inout) :: self
        !> Time, coordinates and velocities (n), which need not satisfy the constraints.
        real(wp), intent(in) :: t, q(:), qd(:)
    end subroutine set_time_scale

    !> The sizes of the coordinates by which rows of Phi are judged, where these exceed the scales: how much rounding of q may leave
    !> of a row follows from them. q itself unless overridden, by a model whose rows bend so much along a large coordinate that
    !> their gradients do not show its part everywhere.
    pure subroutine set_magnitudes(self, q, magnitude)
        class(model_type), intent(in) :: self
        !> Coordinates, and their sizes (n).
        real(wp), intent(in), contiguous :: q(:)
        real(wp), intent(out), contiguous :: magnitude(:)

        magnitude = q
    end subroutine set_magnitudes

    !> The name of a coordinate with blanks behind.
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

    !> The length of a coordinate's name.
    pure integer function coordinate_label_length(self, i)
        class(model_type), intent(in) :: self
        integer, intent(in) :: i

        coordinate_label_length = len_trim(padded_label(self, i))
    end function coordinate_label_length

    !> The name of a coordinate, q1, q2, ... where the model gives none.
    pure function coordinate_label(self, i) result(name)
        class(model_type), intent(in) :: self
        !> Its index.
        integer, intent(in) :: i
        character(len=coordinate_label_length(self, i)) :: name

        name = padded_label(self, i)
    end function coordinate_label

    !> Whether the model tells the units of its coordinates, or those of its multipliers.
    pure logical function has_units(self, of_multipliers)
        class(model_type), intent(in) :: self
        logical, intent(in) :: of_multipliers

        has_units = self%composes_labels .or. merge(allocated(self%multiplier_unit), allocated(self%coordinate_unit), &
            of_multipliers)
    end function has_units

    !> The unit of a coordinate, blank where the model gives none.
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

    !> The unit of the multiplier of a row, blank where the model gives none.
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

    !> Names and units, made when they are asked for: those of thousands of bodies would take more memory than their states. For
    !> models that set `composes_labels`; nothing unless overridden.
    pure function composed(self, what, i) result(label)
        class(model_type), intent(in) :: self
        !> One of the constants of this module, and the coordinate or the row.
        integer, intent(in) :: what, i
        character(len=label_length) :: label

        label = ''
    end function composed

    !> A chart has said where rows of C may stand in `terms%blocks`: tell in the pattern which ones `evaluate` sets there,
    !> `in_blocks` and `all_in_blocks`. None unless overridden.
    pure subroutine note_blocks(self)
        class(model_type), intent(inout) :: self
    end subroutine note_blocks

    !> What the model itself remembers, where its procedures, or actions of events, change something that later calls depend on:
    !> list it by `pack%item`, and a checkpoint keeps it. Nothing unless overridden; parameters that stay need not be listed.
    subroutine pack_state(self, pack)
        class(model_type), intent(inout) :: self
        !> Writes or reads.
        type(pack_type), intent(inout) :: pack
    end subroutine pack_state

    !> Rows at position level that impose a motion, and those of them that impose an angle (rad): a start is led along them where
    !> they are far from held. None unless overridden.
    pure subroutine list_imposed(self, is_imposed, is_angle)
        class(model_type), intent(in) :: self
        !> One for each holonomic row.
        logical, intent(out) :: is_imposed(:), is_angle(:)

        is_imposed = .false.
        is_angle = .false.
    end subroutine list_imposed

    !> A run has come to q, at its start or by a step that is kept. Procedures that count something along the way, as turns, count
    !> it here, and not at the points that steps try. Nothing unless overridden.
    subroutine arrive(self, t, q, starts)
        class(model_type), intent(inout) :: self
        !> Time, coordinates (n).
        real(wp), intent(in) :: t, q(:)
        !> Whether a run starts there, so that what was counted before is forgotten.
        logical, intent(in) :: starts
    end subroutine arrive

    !> Coordinates (n) that take no part in the motion as the model is now: the analysis leaves them out. None unless overridden.
    pure function is_idle(self)
        class(model_type), intent(in) :: self
        logical :: is_idle(self%n)

        is_idle = .false.
    end function is_idle

    !> See that the first `number` breakpoints are in the list, if there are so many. Nothing to do unless overridden.
    subroutine know_breakpoints(self, number, error)
        class(model_type), intent(inout) :: self
        integer, intent(in) :: number
        !> They cannot be found, or the model is wrong there.
        type(error_type), allocatable, intent(out) :: error
    end subroutine know_breakpoints

    !> Whether functions of time take values between two times of the current segment that a step from one to the other does not
    !> see, as those of a narrow pulse: the step should be shorter. Unknown unless overridden, which is no.
    logical function hides(self, from, to, between)
        class(model_type), intent(inout) :: self
        real(wp), intent(in) :: from, to
        !> True if the step evaluates at times between its ends.
        logical, intent(in) :: between

        hides = .false.
    end function hides
end module tandem_model
