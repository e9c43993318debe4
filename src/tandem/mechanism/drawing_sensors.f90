! SPDX-License-Identifier: MIT
!> The words for sensors.
submodule(tandem_mechanism_drawing) tandem_mechanism_drawing_sensors
    use tandem_mechanism_sensor, only: sensed_distance, sensed_energy, sensed_joint, sensed_point
    implicit none (type, external)

contains

    !> A point: where it is, with velocity and acceleration.
    module procedure add_point_sensor
        type(sensor_type) :: sensor
        logical :: is_point

        sensor%kind = sensed_point
        call check_sensor(self, name, sensor, error)
        if (allocated(error)) return
        call self%take_point('sensor '//trim(name), on, sensor%span%first, sensor%span%s1, is_point, error)
        if (.not. allocated(error)) self%sensors = [self%sensors, sensor]
    end procedure add_point_sensor

    !> The coordinate of a joint.
    module procedure add_joint_sensor
        type(sensor_type) :: sensor
        integer :: i, k

        sensor%kind = sensed_joint
        call check_sensor(self, name, sensor, error)
        if (allocated(error)) return
        k = 0
        do i = 1, size(self%joints)
            if (self%joints(i)%name == joint) k = i
        end do
        if (k == 0) then
            call refuse('sensor '//trim(name)//': there is no joint '//trim(joint), 'correct the name', error)
            return
        end if
        associate (its => self%joints(k))
            sensor%slides = its%way > 0
            sensor%turns = its%turn > 0
            if (.not. (sensor%slides .or. sensor%turns)) then
                call refuse('sensor '//trim(name)//': the joint '//trim(joint)//' is '//trim(its%kind%name)// &
                    ', which has no coordinate of its own', &
                    'take a revolute, prismatic, cylindrical or point_on_line joint, or a sensor of a point', error)
                return
            end if
            sensor%span = span_type(first=its%first, second=its%second, s1=its%s1, s2=its%s2)
            sensor%planar = self%planar
            sensor%along = its%axes1(:, merge(1, 3, self%planar))
            sensor%x1 = its%axes1(:, 1)
            sensor%y1 = its%axes1(:, 2)
            sensor%x2 = its%axes2(:, 1)
            if (present(zero)) sensor%zero = zero
            if (self%planar .and. sensor%turns) then
              sensor%zero = sensor%zero - self%angle_of(its%second) + self%angle_of(its%first)
            end if
        end associate
        self%sensors = [self%sensors, sensor]
    end procedure add_joint_sensor

    !> The distance of two points.
    module procedure add_distance_sensor
        type(sensor_type) :: sensor
        logical :: points(2)

        sensor%kind = sensed_distance
        call check_sensor(self, name, sensor, error)
        if (allocated(error)) return
        associate (span => sensor%span)
            call self%take_pair('sensor '//trim(name), first, second, span%first, span%second, span%s1, span%s2, points, error)
        end associate
        if (.not. allocated(error)) self%sensors = [self%sensors, sensor]
    end procedure add_distance_sensor

    !> Kinetic and potential energy of the whole.
    module procedure add_energy_sensor
        type(sensor_type) :: sensor

        sensor%kind = sensed_energy
        call check_sensor(self, name, sensor, error)
        if (.not. allocated(error)) self%sensors = [self%sensors, sensor]
    end procedure add_energy_sensor

    !> A name that can be one of a file's groups and that no other sensor has.
    subroutine check_sensor(self, name, sensor, error)
        class(drawing_type), intent(inout) :: self
        character(len=*), intent(in) :: name
        type(sensor_type), intent(inout) :: sensor
        type(error_type), allocatable, intent(inout) :: error

        if (.not. allocated(self%names)) call self%clear()
        if (len_trim(name) == 0 .or. len_trim(name) > name_length .or. scan(trim(name), './ ') > 0) then
            call refuse('sensor '//trim(name)//': "'//trim(name)//'" is no name', 'take 1 to '//to_text(name_length)// &
                ' characters without dots, slashes and blanks', error)
        else if (any(self%sensors%name == name)) then
            call refuse('sensor '//trim(name)//' is there already', 'take another name', error)
        end if
        sensor%name = name
    end subroutine check_sensor
end submodule tandem_mechanism_drawing_sensors
