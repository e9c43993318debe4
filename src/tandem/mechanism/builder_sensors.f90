! SPDX-License-Identifier: MIT
!> Builder procedures for sensors, and for the results of bodies, reactions and forces, which are sensors in separate groups.
submodule(tandem_mechanism_builder) tandem_mechanism_builder_sensors
    use tandem_error, only: to_text
    use tandem_mechanism_refusal, only: refuse
    use tandem_mechanism_sensor, only: of_distance, of_knife_edge, of_joint, of_kind, of_massless_wheel, of_row, &
        of_wheel, sensed_balance, sensed_body, sensed_distance, sensed_energy, sensed_force, &
        sensed_joint, sensed_point, sensed_reaction
    use tandem_names, only: question
    implicit none (type, external)

contains

    module procedure add_point_sensor
        type(sensor_type) :: sensor
        logical :: is_point

        sensor%kind = sensed_point
        call check_sensor(self, name, sensor, error)
        if (allocated(error)) return
        call self%take_point('sensor '//trim(name), on, sensor%vector%first, sensor%vector%s1, is_point, error)
        if (.not. allocated(error)) call keep_sensor(self, sensor)
    end procedure add_point_sensor

    module procedure add_joint_sensor
        type(sensor_type) :: sensor
        integer :: k, type_of

        sensor%kind = sensed_joint
        if (present(group)) sensor%group = group
        call check_sensor(self, name, sensor, error)
        if (allocated(error)) return
        call self%find_element(joint, type_of, k)
        if (type_of == of_massless_wheel) then
            if (present(zero)) sensor%zero = zero
            call add_slide_sensor(self, sensor, joint, k, error)
            return
        else if (type_of /= of_joint) then
            call refuse('sensor '//trim(name)//': there is no joint '//trim(joint), 'correct the name', error)
            return
        end if
        associate (its => self%joints(k))
            sensor%slides = its%displacement > 0
            sensor%turns = its%rotation > 0
            if (.not. (sensor%slides .or. sensor%turns)) then
                call refuse('sensor '//trim(name)//': the joint '//trim(joint)//' is '//trim(its%kind_name)// &
                    ', which has no single coordinate', &
                    'use a revolute, prismatic, cylindrical or point_on_line joint, or a sensor of a point', error)
                return
            end if
            sensor%planar = self%planar
            if (sensor%slides) sensor%displacement = self%at%coordinates(its%displacement)
            if (sensor%turns) sensor%rotation = self%at%coordinates(its%rotation)
            if (present(zero)) sensor%zero = zero
        end associate
        call keep_sensor(self, sensor)
    end procedure add_joint_sensor

    !> Add a sensor of the displacement of a massless wheel.
    subroutine add_slide_sensor(self, sensor, wheel, number, error)
        class(builder_type), intent(inout) :: self
        type(sensor_type), intent(inout) :: sensor
        !> Name and index of the wheel.
        character(len=*), intent(in) :: wheel
        integer, intent(in) :: number
        type(error_type), allocatable, intent(inout) :: error

        if (self%massless_wheels(number)%displacement == 0) then
            call refuse('sensor '//trim(sensor%name)//': the wheel '//trim(wheel)//' does not slide', &
                'use a sensor of a point', error)
            return
        end if
        sensor%slides = .true.
        sensor%displacement = self%at%coordinates(self%massless_wheels(number)%displacement)
        call keep_sensor(self, sensor)
    end subroutine add_slide_sensor

    module procedure add_distance_sensor
        type(sensor_type) :: sensor
        logical :: points(2)

        sensor%kind = sensed_distance
        call check_sensor(self, name, sensor, error)
        if (allocated(error)) return
        associate (vector => sensor%vector)
            call self%take_pair('sensor '//trim(name), first, second, vector, points, &
                error)
        end associate
        if (.not. allocated(error)) call keep_sensor(self, sensor)
    end procedure add_distance_sensor

    module procedure add_energy_sensor
        type(sensor_type) :: sensor

        sensor%kind = sensed_energy
        call check_sensor(self, name, sensor, error)
        if (.not. allocated(error)) call keep_sensor(self, sensor)
    end procedure add_energy_sensor

    module procedure add_balance_sensor
        type(sensor_type) :: sensor

        sensor%kind = sensed_balance
        if (present(group)) sensor%group = group
        call check_sensor(self, name, sensor, error)
        if (.not. allocated(error)) call keep_sensor(self, sensor)
    end procedure add_balance_sensor

    module procedure add_body_sensor
        type(sensor_type) :: sensor

        sensor%kind = sensed_body
        if (present(group)) sensor%group = group
        call check_sensor(self, name, sensor, error)
        if (allocated(error)) return
        sensor%number = self%find_body(body)
        if (sensor%number < 1) then
            call refuse('sensor '//trim(name)//': there is no body '//trim(body)//question(trim(body), names_of(self, [0])), &
                'correct the name', error)
            return
        end if
        sensor%turns = self%bodies(sensor%number)%turns
        sensor%planar = self%planar
        call keep_sensor(self, sensor)
    end procedure add_body_sensor

    module procedure add_reaction_sensor
        type(sensor_type) :: sensor
        integer, allocatable :: types(:)
        integer :: k

        sensor%kind = sensed_reaction
        if (present(group)) sensor%group = group
        call check_sensor(self, name, sensor, error)
        if (allocated(error)) return
        k = self%index_of%names%get(element)
        if (k > 0) sensor%of = self%types(k)
        types = [of_joint, of_wheel, of_knife_edge, of_massless_wheel, types_of(self, 'constraints')]
        if (.not. any(sensor%of == types)) then
            call refuse('sensor '//trim(name)//': '//trim(element)//' is not a joint, wheel or constraint'// &
                question(trim(element), names_of(self, types)), 'correct the name', error)
            return
        end if
        sensor%number = self%numbers(k)
        call find_rows(self, element, sensor)
        associate (vector => sensor%vector)
            select case (sensor%of)
            case (of_joint)
                associate (its => self%joints(sensor%number))
                    vector = point_vector_type(first=its%first, second=its%second, s1=its%s1, s2=its%s2)
                end associate
            case (of_wheel)
                vector%second = self%rollers(sensor%number)%body
            case (of_massless_wheel)
                vector%second = self%massless_wheels(sensor%number)%body
            case (of_knife_edge)
                vector%second = self%knife_edges(sensor%number)%body
                vector%s2 = self%knife_edges(sensor%number)%point
            case (of_distance)
                vector = self%distances(sensor%number)
            case default
                ! Rows of several bodies have no single pair of bodies.
                vector = point_vector_type()
            end select
            if (sensor%of /= of_row .and. sensor%of <= of_kind) sensor%between = [name_of(self, vector%first), &
                name_of(self, vector%second)]
        end associate
        if (sensor%of > of_kind) then
            associate (it => self%kinds(sensor%of - of_kind)%of%constraint(sensor%number, 1.0_wp))
                sensor%can_be_freed = it%can_be_freed
            end associate
        end if
        sensor%is_driven = self%index_of%motions%get(element) > 0
        if (sensor%of == of_row) sensor%is_driven = self%rate_rows(sensor%number)%rhs > 0
        call keep_sensor(self, sensor)
    end procedure add_reaction_sensor

    !> Find the rows of an element, whose names begin with that of the element. Rows at velocity level have negative indices until
    !> `define` moves them after those at position level.
    subroutine find_rows(self, element, sensor)
        class(builder_type), intent(in) :: self
        character(len=*), intent(in) :: element
        type(sensor_type), intent(inout) :: sensor
        integer :: i

        i = self%held%first(element)
        do while (i > 0)
            call add(i, self%held%unit(i))
            i = self%held%next(i)
        end do
        i = self%rolling%first(element)
        do while (i > 0)
            call add(-i, self%rolling%unit(i))
            i = self%rolling%next(i)
        end do

    contains

        subroutine add(row, unit)
            integer, intent(in) :: row
            character(len=*), intent(in) :: unit

            sensor%n_rows = sensor%n_rows + 1
            sensor%rows(sensor%n_rows) = row
            sensor%unit = unit
        end subroutine add
    end subroutine find_rows

    module procedure add_force_sensor
        type(sensor_type) :: sensor
        integer, allocatable :: types(:)
        integer :: i, k, first, second

        sensor%kind = sensed_force
        if (present(group)) sensor%group = group
        call check_sensor(self, name, sensor, error)
        if (allocated(error)) return
        k = self%index_of%names%get(element)
        if (k > 0) sensor%of = self%types(k)
        types = types_of(self, 'forces')
        if (.not. any(sensor%of == types)) then
            call refuse('sensor '//trim(name)//': '//trim(element)//' is not a force'// &
                question(trim(element), names_of(self, types)), 'correct the name', error)
            return
        end if
        sensor%number = self%numbers(k)
        associate (attachment => self%kinds(sensor%of - of_kind)%of%attachment(sensor%number))
            first = attachment%body(1)
            second = attachment%body(2)
            sensor%slides = attachment%slides
            sensor%has_reaction_friction = attachment%needs_multipliers
        end associate
        ! The displacement of a wheel belongs to no body: the force is between the wheel and the body that carries it. A sum belongs
        ! to no body at all.
        if (second < 0) then
            i = findloc(self%massless_wheels%slide, second, dim=1)
            if (i > 0) first = self%massless_wheels(i)%body
        end if
        sensor%between(2) = name_of(self, second)
        if (first >= 0) sensor%between(1) = name_of(self, first)
        call keep_sensor(self, sensor)
    end procedure add_force_sensor

    module procedure add_results
        character(len=name_length), allocatable :: list(:)
        integer, allocatable :: types(:)
        integer :: i, k

        if (.not. allocated(self%types)) call self%clear()
        types = types_of(self, kind)
        if (size(types) == 0) then
            call refuse('results of '//kind, 'use bodies, joints, wheels, constraints or forces', error)
            return
        end if
        allocate (list(size(names)))
        list = names
        if (size(names) == 1) then
            if (names(1) == 'all') list = names_of(self, types)
        end if
        do i = 1, size(list)
            k = self%index_of%names%get(list(i))
            if (k > 0) then
                if (.not. any(self%types(k) == types)) k = 0
            end if
            if (k == 0) then
                call refuse('results of '//kind//': there is no '//trim(list(i))// &
                    question(trim(list(i)), names_of(self, types)), 'correct the name', error)
                return
            end if
            select case (self%types(k))
            case (0)
                call self%add_body_sensor(list(i), list(i), error, kind)
            case (of_kind + 1:)
                if (kind == 'forces') then
                    call self%add_force_sensor(list(i), list(i), error, kind)
                else
                    call self%add_reaction_sensor(list(i), list(i), error, kind)
                end if
            case (of_joint)
                associate (its => self%joints(self%numbers(k)))
                    if (max(its%rotation, its%displacement) > 0) call self%add_joint_sensor(list(i), list(i), error, group=kind)
                end associate
                if (.not. allocated(error)) call self%add_reaction_sensor(list(i), list(i), error, kind)
            case (of_massless_wheel)
                if (self%massless_wheels(self%numbers(k))%displacement > 0) then
                    call self%add_joint_sensor(list(i), list(i), error, group=kind)
                end if
                if (.not. allocated(error)) call self%add_reaction_sensor(list(i), list(i), error, kind)
            case default
                call self%add_reaction_sensor(list(i), list(i), error, kind)
            end select
            if (allocated(error)) return
        end do
    end procedure add_results

    !> Types of elements in a kind of results.
    pure function types_of(self, kind) result(types)
        class(builder_type), intent(in) :: self
        character(len=*), intent(in) :: kind
        integer, allocatable :: types(:)

        select case (kind)
        case ('bodies')
            types = [0]
        case ('joints')
            types = [of_joint]
        case ('wheels')
            types = [of_wheel, of_knife_edge, of_massless_wheel]
        case ('constraints')
            types = [of_distance, of_row, kinds_in('constraint')]
        case ('forces')
            types = kinds_in('force')
        case default
            allocate (types(0))
        end select

    contains

        !> Types of the kinds whose elements a table of scenes contains.
        pure function kinds_in(table) result(list)
            character(len=*), intent(in) :: table
            integer, allocatable :: list(:)
            integer :: k

            list = [integer ::]
            do k = 1, size(self%kinds)
                if (self%kinds(k)%of%table() == table) list = [list, of_kind + k]
            end do
        end function kinds_in
    end function types_of

    !> Name of a body.
    pure function name_of(self, body) result(name)
        class(builder_type), intent(in) :: self
        !> 0 for the ground, negative for a coordinate of an element, which has the name of the element.
        integer, intent(in) :: body
        character(len=label_length) :: name

        name = 'ground'
        if (body > 0) name = self%bodies(body)%name
        if (body < 0) name = self%slides(-body)%name
    end function name_of

    !> Names of all elements of given types.
    pure function names_of(self, types) result(list)
        class(builder_type), intent(in) :: self
        integer, intent(in) :: types(:)
        character(len=name_length), allocatable :: list(:)
        integer :: i, n

        n = count([(any(self%types(i) == types), i=1, self%index_of%names%n)])
        allocate (list(n))
        n = 0
        do i = 1, self%index_of%names%n
            if (.not. any(self%types(i) == types)) cycle
            n = n + 1
            list(n) = self%index_of%names%name(i)
        end do
    end function names_of

    !> Append a sensor with a valid name.
    subroutine keep_sensor(self, sensor)
        class(builder_type), intent(inout) :: self
        type(sensor_type), intent(in) :: sensor

        self%n_of%sensors = self%n_of%sensors + 1
        if (self%n_of%sensors > size(self%sensors)) self%sensors = [self%sensors, self%sensors, sensor]
        self%sensors(self%n_of%sensors) = sensor
        call self%index_of%sensors%put(key_of(sensor), self%n_of%sensors)
    end subroutine keep_sensor

    !> Key that must be unique among sensors: group and name, and for the groups of results, in which an element may have several
    !> sensors, the measured quantity.
    pure function key_of(sensor) result(key)
        type(sensor_type), intent(in) :: sensor
        character(len=2*label_length + 8) :: key

        write (key, '(a, "/", a, i0)') trim(sensor%group), trim(sensor%name)//'/', merge(0, sensor%kind, sensor%group == 'sensors')
    end function key_of

    !> Check that a name is a valid group name in files and that no other sensor has it.
    subroutine check_sensor(self, name, sensor, error)
        class(builder_type), intent(inout) :: self
        character(len=*), intent(in) :: name
        type(sensor_type), intent(inout) :: sensor
        type(error_type), allocatable, intent(inout) :: error

        if (.not. allocated(self%types)) call self%clear()
        sensor%name = name
        if (len_trim(name) == 0 .or. len_trim(name) > name_length .or. scan(trim(name), './ ') > 0) then
            call refuse('sensor '//trim(name)//': "'//trim(name)//'" is not a valid name', 'use 1 to '//to_text(name_length)// &
                ' characters without dots, slashes and blanks', error)
        else if (self%index_of%sensors%get(key_of(sensor)) > 0) then
            call refuse('sensor '//trim(name)//' exists already', 'use another name', error)
        end if
    end subroutine check_sensor
end submodule tandem_mechanism_builder_sensors
