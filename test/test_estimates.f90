! SPDX-License-Identifier: MIT
!> What a run says about itself: that it is stiff, and how wrong it is.
module test_estimates
    use asserts, only: check_below, check_between, check_no_failure, check_true
    use model_stiff_pendulum, only: stiff_pendulum_type
    use runs, only: get_start, new_scene, run
    use tandem, only: failure_type => error_type, model_type, motorcycle_type, options_type, simulation_type, &
        statistics_type, wp
    use tandem_simulate_stiffness, only: stiffness_type
    use testdrive, only: error_type, new_unittest, unittest_type
    implicit none (type, external)
    private

    public :: collect_estimates

    character(len=16), parameter :: pairs(2) = [character(len=16) :: 'dopri5', 'dop853']

contains

    !> The tests of this suite.
    subroutine collect_estimates(testsuite)
        type(unittest_type), allocatable, intent(out) :: testsuite(:)

        testsuite = [ &
            new_unittest('fifteen-steps-at-the-limit-are-stiff', test_rule), &
            new_unittest('a-stiff-pendulum-is-noticed', test_stiff_pendulum), &
            new_unittest('a-stiff-suspension-is-noticed', test_stiff_suspension), &
            new_unittest('fixed-steps-near-the-limit-are-noticed', test_stiff_rk4), &
            new_unittest('what-is-not-stiff-gives-no-alarm', test_not_stiff)]
    end subroutine collect_estimates

    subroutine test_rule(error)
        type(error_type), allocatable, intent(out) :: error
        type(stiffness_type) :: stiffness
        integer :: i

        ! Five others in a row are forgiven, six are not.
        do i = 1, 14
            call stiffness%observe(real(i, wp), .true.)
        end do
        do i = 15, 20
            call stiffness%observe(real(i, wp), .false.)
        end do
        do i = 21, 27
            call stiffness%observe(real(i, wp), .true.)
        end do
        do i = 28, 32
            call stiffness%observe(real(i, wp), .false.)
        end do
        do i = 33, 39
            call stiffness%observe(real(i, wp), .true.)
        end do
        call check_true(error, .not. stiffness%is_stiff, 'fourteen are not enough')
        if (allocated(error)) return
        call stiffness%observe(40.0_wp, .true.)
        call check_true(error, stiffness%is_stiff .and. stiffness%steps == 29, 'fifteen are')
        if (allocated(error)) return
        call check_between(error, stiffness%since, 21.0_wp, 21.0_wp, 'the first of the fifteen')
    end subroutine test_rule

    !> Frequency ratio 1e6, damping ratio 0.5: the transient takes microseconds, then 3.4/lambda is the largest step.
    subroutine test_stiff_pendulum(error)
        type(error_type), allocatable, intent(out) :: error
        type(stiff_pendulum_type), target :: model
        type(simulation_type) :: simulation
        type(statistics_type) :: statistics
        type(options_type) :: options
        type(failure_type), allocatable :: failure
        real(wp), parameter :: length = 1.0001_wp
        integer :: i, k

        model%k = 9.81e12_wp
        model%c = sqrt(model%k)
        call model%define()
        do i = 1, size(pairs)
            do k = 4, 6, 2
                options%stepper = pairs(i)
                options%rtol = 10.0_wp**(-k)
                call run(simulation, model, options, 0.0_wp, [length, 0.0_wp, length], [0.0_wp, 0.0_wp, 0.0_wp], 5.0e-4_wp, failure)
                call check_no_failure(error, failure)
                if (allocated(error)) return
                statistics = simulation%statistics()
                call check_true(error, statistics%is_stiff, trim(pairs(i))//': not noticed')
                if (allocated(error)) return
                ! Damping exp(-sqrt(k) t/2) leaves of the transient 1e-4 ... 1e-10 by then; seen: 3e-5 to 8e-5.
                call check_between(error, statistics%stiff_from, 5.0e-6_wp, 2.0e-4_wp, trim(pairs(i))//': since when')
                if (allocated(error)) return
            end do
        end do
    end subroutine test_stiff_pendulum

    !> The motorcycle with k and c times 1000.
    subroutine test_stiff_suspension(error)
        type(error_type), allocatable, intent(out) :: error
        class(model_type), allocatable, target :: model
        type(simulation_type) :: simulation
        type(statistics_type) :: statistics
        type(options_type) :: options
        type(failure_type), allocatable :: failure
        real(wp), allocatable :: q(:), qd(:)
        integer :: i

        call new_scene('motorcycle', model)
        call get_start('motorcycle', q, qd)
        select type (model)
        class is (motorcycle_type)
            model%free_length = model%spring_length()
            model%stiffness = 1000*model%stiffness
            model%damping = 1000*model%damping
        end select
        do i = 1, size(pairs)
            options%stepper = pairs(i)
            options%rtol = 1.0e-6_wp
            call run(simulation, model, options, 0.0_wp, q, qd, 0.1_wp, failure)
            call check_no_failure(error, failure)
            if (allocated(error)) return
            statistics = simulation%statistics()
            call check_true(error, statistics%is_stiff, trim(pairs(i))//': not noticed')
            if (allocated(error)) return
            call check_true(error, 2*statistics%stiff_steps > statistics%steps, trim(pairs(i))//': most steps are at the limit')
            if (allocated(error)) return
        end do
    end subroutine test_stiff_suspension

    !> The limit is h = 2.79/2.7e4; a tenth of the step is far from it.
    subroutine test_stiff_rk4(error)
        type(error_type), allocatable, intent(out) :: error
        class(model_type), allocatable, target :: model
        type(simulation_type) :: simulation
        type(statistics_type) :: statistics
        type(options_type) :: options
        type(failure_type), allocatable :: failure
        real(wp), allocatable :: q(:), qd(:)
        real(wp), parameter :: steps(2) = [1.0e-4_wp, 1.0e-5_wp]
        integer :: i

        call new_scene('motorcycle', model)
        call get_start('motorcycle', q, qd)
        select type (model)
        class is (motorcycle_type)
            model%free_length = model%spring_length()
            model%stiffness = 1000*model%stiffness
            model%damping = 1000*model%damping
        end select
        do i = 1, size(steps)
            options%step = steps(i)
            call run(simulation, model, options, 0.0_wp, q, qd, 0.01_wp, failure)
            call check_no_failure(error, failure)
            if (allocated(error)) return
            statistics = simulation%statistics()
            call check_true(error, statistics%is_stiff .eqv. i == 1, 'noticed at the limit and only there')
            if (allocated(error)) return
        end do
    end subroutine test_stiff_rk4

    !> Every tolerance from 1e-4 to 1e-12.
    subroutine test_not_stiff(error)
        type(error_type), allocatable, intent(out) :: error
        character(len=10), parameter :: scenes(3) = [character(len=10) :: 'disk', 'vehicle', 'heavy_top']
        class(model_type), allocatable, target :: model
        type(simulation_type) :: simulation
        type(statistics_type) :: statistics
        type(options_type) :: options
        type(failure_type), allocatable :: failure
        real(wp), allocatable :: q(:), qd(:)
        integer :: i, k, scene

        do scene = 1, size(scenes)
            call new_scene(trim(scenes(scene)), model)
            call get_start(trim(scenes(scene)), q, qd)
            do i = 1, size(pairs)
                do k = 4, 12, 2
                    options%stepper = pairs(i)
                    options%rtol = 10.0_wp**(-k)
                    call run(simulation, model, options, 0.0_wp, q, qd, 2.0_wp, failure)
                    call check_no_failure(error, failure)
                    if (allocated(error)) return
                    statistics = simulation%statistics()
                    ! Seen: no step at all.
                    call check_true(error, .not. statistics%is_stiff .and. statistics%stiff_steps < 5, &
                        trim(scenes(scene))//', '//trim(pairs(i))//': false alarm')
                    if (allocated(error)) return
                end do
            end do
        end do
    end subroutine test_not_stiff
end module test_estimates
