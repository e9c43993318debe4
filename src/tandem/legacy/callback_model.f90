! SPDX-License-Identifier: MIT
!> Models whose procedures are provided by a caller in another language. This module contains the common parts: the addresses of the
!> user's procedures, and the targets of the model's procedure pointers, which convert arguments to contiguous arrays. Extensions
!> for each language call the user's procedures according to the conventions of that language.
!>
!> A procedure that returns 0 must have set its complete value. The last entry is marked before the call. If it still has the mark
!> afterwards, the procedure has failed, such as a Python procedure that has raised an exception.
!>
!> No pointers to internal procedures are used, because these would require code on the stack.
module tandem_legacy_callback_model
    use tandem_kinds, only: long, wp
    use tandem_legacy_terms, only: a_constraint_acceleration, a_force_q, a_force_qd, a_gamma_q, a_gamma_qd, a_holonomic, &
        a_holonomic_jacobian, a_holonomic_rate, a_jacobian_derivative, a_kinetic_energy, a_mass_derivative, a_mass_matrix, &
        a_nonholonomic_jacobian, a_nonholonomic_rhs, a_nu_derivative, a_potential_energy, a_reaction_derivative, &
        an_applied_force, an_inertia_force, n_callbacks, of_motion, terms
    use tandem_model, only: model_type
    use tandem_model_procedures, only: procedure_model_type
    use tandem_model_terms, only: n_terms, need_force, need_gamma, need_jacobian, need_mass, need_nu, need_phi, terms_type
    use, intrinsic :: ieee_arithmetic, only: ieee_quiet_nan, ieee_value
    use, intrinsic :: iso_c_binding, only: c_associated, c_funptr, c_loc, c_null_funptr, c_null_ptr, c_ptr
    implicit none (type, external)
    private

    public :: callback_model_type

    !> Model with procedures in another language. Set the sizes first, then attach the procedures.
    type, abstract, extends(procedure_model_type) :: callback_model_type
        !> True for languages that store matrices by rows, such as C.
        logical :: by_rows = .false.
        !> User procedures, indexed as in `tandem_legacy_terms`, and the fused procedure.
        type(c_funptr) :: callback(n_callbacks) = c_null_funptr, fused = c_null_funptr
        !> Storage for terms that were not requested, so that the fused procedure may always compute all terms; addresses of the
        !> terms.
        type(terms_type), pointer, private :: unwanted => null()
        type(c_ptr), private :: scratch(n_terms) = c_null_ptr
        !> Matrix that is being converted (n*n).
        real(wp), allocatable, private :: work(:)
    contains
        procedure :: prepare, release, set_callback, set_fused, evaluate_function
        procedure(call_interface), deferred :: call_one
        procedure(fused_interface), deferred :: call_fused
    end type callback_model_type

    !> Mark of a value that was not set: a NaN that computations do not produce.
    integer(long), parameter :: unset = int(z'7FF8756E73657421', long)

    abstract interface
        !> Call the user procedure of one term, or of an event.
        subroutine call_interface(self, address, kind, rows, t, q, v, value, stat)
            import :: c_funptr, callback_model_type, wp
            implicit none (type, external)
            class(callback_model_type), intent(inout) :: self
            type(c_funptr), intent(in) :: address
            !> Kind of its argument list, see `tandem_legacy_terms`; rows of its value.
            integer, intent(in) :: kind, rows
            !> Time, NaN if the term must not depend on it; coordinates (n).
            real(wp), intent(in) :: t, q(*)
            !> Additional argument: velocities (n), or the constant vector x, (n) or (nh + nd).
            real(wp), intent(in) :: v(*)
            !> Scalar, vector (rows), or matrix (rows, n).
            real(wp), intent(inout) :: value(*)
            !> Status of the user procedure.
            integer, intent(out) :: stat
        end subroutine call_interface

        !> Call the user's fused procedure.
        subroutine fused_interface(self, need, t, q, qd, ptr, stat)
            import :: c_ptr, callback_model_type, n_terms, wp
            implicit none (type, external)
            class(callback_model_type), intent(inout) :: self
            !> Requested terms, a sum of need bits.
            integer, intent(in) :: need
            real(wp), intent(in) :: t, q(*), qd(*)
            !> Addresses of Phi, C, nu, gamma, M, S + Q_A.
            type(c_ptr), intent(in) :: ptr(n_terms)
            integer, intent(out) :: stat
        end subroutine fused_interface
    end interface

