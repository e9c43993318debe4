! SPDX-License-Identifier: MIT
!> Convert small motions of the coordinates to motions of the bodies, for drawing modes.
submodule(tandem_mechanism) tandem_mechanism_body_motion
    use tandem_rigid_euler_parameters, only: e_product
    implicit none (type, external)

contains

    module procedure find_body_motions
        real(wp) :: re(3), im(3)
        integer :: i

        motions = (0.0_wp, 0.0_wp)
        do i = 1, size(self%bodies)
            associate (place => self%first(i), turn => self%first(i) + merge(2, 3, self%planar))
                motions(:turn - place, i) = shape(place:turn - 1)
                if (.not. self%bodies(i)%turns) cycle
                if (self%planar) then
                    motions(6, i) = shape(turn)
                else
                    ! omega = 2 E(p) pd.
                    associate (p => q(turn:turn + 3), dp => shape(turn:turn + 3))
                        re = 2*e_product(p, real(dp, wp))
                        im = 2*e_product(p, aimag(dp))
                        motions(4:, i) = cmplx(re, im, wp)
                    end associate
                end if
            end associate
        end do
    end procedure find_body_motions
end submodule tandem_mechanism_body_motion
