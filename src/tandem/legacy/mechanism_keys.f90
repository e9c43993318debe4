! SPDX-License-Identifier: MIT
!> Problems whose model is a mechanism: keys are set one by one, then the mechanism is built and can be queried.
module tandem_legacy_mechanism_keys
    use tandem_error, only: error_type
    use tandem_kinds, only: wp
    use tandem_legacy_description, only: description_type
    use tandem_legacy_value_text, only: read_value
    use tandem_mechanism, only: mechanism_type
    use tandem_mechanism_description, only: build_mechanism
    use tandem_mechanism_entries, only: value_type
    use tandem_mechanism_shown, only: shown_type
    use, intrinsic :: ieee_arithmetic, only: ieee_is_finite
    implicit none (type, external)
    private

    public :: set_key, set_value, define_mechanism, get_reference_state, get_name

contains

    !> Set a key to a value given as text. A later value replaces an earlier one.
    subroutine set_key(problem, key, text)
        class(description_type), intent(inout) :: problem
        !> Key, such as body.rod.mass; trailing blanks are ignored.
        character(len=*), intent(in) :: key
        !> Value in the syntax of scene files: a number, "a text", true, false, or a list of these in brackets.
        character(len=*), intent(in) :: text
        type(value_type) :: value
        logical :: is_good

        call read_value(text, value, is_good)
        if (is_good) then
            call set_value(problem, key, value)
        else if (problem%is_free()) then
            if (.not. is_open(problem)) return
            call problem%refuse('the value '//text//' of '//trim(key)//' cannot be read', &
                'use a number, "a string", true, false, or a list of these in brackets')
        end if
    end subroutine set_key

    !> Set the value of a key.
    subroutine set_value(problem, key, value)
        class(description_type), intent(inout) :: problem
        !> Key, as in `set_key`.
        character(len=*), intent(in) :: key
        type(value_type), intent(in) :: value

        if (.not. problem%is_free()) return
        if (.not. is_open(problem)) return
        if (len_trim(key) == 0) then
            call problem%refuse('the key is empty', 'give one such as body.rod.mass')
        else if (.not. all(ieee_is_finite(value%atoms%number))) then
            call problem%refuse('the value of '//trim(key)//' is not finite', 'give a number')
        else
            call problem%keys%set(trim(key), value)
            call problem%succeed()
        end if
    end subroutine set_value

    !> False, with a status, if keys cannot be set in the problem.
    logical function is_open(problem)
        class(description_type), intent(inout) :: problem

        is_open = problem%is_mechanism .and. .not. associated(problem%model)
        if (is_open) return
        if (problem%is_mechanism) then
            call problem%refuse('the mechanism is complete', 'create another problem for another mechanism')
        else
            call problem%refuse('the problem is not a mechanism', 'create it by tandem_new_mechanism or TDMECH')
        end if
    end function is_open

    !> Build the mechanism from its keys. After a failure, keys can be corrected and the call repeated.
    subroutine define_mechanism(problem, planar, may_be_open, times)
        class(description_type), intent(inout) :: problem
        !> True for a planar mechanism; true if joints may be open in the reference configuration, because the start will be
        !> assembled.
        logical, intent(in) :: planar, may_be_open
        !> Start and end of the runs (s), between which kinks of functions of time are searched.
        real(wp), intent(in) :: times(2)
        type(mechanism_type), pointer :: mechanism
        type(shown_type), allocatable :: shown(:)
        type(error_type), allocatable :: error
        integer :: place

        if (.not. problem%is_free()) return
        if (.not. is_open(problem)) return
        allocate (mechanism)
        call build_mechanism(problem%keys, planar, may_be_open, times, mechanism, error, place, shown)
        if (allocated(error)) then
            deallocate (mechanism)
        else
            problem%model => mechanism
            problem%callbacks%n = mechanism%n
            problem%callbacks%n_holonomic = mechanism%n_holonomic
            problem%callbacks%n_nonholonomic = mechanism%n_nonholonomic
        end if
        call problem%conclude(error)
    end subroutine define_mechanism

    !> Coordinates and velocities of the reference configuration.
    subroutine get_reference_state(problem, q, qd)
        class(description_type), intent(inout) :: problem
        !> Coordinates and velocities (n).
        real(wp), intent(inout) :: q(*), qd(*)

        if (.not. is_complete(problem)) return
        select type (model => problem%model)
        type is (mechanism_type)
            call model%start(q(:model%n), qd(:model%n))
        end select
        call problem%succeed()
    end subroutine get_reference_state

    !> Name or unit of a coordinate, or name of a row.
    subroutine get_name(problem, what, i, text)
        class(description_type), intent(inout) :: problem
        !> 'coordinate', 'unit' or 'row'.
        character(len=*), intent(in) :: what
        !> Index from 1.
        integer, intent(in) :: i
        character(len=:), allocatable, intent(out) :: text
        integer :: n

        text = ''
        if (.not. is_complete(problem)) return
        associate (model => problem%model)
            n = model%n
            if (what == 'row') n = model%n_constraints()
            if (all(what /= [character(len=10) :: 'coordinate', 'unit', 'row'])) then
                call problem%refuse('there are no names of "'//what//'"', 'use coordinate, unit or row')
            else if (i < 1 .or. i > n) then
                call problem%refuse('there is no such '//trim(what), 'numbers start at the first one')
            else
                select case (what)
                case ('coordinate'); text = model%coordinate_label(i)
                case ('unit'); text = trim(model%unit_of_coordinate(i))
                case default; text = model%row_name(i)
                end select
                call problem%succeed()
            end if
        end associate
    end subroutine get_name

    !> False, with a status, if the mechanism has not been built.
    logical function is_complete(problem)
        class(description_type), intent(inout) :: problem

        is_complete = problem%is_free()
        if (.not. is_complete) return
        is_complete = problem%is_mechanism .and. associated(problem%model)
        if (.not. is_complete) call problem%refuse('there is no complete mechanism', 'call tandem_define or TDDEFN after its keys')
    end function is_complete
end module tandem_legacy_mechanism_keys
