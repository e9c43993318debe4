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
    !> Implicit steps may need more corrections on sparse charts, which must therefore be cheaper by this factor.
    real(wp), parameter :: gain = 0.85_wp
    !> Forces that oscillate or decay faster than the mechanism moves by this factor make sparse charts take more implicit steps.
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
        is_sparse = cost%sparse < merge(gain, 1.0_wp, implicit)*cost%dense
        if (.not. is_sparse .or. model%n >= many .or. .not. model%derives_by_bodies) return
        if (.not. (implicit .or. options%stepper == 'auto')) return
        call stiffness_of(model, t, q, qd, stiffness)
        is_sparse = stiffness < very_stiff
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
