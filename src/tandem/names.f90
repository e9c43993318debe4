! SPDX-License-Identifier: MIT
!> Suggestions for misspelt names, and names in lower case.
module tandem_names
    implicit none (type, external)
    private

    public :: nearest_name, question, lower_case

    !> Number of letters around the name in a question.
    integer, parameter :: around = 19

    !> Names of keys, quantities and motions in earlier versions, and their present names.
    character(len=12), parameter :: former_names(5) = [character(len=12) :: 'way', 'traction', 'pull', 'turn', 'place']
    character(len=12), parameter :: present_names(5) = [character(len=12) :: 'displacement', 'tension', 'tension', 'rotation', &
        'position']

contains

    !> Length of the nearest name.
    pure integer function nearest_length(word, names)
        character(len=*), intent(in) :: word, names(:)
        integer :: i

        i = nearest_place(word, names)
        nearest_length = 0
        if (i > 0) nearest_length = len_trim(names(i))
    end function nearest_length

    !> Length of the question.
    pure integer function question_length(word, names)
        character(len=*), intent(in) :: word, names(:)

        question_length = nearest_length(word, names)
        if (question_length > 0) question_length = question_length + around
    end function question_length

    !> Index of the nearest name; 0 if none is near. A name of an earlier version is nearest to its present name.
    pure integer function nearest_place(word, names)
        character(len=*), intent(in) :: word, names(:)
        integer :: i, distance, least

        nearest_place = renamed_place(word, names)
        least = huge(1)
        if (len(word) > 64 .or. nearest_place > 0) return
        do i = 1, size(names)
            distance = edits(lower_case(word), lower_case(names(i)))
            if (distance < least .and. distance <= max(1, len_trim(names(i))/3)) then
                least = distance
                nearest_place = i
            end if
        end do
    end function nearest_place

    !> Index of the present name of a word whose last part, behind a dot or a slash, is a name of an earlier version, as
    !> `world.turn_z`; 0 if there is none.
    pure integer function renamed_place(word, names)
        character(len=*), intent(in) :: word, names(:)
        integer :: from, to, i

        renamed_place = 0
        from = scan(word, './', back=.true.) + 1
        to = from + scan(word(from:)//'_', '_ ') - 2
        do i = 1, size(former_names)
            if (word(from:to) /= former_names(i)) cycle
            renamed_place = findloc(names == word(:from - 1)//trim(present_names(i))//word(to + 1:), .true., dim=1)
            if (renamed_place > 0) return
        end do
    end function renamed_place

    !> Name that was probably meant, or nothing: the one with the fewest edits, at most a third of its length.
    pure function nearest_name(word, names) result(name)
        !> Misspelt name.
        character(len=*), intent(in) :: word
        !> Existing names.
        character(len=*), intent(in) :: names(:)
        character(len=nearest_length(word, names)) :: name

        name = ''
        if (len(name) > 0) name = names(nearest_place(word, names))
    end function nearest_name

    !> End of a message about a misspelt name: the name that was probably meant, or nothing.
    pure function question(word, names) result(text)
        !> Misspelt name.
        character(len=*), intent(in) :: word
        !> Existing names.
        character(len=*), intent(in) :: names(:)
        character(len=question_length(word, names)) :: text

        text = ''
        if (len(text) > 0) text = ' (did you mean "'//nearest_name(word, names)//'"?)'
    end function question

    !> Number of insertions, deletions, replacements and swaps of neighbours that turn a into b.
    pure integer function edits(a, b)
        character(len=*), intent(in) :: a, b
        integer :: cost(0:len(a), 0:len(b)), i, j

        cost(:, 0) = [(i, i=0, len(a))]
        cost(0, :) = [(j, j=0, len(b))]
        do j = 1, len(b)
            do i = 1, len(a)
                cost(i, j) = min(cost(i - 1, j) + 1, cost(i, j - 1) + 1, &
                    cost(i - 1, j - 1) + merge(0, 1, a(i:i) == b(j:j)))
                if (min(i, j) > 1) then
                    if (a(i:i) == b(j - 1:j - 1) .and. a(i - 1:i - 1) == b(j:j)) then
                        cost(i, j) = min(cost(i, j), cost(max(0, i - 2), max(0, j - 2)) + 1)
                    end if
                end if
            end do
        end do
        edits = cost(len(a), len(b))
    end function edits

    !> A name in lower case, without trailing blanks.
    pure function lower_case(name) result(lower)
        character(len=*), intent(in) :: name
        character(len=len_trim(name)) :: lower
        integer :: i

        lower = name
        do i = 1, len(lower)
            if (lower(i:i) >= 'A' .and. lower(i:i) <= 'Z') lower(i:i) = achar(iachar(lower(i:i)) + 32)
        end do
    end function lower_case
end module tandem_names
