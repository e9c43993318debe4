! SPDX-License-Identifier: MIT
!> Parse the text of an expression into a list of operations.
!>
!> sum = product {(+|-) product}, product = factor {(*|/) factor}, factor = {+|-} power, power = operand [(^|**) factor], operand =
!> number | name | function(sum {, sum}) | (sum). Operations on constants are evaluated at once, and repeated operations are stored
!> once. The length of the text, the depth of nesting and the length of the list are bounded, so that parsing of any text ends in
!> bounded time with a list or with one error.
module tandem_mechanism_expression_parser
    use tandem_error, only: to_text
    use tandem_kinds, only: wp
    use tandem_mechanism_expression_code, only: builder_type, code_type, operand_type
    use tandem_mechanism_operations, only: find_function, function_type, functions, op_add, op_divide, op_multiply, op_negate, &
        op_power, op_power_constant, op_smooth_step, op_subtract, pi
    use tandem_names, only: question
    use tandem_number_text, only: read_number
    use, intrinsic :: ieee_arithmetic, only: ieee_is_finite
    implicit none (type, external)
    private

    public :: compile, is_name, name_length

    character(len=*), parameter :: digits = '0123456789', &
        letters = 'abcdefghijklmnopqrstuvwxyzABCDEFGHIJKLMNOPQRSTUVWXYZ'

    !> Length of quotations in messages.
    integer, parameter :: found_length = 32
    !> Largest lengths of a text and of a name.
    integer, parameter :: max_length = 4000, name_length = 128
    !> Largest depth of nested parentheses, functions, powers and signs.
    integer, parameter :: max_depth = 100
    character(len=*), parameter :: too_long = 'the expression has too many operations, names and numbers'

    !> Text and list during parsing.
    type :: parser_type
        character(len=:), allocatable :: text
        !> Names of the variables, then of the constants, then pi.
        character(len=name_length), allocatable :: names(:)
        integer :: n_variables = 0
        !> Values of the constants.
        real(wp), allocatable :: values(:)
        integer :: at = 1, depth = 0
        type(builder_type) :: list
        !> First error, and its position.
        character(len=:), allocatable :: problem
        integer :: column = 0
    contains
        procedure :: fail, skip_blanks, quote, quote_with_advice, is_next, consume
        procedure :: parse_sum, parse_product, parse_factor, parse_power, parse_operand
        procedure :: parse_number, parse_function, parse_name
        procedure :: append_power, append_smooth_step, append_operation
    end type parser_type

