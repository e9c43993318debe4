! SPDX-License-Identifier: MIT
!> What a run has to say that is no failure: one warning.
module tandem_simulate_warning
    implicit none (type, external)
    private

    public :: add_warning, warning_type

    type :: warning_type
        !> What was seen and what to do about it.
        character(len=:), allocatable :: text
    end type warning_type
contains

    !> Put a warning behind others. An array constructor would leave the memory of the new text behind (gfortran 12).
    subroutine add_warning(warnings, text)
        !> Those that there are; allocated, and one longer afterwards.
        type(warning_type), allocatable, intent(inout) :: warnings(:)
        character(len=*), intent(in) :: text
        type(warning_type), allocatable :: longer(:)

        allocate (longer(size(warnings) + 1))
        longer(:size(warnings)) = warnings
        longer(size(longer))%text = text
        call move_alloc(longer, warnings)
    end subroutine add_warning
end module tandem_simulate_warning
