! SPDX-License-Identifier: MIT
!> Results at a point: multipliers, projections, constraint errors.
submodule(tandem_chart_dense) tandem_chart_dense_answers
    use tandem_linalg_lapack, only: dpotrf, dpotrs
    implicit none (type, external)

contains

    module procedure do_find_multipliers
        lambda = 0.0_wp
        call self%move_with(t, q, qd, stat)
        if (stat == status_ok) call self%complete_velocity_basis(stat)
        if (stat /= status_ok) return
        self%counts%multipliers = self%counts%multipliers + 1
        if (allocated(self%rows%dropped)) then
            call share_load(self%rows%dropped, lambda)
        else
            call self%dynamics%multipliers(self%model%terms%mass, self%velocity_basis%right_inverse, self%model%terms%force, &
                qdd, lambda)
        end if

    contains

        !> The multipliers of least norm. Rows that were left out are combinations K C = C_l of the others, K = C_l R: forces y of
        !> these rows reduce the multipliers of the others to mu - K'y, and (I + K K') y = K mu minimises the norm of all.
        subroutine share_load(left_out, lambda)
            integer, intent(in) :: left_out(:)
            real(wp), intent(inout), contiguous :: lambda(:)
            real(wp) :: mu(size(self%model%kept)), combination(size(left_out), size(mu)), gram(size(left_out), size(left_out))
            real(wp) :: share(size(left_out))
            integer :: i, info

            call self%dynamics%multipliers(self%model%terms%mass, self%velocity_basis%right_inverse, self%model%terms%force, &
                qdd, mu)
            combination = matmul(self%model%all_rows%jacobian(left_out, :), self%velocity_basis%right_inverse)
            gram = matmul(combination, transpose(combination))
            do i = 1, size(left_out)
                gram(i, i) = gram(i, i) + 1.0_wp
            end do
            share = matmul(combination, mu)
            call dpotrf('L', size(left_out), gram, size(left_out), info)
            call dpotrs('L', size(left_out), 1, gram, size(left_out), share, size(left_out), info)
            lambda(self%model%kept) = mu - matmul(share, combination)
            lambda(left_out) = share
        end subroutine share_load
    end procedure do_find_multipliers

    module procedure do_project
        if (moves_q) then
            call restore_near(self, t, exactly, q, qd, stat)
        else
            call project_velocity(self, t, q, qd, stat)
        end if
    end procedure do_project

    !> The nearest velocity in the mass metric.
    subroutine project_velocity(self, t, q, qd, stat)
        class(dense_chart_type), intent(inout) :: self
        real(wp), intent(in) :: t, q(self%n)
        real(wp), intent(inout) :: qd(self%n)
        integer, intent(out) :: stat

        self%failure%row = 0
        call self%move_to(t, q, stat)
        if (stat == status_ok) call self%complete_velocity_basis(stat)
        if (stat /= status_ok) return
        associate (r => self%velocity_basis%right_inverse, d => self%velocity_basis%null_space)
            call self%dynamics%factor(self%model%terms%mass, d, stat)
            if (stat /= status_ok) return
            call self%dynamics%project(d, r, self%model%terms%nu, qd)
        end associate
        if (.not. sum(abs(qd)) <= huge(1.0_wp)) stat = status_not_finite
    end subroutine project_velocity

    !> Bring a point beside the manifold onto it: q := q - R (Phi, 0) until Phi = 0 and qd := qd - R (C qd - nu), with the R of the
    !> point itself. Newton's iteration, but C is reused while Phi falls fast.
    subroutine restore_near(self, t, exactly, q, qd, stat)
        class(dense_chart_type), intent(inout) :: self
        real(wp), intent(in) :: t
        logical, intent(in) :: exactly
        real(wp), intent(inout) :: q(self%n), qd(self%n)
        integer, intent(out) :: stat
        !> From an error of the size of the coordinates a few corrections suffice; an iteration that takes more diverges.
        integer, parameter :: most = 30
        real(wp), parameter :: fast = 0.1_wp, slow = 0.5_wp
        real(wp) :: error, last_error
        logical :: is_at_rounding
        integer :: k, pass

        self%failure%row = 0
        last_error = huge(1.0_wp)
        stat = status_ok
        do k = 0, merge(most, -1, self%nh > 0)
            call self%model%evaluate_phi(t, q, self%counts, stat)
            if (stat /= status_ok) then
                call self%fail_term()
                return
            end if
            call self%position%judge(self%model%terms%phi, error)
            if (.not. error <= huge(1.0_wp)) then
                call self%name_infinite(stat)
                return
            end if
            is_at_rounding = error >= slow*last_error
            if (self%position%is_restored(error) .and. (is_at_rounding .or. .not. exactly)) exit
            ! The point is near enough.
            if (error <= self%tolerance .and. is_at_rounding) exit
            if (k == most) then
                stat = status_position_diverged
                call self%blame(self%position%failed_row, error)
                return
            end if
            if (k == 0 .or. error > fast*last_error) call split_at(stat)
            if (stat /= status_ok) return
            self%work%x = 0.0_wp
            self%work%x(:self%nh) = self%model%terms%phi
            call self%velocity_basis%subtract_right_inverse(self%bases%x, self%work%x, q)
            last_error = error
        end do
        call split_at(stat)
        if (stat /= status_ok) return
        self%point%has_phi = self%nh > 0
        ! The second pass removes the rounding error of the first.
        do pass = 1, 2
            self%work%x(:) = -self%model%terms%nu
            call add_product(self%model%terms%jacobian, qd, 1.0_wp, self%work%x)
            call self%velocity_basis%subtract_right_inverse(self%bases%x, self%work%x, qd)
        end do
        if (.not. sum(abs(qd)) <= huge(1.0_wp)) call self%name_infinite(stat)

    contains

        !> R at the point.
        subroutine split_at(stat)
            integer, intent(out) :: stat

            call self%move_to(t, q, stat)
            if (stat == status_ok) call self%complete_velocity_basis(stat)
        end subroutine split_at
    end subroutine restore_near

    !> Remove from errors of rates at the point of the last projection their components normal to a curve: R Phi_q e_q from the
    !> error of q, because the velocity constraints do not bind the curve itself, and R C e_qd from the error of qd.
    module procedure remove_normal
        self%work%x = 0.0_wp
        call add_product(self%model%terms%jacobian, error_q, 1.0_wp, self%work%x)
        self%work%x(self%nh + 1:) = 0.0_wp
        call self%velocity_basis%subtract_right_inverse(self%bases%x, self%work%x, error_q)
        self%work%x = 0.0_wp
        call add_product(self%model%terms%jacobian, error_qd, 1.0_wp, self%work%x)
        call self%velocity_basis%subtract_right_inverse(self%bases%x, self%work%x, error_qd)
    end procedure remove_normal

    module procedure do_find_errors
        errors = 0.0_wp
        rows = 0
        if (self%m == 0) then
            stat = status_ok
            return
        end if
        call self%move_with(t, q, qd, stat)
        if (stat /= status_ok) return
        ! All redundant rows count, including dropped rows.
        if (self%nh > 0 .and. .not. self%point%has_phi) then
            call self%model%evaluate(need_phi, t, q, qd, self%counts, stat)
            if (stat /= status_ok) then
                call self%fail_term()
                return
            end if
        end if
        call self%model%set_magnitudes(q, self%work%magnitude)
        if (allocated(self%rows%dropped)) then
            call constraint_errors(self%model%all_rows, self%work%magnitude, qd, qdd, self%scale, self%rate, errors, rows)
        else
            call constraint_errors(self%model%terms, self%work%magnitude, qd, qdd, self%scale, self%rate, errors, rows)
        end if
        if (.not. maxval(errors) < huge(1.0_wp)) call self%name_infinite(stat)
    end procedure do_find_errors

    !> Find the term that is not finite, if there is one, after a failure. Invalidate the point, so that it can be tried again.
    module procedure name_infinite
        call self%point%forget()
        associate (terms => self%model%terms)
            if (.not. sum(abs(terms%phi)) <= huge(1.0_wp)) then
                self%failure%term = 'phi'
            else if (.not. sum(abs(terms%jacobian)) <= huge(1.0_wp)) then
                self%failure%term = 'jacobian'
            else if (.not. sum(abs(terms%nu)) <= huge(1.0_wp)) then
                self%failure%term = 'nu'
            else if (.not. sum(abs(terms%mass)) <= huge(1.0_wp)) then
                self%failure%term = 'mass'
            else if (.not. sum(abs(terms%gamma)) <= huge(1.0_wp)) then
                self%failure%term = 'gamma'
            else if (.not. sum(abs(terms%force)) <= huge(1.0_wp)) then
                self%failure%term = 'force'
            else
                self%failure%term = 'the velocity'
                return
            end if
        end associate
        stat = status_not_finite
    end procedure name_infinite
end submodule tandem_chart_dense_answers
