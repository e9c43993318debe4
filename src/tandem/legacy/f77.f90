! SPDX-License-Identifier: MIT
! The Fortran 77 interface: external subroutines, so that callers need no module. doc/linking.md describes them, and
! include/tandem.inc contains the named constants. Names have at most six characters, as the language requires.
!
! H(4) is a handle and IERR the status. RPAR and IPAR are passed to the procedures of the model in all calls that may call them.
! include/interface.txt lists the public part of this file.

!> Version of the interface, to be compared with TDIVER of the include file.
subroutine tdvers(iver)
    use tandem_legacy_version, only: interface_version
    implicit none (type, external)
    integer, intent(out) :: iver

    iver = interface_version
end subroutine tdvers

!> Create a problem with N coordinates, NH holonomic and ND nonholonomic constraints.
subroutine tdnew(h, n, nh, nd, ierr)
    use tandem_legacy_callback_model, only: callback_model_type
    use tandem_legacy_f77_model, only: f77_model_type
    use tandem_legacy_handle, only: new_handle, to_handle
    use tandem_status, only: status_invalid_model
    implicit none (type, external)
    integer, intent(out) :: h(4)
    integer, intent(in) :: n, nh, nd
    integer, intent(out) :: ierr
    type(f77_model_type), pointer :: model
    class(callback_model_type), pointer :: callback_model
    integer :: stat

    h = 0
    ierr = status_invalid_model
    allocate (model, stat=stat)
    if (stat /= 0) return
    callback_model => model
    call to_handle(new_handle(callback_model, n, nh, nd, ierr), h)
end subroutine tdnew

!> Free a problem. The handle becomes zero.
subroutine tdfree(h, ierr)
    use tandem_legacy_handle, only: free_handle, problem_of, to_address
    use tandem_legacy_problem, only: problem_type
    use tandem_status, only: status_invalid_option, status_ok
    implicit none (type, external)
    integer, intent(inout) :: h(4)
    integer, intent(out) :: ierr
    type(problem_type), pointer :: problem

    ierr = status_invalid_option
    call problem_of(to_address(h), problem)
    if (.not. associated(problem)) return
    if (.not. free_handle(to_address(h))) then
        ierr = problem%stat
        return
    end if
    h = 0
    ierr = status_ok
end subroutine tdfree

!> Return the message of the last IERR.
subroutine tdtext(h, text)
    use tandem_legacy_description, only: message_length, message_of_no_problem
    use tandem_legacy_handle, only: problem_of, to_address
    use tandem_legacy_problem, only: problem_type
    use, intrinsic :: iso_c_binding, only: c_null_char
    implicit none (type, external)
    integer, intent(in) :: h(4)
    character(len=*), intent(out) :: text
    type(problem_type), pointer :: problem
    integer :: i

    call problem_of(to_address(h), problem)
    text = message_of_no_problem
    if (.not. associated(problem)) return
    text = ' '
    do i = 1, message_length
        if (problem%message(i) == c_null_char) exit
        if (i <= len(text)) text(i:i) = problem%message(i)
    end do
    ! Indicate that the text is truncated.
    if (i - 1 > len(text)) text(max(1, len(text) - 2):) = '...'
end subroutine tdtext

!> Set a procedure of (T, Q): the subroutine SUB(N, M, T, Q, VAL, RPAR, IPAR, ISTAT), or TDNONE.
subroutine tdpos(h, name, sub, ierr)
    use tandem_legacy_f77_model, only: f77_position, found, problem_type, address_or_null
    use tandem_legacy_terms, only: of_position
    use, intrinsic :: iso_c_binding, only: c_funloc
    implicit none (type, external)
    integer, intent(in) :: h(4)
    character(len=*), intent(in) :: name
    procedure(f77_position) :: sub
    integer, intent(out) :: ierr
    type(problem_type), pointer :: problem

    if (.not. found(h, problem, ierr)) return
    call problem%set_procedure(name, of_position, address_or_null(c_funloc(sub)))
    ierr = problem%stat
end subroutine tdpos

