! SPDX-License-Identifier: MIT
!> Definition of a mechanism: the lists of its elements, their names and rows, and common procedures of the builder for functions,
!> laws, expressions, directions, and positions of bodies in the reference configuration.
module tandem_mechanism_definition
    use tandem_error, only: error_type
    use tandem_kinds, only: wp
    use tandem_mechanism_body, only: body_type, point_type
    use tandem_mechanism_context, only: context_type
    use tandem_mechanism_coordinate, only: coordinate_type, slide_coordinate
    use tandem_mechanism_perpendicular, only: perpendicular_type
    use tandem_mechanism_element_kind, only: kind_item_type, word_length
    use tandem_mechanism_expression, only: expression_type
    use tandem_mechanism_formula, only: formula_type, is_joint, is_joint_rate, is_place, is_spin, is_time, is_turn, is_turn_rate, &
        is_velocity, variable_name_length, variable_type
    use tandem_mechanism_function, only: function_type
    use tandem_mechanism_velocity_joint, only: velocity_joint_type
    use tandem_mechanism_joint, only: joint_type, name_length
    use tandem_mechanism_law, only: law_item_type, law_type
    use tandem_mechanism_massless_wheel, only: massless_wheel_type
    use tandem_mechanism_pose, only: pose_type
    use tandem_mechanism_rate_row, only: rate_row_type
    use tandem_mechanism_refusal, only: refuse, take_vector
    use tandem_mechanism_rolling, only: knife_edge_type, roller_type
    use tandem_mechanism_row_list, only: row_list_type
    use tandem_mechanism_sensor, only: of_joint, of_kind, of_massless_wheel, sensor_type
    use tandem_mechanism_point_vector, only: point_vector_type
    use tandem_model, only: model_type, quantity_type
    use tandem_name_index, only: name_index_type
    use tandem_rigid_euler_parameters, only: rotation
    implicit none (type, external)
    private

    public :: definition_type, motion_type, angle_type, slide_type

    !> A function of time, and its derivative whose jump makes qd jump: 1 for a row at position level, 0 for the coefficients of a
    !> row at velocity level, -1 for a force. A lower derivative must not jump.
    type :: motion_type
        class(function_type), allocatable :: f
        integer :: jump_order = -1
        !> Name of the element, for messages.
        character(len=name_length) :: name = ''
    end type motion_type

    !> A constrained angle in the plane: angle2 - angle1 = offset + f(t).
    type :: angle_type
        integer :: first = 0, second = 0, row = 0
        real(wp) :: offset = 0.0_wp
        integer :: motion = 0
    end type angle_type

    !> A coordinate that an element has of its own, behind those of the bodies: the displacement of a massless wheel, or the sum or
    !> the slack of a coupling.
    type :: slide_type
        !> Name of the element; unit; true if no element may name the coordinate.
        character(len=name_length) :: name = ''
        character(len=3) :: unit = ''
        logical :: is_slack = .false.
        !> Inertia (kg or kg m^2).
        real(wp) :: inertia = 0.0_wp
    end type slide_type

    !> Number of elements of each type.
    type :: numbers_type
        integer :: bodies = 0, points = 0, joints = 0, motions = 0, perpendiculars = 0, coincidences = 0, distances = 0, &
            angles = 0, laws = 0, formulas = 0, coordinates = 0, velocity_joints = 0, knife_edges = 0, &
            rollers = 0, massless_wheels = 0, slides = 0, sensors = 0
    end type numbers_type

    !> Indices by name: of all elements; of points (`body.point`); of sensors; of the first function of time of an element.
    type :: indices_type
        type(name_index_type) :: names, points, sensors, motions
    end type indices_type

    !> All elements. `planar` and `gravity` must be set before the first element is added.
    type, extends(model_type) :: definition_type
        !> True if bodies move in the plane (x, y, angle).
        logical :: planar = .false.
        !> Acceleration due to gravity (m/s^2).
        real(wp) :: gravity(3) = 0.0_wp
        !> Start and end of the run (s): functions of time are compared with the reference configuration at the start, and their
        !> kinks within the run become breakpoints. Needed only if a run does not start at 0, or functions have kinks.
        real(wp) :: times(2) = 0.0_wp
        !> Numbers of elements. During the definition lists have spare room, so that adding an element does not copy them each time.
        type(numbers_type) :: n_of
        type(body_type), allocatable :: bodies(:)
        type(point_type), allocatable :: points(:)
        type(joint_type), allocatable :: joints(:)
        type(motion_type), allocatable :: motions(:)
        !> Elements by type.
        type(perpendicular_type), allocatable :: perpendiculars(:)
        type(point_vector_type), allocatable :: coincidences(:), distances(:)
        type(angle_type), allocatable :: angles(:)
        !> Kinds of elements, each with its elements.
        type(kind_item_type), allocatable :: kinds(:)
        !> Point of the last evaluation, and objects that elements share: laws, expressions of the state, coordinates of joints.
        type(context_type) :: at
        type(slide_type), allocatable :: slides(:)
        type(velocity_joint_type), allocatable :: velocity_joints(:)
        type(rate_row_type), allocatable :: rate_rows(:)
        type(knife_edge_type), allocatable :: knife_edges(:)
        type(roller_type), allocatable :: rollers(:)
        type(massless_wheel_type), allocatable :: massless_wheels(:)
        type(sensor_type), allocatable :: sensors(:)
        !> Rows so far: at position level without those of Euler parameters, and at velocity level.
        type(row_list_type) :: held, rolling
        type(indices_type) :: index_of
        !> Type of each element, such as `of_joint`, 0 for a body, and its index in the list of its type.
        integer, allocatable :: types(:), numbers(:)
        !> Times up to which kinks of each function of time, law and formula have been searched, in this order; kinks after
        !> `breakpoints_until`, unsorted, and true for each at which qd jumps.
        real(wp), allocatable :: searched(:), ahead(:)
        logical, allocatable :: jumps_ahead(:)
    contains
        procedure :: clear, fit, find_body, find_element, kind_number, list_words
        procedure :: keep_name, keep_coordinate, variable_names, list_variables
        procedure :: take_motion, take_law, take_formula, take_slide, take_direction
        procedure :: need_turning_body, find_coordinate, frame_of, angle_of, reference_length
        procedure :: begin_breakpoints, know_breakpoints, hold_pieces, pieces_hide
    end type definition_type

    interface
        !> Index of the coordinate of a joint or of a sliding wheel, from `joint`, `joint.angle` or `joint.displacement`.
        module subroutine find_coordinate(self, label, text, number, error)
            implicit none (type, external)
            class(definition_type), intent(in) :: self
            character(len=*), intent(in) :: label, text
            integer, intent(out) :: number
            type(error_type), allocatable, intent(inout) :: error
        end subroutine find_coordinate

        !> List all kinds of elements, without elements.
        pure module subroutine list_kinds(kinds)
            implicit none (type, external)
            type(kind_item_type), allocatable, intent(inout) :: kinds(:)
        end subroutine list_kinds

        !> Find the first kinks of functions of time. Steps end at kinks; qd jumps at a kink in the rate of a motion.
        module subroutine begin_breakpoints(self, error)
            implicit none (type, external)
            class(definition_type), intent(inout) :: self
            type(error_type), allocatable, intent(out) :: error
        end subroutine begin_breakpoints

        !> Search for kinks until a number of them is known.
        module subroutine know_breakpoints(self, number, error)
            implicit none (type, external)
            class(definition_type), intent(inout) :: self
            integer, intent(in) :: number
            type(error_type), allocatable, intent(out) :: error
        end subroutine know_breakpoints

        !> Set the smooth pieces of all functions to the current segment.
        pure module subroutine hold_pieces(self)
            implicit none (type, external)
            class(definition_type), intent(inout) :: self
        end subroutine hold_pieces

        !> True if the current pieces have values between two times that a step does not sample.
        module function pieces_hide(self, from, to, between)
            implicit none (type, external)
            class(definition_type), intent(inout) :: self
            real(wp), intent(in) :: from, to
            !> True if the step evaluates at times between its ends.
            logical, intent(in) :: between
            logical :: pieces_hide
        end function pieces_hide
    end interface

