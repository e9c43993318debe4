! SPDX-License-Identifier: MIT
! Subroutines of the Fortran 77 interface about equilibria and linearised systems; the others are in f77.f90.

!> Eigenvalues RE(K), IM(K) of small motions about T, Q(N), QD(N), and the matrix A(K*K), by columns; K is at most 2 N.
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

!> Move Q(N) to the nearest equilibrium at T.
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

!> Move Q(N), QD(N) to the nearest steady motion at T along MOTION: names separated by blanks or commas, NAME=RATE for a given rate;
!> a blank text for all symmetries.
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
