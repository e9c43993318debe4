! SPDX-License-Identifier: MIT
!> The acceleration at a point near the point of a factor: the third stage of Kutta's method is O(h^2) from the second, the end of a
!> step O(h^3) from the last stage. The acceleration and the multipliers differ by little, and by nearly as much as in the previous
!> step. The residual of the equations of motion is removed by solutions with the factor, each of which reduces it in proportion to
!> the distance: one or two replace a factorization, and they solve the equations at the point itself.
module tandem_chart_sparse_nearby
    use tandem_chart_sparse_analysis, only: analysis_type
    use tandem_chart_sparse_factor, only: factor_type
    use tandem_chart_sparse_progress, only: is_rounding, is_trusted, largest_part, learn, progress_type, unknown
    use tandem_kinds, only: sp, wp
    use tandem_linalg_kernels, only: is_finite
    use tandem_model_terms, only: terms_type
    use tandem_pack, only: pack_type
    implicit none (type, external)
    private

    public :: nearby_type

    !> Represents no time.
    real(wp), parameter :: never = huge(1.0_wp)

    type :: nearby_type
        !> Time of the factor at the last point, if it can be used for points at that time, and their distance from it.
        real(wp) :: t = never, moved = 0.0_wp
        !> The acceleration (n) and the multipliers in the order of the nodes (n_unknowns) at the point solved for last.
        real(wp), allocatable :: qdd(:), lambda(:)
        !> Last difference of the results at nearby points, at stages and at ends of steps, and its change since the time before:
        !> (n, 2), (n_unknowns, 2). A guess needs no more digits.
        real(sp), allocatable :: change(:, :), change_lambda(:, :), trend(:, :), trend_lambda(:, :)
        !> Remainder of a solution relative to the distance.
        type(progress_type) :: progress
        !> Number of points without an attempt, after a failed one.
        integer :: pause = 0
    contains
        procedure :: allocate => allocate_nearby, may_serve, note, forget, solve, pack_state
    end type nearby_type

