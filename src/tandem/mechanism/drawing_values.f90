! SPDX-License-Identifier: MIT
!> What elements are given besides points: functions, laws, expressions, directions; and where they are drawn.
submodule(tandem_mechanism_drawing) tandem_mechanism_drawing_values
    use tandem_mechanism_formula, only: is_joint, is_joint_rate, is_place, is_spin, is_time, is_turn, is_turn_rate, is_velocity
    use tandem_mechanism_pose, only: pose_type
    use tandem_mechanism_refusal, only: refuse, take_vector
    use tandem_mechanism_sensor, only: of_joint, of_massless_wheel
    use tandem_rigid_euler_parameters, only: rotation
    implicit none (type, external)

contains

    module procedure take_motion
        number = self%n_of%motions + 1
        if (number > size(self%motions)) call resize_motions(self, 2*number)
        self%n_of%motions = number
        allocate (self%motions(number)%f, source=f)
        self%motions(number)%jump_order = jump_order
        self%motions(number)%name = name
        call self%motion_index%put(name, number)
    end procedure take_motion

    !> Room for so many functions of time.
    subroutine resize_motions(self, room)
        class(drawing_type), intent(inout) :: self
        integer, intent(in) :: room
        type(motion_type), allocatable :: others(:)
        integer :: i

        allocate (others(room))
        do i = 1, self%n_of%motions
            call move_alloc(self%motions(i)%f, others(i)%f)
            others(i)%jump_order = self%motions(i)%jump_order
            others(i)%name = self%motions(i)%name
        end do
        call move_alloc(others, self%motions)
    end subroutine resize_motions

    module procedure take_law
        number = self%n_of%laws + 1
        if (number > size(self%laws)) call resize_laws(self, 2*number)
        self%n_of%laws = number
        allocate (self%laws(number)%law, source=law)
    end procedure take_law

    !> Room for so many laws.
    subroutine resize_laws(self, room)
        class(drawing_type), intent(inout) :: self
        integer, intent(in) :: room
        type(law_item_type), allocatable :: others(:)
        integer :: i

        allocate (others(room))
        do i = 1, self%n_of%laws
            call move_alloc(self%laws(i)%law, others(i)%law)
        end do
        call move_alloc(others, self%laws)
    end subroutine resize_laws

    module procedure take_formula
        number = self%n_of%formulas + 1
        if (number > size(self%formulas)) call resize_formulas(self, 2*number)
        self%n_of%formulas = number
        call self%formulas(number)%initialize(expression, self%list_variables())
    end procedure take_formula

    !> Room for so many expressions of the state.
    subroutine resize_formulas(self, room)
        class(drawing_type), intent(inout) :: self
        integer, intent(in) :: room
        type(formula_type), allocatable :: others(:)

        allocate (others(room))
        others(:self%n_of%formulas) = self%formulas(:self%n_of%formulas)
        call move_alloc(others, self%formulas)
    end subroutine resize_formulas

    module procedure fit
        associate (n => self%n_of)
            self%bodies = self%bodies(:n%bodies)
            self%points = self%points(:n%points)
            self%joints = self%joints(:n%joints)
            self%dots = self%dots(:n%dots)
            self%meetings = self%meetings(:n%meetings)
            self%distances = self%distances(:n%distances)
            self%angles = self%angles(:n%angles)
            self%springs = self%springs(:n%springs)
            self%torsions = self%torsions(:n%torsions)
            self%bushings = self%bushings(:n%bushings)
            self%loads = self%loads(:n%loads)
            self%coordinates = self%coordinates(:n%coordinates)
            self%couplings = self%couplings(:n%couplings)
            self%glides = self%glides(:n%glides)
            self%edges = self%edges(:n%edges)
            self%rollers = self%rollers(:n%rollers)
            self%massless_wheels = self%massless_wheels(:n%massless_wheels)
            self%sensors = self%sensors(:n%sensors)
            call resize_motions(self, n%motions)
            call resize_laws(self, n%laws)
            call resize_formulas(self, n%formulas)
        end associate
    end procedure fit

    module procedure variable_names
        type(variable_type), allocatable :: variables(:)

        allocate (variables, source=self%list_variables())
        names = variables%name
    end procedure variable_names

    module procedure list_variables
        character(len=*), parameter :: axis(3) = ['x', 'y', 'z'], number(4) = ['0', '1', '2', '3']
        integer :: i, k, m, n

        ! At most so many of a body and of a joint.
        allocate (variables(1 + 13*self%n_of%bodies + 4*self%n_of%joints + 2*self%n_of%slides))
        m = 0
        call add('t', is_time, 0, 0)
        n = merge(2, 3, self%planar)
        do i = 1, self%n_of%bodies
            associate (name => trim(self%bodies(i)%name)//'.')
                do k = 1, n
                    call add(name//axis(k), is_place, i, k)
                end do
                do k = 1, n
                    call add(name//'v'//axis(k), is_velocity, i, k)
                end do
                if (.not. self%bodies(i)%turns) cycle
                if (self%planar) then
                    call add(name//'angle', is_turn, i, 1)
                    call add(name//'omega', is_turn_rate, i, 1)
                    cycle
                end if
                do k = 1, 4
                    call add(name//'e'//number(k), is_turn, i, k)
                end do
                do k = 1, 3
                    call add(name//'w'//axis(k), is_spin, i, k)
                end do
            end associate
        end do
        do i = 1, self%n_of%joints
            associate (name => trim(self%joints(i)%name)//'.', turn => self%joints(i)%turn, way => self%joints(i)%way)
                if (turn > 0) then
                    call add(name//'angle', is_joint, turn, 1)
                    call add(name//'rate', is_joint_rate, turn, 1)
                end if
                if (way > 0) call add_way(name, way)
            end associate
        end do
        do i = 1, self%n_names
            if (self%types(i) /= of_massless_wheel) cycle
            associate (way => self%massless_wheels(self%numbers(i))%way)
                if (way > 0) call add_way(trim(self%names(i))//'.', way)
            end associate
        end do
        variables = variables(:m)

    contains

        subroutine add_way(name, way)
            character(len=*), intent(in) :: name
            integer, intent(in) :: way

            call add(name//'way', is_joint, way, 1)
            call add(name//'speed', is_joint_rate, way, 1)
        end subroutine add_way

        subroutine add(name, kind, of, place)
            character(len=*), intent(in) :: name
            integer, intent(in) :: kind, of, place

            m = m + 1
            variables(m) = variable_type(name, kind, of, place)
        end subroutine add
    end procedure list_variables

    module procedure find_coordinate
        integer :: k, dot, type_of, turn, way

        number = 0
        dot = index(text, '.')
        if (dot == 0) dot = len_trim(text) + 1
        call self%find_element(text(:dot - 1), type_of, k)
        if (type_of == of_joint) then
            turn = self%joints(k)%turn
            way = self%joints(k)%way
        else if (type_of == of_massless_wheel) then
            turn = 0
            way = self%massless_wheels(k)%way
        else
            call refuse(label//': there is no joint '//text(:dot - 1), 'add the joint before', error)
            return
        end if
        if (text(dot:) == '.angle') then
            number = turn
        else if (text(dot:) == '.way') then
            number = way
        else if (dot > len_trim(text)) then
            number = merge(turn, way, turn > 0)
        end if
        if (number == 0) call refuse(label//': '//merge('the joint', 'the wheel', type_of == of_joint)//' '//text(:dot - 1)// &
            ' has no axis to turn about or to slide along', 'take a joint that has one, and its .angle or .way', error)
    end procedure find_coordinate

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

    module procedure angle_of
        angle_of = 0.0_wp
        if (body > 0) angle_of = self%bodies(body)%angle
    end procedure angle_of

    module procedure take_direction
        call take_vector(self%planar, label, what, given, vector, error)
        if (allocated(error)) return
        if (.not. norm2(vector) > 0.0_wp) then
            call refuse(label//': '//what//' is zero', 'give a direction', error)
        else
            vector = vector/norm2(vector)
        end if
    end procedure take_direction

    module procedure need_turning_body
        logical :: turns

        turns = .false.
        if (body > 0) turns = self%bodies(body)%turns
        if (.not. turns) call refuse(label//' is on the ground or on a point mass', 'name a body with an inertia', error)
    end procedure need_turning_body
end submodule tandem_mechanism_drawing_values
