! SPDX-License-Identifier: MIT
!> Options by name, for callers without access to `options_type`. Names are those of the table of options, in upper or lower case.
!> An invalid value is refused at once, and the option is unchanged. Contradictions between options are reported at the start of a
!> run.
module tandem_legacy_settings
    use tandem_error, only: error_type, set_error, to_text
    use tandem_kinds, only: wp
    use tandem_names, only: lower_case
    use tandem_options, only: check_word, option_row_type, option_visitor_type, options_type
    use tandem_simulate_assembly, only: assembly_type, velocity_metrics
    use tandem_status, only: status_invalid_option
    use, intrinsic :: ieee_arithmetic, only: ieee_is_finite
    implicit none (type, external)
    private

    public :: set_option, copy_flags, copy_list

    !> Visitor of the table of options that sets the option with a given name to a value, which has one of four types.
    type, extends(option_visitor_type) :: setter_type
        character(len=:), allocatable :: name
        real(wp), allocatable :: number
        integer, allocatable :: whole
        character(len=:), allocatable :: word
        real(wp), allocatable :: list(:)
        logical :: found = .false.
        !> Names of the options of this type, for messages.
        character(len=:), allocatable :: known
        type(error_type), allocatable :: error
    contains
        procedure :: take => set_if_named
    end type setter_type

contains

    !> Set an option of a run, or of the assembly of a start, to a number, an integer, a word or a list.
    subroutine set_option(options, assembly, name, error, number, whole, word, list)
        type(options_type), intent(inout) :: options
        type(assembly_type), intent(inout) :: assembly
        !> Name of an option, in upper or lower case.
        character(len=*), intent(in) :: name
        !> invalid_option if there is no such option of this type, or if the value is invalid.
        type(error_type), allocatable, intent(out) :: error
        real(wp), intent(in), optional :: number
        integer, intent(in), optional :: whole
        !> Word in upper or lower case.
        character(len=*), intent(in), optional :: word
        !> List; an empty list removes the values.
        real(wp), intent(in), optional :: list(:)
        type(options_type) :: changed
        type(setter_type) :: setter
        !> Type of the value; names of this type that the problem itself handles.
        character(len=:), allocatable :: kind, others
        logical :: taken

        call set_assembly(assembly, lower_case(name), taken, error, number, word, list)
        if (taken) return
        setter%name = lower_case(name)
        setter%known = ''
        if (present(number)) then
            kind = 'a real option'
            others = ', largest_move_q, largest_move_qd'
            setter%number = number
        else if (present(whole)) then
            kind = 'an integer option'
            setter%whole = whole
            others = ', constant_mass'
        else if (present(word)) then
            kind = 'a text option'
            others = ', velocity_metric'
            setter%word = lower_case(word)
        else
            kind = 'a list of numbers'
            setter%list = list
            others = ', coordinate_scale, breakpoints, nu_jumps, mass_blocks, weight_q, weight_qd, fixed_q, fixed_qd'
        end if
        changed = options
        call changed%visit(setter)
        if (.not. setter%found) then
            call set_error(error, status_invalid_option, '"'//trim(name)//'" is not '//kind, 'there are '// &
                setter%known(3:)//others)
        else if (allocated(setter%error)) then
            call move_alloc(setter%error, error)
        else
            call changed%check(error)
        end if
        if (.not. allocated(error)) options = changed
    end subroutine set_option

    subroutine set_if_named(self, row, number, whole, word, list, choices)
        class(setter_type), intent(inout) :: self
        type(option_row_type), intent(in) :: row
        real(wp), intent(inout), optional :: number
        integer, intent(inout), optional :: whole
        character(len=*), intent(inout), optional :: word
        real(wp), allocatable, intent(inout), optional :: list(:)
        character(len=*), intent(in), optional :: choices(:)

        if (.not. ((present(number) .and. allocated(self%number)) .or. (present(whole) .and. allocated(self%whole)) .or. &
            (present(word) .and. allocated(self%word)) .or. &
            (present(list) .and. .not. present(number) .and. allocated(self%list)))) return
        self%known = self%known//', '//trim(row%name)
        if (row%name /= self%name) return
        self%found = .true.
        if (present(number)) number = self%number
        if (present(whole)) whole = self%whole
        if (allocated(self%list)) then
            if (allocated(list)) deallocate (list)
            if (size(self%list) > 0) list = self%list
        end if
        if (.not. present(word)) return
        ! Check the word before it is truncated to the length of the option, which could make it valid.
        call check_word(row, self%word, choices, self%error)
        word = self%word
    end subroutine set_if_named

    !> Set an option of the assembly of a start to a number, a word or a list.
    subroutine set_assembly(assembly, name, taken, error, number, word, list)
        type(assembly_type), intent(inout) :: assembly
        !> Name in lower case.
        character(len=*), intent(in) :: name
        !> True if there is such an option.
        logical, intent(out) :: taken
        !> invalid_option if the value is invalid.
        type(error_type), allocatable, intent(out) :: error
        real(wp), intent(in), optional :: number
        character(len=*), intent(in), optional :: word
        real(wp), intent(in), optional :: list(:)

        taken = .true.
        if (present(list) .and. name == 'weight_q') then
            call copy_list(list, assembly%weight_q)
        else if (present(list) .and. name == 'weight_qd') then
            call copy_list(list, assembly%weight_qd)
        else if (present(list) .and. name == 'fixed_q') then
            call copy_flags(list, assembly%fixed_q)
        else if (present(list) .and. name == 'fixed_qd') then
            call copy_flags(list, assembly%fixed_qd)
        else if (present(number) .and. name == 'largest_move_q') then
            call set_limit(assembly%largest_move_q)
        else if (present(number) .and. name == 'largest_move_qd') then
            call set_limit(assembly%largest_move_qd)
        else if (present(word) .and. name == 'velocity_metric') then
            if (any(lower_case(word) == velocity_metrics)) then
                assembly%velocity_metric = lower_case(word)
            else
                call set_error(error, status_invalid_option, name//' = "'//trim(word)//'" is unknown', 'use mass or weights')
            end if
        else
            taken = .false.
        end if
    contains
        subroutine set_limit(limit)
            real(wp), intent(inout) :: limit

            if (number >= 0.0_wp .and. ieee_is_finite(number)) then
                limit = number
            else
                call set_error(error, status_invalid_option, name//' = '//to_text(number)//' must be positive, or 0 for no limit')
            end if
        end subroutine set_limit
    end subroutine set_assembly

    !> Copy a list; not allocated if the list is empty.
    pure subroutine copy_list(values, list)
        real(wp), intent(in) :: values(:)
        real(wp), allocatable, intent(inout) :: list(:)

        if (allocated(list)) deallocate (list)
        if (size(values) > 0) list = values
    end subroutine copy_list

    !> True for each nonzero number; not allocated if there are no numbers.
    pure subroutine copy_flags(values, flags)
        real(wp), intent(in) :: values(:)
        logical, allocatable, intent(inout) :: flags(:)

        if (allocated(flags)) deallocate (flags)
        if (size(values) > 0) flags = abs(values) > 0.0_wp
    end subroutine copy_flags
end module tandem_legacy_settings
