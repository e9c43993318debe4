! SPDX-License-Identifier: MIT
!> Build a mechanism from keys with values: the only module that defines the keys. Elements are added by the procedures of
!> `tandem_mechanism_builder` in an order in which all referenced elements exist already: bodies and points, joints and other rows,
!> wheels, forces, sensors.
module tandem_mechanism_description
    use tandem_error, only: error_type
    use tandem_kinds, only: wp
    use tandem_mechanism, only: mechanism_type
    use tandem_mechanism_described_elements, only: read_constraint, read_force, read_wheel
    use tandem_mechanism_described_sensors, only: read_results, read_sensor
    use tandem_mechanism_described_points, only: read_points, take_point
    use tandem_mechanism_element_keys, only: key_length, listed, place_among, text_length
    use tandem_mechanism_entries, only: entries_type, entry_type, is_number, is_text, text_value
    use tandem_mechanism_function, only: function_type
    use tandem_mechanism_joint, only: kind_names
    use tandem_mechanism_key_reader, only: anything, not_negative, positive, reader_type
    use tandem_mechanism_parameters, only: reserved_names, resolve_parameters
    use tandem_mechanism_repetition, only: repeat_elements
    use tandem_mechanism_shown, only: shown_type
    use tandem_mechanism_table_function, only: table_ends, table_kinds, table_type
    use tandem_mechanism_shape, only: set_mass_of_shape, shape_names, shape_sizes
    use tandem_mechanism_vector, only: in_space
    use tandem_rigid_euler_parameters, only: rotation
    implicit none (type, external)
    private

    public :: build_mechanism, mechanism_kinds, mechanism_singles

    !> Kinds of elements with names, and kinds of which there is one element.
    character(len=10), parameter :: mechanism_kinds(8) = [character(len=10) :: 'function', 'body', 'joint', 'constraint', 'wheel', &
        'force', 'sensor', 'repeat']
    character(len=10), parameter :: mechanism_singles(4) = [character(len=10) :: 'parameters', 'gravity', 'ground', &
        'results']

