! SPDX-License-Identifier: MIT
!> What a run has to say that is no failure: one warning.
module tandem_simulate_warning
    implicit none (type, external)
    private

    public :: warning_type

    type :: warning_type
        !> What was seen and what to do about it.
        character(len=:), allocatable :: text
    end type warning_type
end module tandem_simulate_warning
