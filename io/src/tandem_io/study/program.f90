! SPDX-License-Identifier: MIT
!> Identification of the program that computes the rows of a study, because rows of another build may differ in counts, times and
!> rounding.
module tandem_io_study_program
    use tandem, only: long
    use tandem_io_scene_shipped, only: program_path
    use tandem_io_study_files, only: read_whole
    use tandem_io_version, only: tandem_version
    use tandem_pack, only: checksum
    implicit none (type, external)
    private

    public :: program_settings

contains

    !> Version of tandem and checksum of the executable file, in TOML.
    function program_settings() result(text)
        character(len=:), allocatable :: text
        character(len=:), allocatable :: bytes
        character(len=16) :: build
        integer, parameter :: word = storage_size(0_long)/storage_size('a')
        character(len=*), parameter :: newline = new_line('a')

        build = 'unknown'
        call read_whole(program_path(), bytes)
        if (allocated(bytes)) write (build, '(z16.16)') checksum(transfer(bytes, [0_long], len(bytes)/word))
        text = '[program]'//newline//'tandem = "'//tandem_version//'"'//newline//'build = "'//trim(build)//'"'//newline
    end function program_settings
end module tandem_io_study_program