contains

    !> Allocate for an analysed pattern.
    subroutine allocate_nearby(self, a)
        class(nearby_type), intent(inout) :: self
        type(analysis_type), intent(in) :: a

        if (allocated(self%qdd)) deallocate (self%qdd, self%lambda, self%change, self%change_lambda, self%trend, &
            self%trend_lambda)
        allocate (self%qdd(a%n), self%lambda(a%n_unknowns), source=0.0_wp)
        allocate (self%change(a%n, 2), self%change_lambda(a%n_unknowns, 2), source=0.0_sp)
        allocate (self%trend(a%n, 2), self%trend_lambda(a%n_unknowns, 2), source=0.0_sp)
        self%progress = progress_type()
        self%pause = 0
        call self%forget()
    end subroutine allocate_nearby

    !> True if the factor can be used for the acceleration at a time.
    pure logical function may_serve(self, t, factor)
        class(nearby_type), intent(in) :: self
        real(wp), intent(in) :: t
        !> If rows are left out, or near a loss of rank, the point's own factor is used.
        type(factor_type), intent(in) :: factor
        real(wp), parameter :: near_loss = 1.0e-4_wp

        may_serve = abs(t - self%t) <= 0.0_wp .and. factor%least > near_loss .and. .not. factor%leaves_out
    end function may_serve

    !> Store the solution with the factor of the point.
    pure subroutine note(self, t, qdd, lambda)
        class(nearby_type), intent(inout) :: self
        real(wp), intent(in) :: t
        real(wp), intent(in), contiguous :: qdd(:), lambda(:)

        if (.not. allocated(self%qdd)) return
        self%t = t
        self%moved = 0.0_wp
        self%qdd(:) = qdd
        self%lambda(:) = lambda
    end subroutine note

    !> The factor belongs to no nearby point any more.
    pure subroutine forget(self)
        class(nearby_type), intent(inout) :: self

        self%t = never
    end subroutine forget

    !> Find the acceleration at a point with the factor of another.
    subroutine solve(self, a, factor, mass, terms, scale, rate, is_stage, is_again, largest_rest, qdd, g, x, z, is_solved)
        class(nearby_type), intent(inout) :: self
        type(analysis_type), intent(in) :: a
        !> With C of the point.
        type(factor_type), intent(in) :: factor
        !> Compressed M, gamma and the forces of the point.
        real(wp), intent(in), contiguous :: mass(:, :)
        type(terms_type), intent(in) :: terms
        !> Of the coordinates (n).
        real(wp), intent(in), contiguous :: scale(:)
        !> 1 over the square of the time scale.
        real(wp), intent(in) :: rate
        !> True if the point is a stage; true if it was solved for before: then the guesses for the next step are unchanged.
        logical, intent(in) :: is_stage, is_again
        !> Largest remainder of each acceleration, relative to itself or the scale of its coordinate.
        real(wp), intent(in) :: largest_rest
        !> (n)
        real(wp), intent(out), contiguous :: qdd(:)
        !> Work space: (m), (n), (n_unknowns).
        real(wp), intent(inout), contiguous :: g(:), x(:), z(:)
        !> False if the remainder is too large: then the point needs its own factor.
        logical, intent(out) :: is_solved
        !> More solutions cost as much as a factor.
        integer, parameter :: most = 4, long_pause = 50
        !> A slower reduction means that the point is too far away; a larger remainder is not rounding.
        real(wp), parameter :: slow = 0.3_wp, largest_rounding = 1.0e-10_wp
        !> Usual rounding error.
        real(wp), parameter :: rounding = 2.0e-14_wp
        real(wp) :: before, last, rest
        integer :: k, kind

        is_solved = .false.
        if (self%pause > 0) then
            self%pause = self%pause - 1
            return
        end if
        kind = merge(1, 2, is_stage)
        if (is_again) then
            qdd(:) = self%qdd
        else
            call guess(a%n, self%change(:, kind), self%trend(:, kind), self%qdd)
            call guess(a%n_unknowns, self%change_lambda(:, kind), self%trend_lambda(:, kind), self%lambda)
            qdd(:) = self%qdd
        end if
        before = 0.0_wp
        last = unknown
        do k = 1, most
            g(:) = -terms%gamma
            call factor%multiply(a, qdd, g)
            ! `self%qdd` of the other point is no longer needed.
            call factor%find_unbalanced(a, mass, terms%force, qdd, self%lambda, self%qdd)
            call factor%solve(a, .true., self%qdd, g, x, z)
            if (is_again) then
                qdd(:) = qdd + x
                self%lambda(:) = self%lambda + z
            else
                call add(a%n, x, qdd, self%change(:, kind), self%trend(:, kind))
                call add(a%n_unknowns, z, self%lambda, self%change_lambda(:, kind), self%trend_lambda(:, kind))
            end if
            rest = largest_part(a%n, x, qdd, scale, rate)
            if (.not. rest < slow*last) then
                is_solved = rest <= largest_rounding .and. is_rounding(rest, last, before)
                exit
            end if
            if (k == 2) call learn(self%progress, self%moved, rest, last, rounding)
            is_solved = rest <= largest_rest .or. is_trusted(self%progress, self%moved, rest, largest_rest)
            if (is_solved) exit
            if (k > 1) before = last
            last = rest
        end do
        ! NaN is not detected by its size.
        if (is_solved) is_solved = is_finite(a%n, qdd)
        if (is_solved) then
            self%qdd(:) = qdd
            return
        end if
        self%pause = long_pause
        self%change(:, kind) = 0.0_sp
        self%change_lambda(:, kind) = 0.0_sp
        self%trend(:, kind) = 0.0_sp
        self%trend_lambda(:, kind) = 0.0_sp
    end subroutine solve

    !> Extrapolate from the last two changes.
    pure subroutine guess(n, change, trend, x)
        integer, intent(in) :: n
        real(sp), intent(inout) :: change(n)
        real(sp), intent(in) :: trend(n)
        real(wp), intent(inout) :: x(n)
        integer :: i

        !GCC$ UNROLL 1
        do i = 1, n
            change(i) = change(i) + trend(i)
            x(i) = x(i) + change(i)
        end do
    end subroutine guess

    !> Add a solution to the result, to its last change, and to the change of this.
    pure subroutine add(n, x, y, change, trend)
        integer, intent(in) :: n
        real(wp), intent(in) :: x(n)
        real(wp), intent(inout) :: y(n)
        real(sp), intent(inout) :: change(n), trend(n)
        integer :: i

        !GCC$ UNROLL 1
        do i = 1, n
            y(i) = y(i) + x(i)
            change(i) = change(i) + real(x(i), sp)
            trend(i) = trend(i) + real(x(i), sp)
        end do
    end subroutine add

    !> All components.
    subroutine pack_state(self, pack)
        class(nearby_type), intent(inout) :: self
        type(pack_type), intent(inout) :: pack

        if (.not. allocated(self%qdd)) return
        call pack%item(self%t, self%moved)
        call pack%item(self%progress%ageing)
        call pack%item(self%pause)
        call pack%item(self%qdd, self%lambda)
        call pack_guess(self%change)
        call pack_guess(self%change_lambda)
        call pack_guess(self%trend)
        call pack_guess(self%trend_lambda)

    contains

        subroutine pack_guess(x)
            real(sp), intent(inout) :: x(:, :)
            real(wp), allocatable :: copy(:, :)

            allocate (copy(size(x, 1), size(x, 2)), source=real(x, wp))
            call pack%item(copy)
            x(:, :) = real(copy, sp)
        end subroutine pack_guess
    end subroutine pack_state
end module tandem_chart_sparse_nearby
