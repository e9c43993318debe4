! SPDX-License-Identifier: MIT
!> How near C is to losing rank: watched by what the split knows, decided by singular values and by the orientation of C.
submodule(tandem_tangent_dense) tandem_tangent_dense_rank
    implicit none (type, external)

contains

    !> How many steps as the one that ends at (t, q) C is away from losing rank.
    module subroutine measure_rank(self, t, q, room, stat)
        class(dense_chart_type), intent(inout) :: self
        real(wp), intent(in) :: t
        real(wp), intent(in), contiguous :: q(:)
        real(wp), intent(out) :: room
        integer, intent(out) :: stat
        !> A redundant row leaves at most this of itself in the motions that the others allow; rounding is far below.
        real(wp), parameter :: largest_rest = 1.0e-6_wp
        !> A loss of rank further away than so many steps is not looked for.
        real(wp), parameter :: horizon = 8.0_wp
        real(wp) :: smallest, smallest_before, fall
        logical :: falls
        integer :: i, j

        self%failed_row = 0
        self%fallen = 1.0_wp
        room = huge(1.0_wp)
        stat = status_ok
        if (self%m == 0) return
        call self%visit(t, q, stat)
        if (stat == status_ok) call self%split_here(stat)
        if (stat /= status_ok) return
        if (self%has_bases) call measure_origin(self)
        call self%measure_split()
        if (allocated(self%dropped)) then
            call self%split_fully(stat)
            if (stat /= status_ok) return
            do i = 1, size(self%dropped)
                associate (row => self%model%all_rows%jacobian(self%dropped(i), :), d => self%split%null_space)
                    do j = 1, size(d, 2)
                        if (abs(dot_product(row, d(:, j))) <= largest_rest*norm2(row*self%scale)*norm2(d(:, j)/self%scale)) cycle
                        call self%blame_dependent(0)
                        self%failed_row = self%dropped(i)
                        room = 0.0_wp
                        return
                    end do
                end associate
            end do
        end if
        ! These are at hand, and cheap: what falls towards a loss of rank, and the orientation of the pivot columns. That changes
        ! with the one of C, and where the pivot columns alone turn singular: in a step that does both it is what it was.
        fall = self%last_independence - self%split%independence
        falls = .not. self%split%independence > horizon*fall
        if (falls .or. self%split%orientation /= self%origin_orientation) then
            if (.not. self%row_space%keeps_orientation(self%m, self%n, self%step_jacobian, self%model%terms%jacobian, &
                self%scale)) then
                ! A shorter step will be compared with the same start.
                room = 0.0_wp
                call self%blame_dependent(0)
                return
            end if
        end if
        self%origin_orientation = self%split%orientation
        self%last_independence = self%split%independence
        if (.not. falls) return
        call self%row_space%find_weakest(self%m, self%n, self%step_jacobian, self%scale, self%x, smallest_before)
        call self%row_space%find_weakest(self%m, self%n, self%model%terms%jacobian, self%scale, self%x, smallest)
        if (smallest_before > smallest) room = smallest/(smallest_before - smallest)
        self%fallen = smallest/max(self%best_independence, tiny(1.0_wp))
        if (room <= horizon) call self%blame_dependent(0)
    end subroutine measure_rank

    !> The orientation and the independence of C at the current point.
    module subroutine measure_split(self)
        class(dense_chart_type), intent(inout) :: self

        if (self%split%is_measured) return
        call self%split%measure_orientation()
        if (.not. self%has_bases) call self%reduced%find_independence(self%split%elimination, self%split%independence)
    end subroutine measure_split

    !> The orientation of C and its smallest pivot at the start of the step, where bases are kept: both of C X.
    subroutine measure_origin(self)
        class(dense_chart_type), intent(inout) :: self
        integer :: stat

        call set_product(self%step_jacobian, self%x_basis, self%origin_c_x)
        call self%origin_lu%factor(self%origin_c_x, stat)
        if (stat /= 0) return
        self%origin_orientation = self%origin_lu%determinant_sign()
        self%last_independence = self%origin_lu%smallest_pivot()
    end subroutine measure_origin

    !> Whether C loses rank on the straight way ahead of a state, soon enough for that way to mean something.
    module logical function loses_rank_ahead(self, t, q, qd, h)
        class(dense_chart_type), intent(inout) :: self
        real(wp), intent(in) :: t, h
        real(wp), intent(in), contiguous :: q(:), qd(:)
        !> Halvings of the way; how much C may change until the loss.
        integer, parameter :: most_halvings = 12
        real(wp), parameter :: largest_change = 0.5_wp
        real(wp), allocatable :: here(:, :)
        real(wp) :: near, far, middle
        integer :: k, stat

        loses_rank_ahead = .false.
        if (self%m == 0) return
        call self%move_to(t, q, stat)
        if (stat /= status_ok) return
        here = self%model%terms%jacobian
        near = 0.0_wp
        far = h
        if (keeps_until(h)) return
        do k = 1, most_halvings
            middle = 0.5_wp*(near + far)
            if (keeps_until(middle)) then
                near = middle
            else
                far = middle
            end if
        end do
        loses_rank_ahead = .not. keeps_until(far)
        if (loses_rank_ahead) loses_rank_ahead = change_from(self, here) <= largest_change
        if (loses_rank_ahead) call self%blame_dependent(0)

    contains

        !> Whether C has its orientation still; what cannot be evaluated counts as no loss.
        logical function keeps_until(ahead)
            real(wp), intent(in) :: ahead

            self%trial = q + ahead*qd
            call self%move_to(t + ahead, self%trial, stat)
            keeps_until = stat /= status_ok
            if (.not. keeps_until) keeps_until = self%row_space%keeps_orientation(self%m, self%n, here, &
                self%model%terms%jacobian, self%scale)
        end function keeps_until
    end function loses_rank_ahead

    !> How far C has changed from the start of the step to the current point.
    module real(wp) function relative_change(self)
        class(dense_chart_type), intent(in) :: self

        relative_change = change_from(self, self%step_jacobian)
    end function relative_change

    !> How far C has changed from another to that of the current point: rows of unit length in the other, Frobenius norm.
    pure real(wp) function change_from(self, other)
        class(dense_chart_type), intent(in) :: self
        !> C elsewhere (m, n).
        real(wp), intent(in) :: other(:, :)
        integer :: i

        change_from = 0.0_wp
        do i = 1, self%m
            change_from = change_from + sum(((self%model%terms%jacobian(i, :) - other(i, :))*self%scale)**2)/ &
                max(sum((other(i, :)*self%scale)**2), tiny(1.0_wp))
        end do
        change_from = sqrt(change_from)
    end function change_from

    !> Remember which rows depend on each other at the current point.
    module subroutine blame_dependent(self, row)
        class(dense_chart_type), intent(inout) :: self
        integer, intent(in) :: row
        !> Smaller parts of the combination are not named.
        real(wp), parameter :: smallest_part = 0.01_wp
        real(wp) :: share(self%m), smallest
        integer :: i

        call self%row_space%find_weakest(self%m, self%n, self%model%terms%jacobian, self%scale, share, smallest)
        if (row > 0) share(row) = 1.0_wp
        call self%blame(merge(row, maxloc(abs(share), dim=1), row > 0), smallest)
        self%failed_rows = pack([(i, i=1, self%m)], abs(share) > smallest_part)
        if (allocated(self%dropped)) self%failed_rows = self%model%kept(self%failed_rows)
    end subroutine blame_dependent
end submodule tandem_tangent_dense_rank
