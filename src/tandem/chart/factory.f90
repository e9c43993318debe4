! SPDX-License-Identifier: MIT
!> The kind of chart for a model; `chart_policies` name the conditions of its renewal.
module tandem_chart_factory
    use tandem_chart, only: chart_type
    use tandem_chart_cost, only: cost_type
    use tandem_model, only: model_type
    use tandem_options, only: chart_kinds, options_type
    implicit none (type, external)
    private

    public :: choose_chart, cost_type, is_sparse_chart, new_chart

    ! Only the submodule uses the modules of the charts, so that a change in one of them recompiles few files.
    interface
        !> Choose the kind of chart: on request, or by the estimated cost of a step.
        module subroutine choose_chart(model, options, implicit, is_sparse, cost)
            implicit none (type, external)
            class(model_type), intent(in) :: model
            !> Checked.
            type(options_type), intent(in) :: options
            !> True for an implicit stepper.
            logical, intent(in) :: implicit
            logical, intent(out) :: is_sparse
            !> Zero if it was not needed.
            type(cost_type), intent(out) :: cost
        end subroutine choose_chart

        !> True for a sparse chart.
        pure module logical function is_sparse_chart(chart)
            implicit none (type, external)
            class(chart_type), intent(in) :: chart
        end function is_sparse_chart

        !> Allocate a chart that is to be initialised.
        module subroutine new_chart(is_sparse, chart)
            implicit none (type, external)
            logical, intent(in) :: is_sparse
            class(chart_type), allocatable, intent(out) :: chart
        end subroutine new_chart
    end interface
end module tandem_chart_factory
