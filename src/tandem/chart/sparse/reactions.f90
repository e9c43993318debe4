! SPDX-License-Identifier: MIT
!> Reactions at the last point of a sparse system: multipliers and friction on reactions.
submodule(tandem_chart_sparse_system) tandem_chart_sparse_reactions
    implicit none (type, external)

contains

    module procedure balance
        integer, parameter :: most = 8
        real(wp) :: moved(size(force)), left(size(force)), more(size(self%z))
        real(wp), parameter :: rest = 1.0e-14_wp
        integer :: b, first, i, last, n, pass, stat

        lambda = 0.0_wp
        associate (a => self%analysis, factor => self%factor(self%here))
            self%g(:) = 0.0_wp
            call self%solve_here(force, self%g, self%x, self%z, rest, .false., stat)
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
    end procedure balance

    module procedure add_friction
        real(wp), parameter :: rest = 1.0e-14_wp
        real(wp) :: qdd(size(self%q_point)), lambda(self%m)
        integer :: j

        stat = status_ok
        if (self%normal_forces%n == 0 .or. self%has_friction) return
        call self%model%find_directions(self%t_point, self%q_point, self%qd_point, stat)
        if (stat /= status_ok) return
        self%g(:) = -self%model%terms%gamma
        call self%solve_here(self%model%terms%force, self%g, qdd, self%z, rest, .false., stat)
        if (stat /= status_ok) return
        call self%find_multipliers(qdd, lambda)
        self%normal_forces%first(:) = lambda
        do j = 1, self%normal_forces%n
            qdd = self%model%directions(:, j)
            call self%balance(qdd, lambda)
            self%normal_forces%reach(:, j) = lambda
        end do
        call self%normal_forces%add_force(self%model, stat)
        self%has_friction = stat == status_ok
    end procedure add_friction
end submodule tandem_chart_sparse_reactions
