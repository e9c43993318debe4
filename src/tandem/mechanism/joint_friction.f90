! SPDX-License-Identifier: MIT
!> Joint friction in the form that charts use: the generalised force of each friction for a normal force of 1 N, and the normal
!> forces for given multipliers.
submodule(tandem_mechanism) tandem_mechanism_joint_friction
    use tandem_mechanism_normal_force, only: normal_force
    implicit none (type, external)

contains

    module procedure list_frictions
        integer :: i

        do i = 1, size(self%torsions)
            associate (rows => self%torsions(i)%reaction%rows)
                ! Velocity-level rows are numbered after all holonomic rows.
                where (rows < 0) rows = self%n_holonomic - rows
            end associate
        end do
        self%n_frictions = count(self%torsions%reaction%n > 0)
    end procedure list_frictions

    !> Matrix B, whose columns are the generalised friction forces for normal forces of 1 N.
    module procedure friction_directions
        integer :: i

        stat = 0
        value = 0.0_wp
        ! Set only the poses and select the smooth piece of each force law; evaluate no terms.
        call self%evaluate(0, t, q, qd, self%at_row, stat)
        do i = 1, size(self%bodies)
            call set_rates(self%at%pose(i), qd)
        end do
        call add_friction_directions(self%torsions, t, self%at%pose, self%at%laws, value)
    end procedure friction_directions

    !> Normal forces p and their gradients with respect to the multipliers.
    module procedure normal_forces
        integer :: i, j, k

        gradient = 0.0_wp
        k = 0
        do i = 1, size(self%torsions)
            associate (reaction => self%torsions(i)%reaction)
                if (reaction%n == 0) cycle
                k = k + 1
                value(k) = normal_force(reaction, lambda)
                if (.not. value(k) > 0.0_wp) cycle
                do j = 1, reaction%n
                    gradient(k, reaction%rows(j)) = reaction%weights(j)**2*lambda(reaction%rows(j))/value(k)
                end do
            end associate
        end do
    end procedure normal_forces
end submodule tandem_mechanism_joint_friction
