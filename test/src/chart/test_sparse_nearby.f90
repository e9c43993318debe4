! SPDX-License-Identifier: MIT
!> Tests of accelerations that fixed explicit steps find with the factor of a nearby point: against full matrices, and in runs.
module test_sparse_nearby
    use, intrinsic :: ieee_arithmetic, only: ieee_quiet_nan, ieee_value
    use asserts, only: check_close, check_count, check_no_failure, check_true
    use large_mechanisms, only: make_large
    use large_runs, only: begin, go_on, scenes
    use scattered_numbers, only: scattered
    use tandem, only: failure_type => error_type, mechanism_type, options_type, simulation_type, statistics_type, terms_type, wp
    use tandem_chart_sparse_meetings, only: of_hinges
    use tandem_chart_sparse_system, only: system_type
    use tandem_model_counts, only: counts_type
    use terms_at, only: get_terms
    use testdrive, only: error_type, new_unittest, unittest_type
    implicit none (type, external)
    private

    public :: collect_sparse_nearby

    integer, parameter :: n_bodies = 14

contains

    !> The suite.
    subroutine collect_sparse_nearby(testsuite)
        type(unittest_type), allocatable, intent(out) :: testsuite(:)

        testsuite = [ &
            new_unittest('forces-that-are-not-balanced', test_unbalanced), &
            new_unittest('accelerations-beside-a-factor', test_accelerations), &
            new_unittest('looks-leave-no-trace', test_looks), &
            new_unittest('steps-take-two-factors', test_factors), &
            new_unittest('few-hinges-have-short-columns', test_few_hinges)]
    end subroutine collect_sparse_nearby

    !> f - M x - C' lambda by full matrices, lambda in the order of the nodes, without the components of owned rows.
    function left_of(system, terms, f, x, z) result(left)
        type(system_type), intent(in) :: system
        type(terms_type), intent(in) :: terms
        real(wp), intent(in) :: f(:), x(:), z(:)
        real(wp) :: left(size(f)), lambda(system%m), own(size(f))
        integer :: b, n

        lambda = 0.0_wp
        associate (a => system%analysis)
            do n = 1, a%n_nodes
                if (a%is_body(n)) cycle
                lambda(a%origin(n):a%origin(n) + a%height(n) - 1) = z(a%place(n) + 1:a%place(n) + a%height(n))
            end do
            left = f - matmul(terms%mass, x) - matmul(lambda, terms%jacobian)
            do b = 1, a%n_bodies
                if (a%own_row(b) == 0) cycle
                own = terms%jacobian(a%own_row(b), :)
                left = left - own*dot_product(own, left)/dot_product(own, own)
            end do
        end associate
    end function left_of

    !> All kinds of bodies and joints: hinges, pins, a hub, ball joints, distances, knife edges.
    subroutine test_unbalanced(error)
        type(error_type), allocatable, intent(out) :: error
        type(mechanism_type), target :: mechanism
        type(failure_type), allocatable :: failure
        type(system_type) :: system
        type(counts_type) :: counts
        type(terms_type) :: terms
        real(wp), allocatable :: f(:), left(:), q(:), qd(:), x(:), z(:)
        integer :: k, stat

        do k = 1, size(scenes)
            mechanism = mechanism_type()
            call make_large(trim(scenes(k)), n_bodies, mechanism, failure)
            call check_no_failure(error, failure)
            if (allocated(error)) return
            q = spread(0.0_wp, 1, mechanism%n)
            qd = q
            call mechanism%start(q, qd)
            q = q + 0.1_wp*scattered(mechanism%n, 1)
            call system%initialize(mechanism, .false.)
            call system%visit(0.0_wp, q, counts, stat)
            call check_count(error, stat, 0, 'the status')
            call system%load()
            call get_terms(mechanism, 0.0_wp, q, qd, terms, stat)
            f = scattered(mechanism%n, 2)
            x = scattered(mechanism%n, 3)
            z = scattered(system%analysis%n_unknowns, 4)
            left = f
            call system%factor(system%here)%find_unbalanced(system%analysis, system%model%terms%mass, f, x, z, left)
            call check_close(error, left, left_of(system, terms, f, x, z), 1.0e-12_wp, trim(scenes(k)))
            if (allocated(error)) return
        end do
    end subroutine test_unbalanced

    !> At a point 1e-6 away, at the same again, and further off, the equations of motion and C qdd = -gamma are satisfied by full
    !> matrices. At another time, where the point is no neighbour, and for NaN the factor is not reused.
    subroutine test_accelerations(error)
        type(error_type), allocatable, intent(out) :: error
        type(mechanism_type), target :: mechanism
        type(failure_type), allocatable :: failure
        type(system_type) :: system
        type(counts_type) :: counts
        real(wp), allocatable :: q(:), qd(:), qdd(:), scale(:), off(:)
        integer :: k, stat
        logical :: is_solved

        do k = 1, size(scenes)
            mechanism = mechanism_type()
            call make_large(trim(scenes(k)), n_bodies, mechanism, failure)
            call check_no_failure(error, failure)
            if (allocated(error)) return
            q = spread(0.0_wp, 1, mechanism%n)
            qd = q
            call mechanism%start(q, qd)
            qd = qd + scattered(mechanism%n, 5)
            qdd = q
            off = scattered(mechanism%n, 6)
            scale = spread(1.0_wp, 1, mechanism%n)
            counts = counts_type()
            call system%initialize(mechanism, .true.)
            ! The origin keeps its factor.
            call system%visit(0.0_wp, q, counts, stat)
            call system%factorize(counts, stat)
            call system%take_origin()
            q = q + 1.0e-3_wp*scattered(mechanism%n, 1)
            call system%move_with(1.0_wp, q, qd, counts, stat)
            call try(is_solved)
            call check_true(error, .not. is_solved, trim(scenes(k))//': solved by the factor of the origin')
            call system%factorize(counts, stat)
            call check_count(error, stat, 0, 'the status')
            if (allocated(error)) return
            associate (factor => system%factor(system%here))
                system%g(:) = -system%model%terms%gamma
                call factor%solve(system%analysis, .true., system%model%terms%force, system%g, qdd, system%z)
            end associate
            call system%nearby%note(1.0_wp, qdd, system%z)
            call check_beside(1.0e-6_wp)
            call check_beside(1.0e-6_wp)
            call check_beside(1.0e-5_wp)
            if (allocated(error)) return
            call check_again()
            if (allocated(error)) return
            call check_count(error, int(counts%constraint_factorizations), 2, trim(scenes(k))//': factorizations')
            call system%move_with(1.0_wp, q + 2.0e-5_wp*off, qd, counts, stat)
            system%model%terms%force(1) = ieee_value(1.0_wp, ieee_quiet_nan)
            call try(is_solved)
            call check_true(error, .not. is_solved, trim(scenes(k))//': solved for forces that are no numbers')
            call check_true(error, all(abs(system%nearby%change) <= 0) .and. all(abs(system%nearby%trend) <= 0), &
                trim(scenes(k))//': what is no number is kept')
            system%nearby%pause = 0
            call system%move_with(1.0_wp, q + 0.5_wp*off, qd, counts, stat)
            call try(is_solved)
            call check_true(error, .not. is_solved, trim(scenes(k))//': solved far away')
            call system%move_with(1.0_wp, q, qd, counts, stat)
            call try(is_solved)
            call check_true(error, .not. is_solved, trim(scenes(k))//': tried at once after a failure')
            call system%move_with(1.1_wp, q, qd, counts, stat)
            call try(is_solved)
            call check_true(error, .not. is_solved, trim(scenes(k))//': solved at another time')
            if (allocated(error)) return
        end do

    contains

        subroutine try(is_solved)
            logical, intent(out) :: is_solved

            call system%solve_nearby(scale, .false., 1.0e-13_wp, qdd, is_solved)
        end subroutine try

        !> Again at the last solved point, after an evaluation elsewhere: the data of its factor is restored, the guesses are kept.
        subroutine check_again()
            type(counts_type) :: of_looks
            real(wp) :: least, change(size(q), 2), found(size(q))
            integer :: weakest

            least = system%factor(system%here)%least
            weakest = system%factor(system%here)%weakest
            change = system%nearby%change
            found = qdd
            call system%hold()
            call system%visit(1.0_wp, q + 0.01_wp*off, of_looks, stat)
            call system%factorize(of_looks, stat)
            call system%release()
            call check_true(error, abs(system%factor(system%here)%least - least) <= 0.0_wp .and. &
                system%factor(system%here)%weakest == weakest, trim(scenes(k))//': the smallest pivot is that of a look')
            call system%move_with(1.0_wp, q + 1.0e-5_wp*off, qd, counts, stat)
            call try(is_solved)
            call check_true(error, is_solved, trim(scenes(k))//': not solved after a look')
            call check_close(error, qdd/(1.0_wp + maxval(abs(found))), found/(1.0_wp + maxval(abs(found))), 1.0e-12_wp, &
                trim(scenes(k))//': the acceleration after a look')
            call check_true(error, all(abs(system%nearby%change - change) <= 0), trim(scenes(k))//': a guess has changed')
        end subroutine check_again

        !> At q + distance off.
        subroutine check_beside(distance)
            real(wp), intent(in) :: distance
            type(terms_type) :: terms
            real(wp) :: largest

            if (allocated(error)) return
            call system%move_with(1.0_wp, q + distance*off, qd, counts, stat)
            call try(is_solved)
            call check_true(error, is_solved .and. system%serves, trim(scenes(k))//': not solved')
            if (allocated(error)) return
            call get_terms(mechanism, 1.0_wp, q + distance*off, qd, terms, stat)
            largest = maxval(abs(qdd)) + maxval(abs(terms%force)) + maxval(abs(system%nearby%lambda))
            call check_close(error, matmul(terms%jacobian, qdd)/largest, -terms%gamma/largest, 1.0e-13_wp, &
                trim(scenes(k))//': C qdd and -gamma')
            call check_close(error, left_of(system, terms, terms%force, qdd, system%nearby%lambda)/largest, 0.0_wp*qdd, &
                1.0e-13_wp, trim(scenes(k))//': M qdd + C'' lambda and the forces')
        end subroutine check_beside
    end subroutine test_accelerations

    !> Dense output with multipliers between steps, and multipliers at their ends, do not change the steps, and these multipliers
    !> solve the equations of motion.
    subroutine test_looks(error)
        type(error_type), allocatable, intent(out) :: error
        type(mechanism_type), target :: one, two
        type(simulation_type) :: looking, blind
        type(failure_type), allocatable :: failure
        type(options_type) :: options
        type(terms_type) :: terms
        real(wp), allocatable :: lambda(:), left(:)
        integer :: k, stat, step

        do k = 1, size(scenes)
            options = options_type(chart_kind='sparse', step=2.0e-3_wp)
            call begin(trim(scenes(k)), n_bodies, options, one, looking, error)
            call begin(trim(scenes(k)), n_bodies, options, two, blind, error)
            if (allocated(error)) return
            lambda = spread(0.0_wp, 1, one%n_constraints())
            do step = 1, 12
                call looking%step(1.0_wp, failure)
                call check_no_failure(error, failure)
                call blind%step(1.0_wp, failure)
                call check_no_failure(error, failure)
                if (allocated(error)) return
                if (modulo(step, 3) == 0) cycle
                call looking%look_at(looking%state%t - 0.3_wp*looking%last_step, failure)
                call check_no_failure(error, failure)
                call looking%multipliers(lambda)
                if (step > 6) then
                    call looking%look_at(looking%state%t - 0.3_wp*looking%last_step, failure)
                    call check_no_failure(error, failure)
                end if
                call looking%look_back()
                call looking%multipliers(lambda)
                call get_terms(one, looking%state%t, looking%state%q, looking%state%qd, terms, stat)
                left = terms%force - matmul(terms%mass, looking%state%qdd) - matmul(lambda, terms%jacobian)
                call check_close(error, left/(1.0_wp + maxval(abs(lambda))), 0.0_wp*left, 1.0e-12_wp, &
                    trim(scenes(k))//': M qdd + C'' lambda and the forces')
                if (allocated(error)) return
            end do
            call check_true(error, all(abs(looking%state%q - blind%state%q) <= 0.0_wp) .and. &
                all(abs(looking%state%qd - blind%state%qd) <= 0.0_wp), trim(scenes(k))//': a look changes the steps')
            if (allocated(error)) return
        end do
    end subroutine test_looks

    !> Two of the four points of a step of `rk4` are factored, and the motion is that of the dense chart.
    subroutine test_factors(error)
        type(error_type), allocatable, intent(out) :: error
        type(mechanism_type), target :: one, two
        type(simulation_type) :: sparse, dense
        type(statistics_type) :: statistics
        integer :: k

        do k = 1, size(scenes)
            call begin(trim(scenes(k)), n_bodies, options_type(step=1.0e-3_wp, chart_kind='sparse'), one, sparse, error)
            call begin(trim(scenes(k)), n_bodies, options_type(step=1.0e-3_wp, chart_kind='dense'), two, dense, error)
            call go_on(sparse, 0.1_wp, error)
            call go_on(dense, 0.1_wp, error)
            if (allocated(error)) return
            statistics = sparse%statistics()
            call check_true(error, statistics%constraint_factorizations <= 2*statistics%steps + 4, &
                trim(scenes(k))//': more than two factorizations a step')
            call check_close(error, sparse%state%q, dense%state%q, 1.0e-9_wp, trim(scenes(k))//': q')
            if (allocated(error)) return
        end do
    end subroutine test_factors

    !> Columns of positions, the unit matrix with a sign, are stored neither for many hinges nor for few.
    subroutine test_few_hinges(error)
        type(error_type), allocatable, intent(out) :: error
        type(mechanism_type), target :: mechanism
        type(failure_type), allocatable :: failure
        type(system_type) :: system
        integer, parameter :: numbers(2) = [4, 16]
        integer :: k

        do k = 1, size(numbers)
            mechanism = mechanism_type()
            call make_large('spatial_chain', numbers(k), mechanism, failure)
            call check_no_failure(error, failure)
            if (allocated(error)) return
            call system%initialize(mechanism, .true.)
            call check_true(error, all(system%analysis%joints_of_body == of_hinges), 'positions have columns')
            if (allocated(error)) return
        end do
    end subroutine test_few_hinges
end module test_sparse_nearby
