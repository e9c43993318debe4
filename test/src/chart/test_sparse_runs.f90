! SPDX-License-Identifier: MIT
!> Tests of the sparse chart in a run besides the motion: dense output, checkpoints, a profile, dropped rows; its choice, and its
!> refusals.
module test_sparse_runs
    use asserts, only: check_below, check_close, check_count, check_failure, check_no_failure, check_true
    use large_mechanisms, only: make_large
    use large_runs, only: begin, check_resumption, check_timed, controlled, go_on, scenes, start
    use tandem, only: failure_type => error_type, long, mechanism_type, options_type, simulation_type, statistics_type, &
        terms_type, wp
    use tandem_chart_sparse, only: sparse_chart_type
    use tandem_chart_sparse_factor, only: factor_type
    use tandem_pack, only: pack_type
    use terms_at, only: get_terms
    use testdrive, only: error_type, new_unittest, unittest_type
    implicit none (type, external)
    private

    public :: collect_sparse_runs

contains

    !> The suite.
    subroutine collect_sparse_runs(testsuite)
        type(unittest_type), allocatable, intent(out) :: testsuite(:)

        testsuite = [ &
            new_unittest('dense-output', test_dense_output), &
            new_unittest('checkpoint', test_checkpoint), &
            new_unittest('factor-of-a-checkpoint', test_factor_of_checkpoint), &
            new_unittest('choice', test_choice), &
            new_unittest('profile', test_profile), &
            new_unittest('redundant-rows', test_redundant), &
            new_unittest('redundant-rows-of-a-door', test_door), &
            new_unittest('partners-of-redundant-rows', test_partners), &
            new_unittest('refusals', test_refusals)]
    end subroutine collect_sparse_runs

    !> Between steps the constraints are satisfied as at their ends, the motion is that of the dense chart, and dense output does
    !> not change the run.
    subroutine test_dense_output(error)
        type(error_type), allocatable, intent(out) :: error
        type(mechanism_type), target :: one, two, three
        type(simulation_type) :: sparse, dense, blind
        type(failure_type), allocatable :: failure

        call begin('spatial_chain', 12, controlled(1.0e-10_wp, 'sparse'), one, sparse, error)
        call begin('spatial_chain', 12, controlled(1.0e-10_wp, 'sparse'), three, blind, error)
        call begin('spatial_chain', 12, controlled(1.0e-10_wp, 'dense'), two, dense, error)
        if (allocated(error)) return
        do while (sparse%state%t < 0.1_wp)
            call sparse%step(1.0_wp, failure)
            call check_no_failure(error, failure)
            call blind%step(1.0_wp, failure)
            call check_no_failure(error, failure)
            if (allocated(error)) return
            call sparse%look_at(sparse%state%t - 0.3_wp*sparse%last_step, failure)
            call check_no_failure(error, failure)
            call check_below(error, maxval(sparse%errors), 1.0e-12_wp, 'errors between steps')
            if (allocated(error)) return
            if (sparse%state%t > 0.08_wp) exit
            call sparse%look_back()
        end do
        call go_on(dense, sparse%state%t, error)
        call check_close(error, sparse%state%q, dense%state%q, 1.0e-8_wp, 'q between steps')
        call sparse%look_back()
        call check_true(error, all(abs(sparse%state%q - blind%state%q) <= 0.0_wp), 'a look changes the steps')
    end subroutine test_dense_output

    !> With fixed and with controlled steps.
    subroutine test_checkpoint(error)
        type(error_type), allocatable, intent(out) :: error
        integer :: i

        do i = 1, size(scenes)
            call check_resumption(trim(scenes(i)), options_type(step=1.0e-3_wp, chart_kind='sparse'), error)
            if (.not. allocated(error)) call check_resumption(trim(scenes(i)), controlled(1.0e-9_wp, 'sparse'), error)
            if (allocated(error)) return
        end do
    end subroutine test_checkpoint

    !> A restored factor contains the remainders of dropped rows, by which a loss of rank is judged.
    subroutine test_factor_of_checkpoint(error)
        type(error_type), allocatable, intent(out) :: error
        type(factor_type) :: factor, again
        type(pack_type) :: pack
        integer(long), allocatable :: words(:)
        character(len=64) :: problem

        allocate (factor%is_out(1), again%is_out(1), source=.false.)
        factor%rest = 0.25_wp
        factor%loosest = 7
        call pack%begin_writing()
        call factor%pack_state(pack)
        call pack%end_writing('factor', words)
        call pack%begin_reading('factor', words, problem)
        call again%pack_state(pack)
        call check_close(error, [again%rest], [factor%rest], 0.0_wp, 'rest')
        call check_count(error, again%loosest, factor%loosest, 'loosest')
    end subroutine test_factor_of_checkpoint

    !> Few bodies get the dense chart, many the sparse one, and unsupported ones the dense one: with two thousand bodies charts
    !> whose memory grows with the square of the bodies could not start.
    subroutine test_choice(error)
        type(error_type), allocatable, intent(out) :: error
        type(mechanism_type), target :: mechanism
        type(simulation_type) :: simulation
        type(statistics_type) :: statistics
        integer :: i, n

        call begin('planar_chain', 3, options_type(step=1.0e-3_wp), mechanism, simulation, error)
        call go_on(simulation, 0.01_wp, error)
        if (allocated(error)) return
        statistics = simulation%statistics()
        call check_true(error, statistics%basis_factorizations > 0, 'few bodies have a sparse chart')
        call begin('spatial_chain', 2000, options_type(step=1.0e-3_wp), mechanism, simulation, error)
        call go_on(simulation, 0.002_wp, error)
        if (allocated(error)) return
        statistics = simulation%statistics()
        call check_true(error, statistics%basis_factorizations == 0, 'many bodies have a dense chart')
        ! Implicit steps.
        call begin('planar_chain', 25, options_type(stepper='sdirk54', step=1.0e-3_wp), mechanism, simulation, error)
        call go_on(simulation, 0.002_wp, error)
        if (allocated(error)) return
        ! Few bodies and many, with explicit steps, with implicit ones, and under error control.
        do i = 1, 6
            mechanism = mechanism_type()
            n = merge(3, 25, modulo(i, 2) == 1)
            select case (i)
            case (1, 2)
                call begin('planar_chain', n, options_type(step=1.0e-3_wp), mechanism, simulation, error)
            case (3, 4)
                call begin('planar_chain', n, options_type(stepper='sdirk54', step=1.0e-3_wp), mechanism, simulation, error)
            case default
                call begin('planar_chain', n, controlled(1.0e-6_wp, 'automatic'), mechanism, simulation, error)
            end select
            if (allocated(error)) return
            call check_true(error, simulation%is_sparse .eqv. modulo(i, 2) == 0, 'another chart was chosen')
            call check_true(error, simulation%cost%sparse < simulation%cost%dense .eqv. modulo(i, 2) == 0, &
                'the other chart is estimated to cost less')
        end do
        ! Redundant rows do not matter.
        mechanism = mechanism_type()
        call draw_parallelograms(3, mechanism, error)
        if (.not. allocated(error)) call start(mechanism, options_type(step=1.0e-3_wp), simulation, error)
        if (allocated(error)) return
        call check_true(error, simulation%is_sparse, 'three parallelograms have a dense chart')
        call check_count(error, simulation%n_redundant, 3, 'redundant rows')
    end subroutine test_choice

    !> A body on two hinges of the same axis: the redundant rows and the motion are the same on both charts.
    subroutine test_door(error)
        type(error_type), allocatable, intent(out) :: error
        real(wp), parameter :: along(3) = [0.0_wp, 1.0_wp, 0.0_wp], inertia(3) = [0.1_wp, 0.2_wp, 0.3_wp]
        character(len=6), parameter :: kinds(2) = [character(len=6) :: 'sparse', 'dense']
        type(mechanism_type), target :: mechanism(2)
        type(simulation_type) :: simulation(2)
        type(failure_type), allocatable :: failure
        integer :: i, k

        do i = 1, 2
            call mechanism(i)%add_body('door', 1.0_wp, [0.5_wp, 0.0_wp, 0.0_wp], failure, inertia=inertia)
            do k = 1, 2
                if (.not. allocated(failure)) call mechanism(i)%add_joint('hinge'//achar(iachar('0') + k), 'revolute', 'ground', &
                    'door', failure, at=[0.0_wp, 0.3_wp*k, 0.0_wp], axis=along)
            end do
            if (.not. allocated(failure)) call mechanism(i)%define(failure)
            call check_no_failure(error, failure)
            if (.not. allocated(error)) call start(mechanism(i), controlled(1.0e-10_wp, trim(kinds(i))), simulation(i), error)
            if (allocated(error)) return
            call check_count(error, simulation(i)%n_redundant, 5, 'redundant rows')
            call check_true(error, simulation(i)%is_sparse .eqv. i == 1, 'the other chart')
            call go_on(simulation(i), 0.2_wp, error)
            if (allocated(error)) return
        end do
        call check_close(error, simulation(1)%state%q, simulation(2)%state%q, 1.0e-9_wp, 'q')
    end subroutine test_door

    !> With the chart that the program chooses.
    subroutine test_profile(error)
        type(error_type), allocatable, intent(out) :: error

        call check_timed('spatial_chain', options_type(step=1.0e-3_wp), error)
    end subroutine test_profile

    !> Parallelograms in space on three hinges and a ball joint, with one redundant row each: as many rows are dropped and named,
    !> the motion is that of the dense chart, and a continued run is bitwise equal.
    subroutine test_redundant(error)
        type(error_type), allocatable, intent(out) :: error
        integer, parameter :: n = 5
        type(mechanism_type), target :: one, two, three
        type(simulation_type) :: sparse, dense, again
        type(failure_type), allocatable :: failure
        integer(long), allocatable :: words(:)
        real(wp), allocatable :: of_sparse(:), of_dense(:)
        integer :: i

        call draw_parallelograms(n, one, error)
        call draw_parallelograms(n, two, error)
        call draw_parallelograms(n, three, error)
        if (allocated(error)) return
        call start(one, controlled(1.0e-12_wp, 'sparse'), sparse, error)
        call start(two, controlled(1.0e-12_wp, 'dense'), dense, error)
        call start(three, controlled(1.0e-12_wp, 'sparse'), again, error)
        if (allocated(error)) return
        call check_count(error, sparse%n_redundant, n, 'rows left out')
        call check_count(error, size(sparse%warnings), n, 'warnings')
        if (allocated(error)) return
        do i = 1, size(sparse%warnings)
            call check_true(error, index(sparse%warnings(i)%text, 'repeats') > 0, 'a warning tells of no redundant row')
        end do
        call go_on(sparse, 0.1_wp, error)
        if (allocated(error)) return
        call sparse%save_state(words, failure)
        call check_no_failure(error, failure)
        call again%restore_state(words, failure)
        call check_no_failure(error, failure)
        call go_on(sparse, 0.2_wp, error)
        call go_on(again, 0.2_wp, error)
        call go_on(dense, 0.2_wp, error)
        if (allocated(error)) return
        call check_close(error, sparse%state%q, dense%state%q, 1.0e-10_wp, 'q')
        allocate (of_sparse(one%n_constraints()), of_dense(two%n_constraints()))
        call sparse%multipliers(of_sparse)
        call dense%multipliers(of_dense)
        call check_close(error, of_sparse, of_dense, 1.0e-9_wp*maxval(abs(of_dense)), 'multipliers of least norm')
        call check_true(error, all(abs(sparse%state%q - again%state%q) <= 0.0_wp), 'it goes on otherwise')
    end subroutine test_redundant

    !> They stand side by side.
    subroutine draw_parallelograms(n, mechanism, error)
        integer, intent(in) :: n
        type(mechanism_type), intent(inout) :: mechanism
        type(error_type), allocatable, intent(inout) :: error
        type(failure_type), allocatable :: failure
        real(wp), parameter :: along(3) = [0.0_wp, 1.0_wp, 0.0_wp], inertia(3) = [0.1_wp, 0.2_wp, 0.3_wp]
        character(len=1) :: number
        real(wp) :: y
        integer :: i

        mechanism%gravity = [3.0_wp, 0.0_wp, -9.81_wp]
        do i = 1, n
            if (allocated(error)) return
            write (number, '(i0)') i
            y = i
            call mechanism%add_body('a'//number, 1.0_wp, [0.0_wp, y, 0.5_wp], failure, inertia=inertia)
            call check_no_failure(error, failure)
            call mechanism%add_body('b'//number, 1.0_wp, [0.5_wp, y, 1.0_wp], failure, inertia=inertia)
            call check_no_failure(error, failure)
            call mechanism%add_body('c'//number, 1.0_wp, [1.0_wp, y, 0.5_wp], failure, inertia=inertia)
            call check_no_failure(error, failure)
            call mechanism%add_joint('j'//number, 'revolute', 'ground', 'a'//number, failure, at=[0.0_wp, y, 0.0_wp], axis=along)
            call check_no_failure(error, failure)
            call mechanism%add_joint('k'//number, 'revolute', 'a'//number, 'b'//number, failure, at=[0.0_wp, y, 1.0_wp], axis=along)
            call check_no_failure(error, failure)
            call mechanism%add_joint('l'//number, 'revolute', 'b'//number, 'c'//number, failure, at=[1.0_wp, y, 1.0_wp], axis=along)
            call check_no_failure(error, failure)
            call mechanism%add_joint('m'//number, 'spherical', 'c'//number, 'ground', failure, at=[1.0_wp, y, 0.0_wp])
            call check_no_failure(error, failure)
        end do
        call mechanism%define(failure)
        call check_no_failure(error, failure)
    end subroutine draw_parallelograms

    !> Each dropped row is a combination of exactly the rows it is reported to repeat, by C itself: for separate parallelograms, and
    !> for equal cranks on one coupler, whose combinations all include it.
    subroutine test_partners(error)
        type(error_type), allocatable, intent(out) :: error
        type(mechanism_type), target :: mechanism, cranks

        call draw_parallelograms(9, mechanism, error)
        if (.not. allocated(error)) call check_partners(mechanism, 9, error)
        if (.not. allocated(error)) call draw_cranks(12, cranks, error)
        if (.not. allocated(error)) call check_partners(cranks, 10, error)
    end subroutine test_partners

    !> All rows dropped at the start.
    subroutine check_partners(mechanism, expected, error)
        type(mechanism_type), intent(inout), target :: mechanism
        integer, intent(in) :: expected
        type(error_type), allocatable, intent(inout) :: error
        type(sparse_chart_type) :: chart
        type(terms_type) :: terms
        type(failure_type), allocatable :: failure
        real(wp), dimension(mechanism%n) :: q, qd, dq
        integer, allocatable :: start(:), partners(:), norms(:)
        integer :: i, k, stat

        call mechanism%start(q, qd)
        call chart%attach(mechanism, options_type(stepper='rk4'), .false., .false., failure)
        call check_no_failure(error, failure)
        if (allocated(error)) return
        dq = 0.0_wp
        call chart%set_origin(0.0_wp, q, qd, .false., dq, stat)
        call chart%leave_out_dependent(0.0_wp, q, qd, stat)
        call check_count(error, stat, 0, 'status')
        call check_count(error, chart%n_dropped, expected, 'rows left out')
        if (allocated(error)) return
        call chart%find_partners(chart%left_out, start, partners)
        call get_terms(mechanism, 0.0_wp, q, qd, terms, stat)
        ! Euler parameters remain normed whichever rows of joints are dropped.
        norms = pack([(i, i=1, size(terms%phi))], [(index(mechanism%row_name(i), ' norm') > 0, i=1, size(terms%phi))])
        do i = 1, expected
            associate (its => partners(start(i):start(i + 1) - 1), row => chart%left_out(i))
                call check_below(error, rest_of(terms%jacobian, [norms, its], row), 1.0e-10_wp, 'what partners leave')
                do k = 1, size(its)
                    call check_true(error, rest_of(terms%jacobian, [norms, its(:k - 1), its(k + 1:)], row) > 1.0e-3_wp, &
                        'a partner is none')
                end do
            end associate
            if (allocated(error)) return
        end do
    end subroutine check_partners

    !> Length of the remainder of a row.
    real(wp) function rest_of(c, rows, row)
        real(wp), intent(in) :: c(:, :)
        integer, intent(in) :: rows(:), row
        real(wp) :: basis(size(c, 2), size(rows) + 1)
        integer :: i, k, pass

        do i = 1, size(rows) + 1
            if (i <= size(rows)) basis(:, i) = c(rows(i), :)
            if (i > size(rows)) basis(:, i) = c(row, :)
            do pass = 1, 2
                do k = 1, i - 1
                    basis(:, i) = basis(:, i) - dot_product(basis(:, k), basis(:, i))*basis(:, k)
                end do
            end do
            if (i <= size(rows)) basis(:, i) = basis(:, i)/norm2(basis(:, i))
        end do
        rest_of = norm2(basis(:, size(rows) + 1))
    end function rest_of

    !> Equal cranks in the plane on one coupler.
    subroutine draw_cranks(n, mechanism, error)
        integer, intent(in) :: n
        type(mechanism_type), intent(inout) :: mechanism
        type(error_type), allocatable, intent(inout) :: error
        type(failure_type), allocatable :: failure
        character(len=2) :: number
        real(wp) :: x
        integer :: i

        mechanism%planar = .true.
        call mechanism%add_body('coupler', 1.0_wp, [0.5_wp*n, 1.0_wp], failure, inertia=[1.0_wp])
        call check_no_failure(error, failure)
        do i = 1, n
            if (allocated(error)) return
            write (number, '(i0)') i
            x = i
            call mechanism%add_body('c'//number, 1.0_wp, [x, 0.5_wp], failure, inertia=[0.1_wp])
            call check_no_failure(error, failure)
            call mechanism%add_joint('f'//number, 'revolute', 'ground', 'c'//number, failure, at=[x, 0.0_wp])
            call check_no_failure(error, failure)
            call mechanism%add_joint('t'//number, 'revolute', 'c'//number, 'coupler', failure, at=[x, 1.0_wp])
            call check_no_failure(error, failure)
        end do
        call mechanism%define(failure)
        call check_no_failure(error, failure)
    end subroutine draw_cranks

    !> Unsupported features of this chart are refused at the set-up, with the remedy.
    subroutine test_refusals(error)
        type(error_type), allocatable, intent(out) :: error
        type(failure_type), allocatable :: failure
        type(mechanism_type), target :: mechanism
        integer :: i

        call refuse(options_type(chart_kind='sparse', chart='adaptive'), 'adaptive')
        call refuse(options_type(chart_kind='sparse', refresh='refine'), 'refine')
        call refuse(options_type(chart_kind='round'), 'chart_kind')
        ! A body without inertia.
        do i = 1, 2
            mechanism = mechanism_type()
            mechanism%planar = .true.
            call mechanism%add_body('mass', 1.0_wp, [-1.0_wp, 0.0_wp], failure, inertia=[0.0_wp])
            call check_no_failure(error, failure)
            call mechanism%add_joint('pivot', 'revolute', 'ground', 'mass', failure, at=[0.0_wp, 0.0_wp])
            call check_no_failure(error, failure)
            call mechanism%define(failure)
            call check_no_failure(error, failure)
            if (allocated(error)) return
            call initialize(options_type(step=1.0e-3_wp, chart_kind=merge('sparse   ', 'automatic', i == 1)))
            call check_no_failure(error, failure)
        end do

    contains

        subroutine refuse(options, piece)
            type(options_type), intent(in) :: options
            character(len=*), intent(in) :: piece

            if (allocated(error)) return
            mechanism = mechanism_type()
            call make_large('planar_chain', 5, mechanism, failure)
            call check_no_failure(error, failure)
            call initialize(options)
            call check_failure(error, failure, 'invalid_option', piece)
        end subroutine refuse

        subroutine initialize(options)
            type(options_type), intent(in) :: options
            type(simulation_type) :: simulation
            real(wp) :: q(mechanism%n), qd(mechanism%n)

            call mechanism%start(q, qd)
            call simulation%initialize(mechanism, options, 0.0_wp, q, qd, failure)
        end subroutine initialize
    end subroutine test_refusals
end module test_sparse_runs
