! SPDX-License-Identifier: MIT
!> Error of a run in the C and Fortran 77 interfaces, estimated by a second, more accurate run. The first run is recorded from its
!> start to an end that is specified in advance, over any number of calls; then the second run is made.
module tandem_legacy_error_watch
    use tandem_error, only: error_type, set_error
    use tandem_kinds, only: wp
    use tandem_model, only: model_type
    use tandem_simulate_global_error, only: global_error_type
    use tandem_simulate_statistics, only: statistics_type
    use tandem_simulation, only: at_end, at_step, simulation_type
    use tandem_status, only: status_invalid_option
    use, intrinsic :: ieee_arithmetic, only: ieee_is_finite
    implicit none (type, external)
    private

    public :: error_watch_type

    !> Error of a run.
    type :: error_watch_type
        type(global_error_type) :: global_error
        !> Reason for which the second run failed.
        type(error_type), allocatable :: failure
        !> True while the run is being recorded; end of the recording.
        logical, private :: is_on = .false.
        real(wp), private :: t_end = 0.0_wp
        !> True if the run was recorded from its start; state at the start (n).
        logical, private :: has_begun = .false.
        real(wp), allocatable, private :: q(:), qd(:)
    contains
        procedure :: begin, discard, integrate, step, estimate
    end type error_watch_type

contains

    !> Begin recording a run at its start.
    subroutine begin(self, simulation, t_end, error)
        class(error_watch_type), intent(inout) :: self
        type(simulation_type), intent(in) :: simulation
        !> Time at which the error will be estimated.
        real(wp), intent(in) :: t_end
        type(error_type), allocatable, intent(out) :: error
        type(statistics_type) :: statistics

        statistics = simulation%statistics()
        if (statistics%steps > 0) then
            call set_error(error, status_invalid_option, 'the run has already left its start', 'restart it')
        else if (.not. (t_end > simulation%state%t .and. ieee_is_finite(t_end))) then
            call set_error(error, status_invalid_option, 'the end must be finite and after the start', 'choose a later end')
        else
            call self%discard()
            call self%global_error%initialize(size(simulation%state%q), simulation%state%t, t_end)
            self%q = simulation%state%q
            self%qd = simulation%state%qd
            self%t_end = t_end
            self%is_on = .true.
            self%has_begun = .true.
        end if
    end subroutine begin

    !> Discard the recorded data.
    subroutine discard(self)
        class(error_watch_type), intent(inout) :: self

        self%is_on = .false.
        self%has_begun = .false.
        self%global_error%is_known = .false.
        if (allocated(self%failure)) deallocate (self%failure)
    end subroutine discard

    !> Integrate to t_end. A step ends at the end of the recording, if this lies before t_end.
    subroutine integrate(self, simulation, t_end, error)
        class(error_watch_type), intent(inout) :: self
        type(simulation_type), intent(inout) :: simulation
        real(wp), intent(in) :: t_end
        type(error_type), allocatable, intent(out) :: error

        if (self%is_on) then
            call simulation%integrate(min(t_end, self%t_end), error, self%global_error)
            self%is_on = simulation%state%t < self%t_end
            if (allocated(error) .or. simulation%is_stopped .or. .not. simulation%state%t < t_end) return
        end if
        call simulation%integrate(t_end, error)
    end subroutine integrate

    !> Perform one step that goes neither beyond t_limit nor beyond the end of the recording.
    subroutine step(self, simulation, t_limit, error)
        class(error_watch_type), intent(inout) :: self
        type(simulation_type), intent(inout) :: simulation
        real(wp), intent(in) :: t_limit
        type(error_type), allocatable, intent(out) :: error

        if (.not. self%is_on) then
            call simulation%step(t_limit, error)
            return
        end if
        call simulation%step(min(t_limit, self%t_end), error)
        if (allocated(error)) return
        call self%global_error%observe(simulation, at_step, error)
        self%is_on = simulation%state%t < self%t_end
        if (.not. (self%is_on .or. allocated(error))) call self%global_error%observe(simulation, at_end, error)
    end subroutine step

    !> Estimate the error by a second run. The first run can be continued as if nothing had happened.
    subroutine estimate(self, model, simulation, error)
        class(error_watch_type), intent(inout) :: self
        !> Model of the run.
        class(model_type), intent(inout), target :: model
        type(simulation_type), intent(in) :: simulation
        !> invalid_option if the run was not recorded or has not reached the end of the recording; otherwise the reason for which
        !> the second run failed.
        type(error_type), allocatable, intent(out) :: error
        integer :: segment

        if (.not. self%has_begun) then
            call set_error(error, status_invalid_option, 'the run was not observed from its start', &
                'call tandem_watch_error or TDWERR there')
            return
        end if
        segment = model%segment
        call self%global_error%estimate(model, simulation%options, self%q, self%qd, error)
        model%segment = segment
        if (allocated(error)) self%failure = error
    end subroutine estimate
end module tandem_legacy_error_watch
