! SPDX-License-Identifier: MIT
!> The kind of chart that a model gets; `chart_policies` name when it is renewed.
module tandem_chart_factory
    use tandem_chart, only: chart_type
    use tandem_model, only: model_type
    use tandem_options, only: chart_kinds, options_type
    implicit none (type, external)
    private

    public :: is_sparse_chart, keeps_dependent_rows, new_chart, wants_sparse

    ! The submodule alone uses the modules of the charts, so that a change in one of them recompiles few files.
    interface
        !> True for a model that gets a sparse chart: on request, or since it can have one that is faster.
        module logical function wants_sparse(model, options, implicit)
            implicit none (type, external)
            !> Checked.
            class(model_type), intent(in) :: model
            type(options_type), intent(in) :: options
            !> True for an implicit stepper.
            logical, intent(in) :: implicit
        end function wants_sparse

        !> True for a model whose redundant rows call for a dense chart, which gives multipliers of least norm, in place of the
        !> sparse one that the program chose.
        pure module logical function keeps_dependent_rows(model, options)
            implicit none (type, external)
            class(model_type), intent(in) :: model
            !> Checked.
            type(options_type), intent(in) :: options
        end function keeps_dependent_rows

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
