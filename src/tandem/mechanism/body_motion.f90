! SPDX-License-Identifier: MIT
!> Convert small motions of the coordinates to motions of the bodies, for drawing modes and for messages.
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

    module procedure describe_motion
        !> Motions below this fraction of the largest are rounding.
        real(wp), parameter :: rounding = 1.0e-6_wp
        complex(wp) :: motions(6, size(self%bodies))
        real(wp) :: m(6, 0:size(self%bodies)), away(size(self%joints))
        integer :: i, body, joint

        call self%find_body_motions(q, cmplx(direction, 0.0_wp, wp), motions)
        m(:, 0) = 0.0_wp
        m(:, 1:) = real(motions, wp)
        m(:3, :) = m(:3, :)/self%size_of_bodies
        if (.not. maxval(abs(m)) > rounding*self%largest_on_scales(direction)) then
            call self%model_type%describe_motion(q, direction, text)
            return
        end if
        body = maxloc(sum(abs(m(:, 1:)), dim=1), dim=1)
        joint = 0
        do i = 1, size(self%joints)
            away(i) = sum(abs(m(:, self%joints(i)%second) - m(:, self%joints(i)%first)))
        end do
        if (size(away) > 0) joint = maxloc(away, dim=1)
        if (joint > 0) then
            if (.not. away(joint) > rounding*sum(abs(m(:, body)))) joint = 0
        end if
        text = ''
        if (joint > 0) then
            associate (j => self%joints(joint))
                body = j%second
                if (sum(abs(m(:, j%first))) > sum(abs(m(:, j%second)))) body = j%first
                text = ' in the joint "'//trim(j%name)//'"'
            end associate
        end if
        text = 'the body "'//trim(self%bodies(body)%name)//'" moves without mass'//text
    end procedure describe_motion
end submodule tandem_mechanism_body_motion
