! SPDX-License-Identifier: MIT
!> Observes a long run: growth of the constraint errors from the first to the last tenth, and growth of memory.
module tandem_io_study_endurance
    use tandem, only: at_start, at_step, error_type, long, observer_type, simulation_type, wp
    use tandem_io_study_memory, only: resident_pages
    implicit none (type, external)
    private

    public :: endurance_type

    type, extends(observer_type) :: endurance_type
        !> Start and end of the run.
        real(wp) :: t_start = 0.0_wp, t_end = 0.0_wp
        !> Largest errors of the position, velocity and acceleration constraints on natural scales, in the first and in the last
        !> tenth of the time.
        real(wp) :: first(3) = 0.0_wp, last(3) = 0.0_wp
        !> Resident memory pages after the first tenth and at the end; negative if unknown.
        integer(long) :: pages_first = -1, pages_last = -1
    contains
        procedure :: observe, growth
    end type endurance_type

contains

    !> Record the errors of a step.
    subroutine observe(self, simulation, occasion, error)
        class(endurance_type), intent(inout) :: self
        class(simulation_type), intent(inout) :: simulation
        !> `at_start`, `at_step` or `at_end`.
        integer, intent(in) :: occasion
        type(error_type), allocatable, intent(out) :: error
        real(wp) :: tenth

        if (occasion == at_start) then
            self%first = simulation%errors
            self%last = 0.0_wp
            self%pages_first = -1
            self%pages_last = -1
        end if
        if (occasion /= at_step) return
        tenth = 0.1_wp*(self%t_end - self%t_start)
        if (simulation%state%t <= self%t_start + tenth) then
            self%first = max(self%first, simulation%errors)
        else if (self%pages_first < 0) then
            self%pages_first = resident_pages()
        end if
        if (simulation%state%t >= self%t_end - tenth) self%last = max(self%last, simulation%errors)
        if (simulation%state%t >= self%t_end) self%pages_last = resident_pages()
    end subroutine observe

    !> Largest of the three ratios of the constraint errors in the last and in the first tenth. Errors below `noise` are replaced by
    !> it.
    pure real(wp) function growth(self, noise)
        class(endurance_type), intent(in) :: self
        real(wp), intent(in) :: noise

        growth = maxval(max(self%last, noise)/max(self%first, noise))
    end function growth
end module tandem_io_study_endurance
