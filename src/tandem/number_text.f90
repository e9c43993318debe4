! SPDX-License-Identifier: MIT
!> Numbers from text by one strict grammar. A list-directed read accepts far more: repetitions (`2*100`), separators (`,` and `/`)
!> that leave the number undefined, exponents without a letter (`1-5`), and any text after a blank.
module tandem_number_text
    use tandem_kinds, only: long, wp
    use, intrinsic :: ieee_arithmetic, only: ieee_is_finite
    implicit none (type, external)
    private

    public :: read_number, read_numbers

    character(len=*), parameter :: digits = '0123456789', blanks = ' '//achar(9)//achar(13)

    !> Finite number in a text. Surrounding blanks are allowed, but nothing else.
    interface read_number
        module procedure read_real
        module procedure read_integer
        module procedure read_long
    end interface read_number

contains

    !> A real number: sign, digits with at most one point, exponent; sign and exponent may be missing.
    pure subroutine read_real(text, number, is_read)
        character(len=*), intent(in) :: text
        !> 0 if the text is not a number.
        real(wp), intent(out) :: number
        logical, intent(out) :: is_read
        integer :: stat

        number = 0.0_wp
        is_read = is_decimal(trim(adjustl(text)))
        if (.not. is_read) return
        read (text, *, iostat=stat) number
        is_read = stat == 0
        if (is_read) is_read = ieee_is_finite(number)
        if (.not. is_read) number = 0.0_wp
    end subroutine read_real

    !> A whole number in digits, with or without a sign.
    pure subroutine read_integer(text, number, is_read)
        character(len=*), intent(in) :: text
        !> 0 if the text is not a whole number of this kind.
        integer, intent(out) :: number
        logical, intent(out) :: is_read
        integer(long) :: wide

        number = 0
        call read_long(text, wide, is_read)
        is_read = is_read .and. wide >= -huge(number) .and. wide <= huge(number)
        if (is_read) number = int(wide)
    end subroutine read_integer

    !> The same for whole numbers of 64 bits.
    pure subroutine read_long(text, number, is_read)
        character(len=*), intent(in) :: text
        integer(long), intent(out) :: number
        logical, intent(out) :: is_read
        integer :: stat

        number = 0
        is_read = is_decimal(trim(adjustl(text))) .and. scan(text, '.eE') == 0
        if (.not. is_read) return
        read (text, *, iostat=stat) number
        is_read = stat == 0
        if (.not. is_read) number = 0
    end subroutine read_long

    !> Read as many real numbers as fit, separated by blanks, tabs or one comma.
    pure subroutine read_numbers(text, numbers, is_read, may_be_more)
        character(len=*), intent(in) :: text
        real(wp), intent(out) :: numbers(:)
        !> False if one is not a number, if there are fewer, or if anything follows without `may_be_more`.
        logical, intent(out) :: is_read
        logical, intent(in), optional :: may_be_more
        integer :: from, to, k

        numbers = 0.0_wp
        is_read = .true.
        to = 0
        do k = 1, size(numbers)
            to = behind_blanks(text, to)
            if (k > 1 .and. text(to + 1:min(to + 1, len(text))) == ',') then
                to = to + 1
                to = behind_blanks(text, to)
            end if
            from = to + 1
            to = from + scan(text(from:)//' ', blanks//',') - 2
            call read_real(text(from:to), numbers(k), is_read)
            if (.not. is_read) return
        end do
        if (present(may_be_more)) then
            if (may_be_more) return
        end if
        is_read = behind_blanks(text, to) == len(text)
    end subroutine read_numbers

    !> Last of the blanks that follow a place.
    pure integer function behind_blanks(text, place)
        character(len=*), intent(in) :: text
        integer, intent(in) :: place
        integer :: n

        n = verify(text(place + 1:), blanks)
        behind_blanks = merge(place + n - 1, len(text), n > 0)
    end function behind_blanks

    !> True if a text without blanks is a decimal number.
    pure logical function is_decimal(text)
        character(len=*), intent(in) :: text
        integer :: from, e

        from = 1
        if (scan(text(:min(1, len(text))), '+-') > 0) from = 2
        e = scan(text, 'eE')
        if (e == 0) e = len(text) + 1
        associate (mantissa => text(from:e - 1))
            is_decimal = verify(mantissa, digits//'.') == 0 .and. scan(mantissa, digits) > 0 .and. &
                index(mantissa, '.') == index(mantissa, '.', back=.true.)
        end associate
        if (e > len(text)) return
        from = e + 1
        if (scan(text(from:min(from, len(text))), '+-') > 0) from = from + 1
        is_decimal = is_decimal .and. from <= len(text) .and. verify(text(from:), digits) == 0
    end function is_decimal
end module tandem_number_text
