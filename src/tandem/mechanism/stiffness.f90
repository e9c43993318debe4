! SPDX-License-Identifier: MIT
!> Gradient blocks of a mechanism by bodies. For each element, the poses of its bodies temporarily refer to the columns of a small
!> window; the element is differentiated into the window, and the window is added to the blocks of the bodies.
!>
!> Curvatures of constraints are included for coincident points and Euler parameters, which matter for hanging bodies. Those of axes
!> and distances are omitted, because they couple bodies that have no force in common.
submodule(tandem_mechanism) tandem_mechanism_stiffness
    implicit none (type, external)

    !> Blocks requested from each element.
    integer, parameter :: needed = need_dynamics_q + need_dynamics_qd

contains

    !> List the pairs of bodies with a force in common, and determine the size of the window.
    module procedure list_coupled
        integer, allocatable :: pairs(:, :)
        integer :: i, j, k, n, n_bodies, pass, most

        most = 2
        allocate (self%touched(most))
        do pass = 1, 2
            n = 0
            do k = 1, size(self%force_kinds)
                associate (kind => self%kinds(self%force_kinds(k))%of)
                    do i = 1, kind%n
                        call kind%touch(i, self%at, n_bodies, self%touched)
                        most = max(most, n_bodies)
                        do j = 2, n_bodies
                            call add_pair(self%touched(1), self%touched(j))
                        end do
                    end do
                end associate
            end do
            if (pass == 1) allocate (pairs(2, n), source=0)
        end do
        call move_alloc(pairs, self%pattern%coupled)
        call self%window%allocate(7*most, 0)

    contains

        !> Append a pair.
        subroutine add_pair(one, two)
            integer, intent(in) :: one, two

            n = n + 1
            if (allocated(pairs)) pairs(:, n) = [one, two]
        end subroutine add_pair
    end procedure list_coupled

    module procedure evaluate_stiffness
        integer :: i, j, k, n, n_rows

        stat = 0
        call stiffness%clear()
        call self%set_motion(t, q, qd, qdd)
        n_rows = merge(2, 3, self%planar)
        do i = 1, size(self%coincidences)
            associate (it => self%coincidences(i))
                call open_window(self, [it%first, it%second])
                call differentiate_coincidences(self%coincidences(i:i), n_rows, need_dynamics_q, self%at%pose, lambda, self%window)
                call close_window(self, [it%first, it%second], stiffness)
            end associate
        end do
        do i = 1, size(self%turning)
            associate (body => self%turning(i))
                call open_window(self, [body])
                call differentiate_inertia(self%bodies(body), self%at%pose(body), needed, self%window)
                do j = self%at%pose(body)%turn, self%at%pose(body)%turn + 3
                    self%window%dynamics_q(j, j) = self%window%dynamics_q(j, j) + lambda(self%before_norms + i)
                end do
                call close_window(self, [body], stiffness)
            end associate
        end do
        do k = 1, size(self%force_kinds)
            associate (kind => self%kinds(self%force_kinds(k))%of)
                do i = 1, kind%n
                    call kind%touch(i, self%at, n, self%touched)
                    call open_window(self, self%touched(:n))
                    call kind%differentiate(i, i, needed, self%at, lambda, self%window)
                    call close_window(self, self%touched(:n), stiffness)
                end do
            end associate
        end do
    end procedure evaluate_stiffness

    !> Assign columns of the window to the given bodies, in their order; 0 is the ground.
    subroutine open_window(self, bodies)
        class(mechanism_type), intent(inout) :: self
        integer, intent(in) :: bodies(:)
        integer :: k, n

        n = 0
        do k = 1, size(bodies)
            if (bodies(k) == 0) cycle
            associate (pose => self%at%pose(bodies(k)))
                pose%place = n + 1
                n = n + pose%n_place
                if (pose%n_turn > 0) pose%turn = n + 1
                n = n + pose%n_turn
            end associate
        end do
        self%window%dynamics_q(:n, :n) = 0.0_wp
        self%window%dynamics_qd(:n, :n) = 0.0_wp
    end subroutine open_window

    !> Add the window to the blocks of the bodies, and restore the columns of their poses.
    subroutine close_window(self, bodies, stiffness)
        class(mechanism_type), intent(inout) :: self
        integer, intent(in) :: bodies(:)
        type(stiffness_type), intent(inout) :: stiffness
        integer :: k

        call stiffness%add(pack(bodies, bodies > 0), self%window%dynamics_q, self%window%dynamics_qd)
        do k = 1, size(bodies)
            if (bodies(k) == 0) cycle
            associate (pose => self%at%pose(bodies(k)))
                pose%place = stiffness%first(bodies(k))
                if (pose%n_turn > 0) pose%turn = pose%place + pose%n_place
            end associate
        end do
    end subroutine close_window
end submodule tandem_mechanism_stiffness
