! SPDX-License-Identifier: MIT
!> Points beside the manifold: the nearest position and velocity in the mass metric, to first order.
submodule(tandem_chart_sparse_motion) tandem_chart_sparse_nearest
    implicit none (type, external)

contains

    module procedure restore_near
        integer, parameter :: most = 30
        real(wp), parameter :: fast = 0.1_wp, slow = 0.5_wp
        real(wp) :: error, last_error
        logical :: is_at_rounding
        integer :: k

        self%failure%row = 0
        last_error = huge(1.0_wp)
        stat = status_ok
        associate (s => self%system)
            do k = 0, merge(most, -1, s%nh > 0)
                call s%model%evaluate_phi(t, q, self%counts, stat)
                if (stat /= status_ok) then
                    self%failure%term = trim(s%model%failed_term)
                    return
                end if
                error = largest(s%nh, s%model%terms%phi, self%phi_weight)
                if (.not. error <= huge(1.0_wp)) then
                    call s%name_infinite(stat)
                    self%failure%term = trim(s%model%failed_term)
                    return
                end if
                is_at_rounding = error >= slow*last_error
                if (error <= self%end_tolerance .and. (is_at_rounding .or. .not. exactly)) exit
                ! The point is near enough.
                if (error <= self%tolerance .and. is_at_rounding) exit
                if (k == most) then
                    stat = status_position_diverged
                    self%failure%row = maxloc(abs(s%model%terms%phi)*self%phi_weight, dim=1)
                    self%failure%value = error
                    return
                end if
                if (k > 0) then
                    if (error > fast*last_error) call go_there()
                else if (.not. (is_near .and. s%factor(s%here)%is_factored)) then
                    call go_there()
                end if
                if (stat /= status_ok) return
                s%g(:s%nh) = -s%model%terms%phi
                s%g(s%nh + 1:) = 0.0_wp
                call s%factor(s%here)%solve(s%analysis, .false., q, s%g, s%x, s%z)
                q = q + s%x
                self%counts%position_corrections = self%counts%position_corrections + 1
                last_error = error
            end do
            call go_there()
            if (stat /= status_ok) return
            s%has_phi = s%nh > 0
            call meet_velocity_here()
            if (sum(abs(qd)) <= huge(1.0_wp)) return
            stat = status_not_finite
            call s%name_infinite(stat)
            self%failure%term = trim(s%model%failed_term)
        end associate

    contains

        !> Compute the factor at the point.
        subroutine go_there()
            call self%system%visit(t, q, self%counts, stat)
            if (stat == status_ok) call self%system%factorize(self%counts, stat)
            if (stat /= status_ok) call self%fail_here(stat)
        end subroutine go_there

        !> Remove C qd - nu; a second pass removes the rounding error of the first, if necessary.
        subroutine meet_velocity_here()
            integer :: pass

            associate (s => self%system, here => self%system%factor(self%system%here))
                do pass = 1, 2
                    s%g(:) = s%model%terms%nu
                    call here%multiply(s%analysis, qd, s%g)
                    if (pass > 1 .and. largest(s%m, s%g, self%velocity_weight) <= self%velocity_tolerance) exit
                    call here%solve(s%analysis, .false., qd, s%g, s%x, s%z)
                    qd = qd + s%x
                end do
            end associate
        end subroutine meet_velocity_here
    end procedure restore_near
end submodule tandem_chart_sparse_nearest
