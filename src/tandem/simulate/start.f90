! SPDX-License-Identifier: MIT
!> Start of a simulation: checks consistency, corrects small errors, and treats redundant rows and integrable nonholonomic rows.
submodule(tandem_simulation) tandem_simulate_start
    use tandem_status, only: status_inconsistent_rows
    use tandem_model_integrability, only: find_integrable_rows
    use tandem_model_redundancy, only: redundancy_type
    implicit none (type, external)

    character(len=12), parameter :: level_name(3) = [character(len=12) :: 'position', 'velocity', 'acceleration']
    character(len=*), parameter :: beside_start = 'at the start, but not near it (a singular configuration)'

    interface
        !> Accept a start in a singular configuration if the velocity belongs to one branch; otherwise `crossing%obstacle` is the
        !> reason.
        module subroutine start_on_branch(self, q, qd, is_sparse, error)
            implicit none (type, external)
            class(simulation_type), intent(inout) :: self
            !> Coordinates and velocities at the start, and kind of the chart.
            real(wp), intent(in) :: q(:), qd(:)
            logical, intent(in) :: is_sparse
            !> The error of a start without a branch; deallocated if it is accepted.
            type(error_type), allocatable, intent(inout) :: error
        end subroutine start_on_branch
    end interface

contains

    module procedure accept_start
        real(wp) :: q(size(self%state%q)), qd(size(self%state%q))
        logical :: is_sparse

        q = self%state%q
        qd = self%state%qd
        is_sparse = self%is_sparse
        call accept_state(self, error)
        if (.not. allocated(error)) return
        if (error%stat /= status_rank_deficient .or. .not. self%crossing%passes) return
        call start_on_branch(self, q, qd, is_sparse, error)
        if (allocated(error)) error%message = error%message//'; a start here requires a velocity along one branch, but '// &
            trim(self%crossing%obstacle)
    end procedure accept_start

    !> Accept a state beside singular configurations.
    subroutine accept_state(self, error)
        class(simulation_type), intent(inout) :: self
        type(error_type), allocatable, intent(out) :: error
        integer :: rows(3), stat, i

        ! These arrays are not in use yet; store the start in them.
        self%next%dq(:) = self%state%q
        self%next%dqd(:) = self%state%qd
        call begin_chart(self, stat)
        if (self%is_sparse .and. stat == status_rank_deficient) then
            call omit_redundant_rows(self, stat, error)
            if (allocated(error)) return
        end if
        if (self%is_sparse .and. any(stat == [status_rank_deficient, status_singular_mass])) then
            call leave_sparse(self, stat, error)
            if (allocated(error)) return
            call begin_chart(self, stat)
        end if
        if (stat == status_ok) call measure(self, rows, stat)
        if (stat == status_rank_deficient .or. (stat == status_ok .and. .not. self%is_sparse .and. may_hide_redundancy(self))) then
            call drop_redundant_rows(self, stat == status_rank_deficient, error)
            if (allocated(error)) return
            call self%chart%set_origin(self%state%t, self%state%q, self%state%qd, .false., self%state%dq, stat)
            if (stat == status_ok) call measure(self, rows, stat)
        end if
        if (stat /= status_ok) then
            call self%fail(stat, 'at the start', error, before_steps)
            return
        end if
        do i = 1, 2
            if (self%errors(i) <= self%options%start_tolerance) cycle
            call set_error(error, status_inconsistent_start, 'the start violates the '//trim(level_name(i))// &
                ' constraint "'//self%model%row_name(rows(i))//'" by '//to_text(self%errors(i))// &
                ' of its natural scale (allowed: '//to_text(self%options%start_tolerance)//')', &
                trim(merge('correct the position or velocity that it restricts', &
                'give q0 and qd0 that satisfy it                   ', self%model%composes_labels))// &
                ', or assemble the start')
            return
        end do
        if (any(self%errors(1:2) > self%options%constraint_tolerance)) call remove_errors(self, stat)
        if (stat /= status_ok) then
            call self%fail(stat, 'at the start', error, before_steps)
            return
        end if
        self%tally%start_moved_q = maxval(abs(self%next%dq - self%state%q))
        self%tally%start_moved_qd = maxval(abs(self%next%dqd - self%state%qd))
        if (allocated(self%model%warning)) call self%warn(self%model%warning)
        call self%renew_chart(by_start, error)
        if (allocated(error)) return
        associate (state => self%state)
            call self%chart%accelerate(state%t, state%q, state%qd, step_end, state%qdd, stat)
        end associate
        if (stat /= status_ok) then
            call self%fail(stat, 'at the start', error, before_steps)
            return
        end if
        call self%measure_errors(error)
        if (.not. allocated(error)) call warn_of_integrable_rows(self)
    end subroutine accept_state

    !> Let a sparse chart omit redundant rows, and report them.
    subroutine omit_redundant_rows(self, stat, error)
        class(simulation_type), intent(inout) :: self
        !> ok, or the reason for which a dense chart is required.
        integer, intent(out) :: stat
        type(error_type), allocatable, intent(out) :: error
        integer, allocatable :: partners(:), first(:)
        integer :: i, level, row
        !> Largest number of rows that are reported with the rows they depend on; largest number of coordinates for a dense chart.
        integer, parameter :: most_reported = 100, most_dense = 300

        associate (state => self%state, model => self%model)
            call self%chart%leave_out_dependent(state%t, state%q, state%qd, stat)
            if (stat /= status_ok) return
            call compare_omitted(self, row, level)
            if (row > 0 .and. may_leave_sparse(self) .and. model%n <= most_dense) then
                ! A dense chart finds all rows that are concerned.
                stat = status_rank_deficient
                return
            end if
            if (row > 0) then
                call report_row(self, row, level, error)
                return
            end if
            self%n_redundant = self%chart%n_dropped
            call self%chart%find_partners(self%chart%left_out(:min(self%n_redundant, most_reported)), first, partners)
            do i = 1, min(self%n_redundant, most_reported)
                associate (dropped => self%chart%left_out(i))
                    call self%warn('the constraint "'//model%row_name(dropped)//'" repeats'// &
                        trim(self%with_rows(partners(first(i):first(i + 1) - 1), dropped, ' '))// &
                        ' and was left out; the multipliers are those of least norm', is_note=.true.)
                end associate
            end do
            if (self%n_redundant > most_reported) call self%warn(to_text(self%n_redundant - most_reported)// &
                ' further constraints are redundant and were left out', is_note=.true.)
        end associate
    end subroutine omit_redundant_rows

    !> Find an omitted row that contradicts the others at the start, or does not depend on them at points nearby. It must be
    !> satisfied at points that satisfy the other rows.
    subroutine compare_omitted(self, row, level)
        class(simulation_type), intent(inout) :: self
        !> Row, 0 if there is none; level of the contradiction, 0 if the row depends on the others at the start only.
        integer, intent(out) :: row, level
        !> Distance of the points in coordinate scales; largest errors of a row at the three levels. gamma may be computed by
        !> differences.
        real(wp), parameter :: distance = 1.0e-3_wp, largest_error(3) = [1.0e-9_wp, 1.0e-9_wp, 1.0e-6_wp]
        integer, parameter :: n_points = 3
        type(measure_type) :: measured
        real(wp) :: errors(3), scale(self%model%n)
        integer :: i, k, rows(3), stat

        scale = self%model%scales()
        associate (state => self%state, point => self%next, chart => self%chart)
            do k = 0, n_points
                row = 0
                level = 1
                ! First the start itself, then points in arbitrary directions.
                state%dq(:) = 0.0_wp
                if (k > 0) state%dq(:) = distance*scale*[(sin(real(k + i*(k + 1), wp)), i=1, size(scale))]
                state%dqd(:) = 0.0_wp
                call chart%restore(state%t, state%dq, state%dqd, step_end, point%q, point%qd, stat)
                if (stat == status_position_diverged) row = chart%failure%row
                if (k == 0) then
                    if (stat == status_chart_left) then
                        level = 2
                        row = chart%failure%row
                    end if
                    if (stat == status_ok) call chart%accelerate(state%t, point%q, point%qd, step_end, point%qdd, stat)
                    if (stat == status_ok) call chart%find_errors(state%t, point%q, point%qd, point%qdd, errors, rows, stat)
                    if (stat == status_ok) then
                        level = findloc(errors > largest_error, .true., dim=1)
                        if (level > 0) row = rows(level)
                    end if
                else if (stat == status_ok) then
                    call chart%measure(need_rank, state%t, state%q, state%t, point%q, point%qd, measured, stat)
                    if (stat == status_ok .and. .not. measured%room > 0.0_wp) row = chart%failure%row
                end if
                if (row == 0 .or. all(chart%left_out /= row)) cycle
                if (k > 0) level = 0
                exit
            end do
            state%dq(:) = 0.0_wp
            state%dqd(:) = 0.0_wp
            if (row > 0 .and. all(chart%left_out /= row)) row = 0
        end associate
    end subroutine compare_omitted

    !> Report a dependent row that contradicts the others, or that depends on them only at the start (level 0).
    subroutine report_row(self, row, level, error)
        class(simulation_type), intent(inout) :: self
        integer, intent(in) :: row, level
        type(error_type), allocatable, intent(out) :: error
        integer, allocatable :: partners(:), first(:)

        call self%chart%find_partners([row], first, partners)
        if (level > 0) then
            call set_error(error, status_inconsistent_rows, 'the constraint "'//self%model%row_name(row)// &
                '" depends on'//trim(self%with_rows(partners, 0, ' '))//' and contradicts it in the '// &
                trim(level_name(level))//' at the start')
            return
        end if
        self%chart%failure%row = row
        self%chart%failure%rows = [row, partners]
        call self%fail(status_rank_deficient, beside_start, error, before_steps)
    end subroutine report_row

    !> True if a dense chart may replace the sparse one, because the user has specified neither.
    pure logical function may_leave_sparse(self)
        class(simulation_type), intent(in) :: self

        may_leave_sparse = self%options%chart_kind == chart_kinds(1) .and. .not. allocated(self%own%chart)
    end function may_leave_sparse

    !> Change to the dense chart, unless the user has specified the sparse one. The dense chart can analyse coordinates without mass
    !> that no row determines, and redundant rows that the sparse chart cannot separate.
    subroutine leave_sparse(self, stat, error)
        class(simulation_type), intent(inout) :: self
        !> Status of the sparse chart at the start.
        integer, intent(in) :: stat
        type(error_type), allocatable, intent(out) :: error

        if (.not. may_leave_sparse(self)) then
            if (stat == status_rank_deficient) then
                call set_error(error, status_invalid_option, 'the chart is sparse, but the constraint "'// &
                    self%model%row_name(self%chart%failure%row)//'" depends on others at the start', &
                    'remove it if it is redundant, or use chart_kind = "dense"')
            else
                call set_error(error, status_invalid_option, 'the chart is sparse, but the coordinate "'// &
                    self%model%coordinate_label(self%chart%failure%coordinate)//'" has no mass', &
                    'give its body mass and inertia, or use chart_kind = "dense"')
            end if
            return
        end if
        self%is_sparse = .false.
        call self%allocate_chart()
        if (self%has_surplus_rows()) return
        call self%chart%attach(self%model, self%options, self%method%implicit, self%method%damps, error)
    end subroutine leave_sparse

    !> Construct a chart with all rows at the start.
    subroutine begin_chart(self, stat)
        class(simulation_type), intent(inout) :: self
        integer, intent(out) :: stat

        stat = status_rank_deficient
        if (self%has_surplus_rows()) return
        call self%chart%set_origin(self%state%t, self%state%q, self%state%qd, .false., self%state%dq, stat)
    end subroutine begin_chart

    module procedure has_surplus_rows
        has_surplus_rows = .not. self%is_sparse .and. self%model%n_constraints() > self%model%n
    end procedure has_surplus_rows

    !> Evaluate the constraint errors of the start.
    subroutine measure(self, rows, stat)
        class(simulation_type), intent(inout) :: self
        integer, intent(out) :: rows(3), stat

        associate (state => self%state)
            call self%chart%find_errors(state%t, state%q, state%qd, state%qdd, self%errors, rows, stat)
        end associate
    end subroutine measure

    !> True if rows may be dependent on the manifold, since errors of the start can hide this.
    logical function may_hide_redundancy(self)
        class(simulation_type), intent(in) :: self

        may_hide_redundancy = self%errors(1) <= self%options%start_tolerance .and. &
            self%chart%independence <= 1.0e3_wp*self%errors(1)
    end function may_hide_redundancy

    !> Move the start onto the constraints by operations of the chart for points off the manifold.
    subroutine remove_errors(self, stat)
        class(simulation_type), intent(inout) :: self
        integer, intent(out) :: stat

        associate (state => self%state)
            state%dq = 0.0_wp
            state%dqd = 0.0_wp
            call self%chart%restore(state%t, state%dq, state%dqd, step_end, self%next%q, self%next%qd, stat)
            if (stat /= status_ok) return
            state%q = self%next%q
            state%qd = self%next%qd
        end associate
    end subroutine remove_errors

    !> Find redundant rows and construct a chart without them. The start then satisfies all rows.
    subroutine drop_redundant_rows(self, is_deficient, error)
        class(simulation_type), intent(inout) :: self
        !> True if a chart with all rows is impossible.
        logical, intent(in) :: is_deficient
        type(error_type), allocatable, intent(out) :: error
        type(redundancy_type), allocatable :: redundancy
        integer, allocatable :: kept(:)
        integer :: stat, i, k

        allocate (redundancy)
        associate (state => self%state, options => self%options, model => self%model)
            call redundancy%analyse(model, model%scales(), state%t, state%q, state%qd, options%constraint_tolerance, &
                self%chart%counts, stat)
            if (stat == status_inconsistent_rows) then
                k = findloc(redundancy%dropped, redundancy%failed_row, dim=1)
                if (size(redundancy%partners(k)) == 0) then
                    call set_error(error, stat, 'the constraint "'//model%row_name(redundancy%failed_row)// &
                        '" has no gradient at the start, and its '//trim(level_name(redundancy%failed_level))// &
                        ' is violated there', 'start elsewhere, or correct the row')
                    return
                end if
                call set_error(error, stat, 'the constraint "'//model%row_name(redundancy%failed_row)// &
                    '" depends on'//trim(self%with_rows(redundancy%partners(k), 0, ' '))//' and contradicts it in the '// &
                    trim(level_name(redundancy%failed_level))//' at the start')
                return
            else if (stat == status_rank_deficient .or. (is_deficient .and. stat == status_ok .and. &
                size(redundancy%dropped) == 0)) then
                if (self%chart%failure%row == 0 .and. redundancy%failed_row > 0) then
                    self%chart%failure%row = redundancy%failed_row
                    self%chart%failure%rows = redundancy%partners(findloc(redundancy%dropped, redundancy%failed_row, dim=1))
                end if
                call self%fail(status_rank_deficient, beside_start, error, before_steps)
                return
            else if (stat /= status_ok) then
                call self%fail(stat, 'at the start', error, before_steps)
                return
            end if
            ! An error above the tolerance is not corrected silently; the start is refused with the remaining rows.
            if (redundancy%error <= options%start_tolerance) state%q = redundancy%q
            if (size(redundancy%dropped) == 0) return
            self%n_redundant = size(redundancy%dropped)
            do i = 1, size(redundancy%dropped)
                if (size(redundancy%partners(i)) == 0) then
                    call self%warn('the constraint "'//model%row_name(redundancy%dropped(i))// &
                        '" restricts nothing and was left out', is_note=.true.)
                else
                    call self%warn('the constraint "'//model%row_name(redundancy%dropped(i))//'" repeats'// &
                        trim(self%with_rows(redundancy%partners(i), 0, ' '))// &
                        ' and was left out; the multipliers are those of least norm', is_note=.true.)
                end if
            end do
        end associate
        call move_alloc(redundancy%kept, kept)
        ! Release the analysis first, because it is as large as a chart.
        deallocate (redundancy)
        call use_rows(self, kept, error)
    end subroutine drop_redundant_rows

    module procedure choose_rows_anew
        type(redundancy_type) :: redundancy
        type(error_type), allocatable :: error
        integer :: n

        if (self%is_sparse) then
            n = self%chart%n_dropped
            call self%chart%leave_out_dependent(self%state%t, self%state%q, self%state%qd, stat)
            if (stat == status_ok .and. self%chart%n_dropped /= n) stat = status_rank_deficient
            return
        end if
        call redundancy%choose(self%model, self%model%scales(), self%state%t, self%state%q, self%chart%counts, stat)
        if (stat /= status_ok) return
        if (size(redundancy%dropped) /= self%chart%n_dropped) then
            stat = status_rank_deficient
            return
        end if
        call use_rows(self, redundancy%kept, error)
        if (allocated(error)) then
            stat = error%stat
            return
        end if
        ! The state retains the rounding error that the previous chart has found.
        self%next%dq(:) = 0.0_wp
        call self%chart%set_origin(self%state%t, self%state%q, self%state%qd, .false., self%next%dq, stat)
    end procedure choose_rows_anew

    !> Construct a chart that uses some of the rows.
    subroutine use_rows(self, kept, error)
        class(simulation_type), intent(inout) :: self
        !> Indices of the rows, in increasing order.
        integer, intent(in) :: kept(:)
        type(error_type), allocatable, intent(out) :: error
        type(counts_type) :: counts
        real(wp) :: best

        ! Release the previous chart first; both together would take twice the memory.
        counts = self%chart%counts
        best = self%chart%best_independence
        call self%allocate_chart()
        call self%chart%attach(self%model, self%options, self%method%implicit, self%method%damps, error, kept)
        call self%chart%continue_counts(counts, best)
    end subroutine use_rows

    !> Warn of nonholonomic rows that are integrable.
    subroutine warn_of_integrable_rows(self)
        class(simulation_type), intent(inout) :: self
        integer, allocatable :: alone(:)
        logical :: together
        integer :: i

        ! This check requires dense matrices.
        if (self%model%n_nonholonomic == 0 .or. self%is_sparse) return
        call find_integrable_rows(self%model, self%model%scales(), self%state%t, self%state%q, self%chart%counts, alone, together)
        do i = 1, size(alone)
            call self%warn('the nonholonomic constraint "'//self%model%row_name(alone(i))// &
                '" is integrable: it restricts the position, which is satisfied only if it is given as a holonomic constraint')
        end do
        if (.not. together) return
        associate (nh => self%model%n_holonomic)
            call self%warn('the nonholonomic constraints'// &
                trim(self%with_rows([(i, i=nh + 1, self%model%n_constraints())], 0, ' '))// &
                ' are jointly integrable: they restrict the position, which is satisfied only if they are given as '// &
                'holonomic constraints')
        end associate
    end subroutine warn_of_integrable_rows
end submodule tandem_simulate_start
