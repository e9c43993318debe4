! SPDX-License-Identifier: MIT
!> The words for springs and loads.
submodule(tandem_mechanism_drawing) tandem_mechanism_drawing_forces
    implicit none (type, external)

contains

    !> A spring and damper along the way between two points.
    module procedure add_spring
        type(spring_type) :: spring
        character(len=:), allocatable :: label
        logical :: points(2)

        label = 'spring '//trim(name)
        call self%check_name(name, label, error)
        if (allocated(error)) return
        associate (span => spring%span)
            call self%take_pair(label, first, second, span%first, span%second, span%s1, span%s2, points, error)
        end associate
        if (allocated(error)) return
        spring%length = self%drawn_length(spring%span)
        if (.not. spring%length > 0.0_wp) then
            call refuse(label//' has no length in the drawing, and no direction', 'move one of its ends', error)
            return
        end if
        if (present(stiffness)) spring%stiffness = stiffness
        if (present(damping)) spring%damping = damping
        if (present(length)) spring%length = length
        if (present(motion)) call self%take_motion(name, motion, -1, spring%motion)
        if (present(law)) call self%take_law(law, spring%law)
        self%springs = [self%springs, spring]
        call self%keep_name(name, of_spring, size(self%springs))
    end procedure add_spring

    !> A spring and damper along the coordinate of a joint, such as the angle about its axis.
    module procedure add_torsion
        type(torsion_type) :: torsion
        character(len=:), allocatable :: label
        integer :: k

        label = 'torsion '//trim(name)
        call self%check_name(name, label, error)
        if (allocated(error)) return
        call self%find_coordinate(label, joint, k, error)
        if (allocated(error)) return
        torsion%coordinate = self%coordinates(k)
        if (present(angle)) torsion%angle = angle
        if (present(stiffness)) torsion%stiffness = stiffness
        if (present(damping)) torsion%damping = damping
        if (present(motion)) call self%take_motion(name, motion, -1, torsion%motion)
        if (present(law)) call self%take_law(law, torsion%law)
        self%torsions = [self%torsions, torsion]
        call self%keep_name(name, of_torsion, size(self%torsions))
    end procedure add_torsion

    !> Forces and torques that hold two frames together, which are one in the drawing.
    module procedure add_bushing
        type(bushing_type) :: bushing
        type(joint_type) :: joint
        character(len=:), allocatable :: label
        integer :: k, l, m

        label = 'bushing '//trim(name)
        call self%check_name(name, label, error)
        if (allocated(error)) return
        ! A place like that of a joint, none of whose rows come.
        joint%kind = find_kind('fixed', self%planar)
        call self%place_joint(label, joint, first, second, error, at, axis, across, .false.)
        if (.not. allocated(error) .and. present(stiffness)) call take_matrix('stiffness', stiffness, bushing%stiffness)
        if (.not. allocated(error) .and. present(damping)) call take_matrix('damping', damping, bushing%damping)
        if (allocated(error)) return
        bushing%n = merge(3, 6, self%planar)
        bushing%coordinates%first = joint%first
        bushing%coordinates%second = joint%second
        do k = 1, merge(2, 3, self%planar)
            associate (way => bushing%coordinates(k))
                way%kind = is_way
                way%one = dot_type(first=joint%first, second=joint%second, is_point=.true., a=joint%axes1(:, k), b=joint%s2)
                way%offset = dot_product(joint%axes1(:, k), joint%s1)
            end associate
        end do
        if (self%planar) then
            bushing%coordinates(3)%kind = is_angle
            bushing%coordinates(3)%offset = self%angle_of(joint%second) - self%angle_of(joint%first)
        else
            do k = 1, 3
                l = mod(k, 3) + 1
                m = mod(l, 3) + 1
                associate (turn => bushing%coordinates(3 + k))
                    ! About k: m1.l2 = sin, l1.m2 = -sin.
                    turn%kind = is_tilt
                    turn%one = dot_type(first=joint%first, second=joint%second, a=joint%axes1(:, m), b=joint%axes2(:, l))
                    turn%other = dot_type(first=joint%first, second=joint%second, a=joint%axes1(:, l), b=joint%axes2(:, m))
                end associate
            end do
        end if
        self%bushings = [self%bushings, bushing]
        call self%keep_name(name, of_bushing, size(self%bushings))

    contains

        !> A diagonal, or a symmetric matrix.
        subroutine take_matrix(what, given, matrix)
            character(len=*), intent(in) :: what
            real(wp), intent(in) :: given(:)
            real(wp), intent(inout) :: matrix(6, 6)
            integer :: n, i

            n = merge(3, 6, self%planar)
            if (all(size(given) /= [n, n*n]) .or. .not. all(ieee_is_finite(given))) then
                call refuse(label//': '//what//' has '//to_text(size(given))//' entries, or one that is not finite', &
                    'give '//to_text(n)//', or a symmetric matrix of '//to_text(n*n), error)
            else if (size(given) == n) then
                do i = 1, n
                    matrix(i, i) = given(i)
                end do
            else
                matrix(:n, :n) = reshape(given, [n, n])
                if (any(abs(matrix - transpose(matrix)) > tolerance*maxval(abs(matrix)))) call refuse(label//': '//what// &
                    ' is not symmetric', 'make entries i, j and j, i equal', error)
            end if
        end subroutine take_matrix
    end procedure add_bushing

    !> A force at a point of a body, and a torque on it.
    module procedure add_load
        type(load_type) :: load
        character(len=:), allocatable :: label
        integer :: k
        logical :: is_point

        label = 'load '//trim(name)
        call self%check_name(name, label, error)
        if (allocated(error)) return
        call self%take_point(label, on, load%body, load%point, is_point, error)
        if (allocated(error)) return
        if (load%body == 0) then
            call refuse(label//' acts on the ground', 'name a body', error)
            return
        end if
        if (present(force)) call take_vector(self%planar, label, 'force', force, load%force, error)
        if (allocated(error)) return
        if (present(torque)) then
            if (size(torque) /= merge(1, 3, self%planar) .or. .not. all(ieee_is_finite(torque))) then
                call refuse(label//': torque has '//to_text(size(torque))//' entries, or one that is not finite', &
                    'give one in the plane, three in space', error)
                return
            end if
            if (.not. self%bodies(load%body)%turns) then
                call refuse(label//' turns the point mass '//trim(self%bodies(load%body)%name), 'give the body an inertia', error)
                return
            end if
            if (self%planar) then
                load%torque(3) = torque(1)
            else
                load%torque = torque
            end if
        end if
        if (present(in_body)) load%in_body = in_body
        if (present(force_by)) then
            if (size(force_by) /= merge(2, 3, self%planar)) call refuse(label//': force has '//to_text(size(force_by))// &
                ' expressions', 'give two in the plane, three in space', error)
        end if
        if (present(torque_by) .and. .not. allocated(error)) then
            if (size(torque_by) /= merge(1, 3, self%planar) .or. .not. self%bodies(load%body)%turns) then
                call refuse(label//': torque has '//to_text(size(torque_by))//' expressions, or turns a point mass', &
                    'give one in the plane, three in space, on a body with an inertia', error)
            end if
        end if
        if (allocated(error)) return
        if (present(force_by)) then
            do k = 1, size(force_by)
                call self%take_formula(force_by(k), load%formula(k))
            end do
        end if
        if (present(torque_by)) then
            do k = 1, size(torque_by)
                call self%take_formula(torque_by(k), load%formula(6 - size(torque_by) + k))
            end do
        end if
        if (present(motion)) call self%take_motion(name, motion, -1, load%motion)
        self%loads = [self%loads, load]
        call self%keep_name(name, of_load, size(self%loads))
    end procedure add_load
end submodule tandem_mechanism_drawing_forces
