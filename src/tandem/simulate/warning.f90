! SPDX-License-Identifier: MIT
!> A warning of a run, and the limits above which errors cause one.
module tandem_simulate_warning
    use tandem_kinds, only: wp
    use tandem_options, only: options_type
    implicit none (type, external)
    private

    public :: add_warning, dense_limit, large, times, warning_limit, warning_type

    !> Errors above this part of the state cause a warning with fixed steps, and above this multiple of the tolerance with others.
    real(wp), parameter :: large = 5.0e-4_wp, times = 15.0_wp

    !> Under error control the motion between steps is kept within this multiple of the tolerance if states there are requested.
    real(wp), parameter :: dense_limit = 10.0_wp

    type :: warning_type
        !> Observation and advice.
        character(len=:), allocatable :: text
        !> True for a property of the model that users should know, such as a redundant row, rather than a warning about the result.
        logical :: is_note = .false.
    end type warning_type

contains

    !> The error of a step, relative to the state, above which a warning is due.
    pure real(wp) function warning_limit(options)
        type(options_type), intent(in) :: options

        warning_limit = large
        if (options%is_adaptive()) warning_limit = min(large, times*options%relative_tolerance())
    end function warning_limit

    !> Append a warning. An array constructor would leave the memory of the new text behind (gfortran 12).
    subroutine add_warning(warnings, text, is_note)
        !> Existing warnings; allocated, and one longer afterwards.
        type(warning_type), allocatable, intent(inout) :: warnings(:)
        character(len=*), intent(in) :: text
        logical, intent(in), optional :: is_note
        type(warning_type), allocatable :: longer(:)

        allocate (longer(size(warnings) + 1))
        longer(:size(warnings)) = warnings
        longer(size(longer))%text = text
        if (present(is_note)) longer(size(longer))%is_note = is_note
        call move_alloc(longer, warnings)
    end subroutine add_warning
end module tandem_simulate_warning
