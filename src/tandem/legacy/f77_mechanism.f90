! SPDX-License-Identifier: MIT
! Subroutines of the Fortran 77 interface for mechanisms described by keys; the others are in f77.f90. Trailing blanks of keys and
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
    call problem%await_mechanism()
    ierr = problem%stat
end subroutine tdmech

!> Set the key KEY to a value as in scene files: '1.5', '"a text"', 'true', '[0, "l/2"]'.
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

!> Set the key KEY to the number X.
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

!> Set the key KEY to the text TEXT, without quotes: a word, a name, or an expression.
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

!> Set the key KEY to the list of numbers X(N).
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

!> Build the mechanism from its keys. IPLAN not 0: in the plane; IOPEN not 0: joints may be open in the reference configuration;
!> kinks of functions of time are searched from T0 to T1.
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

!> Numbers of coordinates, holonomic and nonholonomic constraints; zeros if there is no model yet.
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

!> State of the reference configuration, Q(N) and QD(N).
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

!> Name of coordinate I (WHAT = 'coordinate'), its unit ('unit'), or name of constraint row I ('row'), from 1.
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
