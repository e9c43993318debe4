! SPDX-License-Identifier: MIT
!> The segment between breakpoints that contains a time.
module tandem_model_segment
    use tandem_error, only: error_type
    use tandem_kinds, only: wp
    use tandem_model, only: model_type
    implicit none (type, external)
    private

    public :: find_segment

contains

    !> Make the segment that contains a time the current segment, and make sure that the breakpoint at its end is known.
    subroutine find_segment(model, t, error)
        class(model_type), intent(inout) :: model
        !> Time; a breakpoint belongs to the segment after it.
        real(wp), intent(in) :: t
        type(error_type), allocatable, intent(out) :: error
        integer :: segment

        segment = 1
        do
            model%segment = segment
            call model%know_breakpoints(segment, error)
            if (allocated(error) .or. .not. allocated(model%breakpoints)) return
            segment = 1 + count(model%breakpoints <= t)
            if (segment == model%segment) return
        end do
    end subroutine find_segment
end module tandem_model_segment
