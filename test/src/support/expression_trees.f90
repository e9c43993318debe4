! SPDX-License-Identifier: MIT
!> Random expressions as text, and the same ones as trees that are differentiated symbolically: an independent computation of the
!> derivatives of expressions.
module expression_trees
    use tandem, only: wp
    use tandem_linalg_random, only: random_vector
    implicit none (type, external)
    private

    public :: trees_type

    integer, parameter :: most = 400000
    !> Precedence of a text: sums, products, signs, powers, and atoms without parentheses.
    integer, parameter :: sum_level = 1, product_level = 2, sign_level = 3, power_level = 4, atom_level = 5

    type :: string_type
        character(len=:), allocatable :: text
        integer :: level = atom_level
    end type string_type

    !> Nodes, each after its operands. Only those of a random expression have a text.
    type :: trees_type
        integer :: n = 0, seed = 1
        character(len=8), allocatable :: names(:)
        integer, allocatable :: left(:), right(:)
        !> Values of constants; values at a point, and bounds of their rounding errors in units of rounding.
        real(wp), allocatable :: constants(:), values(:), errors(:)
        type(string_type), allocatable :: texts(:)
    contains
        procedure :: clear
        procedure :: make_random
        procedure :: text_of
        procedure :: derivative
        procedure :: along
        procedure :: evaluate
        procedure, private :: node
        procedure, private :: leaf
        procedure, private :: draw
        procedure, private :: write_text
    end type trees_type

