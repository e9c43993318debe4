! SPDX-License-Identifier: MIT
!> Tests of the Newton matrix of implicit stages: the Jacobian (76), (77) of the residual against differences, its contraction, and
!> its reuse in further steps.
module test_newton_matrix
    use asserts, only: check_below, check_close, check_count, check_no_failure, check_true
    use differences, only: h, random_vector, weight
    use model_perturbed, only: perturbed_type
    use runs, only: run
    use subjects, only: new_subject, subject_names
    use stage_corrections, only: correct_stage
    use tandem, only: failure_type => error_type, model_type, options_type, rolling_disk_type, simulation_type, terms_type, wp
    use tandem_linalg_basis, only: basis_type
    use tandem_linalg_lu, only: lu_type
    use tandem_chart, only: step_end
    use tandem_chart_dense, only: dense_chart_type
    use terms_at, only: get_terms
    use testdrive, only: error_type, new_unittest, test_failed, unittest_type
    implicit none (type, external)
    private

    public :: collect_newton_matrix

    !> A chart, its bases, and the point of differentiation.
    type :: stage_point_type
        type(dense_chart_type) :: chart
        real(wp) :: t = 0.0_wp
        real(wp), allocatable :: v_basis(:, :), w_basis(:, :), x_basis(:, :), v(:), w(:), wd(:), lambda(:)
    end type stage_point_type

