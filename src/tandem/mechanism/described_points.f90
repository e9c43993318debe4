! SPDX-License-Identifier: MIT
!> Points in the keys of a mechanism: named points of bodies, and points of elements given by text; names of the variables that
!> expressions in keys may contain.
module tandem_mechanism_described_points
    use tandem_error, only: error_type
    use tandem_kinds, only: wp
    use tandem_mechanism_builder, only: builder_type
    use tandem_mechanism_element_keys, only: key_length, text_length
    use tandem_mechanism_formula, only: variable_type
    use tandem_mechanism_key_reader, only: anything, reader_type
    implicit none (type, external)
    private

    public :: read_points, take_point, take_points, list_variables

contains

    !> The points of a body or of the ground: all keys below `points`.
    subroutine read_points(reader, body, mechanism)
        type(reader_type), intent(inout) :: reader
        character(len=*), intent(in) :: body
        class(builder_type), intent(inout) :: mechanism
        character(len=key_length), allocatable :: names(:)
        real(wp), allocatable :: place(:)
        type(error_type), allocatable :: error
        integer :: i

        call reader%keys_below('points', names)
        do i = 1, size(names)
            call reader%get_numbers('points.'//trim(names(i)), [merge(2, 3, mechanism%planar)], place, anything, 'm', &
                'in the body''s axes, from its centre of mass')
            if (reader%failed()) return
            call mechanism%add_point(body, trim(names(i)), place, error)
            call reader%blame(error)
            deallocate (place)
        end do
    end subroutine read_points

    !> A point given by text: a body, `body.point`, or `body:[x, y]`, which becomes a point without a name of its own.
    subroutine take_point(reader, key, text, mechanism, n_points, point)
        type(reader_type), intent(inout) :: reader
        character(len=*), intent(in) :: key, text
        class(builder_type), intent(inout) :: mechanism
        !> Number of unnamed points so far.
        integer, intent(inout) :: n_points
        character(len=key_length), intent(out) :: point
        type(error_type), allocatable :: error
        real(wp) :: place(3)
        character(len=8) :: name
        integer :: colon, from, to, n, n_place

        point = text
        colon = index(text, ':')
        if (reader%failed() .or. colon == 0) return
        n_place = merge(2, 3, mechanism%planar)
        from = colon + index(text(colon + 1:), '[')
        to = index(text, ']', back=.true.)
        n = 0
        if (from > colon .and. to == len_trim(text)) then
            do while (from < to .and. n < 3)
                associate (comma => index(text(from + 1:to - 1)//',', ','))
                    n = n + 1
                    call reader%evaluate_text(key, text(from + 1:from + comma - 1), place(n))
                    from = from + comma
                end associate
            end do
        end if
        if (reader%failed()) return
        if (n /= n_place .or. from < to) then
            call reader%fail(key, '"'//trim(text)//'" is not a valid point', 'write body, body.point or body:[x, y'// &
                trim(merge(']   ', ', z]', mechanism%planar)))
            return
        end if
        n_points = n_points + 1
        write (name, '(":", i0)') n_points
        call mechanism%add_point(text(:colon - 1), name, place(:n_place), error)
        call reader%blame(error)
        point = text(:colon - 1)//'.'//name
    end subroutine take_point

    !> Two points.
    subroutine take_points(reader, key, mechanism, n_points, points, help, required)
        type(reader_type), intent(inout) :: reader
        character(len=*), intent(in) :: key
        class(builder_type), intent(inout) :: mechanism
        integer, intent(inout) :: n_points
        character(len=key_length), intent(out) :: points(2)
        character(len=*), intent(in) :: help
        logical, intent(in) :: required
        character(len=text_length), allocatable :: texts(:)
        integer :: i

        points = ''
        call reader%get_texts(key, 2, texts, help, required)
        if (reader%failed() .or. .not. allocated(texts)) return
        do i = 1, 2
            call take_point(reader, key, trim(texts(i)), mechanism, n_points, points(i))
        end do
    end subroutine take_points

    !> Names of the variables that expressions may contain.
    subroutine list_variables(mechanism, variables)
        class(builder_type), intent(in) :: mechanism
        character(len=key_length), allocatable, intent(out) :: variables(:)
        type(variable_type), allocatable :: list(:)

        allocate (list, source=mechanism%list_variables())
        allocate (variables(size(list)))
        variables = list%name
    end subroutine list_variables
end module tandem_mechanism_described_points
