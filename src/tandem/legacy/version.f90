! SPDX-License-Identifier: MIT
!> Version of the C and Fortran 77 interfaces.
module tandem_legacy_version
    implicit none (type, external)
    private

    public :: interface_version

    !> 1000 times the major version, which changes if programs must be changed or recompiled, plus the minor version, which changes
    !> if the interface is extended. `include/interface.txt` lists the interface of the version.
    integer, parameter :: interface_version = 1018
end module tandem_legacy_version
