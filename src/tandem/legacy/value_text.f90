! SPDX-License-Identifier: MIT
!> Values of keys of a mechanism as text, in the syntax of scene files: a number, "a text", true, false, or a list of these in
!> brackets.
module tandem_legacy_value_text
    use tandem_kinds, only: wp
    use tandem_mechanism_entries, only: atom_type, is_text, is_truth, value_type
    use tandem_number_text, only: read_number
    implicit none (type, external)
    private

    public :: read_value

contains

    !> Read a value.
    pure subroutine read_value(text, value, is_good)
        character(len=*), intent(in) :: text
        type(value_type), intent(out) :: value
        !> True if the text consists of one valid value.
        logical, intent(out) :: is_good
        type(atom_type) :: atom
        integer :: at, n

        at = 1
        allocate (value%atoms(0))
        call skip_blanks(text, at)
        value%is_list = next(text, at) == '['
        if (.not. value%is_list) then
            call read_atom(text, at, atom, is_good)
            if (is_good) value%atoms = [atom]
        else
            at = at + 1
            call skip_blanks(text, at)
            if (next(text, at) /= '[') then
                call read_atoms(text, at, value%atoms, is_good)
            else
                do
                    is_good = next(text, at) == '['
                    if (.not. is_good) exit
                    at = at + 1
                    n = size(value%atoms)
                    call read_atoms(text, at, value%atoms, is_good)
                    if (n == 0) value%row_length = size(value%atoms)
                    is_good = is_good .and. size(value%atoms) == n + value%row_length .and. value%row_length > 0
                    if (.not. is_good) exit
                    call skip_blanks(text, at)
                    if (next(text, at) == ',') at = at + 1
                    call skip_blanks(text, at)
                    if (next(text, at) == ']') exit
                end do
                at = at + 1
            end if
        end if
        call skip_blanks(text, at)
        is_good = is_good .and. at > len(text)
    end subroutine read_value

    !> Read the remainder of a list, from the character after its opening bracket to the closing bracket.
    pure subroutine read_atoms(text, at, atoms, is_good)
        character(len=*), intent(in) :: text
        integer, intent(inout) :: at
        type(atom_type), allocatable, intent(inout) :: atoms(:)
        logical, intent(out) :: is_good
        type(atom_type) :: atom

        do
            call skip_blanks(text, at)
            is_good = next(text, at) == ']'
            if (is_good) exit
            call read_atom(text, at, atom, is_good)
            if (.not. is_good) return
            atoms = [atoms, atom]
            call skip_blanks(text, at)
            is_good = next(text, at) == ',' .or. next(text, at) == ']'
            if (.not. is_good) return
            if (next(text, at) == ',') at = at + 1
        end do
        at = at + 1
    end subroutine read_atoms

    !> Character at a position; a blank beyond the end.
    pure character function next(text, at)
        character(len=*), intent(in) :: text
        integer, intent(in) :: at

        next = ' '
        if (at <= len(text)) next = text(at:at)
    end function next

    pure subroutine skip_blanks(text, at)
        character(len=*), intent(in) :: text
        integer, intent(inout) :: at

        do while (at <= len(text))
            if (text(at:at) /= ' ') exit
            at = at + 1
        end do
    end subroutine skip_blanks

    !> Read a number, a text or a logical value.
    pure subroutine read_atom(text, at, atom, is_good)
        character(len=*), intent(in) :: text
        integer, intent(inout) :: at
        type(atom_type), intent(out) :: atom
        logical, intent(out) :: is_good
        integer :: first

        if (next(text, at) == '"') then
            call read_text(text, at, atom, is_good)
            return
        end if
        first = at
        do while (scan(next(text, at), ' ,]') == 0)
            at = at + 1
        end do
        associate (word => text(first:at - 1))
            select case (word)
            case ('true', 'false')
                atom%kind = is_truth
                atom%truth = word == 'true'
                is_good = .true.
            case default
                call read_number(word, atom%number, is_good)
            end select
        end associate
    end subroutine read_atom

    !> Read a text in quotes, in which \" and \\ denote a quote and a backslash.
    pure subroutine read_text(text, at, atom, is_good)
        character(len=*), intent(in) :: text
        integer, intent(inout) :: at
        type(atom_type), intent(inout) :: atom
        logical, intent(out) :: is_good
        character(len=len(text)) :: found
        integer :: n

        atom%kind = is_text
        n = 0
        at = at + 1
        do
            is_good = at <= len(text)
            if (.not. is_good) return
            if (text(at:at) == '"') exit
            if (text(at:at) == '\') then
                at = at + 1
                is_good = next(text, at) == '"' .or. next(text, at) == '\'
                if (.not. is_good) return
            end if
            n = n + 1
            found(n:n) = text(at:at)
            at = at + 1
        end do
        at = at + 1
        atom%text = found(:n)
    end subroutine read_text
end module tandem_legacy_value_text
