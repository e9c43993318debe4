! SPDX-License-Identifier: MIT
!> A model whose procedures are external subroutines in the style of Fortran 77, with RPAR and IPAR handed through.
module tandem_legacy_f77_model
    use tandem_kinds, only: wp
    use tandem_legacy_callback_model, only: callback_model_type
    use tandem_legacy_terms, only: n_callbacks
    use tandem_model, only: model_type
    use tandem_model_terms, only: n_terms, terms_type
    use, intrinsic :: iso_c_binding, only: c_associated, c_double, c_f_procpointer, c_funloc, c_funptr, &
        c_int, c_ptr
    implicit none (type, external)
    private

    public :: f77_model_type, is_none, lend_to, f77_position, f77_motion, f77_direction, f77_evaluate

    abstract interface
        !> A term of time and position.
        subroutine f77_position(n, m, t, q, val, rpar, ipar, istat)
            import :: wp
            implicit none (type, external)
            !> Number of coordinates; rows of VAL: VAL(M), or VAL(M, N) for a matrix.
            integer, intent(in) :: n, m
            !> Time; coordinates (n).
            real(wp), intent(in) :: t, q(*)
            !> The term, all of it.
            real(wp), intent(inout) :: val(*)
            !> The caller's own.
            real(wp), intent(inout) :: rpar(*)
            integer, intent(inout) :: ipar(*)
            !> 0 on entry; > 0 cannot be evaluated here, < 0 stop.
            integer, intent(inout) :: istat
        end subroutine f77_position

        !> A term of time, position and velocity.
        subroutine f77_motion(n, m, t, q, qd, val, rpar, ipar, istat)
            import :: wp
            implicit none (type, external)
            integer, intent(in) :: n, m
            !> Time; coordinates and velocities (n).
            real(wp), intent(in) :: t, q(*), qd(*)
            real(wp), intent(inout) :: val(*)
            real(wp), intent(inout) :: rpar(*)
            integer, intent(inout) :: ipar(*)
            integer, intent(inout) :: istat
        end subroutine f77_motion

        !> A derivative with a constant vector X.
        subroutine f77_direction(n, m, t, q, x, val, rpar, ipar, istat)
            import :: wp
            implicit none (type, external)
            integer, intent(in) :: n, m
            !> Time; coordinates (n); x, (n) or (nh + nd).
            real(wp), intent(in) :: t, q(*), x(*)
            real(wp), intent(inout) :: val(*)
            real(wp), intent(inout) :: rpar(*)
            integer, intent(inout) :: ipar(*)
            integer, intent(inout) :: istat
        end subroutine f77_direction

        !> Several terms at once.
        subroutine f77_evaluate(need, n, nh, nd, t, q, qd, phi, c, anu, gam, am, f, rpar, ipar, istat)
            import :: wp
            implicit none (type, external)
            !> The terms wanted, a sum of need bits; numbers of coordinates, holonomic and nonholonomic constraints.
            integer, intent(in) :: need, n, nh, nd
            real(wp), intent(in) :: t, q(*), qd(*)
            !> PHI(NH), C(NH + ND, N), ANU(NH + ND), GAM(NH + ND), AM(N, N), F(N).
            real(wp), intent(inout) :: phi(*), c(*), anu(*), gam(*), am(*), f(*)
            real(wp), intent(inout) :: rpar(*)
            integer, intent(inout) :: ipar(*)
            integer, intent(inout) :: istat
        end subroutine f77_evaluate
    end interface

    abstract interface
        !> `f77_evaluate` as it is called: arrays by their addresses, which is how Fortran 77 hands them over.
        subroutine f77_evaluate_by_address(need, n, nh, nd, t, q, qd, phi, c, anu, gam, am, f, rpar, ipar, istat) bind(C)
            import :: c_double, c_int, c_ptr
            implicit none (type, external)
            integer(c_int), intent(in) :: need, n, nh, nd
            real(c_double), intent(in) :: t, q(*), qd(*)
            type(c_ptr), value :: phi, c, anu, gam, am, f
            real(c_double), intent(inout) :: rpar(*)
            integer(c_int), intent(inout) :: ipar(*)
            integer(c_int), intent(inout) :: istat
        end subroutine f77_evaluate_by_address
    end interface

    !> The subroutines of one term, of which at most one is there.
    type :: callback_type
        procedure(f77_position), pointer, nopass :: position => null()
        procedure(f77_motion), pointer, nopass :: motion => null()
        procedure(f77_direction), pointer, nopass :: direction => null()
    end type callback_type

    type, extends(callback_model_type) :: f77_model_type
        type(callback_type), private :: callback(n_callbacks)
        procedure(f77_evaluate_by_address), pointer, nopass, private :: fused => null()
        !> The first entries of the arrays that the current call of the interface was given.
        real(wp), pointer, contiguous, private :: rpar(:) => null()
        integer, pointer, contiguous, private :: ipar(:) => null()
    contains
        procedure :: set_position
        procedure :: set_motion
        procedure :: set_direction
        procedure :: set_evaluate
        procedure :: call_position
        procedure :: call_motion
        procedure :: call_direction
    end type f77_model_type