contains

    !> Allocate the work space. The sizes of the model must be valid.
    subroutine prepare(self)
        class(callback_model_type), intent(inout) :: self

        call self%release()
        allocate (self%unwanted)
        associate (terms => self%unwanted)
            call terms%allocate(self%n, self%n_holonomic, self%n_nonholonomic, fills_mass=.false.)
            self%scratch = [c_loc(terms%phi), c_loc(terms%jacobian), c_loc(terms%nu), c_loc(terms%gamma), c_loc(terms%mass), &
                c_loc(terms%force)]
        end associate
        ! Users set the whole array.
        if (allocated(self%work)) deallocate (self%work)
        allocate (self%work(self%n*self%n))
    end subroutine prepare

    !> Deallocate the work space.
    subroutine release(self)
        class(callback_model_type), intent(inout) :: self

        if (associated(self%unwanted)) deallocate (self%unwanted)
        self%unwanted => null()
    end subroutine release

    !> Attach a procedure to the model, or detach it if the address is null.
    subroutine set_callback(self, term, address)
        class(callback_model_type), intent(inout) :: self
        !> Index of the procedure in `tandem_legacy_terms`.
        integer, intent(in) :: term
        !> Address of the procedure, or null.
        type(c_funptr), intent(in) :: address
        logical :: has

        self%callback(term) = address
        has = c_associated(address)
        select case (term)
        case (a_holonomic); nullify (self%holonomic)
            if (has) self%holonomic => holonomic
        case (a_holonomic_jacobian); nullify (self%holonomic_jacobian)
            if (has) self%holonomic_jacobian => holonomic_jacobian
        case (a_holonomic_rate); nullify (self%holonomic_rate)
            if (has) self%holonomic_rate => holonomic_rate
        case (a_nonholonomic_jacobian); nullify (self%nonholonomic_jacobian)
            if (has) self%nonholonomic_jacobian => nonholonomic_jacobian
        case (a_nonholonomic_rhs); nullify (self%nonholonomic_rhs)
            if (has) self%nonholonomic_rhs => nonholonomic_rhs
        case (a_mass_matrix); nullify (self%mass_matrix)
            if (has) self%mass_matrix => mass_matrix
        case (a_potential_energy); nullify (self%potential_energy)
            if (has) self%potential_energy => potential_energy
        case (a_nu_derivative); nullify (self%nu_derivative)
            if (has) self%nu_derivative => nu_derivative
        case (a_constraint_acceleration); nullify (self%constraint_acceleration)
            if (has) self%constraint_acceleration => constraint_acceleration
        case (an_inertia_force); nullify (self%inertia_force)
            if (has) self%inertia_force => inertia_force
        case (an_applied_force); nullify (self%applied_force)
            if (has) self%applied_force => applied_force
        case (a_kinetic_energy); nullify (self%kinetic_energy)
            if (has) self%kinetic_energy => kinetic_energy
        case (a_gamma_q); nullify (self%gamma_q)
            if (has) self%gamma_q => gamma_q
        case (a_gamma_qd); nullify (self%gamma_qd)
            if (has) self%gamma_qd => gamma_qd
        case (a_force_q); nullify (self%force_q)
            if (has) self%force_q => force_q
        case (a_force_qd); nullify (self%force_qd)
            if (has) self%force_qd => force_qd
        case (a_jacobian_derivative); nullify (self%jacobian_derivative)
            if (has) self%jacobian_derivative => jacobian_derivative
        case (a_reaction_derivative); nullify (self%reaction_derivative)
            if (has) self%reaction_derivative => reaction_derivative
        case (a_mass_derivative); nullify (self%mass_derivative)
            if (has) self%mass_derivative => mass_derivative
        case default ! The table has no other rows.
        end select
    end subroutine set_callback

    !> Attach a fused procedure to the model, or detach it if the address is null.
    subroutine set_fused(self, address, provides)
        class(callback_model_type), intent(inout) :: self
        !> Address of the procedure, or null.
        type(c_funptr), intent(in) :: address
        !> Provided terms, a sum of need bits.
        integer, intent(in) :: provides

        self%fused = address
        self%provides = merge(provides, 0, c_associated(address))
        nullify (self%evaluate)
        if (c_associated(address)) self%evaluate => evaluate
    end subroutine set_fused

    !> Find the addresses of the terms for a call of the fused procedure. Requested terms are written in place. Other terms, and a
    !> Jacobian stored by rows, are written to scratch memory. Passing addresses is fast, because most calls request one short
    !> vector. Requested terms are marked as not set.
    subroutine find_addresses(self, need, terms, ptr)
        class(callback_model_type), intent(in) :: self
        !> Requested terms, a sum of need bits.
        integer, intent(in) :: need
        type(terms_type), intent(inout), target :: terms
        !> Addresses of Phi, C, nu, gamma, M, S + Q_A.
        type(c_ptr), intent(out) :: ptr(n_terms)

        ptr = self%scratch
        if (iand(need, need_phi) /= 0) then
            ptr(1) = c_loc(terms%phi)
            call mark(size(terms%phi), terms%phi)
        end if
        if (iand(need, need_jacobian) /= 0) then
            if (self%by_rows) then
                call mark(size(self%unwanted%jacobian), self%unwanted%jacobian)
            else
                ptr(2) = c_loc(terms%jacobian)
                call mark(size(terms%jacobian), terms%jacobian)
            end if
        end if
        if (iand(need, need_nu) /= 0) then
            ptr(3) = c_loc(terms%nu)
            call mark(size(terms%nu), terms%nu)
        end if
        if (iand(need, need_gamma) /= 0) then
            ptr(4) = c_loc(terms%gamma)
            call mark(size(terms%gamma), terms%gamma)
        end if
        if (iand(need, need_mass) /= 0) then
            ptr(5) = c_loc(terms%mass)
            call mark(size(terms%mass), terms%mass)
        end if
        if (iand(need, need_force) /= 0) then
            ptr(6) = c_loc(terms%force)
            call mark(size(terms%force), terms%force)
        end if
    end subroutine find_addresses

    !> Check that a fused procedure has set the requested terms. One marked term suffices for a procedure that has failed before it
    !> set any term. After a later failure, marks remain as NaN in the result.
    subroutine check_terms(self, need, terms, stat)
        class(callback_model_type), intent(in) :: self
        integer, intent(in) :: need
        type(terms_type), intent(in) :: terms
        !> Status of the procedure; set to a negative value if no term was set.
        integer, intent(inout) :: stat

        if (iand(need, need_force) /= 0) then
            call check_value(size(terms%force), terms%force, stat)
        else if (iand(need, need_mass) /= 0) then
            call check_value(size(terms%mass), terms%mass, stat)
        else if (iand(need, need_phi) /= 0) then
            call check_value(size(terms%phi), terms%phi, stat)
        else if (iand(need, need_gamma) /= 0) then
            call check_value(size(terms%gamma), terms%gamma, stat)
        else if (iand(need, need_nu) /= 0) then
            call check_value(size(terms%nu), terms%nu, stat)
        else if (self%by_rows) then
            call check_value(size(self%unwanted%jacobian), self%unwanted%jacobian, stat)
        else
            call check_value(size(terms%jacobian), terms%jacobian, stat)
        end if
    end subroutine check_terms

    !> Mark a value as not set by its last entry.
    pure subroutine mark(n, value)
        integer, intent(in) :: n
        real(wp), intent(inout) :: value(*)

        if (n > 0) value(n) = transfer(unset, value(n))
    end subroutine mark

    !> Return an error if a value is still marked, whatever status the procedure returned.
    pure subroutine check_value(n, value, stat)
        integer, intent(in) :: n
        real(wp), intent(in) :: value(*)
        integer, intent(inout) :: stat

        if (n == 0 .or. stat /= 0) return
        if (transfer(value(n), unset) == unset) stat = -1
    end subroutine check_value

    !> Convert storage by rows to storage by columns.
    pure subroutine from_rows(m, n, rows, value)
        integer, intent(in) :: m, n
        real(wp), intent(in) :: rows(n, m)
        real(wp), intent(inout) :: value(m, n)
        integer :: first, i, j

        ! Four rows at a time, then two: entries of a column are written together, because the elimination reads them soon.
        first = 1
        do while (first + 3 <= m)
            !GCC$ novector
            !GCC$ unroll 1
            do j = 1, n
                value(first, j) = rows(j, first)
                value(first + 1, j) = rows(j, first + 1)
                value(first + 2, j) = rows(j, first + 2)
                value(first + 3, j) = rows(j, first + 3)
            end do
            first = first + 4
        end do
        do i = first, m - 1, 2
            !GCC$ novector
            !GCC$ unroll 1
            do j = 1, n
                value(i, j) = rows(j, i)
                value(i + 1, j) = rows(j, i + 1)
            end do
        end do
        if (modulo(m, 2) == 1) value(m, :) = rows(:, m)
    end subroutine from_rows

    ! --- procedures to which the model's pointers point -----------------------------------------------------------------------

    !> Evaluate several terms by the fused procedure.
    subroutine evaluate(self, need, t, q, qd, terms, stat)
        class(model_type), intent(inout) :: self
        integer, intent(in) :: need
        real(wp), intent(in) :: t, q(:), qd(:)
        type(terms_type), intent(inout) :: terms
        integer, intent(out) :: stat
        type(c_ptr) :: ptr(n_terms)

        stat = -1
        select type (self)
        class is (callback_model_type)
            call find_addresses(self, need, terms, ptr)
            call self%call_fused(need, t, q, qd, ptr, stat)
            call check_terms(self, need, terms, stat)
            if (self%by_rows .and. iand(need, need_jacobian) /= 0) then
                call from_rows(size(terms%jacobian, 1), self%n, self%unwanted%jacobian, terms%jacobian)
            end if
        end select
    end subroutine evaluate

    !> Evaluate a vector by the user's procedure. Procedures without an argument v receive q in its place.
    subroutine evaluate_vector(self, term, t, q, v, value, stat)
        class(model_type), intent(inout) :: self
        integer, intent(in) :: term
        real(wp), intent(in) :: t, q(:), v(:)
        real(wp), intent(inout) :: value(:)
        integer, intent(out) :: stat

        stat = -1
        select type (self)
        class is (callback_model_type)
            call mark(size(value), value)
            call self%call_one(self%callback(term), terms(term)%kind, size(value), t, q, v, value, stat)
            call check_value(size(value), value, stat)
        end select
    end subroutine evaluate_vector

    !> Evaluate a user's function of time, position and velocity that is not a term, such as that of an event.
    subroutine evaluate_function(self, address, t, q, qd, value, stat)
        class(callback_model_type), intent(inout) :: self
        type(c_funptr), intent(in) :: address
        real(wp), intent(in) :: t, q(:), qd(:)
        real(wp), intent(out) :: value(:)
        !> Status of the procedure; negative if the value was not set.
        integer, intent(out) :: stat

        call mark(size(value), value)
        call self%call_one(address, of_motion, size(value), t, q, qd, value, stat)
        call check_value(size(value), value, stat)
    end subroutine evaluate_function

    !> Evaluate a matrix by the user's procedure. It is stored in place and may be a part of a larger matrix.
    subroutine evaluate_matrix(self, term, t, q, v, value, stat)
        class(model_type), intent(inout) :: self
        integer, intent(in) :: term
        real(wp), intent(in) :: t, q(:), v(:)
        real(wp), intent(inout) :: value(:, :)
        integer, intent(out) :: stat
        integer :: i, j, rows, n

        stat = -1
        rows = size(value, 1)
        n = size(value, 2)
        select type (self)
        class is (callback_model_type)
            call mark(size(value), self%work)
            call self%call_one(self%callback(term), terms(term)%kind, rows, t, q, v, self%work, stat)
            call check_value(size(value), self%work, stat)
            do j = 1, n
                do i = 1, rows
                    if (self%by_rows) then
                        value(i, j) = self%work((i - 1)*n + j)
                    else
                        value(i, j) = self%work((j - 1)*rows + i)
                    end if
                end do
            end do
        end select
    end subroutine evaluate_matrix

    !> Time for terms that must not depend on time. A term that uses it becomes NaN, which is detected.
    pure real(wp) function no_time()
        no_time = ieee_value(no_time, ieee_quiet_nan)
    end function no_time

    subroutine holonomic(self, t, q, value, stat)
        class(model_type), intent(inout) :: self
        real(wp), intent(in) :: t, q(:)
        real(wp), intent(out) :: value(:)
        integer, intent(out) :: stat

        call evaluate_vector(self, a_holonomic, t, q, q, value, stat)
    end subroutine holonomic

    subroutine holonomic_jacobian(self, t, q, value, stat)
        class(model_type), intent(inout) :: self
        real(wp), intent(in) :: t, q(:)
        real(wp), intent(out) :: value(:, :)
        integer, intent(out) :: stat

        call evaluate_matrix(self, a_holonomic_jacobian, t, q, q, value, stat)
    end subroutine holonomic_jacobian

    subroutine holonomic_rate(self, t, q, value, stat)
        class(model_type), intent(inout) :: self
        real(wp), intent(in) :: t, q(:)
        real(wp), intent(out) :: value(:)
        integer, intent(out) :: stat

        call evaluate_vector(self, a_holonomic_rate, t, q, q, value, stat)
    end subroutine holonomic_rate

    subroutine nonholonomic_jacobian(self, t, q, value, stat)
        class(model_type), intent(inout) :: self
        real(wp), intent(in) :: t, q(:)
        real(wp), intent(out) :: value(:, :)
        integer, intent(out) :: stat

        call evaluate_matrix(self, a_nonholonomic_jacobian, t, q, q, value, stat)
    end subroutine nonholonomic_jacobian

    subroutine nonholonomic_rhs(self, t, q, value, stat)
        class(model_type), intent(inout) :: self
        real(wp), intent(in) :: t, q(:)
        real(wp), intent(out) :: value(:)
        integer, intent(out) :: stat

        call evaluate_vector(self, a_nonholonomic_rhs, t, q, q, value, stat)
    end subroutine nonholonomic_rhs

    subroutine nu_derivative(self, t, q, value, stat)
        class(model_type), intent(inout) :: self
        real(wp), intent(in) :: t, q(:)
        real(wp), intent(out) :: value(:, :)
        integer, intent(out) :: stat

        call evaluate_matrix(self, a_nu_derivative, t, q, q, value, stat)
    end subroutine nu_derivative

    subroutine constraint_acceleration(self, t, q, qd, value, stat)
        class(model_type), intent(inout) :: self
        real(wp), intent(in) :: t, q(:), qd(:)
        real(wp), intent(out) :: value(:)
        integer, intent(out) :: stat

        call evaluate_vector(self, a_constraint_acceleration, t, q, qd, value, stat)
    end subroutine constraint_acceleration

    subroutine applied_force(self, t, q, qd, value, stat)
        class(model_type), intent(inout) :: self
        real(wp), intent(in) :: t, q(:), qd(:)
        real(wp), intent(out) :: value(:)
        integer, intent(out) :: stat

        call evaluate_vector(self, an_applied_force, t, q, qd, value, stat)
    end subroutine applied_force

    subroutine gamma_q(self, t, q, qd, value, stat)
        class(model_type), intent(inout) :: self
        real(wp), intent(in) :: t, q(:), qd(:)
        real(wp), intent(out) :: value(:, :)
        integer, intent(out) :: stat

        call evaluate_matrix(self, a_gamma_q, t, q, qd, value, stat)
    end subroutine gamma_q

    subroutine gamma_qd(self, t, q, qd, value, stat)
        class(model_type), intent(inout) :: self
        real(wp), intent(in) :: t, q(:), qd(:)
        real(wp), intent(out) :: value(:, :)
        integer, intent(out) :: stat

        call evaluate_matrix(self, a_gamma_qd, t, q, qd, value, stat)
    end subroutine gamma_qd

    subroutine force_q(self, t, q, qd, value, stat)
        class(model_type), intent(inout) :: self
        real(wp), intent(in) :: t, q(:), qd(:)
        real(wp), intent(out) :: value(:, :)
        integer, intent(out) :: stat

        call evaluate_matrix(self, a_force_q, t, q, qd, value, stat)
    end subroutine force_q

    subroutine force_qd(self, t, q, qd, value, stat)
        class(model_type), intent(inout) :: self
        real(wp), intent(in) :: t, q(:), qd(:)
        real(wp), intent(out) :: value(:, :)
        integer, intent(out) :: stat

        call evaluate_matrix(self, a_force_qd, t, q, qd, value, stat)
    end subroutine force_qd

    subroutine jacobian_derivative(self, t, q, x, value, stat)
        class(model_type), intent(inout) :: self
        real(wp), intent(in) :: t, q(:), x(:)
        real(wp), intent(out) :: value(:, :)
        integer, intent(out) :: stat

        call evaluate_matrix(self, a_jacobian_derivative, t, q, x, value, stat)
    end subroutine jacobian_derivative

    subroutine reaction_derivative(self, t, q, x, value, stat)
        class(model_type), intent(inout) :: self
        real(wp), intent(in) :: t, q(:), x(:)
        real(wp), intent(out) :: value(:, :)
        integer, intent(out) :: stat

        call evaluate_matrix(self, a_reaction_derivative, t, q, x, value, stat)
    end subroutine reaction_derivative

    subroutine mass_matrix(self, q, value, stat)
        class(model_type), intent(inout) :: self
        real(wp), intent(in) :: q(:)
        real(wp), intent(out) :: value(:, :)
        integer, intent(out) :: stat

        call evaluate_matrix(self, a_mass_matrix, no_time(), q, q, value, stat)
    end subroutine mass_matrix

    subroutine mass_derivative(self, q, x, value, stat)
        class(model_type), intent(inout) :: self
        real(wp), intent(in) :: q(:), x(:)
        real(wp), intent(out) :: value(:, :)
        integer, intent(out) :: stat

        call evaluate_matrix(self, a_mass_derivative, no_time(), q, x, value, stat)
    end subroutine mass_derivative

    subroutine inertia_force(self, q, qd, value, stat)
        class(model_type), intent(inout) :: self
        real(wp), intent(in) :: q(:), qd(:)
        real(wp), intent(out) :: value(:)
        integer, intent(out) :: stat

        call evaluate_vector(self, an_inertia_force, no_time(), q, qd, value, stat)
    end subroutine inertia_force

    subroutine potential_energy(self, t, q, value, stat)
        class(model_type), intent(inout) :: self
        real(wp), intent(in) :: t, q(:)
        real(wp), intent(out) :: value
        integer, intent(out) :: stat
        real(wp) :: energy(1)

        call evaluate_vector(self, a_potential_energy, t, q, q, energy, stat)
        value = energy(1)
    end subroutine potential_energy

    subroutine kinetic_energy(self, q, qd, value, stat)
        class(model_type), intent(inout) :: self
        real(wp), intent(in) :: q(:), qd(:)
        real(wp), intent(out) :: value
        integer, intent(out) :: stat
        real(wp) :: energy(1)

        call evaluate_vector(self, a_kinetic_energy, no_time(), q, qd, energy, stat)
        value = energy(1)
    end subroutine kinetic_energy
end module tandem_legacy_callback_model
