! SPDX-License-Identifier: MIT
!> Numbers of the coordinates and rows of a mechanism: columns of bodies, rows of elements, names and units on request, and the
!> pattern.
submodule(tandem_mechanism) tandem_mechanism_numbering
    use tandem_kinds, only: lane
    use tandem_model, only: its_unit, name_of_coordinate, unit_of_its_multiplier
    use tandem_mechanism_coordinate, only: number_slide
    use tandem_mechanism_hinge, only: gather_hinges
    use tandem_mechanism_hinge_group, only: find_hinge_blocks, gather_hinge_groups, place_hinge_groups
    use tandem_mechanism_incidence, only: list_incidence
    use tandem_mechanism_pin, only: find_pin_blocks, gather_pins, place_pins
    use tandem_mechanism_rotating_bodies, only: find_norm_blocks, gather_rotating_bodies, store_columns
    implicit none (type, external)

contains

    module procedure number_coordinates
        integer, allocatable :: blocks(:)
        integer :: i, k, n

        call number_slides(self)
        if (allocated(self%at%pose)) deallocate (self%at%pose)
        ! At most seven per body.
        allocate (blocks(7*size(self%bodies) + self%n_of%slides), source=0)
        self%turning = pack([(i, i=1, size(self%bodies))], self%bodies%turns .and. .not. self%planar)
        self%first = spread(1, 1, size(self%bodies) + self%n_of%slides + 1)
        n = 0
        do i = 1, size(self%first) - 1
            k = 1
            if (i <= size(self%bodies)) k = merge(2, 3, self%planar)
            blocks(n + 1:n + k) = 1
            n = n + k
            if (i <= size(self%bodies)) then
                if (self%bodies(i)%turns) then
                    blocks(n + 1) = merge(1, 4, self%planar)
                    n = n + blocks(n + 1)
                end if
            end if
            self%first(i + 1) = n + 1
        end do
        self%n = n
        self%composes_labels = .true.
        self%is_ready_made = .true.
        self%mass_blocks = pack(blocks, blocks > 0)
        allocate (self%weight(n), source=0.0_wp)
        k = merge(2, 3, self%planar)
        do i = 1, size(self%bodies)
            self%weight(self%first(i):self%first(i) + k - 1) = self%bodies(i)%mass*self%gravity(:k)
        end do
        call make_poses(self)
    end procedure number_coordinates

    module procedure make_poses
        integer :: i

        if (allocated(self%at%pose)) return
        allocate (self%at%pose(0:size(self%first) - 1))
        do i = 1, size(self%first) - 1
            associate (pose => self%at%pose(i))
                pose%place = self%first(i)
                pose%n_place = 1
                if (i <= size(self%bodies)) then
                    pose%n_place = merge(2, 3, self%planar)
                    if (self%bodies(i)%turns) then
                        pose%turn = pose%place + pose%n_place
                        pose%n_turn = merge(1, 4, self%planar)
                    end if
                end if
            end associate
        end do
        call place_poses(self)
    end procedure make_poses

    !> Set the places of the bodies' coordinates in the terms.
    pure subroutine place_poses(self)
        class(mechanism_type), intent(inout) :: self
        integer :: i

        do i = 1, ubound(self%at%pose, 1)
            associate (pose => self%at%pose(i))
                pose%place_column = pose%place
                pose%turn_column = pose%turn
                pose%place_mass = pose%place
                pose%turn_mass = pose%turn
                pose%mass_step = 1
                if (.not. self%is_compressed) cycle
                pose%place_column = self%pattern%column(pose%place)
                ! M is diagonal there.
                pose%place_mass = 1
                pose%mass_step = 0
                if (pose%turn == 0) cycle
                pose%turn_column = self%pattern%column(pose%turn)
                pose%turn_mass = self%pattern%mass_column(pose%turn)
            end associate
        end do
    end subroutine place_poses

    module procedure composed
        integer :: row

        select case (what)
        case (name_of_coordinate, its_unit)
            label = label_of_coordinate(self, i, what == its_unit)
        case default
            if (i > self%n_holonomic) then
                row = i - self%n_holonomic
                label = self%rolling%name(row)
                if (what == unit_of_its_multiplier) label = self%rolling%unit(row)
            else if (i > self%before_norms) then
                label = trim(self%bodies(self%turning(i - self%before_norms))%name)//' norm'
                if (what == unit_of_its_multiplier) label = 'J'
            else
                label = self%held%name(i)
                if (what == unit_of_its_multiplier) label = self%held%unit(i)
            end if
        end select
    end procedure composed

    !> Name or unit of a coordinate.
    pure function label_of_coordinate(self, i, is_unit) result(label)
        class(mechanism_type), intent(in) :: self
        integer, intent(in) :: i
        logical, intent(in) :: is_unit
        character(len=label_length) :: label
        character(len=*), parameter :: places(3) = ['x', 'y', 'z'], turns(4) = ['e0', 'e1', 'e2', 'e3']
        integer :: from, k, middle, to

        label = '1'
        from = 1
        to = size(self%first)
        do while (to - from > 1)
            middle = (from + to)/2
            if (self%first(middle) <= i) then
                from = middle
            else
                to = middle
            end if
        end do
        k = i - self%first(from) + 1
        if (from > size(self%bodies)) then
            associate (slide => self%slides(from - size(self%bodies)))
                label = slide%unit
                if (.not. is_unit) label = trim(slide%name)//trim(merge('.slack       ', '.displacement', slide%is_slack))
            end associate
        else if (k <= merge(2, 3, self%planar)) then
            label = 'm'
            if (.not. is_unit) label = trim(self%bodies(from)%name)//'.'//places(k)
        else if (self%planar) then
            label = 'rad'
            if (.not. is_unit) label = trim(self%bodies(from)%name)//'.angle'
        else if (.not. is_unit) then
            label = trim(self%bodies(from)%name)//'.'//turns(k - 3)
        end if
    end function label_of_coordinate

    !> Move the poses of sliding parts behind those of the bodies.
    subroutine number_slides(self)
        class(mechanism_type), intent(inout) :: self
        integer :: i, k

        do i = 1, size(self%massless_wheels)
            call put_behind(self%massless_wheels(i)%slide)
        end do
        do i = 1, size(self%sensors)
            call put_behind(self%sensors(i)%vector%second)
            call number_slide(self%sensors(i)%displacement, size(self%bodies))
        end do
        do i = 1, size(self%at%coordinates)
            call number_slide(self%at%coordinates(i), size(self%bodies))
        end do
        do k = 1, size(self%kinds)
            call self%kinds(k)%of%number_slides(size(self%bodies))
        end do

    contains

        subroutine put_behind(pose)
            integer, intent(inout) :: pose

            if (pose < 0) pose = size(self%bodies) - pose
        end subroutine put_behind
    end subroutine number_slides

    module procedure rows_of_kinds
        integer :: i, k, n

        allocate (rows(sum([(self%kinds(self%row_kinds(k))%of%n, k=1, size(self%row_kinds))])))
        n = 0
        do k = 1, size(self%row_kinds)
            do i = 1, self%kinds(self%row_kinds(k))%of%n
                n = n + 1
                rows(n) = self%kinds(self%row_kinds(k))%of%constraint(i, length)
            end do
        end do
    end procedure rows_of_kinds

    module procedure number_rows
        integer :: k

        self%before_norms = self%held%n
        self%n_holonomic = self%before_norms + size(self%turning)
        self%n_nonholonomic = self%rolling%n
        self%rows_may_repeat = .true.
        self%velocity_joints%row = self%velocity_joints%row + self%n_holonomic
        self%rate_rows%row = self%rate_rows%row + self%n_holonomic
        self%knife_edges%row = self%knife_edges%row + self%n_holonomic
        self%rollers%row = self%rollers%row + self%n_holonomic
        self%massless_wheels%row = self%massless_wheels%row + self%n_holonomic
        do k = 1, size(self%kinds)
            call self%kinds(k)%of%renumber(self%n_holonomic)
        end do
    end procedure number_rows

    !> Group elements that are evaluated together: pins in the plane; hinges and bodies in space if they are numerous enough.
    module procedure form_groups
        integer, parameter :: many = lane
        type(hinge_type), allocatable :: hinges(:)
        integer :: i

        call gather_hinges(self%coincidences, self%perpendiculars, self%at%pose, self%before_norms, self%hinges, &
            self%single_coincidences, self%single_perpendiculars)
        allocate (hinges(0))
        if (size(self%hinges) >= many) then
            call move_alloc(self%hinges, hinges)
            allocate (self%hinges(0))
        end if
        call gather_hinge_groups(hinges, self%at%pose, self%hinge_groups)
        if (size(self%turning) >= many) then
            self%n_turning_alone = 0
            call gather_rotating_bodies(self%turning, self%bodies, self%at%pose, self%before_norms, self%rotating_groups)
            self%alone = pack([(i, i=1, size(self%bodies))], self%at%pose(1:size(self%bodies))%n_turn < 4)
        else
            self%n_turning_alone = size(self%turning)
            allocate (self%rotating_groups(0))
            self%alone = [(i, i=1, size(self%bodies))]
        end if
        call self%angles_of_bodies%gather(self%at%pose)
        if (self%planar) then
            call gather_pins(self%coincidences, self%at%pose, self%angles_of_bodies, self%pins)
            self%single_coincidences = [integer ::]
        else
            allocate (self%pins(0))
        end if
        self%takes_poses = max(self%n_turning_alone, size(self%hinges), size(self%single_coincidences), &
            size(self%single_perpendiculars), &
            size(self%distances), size(self%angles), size(self%knife_edges), size(self%rollers), &
            size(self%massless_wheels), size(self%velocity_joints), size(self%rate_rows), size(self%row_kinds), &
            size(self%force_kinds)) > 0
        self%keeps_poses = self%takes_poses .or. size(self%sensors) > 0
    end procedure form_groups

    module procedure declare_pattern
        integer, allocatable :: rows(:), bodies(:), owner(:)
        integer :: i, l

        if (allocated(self%pattern)) deallocate (self%pattern)
        call set_columns(self, .false.)
        call list_incidence(self, size(self%turning), rows, bodies)
        allocate (owner(self%n_constraints()), source=0)
        do i = 1, size(self%turning)
            owner(self%before_norms + i) = self%turning(i)
            rows(size(rows) - size(self%turning) + i) = self%before_norms + i
            bodies(size(rows) - size(self%turning) + i) = self%turning(i)
        end do
        allocate (self%pattern)
        call self%pattern%build(self%first, self%mass_blocks, size(owner), rows, bodies, owner)
        deallocate (rows, bodies, owner)
        do i = 1, size(self%hinges)
            call self%pattern%tell_meeting(self%hinges(i)%row, 5, self%hinges(i)%first)
        end do
        do i = 1, size(self%hinge_groups)
            associate (group => self%hinge_groups(i))
                do l = 1, group%n
                    call self%pattern%tell_meeting(group%row(l), 5, group%body(l, 1))
                end do
            end associate
        end do
        do i = 1, size(self%pins)
            associate (pin => self%pins(i))
                if (all(pin%body == 0 .or. pin%angle > 0)) call self%pattern%tell_meeting(pin%row, 2, pin%body(1))
            end associate
        end do
    end procedure declare_pattern

    module procedure set_columns
        logical :: were_there

        self%is_compressed = is_compressed
        were_there = allocated(self%at%pose)
        call make_poses(self)
        call place_poses(self)
        call place_hinge_groups(self%at%pose, self%hinge_groups)
        call place_pins(self%at%pose, self%pins)
        call store_columns(self%at%pose, self%rotating_groups)
        if (.not. were_there) deallocate (self%at%pose)
    end procedure set_columns

    module procedure note_blocks
        ! A chart with such blocks stores the terms compressed.
        if (.not. self%is_compressed) call set_columns(self, .true.)
        self%pattern%in_blocks = spread(.false., 1, self%pattern%n_rows)
        call find_hinge_blocks(self%pattern, self%hinge_groups)
        call find_pin_blocks(self%pattern, self%pins)
        call find_norm_blocks(self%pattern, self%rotating_groups)
        self%pattern%all_in_blocks = all(self%pattern%in_blocks .or. self%pattern%block_height == 0)
    end procedure note_blocks
end submodule tandem_mechanism_numbering