contains

    !> Compile an expression into a list of operations, or return the error in its text.
    subroutine compile(text, variables, names, values, code, column, problem)
        character(len=*), intent(in) :: text
        !> Names of the variables, at most `name_length` long.
        character(len=*), intent(in) :: variables(:)
        !> Names and values of constants.
        character(len=*), intent(in) :: names(:)
        real(wp), intent(in) :: values(:)
        type(code_type), intent(out) :: code
        !> Position of the error, from 1.
        integer, intent(out) :: column
        !> Error message; not allocated after success.
        character(len=:), allocatable, intent(out) :: problem
        type(parser_type), allocatable :: parser
        type(operand_type) :: last

        column = 1
        if (len(text) > max_length) then
            problem = 'expressions have at most '//to_text(max_length)//' characters'
            return
        end if
        allocate (parser)
        parser%text = text
        allocate (parser%names(size(variables) + size(names) + 1))
        parser%n_variables = size(variables)
        parser%names(:size(variables)) = variables
        parser%names(size(variables) + 1:size(parser%names) - 1) = names
        parser%names(size(parser%names)) = 'pi'
        parser%values = [values, pi]
        call parser%skip_blanks
        if (parser%at > len(text)) call parser%fail(1, 'expected an expression, found nothing')
        call parser%parse_sum(last)
        if (.not. allocated(parser%problem) .and. parser%at <= len(text)) then
            if (scan(text(parser%at:parser%at), '<>=!&|?:') > 0) then
                call parser%fail(parser%at, 'comparisons are not available; use step, ramp, min or max')
            else
                call parser%fail(parser%at, 'expected an operator or the end, found '//trim(parser%quote_with_advice()))
            end if
        end if
        if (.not. allocated(parser%problem)) then
            call parser%list%arrange(last, code)
            if (parser%list%is_full) call parser%fail(1, too_long)
        end if
        if (allocated(parser%problem)) then
            column = parser%column
            call move_alloc(parser%problem, problem)
        end if
    end subroutine compile

    !> Text at the current position, for messages. If it is an operand that follows another operand, advice is added.
    pure function quote_with_advice(self) result(text)
        class(parser_type), intent(in) :: self
        character(len=found_length + 26) :: text

        text = self%quote()
        if (self%at > len(self%text)) return
        if (scan(self%text(self%at:self%at), letters//digits//'_(.') > 0) text = trim(text)//'; a product needs *'
    end function quote_with_advice

    !> True if a text is a name: letters, digits and underscores after a letter; names of this form joined by dots are names too.
    pure logical function is_name(text)
        character(len=*), intent(in) :: text

        is_name = name_end(text, 1) == len(text) .and. len(text) > 0
    end function is_name

    !> Last position of the name that begins at a position; the position before it if there is none.
    pure integer function name_end(text, first)
        character(len=*), intent(in) :: text
        integer, intent(in) :: first
        integer :: n

        name_end = first - 1
        do
            if (name_end + 1 > len(text)) return
            ! A dot belongs to a name if a letter follows.
            n = name_end + 1
            if (n > first) n = n + 1
            if (n > len(text)) return
            if (scan(text(n:n), letters) == 0) return
            name_end = n - 1 + verify(text(n:)//' ', letters//digits//'_') - 1
            if (name_end + 1 > len(text)) return
            if (text(name_end + 1:name_end + 1) /= '.') return
        end do
    end function name_end

    !> Store the first error.
    subroutine fail(self, column, problem)
        class(parser_type), intent(inout) :: self
        integer, intent(in) :: column
        character(len=*), intent(in) :: problem

        if (allocated(self%problem)) return
        self%column = column
        self%problem = problem
    end subroutine fail

    !> Advance to the next character that is not blank.
    subroutine skip_blanks(self)
        class(parser_type), intent(inout) :: self

        self%at = self%at - 1 + verify(self%text(self%at:)//'|', ' '//achar(9))
    end subroutine skip_blanks

    !> Text at the current position, for messages.
    pure function quote(self) result(text)
        class(parser_type), intent(in) :: self
        character(len=found_length) :: text
        integer :: last

        if (self%at > len(self%text)) then
            text = 'the end'
            return
        end if
        last = max(name_end(self%text, self%at), self%at)
        if (scan(self%text(last:last), digits) > 0) last = last - 1 + verify(self%text(last:)//' ', digits//'.') - 1
        text = '"'//printable(self%text(self%at:min(last, self%at + found_length - 3)))//'"'
    end function quote

    !> Text for messages, in which control characters and bytes of non-ASCII characters are replaced by question marks.
    pure function printable(text) result(shown)
        character(len=*), intent(in) :: text
        character(len=len(text)) :: shown
        integer :: i

        shown = text
        do i = 1, len(text)
            if (iachar(text(i:i)) < 32 .or. iachar(text(i:i)) > 126) shown(i:i) = '?'
        end do
    end function printable

    !> True if the next characters are a given symbol.
    pure logical function is_next(self, symbol)
        class(parser_type), intent(in) :: self
        character(len=*), intent(in) :: symbol

        is_next = self%text(self%at:min(self%at + len(symbol) - 1, len(self%text))) == symbol
    end function is_next

    !> Consume a symbol if it is next; true in this case.
    logical function consume(self, symbol)
        class(parser_type), intent(inout) :: self
        character(len=*), intent(in) :: symbol

        consume = self%is_next(symbol)
        ! A star that is the first of two is not a multiplication.
        if (symbol == '*' .and. consume) consume = .not. self%is_next('**')
        if (.not. consume) return
        self%at = self%at + len(symbol)
        call self%skip_blanks
    end function consume

    !> Parse a sum of products.
    recursive subroutine parse_sum(self, value)
        class(parser_type), intent(inout) :: self
        type(operand_type), intent(out) :: value
        type(operand_type) :: right
        integer :: column

        call self%parse_product(value)
        do while (.not. allocated(self%problem))
            column = self%at
            if (self%consume('+')) then
                call self%parse_product(right)
                call self%append_operation(op_add, value, right, column)
            else if (self%consume('-')) then
                call self%parse_product(right)
                call self%append_operation(op_subtract, value, right, column)
            else
                exit
            end if
        end do
    end subroutine parse_sum

    !> Parse a product of factors.
    recursive subroutine parse_product(self, value)
        class(parser_type), intent(inout) :: self
        type(operand_type), intent(out) :: value
        type(operand_type) :: right
        integer :: column

        call self%parse_factor(value)
        do while (.not. allocated(self%problem))
            column = self%at
            if (self%consume('*')) then
                call self%parse_factor(right)
                call self%append_operation(op_multiply, value, right, column)
            else if (self%consume('/')) then
                call self%parse_factor(right)
                call self%append_operation(op_divide, value, right, column)
            else
                exit
            end if
        end do
    end subroutine parse_product

    !> Parse a power with leading signs: -2^2 is -4. All nested expressions pass through this procedure.
    recursive subroutine parse_factor(self, value)
        class(parser_type), intent(inout) :: self
        type(operand_type), intent(out) :: value
        logical :: is_negative
        integer :: column

        if (allocated(self%problem)) return
        self%depth = self%depth + 1
        if (self%depth > max_depth) then
            call self%fail(self%at, 'expressions may be nested at most '//to_text(max_depth)//' deep')
            return
        end if
        column = self%at
        is_negative = .false.
        do
            if (self%consume('-')) then
                is_negative = .not. is_negative
            else if (.not. self%consume('+')) then
                exit
            end if
        end do
        call self%parse_power(value)
        if (is_negative) call self%append_operation(op_negate, value, operand_type(), column)
        self%depth = self%depth - 1
    end subroutine parse_factor

    !> Parse an operand and its exponent, which may itself have signs and powers: 2^-3^2 is 2^(-(3^2)).
    recursive subroutine parse_power(self, value)
        class(parser_type), intent(inout) :: self
        type(operand_type), intent(out) :: value
        type(operand_type) :: exponent
        integer :: column

        call self%parse_operand(value)
        if (allocated(self%problem)) return
        column = self%at
        if (.not. self%consume('^')) then
            if (.not. self%consume('**')) return
        end if
        call self%parse_factor(exponent)
        call self%append_power(value, exponent, column)
    end subroutine parse_power

    !> Parse a number, a name, a function or an expression in parentheses.
    recursive subroutine parse_operand(self, value)
        class(parser_type), intent(inout) :: self
        type(operand_type), intent(out) :: value
        integer :: column, last

        column = self%at
        if (self%consume('(')) then
            call self%parse_sum(value)
            if (allocated(self%problem)) return
            if (.not. self%consume(')')) call self%fail(self%at, 'expected ")" for the "(" of column '//to_text(column)// &
                ', found '//trim(self%quote_with_advice()))
            return
        end if
        last = name_end(self%text, column)
        if (last >= column) then
            self%at = last + 1
            call self%skip_blanks
            if (find_function(self%text(column:last)) > 0) then
                call self%parse_function(column, functions(find_function(self%text(column:last))), value)
            else
                call self%parse_name(column, self%text(column:last), value)
            end if
        else if (verify(self%text(column:)//'|', digits//'.') > 1) then
            call self%parse_number(value)
        else
            call self%fail(column, 'expected a number, a name or "(", found '//trim(self%quote()))
        end if
    end subroutine parse_operand

    !> Parse a number: digits with optional decimal point and exponent.
    subroutine parse_number(self, value)
        class(parser_type), intent(inout) :: self
        type(operand_type), intent(out) :: value
        integer :: first
        logical :: is_read

        first = self%at
        call skip_digits
        if (next('.')) then
            self%at = self%at + 1
            call skip_digits
        end if
        if (self%text(first:self%at - 1) == '.') then
            call self%fail(first, 'expected digits next to the decimal point')
            return
        end if
        if (next('eE')) then
            self%at = self%at + 1
            if (next('+-')) self%at = self%at + 1
            if (.not. next(digits)) then
                call self%fail(self%at, 'expected the digits of an exponent, found '//trim(self%quote()))
                return
            end if
            call skip_digits
        end if
        call read_number(self%text(first:self%at - 1), value%value, is_read)
        if (.not. is_read) then
            call self%fail(first, 'the number is too large')
            return
        end if
        call self%skip_blanks

    contains

        !> True if the next character is in a set.
        pure logical function next(set)
            character(len=*), intent(in) :: set

            next = .false.
            if (self%at <= len(self%text)) next = scan(self%text(self%at:self%at), set) > 0
        end function next

        subroutine skip_digits
            self%at = self%at - 1 + verify(self%text(self%at:)//'|', digits)
        end subroutine skip_digits
    end subroutine parse_number

    !> List of the variables for messages, if there are only a few.
    pure function list_of_variables(self) result(text)
        class(parser_type), intent(in) :: self
        integer, parameter :: few = 8
        character(len=few*(len(self%names) + 2) + 24) :: text
        integer :: i

        text = ''
        if (self%n_variables < 1 .or. self%n_variables > few) return
        text = '; its variables are '//self%names(1)
        do i = 2, self%n_variables
            text = trim(text)//', '//self%names(i)
        end do
    end function list_of_variables

    !> Look up a variable or a constant.
    subroutine parse_name(self, column, name, value)
        class(parser_type), intent(inout) :: self
        integer, intent(in) :: column
        character(len=*), intent(in) :: name
        type(operand_type), intent(out) :: value
        integer :: i

        do i = 1, size(self%names)
            if (self%names(i) == name) exit
        end do
        if (i > size(self%names)) then
            if (self%is_next('(')) then
                call self%fail(column, 'there is no function "'//name//'"'//question(name, functions%name))
            else
                call self%fail(column, 'there is no "'//name//'"'//question(name, self%names)//trim(list_of_variables(self)))
            end if
            return
        end if
        if (self%is_next('(')) call self%fail(column, '"'//name//'" is not a function; a product needs *')
        if (i <= self%n_variables) then
            if (any(self%names(self%n_variables + 1:) == name)) call self%fail(column, '"'//name// &
                '" is the name of a variable here and of a parameter; rename the parameter')
        end if
        if (i > self%n_variables) then
            value%value = self%values(i - self%n_variables)
        else
            value = self%list%variable(i)
            if (self%list%is_full) call self%fail(column, too_long)
        end if
    end subroutine parse_name

    !> Parse the arguments of a function.
    recursive subroutine parse_function(self, column, row, value)
        class(parser_type), intent(inout) :: self
        !> Position of the function's name.
        integer, intent(in) :: column
        type(function_type), intent(in) :: row
        type(operand_type), intent(out) :: value
        type(operand_type) :: arguments(maxval(functions%most))
        integer :: n, i

        if (.not. self%consume('(')) then
            call self%fail(self%at, 'expected "(" after the function '//trim(row%name)//', found '//trim(self%quote()))
            return
        end if
        n = 0
        do
            n = n + 1
            if (n > row%most) exit
            call self%parse_sum(arguments(n))
            if (allocated(self%problem)) return
            if (.not. self%consume(',')) exit
        end do
        if (n <= row%most .and. .not. self%is_next(')')) then
            call self%fail(self%at, 'expected ")" or "," in the arguments of '//trim(row%name)//', found '// &
                trim(self%quote_with_advice()))
        else if (n < row%least .or. n > row%most .or. (row%operation == op_smooth_step .and. n == 2)) then
            call self%fail(column, trim(row%name)//' takes '//trim(numbers_of_arguments(row)))
        end if
        if (allocated(self%problem)) return
        self%at = self%at + 1
        call self%skip_blanks
        value = arguments(1)
        if (row%operation == op_smooth_step) then
            call self%append_smooth_step(n, arguments, column, value)
        else if (n == 1) then
            call self%append_operation(row%operation, value, operand_type(), column)
        end if
        do i = 2, merge(n, 1, row%operation /= op_smooth_step)
            call self%append_operation(row%operation, value, arguments(i), column)
        end do
    end subroutine parse_function

    !> Number of arguments of a function, in words.
    pure function numbers_of_arguments(row) result(text)
        type(function_type), intent(in) :: row
        character(len=24) :: text

        if (row%operation == op_smooth_step) then
            text = '1 or 3 arguments'
        else if (row%most == 1) then
            text = '1 argument'
        else if (row%least == row%most) then
            text = to_text(row%least)//' arguments'
        else
            text = to_text(row%least)//' to '//to_text(row%most)//' arguments'
        end if
    end function numbers_of_arguments

    !> Append a power. A constant exponent requires no logarithm of the base, and a square becomes a product.
    subroutine append_power(self, base, exponent, column)
        class(parser_type), intent(inout) :: self
        type(operand_type), intent(inout) :: base
        type(operand_type), intent(in) :: exponent
        integer, intent(in) :: column
        type(operand_type) :: copy

        if (allocated(self%problem)) return
        if (base%node == 0 .or. exponent%node /= 0) then
            call self%append_operation(op_power, base, exponent, column)
        else if (.not. abs(exponent%value) > 0.0_wp) then
            base = operand_type(value=1.0_wp)
        else if (.not. abs(exponent%value - 2.0_wp) > 0.0_wp) then
            copy = base
            call self%append_operation(op_multiply, base, copy, column)
        else if (abs(exponent%value - 1.0_wp) > 0.0_wp) then
            call self%append_operation(op_power_constant, base, exponent, column)
        end if
    end subroutine append_power

    !> Append smooth_step(x), or smooth_step(x, from, to), which rises from 0 to 1 as x varies from `from` to `to`.
    subroutine append_smooth_step(self, n, arguments, column, value)
        class(parser_type), intent(inout) :: self
        integer, intent(in) :: n
        type(operand_type), intent(inout) :: arguments(:)
        integer, intent(in) :: column
        type(operand_type), intent(out) :: value

        value = arguments(1)
        if (n == 3) then
            call self%append_operation(op_subtract, value, arguments(2), column)
            call self%append_operation(op_subtract, arguments(3), arguments(2), column)
            call self%append_operation(op_divide, value, arguments(3), column)
        end if
        call self%append_operation(op_smooth_step, value, operand_type(), column)
    end subroutine append_smooth_step

    !> Append left := operation(left, right).
    subroutine append_operation(self, operation, left, right, column)
        class(parser_type), intent(inout) :: self
        integer, intent(in) :: operation
        type(operand_type), intent(inout) :: left
        type(operand_type), intent(in) :: right
        !> Position of the operation in the text.
        integer, intent(in) :: column

        if (allocated(self%problem)) return
        call self%list%apply(operation, left, right)
        if (self%list%is_full) then
            call self%fail(column, too_long)
        else if (left%node == 0 .and. .not. ieee_is_finite(left%value)) then
            call self%fail(column, 'the constants here do not yield a finite number')
        end if
    end subroutine append_operation
end module tandem_mechanism_expression_parser
