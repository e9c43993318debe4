! SPDX-License-Identifier: MIT
!> What a run has to say that is no failure: one warning; and from where on an error is worth one.
module tandem_simulate_warning
    use tandem_kinds, only: wp
    use tandem_options, only: options_type
    implicit none (type, external)
    private

    public :: add_warning, dense_limit, large, times, warning_limit, warning_type

    !> Errors above this part of the state are worth a warning with fixed steps, and above so many times the tolerance with others.
    real(wp), parameter :: large = 5.0e-4_wp, times = 15.0_wp

    !> Under error control the motion between steps is kept within so many times the tolerance where somebody looks there.
    real(wp), parameter :: dense_limit = 10.0_wp

    type :: warning_type
        !> What was seen and what to do about it.
        character(len=:), allocatable :: text
        !> A property of the model that users should know, such as a redundant row, rather than a doubt about the result.
        logical :: is_note = .false.
    end type warning_type

contains

    !> The error of a step, relative to the state, above which there is something to say.
    pure real(wp) function warning_limit(options)
        type(options_type), intent(in) :: options

        warning_limit = large
        if (options%is_adaptive()) warning_limit = min(large, times*options%relative_tolerance())
    end function warning_limit

    !> Put a warning behind others. An array constructor would leave the memory of the new text behind (gfortran 12).
    subroutine add_warning(warnings, text, is_note)
        !> Those that there are; allocated, and one longer afterwards.
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
