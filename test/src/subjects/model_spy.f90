! SPDX-License-Identifier: MIT
!> Wraps any model: counts the calls of each procedure, sets traps for procedures that must not be called, and fails on request.
module model_spy
    use tandem, only: model_type, procedure_model_type, need_force, need_gamma, need_jacobian, need_mass, need_nu, need_phi, &
        terms_type, wp
    use terms_at, only: get_terms
    use, intrinsic :: ieee_arithmetic, only: ieee_positive_inf, ieee_quiet_nan, ieee_value
    implicit none (type, external)
    private

    public :: spy_type, calls_type, no_fault, fault_nan, fault_infinity, fault_retry, fault_stop

    !> Kinds of faults: a NaN or an infinity in the result, a positive or a negative status.
    integer, parameter :: no_fault = 0, fault_nan = 1, fault_infinity = 2, fault_retry = 3, fault_stop = 4

    !> Number of calls of each procedure of the model.
    type :: calls_type
        integer :: holonomic = 0, holonomic_jacobian = 0, holonomic_rate = 0
        integer :: nonholonomic_jacobian = 0, nonholonomic_rhs = 0, constraint_acceleration = 0
        integer :: mass_matrix = 0, inertia_force = 0, applied_force = 0
        integer :: kinetic_energy = 0, potential_energy = 0, evaluate = 0
        !> Calls of procedures that the wrapped model does not have.
        integer :: trapped = 0
    end type calls_type

    type, extends(procedure_model_type) :: spy_type
        type(calls_type) :: calls
        !> Term (a need bit) with the fault, its kind, and its first time.
        integer :: fault_term = 0, fault = no_fault
        real(wp) :: fault_time = 0.0_wp
        !> Only segment between breakpoints with the fault; 0 for any.
        integer :: fault_segment = 0
        !> True if the fault occurs only once.
        logical :: once = .false.
        !> Number of occurrences, and largest number of consecutive ones at the same time and coordinates.
        integer :: n_faults = 0, most_at_a_point = 0
        class(model_type), pointer, private :: inner => null()
        !> The same if it has single procedures.
        class(procedure_model_type), pointer, private :: single => null()
        real(wp), private :: last_time = -huge(1.0_wp)
        !> Coordinates of the last call; those and the time of the last fault, and number of occurrences there.
        real(wp), allocatable, private :: last_q(:), fault_q(:)
        real(wp), private :: time_of_fault = -huge(1.0_wp)
        integer, private :: n_there = 0
    contains
        procedure :: wrap
        procedure :: set_traps
        procedure :: fuse
        procedure, private :: enter
        procedure, private :: upset_vector
        procedure, private :: upset_matrix
        procedure, private :: is_due
    end type spy_type

