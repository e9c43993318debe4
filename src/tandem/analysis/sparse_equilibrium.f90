! SPDX-License-Identifier: MIT
!> Equilibria of large mechanisms: Newton's iteration with the sparse matrix [K, C'; C, 0], damped by the natural monotonicity test
!> (P. Deuflhard, Newton Methods for Nonlinear Problems, 2004, section 4.4). If it fails or would go far, the motion without inertia
!> D q' = forces, by implicit steps with mu D + K, each of which goes downhill, with a mu that falls towards rest (C. T. Kelley, D.
!> E. Keyes, SIAM J. Numer. Anal. 35, 1998), which finds a stable equilibrium, and Newton's iteration again. D measures rotations
!> rather than positions: with M the far end of a chain would wait until a bend has passed through all of it.
!>
!> Rows at velocity level hold: the coordinates move in the directions that these allow.
module tandem_analysis_sparse_equilibrium
    use tandem_analysis_sparse_point, only: most_factor_entries, sparse_point_type
    use tandem_error, only: error_type, set_error, to_text
    use tandem_kinds, only: wp
    use tandem_linalg_sparse_lu, only: sparse_lu_type, sparse_matrix_type
    use tandem_model, only: label_length, model_type
    use tandem_status, only: status_no_equilibrium, status_ok, status_work_limit
    implicit none (type, external)
    private

    public :: moved_reason, relax_sparsely, settle_sparsely

    !> Reason why a mechanism has no equilibrium, appended to a message.
    character(len=*), parameter :: moved_reason = '; its constraints impose a motion, so that no equilibrium exists'

    !> Largest number of iterations of Newton, and of implicit steps.
    integer, parameter :: most_iterations = 60, most_relaxations = 400
    !> The longest step over the size of the coordinates: a long chain swings far.
    real(wp), parameter :: longest = 0.5_wp
    !> Forces are in balance if their residual is at most this part of their terms.
    real(wp), parameter :: balance_bound = 1.0e-9_wp

