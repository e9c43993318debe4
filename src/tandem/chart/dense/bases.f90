! SPDX-License-Identifier: MIT
!> The bases of a dense chart that moves in their coordinates.
module tandem_chart_dense_bases
    use tandem_kinds, only: wp
    implicit none (type, external)
    private

    public :: bases_type

    !> diag(s) X (n, m), diag(s) V (n, n - nh), diag(s) W (n, n - m), and the duals of V and W, which give coordinates: only if
    !> bases are kept.
    type :: bases_type
        real(wp), allocatable :: x(:, :), v(:, :), w(:, :), v_dual(:, :), w_dual(:, :)
    end type bases_type
end module tandem_chart_dense_bases
