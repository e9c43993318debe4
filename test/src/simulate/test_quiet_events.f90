! SPDX-License-Identifier: MIT
!> Tests of events that do not or hardly occur in a step: their cost, and completeness.
module test_quiet_events
    use asserts, only: check_below, check_close, check_count, check_no_failure, check_true
    use model_pendulum, only: pendulum_type
    use runs, only: choose
    use tandem, only: change_stepper, failure_type => error_type, options_type, rolling_disk_type, simulation_type, &
        statistics_type, stepper_names, threshold_event_type, wp
    use testdrive, only: error_type, new_unittest, unittest_type
    implicit none (type, external)
    private

    public :: collect_quiet_events

    real(wp), parameter :: pi = acos(-1.0_wp)

contains

    !> The tests of this suite.
    subroutine collect_quiet_events(testsuite)
        type(unittest_type), allocatable, intent(out) :: testsuite(:)

        testsuite = [ &
            new_unittest('events-out-of-reach-restore-no-constraints', test_out_of_reach), &
            new_unittest('two-crossings-however-close-are-found', test_close_crossings)]
    end subroutine collect_quiet_events

    !> Thresholds that the motion does not reach cost no evaluation of the model with any stepper, and change nothing.
    subroutine test_out_of_reach(error)
        type(error_type), allocatable, intent(out) :: error
        type(rolling_disk_type), target :: disk
        type(threshold_event_type), target :: events(4)
        type(simulation_type) :: simulation
        type(statistics_type) :: without, statistics
        type(options_type) :: options
        type(failure_type), allocatable :: failure
        real(wp) :: q(9), qd(9), expected(9)
        integer :: i, k, l

        call disk%define()
        call disk%start([-1.0_wp, 0.01_wp, 0.0_wp], 0.1_wp, q, qd)
        events(1) = threshold_event_type(name='above', quantity='q', index=3, value=2.0_wp)
        events(2) = threshold_event_type(name='below', quantity='q', index=3, value=0.0_wp, direction=-1)
        events(3) = threshold_event_type(name='fast', quantity='qd', index=1, value=30.0_wp)
        events(4) = threshold_event_type(name='slow', quantity='qd', index=3, value=-20.0_wp, direction=1)
        do k = 1, size(stepper_names)
            do l = 1, 2
                options = choose(stepper=stepper_names(k), step=0.02_wp)
                if (l == 2 .and. stepper_names(k) == 'rk4') cycle
                if (l == 2) call change_stepper(options, options%stepper, rtol=1.0e-5_wp)
                call simulation%initialize(disk, options, 0.0_wp, q, qd, failure)
                if (.not. allocated(failure)) call simulation%integrate(0.5_wp, failure)
                call check_no_failure(error, failure)
                if (allocated(error)) return
                without = simulation%statistics()
                expected = simulation%state%q
                call simulation%initialize(disk, options, 0.0_wp, q, qd, failure)
                if (.not. allocated(failure)) then
                    do i = 1, size(events)
                        call simulation%add_event(events(i))
                    end do
                    call simulation%integrate(0.5_wp, failure)
                end if
                call check_no_failure(error, failure)
                if (allocated(error)) return
                statistics = simulation%statistics()
                call check_count(error, simulation%n_events, 0, 'events')
                call check_close(error, simulation%state%q, expected, 0.0_wp, trim(stepper_names(k))//', q')
                call check_true(error, statistics%right_hand_sides == without%right_hand_sides .and. &
                    all(statistics%terms == without%terms), trim(stepper_names(k))//': no evaluation')
                if (allocated(error)) return
            end do
        end do
    end subroutine test_out_of_reach

    !> A pendulum passes a height slightly above its lowest point twice per swing, in steps of a large part of the swing. Energy
    !> gives the angle and the times between: 2 phi/omega, omega that of the lowest point.
    subroutine test_close_crossings(error)
        type(error_type), allocatable, intent(out) :: error
        character(len=16), parameter :: steppers(3) = [character(len=16) :: 'dopri5', 'dop853', 'radau5']
        real(wp), parameter :: start = 0.8_wp
        type(pendulum_type), target :: model
        type(threshold_event_type), target :: height
        type(simulation_type) :: simulation
        type(failure_type), allocatable :: failure
        real(wp) :: q(2), qd(2), omega, phi
        integer :: i, k

        call model%define()
        call model%start(start, 0.0_wp, q, qd)
        omega = sqrt(2*model%g/model%length*(1.0_wp - cos(start)))
        do k = 1, size(steppers)
            do i = 2, 8
                height = threshold_event_type(name='height', quantity='q', index=2, value=-model%length*(1.0_wp - 0.1_wp**i))
                call simulation%initialize(model, options_type(stepper=steppers(k), rtol=1.0e-4_wp), 0.0_wp, q, qd, failure)
                call simulation%add_event(height)
                ! One and a half periods, of which the amplitude makes each longer by 4 %.
                if (.not. allocated(failure)) call simulation%integrate(3*pi*sqrt(model%length/model%g)*1.04_wp, failure)
                call check_no_failure(error, failure)
                call check_count(error, simulation%n_events, 6, trim(steppers(k))//': crossings')
                if (allocated(error)) return
                phi = acos(1.0_wp - 0.1_wp**i)
                associate (event => simulation%events)
                    call check_true(error, all(event(1:5:2)%direction == -1) .and. all(event(2:6:2)%direction == 1), 'directions')
                    ! Errors of the steps change the height; close to the lowest point times change with its root.
                    if (i < 5) call check_below(error, maxval(abs(event(2:6:2)%t - event(1:5:2)%t - 2*phi/omega)), &
                        0.05_wp*phi/omega, trim(steppers(k))//': times between')
                end associate
                if (allocated(error)) return
            end do
        end do
    end subroutine test_close_crossings
end module test_quiet_events
