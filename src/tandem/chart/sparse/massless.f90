! SPDX-License-Identifier: MIT
!> Coordinates without mass of a sparse system.
!>
!> In the factors such a coordinate has a small mass, so that each body can be eliminated first. A solution with the factor
!> satisfies the constraints, and its error is small because the mass is: conjugate gradients that are preconditioned by the
!> factor remove it, each step by the ratio of the added mass to the mass that the constraints give the coordinate.
submodule(tandem_chart_sparse_system) tandem_chart_sparse_massless
    use tandem_chart_sparse_progress, only: largest_part
    implicit none (type, external)

contains

    module procedure invert_masses
        if (.not. allocated(self%massless)) call self%find_massless()
        call set_masses(1.0_wp)
        call self%factor(self%here)%invert_masses(self%analysis, self%pattern%mass_width, self%model%terms%mass, stat)
        call set_masses(0.0_wp)

    contains

        subroutine set_masses(part)
            real(wp), intent(in) :: part
            integer :: i

            do i = 1, self%n_massless
                associate (j => self%massless(i))
                    self%model%terms%mass(j, self%pattern%mass_column(j)) = part*self%added(i)
                end associate
            end do
        end subroutine set_masses
    end procedure invert_masses

    module procedure find_massless
        !> Part of the mass of the nearest bodies. A smaller one costs fewer steps and loses digits of the factor.
        real(wp), parameter :: part = 1.0e-4_wp
        logical :: has_mass(size(self%q_point)), is_known(self%pattern%n_bodies), was_known(self%pattern%n_bodies)
        real(wp) :: given(size(self%q_point)), least
        integer :: b, i, j, k, last, row

        associate (mass => self%model%terms%mass, a => self%analysis, p => self%pattern, scale => self%scale)
            ! The largest entry of the block on the scales of its coordinates.
            given = 0.0_wp
            j = 1
            do while (j <= size(scale))
                last = j
                do while (last < size(scale))
                    if (a%block_first(last + 1) /= j) exit
                    last = last + 1
                end do
                do i = j, last
                    given(j:last) = max(given(j:last), abs(mass(i, p%mass_column(i)))*scale(i)**2)
                end do
                j = last + 1
            end do
            has_mass = given > 0.0_wp
            do b = 1, p%n_bodies
                is_known(b) = all(has_mass(p%first(b):p%first(b + 1) - 1))
            end do
            ! Bodies with rows in common, from those with mass on: bodies of equal size exchange the masses of equal coordinates.
            do
                was_known = is_known
                do row = 1, p%n_rows
                    associate (bodies => p%row_body(p%row_start(row):p%row_start(row + 1) - 1))
                        do i = 1, size(bodies)
                            if (was_known(bodies(i))) cycle
                            do k = 1, size(bodies)
                                if (was_known(bodies(k))) call take(bodies(i), bodies(k))
                            end do
                        end do
                    end associate
                end do
                if (all(is_known .eqv. was_known)) exit
            end do
            least = 1.0_wp
            if (any(has_mass)) least = minval(given, has_mass)
            where (.not. given > 0.0_wp) given = least
            self%massless = pack([(j, j=1, size(has_mass))], .not. has_mass)
            self%n_massless = size(self%massless)
            self%added = part*given(self%massless)/scale(self%massless)**2
            self%history%qdd = spread(0.0_wp*self%added, 2, 2)
            self%history%t = 0.0_wp
            if (.not. any(has_mass) .or. .not. all(given <= huge(1.0_wp))) self%n_massless = 0
        end associate
        call allocate_work(self)

    contains

        !> The smallest masses of the neighbours.
        subroutine take(one, other)
            integer, intent(in) :: one, other
            real(wp) :: of_other
            integer :: at, from

            associate (first => self%pattern%first)
                do at = first(one), first(one + 1) - 1
                    if (has_mass(at)) cycle
                    from = first(other) + at - first(one)
                    if (first(one + 1) - first(one) == first(other + 1) - first(other)) then
                        of_other = given(from)
                    else
                        of_other = minval(given(first(other):first(other + 1) - 1))
                    end if
                    if (.not. given(at) > 0.0_wp .or. of_other < given(at)) given(at) = of_other
                end do
            end associate
            is_known(one) = .true.
        end subroutine take
    end procedure find_massless

    !> Allocate the work space of the iteration.
    subroutine allocate_work(self)
        class(system_type), intent(inout) :: self

        if (allocated(self%step)) deallocate (self%step, self%direction, self%left, self%no_rows, self%more, self%change, &
            self%unbalanced, self%moved, self%guess)
        if (self%n_massless == 0) return
        associate (n => size(self%scale))
            allocate (self%step(n), self%direction(n), self%left(n), self%no_rows(self%m), self%more(size(self%z)), &
                self%change(size(self%z)), self%unbalanced(self%n_massless), self%moved(self%n_massless), &
                self%guess(self%n_massless), source=0.0_wp)
        end associate
    end subroutine allocate_work

    module procedure check_massless
        real(wp), parameter :: rest = 1.0e-6_wp
        real(wp) :: force(size(self%q_point)), no_rows(self%m), x(size(self%q_point))
        integer :: i

        self%determines_massless = self%n_massless == 0
        if (self%determines_massless) return
        ! Forces in no particular direction.
        force = 0.0_wp
        no_rows = 0.0_wp
        do i = 1, self%n_massless
            force(self%massless(i)) = self%added(i)/self%scale(self%massless(i))*cos(real(i, wp)**2)
        end do
        call self%solve_here(force, no_rows, x, self%z, rest, .false., stat)
        self%determines_massless = stat == status_ok
    end procedure check_massless

    module procedure solve_here
        !> Steps near a point where no constraint determines a coordinate, and the ratio of masses of such a point.
        integer, parameter :: most = 60
        real(wp), parameter :: largest_ratio = 1.0e12_wp
        !> Larger errors that do not decrease are not rounding.
        real(wp), parameter :: largest_rounding = 1.0e-9_wp, slow = 0.3_wp
        !> Rounding error of a step relative to it, and that of a solution: the factor loses the digits of the small mass.
        real(wp), parameter :: rounding = 1.0e-8_wp, of_solution = 1.0e-12_wp
        real(wp) :: before, curvature, expected, last, least, part, product, rest
        integer :: k

        stat = status_ok
        associate (factor => self%factor(self%here), a => self%analysis, d => self%step, direction => self%direction, &
            left => self%left, unbalanced => self%unbalanced, moved => self%moved, more => self%more, change => self%change)
            if (self%n_massless == 0) then
                call factor%solve(a, .true., f, g, x, z)
                return
            end if
            call keep_history(self)
            left(:) = f
            self%no_rows(:) = 0.0_wp
            self%guess(:) = 0.0_wp
            if (is_acceleration) call add_guess(self)
            call factor%solve(a, .true., left, g, x, z)
            if (largest_rest < of_solution) then
                ! Rounding of C x, which a later correction would turn into unbalanced forces.
                self%no_rows(:) = g
                call factor%multiply(a, x, self%no_rows)
                call factor%solve(a, .false., left, self%no_rows, d, more)
                x(:) = x + d
                z(:) = z + more
                self%no_rows(:) = 0.0_wp
            end if
            ! The solution balances f but for the forces of the added mass, apart from reactions, which do no work in the null
            ! space: so the iteration needs the unbalanced forces of these coordinates alone, without their rounding.
            unbalanced(:) = self%added*(x(self%massless) - self%guess)
            left(:) = 0.0_wp
            ! With the largest ratio, a step of this size is negligible; its direction is rounding.
            least = sum(self%added*(largest_rest/largest_ratio*self%rate**2*self%scale(self%massless))**2)
            before = 1.0_wp
            last = 0.0_wp
            do k = 1, most
                left(self%massless) = unbalanced
                if (k == 1) then
                    call factor%solve(a, .true., left, self%no_rows, direction, change)
                    product = sum(unbalanced*direction(self%massless))
                else
                    call factor%solve(a, .true., left, self%no_rows, d, more)
                    product = sum(unbalanced*d(self%massless))
                end if
                if (.not. product > least) exit
                ! A solution d for u has the forces M d = u - A d.
                if (k == 1) then
                    moved(:) = unbalanced - self%added*direction(self%massless)
                else
                    part = product/before
                    call scale_and_add(size(d), part, d, direction)
                    call scale_and_add(size(more), part, more, change)
                    moved(:) = (unbalanced - self%added*d(self%massless)) + part*moved
                end if
                curvature = sum(direction(self%massless)*moved)
                if (.not. curvature*largest_ratio > sum(self%added*direction(self%massless)**2)) stat = status_singular_mass
                if (stat /= status_ok) exit
                part = product/curvature
                rest = part*largest_part(size(x), direction, x, self%scale, self%rate**2)
                if (k > 1) self%history%reduction = min(max(rest/last, rounding), 1.0_wp)
                if (k > 1 .and. rest <= rounding*last) exit
                call add_scaled(size(x), part, direction, x)
                call add_scaled(size(z), part, change, z)
                unbalanced(:) = unbalanced - part*moved
                ! The refinement below reduces the error once more.
                expected = rest*self%history%reduction
                if (largest_rest < of_solution) expected = expected*self%history%reduction
                if (expected <= largest_rest) exit
                if (k > 1 .and. rest <= largest_rounding .and. rest > slow*last) exit
                before = product
                last = rest
            end do
            if (k > most) stat = status_singular_mass
            if (stat /= status_ok) factor%failed_coordinate = &
                self%massless(maxloc(self%added*direction(self%massless)**2, dim=1))
            if (stat == status_ok .and. largest_rest < of_solution) then
                call factor%find_unbalanced(a, self%model%terms%mass, f, x, z, left)
                call factor%solve(a, .true., left, self%no_rows, d, more)
                x(:) = x + d
                z(:) = z + more
            end if
            if (is_acceleration .and. stat == status_ok) call note(self, x)
        end associate
    end procedure solve_here

    !> Begin with the acceleration at this time that the last two predict.
    pure subroutine add_guess(self)
        class(system_type), intent(inout) :: self
        real(wp), parameter :: farthest = 2.0_wp
        real(wp) :: ahead, interval
        integer :: i

        associate (qdd => self%history%qdd, times => self%history%t)
            ahead = self%t_point - times(1)
            interval = times(1) - times(2)
            ahead = merge(ahead, 0.0_wp, abs(ahead) < farthest*abs(interval))
            if (abs(ahead) > 0.0_wp) ahead = ahead/interval
            self%guess(:) = qdd(:, 1) + ahead*(qdd(:, 1) - qdd(:, 2))
        end associate
        do i = 1, self%n_massless
            associate (j => self%massless(i))
                self%left(j) = self%left(j) + self%added(i)*self%guess(i)
            end associate
        end do
    end subroutine add_guess

    !> Store the acceleration at the last point. After a failed evaluation the next point needs another guess.
    pure subroutine note(self, x)
        class(system_type), intent(inout) :: self
        real(wp), intent(in), contiguous :: x(:)

        associate (qdd => self%history%qdd, times => self%history%t)
            if (abs(self%t_point - times(1)) > 0.0_wp) then
                qdd(:, 2) = qdd(:, 1)
                times(2) = times(1)
            end if
            qdd(:, 1) = merge(x(self%massless), 0.0_wp, abs(x(self%massless)) <= huge(1.0_wp))
            times(1) = self%t_point
        end associate
    end subroutine note

    !> x := x + part y.
    pure subroutine add_scaled(n, part, y, x)
        integer, intent(in) :: n
        real(wp), intent(in) :: part, y(n)
        real(wp), intent(inout) :: x(n)
        integer :: i

        do i = 1, n
            x(i) = x(i) + part*y(i)
        end do
    end subroutine add_scaled

    !> x := y + part x.
    pure subroutine scale_and_add(n, part, y, x)
        integer, intent(in) :: n
        real(wp), intent(in) :: part, y(n)
        real(wp), intent(inout) :: x(n)
        integer :: i

        do i = 1, n
            x(i) = y(i) + part*x(i)
        end do
    end subroutine scale_and_add

    !> Points between steps leave no trace: put the history aside before the first, and restore it after the last.
    pure subroutine keep_history(self)
        class(system_type), intent(inout) :: self

        if (self%is_held .eqv. self%kept_history%is_kept) return
        if (self%is_held) then
            self%kept_history = self%history
        else
            self%history = self%kept_history
        end if
        self%kept_history%is_kept = self%is_held
    end subroutine keep_history

    module procedure pack_massless
        call keep_history(self)
        call pack%item(self%massless)
        call pack%item(self%added)
        call pack%item(self%history%qdd)
        call pack%item(self%history%t(1), self%history%t(2))
        call pack%item(self%history%reduction)
        call pack%item(self%determines_massless)
        if (.not. allocated(self%massless)) return
        self%n_massless = size(self%massless)
        call allocate_work(self)
    end procedure pack_massless
end submodule tandem_chart_sparse_massless
