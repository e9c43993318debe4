! SPDX-License-Identifier: MIT
!> Models whose procedures are C functions. `include/tandem.h` declares the types of these functions.
module tandem_legacy_c_model
    use tandem_kinds, only: wp
    use tandem_legacy_callback_model, only: callback_model_type
    use tandem_legacy_terms, only: of_position
    use tandem_model_terms, only: n_terms
    use, intrinsic :: iso_c_binding, only: c_double, c_f_procpointer, c_funptr, c_int, c_null_ptr, c_ptr
    implicit none (type, external)
    private

    public :: c_model_type

    abstract interface
        !> `tandem_position_function`: a term of time and position.
        integer(c_int) function c_position(t, q, value, user_data) bind(C)
            import :: c_double, c_int, c_ptr
            implicit none (type, external)
            !> Time.
            real(c_double), value :: t
            !> Coordinates (n).
            real(c_double), intent(in) :: q(*)
            !> The complete term; matrices are stored by rows.
            real(c_double), intent(inout) :: value(*)
            !> Argument of `tandem_new`.
            type(c_ptr), value :: user_data
        end function c_position

        !> `tandem_motion_function`: a term of time, position and velocity, or the function of an event.
        !> `tandem_direction_function`: a derivative with a constant vector.
        integer(c_int) function c_motion(t, q, v, value, user_data) bind(C)
            import :: c_double, c_int, c_ptr
            implicit none (type, external)
            real(c_double), value :: t
            !> Coordinates (n); velocities (n), or constant vector (n) or (nh + nd).
            real(c_double), intent(in) :: q(*), v(*)
            real(c_double), intent(inout) :: value(*)
            type(c_ptr), value :: user_data
        end function c_motion

        !> `tandem_evaluate_function`: several terms at once.
        integer(c_int) function c_evaluate(need, t, q, qd, phi, jacobian, nu, gamma, mass, force, user_data) bind(C)
            import :: c_double, c_int, c_ptr
            implicit none (type, external)
            !> Requested terms, a sum of need bits.
            integer(c_int), value :: need
            real(c_double), value :: t
            real(c_double), intent(in) :: q(*), qd(*)
            !> Addresses of Phi (nh), C (nh + nd, n) by rows, nu and gamma (nh + nd), M (n, n), S + Q_A (n).
            type(c_ptr), value :: phi, jacobian, nu, gamma, mass, force
            type(c_ptr), value :: user_data
        end function c_evaluate
    end interface

    !> Model whose procedures are C functions.
    type, extends(callback_model_type) :: c_model_type
        !> Argument of all functions.
        type(c_ptr) :: user_data = c_null_ptr
    contains
        procedure :: call_one, call_fused
    end type c_model_type

contains

    subroutine call_one(self, address, kind, rows, t, q, v, value, stat)
        class(c_model_type), intent(inout) :: self
        type(c_funptr), intent(in) :: address
        integer, intent(in) :: kind, rows
        real(wp), intent(in) :: t, q(*), v(*)
        real(wp), intent(inout) :: value(*)
        integer, intent(out) :: stat
        procedure(c_position), pointer :: position
        procedure(c_motion), pointer :: motion

        if (kind == of_position) then
            call c_f_procpointer(address, position)
            stat = position(t, q, value, self%user_data)
        else
            call c_f_procpointer(address, motion)
            stat = motion(t, q, v, value, self%user_data)
        end if
    end subroutine call_one

    subroutine call_fused(self, need, t, q, qd, ptr, stat)
        class(c_model_type), intent(inout) :: self
        integer, intent(in) :: need
        real(wp), intent(in) :: t, q(*), qd(*)
        type(c_ptr), intent(in) :: ptr(n_terms)
        integer, intent(out) :: stat
        procedure(c_evaluate), pointer :: evaluate

        call c_f_procpointer(self%fused, evaluate)
        stat = evaluate(need, t, q, qd, ptr(1), ptr(2), ptr(3), ptr(4), ptr(5), ptr(6), self%user_data)
    end subroutine call_fused
end module tandem_legacy_c_model