contains

    !> Find the equilibrium near q. Errors: no_equilibrium, invalid_model if there is no sparse form, and statuses of evaluating the
    !> model.
    subroutine settle_sparsely(model, t, q, iterations, relaxations, has_form, error)
        class(model_type), intent(inout), target :: model
        real(wp), intent(in) :: t
        !> The start (n), which need not satisfy the constraints; the equilibrium.
        real(wp), intent(inout) :: q(:)
        integer, intent(out) :: iterations, relaxations
        !> True if the model has a sparse form.
        logical, intent(out) :: has_form
        type(error_type), allocatable, intent(out) :: error
        type(sparse_point_type), allocatable :: point
        real(wp) :: start(size(q))
        integer :: stat

        iterations = 0
        relaxations = 0
        allocate (point)
        call point%initialize(model, error)
        has_form = .not. allocated(error)
        if (allocated(error)) return
        start = q
        call iterate(point, t, .true., q, iterations, stat)
        if (stat == status_no_equilibrium) then
            q = start
            call relax(point, t, q, relaxations, stat)
            if (stat == status_ok) call iterate(point, t, .false., q, iterations, stat)
        end if
        if (stat == status_no_equilibrium) then
            q = start
            call iterate(point, t, .false., q, iterations, stat)
        end if
        associate (moves => any(abs(point%evaluator%terms%nu) > 0.0_wp))
            if (stat /= status_ok .and. stat /= status_no_equilibrium) then
                call set_error(error, stat, 'the model "'//model%name//'" cannot be evaluated in the search for its equilibrium')
            else if (stat == status_no_equilibrium .or. moves) then
                call set_error(error, status_no_equilibrium, 'no equilibrium of the model "'//model%name//'" was found in '// &
                    to_text(iterations)//' iterations and '//to_text(relaxations)//' steps along the forces'// &
                    trim(merge(moved_reason, repeat(' ', len(moved_reason)), moves)))
            end if
        end associate
    end subroutine settle_sparsely

    !> Only move along the forces, to a start of Newton's iteration.
    subroutine relax_sparsely(model, t, q, relaxations, has_form, stat)
        class(model_type), intent(inout), target :: model
        real(wp), intent(in) :: t
        !> The start, and the resulting position (n).
        real(wp), intent(inout) :: q(:)
        integer, intent(inout) :: relaxations
        !> False for a model without a sparse form.
        logical, intent(out) :: has_form
        !> A status code.
        integer, intent(out) :: stat
        type(sparse_point_type), allocatable :: point
        type(error_type), allocatable :: error

        stat = status_no_equilibrium
        allocate (point)
        call point%initialize(model, error)
        has_form = .not. allocated(error)
        if (has_form) call relax(point, t, q, relaxations, stat)
    end subroutine relax_sparsely

    !> Newton's iteration.
    subroutine iterate(point, t, stays_near, q, iterations, stat)
        type(sparse_point_type), intent(inout) :: point
        real(wp), intent(in) :: t
        !> True to end when steps must be shortened much: from there on any equilibrium may be reached, however far.
        logical, intent(in) :: stays_near
        real(wp), intent(inout) :: q(:)
        integer, intent(inout) :: iterations
        integer, intent(out) :: stat
        type(sparse_matrix_type) :: a
        type(sparse_lu_type) :: lu
        real(wp), parameter :: least_factor = 0.2_wp
        real(wp), allocatable :: acceleration(:)
        real(wp), dimension(size(q)) :: step, next, from
        real(wp), dimension(point%m) :: more, unused, lambda
        real(wp) :: factor, unit, size_of_q, length
        logical :: is_last
        integer :: i, tries

        call point%look(t, q, stat)
        if (stat == status_ok) call point%find_dependent_rows(acceleration, stat)
        if (stat /= status_ok) return
        is_last = .false.
        do i = 1, most_iterations
            iterations = iterations + 1
            call point%differentiate(.false., stat)
            if (stat /= status_ok) return
            call point%balance()
            call factor_with(point, spread(0.0_wp, 1, point%n), a, lu, unit, stat)
            if (stat /= status_ok) return
            call correct(point, a, lu, unit, step, more)
            length = maxval(abs(step/point%scale))
            size_of_q = 1 + maxval(abs(q/point%scale))
            if (length <= 1.0e-14_wp*size_of_q .or. (is_last .and. length <= 1.0e-10_wp*size_of_q)) then
                if (.not. max(point%imbalance(), point%violation()) <= balance_bound) stat = status_no_equilibrium
                return
            end if
            from = q
            lambda = point%lambda
            factor = min(1.0_wp, longest*size_of_q/length)
            do tries = 1, 30
                q = from + factor*step
                point%lambda = lambda + factor*more
                call point%look(t, q, stat)
                if (stat == status_ok) then
                    call point%balance()
                    call correct(point, a, lu, unit, next, unused)
                    if (norm2(next/point%scale) <= (1 - factor/4)*norm2(step/point%scale)) exit
                    ! Rounding, if the previous correction was small already: no further improvement.
                    is_last = length <= 1.0e-10_wp*size_of_q
                    if (is_last) exit
                end if
                factor = factor/2
            end do
            if (tries > 30 .or. (stays_near .and. factor < least_factor)) exit
        end do
        stat = status_no_equilibrium
    end subroutine iterate

    !> The factors of [mu D + K, C'; C, 0] at the point, with known K.
    subroutine factor_with(point, diagonal, a, lu, unit, stat)
        type(sparse_point_type), intent(in) :: point
        !> Diagonal of mu D (n).
        real(wp), intent(in) :: diagonal(:)
        type(sparse_matrix_type), intent(inout) :: a
        type(sparse_lu_type), intent(inout) :: lu
        real(wp), intent(out) :: unit
        !> no_equilibrium if it is singular.
        integer, intent(out) :: stat
        integer, allocatable :: order(:)
        integer :: info

        stat = status_ok
        call point%assemble([(0.0_wp, 0.0_wp), (0.0_wp, 0.0_wp), (1.0_wp, 0.0_wp)], a, order, unit, diagonal)
        call lu%factor(a, order, most_factor_entries, info)
        if (info < 0) stat = status_work_limit
        if (info > 0) stat = status_no_equilibrium
    end subroutine factor_with

    !> The correction of coordinates and multipliers.
    subroutine correct(point, a, lu, unit, step, more)
        type(sparse_point_type), intent(in) :: point
        type(sparse_matrix_type), intent(in) :: a
        type(sparse_lu_type), intent(in) :: lu
        real(wp), intent(in) :: unit
        !> (n), (m).
        real(wp), intent(out) :: step(:), more(:)
        real(wp) :: g(point%m)

        g = 0.0_wp
        g(:point%nh) = -point%evaluator%terms%phi
        call point%solve(a, lu, unit, -point%residual, g, step, more)
    end subroutine correct

    !> Move downhill along the forces to a position where they are nearly in balance. A step is accepted if it stays near the
    !> constraints, and if the forces at both of its ends together do work along it; else it is repeated with a larger mu. So a
    !> matrix that is not positive definite, or a linearisation of short reach, shortens steps, but does not change the result.
    subroutine relax(point, t, q, relaxations, stat)
        type(sparse_point_type), intent(inout) :: point
        real(wp), intent(in) :: t
        real(wp), intent(inout) :: q(:)
        integer, intent(inout) :: relaxations
        integer, intent(out) :: stat
        !> The part of the work at the start that may be lost at the end, and factors of mu for steps that are too long, for steps
        !> with large changes of the forces, and for others.
        real(wp), parameter :: least_work = -0.5_wp, much = 0.25_wp, shorter = 4.0_wp, longer = 0.5_wp, much_longer = 0.2_wp
        !> The lengths of the first step, of the longest one, and of one that ends the search, in weighted coordinates.
        real(wp), parameter :: first_length = 0.05_wp, longest_step = 0.5_wp, no_step = 1.0e-6_wp
        type(sparse_matrix_type) :: a
        type(sparse_lu_type) :: lu
        real(wp), allocatable :: pull(:)
        real(wp), dimension(size(q)) :: step, from, force, weight
        real(wp), dimension(point%m) :: more, lambda
        logical :: is_out(point%m)
        real(wp) :: unit, mu, length, before, after
        integer :: i, tries

        call point%look(t, q, stat)
        if (stat /= status_ok) return
        call weigh(point, weight)
        call point%find_dependent_rows(pull, stat, weight**2)
        if (stat == status_ok) call return_to_rows(point, t, weight, huge(1.0_wp), q, stat)
        if (stat == status_ok) call point%find_dependent_rows(pull, stat, weight**2)
        if (stat /= status_ok) return
        mu = max(maxval(abs(weight*pull))/first_length, tiny(1.0_wp))
        do i = 1, most_relaxations
            relaxations = relaxations + 1
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
                call factor_with(point, mu*weight**2, a, lu, unit, stat)
                if (stat == status_work_limit) return
                if (stat == status_ok) then
                    call correct(point, a, lu, unit, step, more)
                    length = maxval(abs(weight*step))
                    before = dot_product(force, step)
                    if (length <= longest_step .and. before > 0.0_wp) then
                        q = q + step
                        call return_to_rows(point, t, weight, length, q, stat)
                        if (stat == status_ok) call point%find_dependent_rows(pull, stat, weight**2)
                        if (stat == status_ok) then
                            after = dot_product(weight**2*pull, q - from)
                            if (after >= least_work*before .or. length <= no_step) exit
                        end if
                    end if
                end if
                mu = shorter*mu
            end do
            if (tries > 30) exit
            if (length <= no_step) return
            if (tries == 1) mu = mu*merge(much_longer, longer, after > much*before)
        end do
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
    subroutine return_to_rows(point, t, weight, length, q, stat)
        type(sparse_point_type), intent(inout) :: point
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
        real(wp) :: g(point%m), unused(point%m), correction, last, moved
        integer :: i

        none = 0.0_wp
        moved = 0.0_wp
        last = huge(1.0_wp)
        do i = 1, most
            call point%look(t, q, stat)
            if (stat /= status_ok) return
            call correct_rows()
            if (correction > fast*last) then
                call point%find_dependent_rows(unused_pull, stat, weight**2)
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
            g(:point%nh) = -point%evaluator%terms%phi
            call point%solve(point%ties, point%of_ties, point%unit_of_ties, none, g, step, unused)
            correction = maxval(abs(weight*step))
        end subroutine correct_rows
    end subroutine return_to_rows
end module tandem_analysis_sparse_equilibrium
