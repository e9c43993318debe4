! SPDX-License-Identifier: MIT
!> The version of this package, as in fpm.toml, and of the result file.
module tandem_io_version
    implicit none (type, external)
    private

    public :: tandem_version, format_version

    !> Version of tandem.
    character(len=*), parameter :: tandem_version = '0.1.0'
    !> Version of the result file's layout: raised when a reader of older files would go wrong.
    integer, parameter :: format_version = 1
end module tandem_io_version
