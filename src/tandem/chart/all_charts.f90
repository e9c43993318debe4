! SPDX-License-Identifier: MIT
!> The list of all charts, and the choice between them.
submodule(tandem_chart_factory) tandem_chart_all
    use tandem_chart_cost, only: estimate_cost
    use tandem_chart_dense, only: dense_chart_type
    use tandem_chart_sparse, only: find_obstacle, sparse_chart_type
    implicit none (type, external)

    !> Smaller models were no faster with sparse charts; larger models always are, for any pattern.
    integer, parameter :: few = 8, very_many = 100

contains

    module procedure choose_chart
        is_sparse = options%chart_kind == 'sparse'
        if (options%chart_kind /= chart_kinds(1) .or. model%n < few) return
        if (find_obstacle(model, options, implicit) /= '') return
        is_sparse = model%n >= very_many
        if (is_sparse) return
        call estimate_cost(model, options, implicit, cost)
        is_sparse = cost%sparse < cost%dense
    end procedure choose_chart

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
