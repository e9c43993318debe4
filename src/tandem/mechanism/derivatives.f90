! SPDX-License-Identifier: MIT
!> Evaluate the five gradient blocks of a mechanism, element by element.
submodule(tandem_mechanism) tandem_mechanism_derivatives
    implicit none (type, external)

contains

    module procedure add_derivatives
        integer :: i, j, k

        call differentiate_coincidences(self%coincidences, merge(2, 3, self%planar), need, self%at%pose, lambda, derivatives)
        call differentiate_perpendiculars(self%perpendiculars, need, self%at%pose, lambda, derivatives)
        call differentiate_distances(self%distances, need, self%at%pose, lambda, derivatives)
        do k = 1, size(self%row_kinds)
            associate (kind => self%kinds(self%row_kinds(k))%of)
                call kind%differentiate(1, kind%n, need, self%at, lambda, derivatives)
            end associate
        end do
        call differentiate_knife_edges(self%knife_edges, need, self%at%pose, self%at%f, lambda, derivatives)
        call differentiate_rollers(self%rollers, need, self%at%pose, self%at%f, lambda, derivatives)
        call differentiate_massless_wheels(self%massless_wheels, need, self%at%pose, self%at%f, lambda, derivatives)
        call differentiate_velocity_joints(self%velocity_joints, need, self%at%pose, lambda, derivatives)
        call differentiate_rate_rows(self%rate_rows, need, t, self%at%pose, lambda, self%at%formulas, self%at%coordinates, &
            derivatives)
        do i = 1, size(self%turning)
            k = self%before_norms + i
            ! Coordinates of a body have columns that follow each other.
            associate (p => self%at%pose(self%turning(i))%p, turn => self%at%pose(self%turning(i))%turn, &
                column => derivatives%column_of(self%at%pose(self%turning(i))%turn))
                if (iand(need, need_velocity_q) /= 0) derivatives%velocity_q(k, column:column + 3) = p(:, 1)
                if (iand(need, need_acceleration_q) /= 0) derivatives%acceleration_q(k, column:column + 3) = p(:, 2)
                if (iand(need, need_acceleration_qd) /= 0) derivatives%acceleration_qd(k, column:column + 3) = 2*p(:, 1)
                if (iand(need, need_dynamics_q) /= 0) then
                    do j = 0, 3
                        derivatives%dynamics_q(turn + j, column + j) = derivatives%dynamics_q(turn + j, column + j) + lambda(k)
                    end do
                end if
            end associate
        end do
        if (iand(need, need_dynamics_q + need_dynamics_qd) == 0) return
        do i = 1, size(self%turning)
            call differentiate_inertia(self%bodies(self%turning(i)), self%at%pose(self%turning(i)), need, derivatives)
        end do
        do k = 1, size(self%force_kinds)
            associate (kind => self%kinds(self%force_kinds(k))%of)
                call kind%differentiate(1, kind%n, need, self%at, lambda, derivatives)
            end associate
        end do
    end procedure add_derivatives
end submodule tandem_mechanism_derivatives
