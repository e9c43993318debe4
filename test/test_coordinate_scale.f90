! SPDX-License-Identifier: MIT
!> Tests that results do not depend on the unit of length where the model states its scales.
module test_coordinate_scale
    use asserts, only: check_below, check_no_failure, check_true
    use model_pendulum, only: pendulum_type
    use model_rod, only: rod_type
    use runs, only: choose, run
    use tandem, only: chart_policies, failure_type => error_type, options_type, refresh_modes, simulation_type, statistics_type, wp
    use testdrive, only: error_type, new_unittest, unittest_type
    implicit none (type, external)
    private

    public :: collect_coordinate_scale

contains

    !> The suite.
    subroutine collect_coordinate_scale(testsuite)
        type(unittest_type), allocatable, intent(out) :: testsuite(:)

        testsuite = [ &
            new_unittest('pendulum-in-millimetres-moves-as-in-metres', test_pendulum), &
            new_unittest('rod-in-millimetres-moves-as-in-metres', test_rod), &
            new_unittest('rod-in-kilometres-moves-as-in-metres', test_kilometres), &
            new_unittest('policies-and-modes-see-scaled-coordinates', test_policies), &
            new_unittest('implicit-steps-see-scaled-coordinates', test_implicit), &
            new_unittest('without-scales-the-unit-matters', test_without)]
    end subroutine collect_coordinate_scale

    !> Swing a rod from the same angle in some unit; the result in metres.
    subroutine swing_rod(units, with_scale, options, q, charts, error)
        !> Units of length in a metre.
        real(wp), intent(in) :: units
        logical, intent(in) :: with_scale
        type(options_type), intent(in) :: options
        real(wp), intent(out) :: q(3)
        integer, intent(out) :: charts
        type(error_type), allocatable, intent(inout) :: error
        type(rod_type), target :: model
        type(simulation_type) :: simulation
        type(statistics_type) :: statistics
        type(failure_type), allocatable :: failure
        real(wp) :: q0(3), qd0(3)

        model%units = units
        call model%define()
        if (with_scale) model%coordinate_scale = [units, units, 1.0_wp]
        call model%start(1.0_wp, 2.0_wp, q0, qd0)
        call run(simulation, model, options, 0.0_wp, q0, qd0, 2.0_wp, failure)
        call check_no_failure(error, failure)
        statistics = simulation%statistics()
        charts = int(statistics%charts)
        q = simulation%state%q/[units, units, 1.0_wp]
    end subroutine swing_rod

    subroutine test_pendulum(error)
        type(error_type), allocatable, intent(out) :: error
        type(pendulum_type), target :: metres, millimetres
        type(simulation_type) :: first, second
        type(failure_type), allocatable :: failure
        real(wp) :: q(2), qd(2)

        call metres%define()
        call metres%start(1.0_wp, 2.0_wp, q, qd)
        call run(first, metres, choose(step=1.0e-2_wp), 0.0_wp, q, qd, 2.0_wp, failure)
        call check_no_failure(error, failure)
        millimetres%units = 1000.0_wp
        call millimetres%define()
        millimetres%coordinate_scale = [1000.0_wp, 1000.0_wp]
        call millimetres%start(1.0_wp, 2.0_wp, q, qd)
        call run(second, millimetres, choose(step=1.0e-2_wp), 0.0_wp, q, qd, 2.0_wp, failure)
        call check_no_failure(error, failure)
        ! Truncation is 1e-6 here, and the same in both: what differs is rounding, and where an iteration stops.
        call check_below(error, maxval(abs(second%state%q/1000 - first%state%q)), 1.0e-12_wp, 'difference of q')
        call check_below(error, maxval(abs(second%state%qd/1000 - first%state%qd)), 1.0e-11_wp, 'difference of qd')
    end subroutine test_pendulum

    subroutine test_rod(error)
        type(error_type), allocatable, intent(out) :: error

        call check_unit(1000.0_wp, choose(step=1.0e-2_wp), error)
    end subroutine test_rod

    subroutine test_kilometres(error)
        type(error_type), allocatable, intent(out) :: error

        call check_unit(1.0e-3_wp, choose(step=1.0e-2_wp), error)
    end subroutine test_kilometres

    !> The rod in a unit against the rod in metres.
    subroutine check_unit(units, options, error)
        real(wp), intent(in) :: units
        type(options_type), intent(in) :: options
        type(error_type), allocatable, intent(inout) :: error
        real(wp) :: q(3), expected(3)
        integer :: charts, charts_expected

        call swing_rod(1.0_wp, .true., options, expected, charts_expected, error)
        call swing_rod(units, .true., options, q, charts, error)
        call check_below(error, maxval(abs(q - expected)), 1.0e-12_wp, 'difference of q with '//trim(options%chart)//', '// &
            options%refresh)
        call check_true(error, charts == charts_expected, 'the number of charts is the same')
    end subroutine check_unit

    subroutine test_policies(error)
        type(error_type), allocatable, intent(out) :: error
        type(options_type) :: options
        integer :: i, j

        do i = 1, size(chart_policies)
            do j = 1, size(refresh_modes)
                options = choose(step=1.0e-2_wp, chart=chart_policies(i), refresh=refresh_modes(j), v_limit=0.4_wp)
                options%w_limit = 2.0_wp
                call check_unit(1000.0_wp, options, error)
            end do
        end do
    end subroutine test_policies

    !> Newton's iteration stops by scaled coordinates too: the runs differ by what it leaves, 1e-14 a stage.
    subroutine test_implicit(error)
        type(error_type), allocatable, intent(out) :: error
        type(options_type) :: options
        integer :: i

        do i = 1, size(chart_policies)
            options = choose(step=1.0e-2_wp, chart=chart_policies(i), stepper='sdirk54', v_limit=0.4_wp)
            call check_unit(1000.0_wp, options, error)
            options%stepper = 'trapezoid'
            call check_unit(1.0e-3_wp, options, error)
        end do
    end subroutine test_implicit

    !> The guard of the tests above: a basis that is orthonormal in mixed units gives another truncation error.
    subroutine test_without(error)
        type(error_type), allocatable, intent(out) :: error
        real(wp) :: q(3), expected(3)
        integer :: charts

        call swing_rod(1.0_wp, .false., choose(step=1.0e-2_wp), expected, charts, error)
        call swing_rod(1000.0_wp, .false., choose(step=1.0e-2_wp), q, charts, error)
        call check_true(error, maxval(abs(q - expected)) > 1.0e-10_wp, 'without scales the results differ')
    end subroutine test_without
end module test_coordinate_scale
