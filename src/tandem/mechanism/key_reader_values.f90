! SPDX-License-Identifier: MIT
!> Values of keys by kind: the default before the call, the given value after it.
submodule(tandem_mechanism_key_reader) tandem_mechanism_key_reader_values
    use tandem_mechanism_entries, only: is_truth, number_value, text_value
    implicit none (type, external)

contains

    module procedure get_number
        integer :: k
        real(wp) :: number

        k = self%index_of(key, required)
        if (k > 0) then
            associate (given => self%entries%list(k)%value)
                if (given%is_list) call self%fail(key, 'is a list', 'give one number, or an expression as text')
                if (self%failed()) return
                call self%evaluate(k, given%atoms(1), number)
                if (self%failed()) return
                call check_number(self, key, number, check)
                value = number
            end associate
        end if
        if (allocated(value)) call self%remember(key, k, number_value(value), unit, help)
    end procedure get_number

    module procedure get_numbers
        character(len=:), allocatable :: allowed
        type(value_type) :: shown
        integer :: k, i, n

        k = self%index_of(key, required, row_length)
        if (k > 0) then
            n = size(self%entries%list(k)%value%atoms)
            if (.not. any(lengths == n)) then
                allowed = to_text(lengths(1))
                do i = 2, size(lengths)
                    allowed = allowed//' or '//to_text(lengths(i))
                end do
                call self%fail(key, 'has '//to_text(n)//trim(merge(' entry  ', ' entries', n == 1)), 'give '//allowed)
                return
            end if
            if (allocated(values)) deallocate (values)
            allocate (values(n))
            do i = 1, n
                call self%evaluate(k, self%entries%list(k)%value%atoms(i), values(i))
                if (self%failed()) return
                call check_number(self, key, values(i), check)
            end do
        end if
        if (.not. allocated(values)) return
        shown%is_list = .true.
        if (k > 0) shown%row_length = self%entries%list(k)%value%row_length
        allocate (shown%atoms(size(values)))
        shown%atoms%number = values
        call self%remember(key, k, shown, unit, help)
    end procedure get_numbers

    module procedure get_text
        integer :: k

        k = self%index_of(key, required)
        if (k > 0) then
            associate (given => self%entries%list(k)%value)
                if (given%is_list .or. given%atoms(1)%kind /= is_text) then
                    call self%fail(key, 'is no text', 'write it in quotes')
                    return
                end if
                text = given%atoms(1)%text
            end associate
        end if
        if (allocated(text)) call self%remember(key, k, text_value(text), help=help)
    end procedure get_text

    module procedure get_choice
        character(len=:), allocatable :: comment

        comment = listed(choices)
        comment = comment(2:)
        if (present(help)) comment = help//': '//comment
        call self%get_text(key, text, comment, required)
        if (self%failed() .or. .not. allocated(text)) return
        if (.not. any(choices == text)) then
            call self%fail(key, 'is "'//text//'"'//question(text, choices), 'take one of'//listed(choices))
        end if
    end procedure get_choice

    module procedure get_texts
        type(value_type) :: shown
        integer :: k, i

        k = self%index_of(key, required)
        if (k > 0) then
            associate (given => self%entries%list(k)%value)
                if (.not. given%is_list .or. .not. all(given%atoms%kind == is_text)) then
                    call self%fail(key, 'is no list of texts', 'write ["...", "..."]')
                else if (length > 0 .and. size(given%atoms) /= length) then
                    call self%fail(key, 'has '//to_text(size(given%atoms))//' texts', 'give '//to_text(length))
                end if
                if (self%failed()) return
                if (allocated(texts)) deallocate (texts)
                allocate (texts(size(given%atoms)))
                do i = 1, size(texts)
                    if (len(given%atoms(i)%text) > text_length) then
                        call self%fail(key, 'has a text of more than '//to_text(text_length)//' characters', 'shorten it')
                        return
                    end if
                    texts(i) = given%atoms(i)%text
                end do
            end associate
        end if
        if (.not. allocated(texts)) return
        shown%is_list = .true.
        allocate (shown%atoms(size(texts)))
        shown%atoms%kind = is_text
        do i = 1, size(texts)
            shown%atoms(i)%text = trim(texts(i))
        end do
        call self%remember(key, k, shown, help=help)
    end procedure get_texts

    module procedure pass
        integer :: k

        k = self%index_of(key)
        if (k == 0) return
        associate (given => self%entries%list(k)%value)
            if (.not. given%is_list .or. .not. all(given%atoms%kind == is_text)) then
                call self%fail(key, 'is no list of texts', 'write ["...", "..."]')
            else
                call self%remember(key, k, given, help=help)
            end if
        end associate
    end procedure pass

    module procedure get_truth
        type(value_type) :: shown
        integer :: k

        k = self%index_of(key)
        if (k > 0) then
            associate (given => self%entries%list(k)%value)
                if (given%is_list .or. given%atoms(1)%kind /= is_truth) then
                    call self%fail(key, 'is neither true nor false', 'write true or false, without quotes')
                    return
                end if
                truth = given%atoms(1)%truth
            end associate
        end if
        allocate (shown%atoms(1))
        shown%atoms(1)%kind = is_truth
        shown%atoms(1)%truth = truth
        call self%remember(key, k, shown, help=help)
    end procedure get_truth
    !> Refuse a number outside its range.
    subroutine check_number(self, key, number, check)
        class(key_reader_type), intent(inout) :: self
        character(len=*), intent(in) :: key
        real(wp), intent(in) :: number
        integer, intent(in), optional :: check

        if (.not. present(check)) return
        if (check == positive .and. .not. number > 0.0_wp) then
            call self%fail(key, 'is '//to_text(number), 'give a number > 0')
        else if (check == not_negative .and. .not. number >= 0.0_wp) then
            call self%fail(key, 'is '//to_text(number), 'give a number >= 0')
        end if
    end subroutine check_number

    module procedure remember
        type(value_type) :: shown
        character(len=:), allocatable :: table, name, comment
        integer :: of

        if (self%failed()) return
        name = key
        shown = value
        associate (element => self%elements(self%current))
            table = path_of(element)
            of = entry
            if (of == 0 .and. element%n > 0) of = element%entries(1)
            if (of > 0) then
                associate (its => self%entries%list(of))
                    if (.not. its%is_first) return
                    if (allocated(its%template)) then
                        table = its%template(:its%n_heading)
                        if (entry > 0) name = its%template(its%n_heading + 2:)
                    end if
                    if (entry > 0) shown = its%given
                end associate
            end if
        end associate
        comment = ''
        if (present(unit)) comment = unit
        if (present(help)) then
            if (len(comment) > 0 .and. len(help) > 0) comment = comment//', '
            comment = comment//help
        end if
        call self%show(table, name, shown, comment)
    end procedure remember
end submodule tandem_mechanism_key_reader_values
