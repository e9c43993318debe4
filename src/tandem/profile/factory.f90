! SPDX-License-Identifier: MIT
!> Creates the chart of a run, with time measurement.
module tandem_profile_factory
    use tandem_chart, only: chart_type
    use tandem_kinds, only: wp
    use tandem_model, only: model_type
    use tandem_options, only: options_type
    use tandem_profile_ledger, only: profile_type
    implicit none (type, external)
    private

    public :: new_profiled_chart

    ! Only the submodule uses the modules of the charts, so that a change in one of them recompiles few files.
    interface
        !> For `initialize` of the simulation.
        module subroutine new_profiled_chart(model, options, t, q, qd, profile, chart)
            implicit none (type, external)
            class(model_type), intent(inout), target :: model
            type(options_type), intent(in) :: options
            !> Start of the run.
            real(wp), intent(in) :: t, q(:), qd(:)
            !> Measured times; must outlive the simulation.
            type(profile_type), intent(in), target :: profile
            class(chart_type), allocatable, intent(out) :: chart
        end subroutine new_profiled_chart
    end interface
end module tandem_profile_factory
