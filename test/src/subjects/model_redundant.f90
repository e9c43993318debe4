! SPDX-License-Identifier: MIT
!> Wraps any model and appends one row that depends on its others: sum_k factors(k) (row rows(k) of C), unchanged or altered so that
!> it contradicts them. If all rows are holonomic it becomes the last holonomic row, else the last nonholonomic one. Everything else
!> is passed on: segments, breakpoints, names, energies, fused derivatives. A wrapped model can be wrapped again, so that the
!> procedures may call themselves.
module model_redundant
    use tandem, only: derivatives_type, model_type, need_acceleration_q, need_acceleration_qd, need_dynamics_q, need_dynamics_qd, &
        need_force, need_gamma, need_jacobian, need_mass, need_nu, need_phi, need_velocity_q, terms_type, wp
    implicit none (type, external)
    private

    public :: redundant_type

    type, extends(model_type) :: redundant_type
        !> Errors of the copy's own Phi (holonomic only), nu and gamma; 0 for a consistent one.
        real(wp) :: phi_offset = 0.0_wp, nu_offset = 0.0_wp, gamma_offset = 0.0_wp
        !> From the time `growth_from` on, growth*(t - growth_from)**3 is added to the copy's Phi; its nu and gamma follow, those
        !> of a nonholonomic copy as well.
        real(wp) :: growth = 0.0_wp, growth_from = 0.0_wp
        !> The row of C of this model that was appended.
        integer :: new_row = 0
        integer, allocatable, private :: rows(:)
        real(wp), allocatable, private :: factors(:)
        class(model_type), pointer, private :: inner => null()
        type(terms_type), private :: terms
        type(derivatives_type), private :: derivatives
    contains
        procedure :: wrap
        procedure, private :: evaluate_inner
        procedure, private :: spread_vector
        procedure, private :: spread_matrix
        procedure, private :: gather
    end type redundant_type

