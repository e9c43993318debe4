! SPDX-License-Identifier: MIT
!> The cost of a step on dense and on sparse charts, estimated before the first one. It follows from the pattern of C and M alone,
!> so that the choice of a chart does not depend on the machine or its load.
!>
!> A dense chart eliminates m rows of n columns and forms D'M D with the n - m columns of D; a sparse chart processes the entries
!> of C, body by body, and the blocks of its factor. Evaluations of the model take the same time on both. The weights are fitted to
!> the ratios of both times in runs of random mechanisms with 8 to 98 coordinates: of `dop853`, `dopri5` and `auto` for explicit
!> steps, of `radau5` and `sdirk54` for implicit ones (doc/sparse.md; `bench/random_mechanisms.py --count 300 --rounds 1`).
module tandem_chart_cost
    use tandem_chart_sparse_analysis, only: analysis_type
    use tandem_chart_sparse_newton_analysis, only: newton_analysis_type
    use tandem_kinds, only: wp
    use tandem_model, only: model_type
    use tandem_model_stiffness, only: stiffness_type
    use tandem_options, only: options_type
    implicit none (type, external)
    private

    public :: cost_type, estimate_cost

    !> Microseconds of a step on the machine of the fit; zero if no choice was to be made. Only the ratio of both is meaningful.
    type :: cost_type
        real(wp) :: dense = 0.0_wp, sparse = 0.0_wp
    end type cost_type

contains

    !> The cost of a step by either chart, for a model with a pattern.
    subroutine estimate_cost(model, options, implicit, cost)
        class(model_type), intent(in) :: model
        type(options_type), intent(in) :: options
        !> True for implicit steps; the model then lists the bodies that share forces.
        logical, intent(in) :: implicit
        type(cost_type), intent(out) :: cost
        type(analysis_type) :: analysis
        type(newton_analysis_type) :: newton
        type(stiffness_type) :: stiffness
        !> Range of tolerances on which costs may depend.
        real(wp), parameter :: tightest = 1.0e-12_wp, loosest = 1.0e-2_wp
        real(wp) :: n, m, free
        integer :: i

        n = real(model%n, wp)
        m = real(min(model%n_constraints(), model%n), wp)
        free = n - m
        call analysis%analyse(model%pattern, [(i, i=1, model%n_constraints())])
        associate (bodies => real(analysis%n_bodies, wp), entries => real(analysis%n_entries, wp), &
            neighbours => real(size(analysis%behind, 2), wp))
            if (implicit) then
                call build_stiffness(model, stiffness)
                call newton%analyse_newton(analysis, stiffness)
                cost%dense = 17.1_wp + 0.211_wp*n + 0.153_wp*n*m + 1.39e-3_wp*free*n**2
                cost%sparse = 15.9_wp + 5.31_wp*bodies + 0.221_wp*entries + 0.0191_wp*real(newton%block%n_entries, wp)
                ! The stages of `sdirk54`, of order 1, take more corrections on sparse charts the longer the steps are.
                if (options%stepper == 'sdirk54' .and. options%is_adaptive()) cost%sparse = cost%sparse* &
                    (min(max(options%relative_tolerance(), tightest), loosest)/1.0e-6_wp)**0.026_wp
            else
                cost%dense = 6.58_wp + 0.699_wp*n + 2.2e-3_wp*m**2*n + 2.0e-4_wp*free*n**2
                cost%sparse = 8.69_wp + 0.652_wp*bodies + 0.094_wp*entries + 0.343_wp*neighbours
            end if
            ! Rows at velocity level need a factor of their own. The mechanisms of the fit have none.
            if (model%n_nonholonomic > 0) cost%sparse = 1.2_wp*cost%sparse
        end associate
    end subroutine estimate_cost

    !> The blocks of K for the pairs of bodies that share forces.
    subroutine build_stiffness(model, stiffness)
        class(model_type), intent(in) :: model
        type(stiffness_type), intent(inout) :: stiffness
        integer, allocatable :: pairs(:, :)

        allocate (pairs(2, 0))
        if (allocated(model%pattern%coupled)) pairs = model%pattern%coupled
        call stiffness%build(model%pattern%first, pairs)
    end subroutine build_stiffness
end module tandem_chart_cost