!> Set a procedure of (T, Q, QD): the subroutine SUB(N, M, T, Q, QD, VAL, RPAR, IPAR, ISTAT), or TDNONE.
subroutine tdmot(h, name, sub, ierr)
    use tandem_legacy_f77_model, only: f77_motion, found, problem_type, address_or_null
    use tandem_legacy_terms, only: of_motion
    use, intrinsic :: iso_c_binding, only: c_funloc
    implicit none (type, external)
    integer, intent(in) :: h(4)
    character(len=*), intent(in) :: name
    procedure(f77_motion) :: sub
    integer, intent(out) :: ierr
    type(problem_type), pointer :: problem

    if (.not. found(h, problem, ierr)) return
    call problem%set_procedure(name, of_motion, address_or_null(c_funloc(sub)))
    ierr = problem%stat
end subroutine tdmot

!> Set a procedure of (T, Q, X): the subroutine SUB(N, M, T, Q, X, VAL, RPAR, IPAR, ISTAT), or TDNONE.
subroutine tddir(h, name, sub, ierr)
    use tandem_legacy_f77_model, only: f77_direction, found, problem_type, address_or_null
    use tandem_legacy_terms, only: of_direction
    use, intrinsic :: iso_c_binding, only: c_funloc
    implicit none (type, external)
    integer, intent(in) :: h(4)
    character(len=*), intent(in) :: name
    procedure(f77_direction) :: sub
    integer, intent(out) :: ierr
    type(problem_type), pointer :: problem

    if (.not. found(h, problem, ierr)) return
    call problem%set_procedure(name, of_direction, address_or_null(c_funloc(sub)))
    ierr = problem%stat
end subroutine tddir

!> Set a procedure of several terms, SUB(NEED, N, NH, ND, T, Q, QD, PHI, C, ANU, GAM, AM, F, RPAR, IPAR, ISTAT), or TDNONE. IPROV is
!> the sum of the constants of the terms that it provides; ignored with TDNONE.
subroutine tdeval(h, sub, iprov, ierr)
    use tandem_legacy_f77_model, only: f77_evaluate, found, problem_type, address_or_null
    use, intrinsic :: iso_c_binding, only: c_funloc
    implicit none (type, external)
    integer, intent(in) :: h(4)
    procedure(f77_evaluate) :: sub
    integer, intent(in) :: iprov
    integer, intent(out) :: ierr
    type(problem_type), pointer :: problem

    if (.not. found(h, problem, ierr)) return
    call problem%set_evaluate(address_or_null(c_funloc(sub)), iprov)
    ierr = problem%stat
end subroutine tdeval

!> Set a real option.
subroutine tdsetr(h, name, value, ierr)
    use tandem_legacy_f77_model, only: found, problem_type, wp
    implicit none (type, external)
    integer, intent(in) :: h(4)
    character(len=*), intent(in) :: name
    real(wp), intent(in) :: value
    integer, intent(out) :: ierr
    type(problem_type), pointer :: problem

    if (.not. found(h, problem, ierr)) return
    call problem%set(name, number=value)
    ierr = problem%stat
end subroutine tdsetr

!> Set an integer option.
subroutine tdseti(h, name, ivalue, ierr)
    use tandem_legacy_f77_model, only: found, problem_type
    implicit none (type, external)
    integer, intent(in) :: h(4)
    character(len=*), intent(in) :: name
    integer, intent(in) :: ivalue
    integer, intent(out) :: ierr
    type(problem_type), pointer :: problem

    if (.not. found(h, problem, ierr)) return
    call problem%set(name, whole=ivalue)
    ierr = problem%stat
end subroutine tdseti

!> Set an option whose value is a word.
subroutine tdsets(h, name, word, ierr)
    use tandem_legacy_f77_model, only: found, problem_type
    implicit none (type, external)
    integer, intent(in) :: h(4)
    character(len=*), intent(in) :: name, word
    integer, intent(out) :: ierr
    type(problem_type), pointer :: problem

    if (.not. found(h, problem, ierr)) return
    call problem%set(name, word=word)
    ierr = problem%stat
end subroutine tdsets