contains

    !> Wrap a model that is already set up. The offsets and the growth can be set before or after.
    subroutine wrap(self, inner, rows, factors, name, as_velocity)
        class(redundant_type), intent(inout), target :: self
        class(model_type), intent(inout), target :: inner
        !> Rows of the wrapped model's C, and their factors.
        integer, intent(in) :: rows(:)
        real(wp), intent(in) :: factors(:)
        !> The name of the new row.
        character(len=*), intent(in) :: name
        !> True for a nonholonomic row in any case: E of it is then the sum of rows of Phi_q, e that of their -Phi_t.
        logical, intent(in), optional :: as_velocity
        logical :: is_holonomic
        integer :: i

        self%inner => inner
        self%rows = rows
        self%factors = factors
        is_holonomic = all(rows <= inner%n_holonomic)
        if (present(as_velocity)) is_holonomic = is_holonomic .and. .not. as_velocity
        self%name = inner%name//' with '//name
        self%n = inner%n
        self%n_holonomic = inner%n_holonomic
        self%n_nonholonomic = inner%n_nonholonomic
        if (is_holonomic) then
            self%n_holonomic = self%n_holonomic + 1
            self%new_row = self%n_holonomic
        else
            self%n_nonholonomic = self%n_nonholonomic + 1
            self%new_row = self%n_constraints()
        end if
        if (allocated(self%holonomic_name)) deallocate (self%holonomic_name, self%nonholonomic_name)
        allocate (self%holonomic_name(self%n_holonomic), self%nonholonomic_name(self%n_nonholonomic))
        associate (nh => inner%n_holonomic)
            do i = 1, inner%n_constraints()
                if (i <= nh) self%holonomic_name(i) = inner%row_name(i)
                if (i > nh) self%nonholonomic_name(i - nh) = inner%row_name(i)
            end do
        end associate
        if (is_holonomic) self%holonomic_name(self%n_holonomic) = name
        if (.not. is_holonomic) self%nonholonomic_name(self%n_nonholonomic) = name
        self%constant_mass = inner%constant_mass
        ! Remove names of an earlier wrapping.
        if (allocated(self%coordinate_name)) deallocate (self%coordinate_name)
        if (allocated(self%coordinate_unit)) deallocate (self%coordinate_unit)
        if (allocated(self%coordinate_scale)) deallocate (self%coordinate_scale)
        if (allocated(self%breakpoints)) deallocate (self%breakpoints)
        if (allocated(self%nu_jumps)) deallocate (self%nu_jumps)
        if (allocated(inner%coordinate_name)) self%coordinate_name = inner%coordinate_name
        if (allocated(inner%coordinate_unit)) self%coordinate_unit = inner%coordinate_unit
        if (allocated(inner%coordinate_scale)) self%coordinate_scale = inner%coordinate_scale
        if (allocated(inner%breakpoints)) self%breakpoints = inner%breakpoints
        if (allocated(inner%nu_jumps)) self%nu_jumps = inner%nu_jumps
        call self%terms%allocate(inner%n, inner%n_holonomic, inner%n_nonholonomic)
        call self%derivatives%allocate(inner%n, inner%n_constraints())
        ! The new row may have a nu even if the wrapped model has none.
        self%provides = ior(inner%has_terms(), need_jacobian + need_nu)
        if (self%n_holonomic > 0) self%provides = ior(self%provides, need_phi)
        self%evaluate => evaluate
        self%provides_derivatives = inner%provides_derivatives
        self%evaluate_derivatives => null()
        if (self%provides_derivatives /= 0) self%evaluate_derivatives => evaluate_derivatives
        self%kinetic_energy => null()
        self%potential_energy => null()
        if (associated(inner%kinetic_energy)) self%kinetic_energy => kinetic_energy
        if (associated(inner%potential_energy)) self%potential_energy => potential_energy
    end subroutine wrap

    !> The rows of the wrapped model and, in its place, the new one plus an extra.
    pure subroutine spread_vector(self, inner, extra, values)
        class(redundant_type), intent(in) :: self
        real(wp), intent(in) :: inner(:), extra
        real(wp), intent(inout) :: values(:)

        values(:self%new_row - 1) = inner(:self%new_row - 1)
        values(self%new_row) = dot_product(self%factors, inner(self%rows)) + extra
        values(self%new_row + 1:) = inner(self%new_row:)
    end subroutine spread_vector

    !> The same for a matrix.
    pure subroutine spread_matrix(self, inner, values)
        class(redundant_type), intent(in) :: self
        real(wp), intent(in) :: inner(:, :)
        real(wp), intent(inout) :: values(:, :)

        values(:self%new_row - 1, :) = inner(:self%new_row - 1, :)
        values(self%new_row, :) = matmul(self%factors, inner(self%rows, :))
        values(self%new_row + 1:, :) = inner(self%new_row:, :)
    end subroutine spread_matrix

    !> The multipliers of the wrapped model that give the same C' lambda.
    pure function gather(self, lambda) result(inner)
        class(redundant_type), intent(in) :: self
        real(wp), intent(in) :: lambda(:)
        real(wp) :: inner(size(lambda) - 1)

        inner(:self%new_row - 1) = lambda(:self%new_row - 1)
        inner(self%new_row:) = lambda(self%new_row + 1:)
        inner(self%rows) = inner(self%rows) + self%factors*lambda(self%new_row)
    end function gather

    !> The wrapped model's terms, fused or single.
    recursive subroutine evaluate_inner(self, need, t, q, qd, stat)
        class(redundant_type), intent(inout) :: self
        integer, intent(in) :: need
        real(wp), intent(in) :: t, q(:), qd(:)
        integer, intent(out) :: stat
        real(wp) :: part(size(q))
        integer :: rest, failed

        stat = 0
        self%inner%segment = self%segment
        associate (inner => self%inner, terms => self%terms)
            rest = iand(need, inner%provides)
            if (rest /= 0) call inner%evaluate(rest, t, q, qd, terms, stat)
            rest = iand(iand(need, inner%has_terms()), not(inner%provides))
            if (stat == 0 .and. rest /= 0) call inner%evaluate_single(rest, t, q, qd, terms, part, failed, stat)
        end associate
    end subroutine evaluate_inner

    recursive subroutine evaluate(self, need, t, q, qd, terms, stat)
        class(model_type), intent(inout) :: self
        integer, intent(in) :: need
        real(wp), intent(in) :: t, q(:), qd(:)
        type(terms_type), intent(inout) :: terms
        integer, intent(out) :: stat
        real(wp) :: late

        stat = -1
        select type (self)
        class is (redundant_type)
            call self%evaluate_inner(need, t, q, qd, stat)
            if (stat /= 0) return
            late = max(0.0_wp, t - self%growth_from)
            associate (inner => self%terms)
                if (iand(need, need_phi) /= 0) then
                    if (self%new_row > self%n_holonomic) then
                        terms%phi = inner%phi
                    else
                        call self%spread_vector(inner%phi, self%phi_offset + self%growth*late**3, terms%phi)
                    end if
                end if
                if (iand(need, need_jacobian) /= 0) call self%spread_matrix(inner%jacobian, terms%jacobian)
                if (iand(need, need_nu) /= 0) then
                    call self%spread_vector(inner%nu, self%nu_offset - 3*self%growth*late**2, terms%nu)
                end if
                if (iand(need, need_gamma) /= 0) then
                    call self%spread_vector(inner%gamma, self%gamma_offset + 6*self%growth*late, terms%gamma)
                end if
                if (iand(need, need_mass) /= 0) terms%mass = inner%mass
                if (iand(need, need_force) /= 0) terms%force = inner%force
            end associate
        end select
    end subroutine evaluate

    !> The derivatives that the wrapped model fuses; its single ones are not passed on and are replaced by differences.
    recursive subroutine evaluate_derivatives(self, need, t, q, qd, qdd, lambda, derivatives, stat)
        class(model_type), intent(inout) :: self
        integer, intent(in) :: need
        real(wp), intent(in) :: t, q(:), qd(:), qdd(:), lambda(:)
        type(derivatives_type), intent(inout) :: derivatives
        integer, intent(out) :: stat

        stat = -1
        select type (self)
        class is (redundant_type)
            self%inner%segment = self%segment
            associate (inner => self%derivatives)
                call self%inner%evaluate_derivatives(need, t, q, qd, qdd, self%gather(lambda), inner, stat)
                if (stat /= 0) return
                if (iand(need, need_velocity_q) /= 0) call self%spread_matrix(inner%velocity_q, derivatives%velocity_q)
                if (iand(need, need_acceleration_q) /= 0) then
                    call self%spread_matrix(inner%acceleration_q, derivatives%acceleration_q)
                end if
                if (iand(need, need_acceleration_qd) /= 0) then
                    call self%spread_matrix(inner%acceleration_qd, derivatives%acceleration_qd)
                end if
                if (iand(need, need_dynamics_q) /= 0) derivatives%dynamics_q = inner%dynamics_q
                if (iand(need, need_dynamics_qd) /= 0) derivatives%dynamics_qd = inner%dynamics_qd
            end associate
        end select
    end subroutine evaluate_derivatives

    recursive subroutine kinetic_energy(self, q, qd, value, stat)
        class(model_type), intent(inout) :: self
        real(wp), intent(in) :: q(:), qd(:)
        real(wp), intent(out) :: value
        integer, intent(out) :: stat

        stat = -1
        value = 0.0_wp
        select type (self)
        class is (redundant_type)
            self%inner%segment = self%segment
            call self%inner%kinetic_energy(q, qd, value, stat)
        end select
    end subroutine kinetic_energy

    recursive subroutine potential_energy(self, t, q, value, stat)
        class(model_type), intent(inout) :: self
        real(wp), intent(in) :: t, q(:)
        real(wp), intent(out) :: value
        integer, intent(out) :: stat

        stat = -1
        value = 0.0_wp
        select type (self)
        class is (redundant_type)
            self%inner%segment = self%segment
            call self%inner%potential_energy(t, q, value, stat)
        end select
    end subroutine potential_energy
end module model_redundant
