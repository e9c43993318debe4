! SPDX-License-Identifier: MIT
!> The numbers of a mechanism's coordinates and rows: columns of bodies, rows of elements, their names and units, and the pattern.
submodule(tandem_mechanism) tandem_mechanism_numbering
    use tandem_kinds, only: lane
    use tandem_mechanism_coordinate, only: coordinate_type
    use tandem_mechanism_hinge, only: gather_hinges
    use tandem_mechanism_hinge_group, only: find_hinge_blocks, gather_hinge_groups, place_hinge_groups
    use tandem_mechanism_incidence, only: list_incidence
    use tandem_mechanism_pin, only: find_pin_blocks, gather_pins, place_pins
    use tandem_mechanism_turning, only: find_norm_blocks, gather_turning, place_turning
    implicit none (type, external)

contains

    module procedure number_coordinates
        character(len=*), parameter :: place(3) = ['x', 'y', 'z'], turn(4) = ['e0', 'e1', 'e2', 'e3']
        integer, allocatable :: blocks(:)
        integer :: i, k, n

        call number_slides(self)
        if (allocated(self%pose)) deallocate (self%pose)
        allocate (self%pose(0:size(self%bodies) + count(self%massless_wheels%slide > 0)))
        if (allocated(self%coordinate_name)) deallocate (self%coordinate_name, self%coordinate_unit)
        ! At most seven a body, and one a coupling or a wheel that slides.
        n = 7*size(self%bodies) + size(self%couplings) + size(self%massless_wheels)
        allocate (self%coordinate_name(n), self%coordinate_unit(n))
        allocate (blocks(n), source=0)
        self%turning = [integer ::]
        n = 0
        do i = 1, size(self%bodies)
            associate (pose => self%pose(i), body => self%bodies(i))
                pose%n_place = merge(2, 3, self%planar)
                pose%place = n + 1
                do k = 1, pose%n_place
                    call add_coordinate(trim(body%name)//'.'//place(k), 'm', 1)
                end do
                if (.not. body%turns) cycle
                pose%turn = n + 1
                if (self%planar) then
                    pose%n_turn = 1
                    call add_coordinate(trim(body%name)//'.angle', 'rad', 1)
                else
                    pose%n_turn = 4
                    do k = 1, 4
                        call add_coordinate(trim(body%name)//'.'//turn(k), '1', merge(4, 0, k == 1))
                    end do
                    self%turning = [self%turning, i]
                end if
            end associate
        end do
        do i = 1, size(self%massless_wheels)
            if (self%massless_wheels(i)%slide == 0) cycle
            associate (pose => self%pose(self%massless_wheels(i)%slide))
                pose%n_place = 1
                pose%place = n + 1
                call add_coordinate(element_name(self, self%massless_wheels(i)%height_row)//'.way', 'm', 1)
            end associate
        end do
        ! The slacks of couplings that events lock and free.
        do i = 1, size(self%couplings)
            if (.not. self%couplings(i)%can_be_freed) cycle
            call add_coordinate(trim(self%held%name(self%couplings(i)%row))//'.slack', '1', 1)
            self%couplings(i)%slack = n
        end do
        self%n = n
        self%coordinate_name = self%coordinate_name(:n)
        self%coordinate_unit = self%coordinate_unit(:n)
        self%mass_blocks = pack(blocks, blocks > 0)
        allocate (self%weight(n), source=0.0_wp)
        do i = 1, size(self%bodies)
            associate (pose => self%pose(i))
                self%weight(pose%place:pose%place + pose%n_place - 1) = self%bodies(i)%mass*self%gravity(:pose%n_place)
            end associate
        end do

    contains

        !> One coordinate more, and the block of M that begins there, 0 for none.
        subroutine add_coordinate(name, unit, block)
            character(len=*), intent(in) :: name, unit
            integer, intent(in) :: block

            n = n + 1
            self%coordinate_name(n) = name
            self%coordinate_unit(n) = unit
            blocks(n) = block
        end subroutine add_coordinate
    end procedure number_coordinates

    !> Let the poses of what slides stand behind those of the bodies.
    subroutine number_slides(self)
        class(mechanism_type), intent(inout) :: self
        integer :: i, k

        do i = 1, size(self%massless_wheels)
            call put_behind(self%massless_wheels(i)%slide)
        end do
        do i = 1, size(self%sensors)
            call put_behind(self%sensors(i)%span%second)
        end do
        do i = 1, size(self%coordinates)
            call renumber(self%coordinates(i))
        end do
        do i = 1, size(self%torsions)
            call renumber(self%torsions(i)%coordinate)
        end do
        do i = 1, size(self%couplings)
            do k = 1, self%couplings(i)%n
                call renumber(self%couplings(i)%coordinates(k))
            end do
        end do

    contains

        subroutine renumber(coordinate)
            type(coordinate_type), intent(inout) :: coordinate

            call put_behind(coordinate%second)
            call put_behind(coordinate%one%second)
        end subroutine renumber

        subroutine put_behind(pose)
            integer, intent(inout) :: pose

            if (pose < 0) pose = size(self%bodies) - pose
        end subroutine put_behind
    end subroutine number_slides

    !> The element that a row is of, with which its name begins.
    pure function element_name(self, row) result(name)
        class(mechanism_type), intent(in) :: self
        integer, intent(in) :: row
        character(len=index(self%held%name(row), ' ') - 1) :: name

        name = self%held%name(row)
    end function element_name

    module procedure name_rows
        integer :: i

        self%before_norms = self%held%n
        self%n_holonomic = self%before_norms + size(self%turning)
        self%n_nonholonomic = self%rolling%n
        self%rows_may_repeat = .true.
        self%holonomic_name = [character(len=label_length) :: self%held%name(:self%held%n), &
            (trim(self%bodies(self%turning(i))%name)//' norm', i=1, size(self%turning))]
        self%nonholonomic_name = self%rolling%name(:self%rolling%n)
        self%multiplier_unit = [character(len=label_length) :: self%held%unit(:self%held%n), ('J', i=1, size(self%turning)), &
            self%rolling%unit(:self%rolling%n)]
        self%glides%row = self%glides%row + self%n_holonomic
        self%rate_rows%row = self%rate_rows%row + self%n_holonomic
        self%edges%row = self%edges%row + self%n_holonomic
        self%rollers%row = self%rollers%row + self%n_holonomic
        self%massless_wheels%row = self%massless_wheels%row + self%n_holonomic
    end procedure name_rows

    !> Elements that are evaluated together: pins in the plane, and where there are so many that it pays hinges and bodies in space.
    module procedure form_groups
        integer, parameter :: many = lane
        type(hinge_type), allocatable :: hinges(:)
        integer :: i

        call gather_hinges(self%meetings, self%dots, self%pose, self%before_norms, self%hinges, self%loose_meetings, &
            self%loose_dots)
        allocate (hinges(0))
        if (size(self%hinges) >= many) then
            call move_alloc(self%hinges, hinges)
            allocate (self%hinges(0))
        end if
        call gather_hinge_groups(hinges, self%pose, self%hinge_groups)
        if (size(self%turning) >= many) then
            self%n_turning_alone = 0
            call gather_turning(self%turning, self%bodies, self%pose, self%before_norms, self%turning_groups)
            self%alone = pack([(i, i=1, size(self%bodies))], self%pose(1:size(self%bodies))%n_turn < 4)
        else
            self%n_turning_alone = size(self%turning)
            allocate (self%turning_groups(0))
            self%alone = [(i, i=1, size(self%bodies))]
        end if
        call self%angles_of_bodies%gather(self%pose)
        if (self%planar) then
            call gather_pins(self%meetings, self%pose, self%angles_of_bodies, self%pins)
            self%loose_meetings = [integer ::]
        else
            allocate (self%pins(0))
        end if
        self%takes_poses = max(self%n_turning_alone, size(self%hinges), size(self%loose_meetings), size(self%loose_dots), &
            size(self%distances), size(self%angles), size(self%couplings), size(self%edges), size(self%rollers), &
            size(self%massless_wheels), size(self%glides), size(self%rate_rows), size(self%springs), size(self%torsions), &
            size(self%bushings), size(self%loads)) > 0
    end procedure form_groups

    module procedure declare_pattern
        integer, allocatable :: rows(:), bodies(:), owner(:)
        integer :: i

        if (allocated(self%pattern)) deallocate (self%pattern)
        call set_columns(self, .false.)
        ! A slack is a coordinate of no body.
        if (any(self%couplings%can_be_freed)) return
        call list_incidence(self, rows, bodies)
        allocate (owner(self%n_constraints()), source=0)
        do i = 1, size(self%turning)
            owner(self%before_norms + i) = self%turning(i)
        end do
        allocate (self%pattern)
        call self%pattern%build([self%pose(1:)%place, self%n + 1], self%mass_blocks, size(owner), &
            [rows, (self%before_norms + i, i=1, size(self%turning))], [bodies, self%turning], owner)
    end procedure declare_pattern

    module procedure set_columns
        integer :: i

        self%is_compressed = is_compressed
        do i = 1, ubound(self%pose, 1)
            associate (pose => self%pose(i))
                pose%place_column = pose%place
                pose%turn_column = pose%turn
                pose%place_mass = pose%place
                pose%turn_mass = pose%turn
                pose%mass_step = 1
                if (.not. is_compressed) cycle
                pose%place_column = self%pattern%column(pose%place)
                ! M is diagonal there.
                pose%place_mass = 1
                pose%mass_step = 0
                if (pose%turn == 0) cycle
                pose%turn_column = self%pattern%column(pose%turn)
                pose%turn_mass = self%pattern%mass_column(pose%turn)
            end associate
        end do
        call place_hinge_groups(self%pose, self%hinge_groups)
        call place_pins(self%pose, self%pins)
        call place_turning(self%pose, self%turning_groups)
    end procedure set_columns

    module procedure find_blocks
        self%pattern%in_blocks = spread(.false., 1, self%pattern%n_rows)
        call find_hinge_blocks(self%pattern, self%hinge_groups)
        call find_pin_blocks(self%pattern, self%pins)
        call find_norm_blocks(self%pattern, self%turning_groups)
        self%pattern%all_in_blocks = all(self%pattern%in_blocks .or. self%pattern%block_height == 0)
    end procedure find_blocks
end submodule tandem_mechanism_numbering
