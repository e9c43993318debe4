! SPDX-License-Identifier: MIT
!> Pivoted QR of small matrices by Householder reflections, in loops: up to some thirty rows the calls of LAPACK cost several times
!> their arithmetic. Signs, reflectors and their storage are those of LAPACK's dgeqp3 and dorgqr.
!> Source: G. H. Golub, C. F. Van Loan, Matrix Computations, 4th ed., sections 5.1 and 5.4.2.
module tandem_linalg_householder
    use tandem_kinds, only: wp
    implicit none (type, external)
    private

    public :: factor_pivoted, form_columns

contains

    !> Factor A P = Q R. Pivots are chosen within the first `first` columns, then within the others, by the largest remaining
    !> length.
    pure subroutine factor_pivoted(n, m, first, a, tau, order)
        integer, intent(in) :: n, m, first
        !> A on entry; R in the upper triangle, reflectors below it (n, m), m <= n.
        real(wp), intent(inout) :: a(n, m)
        !> Factors of the reflectors (m).
        real(wp), intent(out) :: tau(m)
        !> The column of A in each column of A P (m).
        integer, intent(out) :: order(m)
        real(wp) :: beta, f, largest, length, swap
        integer :: i, j, k, last, p

        do j = 1, m
            order(j) = j
        end do
        do k = 1, m
            last = merge(first, m, k <= first)
            p = k
            largest = -1.0_wp
            do j = k, last
                length = 0.0_wp
                do i = k, n
                    length = length + a(i, j)**2
                end do
                if (.not. length > largest) cycle
                largest = length
                p = j
            end do
            if (p /= k) then
                do i = 1, n
                    swap = a(i, k)
                    a(i, k) = a(i, p)
                    a(i, p) = swap
                end do
                j = order(k)
                order(k) = order(p)
                order(p) = j
            end if
            tau(k) = 0.0_wp
            length = 0.0_wp
            do i = k + 1, n
                length = length + a(i, k)**2
            end do
            if (.not. length > 0.0_wp) cycle
            beta = -sign(sqrt(largest), a(k, k))
            tau(k) = (beta - a(k, k))/beta
            f = 1.0_wp/(a(k, k) - beta)
            do i = k + 1, n
                a(i, k) = a(i, k)*f
            end do
            a(k, k) = beta
            do j = k + 1, m
                call reflect(n - k, a(k + 1:, k), tau(k), a(k, j), a(k + 1:, j))
            end do
        end do
    end subroutine factor_pivoted

    !> The first columns of Q.
    pure subroutine form_columns(n, m, columns, a, tau, q)
        integer, intent(in) :: n, m, columns
        !> The reflectors, as `factor_pivoted` leaves them (n, m), and their factors (m).
        real(wp), intent(in) :: a(n, m), tau(m)
        real(wp), intent(inout) :: q(n, columns)
        integer :: j, k

        q = 0.0_wp
        do j = 1, columns
            q(j, j) = 1.0_wp
        end do
        do k = min(m, columns), 1, -1
            do j = k, columns
                call reflect(n - k, a(k + 1:, k), tau(k), q(k, j), q(k + 1:, j))
            end do
        end do
    end subroutine form_columns

    !> (x1, x) := (I - tau v v') (x1, x), v = (1, v2).
    pure subroutine reflect(n, v2, tau, x1, x)
        integer, intent(in) :: n
        real(wp), intent(in) :: v2(n), tau
        real(wp), intent(inout) :: x1, x(n)
        real(wp) :: f
        integer :: i

        f = x1
        do i = 1, n
            f = f + v2(i)*x(i)
        end do
        f = tau*f
        x1 = x1 - f
        do i = 1, n
            x(i) = x(i) - f*v2(i)
        end do
    end subroutine reflect
end module tandem_linalg_householder
