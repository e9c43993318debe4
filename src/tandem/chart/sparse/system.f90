! SPDX-License-Identifier: MIT
!> The terms of a model at the points of a sparse chart, and the factor of M x + C' lambda = f, C x = g there and at the chart's
!> origin, which is the start of a step. The matrix of the step's end becomes that of the next origin.
module tandem_chart_sparse_system
    use tandem_chart_normal_forces, only: normal_forces_type
    use tandem_chart_sparse_analysis, only: analysis_type
    use tandem_chart_sparse_blocks, only: read_behind
    use tandem_chart_sparse_errors, only: judge_rows
    use tandem_chart_sparse_factor, only: factor_type
    use tandem_chart_sparse_nearby, only: nearby_type
    use tandem_chart_sparse_progress, only: history_type, largest_change
    use tandem_kinds, only: wp
    use tandem_linalg_kernels, only: are_same
    use tandem_model, only: model_type
    use tandem_model_counts, only: counts_type
    use tandem_model_evaluator, only: evaluator_type
    use tandem_model_pattern, only: pattern_type
    use tandem_model_terms, only: need_force, need_gamma, need_jacobian, need_mass, need_nu, need_phi, terms_type
    use tandem_pack, only: pack_type
    use tandem_status, only: status_not_finite, status_ok, status_singular_mass
    implicit none (type, external)
    private

    public :: system_type

    type :: system_type
        type(evaluator_type) :: model
        type(analysis_type) :: analysis
        type(pattern_type), pointer :: pattern => null()
        !> Factors at the origin, and at the last point; they may coincide.
        type(factor_type) :: factor(2)
        integer :: base = 1, here = 1
        !> Smallest pivot of all factors of a step.
        real(wp) :: lowest = 1.0_wp
        !> True if C and W exist for the last point only, and are moved from one factor to the other: explicit steps solve with the
        !> factor of the origin without them.
        logical :: shares_terms = .false.
        !> In such steps: the accelerations near a point that was factored; true if the factor of a nearby point is reused at the
        !> last one in place of its own.
        type(nearby_type) :: nearby
        logical :: serves = .false.
        !> Saved by `hold`: the reused factor, its W, and its point (n).
        type(factor_type) :: spare
        real(wp), allocatable :: spare_w(:, :), spare_q(:)
        real(wp) :: spare_t = 0.0_wp
        logical :: is_put_aside = .false., is_held = .false.
        !> True if the factors contain the inverses of a constant M, without rows that bodies own.
        logical :: has_inverses(2) = .false.
        integer :: nh = 0, m = 0
        !> The last point; true if gamma and the forces (with the velocity `qd_point`) belong to it; true if Phi does.
        real(wp) :: t_point = 0.0_wp
        real(wp), allocatable :: q_point(:), qd_point(:)
        logical :: has_point = .false., has_motion = .false., has_phi = .false.
        !> Coordinates without mass, found at the first factorization (before, the list is not allocated), and their mass in the
        !> factors; their number; true if constraints determine them. Scales of all coordinates (n).
        integer, allocatable :: massless(:)
        real(wp), allocatable :: added(:)
        integer :: n_massless = 0
        logical :: determines_massless = .false.
        !> History of their iteration; that of the last step while points between steps are evaluated.
        type(history_type), private :: history, kept_history
        real(wp), allocatable :: scale(:)
        !> Work space of the iteration (n, m, unknowns, and coordinates without mass); allocated if there are such coordinates.
        real(wp), dimension(:), allocatable, private :: step, direction, left, no_rows, more, change, unbalanced, moved, guess
        class(model_type), pointer, private :: source => null()
        !> Friction on reactions; true if the forces of the last point contain it.
        type(normal_forces_type) :: normal_forces
        logical :: has_friction = .false.
        !> Natural scales of Phi and of C qd - nu (m, 2); true if they belong to the last point with its velocity.
        real(wp), allocatable :: scales(:, :)
        logical :: has_scales = .false.
        !> Work space: unknowns of nodes, (m), (n).
        real(wp), allocatable :: z(:), g(:), x(:)
        !> 1 over the time scale of the model.
        real(wp) :: rate = 1.0_wp
    contains
        procedure :: initialize, visit, load, factorize, insist, move_with, solve_nearby, choose_rows
        procedure, private :: lend_rows
        procedure :: hold, release
        procedure :: take_origin, forget, find_errors, find_weights
        procedure :: find_diagonal, find_multipliers, name_infinite, pack_state
        procedure :: add_friction, invert_masses, solve_here
        procedure, private :: balance, find_massless, check_massless, pack_massless
    end type system_type

    interface
        !> Invert the masses of bodies at the last point. Coordinates without mass get one.
        module subroutine invert_masses(self, stat)
            implicit none (type, external)
            class(system_type), intent(inout) :: self
            !> As of `tandem_chart_sparse_factor`.
            integer, intent(out) :: stat
        end subroutine invert_masses

        !> Find the coordinates without mass: the diagonal of their block of M is zero.
        module subroutine find_massless(self)
            implicit none (type, external)
            class(system_type), intent(inout) :: self
        end subroutine find_massless

        !> Check, once, that the constraints determine the coordinates without mass at the last point, which is factored.
        module subroutine check_massless(self, stat)
            implicit none (type, external)
            class(system_type), intent(inout) :: self
            !> ok or `singular_mass`, with the coordinate in the factor.
            integer, intent(inout) :: stat
        end subroutine check_massless

        !> Solve M x + C' lambda = f, C x = g at the last point, which is factored, also with coordinates without mass.
        module subroutine solve_here(self, f, g, x, z, largest_rest, is_acceleration, stat)
            implicit none (type, external)
            class(system_type), intent(inout) :: self
            !> (n), (m)
            real(wp), intent(in), contiguous :: f(:), g(:)
            !> As of `solve` in `tandem_chart_sparse_factor`.
            real(wp), intent(out), contiguous :: x(:)
            real(wp), intent(inout), contiguous :: z(:)
            !> Largest error of an entry of x that coordinates without mass cause, relative to the entry or to its scale.
            real(wp), intent(in) :: largest_rest
            !> True for the acceleration of the motion: the iteration begins with that of the last point.
            logical, intent(in) :: is_acceleration
            !> ok or `singular_mass`, with the coordinate in the factor.
            integer, intent(out) :: stat
        end subroutine solve_here

        !> The multipliers of M x + C' lambda = force with C x = 0 at the last point.
        module subroutine balance(self, force, lambda)
            implicit none (type, external)
            class(system_type), intent(inout) :: self
            !> (n), changed; (m)
            real(wp), intent(inout), contiguous :: force(:)
            real(wp), intent(out), contiguous :: lambda(:)
        end subroutine balance

        !> Add friction on reactions to the forces of the last point, which is factored.
        module subroutine add_friction(self, stat)
            implicit none (type, external)
            class(system_type), intent(inout) :: self
            !> A status code.
            integer, intent(out) :: stat
        end subroutine add_friction

        !> The coordinates without mass, which a new chart does not know yet.
        module subroutine pack_massless(self, pack)
            implicit none (type, external)
            class(system_type), intent(inout) :: self
            type(pack_type), intent(inout) :: pack
        end subroutine pack_massless
    end interface

