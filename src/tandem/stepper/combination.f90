! SPDX-License-Identifier: MIT
!> Linear combinations of rates with the weights of a row of a tableau. About half of a large tableau is zero, so only the columns
!> with nonzero weights are stored.
module tandem_stepper_combination
    use tandem_kinds, only: lane, wp
    implicit none (type, external)
    private

    public :: combination_type

    !> Number of columns added at a time.
    integer, parameter :: group = 4

    !> sum_j weight(j) rate(:, j) over the columns with nonzero weights.
    type :: combination_type
        private
        integer :: n_groups = 0
        !> Weights and indices of the columns (group, n_groups); the last group is padded with zero weights.
        real(wp), allocatable :: weight(:, :)
        integer, allocatable :: column(:, :)
    contains
        procedure :: set, add
    end type combination_type

contains

    !> Set the weights, one per column beginning with the first.
    pure subroutine set(self, weight)
        class(combination_type), intent(inout) :: self
        real(wp), intent(in) :: weight(:)
        integer :: g, i, j

        self%n_groups = (count(abs(weight) > 0.0_wp) + group - 1)/group
        if (allocated(self%weight)) deallocate (self%weight, self%column)
        allocate (self%weight(group, self%n_groups), source=0.0_wp)
        allocate (self%column(group, self%n_groups), source=1)
        i = 0
        do j = 1, size(weight)
            if (.not. abs(weight(j)) > 0.0_wp) cycle
            g = i/group + 1
            self%weight(mod(i, group) + 1, g) = weight(j)
            ! Pad with a column that is already evaluated.
            self%column(mod(i, group) + 1:, g) = j
            i = i + 1
        end do
    end subroutine set

    !> y := x + h times the combination.
    pure subroutine add(self, height, n_rates, h, rate, x, y)
        class(combination_type), intent(in) :: self
        !> Number of rows, a multiple of `lane`; number of columns, at least the number of weights.
        integer, intent(in) :: height, n_rates
        real(wp), intent(in) :: h, rate(height, n_rates), x(height)
        real(wp), intent(inout) :: y(height)

        call add_groups(self%n_groups, self%weight, self%column, height, n_rates, h, rate, x, y)
    end subroutine add

    !> `add` with explicit-shape arrays.
    pure subroutine add_groups(n_groups, weight, column, height, n_rates, h, rate, x, y)
        integer, intent(in) :: n_groups, column(group, n_groups), height, n_rates
        real(wp), intent(in) :: weight(group, n_groups), h, rate(height, n_rates), x(height)
        real(wp), intent(inout) :: y(height)
        real(wp) :: w1, w2, w3, w4
        integer :: b, c1, c2, c3, c4, g, i

        if (n_groups == 0) y = x
        do g = 1, n_groups
            w1 = h*weight(1, g)
            w2 = h*weight(2, g)
            w3 = h*weight(3, g)
            w4 = h*weight(4, g)
            c1 = column(1, g)
            c2 = column(2, g)
            c3 = column(3, g)
            c4 = column(4, g)
            if (g == 1) then
                do b = 0, height - lane, lane
                    !GCC$ UNROLL 1
                    do i = 1, lane
                        y(b + i) = x(b + i) + &
                            ((w1*rate(b + i, c1) + w2*rate(b + i, c2)) + (w3*rate(b + i, c3) + w4*rate(b + i, c4)))
                    end do
                end do
            else
                do b = 0, height - lane, lane
                    !GCC$ UNROLL 1
                    do i = 1, lane
                        y(b + i) = y(b + i) + &
                            ((w1*rate(b + i, c1) + w2*rate(b + i, c2)) + (w3*rate(b + i, c3) + w4*rate(b + i, c4)))
                    end do
                end do
            end if
        end do
    end subroutine add_groups
end module tandem_stepper_combination
