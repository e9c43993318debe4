! SPDX-License-Identifier: MIT
!> Convergence of corrections with the factor of the step's start: the expected remainder of a correction, and detection of
!> rounding.
module tandem_chart_sparse_progress
    use tandem_kinds, only: lane, wp
    implicit none (type, external)
    private

    public :: history_type, is_rounding, is_trusted, largest, largest_change, largest_part, learn, progress_type, unknown

    !> Represents an unknown error or part of an error.
    real(wp), parameter :: unknown = 1.0e100_wp

    !> Recent convergence of the corrections of one level.
    type :: progress_type
        !> A correction leaves this part of an error per age of the factor.
        real(wp) :: ageing = unknown
    end type progress_type

    !> The last two accelerations of coordinates without mass (:, 2), and the times; reduction of the error by a step of their
    !> iteration; true if it is put aside.
    type :: history_type
        real(wp), allocatable :: qdd(:, :)
        real(wp) :: t(2) = 0.0_wp, reduction = 1.0_wp
        logical :: is_kept = .false.
    end type history_type

contains

    !> True if a correction is expected to leave less than the tolerance.
    pure logical function is_trusted(progress, age, error, wanted)
        type(progress_type), intent(in) :: progress
        !> The age of the factor, and the error before the correction.
        real(wp), intent(in) :: age, error, wanted
        !> As in the dense chart, see `tandem_chart_dense_position`.
        real(wp), parameter :: distrust = 8.0_wp

        is_trusted = distrust*progress%ageing*age*error <= wanted
    end function is_trusted

    !> Update the estimate from the first correction of an iteration. A remainder at rounding level is an upper bound of the part.
    pure subroutine learn(progress, age, error, before, rounding_of)
        type(progress_type), intent(inout) :: progress
        real(wp), intent(in) :: age, error, before
        !> Level of rounding errors, if not 1e-15.
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

    !> True if a correction left about as large an error as before because of rounding, and not because all corrections are slow: if
    !> a body has turned by more than a radian each may leave more than half.
    pure logical function is_rounding(error, last_error, error_before)
        !> The error now, before the last correction, and before the previous one, 0 if there was none.
        real(wp), intent(in) :: error, last_error, error_before
        real(wp), parameter :: fast = 0.1_wp, some = 0.5_wp, none = 0.9_wp

        is_rounding = error > merge(some, none, last_error < fast*error_before)*last_error
    end function is_rounding

    !> The largest weighted entry; not finite if one is not.
    pure real(wp) function largest(n, x, weight)
        integer, intent(in) :: n
        real(wp), intent(in) :: x(n), weight(n)
        real(wp) :: most(lane), total(lane), rest
        integer :: b, i

        do i = 1, lane
            most(i) = 0.0_wp
            total(i) = 0.0_wp
        end do
        ! Separate sums and maxima for each lane of a register: none waits for the previous one.
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

    !> The largest change of an entry, ignoring NaN.
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

    !> The largest entry relative to the vector to which it is added, max |x| / max(|of|, factor scale), ignoring NaN.
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
