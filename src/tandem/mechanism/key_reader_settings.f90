! SPDX-License-Identifier: MIT
!> Values with defaults that are not allocatable, or with a given length, as in the tables of a scene.
submodule(tandem_mechanism_key_reader) tandem_mechanism_key_reader_settings
    use tandem_mechanism_entries, only: is_number, is_other, number_value
    use tandem_mechanism_value_rules, only: kind_of, violated
    use tandem_names, only: nearest_name
    use tandem_number_text, only: read_number
    implicit none (type, external)

contains

    module procedure get_real
        real(wp), allocatable :: number

        number = value
        call self%get_number(key, number, check, unit, help, required)
        if (.not. self%failed()) value = number
    end procedure get_real

    module procedure get_integer
        character(len=:), allocatable :: problem
        integer :: k

        k = self%index_of(key)
        if (k > 0) then
            associate (given => self%entries%list(k)%value, atom => self%entries%list(k)%value%atoms)
                problem = ''
                if (given%is_list) then
                    problem = 'must be an integer, not an array'
                else if (atom(1)%kind == is_number .and. .not. atom(1)%is_whole) then
                    problem = 'must be an integer, not a number with a fraction'
                else if (atom(1)%kind /= is_number) then
                    problem = 'must be an integer, not '//trim(kind_of(atom(1)))
                else if (allocated(atom(1)%problem) .or. abs(atom(1)%number) > huge(value)) then
                    problem = 'must lie between -'//to_text(huge(value))//' and '//to_text(huge(value))
                else
                    value = nint(atom(1)%number)
                    problem = trim(violated(real(value, wp), check))
                end if
            end associate
            if (problem /= '') call self%refuse_value(k, key, problem)
        end if
        call self%record_key(key, k, number_value(real(value, wp)), help=help, is_whole=.true.)
    end procedure get_integer

    module procedure get_choice
        character(len=:), allocatable :: text

        text = trim(value)
        call self%get_word(key, text, choices, help, required)
        value = text
    end procedure get_choice

    module procedure get_vector
        real(wp), allocatable :: numbers(:)

        allocate (numbers, source=values)
        call self%get_numbers(key, [size(values)], numbers, check, unit, help)
        if (.not. self%failed()) values = numbers
    end procedure get_vector

    module procedure get_strings
        character(len=text_length), allocatable :: texts(:)
        character(len=len(values)), allocatable :: taken(:)
        character(len=:), allocatable :: problem, word
        logical :: with_values
        integer :: i

        with_values = .false.
        if (present(may_have_values)) with_values = may_have_values
        allocate (texts(size(values)))
        texts = values
        call self%get_texts(key, 0, texts, help)
        if (self%failed()) return
        problem = ''
        do i = 1, size(texts)
            word = trim(texts(i))
            if (len(word) > len(values)) problem = 'element '//to_text(i)//' is too long'
            if (with_values .and. problem == '') problem = trim(value_problem(word))
            if (problem /= '') exit
            if (with_values .and. index(word, '=') > 0) word = word(:index(word, '=') - 1)
            if (.not. any(word == choices)) then
                problem = '"'//trim(word)//'" is not one of'//listed(choices)
                if (nearest_name(trim(word), choices) /= '') then
                    problem = problem//'; did you mean "'//nearest_name(trim(word), choices)//'"?'
                end if
            else if (count(texts == texts(i)) > 1) then
                problem = 'has "'//trim(texts(i))//'" more than once'
            end if
            if (problem /= '') exit
        end do
        if (problem /= '') then
            call self%refuse(key, problem)
            return
        end if
        allocate (taken(size(texts)))
        taken = texts
        call move_alloc(taken, values)
    end procedure get_strings

    !> Problem of the number in NAME=NUMBER; empty if it is valid.
    pure function value_problem(text) result(problem)
        character(len=*), intent(in) :: text
        character(len=len(text) + 48) :: problem
        real(wp) :: number
        logical :: is_read
        integer :: at

        problem = ''
        at = index(text, '=')
        if (at == 0) return
        call read_number(text(at + 1:), number, is_read)
        if (.not. is_read) problem = 'has "'//trim(text)//'", whose value is not a finite number'
    end function value_problem

    module procedure get_for_each
        real(wp), allocatable :: number
        integer :: k

        k = self%find(key)
        if (k > 0) then
            if (self%entries%list(k)%value%is_list) then
                call self%get_numbers(key, [length], values, help=help)
                return
            end if
        end if
        if (present(value)) number = value
        call self%get_number(key, number, help=help)
        if (k == 0 .and. .not. present(value) .or. self%failed()) return
        if (present(value)) then
            value = number
        else
            values = spread(number, 1, length)
        end if
    end procedure get_for_each

    module procedure get_list
        character(len=:), allocatable :: problem
        integer :: k, i

        if (allocated(values)) deallocate (values)
        k = self%index_of(key)
        if (k == 0) return
        associate (given => self%entries%list(k)%value)
            problem = ''
            if (.not. given%is_list) problem = 'must be a list, as in [1.0, 2.0]'
            if (problem == '' .and. size(given%atoms) == 0) problem = 'is an empty list'
            do i = 1, size(given%atoms)
                if (problem /= '') exit
                if (given%atoms(i)%kind == is_other) then
                    problem = 'has an element '//to_text(i)//' that must be a number, a string, true or false'
                else if (allocated(given%atoms(i)%problem)) then
                    problem = 'element '//to_text(i)//' '//given%atoms(i)%problem
                end if
            end do
            if (problem == '') allocate (values, source=given)
        end associate
        if (problem /= '') call self%refuse_value(k, key, problem)
    end procedure get_list
end submodule tandem_mechanism_key_reader_settings
