! SPDX-License-Identifier: MIT
!> What elements are given besides points: functions, laws, expressions, directions; and where they are drawn.
submodule(tandem_mechanism_drawing) tandem_mechanism_drawing_values
    use tandem_mechanism_formula, only: is_joint, is_joint_rate, is_place, is_spin, is_time, is_turn, is_turn_rate, is_velocity
    use tandem_mechanism_pose, only: pose_type
    use tandem_mechanism_refusal, only: refuse, take_vector
    use tandem_rigid_euler_parameters, only: rotation
    implicit none (type, external)

contains

    !> Keep a function of time, and give its number.
    module procedure take_motion
        type(motion_type), allocatable :: longer(:)
        integer :: i

        number = size(self%motions) + 1
        allocate (longer(number))
        do i = 1, number - 1
            call move_alloc(self%motions(i)%f, longer(i)%f)
            longer(i)%jump_order = self%motions(i)%jump_order
            longer(i)%name = self%motions(i)%name
        end do
        allocate (longer(number)%f, source=f)
        longer(number)%jump_order = jump_order
        longer(number)%name = name
        call move_alloc(longer, self%motions)
    end procedure take_motion

    !> Keep a law, and give its number.
    module procedure take_law
        type(law_item_type), allocatable :: longer(:)
        integer :: i

        number = size(self%laws) + 1
        allocate (longer(number))
        do i = 1, number - 1
            call move_alloc(self%laws(i)%law, longer(i)%law)
        end do
        allocate (longer(number)%law, source=law)
        call move_alloc(longer, self%laws)
    end procedure take_law

    !> Keep an expression of the state, and give its number.
    module procedure take_formula
        type(formula_type), allocatable :: longer(:)

        number = size(self%formulas) + 1
        allocate (longer(number))
        longer(:number - 1) = self%formulas
        call longer(number)%initialize(expression, self%list_variables())
        call move_alloc(longer, self%formulas)
    end procedure take_formula

    !> The variables that expressions of loads and of rows may name, in their order: t; of each body x, y, z (m), vx, vy, vz (m/s),
    !> in the plane angle (rad) and omega (rad/s), in space e0 to e3 and wx, wy, wz in the world's frame (rad/s), as `body.x`; of
    !> each joint that turns about or slides along an axis angle and rate, or way and speed, as `joint.angle`, counted from the
    !> drawing. Parse an expression with them after what it names was added, and add its element before another body or joint.
    module procedure variable_names
        type(variable_type), allocatable :: variables(:)

        allocate (variables, source=self%list_variables())
        names = variables%name
    end procedure variable_names

    !> What they are.
    module procedure list_variables
        character(len=*), parameter :: axis(3) = ['x', 'y', 'z'], number(4) = ['0', '1', '2', '3']
        integer :: i, k, n

        variables = [variable_type('t', is_time)]
        if (.not. allocated(self%bodies)) return
        n = merge(2, 3, self%planar)
        do i = 1, size(self%bodies)
            associate (name => trim(self%bodies(i)%name)//'.')
                variables = [variables, (variable_type(name//axis(k), is_place, i, k), k=1, n), &
                    (variable_type(name//'v'//axis(k), is_velocity, i, k), k=1, n)]
                if (.not. self%bodies(i)%turns) cycle
                if (self%planar) then
                    variables = [variables, variable_type(name//'angle', is_turn, i, 1), &
                        variable_type(name//'omega', is_turn_rate, i, 1)]
                else
                    variables = [variables, (variable_type(name//'e'//number(k), is_turn, i, k), k=1, 4), &
                        (variable_type(name//'w'//axis(k), is_spin, i, k), k=1, 3)]
                end if
            end associate
        end do
        do i = 1, size(self%joints)
            associate (name => trim(self%joints(i)%name)//'.', turn => self%joints(i)%turn, way => self%joints(i)%way)
                if (turn > 0) variables = [variables, variable_type(name//'angle', is_joint, turn, 1), &
                    variable_type(name//'rate', is_joint_rate, turn, 1)]
                if (way > 0) variables = [variables, variable_type(name//'way', is_joint, way, 1), &
                    variable_type(name//'speed', is_joint_rate, way, 1)]
            end associate
        end do
    end procedure list_variables

    !> The number of a joint's coordinate, by `joint`, `joint.angle` or `joint.way`.
    module procedure find_coordinate
        integer :: i, k, dot

        number = 0
        dot = index(text, '.')
        if (dot == 0) dot = len_trim(text) + 1
        k = 0
        do i = 1, size(self%joints)
            if (self%joints(i)%name == text(:dot - 1)) k = i
        end do
        if (k == 0) then
            call refuse(label//': there is no joint '//text(:dot - 1), 'add the joint before', error)
            return
        end if
        associate (turn => self%joints(k)%turn, way => self%joints(k)%way)
            if (text(dot:) == '.angle') then
                number = turn
            else if (text(dot:) == '.way') then
                number = way
            else if (dot > len_trim(text)) then
                number = merge(turn, way, turn > 0)
            end if
        end associate
        if (number == 0) call refuse(label//': the joint '//text(:dot - 1)//' has no axis to turn about or to slide along', &
            'take a joint that has one, and its .angle or .way', error)
    end procedure find_coordinate

    !> Where a body is in the drawing.
    module procedure frame_of
        type(pose_type) :: ground

        r = 0.0_wp
        a = ground%a(:, :, 0)
        if (body == 0) return
        associate (its => self%bodies(body))
            r = its%position
            if (self%planar) then
                a(1:2, 1) = [cos(its%angle), sin(its%angle)]
                a(1:2, 2) = [-sin(its%angle), cos(its%angle)]
            else
                a = rotation(its%p)
            end if
        end associate
    end procedure frame_of

    !> The angle of a body in the drawing.
    module procedure angle_of
        angle_of = 0.0_wp
        if (body > 0) angle_of = self%bodies(body)%angle
    end procedure angle_of

    !> A unit vector along what is given.
    module procedure take_direction
        call take_vector(self%planar, label, what, given, vector, error)
        if (allocated(error)) return
        if (.not. norm2(vector) > 0.0_wp) then
            call refuse(label//': '//what//' is zero', 'give a direction', error)
        else
            vector = vector/norm2(vector)
        end if
    end procedure take_direction

    !> Refuse the ground and point masses.
    module procedure need_turning_body
        logical :: turns

        turns = .false.
        if (body > 0) turns = self%bodies(body)%turns
        if (.not. turns) call refuse(label//' is on the ground or on a point mass', 'name a body with an inertia', error)
    end procedure need_turning_body
end submodule tandem_mechanism_drawing_values