contains

    !> Remove all nodes.
    subroutine clear(self, seed)
        class(trees_type), intent(inout) :: self
        integer, intent(in) :: seed

        self%seed = seed
        self%n = 0
        if (allocated(self%names)) return
        allocate (self%names(most), self%left(most), self%right(most), self%constants(most), self%values(most), self%errors(most))
        allocate (self%texts(2000))
    end subroutine clear

    !> A node; products with zero and one and sums with zero are simplified.
    recursive integer function node(self, name, left, right) result(place)
        class(trees_type), intent(inout) :: self
        character(len=*), intent(in) :: name
        integer, intent(in) :: left
        integer, intent(in), optional :: right

        if (present(right)) then
            if (name == '*') then
                if (is(left, 0.0_wp) .or. is(right, 1.0_wp)) then
                    place = left
                    return
                else if (is(right, 0.0_wp) .or. is(left, 1.0_wp)) then
                    place = right
                    return
                end if
            else if (name == '+') then
                if (is(left, 0.0_wp)) then
                    place = right
                    return
                else if (is(right, 0.0_wp)) then
                    place = left
                    return
                end if
            end if
        end if
        self%n = self%n + 1
        place = self%n
        if (place > most) error stop 'too many nodes'
        self%names(place) = name
        self%left(place) = left
        self%right(place) = left
        if (present(right)) self%right(place) = right

    contains

        logical function is(operand, value)
            integer, intent(in) :: operand
            real(wp), intent(in) :: value

            is = .false.
            if (self%names(operand) == 'number') is = .not. abs(self%constants(operand) - value) > 0.0_wp
        end function is
    end function node

    !> A constant.
    integer function leaf(self, value) result(place)
        class(trees_type), intent(inout) :: self
        real(wp), intent(in) :: value

        self%n = self%n + 1
        place = self%n
        if (place > most) error stop 'too many nodes'
        self%names(place) = 'number'
        self%constants(place) = value
    end function leaf

    !> A random integer from 1 to n.
    integer function draw(self, n)
        class(trees_type), intent(inout) :: self
        integer, intent(in) :: n
        real(wp) :: value(1)

        value = random_vector(self%seed, 1)
        draw = 1 + min(n - 1, int(n*(value(1) + 1.0_wp)/2))
    end function draw

    !> A random expression of x1, x2 and x3, defined everywhere.
    recursive integer function make_random(self, depth) result(place)
        class(trees_type), intent(inout) :: self
        !> Largest depth.
        integer, intent(in) :: depth
        integer :: a, b, kind
        character(len=8), parameter :: smooth(6) = ['sin     ', 'cos     ', 'tanh    ', 'atan    ', 'abs     ', 'ramp    ']
        character(len=8), parameter :: bounded(5) = ['tan     ', 'exp     ', 'sinh    ', 'cosh    ', 'smooth  ']
        character(len=8), parameter :: positive(2) = ['log     ', 'sqrt    ']

        if (depth <= 0) then
            if (self%draw(3) == 1) then
                place = self%leaf(self%draw(40)/8.0_wp)
            else
                place = self%node('x', self%draw(3))
            end if
            call self%write_text(place)
            return
        end if
        kind = self%draw(16)
        a = self%make_random(depth - 1)
        select case (kind)
        case (1, 2)
            b = self%make_random(depth - 1)
            place = self%node('+', a, b)
        case (3, 4)
            b = self%make_random(depth - 1)
            place = self%node('-', a, b)
        case (5, 6)
            b = self%make_random(depth - 1)
            place = self%node('*', a, b)
        case (7)
            b = above_zero(self%make_random(depth - 2))
            place = self%node('/', a, b)
        case (8)
            place = self%node('^', a, self%leaf(real(1 + self%draw(3), wp)))
            call self%write_text(self%right(place))
        case (9)
            a = above_zero(a)
            b = bounded_by_sine(self%make_random(depth - 2))
            place = self%node('^', a, b)
        case (10)
            place = self%node('neg', a)
        case (11)
            place = self%node(smooth(self%draw(size(smooth))), a)
        case (12)
            place = self%node(bounded(self%draw(size(bounded))), bounded_by_sine(a))
        case (13)
            place = self%node(positive(self%draw(size(positive))), above_zero(a))
        case (14)
            place = self%leaf(0.75_wp)
            call self%write_text(place)
            place = self%node('*', place, bounded_by_sine(a))
            call self%write_text(place)
            place = self%node(trim(merge('asin', 'acos', self%draw(2) == 1)), place)
        case (15)
            b = self%make_random(depth - 1)
            place = self%node(trim(merge('min', 'max', self%draw(2) == 1)), a, b)
        case default
            b = above_zero(self%make_random(depth - 2))
            place = self%node('atan2', a, b)
        end select
        call self%write_text(place)

    contains

        !> 1.25 + a^2.
        integer function above_zero(a)
            integer, intent(in) :: a
            integer :: square

            square = self%leaf(2.0_wp)
            call self%write_text(square)
            square = self%node('^', a, square)
            call self%write_text(square)
            above_zero = self%leaf(1.25_wp)
            call self%write_text(above_zero)
            above_zero = self%node('+', above_zero, square)
            call self%write_text(above_zero)
        end function above_zero

        !> sin(a).
        integer function bounded_by_sine(a)
            integer, intent(in) :: a

            bounded_by_sine = self%node('sin', a)
            call self%write_text(bounded_by_sine)
        end function bounded_by_sine
    end function make_random

    !> Text of a node, with the necessary parentheses and some more.
    subroutine write_text(self, place)
        class(trees_type), intent(inout) :: self
        integer, intent(in) :: place
        character(len=24) :: buffer
        character(len=:), allocatable :: name
        integer :: a, b

        if (allocated(self%texts(place)%text)) deallocate (self%texts(place)%text)
        name = trim(self%names(place))
        a = self%left(place)
        b = self%right(place)
        self%texts(place)%level = atom_level
        select case (name)
        case ('number')
            write (buffer, '(f0.4)') self%constants(place)
            self%texts(place)%text = trim(buffer)
        case ('x')
            write (buffer, '("x", i0)') a
            self%texts(place)%text = trim(buffer)
        case ('+', '-')
            call join(sum_level, sum_level, product_level)
        case ('*', '/')
            call join(product_level, product_level, sign_level)
        case ('^')
            call join(power_level, atom_level, sign_level)
        case ('neg')
            self%texts(place)%text = '-'//wrapped(a, sign_level)
            self%texts(place)%level = sign_level
        case ('min', 'max', 'atan2')
            self%texts(place)%text = name//'('//self%texts(a)%text//','//self%texts(b)%text//')'
        case ('smooth')
            self%texts(place)%text = 'smooth_step('//self%texts(a)%text//')'
        case default
            self%texts(place)%text = name//'('//self%texts(a)%text//')'
        end select

    contains

        !> An operator between its operands, which need parentheses below given levels.
        subroutine join(level, left_level, right_level)
            integer, intent(in) :: level, left_level, right_level

            self%texts(place)%level = level
            self%texts(place)%text = wrapped(a, left_level)//name//wrapped(b, right_level)
            if (self%draw(4) == 1) self%texts(place)%text = wrapped(a, left_level)//' '//name//' '//wrapped(b, right_level)
        end subroutine join

        function wrapped(operand, level) result(text)
            integer, intent(in) :: operand, level
            character(len=:), allocatable :: text

            text = self%texts(operand)%text
            if (self%texts(operand)%level < level .or. self%draw(8) == 1) text = '('//text//')'
        end function wrapped
    end subroutine write_text

    !> The text of a random expression.
    function text_of(self, place) result(text)
        class(trees_type), intent(in) :: self
        integer, intent(in) :: place
        character(len=:), allocatable :: text

        text = self%texts(place)%text
    end function text_of

    !> The derivative with respect to a variable, by symbolic rules.
    recursive integer function derivative(self, place, variable) result(d)
        class(trees_type), intent(inout) :: self
        integer, intent(in) :: place, variable
        integer :: a, b, da, db, outer
        character(len=8) :: name

        name = self%names(place)
        a = self%left(place)
        b = self%right(place)
        select case (name)
        case ('number', 'sign', 'step')
            d = self%leaf(0.0_wp)
            return
        case ('x')
            d = self%leaf(merge(1.0_wp, 0.0_wp, a == variable))
            return
        case ('+', '-', '*', '/', '^', 'min', 'max', 'atan2')
            db = self%derivative(b, variable)
        case default
            db = 0
        end select
        da = self%derivative(a, variable)
        select case (name)
        case ('+')
            d = self%node('+', da, db)
        case ('-')
            d = self%node('-', da, db)
        case ('*')
            d = self%node('+', self%node('*', da, b), self%node('*', a, db))
        case ('/')
            d = self%node('-', self%node('*', da, b), self%node('*', a, db))
            d = self%node('/', d, self%node('*', b, b))
        case ('^')
            if (self%names(b) == 'number') then
                outer = self%node('^', a, self%leaf(self%constants(b) - 1.0_wp))
                d = self%node('*', self%node('*', b, outer), da)
            else
                ! (a^b)' = a^b (b' log a + b a'/a)
                outer = self%node('/', self%node('*', b, da), a)
                outer = self%node('+', self%node('*', db, self%node('log', a)), outer)
                d = self%node('*', place, outer)
            end if
        case ('min', 'max')
            ! Of min, the operand that is less; of max, the other one.
            outer = self%node('step', self%node('-', a, b))
            if (name == 'min') outer = self%node('-', self%leaf(1.0_wp), outer)
            d = self%node('*', self%node('-', self%leaf(1.0_wp), outer), db)
            d = self%node('+', self%node('*', outer, da), d)
        case ('atan2')
            d = self%node('-', self%node('*', da, b), self%node('*', a, db))
            d = self%node('/', d, self%node('+', self%node('*', a, a), self%node('*', b, b)))
        case ('neg')
            d = self%node('neg', da)
        case ('sin')
            d = self%node('*', self%node('cos', a), da)
        case ('cos')
            d = self%node('*', self%node('neg', self%node('sin', a)), da)
        case ('tan')
            d = self%node('/', da, self%node('^', self%node('cos', a), self%leaf(2.0_wp)))
        case ('sinh')
            d = self%node('*', self%node('cosh', a), da)
        case ('cosh')
            d = self%node('*', self%node('sinh', a), da)
        case ('tanh')
            d = self%node('/', da, self%node('^', self%node('cosh', a), self%leaf(2.0_wp)))
        case ('atan')
            d = self%node('/', da, self%node('+', self%leaf(1.0_wp), self%node('*', a, a)))
        case ('asin', 'acos')
            d = self%node('/', da, self%node('sqrt', self%node('-', self%leaf(1.0_wp), self%node('*', a, a))))
            if (name == 'acos') d = self%node('neg', d)
        case ('exp')
            d = self%node('*', place, da)
        case ('log')
            d = self%node('/', da, a)
        case ('sqrt')
            d = self%node('/', da, self%node('*', self%leaf(2.0_wp), place))
        case ('abs')
            d = self%node('*', self%node('sign', a), da)
        case ('ramp')
            d = self%node('*', self%node('step', a), da)
        case ('smooth')
            ! 30 s^2 (1 - s)^2 with s = min(ramp(a), 1)
            outer = self%node('min', self%node('ramp', a), self%leaf(1.0_wp))
            outer = self%node('*', outer, self%node('-', self%leaf(1.0_wp), outer))
            d = self%node('*', self%node('*', self%leaf(30.0_wp), self%node('*', outer, outer)), da)
        case default
            error stop 'no rule for '//name
        end select
    end function derivative

    !> The derivative along a direction.
    integer function along(self, place, v) result(d)
        class(trees_type), intent(inout) :: self
        integer, intent(in) :: place
        real(wp), intent(in) :: v(:)
        integer :: i

        d = self%leaf(0.0_wp)
        do i = 1, size(v)
            d = self%node('+', d, self%node('*', self%leaf(v(i)), self%derivative(place, i)))
        end do
    end function along

    !> The values of all nodes at a point, and bounds of their errors in units of rounding.
    subroutine evaluate(self, x)
        class(trees_type), intent(inout) :: self
        real(wp), intent(in) :: x(:)
        real(wp) :: a, b, ea, eb, f, e
        integer :: i

        do i = 1, self%n
            if (self%names(i) == 'number') then
                f = self%constants(i)
                e = abs(f)
            else if (self%names(i) == 'x') then
                f = x(self%left(i))
                e = abs(f)
            else
                a = self%values(self%left(i))
                b = self%values(self%right(i))
                ea = self%errors(self%left(i))
                eb = self%errors(self%right(i))
                call apply(trim(self%names(i)), a, b, ea, eb, f, e)
            end if
            self%values(i) = f
            self%errors(i) = e
        end do
    end subroutine evaluate

    !> One operation, with the propagation of rounding to first order.
    subroutine apply(name, a, b, ea, eb, f, e)
        character(len=*), intent(in) :: name
        real(wp), intent(in) :: a, b, ea, eb
        real(wp), intent(out) :: f, e

        select case (name)
        case ('+')
            f = a + b
            e = ea + eb
        case ('-')
            f = a - b
            e = ea + eb
        case ('*')
            f = a*b
            e = ea*abs(b) + eb*abs(a)
        case ('/')
            f = a/b
            e = (ea + eb*abs(f))/abs(b)
        case ('^')
            if (abs(b - anint(b)) > 0.0_wp) then
                f = a**b
                e = abs(f)*(abs(b/a)*ea + abs(log(a))*eb)
            else
                f = a**nint(b)
                e = 0.0_wp
                if (nint(b) /= 0) e = abs(b*a**(nint(b) - 1))*ea
            end if
        case ('min')
            f = min(a, b)
            e = ea + eb
        case ('max')
            f = max(a, b)
            e = ea + eb
        case ('atan2')
            f = atan2(a, b)
            e = (abs(b)*ea + abs(a)*eb)/(a*a + b*b)
        case ('neg')
            f = -a
            e = ea
        case ('sin')
            f = sin(a)
            e = ea
        case ('cos')
            f = cos(a)
            e = ea
        case ('tan')
            f = tan(a)
            e = (1.0_wp + f*f)*ea
        case ('sinh')
            f = sinh(a)
            e = cosh(a)*ea
        case ('cosh')
            f = cosh(a)
            e = abs(sinh(a))*ea
        case ('tanh', 'atan')
            f = merge(tanh(a), atan(a), name == 'tanh')
            e = ea
        case ('asin', 'acos')
            f = merge(asin(a), acos(a), name == 'asin')
            e = ea/sqrt(1.0_wp - a*a)
        case ('exp')
            f = exp(a)
            e = f*ea
        case ('log')
            f = log(a)
            e = ea/abs(a)
        case ('sqrt')
            f = sqrt(a)
            e = 0.5_wp*ea/f
        case ('abs')
            f = abs(a)
            e = ea
        case ('ramp')
            f = max(a, 0.0_wp)
            e = ea
        case ('sign')
            f = sign(1.0_wp, a)
            e = 0.0_wp
        case ('step')
            f = merge(1.0_wp, 0.0_wp, a >= 0.0_wp)
            e = 0.0_wp
        case ('smooth')
            f = min(max(a, 0.0_wp), 1.0_wp)
            e = 30.0_wp*ea
            f = f**3*(10.0_wp + f*(6.0_wp*f - 15.0_wp))
        case default
            error stop 'no operation '//name
        end select
        e = e + abs(f)
    end subroutine apply
end module expression_trees
