! SPDX-License-Identifier: MIT
!> The list of all charts, and the choice between them.
submodule(tandem_chart_factory) tandem_chart_all
    use tandem_chart_cost, only: estimate_cost
    use tandem_chart_dense, only: dense_chart_type
    use tandem_chart_sparse, only: find_obstacle, sparse_chart_type
    use tandem_kinds, only: wp
    implicit none (type, external)

    !> Smaller models were no faster with sparse charts; larger models always are, for any pattern.
    integer, parameter :: few = 8, very_many = 100
    !> With redundant rows a sparse chart is used up to this cost of a step, relative to the dense one: for explicit steps, whose
    !> dense charts then need a basis at every step, and for implicit ones.
    real(wp), parameter :: most_explicit = 2.0_wp, most_implicit = 1.1_wp

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

    module procedure suits_redundancy
        suits_redundancy = .false.
        if (options%chart_kind /= chart_kinds(1)) return
        if (find_obstacle(model, options, implicit) /= '') return
        if (.not. cost%sparse > 0.0_wp) call estimate_cost(model, options, implicit, cost)
        suits_redundancy = cost%sparse < merge(most_implicit, most_explicit, implicit)*cost%dense
    end procedure suits_redundancy

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
