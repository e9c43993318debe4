! SPDX-License-Identifier: MIT
!> Choice between sparse and dense factors of a saddle-point system by the predicted number of operations, which depends on the
!> structure alone.
module tandem_saddle_choice
    use tandem_kinds, only: wp
    use tandem_linalg_order, only: list_type, order_nodes
    use tandem_model_neighbours, only: find_neighbours
    use tandem_model_pattern, only: pattern_type
    use tandem_saddle, only: saddle_type
    use tandem_saddle_dense, only: dense_saddle_type
    use tandem_saddle_sparse, only: sparse_saddle_type
    implicit none (type, external)
    private

    public :: allocate_saddle, suits_sparse

contains

    !> True if sparse factors cost less.
    logical function suits_sparse(pattern)
        type(pattern_type), intent(in) :: pattern
        !> Operations on full matrices over n^3, and the time of one with complex numbers and indices over one of these.
        real(wp), parameter :: full = 4.0_wp, slower = 32.0_wp
        type(list_type), allocatable :: neighbours(:)
        real(wp) :: operations

        ! gfortran warns of unset bounds without this.
        allocate (neighbours(0))
        call find_neighbours(pattern, neighbours)
        call count_operations(pattern, neighbours, operations)
        suits_sparse = pattern%n_bodies > 1 .and. slower*operations < full*real(size(pattern%column), wp)**3
    end function suits_sparse

    !> Number of operations with sparse factors.
    subroutine count_operations(pattern, left, cost)
        type(pattern_type), intent(in) :: pattern
        !> Neighbours of each body; afterwards those that were left when it was eliminated.
        type(list_type), intent(inout) :: left(:)
        real(wp), intent(out) :: cost
        type(list_type) :: none(pattern%n_bodies)
        integer :: order(pattern%n_bodies), place(pattern%n_bodies), unknowns(pattern%n_bodies), b, i, k
        real(wp) :: front

        call order_nodes(left, none, order)
        do k = 1, pattern%n_bodies
            place(order(k)) = k
            unknowns(k) = pattern%first(k + 1) - pattern%first(k)
        end do
        ! A row is eliminated with the first of its bodies.
        do i = 1, pattern%n_rows
            associate (bodies => pattern%row_body(pattern%row_start(i):pattern%row_start(i + 1) - 1))
                if (size(bodies) == 0) cycle
                b = bodies(minloc(place(bodies), dim=1))
                unknowns(b) = unknowns(b) + 1
            end associate
        end do
        cost = 0.0_wp
        do b = 1, pattern%n_bodies
            front = unknowns(b)
            if (left(b)%n > 0) front = front + sum(unknowns(left(b)%item(:left(b)%n)))
            cost = cost + unknowns(b)*front**2
        end do
    end subroutine count_operations

    !> Allocate a sparse or a dense system, which is then to be analysed.
    subroutine allocate_saddle(is_sparse, saddle)
        logical, intent(in) :: is_sparse
        class(saddle_type), allocatable, intent(out) :: saddle

        if (is_sparse) then
            allocate (sparse_saddle_type :: saddle)
        else
            allocate (dense_saddle_type :: saddle)
        end if
    end subroutine allocate_saddle
end module tandem_saddle_choice
