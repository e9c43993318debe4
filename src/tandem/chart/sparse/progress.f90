! SPDX-License-Identifier: MIT
!> How corrections with the factor of the step's start do: what one may be trusted to leave, and whether it is rounding that stops
!> them.
module tandem_chart_sparse_progress
    use tandem_kinds, only: lane, wp
    implicit none (type, external)
    private

    public :: is_rounding, is_trusted, largest, largest_change, largest_part, learn, progress_type, unknown

    !> Stands for an error or a part of it that nothing is known of.
    real(wp), parameter :: unknown = 1.0e100_wp

    !> How the corrections of one level have done of late.
    type :: progress_type
        !> A correction leaves this part of an error, times the age of the factor.
        real(wp) :: ageing = unknown
    end type progress_type

contains

    !> Whether a correction can be trusted to have left less than is wanted.
    pure logical function is_trusted(progress, age, error, wanted)
        type(progress_type), intent(in) :: progress
        !> The age of the factor, and the error before the correction.
        real(wp), intent(in) :: age, error, wanted
        !> As of the dense chart, see `tandem_chart_dense_position`.
        real(wp), parameter :: distrust = 8.0_wp

        is_trusted = distrust*progress%ageing*age*error <= wanted
    end function is_trusted

    !> Learn from the first correction of an iteration. What it left as rounding says how large the part is at most.
    pure subroutine learn(progress, age, error, before, rounding_of)
        type(progress_type), intent(inout) :: progress
        real(wp), intent(in) :: age, error, before
        !> What one rounding leaves, if not 1e-15.
        real(wp), intent(in), optional :: rounding_of
        real(wp), parameter :: many = 20.0_wp, kept = 0.5_wp
        real(wp) :: rounding, seen

        if (.not. (age > 0.0_wp .and. before > 0.0_wp)) return
        rounding = 1.0e-15_wp
        if (present(rounding_of)) rounding = rounding_of
        seen = max(error, rounding)/(before*age)
        if (error <= many*rounding) then
            progress%ageing = min(progress%ageing, seen)
        else
            progress%ageing = max(seen, merge(kept*progress%ageing, 0.0_wp, progress%ageing < unknown))
        end if
    end subroutine learn

    !> Whether a correction left about as much as it found because of rounding, not since all of them are slow: where a body has
    !> turned by more than a radian they may leave more than half each.
    pure logical function is_rounding(error, last_error, error_before)
        !> The error now, before the last correction, and before the one before that, 0 where there was none.
        real(wp), intent(in) :: error, last_error, error_before
        real(wp), parameter :: fast = 0.1_wp, some = 0.5_wp, none = 0.9_wp

        is_rounding = error > merge(some, none, last_error < fast*error_before)*last_error
    end function is_rounding

    !> The largest weighted entry; not finite where one is not.
    pure real(wp) function largest(n, x, weight)
        integer, intent(in) :: n
        real(wp), intent(in) :: x(n), weight(n)
        real(wp) :: most(lane), total(lane), rest
        integer :: b, i

        do i = 1, lane
            most(i) = 0.0_wp
            total(i) = 0.0_wp
        end do
        ! Sums and maxima of their own for each place of a register: none waits for the one before it.
        do b = 0, n - lane, lane
            !GCC$ UNROLL 1
            do i = 1, lane
                total(i) = total(i) + abs(x(b + i))
                most(i) = max(most(i), abs(x(b + i))*weight(b + i))
            end do
        end do
        rest = 0.0_wp
        largest = 0.0_wp
        do i = n - modulo(n, lane) + 1, n
            rest = rest + abs(x(i))
            largest = max(largest, abs(x(i))*weight(i))
        end do
        do i = 1, lane
            rest = rest + total(i)
            largest = max(largest, most(i))
        end do
        if (.not. rest <= huge(1.0_wp)) largest = rest
    end function largest

    !> The largest change of an entry; one that is no number does not count.
    pure real(wp) function largest_change(n, x, before)
        integer, intent(in) :: n
        real(wp), intent(in) :: x(n), before(n)
        real(wp) :: most(lane)
        integer :: b, i

        do i = 1, lane
            most(i) = 0.0_wp
        end do
        do b = 0, n - lane, lane
            !GCC$ UNROLL 1
            do i = 1, lane
                most(i) = max(most(i), abs(x(b + i) - before(b + i)))
            end do
        end do
        largest_change = 0.0_wp
        do i = n - modulo(n, lane) + 1, n
            largest_change = max(largest_change, abs(x(i) - before(i)))
        end do
        do i = 1, lane
            largest_change = max(largest_change, most(i))
        end do
    end function largest_change

    !> The largest entry against what it is added to, max |x| / max(|of|, factor scale); one that is no number does not count.
    pure real(wp) function largest_part(n, x, of, scale, factor)
        integer, intent(in) :: n
        real(wp), intent(in) :: x(n), of(n), scale(n), factor
        real(wp) :: most(lane)
        integer :: b, i

        do i = 1, lane
            most(i) = 0.0_wp
        end do
        do b = 0, n - lane, lane
            !GCC$ UNROLL 1
            do i = 1, lane
                most(i) = max(most(i), abs(x(b + i))/max(abs(of(b + i)), factor*scale(b + i)))
            end do
        end do
        largest_part = 0.0_wp
        do i = n - modulo(n, lane) + 1, n
            largest_part = max(largest_part, abs(x(i))/max(abs(of(i)), factor*scale(i)))
        end do
        do i = 1, lane
            largest_part = max(largest_part, most(i))
        end do
    end function largest_part
end module tandem_chart_sparse_progress
