! SPDX-License-Identifier: MIT
!> The list of all charts, and the choice between them.
submodule(tandem_chart_factory) tandem_chart_all
    use tandem_chart_dense, only: dense_chart_type
    use tandem_chart_sparse, only: find_obstacle, sparse_chart_type
    implicit none (type, external)

    !> From so many coordinates on no scene was slower with a sparse chart and explicit steps, of fixed length and under error
    !> control: doc/sparse.md has the tables.
    integer, parameter :: crossover = 27, crossover_of_control = 40
    !> With implicit ones some are slower up to here: dense charts follow what is stiff. And from here on redundant rows are left to
    !> sparse charts, which give them no multipliers.
    integer, parameter :: many = 60

contains

    module procedure wants_sparse
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
    end procedure wants_sparse

    module procedure keeps_dependent_rows
        keeps_dependent_rows = options%chart_kind == chart_kinds(1) .and. model%n < many
    end procedure keeps_dependent_rows

    module procedure is_sparse_chart
        is_sparse_chart = .false.
        select type (chart)
        class is (sparse_chart_type)
            is_sparse_chart = .true.
        end select
    end procedure is_sparse_chart

    module procedure new_chart
        if (is_sparse) then
            allocate (sparse_chart_type :: chart)
        else
            allocate (dense_chart_type :: chart)
        end if
    end procedure new_chart
end submodule tandem_chart_all
