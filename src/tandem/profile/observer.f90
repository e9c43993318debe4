! SPDX-License-Identifier: MIT
!> Observer that calls another observer and measures its time.
module tandem_profile_observer
    use tandem_error, only: error_type
    use tandem_profile_ledger, only: mark_type, profile_type
    use tandem_profile_parts, only: part_watch
    use tandem_simulation, only: observer_type, simulation_type
    implicit none (type, external)
    private

    public :: profiled_observer_type

    !> Pass an object of this type to `integrate` of the simulation in place of `inner`.
    type, extends(observer_type) :: profiled_observer_type
        !> Observer to be called, and the measured times. Both must exist as long as this object.
        class(observer_type), pointer :: inner => null()
        type(profile_type), pointer :: profile => null()
        !> Part to which the time is attributed; `part_rows` for an observer that writes output.
        integer :: part = part_watch
    contains
        procedure :: observe
    end type profiled_observer_type

contains

    !> Call the inner observer, which may be of this type as well.
    recursive subroutine observe(self, simulation, occasion, error)
        class(profiled_observer_type), intent(inout) :: self
        class(simulation_type), intent(inout) :: simulation
        !> `at_start`, `at_step`, `at_end` or `at_event`.
        integer, intent(in) :: occasion
        type(error_type), allocatable, intent(out) :: error
        type(mark_type) :: mark

        call self%profile%enter(self%part, mark)
        call self%inner%observe(simulation, occasion, error)
        call self%profile%leave(mark)
    end subroutine observe
end module tandem_profile_observer
