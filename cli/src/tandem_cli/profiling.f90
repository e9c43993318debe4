! SPDX-License-Identifier: MIT
!> Time measurement of a run for `tandem run --profile`.
module tandem_cli_profiling
    use tandem, only: model_type, observer_type, part_rows, part_watch, profile_type, profiled_observer_type
    use tandem_io, only: observer_list_type
    implicit none (type, external)
    private

    public :: profiling_type

    !> Time measurement; must be a target and outlive the run.
    type :: profiling_type
        !> Measured times.
        type(profile_type) :: profile
        type(profiled_observer_type), private :: watching, writing
    contains
        procedure :: begin, observe
    end type profiling_type

contains

    !> Begin the measurement of a run with a model.
    subroutine begin(self, model)
        class(profiling_type), intent(inout), target :: self
        class(model_type), intent(inout) :: model

        call self%profile%begin()
        model%state%timer => self%profile
    end subroutine begin

    !> Replace observers by observers that measure their time.
    subroutine observe(self, watchers, writer, observers)
        class(profiling_type), intent(inout), target :: self
        !> Observers that do not write, and the observer that writes the file.
        class(observer_type), intent(inout), target :: watchers, writer
        !> Measured observers.
        type(observer_list_type), intent(inout) :: observers

        self%watching%inner => watchers
        self%watching%profile => self%profile
        self%watching%part = part_watch
        self%writing%inner => writer
        self%writing%profile => self%profile
        self%writing%part = part_rows
        call observers%add(self%watching)
        call observers%add(self%writing)
    end subroutine observe
end module tandem_cli_profiling
