! SPDX-License-Identifier: MIT
!> Options by name, for callers who cannot see `options_type`. The names are those of the table of options, in either case. A value
!> that cannot be is refused at once, and the one before stays; how options go together is seen when a run starts.
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

    public :: set_option, take_flags, take_list

    !> Gives the option of a name its value, which is one of four kinds.
    type, extends(option_visitor_type) :: setter_type
        character(len=:), allocatable :: name
        real(wp), allocatable :: number
        integer, allocatable :: whole
        character(len=:), allocatable :: word
        real(wp), allocatable :: list(:)
        logical :: found = .false.
        !> The options of that kind, for messages.
        character(len=:), allocatable :: known
        type(error_type), allocatable :: error
    contains
        procedure :: take => set_if_named
    end type setter_type

contains

    !> Set an option, or what is asked of a start that is assembled, to one of a number, an integer, a word and a list.
    subroutine set_option(options, assembly, name, error, number, whole, word, list)
        type(options_type), intent(inout) :: options
        type(assembly_type), intent(inout) :: assembly
        !> Name of a component, in either case.
        character(len=*), intent(in) :: name
        !> invalid_option where there is no such option of that kind, or its value cannot be.
        type(error_type), allocatable, intent(out) :: error
        real(wp), intent(in), optional :: number
        integer, intent(in), optional :: whole
        !> In either case.
        character(len=*), intent(in), optional :: word
        !> No entries take the list back.
        real(wp), intent(in), optional :: list(:)
        type(options_type) :: changed
        type(setter_type) :: setter
        !> The kind, and what else there is of it, which the problem sets.
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
        ! Before it is cut to the room that the option has: a longer word must not become another.
        call check_word(row, self%word, choices, self%error)
        word = self%word
    end subroutine set_if_named

    !> Set what is asked of a start that is assembled, to one of a number, a word and a list.
    subroutine set_assembly(assembly, name, taken, error, number, word, list)
        type(assembly_type), intent(inout) :: assembly
        !> In lower case.
        character(len=*), intent(in) :: name
        !> Whether there is such a one.
        logical, intent(out) :: taken
        !> invalid_option where its value cannot be.
        type(error_type), allocatable, intent(out) :: error
        real(wp), intent(in), optional :: number
        character(len=*), intent(in), optional :: word
        real(wp), intent(in), optional :: list(:)

        taken = .true.
        if (present(list) .and. name == 'weight_q') then
            call take_list(list, assembly%weight_q)
        else if (present(list) .and. name == 'weight_qd') then
            call take_list(list, assembly%weight_qd)
        else if (present(list) .and. name == 'fixed_q') then
            call take_flags(list, assembly%fixed_q)
        else if (present(list) .and. name == 'fixed_qd') then
            call take_flags(list, assembly%fixed_qd)
        else if (present(number) .and. name == 'largest_move_q') then
            call take_limit(assembly%largest_move_q)
        else if (present(number) .and. name == 'largest_move_qd') then
            call take_limit(assembly%largest_move_qd)
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
        subroutine take_limit(limit)
            real(wp), intent(inout) :: limit

            if (number >= 0.0_wp .and. ieee_is_finite(number)) then
                limit = number
            else
                call set_error(error, status_invalid_option, name//' = '//to_text(number)//' must be positive, or 0 for no limit')
            end if
        end subroutine take_limit
    end subroutine set_assembly

    !> A list, or none where there are no numbers.
    pure subroutine take_list(values, list)
        real(wp), intent(in) :: values(:)
        real(wp), allocatable, intent(inout) :: list(:)

        if (allocated(list)) deallocate (list)
        if (size(values) > 0) list = values
    end subroutine take_list

    !> Whether each of some numbers is not 0; none where there are none.
    pure subroutine take_flags(values, flags)
        real(wp), intent(in) :: values(:)
        logical, allocatable, intent(inout) :: flags(:)

        if (allocated(flags)) deallocate (flags)
        if (size(values) > 0) flags = abs(values) > 0.0_wp
    end subroutine take_flags
end module tandem_legacy_settings
