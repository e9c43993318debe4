! SPDX-License-Identifier: MIT
!> Small motions of coordinates as motions of bodies, for who draws modes.
submodule(tandem_mechanism) tandem_mechanism_body_motion
    use tandem_rigid_euler_parameters, only: e_product
    implicit none (type, external)

contains

    module procedure find_body_motions
        real(wp) :: re(3), im(3)
        integer :: i

        motions = (0.0_wp, 0.0_wp)
        do i = 1, size(self%bodies)
            associate (pose => self%pose(i))
                motions(:pose%n_place, i) = shape(pose%place:pose%place + pose%n_place - 1)
                if (pose%n_turn == 1) then
                    motions(6, i) = shape(pose%turn)
                else if (pose%n_turn == 4) then
                    ! omega = 2 E(p) pd.
                    associate (p => q(pose%turn:pose%turn + 3), dp => shape(pose%turn:pose%turn + 3))
                        re = 2*e_product(p, real(dp, wp))
                        im = 2*e_product(p, aimag(dp))
                        motions(4:, i) = cmplx(re, im, wp)
                    end associate
                end if
            end associate
        end do
    end procedure find_body_motions
end submodule tandem_mechanism_body_motion
