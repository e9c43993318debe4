! SPDX-License-Identifier: MIT
!> Operations of the sparse chart for explicit steps: points, velocities and accelerations that belong to increments.
!>
!> The complements are those of the mass metric, q = q0 + xi - Y0 mu and qd = qd0 + eta - Y0 x with the columns Y0 = M^-1 C' of the
!> origin, so that the factor for the acceleration there is reused for all corrections of the step. Neither a basis nor a projector
!> is formed. Corrections for Phi use no row of E: this complement of the tangent space is as good as others.
module tandem_chart_sparse_motion
    use tandem_chart_sparse_partners, only: choose_independent, find_partners_of => find_partners
    use tandem_chart_sparse_progress, only: is_rounding, is_trusted, largest, learn, progress_type, unknown
    use tandem_chart_sparse_rank, only: rank_type
    use tandem_chart_sparse_system, only: system_type
    use tandem_error, only: error_type, set_error
    use tandem_kinds, only: wp
    use tandem_linalg_kernels, only: is_finite
    use tandem_linalg_secants, only: secants_type
    use tandem_model, only: model_type
    use tandem_model_terms, only: need_gamma, need_jacobian, need_mass, need_phi
    use tandem_model_timer, only: of_position, of_velocity
    use tandem_options, only: options_type
    use tandem_status, only: status_chart_left, status_invalid_option, status_not_finite, status_ok, status_position_diverged, &
        status_rank_deficient, status_singular_mass
    use tandem_chart, only: chart_memory_type, goal_type
    use tandem_chart_implicit, only: implicit_chart_type
    use tandem_chart_sparse_blocks, only: most_coordinates
    implicit none (type, external)
    private

    public :: sparse_motion_type, find_obstacle, do_attach, take_complement

    !> If a correction leaves no more than this, the second derivative predicts an implicit stage; if bodies turn far within a step
    !> it is inaccurate.
    real(wp), parameter :: near = 0.05_wp

    !> The start of the next step; the factor of a nearby point is stored in the system itself.
    type, extends(chart_memory_type) :: sparse_memory_type
        real(wp), allocatable :: delta(:)
        type(progress_type) :: position, velocity
    end type sparse_memory_type

    !> The chart without the operations between steps.
    type, abstract, extends(implicit_chart_type) :: sparse_motion_type
        type(system_type) :: system
        type(rank_type) :: rank
        !> Largest constraint errors on their natural scale: after projection; of Phi and of C qd - nu at ends of steps and at
        !> stages.
        real(wp) :: tolerance = 0.0_wp
        real(wp) :: end_tolerance = 0.0_wp, stage_tolerance = 0.0_wp, velocity_tolerance = 0.0_wp, stage_velocity_tolerance = 0.0_wp
        !> Largest errors of the next iterate of a stage, if they may be larger than those of other points.
        real(wp) :: loose_position = 0.0_wp, loose_velocity = 0.0_wp
        !> Largest error of the acceleration at stages that coordinates without mass cause.
        real(wp) :: massless_tolerance = 0.0_wp
        !> Largest error if rounding prevents a smaller one: positions are judged by the scales at the start of a step here, by
        !> those at its end afterwards.
        real(wp) :: allowed = 0.0_wp
        !> True if the run is to stop at singular configurations: then no step may pass one unnoticed.
        logical :: stops_at_losses = .false.
        !> The origin, and coordinate scales (n).
        real(wp) :: t0 = 0.0_wp
        real(wp), allocatable :: q0(:), qd0(:), scale(:)
        !> -Y0 mu of the last point; component of qdd at the start of the step along Y0; -Y0 x of a stage over its defect, or
        !> undivided in implicit steps, whose stages have none (n).
        real(wp), allocatable :: delta(:), curve(:), delta_rate(:)
        logical :: has_curve = .false., has_delta_rate = .false.
        !> For implicit stages: -Y0 x of the last one over its defect (n), and the defects of `delta` and `delta_rate`, 0 if these
        !> are not usable.
        real(wp), allocatable :: bend(:)
        logical :: has_bend = .false.
        !> True if `curve` and `bend` belong to another origin, which has another complement.
        logical :: is_curve_old = .false., is_bend_old = .false.
        real(wp) :: defect_of_delta = 0.0_wp, defect_of_rate = 0.0_wp
        !> Reciprocals of the natural scales of rows at the origin (nh), (m).
        real(wp), allocatable :: phi_weight(:), velocity_weight(:)
        type(progress_type) :: position, velocity
        !> Rounding error of the origin (n).
        real(wp), allocatable, private :: rounding(:)
        !> Accelerates slow corrections in steps that may be long.
        type(secants_type) :: secants
    contains
        procedure :: do_attach, do_set_origin, start_step, get_memory, set_memory, forget
        procedure :: leave_out_dependent, find_partners
        procedure :: restore, do_accelerate
        procedure, non_overridable :: fail_here, restore_position, restore_velocity, restore_near
        procedure, private, non_overridable :: make_origin
        procedure, private, non_overridable :: meet_velocity
        procedure, private, nopass, non_overridable :: recall
    end type sparse_motion_type

    interface
        !> Bring a point beside the manifold onto it, by the factor of the point itself or of a nearby one.
        module subroutine restore_near(self, t, is_near, exactly, q, qd, stat)
            implicit none (type, external)
            class(sparse_motion_type), intent(inout) :: self
            real(wp), intent(in) :: t
            !> True if the last point is so near that its factor may be used.
            logical, intent(in) :: is_near
            !> True to correct q until rounding prevents it.
            logical, intent(in) :: exactly
            real(wp), intent(inout) :: q(self%n), qd(self%n)
            integer, intent(out) :: stat
        end subroutine restore_near

        !> qd = qd0 + eta - Y0 x with C qd = nu.
        module subroutine restore_velocity(self, t, q, increment, goal, qd, stat)
            implicit none (type, external)
            class(sparse_motion_type), intent(inout) :: self
            real(wp), intent(in) :: t, q(self%n), increment(self%n)
            type(goal_type), intent(in) :: goal
            real(wp), intent(out) :: qd(self%n)
            integer, intent(out) :: stat
        end subroutine restore_velocity

        !> Corrections of qd at the last point.
        module subroutine meet_velocity(self, age, goal, qd, stat)
            implicit none (type, external)
            class(sparse_motion_type), intent(inout) :: self
            !> Time since the origin.
            real(wp), intent(in) :: age
            type(goal_type), intent(in) :: goal
            real(wp), intent(inout) :: qd(self%n)
            integer, intent(out) :: stat
        end subroutine meet_velocity
    end interface