contains

    !> Build a mechanism from its keys, and define it. The message of an error states key, element and remedy.
    subroutine build_mechanism(entries, planar, may_be_open, times, mechanism, error, place, shown)
        type(entries_type), intent(in) :: entries
        !> True if bodies move in the plane.
        logical, intent(in) :: planar
        !> True if joints may be open in the reference configuration, because the start will be assembled.
        logical, intent(in) :: may_be_open
        !> Start and end of the run, between which kinks of functions of time are searched (s).
        real(wp), intent(in) :: times(2)
        type(mechanism_type), intent(inout) :: mechanism
        type(error_type), allocatable, intent(out) :: error
        !> Place of the entry that caused the error; 0 if none.
        integer, intent(out) :: place
        !> The complete mechanism with all defaults.
        type(shown_type), allocatable, intent(out) :: shown(:)
        type(reader_type) :: reader
        type(error_type), allocatable :: its_error
        type(entries_type) :: rest, repeats
        type(entries_type), target :: elements
        integer :: i, n_points

        call take_parameters(entries, reader, rest)
        if (.not. reader%failed()) then
          call repeat_elements(rest, reader%names, reader%values, elements, repeats, reader%error, reader%place)
        end if
        if (.not. reader%failed()) call reader%take(elements, mechanism_kinds(:7), mechanism_singles(2:))
        n_points = 0
        if (.not. reader%failed()) then
            mechanism%planar = planar
            mechanism%times = times
            call mechanism%clear()
            call show_repeats()
            call read_gravity(reader, mechanism)
            do i = 1, reader%n_of('function')
                call read_table(reader, i)
            end do
            do i = 1, reader%n_of('body')
                call read_body(reader, i, mechanism)
            end do
            call reader%open_table('ground', 1)
            call read_points(reader, 'ground', mechanism)
            call reader%close_table()
            do i = 1, reader%n_of('joint')
                call read_joint(reader, i, may_be_open, mechanism, n_points)
            end do
            do i = 1, reader%n_of('constraint')
                call read_constraint(reader, i, mechanism, n_points)
            end do
            do i = 1, reader%n_of('wheel')
                call read_wheel(reader, i, may_be_open, mechanism, n_points)
            end do
            do i = 1, reader%n_of('force')
                call read_force(reader, i, mechanism, n_points)
            end do
            do i = 1, reader%n_of('sensor')
                call read_sensor(reader, i, mechanism, n_points)
            end do
            call read_results(reader, mechanism)
        end if
        if (.not. reader%failed()) call mechanism%define(its_error)
        call reader%blame_named(its_error)
        place = reader%place
        if (reader%failed()) then
            call move_alloc(reader%error, error)
        else
            call order_as_given(entries, reader%shown(:reader%n_shown), shown)
        end if

    contains

        !> List the keys of repetitions in the complete mechanism.
        subroutine show_repeats()
            integer :: k, dot

            do k = 1, repeats%n
                dot = index(repeats%list(k)%key, '.', back=.true.)
                associate (key => repeats%list(k)%key)
                    call reader%show(shown_type(key(:dot - 1), key(dot + 1:), value=repeats%list(k)%value, &
                        comment=trim(repeat_help(key(dot + 1:)))))
                end associate
            end do
        end subroutine show_repeats
    end subroutine build_mechanism

    !> Sort the lines of the complete mechanism by the given order of their tables, which preserves the order of elements and
    !> coordinates.
    subroutine order_as_given(entries, lines, shown)
        type(entries_type), intent(in) :: entries
        type(shown_type), intent(in) :: lines(:)
        type(shown_type), allocatable, intent(out) :: shown(:)
        character(len=key_length) :: tables(size(mechanism_kinds) + size(mechanism_singles))
        integer :: i, k, n, m

        tables = ''
        n = 0
        do i = 1, entries%n
            call add_table(entries%list(i)%key)
        end do
        do i = 1, size(lines)
            call add_table(lines(i)%table)
        end do
        allocate (shown(size(lines)))
        m = 0
        do k = 1, n
            do i = 1, size(lines)
                if (index(lines(i)%table//'.', trim(tables(k))//'.') /= 1) cycle
                m = m + 1
                shown(m) = lines(i)
            end do
        end do

    contains

        !> The first part of a key.
        subroutine add_table(key)
            character(len=*), intent(in) :: key

            associate (first => key(:index(key//'.', '.') - 1))
                if (any(tables(:n) == first)) return
                n = n + 1
                tables(n) = first
            end associate
        end subroutine add_table
    end subroutine order_as_given

    !> Meaning of a key of a repetition.
    pure function repeat_help(key) result(help)
        character(len=*), intent(in) :: key
        character(len=64) :: help

        help = ''
        if (key == 'count') help = 'number of copies'
        if (key == 'index') help = 'name of the index, used as {i} in names and as i in expressions'
        if (key == 'first') help = 'index of the first copy'
    end function repeat_help

    !> Resolve the parameters, and return the other entries.
    subroutine take_parameters(entries, reader, rest)
        type(entries_type), intent(in) :: entries
        type(reader_type), intent(inout) :: reader
        type(entries_type), intent(out) :: rest
        character(len=*), parameter :: head = 'parameters.'
        character(len=4000), allocatable :: texts(:)
        character(len=key_length), allocatable :: names(:)
        character(len=24) :: number
        character(len=:), allocatable :: name
        integer :: i, n

        allocate (names(entries%n), texts(entries%n))
        n = 0
        do i = 1, entries%n
            associate (entry => entries%list(i))
                if (index(entry%key, head) /= 1) then
                    call rest%append(entry)
                    cycle
                end if
                name = entry%key(len(head) + 1:)
                reader%place = entry%place
                if (entry%value%is_list .or. all(entry%value%atoms(1)%kind /= [is_number, is_text])) then
                    call refuse_parameter(entry%key, 'is not a number', &
                        'give a number, or an expression of other parameters in quotes')
                    return
                else if (len(name) > key_length) then
                    call refuse_parameter(entry%key, 'has a name that is too long', 'shorten it')
                    return
                else if (index(name, '.') > 0) then
                    ! Next to a parameter named like the part before the dot, the complete scene would not be valid TOML.
                    call refuse_parameter(entry%key, 'has a dot in its name', 'use letters, digits and _')
                    return
                end if
                n = n + 1
                names(n) = name
                if (entry%value%atoms(1)%kind == is_text) then
                    texts(n) = entry%value%atoms(1)%text
                else
                    write (number, '(es24.16e3)') entry%value%atoms(1)%number
                    texts(n) = adjustl(number)
                end if
                call reader%show(shown_type('parameters', name, value=entry%value, comment=''))
            end associate
        end do
        allocate (reader%values(n))
        reader%names = names(:n)
        call resolve_parameters(reader%names, texts(:n), reader%values, reader%error, head)
        if (.not. allocated(reader%error)) return
        ! Find the parameter in the message, either by its key or as part of a circle.
        do i = entries%n, 1, -1
            if (index(entries%list(i)%key, head) /= 1) cycle
            name = entries%list(i)%key(len(head) + 1:)
            if (index(reader%error%message, head//name//':') > 0) then
                reader%place = entries%list(i)%place
                exit
            end if
            if (index(reader%error%message, ' '//name//' ->') > 0 .or. index(reader%error%message, ' "'//name//'" ') > 0) then
              reader%place = entries%list(i)%place
            end if
        end do

    contains

        subroutine refuse_parameter(key, problem, advice)
            character(len=*), intent(in) :: key, problem, advice

            call reader%refuse_all(key//' '//problem, advice)
        end subroutine refuse_parameter
    end subroutine take_parameters

    !> [function.NAME]
    subroutine read_table(reader, number)
        type(reader_type), intent(inout) :: reader
        integer, intent(in) :: number
        real(wp), allocatable :: at(:), values(:)
        character(len=:), allocatable :: kind, ends, name
        type(table_type) :: table
        type(error_type), allocatable :: error

        call reader%open_table('function', number)
        if (reader%failed()) return
        name = reader%name
        if (name == 'pi' .or. any(reserved_names == name) .or. any(reader%names == name)) then
            call reader%fail('', 'the name "'//name//'" has another meaning in expressions, as a variable or a parameter', &
                'choose another name')
            return
        end if
        call reader%get_numbers('at', [max(2, reader%count_of('at'))], at, anything, '', 'arguments, ascending', &
            required=.true.)
        call reader%get_numbers('values', [max(2, reader%count_of('at'))], values, anything, '', 'values, one per argument', &
            required=.true.)
        kind = 'cubic'
        call reader%get_word('type', kind, table_kinds, 'interpolation between the points')
        call reader%get_word('ends', ends, table_ends, 'extension beyond them')
        call reader%close_table()
        if (reader%failed()) return
        call table%initialize(at, values, kind, error, ends)
        if (allocated(error)) error%message = error%message(:index(error%message, ': ') + 1)//'function '//name//': '// &
            error%message(index(error%message, ': ') + 2:)
        call reader%blame(error)
        if (.not. reader%failed()) call reader%add_table(name, table)
    end subroutine read_table

    !> [gravity]
    subroutine read_gravity(reader, mechanism)
        type(reader_type), intent(inout) :: reader
        type(mechanism_type), intent(inout) :: mechanism
        real(wp), allocatable :: vector(:)

        call reader%open_table('gravity', 1)
        vector = [real(wp) :: 0.0_wp, 0.0_wp]
        if (.not. mechanism%planar) vector = [vector, 0.0_wp]
        call reader%get_numbers('vector', [size(vector)], vector, anything, 'm/s^2', 'acceleration due to gravity')
        call reader%close_table()
        if (.not. reader%failed()) mechanism%gravity = in_space(vector)
    end subroutine read_gravity

    !> [body.NAME]
    subroutine read_body(reader, number, mechanism)
        type(reader_type), intent(inout) :: reader
        integer, intent(in) :: number
        type(mechanism_type), intent(inout) :: mechanism
        real(wp), allocatable :: mass, density, angle, inertia(:), position(:), rotation(:), p(:), velocity(:), omega(:), spin(:), &
            sizes(:)
        character(len=key_length), allocatable :: shapes(:)
        character(len=:), allocatable :: name, shape
        type(error_type), allocatable :: error
        integer :: n_place, i

        call reader%open_table('body', number)
        if (reader%failed()) return
        n_place = merge(2, 3, mechanism%planar)
        name = reader%name
        call reader%keys_below('shape', shapes)
        if (size(shapes) > 1) call reader%fail('shape.'//trim(shapes(2)), 'is a second shape', 'give one shape')
        if (size(shapes) == 1) then
            shape = trim(shapes(1))
            i = place_among(shape_names, shape)
            if (i == 0) then
                call reader%fail('shape.'//shape, 'is not a shape', 'use bar, box, cylinder or sphere')
            else
                call reader%get_numbers('shape.'//shape, [shape_sizes(i)], sizes, positive, 'm', &
                    'bar: length, width; box: three knife_edges; cylinder: radius, length along z; sphere: radius')
            end if
        end if
        call reader%get_number('mass', mass, not_negative, 'kg', '', required=.not. reader%gives('density'))
        call reader%get_number('density', density, positive, merge('kg/m^2', 'kg/m^3', mechanism%planar), &
            'with a shape, instead of mass and inertia')
        if (mechanism%planar) then
            call reader%get_numbers('inertia', [1], inertia, not_negative, 'kg m^2', 'about the centre of mass; none: a point mass')
        else
            call reader%get_numbers('inertia', [3, 6], inertia, anything, 'kg m^2', &
                'about the centre of mass: xx, yy, zz in the axes of the body, then xy, xz, yz; none: a point mass')
        end if
        if (reader%failed()) return
        if (allocated(density) .and. .not. allocated(sizes)) then
            call reader%fail('density', 'is given without a shape', 'add one, such as shape = { box = [1, 0.1, 0.1] }')
        else if (allocated(density) .and. allocated(mass)) then
            call reader%fail('density', 'is given together with mass', 'remove one of them')
        else if (allocated(sizes) .and. .not. allocated(inertia)) then
            call set_mass_of_shape(shape, sizes, mechanism%planar, density, mass, inertia)
            if (.not. allocated(inertia)) call reader%fail('shape.'//shape, 'has no inertia in '// &
                trim(merge('the plane', 'space    ', mechanism%planar)), 'give the inertia, or another shape')
        end if
        call reader%get_numbers('position', [n_place], position, anything, 'm', &
            'of the centre of mass in the reference configuration', required=.true.)
        velocity = [(0.0_wp, i=1, n_place)]
        call reader%get_numbers('velocity', [n_place], velocity, anything, 'm/s', 'of the centre of mass at the start')
        ! A point mass has no rotation.
        if (allocated(inertia)) then
            if (mechanism%planar) then
                angle = 0.0_wp
                call reader%get_number('angle', angle, anything, 'rad', 'in the reference configuration')
                p = [angle]
            else
                call reader%get_numbers('rotation', [3], rotation, anything, 'rad', &
                    'in the reference configuration: axis times angle')
                call reader%get_numbers('euler_parameters', [4], p, anything, '', 'instead of the rotation')
                if (allocated(rotation) .and. allocated(p)) then
                  call reader%fail('rotation', 'is given together with Euler parameters', 'remove one of them')
                end if
                if (allocated(rotation)) p = turned_by(rotation)
            end if
            if (reader%gives('omega_body') .and. .not. mechanism%planar) then
                if (reader%gives('omega')) call reader%fail('omega_body', 'is given together with omega', 'remove one of them')
                call reader%get_numbers('omega_body', [3], spin, anything, 'rad/s', &
                    'angular velocity at the start, in the axes of the body')
                if (.not. allocated(p)) p = [1.0_wp, 0.0_wp, 0.0_wp, 0.0_wp]
                if (.not. reader%failed()) omega = matmul(rotation_of(p), spin)
            else
                omega = [(0.0_wp, i=1, merge(1, 3, mechanism%planar))]
                call reader%get_numbers('omega', [size(omega)], omega, anything, 'rad/s', &
                    'angular velocity at the start, in the axes of the world; or omega_body')
            end if
        end if
        call reader%pass('looks', 'for display only: shapes and meshes, with positions relative to the centre of mass')
        if (reader%failed()) return
        call mechanism%add_body(name, mass, position, error, inertia, p, velocity, omega)
        if (allocated(sizes) .and. .not. allocated(error)) then
            associate (body => mechanism%bodies(mechanism%n_of%bodies))
                body%shape = shape
                body%sizes(:size(sizes)) = sizes
            end associate
        end if
        call reader%blame(error)
        call read_points(reader, name, mechanism)
        call reader%close_table()
    end subroutine read_body

    !> Rotation of Euler parameters of any length other than zero.
    pure function rotation_of(p) result(a)
        real(wp), intent(in) :: p(4)
        real(wp) :: a(3, 3)

        a = rotation(p/max(norm2(p), tiny(1.0_wp)))
    end function rotation_of

    !> Euler parameters of a rotation about an axis.
    pure function turned_by(rotation) result(p)
        real(wp), intent(in) :: rotation(3)
        real(wp) :: p(4), angle

        angle = norm2(rotation)
        p = [cos(angle/2), rotation/2]
        if (angle > 0.0_wp) p(2:) = sin(angle/2)*rotation/angle
    end function turned_by

    !> [joint.NAME]
    subroutine read_joint(reader, number, may_be_open, mechanism, n_points)
        type(reader_type), intent(inout) :: reader
        integer, intent(in) :: number
        logical, intent(in) :: may_be_open
        type(mechanism_type), intent(inout) :: mechanism
        integer, intent(inout) :: n_points
        character(len=key_length) :: sides(2), point
        character(len=text_length), allocatable :: texts(:)
        character(len=:), allocatable :: kind, name, at_point, named
        real(wp), allocatable :: at(:), axis(:), across(:), pitch, freedoms(:), rotor
        integer, allocatable :: hold(:), drive
        class(function_type), allocatable :: motion
        type(error_type), allocatable :: error
        integer :: n_place, i

        call reader%open_table('joint', number)
        if (reader%failed()) return
        name = reader%name
        n_place = merge(2, 3, mechanism%planar)
        call reader%get('type', kind, trim(kind_names(mechanism%planar)), required=.true.)
        call reader%get_texts('bodies', 2, texts, 'the two bodies, or points of them; "ground" is one', required=.true.)
        if (reader%failed()) return
        do i = 1, 2
            call take_point(reader, 'bodies', trim(texts(i)), mechanism, n_points, sides(i))
        end do
        if (reader%failed()) return
        if (reader%is_text_at('at')) then
            call reader%get('at', at_point, 'm, position in the reference configuration; or a point of one of the bodies')
            ! A body without a point name denotes its centre of mass.
            named = at_point
            if (scan(named, '.:') == 0) named = named//trim(merge(':[0, 0]   ', ':[0, 0, 0]', mechanism%planar))
            call take_point(reader, 'at', named, mechanism, n_points, point)
            i = place_among([character(len=key_length) :: body_of(sides(1)), body_of(sides(2))], body_of(point))
            if (i == 0) then
                call reader%fail('at', '"'//at_point//'" is not a point of one of its bodies', &
                    'name one of them, or give the position in the reference configuration')
            else if (scan(sides(i), '.:') == 0) then
                sides(i) = point
            else if (texts(i) /= at_point) then
                call reader%fail('at', '"'//at_point//'" differs from the point of that body in bodies, "'//trim(texts(i))//'"', &
                    'remove one of them')
            end if
        else
            call reader%get_numbers('at', [n_place], at, anything, 'm', &
                'position in the reference configuration; or a point of one of the bodies')
        end if
        call reader%get_numbers('axis', [n_place], axis, anything, '', &
            'axis of rotation or sliding, direction of the line, normal of the plane; '// &
            'in the reference configuration')
        if (.not. mechanism%planar) call reader%get_numbers('across', [n_place], across, anything, '', &
            'axis of a universal joint on the second body')
        call reader%get_function('motion', motion, 'rad or m', 'prescribed coordinate, from the reference configuration')
        call reader%get_number('pitch', pitch, anything, 'm', 'of a screw: displacement per revolution')
        call reader%get_numbers('hold', [merge(3, 6, mechanism%planar)], freedoms, anything, '', &
            'of a primitive: for each direction 0 free, 1 constrained at position level, 2 at velocity level')
        call read_drive(reader, mechanism%planar, drive)
        call reader%get_number('rotor_inertia', rotor, not_negative, 'kg m^2 or kg', &
            'of a rotor: the kinetic energy is half of it times the squared rate of the joint')
        call reader%close_table()
        if (reader%failed()) return
        if (allocated(freedoms)) hold = nint(freedoms)
        call mechanism%add_joint(name, kind, trim(sides(1)), trim(sides(2)), error, at, axis, across, motion, may_be_open, pitch, &
            hold, drive)
        if (.not. allocated(error) .and. allocated(rotor)) call mechanism%add_coupling(name//'_rotor', &
            [name], [1.0_wp], error, inertia=rotor)
        call reader%blame(error)
    end subroutine read_joint

    !> Freedom of a primitive that its motion drives, given by its place in `hold` or its name.
    subroutine read_drive(reader, planar, drive)
        type(reader_type), intent(inout) :: reader
        logical, intent(in) :: planar
        !> Not allocated if the key is absent.
        integer, allocatable, intent(out) :: drive
        character(len=*), parameter :: key = 'drive', help = 'of a primitive: direction that the motion drives'
        character(len=5), parameter :: in_space(6) = [character(len=5) :: 'x', 'y', 'z', 'rx', 'ry', 'rz']
        character(len=5), parameter :: in_the_plane(3) = [character(len=5) :: 'x', 'y', 'angle']
        character(len=5), allocatable :: names(:)
        character(len=:), allocatable :: name
        real(wp), allocatable :: place

        if (planar) then
            allocate (names(3), source=in_the_plane)
        else
            allocate (names(6), source=in_space)
        end if
        if (reader%is_text_at(key)) then
            call reader%get_word(key, name, names, help)
            if (.not. reader%failed()) drive = place_among(names, name)
            return
        end if
        call reader%get_number(key, place, positive, '', help//':'//listed(names)//' or its index in hold')
        if (.not. allocated(place) .or. reader%failed()) return
        drive = nint(min(place, size(names) + 1.0_wp))
        if (abs(place - drive) > 0.0_wp) call reader%fail(key, 'is not an index in hold', 'use one of'//listed(names))
    end subroutine read_drive

    !> The body of a point.
    pure function body_of(point) result(body)
        character(len=*), intent(in) :: point
        character(len=len(point)) :: body

        body = point(:index(point//'.', '.') - 1)
    end function body_of

end module tandem_mechanism_description
