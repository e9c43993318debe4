! SPDX-License-Identifier: MIT
!> Normal force of a joint with friction from its reaction: N = |(w_i lambda_i)|, with the weight 1 for a multiplier that is a force
!> and 1/arm for one that is a torque, if torques count. Rows of joints use unit axes and perpendicular directions, so that
!> multipliers are forces (N) and torques (N m) in the frame of the joint at any position.
module tandem_mechanism_normal_force
    use tandem_kinds, only: wp
    implicit none (type, external)
    private

    public :: normal_force_type, most_pressing, normal_force

    !> Largest number of rows of a joint: six freedoms, and the row of a screw.
    integer, parameter :: most_pressing = 7

    type :: normal_force_type
        !> Number of rows, 0 for a given normal force; rows of C, and their weights (1, 1/m).
        integer :: n = 0
        integer :: rows(most_pressing) = 0
        real(wp) :: weights(most_pressing) = 0.0_wp
    end type normal_force_type

contains

    !> Normal force N (N).
    pure real(wp) function normal_force(reaction, lambda) result(normal)
        type(normal_force_type), intent(in) :: reaction
        real(wp), intent(in) :: lambda(:)
        integer :: i

        normal = 0.0_wp
        do i = 1, reaction%n
            normal = normal + (reaction%weights(i)*lambda(reaction%rows(i)))**2
        end do
        normal = sqrt(normal)
    end function normal_force
end module tandem_mechanism_normal_force