contains

    !> Remove all elements.
    pure subroutine clear(self)
        class(definition_type), intent(inout) :: self

        self%bodies = [body_type ::]
        self%points = [point_type ::]
        self%joints = [joint_type ::]
        if (allocated(self%motions)) deallocate (self%motions)
        allocate (self%motions(0))
        self%perpendiculars = [perpendicular_type ::]
        self%coincidences = [point_vector_type ::]
        self%distances = [point_vector_type ::]
        self%angles = [angle_type ::]
        call list_kinds(self%kinds)
        if (allocated(self%at%laws)) deallocate (self%at%laws)
        if (allocated(self%at%formulas)) deallocate (self%at%formulas)
        allocate (self%at%laws(0), self%at%formulas(0))
        self%at%coordinates = [coordinate_type ::]
        self%slides = [slide_type ::]
        self%velocity_joints = [velocity_joint_type ::]
        if (allocated(self%rate_rows)) deallocate (self%rate_rows)
        allocate (self%rate_rows(0))
        self%knife_edges = [knife_edge_type ::]
        self%rollers = [roller_type ::]
        self%massless_wheels = [massless_wheel_type ::]
        self%sensors = [sensor_type ::]
        if (allocated(self%types)) deallocate (self%types, self%numbers)
        allocate (self%types(16), self%numbers(16))
        call self%index_of%names%clear()
        call self%index_of%points%clear()
        call self%index_of%sensors%clear()
        call self%index_of%motions%clear()
        call self%held%clear()
        call self%rolling%clear()
        self%n_of = numbers_type()
    end subroutine clear

    !> Store the name of a new element.
    pure subroutine keep_name(self, name, type_of, number)
        class(definition_type), intent(inout) :: self
        character(len=*), intent(in) :: name
        !> Type of the element, and its index in the list of this type.
        integer, intent(in) :: type_of, number

        if (self%index_of%names%n == size(self%types)) then
            self%types = [self%types, self%types]
            self%numbers = [self%numbers, self%numbers]
        end if
        call self%index_of%names%put(name, self%index_of%names%n + 1)
        self%types(self%index_of%names%n) = type_of
        self%numbers(self%index_of%names%n) = number
    end subroutine keep_name

    !> Index of a body, 0 for the ground, -1 if the name is unknown.
    pure integer function find_body(self, name)
        class(definition_type), intent(in) :: self
        character(len=*), intent(in) :: name
        integer :: k

        find_body = merge(0, -1, name == 'ground')
        k = self%index_of%names%get(name)
        if (k == 0) return
        if (self%types(k) == 0) find_body = self%numbers(k)
    end function find_body

    !> Type of the element of a name, such as `of_joint`, 0 for a body, -1 if unknown; and its index in the list of its type.
    pure subroutine find_element(self, name, type_of, number)
        class(definition_type), intent(in) :: self
        character(len=*), intent(in) :: name
        integer, intent(out) :: type_of, number
        integer :: k

        type_of = -1
        number = 0
        k = self%index_of%names%get(name)
        if (k == 0) return
        type_of = self%types(k)
        number = self%numbers(k)
    end subroutine find_element

    !> Index of the kind of elements of a word, 0 if there is none.
    pure integer function kind_number(self, label)
        class(definition_type), intent(in) :: self
        character(len=*), intent(in) :: label

        do kind_number = size(self%kinds), 1, -1
            if (self%kinds(kind_number)%of%label() == label) exit
        end do
    end function kind_number

    !> List the words of kinds whose elements have sensors, or numbers that events may set, with articles: `a ..., a ... or a ...`.
    subroutine list_words(self, of_settings, last, text)
        class(definition_type), intent(in) :: self
        logical, intent(in) :: of_settings
        !> Separator before the last word.
        character(len=*), intent(in) :: last
        character(len=:), allocatable, intent(out) :: text
        type(quantity_type), allocatable :: quantities(:)
        character(len=9) :: names(3)
        character(len=word_length) :: words(size(self%kinds))
        integer :: k, n

        n = 0
        do k = 1, size(self%kinds)
            allocate (quantities(0))
            call self%kinds(k)%of%list_quantities(sensor_type(), quantities)
            call self%kinds(k)%of%list_settings(names)
            if (merge(names(1) /= '', size(quantities) > 0, of_settings)) then
                n = n + 1
                words(n) = self%kinds(k)%of%label()
            end if
            deallocate (quantities)
        end do
        text = 'a '//trim(words(1))
        do k = 2, n - 1
            text = text//', a '//trim(words(k))
        end do
        if (n > 1) text = text//last//'a '//trim(words(n))
    end subroutine list_words

    !> Distance of two points in the reference configuration.
    pure real(wp) function reference_length(self, vector)
        class(definition_type), intent(in) :: self
        type(point_vector_type), intent(in) :: vector
        real(wp) :: r1(3), r2(3), a1(3, 3), a2(3, 3)

        call self%frame_of(vector%first, r1, a1)
        call self%frame_of(vector%second, r2, a2)
        reference_length = norm2(r2 + matmul(a2, vector%s2) - r1 - matmul(a1, vector%s1))
    end function reference_length

    !> Append a function of time, and return its index.
    subroutine take_motion(self, name, f, jump_order, number)
        class(definition_type), intent(inout) :: self
        !> Name of the element.
        character(len=*), intent(in) :: name
        class(function_type), intent(in) :: f
        !> See `motion_type`.
        integer, intent(in) :: jump_order
        integer, intent(out) :: number

        number = self%n_of%motions + 1
        if (number > size(self%motions)) call resize_motions(self, 2*number)
        self%n_of%motions = number
        allocate (self%motions(number)%f, source=f)
        self%motions(number)%jump_order = jump_order
        self%motions(number)%name = name
        call self%index_of%motions%put(name, number)
    end subroutine take_motion

    !> Allocate room for a number of functions of time.
    subroutine resize_motions(self, room)
        class(definition_type), intent(inout) :: self
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

    !> Append a law, and return its index.
    subroutine take_law(self, law, number)
        class(definition_type), intent(inout) :: self
        class(law_type), intent(in) :: law
        integer, intent(out) :: number

        number = self%n_of%laws + 1
        if (number > size(self%at%laws)) call resize_laws(self, 2*number)
        self%n_of%laws = number
        allocate (self%at%laws(number)%law, source=law)
    end subroutine take_law

    !> Allocate room for a number of laws.
    subroutine resize_laws(self, room)
        class(definition_type), intent(inout) :: self
        integer, intent(in) :: room
        type(law_item_type), allocatable :: others(:)
        integer :: i

        allocate (others(room))
        do i = 1, self%n_of%laws
            call move_alloc(self%at%laws(i)%law, others(i)%law)
        end do
        call move_alloc(others, self%at%laws)
    end subroutine resize_laws

    !> Append an expression of the state, and return its index.
    subroutine take_formula(self, expression, number)
        class(definition_type), intent(inout) :: self
        type(expression_type), intent(in) :: expression
        integer, intent(out) :: number

        number = self%n_of%formulas + 1
        if (number > size(self%at%formulas)) call resize_formulas(self, 2*number)
        self%n_of%formulas = number
        call self%at%formulas(number)%initialize(expression, self%list_variables())
    end subroutine take_formula

    !> Allocate room for a number of expressions of the state.
    subroutine resize_formulas(self, room)
        class(definition_type), intent(inout) :: self
        integer, intent(in) :: room
        type(formula_type), allocatable :: others(:)

        allocate (others(room))
        others(:self%n_of%formulas) = self%at%formulas(:self%n_of%formulas)
        call move_alloc(others, self%at%formulas)
    end subroutine resize_formulas

    !> Append a coordinate of an element, and return the preliminary number of its pose, which is negative: `define` numbers the
    !> poses of these coordinates behind those of all bodies.
    subroutine take_slide(self, name, unit, inertia, pose, displacement)
        class(definition_type), intent(inout) :: self
        !> Name of the element; unit; inertia (kg or kg m^2).
        character(len=*), intent(in) :: name, unit
        real(wp), intent(in) :: inertia
        integer, intent(out) :: pose
        !> Index of the coordinate for elements that name it.
        integer, intent(out), optional :: displacement
        type(slide_type) :: slide

        slide = slide_type(name, unit, .not. present(displacement), inertia)
        associate (n => self%n_of%slides)
            n = n + 1
            if (n > size(self%slides)) self%slides = [self%slides, self%slides, slide]
            self%slides(n) = slide
            pose = -n
        end associate
        if (present(displacement)) call self%keep_coordinate(slide_coordinate(pose), displacement)
    end subroutine take_slide

    !> Append a coordinate, and return its index.
    pure subroutine keep_coordinate(self, coordinate, number)
        class(definition_type), intent(inout) :: self
        type(coordinate_type), intent(in) :: coordinate
        integer, intent(out) :: number

        number = self%n_of%coordinates + 1
        if (number > size(self%at%coordinates)) self%at%coordinates = [self%at%coordinates, self%at%coordinates, coordinate]
        self%at%coordinates(number) = coordinate
        self%n_of%coordinates = number
    end subroutine keep_coordinate

    !> Trim the lists to their used lengths.
    subroutine fit(self)
        class(definition_type), intent(inout) :: self
        integer :: k

        do k = 1, size(self%kinds)
            call self%kinds(k)%of%fit()
        end do
        associate (n => self%n_of)
            self%bodies = self%bodies(:n%bodies)
            self%points = self%points(:n%points)
            self%joints = self%joints(:n%joints)
            self%perpendiculars = self%perpendiculars(:n%perpendiculars)
            self%coincidences = self%coincidences(:n%coincidences)
            self%distances = self%distances(:n%distances)
            self%angles = self%angles(:n%angles)
            self%at%coordinates = self%at%coordinates(:n%coordinates)
            self%slides = self%slides(:n%slides)
            self%velocity_joints = self%velocity_joints(:n%velocity_joints)
            self%knife_edges = self%knife_edges(:n%knife_edges)
            self%rollers = self%rollers(:n%rollers)
            self%massless_wheels = self%massless_wheels(:n%massless_wheels)
            self%sensors = self%sensors(:n%sensors)
            ! `keep_name` doubles the room.
            self%types = self%types(:max(1, self%index_of%names%n))
            self%numbers = self%numbers(:max(1, self%index_of%names%n))
            call resize_motions(self, n%motions)
            call resize_laws(self, n%laws)
            call resize_formulas(self, n%formulas)
        end associate
    end subroutine fit

    !> Variables of the expressions of loads and of rows, in their order: t; of each body x, y, z (m), vx, vy, vz (m/s), in the
    !> plane angle (rad) and omega (rad/s), in space e0 to e3 and wx, wy, wz in the world frame (rad/s), as `body.x`; of each joint
    !> with an axis angle and rate, or way and speed, as `joint.angle`, measured from the reference configuration, and of each
    !> sliding massless wheel its way and speed. Parse an expression with these names after the elements in it were added, and add
    !> its element before another body or joint.
    function variable_names(self) result(names)
        class(definition_type), intent(in) :: self
        character(len=variable_name_length), allocatable :: names(:)
        type(variable_type), allocatable :: variables(:)

        allocate (variables, source=self%list_variables())
        names = variables%name
    end function variable_names

    !> Definitions of these variables.
    function list_variables(self) result(variables)
        class(definition_type), intent(in) :: self
        type(variable_type), allocatable :: variables(:)
        character(len=*), parameter :: axis(3) = ['x', 'y', 'z'], number(4) = ['0', '1', '2', '3']
        integer :: i, k, m, n

        ! Upper bounds per body and per joint.
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
            associate (name => trim(self%joints(i)%name)//'.', turn => self%joints(i)%rotation, way => self%joints(i)%displacement)
                if (turn > 0) then
                    call add(name//'angle', is_joint, turn, 1)
                    call add(name//'rate', is_joint_rate, turn, 1)
                end if
                if (way > 0) call add_way(name, way)
            end associate
        end do
        do i = 1, self%index_of%names%n
            if (self%types(i) /= of_massless_wheel) cycle
            associate (way => self%massless_wheels(self%numbers(i))%displacement)
                if (way > 0) call add_way(self%index_of%names%name(i)//'.', way)
            end associate
        end do
        variables = variables(:m)

    contains

        subroutine add_way(name, way)
            character(len=*), intent(in) :: name
            integer, intent(in) :: way

            call add(name//'displacement', is_joint, way, 1)
            call add(name//'speed', is_joint_rate, way, 1)
        end subroutine add_way

        subroutine add(name, kind, of, place)
            character(len=*), intent(in) :: name
            integer, intent(in) :: kind, of, place

            m = m + 1
            variables(m) = variable_type(name, kind, of, place)
        end subroutine add
    end function list_variables

    !> Position and rotation of a body in the reference configuration.
    pure subroutine frame_of(self, body, r, a)
        class(definition_type), intent(in) :: self
        integer, intent(in) :: body
        real(wp), intent(out) :: r(3), a(3, 3)
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
    end subroutine frame_of

    !> Angle of a body in the reference configuration.
    pure real(wp) function angle_of(self, body)
        class(definition_type), intent(in) :: self
        integer, intent(in) :: body

        angle_of = 0.0_wp
        if (body > 0) angle_of = self%bodies(body)%angle
    end function angle_of

    !> Normalise a given direction.
    subroutine take_direction(self, label, what, given, vector, error)
        class(definition_type), intent(in) :: self
        character(len=*), intent(in) :: label, what
        real(wp), intent(in) :: given(:)
        real(wp), intent(inout) :: vector(3)
        type(error_type), allocatable, intent(inout) :: error

        call take_vector(self%planar, label, what, given, vector, error)
        if (allocated(error)) return
        if (.not. norm2(vector) > 0.0_wp) then
            call refuse(label//': '//what//' is zero', 'give a direction', error)
        else
            vector = vector/norm2(vector)
        end if
    end subroutine take_direction

    !> Refuse the ground and point masses.
    subroutine need_turning_body(self, label, body, error)
        class(definition_type), intent(in) :: self
        character(len=*), intent(in) :: label
        integer, intent(in) :: body
        type(error_type), allocatable, intent(inout) :: error
        logical :: turns

        turns = .false.
        if (body > 0) turns = self%bodies(body)%turns
        if (.not. turns) call refuse(label//' is on the ground or on a point mass', 'name a body with an inertia', error)
    end subroutine need_turning_body
end module tandem_mechanism_definition
