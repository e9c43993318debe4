! SPDX-License-Identifier: MIT
!> Rows of imposed motions, and counting of full revolutions of angles in space, which orientations do not determine. While a start
!> is searched, revolutions follow the smallest change from point to point; during a run they follow it from one accepted point to
!> the next. An angle that is driven by a function of time takes its revolutions from the function.
submodule(tandem_mechanism) tandem_mechanism_revolutions
    use tandem_mechanism_coordinate, only: begin_turns, count_turns, end_search
    use tandem_mechanism_element_kind, only: visit_interface
    use tandem_mechanism_sensor, only: begin_sensor
    implicit none (type, external)

contains

    !> Count revolutions at an accepted point. The first accepted point after the start ends the search for the start.
    module procedure arrive
        integer :: i, stat

        if (.not. self%counts_turns) return
        if (starts) then
            self%follows_turns = .true.
            call visit_elements(self, begin_turns)
            call visit_sensors(self, begin_turns)
            do i = 1, size(self%sensors)
                call begin_sensor(self%sensors(i))
            end do
        end if
        if (.not. (self%follows_turns .or. depends_on_revolutions(self))) return
        ! Set only the poses, the functions of time and, while a start is searched, the revolutions; evaluate no terms.
        call self%evaluate(0, t, q, q, self%at_row, stat)
        if (.not. self%follows_turns) then
            call visit_elements(self, count_turns)
        else if (.not. starts) then
            self%follows_turns = .false.
            call visit_elements(self, end_search)
            call visit_sensors(self, end_search)
        end if
    end procedure arrive

    module procedure list_imposed
        type(constraint_type), allocatable :: rows(:)
        integer :: i

        is_imposed = .false.
        is_angle = .false.
        do i = 1, size(self%perpendiculars)
            if (self%perpendiculars(i)%motion > 0) is_imposed(self%perpendiculars(i)%row) = .true.
        end do
        do i = 1, size(self%distances)
            if (self%distances(i)%motion > 0) is_imposed(self%distances(i)%row) = .true.
        end do
        do i = 1, size(self%angles)
            if (self%angles(i)%motion == 0) cycle
            is_imposed(self%angles(i)%row) = .true.
            is_angle(self%angles(i)%row) = .true.
        end do
        allocate (rows, source=rows_of_kinds(self, 1.0_wp))
        do i = 1, size(rows)
            if (.not. rows(i)%is_locked) cycle
            is_imposed(rows(i)%row) = .true.
            is_angle(rows(i)%row) = rows(i)%is_angle
        end do
    end procedure list_imposed

    module procedure follow_turns
        call visit_elements(self, count_turns)
        call visit_sensors(self, count_turns)
    end procedure follow_turns

    !> True if forces, expressions or rows depend on full revolutions.
    pure logical function depends_on_revolutions(self)
        type(mechanism_type), intent(in) :: self
        integer :: k

        depends_on_revolutions = size(self%at%formulas) > 0 .or. &
            any([(self%kinds(k)%of%counts_turns, k=1, size(self%kinds))])
    end function depends_on_revolutions

    !> Call `visit` for the coordinates of forces, expressions and rows.
    pure subroutine visit_elements(self, visit)
        type(mechanism_type), intent(inout) :: self
        procedure(visit_interface) :: visit
        integer :: i, k

        do k = 1, size(self%kinds)
            call self%kinds(k)%of%visit_coordinates(visit, self%at)
        end do
        do i = 1, size(self%at%formulas)
            do k = 1, size(self%at%formulas(i)%variables)
                associate (variable => self%at%formulas(i)%variables(k))
                    if (variable%kind == is_joint) call visit(self%at%coordinates(variable%owner), self%at%pose, self%at%f)
                end associate
            end do
        end do
    end subroutine visit_elements

    !> Call `visit` for the coordinates of sensors.
    pure subroutine visit_sensors(self, visit)
        type(mechanism_type), intent(inout) :: self
        procedure(visit_interface) :: visit
        integer :: i

        do i = 1, size(self%sensors)
            if (self%sensors(i)%kind == sensed_joint .and. self%sensors(i)%turns) then
                call visit(self%sensors(i)%rotation, self%at%pose, self%at%f)
            end if
        end do
    end subroutine visit_sensors
end submodule tandem_mechanism_revolutions
