! SPDX-License-Identifier: MIT
!> An observer of the action of an event on a pendulum.
module event_witness
    use tandem, only: at_event, at_step, failure_type => error_type, observer_type, simulation_type, wp
    implicit none (type, external)
    private

    public :: witness_type

    !> Stores the velocity before and after an action, and evaluates the shortened step.
    type, extends(observer_type) :: witness_type
        integer :: n_events = 0
        real(wp) :: before(2) = 0.0_wp, after(2) = 0.0_wp, largest_error = 0.0_wp, between = 0.0_wp
    contains
        procedure :: observe
    end type witness_type

contains

    subroutine observe(self, simulation, occasion, error)
        class(witness_type), intent(inout) :: self
        class(simulation_type), intent(inout) :: simulation
        integer, intent(in) :: occasion
        type(failure_type), allocatable, intent(out) :: error
        real(wp) :: t

        if (occasion == at_event) then
            self%n_events = self%n_events + 1
            self%before = simulation%state%qd
            ! Before the event the old gravity applies.
            t = simulation%state%t - 0.5_wp*simulation%last_step
            call simulation%look_at(t, error)
            associate (q => simulation%state%q, qd => simulation%state%qd, qdd => simulation%state%qdd)
                self%between = abs((qdd(1)*(-q(2)) + (qdd(2) + 9.81_wp)*q(1)))
            end associate
            self%largest_error = maxval(simulation%errors)
            call simulation%look_back()
        else if (occasion == at_step .and. self%n_events == 1 .and. .not. any(abs(self%after) > 0.0_wp)) then
            self%after = simulation%state%qd
        end if
    end subroutine observe
end module event_witness
