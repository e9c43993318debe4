! SPDX-License-Identifier: MIT
!> Operations of the sparse chart for implicit stages: the Newton matrix, corrections of a stage's rates, filter of errors.
!>
!> Rates are ambient: only the part of qd and qdd that the chart's complement leaves counts in a stage's rates. So Newton's unknowns
!> are the acceleration and the multipliers of the stage, and the rate of the position follows: with r = qd - rate_q,
!>
!>   [H, C'; C, 0] [b; mu] = [S + Q_A - M qdd - C' lambda - ha K r; -gamma - C qdd],   H = M + ha D + ha^2 K,
!>   qdd := qdd + b,   lambda := lambda + mu,   rate_q := qd + ha b.
!>
!> After convergence the equations of motion and C qdd = -gamma hold at the stage itself, whichever matrix was used.
module tandem_chart_sparse_implicit_stage
    use tandem_chart_sparse_motion, only: attach_motion => do_attach, sparse_motion_type
    use tandem_chart_sparse_newton_matrix, only: newton_matrix_type
    use tandem_chart_sparse_progress, only: largest_part
    use tandem_error, only: error_type
    use tandem_kinds, only: wp
    use tandem_linalg_kernels, only: is_finite
    use tandem_model, only: model_type
    use tandem_model_stiffness, only: stiffness_type
    use tandem_options, only: options_type
    use tandem_pack, only: pack_type
    use tandem_status, only: status_not_finite, status_ok
    implicit none (type, external)
    private

    public :: do_attach, sparse_implicit_type

    !> Number of steps whose multipliers extrapolate to those of a stage, and the largest number of stages of a step.
    integer, parameter :: most_past = 6, most_stages = 5

    !> The chart with implicit stages.
    type, abstract, extends(sparse_motion_type) :: sparse_implicit_type
        !> Allocated for an implicit stepper, like the other arrays.
        type(newton_matrix_type), allocatable :: newton
        !> The model's segment when the matrix was formed.
        integer :: newton_segment = 0
        !> The multipliers of the last stage (m), its number and its time; the multipliers of each stage in some earlier steps (m,
        !> most_past, stages) in a ring buffer, and the index of the newest.
        real(wp), allocatable :: lambda(:), past(:, :, :), t_past(:, :)
        real(wp) :: t_lambda = 0.0_wp
        integer, allocatable :: n_past(:), newest(:)
        !> 0 if the multipliers belong to no stage.
        integer :: stage_lambda = 0
        !> Last observed remainder of a system with the M and C of the point after a solution with the matrix; more than 1 if
        !> unknown.
        real(wp), private :: left = 2.0_wp
        !> Largest errors that the iteration may leave.
        real(wp) :: iterate_tolerance = 0.0_wp
        !> Angle by which C has turned from the matrix to the chart's origin, if known.
        real(wp), private :: angle = 1.0_wp
        !> True if the residual of the last stage has no component along the complement; else corrections are refined.
        logical :: balances = .false.
        !> Work space: forces, corrections and their sum (n), multipliers and right sides (m).
        real(wp), allocatable :: force(:), part(:), total(:), mu(:), total_mu(:), rows(:)
    contains
        procedure :: do_attach, do_factor, do_reuse, do_filter, pack_newton
        procedure(expect_interface), deferred :: expect_pairs
        procedure :: begin_multipliers, find_correction, make_tangent
        procedure, private :: keep_multipliers
    end type sparse_implicit_type

    abstract interface
        !> Complex pairs of systems are factored too.
        subroutine expect_interface(self, ratios)
            import :: sparse_implicit_type, wp
            implicit none (type, external)
            class(sparse_implicit_type), intent(inout) :: self
            complex(wp), intent(in), contiguous :: ratios(:)
        end subroutine expect_interface
    end interface

