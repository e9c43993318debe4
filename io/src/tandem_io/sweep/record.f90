! SPDX-License-Identifier: MIT
!> The record of a case, and its representation as 64-bit words for messages and the journal.
module tandem_io_sweep_record
    use tandem, only: long, status_name, wp
    implicit none (type, external)
    private

    public :: record_type, words_of_record, message_length, message_words, status_crashed, status_hung, name_of_status

    !> Statuses that occur only in sweeps: the process of a case ended, or did not return in time.
    integer, parameter :: status_crashed = -101, status_hung = -102
    !> Length of a message in letters and in words.
    integer, parameter :: letters_per_word = 8, message_words = 40, message_length = letters_per_word*message_words
    !> Number of words before the values: case, status, seconds, words of the message.
    integer, parameter :: n_header = 4

    type :: record_type
        !> Number of the case.
        integer(long) :: case = 0
        !> A code of `tandem_status`, or one of the statuses above; 0 for success.
        integer :: status = 0
        !> Wall time of the case.
        real(wp) :: seconds = 0.0_wp
        !> Kept values; NaN if missing.
        real(wp), allocatable :: values(:)
        !> Description of the failure, on one line.
        character(len=message_length) :: message = ''
    contains
        procedure :: to_words, from_words
    end type record_type

contains

    !> Largest number of words of a record.
    pure integer function words_of_record(outputs)
        integer, intent(in) :: outputs

        words_of_record = n_header + outputs + message_words
    end function words_of_record

    !> Name of a status.
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

    !> Convert to words; the first `n` elements of `words` are set.
    pure subroutine to_words(self, words, n)
        class(record_type), intent(in) :: self
        integer(long), intent(inout) :: words(:)
        integer, intent(out) :: n
        integer :: i, length

        length = (len_trim(self%message) + letters_per_word - 1)/letters_per_word
        words(1) = self%case
        words(2) = self%status
        words(3) = transfer(self%seconds, 0_long)
        words(4) = length
        do i = 1, size(self%values)
            words(n_header + i) = transfer(self%values(i), 0_long)
        end do
        n = n_header + size(self%values)
        do i = 1, length
            words(n + i) = transfer(self%message(letters_per_word*(i - 1) + 1:letters_per_word*i), 0_long)
        end do
        n = n + length
    end subroutine to_words

    !> Convert from words; `values` must have the size of the converted record.
    pure subroutine from_words(self, words)
        class(record_type), intent(inout) :: self
        !> Words set by `to_words`.
        integer(long), intent(in) :: words(:)
        character(len=letters_per_word) :: letters
        integer :: i, n

        self%case = words(1)
        self%status = int(words(2))
        self%seconds = transfer(words(3), 0.0_wp)
        n = n_header + size(self%values)
        do i = 1, size(self%values)
            self%values(i) = transfer(words(n_header + i), 0.0_wp)
        end do
        self%message = ''
        do i = 1, min(size(words) - n, message_words)
            letters = transfer(words(n + i), letters)
            self%message(letters_per_word*(i - 1) + 1:letters_per_word*i) = letters
        end do
    end subroutine from_words
end module tandem_io_sweep_record
