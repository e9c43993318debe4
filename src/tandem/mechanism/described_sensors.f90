! SPDX-License-Identifier: MIT
!> Reads the tables [sensor.NAME] and [results] of a mechanism.
module tandem_mechanism_described_sensors
    use tandem_error, only: error_type
    use tandem_kinds, only: wp
    use tandem_mechanism, only: mechanism_type
    use tandem_mechanism_described_points, only: take_point, take_points
    use tandem_mechanism_element_keys, only: key_length, text_length
    use tandem_mechanism_key_reader, only: anything, reader_type
    implicit none (type, external)
    private

    public :: read_sensor, read_results

contains

    !> [sensor.NAME]
    subroutine read_sensor(reader, number, mechanism, n_points)
        type(reader_type), intent(inout) :: reader
        integer, intent(in) :: number
        type(mechanism_type), intent(inout) :: mechanism
        integer, intent(inout) :: n_points
        character(len=*), parameter :: kinds(8) = [character(len=8) :: 'point', 'joint', 'distance', 'energy', 'body', &
            'reaction', 'force', 'balance']
        character(len=:), allocatable :: name, text, words
        character(len=key_length) :: points(2), point
        real(wp), allocatable :: zero
        type(error_type), allocatable :: error
        logical :: wanted
        integer :: i, n

        call reader%open_table('sensor', number)
        if (reader%failed()) return
        name = reader%name
        n = count([(reader%gives(trim(kinds(i))), i=1, size(kinds))])
        if (reader%gives('point')) then
            call reader%get('point', text, 'a body or a point of it: position, velocity, acceleration')
            if (reader%failed()) return
            call take_point(reader, 'point', text, mechanism, n_points, point)
            if (.not. reader%failed()) call mechanism%add_point_sensor(name, trim(point), error)
        else if (reader%gives('joint')) then
            call reader%get('joint', text, 'its displacement or angle (full rotations counted) and its rate')
            zero = 0.0_wp
            call reader%get_number('zero', zero, anything, 'rad or m', 'value in the reference configuration')
            if (.not. reader%failed()) call mechanism%add_joint_sensor(name, text, error, zero)
        else if (reader%gives('distance')) then
            call take_points(reader, 'distance', mechanism, n_points, points, 'two points: distance and rate', .false.)
            if (.not. reader%failed()) call mechanism%add_distance_sensor(name, trim(points(1)), trim(points(2)), error)
        else if (reader%gives('energy')) then
            wanted = .true.
            call reader%get('energy', wanted, 'kinetic, potential and total energy of the mechanism')
            if (wanted .and. .not. reader%failed()) call mechanism%add_energy_sensor(name, error)
        else if (reader%gives('body')) then
            call reader%get('body', text, 'position, orientation, velocities and energies')
            if (.not. reader%failed()) call mechanism%add_body_sensor(name, text, error)
        else if (reader%gives('reaction')) then
            call reader%get('reaction', text, 'a joint, a wheel or a constraint: force, torque, power of its motion')
            if (.not. reader%failed()) call mechanism%add_reaction_sensor(name, text, error)
        else if (reader%gives('force')) then
            if (.not. allocated(mechanism%kinds)) call mechanism%clear()
            call mechanism%list_words(.false., ' or ', words)
            call reader%get('force', text, words//': force, length, energy, power')
            if (.not. reader%failed()) call mechanism%add_force_sensor(name, text, error)
        else if (reader%gives('balance')) then
            wanted = .true.
            call reader%get('balance', wanted, 'energies, work of motions and forces, and the residual')
            if (wanted .and. .not. reader%failed()) call mechanism%add_balance_sensor(name, error)
        end if
        call reader%blame(error)
        if (n /= 1) call reader%fail('', 'must measure one thing', &
            'give one of point, joint, distance, energy, body, reaction, force, balance')
        call reader%close_table()
    end subroutine read_sensor

    !> [results]
    subroutine read_results(reader, mechanism)
        type(reader_type), intent(inout) :: reader
        type(mechanism_type), intent(inout) :: mechanism
        character(len=*), parameter :: kinds(5) = [character(len=11) :: 'bodies', 'joints', 'wheels', 'constraints', 'forces']
        character(len=*), parameter :: help(5) = [character(len=72) :: &
            'names, or "all": position, orientation, velocities, energies', &
            'coordinates, reactions, power of motions', 'positions and forces of contact', &
            'forces and multipliers', 'forces, lengths, energies, power']
        character(len=:), allocatable :: text
        character(len=text_length), allocatable :: names(:)
        type(error_type), allocatable :: error
        logical :: balance
        integer :: i

        if (reader%n_of('results') == 0) return
        call reader%open_table('results', 1)
        if (reader%failed()) return
        do i = 1, size(kinds)
            if (allocated(names)) deallocate (names)
            if (allocated(text)) deallocate (text)
            if (reader%is_text_at(trim(kinds(i)))) then
                call reader%get(trim(kinds(i)), text, trim(help(i)))
                if (text /= 'all') call reader%fail(trim(kinds(i)), 'is '//text, 'write "all", or a list of names')
                allocate (names(1))
                names = text
            else
                call reader%get_texts(trim(kinds(i)), 0, names, trim(help(i)))
            end if
            if (reader%failed()) return
            if (.not. allocated(names)) cycle
            call mechanism%add_results(trim(kinds(i)), names, error)
            call reader%blame(error)
            if (reader%failed()) return
        end do
        balance = .false.
        call reader%get('balance', balance, 'energies, work of motions and forces, and the residual')
        if (balance .and. .not. reader%failed()) call mechanism%add_balance_sensor('balance', error, '')
        call reader%blame(error)
        call reader%close_table()
    end subroutine read_results
end module tandem_mechanism_described_sensors
