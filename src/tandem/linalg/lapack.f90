! SPDX-License-Identifier: MIT
!> Explicit interfaces of the routines of LAPACK and BLAS that tandem calls. Only src/tandem/linalg uses this module.
!> Source: Anderson et al., LAPACK Users' Guide, 3rd ed., SIAM 1999.
module tandem_linalg_lapack
    use tandem_kinds, only: wp
    implicit none (type, external)
    public

    interface
        !> QR factorisation with column pivoting, A P = Q R.
        subroutine dgeqp3(m, n, a, lda, jpvt, tau, work, lwork, info)
            import :: wp
            implicit none (type, external)
            integer, intent(in) :: m, n, lda, lwork
            real(wp), intent(inout) :: a(lda, *)
            integer, intent(inout) :: jpvt(*)
            real(wp), intent(out) :: tau(*), work(*)
            integer, intent(out) :: info
        end subroutine dgeqp3

        !> The first n columns of the orthogonal Q of k reflectors.
        subroutine dorgqr(m, n, k, a, lda, tau, work, lwork, info)
            import :: wp
            implicit none (type, external)
            integer, intent(in) :: m, n, k, lda, lwork
            real(wp), intent(inout) :: a(lda, *)
            real(wp), intent(in) :: tau(*)
            real(wp), intent(out) :: work(*)
            integer, intent(out) :: info
        end subroutine dorgqr

        !> C := Q C or Q' C with the Q of a QR factorisation.
        subroutine dormqr(side, trans, m, n, k, a, lda, tau, c, ldc, work, lwork, info)
            import :: wp
            implicit none (type, external)
            character(len=1), intent(in) :: side, trans
            integer, intent(in) :: m, n, k, lda, ldc, lwork
            real(wp), intent(in) :: a(lda, *), tau(*)
            real(wp), intent(inout) :: c(ldc, *)
            real(wp), intent(out) :: work(*)
            integer, intent(out) :: info
        end subroutine dormqr

        !> Singular value decomposition A = U diag(s) V'.
        subroutine dgesvd(jobu, jobvt, m, n, a, lda, s, u, ldu, vt, ldvt, work, lwork, info)
            import :: wp
            implicit none (type, external)
            character(len=1), intent(in) :: jobu, jobvt
            integer, intent(in) :: m, n, lda, ldu, ldvt, lwork
            real(wp), intent(inout) :: a(lda, *)
            real(wp), intent(out) :: s(*), u(ldu, *), vt(ldvt, *), work(*)
            integer, intent(out) :: info
        end subroutine dgesvd

        !> The same by divide and conquer.
        subroutine dgesdd(jobz, m, n, a, lda, s, u, ldu, vt, ldvt, work, lwork, iwork, info)
            import :: wp
            implicit none (type, external)
            character(len=1), intent(in) :: jobz
            integer, intent(in) :: m, n, lda, ldu, ldvt, lwork
            real(wp), intent(inout) :: a(lda, *)
            real(wp), intent(out) :: s(*), u(ldu, *), vt(ldvt, *), work(*)
            integer, intent(out) :: iwork(*), info
        end subroutine dgesdd

        !> Eigenvalues, ascending, and eigenvectors of a symmetric matrix.
        subroutine dsyev(jobz, uplo, n, a, lda, w, work, lwork, info)
            import :: wp
            implicit none (type, external)
            character(len=1), intent(in) :: jobz, uplo
            integer, intent(in) :: n, lda, lwork
            real(wp), intent(inout) :: a(lda, *)
            real(wp), intent(out) :: w(*), work(*)
            integer, intent(out) :: info
        end subroutine dsyev

        !> Eigenvalues, right and left eigenvectors of a square matrix, with condition numbers.
        subroutine dgeevx(balanc, jobvl, jobvr, sense, n, a, lda, wr, wi, vl, ldvl, vr, ldvr, ilo, ihi, scale, abnrm, rconde, &
            rcondv, work, lwork, iwork, info)
            import :: wp
            implicit none (type, external)
            character(len=1), intent(in) :: balanc, jobvl, jobvr, sense
            integer, intent(in) :: n, lda, ldvl, ldvr, lwork
            real(wp), intent(inout) :: a(lda, *)
            real(wp), intent(out) :: wr(*), wi(*), vl(ldvl, *), vr(ldvr, *), scale(*), abnrm, rconde(*), rcondv(*), work(*)
            integer, intent(out) :: ilo, ihi, iwork(*), info
        end subroutine dgeevx

        !> LU factorisation with row pivoting.
        subroutine dgetrf(m, n, a, lda, ipiv, info)
            import :: wp
            implicit none (type, external)
            integer, intent(in) :: m, n, lda
            real(wp), intent(inout) :: a(lda, *)
            integer, intent(out) :: ipiv(*), info
        end subroutine dgetrf

        !> Solution with the factors of `dgetrf`.
        subroutine dgetrs(trans, n, nrhs, a, lda, ipiv, b, ldb, info)
            import :: wp
            implicit none (type, external)
            character(len=1), intent(in) :: trans
            integer, intent(in) :: n, nrhs, lda, ldb
            real(wp), intent(in) :: a(lda, *)
            integer, intent(in) :: ipiv(*)
            real(wp), intent(inout) :: b(ldb, *)
            integer, intent(out) :: info
        end subroutine dgetrs

        !> LU factorisation with row pivoting of a complex matrix.
        subroutine zgetrf(m, n, a, lda, ipiv, info)
            import :: wp
            implicit none (type, external)
            integer, intent(in) :: m, n, lda
            complex(wp), intent(inout) :: a(lda, *)
            integer, intent(out) :: ipiv(*), info
        end subroutine zgetrf

        !> Solution with the factors of zgetrf.
        subroutine zgetrs(trans, n, nrhs, a, lda, ipiv, b, ldb, info)
            import :: wp
            implicit none (type, external)
            character(len=1), intent(in) :: trans
            integer, intent(in) :: n, nrhs, lda, ldb
            complex(wp), intent(in) :: a(lda, *)
            integer, intent(in) :: ipiv(*)
            complex(wp), intent(inout) :: b(ldb, *)
            integer, intent(out) :: info
        end subroutine zgetrs

        !> The Schur form of a complex matrix; not sorted if `sort` is 'N'.
        subroutine zgees(jobvs, sort, select, n, a, lda, sdim, w, vs, ldvs, work, lwork, rwork, bwork, info)
            import :: wp
            implicit none (type, external)
            interface
                logical function select(value)
                    import :: wp
                    implicit none (type, external)
                    complex(wp), intent(in) :: value
                end function select
            end interface
            character(len=1), intent(in) :: jobvs, sort
            integer, intent(in) :: n, lda, ldvs, lwork
            complex(wp), intent(inout) :: a(lda, *)
            complex(wp), intent(out) :: w(*), vs(ldvs, *), work(*)
            real(wp), intent(out) :: rwork(*)
            integer, intent(out) :: sdim, info
            logical, intent(out) :: bwork(*)
        end subroutine zgees

        !> Move the entry ifst of the diagonal of a complex Schur form to the place ilst.
        subroutine ztrexc(compq, n, t, ldt, q, ldq, ifst, ilst, info)
            import :: wp
            implicit none (type, external)
            character(len=1), intent(in) :: compq
            integer, intent(in) :: n, ldt, ldq, ifst, ilst
            complex(wp), intent(inout) :: t(ldt, *), q(ldq, *)
            integer, intent(out) :: info
        end subroutine ztrexc

        !> Eigenvectors of a complex triangular matrix.
        subroutine ztrevc(side, howmny, select, n, t, ldt, vl, ldvl, vr, ldvr, mm, m, work, rwork, info)
            import :: wp
            implicit none (type, external)
            character(len=1), intent(in) :: side, howmny
            logical, intent(in) :: select(*)
            integer, intent(in) :: n, ldt, ldvl, ldvr, mm
            complex(wp), intent(inout) :: t(ldt, *), vl(ldvl, *), vr(ldvr, *)
            complex(wp), intent(out) :: work(*)
            real(wp), intent(out) :: rwork(*)
            integer, intent(out) :: m, info
        end subroutine ztrevc

        !> Reciprocal condition number from the factors of `dgetrf`.
        subroutine dgecon(norm, n, a, lda, anorm, rcond, work, iwork, info)
            import :: wp
            implicit none (type, external)
            character(len=1), intent(in) :: norm
            integer, intent(in) :: n, lda
            real(wp), intent(in) :: a(lda, *), anorm
            real(wp), intent(out) :: rcond, work(*)
            integer, intent(out) :: iwork(*), info
        end subroutine dgecon

        !> Cholesky factorisation.
        subroutine dpotrf(uplo, n, a, lda, info)
            import :: wp
            implicit none (type, external)
            character(len=1), intent(in) :: uplo
            integer, intent(in) :: n, lda
            real(wp), intent(inout) :: a(lda, *)
            integer, intent(out) :: info
        end subroutine dpotrf

        !> Solution with the factor of `dpotrf`.
        subroutine dpotrs(uplo, n, nrhs, a, lda, b, ldb, info)
            import :: wp
            implicit none (type, external)
            character(len=1), intent(in) :: uplo
            integer, intent(in) :: n, nrhs, lda, ldb
            real(wp), intent(in) :: a(lda, *)
            real(wp), intent(inout) :: b(ldb, *)
            integer, intent(out) :: info
        end subroutine dpotrs

        !> The inverse of a definite matrix, one triangle, from the factor of `dpotrf`.
        subroutine dpotri(uplo, n, a, lda, info)
            import :: wp
            implicit none (type, external)
            character(len=1), intent(in) :: uplo
            integer, intent(in) :: n, lda
            real(wp), intent(inout) :: a(lda, *)
            integer, intent(out) :: info
        end subroutine dpotri

        !> The inverse of a triangular matrix.
        subroutine dtrtri(uplo, diag, n, a, lda, info)
            import :: wp
            implicit none (type, external)
            character(len=1), intent(in) :: uplo, diag
            integer, intent(in) :: n, lda
            real(wp), intent(inout) :: a(lda, *)
            integer, intent(out) :: info
        end subroutine dtrtri

        !> C := alpha A B + beta C, either transposed or not.
        subroutine dgemm(transa, transb, m, n, k, alpha, a, lda, b, ldb, beta, c, ldc)
            import :: wp
            implicit none (type, external)
            character(len=1), intent(in) :: transa, transb
            integer, intent(in) :: m, n, k, lda, ldb, ldc
            real(wp), intent(in) :: alpha, a(lda, *), b(ldb, *), beta
            real(wp), intent(inout) :: c(ldc, *)
        end subroutine dgemm

        !> C := alpha A A' + beta C or alpha A' A + beta C, one triangle.
        subroutine dsyrk(uplo, trans, n, k, alpha, a, lda, beta, c, ldc)
            import :: wp
            implicit none (type, external)
            character(len=1), intent(in) :: uplo, trans
            integer, intent(in) :: n, k, lda, ldc
            real(wp), intent(in) :: alpha, a(lda, *), beta
            real(wp), intent(inout) :: c(ldc, *)
        end subroutine dsyrk
    end interface
end module tandem_linalg_lapack
