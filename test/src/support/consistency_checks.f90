! SPDX-License-Identifier: MIT
!> Reports of runs about contradictory procedures of a model.
module consistency_checks
    use asserts, only: check_text
    use tandem, only: at_step, failure_type => error_type, find_error_warnings, observer_type, simulation_type, statistics_type, &
        warning_type, wp
    use tandem_model_consistency, only: contradiction_length, find_contradiction
    use tandem_model_counts, only: counts_type
    use testdrive, only: error_type, test_failed
    implicit none (type, external)
    private

    public :: check_clean, check_named, looker_type

    !> Checks every step, while a run checks few.
    type, extends(observer_type) :: looker_type
        character(len=contradiction_length) :: contradiction = ''
        integer :: looks = 0
        !> Number of steps between checks.
        integer :: pause = 1
        integer, private :: steps = 0
    contains
        procedure :: observe
    end type looker_type

contains

    subroutine observe(self, simulation, occasion, error)
        class(looker_type), intent(inout) :: self
        class(simulation_type), intent(inout) :: simulation
        integer, intent(in) :: occasion
        type(failure_type), allocatable, intent(out) :: error
        character(len=contradiction_length) :: found
        type(counts_type) :: counts

        if (occasion /= at_step) return
        self%steps = self%steps + 1
        if (mod(self%steps, self%pause) /= 0) return
        self%looks = self%looks + 1
        associate (state => simulation%state)
            call find_contradiction(simulation%model, state%t, state%q, state%qd, &
                merge(-1.0_wp, 1.0_wp, mod(self%looks, 2) == 0)*simulation%last_step, counts, found)
        end associate
        if (found /= '') self%contradiction = found
    end subroutine observe

    !> A run must report the contradictory procedures, and find_error_warnings must list this first.
    subroutine check_named(error, simulation, failure, piece)
        type(error_type), allocatable, intent(inout) :: error
        type(simulation_type), intent(in) :: simulation
        type(failure_type), allocatable, intent(in) :: failure
        character(len=*), intent(in) :: piece
        type(statistics_type) :: statistics
        type(warning_type), allocatable :: doubts(:)

        if (allocated(error)) return
        statistics = simulation%statistics()
        call check_text(error, trim(statistics%contradiction), piece)
        if (allocated(error)) return
        call find_error_warnings(simulation%options, statistics, doubts)
        call check_text(error, doubts(1)%text, piece)
        if (allocated(error) .or. .not. allocated(failure)) return
        call check_text(error, failure%message, piece)
    end subroutine check_named

    !> A run must not report a contradiction in its model.
    subroutine check_clean(error, simulation, looker, what)
        type(error_type), allocatable, intent(inout) :: error
        type(simulation_type), intent(in) :: simulation
        type(looker_type), intent(in) :: looker
        character(len=*), intent(in) :: what
        type(statistics_type) :: statistics

        if (allocated(error)) return
        statistics = simulation%statistics()
        if (statistics%contradiction /= '') call test_failed(error, what//': '//trim(statistics%contradiction))
        if (looker%contradiction /= '') call test_failed(error, what//', looked at: '//trim(looker%contradiction))
    end subroutine check_clean
end module consistency_checks
