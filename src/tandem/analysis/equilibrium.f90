! SPDX-License-Identifier: MIT
!> Search for an equilibrium: Newton's iteration with the saddle-point matrix [K, C'; C, 0], damped by the natural monotonicity test
!> (P. Deuflhard, Newton Methods for Nonlinear Problems, 2004, section 4.4). If it fails, the motion without inertia D q' = forces,
!> by implicit steps with mu D + K, each of which goes downhill, with a mu that falls towards rest (C. T. Kelley, D. E. Keyes, SIAM
!> J. Numer. Anal. 35, 1998), which finds a stable equilibrium, and Newton's iteration again. D measures rotations rather than
!> positions: with M the far end of a chain would wait until a bend has passed through all of it. The work is bounded.
!>
!> Corrections have least norm if K is singular, so that the iteration leads to the nearest member of a family of equilibria. This
!> requires full matrices. Sparse ones are used if they cost less and are regular; with them rows at velocity level hold: the
!> coordinates move in the directions that these allow.
module tandem_analysis_equilibrium
    use tandem_analysis_sparse_point, only: sparse_point_type
    use tandem_error, only: error_type, set_error, to_text
    use tandem_kinds, only: wp
    use tandem_model, only: label_length, model_type
    use tandem_model_pattern, only: pattern_type
    use tandem_saddle, only: saddle_singular, saddle_type
    use tandem_saddle_choice, only: allocate_saddle, suits_sparse
    use tandem_saddle_dense, only: dense_saddle_type
    use tandem_status, only: status_no_equilibrium, status_not_finite, status_ok, status_singular_mass, status_work_limit
    implicit none (type, external)
    private

    public :: moved_reason, settle

    !> Reason why a mechanism has no equilibrium, appended to a message.
    character(len=*), parameter :: moved_reason = '; its constraints impose a motion, so that no equilibrium exists'

    !> Largest number of iterations of Newton, and of implicit steps.
    integer, parameter :: most_iterations = 60, most_relaxations = 400
    !> Full matrices above the first number of coordinates take minutes; a search that failed with sparse ones is repeated with full
    !> ones up to the second number. Their factors in each part of a search are limited to `most_operations` over n^2, and at least
    !> to `least_factors`.
    integer, parameter :: most_full = 1000, most_repeated = 500, least_factors = 60
    real(wp), parameter :: most_operations = 2.0e7_wp
    !> The longest step over the size of the coordinates: a long chain swings far.
    real(wp), parameter :: longest = 0.5_wp
    !> Forces are in balance if their residual is at most this part of their terms.
    real(wp), parameter :: balance_bound = 1.0e-9_wp

    !> A search by one kind of factors.
    type :: search_type
        type(sparse_point_type) :: point
        !> [K, C'; C, 0] or [mu D + K, C'; C, 0].
        class(saddle_type), allocatable :: saddle
        logical :: is_sparse = .false.
        !> True in Newton's iteration, false in the steps along the forces.
        logical :: is_newton = .true.
        !> True if a sparse matrix was singular.
        logical :: is_singular = .false.
        !> Factors so far, and their limit.
        integer :: n_factors = 0, most_factors = huge(1)
        integer :: iterations = 0, relaxations = 0, n_free = 0
    contains
        procedure :: attach, run, iterate, factor_with, correct, balance_rows, compare_forces, imposed_motion, relax
        procedure :: return_to_rows
    end type search_type

