! SPDX-License-Identifier: MIT
!> The attributes with which the file of a study begins.
module tandem_io_output_study_head
    use tandem, only: long
    use tandem_io_output_hdf5, only: hdf5_type
    use tandem_io_version, only: format_version, tandem_version
    implicit none (type, external)
    private

    public :: create_study

contains

    !> Create a file; an existing file is overwritten.
    subroutine create_study(file, path, study, scene)
        type(hdf5_type), intent(inout) :: file
        !> Path of the file, name of the study, and complete scene as text.
        character(len=*), intent(in) :: path, study, scene

        call file%create(path)
        call file%attach('/', 'format_version', int(format_version, long))
        call file%attach('/', 'tandem_version', tandem_version)
        call file%attach('/', 'study', study)
        call file%attach('/', 'scene', scene)
    end subroutine create_study
end module tandem_io_output_study_head
