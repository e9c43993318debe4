! SPDX-License-Identifier: MIT
!> Builder procedures for joints.
submodule(tandem_mechanism_builder) tandem_mechanism_builder_joints
    use tandem_error, only: to_text
    use tandem_mechanism_coordinate, only: is_angle, is_displacement, is_elevation
    use tandem_mechanism_formula, only: is_place, is_spin, is_time, is_turn, is_turn_rate, is_velocity
    use tandem_mechanism_joint, only: find_kind, kind_names, kind_type
    use tandem_mechanism_refusal, only: refuse, take_vector
    use tandem_mechanism_sensor, only: of_distance, of_joint, of_row
    use tandem_mechanism_vector, only: cross, frame_along
    use, intrinsic :: ieee_arithmetic, only: ieee_is_finite
    implicit none (type, external)

contains

    module procedure add_joint
        type(placed_joint_type) :: joint
        character(len=:), allocatable :: label
        integer :: i, k, driven

        label = 'joint '//trim(name)
        call self%check_name(name, label, error)
        if (allocated(error)) return
        joint%name = name
        joint%kind = find_kind(kind, self%planar)
        joint%kind_name = joint%kind%name
        driven = merge(joint%kind%driven, 0, present(motion))
        if (joint%kind%name == '') then
            call refuse(label//' has the unknown type '//trim(kind), 'use one of '//trim(kind_names(self%planar)), error)
        else if ((joint%kind%name == 'screw') .neqv. present(pitch)) then
            call refuse(label//' has a pitch, or lacks one', 'give a pitch to screws only', error)
        else if (joint%kind%name == 'primitive') then
            call take_freedoms(self, label, joint, driven, present(motion), error, hold, drive)
        else if (present(hold) .or. present(drive)) then
            call refuse(label//' has hold, which its type defines', 'use the type primitive, or remove hold', error)
        else if (present(motion) .and. joint%kind%driven == 0) then
            call refuse(label//' cannot be driven', 'drive a revolute or a prismatic joint', error)
        end if
        if (allocated(error)) return
        if (present(open)) joint%may_be_open = open
        call self%place_joint(label, joint, first, second, error, at, axis, across)
        if (allocated(error)) return
        associate (turns => joint%kind%held .or. joint%at_velocity_level)
            if (any(turns(merge(3, 4, self%planar):merge(3, 6, self%planar))) .or. driven > merge(2, 3, self%planar)) then
                do k = 1, 2
                    i = merge(joint%first, joint%second, k == 1)
                    if (i > 0) call self%need_turning_body(label, i, error)
                    if (allocated(error)) return
                end do
            end if
        end associate
        call add_joint_rows(self, joint, driven, motion)
        call add_coordinates(self, joint)
        self%n_of%joints = self%n_of%joints + 1
        if (self%n_of%joints > size(self%joints)) self%joints = [self%joints, self%joints, joint%joint_type]
        self%joints(self%n_of%joints) = joint%joint_type
        call self%keep_name(name, of_joint, self%n_of%joints)
        ! A separate row for the displacement and the angle of the screw.
        if (present(pitch)) call add_sum(self, trim(name)//' pitch', 'N', &
            self%at%coordinates([joint%displacement, joint%rotation]), [1.0_wp, -pitch/(2*acos(-1.0_wp))], 0, .false.)
    end procedure add_joint

    !> Set the freedoms that a primitive constrains.
    subroutine take_freedoms(self, label, joint, driven, is_driven, error, hold, drive)
        class(builder_type), intent(in) :: self
        character(len=*), intent(in) :: label
        type(placed_joint_type), intent(inout) :: joint
        integer, intent(inout) :: driven
        logical, intent(in) :: is_driven
        type(error_type), allocatable, intent(inout) :: error
        integer, intent(in), optional :: hold(:), drive
        integer :: n, m

        n = merge(3, 6, self%planar)
        m = 0
        if (present(hold)) m = size(hold)
        if (m /= n) then
            call refuse(label//': hold has '//to_text(m)//' entries', 'give '//to_text(n)//': 0 for free, '// &
                '1 for constrained at position level, 2 at velocity level', error)
            return
        else if (any(hold < 0 .or. hold > 2) .or. all(hold == 0)) then
            call refuse(label//': hold has an entry that is not 0, 1, 2, or holds nothing', 'correct it', error)
            return
        end if
        joint%kind%held(:n) = hold == 1
        joint%at_velocity_level(:n) = hold == 2
        if (.not. is_driven) return
        driven = 0
        if (present(drive)) driven = drive
        if (driven < 1 .or. driven > n) then
            driven = 0
        else if (hold(driven) == 0) then
            driven = 0
        end if
        if (driven == 0) then
            call refuse(label//' has a motion that drives no direction', 'set drive to a direction constrained in hold', error)
            return
        end if
        ! The row of the motion constrains the driven freedom.
        joint%kind%held(driven) = .false.
        if (n == 3 .or. driven < 4 .or. joint%at_velocity_level(driven)) return
        if (count(joint%kind%held(4:6)) == 1) call refuse(label//' drives a rotation, and one other rotation is constrained', &
            'constrain both other rotations, or neither', error)
    end subroutine take_freedoms

    module procedure place_joint
        real(wp) :: frame(3, 3), place(3), a1(3, 3), a2(3, 3), r1(3), r2(3), gap(3)
        type(point_vector_type) :: pair
        logical :: points(2)
        integer :: k

        call self%take_pair(label, first, second, pair, points, error)
        if (allocated(error)) return
        joint%first = pair%first
        joint%second = pair%second
        joint%s1 = pair%s1
        joint%s2 = pair%s2
        call self%frame_of(joint%first, r1, a1)
        call self%frame_of(joint%second, r2, a2)
        if (present(at)) then
            call take_vector(self%planar, label, 'at', at, place, error)
            if (allocated(error)) return
            if (.not. points(1)) joint%s1 = matmul(place - r1, a1)
            if (.not. points(2)) joint%s2 = matmul(place - r2, a2)
        else if (points(1) .and. .not. points(2)) then
            joint%s2 = matmul(r1 + matmul(a1, joint%s1) - r2, a2)
        else if (points(2) .and. .not. points(1)) then
            joint%s1 = matmul(r2 + matmul(a2, joint%s2) - r1, a1)
        else if (.not. points(1)) then
            call refuse(label//' has no position', 'add at = ..., or name a point of one of the bodies', error)
            return
        end if
        call take_axes(self, label, joint%kind, axis, across, frame, error)
        if (allocated(error)) return
        joint%axes1 = matmul(transpose(a1), frame)
        joint%axes2 = matmul(transpose(a2), frame)
        if (joint%kind%name == 'gimbal') call tilt_axes(dot_product(across, frame(:, 1))/norm2(across), joint%axes2)
        gap = matmul(r2 + matmul(a2, joint%s2) - r1 - matmul(a1, joint%s1), frame)
        do k = 1, merge(2, 3, self%planar)
            if (.not. joint%kind%held(k)) gap(k) = 0.0_wp
        end do
        if (norm2(gap) > tolerance*(1 + norm2(r1) + norm2(r2)) .and. .not. joint%may_be_open) then
            call refuse(label//': its two sides are '//to_text(norm2(gap))//' m apart in the reference configuration', &
                'move a body or a point, or assemble the start, in a scene by [initial] assemble = true', error)
        end if
    end procedure place_joint

    !> Axes of a gimbal on its second body: the third one has this sine of the angle from the plane across the first axis.
    pure subroutine tilt_axes(sine, axes)
        real(wp), intent(in) :: sine
        real(wp), intent(inout) :: axes(3, 3)
        real(wp) :: cosine, first(3)

        cosine = sqrt(1 - sine**2)
        first = axes(:, 1)
        axes(:, 1) = cosine*first - sine*axes(:, 3)
        axes(:, 3) = sine*first + cosine*axes(:, 3)
    end subroutine tilt_axes

    !> Add the successive angles of a universal joint, about the axes of its bodies, or of a gimbal: about axis 1 of the first body,
    !> axis 3 of the second one, and the axis perpendicular to both.
    subroutine add_angles(self, joint)
        class(builder_type), intent(inout) :: self
        type(placed_joint_type), intent(inout) :: joint
        type(coordinate_type) :: elevation
        real(wp) :: r(3), a1(3, 3), a2(3, 3)

        associate (e => joint%axes1, f => joint%axes2)
            if (joint%kind%name == 'universal') then
                call keep(1, angle(e(:, 2), f(:, 2), e(:, 3), f(:, 2)))
                call keep(2, angle(e(:, 1), f(:, 1), e(:, 1), f(:, 3)))
            else
                call self%frame_of(joint%first, r, a1)
                call self%frame_of(joint%second, r, a2)
                elevation = angle(e(:, 1), f(:, 3), e(:, 3), f(:, 3))
                elevation%kind = is_elevation
                elevation%offset = elevation_of(matmul(a1, e(:, 1)), matmul(a2, f(:, 3)))
                call keep(1, angle(e(:, 3), f(:, 3), -e(:, 2), f(:, 3)))
                call keep(2, elevation)
                call keep(3, angle(e(:, 1), f(:, 1), e(:, 1), -f(:, 2)))
            end if
        end associate

    contains

        !> Angle with the cosine a.b and the sine c.d, up to a common factor.
        pure type(coordinate_type) function angle(a, b, c, d)
            real(wp), intent(in) :: a(3), b(3), c(3), d(3)

            angle = angle_in_space(joint, 1, 2)
            angle%one%a = a
            angle%one%b = b
            angle%other%a = c
            angle%other%b = d
        end function angle

        !> Angle of a vector from the plane across another one.
        pure real(wp) function elevation_of(a, d)
            real(wp), intent(in) :: a(3), d(3)

            elevation_of = atan2(dot_product(a, d), norm2(cross(a, d)))
        end function elevation_of

        subroutine keep(k, coordinate)
            integer, intent(in) :: k
            type(coordinate_type), intent(in) :: coordinate

            call self%keep_coordinate(coordinate, joint%angles(k))
        end subroutine keep
    end subroutine add_angles

    !> Add the coordinates of a joint with one rotation or one displacement, about or along its axis, from the reference
    !> configuration on.
    subroutine add_coordinates(self, joint)
        class(builder_type), intent(inout) :: self
        type(placed_joint_type), intent(inout) :: joint
        type(coordinate_type) :: coordinate
        integer :: axis

        axis = merge(1, 3, self%planar)
        if (any(joint%kind%name == [character(len=9) :: 'universal', 'gimbal']) .and. turns(joint%first) .and. &
            turns(joint%second)) call add_angles(self, joint)
        associate (held => joint%kind%held)
            if (merge(.not. held(3), all(held(4:5)) .and. .not. held(6), self%planar) .and. turns(joint%first) .and. &
                turns(joint%second)) then
                coordinate = angle_in_space(joint, 1, 2)
                if (self%planar) coordinate%offset = self%angle_of(joint%second) - self%angle_of(joint%first)
                if (joint%driven == merge(3, 6, self%planar)) coordinate%motion = joint%motion
                call self%keep_coordinate(coordinate, joint%rotation)
            end if
            if (.not. held(axis) .and. count(.not. held(:merge(2, 3, self%planar))) == 1) then
                coordinate = coordinate_type(kind=is_displacement, first=joint%first, second=joint%second)
                coordinate%one = perpendicular_type(first=joint%first, second=joint%second, is_point=.true., a=joint%axes1(:, &
                    axis), b=joint%s2)
                coordinate%offset = reference_displacement(self, joint, axis)
                call self%keep_coordinate(coordinate, joint%displacement)
            end if
        end associate

    contains

        !> True if a side is the ground or a body with a rotation.
        logical function turns(body)
            integer, intent(in) :: body

            turns = .true.
            if (body > 0) turns = self%bodies(body)%turns
        end function turns
    end subroutine add_coordinates

    !> Displacement of the second body's point from the first one's along an axis of the joint, in the reference configuration.
    pure real(wp) function reference_displacement(self, joint, axis)
        class(builder_type), intent(in) :: self
        type(placed_joint_type), intent(in) :: joint
        integer, intent(in) :: axis
        real(wp) :: r1(3), r2(3), a1(3, 3), a2(3, 3)

        call self%frame_of(joint%first, r1, a1)
        call self%frame_of(joint%second, r2, a2)
        reference_displacement = dot_product(matmul(a1, joint%axes1(:, axis)), r2 + matmul(a2, joint%s2) - r1)
    end function reference_displacement

    !> Append a perpendicularity row.
    subroutine keep_perpendicular(self, perpendicular)
        class(builder_type), intent(inout) :: self
        type(perpendicular_type), intent(in) :: perpendicular

        self%n_of%perpendiculars = self%n_of%perpendiculars + 1
        if (self%n_of%perpendiculars > size(self%perpendiculars)) self%perpendiculars = [self%perpendiculars, &
            self%perpendiculars, perpendicular]
        self%perpendiculars(self%n_of%perpendiculars) = perpendicular
    end subroutine keep_perpendicular

    !> Append coincident points.
    subroutine keep_coincidence(self, meeting)
        class(builder_type), intent(inout) :: self
        type(point_vector_type), intent(in) :: meeting

        self%n_of%coincidences = self%n_of%coincidences + 1
        if (self%n_of%coincidences > size(self%coincidences)) self%coincidences = [self%coincidences, self%coincidences, meeting]
        self%coincidences(self%n_of%coincidences) = meeting
    end subroutine keep_coincidence

    !> Append a constrained angle.
    subroutine keep_angle(self, angle)
        class(builder_type), intent(inout) :: self
        type(angle_type), intent(in) :: angle

        self%n_of%angles = self%n_of%angles + 1
        if (self%n_of%angles > size(self%angles)) self%angles = [self%angles, self%angles, angle]
        self%angles(self%n_of%angles) = angle
    end subroutine keep_angle

    !> Frame of the joint in the world, axes in columns.
    subroutine take_axes(self, label, kind, axis, across, frame, error)
        class(builder_type), intent(in) :: self
        character(len=*), intent(in) :: label
        type(kind_type), intent(in) :: kind
        real(wp), intent(in), optional :: axis(:), across(:)
        real(wp), intent(out) :: frame(3, 3)
        type(error_type), allocatable, intent(inout) :: error
        real(wp), parameter :: z(3) = [0.0_wp, 0.0_wp, 1.0_wp]
        real(wp) :: a(3), b(3)

        a = merge([1.0_wp, 0.0_wp, 0.0_wp], z, self%planar)
        b = 0.0_wp
        if (present(axis)) call self%take_direction(label, 'axis', axis, a, error)
        if (present(across) .and. .not. allocated(error)) call self%take_direction(label, 'across', across, b, error)
        if (allocated(error)) return
        if (kind%has_axis .and. .not. present(axis)) then
            call refuse(label//' has no axis', 'add axis = ...', error)
            return
        end if
        if (present(across) .and. norm2(cross(a, b)) < 1.0e-6_wp) then
            call refuse(label//': across is parallel to the axis', 'use another direction', error)
            return
        end if
        if (self%planar) then
            frame = reshape([a, cross(z, a), z], [3, 3])
        else if (kind%name == 'gimbal') then
            if (.not. present(across)) then
                call refuse(label//' has one axis, and a gimbal has three: across is missing', &
                    'give axis, about which it rotates first, and across, about which it rotates last', error)
                return
            end if
            frame(:, 1) = a
            frame(:, 2) = cross(b, a)/norm2(cross(b, a))
            frame(:, 3) = cross(a, frame(:, 2))
        else if (kind%name == 'universal') then
            if (.not. present(across)) then
                call refuse(label//' has one axis, and a universal joint has two: across is missing', &
                    'give axis on the first body and across on the second, at 90 degrees in the reference configuration', error)
                return
            else if (abs(dot_product(a, b)) > tolerance) then
                call refuse(label//' has axes that are not perpendicular: their cosine is '//to_text(dot_product(a, b)), &
                    'give axis on the first body and across on the second, at 90 degrees in the reference configuration', error)
                return
            end if
            frame = reshape([a, b, cross(a, b)], [3, 3])
        else if (present(across)) then
            frame = frame_along(a, b)
        else
            frame = frame_along(a)
        end if
    end subroutine take_axes

    !> Add the rows of a joint.
    subroutine add_joint_rows(self, joint, drive, motion)
        class(builder_type), intent(inout) :: self
        type(placed_joint_type), intent(inout) :: joint
        !> Driven freedom; 0 if none.
        integer, intent(in) :: drive
        class(function_type), intent(in), optional :: motion
        character(len=1), parameter :: letter(3) = ['x', 'y', 'z']
        type(perpendicular_type) :: perpendicular
        integer :: k, l, m, n, driven, number, before
        logical :: turn(3)

        before = self%held%n
        n = merge(2, 3, self%planar)
        driven = drive
        number = 0
        if (present(motion)) call self%take_motion(joint%name, motion, 1, number)
        if (any(joint%at_velocity_level)) then
            call add_velocity_joints(self, joint, driven, number)
            ! Each freedom is driven at one level only.
            if (driven > 0) driven = merge(0, driven, joint%at_velocity_level(max(1, driven)))
        end if
        joint%driven = driven
        joint%motion = number
        if (all(joint%kind%held(:n))) then
            call keep_coincidence(self, point_vector_type(first=joint%first, second=joint%second, row=before + 1, s1=joint%s1, &
                s2=joint%s2))
            do k = 1, n
                call self%held%add(trim(joint%name)//' '//letter(min(k, n)), 'N')
            end do
        else
            do k = 1, n
                if (.not. joint%kind%held(k) .and. driven /= k) cycle
                call self%held%add(trim(joint%name)//merge(' motion', ' '//letter(k)//'     ', driven == k), 'N')
                perpendicular = perpendicular_type(first=joint%first, second=joint%second, row=self%held%n, is_point=.true., &
                    a=joint%axes1(:, k), b=joint%s2, c=dot_product(joint%axes1(:, k), joint%s1))
                ! A motion is measured from the reference configuration, in which the points may be apart along its axis.
                if (driven == k) perpendicular%c = reference_displacement(self, joint, k)
                if (driven == k) perpendicular%motion = number
                call keep_perpendicular(self, perpendicular)
            end do
        end if
        if (self%planar) then
            if (joint%kind%held(3) .or. driven == 3) then
                call self%held%add(trim(joint%name)//merge(' motion', ' angle ', driven == 3), 'N m')
                call keep_angle(self, angle_type(joint%first, joint%second, self%held%n, &
                    self%angle_of(joint%second) - self%angle_of(joint%first), merge(number, 0, driven == 3)))
            end if
        else
            turn = joint%kind%held(4:6)
            do k = 1, 3
                ! k, l, m are in cyclic order.
                l = mod(k, 3) + 1
                m = mod(l, 3) + 1
                if (count(turn) == 2 .and. .not. turn(k)) then
                    ! Axis k is common: l1.k2 = 0 fixes the rotation about m, m1.k2 = 0 that about l.
                    call add_direction(l, k, m)
                    call add_direction(m, k, l)
                end if
                if (driven == k + 3) then
                    call add_sum(self, trim(joint%name)//' motion', 'N m', [angle_in_space(joint, l, m)], [1.0_wp], number, .true.)
                else if (count(turn) /= 2 .and. turn(k)) then
                    call add_direction(l, m, k)
                end if
            end do
        end if
        joint%row = before + 1
        joint%n_rows = self%held%n - before

    contains

        !> a1.b2 = 0.
        subroutine add_direction(a, b, about)
            integer, intent(in) :: a, b, about

            call self%held%add(trim(joint%name)//' rotation '//letter(about), 'N m')
            call keep_perpendicular(self, perpendicular_type(first=joint%first, second=joint%second, row=self%held%n, &
                a=joint%axes1(:, a), b=joint%axes2(:, b)))
        end subroutine add_direction
    end subroutine add_joint_rows

    !> Add the rows of a joint at velocity level.
    subroutine add_velocity_joints(self, joint, driven, number)
        class(builder_type), intent(inout) :: self
        type(placed_joint_type), intent(in) :: joint
        !> Freedom that a function drives, and the index of the function.
        integer, intent(in) :: driven, number
        character(len=1), parameter :: letter(3) = ['x', 'y', 'z']
        type(velocity_joint_type) :: velocity_joint
        integer :: k, n

        n = merge(2, 3, self%planar)
        do k = 1, 6
            if (.not. joint%at_velocity_level(k)) cycle
            velocity_joint = velocity_joint_type(first=joint%first, second=joint%second)
            if (k <= n) then
                velocity_joint%is_displacement = .true.
                velocity_joint%axis = joint%axes2(:, k)
                velocity_joint%point = joint%s2
                velocity_joint%moment = cross(joint%s2, joint%axes2(:, k))
                call self%rolling%add(trim(joint%name)//' rate '//letter(min(k, n)), 'N')
            else
                velocity_joint%axis = [0.0_wp, 0.0_wp, 1.0_wp]
                if (.not. self%planar) velocity_joint%axis = joint%axes2(:, k - 3)
                velocity_joint%moment = velocity_joint%axis
                call self%rolling%add(trim(joint%name)//' spin '//letter(merge(3, k - 3, self%planar)), 'N m')
            end if
            if (driven == k) velocity_joint%motion = number
            velocity_joint%row = self%rolling%n
            self%n_of%velocity_joints = self%n_of%velocity_joints + 1
            if (self%n_of%velocity_joints > size(self%velocity_joints)) self%velocity_joints = [self%velocity_joints, &
                self%velocity_joints, velocity_joint]
            self%velocity_joints(self%n_of%velocity_joints) = velocity_joint
        end do
    end subroutine add_velocity_joints

    !> Angle in space from axis l of the first body to axis l of the second, positive towards axis m of the first.
    pure function angle_in_space(joint, l, m) result(angle)
        type(placed_joint_type), intent(in) :: joint
        integer, intent(in) :: l, m
        type(coordinate_type) :: angle

        angle%kind = is_angle
        angle%first = joint%first
        angle%second = joint%second
        angle%one = perpendicular_type(first=joint%first, second=joint%second, a=joint%axes1(:, l), b=joint%axes2(:, l))
        angle%other = perpendicular_type(first=joint%first, second=joint%second, a=joint%axes1(:, m), b=joint%axes2(:, l))
    end function angle_in_space
end submodule tandem_mechanism_builder_joints
