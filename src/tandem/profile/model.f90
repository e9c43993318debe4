! SPDX-License-Identifier: MIT
!> A model that forwards every procedure to another one and books its time and its calls.
module tandem_profile_model
    use tandem_kinds, only: wp
    use tandem_model, only: model_type
    use tandem_model_derivatives, only: derivatives_type
    use tandem_model_terms, only: terms_type
    use tandem_pack, only: pack_type
    use tandem_profile_ledger, only: mark_type, profile_type
    use tandem_profile_parts, only: part_derivatives, part_single, part_terms
    implicit none (type, external)
    private

    public :: profiled_model_type

    !> Stands in for `inner` in a simulation. An event that acts on its model meets this type, and finds the model there.
    type, extends(model_type) :: profiled_model_type
        !> The model that does the work.
        class(model_type), pointer :: inner => null()
        !> Where its time is booked.
        type(profile_type), pointer :: profile => null()
    contains
        procedure :: wrap
        procedure, private :: enter
        procedure :: pack_state
    end type profiled_model_type

contains

    !> Stand in for a model that is set up; it has the same terms.
    subroutine wrap(self, inner, profile)
        class(profiled_model_type), intent(inout) :: self
        !> Both must outlive this one.
        class(model_type), intent(inout), target :: inner
        type(profile_type), intent(inout), target :: profile

        call copy(inner, self%model_type)
        self%inner => inner
        self%profile => profile
        if (associated(inner%holonomic)) self%holonomic => timed_holonomic
        if (associated(inner%holonomic_jacobian)) self%holonomic_jacobian => timed_holonomic_jacobian
        if (associated(inner%holonomic_rate)) self%holonomic_rate => timed_holonomic_rate
        if (associated(inner%nonholonomic_jacobian)) self%nonholonomic_jacobian => timed_nonholonomic_jacobian
        if (associated(inner%nonholonomic_rhs)) self%nonholonomic_rhs => timed_nonholonomic_rhs
        if (associated(inner%constraint_acceleration)) self%constraint_acceleration => timed_constraint_acceleration
        if (associated(inner%mass_matrix)) self%mass_matrix => timed_mass_matrix
        if (associated(inner%inertia_force)) self%inertia_force => timed_inertia_force
        if (associated(inner%applied_force)) self%applied_force => timed_applied_force
        if (associated(inner%kinetic_energy)) self%kinetic_energy => timed_kinetic_energy
        if (associated(inner%potential_energy)) self%potential_energy => timed_potential_energy
        if (associated(inner%jacobian_derivative)) self%jacobian_derivative => timed_jacobian_derivative
        if (associated(inner%nu_derivative)) self%nu_derivative => timed_nu_derivative
        if (associated(inner%gamma_q)) self%gamma_q => timed_gamma_q
        if (associated(inner%gamma_qd)) self%gamma_qd => timed_gamma_qd
        if (associated(inner%mass_derivative)) self%mass_derivative => timed_mass_derivative
        if (associated(inner%reaction_derivative)) self%reaction_derivative => timed_reaction_derivative
        if (associated(inner%force_q)) self%force_q => timed_force_q
        if (associated(inner%force_qd)) self%force_qd => timed_force_qd
        if (associated(inner%evaluate)) self%evaluate => timed_evaluate
        if (associated(inner%evaluate_derivatives)) self%evaluate_derivatives => timed_evaluate_derivatives
    end subroutine wrap

    !> Sizes, names and all else that a model has without its extension.
    subroutine copy(from, to)
        type(model_type), intent(in) :: from
        type(model_type), intent(inout) :: to

        to = from
    end subroutine copy

    !> Tell the model which segment it is in, and enter the part that its procedure is.
    subroutine enter(self, part, mark)
        class(profiled_model_type), intent(inout) :: self
        integer, intent(in) :: part
        type(mark_type), intent(out) :: mark

        self%inner%segment = self%segment
        call self%profile%enter(part, mark)
    end subroutine enter

    !> What the model itself remembers.
    subroutine pack_state(self, pack)
        class(profiled_model_type), intent(inout) :: self
        type(pack_type), intent(inout) :: pack

        call self%inner%pack_state(pack)
    end subroutine pack_state

    subroutine timed_holonomic(self, t, q, value, stat)
        class(model_type), intent(inout) :: self
        real(wp), intent(in) :: t, q(:)
        real(wp), intent(out) :: value(:)
        integer, intent(out) :: stat
        type(mark_type) :: mark

        stat = -1
        select type (self)
        class is (profiled_model_type)
            call self%enter(part_single + 1, mark)
            call self%inner%holonomic(t, q, value, stat)
            call self%profile%leave(mark)
        end select
    end subroutine timed_holonomic

    subroutine timed_holonomic_jacobian(self, t, q, value, stat)
        class(model_type), intent(inout) :: self
        real(wp), intent(in) :: t, q(:)
        real(wp), intent(out) :: value(:, :)
        integer, intent(out) :: stat
        type(mark_type) :: mark

        stat = -1
        select type (self)
        class is (profiled_model_type)
            call self%enter(part_single + 2, mark)
            call self%inner%holonomic_jacobian(t, q, value, stat)
            call self%profile%leave(mark)
        end select
    end subroutine timed_holonomic_jacobian

    subroutine timed_holonomic_rate(self, t, q, value, stat)
        class(model_type), intent(inout) :: self
        real(wp), intent(in) :: t, q(:)
        real(wp), intent(out) :: value(:)
        integer, intent(out) :: stat
        type(mark_type) :: mark

        stat = -1
        select type (self)
        class is (profiled_model_type)
            call self%enter(part_single + 3, mark)
            call self%inner%holonomic_rate(t, q, value, stat)
            call self%profile%leave(mark)
        end select
    end subroutine timed_holonomic_rate

    subroutine timed_nonholonomic_jacobian(self, t, q, value, stat)
        class(model_type), intent(inout) :: self
        real(wp), intent(in) :: t, q(:)
        real(wp), intent(out) :: value(:, :)
        integer, intent(out) :: stat
        type(mark_type) :: mark

        stat = -1
        select type (self)
        class is (profiled_model_type)
            call self%enter(part_single + 4, mark)
            call self%inner%nonholonomic_jacobian(t, q, value, stat)
            call self%profile%leave(mark)
        end select
    end subroutine timed_nonholonomic_jacobian

    subroutine timed_nonholonomic_rhs(self, t, q, value, stat)
        class(model_type), intent(inout) :: self
        real(wp), intent(in) :: t, q(:)
        real(wp), intent(out) :: value(:)
        integer, intent(out) :: stat
        type(mark_type) :: mark

        stat = -1
        select type (self)
        class is (profiled_model_type)
            call self%enter(part_single + 5, mark)
            call self%inner%nonholonomic_rhs(t, q, value, stat)
            call self%profile%leave(mark)
        end select
    end subroutine timed_nonholonomic_rhs

    subroutine timed_constraint_acceleration(self, t, q, qd, value, stat)
        class(model_type), intent(inout) :: self
        real(wp), intent(in) :: t, q(:), qd(:)
        real(wp), intent(out) :: value(:)
        integer, intent(out) :: stat
        type(mark_type) :: mark

        stat = -1
        select type (self)
        class is (profiled_model_type)
            call self%enter(part_single + 6, mark)
            call self%inner%constraint_acceleration(t, q, qd, value, stat)
            call self%profile%leave(mark)
        end select
    end subroutine timed_constraint_acceleration

    subroutine timed_mass_matrix(self, q, value, stat)
        class(model_type), intent(inout) :: self
        real(wp), intent(in) :: q(:)
        real(wp), intent(out) :: value(:, :)
        integer, intent(out) :: stat
        type(mark_type) :: mark

        stat = -1
        select type (self)
        class is (profiled_model_type)
            call self%enter(part_single + 7, mark)
            call self%inner%mass_matrix(q, value, stat)
            call self%profile%leave(mark)
        end select
    end subroutine timed_mass_matrix

    subroutine timed_inertia_force(self, q, qd, value, stat)
        class(model_type), intent(inout) :: self
        real(wp), intent(in) :: q(:), qd(:)
        real(wp), intent(out) :: value(:)
        integer, intent(out) :: stat
        type(mark_type) :: mark

        stat = -1
        select type (self)
        class is (profiled_model_type)
            call self%enter(part_single + 8, mark)
            call self%inner%inertia_force(q, qd, value, stat)
            call self%profile%leave(mark)
        end select
    end subroutine timed_inertia_force

    subroutine timed_applied_force(self, t, q, qd, value, stat)
        class(model_type), intent(inout) :: self
        real(wp), intent(in) :: t, q(:), qd(:)
        real(wp), intent(out) :: value(:)
        integer, intent(out) :: stat
        type(mark_type) :: mark

        stat = -1
        select type (self)
        class is (profiled_model_type)
            call self%enter(part_single + 9, mark)
            call self%inner%applied_force(t, q, qd, value, stat)
            call self%profile%leave(mark)
        end select
    end subroutine timed_applied_force

    subroutine timed_kinetic_energy(self, q, qd, value, stat)
        class(model_type), intent(inout) :: self
        real(wp), intent(in) :: q(:), qd(:)
        real(wp), intent(out) :: value
        integer, intent(out) :: stat
        type(mark_type) :: mark

        stat = -1
        select type (self)
        class is (profiled_model_type)
            call self%enter(part_single + 10, mark)
            call self%inner%kinetic_energy(q, qd, value, stat)
            call self%profile%leave(mark)
        end select
    end subroutine timed_kinetic_energy

    subroutine timed_potential_energy(self, t, q, value, stat)
        class(model_type), intent(inout) :: self
        real(wp), intent(in) :: t, q(:)
        real(wp), intent(out) :: value
        integer, intent(out) :: stat
        type(mark_type) :: mark

        stat = -1
        select type (self)
        class is (profiled_model_type)
            call self%enter(part_single + 11, mark)
            call self%inner%potential_energy(t, q, value, stat)
            call self%profile%leave(mark)
        end select
    end subroutine timed_potential_energy

    subroutine timed_jacobian_derivative(self, t, q, x, value, stat)
        class(model_type), intent(inout) :: self
        real(wp), intent(in) :: t, q(:), x(:)
        real(wp), intent(out) :: value(:, :)
        integer, intent(out) :: stat
        type(mark_type) :: mark

        stat = -1
        select type (self)
        class is (profiled_model_type)
            call self%enter(part_single + 12, mark)
            call self%inner%jacobian_derivative(t, q, x, value, stat)
            call self%profile%leave(mark)
        end select
    end subroutine timed_jacobian_derivative

    subroutine timed_nu_derivative(self, t, q, value, stat)
        class(model_type), intent(inout) :: self
        real(wp), intent(in) :: t, q(:)
        real(wp), intent(out) :: value(:, :)
        integer, intent(out) :: stat
        type(mark_type) :: mark

        stat = -1
        select type (self)
        class is (profiled_model_type)
            call self%enter(part_single + 13, mark)
            call self%inner%nu_derivative(t, q, value, stat)
            call self%profile%leave(mark)
        end select
    end subroutine timed_nu_derivative

    subroutine timed_gamma_q(self, t, q, qd, value, stat)
        class(model_type), intent(inout) :: self
        real(wp), intent(in) :: t, q(:), qd(:)
        real(wp), intent(out) :: value(:, :)
        integer, intent(out) :: stat
        type(mark_type) :: mark

        stat = -1
        select type (self)
        class is (profiled_model_type)
            call self%enter(part_single + 14, mark)
            call self%inner%gamma_q(t, q, qd, value, stat)
            call self%profile%leave(mark)
        end select
    end subroutine timed_gamma_q

    subroutine timed_gamma_qd(self, t, q, qd, value, stat)
        class(model_type), intent(inout) :: self
        real(wp), intent(in) :: t, q(:), qd(:)
        real(wp), intent(out) :: value(:, :)
        integer, intent(out) :: stat
        type(mark_type) :: mark

        stat = -1
        select type (self)
        class is (profiled_model_type)
            call self%enter(part_single + 15, mark)
            call self%inner%gamma_qd(t, q, qd, value, stat)
            call self%profile%leave(mark)
        end select
    end subroutine timed_gamma_qd

    subroutine timed_mass_derivative(self, q, x, value, stat)
        class(model_type), intent(inout) :: self
        real(wp), intent(in) :: q(:), x(:)
        real(wp), intent(out) :: value(:, :)
        integer, intent(out) :: stat
        type(mark_type) :: mark

        stat = -1
        select type (self)
        class is (profiled_model_type)
            call self%enter(part_single + 16, mark)
            call self%inner%mass_derivative(q, x, value, stat)
            call self%profile%leave(mark)
        end select
    end subroutine timed_mass_derivative

    subroutine timed_reaction_derivative(self, t, q, x, value, stat)
        class(model_type), intent(inout) :: self
        real(wp), intent(in) :: t, q(:), x(:)
        real(wp), intent(out) :: value(:, :)
        integer, intent(out) :: stat
        type(mark_type) :: mark

        stat = -1
        select type (self)
        class is (profiled_model_type)
            call self%enter(part_single + 17, mark)
            call self%inner%reaction_derivative(t, q, x, value, stat)
            call self%profile%leave(mark)
        end select
    end subroutine timed_reaction_derivative

    subroutine timed_force_q(self, t, q, qd, value, stat)
        class(model_type), intent(inout) :: self
        real(wp), intent(in) :: t, q(:), qd(:)
        real(wp), intent(out) :: value(:, :)
        integer, intent(out) :: stat
        type(mark_type) :: mark

        stat = -1
        select type (self)
        class is (profiled_model_type)
            call self%enter(part_single + 18, mark)
            call self%inner%force_q(t, q, qd, value, stat)
            call self%profile%leave(mark)
        end select
    end subroutine timed_force_q

    subroutine timed_force_qd(self, t, q, qd, value, stat)
        class(model_type), intent(inout) :: self
        real(wp), intent(in) :: t, q(:), qd(:)
        real(wp), intent(out) :: value(:, :)
        integer, intent(out) :: stat
        type(mark_type) :: mark

        stat = -1
        select type (self)
        class is (profiled_model_type)
            call self%enter(part_single + 19, mark)
            call self%inner%force_qd(t, q, qd, value, stat)
            call self%profile%leave(mark)
        end select
    end subroutine timed_force_qd

    subroutine timed_evaluate(self, need, t, q, qd, terms, stat)
        class(model_type), intent(inout) :: self
        integer, intent(in) :: need
        real(wp), intent(in) :: t, q(:), qd(:)
        type(terms_type), intent(inout) :: terms
        integer, intent(out) :: stat
        type(mark_type) :: mark

        stat = -1
        select type (self)
        class is (profiled_model_type)
            call self%enter(part_terms + need, mark)
            call self%inner%evaluate(need, t, q, qd, terms, stat)
            call self%profile%leave(mark)
        end select
    end subroutine timed_evaluate

    subroutine timed_evaluate_derivatives(self, need, t, q, qd, qdd, lambda, derivatives, stat)
        class(model_type), intent(inout) :: self
        integer, intent(in) :: need
        real(wp), intent(in) :: t, q(:), qd(:), qdd(:), lambda(:)
        type(derivatives_type), intent(inout) :: derivatives
        integer, intent(out) :: stat
        type(mark_type) :: mark

        stat = -1
        select type (self)
        class is (profiled_model_type)
            call self%enter(part_derivatives + need, mark)
            call self%inner%evaluate_derivatives(need, t, q, qd, qdd, lambda, derivatives, stat)
            call self%profile%leave(mark)
        end select
    end subroutine timed_evaluate_derivatives
end module tandem_profile_model
