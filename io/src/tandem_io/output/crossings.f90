! SPDX-License-Identifier: MIT
!> Writes the singular configurations that a run has passed: the group /events/singular (see doc/output.md).
module tandem_io_output_crossings
    use tandem, only: crossing_record_type
    use tandem_io_output_hdf5, only: hdf5_type
    implicit none (type, external)
    private

    public :: write_crossings, crossings_path

    character(len=*), parameter :: crossings_path = '/events/singular'

contains

    !> Create the group, which must not exist.
    subroutine write_crossings(file, crossings)
        type(hdf5_type), intent(inout) :: file
        !> In the order of time.
        type(crossing_record_type), intent(in) :: crossings(:)

        if (.not. file%has('/events')) call file%add_group('/events')
        call file%add_group(crossings_path)
        call file%put(crossings_path//'/time', crossings%t)
        call file%attach(crossings_path//'/time', 'unit', 's')
        call file%attach(crossings_path//'/time', 'meaning', 'the time of each singular configuration that was passed')
        call file%put(crossings_path//'/error', crossings%error)
        call file%attach(crossings_path//'/error', 'unit', '1')
        call file%attach(crossings_path//'/error', 'meaning', &
            'estimated error of the step over it, relative to s + |y| of each coordinate and velocity')
    end subroutine write_crossings
end module tandem_io_output_crossings
