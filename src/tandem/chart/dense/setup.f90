! SPDX-License-Identifier: MIT
!> The work space of the chart, and the bases at its origin.
submodule(tandem_chart_dense) tandem_chart_dense_setup
    implicit none (type, external)

    !> Largest number of stages of an implicit method.
    integer, parameter :: most_stages = 7

contains

    module procedure do_attach
        real(wp) :: utol
        integer :: i, way

        self%mode%refines = options%refresh == 'refine'
        self%mode%is_implicit = implicit
        self%has_reach = .true.
        self%follows_stiffness = implicit .and. damps .and. options%chart /= 'paper'
        self%mode%uses_svd = options%basis == 'svd'
        ! The reach of kept charts is measured for the paper's complement. Without restored stages it makes ends of steps more
        ! accurate. Fixed steps, which have no error estimate, end with `chart_left` if C has turned too far for it.
        self%mode%keeps_momentum = options%is_adaptive() .and. projects_stages(options) .and. &
            options%chart == chart_policies(1)
        self%tolerance = options%constraint_tolerance
        ! gfortran would use undefined bounds if an absent argument were passed on.
        if (present(kept)) then
            call self%model%initialize(model, kept)
        else
            call self%model%initialize(model)
        end if
        self%n = model%n
        self%nh = size(self%model%terms%phi)
        self%m = size(self%model%terms%nu)
        if (present(kept) .and. model%n_frictions > 0) then
            call set_error(error, status_invalid_model, 'friction on reactions, which redundant constraints leave undetermined', &
                'take joints that hold no more than they must, or give the friction a normal force')
            return
        end if
        self%friction%n = 0
        if (model%n_frictions > 0) call self%friction%allocate(model, self%n, self%m)
        self%mode%restores_iterates = self%mode%refines .or. options%chart == 'paper' .or. self%friction%n > 0
        if (present(kept)) then
            self%n_dropped = model%n_constraints() - size(kept)
            call self%rows%choose(model%n, model%n_constraints(), kept, implicit)
        end if
        call self%watch%allocate(options, implicit, self%n, self%nh, self%m)
        ! The condition of (38) is that of the paper's D, which needs W.
        self%mode%has_bases = implicit .or. self%mode%refines .or. self%watch%condition
        self%scale = model%scales()
        self%rate = 1.0_wp/model%time_scale
        self%basis_scale = self%scale
        self%work%magnitude = self%scale
        ! Entries of a variable mass matrix may be small by the choice of coordinates alone.
        self%knows_masses = .not. (implicit .and. model%constant_mass) .or. options%chart == 'paper'
        self%mode%has_nu = iand(self%model%has, need_nu) /= 0
        self%mode%has_gamma = iand(self%model%has, need_gamma) /= 0 .or. self%m == 0
        associate (n => self%n, nh => self%nh, m => self%m)
            way = by_elimination
            if (self%mode%has_bases) way = merge(by_refinement, by_factor, self%mode%refines)
            ! Rows are weighted by their scales at the start of a step during the iteration, by those at its end afterwards: an
            ! accepted point must not miss the tolerance for this reason.
            utol = options%position_tolerance()
            if (.not. self%mode%refines) utol = min(utol, 0.25_wp*max(utol, options%constraint_tolerance))
            call self%position%allocate(n, nh, self%mode%refines, utol, max(utol, options%stage_tolerance()), options%b_tolerance())
            self%position%predicts = .not. (self%mode%refines .or. implicit .or. options%chart == 'paper')
            call self%velocity_basis%allocate(n, m, way, options%h_tolerance())
            call self%dynamics%allocate(n, n - m)
            call self%basis%allocate(n, nh, m, merge(n, m, self%mode%has_bases .or. self%mode%uses_svd))
            if (.not. self%mode%has_gamma .or. implicit) call self%differences%initialize(model, self%scale)
            self%q0 = spread(0.0_wp, 1, n)
            self%work%x = spread(0.0_wp, 1, m)
            allocate (self%start%jacobian(m, n), source=0.0_wp)
            call self%ties%allocate(n, m)
            call self%row_space%forget()
            if (self%mode%has_bases) then
                allocate (self%start%c_x(m, m), source=0.0_wp)
                call self%start%lu%allocate(m)
                allocate (self%bases%x(n, m), self%bases%w(n, n - m), self%bases%w_dual(n, n - m), source=0.0_wp)
                allocate (self%bases%v(n, n - nh), self%bases%v_dual(n, n - nh), source=0.0_wp)
            else
                allocate (self%bases%x(0, 0), self%bases%w(0, 0))
                call self%free_motion%allocate(m, n, self%scale)
            end if
            ! With redundant rows the singular values decide when to choose other rows.
            self%mode%skips_basis = .not. (self%mode%has_bases .or. self%mode%uses_svd .or. self%watch%v .or. self%watch%w .or. &
                self%watch%secants .or. present(kept))
            if (implicit) then
                call self%stage%allocate(n, nh, m)
                self%n_residual = 2*n - nh - m
                self%n_rates = [n - nh, n - m]
                call self%metric%allocate(n, nh, m, options%relative_tolerance(), self%rate)
                call self%derivatives%allocate(n, m)
                self%stage_segment = 0
                if (allocated(self%iterates)) deallocate (self%iterates)
                allocate (self%iterates(most_stages))
                do i = 1, most_stages
                    call self%iterates(i)%allocate(n, nh, m)
                end do
                ! Measured: three corrections with the model's own derivatives; differences take 2 (n + 1) evaluations.
                self%matrix_cost = 3.0_wp
                if (model%provides_derivatives /= need_all_derivatives) then
                    self%matrix_cost = self%matrix_cost + 0.35_wp*real(n + 1, wp)
                end if
                allocate (self%work%b_phi(nh, n), self%work%lambda(m), self%work%change_q(n), self%work%change_qd(n), source=0.0_wp)
            end if
        end associate
        self%qd0 = self%q0
        self%work%trial = self%q0
        call self%point%allocate(self%n)
    end procedure do_attach

    !> Make (t, q, qd) the origin: bases and the rank decision, then the start of the position and velocity levels.
    module procedure make_origin
        logical :: is_done
        integer :: split_stat

        self%failure%row = 0
        self%is_at_origin = .true.
        self%may_lean = .true.
        if (self%follows_stiffness) call self%metric%note_move(self%basis%q(:, :self%nh), self%q0, q, self%basis_scale)
        call copy(self%n, q, self%q0)
        call copy(self%n, qd, self%qd0)
        call self%visit(t, q, stat)
        if (stat == status_ok .and. self%mode%has_bases) call self%refuse_infinite(stat)
        ! A condition that holds at the start may be violated later.
        if (stat == status_ok) call self%judge_blocks(stat)
        if (stat /= status_ok) return
        call copy(self%m*self%n, self%model%terms%jacobian, self%start%jacobian)
        split_stat = status_ok
        ! Implicit steps split velocities when needed.
        if (.not. self%mode%has_bases) call self%find_velocity_basis(split_stat)
        if (split_stat == status_not_finite) then
            stat = split_stat
            return
        end if
        call self%model%set_magnitudes(q, self%work%magnitude)
        is_done = .false.
        if (.not. self%mode%has_bases .and. split_stat == status_ok) call self%measure_split()
        if (self%mode%skips_basis .and. split_stat == status_ok) call start_without_basis(self, t, is_done)
        if (.not. is_done) then
            if (.not. self%knows_masses) call weigh_coordinates(self)
            call load_bases(self, stat)
            if (stat /= status_ok) return
            if (self%mode%is_implicit) call self%stage%enter_chart(.not. self%metric%is_on)
            call self%position%start(t, self%model%terms%jacobian, self%work%magnitude, self%scale, self%counts, stat)
            if (stat /= status_ok) return
        end if
        if (self%mode%has_bases) then
            call self%point%forget_velocity_basis()
            call self%velocity_basis%start(self%model%terms%jacobian, self%bases%x, stat)
        else
            stat = split_stat
            call self%blame(self%velocity_basis%failed_row, 0.0_wp)
            if (stat /= status_ok) return
            self%start%orientation = self%velocity_basis%orientation
            self%start%independence = self%velocity_basis%independence
            if (self%mode%keeps_momentum) then
                call self%free_motion%set_origin(self%model%blocks(:2*self%model%n_blocks), self%model%terms%mass)
            else
                call self%free_motion%set_origin(self%model%blocks(:0))
            end if
        end if
    end procedure make_origin

    !> If masses differ much, scale the bases so that light coordinates move as easily as their masses allow, once per run. In bases
    !> that mix masses the acceleration of a light one loses as many digits as the masses differ by; and a Newton matrix carried to
    !> another chart takes a light motion for a heavy one if the light one has turned.
    subroutine weigh_coordinates(self)
        class(dense_chart_type), intent(inout) :: self
        !> Ratios of masses below this are harmless: bodies and their moments of inertia differ as much. Larger ratios are limited,
        !> and masses below this part of the largest count as zero.
        real(wp), parameter :: much = 1.0e7_wp, most = 1.0e12_wp, none = 1.0e-15_wp
        !> Largest permitted reduction of the rows' independence: a light body between heavy ones constrains its coordinates twice.
        real(wp), parameter :: least = 0.1_wp
        real(wp) :: largest, smallest, mass, plain
        integer :: i

        self%knows_masses = .true.
        if (self%m == 0) return
        largest = 0.0_wp
        do i = 1, self%n
            largest = max(largest, self%scale(i)**2*self%model%terms%mass(i, i))
        end do
        smallest = largest
        do i = 1, self%n
            mass = self%scale(i)**2*self%model%terms%mass(i, i)
            if (mass > none*largest) smallest = min(smallest, mass)
        end do
        if (.not. largest > much*smallest) return
        call self%basis%factor_qr(self%model%terms%jacobian, self%scale, 0)
        plain = self%basis%smallest
        do i = 1, self%n
            mass = self%scale(i)**2*self%model%terms%mass(i, i)
            if (mass > none*largest) self%basis_scale(i) = self%scale(i)*sqrt(min(most, largest/mass))
        end do
        call self%basis%factor_qr(self%model%terms%jacobian, self%basis_scale, 0)
        if (self%basis%deficient .or. self%basis%smallest < least*plain) self%basis_scale = self%scale
    end subroutine weigh_coordinates

    !> Orthonormal bases at the current point, with the required number of columns, and the rank decision.
    subroutine load_bases(self, stat)
        class(dense_chart_type), intent(inout) :: self
        integer, intent(out) :: stat
        integer :: columns

        stat = status_ok
        ! U is sufficient for explicit steps; |w| and |D| need X, kept bases are complete.
        columns = self%nh
        if (self%watch%w .or. self%watch%secants) columns = self%m
        if (self%mode%has_bases) columns = self%n
        if (self%mode%uses_svd) then
            call self%basis%factor_svd(self%model%terms%jacobian, self%basis_scale)
        else
            call self%basis%factor_qr(self%model%terms%jacobian, self%basis_scale, columns)
        end if
        self%counts%basis_factorizations = self%counts%basis_factorizations + min(self%m, 1)
        call self%note_independence(self%basis%smallest)
        if (self%basis%deficient) then
            call self%blame_dependent(self%basis%dependent_row)
            stat = status_rank_deficient
            return
        end if
        call self%place_bases()
    end subroutine load_bases

    !> Bases from the orthonormal ones: complements orthogonal to the tangent spaces, in the metric if it is on.
    module procedure place_bases
        integer :: j

        do j = 1, self%nh
            self%position%u_basis(:, j) = self%basis_scale*self%basis%q(:, j)
        end do
        if (.not. self%mode%has_bases) return
        do j = 1, self%m
            self%bases%x(:, j) = self%basis_scale*self%basis%q(:, j)
        end do
        do j = 1, self%n - self%nh
            self%bases%v(:, j) = self%basis_scale*self%basis%q(:, self%nh + j)
            self%bases%v_dual(:, j) = self%basis%q(:, self%nh + j)/self%basis_scale
        end do
        do j = 1, self%n - self%m
            self%bases%w(:, j) = self%basis_scale*self%basis%q(:, self%m + j)
            self%bases%w_dual(:, j) = self%basis%q(:, self%m + j)/self%basis_scale
        end do
        if (self%metric%is_on .and. self%m > 0) call self%metric%lean(self%nh, self%m, self%basis%q, self%basis_scale, &
            self%position%u_basis, self%bases%v_dual, self%bases%x, self%bases%w_dual)
    end procedure place_bases

    module procedure pack_state
        call self%pack_contract(pack)
        call self%model%pack_state(pack)
        call self%differences%pack_state(pack)
        call self%position%pack_state(pack)
        call self%velocity_basis%pack_state(pack)
        if (self%mode%is_implicit) then
            call self%stage%pack_state(pack)
            call self%metric%pack_state(pack)
            call pack%item(self%basis_scale)
            call pack%item(self%knows_masses, self%may_lean, self%is_at_origin)
        end if
        call pack%item(self%q0, self%qd0)
        call pack%item(self%basis%q)
        call pack%item(self%bases%x, self%bases%v, self%bases%w, self%bases%v_dual, self%bases%w_dual)
        if (.not. self%mode%has_bases) call self%free_motion%pack_state(pack)
        call pack%item(self%rows%dropped)
        call pack%item(self%start%orientation)
        call pack%item(self%start%independence)
        call self%ties%pack_state(pack)
        call pack%item(self%start%jacobian)
        call self%point%pack_state(pack)
        call pack%item(self%stage_segment)
    end procedure pack_state

    !> If C clearly has full rank, no basis is needed.
    subroutine start_without_basis(self, t, can)
        class(dense_chart_type), intent(inout) :: self
        real(wp), intent(in) :: t
        logical, intent(out) :: can
        !> A larger smallest singular value needs no detailed check.
        real(wp), parameter :: clearly_independent = 1.0e-5_wp
        !> A value that is hardly larger than all earlier ones needs none either.
        real(wp), parameter :: much_better = 1.25_wp

        associate (e => self%velocity_basis%elimination, bound => self%velocity_basis%independence)
            ! The largest value so far must be a singular value, not a bound.
            can = bound > clearly_independent .and. .not. bound > much_better*self%best_independence
            if (.not. can) return
            self%independence = bound
            call self%position%start_without_basis(t, e%height, e%matrix, self%work%magnitude, self%scale, self%counts, can)
        end associate
    end subroutine start_without_basis
end submodule tandem_chart_dense_setup
