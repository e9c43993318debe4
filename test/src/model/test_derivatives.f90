! SPDX-License-Identifier: MIT
!> Tests of the derivatives for implicit steps: those of the models, and the differences that replace missing ones, including gamma.
module test_derivatives
    use asserts, only: check_below, check_between, check_count, check_no_failure, check_true
    use differences, only: h, random_vector, weight
    use model_perturbed, only: perturbed_type
    use model_skater, only: single_names, skater_type
    use runs, only: run
    use subjects, only: new_subject, subject_names
    use tandem, only: derivative_name, derivatives_type, failure_type => error_type, long, model_type, n_derivatives, &
        need_all_derivatives, need_gamma, options_type, procedure_model_type, rolling_disk_type, simulation_type, &
        statistics_type, terms_type, wp
    use tandem_model_differences, only: differences_type
    use tandem_model_counts, only: counts_type
    use terms_at, only: get_terms
    use testdrive, only: error_type, new_unittest, test_failed, unittest_type
    implicit none (type, external)
    private

    public :: collect_derivatives

    !> Number of random points per model.
    integer, parameter :: n_points = 4

contains

    !> The suite.
    subroutine collect_derivatives(testsuite)
        type(unittest_type), allocatable, intent(out) :: testsuite(:)

        testsuite = [ &
            new_unittest('derivatives-of-the-models-agree-with-differences', test_models), &
            new_unittest('derivatives-that-are-not-asked-for-are-left-alone', test_need), &
            new_unittest('differences-stand-in-for-all-derivatives', test_stand_in), &
            new_unittest('differences-stand-in-for-single-derivatives', test_single), &
            new_unittest('differences-stand-in-for-some-fused-derivatives', test_some_fused), &
            new_unittest('single-procedures-and-none-give-the-same-solution', test_single_solutions), &
            new_unittest('with-and-without-derivatives-the-solution-is-the-same', test_solutions), &
            new_unittest('differences-stand-in-for-gamma', test_gamma), &
            new_unittest('a-run-without-gamma-reports-its-noise', test_gamma_run), &
            new_unittest('a-misprinted-gamma-qd-changes-no-solution', test_misprint)]
    end subroutine collect_derivatives

    !> C qd - nu, C qdd + gamma and M qdd + C' lambda - S - Q_A for constant qdd and lambda; C is multiplied by a constant `u`.
    subroutine residuals(model, t, q, qd, u, qdd, lambda, velocity, acceleration, dynamics)
        class(model_type), intent(inout) :: model
        real(wp), intent(in) :: t, q(:), qd(:), u(:), qdd(:), lambda(:)
        real(wp), intent(out) :: velocity(:), acceleration(:), dynamics(:)
        type(terms_type) :: terms
        integer :: stat

        call get_terms(model, t, q, qd, terms, stat)
        if (stat /= 0) error stop 'residuals: the model cannot be evaluated'
        velocity = matmul(terms%jacobian, u) - terms%nu
        acceleration = matmul(terms%jacobian, qdd) + terms%gamma
        dynamics = matmul(terms%mass, qdd) + matmul(lambda, terms%jacobian) - terms%force
    end subroutine residuals

    !> All five derivatives by differences that are independent of the library's.
    subroutine differentiate(model, t, q, qd, qdd, lambda, d)
        class(model_type), intent(inout) :: model
        real(wp), intent(in) :: t, q(:), qd(:), qdd(:), lambda(:)
        type(derivatives_type), intent(inout) :: d
        real(wp), dimension(size(lambda)) :: v_plus, v_minus, a_plus, a_minus
        real(wp), dimension(size(q)) :: f_plus, f_minus, e
        integer :: i, j

        call d%allocate(size(q), size(lambda))
        do j = 1, size(q)
            do i = 1, 3
                e = 0.0_wp
                e(j) = i*h
                call residuals(model, t, q + e, qd, qd, qdd, lambda, v_plus, a_plus, f_plus)
                call residuals(model, t, q - e, qd, qd, qdd, lambda, v_minus, a_minus, f_minus)
                d%velocity_q(:, j) = d%velocity_q(:, j) + weight(i)*(v_plus - v_minus)/h
                d%acceleration_q(:, j) = d%acceleration_q(:, j) + weight(i)*(a_plus - a_minus)/h
                d%dynamics_q(:, j) = d%dynamics_q(:, j) + weight(i)*(f_plus - f_minus)/h
                call residuals(model, t, q, qd + e, qd, qdd, lambda, v_plus, a_plus, f_plus)
                call residuals(model, t, q, qd - e, qd, qdd, lambda, v_minus, a_minus, f_minus)
                d%acceleration_qd(:, j) = d%acceleration_qd(:, j) + weight(i)*(a_plus - a_minus)/h
                d%dynamics_qd(:, j) = d%dynamics_qd(:, j) + weight(i)*(f_plus - f_minus)/h
            end do
        end do
    end subroutine differentiate

    !> Compare all five; errors are relative to the largest entry of each.
    subroutine compare(found, expected, tolerance, what, error)
        type(derivatives_type), intent(in) :: found, expected
        real(wp), intent(in) :: tolerance
        character(len=*), intent(in) :: what
        type(error_type), allocatable, intent(inout) :: error

        call compare_one(1, found%velocity_q, expected%velocity_q)
        call compare_one(2, found%acceleration_q, expected%acceleration_q)
        call compare_one(3, found%acceleration_qd, expected%acceleration_qd)
        call compare_one(4, found%dynamics_q, expected%dynamics_q)
        call compare_one(5, found%dynamics_qd, expected%dynamics_qd)

    contains

        subroutine compare_one(number, a, b)
            integer, intent(in) :: number
            real(wp), intent(in) :: a(:, :), b(:, :)

            call check_below(error, maxval(abs(a - b))/max(1.0_wp, maxval(abs(b))), tolerance, &
                what//': error of '//trim(derivative_name(number)))
        end subroutine compare_one
    end subroutine compare

    !> A random state around a start: (q, qd) off the constraints, accelerations and multipliers of some size.
    subroutine random_state(seed, q0, qd0, q, qd, qdd, lambda)
        integer, intent(inout) :: seed
        real(wp), intent(in) :: q0(:), qd0(:)
        real(wp), intent(out) :: q(:), qd(:), qdd(:), lambda(:)

        call random_vector(seed, q)
        call random_vector(seed, qd)
        call random_vector(seed, qdd)
        call random_vector(seed, lambda)
        q = q0 + 0.5_wp*q
        qd = qd0 + 2*qd
        qdd = 5*qdd
        lambda = 100*lambda
    end subroutine random_state

    !> The derivatives of a model's own procedures, fused or single, through the library.
    subroutine get_derivatives(model, t, q, qd, qdd, lambda, d, counts, error)
        class(model_type), intent(inout), target :: model
        real(wp), intent(in) :: t
        real(wp), intent(in), contiguous :: q(:), qd(:), qdd(:), lambda(:)
        type(derivatives_type), intent(inout) :: d
        type(counts_type), intent(inout) :: counts
        type(error_type), allocatable, intent(inout) :: error
        type(differences_type) :: stand_in
        integer :: stat

        call d%allocate(model%n, model%n_constraints())
        call stand_in%initialize(model, spread(1.0_wp, 1, model%n))
        call stand_in%evaluate_derivatives(t, q, qd, qdd, lambda, d, counts, stat)
        if (stat /= 0 .and. .not. allocated(error)) call test_failed(error, model%name//': no derivatives')
    end subroutine get_derivatives

    subroutine test_models(error)
        type(error_type), allocatable, intent(out) :: error
        class(model_type), allocatable :: model
        real(wp), allocatable :: q0(:), qd0(:), q(:), qd(:), qdd(:), lambda(:)
        type(derivatives_type) :: own, expected
        type(counts_type) :: counts
        real(wp) :: t(1)
        integer :: i, k, seed

        seed = 201
        do k = 1, size(subject_names)
            call new_subject(trim(subject_names(k)), model, q0, qd0)
            allocate (q, mold=q0)
            allocate (qd, mold=q0)
            allocate (qdd, mold=q0)
            allocate (lambda(model%n_constraints()))
            do i = 1, n_points
                call random_vector(seed, t)
                model%segment = 1 + i/n_points
                call random_state(seed, q0, qd0, q, qd, qdd, lambda)
                counts = counts_type()
                call get_derivatives(model, 3 + t(1), q, qd, qdd, lambda, own, counts, error)
                call check_true(error, counts%difference_evaluations == 0, 'the model needs no differences')
                call differentiate(model, 3 + t(1), q, qd, qdd, lambda, expected)
                ! Rounding eps/h and truncation h**6/140 are both 1e-14 of functions that are up to 1e2 times their gradients.
                call compare(own, expected, 1.0e-10_wp, trim(subject_names(k)), error)
            end do
            deallocate (q, qd, qdd, lambda)
        end do
    end subroutine test_models

    !> Each derivative separately, with a mark in all the others.
    subroutine test_need(error)
        type(error_type), allocatable, intent(out) :: error
        class(model_type), allocatable :: model
        real(wp), allocatable :: q(:), qd(:), qdd(:), lambda(:), q0(:), qd0(:)
        type(derivatives_type) :: all, one
        real(wp), parameter :: mark = 12345.0_wp
        integer :: i, k, seed, stat

        seed = 202
        do k = 1, size(subject_names) - 1
            call new_subject(trim(subject_names(k)), model, q0, qd0)
            allocate (q, mold=q0)
            allocate (qd, mold=q0)
            allocate (qdd, mold=q0)
            allocate (lambda(model%n_constraints()))
            call random_state(seed, q0, qd0, q, qd, qdd, lambda)
            call all%allocate(model%n, model%n_constraints())
            call model%evaluate_derivatives(need_all_derivatives, 1.0_wp, q, qd, qdd, lambda, all, stat)
            do i = 1, n_derivatives
                call one%allocate(model%n, model%n_constraints())
                one%velocity_q = mark
                one%acceleration_q = mark
                one%acceleration_qd = mark
                one%dynamics_q = mark
                one%dynamics_qd = mark
                call model%evaluate_derivatives(2**(i - 1), 1.0_wp, q, qd, qdd, lambda, one, stat)
                call check_one(i == 1, one%velocity_q, all%velocity_q)
                call check_one(i == 2, one%acceleration_q, all%acceleration_q)
                call check_one(i == 3, one%acceleration_qd, all%acceleration_qd)
                call check_one(i == 4, one%dynamics_q, all%dynamics_q)
                call check_one(i == 5, one%dynamics_qd, all%dynamics_qd)
            end do
            deallocate (q, qd, qdd, lambda)
        end do

    contains

        !> Equal to the complete set if requested, else the mark.
        subroutine check_one(wanted, found, expected)
            logical, intent(in) :: wanted
            real(wp), intent(in) :: found(:, :), expected(:, :)

            if (wanted) then
                call check_below(error, maxval(abs(found - expected)), 0.0_wp, trim(subject_names(k))//': '//derivative_name(i))
            else
                call check_below(error, maxval(abs(found - mark)), 0.0_wp, trim(subject_names(k))//': what was not asked for')
            end if
        end subroutine check_one
    end subroutine test_need

    !> Forward differences have errors of sqrt(eps) = 1.5e-8 times curvatures up to some tens of the largest entry.
    subroutine test_stand_in(error)
        type(error_type), allocatable, intent(out) :: error
        class(model_type), allocatable :: model
        real(wp), allocatable :: q0(:), qd0(:), q(:), qd(:), qdd(:), lambda(:)
        type(derivatives_type) :: own, stand_in
        type(counts_type) :: counts
        integer :: k, seed

        seed = 204
        do k = 1, size(subject_names) - 1
            call new_subject(trim(subject_names(k)), model, q0, qd0)
            allocate (q, mold=q0)
            allocate (qd, mold=q0)
            allocate (qdd, mold=q0)
            allocate (lambda(model%n_constraints()))
            call random_state(seed, q0, qd0, q, qd, qdd, lambda)
            call get_derivatives(model, 1.0_wp, q, qd, qdd, lambda, own, counts, error)
            counts = counts_type()
            model%provides_derivatives = 0
            call get_derivatives(model, 1.0_wp, q, qd, qdd, lambda, stand_in, counts, error)
            call compare(stand_in, own, 1.0e-6_wp, trim(subject_names(k)), error)
            ! One point and one displacement per coordinate, for q and for qd.
            call check_count(error, counts%difference_evaluations, 2*(model%n + 1), trim(subject_names(k))//': evaluations')
            ! Without forces, their derivative is known.
            call check_count(error, sum(counts%derivatives), merge(1, 0, subject_names(k) == 'vehicle'), &
                trim(subject_names(k))//': derivatives that need no differences')
            deallocate (q, qd, qdd, lambda)
        end do
    end subroutine test_stand_in

    !> Without one of the single procedures.
    subroutine remove(model, name)
        class(procedure_model_type), intent(inout) :: model
        character(len=*), intent(in) :: name

        select case (name)
        case ('jacobian_derivative')
            model%jacobian_derivative => null()
        case ('nu_derivative')
            model%nu_derivative => null()
        case ('gamma_q')
            model%gamma_q => null()
        case ('gamma_qd')
            model%gamma_qd => null()
        case ('mass_derivative')
            model%mass_derivative => null()
        case ('reaction_derivative')
            model%reaction_derivative => null()
        case ('force_q')
            model%force_q => null()
        case ('force_qd')
            model%force_qd => null()
        case default
            error stop 'remove: no such procedure'
        end select
    end subroutine remove

    !> All single procedures but one, and only one, each in turn.
    subroutine test_single(error)
        type(error_type), allocatable, intent(out) :: error
        type(skater_type), target :: model
        type(derivatives_type) :: own, stand_in
        type(counts_type) :: counts
        real(wp) :: q0(4), qd0(4), q(4), qd(4), qdd(4), lambda(2)
        integer :: i, j, seed

        seed = 205
        call model%define()
        call model%start(q0, qd0)
        call random_state(seed, q0, qd0, q, qd, qdd, lambda)
        call get_derivatives(model, 1.0_wp, q, qd, qdd, lambda, own, counts, error)
        call check_count(error, counts%difference_evaluations, 0, 'evaluations with every procedure')
        do i = 1, size(single_names)
            call model%define()
            call remove(model, trim(single_names(i)))
            counts = counts_type()
            call get_derivatives(model, 1.0_wp, q, qd, qdd, lambda, stand_in, counts, error)
            call compare(stand_in, own, 1.0e-6_wp, 'without '//trim(single_names(i)), error)
            ! The missing part depends on q or on qd, not on both.
            call check_count(error, counts%difference_evaluations, 5, 'evaluations without '//trim(single_names(i)))
            call model%define()
            do j = 1, size(single_names)
                if (j /= i) call remove(model, trim(single_names(j)))
            end do
            call get_derivatives(model, 1.0_wp, q, qd, qdd, lambda, stand_in, counts, error)
            call compare(stand_in, own, 1.0e-6_wp, 'with nothing but '//trim(single_names(i)), error)
        end do
    end subroutine test_single

    !> Every subset of the disk's five fused derivatives.
    subroutine test_some_fused(error)
        type(error_type), allocatable, intent(out) :: error
        type(rolling_disk_type), target :: model
        type(derivatives_type) :: own, stand_in
        type(counts_type) :: counts
        real(wp) :: q0(9), qd0(9), q(9), qd(9), qdd(9), lambda(6)
        integer :: mask, seed

        seed = 206
        call model%define()
        call model%start([-1.0_wp, 0.01_wp, 0.0_wp], 0.0_wp, q0, qd0)
        call random_state(seed, q0, qd0, q, qd, qdd, lambda)
        call get_derivatives(model, 1.0_wp, q, qd, qdd, lambda, own, counts, error)
        do mask = 0, need_all_derivatives
            model%provides_derivatives = mask
            counts = counts_type()
            call get_derivatives(model, 1.0_wp, q, qd, qdd, lambda, stand_in, counts, error)
            call compare(stand_in, own, 1.0e-6_wp, 'the disk with some derivatives', error)
            call check_count(error, sum(counts%derivatives), popcnt(mask), 'derivatives of its own')
        end do
    end subroutine test_some_fused

    !> Two runs of the same problem: the largest difference of q and qd at the end, and the second one's statistics.
    subroutine compare_runs(model, other, options, q, qd, t_end, difference, own, stand_in, error)
        class(model_type), intent(inout), target :: model, other
        type(options_type), intent(in) :: options
        real(wp), intent(in) :: q(:), qd(:), t_end
        real(wp), intent(out) :: difference
        type(statistics_type), intent(out) :: own, stand_in
        type(error_type), allocatable, intent(inout) :: error
        type(simulation_type) :: first, second
        type(failure_type), allocatable :: failure

        difference = huge(1.0_wp)
        call run(first, model, options, 0.0_wp, q, qd, t_end, failure)
        call check_no_failure(error, failure)
        call run(second, other, options, 0.0_wp, q, qd, t_end, failure)
        call check_no_failure(error, failure)
        if (allocated(error)) return
        difference = max(maxval(abs(first%state%q - second%state%q)), maxval(abs(first%state%qd - second%state%qd)))
        own = first%statistics()
        stand_in = second%statistics()
    end subroutine compare_runs

    subroutine test_single_solutions(error)
        type(error_type), allocatable, intent(out) :: error
        type(skater_type), target :: model, other
        type(statistics_type) :: own, stand_in
        type(options_type) :: options
        real(wp) :: q(4), qd(4), difference
        integer :: i, j, k

        call model%define()
        call model%start(q, qd)
        options%step = 1.0e-2_wp
        do k = 1, 2
            options%stepper = merge('sdirk54  ', 'trapezoid', k == 1)
            ! Without each of them, at last without any.
            do i = 1, size(single_names) + 1
                call other%define()
                do j = 1, size(single_names)
                    if (i == j .or. i > size(single_names)) call remove(other, trim(single_names(j)))
                end do
                call compare_runs(model, other, options, q, qd, 1.0_wp, difference, own, stand_in, error)
                ! 100 steps with remainders of Newton's iteration of 1e-14 each.
                call check_below(error, difference, 1.0e-11_wp, trim(options%stepper)//': difference of the solutions')
                call check_true(error, own%difference_evaluations == 0, 'no differences with every procedure')
                call check_true(error, stand_in%difference_evaluations > 0, 'differences without a procedure')
            end do
        end do
    end subroutine test_single_solutions

    subroutine test_solutions(error)
        type(error_type), allocatable, intent(out) :: error
        class(model_type), allocatable, target :: model, other
        type(statistics_type) :: own, stand_in
        type(options_type) :: options
        real(wp), allocatable :: q(:), qd(:)
        real(wp) :: difference
        integer :: k, i

        options%step = 5.0e-3_wp
        do i = 1, 2
            options%stepper = merge('sdirk54  ', 'trapezoid', i == 1)
            do k = 1, size(subject_names) - 1
                call new_subject(trim(subject_names(k)), model, q, qd)
                call new_subject(trim(subject_names(k)), other, q, qd)
                other%provides_derivatives = 0
                call compare_runs(model, other, options, q, qd, 0.5_wp, difference, own, stand_in, error)
                ! 100 steps with remainders of Newton's iteration of 1e-14 of speeds up to 15 each.
                call check_below(error, difference, 1.0e-10_wp, trim(subject_names(k))//': difference of the solutions')
                call check_true(error, own%difference_evaluations == 0, 'no differences with derivatives')
                ! Two points and a displacement per coordinate, for q and for qd, per Newton matrix.
                call check_count(error, stand_in%difference_evaluations, 2*(model%n + 1)*int(stand_in%newton_matrices), &
                    trim(subject_names(k))//': evaluations')
                ! Good enough: at most a tenth more corrections.
                call check_below(error, real(stand_in%newton_corrections, wp), 1.1_wp*real(own%newton_corrections, wp), &
                    trim(subject_names(k))//': corrections')
            end do
        end do
    end subroutine test_solutions

    !> A central difference of fourth order: rounding and truncation of 1e-12 to 1e-11 of the terms of a row, which are up to
    !> 1e2 times gamma.
    subroutine test_gamma(error)
        type(error_type), allocatable, intent(out) :: error
        class(model_type), allocatable, target :: model
        type(differences_type) :: stand_in
        type(terms_type) :: terms
        type(counts_type) :: counts
        real(wp), allocatable :: q0(:), qd0(:), q(:), qd(:), qdd(:), lambda(:), gamma(:)
        integer :: i, k, seed, stat

        seed = 207
        do k = 1, size(subject_names)
            call new_subject(trim(subject_names(k)), model, q0, qd0)
            allocate (q, mold=q0)
            allocate (qd, mold=q0)
            allocate (qdd, mold=q0)
            allocate (lambda(model%n_constraints()), gamma(model%n_constraints()))
            call stand_in%initialize(model, spread(1.0_wp, 1, model%n))
            do i = 1, n_points
                call random_state(seed, q0, qd0, q, qd, qdd, lambda)
                call get_terms(model, 1.0_wp, q, qd, terms, stat)
                counts = counts_type()
                call stand_in%evaluate_gamma(1.0_wp, q, qd, gamma, counts, stat)
                call check_count(error, stat, 0, 'status')
                call check_below(error, maxval(abs(gamma - terms%gamma))/max(1.0_wp, maxval(abs(terms%gamma))), 1.0e-9_wp, &
                    trim(subject_names(k))//': error of gamma')
                call check_count(error, counts%gamma_evaluations, 4, 'evaluations')
                call check_between(error, counts%gamma_noise, 1.0e-16_wp, 1.0e-9_wp, trim(subject_names(k))//': noise')
            end do
            deallocate (q, qd, qdd, lambda, gamma)
        end do
    end subroutine test_gamma

    subroutine test_gamma_run(error)
        type(error_type), allocatable, intent(out) :: error
        character(len=9), parameter :: steppers(3) = [character(len=9) :: 'rk4', 'trapezoid', 'sdirk54']
        type(rolling_disk_type), target :: model, other
        type(statistics_type) :: own, stand_in
        type(options_type) :: options
        real(wp) :: q(9), qd(9), difference
        integer :: k

        call model%define()
        call model%start([-1.0_wp, 0.01_wp, 0.0_wp], 0.0_wp, q, qd)
        options%step = 5.0e-3_wp
        do k = 1, size(steppers)
            options%stepper = steppers(k)
            call other%define()
            other%provides = other%provides - need_gamma
            call compare_runs(model, other, options, q, qd, 1.0_wp, difference, own, stand_in, error)
            ! An acceleration that is off by 1e-12 moves a second's motion by as much.
            call check_below(error, difference, 1.0e-10_wp, trim(steppers(k))//': difference of the solutions')
            call check_between(error, stand_in%gamma_noise, 1.0e-15_wp, 1.0e-11_wp, trim(steppers(k))//': noise')
            call check_below(error, own%gamma_noise, 0.0_wp, 'noise of the exact gamma')
        end do
    end subroutine test_gamma_run

    !> The disk with (69) corrected and as printed. Start values are so good, and matrices reused so long, that the cost of a run
    !> does not show the difference (6163 and 6176 corrections, 101 and 106 matrices); the contraction of a stage does, see above.
    subroutine test_misprint(error)
        type(error_type), allocatable, intent(out) :: error
        type(rolling_disk_type), target :: right, inner
        type(perturbed_type), target :: printed
        type(statistics_type) :: own, other
        type(options_type) :: options
        real(wp) :: q(9), qd(9), difference

        call right%define()
        call inner%define()
        call right%start([-1.0_wp, 0.01_wp, 0.0_wp], 0.0_wp, q, qd)
        call printed%wrap(inner)
        printed%as_printed = .true.
        options%stepper = 'sdirk54'
        options%step = 1.0e-2_wp
        call compare_runs(right, printed, options, q, qd, 4.0_wp, difference, own, other, error)
        if (allocated(error)) return
        ! 400 steps with remainders of Newton's iteration of 1e-14, times 30 for the weights of SDIRK54, times the growth, 30.
        call check_below(error, difference, 4.0e-9_wp, 'difference of the solutions')
        options%step = 1.0e-3_wp
        options%intol = 1.0e-10_wp
        call compare_runs(right, printed, options, q, qd, 1.0_wp, difference, own, other, error)
        if (allocated(error)) return
        ! Measured: 1.05, and 1.11 over ten seconds.
        call check_below(error, per_stage(own), 1.15_wp, 'corrections a stage with intol = 1e-10')
    end subroutine test_misprint

    !> Corrections per stage.
    pure real(wp) function per_stage(statistics)
        type(statistics_type), intent(in) :: statistics

        per_stage = real(statistics%newton_corrections, wp)/real(max(statistics%implicit_stages, 1_long), wp)
    end function per_stage
end module test_derivatives
