! SPDX-License-Identifier: MIT
!> Static equilibrium of the motorcycle as a start; the start printed in the paper is not an equilibrium.
submodule(tandem_models_motorcycle) tandem_models_motorcycle_start
    use tandem_linalg_lu, only: lu_type
    implicit none (type, external)

contains

    module procedure start
        type(terms_type) :: terms
        type(lu_type) :: lu
        real(wp) :: pitch, tilt, system(10, 10), pitch_row(4), rear(3, 4)

        q = 0.0_wp
        qd = 0.0_wp
        call find_equilibrium_pitch(self, pitch, stat)
        if (stat /= 0) return
        tilt = self%fork_angle + pitch
        q(3) = self%wheel_radius + self%rear_length*sin(pitch)
        q(4:5) = [cos(pitch/2), sin(pitch/2)]
        q(8:9) = -self%wheel_radius*[sin(tilt), cos(tilt)]
        q(10) = fork_length(self, pitch)
        ! Velocity conditions: C qd = nu, the y velocity of the rear axle's centre, and the pitch rate ux' 2 G(p) pd = 0.
        self%segment = 1
        call terms%allocate(10, 6, 2)
        call self%evaluate(need_jacobian + need_nu, 0.0_wp, q, qd, terms, stat)
        system = 0.0_wp
        system(:8, :) = terms%jacobian
        rear = b_matrix(q(4:7), [0.0_wp, -self%rear_length, 0.0_wp])
        system(9, 2) = 1.0_wp
        system(9, 4:7) = rear(2, :)
        pitch_row = g_transposed_product(q(4:7), ux)
        system(10, 4:7) = 2*pitch_row
        call lu%allocate(10)
        call lu%factor(system, stat)
        if (stat /= 0) return
        qd(:8) = terms%nu
        qd(9) = speed
        call lu%solve(qd)
    end procedure start

    !> Length of the fork if all wheels touch the ground, for a given pitch (m).
    pure real(wp) function fork_length(self, pitch)
        class(motorcycle_type), intent(in) :: self
        real(wp), intent(in) :: pitch

        fork_length = ((self%rear_length + self%fork_forward)*sin(pitch) + self%fork_height*cos(pitch))/ &
            cos(self%fork_angle + pitch)
    end function fork_length

    !> Pitch of static equilibrium: stationary point of m g rz + k (s - sf)^2 / 2, by Newton's iteration.
    subroutine find_equilibrium_pitch(self, pitch, stat)
        class(motorcycle_type), intent(in) :: self
        real(wp), intent(out) :: pitch
        integer, intent(out) :: stat
        integer, parameter :: most_iterations = 50
        real(wp) :: s, s1, s2, change
        integer :: i

        pitch = 0.0_wp
        stat = 0
        associate (l => self%rear_length + self%fork_forward, h => self%fork_height, phi => self%fork_angle)
            do i = 1, most_iterations
                ! First and second derivatives of s cos(phi + pitch) = l sin(pitch) + h cos(pitch).
                s = fork_length(self, pitch)
                s1 = (l*cos(pitch) - h*sin(pitch) + s*sin(phi + pitch))/cos(phi + pitch)
                s2 = (-l*sin(pitch) - h*cos(pitch) + 2*s1*sin(phi + pitch) + s*cos(phi + pitch))/cos(phi + pitch)
                change = -(self%mass*self%gravity*self%rear_length*cos(pitch) + self%stiffness*(s - self%spring_length())*s1)/ &
                    (-self%mass*self%gravity*self%rear_length*sin(pitch) + &
                    self%stiffness*(s1**2 + (s - self%spring_length())*s2))
                pitch = pitch + change
                if (.not. abs(pitch) < 1.0_wp) exit
                if (abs(change) <= 4*epsilon(1.0_wp)) return
            end do
        end associate
        stat = 1
    end subroutine find_equilibrium_pitch
end submodule tandem_models_motorcycle_start
