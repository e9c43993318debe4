! SPDX-License-Identifier: MIT
!> The list of all charts, and the choice between them.
submodule(tandem_chart_factory) tandem_chart_all
    use tandem_chart_cost, only: estimate_cost, stiffness_of
    use tandem_chart_dense, only: dense_chart_type
    use tandem_chart_sparse, only: find_obstacle, sparse_chart_type
    implicit none (type, external)

    !> Smaller models were no faster with sparse charts; larger models always are, for any pattern.
    integer, parameter :: few = 8, very_many = 100
    !> Implicit steps of models with at least this number of coordinates use sparse charts, stiff or not.
    integer, parameter :: many = 60
    !> With redundant rows a sparse chart is used up to this cost of a step, relative to the dense one: for explicit steps, whose
    !> dense charts then need a basis at every step, and for implicit ones.
    real(wp), parameter :: most_explicit = 2.0_wp, most_implicit = 1.1_wp
    !> With forces that oscillate or decay faster than the mechanism moves by this factor, corrections of stages that damp contract
    !> more slowly on sparse charts.
    real(wp), parameter :: very_stiff = 500.0_wp

contains

    module procedure choose_chart
        real(wp) :: stiffness

        is_sparse = options%chart_kind == 'sparse'
        if (options%chart_kind /= chart_kinds(1) .or. model%n < few) return
        if (find_obstacle(model, options, implicit) /= '') return
        is_sparse = model%n >= very_many
        if (is_sparse) return
        call estimate_cost(model, implicit, cost)
        is_sparse = cost%sparse < cost%dense
        if (.not. is_sparse .or. model%n >= many .or. .not. model%derives_by_bodies) return
        if (.not. (implicit .or. options%stepper == 'auto')) return
        call stiffness_of(model, t, q, qd, stiffness)
        is_sparse = stiffness < largest_stiffness(options)
    end procedure choose_chart

    !> Stiffness from which dense charts save corrections or steps. With stages of order 1 steps below a tolerance are limited by
    !> the errors of stiff components on either chart, and a method that does not damp resolves them.
    pure real(wp) function largest_stiffness(options)
        type(options_type), intent(in) :: options
        !> The governor, with 960, saves steps of `sdirk54` at `rtol` = 1e-3, not at 1e-5.
        real(wp), parameter :: least_product = 15.0_wp

        largest_stiffness = very_stiff
        if (options%stepper == 'trapezoid') largest_stiffness = huge(1.0_wp)
        if (options%stepper == 'sdirk54' .and. options%is_adaptive()) then
            largest_stiffness = max(very_stiff, least_product/sqrt(options%rtol))
        end if
    end function largest_stiffness

    module procedure suits_redundancy
        suits_redundancy = .false.
        if (options%chart_kind /= chart_kinds(1)) return
        ! Such a model is very stiff.
        if (cost%sparse < cost%dense) return
        if (find_obstacle(model, options, implicit) /= '') return
        if (.not. cost%sparse > 0.0_wp) call estimate_cost(model, implicit, cost)
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
