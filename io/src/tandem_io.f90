! SPDX-License-Identifier: MIT
!> The public face of tandem-io: re-exports only.
module tandem_io
    use hdf5, only: h5open_f
    use tomlf, only: toml_table
    implicit none
    private
    public :: h5open_f, toml_table
end module tandem_io
