! SPDX-License-Identifier: MIT
!> Tests of controlled steps limited by charts.
module test_reach
    use asserts, only: check_below, check_no_failure
    use runs, only: run
    use tandem, only: failure_type => error_type, long, options_type, rolling_disk_type, simulation_type, statistics_type, wp
    use testdrive, only: error_type, new_unittest, unittest_type
    implicit none (type, external)
    private

    public :: collect_reach

contains

    !> The tests of this suite.
    subroutine collect_reach(testsuite)
        type(unittest_type), allocatable, intent(out) :: testsuite(:)

        testsuite = [ &
            new_unittest('few-steps-fail-where-charts-end', test_few_failures)]
    end subroutine collect_reach

    !> A disk that rotates by more than a radian per step, for which the tolerance alone would allow steps beyond the reach of its
    !> charts.
    subroutine test_few_failures(error)
        type(error_type), allocatable, intent(out) :: error
        real(wp), parameter :: tolerances(4) = [1.0e-2_wp, 1.0e-3_wp, 1.0e-4_wp, 1.0e-5_wp]
        character(len=16), parameter :: explicit(2) = [character(len=16) :: 'dopri5', 'dop853']
        type(rolling_disk_type), target :: disk
        type(simulation_type) :: simulation
        type(statistics_type) :: statistics
        type(failure_type), allocatable :: failure
        real(wp) :: q(9), qd(9)
        integer(long) :: failed, tries
        integer :: i, k

        call disk%define()
        call disk%start([-8.0_wp, 0.01_wp, 0.0_wp], 0.1_wp, q, qd)
        do k = 1, size(explicit)
            failed = 0
            tries = 0
            do i = 1, size(tolerances)
                call run(simulation, disk, options_type(stepper=explicit(k), rtol=tolerances(i)), 0.0_wp, q, qd, 20.0_wp, failure)
                call check_no_failure(error, failure)
                if (allocated(error)) return
                statistics = simulation%statistics()
                failed = failed + statistics%failed
                tries = tries + statistics%steps + statistics%failed + statistics%rejected
            end do
            ! For all tolerances together, so that a single attempt does not decide.
            call check_below(error, real(failed, wp)/real(tries, wp), 0.027_wp, trim(explicit(k))//': part of the tries that fail')
            if (allocated(error)) return
        end do
    end subroutine test_few_failures
end module test_reach
