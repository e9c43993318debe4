! SPDX-License-Identifier: MIT
!> How near C is to losing rank: watched by what the split knows, decided by singular values and by the orientation of C; and
!> whether it goes on tying the coordinates without mass.
submodule(tandem_chart_dense) tandem_chart_dense_rank
    implicit none (type, external)

contains

    module procedure measure_rank
        !> A redundant row leaves at most this of itself in the motions that the others allow; rounding is far below.
        real(wp), parameter :: largest_rest = 1.0e-6_wp
        !> A loss of rank further away than so many steps is not looked for.
        real(wp), parameter :: horizon = 8.0_wp
        real(wp) :: smallest, smallest_before, fall
        logical :: falls
        integer :: i, j

        self%failed_row = 0
        self%failed_coordinate = 0
        self%fallen = 1.0_wp
        self%loosened = 1.0_wp
        room = huge(1.0_wp)
        stat = status_ok
        if (self%m == 0) return
        call self%visit(t, q, stat)
        if (stat == status_ok) call self%find_velocity_basis(stat)
        if (stat /= status_ok) return
        if (self%has_bases) call measure_origin(self)
        call self%measure_split()
        if (allocated(self%dropped)) then
            call self%complete_velocity_basis(stat)
            if (stat /= status_ok) return
            do i = 1, size(self%dropped)
                associate (row => self%model%all_rows%jacobian(self%dropped(i), :), d => self%velocity_basis%null_space)
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
        fall = self%last_independence - self%velocity_basis%independence
        falls = .not. self%velocity_basis%independence > horizon*fall
        if (falls .or. self%velocity_basis%orientation /= self%origin_orientation) then
            if (.not. keeps_rank(self, self%step_jacobian, self%model%terms%jacobian)) stat = status_rank_deficient
        end if
        if (stat == status_ok) then
            call find_massless(self)
            if (self%n_massless > 0 .and. .not. self%best_tie > 0.0_wp) call weigh_rows(self, self%step_jacobian)
            if (.not. keeps_ties(self, self%step_jacobian, self%model%terms%jacobian)) stat = status_singular_mass
        end if
        if (stat /= status_ok) then
            ! A shorter step will be compared with the same start.
            call look_within(self, t_from, q_from, t, q, stat)
            return
        end if
        self%origin_orientation = self%velocity_basis%orientation
        self%last_independence = self%velocity_basis%independence
        call measure_ties(self, horizon, room)
        if (.not. falls) return
        call self%row_space%find_weakest(self%m, self%n, self%step_jacobian, self%scale, self%x, smallest_before)
        call self%row_space%find_weakest(self%m, self%n, self%model%terms%jacobian, self%scale, self%x, smallest)
        if (smallest_before > smallest) room = min(room, smallest/(smallest_before - smallest))
        self%fallen = smallest/max(self%best_independence, tiny(1.0_wp))
        if (room <= horizon) call self%blame_dependent(0)
    end procedure measure_rank

    module procedure inherit
        self%best_independence = max(self%best_independence, other%best_independence)
        select type (other)
        class is (dense_chart_type)
            if (size(other%tie_weight) /= size(self%tie_weight) .or. .not. other%best_tie > 0.0_wp) return
            self%best_tie = other%best_tie
            self%tie_weight = other%tie_weight
        end select
    end procedure inherit

    !> How many steps as the last one the constraints are away from no longer tying a coordinate without mass, where they hardly do.
    subroutine measure_ties(self, horizon, room)
        class(dense_chart_type), intent(inout) :: self
        real(wp), intent(in) :: horizon
        !> Replaced where it is less.
        real(wp), intent(inout) :: room
        !> Squares are looked at more closely below this part of the largest so far.
        real(wp), parameter :: loose = 1.0e-4_wp
        real(wp) :: before, after
        logical :: keeps

        if (self%n_massless == 0) return
        if (.not. self%weakest_tie < loose*self%best_tie) then
            self%best_tie = max(self%best_tie, self%weakest_tie)
            return
        end if
        ! Columns that have turned far have small pivots too; these are those of A' A.
        associate (m => self%m, n => self%n, k => self%n_massless, from => self%step_jacobian, to => self%model%terms%jacobian)
            call compare_columns(m, n, k, self%massless, self%scale, from, from, self%ties, self%tied, self%tie_weight, &
                self%loosest, before, keeps)
            call compare_columns(m, n, k, self%massless, self%scale, to, to, self%ties, self%tied, self%tie_weight, &
                self%loosest, after, keeps)
        end associate
        before = sqrt(max(before, 0.0_wp))
        after = sqrt(max(after, 0.0_wp))
        self%loosened = after/sqrt(self%best_tie)
        self%failed_coordinate = self%loosest
        if (after < horizon*(before - after)) room = min(room, max(after/(before - after), tiny(1.0_wp)))
    end subroutine measure_ties

    !> Between the ends of a step C seems to have lost what it has to keep. Find where, on the straight way, or that it has merely
    !> turned: then both parts of the way keep it, and only a shorter step could tell what has happened.
    subroutine look_within(self, t_from, q_from, t, q, stat)
        class(dense_chart_type), intent(inout) :: self
        real(wp), intent(in) :: t_from, t
        real(wp), intent(in), contiguous :: q_from(:), q(:)
        !> The loss, replaced by `chart_left` where it is none.
        integer, intent(inout) :: stat
        integer, parameter :: most_halvings = 12
        real(wp), allocatable :: near(:, :), middle(:, :), far(:, :)
        real(wp) :: from, to, at
        integer :: k, stat_there

        allocate (near, source=self%step_jacobian)
        allocate (far, middle, source=self%model%terms%jacobian)
        from = 0.0_wp
        to = 1.0_wp
        do k = 1, most_halvings
            at = 0.5_wp*(from + to)
            self%trial = q_from + at*(q - q_from)
            call self%move_to(t_from + at*(t - t_from), self%trial, stat_there)
            if (stat_there /= status_ok) exit
            middle = self%model%terms%jacobian
            if (loss_between(self, near, middle) /= status_ok) then
                to = at
                far = middle
            else if (loss_between(self, middle, far) /= status_ok) then
                from = at
                near = middle
            else
                stat = status_chart_left
                self%failed_coordinate = 0
                return
            end if
        end do
        if (stat == status_rank_deficient) call self%blame_dependent(0)
    end subroutine look_within

    !> What C has lost from one point to a neighbouring one: its rank, or that of its columns of the coordinates without mass.
    integer function loss_between(self, from, to) result(loss)
        class(dense_chart_type), intent(inout) :: self
        !> C at the two points (m, n).
        real(wp), intent(in) :: from(:, :), to(:, :)

        loss = status_ok
        if (.not. keeps_rank(self, from, to)) then
            loss = status_rank_deficient
        else if (.not. keeps_ties(self, from, to)) then
            loss = status_singular_mass
        end if
    end function loss_between

    !> Whether the rows of C have kept their orientation.
    logical function keeps_rank(self, from, to)
        class(dense_chart_type), intent(inout) :: self
        real(wp), intent(in) :: from(:, :), to(:, :)

        keeps_rank = self%row_space%keeps_orientation(self%m, self%n, from, to, self%scale)
    end function keeps_rank

    !> Whether the columns of C that belong to the coordinates without mass have kept theirs: det(A' B) of these is positive.
    !> `loosest` is then the coordinate of the smallest pivot, `weakest_tie` that pivot: where the columns hardly differ, about the
    !> square of their smallest singular value.
    logical function keeps_ties(self, from, to)
        class(dense_chart_type), intent(inout) :: self
        real(wp), intent(in) :: from(:, :), to(:, :)

        call compare_columns(self%m, self%n, self%n_massless, self%massless, self%scale, from, to, self%ties, self%tied, &
            self%tie_weight, self%loosest, self%weakest_tie, keeps_ties)
        if (.not. keeps_ties) self%failed_coordinate = self%loosest
    end function keeps_ties

    !> What the rows weigh where ties are compared: 1 over their squared lengths in scaled unknowns at the first point of a run, so
    !> that their units do not matter.
    pure subroutine weigh_rows(self, jacobian)
        class(dense_chart_type), intent(inout) :: self
        real(wp), intent(in) :: jacobian(:, :)
        integer :: j

        self%tie_weight = 0.0_wp
        do j = 1, self%n
            self%tie_weight = self%tie_weight + (self%scale(j)*jacobian(:, j))**2
        end do
        self%tie_weight = 1.0_wp/max(self%tie_weight, tiny(1.0_wp))
    end subroutine weigh_rows

    !> The coordinates without mass at the current point: a zero on the diagonal of M, which has no negative eigenvalue.
    pure subroutine find_massless(self)
        class(dense_chart_type), intent(inout) :: self
        integer :: i

        self%n_massless = 0
        do i = 1, self%n
            if (abs(self%model%terms%mass(i, i)) > 0.0_wp) cycle
            self%n_massless = self%n_massless + 1
            self%massless(self%n_massless) = i
        end do
        ! More than there are constraints cannot be tied, which the factors of D' M D tell.
        if (self%n_massless > self%m) self%n_massless = 0
    end subroutine find_massless

    !> Whether det(A' W B) of some columns of two matrices is positive, and the smallest pivot of an elimination, with weights W of
    !> rows and scaled unknowns. Near each other, A and B have pivots as those of A' A, which need no exchange of rows.
    pure subroutine compare_columns(m, n, k, columns, scale, a, b, product, weighted, weight, weakest, smallest, is_positive)
        !> Rows, columns, those to compare and their numbers.
        integer, intent(in) :: m, n, k, columns(n)
        !> Scales of the unknowns, A and B.
        real(wp), intent(in) :: scale(n), a(m, n), b(m, n)
        !> Work space: A' W B, and W A, transposed, so that the innermost loops run along columns, in registers: columns are few as
        !> a rule. What the rows weigh.
        real(wp), intent(inout) :: product(m + short, m), weighted(m + short, m)
        real(wp), intent(in) :: weight(m)
        !> The column of the smallest pivot, a negative one before all others, and that; 0 and huge where there are no columns.
        integer, intent(out) :: weakest
        real(wp), intent(out) :: smallest
        logical, intent(out) :: is_positive
        real(wp) :: sums(short), f
        integer :: i, j, l, s

        weakest = 0
        smallest = huge(1.0_wp)
        is_positive = .true.
        if (k == 0) return
        !GCC$ NOVECTOR
        do i = 1, k
            f = scale(columns(i))
            !GCC$ NOVECTOR
            !GCC$ UNROLL 1
            do l = 1, m
                weighted(i, l) = f*weight(l)*a(l, columns(i))
            end do
        end do
        do j = 1, k
            do s = 0, k - 1, short
                do i = 1, short
                    sums(i) = 0.0_wp
                end do
                !GCC$ NOVECTOR
                !GCC$ UNROLL 1
                do l = 1, m
                    f = b(l, columns(j))
                    !GCC$ UNROLL 1
                    do i = 1, short
                        sums(i) = sums(i) + weighted(s + i, l)*f
                    end do
                end do
                f = scale(columns(j))
                !GCC$ UNROLL 1
                do i = 1, short
                    product(s + i, j) = f*sums(i)
                end do
            end do
        end do
        do l = 1, k
            if (product(l, l) < smallest) then
                smallest = product(l, l)
                weakest = columns(l)
            end if
            if (product(l, l) < 0.0_wp) is_positive = .not. is_positive
            if (.not. abs(product(l, l)) > 0.0_wp) exit
            do j = l + 1, k
                f = product(l, j)/product(l, l)
                do i = l + 1, k
                    product(i, j) = product(i, j) - product(i, l)*f
                end do
            end do
        end do
    end subroutine compare_columns

    module procedure measure_split
        if (self%velocity_basis%is_measured) return
        call self%velocity_basis%measure_orientation()
        if (.not. self%has_bases) call self%free_motion%find_independence(self%velocity_basis%elimination, &
            self%velocity_basis%independence)
    end procedure measure_split

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

    !> What C loses on the straight way ahead of a state, soon enough for that way to mean something.
    module procedure loss_ahead
        !> Halvings of the way; how much C may change until the loss.
        integer, parameter :: most_halvings = 12
        real(wp), parameter :: largest_change = 0.5_wp
        real(wp), allocatable :: here(:, :)
        real(wp) :: near, far, middle
        integer :: k, loss, stat

        loss_ahead = status_ok
        if (self%m == 0) return
        call self%move_to(t, q, stat)
        if (stat /= status_ok) return
        call find_massless(self)
        if (self%n_massless > 0 .and. .not. self%best_tie > 0.0_wp) call weigh_rows(self, self%model%terms%jacobian)
        allocate (here, source=self%model%terms%jacobian)
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
        if (keeps_until(far)) return
        if (.not. change_from(self, here) <= largest_change) return
        loss_ahead = loss
        if (loss == status_rank_deficient) call self%blame_dependent(0)

    contains

        !> Whether nothing is lost yet; what cannot be evaluated counts as no loss.
        logical function keeps_until(ahead)
            real(wp), intent(in) :: ahead

            self%trial = q + ahead*qd
            call self%move_to(t + ahead, self%trial, stat)
            loss = status_ok
            if (stat == status_ok) loss = loss_between(self, here, self%model%terms%jacobian)
            keeps_until = loss == status_ok
        end function keeps_until
    end procedure loss_ahead

    !> How far C has changed from the start of the step to the current point.
    module procedure relative_change
        relative_change = change_from(self, self%step_jacobian)
    end procedure relative_change

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

    module procedure blame_dependent
        !> Smaller parts of the combination are not named.
        real(wp), parameter :: smallest_part = 0.01_wp
        real(wp) :: share(self%m), smallest
        integer :: i

        call self%row_space%find_weakest(self%m, self%n, self%model%terms%jacobian, self%scale, share, smallest)
        if (row > 0) share(row) = 1.0_wp
        call self%blame(merge(row, maxloc(abs(share), dim=1), row > 0), smallest)
        self%failed_rows = pack([(i, i=1, self%m)], abs(share) > smallest_part)
        if (allocated(self%dropped)) self%failed_rows = self%model%kept(self%failed_rows)
    end procedure blame_dependent
end submodule tandem_chart_dense_rank
