! SPDX-License-Identifier: MIT
!> Tests of the velocity of assembled starts: the nearest consistent one in the mass metric and by weights.
module test_nearest_velocity
    use asserts, only: check_below, check_close, check_failure, check_no_failure, check_text, check_true
    use faulty_runs, only: faults, start_swing, status_of_fault
    use kkt, only: kkt_type
    use model_curve, only: curve_type
    use model_knife_edge, only: knife_edge_type
    use model_moving_pivot, only: moving_pivot_type
    use model_sleigh, only: sleigh_type
    use model_spy, only: spy_type
    use subjects, only: new_subject, subject_names
    use tandem, only: assemble, assembly_type, failure_type => error_type, model_type, need_jacobian, need_nu, &
        terms_type, wp
    use terms_at, only: get_terms
    use testdrive, only: error_type, new_unittest, unittest_type
    use watch, only: natural_errors
    implicit none (type, external)
    private

    public :: collect_nearest_velocity

contains

    !> The suite.
    subroutine collect_nearest_velocity(testsuite)
        type(unittest_type), allocatable, intent(out) :: testsuite(:)

        testsuite = [ &
            new_unittest('nearest-velocity-in-the-mass-metric', test_mass_metric), &
            new_unittest('nearest-velocity-by-weights-and-with-some-fixed', test_weights), &
            new_unittest('singular-masses', test_singular_mass), &
            new_unittest('nonholonomic-rows', test_nonholonomic), &
            new_unittest('velocities-that-cannot-be', test_impossible_velocity), &
            new_unittest('faults', test_faults)]
    end subroutine collect_nearest_velocity

    !> Against the equations with multipliers, solved by elimination; M is singular in the disk and in the motorcycles.
    subroutine test_mass_metric(error)
        type(error_type), allocatable, intent(out) :: error
        class(model_type), allocatable, target :: model
        type(assembly_type) :: request
        type(failure_type), allocatable :: failure
        type(kkt_type) :: equations
        type(terms_type) :: terms
        real(wp), allocatable :: q(:), qd(:), expected(:)
        real(wp) :: errors(3)
        integer :: i, j, stat

        do i = 1, size(subject_names)
            call new_subject(subject_names(i), model, q, qd)
            equations%model => model
            qd = qd + [(cos(3.0_wp*j), j=1, size(qd))]
            expected = qd
            call equations%project(0.0_wp, q, expected)
            call assemble(model, request, 0.0_wp, q, qd, failure)
            call check_no_failure(error, failure)
            ! Numbers of up to 15, condition numbers of up to 1e3.
            call check_close(error, qd, expected, 1.0e-11_wp, 'qd of '//subject_names(i))
            call get_terms(model, 0.0_wp, q, qd, terms, stat)
            call natural_errors(terms, model%n_holonomic, spread(1.0_wp, 1, model%n), q, qd, 0*qd, errors)
            call check_below(error, errors(2), 1.0e-15_wp, 'velocity error')
        end do
    end subroutine test_mass_metric

    !> One row c: W (qd - qd0) = c' mu over the free entries, so qd = qd0 + W^-1 c' (nu - c qd0)/(c W^-1 c').
    subroutine test_weights(error)
        type(error_type), allocatable, intent(out) :: error
        type(sleigh_type), target :: model
        type(terms_type) :: terms
        type(assembly_type) :: request
        type(failure_type), allocatable :: failure
        real(wp), parameter :: q0(3) = [0.3_wp, -0.7_wp, 0.9_wp], qd0(3) = [1.0_wp, 0.5_wp, -2.0_wp]
        real(wp) :: q(3), qd(3), weights(3), step(3)
        integer :: k, stat

        call model%define(1.0_wp)
        do k = 1, 4
            request = assembly_type()
            weights = 1.0_wp
            if (k == 2) weights = [1.0_wp, 10.0_wp, 0.3_wp]
            ! The weights have no effect if the masses decide.
            if (k < 3) request%velocity_metric = 'weights'
            if (k > 1) request%weight_qd = [1.0_wp, 10.0_wp, 0.3_wp]
            if (k > 2) weights = [model%m, model%m, model%inertia]
            if (k == 4) request%fixed_qd = [.true., .false., .false.]
            q = q0
            qd = qd0
            call assemble(model, request, 0.4_wp, q, qd, failure)
            call check_no_failure(error, failure)
            call get_terms(model, 0.4_wp, q0, qd0, terms, stat)
            step = terms%jacobian(1, :)/weights
            if (k == 4) step(1) = 0.0_wp
            step = step*(terms%nu(1) - dot_product(terms%jacobian(1, :), qd0))/dot_product(terms%jacobian(1, :), step)
            call check_close(error, qd, qd0 + step, 1.0e-14_wp, 'qd')
            call check_close(error, request%moved_qd, step, 1.0e-14_wp, 'moved_qd')
            if (k == 4) call check_close(error, qd(:1), qd0(:1), 0.0_wp, 'the fixed velocity')
        end do
    end subroutine test_weights

    !> With mass in x alone only y changes; if the row does not contain y, y keeps its velocity by the weights; without any mass the
    !> weights decide.
    subroutine test_singular_mass(error)
        type(error_type), allocatable, intent(out) :: error
        type(curve_type), target :: model
        type(assembly_type) :: request
        type(failure_type), allocatable :: failure
        real(wp) :: q(2), qd(2), normal(2)

        call model%define()
        model%masses = [3.0_wp, 0.0_wp]
        q = [2*cos(0.4_wp), sin(0.4_wp)]
        qd = [1.0_wp, 1.0_wp]
        normal = q/model%axes**2
        call assemble(model, request, 0.0_wp, q, qd, failure)
        call check_no_failure(error, failure)
        call check_close(error, qd, [1.0_wp, -normal(1)/normal(2)], 1.0e-15_wp, 'qd')
        q = [2.0_wp, 0.0_wp]
        qd = [1.0_wp, 1.0_wp]
        call assemble(model, request, 0.0_wp, q, qd, failure)
        call check_no_failure(error, failure)
        call check_close(error, qd, [0.0_wp, 1.0_wp], 1.0e-15_wp, 'qd where nothing ties y')
        model%masses = 0.0_wp
        q = [2*cos(0.4_wp), sin(0.4_wp)]
        qd = [1.0_wp, 1.0_wp]
        request%weight_qd = [2.0_wp, 7.0_wp]
        call assemble(model, request, 0.0_wp, q, qd, failure)
        call check_no_failure(error, failure)
        call check_close(error, qd, 1.0_wp - normal/request%weight_qd*sum(normal)/sum(normal**2/request%weight_qd), 1.0e-15_wp, &
            'qd without masses')
    end subroutine test_singular_mass

    !> nh = 0: the position is unchanged, the slip is removed.
    subroutine test_nonholonomic(error)
        type(error_type), allocatable, intent(out) :: error
        type(knife_edge_type), target :: model
        type(assembly_type) :: request
        type(failure_type), allocatable :: failure
        real(wp), parameter :: q0(3) = [7.0_wp, -3.0_wp, 0.5_wp], qd0(3) = [2.0_wp, -1.0_wp, 0.3_wp]
        real(wp) :: q(3), qd(3), forward

        call model%define()
        q = q0
        qd = qd0
        call assemble(model, request, 0.0_wp, q, qd, failure)
        call check_no_failure(error, failure)
        call check_close(error, q, q0, 0.0_wp, 'q')
        forward = 2*cos(0.5_wp) - sin(0.5_wp)
        call check_close(error, qd, [forward*cos(0.5_wp), forward*sin(0.5_wp), 0.3_wp], 1.0e-15_wp, 'qd')
        call check_true(error, request%row_q == 0 .and. request%row_qd == 1, 'the blade moved qd')
        call check_true(error, request%is_nearest .and. request%iterations == 0, 'there was no position to look for')
    end subroutine test_nonholonomic

    !> Fixed velocities without a solution, in part or completely.
    subroutine test_impossible_velocity(error)
        type(error_type), allocatable, intent(out) :: error
        type(knife_edge_type), target :: model
        type(assembly_type) :: request
        type(failure_type), allocatable :: failure
        real(wp) :: q(3), qd(3)

        call model%define()
        q = [0.0_wp, 0.0_wp, 0.5_wp]
        qd = [1.0_wp, 2.0_wp, 0.0_wp]
        request%fixed_qd = [.true., .true., .false.]
        call assemble(model, request, 0.0_wp, q, qd, failure)
        call check_failure(error, failure, 'inconsistent_start', &
            'no velocity satisfies all constraints: "no slip" remains violated by 1.27')
        if (allocated(error)) return
        call check_text(error, failure%message, 'with fixed x, y;')
        call check_close(error, qd, [1.0_wp, 2.0_wp, 0.0_wp], 0.0_wp, 'qd')
        request%fixed_qd = .true.
        call assemble(model, request, 0.0_wp, q, qd, failure)
        call check_failure(error, failure, 'inconsistent_start', 'with fixed x, y, phi;')
    end subroutine test_impossible_velocity

    !> A procedure of the velocity constraints fails: a status, and the start is unchanged.
    subroutine test_faults(error)
        type(error_type), allocatable, intent(out) :: error
        type(moving_pivot_type), target :: inner
        type(spy_type), target :: spy
        type(assembly_type) :: request
        type(failure_type), allocatable :: failure
        real(wp) :: q0(2), qd0(2), q(2), qd(2)
        integer, parameter :: terms(2) = [need_jacobian, need_nu]
        character(len=8), parameter :: names(2) = [character(len=8) :: 'jacobian', 'nu']
        integer :: i, k

        call start_swing(inner, q0, qd0)
        qd0 = qd0 + 0.1_wp
        do i = 1, size(terms)
            do k = 1, size(faults)
                call spy%wrap(inner)
                spy%fault = faults(k)
                spy%fault_term = terms(i)
                q = q0
                qd = qd0
                call assemble(spy, request, 0.0_wp, q, qd, failure)
                call check_failure(error, failure, trim(status_of_fault(k)), trim(names(i)))
                call check_close(error, [q, qd], [q0, qd0], 0.0_wp, 'the start')
                if (allocated(error)) then
                    error%message = error%message//' ['//trim(names(i))//', '//trim(status_of_fault(k))//']'
                    return
                end if
            end do
        end do
    end subroutine test_faults
end module test_nearest_velocity
