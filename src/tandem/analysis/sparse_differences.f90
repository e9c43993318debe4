! SPDX-License-Identifier: MIT
!> K and D by central differences of eighth order along groups of coordinates, and a comparison along a random direction that
!> detects entries missing from the pattern.
submodule(tandem_analysis_sparse_point) tandem_analysis_sparse_differences
    use tandem_linalg_random, only: random_vector
    implicit none (type, external)

    !> Displacements and weights of central differences of eighth order; the step in coordinate scales.
    real(wp), parameter :: place(8) = [-4.0_wp, -3.0_wp, -2.0_wp, -1.0_wp, 1.0_wp, 2.0_wp, 3.0_wp, 4.0_wp]
    real(wp), parameter :: weight(8) = [1.0_wp/280, -4.0_wp/105, 0.2_wp, -0.8_wp, 0.8_wp, -0.2_wp, 4.0_wp/105, -1.0_wp/280]
    real(wp), parameter :: step = 2.0_wp**(-8)

contains

    module procedure differentiate
        integer :: g, l
        logical :: rough

        rough = .false.
        if (present(is_rough)) rough = is_rough
        self%stiffness = 0.0_wp
        self%damping = 0.0_wp
        if (self%m > self%nh .and. .not. allocated(self%turning)) allocate (self%turning(self%m, self%pattern%width), &
            source=0.0_wp)
        stat = status_ok
        if (allocated(self%derivatives)) then
            call copy_derivatives(self, stat)
            return
        end if
        associate (first => self%pattern%first)
            do g = 1, self%n_groups
                do l = 1, maxval(first(2:) - first(:size(first) - 1), mask=self%group == g)
                    call difference(self, g, l, .false., rough, self%stiffness, stat)
                    if (stat == status_ok .and. with_damping) call difference(self, g, l, .true., rough, self%damping, stat)
                    if (stat /= status_ok) return
                end do
            end do
        end associate
        ! Restore the terms of the point itself.
        call self%evaluator%evaluate(need_jacobian + need_force + need_mass, self%t, self%q, self%rest, self%counts, stat)
    end procedure differentiate

    !> K, D and (C X q - nu)_q of a model at rest from its own derivatives.
    subroutine copy_derivatives(self, stat)
        type(sparse_point_type), intent(inout) :: self
        integer, intent(out) :: stat
        real(wp) :: none(self%n), total
        integer :: j, k

        none = 0.0_wp
        call self%differences%evaluate_derivatives(self%t, self%q, self%rest, none, self%lambda, self%derivatives, &
            self%counts, stat)
        if (stat /= status_ok) return
        do j = 1, self%n
            do k = self%columns%start(j), self%columns%start(j + 1) - 1
                self%stiffness(k) = self%derivatives%dynamics_q(self%columns%row(k), j)
                self%damping(k) = self%derivatives%dynamics_qd(self%columns%row(k), j)
            end do
        end do
        if (allocated(self%turning)) self%turning = self%derivatives%velocity_q
        total = sum(abs(self%stiffness)) + sum(abs(self%damping)) + sum(abs(self%derivatives%velocity_q))
        if (.not. total <= huge(1.0_wp)) stat = status_not_finite
    end subroutine copy_derivatives

    !> The columns of coordinate l of the bodies of a group.
    subroutine difference(self, g, l, by_qd, is_rough, columns, stat)
        type(sparse_point_type), intent(inout) :: self
        integer, intent(in) :: g, l
        logical, intent(in) :: by_qd, is_rough
        real(wp), intent(inout) :: columns(:)
        integer, intent(out) :: stat
        real(wp), dimension(self%n) :: direction, change
        real(wp) :: change_of_rows(self%m)
        integer :: b, i, j, k

        direction = 0.0_wp
        do b = 1, size(self%group)
            j = self%pattern%first(b) + l - 1
            if (self%group(b) == g .and. j < self%pattern%first(b + 1)) direction(j) = self%scale(j)
        end do
        call difference_along(self, direction, step, by_qd, is_rough, change, change_of_rows, stat)
        if (stat /= status_ok) return
        if (.not. by_qd) then
            ! One of the bodies of a row is in the group.
            do i = self%nh + 1, self%m
                do k = self%pattern%row_start(i), self%pattern%row_start(i + 1) - 1
                    do j = self%pattern%first(self%pattern%row_body(k)), self%pattern%first(self%pattern%row_body(k) + 1) - 1
                        if (direction(j) > 0.0_wp) self%turning(i, self%pattern%column(j)) = change_of_rows(i)/self%scale(j)
                    end do
                end do
            end do
        end if
        do j = 1, self%n
            if (.not. direction(j) > 0.0_wp) cycle
            do k = self%columns%start(j), self%columns%start(j + 1) - 1
                columns(k) = change(self%columns%row(k))/self%scale(j)
            end do
        end do
    end subroutine difference

    !> The derivative of C' lambda - S - Q_A, and by q that of C X q - nu of rows at velocity level, along a direction; in a moving
    !> frame with M (L X q + 2 L qd).
    subroutine difference_along(self, direction, h, by_qd, is_rough, change, change_of_rows, stat)
        type(sparse_point_type), intent(inout) :: self
        real(wp), intent(in) :: direction(:), h
        logical, intent(in) :: by_qd, is_rough
        real(wp), intent(out) :: change(:), change_of_rows(:)
        integer, intent(out) :: stat
        real(wp), dimension(self%n) :: q, qd, more, residual
        real(wp) :: rows(self%m), factor
        integer :: i, need

        change = 0.0_wp
        change_of_rows = 0.0_wp
        need = need_force + merge(0, need_jacobian + need_nu, by_qd) + merge(need_mass, 0, self%frame%moves)
        ! The two positions in the middle are those of second order.
        do i = merge(size(place)/2, 1, is_rough), merge(size(place)/2 + 1, size(place), is_rough)
            factor = merge(0.5_wp*place(i), weight(i), is_rough)/h
            q = self%q
            more = 0.0_wp
            if (by_qd) more = place(i)*h*direction
            if (.not. by_qd) q = q + place(i)*h*direction
            qd = self%frame%velocity(q) + more
            call self%evaluator%evaluate(need, self%t, q, qd, self%counts, stat)
            if (stat /= status_ok) return
            if (by_qd) then
                residual = 0.0_wp
                if (self%frame%moves) call self%pattern%multiply_mass(self%evaluator%terms%mass, 2*self%frame%turned(more), &
                    residual)
                residual = residual - self%evaluator%terms%force
            else
                call add_forces(self, self%lambda, self%frame%turned(qd), residual)
                if (self%m > self%nh) then
                    call self%pattern%multiply(self%evaluator%terms%jacobian, qd, .false., rows)
                    rows = rows - self%evaluator%terms%nu
                    change_of_rows(self%nh + 1:) = change_of_rows(self%nh + 1:) + factor*rows(self%nh + 1:)
                end if
            end if
            change = change + factor*residual
        end do
        if (.not. sum(abs(change)) + sum(abs(change_of_rows)) <= huge(1.0_wp)) stat = status_not_finite
    end subroutine difference_along

    module procedure check_structure
        !> Part of the sizes of the terms that differences of either step may leave as an error.
        real(wp), parameter :: bound = 1.0e-6_wp
        real(wp), dimension(self%n) :: direction, change, product, sizes
        real(wp), dimension(self%m) :: rows, known, all_rows
        integer :: seed, stat

        seed = 1234567
        direction = self%scale*random_vector(seed, self%n)
        call difference_along(self, direction, step/8, .false., .false., change, rows, stat)
        if (stat == status_ok) then
            call self%columns%multiply(self%stiffness, direction, product, sizes)
            sizes = sizes + self%sizes
            if (any(abs(product - change) > bound*max(sizes, 1.0e-6_wp*maxval(sizes)))) then
                call refuse('the forces of the model "'//self%model%name//'" depend on coordinates of bodies that it does '// &
                    'not name as neighbours, or change within a step of differences')
                return
            end if
            if (self%m > self%nh) then
                call self%pattern%multiply(self%turning, direction, .false., known)
                call self%pattern%multiply(self%turning, direction, .true., all_rows)
                if (any(abs(rows - known) > bound*max(all_rows, 1.0e-6_wp*maxval([0.0_wp, all_rows])))) then
                    call refuse('rows at velocity level of the model "'//self%model%name//'" depend on coordinates of bodies '// &
                        'that they do not touch')
                    return
                end if
            end if
            call difference_along(self, direction, step/8, .true., .false., change, rows, stat)
        end if
        if (stat == status_ok) then
            call self%columns%multiply(self%damping, direction, product, sizes)
            sizes = sizes + self%sizes
            if (any(abs(product - change) > bound*max(sizes, 1.0e-6_wp*maxval(sizes)))) then
                call refuse('the forces of the model "'//self%model%name//'" depend on velocities of bodies that it does '// &
                    'not name as neighbours, or change within a step of differences')
                return
            end if
        end if
        if (stat == status_ok) call self%evaluator%evaluate(need_jacobian + need_nu + need_force + need_mass, self%t, self%q, &
            self%rest, self%counts, stat)
        if (stat /= status_ok) call set_error(error, stat, 'the model "'//self%model%name// &
            '" cannot be evaluated around the point')

    contains

        subroutine refuse(message)
            character(len=*), intent(in) :: message

            call set_error(error, status_invalid_model, message, 'use full matrices (tandem linearise without --near)')
        end subroutine refuse
    end procedure check_structure
end submodule tandem_analysis_sparse_differences
