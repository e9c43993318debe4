! SPDX-License-Identifier: MIT
!> Breakpoints of a mechanism: the kinks of its functions of time, laws and expressions are found as a run proceeds, for each from
!> the time its own search has reached.
submodule(tandem_mechanism_definition) tandem_mechanism_segments
    use tandem_error, only: set_error, to_text
    use tandem_mechanism_formula, only: formula_type
    use tandem_status, only: status_invalid_model
    implicit none (type, external)

contains

    module procedure begin_breakpoints
        !> Number of searches before a run, in addition to one per function: enough for all kinks of most mechanisms.
        integer, parameter :: some = 16
        integer :: n

        n = size(self%motions) + size(self%at%laws) + size(self%at%formulas)
        if (n == 0 .or. .not. self%times(2) > self%times(1)) return
        self%searched = spread(self%times(1), 1, n)
        self%state%breakpoints_until = self%times(1)
        allocate (self%breakpoints(0), self%nu_jumps(0), self%ahead(0), self%jumps_ahead(0))
        call search(self, huge(n), n + some, error)
        if (allocated(error)) return
        if (size(self%breakpoints) > 0 .or. self%state%breakpoints_until < self%times(2)) return
        deallocate (self%breakpoints, self%nu_jumps)
    end procedure begin_breakpoints

    module procedure know_breakpoints
        !> Largest number of searches without a kink, in addition to one per function.
        integer, parameter :: most = 200

        if (.not. allocated(self%searched) .or. .not. allocated(self%breakpoints)) return
        if (size(self%breakpoints) >= number) return
        call search(self, number, most + size(self%searched), error)
        if (allocated(error)) return
        if (size(self%breakpoints) < number .and. self%state%breakpoints_until < self%times(2)) call set_error(error, &
            status_invalid_model, 'the search for kinks of functions of time from t = '//to_text(self%state%breakpoints_until)// &
            ' on does not end', 'make the argument of abs, sign, step, ramp, min, max or smooth_step slower, or simpler '// &
            'where it is zero for a while')
    end procedure know_breakpoints

    !> Search until a number of breakpoints is known or there are no more.
    subroutine search(self, number, most, error)
        class(definition_type), intent(inout) :: self
        integer, intent(in) :: number
        !> Largest number of searches.
        integer, intent(in) :: most
        type(error_type), allocatable, intent(out) :: error
        real(wp), allocatable :: places(:)
        logical, allocatable :: jumps(:)
        integer :: i, n_searches

        do n_searches = 1, most
            if (size(self%breakpoints) >= number .or. .not. self%state%breakpoints_until < self%times(2)) return
            i = minloc(self%searched, dim=1)
            call search_function(self, i, places, jumps, error)
            if (allocated(error)) return
            self%ahead = [self%ahead, places]
            self%jumps_ahead = [self%jumps_ahead, jumps]
            if (.not. minval(self%searched) > self%state%breakpoints_until) cycle
            self%state%breakpoints_until = minval(self%searched)
            call take_ahead(self)
        end do
    end subroutine search

    !> Search for kinks of one function, from the time reached so far.
    subroutine search_function(self, i, places, jumps, error)
        class(definition_type), intent(inout) :: self
        !> Index among motions, laws and formulas, in this order.
        integer, intent(in) :: i
        !> Kinks, and true for each at which qd jumps.
        real(wp), allocatable, intent(out) :: places(:)
        logical, allocatable, intent(out) :: jumps(:)
        type(error_type), allocatable, intent(out) :: error
        integer, allocatable :: orders(:)
        real(wp) :: from, to

        from = self%searched(i)
        to = self%times(2)
        associate (law => i - size(self%motions), formula => i - size(self%motions) - size(self%at%laws))
            if (formula > 0) then
                call self%at%formulas(formula)%pieces%find_kinks(from, to, places, orders, error)
            else if (law > 0) then
                call self%at%laws(law)%law%find_kinks(from, to, places, orders, error)
            else
                call self%motions(i)%f%find_kinks(from, to, places, orders, error)
            end if
            if (allocated(error)) return
            allocate (jumps(size(places)), source=.false.)
            self%searched(i) = to
            if (law > 0) return
        end associate
        associate (motion => self%motions(i))
            jumps = orders == motion%jump_order
            if (any(orders < motion%jump_order)) call set_error(error, status_invalid_model, 'the motion of '// &
                trim(motion%name)//' is discontinuous at t = '//to_text(places(findloc(orders < motion%jump_order, .true., &
                dim=1))), 'make it continuous, as by smooth_step instead of step')
        end associate
    end subroutine search_function

    !> Move the kinks that no unknown kink can precede to the breakpoints, in their order. Kinks that differ by rounding only are
    !> merged.
    subroutine take_ahead(self)
        class(definition_type), intent(inout) :: self
        real(wp), parameter :: rounding = 64*epsilon(1.0_wp)
        integer, allocatable :: order(:)
        real(wp), allocatable :: places(:)
        logical, allocatable :: jumps(:)
        integer :: i, n

        order = pack([(i, i=1, size(self%ahead))], self%ahead <= self%state%breakpoints_until)
        call sort(order)
        allocate (places(size(order)), source=self%ahead(order))
        allocate (jumps(size(order)), source=self%jumps_ahead(order))
        n = 0
        do i = 1, size(order)
            if (.not. places(i) < self%times(2)) exit
            if (n > 0) then
                if (places(i) - places(n) <= rounding*max(abs(places(i)), rounding*maxval(abs(self%times)))) then
                    jumps(n) = jumps(n) .or. jumps(i)
                    cycle
                end if
            end if
            n = n + 1
            places(n) = places(i)
            jumps(n) = jumps(i)
        end do
        self%breakpoints = [self%breakpoints, places(:n)]
        self%nu_jumps = [self%nu_jumps, jumps(:n)]
        self%jumps_ahead = pack(self%jumps_ahead, self%ahead > self%state%breakpoints_until)
        self%ahead = pack(self%ahead, self%ahead > self%state%breakpoints_until)

    contains

        !> Merge sort.
        recursive subroutine sort(order)
            integer, intent(inout) :: order(:)
            integer :: left(size(order)/2), i, j, k

            if (size(order) < 2) return
            call sort(order(:size(left)))
            call sort(order(size(left) + 1:))
            left = order(:size(left))
            i = 1
            j = size(left) + 1
            do k = 1, size(order)
                if (i > size(left)) exit
                if (j <= size(order)) then
                    if (self%ahead(order(j)) < self%ahead(left(i))) then
                        order(k) = order(j)
                        j = j + 1
                        cycle
                    end if
                end if
                order(k) = left(i)
                i = i + 1
            end do
        end subroutine sort
    end subroutine take_ahead

    module procedure hold_pieces
        real(wp) :: ends(2), t
        integer :: i

        if (.not. allocated(self%breakpoints)) return
        ends = self%times
        if (self%segment > 1) ends(1) = self%breakpoints(self%segment - 1)
        if (self%segment <= size(self%breakpoints)) ends(2) = self%breakpoints(self%segment)
        t = sum(ends)/2
        do i = 1, size(self%motions)
            call self%motions(i)%f%hold(t)
        end do
        do i = 1, size(self%at%laws)
            call self%at%laws(i)%law%hold(t)
        end do
        do i = 1, size(self%at%formulas)
            call self%at%formulas(i)%pieces%select_piece(t)
        end do
    end procedure hold_pieces

    module procedure pieces_hide
        integer :: i

        pieces_hide = .false.
        do i = 1, size(self%motions)
            pieces_hide = self%motions(i)%f%hides(from, to, between, self%motions(i)%jump_order > 0)
            if (pieces_hide) return
        end do
        do i = 1, size(self%at%laws)
            pieces_hide = self%at%laws(i)%law%hides(from, to, between)
            if (pieces_hide) return
        end do
        do i = 1, size(self%at%formulas)
            pieces_hide = self%at%formulas(i)%pieces%hides(from, to, between, .false.)
            if (pieces_hide) return
        end do
    end procedure pieces_hide
end submodule tandem_mechanism_segments
