! SPDX-License-Identifier: MIT
!> Which kind of chart a model gets. When a chart is renewed is another matter, see `chart_policies`.
module tandem_chart_factory
    use tandem_chart, only: chart_type
    use tandem_chart_dense, only: dense_chart_type
    use tandem_chart_sparse, only: find_obstacle, sparse_chart_type
    use tandem_model, only: model_type
    use tandem_options, only: chart_kinds, options_type
    implicit none (type, external)
    private

    public :: is_sparse_chart, keeps_dependent_rows, new_chart, wants_sparse

    !> From so many coordinates on no scene was slower with a sparse chart and explicit steps, of fixed length and under error
    !> control: doc/sparse.md has the tables.
    integer, parameter :: crossover = 27, crossover_of_control = 40
    !> With implicit ones some are slower up to here: dense charts follow what is stiff. And from here on redundant rows are left to
    !> sparse charts, which give them no multipliers.
    integer, parameter :: many = 60

contains

    !> Whether a model is to get a sparse chart: where it is asked for, or where it can have one that will be faster.
    logical function wants_sparse(model, options, implicit)
        !> Checked.
        class(model_type), intent(in) :: model
        type(options_type), intent(in) :: options
        !> Whether the stepper is implicit.
        logical, intent(in) :: implicit

        integer :: least

        if (options%chart_kind == chart_kinds(1)) then
            least = crossover
            if (options%is_adaptive()) least = crossover_of_control
            if (implicit .or. options%stepper == 'auto') least = many
            wants_sparse = .false.
            if (model%n >= least) wants_sparse = find_obstacle(model, options, implicit) == ''
        else
            wants_sparse = options%chart_kind == 'sparse'
        end if
    end function wants_sparse

    !> Whether a model with redundant rows is to go from the sparse chart that the program chose to a dense one, whose multipliers
    !> are those of least norm.
    pure logical function keeps_dependent_rows(model, options)
        class(model_type), intent(in) :: model
        !> Checked.
        type(options_type), intent(in) :: options

        keeps_dependent_rows = options%chart_kind == chart_kinds(1) .and. model%n < many
    end function keeps_dependent_rows

    !> Whether a chart is sparse.
    pure logical function is_sparse_chart(chart)
        class(chart_type), intent(in) :: chart

        is_sparse_chart = .false.
        select type (chart)
        class is (sparse_chart_type)
            is_sparse_chart = .true.
        end select
    end function is_sparse_chart

    !> A chart that knows nothing yet.
    subroutine new_chart(is_sparse, chart)
        logical, intent(in) :: is_sparse
        class(chart_type), allocatable, intent(out) :: chart

        if (is_sparse) then
            allocate (sparse_chart_type :: chart)
        else
            allocate (dense_chart_type :: chart)
        end if
    end subroutine new_chart
end module tandem_chart_factory
