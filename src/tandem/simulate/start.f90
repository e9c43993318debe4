! SPDX-License-Identifier: MIT
!> The start of a simulation: consistency, redundant rows, integrable nonholonomic rows. Small errors are corrected.
submodule(tandem_simulation) tandem_simulate_start
    use tandem_status, only: status_inconsistent_rows
    use tandem_model_integrability, only: find_integrable_rows
    use tandem_model_redundancy, only: redundancy_type
    implicit none (type, external)

    character(len=12), parameter :: level_name(3) = [character(len=12) :: 'position', 'velocity', 'acceleration']

contains

    module procedure accept_start
        integer :: rows(3), stat, i
        logical :: has_changed

        ! These arrays are free here and hold copies of the start.
        self%next%dq(:) = self%state%q
        self%next%dqd(:) = self%state%qd
        call begin_chart(self, stat)
        has_changed = .false.
        if (stat == status_rank_deficient .and. .not. (self%is_sparse .or. allocated(self%blank))) then
            call enter_sparse(self, stat, has_changed, error)
            if (allocated(error)) return
        end if
        if (self%is_sparse .and. stat == status_rank_deficient) then
            if (.not. is_suspect(self, has_changed)) call leave_out_rows(self, stat)
        end if
        if (self%is_sparse .and. any(stat == [status_rank_deficient, status_singular_mass])) then
            call leave_sparse(self, stat, error)
            if (allocated(error)) return
            call begin_chart(self, stat)
        end if
        if (stat == status_ok) call measure(self, rows, stat)
        if (stat == status_ok .and. allocated(self%chart%left_out)) then
            call check_left_out(self, rows, error)
            if (allocated(error)) return
        end if
        if (stat == status_rank_deficient .or. (stat == status_ok .and. .not. self%is_sparse .and. may_hide_redundancy(self))) then
            call drop_redundant_rows(self, stat == status_rank_deficient, error)
            if (allocated(error)) return
            call self%chart%renew(self%state%t, self%state%q, self%state%qd, stat)
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
        call self%renew_chart(by_start, error)
        if (allocated(error)) return
        associate (state => self%state)
            call self%chart%solve_dynamics(state%t, state%q, state%qd, state%qdd, stat)
        end associate
        if (stat /= status_ok) then
            call self%fail(stat, 'at the start', error, before_steps)
            return
        end if
        call self%measure_errors(error)
        if (.not. allocated(error)) call look_for_integrable_rows(self)
    end procedure accept_start

    !> Change to a sparse chart if redundant rows make the dense one more expensive.
    subroutine enter_sparse(self, stat, has_changed, error)
        class(simulation_type), intent(inout) :: self
        !> Status of the chart at the start.
        integer, intent(inout) :: stat
        logical, intent(out) :: has_changed
        type(error_type), allocatable, intent(out) :: error

        has_changed = suits_redundancy(self%model, self%options, self%method%implicit, self%cost)
        if (.not. has_changed) return
        self%is_sparse = .true.
        call self%allocate_chart()
        call self%chart%initialize(self%model, self%options, self%method%implicit, error)
        if (.not. allocated(error)) call begin_chart(self, stat)
    end subroutine enter_sparse

    !> True if the dependent rows at the start are not redundant, but contradict each other or depend only there: a dense chart
    !> reports that. Sparse charts of larger models, and those that the user has chosen, do not look beside the start.
    logical function is_suspect(self, has_changed)
        class(simulation_type), intent(inout) :: self
        !> True if a dense chart would look.
        logical, intent(in) :: has_changed
        !> Largest number of coordinates for which singular values are cheap.
        integer, parameter :: most = 30
        type(redundancy_type), allocatable :: redundancy
        integer :: stat

        is_suspect = .false.
        if (self%options%chart_kind /= chart_kinds(1) .or. allocated(self%blank)) return
        if (self%model%n > most .and. .not. has_changed) return
        allocate (redundancy)
        associate (state => self%state, model => self%model)
            call redundancy%analyse(model, model%scales(), state%t, state%q, state%qd, self%options%constraint_tolerance, &
                self%chart%counts, stat)
        end associate
        is_suspect = stat /= status_ok
    end function is_suspect

    !> Let a sparse chart leave out redundant rows, and report them.
    subroutine leave_out_rows(self, stat)
        class(simulation_type), intent(inout) :: self
        !> ok, or the reason for its failure.
        integer, intent(out) :: stat
        integer, allocatable :: partners(:), first(:)
        integer :: i
        !> Largest number of rows reported with their partners.
        integer, parameter :: most_told = 100

        associate (state => self%state, model => self%model)
            call self%chart%leave_out_dependent(state%t, state%q, state%qd, stat)
            if (stat /= status_ok) return
            self%n_redundant = self%chart%n_dropped
            call self%chart%find_partners(self%chart%left_out(:min(self%n_redundant, most_told)), first, partners)
            do i = 1, min(self%n_redundant, most_told)
                associate (row => self%chart%left_out(i))
                    call self%warn('the constraint "'//model%row_name(row)//'" repeats'// &
                        trim(self%with_rows(partners(first(i):first(i + 1) - 1), row, ' '))// &
                        ' and was left out; the multipliers are those of least norm', is_note=.true.)
                end associate
            end do
            if (self%n_redundant > most_told) call self%warn(to_text(self%n_redundant - most_told)// &
                ' further constraints are redundant and were left out', is_note=.true.)
        end associate
    end subroutine leave_out_rows

    !> A row that depends on others must not contradict them.
    subroutine check_left_out(self, rows, error)
        class(simulation_type), intent(inout) :: self
        !> The worst rows of the levels.
        integer, intent(in) :: rows(3)
        type(error_type), allocatable, intent(out) :: error
        integer, allocatable :: partners(:), first(:)
        integer :: i

        do i = 1, 2
            if (self%errors(i) <= self%options%start_tolerance .or. all(self%chart%left_out /= rows(i))) cycle
            call self%chart%find_partners(rows(i:i), first, partners)
            call set_error(error, status_inconsistent_rows, 'the constraint "'//self%model%row_name(rows(i))// &
                '" depends on'//trim(self%with_rows(partners, 0, ' '))//' and contradicts it in the '// &
                trim(level_name(i))//' at the start')
            return
        end do
    end subroutine check_left_out

    !> Bodies without mass and redundant rows among nonholonomic ones require the dense chart: use it unless the user has chosen the
    !> sparse one.
    subroutine leave_sparse(self, stat, error)
        class(simulation_type), intent(inout) :: self
        !> Status of the sparse chart at the start.
        integer, intent(in) :: stat
        type(error_type), allocatable, intent(out) :: error

        if (self%options%chart_kind /= chart_kinds(1) .or. allocated(self%blank)) then
            if (stat == status_rank_deficient) then
                call set_error(error, status_invalid_option, 'the chart is sparse, but the constraint "'// &
                    self%model%row_name(self%chart%failed_row)//'" depends on others at the start', &
                    'remove it if it is redundant, or use chart_kind = "dense"')
            else
                call set_error(error, status_invalid_option, 'the chart is sparse, but the coordinate "'// &
                    self%model%coordinate_label(self%chart%failed_coordinate)//'" has no mass', &
                    'give its body mass and inertia, or use chart_kind = "dense"')
            end if
            return
        end if
        self%is_sparse = .false.
        call self%allocate_chart()
        if (.not. self%has_surplus_rows()) call self%chart%initialize(self%model, self%options, self%method%implicit, error)
    end subroutine leave_sparse

    !> Make a chart of all rows at the start.
    subroutine begin_chart(self, stat)
        class(simulation_type), intent(inout) :: self
        integer, intent(out) :: stat

        stat = status_rank_deficient
        if (.not. self%has_surplus_rows()) call self%chart%renew(self%state%t, self%state%q, self%state%qd, stat)
    end subroutine begin_chart

    module procedure has_surplus_rows
        has_surplus_rows = .not. self%is_sparse .and. self%model%n_constraints() > self%model%n
    end procedure has_surplus_rows

    !> The constraint errors of the start.
    subroutine measure(self, rows, stat)
        class(simulation_type), intent(inout) :: self
        integer, intent(out) :: rows(3), stat

        associate (state => self%state)
            call self%chart%constraint_errors(state%t, state%q, state%qd, state%qdd, self%errors, rows, stat)
        end associate
    end subroutine measure

    !> Rows that depend on each other on the manifold do so only up to the error of the start.
    logical function may_hide_redundancy(self)
        class(simulation_type), intent(in) :: self

        may_hide_redundancy = self%errors(1) <= self%options%start_tolerance .and. &
            self%chart%independence <= 1.0e3_wp*self%errors(1)
    end function may_hide_redundancy

    !> Bring the start onto the constraints by the chart's operations for points beside the manifold.
    subroutine remove_errors(self, stat)
        class(simulation_type), intent(inout) :: self
        integer, intent(out) :: stat

        associate (state => self%state)
            state%dq = 0.0_wp
            state%dqd = 0.0_wp
            call self%chart%restore_position(state%t, state%dq, self%next%q, stat)
            if (stat == status_ok) call self%chart%restore_velocity(state%t, self%next%q, state%dqd, self%next%qd, stat)
            if (stat /= status_ok) return
            state%q = self%next%q
            state%qd = self%next%qd
        end associate
    end subroutine remove_errors

    !> Find redundant rows and make a chart without them; the start is then on all rows.
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
                if (self%chart%failed_row == 0 .and. redundancy%failed_row > 0) then
                    self%chart%failed_row = redundancy%failed_row
                    self%chart%failed_rows = redundancy%partners(findloc(redundancy%dropped, redundancy%failed_row, dim=1))
                end if
                call self%fail(status_rank_deficient, 'at the start, but not near it (a singular configuration)', error, &
                    before_steps)
                return
            else if (stat /= status_ok) then
                call self%fail(stat, 'at the start', error, before_steps)
                return
            end if
            ! A larger error than the tolerance is not corrected silently: the start is refused with the remaining rows.
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
        ! Its memory is as large as that of a chart.
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
        call self%chart%renew(self%state%t, self%state%q, self%state%qd, stat)
    end procedure choose_rows_anew

    !> A chart that uses some of the rows.
    subroutine use_rows(self, kept, error)
        class(simulation_type), intent(inout) :: self
        !> Their numbers, ascending.
        integer, intent(in) :: kept(:)
        type(error_type), allocatable, intent(out) :: error
        type(counts_type) :: counts
        real(wp) :: best

        counts = self%chart%counts
        best = self%chart%best_independence
        call self%allocate_chart()
        call self%chart%initialize(self%model, self%options, self%method%implicit, error, kept)
        self%chart%counts = counts
        self%chart%best_independence = best
    end subroutine use_rows

    !> Warn of nonholonomic rows that are integrable.
    subroutine look_for_integrable_rows(self)
        class(simulation_type), intent(inout) :: self
        integer, allocatable :: alone(:)
        logical :: together
        integer :: i

        ! This requires dense matrices.
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
    end subroutine look_for_integrable_rows
end submodule tandem_simulate_start
