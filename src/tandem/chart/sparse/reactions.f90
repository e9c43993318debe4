! SPDX-License-Identifier: MIT
!> Reactions at the last point of a sparse system: multipliers, friction on reactions, coordinates without mass.
submodule(tandem_chart_sparse_system) tandem_chart_sparse_reactions
    implicit none (type, external)

contains

    module procedure invert_masses
        if (.not. allocated(self%update%coordinates)) call self%find_massless()
        call set_masses(1.0_wp)
        call self%factor(self%here)%invert_masses(self%analysis, self%pattern%mass_width, self%model%terms%mass, stat)
        call set_masses(0.0_wp)

    contains

        subroutine set_masses(part)
            real(wp), intent(in) :: part
            integer :: i

            do i = 1, size(self%update%coordinates)
                associate (j => self%update%coordinates(i))
                    self%model%terms%mass(j, self%pattern%mass_column(j)) = part*self%update%added(i)
                end associate
            end do
        end subroutine set_masses
    end procedure invert_masses

    module procedure find_massless
        !> More take too long; the factor then reports them.
        integer, parameter :: most = 40
        logical :: has_mass(size(self%q_point))
        integer, allocatable :: massless(:)
        real(wp) :: scale(size(self%q_point)), total
        integer :: i, j

        has_mass = .false.
        scale = self%source%scales()
        total = 0.0_wp
        associate (mass => self%model%terms%mass, first => self%analysis%block_first)
            do j = 1, size(has_mass)
                associate (entry => mass(j, self%pattern%mass_column(j)))
                    total = total + abs(entry)*scale(j)**2
                    if (.not. abs(entry) > 0.0_wp) cycle
                end associate
                do i = first(j), size(has_mass)
                    if (first(i) /= first(j)) exit
                    has_mass(i) = .true.
                end do
            end do
        end associate
        massless = pack([(j, j=1, size(has_mass))], .not. has_mass)
        if (size(massless) > most .or. .not. (total > 0.0_wp .and. total <= huge(total))) massless = [integer ::]
        call self%update%allocate(size(scale), self%m, massless, &
            total/real(max(count(has_mass), 1), wp)/scale(massless)**2, 0)
    end procedure find_massless

    module procedure factor_update
        real(wp) :: force(size(self%q_point)), lambda(self%m)
        integer :: j

        do j = 1, self%update%n
            force = 0.0_wp
            force(self%update%coordinates(j)) = self%update%added(j)
            call self%balance(force, lambda, .false.)
            self%update%x(:, j) = self%x
            self%update%mu(:, j) = lambda
        end do
        call self%update%factor(stat)
        if (stat /= 0) self%factor(self%here)%failed_coordinate = self%update%coordinates(min(stat, self%update%n))
        stat = merge(status_ok, status_singular_mass, stat == 0)
    end procedure factor_update

    module procedure balance
        integer, parameter :: most = 8
        real(wp) :: moved(size(force)), left(size(force)), more(size(self%z))
        integer :: b, first, i, last, n, pass

        lambda = 0.0_wp
        associate (a => self%analysis, factor => self%factor(self%here))
            self%g(:) = 0.0_wp
            call factor%solve(a, .true., force, self%g, self%x, self%z)
            do pass = 2, merge(most, 1, self%serves)
                call factor%find_unbalanced(a, self%model%terms%mass, force, self%x, self%z, left)
                self%g(:) = 0.0_wp
                call factor%multiply(a, self%x, self%g)
                call factor%solve(a, .true., left, self%g, moved, more)
                self%x = self%x + moved
                self%z = self%z + more
                if (maxval(abs(more)) <= 4*epsilon(1.0_wp)*maxval(abs(self%z))) exit
            end do
            do n = 1, a%n_nodes
                if (a%is_body(n)) cycle
                do i = 1, a%height(n)
                    lambda(a%origin(n) + i - 1) = self%z(a%place(n) + i)
                end do
            end do
            ! Owned rows were eliminated with their bodies: they balance the remaining force.
            call self%pattern%multiply_mass(self%model%terms%mass, self%x, moved)
            force = force - moved
            call factor%add_reactions(a, lambda, force)
            do b = 1, a%n_bodies
                if (a%own_row(b) == 0) cycle
                first = a%first(b)
                last = a%first(b + 1) - 1
                lambda(a%own_row(b)) = dot_product(factor%own(first:last), force(first:last))/ &
                    sum(factor%own(first:last)**2)
            end do
        end associate
        if (completes) call self%update%complete(self%x, lambda)
    end procedure balance

    module procedure add_friction
        real(wp) :: qdd(size(self%q_point)), lambda(self%m)
        integer :: j

        stat = status_ok
        if (self%normal_forces%n == 0 .or. self%has_friction) return
        call self%model%find_directions(self%t_point, self%q_point, self%qd_point, stat)
        if (stat /= status_ok) return
        self%g(:) = -self%model%terms%gamma
        call self%factor(self%here)%solve(self%analysis, .true., self%model%terms%force, self%g, qdd, self%z)
        call self%update%complete_motion(qdd)
        call self%find_multipliers(qdd, lambda)
        self%normal_forces%first(:) = lambda
        do j = 1, self%normal_forces%n
            qdd = self%model%directions(:, j)
            call self%balance(qdd, lambda, .true.)
            self%normal_forces%reach(:, j) = lambda
        end do
        call self%normal_forces%add_force(self%model, stat)
        self%has_friction = stat == status_ok
    end procedure add_friction

    module procedure pack_massless
        integer, allocatable :: coordinates(:)
        real(wp), allocatable :: added(:)

        call pack%item(self%update%coordinates)
        call pack%item(self%update%added)
        if (.not. allocated(self%update%coordinates)) return
        if (pack%is_reading) then
            allocate (coordinates, source=self%update%coordinates)
            allocate (added, source=self%update%added)
            call self%update%allocate(size(self%q_point), self%m, coordinates, added, 0)
        end if
        call self%update%pack_state(pack)
    end procedure pack_massless
end submodule tandem_chart_sparse_reactions