!> Set a list of K numbers.
subroutine tdsetv(h, name, k, values, ierr)
    use tandem_legacy_f77_model, only: found, problem_type, wp
    implicit none (type, external)
    integer, intent(in) :: h(4)
    character(len=*), intent(in) :: name
    integer, intent(in) :: k
    real(wp), intent(in) :: values(*)
    integer, intent(out) :: ierr
    type(problem_type), pointer :: problem

    if (.not. found(h, problem, ierr)) return
    if (k < 0) then
        call problem%refuse('the list "'//trim(name)//'" has a negative number of entries', 'pass their number')
    else
        call problem%set_vector(name, values(:k))
    end if
    ierr = problem%stat
end subroutine tdsetv

!> Set the name of constraint row I, from 1, holonomic rows first.
subroutine tdrow(h, i, name, ierr)
    use tandem_legacy_f77_model, only: found, problem_type
    implicit none (type, external)
    integer, intent(in) :: h(4), i
    character(len=*), intent(in) :: name
    integer, intent(out) :: ierr
    type(problem_type), pointer :: problem

    if (.not. found(h, problem, ierr)) return
    call problem%set_row_name(i, name)
    ierr = problem%stat
end subroutine tdrow

!> Add an event at which entry I of QUANT (q, qd or lambda) reaches VALUE. IDIR: 1 rising, -1 falling, 0 both. If ISTOP is not 0,
!> the run ends at the event.
subroutine tdevnt(h, name, quant, i, value, idir, istop, ierr)
    use tandem_legacy_f77_model, only: found, problem_type, wp
    implicit none (type, external)
    integer, intent(in) :: h(4), i, idir, istop
    character(len=*), intent(in) :: name, quant
    real(wp), intent(in) :: value
    integer, intent(out) :: ierr
    type(problem_type), pointer :: problem

    if (.not. found(h, problem, ierr)) return
    call problem%add_event(name, idir, istop, quant, i, value)
    ierr = problem%stat
end subroutine tdevnt

!> Add an event at zeros of VAL(1), as set by SUB(N, M, T, Q, QD, VAL, RPAR, IPAR, ISTAT) with M = 1. IDIR and ISTOP as in TDEVNT.
subroutine tdevfn(h, name, sub, idir, istop, ierr)
    use tandem_legacy_f77_model, only: f77_motion, found, problem_type, address_or_null
    use, intrinsic :: iso_c_binding, only: c_funloc
    implicit none (type, external)
    integer, intent(in) :: h(4), idir, istop
    character(len=*), intent(in) :: name
    procedure(f77_motion) :: sub
    integer, intent(out) :: ierr
    type(problem_type), pointer :: problem

    if (.not. found(h, problem, ierr)) return
    call problem%add_event(name, idir, istop, function_=address_or_null(c_funloc(sub)))
    ierr = problem%stat
end subroutine tdevfn

!> Remove all events. Takes effect at the next start.
subroutine tdevcl(h, ierr)
    use tandem_legacy_f77_model, only: found, problem_type
    implicit none (type, external)
    integer, intent(in) :: h(4)
    integer, intent(out) :: ierr
    type(problem_type), pointer :: problem

    if (.not. found(h, problem, ierr)) return
    call problem%clear_events()
    ierr = problem%stat
end subroutine tdevcl

!> Return the number of recorded events.
subroutine tdnevt(h, n, ierr)
    use tandem_legacy_f77_model, only: found, problem_type
    implicit none (type, external)
    integer, intent(in) :: h(4)
    integer, intent(out) :: n, ierr
    type(problem_type), pointer :: problem

    n = 0
    if (.not. found(h, problem, ierr)) return
    call problem%count_events(n)
    ierr = problem%stat
end subroutine tdnevt

!> Return recorded event I in the order of time: index NUMBER of the event, direction IDIR in which its function passed through
!> zero, time T, and state Q(N), QD(N).
subroutine tdgevt(h, i, number, idir, t, q, qd, ierr)
    use tandem_legacy_f77_model, only: found, problem_type, wp
    implicit none (type, external)
    integer, intent(in) :: h(4), i
    integer, intent(out) :: number, idir
    real(wp), intent(out) :: t
    real(wp), intent(inout) :: q(*), qd(*)
    integer, intent(out) :: ierr
    type(problem_type), pointer :: problem

    number = 0
    idir = 0
    t = 0.0_wp
    if (.not. found(h, problem, ierr)) return
    call problem%get_event(i, number, idir, t, q, qd)
    ierr = problem%stat
end subroutine tdgevt

!> Return the index of the event that has stopped the run; 0 if none has.
subroutine tdstop(h, number, ierr)
    use tandem_legacy_f77_model, only: found, problem_type
    implicit none (type, external)
    integer, intent(in) :: h(4)
    integer, intent(out) :: number, ierr
    type(problem_type), pointer :: problem

    number = 0
    if (.not. found(h, problem, ierr)) return
    call problem%get_stop(number)
    ierr = problem%stat
end subroutine tdstop

!> Record the run from its start to TEND, for an estimate of its error.
subroutine tdwerr(h, tend, ierr)
    use tandem_legacy_f77_model, only: found, problem_type, wp
    implicit none (type, external)
    integer, intent(in) :: h(4)
    real(wp), intent(in) :: tend
    integer, intent(out) :: ierr
    type(problem_type), pointer :: problem

    if (.not. found(h, problem, ierr)) return
    call problem%watch_error(tend)
    ierr = problem%stat
end subroutine tdwerr

!> Estimate the error of the recorded run by a second run.
subroutine tdeerr(h, rpar, ipar, ierr)
    use tandem_legacy_f77_model, only: found, problem_type, wp
    implicit none (type, external)
    integer, intent(in) :: h(4)
    real(wp), intent(inout) :: rpar(*)
    integer, intent(inout) :: ipar(*)
    integer, intent(out) :: ierr
    type(problem_type), pointer :: problem

    if (.not. found(h, problem, ierr, rpar, ipar)) return
    call problem%estimate_error()
    ierr = problem%stat
end subroutine tdeerr

!> Compare the procedures of the model with differences of each other near T, Q(N), QD(N).
subroutine tdchck(h, t, q, qd, rpar, ipar, ierr)
    use tandem_legacy_f77_model, only: found, problem_type, wp
    implicit none (type, external)
    integer, intent(in) :: h(4)
    real(wp), intent(in) :: t, q(*), qd(*)
    real(wp), intent(inout) :: rpar(*)
    integer, intent(inout) :: ipar(*)
    integer, intent(out) :: ierr
    type(problem_type), pointer :: problem

    if (.not. found(h, problem, ierr, rpar, ipar)) return
    call problem%check(t, q, qd)
    ierr = problem%stat
end subroutine tdchck

!> Move Q(N), QD(N) to the nearest state at T that satisfies the constraints.
subroutine tdassm(h, t, q, qd, rpar, ipar, ierr)
    use tandem_legacy_f77_model, only: found, problem_type, wp
    implicit none (type, external)
    integer, intent(in) :: h(4)
    real(wp), intent(in) :: t
    real(wp), intent(inout) :: q(*), qd(*), rpar(*)
    integer, intent(inout) :: ipar(*)
    integer, intent(out) :: ierr
    type(problem_type), pointer :: problem

    if (.not. found(h, problem, ierr, rpar, ipar)) return
    call problem%assemble(t, q, qd)
    ierr = problem%stat
end subroutine tdassm

!> Start a run at T, Q(N), QD(N).
subroutine tdstrt(h, t, q, qd, rpar, ipar, ierr)
    use tandem_legacy_f77_model, only: found, problem_type, wp
    implicit none (type, external)
    integer, intent(in) :: h(4)
    real(wp), intent(in) :: t, q(*), qd(*)
    real(wp), intent(inout) :: rpar(*)
    integer, intent(inout) :: ipar(*)
    integer, intent(out) :: ierr
    type(problem_type), pointer :: problem

    if (.not. found(h, problem, ierr, rpar, ipar)) return
    call problem%start(t, q, qd)
    ierr = problem%stat
end subroutine tdstrt

!> Integrate to TEND; no action if this is the current time. T, Q(N), QD(N) return the state that was reached, also after a failure
!> before TEND.
subroutine tdintg(h, t, q, qd, tend, rpar, ipar, ierr)
    use tandem_legacy_f77_model, only: found, problem_type, wp
    implicit none (type, external)
    integer, intent(in) :: h(4)
    real(wp), intent(inout) :: t, q(*), qd(*)
    real(wp), intent(in) :: tend
    real(wp), intent(inout) :: rpar(*)
    integer, intent(inout) :: ipar(*)
    integer, intent(out) :: ierr
    type(problem_type), pointer :: problem

    if (.not. found(h, problem, ierr, rpar, ipar)) return
    call problem%integrate(tend)
    call problem%show_state(t, q, qd)
    ierr = problem%stat
end subroutine tdintg

!> Perform one accepted step that does not go beyond TLIM. T, Q(N), QD(N) return the state that was reached.
subroutine tdstep(h, t, q, qd, tlim, rpar, ipar, ierr)
    use tandem_legacy_f77_model, only: found, problem_type, wp
    implicit none (type, external)
    integer, intent(in) :: h(4)
    real(wp), intent(inout) :: t, q(*), qd(*)
    real(wp), intent(in) :: tlim
    real(wp), intent(inout) :: rpar(*)
    integer, intent(inout) :: ipar(*)
    integer, intent(out) :: ierr
    type(problem_type), pointer :: problem

    if (.not. found(h, problem, ierr, rpar, ipar)) return
    call problem%step(tlim)
    call problem%show_state(t, q, qd)
    ierr = problem%stat
end subroutine tdstep

!> Return the state Q(N), QD(N), QDD(N) at a time T within the last step.
subroutine tddens(h, t, q, qd, qdd, rpar, ipar, ierr)
    use tandem_legacy_f77_model, only: found, problem_type, wp
    implicit none (type, external)
    integer, intent(in) :: h(4)
    real(wp), intent(in) :: t
    real(wp), intent(inout) :: q(*), qd(*), qdd(*), rpar(*)
    integer, intent(inout) :: ipar(*)
    integer, intent(out) :: ierr
    type(problem_type), pointer :: problem

    if (.not. found(h, problem, ierr, rpar, ipar)) return
    call problem%get_state_at(t, q, qd, qdd)
    ierr = problem%stat
end subroutine tddens

!> Return the multipliers ALAM(NH + ND) at a time T within the last step.
subroutine tdlamb(h, t, alam, rpar, ipar, ierr)
    use tandem_legacy_f77_model, only: found, problem_type, wp
    implicit none (type, external)
    integer, intent(in) :: h(4)
    real(wp), intent(in) :: t
    real(wp), intent(inout) :: alam(*), rpar(*)
    integer, intent(inout) :: ipar(*)
    integer, intent(out) :: ierr
    type(problem_type), pointer :: problem

    if (.not. found(h, problem, ierr, rpar, ipar)) return
    call problem%get_multipliers(t, alam)
    ierr = problem%stat
end subroutine tdlamb

!> Return the kinetic and the potential energy of the current state.
subroutine tdener(h, ekin, epot, rpar, ipar, ierr)
    use tandem_legacy_f77_model, only: found, problem_type, wp
    implicit none (type, external)
    integer, intent(in) :: h(4)
    real(wp), intent(out) :: ekin, epot
    real(wp), intent(inout) :: rpar(*)
    integer, intent(inout) :: ipar(*)
    integer, intent(out) :: ierr
    type(problem_type), pointer :: problem

    ekin = 0.0_wp
    epot = 0.0_wp
    if (.not. found(h, problem, ierr, rpar, ipar)) return
    call problem%get_energies(ekin, epot)
    ierr = problem%stat
end subroutine tdener

!> Return one statistic of the run.
subroutine tdstat(h, name, value, ierr)
    use tandem_legacy_f77_model, only: found, problem_type, wp
    implicit none (type, external)
    integer, intent(in) :: h(4)
    character(len=*), intent(in) :: name
    real(wp), intent(out) :: value
    integer, intent(out) :: ierr
    type(problem_type), pointer :: problem

    value = 0.0_wp
    if (.not. found(h, problem, ierr)) return
    call problem%get_statistic(name, value)
    ierr = problem%stat
end subroutine tdstat

!> Return the number of warnings of the run.
subroutine tdnwrn(h, nwarn, ierr)
    use tandem_legacy_f77_model, only: found, problem_type
    implicit none (type, external)
    integer, intent(in) :: h(4)
    integer, intent(out) :: nwarn, ierr
    type(problem_type), pointer :: problem

    nwarn = 0
    if (.not. found(h, problem, ierr)) return
    call problem%count_warnings(nwarn)
    ierr = problem%stat
end subroutine tdnwrn

!> Return the text of warning I, from 1, truncated to the length of TEXT.
subroutine tdwarn(h, i, text, ierr)
    use tandem_legacy_f77_model, only: found, problem_type
    implicit none (type, external)
    integer, intent(in) :: h(4), i
    character(len=*), intent(out) :: text
    integer, intent(out) :: ierr
    type(problem_type), pointer :: problem
    character(len=:), allocatable :: warning

    text = ' '
    if (.not. found(h, problem, ierr)) return
    call problem%get_warning(i, warning)
    text = warning
    ierr = problem%stat
end subroutine tdwarn

!> Save the run in the integers ISAVE(NSAVE), of which N are used. With NSAVE = 0 only N is returned.
subroutine tdsave(h, nsave, isave, n, ierr)
    use tandem_error, only: to_text
    use tandem_kinds, only: long
    use tandem_legacy_f77_model, only: found, problem_type
    implicit none (type, external)
    integer, intent(in) :: h(4), nsave
    integer, intent(inout) :: isave(*)
    integer, intent(out) :: n, ierr
    type(problem_type), pointer :: problem
    integer(long), allocatable :: words(:)
    integer :: needed

    needed = 0
    if (found(h, problem, ierr)) then
        call problem%save_state(words)
        if (allocated(words)) then
            needed = size(words)*(storage_size(words)/storage_size(needed))
            if (nsave >= needed) then
                isave(:needed) = transfer(words, isave(1), needed)
            else if (nsave /= 0) then
                call problem%refuse('the state takes '//to_text(needed)//' integers, and the capacity is '//to_text(nsave), &
                    'call TDSAVE with NSAVE = 0 for the required capacity')
            end if
        end if
        ierr = problem%stat
    end if
    ! Set N last, because callers may pass the same variable for NSAVE and N.
    n = needed
end subroutine tdsave

!> Restore the run that TDSAVE has stored in ISAVE(N).
subroutine tdrest(h, n, isave, ierr)
    use tandem_kinds, only: long
    use tandem_legacy_f77_model, only: found, problem_type
    implicit none (type, external)
    integer, intent(in) :: h(4), n, isave(*)
    integer, intent(out) :: ierr
    type(problem_type), pointer :: problem
    integer(long) :: word(1)

    if (.not. found(h, problem, ierr)) return
    if (n < 0 .or. modulo(n, 2) /= 0) then
        call problem%refuse('the state has a negative or an odd number of integers', 'pass the integers saved by TDSAVE')
    else
        call problem%restore_state(transfer(isave(:n), word))
    end if
    ierr = problem%stat
end subroutine tdrest

!> Return the index of the current smooth piece of the model's functions of time: 1 before the first breakpoint, 0 for an invalid H.
!> The procedures of the model may call this subroutine.
subroutine tdsegm(h, iseg)
    use tandem_legacy_handle, only: problem_of, to_address
    use tandem_legacy_problem, only: problem_type
    implicit none (type, external)
    integer, intent(in) :: h(4)
    integer, intent(out) :: iseg
    type(problem_type), pointer :: problem

    iseg = 0
    call problem_of(to_address(h), problem)
    if (.not. associated(problem)) return
    if (associated(problem%model)) iseg = problem%model%segment
end subroutine tdsegm
