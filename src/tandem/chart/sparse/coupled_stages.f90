! SPDX-License-Identifier: MIT
!> Operations of the sparse chart for methods whose stages are solved together. A stage's residual has three parts,
!>
!>   r = qd - rate_q,   e = S + Q_A - M qdd - C' lambda,   g = -gamma - C qdd,
!>
!> and the method's transformation separates the systems of all stages into [H, C'; C, 0] [b; mu] = [e - ha K r; g] with H = M + ha
!> D + ha^2 K, for the real system and with complex ha for pairs; b corrects qdd, r + ha b corrects rate_q, mu corrects lambda. Each
!> stage has its own multipliers.
module tandem_chart_sparse_coupled_stages
    use tandem_chart, only: goal_type
    use tandem_chart_sparse_implicit_stage, only: attach_implicit => do_attach, sparse_implicit_type
    use tandem_chart_sparse_motion, only: take_complement
    use tandem_chart_sparse_progress, only: largest_part
    use tandem_error, only: error_type
    use tandem_kinds, only: wp
    use tandem_model, only: model_type
    use tandem_options, only: options_type
    use tandem_pack, only: pack_type
    use tandem_status, only: status_not_finite, status_ok
    implicit none (type, external)
    private

    public :: sparse_coupled_type

    !> The chart with stages that are solved together.
    type, abstract, extends(sparse_implicit_type) :: sparse_coupled_type
        !> Multipliers of the stages (m, stages) and their times, also of the previous step.
        real(wp), allocatable, private :: lambda_of(:, :), t_of(:), lambda_before(:, :), t_before(:)
        !> Corrections of the stages' last points along the complement (n, stages).
        real(wp), allocatable, private :: delta_of(:, :), delta_rate_of(:, :)
        !> Sizes of the correction in progress, of the last one, and of the first one of a step; true for the first iterate.
        real(wp), private :: change = 0.0_wp, last_change = 0.0_wp, first_change = 0.0_wp
        logical, private :: is_first_iterate = .false.
        !> Number of stages with multipliers; true if all stages of the previous step have them.
        integer, private :: n_known = 0
        logical, private :: has_before = .false.
        !> Velocities of the current iterate of a stage that is solved alone (n).
        real(wp), allocatable, private :: stage_qd(:)
        !> Work space: forces (n) and right sides (m) of an imaginary part.
        real(wp), allocatable, private :: force_im(:), rows_im(:)
    contains
        procedure :: do_attach, expect_pairs, do_find_residual, do_solve, do_solve_pair, do_update, pack_coupled
        procedure, private :: allocate_stages, begin_iterate, begin_stage, is_alone, meet_acceleration, balance_complement
    end type sparse_coupled_type

