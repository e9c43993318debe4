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
        if (present(motion)) call self%take_motion(motion, spring%motion)
        self%springs = [self%springs, spring]
        call self%keep_name(name)
    end procedure add_spring

    !> A torsional spring and damper about the axis of a revolute or cylindrical joint.
    module procedure add_torsion
        type(torsion_type) :: torsion
        character(len=:), allocatable :: label
        integer :: i, k

        label = 'torsion '//trim(name)
        call self%check_name(name, label, error)
        if (allocated(error)) return
        k = 0
        do i = 1, size(self%joints)
            if (self%joints(i)%name == joint) k = i
        end do
        if (k == 0) then
            call refuse(label//': there is no joint '//trim(joint), 'add the joint before', error)
            return
        end if
        associate (its => self%joints(k))
            if (all(its%kind%name /= [character(len=16) :: 'revolute', 'cylindrical'])) then
                call refuse(label//': the joint '//trim(joint)//' has no axis to turn about', &
                    'take a revolute or cylindrical joint', error)
                return
            end if
            torsion%cosine = dot_type(first=its%first, second=its%second, a=its%axes1(:, 1), b=its%axes2(:, 1))
            torsion%sine = dot_type(first=its%first, second=its%second, a=its%axes1(:, 2), b=its%axes2(:, 1))
            if (present(angle)) torsion%angle = angle
            if (self%planar) torsion%angle = torsion%angle + self%angle_of(its%second) - self%angle_of(its%first)
        end associate
        if (present(stiffness)) torsion%stiffness = stiffness
        if (present(damping)) torsion%damping = damping
        if (present(motion)) call self%take_motion(motion, torsion%motion)
        self%torsions = [self%torsions, torsion]
        call self%keep_name(name)
    end procedure add_torsion

    !> A force at a point of a body, and a torque on it.
    module procedure add_load
        type(load_type) :: load
        character(len=:), allocatable :: label
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
        if (present(motion)) call self%take_motion(motion, load%motion)
        self%loads = [self%loads, load]
        call self%keep_name(name)
    end procedure add_load
end submodule tandem_mechanism_drawing_forces
