! SPDX-License-Identifier: MIT
!> Error reports of cold paths: an allocatable `error_type`, unallocated on success.
module tandem_error
    use tandem_status, only: status_name, status_of, status_type
    implicit none (type, external)
    private

    public :: error_type, set_error, to_text

    !> A failure: its status code (see `tandem_status`) and a message with problem, place and remedy.
    type :: error_type
        integer :: stat = 0
        character(len=:), allocatable :: message
    end type error_type

    !> Numbers as text for messages.
    interface to_text
        module procedure integer_to_text
        module procedure real_to_text
    end interface to_text

contains

    !> Allocate `error` with a status and a message; the table's advice is appended unless the message brings its own.
    subroutine set_error(error, stat, message, advice)
        type(error_type), allocatable, intent(out) :: error
        !> Status code, negative.
        integer, intent(in) :: stat
        !> Problem and place.
        character(len=*), intent(in) :: message
        !> Remedy, if the table's advice is too general.
        character(len=*), intent(in), optional :: advice
        type(status_type) :: row

        row = status_of(stat)
        allocate (error)
        error%stat = stat
        if (present(advice)) then
            error%message = status_name(stat)//': '//message//'; '//advice
        else
            error%message = status_name(stat)//': '//message//'; '//trim(row%advice)
        end if
    end subroutine set_error

    !> Length of an integer as text (a deferred length would be static memory, see `tandem_status`).
    pure integer function integer_length(value)
        integer, intent(in) :: value
        character(len=20) :: buffer

        write (buffer, '(i0)') value
        integer_length = len_trim(buffer)
    end function integer_length

    !> An integer without blanks.
    pure function integer_to_text(value) result(text)
        integer, intent(in) :: value
        character(len=integer_length(value)) :: text

        write (text, '(i0)') value
    end function integer_to_text

    !> Length of a real number as text.
    pure integer function real_length(value)
        use tandem_kinds, only: wp
        real(wp), intent(in) :: value
        character(len=24) :: buffer

        write (buffer, '(g0.7)') value
        real_length = len_trim(adjustl(buffer))
    end function real_length

    !> A real number with seven digits and without blanks.
    pure function real_to_text(value) result(text)
        use tandem_kinds, only: wp
        real(wp), intent(in) :: value
        character(len=real_length(value)) :: text
        character(len=24) :: buffer

        write (buffer, '(g0.7)') value
        text = adjustl(buffer)
    end function real_to_text
end module tandem_error
