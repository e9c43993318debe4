! SPDX-License-Identifier: MIT
!> Models whose procedures are external subroutines in the style of Fortran 77, to which RPAR and IPAR are passed.
module tandem_legacy_f77_model
    use tandem_kinds, only: wp
    use tandem_legacy_callback_model, only: callback_model_type
    use tandem_legacy_handle, only: problem_of, to_address
    use tandem_legacy_problem, only: problem_type
    use tandem_legacy_terms, only: of_position
    use tandem_model_terms, only: n_terms
    use tandem_status, only: status_invalid_option
    use, intrinsic :: iso_c_binding, only: c_associated, c_double, c_f_procpointer, c_funloc, c_funptr, c_int, c_null_funptr, &
        c_ptr
    implicit none (type, external)
    private

    public :: f77_model_type, address_or_null, found, f77_position, f77_motion, f77_direction, f77_evaluate
    ! For the subroutines of the interface.
    public :: problem_type, wp

    abstract interface
        !> A term of time and position.
        subroutine f77_position(n, m, t, q, val, rpar, ipar, istat)
            import :: wp
            implicit none (type, external)
            !> Number of coordinates; number of rows of VAL, which is VAL(M), or VAL(M, N) for a matrix.
            integer, intent(in) :: n, m
            !> Time; coordinates (n).
            real(wp), intent(in) :: t, q(*)
            !> The complete term.
            real(wp), intent(inout) :: val(*)
            !> Arrays of the caller.
            real(wp), intent(inout) :: rpar(*)
            integer, intent(inout) :: ipar(*)
            !> 0 on entry. On return: 0 if evaluated, > 0 if it cannot be evaluated here, < 0 to stop the run.
            integer, intent(inout) :: istat
        end subroutine f77_position

        !> A term of time, position and velocity, or the function of an event.
        subroutine f77_motion(n, m, t, q, qd, val, rpar, ipar, istat)
            import :: wp
            implicit none (type, external)
            integer, intent(in) :: n, m
            !> Time; coordinates and velocities (n).
            real(wp), intent(in) :: t, q(*), qd(*)
            real(wp), intent(inout) :: val(*), rpar(*)
            integer, intent(inout) :: ipar(*), istat
        end subroutine f77_motion

        !> A derivative with a constant vector X.
        subroutine f77_direction(n, m, t, q, x, val, rpar, ipar, istat)
            import :: wp
            implicit none (type, external)
            integer, intent(in) :: n, m
            !> Time; coordinates (n); x, (n) or (nh + nd).
            real(wp), intent(in) :: t, q(*), x(*)
            real(wp), intent(inout) :: val(*), rpar(*)
            integer, intent(inout) :: ipar(*), istat
        end subroutine f77_direction

        !> Several terms at once.
        subroutine f77_evaluate(need, n, nh, nd, t, q, qd, phi, c, anu, gam, am, f, rpar, ipar, istat)
            import :: wp
            implicit none (type, external)
            !> Requested terms, a sum of need bits; numbers of coordinates, holonomic and nonholonomic constraints.
            integer, intent(in) :: need, n, nh, nd
            real(wp), intent(in) :: t, q(*), qd(*)
            !> PHI(NH), C(NH + ND, N), ANU(NH + ND), GAM(NH + ND), AM(N, N), F(N).
            real(wp), intent(inout) :: phi(*), c(*), anu(*), gam(*), am(*), f(*)
            real(wp), intent(inout) :: rpar(*)
            integer, intent(inout) :: ipar(*), istat
        end subroutine f77_evaluate
    end interface

    abstract interface
        !> `f77_evaluate` in the form in which it is called: arrays are passed by address, as in Fortran 77.
        subroutine f77_evaluate_by_address(need, n, nh, nd, t, q, qd, phi, c, anu, gam, am, f, rpar, ipar, istat) bind(C)
            import :: c_double, c_int, c_ptr
            implicit none (type, external)
            integer(c_int), intent(in) :: need, n, nh, nd
            real(c_double), intent(in) :: t, q(*), qd(*)
            type(c_ptr), value :: phi, c, anu, gam, am, f
            real(c_double), intent(inout) :: rpar(*)
            integer(c_int), intent(inout) :: ipar(*), istat
        end subroutine f77_evaluate_by_address
    end interface

    !> Model whose procedures are Fortran 77 subroutines.
    type, extends(callback_model_type) :: f77_model_type
        !> First entries of the arrays that the current call of the interface has passed.
        real(wp), pointer, contiguous, private :: rpar(:) => null()
        integer, pointer, contiguous, private :: ipar(:) => null()
    contains
        procedure :: call_one, call_fused
    end type f77_model_type

contains

    !> Address of a procedure; null for the placeholder TDNONE.
    type(c_funptr) function address_or_null(address)
        type(c_funptr), intent(in) :: address
        procedure(f77_position) :: tdnone

        address_or_null = address
        if (c_associated(address, c_funloc(tdnone))) address_or_null = c_null_funptr
    end function address_or_null

    !> Find the problem of a handle, which every subroutine of the interface does first. False, with a status, if the handle is
    !> invalid.
    logical function found(h, problem, ierr, rpar, ipar)
        integer, intent(in) :: h(4)
        type(problem_type), pointer, intent(out) :: problem
        integer, intent(out) :: ierr
        !> Arrays for the procedures of the model, used until the next call with these arguments.
        real(wp), intent(inout), target, optional :: rpar(1)
        integer, intent(inout), target, optional :: ipar(1)

        ierr = status_invalid_option
        call problem_of(to_address(h), problem)
        found = associated(problem)
        if (.not. (found .and. present(rpar) .and. present(ipar))) return
        if (problem%busy) return
        select type (model => problem%callbacks)
        class is (f77_model_type)
            model%rpar => rpar
            model%ipar => ipar
        end select
    end function found

    subroutine call_one(self, address, kind, rows, t, q, v, value, stat)
        class(f77_model_type), intent(inout) :: self
        type(c_funptr), intent(in) :: address
        integer, intent(in) :: kind, rows
        real(wp), intent(in) :: t, q(*), v(*)
        real(wp), intent(inout) :: value(*)
        integer, intent(out) :: stat
        procedure(f77_position), pointer :: position
        procedure(f77_motion), pointer :: motion

        stat = 0
        if (kind == of_position) then
            call c_f_procpointer(address, position)
            call position(self%n, rows, t, q, value, self%rpar, self%ipar, stat)
        else
            call c_f_procpointer(address, motion)
            call motion(self%n, rows, t, q, v, value, self%rpar, self%ipar, stat)
        end if
    end subroutine call_one

    subroutine call_fused(self, need, t, q, qd, ptr, stat)
        class(f77_model_type), intent(inout) :: self
        integer, intent(in) :: need
        real(wp), intent(in) :: t, q(*), qd(*)
        type(c_ptr), intent(in) :: ptr(n_terms)
        integer, intent(out) :: stat
        procedure(f77_evaluate_by_address), pointer :: evaluate

        stat = 0
        call c_f_procpointer(self%fused, evaluate)
        call evaluate(need, self%n, self%n_holonomic, self%n_nonholonomic, t, q, qd, ptr(1), ptr(2), ptr(3), ptr(4), &
            ptr(5), ptr(6), self%rpar, self%ipar, stat)
    end subroutine call_fused
end module tandem_legacy_f77_model
