! SPDX-License-Identifier: MIT
!> Detection of rank loss of C: monitored by quantities of the splitting, decided by singular values and by the orientation of C;
!> likewise the conditioning of the coordinates without mass.
submodule(tandem_chart_dense) tandem_chart_dense_rank
    implicit none (type, external)

contains

    module procedure measure_rank
        !> Largest remainder of a redundant row in the motions that the other rows allow; rounding is far below.
        real(wp), parameter :: largest_rest = 1.0e-6_wp
        !> A loss of rank more steps away than this is not searched for.
        real(wp), parameter :: horizon = 8.0_wp
        real(wp) :: smallest, smallest_before, fall
        logical :: falls
        integer :: i, j

        self%failure%row = 0
        self%failure%coordinate = 0
        stat = status_ok
        if (self%m == 0) return
        call self%visit(t, q, stat)
        if (stat == status_ok) call self%find_velocity_basis(stat)
        if (stat /= status_ok) return
        if (self%mode%has_bases) call measure_origin(self)
        call self%measure_split()
        if (allocated(self%rows%dropped)) then
            call self%complete_velocity_basis(stat)
            if (stat /= status_ok) return
            do i = 1, size(self%rows%dropped)
                associate (row => self%model%all_rows%jacobian(self%rows%dropped(i), :), d => self%velocity_basis%null_space)
                    do j = 1, size(d, 2)
                        if (abs(dot_product(row, d(:, j))) <= largest_rest*norm2(row*self%scale)*norm2(d(:, j)/self%scale)) cycle
                        call self%blame_dependent(0)
                        self%failure%row = self%rows%dropped(i)
                        measure%room = 0.0_wp
                        return
                    end do
                end associate
            end do
        end if
        ! All are available and cheap: the measure that falls towards a loss of rank, the orientation of the pivot columns, and the
        ! change of C. The orientation changes with that of C, and if the pivot columns alone become singular: in a step with both
        ! it is unchanged. A change of C that is smaller than the singular values at both ends together cannot pass a loss.
        fall = self%start%independence - self%velocity_basis%independence
        falls = .not. self%velocity_basis%independence > horizon*fall
        if (falls .or. self%velocity_basis%orientation /= self%start%orientation .or. &
            self%change_from(self%start%jacobian) > self%start%independence + self%velocity_basis%independence) then
            if (.not. keeps_rank(self, self%start%jacobian, self%model%terms%jacobian)) stat = status_rank_deficient
        end if
        if (stat == status_ok) then
            call self%ties%find_massless(self%model%terms%mass)
            if (self%ties%n > 0) then
                call self%ties%weigh_rows(self%start%jacobian, self%scale)
                if (.not. keeps_ties(self, self%start%jacobian, self%model%terms%jacobian)) stat = status_singular_mass
            end if
        end if
        if (stat /= status_ok) then
            ! A shorter step will be compared with the same start.
            call look_within(self, t_from, q_from, t, q, stat)
            return
        end if
        self%start%orientation = self%velocity_basis%orientation
        self%start%independence = self%velocity_basis%independence
        if (self%ties%n > 0) call self%ties%measure(self%start%jacobian, self%model%terms%jacobian, self%scale, horizon, &
            measure%room, measure%loosened, self%failure%coordinate)
        if (.not. falls) return
        call self%row_space%find_weakest(self%m, self%n, self%start%jacobian, self%scale, self%work%x, smallest_before)
        call self%row_space%find_weakest(self%m, self%n, self%model%terms%jacobian, self%scale, self%work%x, smallest)
        if (smallest_before > smallest) measure%room = min(measure%room, smallest/(smallest_before - smallest))
        measure%fallen = smallest/max(self%best_independence, tiny(1.0_wp))
        if (measure%room <= horizon) call self%blame_dependent(0)
    end procedure measure_rank

    module procedure measure_independence
        stat = status_ok
        if (self%m == 0) return
        call self%move_to(t, q, stat)
        if (stat /= status_ok) return
        call self%row_space%find_weakest(self%m, self%n, self%model%terms%jacobian, self%scale, self%work%x, independence)
    end procedure measure_independence

    module procedure inherit
        call self%continue_counts(other%counts, other%best_independence)
        select type (other)
        class is (dense_chart_type)
            call self%ties%inherit(other%ties)
        end select
    end procedure inherit

    !> Between the ends of a step C seems to have lost its rank or its conditioning. Locate the loss on the straight line, or find
    !> that C has merely turned: then both parts of the line are free of losses, and only a shorter step could decide.
    subroutine look_within(self, t_from, q_from, t, q, stat)
        class(dense_chart_type), intent(inout) :: self
        real(wp), intent(in) :: t_from, t
        real(wp), intent(in), contiguous :: q_from(:), q(:)
        !> The loss, replaced by `chart_left` if there is none.
        integer, intent(inout) :: stat
        integer, parameter :: most_halvings = 12
        real(wp), allocatable :: near(:, :), middle(:, :), far(:, :)
        real(wp) :: from, to, at
        integer :: k, stat_there

        allocate (near, source=self%start%jacobian)
        allocate (far, middle, source=self%model%terms%jacobian)
        from = 0.0_wp
        to = 1.0_wp
        do k = 1, most_halvings
            at = 0.5_wp*(from + to)
            self%work%trial = q_from + at*(q - q_from)
            call self%move_to(t_from + at*(t - t_from), self%work%trial, stat_there)
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
                self%failure%coordinate = 0
                return
            end if
        end do
        if (stat == status_rank_deficient) call self%blame_dependent(0)
    end subroutine look_within

    !> Loss of C from one point to a neighbouring one: of its rank, or of the rank of its columns of the coordinates without mass.
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

    !> True if the rows of C have kept their orientation.
    logical function keeps_rank(self, from, to)
        class(dense_chart_type), intent(inout) :: self
        real(wp), intent(in) :: from(:, :), to(:, :)

        keeps_rank = self%row_space%keeps_orientation(self%m, self%n, from, to, self%scale)
    end function keeps_rank

    !> True if C still conditions the coordinates without mass.
    logical function keeps_ties(self, from, to)
        class(dense_chart_type), intent(inout) :: self
        real(wp), intent(in) :: from(:, :), to(:, :)

        call self%ties%compare(from, to, self%scale, keeps_ties)
        if (.not. keeps_ties) self%failure%coordinate = self%ties%loosest
    end function keeps_ties

    module procedure measure_split
        if (self%velocity_basis%is_measured) return
        call self%velocity_basis%measure_orientation()
        if (.not. self%mode%has_bases) call self%free_motion%find_independence(self%velocity_basis%elimination, &
            self%velocity_basis%independence)
    end procedure measure_split

    !> The orientation of C and its smallest pivot at the start of the step, if bases are kept: both of C X.
    subroutine measure_origin(self)
        class(dense_chart_type), intent(inout) :: self
        integer :: stat

        call set_product(self%start%jacobian, self%bases%x, self%start%c_x)
        call self%start%lu%factor(self%start%c_x, stat)
        if (stat /= 0) return
        self%start%orientation = self%start%lu%determinant_sign()
        self%start%independence = self%start%lu%smallest_pivot()
    end subroutine measure_origin

    module procedure find_loss_ahead
        !> Halvings of the line; largest change of C until the loss.
        integer, parameter :: most_halvings = 12
        real(wp), parameter :: largest_change = 0.5_wp
        real(wp), allocatable :: here(:, :)
        real(wp) :: near, far, middle
        integer :: k, stat

        loss = status_ok
        if (self%m == 0) return
        call self%move_to(t_from, q_from, stat)
        if (stat /= status_ok) return
        call self%ties%find_massless(self%model%terms%mass)
        call self%ties%weigh_rows(self%model%terms%jacobian, self%scale)
        allocate (here, source=self%model%terms%jacobian)
        near = 0.0_wp
        far = 1.0_wp
        if (keeps_until(far)) return
        do k = 1, most_halvings
            middle = 0.5_wp*(near + far)
            if (keeps_until(middle)) then
                near = middle
            else
                far = middle
            end if
        end do
        if (keeps_until(far)) return
        if (.not. self%change_from(here) <= largest_change) then
            loss = status_ok
            return
        end if
        ! This status refers to a coordinate.
        if (loss == status_singular_mass) self%failure%row = 0
        if (loss == status_rank_deficient) call self%blame_dependent(0)

    contains

        !> True if nothing is lost yet; points that are not evaluable count as no loss.
        logical function keeps_until(ahead)
            !> Part of the line.
            real(wp), intent(in) :: ahead

            self%work%trial = q_from + ahead*(q - q_from)
            call self%move_to(t_from + ahead*(t - t_from), self%work%trial, stat)
            loss = status_ok
            if (stat == status_ok) loss = loss_between(self, here, self%model%terms%jacobian)
            keeps_until = loss == status_ok
        end function keeps_until
    end procedure find_loss_ahead

    module procedure change_from
        integer :: i

        change_from = 0.0_wp
        do i = 1, self%m
            change_from = change_from + sum(((self%model%terms%jacobian(i, :) - other(i, :))*self%scale)**2)/ &
                max(sum((other(i, :)*self%scale)**2), tiny(1.0_wp))
        end do
        change_from = sqrt(change_from)
    end procedure change_from

    module procedure blame_dependent
        !> Smaller parts of the combination are not reported.
        real(wp), parameter :: smallest_part = 0.01_wp
        real(wp) :: share(self%m), smallest
        integer :: i

        call self%row_space%find_weakest(self%m, self%n, self%model%terms%jacobian, self%scale, share, smallest)
        if (row > 0) share(row) = 1.0_wp
        call self%blame(merge(row, maxloc(abs(share), dim=1), row > 0), smallest)
        self%failure%rows = pack([(i, i=1, self%m)], abs(share) > smallest_part)
        if (allocated(self%rows%dropped)) self%failure%rows = self%model%kept(self%failure%rows)
    end procedure blame_dependent
end submodule tandem_chart_dense_rank
