! SPDX-License-Identifier: MIT
!> Builder procedures for springs and torsions.
submodule(tandem_mechanism_builder) tandem_mechanism_builder_forces
    use tandem_mechanism_coordinate, only: is_angle
    use tandem_mechanism_normal_force, only: normal_force_type
    use tandem_mechanism_refusal, only: refuse
    use tandem_mechanism_sensor, only: of_joint, of_spring, of_torsion
    use, intrinsic :: ieee_arithmetic, only: ieee_is_finite
    implicit none (type, external)

contains

    module procedure add_spring
        type(spring_type) :: spring
        character(len=:), allocatable :: label
        logical :: points(2)

        label = 'spring '//trim(name)
        call self%check_name(name, label, error)
        if (allocated(error)) return
        call self%take_pair(label, first, second, spring%vector, points, error)
        if (allocated(error)) return
        spring%length = self%reference_length(spring%vector)
        if (.not. spring%length > 0.0_wp) then
            call refuse(label//' has length zero in the reference configuration, hence no direction', 'move one of its ends', error)
            return
        end if
        if (present(stiffness)) spring%stiffness = stiffness
        if (present(damping)) spring%damping = damping
        if (present(length)) spring%length = length
        if (present(motion)) call self%take_motion(name, motion, -1, spring%motion)
        if (present(law)) call self%take_law(law, spring%law)
        self%n_of%springs = self%n_of%springs + 1
        if (self%n_of%springs > size(self%springs)) self%springs = [self%springs, self%springs, spring]
        self%springs(self%n_of%springs) = spring
        call self%keep_name(name, of_spring, self%n_of%springs)
    end procedure add_spring

    module procedure add_torsion
        type(torsion_type) :: torsion
        character(len=:), allocatable :: label
        integer :: k, type_of, number

        label = 'torsion '//trim(name)
        call self%check_name(name, label, error)
        if (allocated(error)) return
        call self%find_coordinate(label, joint, k, error)
        if (allocated(error)) return
        torsion%coordinate = self%at%coordinates(k)
        call self%find_element(joint(:index(joint//'.', '.') - 1), type_of, number)
        if (type_of == of_joint) torsion%joint = number
        if (present(angle)) torsion%angle = angle
        if (present(stiffness)) torsion%stiffness = stiffness
        if (present(damping)) torsion%damping = damping
        if (present(motion)) call self%take_motion(name, motion, -1, torsion%motion)
        if (present(law)) call self%take_law(law, torsion%law)
        self%n_of%torsions = self%n_of%torsions + 1
        if (self%n_of%torsions > size(self%torsions)) self%torsions = [self%torsions, self%torsions, torsion]
        self%torsions(self%n_of%torsions) = torsion
        call self%keep_name(name, of_torsion, self%n_of%torsions)
    end procedure add_torsion

    module procedure add_friction
        type(friction_law_type) :: full
        type(normal_force_type) :: reaction
        character(len=:), allocatable :: label
        integer :: k
        logical :: turns

        label = 'friction '//trim(name)
        call self%check_name(name, label, error)
        if (allocated(error)) return
        call self%find_coordinate(label, joint, k, error)
        if (allocated(error)) return
        full = law
        full%normal = 1.0_wp
        if (abs(full%static) <= 0.0_wp) full%static = law%dynamic
        if (.not. (law%dynamic >= 0.0_wp .and. full%static >= law%dynamic .and. law%speed > 0.0_wp .and. &
            all(ieee_is_finite([full%static, law%speed])))) then
            call refuse(label//' has invalid coefficients or an invalid speed', &
                'use 0 <= dynamic <= static and a transition speed > 0', error)
            return
        end if
        turns = self%at%coordinates(k)%kind == is_angle
        if (present(normal)) then
            if (present(radius) .or. present(arm)) then
                call refuse(label//' has both a normal force and a radius or an arm', &
                    'radius and arm belong to friction on the reaction: remove them or the normal force', error)
                return
            end if
            full%normal = normal
        else
            if (turns .neqv. present(radius)) then
                call refuse(label//' '//trim(merge('rotates and has no radius', 'slides and has a radius  ', turns)), &
                    'a rotation requires the radius of the sliding surface, a translation has none', error)
                return
            end if
            if (present(radius)) full%normal = radius
            if (present(arm)) then
                if (.not. (arm > 0.0_wp .and. ieee_is_finite(arm))) then
                    call refuse(label//' has an arm that is not positive', 'give a positive arm in metres, or none', error)
                    return
                end if
            end if
            if (self%at%coordinates(k)%second >= 0) call find_normal_force(self, joint, reaction, arm)
            if (reaction%n == 0) then
                call refuse(label//': the reaction of the joint has no normal component', 'give a normal force', error)
                return
            end if
        end if
        if (.not. (full%normal >= 0.0_wp .and. ieee_is_finite(full%normal))) then
            call refuse(label//' has an invalid normal force or radius', 'use a value >= 0', error)
            return
        end if
        ! Events may change the damping of a torsion.
        full%viscous = 0.0_wp
        call self%add_torsion(name, joint, error, damping=law%viscous, law=full)
        if (.not. allocated(error)) self%torsions(self%n_of%torsions)%reaction = reaction
    end procedure add_friction

    !> Collect the rows of a joint that contribute to the normal force: all but the row of its motion.
    subroutine find_normal_force(self, joint, reaction, arm)
        class(builder_type), intent(in) :: self
        character(len=*), intent(in) :: joint
        type(normal_force_type), intent(inout) :: reaction
        real(wp), intent(in), optional :: arm
        character(len=len(joint)) :: head
        integer :: i

        head = joint
        if (index(joint, '.') > 0) head = joint(:index(joint, '.') - 1)
        i = self%held%first(head)
        do while (i > 0)
            call take(i, self%held%name(i), self%held%unit(i))
            i = self%held%next(i)
        end do
        i = self%rolling%first(head)
        do while (i > 0)
            ! Rows at velocity level are negative until the mechanism is defined.
            call take(-i, self%rolling%name(i), self%rolling%unit(i))
            i = self%rolling%next(i)
        end do

    contains

        subroutine take(row, name, unit)
            integer, intent(in) :: row
            character(len=*), intent(in) :: name, unit
            real(wp) :: weight

            if (name == trim(head)//' motion') return
            weight = 0.0_wp
            if (unit == 'N') weight = 1.0_wp
            if (unit == 'N m' .and. present(arm)) weight = 1/arm
            if (.not. weight > 0.0_wp) return
            reaction%n = reaction%n + 1
            reaction%rows(reaction%n) = row
            reaction%weights(reaction%n) = weight
        end subroutine take
    end subroutine find_normal_force
end submodule tandem_mechanism_builder_forces
