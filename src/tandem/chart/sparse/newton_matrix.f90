! SPDX-License-Identifier: MIT
!> The Newton matrix of implicit stages of a sparse chart, [H, C'; C, 0] with H = M + ha D + ha^2 K, factored by blocks L U: it is
!> not symmetric if there are forces that turn with bodies, friction or control. No basis is formed, and the cost is that of the
!> pattern. Stages that are solved together also have matrices of complex pairs of systems, of the same terms with another ha.
!>
!> A matrix outlives its chart and is reused while C has not turned far. M, C, D and K are stored, so that another ha costs a
!> factorisation and no derivatives. The changes of C and M since are corrected by refinement (`turn`): corrections contract as with
!> the C of the point, up to the third power of the angle.
module tandem_chart_sparse_newton_matrix
    use tandem_chart_sparse_analysis, only: analysis_type
    use tandem_chart_sparse_blocks, only: read_behind
    use tandem_chart_sparse_factor, only: factor_type
    use tandem_chart_sparse_low_rank, only: low_rank_type
    use tandem_chart_sparse_meetings, only: n_of_place
    use tandem_chart_sparse_newton_analysis, only: newton_analysis_type
    use tandem_chart_sparse_newton_factor, only: newton_factor_type, newton_terms_type
    use tandem_chart_sparse_newton_kernels, only: copy
    use tandem_chart_sparse_newton_pair, only: newton_pair_type
    use tandem_kinds, only: wp
    use tandem_model_stiffness, only: stiffness_type
    use tandem_pack, only: pack_type
    use tandem_status, only: status_newton_failed, status_ok
    implicit none (type, external)
    private

    public :: newton_matrix_type

    type :: newton_matrix_type
        type(newton_analysis_type) :: analysis
        !> M, C, D and K of the last `form`.
        type(newton_terms_type) :: terms
        !> Change of C from the point of `form` to the last point of `look_at`.
        type(factor_type) :: turn
        !> ha of the last `factor`, 0 if there is none.
        real(wp) :: ha = 0.0_wp
        type(newton_factor_type), private :: factored
        !> Matrices of complex pairs of systems; of size 0 if stages are solved one by one.
        type(newton_pair_type), allocatable :: pairs(:)
        !> Friction on reactions, of the real system and of the pairs.
        type(low_rank_type), private :: update
        type(low_rank_type), allocatable, private :: update_of_pairs(:)
        !> Coordinates without mass, and their mass in the factors.
        integer, allocatable, private :: massless(:)
        real(wp), allocatable, private :: added(:)
        !> Work space: unknowns of nodes.
        real(wp), allocatable, private :: z(:), w(:)
        integer, private :: n_frictions = 0
    contains
        procedure :: initialize, expect_pairs, form, factor, solve, solve_pair, look_at, turned
        procedure :: tell_massless, set_friction, pack_state
        procedure, private :: factor_update, gather, scatter
    end type newton_matrix_type

contains

    !> Allocate for the chart's analysis and the pairs of bodies that share forces.
    subroutine initialize(self, base, stiffness, mass_width, n_frictions)
        class(newton_matrix_type), intent(inout) :: self
        !> The chart's own analysis.
        type(analysis_type), intent(in) :: base
        !> Built.
        type(stiffness_type), intent(in) :: stiffness
        integer, intent(in) :: mass_width
        !> Number of frictions on reactions.
        integer, intent(in) :: n_frictions

        self%terms%stiffness = stiffness
        call self%analysis%analyse_newton(base, stiffness)
        if (allocated(self%z)) deallocate (self%terms%mass, self%terms%c, self%terms%own, self%z, self%terms%is_out, self%turn%c, &
            self%turn%own, self%pairs, self%update_of_pairs)
        call self%factored%allocate(self%analysis)
        allocate (self%terms%mass(base%n, mass_width), self%terms%c(base%n_entries + read_behind), self%terms%own(base%n), &
            self%z(self%analysis%n_unknowns), self%turn%c(base%n_entries + read_behind), self%turn%own(base%n), source=0.0_wp)
        self%turn%is_difference = .true.
        allocate (self%terms%is_out(base%m), source=.false.)
        allocate (self%pairs(0), self%update_of_pairs(0))
        self%n_frictions = n_frictions
        call self%tell_massless([integer ::], [real(wp) ::])
        call self%update%allocate(base%n, base%m, n_frictions)
        if (allocated(self%terms%columns)) deallocate (self%terms%columns)
        allocate (self%terms%columns(merge(base%n, 0, n_frictions > 0), n_frictions), source=0.0_wp)
        self%ha = 0.0_wp
    end subroutine initialize

    !> From now on also factor the matrices of complex pairs of systems.
    subroutine expect_pairs(self, ratios)
        class(newton_matrix_type), intent(inout) :: self
        !> Ratio of each pair's ha to the ha of the real system.
        complex(wp), intent(in) :: ratios(:)
        integer :: k

        if (size(ratios) == size(self%pairs)) then
            if (all(abs(ratios - self%pairs%ratio) <= 0.0_wp)) return
        end if
        deallocate (self%pairs, self%update_of_pairs)
        allocate (self%pairs(size(ratios)), self%update_of_pairs(size(ratios)))
        do k = 1, size(ratios)
            call self%pairs(k)%allocate(self%analysis, ratios(k))
            call self%update_of_pairs(k)%allocate(self%analysis%n, self%analysis%m, self%n_frictions)
        end do
        self%w = self%z
        self%ha = 0.0_wp
    end subroutine expect_pairs

    !> Copy M and C of a point; D and K are set.
    subroutine form(self, here, mass)
        class(newton_matrix_type), intent(inout) :: self
        !> With its rows loaded.
        type(factor_type), intent(in) :: here
        !> Compressed.
        real(wp), intent(in), contiguous :: mass(:, :)

        self%terms%mass(:, :) = mass
        self%terms%c(:) = here%c(:size(self%terms%c))
        self%terms%own(:) = here%own
        self%terms%is_out(:) = here%is_out
        self%ha = 0.0_wp
    end subroutine form

    !> Factor for ha = h a_ii.
    subroutine factor(self, ha, stat)
        class(newton_matrix_type), intent(inout) :: self
        real(wp), intent(in) :: ha
        !> ok or `newton_failed`.
        integer, intent(out) :: stat
        integer :: k

        self%ha = 0.0_wp
        call add_masses(1.0_wp)
        call self%factored%fill(self%analysis, self%terms, ha, ha**2, .true.)
        call self%factored%eliminate(self%analysis, stat)
        do k = 1, size(self%pairs)
            if (stat == status_ok) call self%pairs(k)%factor(self%analysis, self%terms, ha, stat)
        end do
        call add_masses(0.0_wp)
        if (stat == status_ok .and. self%update%n > 0) call self%factor_update(stat)
        if (stat == status_ok) self%ha = ha

    contains

        !> Set the diagonal of M for coordinates without mass.
        subroutine add_masses(part)
            real(wp), intent(in) :: part
            integer :: i

            do i = 1, size(self%massless)
                associate (j => self%massless(i))
                    self%terms%mass(j, j - self%analysis%block_first(j) + 1) = part*self%added(i)
                end associate
            end do
        end subroutine add_masses
    end subroutine factor

    !> Set the coordinates without mass.
    subroutine tell_massless(self, coordinates, added)
        class(newton_matrix_type), intent(inout) :: self
        integer, intent(in) :: coordinates(:)
        !> Mass of each in the factors: so small that corrections contract nearly as without it.
        real(wp), intent(in) :: added(:)

        self%massless = coordinates
        self%added = added
    end subroutine tell_massless

    !> Set B and p' of friction on reactions.
    subroutine set_friction(self, directions, gradient)
        class(newton_matrix_type), intent(inout) :: self
        !> (n, frictions) and (frictions, m).
        real(wp), intent(in), contiguous :: directions(:, :), gradient(:, :)
        integer :: k

        self%terms%columns(:, :) = directions
        self%update%gradient(:, :) = gradient
        do k = 1, size(self%pairs)
            self%update_of_pairs(k)%gradient(:, :) = gradient
        end do
    end subroutine set_friction

    !> Find the effect of friction on the factors.
    subroutine factor_update(self, stat)
        class(newton_matrix_type), intent(inout) :: self
        !> ok or `newton_failed`.
        integer, intent(out) :: stat
        integer :: j, k

        stat = 0
        associate (columns => self%terms%columns, update => self%update)
            do j = 1, update%n
                update%mu(:, j) = 0.0_wp
                call self%gather(columns(:, j), update%mu(:, j), self%z)
                call self%factored%solve(self%analysis, self%z)
                call self%scatter(self%z, update%x(:, j), update%mu(:, j))
            end do
            call update%factor(stat)
            do k = 1, size(self%pairs)
                associate (pair => self%update_of_pairs(k))
                    do j = 1, pair%n
                        pair%mu(:, j) = 0.0_wp
                        call self%gather(columns(:, j), pair%mu(:, j), self%z)
                        self%w(:) = 0.0_wp
                        call self%pairs(k)%solve(self%analysis, self%z, self%w)
                        call self%scatter(self%z, pair%x(:, j), pair%mu(:, j))
                        call self%scatter(self%w, pair%x_im(:, j), pair%mu_im(:, j))
                    end do
                    if (stat == 0) call pair%factor(stat)
                end associate
            end do
        end associate
        stat = merge(status_ok, status_newton_failed, stat == 0)
    end subroutine factor_update

    !> Solve H x + C' mu = f, C x = g.
    subroutine solve(self, f, g, x, mu)
        class(newton_matrix_type), intent(inout) :: self
        !> f and x (n), g and mu (m).
        real(wp), intent(in), contiguous :: f(:), g(:)
        real(wp), intent(out), contiguous :: x(:), mu(:)

        call self%gather(f, g, self%z)
        call self%factored%solve(self%analysis, self%z)
        call self%scatter(self%z, x, mu)
        call self%update%complete(x, mu)
    end subroutine solve

    !> Solve for a complex pair, in place: x for f and mu for g, their imaginary parts likewise.
    subroutine solve_pair(self, k, f, f_im, g, g_im)
        class(newton_matrix_type), intent(inout) :: self
        !> The number of the pair.
        integer, intent(in) :: k
        !> (n) and (m).
        real(wp), intent(inout), contiguous :: f(:), f_im(:), g(:), g_im(:)

        call self%gather(f, g, self%z)
        call self%gather(f_im, g_im, self%w)
        call self%pairs(k)%solve(self%analysis, self%z, self%w)
        call self%scatter(self%z, f, g)
        call self%scatter(self%w, f_im, g_im)
        if (self%update%n > 0) call self%update_of_pairs(k)%complete_pair(f, f_im, g, g_im)
    end subroutine solve_pair

    !> Right sides by nodes.
    subroutine gather(self, f, g, z)
        class(newton_matrix_type), intent(in) :: self
        real(wp), intent(in), contiguous :: f(:), g(:)
        real(wp), intent(out), contiguous :: z(:)
        integer :: b, i, n

        associate (a => self%analysis)
            do n = 1, a%n_nodes
                if (a%is_body(n)) cycle
                do i = 1, a%height(n)
                    z(a%place(n) + i) = g(a%origin(n) + i - 1)
                    if (self%terms%is_out(a%origin(n) + i - 1)) z(a%place(n) + i) = 0.0_wp
                end do
            end do
            do b = 1, a%n_bodies
                associate (place => a%place(a%node_of_body(b)), nb => a%first(b + 1) - a%first(b))
                    call copy(nb, f(a%first(b):), z(place + 1:))
                    if (a%norm_row(b) == 0) cycle
                    z(place + nb + 1) = g(a%norm_row(b))
                    if (self%terms%is_out(a%norm_row(b))) z(place + nb + 1) = 0.0_wp
                end associate
            end do
        end associate
    end subroutine gather

    !> Extract the solution from the unknowns of nodes.
    subroutine scatter(self, z, x, mu)
        class(newton_matrix_type), intent(in) :: self
        real(wp), intent(in), contiguous :: z(:)
        real(wp), intent(out), contiguous :: x(:), mu(:)
        integer :: b, n

        associate (a => self%analysis)
            do n = 1, a%n_nodes
                if (a%is_body(n)) cycle
                call copy(a%height(n), z(a%place(n) + 1:), mu(a%origin(n):))
            end do
            do b = 1, a%n_bodies
                associate (place => a%place(a%node_of_body(b)), nb => a%first(b + 1) - a%first(b))
                    call copy(nb, z(place + 1:), x(a%first(b):))
                    if (a%norm_row(b) > 0) mu(a%norm_row(b)) = z(place + nb + 1)
                end associate
            end do
        end associate
    end subroutine scatter

    !> Compute the change of C.
    subroutine look_at(self, here)
        class(newton_matrix_type), intent(inout) :: self
        !> With its rows loaded.
        type(factor_type), intent(in) :: here

        self%turn%c(:) = self%terms%c - here%c(:size(self%terms%c))
        self%turn%own(:) = self%terms%own - here%own
    end subroutine look_at

    !> Change of C since then: for all joints of all bodies, the largest squared change over the squared length.
    pure real(wp) function turned(self, base, here)
        class(newton_matrix_type), intent(in) :: self
        !> The chart's own analysis.
        type(analysis_type), intent(in) :: base
        type(factor_type), intent(in) :: here
        real(wp) :: change, length
        integer :: b, from, k, l, n_place, to

        turned = 0.0_wp
        do b = 1, base%n_bodies
            n_place = n_of_place(base%joints_of_body(b))
            do l = base%link_start(b), base%link_start(b + 1) - 1
                from = base%link_offset(l) + base%height(base%link_node(l))*n_place + 1
                to = base%link_offset(l) + base%height(base%link_node(l))*(base%first(b + 1) - base%first(b))
                length = real(n_place, wp)
                change = 0.0_wp
                do k = from, to
                    length = length + self%terms%c(k)**2
                    change = change + (self%terms%c(k) - here%c(k))**2
                end do
                if (change > turned*length) turned = change/max(length, tiny(1.0_wp))
            end do
        end do
    end function turned

    !> The factors, and their terms.
    subroutine pack_state(self, pack)
        class(newton_matrix_type), intent(inout) :: self
        type(pack_type), intent(inout) :: pack
        integer, allocatable :: coordinates(:), out(:)
        real(wp), allocatable :: added(:), ratios(:)
        integer :: k, n

        ! A restored chart has not received the pairs of its stepper yet.
        n = size(self%pairs)
        allocate (ratios(2*n))
        ratios(:n) = real(self%pairs%ratio, wp)
        ratios(n + 1:) = aimag(self%pairs%ratio)
        call pack%item(ratios)
        n = size(ratios)/2
        call self%expect_pairs(cmplx(ratios(:n), ratios(n + 1:), wp))
        call pack%item(self%ha)
        coordinates = self%massless
        added = self%added
        call pack%item(coordinates)
        call pack%item(added)
        if (pack%is_reading) call self%tell_massless(coordinates, added)
        call self%factored%pack_state(pack)
        do k = 1, n
            call self%pairs(k)%pack_state(pack)
            call self%update_of_pairs(k)%pack_state(pack)
        end do
        call self%update%pack_state(pack)
        associate (terms => self%terms)
            call pack%item(terms%mass)
            call pack%item(terms%c)
            call pack%item(terms%own)
            call pack%item(terms%columns)
            out = merge(1, 0, terms%is_out)
            call pack%item(out)
            terms%is_out = out > 0
            call terms%stiffness%pack_state(pack)
        end associate
    end subroutine pack_state
end module tandem_chart_sparse_newton_matrix
