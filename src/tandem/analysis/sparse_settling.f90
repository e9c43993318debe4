! SPDX-License-Identifier: MIT
!> Equilibria of large mechanisms: Newton's iteration with the sparse matrix [K, C'; C, 0], damped by the natural monotonicity test
!> (P. Deuflhard, Newton Methods for Nonlinear Problems, 2004, section 4.4); where that ends nowhere, the motion without inertia
!> M q' = forces, by implicit steps with mu M + K that grow as it comes to rest (C. T. Kelley, D. E. Keyes, SIAM J. Numer. Anal. 35,
!> 1998), which finds a stable one, and Newton's iteration again.
!>
!> Rows at velocity level hold: the coordinates go where they let them.
module tandem_analysis_sparse_settling
    use tandem_analysis_sparse_point, only: most_factor_entries, sparse_point_type
    use tandem_error, only: error_type, set_error, to_text
    use tandem_kinds, only: wp
    use tandem_linalg_sparse_lu, only: sparse_lu_type, sparse_matrix_type
    use tandem_model, only: model_type
    use tandem_status, only: status_no_equilibrium, status_ok, status_work_limit
    implicit none (type, external)
    private

    public :: moved_reason, settle_sparsely

    !> Why a mechanism rests nowhere, behind what a message says of it.
    character(len=*), parameter :: moved_reason = '; its constraints move it, so that it cannot rest'

    !> Most iterations of Newton, and implicit steps.
    integer, parameter :: most_iterations = 60, most_relaxations = 400
    !> The longest step over the size of the coordinates: a long chain swings far.
    real(wp), parameter :: longest = 0.5_wp
    !> Forces are in balance where what is left is this of their terms.
    real(wp), parameter :: balance_bound = 1.0e-9_wp

contains

    !> Find the equilibrium near q. Errors: no_equilibrium, invalid_model where there is no sparse form, and what evaluating the
    !> model may give.
    subroutine settle_sparsely(model, t, q, iterations, relaxations, has_form, error)
        class(model_type), intent(inout), target :: model
        real(wp), intent(in) :: t
        !> The start (n), which need not satisfy the constraints; the equilibrium.
        real(wp), intent(inout) :: q(:)
        integer, intent(out) :: iterations, relaxations
        !> Whether the model has a sparse form.
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
        call iterate(point, t, q, iterations, stat)
        if (stat == status_no_equilibrium) then
            q = start
            call relax(point, t, q, relaxations, stat)
            if (stat == status_ok) call iterate(point, t, q, iterations, stat)
        end if
        associate (moves => any(abs(point%evaluator%terms%nu) > 0.0_wp))
            if (stat /= status_ok .and. stat /= status_no_equilibrium) then
                call set_error(error, stat, 'the model "'//model%name//'" cannot be evaluated on the way to its equilibrium')
            else if (stat == status_no_equilibrium .or. moves) then
                call set_error(error, status_no_equilibrium, 'no equilibrium of the model "'//model%name//'" was found in '// &
                    to_text(iterations)//' iterations and '//to_text(relaxations)//' steps along the forces'// &
                    trim(merge(moved_reason, repeat(' ', len(moved_reason)), moves)))
            end if
        end associate
    end subroutine settle_sparsely

    !> Newton's iteration.
    subroutine iterate(point, t, q, iterations, stat)
        type(sparse_point_type), intent(inout) :: point
        real(wp), intent(in) :: t
        real(wp), intent(inout) :: q(:)
        integer, intent(inout) :: iterations
        integer, intent(out) :: stat
        type(sparse_matrix_type) :: a
        type(sparse_lu_type) :: lu
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
            call factor_at(point, 0.0_wp, a, lu, unit, stat)
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
                    ! Rounding, when the correction before was small already: nothing gets better.
                    is_last = length <= 1.0e-10_wp*size_of_q
                    if (is_last) exit
                end if
                factor = factor/2
            end do
            if (tries > 30) exit
        end do
        stat = status_no_equilibrium
    end subroutine iterate

    !> The factors of [mu M + K, C'; C, 0] at the point, with its residual.
    subroutine factor_at(point, mu, a, lu, unit, stat)
        type(sparse_point_type), intent(inout) :: point
        real(wp), intent(in) :: mu
        type(sparse_matrix_type), intent(inout) :: a
        type(sparse_lu_type), intent(inout) :: lu
        real(wp), intent(out) :: unit
        !> no_equilibrium where it is singular.
        integer, intent(out) :: stat
        integer, allocatable :: order(:)
        integer :: info

        call point%differentiate(.false., stat)
        if (stat /= status_ok) return
        call point%balance()
        call point%assemble([cmplx(mu, 0.0_wp, wp), (0.0_wp, 0.0_wp), (1.0_wp, 0.0_wp)], a, order, unit)
        call lu%factor(a, order, most_factor_entries, info)
        if (info < 0) stat = status_work_limit
        if (info > 0) stat = status_no_equilibrium
    end subroutine factor_at

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

    !> Go with the forces to a place where they are nearly in balance.
    subroutine relax(point, t, q, relaxations, stat)
        type(sparse_point_type), intent(inout) :: point
        real(wp), intent(in) :: t
        real(wp), intent(inout) :: q(:)
        integer, intent(inout) :: relaxations
        integer, intent(out) :: stat
        type(sparse_matrix_type) :: a
        type(sparse_lu_type) :: lu
        real(wp), allocatable :: acceleration(:)
        real(wp), dimension(size(q)) :: step
        real(wp), dimension(point%m) :: more
        real(wp) :: unit, mu, length, before, now
        integer :: i, tries

        mu = 0.0_wp
        before = 0.0_wp
        do i = 1, most_relaxations
            relaxations = relaxations + 1
            call point%look(t, q, stat)
            ! The multipliers are those of the forces here.
            if (stat == status_ok) call point%find_dependent_rows(acceleration, stat)
            if (stat /= status_ok) return
            now = maxval(abs(acceleration/point%scale))
            if (i == 1) then
                mu = max(10*now, tiny(1.0_wp))
            else
                ! Longer steps as it comes to rest.
                mu = mu*min(1.0_wp, max(0.25_wp, now/max(before, tiny(1.0_wp))))
            end if
            before = now
            do tries = 1, 30
                call factor_at(point, mu, a, lu, unit, stat)
                length = huge(1.0_wp)
                if (stat == status_ok) then
                    call correct(point, a, lu, unit, step, more)
                    length = maxval(abs(step/point%scale))
                else if (stat /= status_no_equilibrium) then
                    return
                end if
                if (length <= longest*(1 + maxval(abs(q/point%scale)))) exit
                mu = 4*mu
            end do
            if (tries > 30) exit
            q = q + step
            if (length <= 1.0e-6_wp) return
        end do
        stat = status_no_equilibrium
    end subroutine relax
end module tandem_analysis_sparse_settling
