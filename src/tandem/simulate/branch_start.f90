! SPDX-License-Identifier: MIT
!> Start in a singular configuration: if the velocity belongs to one branch, the motion along it is smooth, and C has its rank again
!> beside the start. A polynomial from the start satisfies the equations of motion at some times behind it (collocation), and is the
!> first step (theory, section 25).
submodule(tandem_simulation:tandem_simulate_start) tandem_simulate_branch_start
    implicit none (type, external)

    !> Times at which the equations of motion are satisfied, relative to the length of the step.
    real(wp), parameter :: nodes(8) = [0.3_wp, 0.4_wp, 0.5_wp, 0.6_wp, 0.7_wp, 0.8_wp, 0.9_wp, 1.0_wp]
    !> Largest error of the step.
    real(wp), parameter :: largest_error = 1.0e-5_wp

contains

    module procedure start_on_branch
        !> Distance of the state beside the start, on the coordinates' scales; part of it by which a position and a velocity may be
        !> off before their correction. Both are of the order of the distance if the velocity belongs to a branch.
        real(wp), parameter :: beside = 1.0e-3_wp, off = 0.1_wp
        type(error_type), allocatable :: branch_error
        type(assembly_type) :: request
        real(wp) :: speed, longest, t

        associate (state => self%state, model => self%model, crossing => self%crossing)
            t = state%t
            call state%begin(t, q, qd)
            speed = model%largest_on_scales(qd)
            crossing%obstacle = 'the velocity is zero'
            if (.not. speed > tiny(speed)) return
            longest = time_to_breakpoint(self, t)
            state%t = t + min(beside/speed, 0.5_wp*longest)
            state%q(:) = q + (state%t - t)*qd
            call assemble(model, request, state%t, state%q, state%qd, branch_error)
            crossing%obstacle = 'the velocity belongs to no branch'
            if (allocated(branch_error)) return
            if (model%largest_on_scales(request%moved_q) > off*speed*(state%t - t)) return
            if (model%largest_on_scales(request%moved_qd) > off*speed) return
            self%is_sparse = is_sparse
            self%n_redundant = 0
            call self%allocate_chart()
            if (.not. self%has_surplus_rows()) call self%chart%attach(model, self%options, self%method%implicit, &
                self%method%damps, branch_error)
            if (.not. allocated(branch_error)) call accept_state(self, branch_error)
            crossing%obstacle = 'no motion begins there'
            if (allocated(branch_error)) return
            call choose_step(self, t, q, qd, speed, longest)
            if (crossing%obstacle /= '') return
            deallocate (error)
            call begin_there(self, t, q, qd)
        end associate
    end procedure start_on_branch

    module procedure continue_on_branch
        !> Distance to a configuration ahead, in multiples of the one from which C determines the motion well.
        real(wp), parameter :: ahead = 10.0_wp
        type(crossing_record_type) :: former
        real(wp) :: q(size(self%state%q)), qd(size(self%state%q))

        associate (state => self%state, crossing => self%crossing)
            is_done = .false.
            former = crossing%record
            if (.not. crossing%is_last_step .or. state%t < former%t - ahead*crossing%near .or. &
                state%t > former%t + crossing%near) return
            q = state%q
            qd = state%qd
            call choose_step(self, state%t, q, qd, self%model%largest_on_scales(qd), time_to_breakpoint(self, state%t))
            is_done = crossing%obstacle == ''
            if (.not. is_done) return
            crossing%starts = .true.
            crossing%is_listed = .false.
            crossing%record%t = former%t
            crossing%record%error = max(crossing%record%error, former%error)
            call crossing%curve%evaluate(state%t, q, qd, state%qdd)
        end associate
    end procedure continue_on_branch

    !> The time until functions of time change next.
    pure real(wp) function time_to_breakpoint(self, t) result(left)
        class(simulation_type), intent(in) :: self
        real(wp), intent(in) :: t

        left = huge(1.0_wp)
        if (.not. allocated(self%model%breakpoints)) return
        if (self%model%segment <= size(self%model%breakpoints)) left = self%model%breakpoints(self%model%segment) - t
    end function time_to_breakpoint

    !> Find the length of the first step with the smallest error. `obstacle` is blank if there is one.
    subroutine choose_step(self, t, q, qd, speed, longest)
        class(simulation_type), intent(inout) :: self
        !> The start; its largest velocity on the coordinates' scales; the latest end.
        real(wp), intent(in) :: t, q(:), qd(:), speed, longest
        !> Longest step on the coordinates' scales; increase of a sufficient error from which on shorter steps are not tried.
        real(wp), parameter :: farthest = 0.3_wp, grows = 100.0_wp
        integer, parameter :: n_tries = 12
        real(wp) :: h, last_h, best_h, error, least_error, off, least_off
        integer :: i

        least_error = huge(1.0_wp)
        least_off = 0.0_wp
        last_h = 0.0_wp
        best_h = 0.0_wp
        do i = 1, n_tries
            h = min(farthest*0.5_wp**(i - 1)/speed, longest)
            if (.not. self%options%is_adaptive()) h = self%options%step*real(ceiling(h/self%options%step), wp)
            if (h > longest .or. abs(h - last_h) <= 0.0_wp) cycle
            last_h = h
            call collocate(self, t, q, qd, h, error, off)
            if (error < least_error) then
                least_error = error
                least_off = off
                best_h = h
            end if
            if (least_error <= largest_error .and. error > grows*least_error) exit
        end do
        associate (crossing => self%crossing)
            crossing%obstacle = 'the motion along the velocity is uncertain by '//to_text(min(least_error, 1.0_wp))
            if (least_off > 0.5_wp*least_error) crossing%obstacle = 'the velocity belongs to no branch, and is off by '// &
                to_text(least_off)
            if (.not. least_error <= largest_error) return
            call collocate(self, t, q, qd, best_h, error, off)
            crossing%obstacle = ''
            crossing%record%t = t
            crossing%record%t_from = t
            crossing%record%t_to = t + best_h
            crossing%record%error = error
        end associate
    end subroutine choose_step

    !> Determine the polynomial of a step.
    subroutine collocate(self, t, q, qd, h, error, off)
        class(simulation_type), intent(inout) :: self
        real(wp), intent(in) :: t, q(:), qd(:), h
        !> Relative error, huge if there is no result.
        real(wp), intent(out) :: error
        !> Part of it by which the polynomial misses the manifold.
        real(wp), intent(out) :: off
        real(wp) :: change
        integer :: stat

        off = 0.0_wp
        error = huge(1.0_wp)
        associate (crossing => self%crossing, trial => self%crossing%trial, there => self%crossing%predicted)
            if (.not. allocated(trial%q)) call trial%allocate(size(q))
            if (.not. allocated(there%q)) call there%allocate(size(q))
            trial%qdd(:) = 0.0_wp
            call crossing%collocation%begin(t, q, qd, t + nodes*h)
            call crossing%collocation%iterate(self%chart, self%local_error, size(nodes), 0.0_wp, crossing%curve, trial, there, &
                change, off, stat)
            if (stat /= status_ok) return
            call crossing%collocation%find_difference(1, 1, there%dq, there%dqd)
            error = max(off, change, self%local_error%largest_part(trial, there%dq, there%dqd))
        end associate
    end subroutine collocate

    !> Return to the start, with the chart at the end of the first step.
    subroutine begin_there(self, t, q, qd)
        class(simulation_type), intent(inout) :: self
        real(wp), intent(in) :: t, q(:), qd(:)
        integer :: rows(3), stat

        associate (state => self%state, crossing => self%crossing)
            crossing%starts = .true.
            crossing%is_listed = .false.
            crossing%near = 0.1_wp*(crossing%record%t_to - t)
            call state%copy(crossing%trial)
            call self%move_origin(stat)
            call state%begin(t, q, qd)
            call crossing%curve%evaluate(t, self%next%q, self%next%qd, state%qdd)
            self%tally%start_moved_q = 0.0_wp
            self%tally%start_moved_qd = 0.0_wp
            call self%chart%find_errors(t, state%q, state%qd, state%qdd, self%errors, rows, stat)
        end associate
    end subroutine begin_there
end submodule tandem_simulate_branch_start
