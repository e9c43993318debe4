! SPDX-License-Identifier: MIT
!> Functions, laws and expressions in keys.
submodule(tandem_mechanism_key_reader) tandem_mechanism_key_reader_functions
    use tandem_mechanism_entries, only: is_number, is_truth
    use tandem_mechanism_expression, only: parse_expression
    use tandem_mechanism_function, only: constant_type, expression_function, table_function
    use tandem_mechanism_law, only: expression_law, table_law
    use, intrinsic :: ieee_arithmetic, only: ieee_is_finite
    implicit none (type, external)

contains

    module procedure get_function
        type(expression_type) :: expression
        type(constant_type) :: constant
        character(len=key_length), allocatable :: names(:)
        real(wp), allocatable :: values(:)
        integer :: k

        k = self%index_of(key)
        if (k == 0) return
        associate (given => self%entries%list(k)%value)
            if (given%is_list .or. given%atoms(1)%kind == is_truth) then
                call self%fail(key, 'is not a function of time', &
                    'give a number, an expression of t in quotes, or the name of a function')
                return
            end if
            if (given%atoms(1)%kind == is_number) then
                constant%value = given%atoms(1)%number
                allocate (f, source=constant)
            else if (table_at(self, k) > 0) then
                allocate (f, source=table_function(self%tables(table_at(self, k))))
            else
                call constants(self, k, names, values)
                call parse_expression(expression, given%atoms(1)%text, ['t'], self%error, names, values, self%entries%list(k)%key)
                if (self%failed()) then
                    self%place = self%entries%list(k)%place
                    return
                end if
                allocate (f, source=expression_function(expression))
            end if
            call self%record_key(key, k, given, unit, help)
        end associate
    end procedure get_function

    module procedure add_table
        type(table_type), allocatable :: longer(:)
        integer :: n

        if (.not. allocated(self%tables)) allocate (self%tables(0), self%table_names(0))
        n = size(self%tables)
        allocate (longer(n + 1))
        longer(:n) = self%tables
        longer(n + 1) = table
        call move_alloc(longer, self%tables)
        self%table_names = [character(len=key_length) :: self%table_names, name]
    end procedure add_table

    !> Index of the table of values that the text of an entry names; 0 if none.
    pure integer function table_at(self, entry) result(number)
        class(reader_type), intent(in) :: self
        integer, intent(in) :: entry

        number = 0
        if (.not. allocated(self%tables)) return
        associate (value => self%entries%list(entry)%value)
            if (value%is_list) return
            if (value%atoms(1)%kind == is_text) number = findloc(self%table_names, trim(value%atoms(1)%text), dim=1)
        end associate
    end function table_at

    module procedure get_law
        type(expression_type), allocatable :: expressions(:)
        integer :: k

        if (self%failed()) return
        k = self%find(key)
        if (k > 0) then
            if (table_at(self, k) > 0) then
                k = self%index_of(key)
                allocate (law, source=table_law(self%tables(table_at(self, k))))
                call self%record_key(key, k, self%entries%list(k)%value, unit, help)
                return
            end if
        end if
        call self%get_expressions(key, [1], [character(len=key_length) :: 't', coordinate, 'rate'], expressions, unit, help)
        if (allocated(expressions)) allocate (law, source=expression_law(expressions(1)))
    end procedure get_law

    module procedure get_expressions
        character(len=key_length), allocatable :: names(:)
        character(len=32) :: number
        real(wp), allocatable :: values(:)
        integer :: k, i

        k = self%index_of(key, required)
        if (k == 0) return
        call constants(self, k, names, values)
        associate (given => self%entries%list(k)%value)
            if (.not. any(lengths == size(given%atoms))) then
                call self%refuse_value(k, key, 'has '//to_text(size(given%atoms))//trim(merge(' element ', ' elements', &
                    size(given%atoms) == 1))//'; it must have '//to_text(lengths(1)))
                return
            end if
            allocate (expressions(size(given%atoms)))
            do i = 1, size(expressions)
                select case (given%atoms(i)%kind)
                case (is_number)
                    write (number, '(es25.16e3)') given%atoms(i)%number
                    call parse_expression(expressions(i), number, [character(len=1) ::], self%error)
                case (is_text)
                    call parse_expression(expressions(i), given%atoms(i)%text, variables, self%error, names, values, &
                        self%entries%list(k)%key)
                case default
                    call self%fail(key, 'is true or false', 'give a number, or an expression in quotes')
                end select
                if (.not. self%failed()) cycle
                self%place = self%entries%list(k)%place
                deallocate (expressions)
                return
            end do
            call self%record_key(key, k, given, unit, help)
        end associate
    end procedure get_expressions

    module procedure evaluate
        type(expression_type) :: expression
        character(len=key_length), allocatable :: names(:)
        real(wp), allocatable :: values(:)

        number = 0.0_wp
        if (self%failed()) return
        associate (given => self%entries%list(entry))
            call constants(self, entry, names, values)
            call parse_expression(expression, text, [character(len=1) ::], self%error, names, values, given%key)
            if (self%failed()) then
                self%place = given%place
                return
            end if
            number = expression%value([real(wp) ::])
            if (.not. ieee_is_finite(number)) call self%fail_at(entry, given%key//' does not yield a finite number', 'correct it')
        end associate
    end procedure evaluate

    module procedure evaluate_text
        number = 0.0_wp
        if (.not. self%failed()) call self%evaluate(self%find(key), text, number)
    end procedure evaluate_text

    !> Parameters, followed by the indices of a repeated element.
    subroutine constants(self, entry, names, values)
        class(reader_type), intent(in) :: self
        integer, intent(in) :: entry
        character(len=key_length), allocatable, intent(out) :: names(:)
        real(wp), allocatable, intent(out) :: values(:)

        names = self%names
        values = self%values
        associate (given => self%entries%list(entry))
            if (.not. allocated(given%index_names)) return
            names = [character(len=key_length) :: names, given%index_names]
            values = [values, real(given%index_values, wp)]
        end associate
    end subroutine constants
end submodule tandem_mechanism_key_reader_functions
