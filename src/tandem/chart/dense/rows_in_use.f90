! SPDX-License-Identifier: MIT
!> The rows of C that a chart uses after redundant rows were dropped: results of differences for all rows of the model are copied to
!> the rows in use, and dropped rows carry no load.
module tandem_chart_dense_rows_in_use
    use tandem_kinds, only: wp
    use tandem_model_counts, only: counts_type
    use tandem_model_derivatives, only: derivatives_type
    use tandem_model_differences, only: differences_type
    use tandem_model_evaluator, only: evaluator_type
    implicit none (type, external)
    private

    public :: rows_in_use_type

    type :: rows_in_use_type
        !> The numbers of the dropped rows in the model; unallocated if all are in use.
        integer, allocatable :: dropped(:)
        !> The derivatives and the multipliers of all rows.
        type(derivatives_type) :: derivatives
        real(wp), allocatable :: lambda(:)
        !> gamma of all rows.
        real(wp), allocatable, private :: gamma(:)
    contains
        procedure :: choose, evaluate_gamma, expand, take
    end type rows_in_use_type

contains

    !> Use some rows of a model's.
    subroutine choose(self, n, m, kept, wants_derivatives)
        class(rows_in_use_type), intent(inout) :: self
        !> Coordinates, and rows of the model.
        integer, intent(in) :: n, m
        !> The rows to use, ascending.
        integer, intent(in) :: kept(:)
        logical, intent(in) :: wants_derivatives
        integer :: i

        self%dropped = pack([(i, i=1, m)], [(all(kept /= i), i=1, m)])
        self%gamma = spread(0.0_wp, 1, m)
        self%lambda = self%gamma
        if (wants_derivatives) call self%derivatives%allocate(n, m)
    end subroutine choose

    !> gamma by differences.
    subroutine evaluate_gamma(self, differences, model, t, q, qd, counts, stat)
        class(rows_in_use_type), intent(inout) :: self
        type(differences_type), intent(inout) :: differences
        type(evaluator_type), intent(inout) :: model
        real(wp), intent(in) :: t
        real(wp), intent(in), contiguous :: q(:), qd(:)
        type(counts_type), intent(inout) :: counts
        integer, intent(out) :: stat

        if (allocated(self%dropped)) then
            call differences%evaluate_gamma(t, q, qd, self%gamma, counts, stat)
            model%all_rows%gamma = self%gamma
            model%terms%gamma = self%gamma(model%kept)
        else
            call differences%evaluate_gamma(t, q, qd, model%terms%gamma, counts, stat)
        end if
    end subroutine evaluate_gamma

    !> The multipliers of all rows from those of the rows in use.
    pure subroutine expand(self, kept, lambda)
        class(rows_in_use_type), intent(inout) :: self
        !> The rows in use, and their multipliers.
        integer, intent(in) :: kept(:)
        real(wp), intent(in) :: lambda(:)

        self%lambda = 0.0_wp
        self%lambda(kept) = lambda
    end subroutine expand

    !> The derivatives of the rows in use from those of all rows.
    pure subroutine take(self, kept, derivatives)
        class(rows_in_use_type), intent(in) :: self
        !> The rows in use.
        integer, intent(in) :: kept(:)
        type(derivatives_type), intent(inout) :: derivatives

        associate (all_rows => self%derivatives)
            derivatives%velocity_q = all_rows%velocity_q(kept, :)
            derivatives%acceleration_q = all_rows%acceleration_q(kept, :)
            derivatives%acceleration_qd = all_rows%acceleration_qd(kept, :)
            derivatives%dynamics_q = all_rows%dynamics_q
            derivatives%dynamics_qd = all_rows%dynamics_qd
        end associate
    end subroutine take
end module tandem_chart_dense_rows_in_use
