! SPDX-License-Identifier: MIT
!> Purpose of a point that a chart restores. It determines the tolerance and the start of the iterations.
module tandem_chart_goal
    use tandem_kinds, only: wp
    implicit none (type, external)
    private

    public :: goal_type, step_end

    type :: goal_type
        !> True for a stage of an explicit step: its point need only satisfy the tolerance of stages, and rounding errors of the
        !> constraints may remain.
        logical :: is_stage = .false.
        !> True for an iterate of an implicit stage: the next correction moves it. True for the first one, with predicted rates and
        !> coordinates.
        logical :: is_iterate = .false., is_first = .false.
        !> True for the end of an explicit step whose stages were not projected: the last one lies beside it by the error of the
        !> step, and its factor corrects it. Otherwise it is corrected along the complement of the chart's origin.
        logical :: follows_stages = .false.
        !> Number of the stage, 0 for none. Charts store data of a stage under its number until the next step.
        integer :: stage = 0
        !> Size of the step: errors of a stage are nearly equal in successive steps.
        real(wp) :: h = 0.0_wp
        !> The increment misses the second derivative of the motion by this times qdd at the start of the step (explicit stages) or
        !> the stage's own rate (implicit ones): h^2 (c^2/2 - sum a c). Huge if unknown.
        real(wp) :: defect = huge(1.0_wp)
        !> Largest errors of q and qd that the iteration of an implicit stage may leave, for charts that solve by refinement.
        real(wp) :: tolerance = 0.0_wp
    end type goal_type

    !> The end of a step, or any other point that must satisfy the constraints.
    type(goal_type), parameter :: step_end = goal_type()
end module tandem_chart_goal
