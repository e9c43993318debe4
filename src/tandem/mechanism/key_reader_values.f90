! SPDX-License-Identifier: MIT
!> Values that need not have a default: numbers, texts and logical values.
submodule(tandem_mechanism_key_reader) tandem_mechanism_key_reader_values
    use tandem_mechanism_entries, only: is_number, is_truth, number_value, text_value, truth_value
    use tandem_mechanism_value_rules, only: kind_of, text_problem, violated
    use tandem_names, only: nearest_name
    use, intrinsic :: ieee_arithmetic, only: ieee_is_finite
    implicit none (type, external)

contains

    module procedure get_number
        integer :: k
        real(wp) :: number

        k = self%index_of(key, required)
        if (k > 0) then
            if (self%entries%list(k)%value%is_list) then
                call self%refuse_value(k, key, 'must be a number, not an array')
            else
                call read_number_at(self, k, key, 1, number, check)
            end if
            if (self%failed()) return
            value = number
        end if
        if (allocated(value)) call self%record_key(key, k, number_value(value), unit, help)
    end procedure get_number

    !> Read a number, or evaluate an expression, from one item of an entry.
    subroutine read_number_at(self, k, key, i, number, check)
        class(reader_type), intent(inout) :: self
        !> Entry and its key; index of the item.
        integer, intent(in) :: k, i
        character(len=*), intent(in) :: key
        real(wp), intent(out) :: number
        integer, intent(in), optional :: check
        character(len=:), allocatable :: problem

        number = 0.0_wp
        problem = ''
        associate (value => self%entries%list(k)%value)
            associate (atom => value%atoms(i))
                if (atom%kind == is_text .and. .not. self%is_scene) then
                    call self%evaluate(k, atom%text, number)
                    if (self%failed()) return
                else if (atom%kind /= is_number) then
                    problem = 'must be a number, not '//trim(kind_of(atom))
                    if (.not. self%is_scene) problem = 'must be a number, or an expression in quotes, not '//trim(kind_of(atom))
                else if (allocated(atom%problem)) then
                    problem = atom%problem
                else
                    number = atom%number
                    if (.not. ieee_is_finite(number)) problem = 'must be a finite number'
                end if
            end associate
            if (problem == '') problem = trim(violated(number, check))
            if (problem == '') return
            if (value%is_list) problem = 'element '//to_text(i)//' '//problem
        end associate
        call self%refuse_value(k, key, problem)
    end subroutine read_number_at

    module procedure get_numbers
        type(value_type) :: shown
        integer :: k, i, n

        k = self%index_of(key, required, row_length)
        if (k > 0) then
            associate (given => self%entries%list(k)%value)
                n = size(given%atoms)
                if (.not. given%is_list .and. (self%is_scene .or. .not. any(lengths == 1))) then
                    call self%refuse_value(k, key, 'must be an array of numbers, not '//trim(kind_of(given%atoms(1)))// &
                        '; it must have '//trim(one_of(lengths)))
                else if (self%is_scene .or. any(lengths == n)) then
                    if (allocated(values)) deallocate (values)
                    allocate (values(n))
                    do i = 1, n
                        call read_number_at(self, k, key, i, values(i))
                    end do
                end if
                if (self%failed()) return
                if (.not. any(lengths == n)) then
                    call self%refuse_value(k, key, 'has '//to_text(n)//trim(merge(' element ', ' elements', n == 1))// &
                        '; it must have '//trim(one_of(lengths)))
                    return
                end if
                do i = 1, n
                    if (violated(values(i), check) == '') cycle
                    if (given%is_list) then
                        call self%refuse_value(k, key, 'element '//to_text(i)//' '//trim(violated(values(i), check)))
                    else
                        call self%refuse_value(k, key, trim(violated(values(i), check)))
                    end if
                    return
                end do
            end associate
        end if
        if (self%failed() .or. .not. allocated(values)) return
        shown%is_list = .true.
        if (k > 0) shown%row_length = self%entries%list(k)%value%row_length
        allocate (shown%atoms(size(values)))
        shown%atoms%number = values
        call self%record_key(key, k, shown, unit, help)
    end procedure get_numbers

    !> The numbers in words, separated by `or`.
    pure function one_of(numbers) result(text)
        integer, intent(in) :: numbers(:)
        character(len=20*size(numbers)) :: text
        integer :: i

        text = to_text(numbers(1))
        do i = 2, size(numbers)
            text = trim(text)//' or '//to_text(numbers(i))
        end do
    end function one_of

    module procedure get_text
        integer :: k
        character(len=:), allocatable :: problem

        k = self%index_of(key, required)
        if (k > 0) then
            associate (given => self%entries%list(k)%value)
                problem = ''
                if (given%is_list) then
                    problem = 'must be a string in quotes, not an array'
                else
                    problem = trim(text_problem(given%atoms(1)))
                end if
                if (problem /= '') then
                    call self%refuse_value(k, key, problem)
                    return
                end if
                text = given%atoms(1)%text
            end associate
        end if
        if (allocated(text)) call self%record_key(key, k, text_value(text), help=help)
    end procedure get_text

    module procedure get_word
        character(len=:), allocatable :: comment, problem

        comment = listed(choices)
        comment = comment(2:)
        if (present(help)) comment = help//': '//comment
        call self%get_text(key, text, comment, required)
        if (self%failed() .or. .not. allocated(text)) return
        if (any(choices == text)) return
        problem = 'must be one of'//listed(choices)//', not "'//text//'"'
        if (nearest_name(text, choices) /= '') problem = problem//'; did you mean "'//nearest_name(text, choices)//'"?'
        call self%refuse(key, problem)
    end procedure get_word

    module procedure get_texts
        type(value_type) :: shown
        character(len=:), allocatable :: problem
        integer :: k, i

        k = self%index_of(key, required)
        if (k > 0) then
            associate (given => self%entries%list(k)%value)
                problem = ''
                if (.not. given%is_list) then
                    problem = 'must be an array of strings in quotes, not '//trim(kind_of(given%atoms(1)))
                else if (length > 0 .and. size(given%atoms) /= length) then
                    problem = 'has '//to_text(size(given%atoms))//trim(merge(' element ', ' elements', size(given%atoms) == 1))// &
                        '; it must have '//to_text(length)
                end if
                if (problem == '' .and. allocated(texts)) deallocate (texts)
                if (problem == '') allocate (texts(size(given%atoms)))
                do i = 1, size(given%atoms)
                    if (problem /= '') exit
                    problem = trim(text_problem(given%atoms(i)))
                    if (problem == '') then
                        if (len(given%atoms(i)%text) > text_length) problem = 'is longer than '//to_text(text_length)//' characters'
                    end if
                    if (problem /= '') then
                        problem = 'element '//to_text(i)//' '//problem
                    else
                        texts(i) = given%atoms(i)%text
                    end if
                end do
                if (problem /= '') then
                    call self%refuse_value(k, key, problem)
                    return
                end if
            end associate
        end if
        if (.not. allocated(texts)) return
        shown%is_list = .true.
        allocate (shown%atoms(size(texts)))
        shown%atoms%kind = is_text
        do i = 1, size(texts)
            shown%atoms(i)%text = trim(texts(i))
        end do
        call self%record_key(key, k, shown, help=help)
    end procedure get_texts

    module procedure pass
        integer :: k

        k = self%index_of(key)
        if (k == 0) return
        associate (given => self%entries%list(k)%value)
            if (.not. given%is_list .or. .not. all(given%atoms%kind == is_text)) then
                call self%refuse_value(k, key, 'must be an array of strings in quotes')
            else
                call self%record_key(key, k, given, help=help)
            end if
        end associate
    end procedure pass

    module procedure get_truth
        integer :: k

        k = self%index_of(key)
        if (k > 0) then
            associate (given => self%entries%list(k)%value)
                if (given%is_list) then
                    call self%refuse_value(k, key, 'must be true or false, not an array')
                else if (given%atoms(1)%kind /= is_truth) then
                    call self%refuse_value(k, key, 'must be true or false, not '//trim(kind_of(given%atoms(1))))
                else
                    truth = given%atoms(1)%truth
                end if
            end associate
        end if
        call self%record_key(key, k, truth_value(truth), help=help)
    end procedure get_truth
end submodule tandem_mechanism_key_reader_values