contains

    !> Copy sizes, names and procedures of a model that is already set up.
    subroutine wrap(self, inner)
        class(spy_type), intent(inout) :: self
        class(model_type), intent(in), target :: inner

        self%inner => inner
        self%calls = calls_type()
        self%last_time = -huge(1.0_wp)
        self%last_q = spread(0.0_wp, 1, inner%n)
        self%n_faults = 0
        self%most_at_a_point = 0
        self%n_there = 0
        if (allocated(self%fault_q)) deallocate (self%fault_q)
        self%name = 'spy on '//inner%name
        self%n = inner%n
        self%n_holonomic = inner%n_holonomic
        self%n_nonholonomic = inner%n_nonholonomic
        self%constant_mass = inner%constant_mass
        if (allocated(inner%holonomic_name)) self%holonomic_name = inner%holonomic_name
        if (allocated(inner%nonholonomic_name)) self%nonholonomic_name = inner%nonholonomic_name
        if (allocated(inner%coordinate_scale)) self%coordinate_scale = inner%coordinate_scale
        if (allocated(inner%breakpoints)) self%breakpoints = inner%breakpoints
        if (allocated(inner%nu_jumps)) self%nu_jumps = inner%nu_jumps
        self%provides = inner%provides
        self%single => null()
        select type (inner)
        class is (procedure_model_type)
            self%single => inner
            if (associated(inner%holonomic)) self%holonomic => spy_holonomic
            if (associated(inner%holonomic_jacobian)) self%holonomic_jacobian => spy_holonomic_jacobian
            if (associated(inner%holonomic_rate)) self%holonomic_rate => spy_holonomic_rate
            if (associated(inner%nonholonomic_jacobian)) self%nonholonomic_jacobian => spy_nonholonomic_jacobian
            if (associated(inner%nonholonomic_rhs)) self%nonholonomic_rhs => spy_nonholonomic_rhs
            if (associated(inner%constraint_acceleration)) self%constraint_acceleration => spy_acceleration
            if (associated(inner%mass_matrix)) self%mass_matrix => spy_mass
            if (associated(inner%inertia_force)) self%inertia_force => spy_inertia_force
            if (associated(inner%applied_force)) self%applied_force => spy_applied_force
        end select
        if (associated(inner%kinetic_energy)) self%kinetic_energy => spy_kinetic_energy
        if (associated(inner%potential_energy)) self%potential_energy => spy_potential_energy
        if (associated(inner%evaluate)) self%evaluate => spy_evaluate
    end subroutine wrap

    !> Associate the procedures that the sizes exclude: none of them may be called.
    subroutine set_traps(self)
        class(spy_type), intent(inout) :: self

        if (self%n_holonomic == 0) then
            self%holonomic => trap_vector
            self%holonomic_jacobian => trap_matrix
        end if
        if (self%n_nonholonomic == 0) self%nonholonomic_jacobian => trap_matrix
    end subroutine set_traps

    !> Provide some terms by `evaluate`, which calls the wrapped model's single procedures.
    subroutine fuse(self, provides)
        class(spy_type), intent(inout) :: self
        !> The terms, a sum of need bits.
        integer, intent(in) :: provides

        self%provides = provides
        self%evaluate => fused
        if (iand(provides, need_phi) /= 0) self%holonomic => null()
        if (iand(provides, need_jacobian) /= 0) self%holonomic_jacobian => null()
        if (iand(provides, need_jacobian) /= 0) self%nonholonomic_jacobian => null()
        if (iand(provides, need_nu) /= 0) self%holonomic_rate => null()
        if (iand(provides, need_nu) /= 0) self%nonholonomic_rhs => null()
        if (iand(provides, need_gamma) /= 0) self%constraint_acceleration => null()
        if (iand(provides, need_mass) /= 0) self%mass_matrix => null()
        if (iand(provides, need_force) /= 0) self%inertia_force => null()
        if (iand(provides, need_force) /= 0) self%applied_force => null()
    end subroutine fuse

    !> Set the segment of the wrapped model.
    subroutine enter(self, count)
        class(spy_type), intent(inout) :: self
        integer, intent(inout) :: count

        self%inner%segment = self%segment
        count = count + 1
    end subroutine enter

    !> True if the fault occurs now.
    logical function is_due(self, term)
        class(spy_type), intent(inout) :: self
        integer, intent(in) :: term

        is_due = self%fault /= no_fault .and. term == self%fault_term .and. self%last_time >= self%fault_time
        if (self%fault_segment > 0) is_due = is_due .and. self%segment == self%fault_segment
        if (.not. is_due) return
        if (self%once) self%fault_term = 0
        self%n_faults = self%n_faults + 1
        if (.not. allocated(self%fault_q)) self%fault_q = self%last_q + 1.0_wp
        if (any(abs(self%fault_q - self%last_q) > 0.0_wp) .or. abs(self%time_of_fault - self%last_time) > 0.0_wp) self%n_there = 0
        self%n_there = self%n_there + 1
        self%most_at_a_point = max(self%most_at_a_point, self%n_there)
        self%fault_q = self%last_q
        self%time_of_fault = self%last_time
    end function is_due

    !> Alter a vector or its status.
    subroutine upset_vector(self, term, value, stat)
        class(spy_type), intent(inout) :: self
        integer, intent(in) :: term
        real(wp), intent(inout) :: value(:)
        integer, intent(inout) :: stat
        integer :: fault

        fault = self%fault
        if (.not. self%is_due(term)) return
        select case (fault)
        case (fault_nan)
            value(size(value)) = ieee_value(1.0_wp, ieee_quiet_nan)
        case (fault_infinity)
            value(size(value)) = ieee_value(1.0_wp, ieee_positive_inf)
        case (fault_retry)
            stat = 7
        case (fault_stop)
            stat = -7
        case default
            error stop 'upset_vector: no such fault'
        end select
    end subroutine upset_vector

    !> Alter a matrix or its status.
    subroutine upset_matrix(self, term, value, stat)
        class(spy_type), intent(inout) :: self
        integer, intent(in) :: term
        real(wp), intent(inout) :: value(:, :)
        integer, intent(inout) :: stat
        integer :: last

        ! In one expression, gfortran 14 with bounds checks uses another row.
        last = size(value, 1)
        call self%upset_vector(term, value(last, :), stat)
    end subroutine upset_matrix

    subroutine spy_holonomic(self, t, q, value, stat)
        class(model_type), intent(inout) :: self
        real(wp), intent(in) :: t, q(:)
        real(wp), intent(out) :: value(:)
        integer, intent(out) :: stat

        stat = -1
        value = 0.0_wp
        select type (self)
        class is (spy_type)
            call self%enter(self%calls%holonomic)
            self%last_time = t
            self%last_q = q
            call self%single%holonomic(self%inner, t, q, value, stat)
            call self%upset_vector(need_phi, value, stat)
        end select
    end subroutine spy_holonomic

    subroutine spy_holonomic_jacobian(self, t, q, value, stat)
        class(model_type), intent(inout) :: self
        real(wp), intent(in) :: t, q(:)
        real(wp), intent(out) :: value(:, :)
        integer, intent(out) :: stat

        stat = -1
        value = 0.0_wp
        select type (self)
        class is (spy_type)
            call self%enter(self%calls%holonomic_jacobian)
            self%last_time = t
            self%last_q = q
            call self%single%holonomic_jacobian(self%inner, t, q, value, stat)
            call self%upset_matrix(need_jacobian, value, stat)
        end select
    end subroutine spy_holonomic_jacobian

    subroutine spy_holonomic_rate(self, t, q, value, stat)
        class(model_type), intent(inout) :: self
        real(wp), intent(in) :: t, q(:)
        real(wp), intent(out) :: value(:)
        integer, intent(out) :: stat

        stat = -1
        value = 0.0_wp
        select type (self)
        class is (spy_type)
            call self%enter(self%calls%holonomic_rate)
            self%last_time = t
            self%last_q = q
            call self%single%holonomic_rate(self%inner, t, q, value, stat)
            call self%upset_vector(need_nu, value, stat)
        end select
    end subroutine spy_holonomic_rate

    subroutine spy_nonholonomic_jacobian(self, t, q, value, stat)
        class(model_type), intent(inout) :: self
        real(wp), intent(in) :: t, q(:)
        real(wp), intent(out) :: value(:, :)
        integer, intent(out) :: stat

        stat = -1
        value = 0.0_wp
        select type (self)
        class is (spy_type)
            call self%enter(self%calls%nonholonomic_jacobian)
            self%last_time = t
            self%last_q = q
            call self%single%nonholonomic_jacobian(self%inner, t, q, value, stat)
            call self%upset_matrix(need_jacobian, value, stat)
        end select
    end subroutine spy_nonholonomic_jacobian

    subroutine spy_nonholonomic_rhs(self, t, q, value, stat)
        class(model_type), intent(inout) :: self
        real(wp), intent(in) :: t, q(:)
        real(wp), intent(out) :: value(:)
        integer, intent(out) :: stat

        stat = -1
        value = 0.0_wp
        select type (self)
        class is (spy_type)
            call self%enter(self%calls%nonholonomic_rhs)
            self%last_time = t
            self%last_q = q
            call self%single%nonholonomic_rhs(self%inner, t, q, value, stat)
            call self%upset_vector(need_nu, value, stat)
        end select
    end subroutine spy_nonholonomic_rhs

    subroutine spy_acceleration(self, t, q, qd, value, stat)
        class(model_type), intent(inout) :: self
        real(wp), intent(in) :: t, q(:), qd(:)
        real(wp), intent(out) :: value(:)
        integer, intent(out) :: stat

        stat = -1
        value = 0.0_wp
        select type (self)
        class is (spy_type)
            call self%enter(self%calls%constraint_acceleration)
            self%last_time = t
            self%last_q = q
            call self%single%constraint_acceleration(self%inner, t, q, qd, value, stat)
            call self%upset_vector(need_gamma, value, stat)
        end select
    end subroutine spy_acceleration

    subroutine spy_mass(self, q, value, stat)
        class(model_type), intent(inout) :: self
        real(wp), intent(in) :: q(:)
        real(wp), intent(out) :: value(:, :)
        integer, intent(out) :: stat

        stat = -1
        value = 0.0_wp
        select type (self)
        class is (spy_type)
            call self%enter(self%calls%mass_matrix)
            self%last_q = q
            call self%single%mass_matrix(self%inner, q, value, stat)
            call self%upset_matrix(need_mass, value, stat)
        end select
    end subroutine spy_mass

    subroutine spy_inertia_force(self, q, qd, value, stat)
        class(model_type), intent(inout) :: self
        real(wp), intent(in) :: q(:), qd(:)
        real(wp), intent(out) :: value(:)
        integer, intent(out) :: stat

        stat = -1
        value = 0.0_wp
        select type (self)
        class is (spy_type)
            call self%enter(self%calls%inertia_force)
            self%last_q = q
            call self%single%inertia_force(self%inner, q, qd, value, stat)
        end select
    end subroutine spy_inertia_force

    subroutine spy_applied_force(self, t, q, qd, value, stat)
        class(model_type), intent(inout) :: self
        real(wp), intent(in) :: t, q(:), qd(:)
        real(wp), intent(out) :: value(:)
        integer, intent(out) :: stat

        stat = -1
        value = 0.0_wp
        select type (self)
        class is (spy_type)
            call self%enter(self%calls%applied_force)
            self%last_time = t
            self%last_q = q
            call self%single%applied_force(self%inner, t, q, qd, value, stat)
            call self%upset_vector(need_force, value, stat)
        end select
    end subroutine spy_applied_force

    subroutine spy_kinetic_energy(self, q, qd, value, stat)
        class(model_type), intent(inout) :: self
        real(wp), intent(in) :: q(:), qd(:)
        real(wp), intent(out) :: value
        integer, intent(out) :: stat

        stat = -1
        value = 0.0_wp
        select type (self)
        class is (spy_type)
            call self%enter(self%calls%kinetic_energy)
            self%last_q = q
            call self%inner%kinetic_energy(q, qd, value, stat)
        end select
    end subroutine spy_kinetic_energy

    subroutine spy_potential_energy(self, t, q, value, stat)
        class(model_type), intent(inout) :: self
        real(wp), intent(in) :: t, q(:)
        real(wp), intent(out) :: value
        integer, intent(out) :: stat

        stat = -1
        value = 0.0_wp
        select type (self)
        class is (spy_type)
            call self%enter(self%calls%potential_energy)
            self%last_q = q
            call self%inner%potential_energy(t, q, value, stat)
        end select
    end subroutine spy_potential_energy

    subroutine spy_evaluate(self, need, t, q, qd, terms, stat)
        class(model_type), intent(inout) :: self
        integer, intent(in) :: need
        real(wp), intent(in) :: t, q(:), qd(:)
        type(terms_type), intent(inout) :: terms
        integer, intent(out) :: stat

        stat = -1
        select type (self)
        class is (spy_type)
            call self%enter(self%calls%evaluate)
            self%last_time = t
            call self%inner%evaluate(need, t, q, qd, terms, stat)
        end select
    end subroutine spy_evaluate

    !> Exactly the requested terms, from the wrapped model's single procedures.
    subroutine fused(self, need, t, q, qd, terms, stat)
        class(model_type), intent(inout) :: self
        integer, intent(in) :: need
        real(wp), intent(in) :: t, q(:), qd(:)
        type(terms_type), intent(inout) :: terms
        integer, intent(out) :: stat
        type(terms_type) :: all

        stat = -1
        select type (self)
        class is (spy_type)
            call self%enter(self%calls%evaluate)
            if (iand(need, not(self%provides)) /= 0) return
            call get_terms(self%inner, t, q, qd, all, stat)
            if (iand(need, need_phi) /= 0) terms%phi = all%phi
            if (iand(need, need_jacobian) /= 0) terms%jacobian = all%jacobian
            if (iand(need, need_nu) /= 0) terms%nu = all%nu
            if (iand(need, need_gamma) /= 0) terms%gamma = all%gamma
            if (iand(need, need_mass) /= 0) terms%mass = all%mass
            if (iand(need, need_force) /= 0) terms%force = all%force
        end select
    end subroutine fused

    subroutine trap_vector(self, t, q, value, stat)
        class(model_type), intent(inout) :: self
        real(wp), intent(in) :: t, q(:)
        real(wp), intent(out) :: value(:)
        integer, intent(out) :: stat

        stat = -1
        value = 0.0_wp
        select type (self)
        class is (spy_type)
            self%calls%trapped = self%calls%trapped + 1
        end select
    end subroutine trap_vector

    subroutine trap_matrix(self, t, q, value, stat)
        class(model_type), intent(inout) :: self
        real(wp), intent(in) :: t, q(:)
        real(wp), intent(out) :: value(:, :)
        integer, intent(out) :: stat

        stat = -1
        value = 0.0_wp
        select type (self)
        class is (spy_type)
            self%calls%trapped = self%calls%trapped + 1
        end select
    end subroutine trap_matrix
end module model_spy
