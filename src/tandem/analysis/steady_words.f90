! SPDX-License-Identifier: MIT
!> Steady motions as text: `NAME` for a motion along which it continues, or all of a group, `NAME=RATE` for a fixed rate, `any` for
!> all symmetries. Scenes, C, Fortran 77 and Python use the same syntax.
module tandem_analysis_steady_words
    use tandem_analysis_equilibrium_search, only: equilibrium_search_type
    use tandem_error, only: error_type, set_error
    use tandem_kinds, only: wp
    use tandem_model, only: model_type
    use tandem_model_affine_motion, only: motion_name_length
    use tandem_number_text, only: read_number
    use tandem_status, only: status_invalid_option
    implicit none (type, external)
    private

    public :: any_motion, find_steady_from_text, find_steady_from_words

    !> Used instead of names: all symmetries.
    character(len=*), parameter :: any_motion = 'any'

contains

    !> The steady motion near (q, qd); see `find_steady_motion` of `equilibrium_search_type`. Errors: those, and an invalid rate.
    subroutine find_steady_from_words(search, model, t, q, qd, words, error)
        type(equilibrium_search_type), intent(out) :: search
        class(model_type), intent(inout), target :: model
        !> Time (s), coordinates and velocities (n).
        real(wp), intent(in) :: t, q(:), qd(:)
        !> An empty list is equivalent to `any` alone.
        character(len=*), intent(in) :: words(:)
        type(error_type), allocatable, intent(out) :: error
        character(len=motion_name_length) :: names(size(words)), held(count(index(words, '=') > 0))
        real(wp) :: held_at(count(index(words, '=') > 0))
        integer :: i, k, last
        logical :: is_read

        k = 0
        do i = 1, size(words)
            last = index(words(i), '=')
            if (last == 0) last = len(words) + 1
            names(i) = adjustl(words(i)(:last - 1))
            if (last > len(words)) cycle
            k = k + 1
            held(k) = names(i)
            call read_number(words(i)(last + 1:), held_at(k), is_read)
            if (is_read) cycle
            call set_error(error, status_invalid_option, 'the rate in "'//trim(words(i))//'" is not a number', &
                'write NAME=RATE with a rate in 1/s, or in m/s')
            return
        end do
        if (size(words) == 0 .or. any(names == any_motion)) then
            call search%find_steady_motion(model, t, q, qd, error, held=held, held_at=held_at)
        else
            call search%find_steady_motion(model, t, q, qd, error, names, held, held_at)
        end if
    end subroutine find_steady_from_words

    !> Variant for words in a text, separated by blanks or commas.
    subroutine find_steady_from_text(search, model, t, q, qd, text, error)
        type(equilibrium_search_type), intent(out) :: search
        class(model_type), intent(inout), target :: model
        real(wp), intent(in) :: t, q(:), qd(:)
        character(len=*), intent(in) :: text
        type(error_type), allocatable, intent(out) :: error
        character(len=len(text)) :: words(count_words(text))

        call split_words(text, words)
        call find_steady_from_words(search, model, t, q, qd, words, error)
    end subroutine find_steady_from_text

    !> Number of words of a text.
    pure integer function count_words(text)
        character(len=*), intent(in) :: text
        integer :: from, to

        count_words = 0
        to = 0
        do
            call next_word(text, from, to)
            if (from == 0) return
            count_words = count_words + 1
        end do
    end function count_words

    !> The words of a text, separated by blanks or commas.
    pure subroutine split_words(text, words)
        character(len=*), intent(in) :: text
        !> Its size is the result of `count_words`.
        character(len=*), intent(out) :: words(:)
        integer :: from, i, to

        to = 0
        do i = 1, size(words)
            call next_word(text, from, to)
            words(i) = text(from:to)
        end do
    end subroutine split_words

    !> Find the next word of a text.
    pure subroutine next_word(text, from, to)
        character(len=*), intent(in) :: text
        !> Its first letter, 0 if there is none.
        integer, intent(out) :: from
        !> The last letter of the previous word, 0 at first; on return of this word.
        integer, intent(inout) :: to
        character(len=*), parameter :: blanks = ' ,'
        integer :: length

        from = verify(text(to + 1:), blanks)
        if (from == 0) return
        from = to + from
        length = scan(text(from:), blanks) - 1
        to = merge(len(text), from + length - 1, length < 0)
    end subroutine next_word
end module tandem_analysis_steady_words
