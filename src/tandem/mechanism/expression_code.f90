! SPDX-License-Identifier: MIT
!> Lists of operations that represent expressions: construction during parsing, and the final form for evaluation.
module tandem_mechanism_expression_code
    use tandem_kinds, only: long, wp
    use tandem_mechanism_operations, only: branch_of, has_kink, is_commutative, kink_order, op_smooth_step, value_of
    implicit none (type, external)
    private

    public :: code_type, builder_type, operand_type, max_slots

    !> Largest number of slots. Evaluations use arrays of this size and need no allocation.
    integer, parameter :: max_slots = 1000
    !> Leaves of a list under construction, in place of operations.
    integer, parameter :: leaf_constant = 0, leaf_variable = -1

    !> List of operations in its final form. Values are stored in slots: the variables, then the constants, then one slot per
    !> operation. An operation reads only earlier slots. The last slot is the value of the expression.
    type :: code_type
        !> Variables that occur, as indices in the list of names.
        integer, allocatable :: variables(:)
        real(wp), allocatable :: constants(:)
        !> Operations and their operands.
        integer, allocatable :: operations(:), left(:), right(:)
        !> Index of the first kink of each operation, 0 if none.
        integer, allocatable :: first_kink(:)
        !> For each kink: the two slots whose difference is compared with an offset; the lowest derivative that jumps.
        integer, allocatable :: kink_left(:), kink_right(:)
        real(wp), allocatable :: kink_offsets(:)
        integer, allocatable :: kink_orders(:)
        !> Number of slots.
        integer :: n_slots = 0
    end type code_type

    !> An operand: an index in the list under construction, or a constant that is not stored in the list yet.
    type :: operand_type
        integer :: node = 0
        real(wp) :: value = 0.0_wp
    end type operand_type

    !> List under construction. Operations on constants are evaluated at once, and repeated operations are stored once.
    type :: builder_type
        !> True if there were too many operations; the list is then invalid.
        logical :: is_full = .false.
        integer, private :: n = 0
        integer, private :: operations(max_slots), left(max_slots), right(max_slots)
        real(wp), private :: constants(max_slots)
    contains
        procedure :: variable, apply, arrange
        procedure, private :: place_of, append
    end type builder_type

contains

    !> Operand that is a variable.
    type(operand_type) function variable(self, i)
        class(builder_type), intent(inout) :: self
        !> Index in the list of names.
        integer, intent(in) :: i

        call self%append(leaf_variable, i, 0, 0.0_wp, variable%node)
    end function variable

    !> left = operation(left, right); evaluated at once if both are constants.
    subroutine apply(self, operation, left, right)
        class(builder_type), intent(inout) :: self
        integer, intent(in) :: operation
        type(operand_type), intent(inout) :: left
        type(operand_type), intent(in) :: right
        integer :: a, b

        if (left%node == 0 .and. right%node == 0) then
            left%value = value_of(operation, left%value, right%value, branch_of(operation, left%value, right%value))
            return
        end if
        call self%place_of(left, a)
        call self%place_of(right, b)
        if (is_commutative(operation)) then
            call self%append(operation, min(a, b), max(a, b), 0.0_wp, left%node)
        else
            call self%append(operation, a, b, 0.0_wp, left%node)
        end if
    end subroutine apply

    !> Index of an operand in the list.
    subroutine place_of(self, operand, node)
        class(builder_type), intent(inout) :: self
        type(operand_type), intent(in) :: operand
        integer, intent(out) :: node

        node = operand%node
        if (node == 0) call self%append(leaf_constant, 0, 0, operand%value, node)
    end subroutine place_of

    !> Append an operation, unless the list already contains it.
    subroutine append(self, operation, left, right, constant, node)
        class(builder_type), intent(inout) :: self
        integer, intent(in) :: operation, left, right
        real(wp), intent(in) :: constant
        integer, intent(out) :: node

        do node = 1, self%n
            if (self%operations(node) == operation .and. self%left(node) == left .and. self%right(node) == right .and. &
                transfer(self%constants(node), 0_long) == transfer(constant, 0_long)) return
        end do
        self%is_full = self%is_full .or. self%n == max_slots
        if (self%is_full) then
            node = 1
            return
        end if
        self%n = node
        self%operations(node) = operation
        self%left(node) = left
        self%right(node) = right
        self%constants(node) = constant
    end subroutine append

    !> Produce the final list, leaves first, which contains only operations on which the result depends.
    subroutine arrange(self, last, code)
        class(builder_type), intent(inout) :: self
        type(operand_type), intent(in) :: last
        type(code_type), intent(out) :: code
        logical :: is_needed(max_slots)
        integer :: slots(max_slots), result, i, k

        call self%place_of(last, result)
        is_needed = .false.
        is_needed(result) = .true.
        do i = result, 1, -1
            if (.not. is_needed(i) .or. self%operations(i) <= leaf_constant) cycle
            is_needed(self%left(i)) = .true.
            is_needed(self%right(i)) = .true.
        end do
        associate (n => self%n, operations => self%operations)
            code%variables = pack(self%left(:n), is_needed(:n) .and. operations(:n) == leaf_variable)
            code%constants = pack(self%constants(:n), is_needed(:n) .and. operations(:n) == leaf_constant)
            k = 0
            do i = 1, n
                if (is_needed(i) .and. operations(i) == leaf_variable) call number(i)
            end do
            do i = 1, n
                if (is_needed(i) .and. operations(i) == leaf_constant) call number(i)
            end do
            do i = 1, n
                if (is_needed(i) .and. operations(i) > leaf_constant) call number(i)
            end do
            code%n_slots = k
            code%operations = pack(operations(:n), is_needed(:n) .and. operations(:n) > leaf_constant)
            code%left = slots(pack(self%left(:n), is_needed(:n) .and. operations(:n) > leaf_constant))
            code%right = slots(pack(self%right(:n), is_needed(:n) .and. operations(:n) > leaf_constant))
        end associate
        call list_kinks(code)

    contains

        !> Assign the next slot to an entry.
        subroutine number(node)
            integer, intent(in) :: node

            k = k + 1
            slots(node) = k
        end subroutine number
    end subroutine arrange

    !> List the kinks of the operations in order.
    pure subroutine list_kinks(code)
        type(code_type), intent(inout) :: code
        integer :: k, i

        allocate (code%first_kink(size(code%operations)), source=0)
        allocate (code%kink_left(0), code%kink_right(0), code%kink_offsets(0), code%kink_orders(0))
        do k = 1, size(code%operations)
            if (.not. has_kink(code%operations(k))) cycle
            code%first_kink(k) = size(code%kink_left) + 1
            do i = 0, merge(1, 0, code%operations(k) == op_smooth_step)
                code%kink_left = [code%kink_left, code%left(k)]
                code%kink_right = [code%kink_right, code%right(k)]
                code%kink_offsets = [code%kink_offsets, real(i, wp)]
                code%kink_orders = [code%kink_orders, kink_order(code%operations(k))]
            end do
        end do
    end subroutine list_kinks
end module tandem_mechanism_expression_code
