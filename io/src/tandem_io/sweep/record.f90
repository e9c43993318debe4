! SPDX-License-Identifier: MIT
!> The record of a case, and its form of 64-bit words for messages and the journal.
module tandem_io_sweep_record
    use tandem, only: long, status_name, wp
    implicit none (type, external)
    private

    public :: record_type, words_of_record, message_length, message_words, status_crashed, status_hung, name_of_status

    !> Statuses that only sweeps have: the process of a case ended, or did not return in time.
    integer, parameter :: status_crashed = -101, status_hung = -102
    !> Letters of a message, and the words that they take.
    integer, parameter :: letters_a_word = 8, message_words = 40, message_length = letters_a_word*message_words
    !> Words before the numbers: case, status, seconds, words of the message.
    integer, parameter :: head = 4

    type :: record_type
        !> Its number.
        integer(long) :: case = 0
        !> A code of `tandem_status`, or one of the above; 0 for success.
        integer :: status = 0
        !> Wall time of the case.
        real(wp) :: seconds = 0.0_wp
        !> Kept values, NaN if missing.
        real(wp), allocatable :: values(:)
        !> Description of the failure, on one line.
        character(len=message_length) :: message = ''
    contains
        procedure :: to_words, from_words
    end type record_type

contains

    !> Most words of a record.
    pure integer function words_of_record(outputs)
        integer, intent(in) :: outputs

        words_of_record = head + outputs + message_words
    end function words_of_record

    !> The name of a status.
    pure function name_of_status(status) result(name)
        integer, intent(in) :: status
        character(len=24) :: name

        select case (status)
        case (status_crashed)
            name = 'crashed'
        case (status_hung)
            name = 'hung'
        case default
            name = status_name(status)
        end select
    end function name_of_status

    !> As words; the first `n` are in use.
    pure subroutine to_words(self, words, n)
        class(record_type), intent(in) :: self
        integer(long), intent(inout) :: words(:)
        integer, intent(out) :: n
        integer :: i, length

        length = (len_trim(self%message) + letters_a_word - 1)/letters_a_word
        words(1) = self%case
        words(2) = self%status
        words(3) = transfer(self%seconds, 0_long)
        words(4) = length
        do i = 1, size(self%values)
            words(head + i) = transfer(self%values(i), 0_long)
        end do
        n = head + size(self%values)
        do i = 1, length
            words(n + i) = transfer(self%message(letters_a_word*(i - 1) + 1:letters_a_word*i), 0_long)
        end do
        n = n + length
    end subroutine to_words

    !> From words.
    pure subroutine from_words(self, words)
        class(record_type), intent(inout) :: self
        !> Those of `to_words`; `values` has its size.
        integer(long), intent(in) :: words(:)
        character(len=letters_a_word) :: letters
        integer :: i, n

        self%case = words(1)
        self%status = int(words(2))
        self%seconds = transfer(words(3), 0.0_wp)
        n = head + size(self%values)
        do i = 1, size(self%values)
            self%values(i) = transfer(words(head + i), 0.0_wp)
        end do
        self%message = ''
        do i = 1, min(size(words) - n, message_words)
            letters = transfer(words(n + i), letters)
            self%message(letters_a_word*(i - 1) + 1:letters_a_word*i) = letters
        end do
    end subroutine from_words
end module tandem_io_sweep_record
