! SPDX-License-Identifier: MIT
! Fortran 77 interface to equilibria and linearised systems; f77.f90 contains the other subroutines.

!> Compute the eigenvalues RE(K), IM(K) of small motions about T, Q(N), QD(N), and the system matrix A(K*K), by columns. K is at
!> most 2 N.
subroutine tdlin(h, t, q, qd, k, re, im, a, rpar, ipar, ierr)
    use tandem_legacy_f77_model, only: found, problem_type, wp
    implicit none (type, external)
    integer, intent(in) :: h(4)
    real(wp), intent(in) :: t, q(*), qd(*)
    integer, intent(out) :: k
    real(wp), intent(inout) :: re(*), im(*), a(*), rpar(*)
    integer, intent(inout) :: ipar(*)
    integer, intent(out) :: ierr
    type(problem_type), pointer :: problem

    k = 0
    if (.not. found(h, problem, ierr, rpar, ipar)) return
    call problem%linearise(t, q, qd, k, re, im, a)
    ierr = problem%stat
end subroutine tdlin

!> Find the equilibrium nearest to Q(N) at T.
subroutine tdequi(h, t, q, rpar, ipar, ierr)
    use tandem_legacy_f77_model, only: found, problem_type, wp
    implicit none (type, external)
    integer, intent(in) :: h(4)
    real(wp), intent(in) :: t
    real(wp), intent(inout) :: q(*), rpar(*)
    integer, intent(inout) :: ipar(*)
    integer, intent(out) :: ierr
    type(problem_type), pointer :: problem

    if (.not. found(h, problem, ierr, rpar, ipar)) return
    call problem%find_equilibrium(t, q)
    ierr = problem%stat
end subroutine tdequi

!> Find the steady motion nearest to Q(N), QD(N) at T. MOTION contains names of motions of symmetry, separated by blanks or commas,
!> with NAME=RATE for a given rate; blank for all symmetries of the model.
subroutine tdstdy(h, t, q, qd, motion, rpar, ipar, ierr)
    use tandem_legacy_f77_model, only: found, problem_type, wp
    implicit none (type, external)
    integer, intent(in) :: h(4)
    real(wp), intent(in) :: t
    real(wp), intent(inout) :: q(*), qd(*)
    character(len=*), intent(in) :: motion
    real(wp), intent(inout) :: rpar(*)
    integer, intent(inout) :: ipar(*)
    integer, intent(out) :: ierr
    type(problem_type), pointer :: problem

    if (.not. found(h, problem, ierr, rpar, ipar)) return
    call problem%find_steady_motion(t, q, qd, motion)
    ierr = problem%stat
end subroutine tdstdy
