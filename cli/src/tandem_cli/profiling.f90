! SPDX-License-Identifier: MIT
!> Time measurement of a run for `tandem run --profile`.
module tandem_cli_profiling
    use tandem, only: chart_type, model_type, new_profiled_chart, observer_type, options_type, part_rows, part_watch, &
        profile_type, profiled_observer_type, wp
    use tandem_io, only: observer_list_type
    implicit none (type, external)
    private

    public :: profiling_type

    !> Must be a target and outlive the run.
    type :: profiling_type
        !> Measured times.
        type(profile_type) :: profile
        type(profiled_observer_type), private :: watching, writing
    contains
        procedure :: begin, observe
    end type profiling_type

contains

    !> Begin the measurement.
    subroutine begin(self, model, options, t, q, qd, chart)
        class(profiling_type), intent(inout), target :: self
        !> The model of the run.
        class(model_type), intent(inout), target :: model
        type(options_type), intent(in) :: options
        !> Start of the run.
        real(wp), intent(in) :: t, q(:), qd(:)
        !> Chart argument for `initialize` of the simulation.
        class(chart_type), allocatable, intent(out) :: chart

        call self%profile%begin()
        call new_profiled_chart(model, options, t, q, qd, self%profile, chart)
        model%state%timer => self%profile
    end subroutine begin

    !> Measure the time of observers.
    subroutine observe(self, watchers, writer, observers)
        class(profiling_type), intent(inout), target :: self
        !> Observers that do not write, and the one that does.
        class(observer_type), intent(inout), target :: watchers, writer
        !> Replacements for them, which measure their time.
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
