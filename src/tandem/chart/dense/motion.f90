! SPDX-License-Identifier: MIT
!> The motion at a point: position, velocity and acceleration that belong to increments, and the splitting of velocities by C.
submodule(tandem_chart_dense) tandem_chart_dense_motion
    implicit none (type, external)

contains

    module procedure restore
        if (associated(self%timer)) call self%timer%begin_operation(of_position)
        call self%restore_position(t, dq, goal, q, stat)
        if (associated(self%timer)) call self%timer%end_operation()
        if (stat /= status_ok) return
        if (associated(self%timer)) call self%timer%begin_operation(of_velocity)
        call self%restore_velocity(t, q, dqd, goal, qd, stat)
        if (associated(self%timer)) call self%timer%end_operation()
    end procedure restore

    module procedure restore_position
        call self%position%restore(self%model, t, self%q0, increment, goal, q, self%counts, stat)
        self%point%has_phi = stat == status_ok .and. self%nh > 0 .and. .not. goal%is_stage
        self%failure%row = 0
        if (stat == status_ok) return
        call self%blame(self%position%failed_row, self%position%failed_value)
        call self%fail_term()
    end procedure restore_position

    module procedure visit
        stat = status_ok
        if (self%point%is_at(t, q)) return
        call self%point%leave()
        call evaluate_place(self, t, q, stat)
        if (stat == status_ok) call self%point%arrive(t, q)
    end procedure visit

    !> Evaluate C, nu and M at (t, q).
    subroutine evaluate_place(self, t, q, stat)
        class(dense_chart_type), intent(inout) :: self
        real(wp), intent(in) :: t, q(self%n)
        integer, intent(out) :: stat

        ! None of these depends on the velocity; q is passed in its place.
        call self%model%evaluate(need_jacobian + need_nu + need_mass, t, q, q, self%counts, stat)
        if (stat /= status_ok) call self%fail_term()
    end subroutine evaluate_place

    module procedure move_to
        call self%visit(t, q, stat)
        if (stat == status_ok) call self%refuse_infinite(stat)
    end procedure move_to

    module procedure refuse_infinite
        stat = status_ok
        if (self%point%is_finite) return
        associate (terms => self%model%terms)
            self%point%is_finite = is_finite(size(terms%jacobian), terms%jacobian) .and. is_finite(self%m, terms%nu)
        end associate
        if (.not. self%point%is_finite) call self%name_infinite(stat)
    end procedure refuse_infinite

    module procedure find_velocity_basis
        stat = status_ok
        if (self%point%has_velocity_basis) return
        associate (jacobian => self%model%terms%jacobian)
            if (self%mode%has_bases) then
                call self%refuse_infinite(stat)
                if (stat /= status_ok) return
                if (self%mode%refines) call self%position%refine(jacobian, self%counts, stat)
                if (stat /= status_ok) return
                call self%velocity_basis%update(jacobian, self%bases%x, self%bases%w, self%counts, stat)
            else
                ! An elimination detects values of C that are not finite.
                call self%velocity_basis%eliminate(self%n, jacobian, self%scale, self%counts, stat)
                if (stat == status_ok .and. self%mode%has_nu) then
                    if (.not. is_finite(self%m, self%model%terms%nu)) stat = status_not_finite
                end if
            end if
        end associate
        if (stat /= status_ok) then
            call blame_velocity_basis(self, stat)
            return
        end if
        call self%point%note_velocity_basis()
        if (.not. self%mode%has_bases) call self%free_motion%load(self%velocity_basis%elimination)
    end procedure find_velocity_basis

    !> Store the row of C at fault, or the term that is not finite.
    subroutine blame_velocity_basis(self, stat)
        class(dense_chart_type), intent(inout) :: self
        integer, intent(inout) :: stat

        call self%blame(self%velocity_basis%failed_row, 0.0_wp)
        if (stat == status_not_finite) call self%name_infinite(stat)
    end subroutine blame_velocity_basis

    module procedure complete_velocity_basis
        call self%find_velocity_basis(stat)
        if (stat == status_ok) call self%velocity_basis%complete(self%model%terms%jacobian, self%bases%x, self%bases%w)
    end procedure complete_velocity_basis

    module procedure restore_velocity
        integer :: pass

        self%failure%row = 0
        if (goal%is_stage) then
            ! Only its acceleration is requested next: the coordinates need not be stored and compared.
            call self%point%pass(t)
            call evaluate_place(self, t, q, stat)
        else
            call self%visit(t, q, stat)
        end if
        if (stat == status_ok) call self%find_velocity_basis(stat)
        if (stat /= status_ok) return
        if (goal%is_stage .and. self%mode%skips_basis) then
            call self%position%follow(self%point%t, self%velocity_basis%elimination%height, &
                self%velocity_basis%elimination%matrix, self%counts)
        end if
        call add(self%n, self%qd0, increment, qd)
        if (self%m == 0) return
        if (.not. self%mode%has_bases) then
            call self%free_motion%restore_velocity(self%velocity_basis%elimination, self%mode%has_nu, .not. goal%is_stage, &
                self%model%terms%nu, qd, stat)
            return
        end if
        associate (terms => self%model%terms)
            ! qd - R (C qd - nu); twice if rounding errors are removed, once with the accuracy of H, the paper's tolerance.
            do pass = 1, merge(1, 2, self%mode%refines)
                self%work%x = -terms%nu
                call add_product(terms%jacobian, qd, 1.0_wp, self%work%x)
                call self%velocity_basis%subtract_right_inverse(self%bases%x, self%work%x, qd)
            end do
        end associate
    end procedure restore_velocity

    module procedure move_with
        call self%visit(t, q, stat)
        if (stat /= status_ok) return
        if (self%point%is_moving_with(qd)) return
        call self%point%forget_motion()
        call evaluate_motion(self, t, q, qd, stat)
        if (stat == status_ok) call self%point%note_motion(qd)
    end procedure move_with

    !> Evaluate gamma and the forces at the current point.
    subroutine evaluate_motion(self, t, q, qd, stat)
        class(dense_chart_type), intent(inout) :: self
        real(wp), intent(in) :: t, q(self%n), qd(self%n)
        integer, intent(out) :: stat

        self%counts%right_hand_sides = self%counts%right_hand_sides + 1
        call self%model%evaluate(need_gamma + need_force, t, q, qd, self%counts, stat)
        if (stat == status_ok .and. .not. self%mode%has_gamma) then
            call self%rows%evaluate_gamma(self%differences, self%model, t, q, qd, self%counts, stat)
        end if
        if (stat == status_ok .and. self%friction%n > 0) call add_friction(self, t, q, qd, stat)
        if (stat /= status_ok) call self%fail_term()
    end subroutine evaluate_motion

    !> Add the friction due to the reactions at this point to the forces.
    subroutine add_friction(self, t, q, qd, stat)
        class(dense_chart_type), intent(inout) :: self
        real(wp), intent(in) :: t, q(self%n), qd(self%n)
        integer, intent(out) :: stat

        call self%complete_velocity_basis(stat)
        if (stat == status_ok) call self%friction%add_force(self%model, self%dynamics, self%velocity_basis%null_space, &
            self%velocity_basis%right_inverse, t, q, qd, stat)
    end subroutine add_friction

    module procedure do_accelerate
        self%failure%row = 0
        ! Phi still belongs to another point after a stage that was not projected.
        if (goal%is_stage) self%point%has_phi = .false.
        if (goal%is_stage .and. self%point%is_passed) then
            call self%point%leave_passed()
            call evaluate_motion(self, t, q, qd, stat)
        else
            call self%move_with(t, q, qd, stat)
        end if
        if (stat == status_ok) call self%find_velocity_basis(stat)
        if (stat /= status_ok) return
        self%counts%mass_factorizations = self%counts%mass_factorizations + min(self%n - self%m, 1)
        associate (terms => self%model%terms, velocity_basis => self%velocity_basis)
            if (self%mode%has_bases) then
                call self%complete_velocity_basis(stat)
                if (stat == status_ok) call self%dynamics%factor(terms%mass, velocity_basis%null_space, stat)
                if (stat == status_ok) call self%dynamics%solve(terms%mass, velocity_basis%null_space, &
                    velocity_basis%right_inverse, terms%gamma, terms%force, qdd, stat)
                if (stat == status_ok .and. .not. self%mode%refines) call self%dynamics%polish(terms%jacobian, &
                    velocity_basis%right_inverse, terms%gamma, qdd)
            else
                call self%free_motion%solve(velocity_basis%elimination, .not. goal%is_stage, &
                    self%model%blocks(:2*self%model%n_blocks), terms%mass, terms%gamma, terms%force, qdd, stat)
            end if
            if (stat /= status_ok) call self%name_infinite(stat)
        end associate
    end procedure do_accelerate
end submodule tandem_chart_dense_motion
