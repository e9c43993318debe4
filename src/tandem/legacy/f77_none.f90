! SPDX-License-Identifier: MIT
!> Placeholder for a procedure that the model of a Fortran 77 caller does not have. It is recognised by its address and never
!> called; a call would end the run.
subroutine tdnone(n, m, t, q, val, rpar, ipar, istat)
    use tandem_kinds, only: wp
    implicit none (type, external)
    integer, intent(in) :: n, m
    real(wp), intent(in) :: t, q(*)
    real(wp), intent(inout) :: val(*), rpar(*)
    integer, intent(inout) :: ipar(*), istat

    istat = -1
end subroutine tdnone