contains

    !> Find the equilibrium near q. Errors: no_equilibrium, invalid_model if there is no sparse form for so many coordinates,
    !> and statuses of evaluating the model.
    subroutine settle(model, t, q, iterations, relaxations, n_free, error)
        class(model_type), intent(inout), target :: model
        real(wp), intent(in) :: t
        !> The start (n), which need not satisfy the constraints; the equilibrium.
        real(wp), intent(inout) :: q(:)
        integer, intent(out) :: iterations, relaxations
        !> Dimension of the family of equilibria, 0 if sparse factors were sufficient.
        integer, intent(out) :: n_free
        type(error_type), allocatable, intent(out) :: error
        type(search_type), allocatable :: search
        type(pattern_type), target :: whole
        real(wp) :: start(size(q))
        logical :: may_be_sparse
        integer :: i, stat

        start = q
        iterations = 0
        relaxations = 0
        n_free = 0
        may_be_sparse = .false.
        if (allocated(model%pattern)) may_be_sparse = suits_sparse(model%pattern) .and. .not. any(model%is_idle())
        do i = 1, 2
            if (i == 1 .and. .not. may_be_sparse) cycle
            if (allocated(search)) deallocate (search)
            allocate (search)
            call search%attach(model, i == 1, whole, error)
            if (allocated(error)) then
                if (i == 1 .and. model%n <= most_full) cycle
                return
            end if
            q = start
            call search%run(t, q, stat)
            iterations = search%iterations
            relaxations = search%relaxations
            n_free = search%n_free
            if (stat /= status_no_equilibrium .or. .not. search%is_singular .or. model%n > most_repeated) exit
        end do
        call refuse(search, stat, error)
    end subroutine settle

    !> Set the error of a failed search.
    subroutine refuse(search, stat, error)
        type(search_type), intent(in) :: search
        integer, intent(in) :: stat
        type(error_type), allocatable, intent(out) :: error
        character(len=:), allocatable :: reason, advice
        logical :: moves

        if (stat == status_ok) return
        moves = any(abs(search%point%evaluator%terms%nu) > 0.0_wp)
        associate (name => search%point%model%name)
            if (stat /= status_ok .and. stat /= status_no_equilibrium) then
                advice = ''
                if (stat == status_not_finite) advice = 'start elsewhere: a term is not a number there, such as the '// &
                    'direction of a rod of length zero'
                call set_error(error, stat, 'the model "'//name//'" cannot be evaluated in the search for its equilibrium', advice)
                return
            end if
            reason = ''
            if (search%n_factors >= search%most_factors) reason = ', the limit for so many coordinates'
            if (moves) reason = moved_reason
            call set_error(error, status_no_equilibrium, 'no equilibrium of the model "'//name//'" was found in '// &
                to_text(search%iterations)//' iterations and '//to_text(search%relaxations)//' steps along the forces'//reason)
        end associate
    end subroutine refuse

    !> Attach a model.
    subroutine attach(self, model, is_sparse, whole, error)
        class(search_type), intent(inout) :: self
        class(model_type), intent(inout), target :: model
        logical, intent(in) :: is_sparse
        !> Set to the pattern of full matrices unless sparse ones are used. It must outlive the search.
        type(pattern_type), intent(inout), target :: whole
        type(error_type), allocatable, intent(out) :: error
        integer :: i

        self%is_sparse = is_sparse
        if (is_sparse) then
            call self%point%initialize(model, error)
            if (allocated(error)) return
        else
            associate (n => model%n, m => model%n_constraints())
                call whole%build([1, n + 1], [n], m, [(i, i=1, m)], [(1, i=1, m)], [(0, i=1, m)])
                self%most_factors = max(least_factors, int(most_operations/real(n, wp)**2))
            end associate
            call allocate_saddle(.false., self%point%ties)
            call self%point%attach(model, whole, is_compressed=.false.)
        end if
        call allocate_saddle(is_sparse, self%saddle)
        call self%saddle%analyse(self%point%pattern, self%point%scale)
    end subroutine attach

    !> All parts of the search.
    subroutine run(self, t, q, stat)
        class(search_type), intent(inout) :: self
        real(wp), intent(in) :: t
        real(wp), intent(inout) :: q(:)
        integer, intent(out) :: stat
        real(wp) :: start(size(q))

        !> Error of a violated row that no coordinate changes, such as the length of a rod between coinciding points.
        real(wp), parameter :: infinite = 1.0e100_wp
        logical :: has_direction

        start = q
        call self%point%look(t, q, stat)
        if (stat /= status_ok) return
        has_direction = self%point%violation() < infinite
        call self%iterate(t, self%is_sparse, q, stat)
        if (stat == status_no_equilibrium) then
            q = start
            call self%relax(t, q, stat)
            if (stat == status_ok) call self%iterate(t, .false., q, stat)
            ! If the start is evaluable, a failing point was reached by the search itself.
            if (stat /= status_ok .and. self%relaxations > 1 .and. stat /= status_work_limit) stat = status_no_equilibrium
        end if
        if (stat == status_no_equilibrium .and. self%is_sparse) then
            q = start
            call self%iterate(t, .false., q, stat)
        end if
        if (stat == status_no_equilibrium .and. .not. has_direction) stat = status_not_finite
    end subroutine run

    !> Newton's iteration.
    subroutine iterate(self, t, stays_near, q, stat)
        class(search_type), intent(inout) :: self
        real(wp), intent(in) :: t
        !> True to end when steps must be shortened much: from there on any equilibrium may be reached, however far.
        logical, intent(in) :: stays_near
        real(wp), intent(inout) :: q(:)
        integer, intent(out) :: stat
        real(wp), parameter :: least_factor = 0.2_wp
        real(wp), dimension(size(q)) :: step, next, from
        real(wp), dimension(self%point%m) :: more, unused, lambda
        real(wp) :: factor, size_of_q, length
        logical :: is_last
        integer :: i, tries

        self%n_factors = 0
        self%is_newton = .true.
        associate (point => self%point)
            call point%look(t, q, stat)
            if (stat == status_ok) call self%balance_rows(stat)
            if (stat /= status_ok) return
            is_last = .false.
            do i = 1, most_iterations
                self%iterations = self%iterations + 1
                call point%differentiate(.false., stat)
                if (stat /= status_ok) return
                call point%balance()
                call self%factor_with(spread(0.0_wp, 1, point%n), stat)
                if (stat /= status_ok) return
                self%n_free = self%saddle%n_free - count(point%model%is_idle())
                call self%correct(step, more)
                length = maxval(abs(step/point%scale))
                size_of_q = 1 + maxval(abs(q/point%scale))
                if (length <= 1.0e-14_wp*size_of_q .or. (is_last .and. length <= 1.0e-10_wp*size_of_q)) then
                    if (.not. max(point%imbalance(), point%violation(), self%imposed_motion()) <= balance_bound) stat = &
                        status_no_equilibrium
                    return
                end if
                from = q
                lambda = point%lambda
                factor = min(1.0_wp, longest*merge(size_of_q, 1.0_wp, self%is_sparse)/length)
                do tries = 1, 30
                    q = from + factor*step
                    point%lambda = lambda + factor*more
                    call point%look(t, q, stat)
                    if (stat == status_ok .and. .not. self%is_sparse) call self%balance_rows(stat)
                    if (stat == status_ok) then
                        call point%balance()
                        if (.not. self%is_sparse) call self%compare_forces()
                        call self%correct(next, unused)
                        if (norm2(next/point%scale) <= (1 - factor/4)*norm2(step/point%scale)) exit
                        ! Rounding, if the previous correction was small already: no further improvement.
                        is_last = length <= 1.0e-10_wp*size_of_q
                        if (is_last) exit
                    end if
                    factor = factor/2
                end do
                if (tries > 30 .or. (stays_near .and. factor < least_factor)) exit
            end do
        end associate
        stat = status_no_equilibrium
    end subroutine iterate

    !> Make the residual of a new point comparable with that of the point of the factors.
    subroutine compare_forces(self)
        class(search_type), intent(inout) :: self

        select type (saddle => self%saddle)
        type is (dense_saddle_type)
            select type (ties => self%point%ties)
            type is (dense_saddle_type)
                call ties%carry(saddle, self%point%residual)
            end select
        end select
    end subroutine compare_forces

    !> Largest velocity that constraints impose, in units of the model.
    real(wp) function imposed_motion(self)
        class(search_type), intent(in) :: self
        integer :: i

        imposed_motion = 0.0_wp
        associate (point => self%point)
            if (.not. any(abs(point%evaluator%terms%nu) > 0.0_wp)) return
            do i = 1, point%m
                imposed_motion = max(imposed_motion, abs(point%evaluator%terms%nu(i))*point%model%time_scale/ &
                    (point%row_length(i)*minval(point%scale)*(1 + maxval(abs(point%q/point%scale)))))
            end do
        end associate
    end function imposed_motion

    !> Multipliers that leave the smallest forces; rows that depend on others.
    subroutine balance_rows(self, stat)
        class(search_type), intent(inout) :: self
        integer, intent(out) :: stat
        real(wp), allocatable :: unused(:)

        stat = status_singular_mass
        if (self%is_sparse) call self%point%find_dependent_rows(unused, stat)
        if (stat == status_singular_mass) call self%point%find_dependent_rows(unused, stat, 1/self%point%scale**2)
    end subroutine balance_rows

    !> The factors of [mu D + K, C'; C, 0] at the point, with known K.
    subroutine factor_with(self, diagonal, stat)
        class(search_type), intent(inout) :: self
        !> Diagonal of mu D (n).
        real(wp), intent(in) :: diagonal(:)
        !> no_equilibrium if it is singular, or after too many factors.
        integer, intent(out) :: stat
        real(wp) :: h(size(self%point%stiffness))
        integer :: i

        stat = status_no_equilibrium
        if (self%n_factors >= self%most_factors) return
        self%n_factors = self%n_factors + 1
        associate (point => self%point)
            h = point%stiffness
            call point%columns%add_diagonal(diagonal, h)
            self%saddle%is_out = point%is_out
            self%saddle%size_of_h = norm2(point%scale*point%evaluator%terms%force)
            call self%saddle%load(h, point%evaluator%terms%jacobian)
            select type (saddle => self%saddle)
            type is (dense_saddle_type)
                ! Rows at velocity level require nu = 0, as in the centre of a turntable, and are no conditions if they impose no
                ! motion.
                if (self%is_newton .and. point%m > point%nh) call saddle%load_below(point%turning, [(i > point%nh, i=1, point%m)], &
                    1/point%model%time_scale)
            end select
        end associate
        call self%saddle%factor(stat)
        if (stat > 0) self%is_singular = .true.
        if (stat /= 0) stat = merge(status_no_equilibrium, status_work_limit, stat == saddle_singular)
    end subroutine factor_with

    !> The correction of coordinates and multipliers.
    subroutine correct(self, step, more)
        class(search_type), intent(in) :: self
        !> (n), (m).
        real(wp), intent(out) :: step(:), more(:)
        real(wp) :: g(self%point%m)

        g = 0.0_wp
        if (self%is_newton .and. .not. self%is_sparse) g = self%point%evaluator%terms%nu
        g(:self%point%nh) = -self%point%evaluator%terms%phi
        call self%saddle%solve(-self%point%residual, g, step, more)
    end subroutine correct

    !> Move downhill along the forces to a position where they are nearly in balance. A step is accepted if it stays near the
    !> constraints, and if the forces at both of its ends together do work along it; else it is repeated with a larger mu. So a
    !> matrix that is not positive definite, or a linearisation of short reach, shortens steps, but does not change the result.
    subroutine relax(self, t, q, stat)
        class(search_type), intent(inout) :: self
        real(wp), intent(in) :: t
        real(wp), intent(inout) :: q(:)
        integer, intent(out) :: stat
        !> The part of the work at the start that may be lost at the end, and factors of mu for steps that are too long, for steps
        !> with large changes of the forces, and for others.
        real(wp), parameter :: least_work = -0.5_wp, much = 0.25_wp, shorter = 4.0_wp, longer = 0.5_wp, much_longer = 0.2_wp
        !> The lengths of the first step, of the longest one, and of one that ends the search, in weighted coordinates.
        real(wp), parameter :: first_length = 0.05_wp, longest_step = 0.5_wp, no_step = 1.0e-6_wp
        real(wp), allocatable :: pull(:)
        real(wp), dimension(size(q)) :: step, from, force, weight
        real(wp), dimension(self%point%m) :: more, lambda
        logical :: is_out(self%point%m), was_singular
        real(wp) :: mu, length, before, after
        integer :: i, tries

        self%n_factors = 0
        self%is_newton = .false.
        was_singular = self%is_singular
        associate (point => self%point)
            call point%look(t, q, stat)
            if (stat /= status_ok) return
            call weigh(point, weight)
            call point%find_dependent_rows(pull, stat, weight**2)
            if (stat == status_ok) call self%return_to_rows(t, weight, huge(1.0_wp), q, stat)
            if (stat == status_ok) call point%find_dependent_rows(pull, stat, weight**2)
            if (stat /= status_ok) return
            mu = max(maxval(abs(weight*pull))/first_length, tiny(1.0_wp))
            do i = 1, most_relaxations
                self%relaxations = self%relaxations + 1
                call point%differentiate(.false., stat, is_rough=.true.)
                if (stat /= status_ok) return
                call point%balance()
                from = q
                force = weight**2*pull
                lambda = point%lambda
                is_out = point%is_out
                do tries = 1, 30
                    if (tries > 1) then
                        q = from
                        point%lambda = lambda
                        point%is_out = is_out
                        call point%look(t, q, stat)
                        if (stat /= status_ok) return
                        call point%balance()
                    end if
                    call self%factor_with(mu*weight**2, stat)
                    if (stat == status_work_limit) return
                    if (stat == status_ok) then
                        call self%correct(step, more)
                        length = maxval(abs(weight*step))
                        before = dot_product(force, step)
                        if (length <= longest_step .and. before > 0.0_wp) then
                            q = q + step
                            call self%return_to_rows(t, weight, length, q, stat)
                            if (stat == status_ok) call point%find_dependent_rows(pull, stat, weight**2)
                            if (stat == status_ok) then
                                after = dot_product(weight**2*pull, q - from)
                                if (after >= least_work*before .or. length <= no_step) exit
                            end if
                        end if
                    end if
                    mu = shorter*mu
                end do
                ! A larger mu makes the matrix regular.
                self%is_singular = was_singular
                if (tries > 30) exit
                if (length <= no_step) return
                if (tries == 1) mu = mu*merge(much_longer, longer, after > much*before)
            end do
        end associate
        stat = status_no_equilibrium
    end subroutine relax

    !> Weights of the coordinates in the lengths of steps: 1 over their scales and over the extent of coordinates of the same unit.
    !> Positions of a long chain move as far as its bars turn.
    subroutine weigh(point, weight)
        type(sparse_point_type), intent(in) :: point
        real(wp), intent(out) :: weight(:)
        real(wp) :: reach
        character(len=label_length) :: units(point%n)
        logical :: is_done(point%n)
        integer :: i

        do i = 1, point%n
            units(i) = point%model%unit_of_coordinate(i)
        end do
        is_done = .false.
        do i = 1, point%n
            if (is_done(i)) cycle
            reach = 1 + maxval(abs(point%q/point%scale), mask=units == units(i))
            where (units == units(i))
                weight = 1/(point%scale*reach)
                is_done = .true.
            end where
        end do
    end subroutine weigh

    !> Bring coordinates onto the rows of Phi, with the factors of the last `find_dependent_rows` while these are suitable; evaluate
    !> the point there.
    subroutine return_to_rows(self, t, weight, length, q, stat)
        class(search_type), intent(inout) :: self
        !> Time; weights of the coordinates (n), and the length of the step: corrections of more than half of it are too long.
        real(wp), intent(in) :: t, weight(:), length
        real(wp), intent(inout) :: q(:)
        !> no_equilibrium if the rows are out of reach.
        integer, intent(out) :: stat
        integer, parameter :: most = 20
        !> Corrections of this part of the size of the coordinates end the iteration; factors are reused as long as each correction
        !> is at most the second part of the previous one.
        real(wp), parameter :: part_of_size = 1.0e-10_wp, fast = 0.1_wp
        real(wp), allocatable :: unused_pull(:)
        real(wp), dimension(size(q)) :: step, none
        real(wp) :: g(self%point%m), unused(self%point%m), correction, last, moved
        integer :: i

        none = 0.0_wp
        moved = 0.0_wp
        last = huge(1.0_wp)
        do i = 1, most
            call self%point%look(t, q, stat)
            if (stat /= status_ok) return
            call correct_rows()
            if (correction > fast*last) then
                call self%point%find_dependent_rows(unused_pull, stat, weight**2)
                if (stat /= status_ok) return
                call correct_rows()
            end if
            if (correction <= part_of_size*(1 + maxval(abs(weight*q)))) return
            moved = moved + correction
            if (.not. moved <= 0.5_wp*length) exit
            last = correction
            q = q + step
        end do
        stat = status_no_equilibrium

    contains

        !> The shortest correction in weighted coordinates.
        subroutine correct_rows()
            g = 0.0_wp
            g(:self%point%nh) = -self%point%evaluator%terms%phi
            call self%point%ties%solve(none, g, step, unused)
            correction = maxval(abs(weight*step))
        end subroutine correct_rows
    end subroutine return_to_rows
end module tandem_analysis_equilibrium
