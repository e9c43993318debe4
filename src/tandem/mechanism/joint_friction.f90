! SPDX-License-Identifier: MIT
!> Joint friction in the form that charts use: the generalised force of each friction for a normal force of 1 N, and the normal
!> forces for given multipliers.
submodule(tandem_mechanism) tandem_mechanism_joint_friction
    use tandem_mechanism_elements_torsion, only: torsion_kind_type
    implicit none (type, external)

contains

    module procedure list_frictions
        integer :: k

        k = self%kind_number('torsion')
        select type (torsions => self%kinds(k)%of)
        type is (torsion_kind_type)
            self%n_frictions = torsions%n_frictions()
        end select
    end procedure list_frictions

    !> Matrix B, whose columns are the generalised friction forces for normal forces of 1 N.
    module procedure friction_directions
        integer :: i, k

        stat = 0
        value = 0.0_wp
        ! Set only the poses and select the smooth piece of each force law; evaluate no terms.
        call self%evaluate(0, t, q, qd, self%at_row, stat)
        do i = 1, size(self%bodies)
            call set_rates(self%at%pose(i), qd)
        end do
        k = self%kind_number('torsion')
        select type (torsions => self%kinds(k)%of)
        type is (torsion_kind_type)
            call torsions%add_friction_directions(self%at, value)
        end select
    end procedure friction_directions

    !> Normal forces p and their gradients with respect to the multipliers.
    module procedure normal_forces
        integer :: k

        gradient = 0.0_wp
        k = self%kind_number('torsion')
        select type (torsions => self%kinds(k)%of)
        type is (torsion_kind_type)
            call torsions%set_normal_forces(lambda, value, gradient)
        end select
    end procedure normal_forces
end submodule tandem_mechanism_joint_friction
