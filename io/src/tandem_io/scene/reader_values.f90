! SPDX-License-Identifier: MIT
!> Values of a reader, by their kind: the default before the call, the value of the last source after it.
submodule(tandem_io_scene_reader) tandem_io_scene_reader_values
    use tandem_io_scene_text, only: to_toml
    use tandem_number_text, only: read_number
    use tomlf, only: toml_array
    implicit none (type, external)

contains

    module procedure get_real
        class(toml_value), pointer :: found
        character(len=:), allocatable :: problem
        integer :: source

        call self%find(key, found, source, required)
        if (associated(found)) then
            call convert(self%sources(source), found, value, problem)
            if (problem == '') problem = violated(value, check)
            if (problem /= '') call self%refuse_value(key, found, source, problem)
        end if
        if (.not. self%is_brief) call self%record(key, to_toml(value), source, unit, help)
    end procedure get_real

    module procedure get_integer
        class(toml_value), pointer :: found
        character(len=:), allocatable :: problem
        integer :: source

        call self%find(key, found, source)
        if (associated(found)) then
            call convert(self%sources(source), found, value, problem)
            if (problem == '') problem = violated(real(value, wp), check)
            if (problem /= '') call self%refuse_value(key, found, source, problem)
        end if
        if (.not. self%is_brief) call self%record(key, to_toml(value), source, help=help)
    end procedure get_integer

    module procedure get_logical
        class(toml_value), pointer :: found
        character(len=:), allocatable :: problem
        integer :: source

        call self%find(key, found, source)
        if (associated(found)) then
            call convert(self%sources(source), found, value, problem)
            if (problem /= '') call self%refuse_value(key, found, source, problem)
        end if
        if (.not. self%is_brief) call self%record(key, to_toml(value), source, help=help)
    end procedure get_logical

    module procedure get_string
        class(toml_value), pointer :: found
        character(len=:), allocatable :: problem
        integer :: source

        call self%find(key, found, source, required)
        if (associated(found)) then
            call convert(self%sources(source), found, value, problem)
            if (problem /= '') call self%refuse_value(key, found, source, problem)
        end if
        if (.not. allocated(value)) value = ''
        if (.not. self%is_brief) call self%record(key, to_toml(value), source, help=help)
    end procedure get_string

    module procedure get_choice
        character(len=:), allocatable :: text, comment
        class(toml_value), pointer :: found
        character(len=:), allocatable :: problem
        integer :: source

        call self%find(key, found, source, required)
        text = trim(value)
        if (associated(found)) then
            call convert(self%sources(source), found, text, problem)
            if (problem == '' .and. .not. any(text == choices)) then
                problem = 'must be one of '//listed(choices)
                if (nearest_name(text, choices) /= '') problem = problem//'; did you mean "'//nearest_name(text, choices)//'"?'
            end if
            if (problem /= '') call self%refuse_value(key, found, source, problem)
        end if
        value = text
        comment = listed(choices)
        if (present(help)) comment = help//': '//comment
        if (.not. self%is_brief) call self%record(key, to_toml(text), source, help=comment)
    end procedure get_choice

    module procedure get_vector
        real(wp), allocatable :: numbers(:)

        allocate (numbers, source=values)
        call self%get_reals(key, numbers, size(values), check, unit, help)
        if (size(numbers) == size(values)) values = numbers
    end procedure get_vector

    module procedure get_reals
        class(toml_value), pointer :: found
        character(len=:), allocatable :: problem
        integer :: source, i

        call self%find(key, found, source, required)
        if (associated(found)) then
            call convert(self%sources(source), found, values, problem)
            if (problem /= '') then
                call self%refuse_value(key, found, source, problem)
                return
            end if
            if (size(values) /= length) problem = 'has '//to_toml(size(values))//' elements; it must have '//to_toml(length)
            do i = 1, size(values)
                if (problem /= '') exit
                problem = violated(values(i), check)
                if (problem /= '') problem = 'element '//to_toml(i)//' '//problem
            end do
            if (problem /= '') call self%refuse_value(key, found, source, problem)
        end if
        if (self%failed()) return
        if (.not. self%is_brief) call self%record(key, to_toml(values), source, unit, help)
    end procedure get_reals

    module procedure get_for_each
        class(toml_value), pointer :: found
        real(wp) :: number
        integer :: source

        call self%find(key, found, source)
        if (.not. (associated(found) .or. present(value))) then
            call self%propose(key)
            return
        end if
        if (associated(found)) then
            select type (found)
            type is (toml_array)
                call self%get_reals(key, values, length, help=help)
                return
            end select
        end if
        number = 0.0_wp
        if (present(value)) number = value
        call self%get_real(key, number, help=help)
        if (present(value)) then
            value = number
        else
            values = spread(number, 1, length)
        end if
    end procedure get_for_each

    module procedure get_strings
        class(toml_value), pointer :: found
        character(len=:), allocatable :: problem, word
        logical :: with_values
        integer :: source, i

        with_values = .false.
        if (present(may_have_values)) with_values = may_have_values
        call self%find(key, found, source)
        if (associated(found)) then
            call convert(self%sources(source), found, values, problem)
            do i = 1, size(values)
                if (problem /= '') exit
                if (with_values) problem = value_problem(values(i))
                if (problem /= '') exit
                word = values(i)
                if (with_values .and. index(word, '=') > 0) word = word(:index(word, '=') - 1)
                if (.not. any(word == choices)) then
                    problem = '"'//trim(word)//'" is none of '//listed(choices)
                    if (nearest_name(trim(word), choices) /= '') then
                        problem = problem//'; did you mean "'//nearest_name(trim(word), choices)//'"?'
                    end if
                else if (count(values == values(i)) > 1) then
                    problem = 'has "'//trim(values(i))//'" more than once'
                end if
            end do
            if (problem /= '') call self%refuse_value(key, found, source, problem)
        end if
        if (self%failed()) return
        if (.not. self%is_brief) call self%record(key, to_toml(values), source, help=help)
    end procedure get_strings

    !> Fault of the number in NAME=NUMBER; empty if there is no number.
    pure function value_problem(text) result(problem)
        character(len=*), intent(in) :: text
        character(len=:), allocatable :: problem
        real(wp) :: number
        logical :: is_read
        integer :: at

        problem = ''
        at = index(text, '=')
        if (at == 0) return
        call read_number(text(at + 1:), number, is_read)
        if (.not. is_read) problem = 'has "'//trim(text)//'", whose value is no finite number'
    end function value_problem

    !> Condition that a number violates; empty if it is valid.
    pure function violated(value, check) result(problem)
        real(wp), intent(in) :: value
        integer, intent(in), optional :: check
        character(len=:), allocatable :: problem

        problem = ''
        if (.not. present(check)) return
        if (check == positive .and. .not. value > 0.0_wp) problem = 'must be positive'
        if (check == not_negative .and. .not. value >= 0.0_wp) problem = 'must not be negative'
    end function violated
end submodule tandem_io_scene_reader_values