contains

    !> Reason why a model cannot be run with these options on this chart; blank if it can.
    function find_obstacle(model, options, implicit) result(obstacle)
        class(model_type), intent(in) :: model
        type(options_type), intent(in) :: options
        !> True if the stepper is implicit.
        logical, intent(in) :: implicit
        character(len=120) :: obstacle
        integer, parameter :: needed = need_jacobian + need_mass

        obstacle = ''
        if (.not. allocated(model%pattern)) then
            obstacle = 'the model declares no pattern of C and M'
        else if (iand(model%provides, needed) /= needed .or. iand(model%provides, need_gamma) == 0) then
            obstacle = 'the model''s evaluate does not give the jacobian, the mass matrix and gamma'
        else if (maxval(model%pattern%first(2:) - model%pattern%first(:model%pattern%n_bodies)) > most_coordinates) then
            obstacle = 'a body of the model''s pattern has more than 12 coordinates'
        else if (implicit .and. .not. model%derives_by_bodies) then
            obstacle = 'the model gives no derivatives by bodies (evaluate_stiffness), which implicit steppers need'
        else if (options%chart /= 'every_step') then
            obstacle = 'chart = "'//trim(options%chart)//'" needs the dense chart'
        else if (options%refresh /= 'factor' .or. options%basis /= 'qr') then
            obstacle = 'refresh = "refine" and basis = "svd" need the dense chart'
        end if
    end function find_obstacle

    !> Attach the model, analyse its pattern and allocate the work space.
    subroutine do_attach(self, model, options, implicit, damps, error, kept)
        class(sparse_motion_type), intent(inout) :: self
        class(model_type), intent(inout), target :: model
        type(options_type), intent(in) :: options
        logical, intent(in) :: implicit, damps
        type(error_type), allocatable, intent(out) :: error
        integer, intent(in), optional :: kept(:)
        character(len=120) :: obstacle
        real(wp), parameter :: of_velocities = 10.0_wp, of_accelerations = 1.0e-11_wp

        obstacle = find_obstacle(model, options, implicit)
        if (obstacle == '' .and. present(kept)) obstacle = 'redundant rows need the dense chart'
        if (obstacle /= '') then
            call set_error(error, status_invalid_option, 'chart_kind = "sparse": '//trim(obstacle), 'use chart_kind = "dense"')
            return
        end if
        call self%system%initialize(model, .not. (implicit .or. options%is_adaptive()))
        self%rank = rank_type()
        self%n = model%n
        self%tolerance = options%constraint_tolerance
        self%allowed = 0.25_wp*self%tolerance
        self%stops_at_losses = options%singular == 'stop'
        self%end_tolerance = max(options%position_tolerance(), 2.0e-15_wp)
        ! The error of C qd at the end of a step enters Phi times h, and is corrected there.
        self%velocity_tolerance = max(self%end_tolerance, 0.1_wp*self%tolerance)
        ! Errors at stages enter the motion times h: under error control they are a small part of the tolerated error. Fixed steps
        ! have no such measure: there C qd, whose error has another direction at each step, may be off by ten tolerances.
        if (options%is_adaptive()) then
            self%stage_tolerance = max(options%stage_tolerance(), self%end_tolerance)
            self%stage_velocity_tolerance = max(options%stage_tolerance(), self%velocity_tolerance)
        else
            self%stage_tolerance = max(self%tolerance, self%end_tolerance)
            self%stage_velocity_tolerance = of_velocities*self%tolerance
        end if
        self%massless_tolerance = max(of_accelerations, options%stage_tolerance())
        ! Without temporaries, which would fragment the memory.
        if (allocated(self%scale)) deallocate (self%scale, self%q0, self%qd0, self%delta, self%curve, self%delta_rate, &
            self%phi_weight, self%velocity_weight, self%rounding)
        if (allocated(self%bend)) deallocate (self%bend)
        allocate (self%scale(model%n), self%phi_weight(model%n_holonomic), self%velocity_weight(model%n_constraints()), &
            source=1.0_wp)
        if (allocated(model%coordinate_scale)) self%scale(:) = model%coordinate_scale
        allocate (self%q0(model%n), self%qd0(model%n), self%delta(model%n), self%curve(model%n), self%delta_rate(model%n), &
            self%rounding(model%n), source=0.0_wp)
        if (implicit) allocate (self%bend(model%n), source=0.0_wp)
        self%has_curve = .false.
        self%has_bend = .false.
        if (implicit .or. options%is_adaptive()) call self%secants%allocate(model%n)
    end subroutine do_attach

    !> Begin steps at a point. Charts are renewed at every step, so that an origin is never kept.
    subroutine do_set_origin(self, t, q, qd, keeps, dq, stat)
        class(sparse_motion_type), intent(inout) :: self
        real(wp), intent(in) :: t
        real(wp), intent(in), contiguous :: q(:), qd(:)
        logical, intent(in) :: keeps
        real(wp), intent(inout), contiguous :: dq(:)
        integer, intent(out) :: stat
        !> A difference of more roundings than this means that q is not the point of that increment.
        real(wp), parameter :: most = 8.0_wp
        logical :: is_rounding
        integer :: i

        is_rounding = .true.
        do i = 1, self%n
            associate (left => ((self%q0(i) - q(i)) + dq(i)) + self%delta(i))
                is_rounding = is_rounding .and. abs(left) <= most*epsilon(1.0_wp)*(abs(self%q0(i)) + abs(dq(i)) + &
                    abs(self%delta(i)) + self%scale(i))
                self%rounding(i) = left
            end associate
        end do
        dq = 0.0_wp
        if (is_rounding) dq = self%rounding
        call self%make_origin(t, q, qd, stat)
    end subroutine do_set_origin

    !> Make (t, q, qd) the origin.
    subroutine make_origin(self, t, q, qd, stat)
        class(sparse_motion_type), intent(inout) :: self
        real(wp), intent(in) :: t
        real(wp), intent(in), contiguous :: q(:), qd(:)
        integer, intent(out) :: stat

        self%failure%row = 0
        self%failure%coordinate = 0
        self%t0 = t
        self%q0(:) = q
        self%qd0(:) = qd
        call begin_corrections(self)
        self%is_curve_old = .true.
        self%is_bend_old = .true.
        call self%system%visit(t, q, self%counts, stat)
        if (stat == status_ok) call self%system%factorize(self%counts, stat)
        if (stat /= status_ok) then
            call self%fail_here(stat)
            return
        end if
        call self%system%take_origin()
        call self%system%find_weights(q, qd, self%scale, self%phi_weight, self%velocity_weight)
        if (self%secants%is_used) call self%system%find_diagonal(self%secants%weight)
        call self%note_independence(sqrt(self%system%factor(self%system%base)%least))
    end subroutine make_origin

    !> Leave out rows that depend on others, and make (t, q, qd) the origin. A row of E must not replace one of Phi.
    subroutine leave_out_dependent(self, t, q, qd, stat)
        class(sparse_motion_type), intent(inout) :: self
        real(wp), intent(in) :: t
        real(wp), intent(in), contiguous :: q(:), qd(:)
        integer, intent(out) :: stat
        integer :: i

        stat = status_rank_deficient
        ! Friction needs reactions, which redundant rows leave undetermined.
        if (self%system%normal_forces%n > 0) return
        call self%system%visit(t, q, self%counts, stat)
        if (stat == status_ok) call choose_independent(self%system, self%counts, stat)
        if (stat /= status_ok) then
            call self%fail_here(stat)
            return
        end if
        associate (is_out => self%system%factor(self%system%here)%is_out)
            self%left_out = pack([(i, i=1, size(is_out))], is_out)
        end associate
        self%n_dropped = size(self%left_out)
        self%chosen_independence = 0.0_wp
        if (self%n_dropped > 0) call self%make_origin(t, q, qd, stat)
        if (self%n_dropped == 0) stat = status_rank_deficient
    end subroutine leave_out_dependent

    !> The rows in use whose combinations are rows that were left out.
    subroutine find_partners(self, rows, start, partners)
        class(sparse_motion_type), intent(inout) :: self
        integer, intent(in) :: rows(:)
        integer, allocatable, intent(out) :: start(:), partners(:)

        call find_partners_of(self%system, rows, start, partners)
    end subroutine find_partners

    !> Store the details of a failure at the last point.
    subroutine fail_here(self, stat)
        class(sparse_motion_type), intent(inout) :: self
        integer, intent(in) :: stat

        associate (factor => self%system%factor(self%system%here))
            self%failure%term = trim(self%system%model%failed_term)
            if (stat == status_rank_deficient) then
                self%failure%row = factor%weakest
                self%failure%rows = [factor%weakest]
                self%failure%value = 0.0_wp
            else if (stat == status_singular_mass) then
                self%failure%coordinate = factor%failed_coordinate
            end if
        end associate
    end subroutine fail_here

    !> Component of the acceleration at the start of a step along the complement: R C qdd, by rows of Phi.
    subroutine start_step(self, qdd)
        class(sparse_motion_type), intent(inout) :: self
        real(wp), intent(in), contiguous :: qdd(:)
        integer :: stat

        self%has_delta_rate = .false.
        if (self%system%nh == 0) return
        if (self%system%shares_terms) then
            ! C of the origin may have been replaced by that of another point.
            self%has_curve = .false.
            call self%system%visit(self%t0, self%q0, self%counts, stat)
            if (stat /= status_ok) return
            call self%system%load()
        end if
        self%curve(:) = qdd
        call take_complement(self%system, self%system%nh, self%curve)
        self%has_curve = .true.
        self%is_curve_old = .false.
    end subroutine start_step

    !> Component of a vector along the complement at the origin, by the first rows.
    subroutine take_complement(s, n_rows, x)
        type(system_type), intent(inout) :: s
        integer, intent(in) :: n_rows
        real(wp), intent(inout), contiguous :: x(:)

        associate (base => s%factor(s%base))
            s%g(:) = 0.0_wp
            call s%factor(merge(s%here, s%base, s%shares_terms))%multiply(s%analysis, x, s%g)
            s%g(:n_rows) = -s%g(:n_rows)
            s%g(n_rows + 1:) = 0.0_wp
            call base%solve(s%analysis, .false., x, s%g, s%x, s%z)
            x(:) = s%x
        end associate
    end subroutine take_complement

    !> Save the start of the next step.
    subroutine get_memory(self, memory)
        class(sparse_motion_type), intent(inout) :: self
        class(chart_memory_type), allocatable, intent(inout) :: memory

        if (allocated(memory)) then
            if (.not. same_type_as(memory, sparse_memory_type())) deallocate (memory)
        end if
        if (.not. allocated(memory)) allocate (sparse_memory_type :: memory)
        select type (memory)
        type is (sparse_memory_type)
            memory%delta = self%delta
            memory%position = self%position
            memory%velocity = self%velocity
        end select
        call self%system%hold()
    end subroutine get_memory

    !> Begin without corrections.
    subroutine begin_corrections(self)
        class(sparse_motion_type), intent(inout) :: self

        self%delta = 0.0_wp
        self%has_delta_rate = .false.
        self%defect_of_delta = 0.0_wp
        self%defect_of_rate = 0.0_wp
    end subroutine begin_corrections

    !> Restore the saved start of the next step, or discard all results of a failed attempt.
    subroutine set_memory(self, memory)
        class(sparse_motion_type), intent(inout) :: self
        class(chart_memory_type), intent(in), optional :: memory

        self%system%lowest = 1.0_wp
        if (.not. present(memory)) then
            call begin_corrections(self)
            ! Near a loss of rank the corrections of a failed attempt may be of any size.
            self%has_curve = .false.
            self%has_bend = .false.
            return
        end if
        select type (memory)
        type is (sparse_memory_type)
            self%delta(:) = memory%delta
            self%position = memory%position
            self%velocity = memory%velocity
        end select
        call self%system%release()
    end subroutine set_memory

    !> Invalidate the last point, and a constant mass matrix if parameters have changed.
    subroutine forget(self, parameters)
        class(sparse_motion_type), intent(inout) :: self
        logical, intent(in) :: parameters

        call self%system%forget()
        if (parameters) self%system%model%mass_is_known = .false.
    end subroutine forget

    !> Position and velocity of increments.
    subroutine restore(self, t, dq, dqd, goal, q, qd, stat)
        class(sparse_motion_type), intent(inout) :: self
        real(wp), intent(in) :: t, dq(self%n), dqd(self%n)
        type(goal_type), intent(in) :: goal
        real(wp), intent(out) :: q(self%n), qd(self%n)
        integer, intent(out) :: stat
        logical :: has_phi

        if (goal%follows_stages) then
            if (associated(self%timer)) call self%timer%begin_operation(of_position)
            q = self%q0 + dq
            qd = self%qd0 + dqd
            call self%restore_near(t, .true., .false., q, qd, stat)
            self%delta = (q - self%q0) - dq
            if (associated(self%timer)) call self%timer%end_operation()
            return
        end if
        if (associated(self%timer)) call self%timer%begin_operation(of_position)
        call self%restore_position(t, dq, goal, q, stat)
        if (associated(self%timer)) call self%timer%end_operation()
        if (stat /= status_ok) return
        has_phi = self%system%has_phi
        if (associated(self%timer)) call self%timer%begin_operation(of_velocity)
        call self%restore_velocity(t, q, dqd, goal, qd, stat)
        if (associated(self%timer)) call self%timer%end_operation()
        self%system%has_phi = has_phi
    end subroutine restore

    !> q = q0 + xi - Y0 mu with Phi(t, q) = 0.
    subroutine restore_position(self, t, increment, goal, q, stat)
        class(sparse_motion_type), intent(inout) :: self
        real(wp), intent(in) :: t, increment(self%n)
        type(goal_type), intent(in) :: goal
        real(wp), intent(out) :: q(self%n)
        integer, intent(out) :: stat
        !> Corrections with a factor of accuracy O(h); an iteration that takes more has left the chart.
        integer, parameter :: limit = 40
        real(wp) :: age, error, error_before, first_error, last_error, wanted
        integer :: k
        logical :: has_left, is_loose, is_near

        stat = status_ok
        self%failure%row = 0
        if (self%system%nh == 0) then
            q = self%q0 + increment
            return
        end if
        is_loose = goal%is_stage .or. goal%is_iterate
        age = abs(t - self%t0)
        if (goal%is_iterate .and. goal%defect < huge(1.0_wp)) then
            is_near = self%position%ageing*age <= near
            call self%recall(self%system, self%system%nh, goal%defect, is_near, self%defect_of_delta, self%has_curve, &
                self%is_curve_old, self%delta, self%curve)
            if (self%has_curve .and. is_near) self%delta(:) = goal%defect*self%curve
        else
            ! A point that is not a stage, such as that of a matrix between the stages, has another correction.
            if (.not. goal%is_iterate) self%defect_of_delta = 0.0_wp
            if (goal%defect < huge(1.0_wp) .and. self%has_curve) self%delta(:) = goal%defect*self%curve
        end if
        wanted = max(merge(self%stage_tolerance, self%end_tolerance, goal%is_stage), self%loose_position)
        first_error = 0.0_wp
        error_before = 0.0_wp
        last_error = unknown
        associate (s => self%system)
            s%has_phi = .false.
            do k = 0, limit
                q = (self%q0 + increment) + self%delta
                if (k > 0 .and. is_loose) then
                    if (is_trusted(self%position, age, last_error, wanted)) return
                end if
                call s%model%evaluate_phi(t, q, self%counts, stat)
                if (stat /= status_ok) exit
                error = largest(s%nh, s%model%terms%phi, self%phi_weight)
                if (.not. error <= huge(1.0_wp)) then
                    stat = status_not_finite
                    call s%name_infinite(stat)
                    exit
                end if
                if (k == 1) call learn(self%position, age, error, last_error)
                s%has_phi = .not. is_loose
                if (error <= wanted) return
                ! Rounding prevents further convergence; the point is near enough.
                if (error <= self%allowed .and. is_rounding(error, last_error, error_before)) return
                s%has_phi = .false.
                if (k == 0) first_error = error
                has_left = k == limit .or. .not. error <= 1.0e3_wp*max(first_error, wanted)
                if (.not. has_left) then
                    s%g(:s%nh) = -s%model%terms%phi
                    s%g(s%nh + 1:) = 0.0_wp
                    call s%factor(s%base)%solve(s%analysis, .false., q, s%g, s%x, s%z)
                    if (self%secants%is_used) call self%secants%mend(k, error, last_error, self%n, s%x, has_left)
                end if
                if (has_left) then
                    stat = status_position_diverged
                    self%failure%row = maxloc(abs(s%model%terms%phi)*self%phi_weight, dim=1)
                    self%failure%value = error
                    exit
                end if
                self%delta(:) = self%delta + s%x
                self%counts%position_corrections = self%counts%position_corrections + 1
                if (k > 0) error_before = last_error
                last_error = error
            end do
        end associate
        self%delta = 0.0_wp
        self%defect_of_delta = 0.0_wp
        self%failure%term = trim(self%system%model%failed_term)
    end subroutine restore_position

    !> Begin an implicit stage: divide the result of the last one by its defect; at the first stage of a step use the component of
    !> the previous step's result along the complement here, since the rest would move the point along the tangent space.
    subroutine recall(system, n_rows, defect, is_near, defect_of_last, is_known, is_old, last, unit)
        type(system_type), intent(inout) :: system
        integer, intent(in) :: n_rows
        real(wp), intent(in) :: defect
        !> True if the result may be used.
        logical, intent(in) :: is_near
        !> The defect of the last stage, then of this one.
        real(wp), intent(inout) :: defect_of_last
        !> True if `unit` is known; true if it belongs to another origin.
        logical, intent(inout) :: is_known, is_old
        real(wp), intent(in), contiguous :: last(:)
        real(wp), intent(inout), contiguous :: unit(:)

        if (abs(defect_of_last) > 0.0_wp) then
            unit(:) = last/defect_of_last
            is_known = .true.
            is_old = .false.
        else if (is_known .and. is_old .and. is_near) then
            call take_complement(system, n_rows, unit)
            is_old = .false.
        end if
        defect_of_last = defect
    end subroutine recall

    !> The acceleration at (t, q, qd).
    subroutine do_accelerate(self, t, q, qd, goal, qdd, stat)
        class(sparse_motion_type), intent(inout) :: self
        real(wp), intent(in) :: t, q(self%n), qd(self%n)
        type(goal_type), intent(in) :: goal
        real(wp), intent(out) :: qdd(self%n)
        integer, intent(out) :: stat
        !> Largest remainder of an acceleration, relative to itself, with the factor of a nearby point. At the end of a step it
        !> equals the rounding error of velocities; at a stage it is at most 1e-3 of the error of `rk4` (measured).
        real(wp), parameter :: rest_at_end = 2.5e-13_wp, rest_at_stage = 1.0e-9_wp
        !> Largest error at the end of a step that coordinates without mass cause; between steps it is that of stages.
        real(wp), parameter :: massless_at_end = 2.0e-14_wp
        integer :: pass
        logical :: is_solved

        self%failure%row = 0
        ! Phi still belongs to another point after a stage that was not projected.
        if (goal%is_stage) self%system%has_phi = .false.
        associate (s => self%system)
            call s%move_with(t, q, qd, self%counts, stat)
            is_solved = .false.
            if (stat == status_ok) call s%solve_nearby(self%scale, goal%is_stage, merge(rest_at_stage, min(rest_at_end, &
                self%allowed), goal%is_stage), qdd, is_solved)
            if (is_solved) return
            if (stat == status_ok) call s%factorize(self%counts, stat)
            if (stat == status_ok) call s%add_friction(stat)
            if (stat /= status_ok) then
                call self%fail_here(stat)
                return
            end if
            associate (here => s%factor(s%here))
                s%g(:) = -s%model%terms%gamma
                call s%solve_here(s%model%terms%force, s%g, qdd, s%z, merge(self%massless_tolerance, &
                    massless_at_end, goal%is_stage .or. s%is_held), .true., stat)
                if (stat /= status_ok) then
                    call self%fail_here(stat)
                    return
                end if
                if (.not. s%is_held) call s%nearby%note(t, qdd, s%z)
                do pass = 1, merge(0, passes(here%least), goal%is_stage)
                    ! Rounding error of C qdd + gamma.
                    s%g(:) = -s%model%terms%gamma
                    call here%multiply(s%analysis, qdd, s%g)
                    call here%solve(s%analysis, .false., qdd, s%g, s%x, s%z)
                    qdd = qdd + s%x
                end do
            end associate
            if (.not. is_finite(self%n, qdd)) then
                stat = status_not_finite
                call s%name_infinite(stat)
                self%failure%term = trim(s%model%failed_term)
            end if
        end associate
    end subroutine do_accelerate

    !> Number of refinements that remove rounding errors, by the smallest pivot: near a loss of rank a solution is less accurate.
    pure integer function passes(least)
        real(wp), intent(in) :: least
        real(wp), parameter :: near = 1.0e-4_wp, nearer = 1.0e-7_wp

        passes = 1
        if (least < near) passes = 2
        if (least < nearer) passes = 4
    end function passes
end module tandem_chart_sparse_motion
