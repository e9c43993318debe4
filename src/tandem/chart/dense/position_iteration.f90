! SPDX-License-Identifier: MIT
!> Newton's iteration for u, and its vector operations.
submodule(tandem_chart_dense_position) tandem_chart_dense_position_iteration
    implicit none (type, external)

contains

    module procedure restore
        self%failed_row = 0
        if (self%nh == 0) then
            stat = status_ok
            call add(self%n, origin, increment, q)
        else if (self%width == short) then
            ! Calls with a constant length for the common cases.
            call iterate(self, short, model, t, origin, increment, goal, q, counts, stat)
        else if (self%width == lane) then
            call iterate(self, lane, model, t, origin, increment, goal, q, counts, stat)
        else
            call iterate(self, self%width, model, t, origin, increment, goal, q, counts, stat)
        end if
    end procedure restore

    !> Newton's iteration for a given padded length.
    subroutine iterate(self, width, model, t, origin, increment, goal, q, counts, stat)
        class(position_type), intent(inout) :: self
        integer, intent(in), value :: width
        type(evaluator_type), intent(inout) :: model
        real(wp), intent(in) :: t, origin(self%n), increment(self%n)
        type(goal_type), intent(in) :: goal
        real(wp), intent(out) :: q(self%n)
        type(counts_type), intent(inout) :: counts
        integer, intent(out) :: stat
        !> A contraction by 0.5 goes from 1 to 1e-12 in 40 corrections; slower iterations have left the chart.
        integer, parameter :: limit = 40
        !> The last correction is assumed to leave at most this times the error expected from its B and the error itself. Of an
        !> earlier estimate this part is kept if the last correction did better: of 190000 unchecked corrections on the scenes the
        !> worst left 4 times the tolerance; without memory it left 38 times the tolerance.
        real(wp), parameter :: distrust = 8.0_wp, kept = 0.5_wp
        real(wp) :: age, error, total, first_error, last_error, utol
        !> B is updated by a correction that has reduced errors by less than this factor, if they are well above rounding.
        real(wp), parameter :: slow = 0.9_wp, noise = 1.0e-10_wp, rounding = 1.0e-15_wp
        logical :: is_predicted, learns, remembers, trusts
        integer :: k

        is_predicted = self%predicts .and. goal%defect < huge(1.0_wp)
        call begin(width, is_predicted, goal%defect, self%prediction%u_start, self%prediction%curvature, self%u, self%first_u)
        remembers = .false.
        if (goal%stage > 0) call expect(self, width, is_predicted, goal%stage, goal%h, remembers)
        first_error = 0.0_wp
        last_error = unknown
        if (self%has_learnt .and. abs(t - self%b_time) > abs(t - self%origin_time)) call self%forget_motion()
        age = abs(t - self%b_time)
        self%n_taken = 0
        utol = merge(self%stage_utol, self%utol, goal%is_stage)
        trusts = goal%is_stage .and. self%predicts
        !GCC$ NOVECTOR
        !GCC$ UNROLL 1
        do k = 0, limit
            call place_of(width, self%n, self%u_basis, self%u, origin, increment, q)
            if (k > 0 .and. trusts) then
                if (distrust*(self%ageing*age + self%b_rest + last_error)*last_error <= utol) then
                    stat = status_ok
                    if (remembers) call remember(self, width, goal%defect, goal%stage, goal%h)
                    return
                end if
            end if
            call model%evaluate_phi(t, q, counts, stat)
            if (stat /= status_ok) then
                self%u = 0.0_wp
                return
            end if
            call measure(self%nh, model%terms%phi, self%weight, error, total)
            ! Later pairs are nearer to rounding, and errors that are zero by rounding carry no information.
            if (k == 1 .and. age > 0.0_wp .and. total <= huge(1.0_wp)) self%ageing = max(max(error, rounding)/(last_error*age), &
                merge(kept*self%ageing, 0.0_wp, self%ageing < unknown))
            if (error <= utol .and. total <= huge(1.0_wp)) then
                if (remembers) call remember(self, width, goal%defect, goal%stage, goal%h)
                return
            end if
            if (.not. total <= huge(1.0_wp)) then
                model%failed_term = 'phi'
                stat = status_not_finite
                self%u = 0.0_wp
                return
            end if
            if (k == 0) then
                first_error = error
            else if (self%has_learnt .and. .not. error < last_error) then
                ! Updates at another point do not apply here.
                call self%forget_motion()
                self%u(:) = self%first_u
                last_error = unknown
                cycle
            end if
            if (k == limit .or. .not. error <= 1.0e3_wp*max(first_error, self%utol)) exit
            if (self%has_gram) then
                learns = error < slow*last_error .and. last_error > noise .and. last_error < unknown
                self%has_learnt = self%has_learnt .or. learns
                call correct_of(width, self%nh, model%terms%phi, self%weight, learns, self%last_phi, self%gram, self%u, &
                    self%correction)
            else if (self%refines) then
                call add_product(self%b%inverse, model%terms%phi, 1.0_wp, self%u(:self%nh))
            else
                self%correction(:self%nh) = model%terms%phi
                call self%lu%solve(self%correction(:self%nh))
                self%u(:self%nh) = self%u(:self%nh) + self%correction(:self%nh)
            end if
            last_error = error
            counts%position_corrections = counts%position_corrections + 1
            self%n_taken = k + 1
            self%most_corrections = max(self%most_corrections, k + 1)
        end do
        stat = status_position_diverged
        self%failed_row = maxloc(abs(model%terms%phi)*self%weight(:self%nh), dim=1)
        self%failed_value = maxval(abs(model%terms%phi)*self%weight(:self%nh))
        ! No part of a failed iteration may enter the next step.
        self%u = 0.0_wp
        if (self%has_learnt) call self%forget_motion()
    end subroutine iterate

    !> The first u of an iteration, predicted if possible.
    pure subroutine begin(width, is_predicted, defect, u_start, curvature, u, first_u)
        integer, intent(in), value :: width
        logical, intent(in) :: is_predicted
        real(wp), intent(in) :: defect, u_start(width), curvature(width)
        real(wp), intent(inout) :: u(width), first_u(width)
        integer :: b, i

        if (is_predicted) then
            do b = 0, width - short, short
                !GCC$ UNROLL 1
                do i = 1, short
                    u(b + i) = u_start(b + i) - defect*curvature(b + i)
                    first_u(b + i) = u(b + i)
                end do
            end do
        else
            first_u(:) = u
        end if
    end subroutine begin

    !> Add to u the error of its prediction at this stage of the last step, if the step sizes are similar: a part of third order.
    pure subroutine expect(self, width, is_predicted, stage, step, remembers)
        class(position_type), intent(inout) :: self
        integer, intent(in), value :: width
        logical, intent(in) :: is_predicted
        integer, intent(in) :: stage
        real(wp), intent(in) :: step
        !> True if the error of this stage is to be stored.
        logical, intent(out) :: remembers
        real(wp), parameter :: alike = 4.0_wp
        real(wp) :: f
        integer :: b, i

        remembers = is_predicted .and. stage <= most_stages
        if (.not. remembers) return
        f = self%prediction%step(stage, self%prediction%known)
        if (.not. step < alike*f) return
        f = (step/f)**3
        do b = 0, width - short, short
            !GCC$ UNROLL 1
            do i = 1, short
                self%u(b + i) = self%u(b + i) + f*self%prediction%missed(b + i, stage, self%prediction%known)
            end do
        end do
    end subroutine expect

    !> Store the error of the prediction, unless it needed no correction.
    pure subroutine remember(self, width, defect, stage, step)
        class(position_type), intent(inout) :: self
        integer, intent(in), value :: width
        real(wp), intent(in) :: defect
        integer, intent(in) :: stage
        real(wp), intent(in) :: step
        integer :: b, i, new

        new = 3 - self%prediction%known
        self%prediction%has_tried = .true.
        self%prediction%step(stage, new) = 0.0_wp
        if (self%n_taken == 0 .and. .not. self%prediction%step(stage, self%prediction%known) > 0.0_wp) return
        self%prediction%step(stage, new) = step
        do b = 0, width - short, short
            !GCC$ UNROLL 1
            do i = 1, short
                self%prediction%missed(b + i, stage, new) = self%u(b + i) - &
                    (self%prediction%u_start(b + i) - defect*self%prediction%curvature(b + i))
            end do
        end do
    end subroutine remember

    !> q := origin + increment - U u. The last entries also fill a register, which overlaps the previous one.
    pure subroutine place_of(width, n, u_basis, u, origin, increment, q)
        integer, intent(in), value :: width
        integer, intent(in) :: n
        real(wp), intent(in) :: u_basis(n, width), u(width), origin(n), increment(n)
        real(wp), intent(out) :: q(n)
        real(wp) :: x(short)
        integer :: first, i, l

        if (n < short) then
            do i = 1, n
                q(i) = (origin(i) + increment(i)) - dot_product(u_basis(i, :), u)
            end do
            return
        end if
        first = 0
        do
            do i = 1, short
                x(i) = origin(first + i) + increment(first + i)
            end do
            do l = 0, width - short, short
                !GCC$ UNROLL 1
                do i = 1, short
                    x(i) = x(i) - ((u_basis(first + i, l + 1)*u(l + 1) + u_basis(first + i, l + 2)*u(l + 2)) + &
                        (u_basis(first + i, l + 3)*u(l + 3) + u_basis(first + i, l + 4)*u(l + 4)))
                end do
            end do
            do i = 1, short
                q(first + i) = x(i)
            end do
            if (first + short == n) exit
            first = min(first + short, n - short)
        end do
    end subroutine place_of

    !> The largest error of the rows of Phi and their sum, which is not finite if one of them is not.
    pure subroutine measure(nh, phi, weight, error, total)
        integer, intent(in) :: nh
        real(wp), intent(in) :: phi(nh), weight(nh)
        real(wp), intent(out) :: error, total
        real(wp) :: e
        integer :: i

        error = 0.0_wp
        total = 0.0_wp
        !GCC$ NOVECTOR
        !GCC$ UNROLL 1
        do i = 1, nh
            e = abs(phi(i))*weight(i)
            total = total + e
            if (e > error) error = e
        end do
    end subroutine measure

    !> u := u + B Phi. With `learns`, B first satisfies the secant condition of the last correction, which has changed Phi by -y:
    !> B := B + w z'/(z'y) with w = B Phi and weighted z = y, which makes it independent of the units of rows (C. G. Broyden,
    !> Math. Comp. 19 (1965) 577-593, his second method). One vector suffices, because w only becomes longer.
    pure subroutine correct_of(width, nh, phi, weight, learns, last_phi, b, u, w)
        integer, intent(in), value :: width
        integer, intent(in) :: nh
        real(wp), intent(in) :: phi(nh), weight(width)
        logical, intent(in) :: learns
        !> Phi before the last correction, then this one, and its change; B; u; work space.
        real(wp), intent(inout) :: last_phi(width, 2), b(width, width), u(width), w(width)
        real(wp) :: along, f, square, y
        integer :: i, j, s

        ! Zeros are written in halves of a register, and a load of the whole register would wait for them: start with a column.
        f = phi(1)
        last_phi(1, 2) = last_phi(1, 1) - f
        last_phi(1, 1) = f
        do s = 0, width - short, short
            !GCC$ UNROLL 1
            do i = 1, short
                w(s + i) = b(s + i, 1)*f
            end do
        end do
        !GCC$ NOVECTOR
        !GCC$ UNROLL 1
        do j = 2, nh
            f = phi(j)
            last_phi(j, 2) = last_phi(j, 1) - f
            last_phi(j, 1) = f
            do s = 0, width - short, short
                !GCC$ UNROLL 1
                do i = 1, short
                    w(s + i) = w(s + i) + b(s + i, j)*f
                end do
            end do
        end do
        f = 1.0_wp
        if (learns) then
            along = 0.0_wp
            square = 0.0_wp
            !GCC$ NOVECTOR
            !GCC$ UNROLL 1
            do j = 1, nh
                y = last_phi(j, 2)
                last_phi(j, 2) = y*weight(j)**2
                along = along + last_phi(j, 2)*phi(j)
                square = square + last_phi(j, 2)*y
            end do
            square = 1.0_wp/square
            !GCC$ NOVECTOR
            !GCC$ UNROLL 1
            do j = 1, nh
                y = last_phi(j, 2)*square
                do s = 0, width - short, short
                    !GCC$ UNROLL 1
                    do i = 1, short
                        b(s + i, j) = b(s + i, j) + w(s + i)*y
                    end do
                end do
            end do
            f = 1.0_wp + along*square
        end if
        do s = 0, width - short, short
            !GCC$ UNROLL 1
            do i = 1, short
                u(s + i) = u(s + i) + w(s + i)*f
            end do
        end do
    end subroutine correct_of

    module procedure place
        call place_of(width, n, u_basis, u, origin, increment, q)
    end procedure place

    module procedure correct
        call correct_of(width, nh, phi, weight, learns, last_phi, b, u, w)
    end procedure correct

    module procedure judge
        real(wp) :: total

        call measure(self%nh, phi, self%weight, error, total)
        if (.not. total <= huge(1.0_wp)) error = total
        self%failed_row = maxloc(abs(phi)*self%weight(:self%nh), dim=1)
    end procedure judge
end submodule tandem_chart_dense_position_iteration