contains

    !> The suite.
    subroutine collect_newton_matrix(testsuite)
        type(unittest_type), allocatable, intent(out) :: testsuite(:)

        testsuite = [ &
            new_unittest('jacobian-of-the-residual-agrees-with-differences', test_jacobian), &
            new_unittest('right-gamma-qd-contracts-quadratically', test_contraction), &
            new_unittest('a-kept-matrix-serves-another-chart-and-another-step', test_kept_matrix)]
    end subroutine collect_newton_matrix

    !> r1 = -V' qd and r2 = M qdd + C' lambda - S - Q_A (53) as functions of v and w, for constant wd and lambda:
    !> q(v) and qd(v, w) by the chart, qdd = W wd - X y with C qdd = -gamma, the rest from the terms.
    subroutine residual(point, model, v, w, r1, r2)
        type(stage_point_type), intent(inout) :: point
        class(model_type), intent(inout) :: model
        real(wp), intent(in) :: v(:), w(:)
        real(wp), intent(out) :: r1(:), r2(:)
        type(terms_type) :: terms
        type(lu_type) :: lu
        real(wp) :: q(model%n), qd(model%n), qdd(model%n), y(model%n_constraints())
        integer :: stat(5)

        call point%chart%restore(point%t, matmul(point%v_basis, v), matmul(point%w_basis, w), step_end, q, qd, stat(1))
        stat(2) = 0
        call get_terms(model, point%t, q, qd, terms, stat(3))
        qdd = matmul(point%w_basis, point%wd)
        y = matmul(terms%jacobian, qdd) + terms%gamma
        call lu%allocate(size(y))
        call lu%factor(matmul(terms%jacobian, point%x_basis), stat(4))
        call lu%solve(y)
        qdd = qdd - matmul(point%x_basis, y)
        r1 = -matmul(qd, point%v_basis)
        r2 = matmul(terms%mass, qdd) + matmul(point%lambda, terms%jacobian) - terms%force
        stat(5) = maxval(abs(stat(:4)))
        if (stat(5) /= 0) error stop 'residual: the point is off the chart'
    end subroutine residual

    !> Move a subject to a time, make a chart there, and go to a random point of it with random velocities.
    subroutine enter_stage(model, q0, qd0, t, seed, point, error)
        class(model_type), intent(inout), target :: model
        real(wp), intent(in) :: q0(:), qd0(:), t
        integer, intent(inout) :: seed
        type(stage_point_type), intent(inout) :: point
        type(error_type), allocatable, intent(inout) :: error
        type(simulation_type) :: simulation
        type(basis_type) :: basis
        type(terms_type) :: terms
        type(failure_type), allocatable :: failure
        type(options_type) :: options
        real(wp), dimension(size(q0)) :: q, qd, qdd
        integer :: n, nh, m, stat(5)

        n = model%n
        nh = model%n_holonomic
        m = model%n_constraints()
        options%step = 5.0e-3_wp
        call run(simulation, model, options, 0.0_wp, q0, qd0, t, failure)
        call check_no_failure(error, failure)
        if (allocated(error)) return
        point%t = t
        call point%chart%attach(model, options, .true., .true., failure)
        qdd = 0.0_wp
        call point%chart%set_origin(t, simulation%state%q, simulation%state%qd, .false., qdd, stat(1))
        ! The bases of the chart are private; the same factorisation gives the same ones.
        call get_terms(model, t, simulation%state%q, simulation%state%qd, terms, stat(2))
        call basis%allocate(n, nh, m)
        call basis%factor_qr(terms%jacobian, spread(1.0_wp, 1, n), n)
        point%v_basis = basis%q(:, nh + 1:)
        point%w_basis = basis%q(:, m + 1:)
        point%x_basis = basis%q(:, :m)
        point%v = spread(0.0_wp, 1, n - nh)
        point%w = spread(0.0_wp, 1, n - m)
        call random_vector(seed, point%v)
        call random_vector(seed, point%w)
        point%v = 0.1_wp*point%v
        point%w = 0.5_wp*point%w
        call point%chart%restore(t, matmul(point%v_basis, point%v), matmul(point%w_basis, point%w), step_end, q, qd, stat(3))
        call point%chart%accelerate(t, q, qd, step_end, qdd, stat(4))
        point%wd = matmul(qdd, point%w_basis)
        point%lambda = spread(0.0_wp, 1, m)
        call point%chart%find_multipliers(t, q, qd, qdd, point%lambda, stat(5))
        if (any(stat /= 0)) call test_failed(error, model%name//': the point is off the chart')
        call point%chart%factor(t, q, qd, qdd, 1.0e-3_wp, [complex(wp) ::], stat(1))
        if (stat(1) /= 0) call test_failed(error, model%name//': no Newton matrix')
    end subroutine enter_stage

    subroutine test_jacobian(error)
        type(error_type), allocatable, intent(out) :: error
        class(model_type), allocatable :: model
        type(stage_point_type), allocatable :: point
        real(wp), allocatable :: q0(:), qd0(:)
        integer :: i, k, seed

        seed = 203
        do k = 1, size(subject_names)
            call new_subject(trim(subject_names(k)), model, q0, qd0)
            do i = 1, 2
                allocate (point)
                call enter_stage(model, q0, qd0, 0.4_wp*i, seed, point, error)
                if (.not. allocated(error)) call check_blocks(point, model, trim(subject_names(k)), error)
                if (allocated(error)) return
                deallocate (point)
            end do
        end do
    end subroutine test_jacobian

    !> R1_v, R1_w, R2_v and R2_w against differences, relative to the largest entry of (R1; R2)_(v, w) in each equation.
    subroutine check_blocks(point, model, name, error)
        type(stage_point_type), intent(inout) :: point
        class(model_type), intent(inout) :: model
        character(len=*), intent(in) :: name
        type(error_type), allocatable, intent(inout) :: error
        !> Truncation h**6/140 is below 1e-14; the constraints, solved to 1e-12, cause errors of 1e-12/h = 1e-10 of the residual's
        !> size.
        real(wp), parameter :: tolerance = 1.0e-8_wp
        real(wp) :: r1(size(point%v), 2), r2(model%n, 2)
        real(wp) :: e1(size(point%v)), e2(size(point%w))
        real(wp) :: d1(size(point%v), size(point%v) + size(point%w)), d2(model%n, size(point%v) + size(point%w))
        integer :: i, j, nv

        nv = size(point%v)
        d1 = 0.0_wp
        d2 = 0.0_wp
        do j = 1, nv + size(point%w)
            do i = 1, 3
                e1 = 0.0_wp
                e2 = 0.0_wp
                if (j <= nv) e1(j) = i*h
                if (j > nv) e2(j - nv) = i*h
                call residual(point, model, point%v + e1, point%w + e2, r1(:, 1), r2(:, 1))
                call residual(point, model, point%v - e1, point%w - e2, r1(:, 2), r2(:, 2))
                d1(:, j) = d1(:, j) + weight(i)*(r1(:, 1) - r1(:, 2))/h
                d2(:, j) = d2(:, j) + weight(i)*(r2(:, 1) - r2(:, 2))/h
            end do
        end do
        associate (stage => point%chart%stage)
            call check_below(error, maxval(abs(stage%r1_v - d1(:, :nv)))/maxval(abs(d1)), tolerance, name//': error of R1_v')
            call check_below(error, maxval(abs(stage%r1_w - d1(:, nv + 1:)))/maxval(abs(d1)), tolerance, name//': error of R1_w')
            call check_below(error, maxval(abs(stage%r2_v - d2(:, :nv)))/maxval(abs(d2)), tolerance, name//': error of R2_v')
            call check_below(error, maxval(abs(stage%r2_w - d2(:, nv + 1:)))/maxval(abs(d2)), tolerance, name//': error of R2_w')
        end associate
    end subroutine check_blocks

    !> Newton's matrix made at the stage itself: the right one contracts quadratically, that of (69) by a factor that a second
    !> correction shows. The disk after a second, h = 0.02, from rates with errors of 1e-2.
    subroutine test_contraction(error)
        type(error_type), allocatable, intent(out) :: error
        type(rolling_disk_type), target :: right, inner
        type(perturbed_type), target :: printed
        real(wp) :: left_right(3), left_printed(3)

        call right%define()
        call inner%define()
        call printed%wrap(inner)
        printed%as_printed = .true.
        call measure_contraction(right, right, left_right, error)
        call measure_contraction(printed, right, left_printed, error)
        ! Measured: 5e-5, 2e-9, 2e-11 with the right one, 5e-5, 6e-8, 2e-11 as printed. The third contains the errors that
        ! the second iterate left in the constraints, which are squares of the first correction.
        call check_below(error, left_right(2), 2*left_right(1)**2, 'the second correction with the right gamma_qd')
        call check_below(error, left_right(3), 1.0e-10_wp, 'the third correction with the right gamma_qd')
        call check_below(error, 10*left_right(2), left_printed(2), 'ten times the second correction')
    end subroutine test_contraction

    !> The size of three corrections of a stage.
    subroutine measure_contraction(model, starter, change, error)
        class(model_type), intent(inout), target :: model
        type(rolling_disk_type), intent(inout), target :: starter
        real(wp), intent(out) :: change(3)
        type(error_type), allocatable, intent(inout) :: error
        !> h a_ii of SDIRK54.
        real(wp), parameter :: ha = 0.25_wp*0.02_wp
        type(simulation_type) :: simulation
        type(dense_chart_type), allocatable :: chart
        type(options_type) :: options
        type(failure_type), allocatable :: failure
        real(wp), dimension(9) :: q, qd, qdd, rate_q, rate_qd, noise
        integer :: k, seed, stat

        change = huge(1.0_wp)
        call starter%start([-1.0_wp, 0.01_wp, 0.0_wp], 0.0_wp, q, qd)
        call run(simulation, starter, options, 0.0_wp, q, qd, 1.0_wp, failure)
        call check_no_failure(error, failure)
        if (allocated(error)) return
        allocate (chart)
        associate (state => simulation%state)
            call chart%attach(model, options, .true., .true., failure)
            noise = 0.0_wp
            call chart%set_origin(state%t, state%q, state%qd, .false., noise, stat)
            rate_q = state%qd
            rate_qd = state%qdd
            call chart%restore(state%t + ha, ha*rate_q, ha*rate_qd, step_end, q, qd, stat)
            call chart%accelerate(state%t + ha, q, qd, step_end, qdd, stat)
            call chart%factor(state%t + ha, q, qd, qdd, ha, [complex(wp) ::], stat)
            seed = 208
            call random_vector(seed, noise)
            rate_q = rate_q + 1.0e-2_wp*noise
            call random_vector(seed, noise)
            rate_qd = rate_qd + 1.0e-2_wp*noise
            do k = 1, 3
                call correct_stage(chart, k == 1, state%t + ha, ha, q, qd, rate_q, rate_qd, change(k), stat)
            end do
        end associate
        if (stat /= 0 .and. .not. allocated(error)) call test_failed(error, 'the stage cannot be solved')
    end subroutine measure_contraction

    !> A matrix of the disk at 1 s, used for a stage 0.02 s later, on the chart there and for a step half as large again: no
    !> derivatives, one factorisation, the same solution as with a new one. Not in another segment of the model.
    subroutine test_kept_matrix(error)
        type(error_type), allocatable, intent(out) :: error
        type(rolling_disk_type), target :: disk
        type(simulation_type) :: simulation
        type(dense_chart_type), allocatable :: chart
        type(options_type) :: options
        type(failure_type), allocatable :: failure
        !> h a_ii of SDIRK54.
        real(wp), parameter :: ha = 0.25_wp*0.01_wp
        real(wp) :: q(9), qd(9), found_q(9, 2), found_qd(9, 2), rate_q(9), rate_qd(9), change(8, 2)
        integer :: i, k, stat
        logical :: can

        call disk%define()
        call disk%start([-1.0_wp, 0.01_wp, 0.0_wp], 0.0_wp, q, qd)
        call run(simulation, disk, options, 0.0_wp, q, qd, 1.0_wp, failure)
        call check_no_failure(error, failure)
        if (allocated(error)) return
        allocate (chart)
        associate (state => simulation%state)
            call chart%attach(disk, options, .true., .true., failure)
            call chart%reuse(ha, [complex(wp) ::], can)
            rate_q = 0.0_wp
            call check_true(error, .not. can, 'there is no matrix yet')
            call chart%set_origin(state%t, state%q, state%qd, .false., rate_q, stat)
            call chart%factor(state%t, state%q, state%qd, state%qdd, ha/1.5_wp, [complex(wp) ::], stat)
            call simulation%integrate(1.02_wp, failure)
            call chart%set_origin(state%t, state%q, state%qd, .false., rate_q, stat)
            do i = 1, 2
                if (i == 1) call chart%reuse(ha, [complex(wp) ::], can)
                if (i == 2) call chart%factor(state%t, state%q, state%qd, state%qdd, ha, [complex(wp) ::], stat)
                call check_true(error, can .and. stat == 0, 'there is a matrix')
                call check_count(error, chart%counts%newton_matrices, i, 'matrices')
                call check_count(error, chart%counts%newton_factorizations, i + 1, 'factorizations')
                q = state%q
                rate_q = state%qd
                rate_qd = state%qdd
                do k = 1, size(change, 1)
                    call correct_stage(chart, k == 1, state%t + ha, ha, q, qd, rate_q, rate_qd, change(k, i), stat)
                end do
                found_q(:, i) = q
                found_qd(:, i) = qd
            end do
            disk%segment = 2
            call chart%reuse(ha, [complex(wp) ::], can)
            disk%segment = 1
        end associate
        call check_true(error, .not. can, 'a matrix of another segment')
        ! Measured: 1.3e-3 and 1.6e-4.
        call check_below(error, maxval(change(2:4, 1)/change(1:3, 1)), 3.0e-3_wp, 'contraction of the old matrix')
        call check_below(error, maxval(change(2:3, 2)/change(1:2, 2)), 5.0e-4_wp, 'contraction of a new one')
        call check_close(error, found_q(:, 1), found_q(:, 2), 1.0e-14_wp, 'q')
        call check_close(error, found_qd(:, 1), found_qd(:, 2), 1.0e-13_wp, 'qd')
    end subroutine test_kept_matrix
end module test_newton_matrix
