! SPDX-License-Identifier: MIT
!> Changes by events: `lock NAME` and `free NAME` of a coupling that can be freed, and `force.NAME.KEY = NUMBER` of an element with
!> such a number, where the number may be an expression of constants.
submodule(tandem_mechanism) tandem_mechanism_changing
    use tandem_mechanism_expression, only: expression_type, parse_expression
    use tandem_mechanism_sensor, only: of_kind
    use, intrinsic :: ieee_arithmetic, only: ieee_is_finite
    implicit none (type, external)

contains

    !> One change.
    module procedure change
        character(len=len(what)) :: text

        text = adjustl(what)
        if (index(text, 'lock ') == 1) then
            call switch(self, trim(adjustl(text(6:))), .true., is_trial, t, q, problem)
        else if (index(text, 'free ') == 1) then
            call switch(self, trim(adjustl(text(6:))), .false., is_trial, t, q, problem)
        else if (index(text, 'force.') == 1 .and. index(text, '=') > 0) then
            call set_number(self, text, is_trial, problem)
        else
            problem = '"'//trim(text)//'" is not a valid change: write "lock NAME", "free NAME" or "force.NAME.KEY = NUMBER"'
        end if
    end procedure change

    !> Lock or free a coupling. Locking a locked coupling keeps its value.
    subroutine switch(self, name, locks, is_trial, t, q, problem)
        type(mechanism_type), intent(inout) :: self
        character(len=*), intent(in) :: name
        logical, intent(in) :: locks, is_trial
        real(wp), intent(in) :: t, q(:)
        character(len=*), intent(out) :: problem
        integer :: i, type_of, stat

        problem = 'there is no coupling '//name//' that can be locked and freed: add the key locked to one'
        call self%find_element(name, type_of, i)
        if (type_of <= of_kind) return
        associate (kind => self%kinds(type_of - of_kind)%of, it => self%kinds(type_of - of_kind)%of%constraint(i, 1.0_wp))
            if (.not. it%can_be_freed) return
            problem = ''
            if (is_trial .or. (locks .eqv. it%is_locked)) return
            ! Set only the poses and the functions of time; evaluate no term.
            if (locks) call self%evaluate(0, t, q, q, self%at_row, stat)
            call kind%lock(i, locks, self%at)
        end associate
    end subroutine switch

    !> Set a number of an element.
    subroutine set_number(self, text, is_trial, problem)
        type(mechanism_type), intent(inout) :: self
        character(len=*), intent(in) :: text
        logical, intent(in) :: is_trial
        character(len=*), intent(out) :: problem
        character(len=*), parameter :: head = 'force.'
        character(len=len(text)) :: name, key
        character(len=9) :: names(3)
        character(len=:), allocatable :: words
        type(expression_type) :: expression
        type(error_type), allocatable :: error
        real(wp) :: number
        integer :: dot, equal, type_of, i, k

        equal = index(text, '=')
        dot = index(text(:equal - 1), '.', back=.true.)
        call parse_expression(expression, trim(adjustl(text(equal + 1:))), [character(len=1) ::], error)
        number = 0.0_wp
        if (.not. allocated(error)) number = expression%value([real(wp) ::])
        if (dot <= len(head) .or. allocated(error) .or. .not. ieee_is_finite(number)) then
            problem = '"'//trim(text)//'" does not set a number: write "force.NAME.KEY = NUMBER"'
            if (allocated(error)) problem = trim(problem)//'; '//error%message(index(error%message, ': ') + 2:)
            return
        end if
        name = text(len(head) + 1:dot - 1)
        key = text(dot + 1:equal - 1)
        call self%find_element(trim(name), type_of, i)
        names = ''
        if (type_of > of_kind) call self%kinds(type_of - of_kind)%of%list_settings(names)
        k = findloc(names == key, .true., dim=1)
        if (names(1) == '') then
            call self%list_words(.true., ' nor ', words)
            problem = trim(name)//' is neither '//words
        else if (k == 0) then
            problem = trim(name)//' has no number '//trim(key)//' that events may set: use '//trim(names(1))//', '// &
                trim(names(2))//' or '//trim(names(3))
        else
            problem = ''
            if (.not. is_trial) self%kinds(type_of - of_kind)%of%numbers(k, i) = number
        end if
    end subroutine set_number

    module procedure pack_state
        integer :: i, k

        do k = 1, size(self%kinds)
            call self%kinds(k)%of%pack_state(pack)
        end do
        do i = 1, size(self%at%coordinates)
            call pack%item(self%at%coordinates(i)%last)
        end do
        do i = 1, size(self%sensors)
            call pack_sensor(self%sensors(i), pack)
        end do
        if (allocated(self%state%impulses)) call pack%item(self%state%impulses)
        if (.not. allocated(self%state%integrals)) return
        do i = 1, size(self%state%integrals)
            call pack%item(self%state%integrals(i))
        end do
    end procedure pack_state
end submodule tandem_mechanism_changing
