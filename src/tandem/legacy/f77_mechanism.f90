! SPDX-License-Identifier: MIT
! Fortran 77 interface to mechanisms that are described by keys; f77.f90 contains the other subroutines. Trailing blanks of keys and
! values are ignored.

!> Create a problem for a mechanism.
subroutine tdmech(h, ierr)
    use tandem_legacy_callback_model, only: callback_model_type
    use tandem_legacy_f77_model, only: f77_model_type, found, problem_type
    use tandem_legacy_handle, only: new_handle, to_handle
    use tandem_status, only: status_invalid_model
    implicit none (type, external)
    integer, intent(out) :: h(4), ierr
    type(f77_model_type), pointer :: model
    class(callback_model_type), pointer :: callback_model
    type(problem_type), pointer :: problem
    integer :: stat

    h = 0
    ierr = status_invalid_model
    allocate (model, stat=stat)
    if (stat /= 0) return
    callback_model => model
    call to_handle(new_handle(callback_model, 0, 0, 0, stat), h)
    if (.not. found(h, problem, ierr)) return
    call problem%set_up_mechanism()
    ierr = problem%stat
end subroutine tdmech

!> Set key KEY to a value in the syntax of scene files: '1.5', '"a text"', 'true', '[0, "l/2"]'.
subroutine tdkey(h, key, value, ierr)
    use tandem_legacy_mechanism_keys, only: set_key
    use tandem_legacy_f77_model, only: found, problem_type
    implicit none (type, external)
    integer, intent(in) :: h(4)
    character(len=*), intent(in) :: key, value
    integer, intent(out) :: ierr
    type(problem_type), pointer :: problem

    if (.not. found(h, problem, ierr)) return
    call set_key(problem, key, trim(value))
    ierr = problem%stat
end subroutine tdkey

!> Set key KEY to the number X.
subroutine tdknum(h, key, x, ierr)
    use tandem_legacy_mechanism_keys, only: set_value
    use tandem_legacy_f77_model, only: found, problem_type, wp
    use tandem_mechanism_entries, only: number_value
    implicit none (type, external)
    integer, intent(in) :: h(4)
    character(len=*), intent(in) :: key
    real(wp), intent(in) :: x
    integer, intent(out) :: ierr
    type(problem_type), pointer :: problem

    if (.not. found(h, problem, ierr)) return
    call set_value(problem, key, number_value(x))
    ierr = problem%stat
end subroutine tdknum

!> Set key KEY to the text TEXT, given without quotes: a word, a name, or an expression.
subroutine tdktxt(h, key, text, ierr)
    use tandem_legacy_mechanism_keys, only: set_value
    use tandem_legacy_f77_model, only: found, problem_type
    use tandem_mechanism_entries, only: text_value
    implicit none (type, external)
    integer, intent(in) :: h(4)
    character(len=*), intent(in) :: key, text
    integer, intent(out) :: ierr
    type(problem_type), pointer :: problem

    if (.not. found(h, problem, ierr)) return
    call set_value(problem, key, text_value(trim(text)))
    ierr = problem%stat
end subroutine tdktxt

!> Set key KEY to the list of numbers X(N).
subroutine tdkvec(h, key, n, x, ierr)
    use tandem_legacy_mechanism_keys, only: set_value
    use tandem_legacy_f77_model, only: found, problem_type, wp
    use tandem_mechanism_entries, only: value_type
    implicit none (type, external)
    integer, intent(in) :: h(4)
    character(len=*), intent(in) :: key
    integer, intent(in) :: n
    real(wp), intent(in) :: x(*)
    integer, intent(out) :: ierr
    type(problem_type), pointer :: problem
    type(value_type) :: list
    integer :: i, stat

    if (.not. found(h, problem, ierr)) return
    stat = 0
    if (n >= 0) allocate (list%atoms(n), stat=stat)
    if (n < 0 .or. stat /= 0) then
        call problem%refuse('the list of '//trim(key)//' has an invalid length', 'pass the number of its entries')
    else
        list%is_list = .true.
        do i = 1, n
            list%atoms(i)%number = x(i)
        end do
        call set_value(problem, key, list)
    end if
    ierr = problem%stat
end subroutine tdkvec

!> Build the mechanism from its keys. If IPLAN is not 0, it is planar. If IOPEN is not 0, joints may be open in the reference
!> configuration. Kinks of functions of time are searched between T0 and T1.
subroutine tddefn(h, iplan, iopen, t0, t1, ierr)
    use tandem_legacy_mechanism_keys, only: define_mechanism
    use tandem_legacy_f77_model, only: found, problem_type, wp
    implicit none (type, external)
    integer, intent(in) :: h(4), iplan, iopen
    real(wp), intent(in) :: t0, t1
    integer, intent(out) :: ierr
    type(problem_type), pointer :: problem

    if (.not. found(h, problem, ierr)) return
    call define_mechanism(problem, iplan /= 0, iopen /= 0, [t0, t1])
    ierr = problem%stat
end subroutine tddefn

!> Return the numbers of coordinates, holonomic and nonholonomic constraints; zeros before the mechanism is built.
subroutine tdsize(h, n, nh, nd, ierr)
    use tandem_legacy_f77_model, only: found, problem_type
    implicit none (type, external)
    integer, intent(in) :: h(4)
    integer, intent(out) :: n, nh, nd, ierr
    type(problem_type), pointer :: problem

    n = 0
    nh = 0
    nd = 0
    if (.not. found(h, problem, ierr)) return
    if (problem%is_free()) then
        n = problem%callbacks%n
        nh = problem%callbacks%n_holonomic
        nd = problem%callbacks%n_nonholonomic
        call problem%succeed()
    end if
    ierr = problem%stat
end subroutine tdsize

!> Return the state Q(N), QD(N) of the reference configuration.
subroutine tddraw(h, q, qd, ierr)
    use tandem_legacy_mechanism_keys, only: get_reference_state
    use tandem_legacy_f77_model, only: found, problem_type, wp
    implicit none (type, external)
    integer, intent(in) :: h(4)
    real(wp), intent(inout) :: q(*), qd(*)
    integer, intent(out) :: ierr
    type(problem_type), pointer :: problem

    if (.not. found(h, problem, ierr)) return
    call get_reference_state(problem, q, qd)
    ierr = problem%stat
end subroutine tddraw

!> Return the name of coordinate I (WHAT = 'coordinate'), its unit ('unit'), or the name of constraint row I ('row'). I is from 1.
subroutine tdname(h, what, i, text, ierr)
    use tandem_legacy_mechanism_keys, only: get_name
    use tandem_legacy_f77_model, only: found, problem_type
    implicit none (type, external)
    integer, intent(in) :: h(4)
    character(len=*), intent(in) :: what
    integer, intent(in) :: i
    character(len=*), intent(out) :: text
    integer, intent(out) :: ierr
    type(problem_type), pointer :: problem
    character(len=:), allocatable :: name

    text = ' '
    if (.not. found(h, problem, ierr)) return
    call get_name(problem, trim(what), i, name)
    ierr = problem%stat
    if (allocated(name)) text = name
end subroutine tdname
