! SPDX-License-Identifier: MIT
!> Measures of C along a step: its independence and its turn, and the distance from the chart's origin.
module tandem_chart_measure
    use tandem_kinds, only: wp
    implicit none (type, external)
    private

    public :: measure_type, need_change, need_contraction, need_independence, need_line, need_policy, need_rank, &
        least_bend

    !> Groups of measures: independence at the end of a step; loss of C on the straight line between the two points; change of C;
    !> contraction of corrections; distance from the origin for the policy; independence of the rows of C at the second point, which
    !> may be singular.
    integer, parameter :: need_rank = 1, need_line = 2, need_change = 4, need_contraction = 8, need_policy = 16, &
        need_independence = 32

    !> Corrections below this part of the natural scale of every row are too small to measure a contraction.
    real(wp), parameter :: least_bend = 2.0e-4_wp

    type :: measure_type
        !> `need_rank`: number of steps like the last one until C loses rank, extrapolated from its smallest singular value. Huge if
        !> that does not fall, 0 if redundant rows have become independent.
        real(wp) :: room = huge(1.0_wp)
        !> `need_rank`: remaining part of the independence, and of the conditioning of massless coordinates; 1 if not measured.
        real(wp) :: fallen = 1.0_wp, loosened = 1.0_wp
        !> `need_rank`: true if the independence was much smaller within the step than at its ends.
        logical :: dips = .false.
        !> `need_change`: change of C from the start of the step, rows of unit length, Frobenius norm.
        real(wp) :: change = 0.0_wp
        !> `need_contraction`, for charts with a reach: the part of the correction of the displacement back to the manifold that
        !> Newton's iteration with C of the start leaves at the end. 0 if C has not changed, and for small corrections; 1 if the
        !> iteration stagnates.
        real(wp) :: contraction = 0.0_wp
        !> `need_policy`: |v|_2 and |w|_2 in scaled coordinates; |D|_2 and |Fbar|_2, 1 at the origin, then the secants of the angles
        !> between the tangent spaces; condition number of (38) or (81); most corrections of an iteration for u, B or H since the
        !> last call.
        real(wp) :: v = 0.0_wp, w = 0.0_wp, d = 1.0_wp, fbar = 1.0_wp, condition = 1.0_wp
        integer :: corrections = 0
        !> `need_independence`: the smallest singular value of the unit rows, or a measure that vanishes with it in proportion.
        real(wp) :: independence = 1.0_wp
    end type measure_type
end module tandem_chart_measure
