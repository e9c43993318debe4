! SPDX-License-Identifier: MIT
!> The cost of a step on dense and on sparse charts, estimated before the first one. It follows from the pattern of C and M alone,
!> so that the choice of a chart does not depend on the machine or its load.
!>
!> A dense chart eliminates m rows of n columns and forms D'M D with the n - m columns of D; a sparse chart processes the entries
!> of C, body by body, and the blocks of its factor. Evaluations of the model take the same time on both. The weights are therefore
!> fitted to the difference of both times, in runs without redundant rows of random mechanisms, of shipped scenes and of other
!> mechanisms with 6 to 98 coordinates: of `dop853` and `dopri5` for explicit steps, of `radau5` and `sdirk54` for implicit ones
!> (doc/sparse.md; `bench/random_mechanisms.py --seed 7 --count 130`).
module tandem_chart_cost
    use tandem_chart_sparse_analysis, only: analysis_type
    use tandem_chart_sparse_newton_analysis, only: newton_analysis_type
    use tandem_error, only: error_type
    use tandem_kinds, only: wp
    use tandem_model, only: model_type
    use tandem_model_counts, only: counts_type
    use tandem_model_evaluator, only: evaluator_type
    use tandem_model_segment, only: find_segment
    use tandem_model_stiffness, only: stiffness_type
    use tandem_model_terms, only: need_mass
    implicit none (type, external)
    private

    public :: cost_type, estimate_cost, stiffness_of

    !> Microseconds of a step on the machine of the fit; zero if no choice was to be made. Only the ratio of both is meaningful.
    type :: cost_type
        real(wp) :: dense = 0.0_wp, sparse = 0.0_wp
    end type cost_type

contains

    !> The cost of a step by either chart, for a model with a pattern.
    subroutine estimate_cost(model, implicit, cost)
        class(model_type), intent(in) :: model
        !> True for implicit steps; the model then lists the bodies that share forces.
        logical, intent(in) :: implicit
        type(cost_type), intent(out) :: cost
        type(analysis_type) :: analysis
        type(newton_analysis_type) :: newton
        type(stiffness_type) :: stiffness
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
                cost%dense = 12.2_wp + 0.813_wp*n + 0.122_wp*n*m + 1.03e-3_wp*m**2*n + 6.9e-4_wp*free*n**2
                cost%sparse = 13.2_wp + 5.86_wp*bodies + 0.298_wp*entries + 0.0324_wp*real(newton%block%n_entries, wp)
            else
                cost%dense = 16.4_wp + 0.196_wp*n + 0.0675_wp*n*m + 9.3e-4_wp*m**2*n + 1.23e-3_wp*free*n**2
                cost%sparse = 11.7_wp + 1.23_wp*bodies + 0.168_wp*entries + 1.31_wp*neighbours
            end if
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

    !> The rate of the fastest oscillation that the forces on one body alone cause at (t, q, qd), times the time scale of the model:
    !> the root of the largest entry of the diagonals of K over M. Zero if it is not evaluable.
    subroutine stiffness_of(model, t, q, qd, ratio)
        class(model_type), intent(inout), target :: model
        real(wp), intent(in) :: t, q(:), qd(:)
        real(wp), intent(out) :: ratio
        !> Coordinates with less than this part of their body's largest entry of M move with others; entries are compared on the
        !> scales of the coordinates.
        real(wp), parameter :: least_mass = 1.0e-3_wp
        type(stiffness_type) :: stiffness
        type(evaluator_type) :: evaluator
        type(counts_type) :: counts
        type(error_type), allocatable :: error
        real(wp), allocatable :: zero(:), lambda(:)
        real(wp) :: scale(model%n), heaviest
        integer :: b, i, k, stat, width

        ratio = 0.0_wp
        ! As at the start of the run, independent of earlier uses of the model.
        call find_segment(model, t, error)
        if (allocated(error)) return
        call model%set_time_scale(t, q, qd)
        scale = model%scales()
        allocate (zero(model%n), lambda(model%n_constraints()), source=0.0_wp)
        call build_stiffness(model, stiffness)
        call model%evaluate_stiffness(t, q, qd, zero, lambda, stiffness, stat)
        if (stat /= 0) return
        call evaluator%initialize(model, wants_jacobian=.false.)
        call evaluator%evaluate(need_mass, t, q, qd, counts, stat)
        if (stat /= 0) return
        associate (mass => evaluator%terms%mass, first => stiffness%first)
            do b = 1, size(first) - 1
                width = first(b + 1) - first(b)
                heaviest = 0.0_wp
                do i = first(b), first(b + 1) - 1
                    heaviest = max(heaviest, mass(i, i)*scale(i)**2)
                end do
                do k = stiffness%start(b), stiffness%start(b + 1) - 1
                    if (stiffness%partner(k) /= b) cycle
                    do i = 1, width
                        associate (j => first(b) + i - 1)
                            if (.not. mass(j, j)*scale(j)**2 > least_mass*heaviest) cycle
                            ratio = max(ratio, abs(stiffness%by_q(stiffness%offset(k) + (i - 1)*width + i))/mass(j, j))
                        end associate
                    end do
                end do
            end do
        end associate
        ratio = sqrt(ratio)*model%time_scale
    end subroutine stiffness_of
end module tandem_chart_cost
