! SPDX-License-Identifier: MIT
!> Bounds of expressions while one of their variables, such as the time, varies over an interval.
submodule(tandem_mechanism_expression) tandem_mechanism_enclosure
    use tandem_mechanism_interval, only: add, branches_between, intersection, enclose_curvatures, enclose_slopes, enclose_value, &
        exact, multiply, nothing, subtract
    use tandem_mechanism_operations, only: op_multiply, op_power_constant
    implicit none (type, external)

contains

    module procedure list_parts
        logical :: depends(max_slots), depends_on_others(max_slots), is_part(max_slots)
        integer :: k, n

        associate (code => self%code)
            n = size(code%variables)
            depends(:n) = code%variables == variable
            depends_on_others(:n) = .not. depends(:n)
            depends(n + 1:n + size(code%constants)) = .false.
            depends_on_others(n + 1:n + size(code%constants)) = .false.
            n = code%n_slots - size(code%operations)
            is_part(:code%n_slots) = .false.
            do k = 1, size(code%operations)
                depends(n + k) = depends(code%left(k)) .or. depends(code%right(k))
                depends_on_others(n + k) = depends_on_others(code%left(k)) .or. depends_on_others(code%right(k))
                if (.not. depends_on_others(n + k)) cycle
                is_part(code%left(k)) = .true.
                is_part(code%right(k)) = .true.
            end do
            is_part(code%n_slots) = .true.
            parts = pack([(k, k=1, code%n_slots)], [(k > n .and. is_part(k) .and. depends(k) .and. .not. depends_on_others(k), &
                k=1, code%n_slots)])
        end associate
    end procedure list_parts

    !> Bounds of the values and derivatives of all slots while one variable varies over an interval, by interval arithmetic and by
    !> the mean value theorem, which is sharper in short intervals. Slots that depend on other variables are empty. The derivative
    !> is unbounded if the value may jump within the interval.
    pure subroutine enclose(self, variable, from, to, w, w1, at_middle, sides, w2)
        class(expression_type), intent(in) :: self
        !> Index of the variable in the list of names.
        integer, intent(in) :: variable
        !> The interval.
        real(wp), intent(in) :: from, to
        !> Bounds of the values and derivatives; bounds of the values at the middle of the interval, which include their rounding
        !> errors.
        type(interval_type), intent(inout) :: w(:), w1(:), at_middle(:)
        !> Side of each kink: 1 or -1. By default the values of the variables decide.
        integer, intent(in), optional :: sides(:)
        !> Bounds of the second derivatives; unbounded if the branch at a kink is uncertain.
        type(interval_type), intent(inout), optional :: w2(:)
        type(interval_type) :: a, b, b_at_middle, by_a, by_b, offset
        integer :: branches(2), operation, k, n, i, j

        offset = subtract(interval_type(from, to), exact(middle_of(from, to)))
        associate (code => self%code)
            do k = 1, size(code%variables)
                w(k) = nothing
                w1(k) = w(k)
                at_middle(k) = w(k)
                if (code%variables(k) /= variable) cycle
                w(k) = interval_type(from, to)
                w1(k) = exact(1.0_wp)
                at_middle(k) = exact(middle_of(from, to))
            end do
            n = size(code%variables)
            do k = 1, size(code%constants)
                w(n + k) = exact(code%constants(k))
                w1(n + k) = exact(0.0_wp)
                at_middle(n + k) = w(n + k)
            end do
            n = code%n_slots - size(code%operations)
            branches = 0
            do k = 1, size(code%operations)
                i = code%left(k)
                j = code%right(k)
                operation = code%operations(k)
                a = w(i)
                b = w(j)
                b_at_middle = at_middle(j)
                if (operation == op_multiply .and. i == j) then
                    ! The bounds of a square are sharper than those of a product.
                    operation = op_power_constant
                    b = exact(2.0_wp)
                    b_at_middle = b
                end if
                if (code%first_kink(k) > 0) branches = middle_branches(at_middle(i), at_middle(j))
                at_middle(n + k) = enclose_value(operation, at_middle(i), b_at_middle, branches)
                if (code%first_kink(k) > 0 .and. .not. present(sides)) branches = branches_between(operation, a, b)
                w(n + k) = enclose_value(operation, a, b, branches)
                call enclose_slopes(operation, a, b, w(n + k), branches, by_a, by_b)
                w1(n + k) = add(multiply(by_a, w1(i)), multiply(by_b, w1(j)))
                if (present(w2)) w2(n + k) = curvature(w2(i), w2(j))
                w(n + k) = intersection(w(n + k), add(at_middle(n + k), multiply(w1(n + k), offset)))
            end do
        end associate

    contains

        !> Bounds of the second derivative of the current operation.
        pure type(interval_type) function curvature(a2, b2) result(f2)
            !> Second derivatives of the operands.
            type(interval_type), intent(in) :: a2, b2
            type(interval_type) :: by_aa, by_ab, by_bb

            call enclose_curvatures(operation, a, b, w(n + k), [by_a, by_b], branches(1) == 1, by_aa, by_ab, by_bb)
            if (branches(1) /= branches(2)) then
                by_aa = interval_type(-huge(1.0_wp), huge(1.0_wp))
                by_ab = by_aa
                by_bb = by_aa
            end if
            by_aa = add(multiply(by_aa, w1(i)), multiply(by_ab, w1(j)))
            by_ab = add(multiply(by_ab, w1(i)), multiply(by_bb, w1(j)))
            f2 = add(add(multiply(by_a, a2), multiply(by_b, b2)), add(multiply(by_aa, w1(i)), multiply(by_ab, w1(j))))
        end function curvature

        !> Branches of the current operation at the middle of the interval.
        pure function middle_branches(a, b) result(branches)
            type(interval_type), intent(in) :: a, b
            integer :: branches(2)

            if (present(sides)) then
                branches = self%branch_with(k, sides)
            else
                branches = branches_between(self%code%operations(k), a, b)
            end if
        end function middle_branches
    end subroutine enclose

    !> Midpoint of an interval.
    pure real(wp) function middle_of(from, to)
        real(wp), intent(in) :: from, to

        middle_of = from + 0.5_wp*(to - from)
    end function middle_of

    module procedure enclose_kinks
        type(interval_type) :: w(max_slots), w1(max_slots), at_middle(max_slots), offset
        integer :: k, i, j

        call enclose(self, variable, from, to, w, w1, at_middle)
        offset = subtract(interval_type(from, to), exact(middle_of(from, to)))
        associate (code => self%code)
            do k = 1, size(code%kink_left)
                i = code%kink_left(k)
                j = code%kink_right(k)
                middle(k) = subtract(subtract(at_middle(i), at_middle(j)), exact(code%kink_offsets(k)))
                rates(k) = subtract(w1(i), w1(j))
                arguments(k) = intersection(subtract(subtract(w(i), w(j)), exact(code%kink_offsets(k))), &
                    add(middle(k), multiply(rates(k), offset)))
            end do
        end associate
    end procedure enclose_kinks

    module procedure enclose_parts
        type(interval_type) :: w(max_slots), w1(max_slots), w2(max_slots), at_middle(max_slots)

        if (present(curvatures)) then
            w2(:self%code%n_slots - size(self%code%operations)) = exact(0.0_wp)
            call enclose(self, variable, from, to, w, w1, at_middle, sides, w2)
            curvatures = w2(parts)
        else
            call enclose(self, variable, from, to, w, w1, at_middle, sides)
        end if
        values = w(parts)
        rates = w1(parts)
    end procedure enclose_parts

    module procedure evaluate_parts
        real(wp) :: w(max_slots), w1(max_slots), d(5)
        integer :: k, n, i, j

        associate (code => self%code)
            n = size(code%variables)
            w(:n) = t
            w1(:n) = merge(1.0_wp, 0.0_wp, code%variables == variable)
            w(n + 1:n + size(code%constants)) = code%constants
            w1(n + 1:n + size(code%constants)) = 0.0_wp
            n = code%n_slots - size(code%operations)
            do k = 1, size(code%operations)
                i = code%left(k)
                j = code%right(k)
                call differentiate(code%operations(k), w(i), w(j), self%branch_at(k, w(i), w(j), sides), w(n + k), d)
                w1(n + k) = d(1)*w1(i) + d(2)*w1(j)
            end do
        end associate
        values = w(parts)
        rates = w1(parts)
    end procedure evaluate_parts
end submodule tandem_mechanism_enclosure
