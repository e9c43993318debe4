! SPDX-License-Identifier: MIT
!> Tests of mass matrices of diagonal blocks: declared by a model, or found for a constant M.
module test_mass_blocks
    use asserts, only: check_below, check_count, check_failure, check_no_failure, check_true
    use model_perturbed, only: perturbed_type
    use runs, only: choose, run
    use tandem, only: failure_type => error_type, finding_type, model_type, procedure_model_type, need_mass, rolling_disk_type, &
        simulation_type, &
        verify_model, wp
    use tandem_model_evaluator, only: evaluator_type
    use tandem_model_counts, only: counts_type
    use testdrive, only: error_type, new_unittest, unittest_type
    implicit none (type, external)
    private

    public :: collect_mass_blocks

    !> Six free coordinates with a given constant mass matrix.
    type, extends(procedure_model_type) :: heavy_type
        real(wp) :: m(6, 6) = 0.0_wp
    end type heavy_type

contains

    !> The suite.
    subroutine collect_mass_blocks(testsuite)
        type(unittest_type), allocatable, intent(out) :: testsuite(:)

        testsuite = [ &
            new_unittest('sizes-that-do-not-add-up-are-refused', test_sizes), &
            new_unittest('an-entry-outside-of-the-blocks-is-refused', test_outside), &
            new_unittest('blocks-that-fit-the-start-alone-are-refused-later', test_later), &
            new_unittest('verification-finds-an-entry-outside', test_verification), &
            new_unittest('blocks-do-not-change-the-motion', test_motion), &
            new_unittest('the-blocks-of-a-constant-matrix-are-found', test_constant)]
    end subroutine collect_mass_blocks

    subroutine test_sizes(error)
        type(error_type), allocatable, intent(out) :: error
        type(rolling_disk_type), target :: model
        type(simulation_type) :: simulation
        type(failure_type), allocatable :: failure
        real(wp) :: q(9), qd(9)
        integer :: k

        call model%define()
        call model%start([-1.0_wp, 0.01_wp, 0.0_wp], 0.0_wp, q, qd)
        do k = 1, 2
            if (k == 1) model%mass_blocks = [3, 4]
            if (k == 2) model%mass_blocks = [3, 4, 0, 2]
            call run(simulation, model, choose(stepper='rk4'), 0.0_wp, q, qd, 0.01_wp, failure)
            call check_failure(error, failure, 'invalid_model', 'mass_blocks are not positive sizes that add up to n')
        end do
    end subroutine test_sizes

    subroutine test_outside(error)
        type(error_type), allocatable, intent(out) :: error
        type(rolling_disk_type), target :: model
        type(simulation_type) :: simulation
        type(failure_type), allocatable :: failure
        real(wp) :: q(9), qd(9)

        call model%define()
        call model%start([-1.0_wp, 0.01_wp, 0.0_wp], 0.3_wp, q, qd)
        ! It splits the Euler parameters.
        model%mass_blocks = [4, 3, 2]
        call run(simulation, model, choose(stepper='rk4'), 0.0_wp, q, qd, 0.01_wp, failure)
        call check_failure(error, failure, 'invalid_model', &
            'the mass matrix is not zero outside of mass_blocks at the start, entry mass(6,4)')
    end subroutine test_outside

    !> Upright and at rest about one axis, M is diagonal, but no longer when the disk rotates.
    subroutine test_later(error)
        type(error_type), allocatable, intent(out) :: error
        character(len=10), parameter :: charts(2) = [character(len=10) :: 'every_step', 'adaptive']
        type(rolling_disk_type), target :: model
        type(simulation_type) :: simulation
        type(failure_type), allocatable :: failure
        real(wp) :: q(9), qd(9)
        integer :: k

        call model%define()
        call model%start([-1.0_wp, 0.01_wp, 0.0_wp], 0.0_wp, q, qd)
        model%mass_blocks = [4, 3, 2]
        do k = 1, size(charts)
            call run(simulation, model, choose(stepper='dop853', step=0.01_wp, chart=trim(charts(k))), 0.0_wp, q, qd, 1.0_wp, &
                failure)
            call check_failure(error, failure, 'invalid_model', 'the mass matrix is not zero outside of mass_blocks')
            call check_below(error, simulation%state%t, 0.021_wp, 'it ends early')
        end do
    end subroutine test_later

    subroutine test_verification(error)
        type(error_type), allocatable, intent(out) :: error
        type(rolling_disk_type), target :: disk
        type(perturbed_type), target :: model
        type(finding_type), allocatable :: findings(:)
        type(failure_type), allocatable :: failure
        real(wp) :: q(9), qd(9)
        integer :: k

        call disk%define()
        call disk%start([-1.0_wp, 0.01_wp, 0.0_wp], 0.0_wp, q, qd)
        call model%wrap(disk)
        model%mass_blocks = disk%mass_blocks
        call verify_model(model, 0.5_wp, q, qd, 3, findings, failure)
        call check_no_failure(error, failure)
        call check_true(error, all(findings%passed), 'nothing is wrong')
        call check_true(error, any(findings%name == 'mass_blocks'), 'blocks are compared')
        model%term = 5
        model%amount = 0.1_wp
        model%row = 8
        model%column = 2
        call verify_model(model, 0.5_wp, q, qd, 3, findings, failure)
        do k = 1, size(findings)
            if (findings(k)%name == 'mass_blocks') exit
        end do
        call check_true(error, .not. findings(k)%passed, 'it is found')
        call check_count(error, findings(k)%row, 8, 'row')
        call check_count(error, findings(k)%column, 2, 'column')
    end subroutine test_verification

    !> The disk with its blocks, with coarser ones, and with none.
    subroutine test_motion(error)
        type(error_type), allocatable, intent(out) :: error
        character(len=9), parameter :: steppers(3) = [character(len=9) :: 'rk4', 'dop853', 'sdirk54']
        type(rolling_disk_type), target :: model
        type(simulation_type) :: simulation
        type(failure_type), allocatable :: failure
        real(wp) :: q(9), qd(9)
        real(wp) :: ends(18, 3)
        integer :: i, k

        call model%define()
        call model%start([-1.0_wp, 0.01_wp, 0.0_wp], 0.0_wp, q, qd)
        do i = 1, size(steppers)
            do k = 1, 3
                call model%define()
                if (k == 2) model%mass_blocks = [3, 4, 2]
                if (k == 3) deallocate (model%mass_blocks)
                call run(simulation, model, choose(stepper=trim(steppers(i)), step=0.01_wp), 0.0_wp, q, qd, 0.2_wp, failure)
                call check_no_failure(error, failure)
                if (allocated(error)) return
                ends(:, k) = [simulation%state%q, simulation%state%qd]
            end do
            call check_below(error, maxval(abs(ends(:, 2) - ends(:, 1))), 1.0e-12_wp, 'coarse '//steppers(i))
            call check_below(error, maxval(abs(ends(:, 3) - ends(:, 1))), 1.0e-12_wp, 'none '//steppers(i))
        end do
    end subroutine test_motion

    subroutine test_constant(error)
        type(error_type), allocatable, intent(out) :: error
        type(heavy_type), target :: model
        type(evaluator_type) :: evaluator
        type(counts_type) :: counts
        real(wp) :: none(6)
        integer :: i, stat

        none = 0.0_wp
        model%name = 'heavy'
        model%n = 6
        model%constant_mass = .true.
        model%mass_matrix => masses
        do i = 1, 6
            model%m(i, i) = 2.0_wp
        end do
        call look([integer ::])
        model%m(3, 2) = 0.5_wp
        model%m(2, 3) = 0.5_wp
        model%m(5, 6) = 1.0_wp
        model%m(6, 5) = 1.0_wp
        call look([2, 3, 5, 6])
        ! A zero on the diagonal is a block of its own; an arrow makes one block.
        model%m(4, 4) = 0.0_wp
        call look([2, 3, 5, 6])
        model%m(6, 1) = 0.25_wp
        model%m(1, 6) = 0.25_wp
        call look([1, 6])

    contains

        subroutine look(blocks)
            !> First and last coordinates of the blocks with more than one entry.
            integer, intent(in) :: blocks(:)

            call evaluator%initialize(model)
            call check_count(error, evaluator%n_blocks, 1, 'blocks before M is known')
            call evaluator%evaluate(need_mass, 0.0_wp, none, none, counts, stat)
            call check_count(error, stat, 0, 'status')
            call check_count(error, evaluator%n_blocks, size(blocks)/2, 'blocks')
            if (allocated(error)) return
            call check_true(error, all(evaluator%blocks == blocks), 'where they are')
        end subroutine look
    end subroutine test_constant

    subroutine masses(self, q, value, stat)
        class(model_type), intent(inout) :: self
        real(wp), intent(in) :: q(:)
        real(wp), intent(out) :: value(:, :)
        integer, intent(out) :: stat

        stat = 0
        value = 0.0_wp
        select type (self)
        class is (heavy_type)
            value = self%m
        end select
    end subroutine masses
end module test_mass_blocks
