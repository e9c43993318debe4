! SPDX-License-Identifier: MIT
!> Kinds of the numbers that tandem computes with.
module tandem_kinds
    use, intrinsic :: iso_fortran_env, only: real64, int64
    implicit none (type, external)
    private

    public :: wp, long

    !> Working precision of every real number: IEEE double.
    integer, parameter :: wp = real64
    !> Kind of counters that may pass 2**31 in a long run.
    integer, parameter :: long = int64
end module tandem_kinds
