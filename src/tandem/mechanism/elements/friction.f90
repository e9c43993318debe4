! SPDX-License-Identifier: MIT
!> Friction along the coordinate of a joint: a torsion with a friction law, whose normal force is given or follows from the reaction
!> of the joint. The list of torsions contains its elements; this kind has only keys.
module tandem_mechanism_elements_friction
    use tandem_error, only: error_type
    use tandem_kinds, only: wp
    use tandem_mechanism_builder, only: builder_type
    use tandem_mechanism_element_kind, only: element_kind_type, word_length
    use tandem_mechanism_key_reader, only: not_negative, positive, reader_type
    use tandem_mechanism_law, only: friction_law_type
    use tandem_model, only: model_type
    implicit none (type, external)
    private

    public :: friction_kind_type

    !> The word and the keys of friction.
    type, extends(element_kind_type) :: friction_kind_type
    contains
        procedure, nopass :: label, read => read_friction
    end type friction_kind_type

contains

    pure function label()
        character(len=word_length) :: label

        label = 'friction'
    end function label

    subroutine read_friction(reader, mechanism, n_points)
        type(reader_type), intent(inout) :: reader
        class(model_type), intent(inout) :: mechanism
        integer, intent(inout) :: n_points
        character(len=:), allocatable :: name, joint
        real(wp), allocatable :: normal, static, dynamic, speed, viscous, radius, arm
        type(error_type), allocatable :: error

        name = reader%name
        call reader%get('joint', joint, 'that rotates or slides; "joint.angle" or "joint.displacement" if it does both', &
            required=.true.)
        call reader%get_number('normal', normal, not_negative, 'N, N m', &
            'prescribed normal force; for a rotation times the radius. Default: the reaction of the joint')
        call reader%get_number('radius', radius, positive, 'm', 'radius of the sliding surface, with the reaction')
        call reader%get_number('arm', arm, positive, 'm', &
            'lever arm of torques, with the reaction; default: torques do not contribute')
        call reader%get_number('dynamic', dynamic, not_negative, '', 'coefficient of sliding friction', required=.true.)
        call reader%get_number('static', static, not_negative, '', 'largest coefficient, at the transition speed')
        call reader%get_number('speed', speed, positive, 'm/s, rad/s', 'transition speed', required=.true.)
        viscous = 0.0_wp
        call reader%get_number('viscous', viscous, not_negative, 'N s/m, N m s', 'additional viscous damping')
        call reader%close_table()
        if (reader%failed()) return
        if (.not. allocated(static)) static = dynamic
        if (static < dynamic) then
            call reader%fail('static', 'is smaller than the coefficient of sliding friction', 'increase it or remove it')
            return
        end if
        select type (mechanism)
        class is (builder_type)
            call mechanism%add_friction(name, joint, error, friction_law_type(dynamic=dynamic, speed=speed, static=static, &
                viscous=viscous), normal, radius, arm)
        end select
        call reader%blame(error)
    end subroutine read_friction
end module tandem_mechanism_elements_friction

!> Builder procedure for friction.
submodule(tandem_mechanism_builder) tandem_mechanism_elements_friction_builder
    use tandem_mechanism_coordinate, only: is_angle
    use tandem_mechanism_elements_torsion, only: torsion_kind_type
    use tandem_mechanism_normal_force, only: normal_force_type
    use tandem_mechanism_refusal, only: refuse
    use, intrinsic :: ieee_arithmetic, only: ieee_is_finite
    implicit none (type, external)

contains

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
        if (allocated(error)) return
        k = self%kind_number('torsion')
        select type (torsions => self%kinds(k)%of)
        type is (torsion_kind_type)
            call torsions%set_reaction(reaction)
        end select
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
end submodule tandem_mechanism_elements_friction_builder
