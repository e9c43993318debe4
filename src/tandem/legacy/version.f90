! SPDX-License-Identifier: MIT
!> The version of the interfaces for C and Fortran 77.
module tandem_legacy_version
    implicit none (type, external)
    private

    public :: interface_version

    !> A thousand times the major number, which changes when programs must be changed or recompiled, plus the minor number, which
    !> changes with every addition. `include/interface.txt` lists the contents.
    integer, parameter :: interface_version = 1015
end module tandem_legacy_version
