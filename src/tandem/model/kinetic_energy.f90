! SPDX-License-Identifier: MIT
!> Kinetic energy qd' M qd / 2 of a model, for reports.
module tandem_model_kinetic_energy
    use tandem_kinds, only: wp
    use tandem_model, only: model_type
    use tandem_model_counts, only: counts_type
    use tandem_model_evaluator, only: evaluator_type
    use tandem_model_terms, only: need_mass
    use tandem_model_timer, only: of_energy, of_kinetic_energy
    use tandem_pack, only: pack_type
    use tandem_status, only: status_not_finite, status_ok
    implicit none (type, external)
    private

    public :: kinetic_energy_type

    type :: kinetic_energy_type
        private
        type(evaluator_type), allocatable :: evaluator
        logical :: is_compressed = .false.
        !> M qd (n).
        real(wp), allocatable :: momentum(:)
    contains
        procedure :: find, clear, pack_state
        procedure, private :: attach
    end type kinetic_energy_type

contains

    !> Kinetic energy at a state, by the model's own procedure or by its mass matrix.
    subroutine find(self, model, t, q, qd, counts, energy, stat)
        class(kinetic_energy_type), intent(inout) :: self
        !> The same model in all calls.
        class(model_type), intent(inout), target :: model
        !> Time, coordinates and velocities (n).
        real(wp), intent(in) :: t
        real(wp), intent(in), contiguous :: q(:), qd(:)
        type(counts_type), intent(inout) :: counts
        real(wp), intent(out) :: energy
        !> A status code.
        integer, intent(out) :: stat

        energy = 0.0_wp
        counts%kinetic_energies = counts%kinetic_energies + 1
        if (associated(model%kinetic_energy)) then
            if (associated(model%state%timer)) call model%state%timer%begin_call(of_kinetic_energy)
            call model%kinetic_energy(q, qd, energy, stat)
            if (associated(model%state%timer)) call model%state%timer%end_call()
        else
            if (associated(model%state%timer)) call model%state%timer%begin_operation(of_energy)
            call find_by_mass(self, model, t, q, qd, counts, energy, stat)
            if (associated(model%state%timer)) call model%state%timer%end_operation()
        end if
    end subroutine find

    !> Kinetic energy by the mass matrix.
    subroutine find_by_mass(self, model, t, q, qd, counts, energy, stat)
        class(kinetic_energy_type), intent(inout) :: self
        class(model_type), intent(inout), target :: model
        real(wp), intent(in) :: t
        real(wp), intent(in), contiguous :: q(:), qd(:)
        type(counts_type), intent(inout) :: counts
        real(wp), intent(inout) :: energy
        integer, intent(out) :: stat

        if (.not. allocated(self%evaluator)) call self%attach(model)
        call self%evaluator%evaluate(need_mass, t, q, qd, counts, stat)
        if (stat /= status_ok) return
        if (self%is_compressed) then
            call model%pattern%multiply_mass(self%evaluator%terms%mass, qd, self%momentum)
        else
            self%momentum(:) = matmul(self%evaluator%terms%mass, qd)
        end if
        energy = 0.5_wp*dot_product(qd, self%momentum)
        if (.not. abs(energy) <= huge(1.0_wp)) stat = status_not_finite
    end subroutine find_by_mass

    !> Allocate for a model, before the first energy.
    subroutine attach(self, model)
        class(kinetic_energy_type), intent(inout) :: self
        class(model_type), intent(inout), target :: model

        allocate (self%evaluator)
        allocate (self%momentum(model%n))
        self%is_compressed = allocated(model%pattern) .and. iand(model%provides, need_mass) /= 0
        call self%evaluator%initialize(model, compressed=self%is_compressed, wants_jacobian=.not. self%is_compressed)
        self%evaluator%mass_is_trusted = .true.
    end subroutine attach

    !> Pack a constant mass matrix that has been evaluated. A restored state may have other parameters than the preceding run.
    subroutine pack_state(self, model, pack)
        class(kinetic_energy_type), intent(inout) :: self
        class(model_type), intent(inout), target :: model
        type(pack_type), intent(inout) :: pack
        logical :: is_known

        is_known = .false.
        if (allocated(self%evaluator)) is_known = self%evaluator%mass_is_known
        call pack%item(is_known)
        if (is_known) then
            if (.not. allocated(self%evaluator)) call self%attach(model)
            call pack%item(self%evaluator%terms%mass)
            self%evaluator%mass_is_known = .true.
        else
            call self%clear()
        end if
    end subroutine pack_state

    !> Discard the stored mass matrix, because parameters of the model have changed.
    subroutine clear(self)
        class(kinetic_energy_type), intent(inout) :: self

        if (allocated(self%evaluator)) self%evaluator%mass_is_known = .false.
    end subroutine clear
end module tandem_model_kinetic_energy
