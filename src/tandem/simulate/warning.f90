! SPDX-License-Identifier: MIT
!> Warnings of a run, and the error limits above which they are issued.
module tandem_simulate_warning
    use tandem_kinds, only: wp
    use tandem_options, only: options_type
    implicit none (type, external)
    private

    public :: add_warning, dense_limit, large, times, warning_limit, warning_type

    !> Limits of the error of a step: fraction of the state for fixed steps, and multiple of the tolerance otherwise.
    real(wp), parameter :: large = 5.0e-4_wp, times = 15.0_wp

    !> Limit of the error between steps, if states there are requested, as a multiple of the tolerance under error control.
    real(wp), parameter :: dense_limit = 10.0_wp

    type :: warning_type
        !> Observation and advice.
        character(len=:), allocatable :: text
        !> True for a property of the model that users should know, such as a redundant row; false for a warning about the result.
        logical :: is_note = .false.
    end type warning_type

contains

    !> Largest error of a step, relative to the state, without a warning.
    pure real(wp) function warning_limit(options)
        type(options_type), intent(in) :: options

        warning_limit = large
        if (options%is_adaptive()) warning_limit = min(large, times*options%relative_tolerance())
    end function warning_limit

    !> Append a warning. An array constructor would leak the memory of the new text (gfortran 12).
    subroutine add_warning(warnings, text, is_note)
        !> Existing warnings. Allocated on entry and one longer on return.
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
