! SPDX-License-Identifier: MIT
!> Expressions of the state of a mechanism. Their variables are the time, positions, angles and velocities of bodies, and joint
!> coordinates with their rates. Loads and velocity-level rows use them.
module tandem_mechanism_formula
    use tandem_kinds, only: wp
    use tandem_mechanism_coordinate, only: coordinate_type, differentiate_coordinate, measure
    use tandem_mechanism_expression, only: expression_type
    use tandem_mechanism_pair, only: columns, n_local, place_1, turn_1
    use tandem_mechanism_piecewise, only: piecewise_type
    use tandem_mechanism_pose, only: pose_type
    use tandem_rigid_euler_parameters, only: e_product, e_transposed_product
    implicit none (type, external)
    private

    public :: variable_type, formula_type, variable_name_length
    public :: is_time, is_place, is_turn, is_velocity, is_turn_rate, is_spin, is_joint, is_joint_rate

    !> Kinds of variables: time (s); component of a body's position (m); its angle (rad) or one of its Euler parameters; rates of
    !> positions; rates of angles or Euler parameters; component of its angular velocity in the world frame (rad/s); joint
    !> coordinate (m or rad); rate of a joint coordinate.
    integer, parameter :: is_time = 0, is_place = 1, is_turn = 2, is_velocity = 3, is_turn_rate = 4, is_spin = 5, is_joint = 6, &
        is_joint_rate = 7
    !> Length of variable names.
    integer, parameter :: variable_name_length = 80

    !> Variable of an expression.
    type :: variable_type
        character(len=variable_name_length) :: name = ''
        integer :: kind = is_time
        !> Index of the body or of the joint coordinate; component, from 1.
        integer :: owner = 0, entry = 0
    end type variable_type

    !> An expression with the definitions and current values of its variables.
    type :: formula_type
        type(piecewise_type) :: pieces
        type(variable_type), allocatable :: variables(:)
        !> Values of the variables and their rates; derivatives of the expression with respect to the variables, and the rates of
        !> these derivatives.
        real(wp), allocatable :: x(:), v(:), gradient(:), gradient_rate(:)
    contains
        procedure :: initialize, read_state, value, evaluate_gradient, variable_gradient
    end type formula_type

contains

    !> Construct a formula from an expression. Only the variables that occur are stored.
    subroutine initialize(self, expression, variables)
        class(formula_type), intent(out) :: self
        type(expression_type), intent(in) :: expression
        !> Variables with which the expression was parsed, in this order.
        type(variable_type), intent(in) :: variables(:)
        type(expression_type) :: compact
        integer, allocatable :: used(:)
        integer :: time_index

        compact = expression
        call compact%renumber(used)
        self%variables = variables(used)
        time_index = findloc(self%variables%kind, is_time, dim=1)
        call self%pieces%initialize(compact, time_index)
        allocate (self%x(size(used)), self%v(size(used)), self%gradient(size(used)), self%gradient_rate(size(used)), source=0.0_wp)
    end subroutine initialize

    !> Read the values of the variables from the state; with `rates`, also their rates, except for variables that are velocities.
    pure subroutine read_state(self, t, pose, coordinates, rates)
        class(formula_type), intent(inout) :: self
        real(wp), intent(in) :: t
        type(pose_type), intent(in) :: pose(0:)
        !> Joint coordinates.
        type(coordinate_type), intent(inout) :: coordinates(:)
        logical, intent(in) :: rates
        real(wp) :: x(0:2), gradient(n_local, 0:2), spin(3)
        integer :: i

        do i = 1, size(self%variables)
            associate (owner => self%variables(i)%owner, entry => self%variables(i)%entry)
                select case (self%variables(i)%kind)
                case (is_time)
                    self%x(i) = t
                    self%v(i) = 1.0_wp
                case (is_place)
                    self%x(i) = pose(owner)%r(entry, 0)
                    if (rates) self%v(i) = pose(owner)%r(entry, 1)
                case (is_turn)
                    self%x(i) = pose(owner)%p(entry, 0)
                    if (rates) self%v(i) = pose(owner)%p(entry, 1)
                case (is_velocity)
                    self%x(i) = pose(owner)%r(entry, 1)
                case (is_turn_rate)
                    self%x(i) = pose(owner)%p(entry, 1)
                case (is_spin)
                    spin = 2*e_product(pose(owner)%p(:, 0), pose(owner)%p(:, 1))
                    self%x(i) = spin(entry)
                case (is_joint)
                    if (rates) then
                        call differentiate_coordinate(coordinates(owner), pose, 1, 0, x, gradient)
                        self%x(i) = x(0)
                        self%v(i) = x(1)
                    else
                        call measure(coordinates(owner), pose, self%x(i))
                    end if
                case default ! is_joint_rate
                    call differentiate_coordinate(coordinates(owner), pose, 1, 0, x, gradient)
                    self%x(i) = x(1)
                end select
            end associate
        end do
    end subroutine read_state

    !> Value at the state set by `read_state`.
    pure real(wp) function value(self)
        class(formula_type), intent(in) :: self

        value = self%pieces%evaluate_value(self%x)
    end function value

    !> Value and gradient. The gradient is stored in `gradient`.
    pure subroutine evaluate_gradient(self, f)
        class(formula_type), intent(inout) :: self
        real(wp), intent(out) :: f

        call self%pieces%evaluate_gradient(self%x, f, self%gradient)
    end subroutine evaluate_gradient

    !> Gradients of a variable with respect to q and qd, in the layout of an element between two bodies; columns of the entries.
    pure subroutine variable_gradient(self, i, pose, coordinates, by_q, by_qd, c)
        class(formula_type), intent(in) :: self
        !> Index of the variable in the formula.
        integer, intent(in) :: i
        type(pose_type), intent(in) :: pose(0:)
        type(coordinate_type), intent(inout) :: coordinates(:)
        real(wp), intent(out) :: by_q(n_local), by_qd(n_local)
        integer, intent(out) :: c(n_local)
        real(wp) :: x(0:2), gradient(n_local, 0:2), along(3)

        by_q = 0.0_wp
        by_qd = 0.0_wp
        associate (owner => self%variables(i)%owner, entry => self%variables(i)%entry)
            select case (self%variables(i)%kind)
            case (is_joint, is_joint_rate)
                c = columns(pose(coordinates(owner)%first), pose(coordinates(owner)%second))
                call differentiate_coordinate(coordinates(owner), pose, 1, 1, x, gradient)
                if (self%variables(i)%kind == is_joint) then
                    by_q = gradient(:, 0)
                else
                    by_q = gradient(:, 1)
                    by_qd = gradient(:, 0)
                end if
                return
            case (is_time)
                c = 0
                return
            case default
                c = columns(pose(owner), pose(0))
            end select
            select case (self%variables(i)%kind)
            case (is_place)
                by_q(place_1 + entry) = 1.0_wp
            case (is_turn)
                by_q(turn_1 + entry) = 1.0_wp
            case (is_velocity)
                by_qd(place_1 + entry) = 1.0_wp
            case (is_turn_rate)
                by_qd(turn_1 + entry) = 1.0_wp
            case default ! is_spin
                ! E(p) pd = -E(pd) p.
                along = 0.0_wp
                along(entry) = 2.0_wp
                by_q(turn_1 + 1:turn_1 + 4) = -e_transposed_product(pose(owner)%p(:, 1), along)
                by_qd(turn_1 + 1:turn_1 + 4) = e_transposed_product(pose(owner)%p(:, 0), along)
            end select
        end associate
    end subroutine variable_gradient
end module tandem_mechanism_formula
