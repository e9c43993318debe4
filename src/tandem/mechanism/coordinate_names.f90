! SPDX-License-Identifier: MIT
!> Coordinates by their names in scenes, and errors that state the names that exist.
submodule(tandem_mechanism_definition) tandem_mechanism_coordinate_names
    implicit none (type, external)

contains

    module procedure find_coordinate
        character(len=:), allocatable :: known
        integer :: i, k, dot, type_of, turn, way

        number = 0
        dot = index(text, '.')
        if (dot == 0) dot = len_trim(text) + 1
        call self%find_element(text(:dot - 1), type_of, k)
        if (type_of == of_joint) then
            turn = self%joints(k)%rotation
            way = self%joints(k)%displacement
        else if (type_of == of_massless_wheel) then
            turn = 0
            way = self%massless_wheels(k)%displacement
        else if (has_rows()) then
            turn = 0
            associate (it => self%kinds(type_of - of_kind)%of%constraint(k, 1.0_wp))
                way = it%displacement
            end associate
        else
            call refuse(label//': there is no joint '//text(:dot - 1), 'define the joint first', error)
            return
        end if
        if (text(dot:) == '.angle') then
            number = turn
        else if (any(text(dot:) == ['.angle1', '.angle2', '.angle3']) .and. type_of == of_joint) then
            number = self%joints(k)%angles(index('123', text(dot + 6:dot + 6)))
        else if (text(dot:) == '.displacement') then
            number = way
        else if (dot > len_trim(text) .and. turn > 0 .and. way > 0) then
            call refuse(label//': the joint '//trim(text)//' rotates and slides', &
                'name its angle or its displacement: '//trim(text)//'.angle or '//trim(text)//'.displacement', error)
            return
        else if (dot > len_trim(text)) then
            number = max(turn, way)
        end if
        if (number > 0) return
        known = ''
        if (turn > 0) known = known//' or '//text(:dot - 1)//'.angle'
        if (way > 0) known = known//' or '//text(:dot - 1)//'.displacement'
        if (type_of == of_joint) then
            do i = 1, 3
                if (self%joints(k)%angles(i) > 0) known = known//' or '//text(:dot - 1)//'.angle'//'123'(i:i)
            end do
        end if
        if (known == '') then
            call refuse(label//': '//trim(sort())//' '//text(:dot - 1)// &
                ' has no coordinate', 'name a joint that rotates or slides, and its .angle or .displacement', error)
        else
            call refuse(trim(label//': '//trim(sort())//' '//text(:dot - 1)//' has no coordinate '//text(dot + 1:)), &
                'name'//known(4:), error)
        end if

    contains

        !> True for an element of a kind with rows.
        pure logical function has_rows()
            has_rows = type_of > of_kind
            if (has_rows) has_rows = self%kinds(type_of - of_kind)%of%has_rows
        end function has_rows

        !> Sort of an element that may have a coordinate.
        pure function sort()
            character(len=12) :: sort

            sort = 'the joint'
            if (type_of == of_massless_wheel) sort = 'the wheel'
            if (type_of > of_kind) sort = 'the '//self%kinds(type_of - of_kind)%of%label()
        end function sort
    end procedure find_coordinate
end submodule tandem_mechanism_coordinate_names
