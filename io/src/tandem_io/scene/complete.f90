! SPDX-License-Identifier: MIT
!> Complete scenes as TOML text: each key once, with its value or default.
module tandem_io_scene_complete
    use tandem, only: is_number, is_text, is_truth, shown_type, value_type
    use tandem_io_scene_text, only: to_toml
    use tandem_kinds, only: wp
    implicit none (type, external)
    private

    public :: complete_text, unit_in, value_in, value_to_toml

    !> Column at which comments begin, unless the value is too long.
    integer, parameter :: comment_column = 34

contains

    !> Text of a complete scene.
    function complete_text(lines) result(text)
        type(shown_type), intent(in) :: lines(:)
        character(len=:), allocatable :: text
        character(len=:), allocatable :: part, table, heading, longer
        integer :: i, element, length

        length = 0
        table = ''
        element = 0
        allocate (character(len=4096) :: text)
        do i = 1, size(lines)
            associate (line => lines(i))
                if (line%is_hidden) cycle
                part = text_of(line)
                if (line%table /= table .or. line%element /= element) then
                    heading = '['//path_to_toml(line%table)//']'
                    if (line%element > 0) heading = '['//heading//']'
                    part = heading//new_line('a')//part
                    if (table /= '') part = new_line('a')//part
                    table = line%table
                    element = line%element
                end if
            end associate
            if (length + len(part) > len(text)) then
                allocate (character(len=2*(length + len(part))) :: longer)
                longer(:length) = text(:length)
                call move_alloc(longer, text)
            end if
            text(length + 1:length + len(part)) = part
            length = length + len(part)
        end do
        text = text(:length)
    end function complete_text

    !> Text of a line, with the newline.
    function text_of(line) result(text)
        type(shown_type), intent(in) :: line
        character(len=:), allocatable :: text

        text = ''
        if (line%key /= '') text = path_to_toml(line%key)//' = '//value_to_toml(line%value, line%is_whole)
        if (line%comment /= '') then
            if (text /= '') text = text//repeat(' ', max(0, comment_column - 3 - len(text)))//'  '
            text = text//'# '//line%comment
        end if
        text = text//new_line('a')
    end function text_of

    !> Unit of a key; blank if unknown.
    function unit_in(lines, table, key) result(unit)
        type(shown_type), intent(in) :: lines(:)
        character(len=*), intent(in) :: table, key
        character(len=32) :: unit
        integer :: i

        unit = ''
        do i = 1, size(lines)
            if (.not. is_key(lines(i), table, key)) cycle
            if (allocated(lines(i)%unit)) unit = lines(i)%unit
        end do
    end function unit_in

    !> Value of a key in TOML on one line; empty if the key does not exist.
    function value_in(lines, table, key) result(text)
        type(shown_type), intent(in) :: lines(:)
        character(len=*), intent(in) :: table, key
        character(len=:), allocatable :: text
        integer :: i

        text = ''
        do i = 1, size(lines)
            if (is_key(lines(i), table, key)) text = value_to_toml(lines(i)%value, lines(i)%is_whole)
        end do
        do i = 1, len(text)
            if (text(i:i) == new_line('a')) text(i:i) = ' '
        end do
    end function value_in

    !> True if a line contains a key, which may be quoted.
    logical function is_key(line, table, key)
        type(shown_type), intent(in) :: line
        character(len=*), intent(in) :: table, key

        is_key = line%element == 0
        if (is_key .and. line%table /= table) is_key = path_to_toml(line%table) == table
        if (is_key .and. line%key /= key) is_key = path_to_toml(line%key) == key
    end function is_key

    !> Value in TOML. A long list of numbers is written on several lines.
    function value_to_toml(value, is_whole) result(text)
        type(value_type), intent(in) :: value
        !> True to write whole numbers without a decimal point.
        logical, intent(in) :: is_whole
        character(len=:), allocatable :: text
        real(wp), allocatable :: numbers(:)
        integer :: i

        if (value%is_list .and. value%row_length == 0 .and. all(value%atoms%kind == is_number)) then
            allocate (numbers(size(value%atoms)))
            do i = 1, size(numbers)
                numbers(i) = value%atoms(i)%number
            end do
            text = to_toml(numbers)
            return
        end if
        text = ''
        do i = 1, size(value%atoms)
            if (i > 1) text = text//', '
            if (value%row_length > 0) then
                if (i > 1 .and. mod(i - 1, value%row_length) == 0) text = text(:len_trim(text) - 1)//'], '
                if (mod(i - 1, value%row_length) == 0) text = text//'['
            end if
            associate (atom => value%atoms(i))
                select case (atom%kind)
                case (is_text)
                    text = text//to_toml(atom%text)
                case (is_truth)
                    text = text//to_toml(atom%truth)
                case default
                    if (is_whole .and. abs(atom%number) <= huge(1)) then
                        text = text//to_toml(nint(atom%number))
                    else
                        text = text//to_toml(atom%number)
                    end if
                end select
            end associate
        end do
        if (value%row_length > 0) text = text//']'
        if (value%is_list) text = '['//text//']'
    end function value_to_toml

    !> Dotted key, with quotes around parts that need them.
    function path_to_toml(path) result(text)
        character(len=*), intent(in) :: path
        character(len=:), allocatable :: text
        character(len=*), parameter :: letters = 'abcdefghijklmnopqrstuvwxyzABCDEFGHIJKLMNOPQRSTUVWXYZ0123456789_-'
        integer :: from, to, depth

        text = ''
        from = 1
        do
            depth = 0
            do to = from, len(path)
                if (path(to:to) == '{') depth = depth + 1
                if (path(to:to) == '}') depth = depth - 1
                if (path(to:to) == '.' .and. depth <= 0) exit
            end do
            associate (part => path(from:to - 1))
                if (verify(part, letters) == 0) then
                    text = text//part
                else
                    text = text//to_toml(part)
                end if
            end associate
            if (to > len(path)) exit
            text = text//'.'
            from = to + 1
        end do
    end function path_to_toml
end module tandem_io_scene_complete
