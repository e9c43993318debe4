! SPDX-License-Identifier: MIT
!> Kinds of the numbers of tandem, and vector lengths of its loops.
module tandem_kinds
    use, intrinsic :: iso_fortran_env, only: int64, real32, real64
    implicit none (type, external)
    private

    public :: wp, sp, long, lane, short

    !> Working precision of every real number: IEEE double.
    integer, parameter :: wp = real64
    !> Single precision, for stored guesses only: nothing is computed with it.
    integer, parameter :: sp = real32
    !> Kind of counters that may pass 2**31 in a long run.
    integer, parameter :: long = int64
    !> Length of innermost loops: one vector register. With a constant length gfortran generates no code for remainders.
    integer, parameter :: short = 4
    !> Columns of small matrices are padded with zeros to a multiple of this.
    integer, parameter :: lane = 2*short
end module tandem_kinds
