! SPDX-License-Identifier: MIT
!> Rules for the values of keys, in the words of messages.
module tandem_mechanism_value_rules
    use tandem_error, only: to_text
    use tandem_kinds, only: wp
    use tandem_mechanism_entries, only: atom_type, is_number, is_text, is_truth
    implicit none (type, external)
    private

    public :: anything, positive, not_negative, kind_of, text_problem, violated

    !> Ranges of numbers.
    integer, parameter :: anything = 0, positive = 1, not_negative = 2

contains

    !> Kind of an atom in words.
    pure function kind_of(atom) result(text)
        type(atom_type), intent(in) :: atom
        character(len=24) :: text

        select case (atom%kind)
        case (is_number)
            text = 'a number'
            if (atom%is_whole) text = 'an integer'
            if (abs(atom%number - anint(atom%number)) > 0.0_wp) text = 'a number with a fraction'
        case (is_text)
            text = 'a string'
        case (is_truth)
            text = 'true or false'
        case default
            text = atom%text
        end select
    end function kind_of

    !> Reason why an atom is not a valid text; empty if it is.
    pure function text_problem(atom) result(problem)
        type(atom_type), intent(in) :: atom
        character(len=96) :: problem

        problem = ''
        if (atom%kind /= is_text) then
            problem = 'must be a string in quotes, not '//kind_of(atom)
        else if (allocated(atom%problem)) then
            problem = atom%problem
        end if
    end function text_problem

    !> Condition that a number violates; empty if it is valid.
    pure function violated(value, check) result(problem)
        real(wp), intent(in) :: value
        integer, intent(in), optional :: check
        character(len=96) :: problem

        problem = ''
        if (.not. present(check)) return
        if (check == positive .and. .not. value > 0.0_wp) problem = 'must be positive, not '//to_text(value)
        if (check == not_negative .and. .not. value >= 0.0_wp) problem = 'must not be negative, but is '//to_text(value)
    end function violated
end module tandem_mechanism_value_rules
