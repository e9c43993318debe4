! SPDX-License-Identifier: MIT
!> Elimination methods of the index-1 equations.
module tandem_bench_elimination
    use tandem, only: wp
    implicit none (type, external)
    private

    public :: by_lu, by_sweeps, by_lapack, kernel_name, dgesv

    !> LU with partial pivoting, written out; the same pivots, but every column is eliminated above and below, with the search for
    !> the pivot, the rows and the columns in whole vectors; LAPACK.
    integer, parameter :: by_lu = 1, by_sweeps = 2, by_lapack = 3
    !> Names of the methods.
    character(len=16), parameter :: kernel_name(3) = [character(len=16) :: 'index-1 LU', 'index-1 sweeps', 'index-1 LAPACK']

    interface
        !> Solve A X = B by LU with partial pivoting (LAPACK).
        subroutine dgesv(n, nrhs, a, lda, ipiv, b, ldb, info)
            import :: wp
            implicit none (type, external)
            integer, intent(in) :: n, nrhs, lda, ldb
            real(wp), intent(inout) :: a(lda, *), b(ldb, *)
            integer, intent(out) :: ipiv(*), info
        end subroutine dgesv
    end interface
end module tandem_bench_elimination
