! SPDX-License-Identifier: MIT
!> Verification of result files against their checksums.
module tandem_io_output_verification
    use tandem, only: error_type, set_error
    use tandem_status, only: status_invalid_checkpoint
    use tandem_io_output_checkpoint, only: check_copies
    use tandem_io_output_checksums, only: examine, finding_type
    use tandem_io_output_hdf5, only: hdf5_type
    use tandem_io_output_target, only: check_source
    implicit none (type, external)
    private

    public :: verify_result

contains

    !> Read a result file completely, without changing it, and compare it with its checksums.
    subroutine verify_result(path, finding, status, error)
        character(len=*), intent(in) :: path
        !> Result of the check.
        type(finding_type), intent(out) :: finding
        !> Status of the file; blank if unreadable.
        character(len=:), allocatable, intent(out) :: status
        !> Set if the file is not a result, or cannot be opened.
        type(error_type), allocatable, intent(out) :: error
        type(hdf5_type) :: file
        character(len=:), allocatable :: problem
        logical :: is_of_a_run

        status = ''
        call check_source(path, error, 'verify')
        if (allocated(error)) return
        call file%open_to_read(path)
        ! A damaged file is not refused here but reported below.
        is_of_a_run = file%has('/trajectory')
        if (.not. is_of_a_run) is_of_a_run = file%has('/checksums')
        if (.not. (is_of_a_run .or. allocated(file%problem))) then
            call file%close()
            call set_error(error, status_invalid_checkpoint, 'cannot verify '//path//': it has no rows of a run', &
                'use the result of a run; files of studies, sweeps and linearisations have no checksums')
            return
        end if
        call file%get_text('/', 'status', status)
        call examine(file, finding)
        call check_copies(file, problem)
        if (finding%unreadable_texts > 0) problem = 'some text attributes cannot be read'
        if (allocated(file%problem)) problem = file%problem
        ! If the run was killed, a copy of the checkpoint or a text may be incomplete.
        if (finding%problem == '' .and. (status /= 'running' .or. allocated(file%problem))) finding%problem = problem
        call file%close()
    end subroutine verify_result
end module tandem_io_output_verification