contains

    !> Attach a model with a pattern.
    subroutine initialize(self, model, shares_terms)
        class(system_type), intent(inout) :: self
        class(model_type), intent(inout), target :: model
        !> True if C of the origin is used by `start_step` alone.
        logical, intent(in) :: shares_terms
        integer :: i

        call self%model%initialize(model, compressed=.true., wants_jacobian=.false.)
        self%pattern => model%pattern
        self%nh = model%n_holonomic
        self%m = model%n_constraints()
        call self%analysis%analyse(self%pattern, [(i, i=1, self%m)])
        call want_blocks(self%analysis, self%pattern)
        call model%note_blocks()
        if (.not. self%pattern%all_in_blocks) then
            deallocate (self%model%terms%jacobian)
            allocate (self%model%terms%jacobian(self%m, self%pattern%width), source=0.0_wp)
        end if
        if (allocated(self%model%terms%blocks)) deallocate (self%model%terms%blocks)
        do i = 1, 2
            call self%factor(i)%allocate(self%analysis, self%pattern, i == 1 .or. .not. shares_terms)
        end do
        self%shares_terms = shares_terms
        if (shares_terms) call self%nearby%allocate(self%analysis)
        self%spare = factor_type()
        self%is_held = .false.
        self%is_put_aside = .false.
        ! Without temporaries, which would fragment the memory.
        if (allocated(self%q_point)) deallocate (self%q_point, self%qd_point, self%x, self%z, self%g, self%scales)
        allocate (self%q_point(model%n), self%qd_point(model%n), self%x(model%n), self%z(self%analysis%n_unknowns), &
            self%g(self%m), self%scales(self%m, 2), source=0.0_wp)
        self%rate = 1.0_wp/model%time_scale
        if (allocated(self%massless)) deallocate (self%massless, self%added)
        self%source => model
        self%n_massless = 0
        self%determines_massless = .false.
        self%history = history_type()
        self%kept_history%is_kept = .false.
        if (allocated(self%scale)) deallocate (self%scale)
        allocate (self%scale, source=model%scales())
        self%normal_forces%n = 0
        if (model%n_frictions > 0) call self%normal_forces%allocate(model, self%m)
        self%has_inverses = .false.
        self%base = 1
        self%here = 1
        call self%forget()
    end subroutine initialize

    !> Set the positions of the rows of nodes by links, so that a model can store them there.
    pure subroutine want_blocks(a, pattern)
        type(analysis_type), intent(in) :: a
        type(pattern_type), intent(inout) :: pattern
        integer :: b, i, k, l

        if (allocated(pattern%in_blocks)) deallocate (pattern%in_blocks)
        pattern%all_in_blocks = .false.
        pattern%block_height = spread(0, 1, pattern%n_rows)
        pattern%block_start = spread(0, 1, size(pattern%row_body))
        do b = 1, a%n_bodies
            do l = a%link_start(b), a%link_start(b + 1) - 1
                associate (row => a%link(4, l))
                    pattern%block_height(row) = a%link(2, l)
                    do k = pattern%row_start(row), pattern%row_start(row + 1) - 1
                        if (pattern%row_body(k) == b) pattern%block_start(k) = a%link(3, l)
                    end do
                end associate
            end do
        end do
        do i = 1, pattern%n_rows
            b = pattern%owner(i)
            if (b == 0) cycle
            if (a%is_kept(b)) cycle
            pattern%block_height(i) = 1
            pattern%block_start(pattern%row_start(i)) = a%n_entries + read_behind + a%first(b) - 1
        end do
    end subroutine want_blocks

    !> Let the model overwrite the stored rows of the last point.
    subroutine lend_rows(self)
        class(system_type), intent(inout) :: self

        associate (here => self%factor(self%here), other => self%factor(3 - self%here))
            if (.not. allocated(here%w)) then
                call move_alloc(other%w, here%w)
                call move_alloc(other%alone, here%alone)
                if (.not. allocated(here%own)) call move_alloc(other%own, here%own)
                self%has_inverses(self%here) = self%has_inverses(3 - self%here)
            end if
            if (allocated(self%model%terms%blocks)) return
            if (allocated(here%c)) then
                call move_alloc(here%c, self%model%terms%blocks)
            else
                call move_alloc(other%c, self%model%terms%blocks)
            end if
        end associate
    end subroutine lend_rows

    !> Invalidate all data of the last point.
    pure subroutine forget(self)
        class(system_type), intent(inout) :: self

        self%has_point = .false.
        self%has_motion = .false.
        self%has_phi = .false.
        self%has_scales = .false.
        self%serves = .false.
        call self%nearby%forget()
    end subroutine forget

    !> Evaluate C, nu and M at (t, q), unless that was the last point.
    subroutine visit(self, t, q, counts, stat)
        class(system_type), intent(inout) :: self
        real(wp), intent(in) :: t, q(:)
        type(counts_type), intent(inout) :: counts
        integer, intent(out) :: stat
        real(wp) :: t_factor
        logical :: serves

        stat = status_ok
        serves = .false.
        if ((self%has_point .or. self%serves) .and. .not. (t > self%t_point .or. t < self%t_point)) then
            if (are_same(size(q), q, self%q_point)) then
                if (self%has_point) return
                serves = .true.
            end if
        end if
        t_factor = self%nearby%t
        call self%forget()
        if (.not. self%model%mass_is_known) self%has_inverses = .false.
        if (self%here == self%base) then
            self%here = 3 - self%base
        else if (abs(t - t_factor) <= 0.0_wp) then
            self%nearby%t = t_factor
            self%nearby%moved = self%nearby%moved + largest_change(size(q), q, self%q_point)
        end if
        self%factor(self%here)%has_rows = .false.
        self%factor(self%here)%is_factored = .false.
        call self%lend_rows()
        ! None of these depends on the velocity; q is passed in its place.
        call self%model%evaluate(need_jacobian + need_nu + need_mass, t, q, q, counts, stat)
        if (stat /= status_ok) return
        self%t_point = t
        self%q_point(:) = q
        self%has_point = .true.
        self%serves = serves
    end subroutine visit

    !> C of the last point by links.
    subroutine load(self)
        class(system_type), intent(inout) :: self

        associate (factor => self%factor(self%here))
            if (.not. factor%has_rows) call factor%load_rows(self%analysis, self%pattern, self%model%terms%jacobian, &
                self%model%terms%blocks)
        end associate
    end subroutine load

    !> The factor at the last point, unless that of a nearby point is reused.
    subroutine factorize(self, counts, stat)
        class(system_type), intent(inout) :: self
        type(counts_type), intent(inout) :: counts
        !> As of `tandem_chart_sparse_factor`.
        integer, intent(out) :: stat

        stat = status_ok
        associate (factor => self%factor(self%here))
            if (factor%is_factored) return
            call self%load()
            if (self%serves) return
            call self%nearby%forget()
            if (.not. self%has_inverses(self%here)) then
                call self%invert_masses(stat)
                self%has_inverses(self%here) = stat == status_ok .and. self%model%mass_is_known .and. &
                    .not. any(self%analysis%norm_row > 0)
            end if
            if (stat == status_ok) call factor%factorize(self%analysis, .false., stat)
            if (stat == status_ok) self%lowest = min(self%lowest, factor%least)
        end associate
        if (stat == status_ok .and. .not. self%determines_massless) call self%check_massless(stat)
        counts%constraint_factorizations = counts%constraint_factorizations + min(self%m, 1)
        counts%mass_factorizations = counts%mass_factorizations + 1
        if (stat /= status_ok) call self%name_infinite(stat)
    end subroutine factorize

    !> The factor of the last point itself.
    subroutine insist(self, counts, stat)
        class(system_type), intent(inout) :: self
        type(counts_type), intent(inout) :: counts
        integer, intent(out) :: stat

        self%serves = .false.
        call self%factorize(counts, stat)
    end subroutine insist

    !> The acceleration at the last point with the factor of a nearby point, if one can be reused.
    subroutine solve_nearby(self, scale, is_stage, largest_rest, qdd, is_solved)
        class(system_type), intent(inout) :: self
        !> (n)
        real(wp), intent(in), contiguous :: scale(:)
        !> See `tandem_chart_sparse_nearby`.
        logical, intent(in) :: is_stage
        real(wp), intent(in) :: largest_rest
        !> (n)
        real(wp), intent(out), contiguous :: qdd(:)
        logical, intent(out) :: is_solved

        is_solved = .false.
        if (self%is_held .or. .not. self%shares_terms .or. max(self%n_massless, self%normal_forces%n) > 0) return
        associate (here => self%factor(self%here))
            if (here%is_factored .or. .not. self%nearby%may_serve(self%t_point, here)) return
            call self%load()
            call self%nearby%solve(self%analysis, here, self%model%terms%mass, self%model%terms, scale, self%rate**2, is_stage, &
                self%serves, largest_rest, qdd, self%g, self%x, self%z, is_solved)
        end associate
        self%serves = is_solved
    end subroutine solve_nearby

    !> Save the start of the next step, and evaluate other points until `release`.
    subroutine hold(self)
        class(system_type), intent(inout) :: self

        self%is_held = .true.
        self%is_put_aside = self%serves .and. self%here /= self%base
        if (.not. self%is_put_aside) return
        if (.not. allocated(self%spare%y)) call self%spare%allocate(self%analysis, self%pattern, .false.)
        call self%spare%exchange(self%factor(self%here))
        self%spare_w = self%factor(self%here)%w
        self%spare_q = self%q_point
        self%spare_t = self%t_point
        call self%forget()
    end subroutine hold

    !> Restore the saved state; C and M are to be evaluated anew.
    subroutine release(self)
        class(system_type), intent(inout) :: self
        integer :: i

        if (.not. self%is_held) return
        self%is_held = .false.
        if (.not. self%is_put_aside) return
        self%is_put_aside = .false.
        call self%forget()
        self%here = 3 - self%base
        call self%spare%exchange(self%factor(self%here))
        self%factor(self%here)%is_factored = .false.
        do i = 1, 2
            if (allocated(self%factor(i)%w)) self%factor(i)%w(:, :) = self%spare_w
        end do
        self%q_point(:) = self%spare_q
        self%t_point = self%spare_t
        self%nearby%t = self%t_point
        self%serves = .true.
    end subroutine release

    !> Factor, and choose again the rows that are left out because they depend on others.
    subroutine choose_rows(self, left_out, counts, stat)
        class(system_type), intent(inout) :: self
        !> Rows that are left out in any case (m).
        logical, intent(in) :: left_out(:)
        type(counts_type), intent(inout) :: counts
        integer, intent(out) :: stat
        integer :: i

        associate (factor => self%factor(self%here))
            call self%load()
            call self%invert_masses(stat)
            if (stat == status_ok) call factor%factorize(self%analysis, .true., stat, left_out)
            counts%constraint_factorizations = counts%constraint_factorizations + 1
            counts%mass_factorizations = counts%mass_factorizations + 1
            if (stat /= status_ok) return
            do i = 1, 2
                self%factor(i)%is_out(:) = factor%is_out
                self%factor(i)%leaves_out = any(factor%is_out)
            end do
        end associate
        if (.not. self%determines_massless) call self%check_massless(stat)
    end subroutine choose_rows

    !> Evaluate also gamma and the forces at (t, q, qd), unless it was the last point.
    subroutine move_with(self, t, q, qd, counts, stat)
        class(system_type), intent(inout) :: self
        real(wp), intent(in) :: t, q(:), qd(:)
        type(counts_type), intent(inout) :: counts
        integer, intent(out) :: stat

        call self%visit(t, q, counts, stat)
        if (stat /= status_ok) return
        if (self%has_motion) then
            if (are_same(size(qd), qd, self%qd_point)) return
        end if
        self%has_motion = .false.
        self%has_friction = .false.
        self%has_scales = .false.
        counts%right_hand_sides = counts%right_hand_sides + 1
        call self%model%evaluate(need_gamma + need_force, t, q, qd, counts, stat)
        if (stat /= status_ok) return
        self%qd_point(:) = qd
        self%has_motion = .true.
    end subroutine move_with

    !> Make the last point the origin.
    pure subroutine take_origin(self)
        class(system_type), intent(inout) :: self

        self%base = self%here
    end subroutine take_origin

    !> Reciprocals of the natural scales of the rows at the last point, for Phi (nh) and for C qd - nu (m), computed with the errors
    !> at the end of a step.
    subroutine find_weights(self, q, qd, scale, of_phi, of_velocity)
        class(system_type), intent(inout) :: self
        !> (n) each.
        real(wp), intent(in), contiguous :: q(:), qd(:), scale(:)
        real(wp), intent(out) :: of_phi(:), of_velocity(:)
        real(wp) :: errors(3)
        integer :: i, rows(3)

        if (self%has_scales) self%has_scales = are_same(size(qd), qd, self%qd_point)
        ! qd is passed in place of qdd, on which the scales do not depend.
        if (.not. self%has_scales) call self%find_errors(q, qd, qd, scale, errors, rows)
        self%has_scales = .false.
        do i = 1, self%nh
            of_phi(i) = 1.0_wp/max(self%scales(i, 1), tiny(1.0_wp))
        end do
        do i = 1, self%m
            of_velocity(i) = 1.0_wp/max(self%scales(i, 2), tiny(1.0_wp))
        end do
    end subroutine find_weights

    !> The errors of the three levels on the natural scales of their rows, and the worst rows.
    subroutine find_errors(self, q, qd, qdd, scale, errors, rows)
        class(system_type), intent(inout) :: self
        !> (n) each, at the last point with its velocity.
        real(wp), intent(in), contiguous :: q(:), qd(:), qdd(:), scale(:)
        real(wp), intent(out) :: errors(3)
        integer, intent(out) :: rows(3)

        call self%load()
        call self%model%set_magnitudes(q, self%x)
        call judge_rows(self%analysis, self%factor(self%here), self%model%terms, self%nh, self%x, qd, qdd, scale, self%rate, &
            errors, rows, self%scales)
        self%has_scales = self%has_motion
    end subroutine find_errors

    !> The diagonal of M at the last point, along rows that bodies own as large as across them: there M is singular. C is loaded.
    pure subroutine find_diagonal(self, diagonal)
        class(system_type), intent(in) :: self
        !> (n)
        real(wp), intent(out) :: diagonal(:)
        real(wp) :: across, along
        integer :: b, j, k

        do j = 1, size(diagonal)
            diagonal(j) = self%model%terms%mass(j, self%pattern%mass_column(j))
        end do
        diagonal(self%massless) = self%added
        associate (a => self%analysis, own => self%factor(self%here)%own)
            do b = 1, a%n_bodies
                if (a%own_row(b) == 0) cycle
                k = a%first(b) + maxloc(abs(own(a%first(b):a%first(b + 1) - 1)), dim=1) - 1
                across = 0.0_wp
                along = tiny(1.0_wp)
                do j = a%first(b), a%first(b + 1) - 1
                    if (a%block_first(j) == a%block_first(k)) across = max(across, diagonal(j))
                    along = along + own(j)**2
                end do
                do j = a%first(b), a%first(b + 1) - 1
                    diagonal(j) = diagonal(j) + across*own(j)**2/along
                end do
            end do
        end associate
    end subroutine find_diagonal

    !> The multipliers of all rows for an acceleration, which minimise the remaining force in the mass metric:
    !> M x + C' lambda = force - M qdd with C x = 0. The last point is factored, and its forces are known. With the factor of a
    !> nearby point the solution is refined.
    subroutine find_multipliers(self, qdd, lambda)
        class(system_type), intent(inout) :: self
        !> (n)
        real(wp), intent(in), contiguous :: qdd(:)
        !> (m)
        real(wp), intent(out), contiguous :: lambda(:)
        real(wp) :: force(size(qdd))

        call self%pattern%multiply_mass(self%model%terms%mass, qdd, force)
        force = self%model%terms%force - force
        call self%balance(force, lambda)
    end subroutine find_multipliers

    !> Find the term that is not finite, if there is one, after a failure. Invalidate the point, so that it can be tried again.
    subroutine name_infinite(self, stat)
        class(system_type), intent(inout) :: self
        !> `not_finite` if a term was not finite; unchanged otherwise.
        integer, intent(inout) :: stat
        character(len=20) :: term
        real(wp) :: of_rows

        if (self%has_point) call self%load()
        of_rows = 0.0_wp
        if (allocated(self%factor(self%here)%c)) of_rows = sum(abs(self%factor(self%here)%c))
        term = ''
        associate (terms => self%model%terms)
            if (.not. sum(abs(terms%phi)) <= huge(1.0_wp)) then
                term = 'phi'
            else if (.not. sum(abs(terms%jacobian)) + of_rows <= huge(1.0_wp)) then
                term = 'jacobian'
            else if (.not. sum(abs(terms%nu)) <= huge(1.0_wp)) then
                term = 'nu'
            else if (.not. sum(abs(terms%mass)) <= huge(1.0_wp)) then
                term = 'mass'
            else if (.not. sum(abs(terms%gamma)) <= huge(1.0_wp)) then
                term = 'gamma'
            else if (.not. sum(abs(terms%force)) <= huge(1.0_wp)) then
                term = 'force'
            end if
        end associate
        call self%forget()
        if (term == '') then
            if (stat == status_not_finite) self%model%failed_term = 'the velocity'
            return
        end if
        self%model%failed_term = term
        stat = status_not_finite
    end subroutine name_infinite

    !> The last point, what was evaluated there, and both factors.
    subroutine pack_state(self, pack)
        class(system_type), intent(inout) :: self
        type(pack_type), intent(inout) :: pack
        integer :: i

        ! C is packed with the factor.
        if (self%has_point) call self%load()
        if (allocated(self%model%terms%blocks)) call move_alloc(self%model%terms%blocks, self%factor(self%here)%c)
        call self%model%pack_state(pack)
        do i = 1, 2
            call self%factor(i)%pack_state(pack)
        end do
        call pack%item(self%base, self%here)
        call pack%item(self%t_point)
        call pack%item(self%q_point, self%qd_point)
        call pack%item(self%has_point, self%has_motion, self%has_phi, self%has_friction)
        call pack%item(self%scales)
        call pack%item(self%has_scales)
        call pack%item(self%serves)
        call self%nearby%pack_state(pack)
        call self%pack_massless(pack)
    end subroutine pack_state

end module tandem_chart_sparse_system
