! SPDX-License-Identifier: MIT
!> A model whose procedures are functions of C. They have the types that `include/tandem.h` declares.
module tandem_legacy_c_model
    use tandem_kinds, only: wp
    use tandem_legacy_callback_model, only: callback_model_type
    use tandem_legacy_terms, only: n_callbacks
    use tandem_model, only: model_type
    use tandem_model_terms, only: n_terms, need_jacobian, terms_type
    use, intrinsic :: iso_c_binding, only: c_associated, c_double, c_f_procpointer, c_funptr, c_int, c_null_ptr, c_ptr
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
            !> The term, all of it; matrices by rows.
            real(c_double), intent(inout) :: value(*)
            !> What was given to `tandem_new`.
            type(c_ptr), value :: user_data
        end function c_position

        !> `tandem_motion_function`: a term of time, position and velocity.
        integer(c_int) function c_motion(t, q, qd, value, user_data) bind(C)
            import :: c_double, c_int, c_ptr
            implicit none (type, external)
            real(c_double), value :: t
            !> Coordinates and velocities (n).
            real(c_double), intent(in) :: q(*), qd(*)
            real(c_double), intent(inout) :: value(*)
            type(c_ptr), value :: user_data
        end function c_motion

        !> `tandem_direction_function`: a derivative with a constant vector x.
        integer(c_int) function c_direction(t, q, x, value, user_data) bind(C)
            import :: c_double, c_int, c_ptr
            implicit none (type, external)
            real(c_double), value :: t
            !> Coordinates (n); x, (n) or (nh + nd).
            real(c_double), intent(in) :: q(*), x(*)
            real(c_double), intent(inout) :: value(*)
            type(c_ptr), value :: user_data
        end function c_direction

        !> `tandem_evaluate_function`: several terms at once.
        integer(c_int) function c_evaluate(need, t, q, qd, phi, jacobian, nu, gamma, mass, force, user_data) bind(C)
            import :: c_double, c_int, c_ptr
            implicit none (type, external)
            !> The terms wanted, a sum of need bits.
            integer(c_int), value :: need
            real(c_double), value :: t
            real(c_double), intent(in) :: q(*), qd(*)
            !> Addresses of Phi (nh), C (nh + nd, n) by rows, nu and gamma (nh + nd), M (n, n), S + Q_A (n).
            type(c_ptr), value :: phi, jacobian, nu, gamma, mass, force
            type(c_ptr), value :: user_data
        end function c_evaluate
    end interface

    !> The functions of one term, of which at most one is there.
    type :: callback_type
        procedure(c_position), pointer, nopass :: position => null()
        procedure(c_motion), pointer, nopass :: motion => null()
        procedure(c_direction), pointer, nopass :: direction => null()
    end type callback_type

    type, extends(callback_model_type) :: c_model_type
        !> Handed through to every function.
        type(c_ptr) :: user_data = c_null_ptr
        type(callback_type), private :: callback(n_callbacks)
        procedure(c_evaluate), pointer, nopass, private :: fused => null()
    contains
        procedure :: set_position
        procedure :: set_motion
        procedure :: set_direction
        procedure :: set_evaluate
        procedure :: call_position
        procedure :: call_motion
        procedure :: call_direction
    end type c_model_type

contains

    !> Give the function of a term of position; NULL takes it back.
    subroutine set_position(self, term, function_)
        class(c_model_type), intent(inout) :: self
        !> Number of the procedure in `tandem_legacy_terms`.
        integer, intent(in) :: term
        type(c_funptr), intent(in) :: function_

        self%callback(term)%position => null()
        if (c_associated(function_)) call c_f_procpointer(function_, self%callback(term)%position)
        call self%attach(term, c_associated(function_))
    end subroutine set_position

    !> Give the function of a term of motion; NULL takes it back.
    subroutine set_motion(self, term, function_)
        class(c_model_type), intent(inout) :: self
        integer, intent(in) :: term
        type(c_funptr), intent(in) :: function_

        self%callback(term)%motion => null()
        if (c_associated(function_)) call c_f_procpointer(function_, self%callback(term)%motion)
        call self%attach(term, c_associated(function_))
    end subroutine set_motion

    !> Give the function of a derivative with a constant vector; NULL takes it back.
    subroutine set_direction(self, term, function_)
        class(c_model_type), intent(inout) :: self
        integer, intent(in) :: term
        type(c_funptr), intent(in) :: function_

        self%callback(term)%direction => null()
        if (c_associated(function_)) call c_f_procpointer(function_, self%callback(term)%direction)
        call self%attach(term, c_associated(function_))
    end subroutine set_direction

    !> Give the fused function; NULL takes it back.
    subroutine set_evaluate(self, function_, provides)
        class(c_model_type), intent(inout) :: self
        type(c_funptr), intent(in) :: function_
        !> The terms that it gives, a sum of need bits.
        integer, intent(in) :: provides

        self%fused => null()
        if (c_associated(function_)) call c_f_procpointer(function_, self%fused)
        self%evaluate => null()
        if (c_associated(function_)) self%evaluate => evaluate
        self%provides = merge(provides, 0, c_associated(function_))
    end subroutine set_evaluate

    subroutine call_position(self, term, rows, t, q, value, stat)
        class(c_model_type), intent(inout) :: self
        integer, intent(in) :: term, rows
        real(wp), intent(in) :: t, q(*)
        real(wp), intent(inout) :: value(*)
        integer, intent(out) :: stat
        ! Called through a local pointer: gfortran 12 refuses assumed sizes in a call through a component.
        procedure(c_position), pointer :: function_

        function_ => self%callback(term)%position
        stat = function_(t, q, value, self%user_data)
    end subroutine call_position

    subroutine call_motion(self, term, rows, t, q, qd, value, stat)
        class(c_model_type), intent(inout) :: self
        integer, intent(in) :: term, rows
        real(wp), intent(in) :: t, q(*), qd(*)
        real(wp), intent(inout) :: value(*)
        integer, intent(out) :: stat
        procedure(c_motion), pointer :: function_

        function_ => self%callback(term)%motion
        stat = function_(t, q, qd, value, self%user_data)
    end subroutine call_motion

    subroutine call_direction(self, term, rows, t, q, x, value, stat)
        class(c_model_type), intent(inout) :: self
        integer, intent(in) :: term, rows
        real(wp), intent(in) :: t, q(*), x(*)
        real(wp), intent(inout) :: value(*)
        integer, intent(out) :: stat
        procedure(c_direction), pointer :: function_

        function_ => self%callback(term)%direction
        stat = function_(t, q, x, value, self%user_data)
    end subroutine call_direction

    !> Several terms at once: the model's `evaluate`.
    subroutine evaluate(self, need, t, q, qd, terms, stat)
        class(model_type), intent(inout) :: self
        integer, intent(in) :: need
        real(wp), intent(in) :: t, q(:), qd(:)
        type(terms_type), intent(inout) :: terms
        integer, intent(out) :: stat
        procedure(c_evaluate), pointer :: function_
        type(c_ptr) :: place(n_terms)

        stat = -1
        select type (self)
        type is (c_model_type)
            call self%find_places(need, terms, place)
            function_ => self%fused
            stat = function_(need, t, q, qd, place(1), place(2), place(3), place(4), place(5), place(6), self%user_data)
            call self%judge_terms(need, terms, stat)
            if (iand(need, need_jacobian) /= 0) call self%take_jacobian(terms%jacobian)
        end select
    end subroutine evaluate
end module tandem_legacy_c_model
