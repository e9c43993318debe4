! SPDX-License-Identifier: MIT
!> Tests of the accuracy of RK4 and of implicit steppers against the reference solutions, and of all steppers on the motorcycles
!> against an independent solution by the index-1 equations with multipliers.
!>
!> Bounds are the measured errors of order and step, with a margin of two; truncation errors hardly depend on the machine. If
!> rounding, the constraint tolerance or the remainder of Newton's iteration dominates, the margin is ten.
module test_accuracy
    use asserts, only: check_below, check_close, check_count, check_no_failure
    use kkt, only: kkt_type, solve_independently
    use reference, only: read_reference
    use runs, only: choose, get_start, new_scene, run
    use tandem, only: failure_type => error_type, model_type, simulation_type, stepper_names, wp
    use testdrive, only: error_type, new_unittest, unittest_type
    use watch, only: energy_watch_type, reference_watch_type
    implicit none (type, external)
    private

    public :: collect_accuracy

    real(wp), parameter :: two_pi = 8*atan(1.0_wp)

contains

    !> The suite.
    subroutine collect_accuracy(testsuite)
        type(unittest_type), allocatable, intent(out) :: testsuite(:)

        testsuite = [ &
            new_unittest('scenes-with-rk4-agree-with-their-references', test_rk4), &
            new_unittest('vehicle-with-sdirk54-agrees-with-its-reference', test_vehicle_sdirk54), &
            new_unittest('vehicle-with-the-trapezoid-agrees-with-its-reference', test_vehicle_trapezoid), &
            new_unittest('disk-with-sdirk54-agrees-with-its-reference', test_disk_sdirk54), &
            new_unittest('disk-with-the-trapezoid-agrees-with-its-reference', test_disk_trapezoid), &
            new_unittest('heavy-top-with-implicit-steps-agrees-with-its-reference', test_heavy_top), &
            new_unittest('knife-edge-with-implicit-steps-agrees-with-its-reference', test_knife_edge), &
            new_unittest('stiff-pendulum-with-implicit-steps-agrees-with-its-reference', test_stiff_pendulum), &
            new_unittest('the-independent-solution-agrees-with-a-reference', test_independent), &
            new_unittest('motorcycle-with-all-steppers-agrees-with-an-independent-solution', test_motorcycle), &
            new_unittest('chopper-with-all-steppers-agrees-with-an-independent-solution', test_chopper), &
            new_unittest('motorcycles-change-lanes-and-keep-their-energy', test_lane_change)]
    end subroutine collect_accuracy

    !> Run a scene with default options but stepper and step, and compare with the reference at all its times.
    subroutine compare(scene, stepper, step, t_end, rows, bounds, error, final_bound)
        character(len=*), intent(in) :: scene, stepper
        real(wp), intent(in) :: step, t_end
        !> Required number of common rows of the table.
        integer, intent(in) :: rows
        !> Bounds for q and qd, and optionally relative ones for qdd and lambda.
        real(wp), intent(in) :: bounds(:)
        type(error_type), allocatable, intent(inout) :: error
        !> Bound for q at t_end.
        real(wp), intent(in), optional :: final_bound
        class(model_type), allocatable, target :: model
        type(simulation_type) :: simulation
        type(reference_watch_type) :: watch
        type(failure_type), allocatable :: failure

        call new_scene(scene, model)
        call read_reference(scene, watch%table)
        ! The vehicle's acceleration jumps there: the table has its left limit, the simulation its right one.
        if (scene == 'vehicle') watch%skip_acceleration_at = two_pi
        associate (table => watch%table)
            call run(simulation, model, choose(step=step, stepper=stepper), table%t(1), table%q(:, 1), table%qd(:, 1), t_end, &
                failure, watch)
            call check_no_failure(error, failure)
            call check_count(error, watch%met, rows, 'rows of the table that were met')
            call check_below(error, watch%q, bounds(1), scene//' with '//stepper//': error of q')
            call check_below(error, watch%qd, bounds(2), scene//' with '//stepper//': error of qd')
            if (size(bounds) > 2) then
                call check_below(error, watch%qdd, bounds(3), scene//' with '//stepper//': relative error of qdd')
                call check_below(error, watch%lambda, bounds(4), scene//' with '//stepper//': relative error of lambda')
            end if
            if (present(final_bound) .and. .not. allocated(error)) call check_close(error, simulation%state%q, &
                table%q_at(t_end), final_bound, scene//' with '//stepper//': q at the end')
        end associate
    end subroutine compare

    subroutine test_rk4(error)
        type(error_type), allocatable, intent(out) :: error

        ! At h = 1e-3 the error is rounding and the constraint tolerance, 1e-12 of 150 m; 1e-9 is guaranteed at t = 10.
        call compare('vehicle', 'rk4', 1.0e-3_wp, 10.0_wp, 42, [3.0e-11_wp, 1.0e-11_wp, 2.0e-12_wp, 2.0e-11_wp], error, 1.0e-9_wp)
        ! Perturbations grow by 1e2 to 1e3 up to t = 10 and peak in the dips; 5e-7 is guaranteed at t = 10.
        call compare('disk', 'rk4', 1.0e-3_wp, 10.0_wp, 21, [2.0e-6_wp, 1.2e-5_wp, 5.0e-6_wp, 2.0e-6_wp], error, 5.0e-7_wp)
        ! At 60 rad/s a step of 1e-3 turns the top by 0.06 rad.
        call compare('heavy_top', 'rk4', 1.0e-3_wp, 2.0_wp, 11, [5.0e-7_wp, 1.6e-5_wp, 9.0e-7_wp, 6.0e-7_wp], error)
        ! Rounding at h = 1e-3, truncation at h = 1e-2.
        call compare('knife_edge', 'rk4', 1.0e-3_wp, 10.0_wp, 10, [1.0e-11_wp, 1.0e-11_wp, 1.0e-11_wp, 1.5e-11_wp], error)
        call compare('knife_edge', 'rk4', 1.0e-2_wp, 10.0_wp, 10, [9.0e-9_wp, 2.0e-9_wp, 1.1e-9_wp, 9.0e-10_wp], error)
        ! The spring's 3132 rad/s need h < 9e-4; at 1e-4 (h lambda = 0.31) the phase error of its oscillation of 1e-3 m is 1 %.
        call compare('stiff_pendulum', 'rk4', 1.0e-4_wp, 0.5_wp, 7, [2.5e-5_wp, 7.0e-2_wp, 4.0_wp, 3.0_wp], error)
        call compare('stiff_pendulum', 'rk4', 2.5e-5_wp, 0.5_wp, 7, [1.0e-7_wp, 3.0e-4_wp, 1.7e-2_wp, 1.2e-2_wp], error)
    end subroutine test_rk4

    !> At h = 1e-3 the error is the remainder of Newton's iteration, 1e-14 of 150 m per stage; 1e-9 is guaranteed at t = 10.
    subroutine test_vehicle_sdirk54(error)
        type(error_type), allocatable, intent(out) :: error

        call compare('vehicle', 'sdirk54', 1.0e-3_wp, 10.0_wp, 42, [3.0e-10_wp, 3.0e-10_wp, 7.0e-10_wp, 1.0e-9_wp], error, &
            1.0e-9_wp)
    end subroutine test_vehicle_sdirk54

    !> h = 2e-3, order two.
    subroutine test_vehicle_trapezoid(error)
        type(error_type), allocatable, intent(out) :: error

        call compare('vehicle', 'trapezoid', 2.0e-3_wp, 10.0_wp, 42, [3.0e-6_wp, 9.0e-7_wp, 2.2e-7_wp, 1.8e-5_wp], error)
    end subroutine test_vehicle_trapezoid

    !> The remainder of Newton's iteration grows by 1e4 and more in the dips; 5e-7 is guaranteed at t = 10.
    subroutine test_disk_sdirk54(error)
        type(error_type), allocatable, intent(out) :: error

        call compare('disk', 'sdirk54', 1.0e-3_wp, 10.0_wp, 21, [3.0e-6_wp, 2.0e-5_wp, 8.0e-6_wp, 3.0e-6_wp], error, 5.0e-7_wp)
    end subroutine test_disk_sdirk54

    !> h = 1e-4; 1e-4 is guaranteed at t = 10.
    subroutine test_disk_trapezoid(error)
        type(error_type), allocatable, intent(out) :: error

        call compare('disk', 'trapezoid', 1.0e-4_wp, 10.0_wp, 21, [4.0e-5_wp, 2.7e-4_wp, 1.0e-4_wp, 4.0e-5_wp], error, 1.0e-4_wp)
    end subroutine test_disk_trapezoid

    !> At 60 rad/s a step of 1e-3 turns the top by 0.06 rad.
    subroutine test_heavy_top(error)
        type(error_type), allocatable, intent(out) :: error

        call compare('heavy_top', 'sdirk54', 1.0e-3_wp, 2.0_wp, 11, [2.7e-7_wp, 1.0e-5_wp, 6.0e-7_wp, 2.0e-7_wp], error)
        call compare('heavy_top', 'trapezoid', 1.0e-3_wp, 2.0_wp, 11, [1.0e-2_wp, 0.3_wp, 1.3e-2_wp, 3.0e-3_wp], error)
        call compare('heavy_top', 'trapezoid', 5.0e-4_wp, 2.0_wp, 11, [2.5e-3_wp, 0.075_wp, 3.2e-3_wp, 7.5e-4_wp], error)
    end subroutine test_heavy_top

    subroutine test_knife_edge(error)
        type(error_type), allocatable, intent(out) :: error

        call compare('knife_edge', 'sdirk54', 2.0e-2_wp, 10.0_wp, 10, [1.3e-8_wp, 1.8e-8_wp, 1.0e-8_wp, 9.0e-9_wp], error)
        call compare('knife_edge', 'sdirk54', 1.0e-2_wp, 10.0_wp, 10, [9.0e-10_wp, 1.1e-9_wp, 6.0e-10_wp, 5.0e-10_wp], error)
        call compare('knife_edge', 'trapezoid', 2.0e-2_wp, 10.0_wp, 10, [6.0e-3_wp, 1.5e-3_wp, 8.0e-4_wp, 7.0e-4_wp], error)
        call compare('knife_edge', 'trapezoid', 1.0e-2_wp, 10.0_wp, 10, [1.5e-3_wp, 3.7e-4_wp, 2.0e-4_wp, 1.7e-4_wp], error)
    end subroutine test_knife_edge

    !> h lambda = 0.16 and 0.08 for the spring's 3132 rad/s; the trapezoid loses the phase of its oscillation of 1e-3 m.
    subroutine test_stiff_pendulum(error)
        type(error_type), allocatable, intent(out) :: error

        call compare('stiff_pendulum', 'sdirk54', 5.0e-5_wp, 0.5_wp, 7, [1.8e-7_wp, 4.5e-4_wp, 2.8e-2_wp, 2.0e-2_wp], error)
        call compare('stiff_pendulum', 'sdirk54', 2.5e-5_wp, 0.5_wp, 7, [1.1e-8_wp, 2.8e-5_wp, 1.8e-3_wp, 1.3e-3_wp], error)
        call compare('stiff_pendulum', 'trapezoid', 2.5e-5_wp, 0.5_wp, 7, [1.7e-4_wp, 0.5_wp], error)
    end subroutine test_stiff_pendulum

    !> The control of the tests below: the independent solver against the vehicle's reference, through the kink at 2 pi.
    subroutine test_independent(error)
        type(error_type), allocatable, intent(out) :: error
        class(model_type), allocatable, target :: model
        type(reference_watch_type) :: watch
        real(wp), allocatable :: q(:), qd(:)

        call new_scene('vehicle', model)
        call read_reference('vehicle', watch%table)
        call get_start('vehicle', q, qd)
        call solve_independently(model, 0.0_wp, 10.0_wp, 0.05_wp, q, qd)
        associate (table => watch%table)
            ! Rounding of 200 macro steps at 150 m, 3e-14 each, with weights of up to ten in the tableau, integrated over 10 s.
            call check_close(error, q, table%q_at(10.0_wp), 5.0e-10_wp, 'q')
            call check_close(error, qd, table%qd_at(10.0_wp), 5.0e-11_wp, 'qd')
        end associate
    end subroutine test_independent

    !> All steppers at t = 10 against the independent solution, and RK4 against SDIRK54.
    subroutine check_motorcycle(scene, error)
        character(len=*), intent(in) :: scene
        type(error_type), allocatable, intent(inout) :: error
        !> Guaranteed for the steppers of order four; error of order two at h = 2e-3, 1.4e-6 after 150 m, with a margin of two.
        real(wp), parameter :: promised = 1.0e-9_wp, order_two = 2.8e-6_wp
        class(model_type), allocatable, target :: model
        type(simulation_type) :: simulation
        type(kkt_type) :: independent
        type(failure_type), allocatable :: failure
        real(wp), allocatable :: q(:), qd(:), q_end(:), qd_end(:)
        real(wp) :: qdd(10), lambda(8), found(8), final(10, size(stepper_names)), bound
        character(len=:), allocatable :: name
        integer :: i

        call new_scene(scene, model)
        call get_start(scene, q, qd)
        allocate (q_end, source=q)
        allocate (qd_end, source=qd)
        call solve_independently(model, 0.0_wp, 10.0_wp, 0.05_wp, q_end, qd_end)
        independent%model => model
        call independent%accelerate(10.0_wp, q_end, qd_end, qdd, lambda)
        do i = 1, size(stepper_names)
            name = trim(stepper_names(i))
            bound = merge(order_two, promised, name == 'trapezoid')
            call run(simulation, model, choose(step=merge(2.0e-3_wp, 1.0e-3_wp, name == 'trapezoid'), stepper=name), 0.0_wp, &
                q, qd, 10.0_wp, failure)
            call check_no_failure(error, failure)
            call simulation%multipliers(found)
            final(:, i) = simulation%state%q
            call check_close(error, simulation%state%q, q_end, bound, scene//' with '//name//': q')
            ! It rolls straight ahead by then: velocities and forces are those of the equilibrium and the heading.
            call check_close(error, simulation%state%qd, qd_end, 1.0e-10_wp, scene//' with '//name//': qd')
            call check_close(error, simulation%state%qdd, qdd, 1.0e-10_wp, scene//' with '//name//': qdd')
            call check_below(error, maxval(abs(found - lambda))/maxval(abs(lambda)), 1.0e-11_wp, scene//' with '//name// &
                ': relative error of lambda')
            if (allocated(error)) return
        end do
        call check_close(error, final(:, findloc(stepper_names, 'rk4', dim=1)), &
            final(:, findloc(stepper_names, 'sdirk54', dim=1)), promised, scene//': q with rk4 and with sdirk54')
    end subroutine check_motorcycle

    subroutine test_motorcycle(error)
        type(error_type), allocatable, intent(out) :: error

        call check_motorcycle('motorcycle', error)
    end subroutine test_motorcycle

    subroutine test_chopper(error)
        type(error_type), allocatable, intent(out) :: error

        call check_motorcycle('chopper', error)
    end subroutine test_chopper

    !> Steering does work: the energy is not quite constant.
    subroutine test_lane_change(error)
        type(error_type), allocatable, intent(out) :: error
        character(len=10), parameter :: scenes(2) = [character(len=10) :: 'motorcycle', 'chopper']
        !> The paper's figures; guaranteed for the standard one, and effect of steering on the chopper.
        real(wp), parameter :: lane(2) = [4.18_wp, 4.12_wp], bound(2) = [1.0e-6_wp, 2.1e-6_wp]
        class(model_type), allocatable, target :: model
        type(simulation_type) :: simulation
        type(energy_watch_type) :: watch
        type(failure_type), allocatable :: failure
        real(wp), allocatable :: q(:), qd(:)
        integer :: i

        do i = 1, 2
            call new_scene(trim(scenes(i)), model)
            call get_start(trim(scenes(i)), q, qd)
            call run(simulation, model, choose(step=2.0e-3_wp), 0.0_wp, q, qd, 10.0_wp, failure, watch)
            call check_no_failure(error, failure)
            call check_below(error, abs(simulation%state%q(1) - q(1) - lane(i)), 5.0e-3_wp, trim(scenes(i))//': lane change')
            call check_below(error, watch%deviation, bound(i), trim(scenes(i))//': deviation of the energy')
        end do
    end subroutine test_lane_change
end module test_accuracy
