! SPDX-License-Identifier: MIT
!> Wraps a model with fused procedures and makes one entry of one term or derivative wrong, or puts the paper's misprinted (69)
!> in the place of the right gamma_qd, or every other constraint row in other units.
module model_perturbed
    use tandem, only: derivatives_type, model_type, need_acceleration_q, need_acceleration_qd, need_gamma, need_jacobian, &
        need_nu, need_phi, need_velocity_q, terms_type, wp
    implicit none (type, external)
    private

    public :: perturbed_type

    type, extends(model_type) :: perturbed_type
        !> The term (see `term_name`) or the derivative (see `derivative_name`) that is wrong, 0 for none.
        integer :: term = 0, derivative = 0
        !> Place (column 1 for a vector) and amount of the error.
        integer :: row = 1, column = 1
        real(wp) :: amount = 0.0_wp
        !> True if the lower block of gamma_qd is 2 E2, as in (69); right for e = 0 and a constant E_t only.
        logical :: as_printed = .false.
        !> Factor of the first row of C, and of the third, the fifth ..., including their errors.
        real(wp) :: unit = 1.0_wp
        !> Status of the derivatives from a time on, 0 for success.
        integer :: fault_stat = 0
        real(wp) :: fault_time = 0.0_wp
        class(model_type), pointer, private :: inner => null()
    contains
        procedure :: wrap
    end type perturbed_type

contains

    !> Copy sizes, names and procedures of a model that is already set up.
    subroutine wrap(self, inner)
        class(perturbed_type), intent(inout) :: self
        class(model_type), intent(in), target :: inner

        self%inner => inner
        self%name = 'perturbed '//inner%name
        self%n = inner%n
        self%n_holonomic = inner%n_holonomic
        self%n_nonholonomic = inner%n_nonholonomic
        self%constant_mass = inner%constant_mass
        if (allocated(inner%breakpoints)) self%breakpoints = inner%breakpoints
        if (allocated(inner%nu_jumps)) self%nu_jumps = inner%nu_jumps
        self%provides = inner%provides
        self%evaluate => evaluate
        self%provides_derivatives = inner%provides_derivatives
        self%evaluate_derivatives => evaluate_derivatives
    end subroutine wrap

    subroutine evaluate(self, need, t, q, qd, terms, stat)
        class(model_type), intent(inout) :: self
        integer, intent(in) :: need
        real(wp), intent(in) :: t, q(:), qd(:)
        type(terms_type), intent(inout) :: terms
        integer, intent(out) :: stat

        stat = -1
        select type (self)
        class is (perturbed_type)
            self%inner%segment = self%segment
            call self%inner%evaluate(need, t, q, qd, terms, stat)
            call spoil(self, need, terms)
            if (iand(need, need_phi) /= 0) terms%phi(1::2) = self%unit*terms%phi(1::2)
            if (iand(need, need_jacobian) /= 0) terms%jacobian(1::2, :) = self%unit*terms%jacobian(1::2, :)
            if (iand(need, need_nu) /= 0) terms%nu(1::2) = self%unit*terms%nu(1::2)
            if (iand(need, need_gamma) /= 0) terms%gamma(1::2) = self%unit*terms%gamma(1::2)
        end select
    end subroutine evaluate

    !> Make the entry wrong.
    subroutine spoil(self, need, terms)
        class(perturbed_type), intent(in) :: self
        integer, intent(in) :: need
        type(terms_type), intent(inout) :: terms

        if (self%term == 0) return
        if (.not. btest(need, self%term - 1)) return
        select case (self%term)
        case (1)
            terms%phi(self%row) = terms%phi(self%row) + self%amount
        case (2)
            terms%jacobian(self%row, self%column) = terms%jacobian(self%row, self%column) + self%amount
        case (3)
            terms%nu(self%row) = terms%nu(self%row) + self%amount
        case (4)
            terms%gamma(self%row) = terms%gamma(self%row) + self%amount
        case (5)
            terms%mass(self%row, self%column) = terms%mass(self%row, self%column) + self%amount
        case default
            terms%force(self%row) = terms%force(self%row) + self%amount
        end select
    end subroutine spoil

    subroutine evaluate_derivatives(self, need, t, q, qd, qdd, lambda, derivatives, stat)
        class(model_type), intent(inout) :: self
        integer, intent(in) :: need
        real(wp), intent(in) :: t, q(:), qd(:), qdd(:), lambda(:)
        type(derivatives_type), intent(inout) :: derivatives
        integer, intent(out) :: stat
        real(wp) :: pull(size(lambda))

        stat = -1
        select type (self)
        class is (perturbed_type)
            self%inner%segment = self%segment
            pull = lambda
            pull(1::2) = self%unit*pull(1::2)
            call self%inner%evaluate_derivatives(need, t, q, qd, qdd, pull, derivatives, stat)
            associate (d => derivatives)
                if (iand(need, need_velocity_q) /= 0) d%velocity_q(1::2, :) = self%unit*d%velocity_q(1::2, :)
                if (iand(need, need_acceleration_q) /= 0) d%acceleration_q(1::2, :) = self%unit*d%acceleration_q(1::2, :)
                if (iand(need, need_acceleration_qd) /= 0) d%acceleration_qd(1::2, :) = self%unit*d%acceleration_qd(1::2, :)
            end associate
            if (self%as_printed .and. iand(need, need_velocity_q) /= 0 .and. iand(need, need_acceleration_qd) /= 0) then
                associate (lower => self%n_holonomic + 1)
                    derivatives%acceleration_qd(lower:, :) = 2*derivatives%velocity_q(lower:, :)
                end associate
            end if
            if (self%fault_stat /= 0 .and. t >= self%fault_time) stat = self%fault_stat
            if (self%derivative == 0 .or. t < self%fault_time) return
            if (.not. btest(need, self%derivative - 1)) return
            associate (i => self%row, j => self%column)
                select case (self%derivative)
                case (1)
                    derivatives%velocity_q(i, j) = derivatives%velocity_q(i, j) + self%amount
                case (2)
                    derivatives%acceleration_q(i, j) = derivatives%acceleration_q(i, j) + self%amount
                case (3)
                    derivatives%acceleration_qd(i, j) = derivatives%acceleration_qd(i, j) + self%amount
                case (4)
                    derivatives%dynamics_q(i, j) = derivatives%dynamics_q(i, j) + self%amount
                case default
                    derivatives%dynamics_qd(i, j) = derivatives%dynamics_qd(i, j) + self%amount
                end select
            end associate
        end select
    end subroutine evaluate_derivatives
end module model_perturbed
