! SPDX-License-Identifier: MIT
!> Velocities that belong to increments: C qd = nu at a point.
submodule(tandem_chart_sparse_motion) tandem_chart_sparse_velocity
    use tandem_chart_sparse_errors, only: judge_velocity
    implicit none (type, external)

contains

    !> qd = qd0 + eta - Y0 x with C qd = nu.
    module procedure restore_velocity
        self%failure%row = 0
        call self%system%visit(t, q, self%counts, stat)
        if (stat /= status_ok) then
            self%failure%term = trim(self%system%model%failed_term)
            return
        end if
        qd = self%qd0 + increment
        if (self%system%m == 0) return
        call self%system%load()
        call self%meet_velocity(abs(t - self%t0), goal, qd, stat)
    end procedure restore_velocity

    !> Corrections of qd at the last point. C is linear: each leaves the part by which C has changed since the origin. The ends of
    !> steps are judged by the scales there, which a rotating body may have reduced to a tenth: if the Euler parameters of a wheel
    !> point along one axis, the rates of the others do not contribute to the row of their norm.
    module procedure meet_velocity
        integer, parameter :: limit = 60
        real(wp) :: error, error_before, first_error, last_error, wanted
        integer :: k
        logical :: carries, has_left, is_loose, is_near, predicts

        stat = status_ok
        is_loose = goal%is_stage .or. goal%is_iterate
        wanted = max(merge(self%stage_velocity_tolerance, self%velocity_tolerance, goal%is_stage), self%loose_velocity)
        predicts = goal%is_stage .and. goal%defect < huge(1.0_wp)
        ! An iterated stage has nearly the same x each time.
        carries = .not. (goal%is_stage .or. (goal%defect < huge(1.0_wp) .and. .not. goal%is_iterate))
        if (goal%is_iterate .and. goal%defect < huge(1.0_wp)) then
            if (.not. self%has_delta_rate) self%defect_of_rate = 0.0_wp
            is_near = self%velocity%ageing*age <= near
            call self%recall(self%system, self%system%m, goal%defect, is_near, self%defect_of_rate, self%has_bend, &
                self%is_bend_old, self%delta_rate, self%bend)
            if (self%has_bend .and. is_near) self%delta_rate(:) = goal%defect*self%bend
            self%has_delta_rate = self%has_delta_rate .or. (self%has_bend .and. is_near)
        else if (.not. goal%is_iterate) then
            self%defect_of_rate = 0.0_wp
        end if
        first_error = 0.0_wp
        error_before = 0.0_wp
        last_error = unknown
        associate (s => self%system, base => self%system%factor(self%system%base), &
            here => self%system%factor(self%system%here), end_weight => self%system%scales(:, 2))
            if (predicts .and. self%has_delta_rate) qd = qd + goal%defect*self%delta_rate
            if (predicts .and. .not. self%has_delta_rate) self%delta_rate = qd
            if (carries) then
                if (.not. self%has_delta_rate) self%delta_rate = 0.0_wp
                self%has_delta_rate = .false.
                qd = qd + self%delta_rate
                self%delta_rate = self%delta_rate - qd
            end if
            do k = 0, limit
                if (k > 0 .and. is_loose) then
                    if (is_trusted(self%velocity, age, last_error, wanted)) exit
                end if
                if (k == 0 .and. .not. is_loose) then
                    ! The scales at the end replace these when its errors are computed.
                    s%has_scales = .false.
                    call judge_velocity(s%analysis, here, s%model%terms%nu, qd, self%scale, s%rate, s%g, &
                        end_weight)
                else
                    s%g(:) = s%model%terms%nu
                    call here%multiply(s%analysis, qd, s%g)
                end if
                if (is_loose) then
                    error = largest(s%m, s%g, self%velocity_weight)
                else
                    error = largest(s%m, s%g, end_weight)
                end if
                if (.not. error <= huge(1.0_wp)) then
                    stat = status_not_finite
                    call s%name_infinite(stat)
                    self%failure%term = trim(s%model%failed_term)
                    return
                end if
                if (k == 1) call learn(self%velocity, age, error, last_error)
                if (error <= wanted) exit
                if (error <= self%allowed .and. is_rounding(error, last_error, error_before)) exit
                if (k == 0) first_error = error
                has_left = k == limit .or. .not. error <= 1.0e3_wp*max(first_error, wanted)
                if (.not. has_left) then
                    call base%solve(s%analysis, .false., qd, s%g, s%x, s%z)
                    if (self%secants%is_used) call self%secants%mend(k, error, last_error, self%n, s%x, has_left)
                end if
                if (has_left) then
                    stat = status_chart_left
                    self%failure%row = maxloc(abs(s%g)*merge(self%velocity_weight, end_weight, is_loose), dim=1)
                    self%failure%value = error
                    return
                end if
                qd = qd + s%x
                if (k > 0) error_before = last_error
                last_error = error
            end do
            if (carries) then
                self%delta_rate = self%delta_rate + qd
                self%has_delta_rate = .true.
            end if
            if (.not. predicts) return
            if (self%has_delta_rate .or. .not. abs(goal%defect) > 0.0_wp) return
            self%delta_rate = (qd - self%delta_rate)/goal%defect
            self%has_delta_rate = .true.
        end associate
    end procedure meet_velocity
end submodule tandem_chart_sparse_velocity
