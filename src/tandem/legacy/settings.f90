! SPDX-License-Identifier: MIT
!> Options by name, for callers who cannot see `options_type`. The names are those of the table of options, in either case. A value
!> that cannot be is refused at once, and the one before stays; how options go together is seen when a run starts.
module tandem_legacy_settings
    use tandem_error, only: error_type, set_error
    use tandem_kinds, only: wp
    use tandem_options, only: check_word, option_row_type, option_visitor_type, options_type
    use tandem_status, only: status_invalid_option
    implicit none (type, external)
    private

    public :: set_option, lower_case

    !> Gives the option of a name its value, which is one of three kinds.
    type, extends(option_visitor_type) :: setter_type
        character(len=:), allocatable :: name
        real(wp), allocatable :: number
        integer, allocatable :: whole
        character(len=:), allocatable :: word
        logical :: found = .false.
        !> The options of that kind, for messages.
        character(len=:), allocatable :: known
        type(error_type), allocatable :: error
    contains
        procedure :: take => set_if_named
    end type setter_type

contains

    !> Set an option to one of a number, an integer and a word.
    subroutine set_option(options, name, error, number, whole, word)
        type(options_type), intent(inout) :: options
        !> Name of a component, in either case.
        character(len=*), intent(in) :: name
        !> invalid_option where there is no such option of that kind, or its value cannot be.
        type(error_type), allocatable, intent(out) :: error
        real(wp), intent(in), optional :: number
        integer, intent(in), optional :: whole
        !> In either case.
        character(len=*), intent(in), optional :: word
        type(options_type) :: changed
        type(setter_type) :: setter
        character(len=:), allocatable :: kind

        setter%name = lower_case(name)
        setter%known = ''
        if (present(number)) then
            kind = 'a real option'
            setter%number = number
        else if (present(whole)) then
            kind = 'an integer option'
            setter%whole = whole
            setter%known = ', constant_mass'
        else
            kind = 'a text option'
            setter%word = lower_case(word)
        end if
        changed = options
        call changed%visit(setter)
        if (.not. setter%found) then
            call set_error(error, status_invalid_option, '"'//trim(name)//'" is not '//kind, 'there are '//setter%known(3:))
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
            (present(word) .and. allocated(self%word)))) return
        self%known = self%known//', '//trim(row%name)
        if (row%name /= self%name) return
        self%found = .true.
        if (present(number)) number = self%number
        if (present(whole)) whole = self%whole
        if (.not. present(word)) return
        ! Before it is cut to the room that the option has: a longer word must not become another.
        call check_word(row, self%word, choices, self%error)
        word = self%word
    end subroutine set_if_named

    !> A name in lower case, without trailing blanks.
    pure function lower_case(name) result(lower)
        character(len=*), intent(in) :: name
        character(len=len_trim(name)) :: lower
        integer :: i

        lower = name
        do i = 1, len(lower)
            if (lower(i:i) >= 'A' .and. lower(i:i) <= 'Z') lower(i:i) = achar(iachar(lower(i:i)) + 32)
        end do
    end function lower_case
end module tandem_legacy_settings
