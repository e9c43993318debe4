! SPDX-License-Identifier: MIT
!> Implicit steppers. They require a chart that solves stages.
module tandem_stepper_implicit
    use tandem_chart, only: chart_type
    use tandem_chart_implicit, only: implicit_chart_type
    use tandem_kinds, only: wp
    use tandem_status, only: status_invalid_option
    use tandem_stepper, only: stepper_type
    use tandem_stepper_state, only: state_type
    implicit none (type, external)
    private

    public :: implicit_type

    !> Base type of implicit steppers.
    type, abstract, extends(stepper_type) :: implicit_type
    contains
        procedure :: advance, estimate
        procedure(advance_interface), deferred :: advance_stages
        procedure(estimate_interface), deferred :: estimate_stages
    end type implicit_type

    abstract interface
        !> `advance` of `stepper_type`.
        subroutine advance_interface(self, chart, state, h, next, stat)
            import :: implicit_type, implicit_chart_type, state_type, wp
            implicit none (type, external)
            class(implicit_type), intent(inout) :: self
            class(implicit_chart_type), intent(inout) :: chart
            type(state_type), intent(in) :: state
            real(wp), intent(in) :: h
            type(state_type), intent(inout) :: next
            integer, intent(out) :: stat
        end subroutine advance_interface

        !> `estimate` of `stepper_type`.
        subroutine estimate_interface(self, chart, h, weight_q, weight_qd, norm)
            import :: implicit_type, implicit_chart_type, wp
            implicit none (type, external)
            class(implicit_type), intent(inout) :: self
            class(implicit_chart_type), intent(inout) :: chart
            real(wp), intent(in) :: h
            real(wp), intent(in), contiguous :: weight_q(:), weight_qd(:)
            real(wp), intent(out) :: norm
        end subroutine estimate_interface
    end interface

contains

    !> Perform one step.
    subroutine advance(self, chart, state, h, next, stat)
        class(implicit_type), intent(inout) :: self
        class(chart_type), intent(inout) :: chart
        type(state_type), intent(in) :: state
        real(wp), intent(in) :: h
        type(state_type), intent(inout) :: next
        !> `invalid_option` if the chart cannot solve stages.
        integer, intent(out) :: stat

        stat = status_invalid_option
        select type (chart)
        class is (implicit_chart_type)
            call self%advance_stages(chart, state, h, next, stat)
        end select
    end subroutine advance

    !> Error of the last step.
    subroutine estimate(self, chart, h, weight_q, weight_qd, norm)
        class(implicit_type), intent(inout) :: self
        class(chart_type), intent(inout) :: chart
        real(wp), intent(in) :: h
        real(wp), intent(in), contiguous :: weight_q(:), weight_qd(:)
        real(wp), intent(out) :: norm

        norm = 0.0_wp
        select type (chart)
        class is (implicit_chart_type)
            call self%estimate_stages(chart, h, weight_q, weight_qd, norm)
        end select
    end subroutine estimate
end module tandem_stepper_implicit
