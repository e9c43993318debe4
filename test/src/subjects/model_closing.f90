! SPDX-License-Identifier: MIT
!> A particle whose constraints degenerate in time.
module model_closing
    use model_particle, only: particle_type
    use tandem, only: model_type, wp
    implicit none (type, external)
    private

    public :: closing_type

    !> A free particle whose constraints degenerate in time: row 1 is (1, 0, 0); row 2 is (1, a, 0) or (0, a, 0) with
    !> a = slope (t_bad - t).
    type, extends(particle_type) :: closing_type
        real(wp) :: t_bad = 0.1_wp, slope = 1.0_wp, first = 1.0_wp
    contains
        procedure :: close_in
    end type closing_type

contains

    !> Associate the degenerating rows.
    subroutine close_in(self)
        class(closing_type), intent(inout) :: self

        call self%define(.true.)
        self%name = 'closing'
        self%n_nonholonomic = 2
        self%nonholonomic_name = [character(len=32) :: 'wall', 'door']
        self%nonholonomic_jacobian => closing_rows
        self%constraint_acceleration => closing_gamma
    end subroutine close_in

    subroutine closing_rows(self, t, q, value, stat)
        class(model_type), intent(inout) :: self
        real(wp), intent(in) :: t, q(:)
        real(wp), intent(out) :: value(:, :)
        integer, intent(out) :: stat

        stat = 0
        value = 0.0_wp
        select type (self)
        class is (closing_type)
            value(1, 1) = 1.0_wp
            value(2, 1:2) = [self%first, self%slope*(self%t_bad - t)]
        end select
    end subroutine closing_rows

    subroutine closing_gamma(self, t, q, qd, value, stat)
        class(model_type), intent(inout) :: self
        real(wp), intent(in) :: t, q(:), qd(:)
        real(wp), intent(out) :: value(:)
        integer, intent(out) :: stat

        stat = 0
        value = 0.0_wp
        select type (self)
        class is (closing_type)
            value(2) = -self%slope*qd(2)
        end select
    end subroutine closing_gamma
end module model_closing
