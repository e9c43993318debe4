! SPDX-License-Identifier: MIT
!> Read the keys of the elements that act on bodies: further rows, wheels and other rolling elements, forces, sensors.
module tandem_mechanism_described_elements
    use tandem_error, only: error_type
    use tandem_kinds, only: wp
    use tandem_mechanism, only: mechanism_type
    use tandem_mechanism_described_points, only: list_variables, take_point, take_points
    use tandem_mechanism_element_keys, only: key_length, text_length
    use tandem_mechanism_element_kind, only: word_length
    use tandem_mechanism_expression, only: expression_type
    use tandem_mechanism_function, only: function_type
    use tandem_mechanism_key_reader, only: anything, reader_type, not_negative, positive
    use tandem_mechanism_plane, only: plane_type
    implicit none (type, external)
    private

    public :: read_constraint, read_wheel, read_force

contains

    !> [constraint.NAME]
    subroutine read_constraint(reader, number, mechanism, n_points)
        type(reader_type), intent(inout) :: reader
        integer, intent(in) :: number
        type(mechanism_type), intent(inout) :: mechanism
        integer, intent(inout) :: n_points
        character(len=:), allocatable :: kind, name
        character(len=key_length) :: points(2)
        character(len=text_length), allocatable :: texts(:)
        character(len=word_length), allocatable :: words(:)
        real(wp), allocatable :: length
        class(function_type), allocatable :: motion
        type(expression_type), allocatable :: coefficients(:), rhs(:)
        character(len=key_length), allocatable :: variables(:)
        type(error_type), allocatable :: error
        integer :: i, k

        call reader%open_table('constraint', number)
        if (reader%failed()) return
        name = reader%name
        call list_labels(mechanism, 'constraint', words)
        call reader%get_word('type', kind, [character(len=word_length) :: 'distance', words, 'velocity'], required=.true.)
        if (reader%failed()) return
        k = mechanism%kind_number(kind)
        if (k > 0) then
            call mechanism%kinds(k)%of%read(reader, mechanism, n_points)
            return
        end if
        select case (kind)
        case ('distance')
            call take_points(reader, 'between', mechanism, n_points, points, 'two points', .true.)
            call reader%get_number('length', length, positive, 'm', &
                'prescribed length; default: length in the reference configuration')
            call reader%get_function('motion', motion, 'm', 'the length as a function of time')
            if (allocated(length) .and. allocated(motion)) then
              call reader%fail('motion', 'is given together with length', 'remove one of them')
            end if
        case default
            call list_variables(mechanism, variables)
            call reader%get_texts('velocities', 0, texts, 'such as "disk.vx"; sum of coefficients times them is the value', &
                required=.true.)
            if (allocated(texts)) call reader%get_expressions('coefficients', [(i, i=size(texts), size(texts))], &
                variables, coefficients, '', &
                'one for each velocity; expressions of t and the state', required=.true.)
            call reader%get_expressions('value', [1], variables, rhs, '', 'right-hand side; default 0')
        end select
        call reader%close_table()
        if (reader%failed()) return
        select case (kind)
        case ('distance')
            call mechanism%add_distance(name, trim(points(1)), trim(points(2)), error, length, motion)
        case default
            if (allocated(rhs)) then
                call mechanism%add_rate_row(name, texts, coefficients, error, rhs(1))
            else
                call mechanism%add_rate_row(name, texts, coefficients, error)
            end if
        end select
        call reader%blame(error)
    end subroutine read_constraint

    !> [wheel.NAME]
    subroutine read_wheel(reader, number, may_be_open, mechanism, n_points)
        type(reader_type), intent(inout) :: reader
        integer, intent(in) :: number
        logical, intent(in) :: may_be_open
        type(mechanism_type), intent(inout) :: mechanism
        integer, intent(inout) :: n_points
        character(len=:), allocatable :: kind, name, text
        character(len=key_length) :: point
        real(wp), allocatable :: across(:), axis(:), radius, height, crown, axes(:), along(:), about(:)
        class(function_type), allocatable :: steer
        type(plane_type) :: plane
        type(error_type), allocatable :: error
        integer :: n_place

        call reader%open_table('wheel', number)
        if (reader%failed()) return
        name = reader%name
        n_place = merge(2, 3, mechanism%planar)
        call reader%get_word('type', kind, [character(len=10) :: 'knife_edge', 'disk', 'sphere', 'ellipsoid', &
            'massless'], required=.true.)
        call reader%get('at', text, 'contact point or centre: a body or a point of it', required=.true.)
        if (reader%failed()) return
        call take_point(reader, 'at', text, mechanism, n_points, point)
        if (kind == 'knife_edge') then
            call reader%get_numbers('across', [n_place], across, anything, '', &
                'direction without slip, in the reference configuration', required=.true.)
            call reader%get_function('steer', steer, 'rad', 'steering angle, a function of time')
            if (.not. mechanism%planar) call reader%get_numbers('about', [3], about, anything, '', 'steering axis')
        else
            if (kind == 'ellipsoid') then
                call reader%get_numbers('semi_axes', [3], axes, positive, 'm', 'along the axes of the body', required=.true.)
            else
                call reader%get_number('radius', radius, positive, 'm', '', required=.true.)
            end if
            if (kind == 'disk' .or. kind == 'massless') then
                call reader%get_numbers('axis', [3], axis, anything, '', 'axis of rotation in the reference configuration', &
                    required=.true.)
                crown = 0.0_wp
                call reader%get_number('crown', crown, not_negative, 'm', 'radius of the rim''s section, a torus; 0: a sharp rim')
            end if
            plane%open = may_be_open
            plane%normal = [0.0_wp, 0.0_wp, 1.0_wp]
            call reader%get_numbers('normal', [3], plane%normal, anything, '', 'of the plane, on the side of the wheel')
            height = 0.0_wp
            call reader%get_number('height', height, anything, 'm', 'of the plane along its normal')
            plane%height = height
            call reader%get_function('rise', plane%rise, 'm', 'displacement of the plane along its normal, a function of time')
            if (kind == 'massless') then
                call reader%get_numbers('along', [3], along, anything, '', 'direction of the strut in the reference configuration')
                call reader%get_function('steer', steer, 'rad', 'steering angle, a function of time')
                call reader%get_numbers('about', [3], about, anything, '', 'steering axis; default: the strut')
            else
                call reader%get_function('rotation', plane%rotation, 'rad', 'rotation of the plane about its normal')
                call reader%get_numbers('pivot', [3], plane%pivot, anything, 'm', 'centre of this rotation; default: the origin')
                call reader%get_function('slide', plane%slide, 'm', 'displacement of the plane along a direction in it')
                call reader%get_numbers('along', [3], plane%along, anything, '', 'direction of this displacement')
            end if
        end if
        call reader%close_table()
        if (reader%failed()) return
        select case (kind)
        case ('knife_edge')
            call mechanism%add_knife_edge(name, trim(point), across, error, steer, about)
        case ('disk')
            call mechanism%add_rolling_disk(name, trim(point), radius, axis, error, plane, crown)
        case ('massless')
            call mechanism%add_massless_wheel(name, trim(point), radius, axis, error, along, steer, about, plane, crown)
        case ('sphere')
            call mechanism%add_rolling_sphere(name, trim(point), radius, error, plane)
        case default
            call mechanism%add_rolling_ellipsoid(name, trim(point), axes, error, plane)
        end select
        call reader%blame(error)
    end subroutine read_wheel

    !> [force.NAME]
    subroutine read_force(reader, number, mechanism, n_points)
        type(reader_type), intent(inout) :: reader
        integer, intent(in) :: number
        type(mechanism_type), intent(inout) :: mechanism
        integer, intent(inout) :: n_points
        character(len=word_length), allocatable :: words(:)
        character(len=:), allocatable :: kind
        integer :: k

        call reader%open_table('force', number)
        if (reader%failed()) return
        call list_labels(mechanism, 'force', words)
        call reader%get_word('type', kind, words, required=.true.)
        if (reader%failed()) return
        k = mechanism%kind_number(kind)
        call mechanism%kinds(k)%of%read(reader, mechanism, n_points)
    end subroutine read_force

    !> List the words of the kinds of a table.
    subroutine list_labels(mechanism, table, words)
        type(mechanism_type), intent(inout) :: mechanism
        character(len=*), intent(in) :: table
        character(len=word_length), allocatable, intent(out) :: words(:)
        integer :: k, n

        if (.not. allocated(mechanism%kinds)) call mechanism%clear()
        allocate (words(size(mechanism%kinds)))
        n = 0
        do k = 1, size(words)
            if (mechanism%kinds(k)%of%table() /= table) cycle
            n = n + 1
            words(n) = mechanism%kinds(k)%of%label()
        end do
        words = words(:n)
    end subroutine list_labels
end module tandem_mechanism_described_elements
