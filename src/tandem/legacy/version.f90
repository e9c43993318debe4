! SPDX-License-Identifier: MIT
!> The version of the interfaces for C and Fortran 77.
module tandem_legacy_version
    implicit none (type, external)
    private

    public :: interface_version

    !> A thousand times the major number, which changes when a program must be changed or compiled anew, plus the minor one,
    !> which changes when something is added. `include/interface.txt` holds what belongs to it.
    integer, parameter :: interface_version = 1018
end module tandem_legacy_version