contains

    !> Whether a procedure is the one that stands for none.
    logical function is_none(address)
        !> Address of a procedure.
        type(c_funptr), intent(in) :: address
        procedure(f77_position) :: tdnone

        is_none = c_associated(address, c_funloc(tdnone))
    end function is_none

    !> Hand RPAR and IPAR through to the procedures of a model until the next call of this.
    subroutine lend_to(model, rpar, ipar)
        class(callback_model_type), intent(inout) :: model
        real(wp), intent(inout), target :: rpar(1)
        integer, intent(inout), target :: ipar(1)

        select type (model)
        class is (f77_model_type)
            model%rpar => rpar
            model%ipar => ipar
        end select
    end subroutine lend_to

    !> Give the subroutine of a term of position; TDNONE takes it back.
    subroutine set_position(self, term, procedure_)
        class(f77_model_type), intent(inout) :: self
        !> Number of the procedure in `tandem_legacy_terms`.
        integer, intent(in) :: term
        procedure(f77_position) :: procedure_

        self%callback(term)%position => procedure_
        call self%attach(term, .not. is_none(c_funloc(procedure_)))
    end subroutine set_position

    !> Give the subroutine of a term of motion; TDNONE takes it back.
    subroutine set_motion(self, term, procedure_)
        class(f77_model_type), intent(inout) :: self
        integer, intent(in) :: term
        procedure(f77_motion) :: procedure_

        self%callback(term)%motion => procedure_
        call self%attach(term, .not. is_none(c_funloc(procedure_)))
    end subroutine set_motion

    !> Give the subroutine of a derivative with a constant vector; TDNONE takes it back.
    subroutine set_direction(self, term, procedure_)
        class(f77_model_type), intent(inout) :: self
        integer, intent(in) :: term
        procedure(f77_direction) :: procedure_

        self%callback(term)%direction => procedure_
        call self%attach(term, .not. is_none(c_funloc(procedure_)))
    end subroutine set_direction

    !> Give the fused subroutine; TDNONE takes it back.
    subroutine set_evaluate(self, procedure_, provides)
        class(f77_model_type), intent(inout) :: self
        procedure(f77_evaluate) :: procedure_
        !> The terms that it gives, a sum of need bits.
        integer, intent(in) :: provides

        call c_f_procpointer(c_funloc(procedure_), self%fused)
        self%evaluate => null()
        if (.not. is_none(c_funloc(procedure_))) self%evaluate => evaluate
        self%provides = merge(0, provides, is_none(c_funloc(procedure_)))
    end subroutine set_evaluate

    subroutine call_position(self, term, rows, t, q, value, stat)
        class(f77_model_type), intent(inout) :: self
        integer, intent(in) :: term, rows
        real(wp), intent(in) :: t, q(*)
        real(wp), intent(inout) :: value(*)
        integer, intent(out) :: stat
        ! Called through a local pointer: gfortran 12 refuses assumed sizes in a call through a component.
        procedure(f77_position), pointer :: sub

        stat = 0
        sub => self%callback(term)%position
        call sub(self%n, rows, t, q, value, self%rpar, self%ipar, stat)
    end subroutine call_position

    subroutine call_motion(self, term, rows, t, q, qd, value, stat)
        class(f77_model_type), intent(inout) :: self
        integer, intent(in) :: term, rows
        real(wp), intent(in) :: t, q(*), qd(*)
        real(wp), intent(inout) :: value(*)
        integer, intent(out) :: stat
        procedure(f77_motion), pointer :: sub

        stat = 0
        sub => self%callback(term)%motion
        call sub(self%n, rows, t, q, qd, value, self%rpar, self%ipar, stat)
    end subroutine call_motion

    subroutine call_direction(self, term, rows, t, q, x, value, stat)
        class(f77_model_type), intent(inout) :: self
        integer, intent(in) :: term, rows
        real(wp), intent(in) :: t, q(*), x(*)
        real(wp), intent(inout) :: value(*)
        integer, intent(out) :: stat
        procedure(f77_direction), pointer :: sub

        stat = 0
        sub => self%callback(term)%direction
        call sub(self%n, rows, t, q, x, value, self%rpar, self%ipar, stat)
    end subroutine call_direction

    !> Several terms at once: the model's `evaluate`.
    subroutine evaluate(self, need, t, q, qd, terms, stat)
        class(model_type), intent(inout) :: self
        integer, intent(in) :: need
        real(wp), intent(in) :: t, q(:), qd(:)
        type(terms_type), intent(inout) :: terms
        integer, intent(out) :: stat
        procedure(f77_evaluate_by_address), pointer :: sub
        type(c_ptr) :: place(n_terms)

        stat = -1
        select type (self)
        type is (f77_model_type)
            call self%find_places(need, terms, place)
            sub => self%fused
            stat = 0
            call sub(need, self%n, self%n_holonomic, self%n_nonholonomic, t, q, qd, place(1), place(2), place(3), place(4), &
                place(5), place(6), self%rpar, self%ipar, stat)
            call self%judge_terms(need, terms, stat)
        end select
    end subroutine evaluate
end module tandem_legacy_f77_model