contains

    !> Attach the model; for an implicit stepper analyse the Newton matrix too.
    subroutine do_attach(self, model, options, implicit, damps, error, kept)
        class(sparse_implicit_type), intent(inout) :: self
        class(model_type), intent(inout), target :: model
        type(options_type), intent(in) :: options
        logical, intent(in) :: implicit, damps
        type(error_type), allocatable, intent(out) :: error
        integer, intent(in), optional :: kept(:)
        type(stiffness_type) :: stiffness
        integer, allocatable :: pairs(:, :)

        call attach_motion(self, model, options, implicit, damps, error, kept)
        if (allocated(self%newton)) deallocate (self%newton)
        if (allocated(error) .or. .not. implicit) return
        allocate (pairs(2, 0))
        if (allocated(model%pattern%coupled)) pairs = model%pattern%coupled
        call stiffness%build(model%pattern%first, pairs)
        allocate (self%newton)
        call self%newton%initialize(self%system%analysis, stiffness, model%pattern%mass_width, model%n_frictions)
        self%force = spread(0.0_wp, 1, model%n)
        self%part = self%force
        self%total = self%force
        self%lambda = spread(0.0_wp, 1, model%n_constraints())
        if (allocated(self%past)) deallocate (self%past, self%t_past)
        allocate (self%past(size(self%lambda), most_past, most_stages), self%t_past(most_past, most_stages), source=0.0_wp)
        self%n_past = spread(0, 1, most_stages)
        self%newest = spread(1, 1, most_stages)
        self%stage_lambda = 0
        self%left = 2.0_wp
        self%iterate_tolerance = options%newton_tolerance()
        self%follows_stiffness = damps
        ! Measured on sliders on stiff springs and on the governor.
        self%after_hard_step = 0.95_wp
        self%easing = 1.02_wp
        ! Measured on sprung chains.
        self%matrix_cost = 5.0_wp
        self%mu = self%lambda
        self%total_mu = self%lambda
        self%rows = self%lambda
    end subroutine do_attach

    !> Form and factor the Newton matrix.
    subroutine do_factor(self, t, q, qd, qdd, ha, ratios, stat)
        class(sparse_implicit_type), intent(inout) :: self
        real(wp), intent(in) :: t
        real(wp), intent(in), contiguous :: q(:), qd(:), qdd(:)
        real(wp), intent(in) :: ha
        complex(wp), intent(in), contiguous :: ratios(:)
        integer, intent(out) :: stat
        !> Of the acceleration, at which the stiffness is evaluated.
        real(wp), parameter :: rest = 1.0e-13_wp

        self%failure%row = 0
        call self%expect_pairs(ratios)
        associate (s => self%system)
            call s%move_with(t, q, qd, self%counts, stat)
            if (stat == status_ok) call s%factorize(self%counts, stat)
            if (stat == status_ok) call s%add_friction(stat)
            if (stat /= status_ok) then
                call self%fail_here(stat)
                return
            end if
            s%g(:) = -s%model%terms%gamma
            call s%solve_here(s%model%terms%force, s%g, self%part, s%z, rest, .false., stat)
            if (stat /= status_ok) then
                call self%fail_here(stat)
                return
            end if
            call self%keep_multipliers()
            call s%find_multipliers(self%part, self%lambda)
            call s%model%evaluate_stiffness(t, q, qd, qdd, self%lambda, self%newton%terms%stiffness, self%counts, stat)
            if (stat /= status_ok) then
                self%failure%term = 'a derivative'
                return
            end if
            call self%newton%form(s%factor(s%here), s%model%terms%mass)
            call self%newton%tell_massless(s%massless, s%added)
            if (s%normal_forces%n > 0) call self%newton%set_friction(s%model%directions, s%model%normals_gradient)
            call self%newton%factor(ha, stat)
            self%left = 2.0_wp
            self%angle = 1.0_wp
            self%newton_segment = s%model%segment()
        end associate
        self%counts%newton_matrices = self%counts%newton_matrices + 1
        self%counts%newton_factorizations = self%counts%newton_factorizations + 1
    end subroutine do_factor

    !> Reuse the last matrix for ha.
    subroutine do_reuse(self, ha, ratios, can)
        class(sparse_implicit_type), intent(inout) :: self
        real(wp), intent(in) :: ha
        complex(wp), intent(in), contiguous :: ratios(:)
        logical, intent(out) :: can
        !> Successive steps of a grid differ by rounding of the time.
        real(wp), parameter :: rounding = 1.0e-6_wp
        !> Squared change of C against its squared length at any joint, an angle of some 13 degrees, up to which a matrix is reused.
        real(wp), parameter :: farthest = 0.05_wp
        !> If M and C have changed so much that the remainder is larger than this, they are replaced by those of the chart's origin:
        !> a factorisation saves the refinement of some ten corrections.
        real(wp), parameter :: worst = 1.0e-2_wp
        real(wp) :: turned
        logical :: has_new_ha, is_worn
        integer :: stat

        call self%expect_pairs(ratios)
        can = self%newton%ha > 0.0_wp .and. self%newton_segment == self%system%model%segment()
        if (.not. can) return
        turned = self%newton%turned(self%system%analysis, self%system%factor(self%system%base))
        self%angle = sqrt(turned)
        can = turned <= farthest
        if (.not. can) return
        has_new_ha = abs(ha - self%newton%ha) > rounding*self%newton%ha
        if (size(self%newton%pairs) == 0) then
            is_worn = (self%left > worst .and. self%left < 2.0_wp) .or. (self%balances .and. turned > worst**2)
        else
            ! All stages share their corrections' sizes: a necessary factorisation uses the terms of the origin.
            is_worn = has_new_ha .or. turned > worst**2
        end if
        if (is_worn) then
            associate (s => self%system)
                call s%visit(self%t0, self%q0, self%counts, stat)
                can = stat == status_ok
                if (.not. can) return
                call s%load()
                call self%newton%form(s%factor(s%here), s%model%terms%mass)
                self%left = 2.0_wp
                self%angle = 0.0_wp
            end associate
        else if (.not. has_new_ha) then
            return
        end if
        call self%newton%factor(ha, stat)
        self%counts%newton_factorizations = self%counts%newton_factorizations + 1
        can = stat == status_ok
    end subroutine do_reuse

    !> Initial multipliers of a stage: after equal steps extrapolated from the same stage of earlier steps, by the polynomial
    !> through their times, because a stage of low stage order has an error of its own, which stiff forces amplify; else the
    !> multipliers of the last stage. They affect the number of corrections, not the result.
    subroutine begin_multipliers(self, number, t)
        class(sparse_implicit_type), intent(inout) :: self
        !> Number of the stage, and its time.
        integer, intent(in) :: number
        real(wp), intent(in) :: t
        !> Larger weights would amplify errors of the stages; six equal steps have 20.
        real(wp), parameter :: most_weight = 12.0_wp, most_alike = 21.0_wp
        !> This number of steps is sufficient; more steps of equal length may be better.
        integer, parameter :: usual_past = 3
        real(wp), parameter :: rounding = 1.0e-6_wp
        real(wp) :: weight(most_past), x(most_past)
        integer :: at(most_past), of(most_past), i, k, most, n, n_alike, stage

        stage = min(max(number, 1), most_stages)
        if (stage == self%stage_lambda .and. .not. (t < self%t_lambda .or. t > self%t_lambda)) return
        call self%keep_multipliers()
        self%stage_lambda = stage
        self%t_lambda = t
        if (self%n_past(stage) == 0) return
        of = stage
        do k = 1, most_past
            at(k) = modulo(self%newest(stage) - k, most_past) + 1
            x(k) = self%t_past(at(k), stage)
        end do
        n_alike = 1
        do k = 2, self%n_past(stage)
            if (.not. abs(x(k - 1) - x(k) - (t - x(1))) <= rounding*abs(t - x(1))) exit
            n_alike = k
        end do
        most = min(self%n_past(stage), max(usual_past, n_alike))
        n = count(self%n_past > 0)
        if (n_alike < usual_past .and. n >= usual_past) then
            most = usual_past
            do k = 1, most
                of(k) = modulo(stage - 1 - k, n) + 1
                at(k) = modulo(self%newest(of(k)) - 1, most_past) + 1
                x(k) = self%t_past(at(k), of(k))
            end do
        end if
        do n = most, 1, -1
            weight = 0.0_wp
            do k = 1, n
                weight(k) = 1.0_wp
                do i = 1, n
                    if (i /= k) weight(k) = weight(k)*(t - x(i))/(x(k) - x(i))
                end do
            end do
            ! Two stages at the same time give no finite weights.
            if (all(abs(weight) <= merge(most_alike, most_weight, n > usual_past))) exit
        end do
        self%lambda(:) = 0.0_wp
        do k = 1, max(n, 1)
            self%lambda(:) = self%lambda + weight(k)*self%past(:, at(k), of(k))
        end do
    end subroutine begin_multipliers

    !> Store the multipliers of a completed stage; a repeated step replaces its first attempt.
    subroutine keep_multipliers(self)
        class(sparse_implicit_type), intent(inout) :: self
        integer :: stage

        stage = self%stage_lambda
        if (stage == 0) return
        self%stage_lambda = 0
        associate (newest => self%newest(stage), n_past => self%n_past(stage))
            if (n_past == 0 .or. self%t_lambda > self%t_past(newest, stage)) then
                newest = modulo(newest, most_past) + 1
                n_past = min(n_past + 1, most_past)
            end if
            self%past(:, newest, stage) = self%lambda
            self%t_past(newest, stage) = self%t_lambda
        end associate
    end subroutine keep_multipliers

    !> Solve for `force` and `rows` into `total` and `total_mu`, with M and C of the current point, by refinement.
    subroutine find_correction(self, qd, ha)
        class(sparse_implicit_type), intent(inout) :: self
        real(wp), intent(in), contiguous :: qd(:)
        real(wp), intent(in) :: ha
        !> Largest number of solutions; negligible part of their sum; largest ratio of successive solutions. The second one is due
        !> to the multipliers, which may have changed by more than the rates.
        integer, parameter :: most = 4
        real(wp), parameter :: negligible = 0.01_wp, slow = 0.5_wp
        !> Safety factor of the last observed remainder, the negligible part of the tolerance, and the size of a solution in
        !> tolerances above which its remainder is not rounding.
        real(wp), parameter :: distrust = 2.0_wp, part = 0.3_wp, large = 1000.0_wp
        !> Remainder of a solution per angle of C, once the multipliers are nearly right, and its lower limit.
        real(wp), parameter :: by_angle = 10.0_wp, at_least = 0.1_wp
        real(wp) :: last_size, size
        integer :: pass

        last_size = huge(1.0_wp)
        associate (s => self%system, newton => self%newton)
            do pass = 1, most
                call newton%solve(self%force, self%rows, self%part, self%mu)
                size = abs(ha)*largest_part(self%n, self%part, qd, self%scale, s%rate)
                if (pass == 1) then
                    self%total(:) = self%part
                    self%total_mu(:) = self%mu
                    if (distrust*self%left*size <= part*self%iterate_tolerance) exit
                    call newton%look_at(s%factor(s%here))
                else
                    self%total(:) = self%total + self%part
                    self%total_mu(:) = self%total_mu + self%mu
                    if (pass == most) exit
                    if (pass == 2 .and. last_size > large*self%iterate_tolerance) self%left = min(size/last_size, 1.9_wp)
                    if (size <= negligible*abs(ha)*largest_part(self%n, self%total, qd, self%scale, s%rate)) exit
                    if (distrust*max(by_angle*self%angle, at_least)*size <= part*self%iterate_tolerance) exit
                end if
                if (pass > 2 .and. .not. size < slow*last_size) exit
                last_size = size
                ! Residual due to the changes of M and C.
                self%rows(:) = 0.0_wp
                call newton%turn%multiply(s%analysis, self%part, self%rows)
                self%rows(:) = -self%rows
                self%force(:) = 0.0_wp
                call newton%turn%add_reactions(s%analysis, self%mu, self%force)
                self%force(:) = -self%force
                if (s%model%constant_mass()) cycle
                call add_mass(self, 1.0_wp, newton%terms%mass)
                call add_mass(self, -1.0_wp, s%model%terms%mass)
            end do
        end associate
    end subroutine find_correction

    !> force := force + sign M part.
    subroutine add_mass(self, sign, mass)
        class(sparse_implicit_type), intent(inout) :: self
        real(wp), intent(in) :: sign
        real(wp), intent(in), contiguous :: mass(:, :)

        call self%system%pattern%multiply_mass(mass, self%part, self%system%x)
        self%force(:) = self%force + sign*self%system%x
    end subroutine add_mass

    !> Filter the error by a solve with the Newton matrix; then restore its velocity as the chart at the last point does.
    subroutine do_filter(self, error_q, error_qd)
        class(sparse_implicit_type), intent(inout) :: self
        real(wp), intent(inout), contiguous :: error_q(:), error_qd(:)

        associate (s => self%system, newton => self%newton)
            call self%make_tangent(.true., s%nh, error_q)
            call self%make_tangent(.true., s%m, error_qd)
            call s%pattern%multiply_mass(newton%terms%mass, error_qd, self%force)
            call newton%terms%stiffness%multiply(-newton%ha, error_q, self%force)
            self%rows(:) = 0.0_wp
            call newton%solve(self%force, self%rows, self%part, self%mu)
            error_qd(:) = self%part
            error_q(:) = error_q + newton%ha*self%part
            call self%make_tangent(.false., s%m, error_qd)
        end associate
    end subroutine do_filter

    !> Remove from a vector the part that the chart ignores, by the first rows at the origin or at the last point.
    subroutine make_tangent(self, is_origin, n_rows, x)
        class(sparse_implicit_type), intent(inout) :: self
        logical, intent(in) :: is_origin
        integer, intent(in) :: n_rows
        real(wp), intent(inout), contiguous :: x(:)

        if (n_rows == 0) return
        associate (s => self%system)
            if (.not. is_origin .and. .not. s%factor(s%here)%has_rows) return
            s%g(:) = 0.0_wp
            call s%factor(merge(s%base, s%here, is_origin))%multiply(s%analysis, x, s%g)
            s%g(n_rows + 1:) = 0.0_wp
            call s%factor(s%base)%solve(s%analysis, .false., x, s%g, s%x, s%z)
            x(:) = x + s%x
        end associate
    end subroutine make_tangent

    !> The matrix, and the last stage's multipliers.
    subroutine pack_newton(self, pack)
        class(sparse_implicit_type), intent(inout) :: self
        type(pack_type), intent(inout) :: pack

        if (.not. allocated(self%newton)) return
        call self%newton%pack_state(pack)
        call pack%item(self%newton_segment)
        call pack%item(self%lambda)
        call pack%item(self%past)
        call pack%item(self%t_past)
        call pack%item(self%t_lambda)
        call pack%item(self%stage_lambda)
        call pack%item(self%n_past, self%newest)
        call pack%item(self%left, self%angle)
        call pack%item(self%balances)
    end subroutine pack_newton
end module tandem_chart_sparse_implicit_stage