contains

    !> Attach the model.
    subroutine do_attach(self, model, options, implicit, damps, error, kept)
        class(sparse_coupled_type), intent(inout) :: self
        class(model_type), intent(inout), target :: model
        type(options_type), intent(in) :: options
        logical, intent(in) :: implicit, damps
        type(error_type), allocatable, intent(out) :: error
        integer, intent(in), optional :: kept(:)

        call attach_implicit(self, model, options, implicit, damps, error, kept)
        self%n_residual = 2*model%n + model%n_constraints()
        self%n_rates = model%n
        if (implicit) self%stage_qd = spread(0.0_wp, 1, model%n)
        if (allocated(self%t_of)) deallocate (self%t_of)
    end subroutine do_attach

    !> Also factor the matrices of complex pairs of systems.
    subroutine expect_pairs(self, ratios)
        class(sparse_coupled_type), intent(inout) :: self
        complex(wp), intent(in), contiguous :: ratios(:)

        call self%newton%expect_pairs(ratios)
        if (size(ratios) > 0) call self%allocate_stages(2*size(ratios) + 1)
    end subroutine expect_pairs

    !> Allocate for a number of stages, unless this is done.
    subroutine allocate_stages(self, stages)
        class(sparse_coupled_type), intent(inout) :: self
        integer, intent(in) :: stages

        if (allocated(self%t_of)) then
            if (size(self%t_of) == stages) return
        end if
        if (allocated(self%lambda_of)) deallocate (self%lambda_of, self%lambda_before, self%t_before, self%force_im, self%rows_im, &
            self%delta_of, self%delta_rate_of)
        if (allocated(self%t_of)) deallocate (self%t_of)
        associate (m => size(self%lambda))
            allocate (self%lambda_of(m, stages), self%lambda_before(m, stages), self%t_of(stages), self%t_before(stages), &
                self%force_im(size(self%force)), self%rows_im(size(self%rows)), self%delta_of(self%n, stages), &
                self%delta_rate_of(self%n, stages), source=0.0_wp)
        end associate
        self%n_known = 0
        self%has_before = .false.
    end subroutine allocate_stages

    !> The point and the residual of an iterate of a stage. An iterate meets the tolerances of stages: the next correction moves it.
    subroutine do_find_residual(self, goal, t, increment, q, qd, rate, residual, stat)
        class(sparse_coupled_type), intent(inout) :: self
        type(goal_type), intent(in) :: goal
        real(wp), intent(in) :: t
        real(wp), intent(in), contiguous :: increment(:, :)
        real(wp), intent(inout), contiguous :: q(:), qd(:), rate(:, :), residual(:)
        integer, intent(out) :: stat
        type(goal_type) :: point

        point = goal
        if (.not. goal%is_first) point%defect = huge(1.0_wp)
        self%iterate_tolerance = goal%tolerance
        if (.not. self%is_alone()) call self%begin_iterate(goal, increment(:, 1), increment(:, 2), q, rate(:, 1))
        call self%restore_position(t, increment(:, 1), point, q, stat)
        if (stat == status_ok) call self%restore_velocity(t, q, increment(:, 2), point, qd, stat)
        self%loose_position = 0.0_wp
        self%loose_velocity = 0.0_wp
        if (.not. self%is_alone() .and. stat == status_ok) then
            self%delta_of(:, goal%stage) = self%delta
            self%delta_rate_of(:, goal%stage) = self%delta_rate
        end if
        if (stat == status_ok) call find_residual_at(self, goal%stage, t, q, qd, rate(:, 1), rate(:, 2), residual, stat)
    end subroutine do_find_residual

    !> Start the restoration of an iterate of a stage: at the first one from the predicted coordinates, later from the last iterate
    !> of the stage, by their components along the complement. It need only be as accurate as Newton's corrections are small.
    subroutine begin_iterate(self, goal, dq, dqd, q, rate_q)
        class(sparse_coupled_type), intent(inout) :: self
        type(goal_type), intent(in) :: goal
        real(wp), intent(in), contiguous :: dq(:), dqd(:), q(:), rate_q(:)
        !> Part of the last correction, and its largest value.
        real(wp), parameter :: part = 1.0e-4_wp, most = 1.0e-4_wp

        if (goal%stage == 1) then
            if (self%is_first_iterate) self%first_change = self%change
            self%last_change = merge(self%first_change, self%change, goal%is_first)
            self%is_first_iterate = goal%is_first
            self%change = 0.0_wp
        end if
        self%loose_velocity = min(part*self%last_change, most)
        ! Stiff forces move a stage back by as much as its position is off, within the step.
        self%loose_position = self%loose_velocity*min(1.0_wp, self%newton%ha*self%system%rate)
        if (goal%is_first) then
            self%delta(:) = q - (self%q0 + dq)
            call take_complement(self%system, self%system%nh, self%delta)
            self%delta_rate(:) = rate_q - (self%qd0 + dqd)
            call take_complement(self%system, self%system%m, self%delta_rate)
        else
            self%delta(:) = self%delta_of(:, goal%stage)
            self%delta_rate(:) = self%delta_rate_of(:, goal%stage)
        end if
        self%has_delta_rate = .true.
    end subroutine begin_iterate

    !> The residual of a stage at a restored point.
    subroutine find_residual_at(self, stage, t, q, qd, rate_q, rate_qd, residual, stat)
        class(sparse_coupled_type), intent(inout) :: self
        integer, intent(in) :: stage
        real(wp), intent(in) :: t
        real(wp), intent(in), contiguous :: q(:), qd(:)
        real(wp), intent(inout), contiguous :: rate_q(:), rate_qd(:), residual(:)
        integer, intent(out) :: stat
        !> If C turns by less in a step, the refinement of corrections suffices.
        real(wp), parameter :: little = 0.01_wp
        integer :: passes

        associate (s => self%system, n => self%n)
            ! The forces of the residual have the friction of the iterate's own multipliers.
            if (s%has_friction) s%has_motion = .false.
            call s%move_with(t, q, qd, self%counts, stat)
            if (stat /= status_ok) then
                self%failure%term = trim(s%model%failed_term)
                return
            end if
            call s%load()
            residual(:n) = qd - rate_q
            self%balances = self%position%ageing*abs(t - self%t0) > little .or. .not. self%is_alone()
            if (self%balances) then
                ! Along the complement of positions a rate does not move the stage; stiff forces would act on it there.
                call self%make_tangent(.true., s%nh, residual(:n))
                rate_q = qd - residual(:n)
            end if
            if (self%is_alone()) then
                call self%begin_multipliers(stage, t)
                self%stage_qd(:) = qd
                call s%model%add_friction(t, q, qd, self%lambda, stat)
            else
                call self%begin_stage(stage, t)
                call s%model%add_friction(t, q, qd, self%lambda_of(:, stage), stat)
            end if
            if (stat == status_ok) then
                if (self%balances) call self%meet_acceleration(qd, rate_qd, passes)
                if (self%is_alone()) then
                    call find_forces(self, rate_qd, self%lambda, residual)
                else
                    call find_forces(self, rate_qd, self%lambda_of(:, stage), residual)
                end if
                if (self%balances) then
                    call self%balance_complement(stage, passes)
                    residual(n + 1:2*n) = self%force
                end if
            end if
            if (s%normal_forces%n > 0) s%has_motion = .false.
            if (stat /= status_ok) self%failure%term = trim(s%model%failed_term)
        end associate
    end subroutine find_residual_at

    !> Move the accelerations of a stage along the complement of the origin so that C qdd = -gamma there, up to what matters for the
    !> contraction of Newton's iteration. Each correction leaves the part by which C has turned.
    subroutine meet_acceleration(self, qd, rate_qd, passes)
        class(sparse_coupled_type), intent(inout) :: self
        real(wp), intent(in), contiguous :: qd(:)
        real(wp), intent(inout), contiguous :: rate_qd(:)
        !> Number of corrections.
        integer, intent(out) :: passes
        integer, parameter :: most = 4
        real(wp), parameter :: enough = 0.1_wp
        real(wp) :: size, first_size

        first_size = 0.0_wp
        associate (s => self%system, here => self%system%factor(self%system%here), base => self%system%factor(self%system%base))
            do passes = 1, most
                s%g(:) = -s%model%terms%gamma
                call here%multiply(s%analysis, rate_qd, s%g)
                call base%solve(s%analysis, .false., rate_qd, s%g, s%x, s%z)
                rate_qd(:) = rate_qd + s%x
                size = largest_part(self%n, s%x, qd, self%scale, s%rate)
                if (passes == 1) first_size = size
                if (.not. size > enough*first_size) exit
            end do
            passes = min(passes, most)
        end associate
    end subroutine meet_acceleration

    !> Change the multipliers of a stage so that the forces left in the equations of motion, `force`, have no component along the
    !> complement of the origin: the Newton matrix has the C of another point, which would take them for forces along the stage.
    subroutine balance_complement(self, stage, passes)
        class(sparse_coupled_type), intent(inout) :: self
        integer, intent(in) :: stage
        !> Number of corrections, each of which leaves the part by which C has turned.
        integer, intent(in) :: passes
        integer :: b, i, k, node

        associate (s => self%system, a => self%system%analysis, here => self%system%factor(self%system%here), &
            base => self%system%factor(self%system%base))
            do k = 1, passes
                s%g(:) = 0.0_wp
                call base%solve(a, .true., self%force, s%g, s%x, s%z)
                self%mu(:) = 0.0_wp
                do node = 1, a%n_nodes
                    if (a%is_body(node)) cycle
                    do i = 1, a%height(node)
                        self%mu(a%origin(node) + i - 1) = s%z(a%place(node) + i)
                    end do
                end do
                self%part(:) = self%force
                call base%add_reactions(a, self%mu, self%part)
                ! Rows that were eliminated with their bodies.
                do b = 1, a%n_bodies
                    if (a%own_row(b) == 0) cycle
                    associate (from => a%first(b), to => a%first(b + 1) - 1)
                        self%mu(a%own_row(b)) = dot_product(base%r(from:to), self%part(from:to))
                    end associate
                end do
                if (self%is_alone()) then
                    self%lambda(:) = self%lambda + self%mu
                else
                    self%lambda_of(:, stage) = self%lambda_of(:, stage) + self%mu
                end if
                call here%add_reactions(a, self%mu, self%force)
            end do
        end associate
    end subroutine balance_complement

    !> The residuals of the equations of motion and of the rows.
    subroutine find_forces(self, rate_qd, lambda, residual)
        class(sparse_coupled_type), intent(inout) :: self
        !> Accelerations (n) and multipliers (m).
        real(wp), intent(in), contiguous :: rate_qd(:), lambda(:)
        real(wp), intent(inout), contiguous :: residual(:)

        associate (s => self%system, n => self%n, here => self%system%factor(self%system%here))
            call s%pattern%multiply_mass(s%model%terms%mass, rate_qd, self%force)
            self%force(:) = s%model%terms%force - self%force
            call here%add_reactions(s%analysis, lambda, self%force)
            residual(n + 1:2*n) = self%force
            self%rows(:) = -s%model%terms%gamma
            call here%multiply(s%analysis, rate_qd, self%rows)
            residual(2*n + 1:2*n + s%m) = self%rows
        end associate
    end subroutine find_forces

    !> True for methods whose stages are solved one by one.
    pure logical function is_alone(self)
        class(sparse_coupled_type), intent(in) :: self

        is_alone = size(self%newton%pairs) == 0
    end function is_alone

    !> Initial multipliers of a stage: extrapolated by the polynomial through the stages of the previous step.
    subroutine begin_stage(self, stage, t)
        class(sparse_coupled_type), intent(inout) :: self
        integer, intent(in) :: stage
        real(wp), intent(in) :: t
        !> Larger weights would amplify errors of the stages.
        real(wp), parameter :: most_weight = 20.0_wp
        real(wp) :: weight
        integer :: first, i, j, stages

        stages = size(self%t_of)
        if (stage <= self%n_known .and. .not. (t < self%t_of(stage) .or. t > self%t_of(stage))) return
        if (stage == 1) then
            if (self%n_known == stages) then
                self%lambda_before(:, :) = self%lambda_of
                self%t_before(:) = self%t_of
                self%has_before = .true.
            end if
            self%n_known = 0
        end if
        self%t_of(stage) = t
        self%n_known = max(self%n_known, stage)
        if (.not. self%has_before) then
            ! Multipliers of the point where the matrix was formed.
            self%lambda_of(:, stage) = self%lambda
            return
        end if
        do first = 1, stages
            weight = 0.0_wp
            do i = first, stages
                weight = max(weight, abs(share(i)))
            end do
            if (weight <= most_weight) exit
        end do
        first = min(first, stages)
        self%lambda_of(:, stage) = 0.0_wp
        do j = first, stages
            self%lambda_of(:, stage) = self%lambda_of(:, stage) + share(j)*self%lambda_before(:, j)
        end do

    contains

        !> The weight of a stage of the previous step in the polynomial through all its stages.
        pure real(wp) function share(i)
            integer, intent(in) :: i
            integer :: k

            share = 1.0_wp
            do k = first, stages
                if (k /= i) share = share*(t - self%t_before(k))/(self%t_before(i) - self%t_before(k))
            end do
        end function share
    end subroutine begin_stage

    !> The correction of the real system, in place.
    subroutine do_solve(self, x)
        class(sparse_coupled_type), intent(inout) :: self
        real(wp), intent(inout), contiguous :: x(:)

        associate (n => self%n, m => self%system%m, newton => self%newton)
            self%force(:) = x(n + 1:2*n)
            self%rows(:) = x(2*n + 1:2*n + m)
            call newton%terms%stiffness%multiply(-newton%ha, x(:n), self%force)
            if (.not. self%balances) then
                call self%find_correction(self%stage_qd, newton%ha)
                x(:n) = x(:n) + newton%ha*self%total
                x(n + 1:2*n) = self%total
                x(2*n + 1:2*n + m) = self%total_mu
                return
            end if
            call newton%solve(self%force, self%rows, self%part, self%mu)
            x(:n) = x(:n) + newton%ha*self%part
            x(n + 1:2*n) = self%part
            x(2*n + 1:2*n + m) = self%mu
        end associate
    end subroutine do_solve

    !> The correction x + i y of one of the pairs, in place.
    subroutine do_solve_pair(self, k, x, y)
        class(sparse_coupled_type), intent(inout) :: self
        integer, intent(in) :: k
        real(wp), intent(inout), contiguous :: x(:), y(:)
        complex(wp) :: ha

        associate (n => self%n, m => self%system%m, newton => self%newton)
            ha = newton%ha*newton%pairs(k)%ratio
            associate (a => real(ha, wp), b => aimag(ha))
                self%force(:) = x(n + 1:2*n)
                self%force_im(:) = y(n + 1:2*n)
                self%part(:) = a*x(:n) - b*y(:n)
                self%total(:) = a*y(:n) + b*x(:n)
                call newton%terms%stiffness%multiply(-1.0_wp, self%part, self%force)
                call newton%terms%stiffness%multiply(-1.0_wp, self%total, self%force_im)
                self%rows(:) = x(2*n + 1:2*n + m)
                self%rows_im(:) = y(2*n + 1:2*n + m)
                call newton%solve_pair(k, self%force, self%force_im, self%rows, self%rows_im)
                x(:n) = x(:n) + (a*self%force - b*self%force_im)
                y(:n) = y(:n) + (a*self%force_im + b*self%force)
            end associate
            x(n + 1:2*n) = self%force
            y(n + 1:2*n) = self%force_im
            x(2*n + 1:2*n + m) = self%rows
            y(2*n + 1:2*n + m) = self%rows_im
        end associate
    end subroutine do_solve_pair

    !> Add a correction to a stage's rates and multipliers.
    subroutine do_update(self, stage, q, qd, ha, correction, rate, change, stat)
        class(sparse_coupled_type), intent(inout) :: self
        integer, intent(in) :: stage
        real(wp), intent(in), contiguous :: q(:), qd(:)
        real(wp), intent(in) :: ha
        real(wp), intent(in), contiguous :: correction(:)
        real(wp), intent(inout), contiguous :: rate(:, :)
        real(wp), intent(out) :: change
        integer, intent(out) :: stat
        integer :: j

        stat = status_ok
        change = 0.0_wp
        associate (n => self%n, m => self%system%m)
            do j = 1, n
                change = max(change, abs(ha*correction(j))/max(abs(q(j)), self%scale(j)), &
                    abs(ha*correction(n + j))/max(abs(qd(j)), self%system%rate*self%scale(j)))
                rate(j, 1) = rate(j, 1) + correction(j)
                rate(j, 2) = rate(j, 2) + correction(n + j)
            end do
            if (self%is_alone()) then
                self%lambda(:) = self%lambda + correction(2*n + 1:2*n + m)
            else
                self%lambda_of(:, stage) = self%lambda_of(:, stage) + correction(2*n + 1:2*n + m)
                self%change = max(self%change, change)
            end if
        end associate
        if (.not. sum(abs(rate(:, 2))) + sum(abs(rate(:, 1))) <= huge(1.0_wp)) then
            stat = status_not_finite
            call self%system%name_infinite(stat)
            self%failure%term = trim(self%system%model%failed_term)
        end if
        self%counts%newton_corrections = self%counts%newton_corrections + 1
    end subroutine do_update

    !> The stages' multipliers.
    subroutine pack_coupled(self, pack)
        class(sparse_coupled_type), intent(inout) :: self
        type(pack_type), intent(inout) :: pack

        if (.not. allocated(self%newton)) return
        if (size(self%newton%pairs) == 0) return
        call self%allocate_stages(2*size(self%newton%pairs) + 1)
        call pack%item(self%lambda_of, self%lambda_before)
        call pack%item(self%t_of, self%t_before)
        call pack%item(self%n_known)
        call pack%item(self%has_before, self%is_first_iterate)
        call pack%item(self%change, self%first_change)
    end subroutine pack_coupled
end module tandem_chart_sparse_coupled_stages
