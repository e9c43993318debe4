! SPDX-License-Identifier: MIT
!> Exclusion of steps in which no event can occur.
!>
!> Restoring the constraints at the samples of a step costs as much as several stages. Every g is therefore first evaluated at the
!> quarters of the step on the quintic polynomial through the coordinates, velocities and accelerations at its ends, which needs no
!> terms of the model. Between two samples, a smooth g differs from the chord by an eighth of its second difference. The error of
!> the polynomial vanishes at both ends together with two derivatives, so that second differences reflect all of it. g has no zero
!> in the step if |g| exceeds twice the largest second difference and a fraction of the range of its values. All other steps are
!> searched with restored constraints.
submodule(tandem_simulate_event_watch) tandem_simulate_event_screen
    implicit none (type, external)

    !> Smallest |g| relative to the largest second difference, and relative to the range of the samples.
    real(wp), parameter :: over_bend = 2.0_wp, over_range = 0.1_wp

contains

    module procedure rule_out
        integer :: i, k

        may_happen = .false.
        do i = 1, self%n
            associate (watched => self%watched(i))
                may_happen = may_happen .or. watched%rests .or. watched%is_reversed .or. watched%event%needs_multipliers
            end associate
        end do
        if (may_happen) return
        do k = 1, n_rough
            if (k == 1 .and. .not. self%values_are_stale) then
                self%rough(1, :) = self%watched%value
            else
                call sample_near(self, curve, k, may_happen)
                if (may_happen) return
            end if
        end do
        do i = 1, self%n
            associate (watched => self%watched(i), value => self%rough(:, i))
                if (may_vanish(value, watched%sign_before) .or. watched%is_faint(maxval(abs(value)))) may_happen = .true.
            end associate
        end do
        if (may_happen) return
        self%values_are_stale = .false.
        do i = 1, self%n
            associate (watched => self%watched(i), value => self%rough(:, i))
                watched%value = value(n_rough)
                watched%largest = maxval(abs(value))
                watched%peak = max(watched%peak, watched%largest)
                watched%sign_before = sign_of(value(n_rough), 0.0_wp)
                watched%is_open = .false.
            end associate
        end do
    end procedure rule_out

    !> Sample all functions at a quarter of the step.
    subroutine sample_near(self, curve, k, may_happen)
        class(event_watch_type), intent(inout) :: self
        class(curve_type), intent(in) :: curve
        integer, intent(in) :: k
        !> True if a function is undefined or has another sign than at the start.
        logical, intent(out) :: may_happen
        real(wp) :: t
        integer :: i, stat

        may_happen = .false.
        associate (q => self%near_q, qd => self%near_qd)
            call curve%pass_through(real(k - 1, wp)/(n_rough - 1), t, q, qd)
            call self%measure_all(t, q, qd)
            do i = 1, self%n
                call self%evaluate_point(i, t, q, qd, self%rough(k, i), stat)
                may_happen = stat /= 0 .or. .not. self%rough(1, i)*self%rough(k, i) > 0.0_wp
                if (may_happen) exit
            end do
            call self%end_measuring()
        end associate
    end subroutine sample_near

    !> True if a function with these values of equal sign at the quarters of the step may have a zero in it.
    pure logical function may_vanish(value, sign_before)
        real(wp), intent(in) :: value(n_rough)
        !> Sign of the function before the step, 0 if unknown.
        integer, intent(in) :: sign_before
        real(wp) :: least, bend

        least = minval(abs(value))
        bend = maxval(abs(value(3:) - 2*value(2:n_rough - 1) + value(:n_rough - 2)))
        may_vanish = sign_before*sign_of(value(1), 0.0_wp) < 0 .or. &
            .not. least > max(over_bend*bend, over_range*(maxval(value) - minval(value)))
    end function may_vanish
end submodule tandem_simulate_event_screen
