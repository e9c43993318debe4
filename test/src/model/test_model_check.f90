! SPDX-License-Identifier: MIT
!> Tests of the refusal of incomplete models, all by `initialize`, as for a user.
module test_model_check
    use asserts, only: check_failure, check_no_failure
    use model_beads, only: beads_type
    use model_belt_wheel, only: belt_wheel_type
    use model_knife_edge, only: knife_edge_type
    use model_pendulum, only: pendulum_type
    use model_sleigh, only: sleigh_type
    use tandem, only: failure_type => error_type, model_type, need_mass, options_type, rolling_disk_type, simulation_type, wp
    use testdrive, only: error_type, new_unittest, unittest_type
    use, intrinsic :: ieee_arithmetic, only: ieee_positive_inf, ieee_quiet_nan, ieee_value
    implicit none (type, external)
    private

    public :: collect_model_check

contains

    !> The suite.
    subroutine collect_model_check(testsuite)
        type(unittest_type), allocatable, intent(out) :: testsuite(:)

        testsuite = [ &
            new_unittest('complete-models-are-accepted', test_complete), &
            new_unittest('a-model-needs-a-coordinate', test_no_coordinates), &
            new_unittest('numbers-of-constraints-are-not-negative', test_negative), &
            new_unittest('there-are-at-most-as-many-constraints-as-coordinates', test_too_many), &
            new_unittest('missing-holonomic-is-named', test_holonomic), &
            new_unittest('missing-holonomic-jacobian-is-named', test_holonomic_jacobian), &
            new_unittest('missing-nonholonomic-jacobian-is-named', test_nonholonomic_jacobian), &
            new_unittest('missing-mass-matrix-is-named', test_mass_matrix), &
            new_unittest('missing-evaluate-is-named', test_evaluate), &
            new_unittest('a-term-that-evaluate-does-not-provide-is-missed', test_provides), &
            new_unittest('a-rate-without-holonomic-constraints-is-refused', test_rate), &
            new_unittest('a-right-side-without-nonholonomic-constraints-is-refused', test_rhs), &
            new_unittest('lists-of-names-have-one-entry-each', test_names), &
            new_unittest('scales-have-one-entry-each', test_scale_size), &
            new_unittest('scales-are-positive-and-finite', test_scale_values), &
            new_unittest('breakpoints-ascend', test_breakpoints), &
            new_unittest('breakpoints-are-finite', test_breakpoints_finite), &
            new_unittest('jumps-have-one-entry-a-breakpoint', test_jumps), &
            new_unittest('patterns-that-do-not-fit-are-refused', test_patterns)]
    end subroutine collect_model_check

    !> Initialize from the origin: a refused model is detected before an invalid start.
    subroutine check_refused(model, piece, error)
        class(model_type), intent(inout), target :: model
        character(len=*), intent(in) :: piece
        type(error_type), allocatable, intent(inout) :: error
        type(simulation_type) :: simulation
        type(options_type) :: options
        type(failure_type), allocatable :: failure
        real(wp), allocatable :: origin(:)

        if (allocated(error)) return
        origin = spread(0.0_wp, 1, max(model%n, 0))
        call simulation%initialize(model, options, 0.0_wp, origin, origin, failure)
        call check_failure(error, failure, 'invalid_model', piece)
    end subroutine check_refused

    subroutine test_complete(error)
        type(error_type), allocatable, intent(out) :: error
        type(belt_wheel_type), target :: belt_wheel
        type(rolling_disk_type), target :: disk
        type(simulation_type) :: simulation
        type(options_type) :: options
        type(failure_type), allocatable :: failure
        real(wp) :: q(9), qd(9), qdd(2), lambda(2)

        call belt_wheel%define()
        call belt_wheel%solution(0.0_wp, q(:2), qd(:2), qdd, lambda)
        call simulation%initialize(belt_wheel, options, 0.0_wp, q(:2), qd(:2), failure)
        call check_no_failure(error, failure)
        call disk%define()
        call disk%start([-1.0_wp, 0.01_wp, 0.0_wp], 0.0_wp, q, qd)
        call simulation%initialize(disk, options, 0.0_wp, q, qd, failure)
        call check_no_failure(error, failure)
    end subroutine test_complete

    subroutine test_no_coordinates(error)
        type(error_type), allocatable, intent(out) :: error
        type(pendulum_type), target :: model

        call model%define()
        model%n = 0
        call check_refused(model, 'n = 0', error)
        model%n = -3
        call check_refused(model, 'n = -3', error)
    end subroutine test_no_coordinates

    subroutine test_negative(error)
        type(error_type), allocatable, intent(out) :: error
        type(pendulum_type), target :: model

        call model%define()
        model%n_holonomic = -1
        call check_refused(model, 'n_holonomic = -1', error)
        model%n_holonomic = 1
        model%n_nonholonomic = -2
        call check_refused(model, 'n_nonholonomic = -2', error)
    end subroutine test_negative

    subroutine test_too_many(error)
        type(error_type), allocatable, intent(out) :: error
        type(belt_wheel_type), target :: model

        call model%define()
        model%n_holonomic = 2
        call check_refused(model, '2 holonomic and 1 nonholonomic constraints on 2 coordinates', error)
    end subroutine test_too_many

    subroutine test_holonomic(error)
        type(error_type), allocatable, intent(out) :: error
        type(belt_wheel_type), target :: model

        call model%define()
        model%holonomic => null()
        call check_refused(model, 'the procedure holonomic is missing', error)
    end subroutine test_holonomic

    subroutine test_holonomic_jacobian(error)
        type(error_type), allocatable, intent(out) :: error
        type(belt_wheel_type), target :: model

        call model%define()
        model%holonomic_jacobian => null()
        call check_refused(model, 'the procedure holonomic_jacobian is missing', error)
    end subroutine test_holonomic_jacobian

    subroutine test_nonholonomic_jacobian(error)
        type(error_type), allocatable, intent(out) :: error
        type(belt_wheel_type), target :: model

        call model%define()
        model%nonholonomic_jacobian => null()
        call check_refused(model, 'the procedure nonholonomic_jacobian is missing', error)
    end subroutine test_nonholonomic_jacobian

    subroutine test_mass_matrix(error)
        type(error_type), allocatable, intent(out) :: error
        type(belt_wheel_type), target :: model

        call model%define()
        model%mass_matrix => null()
        call check_refused(model, 'the procedure mass_matrix is missing', error)
    end subroutine test_mass_matrix

    subroutine test_evaluate(error)
        type(error_type), allocatable, intent(out) :: error
        type(rolling_disk_type), target :: model

        call model%define()
        model%evaluate => null()
        call check_refused(model, 'the procedure evaluate is missing', error)
    end subroutine test_evaluate

    subroutine test_provides(error)
        type(error_type), allocatable, intent(out) :: error
        type(rolling_disk_type), target :: model

        call model%define()
        model%provides = iand(model%provides, not(need_mass))
        call check_refused(model, 'the procedure mass_matrix is missing', error)
    end subroutine test_provides

    subroutine test_rate(error)
        type(error_type), allocatable, intent(out) :: error
        type(knife_edge_type), target :: model
        type(belt_wheel_type) :: other

        call model%define()
        call other%define()
        model%holonomic_rate => other%holonomic_rate
        call check_refused(model, 'holonomic_rate', error)
    end subroutine test_rate

    subroutine test_rhs(error)
        type(error_type), allocatable, intent(out) :: error
        type(pendulum_type), target :: model
        type(belt_wheel_type) :: other

        call model%define()
        call other%define()
        model%nonholonomic_rhs => other%nonholonomic_rhs
        call check_refused(model, 'nonholonomic_rhs', error)
    end subroutine test_rhs

    subroutine test_names(error)
        type(error_type), allocatable, intent(out) :: error
        type(belt_wheel_type), target :: model
        character(len=32), parameter :: one(1) = 'a', two(2) = 'b', three(3) = 'c'

        call model%define()
        model%coordinate_name = three
        call check_refused(model, 'coordinate_name has 3 entries instead of 2', error)
        model%coordinate_name = two
        model%coordinate_unit = one
        call check_refused(model, 'coordinate_unit has 1 entries instead of 2', error)
        model%coordinate_unit = two
        model%holonomic_name = two
        call check_refused(model, 'holonomic_name has 2 entries instead of 1', error)
        model%holonomic_name = one
        model%nonholonomic_name = two
        call check_refused(model, 'nonholonomic_name has 2 entries instead of 1', error)
        model%nonholonomic_name = one
        model%multiplier_unit = one
        call check_refused(model, 'multiplier_unit has 1 entries instead of 2', error)
    end subroutine test_names

    subroutine test_scale_size(error)
        type(error_type), allocatable, intent(out) :: error
        type(pendulum_type), target :: model

        call model%define()
        model%coordinate_scale = [1.0_wp]
        call check_refused(model, 'coordinate_scale has 1 entries instead of 2', error)
    end subroutine test_scale_size

    subroutine test_scale_values(error)
        type(error_type), allocatable, intent(out) :: error
        type(pendulum_type), target :: model
        real(wp) :: bad(4)
        integer :: i

        call model%define()
        bad = [0.0_wp, -1.0_wp, ieee_value(1.0_wp, ieee_quiet_nan), ieee_value(1.0_wp, ieee_positive_inf)]
        do i = 1, size(bad)
            model%coordinate_scale = [1.0_wp, bad(i)]
            call check_refused(model, 'coordinate_scale', error)
        end do
    end subroutine test_scale_values

    subroutine test_breakpoints(error)
        type(error_type), allocatable, intent(out) :: error
        type(pendulum_type), target :: model

        call model%define()
        model%breakpoints = [1.0_wp, 3.0_wp, 2.0_wp]
        call check_refused(model, 'breakpoints', error)
        model%breakpoints = [1.0_wp, 1.0_wp]
        call check_refused(model, 'breakpoints', error)
    end subroutine test_breakpoints

    subroutine test_breakpoints_finite(error)
        type(error_type), allocatable, intent(out) :: error
        type(pendulum_type), target :: model

        call model%define()
        model%breakpoints = [1.0_wp, ieee_value(1.0_wp, ieee_quiet_nan)]
        call check_refused(model, 'breakpoints', error)
        model%breakpoints = [ieee_value(1.0_wp, ieee_positive_inf)]
        call check_refused(model, 'breakpoints', error)
    end subroutine test_breakpoints_finite

    subroutine test_jumps(error)
        type(error_type), allocatable, intent(out) :: error
        type(sleigh_type), target :: model

        call model%define(1.0_wp)
        model%nu_jumps = [.true., .false.]
        call check_refused(model, 'nu_jumps has 2 entries instead of 1', error)
        deallocate (model%breakpoints)
        model%nu_jumps = [.true.]
        call check_refused(model, 'nu_jumps has 1 entries instead of 0', error)
    end subroutine test_jumps

    !> Each fault has its own message; `build` itself does not write outside of its lists.
    subroutine test_patterns(error)
        type(error_type), allocatable, intent(out) :: error
        type(beads_type) :: model

        call fresh()
        model%pattern%first(4) = 8
        call check_refused(model, 'do not cover the coordinates 1 to 6', error)
        call fresh()
        call model%pattern%build([1, 3, 5, 7], spread(1, 1, 6), 2, [1, 2], [1, 2], [0, 0])
        call check_refused(model, 'it has 2 rows, and the model 3 constraints', error)
        call fresh()
        call model%pattern%build([1, 3, 5, 7], [1, 2, 3], 3, [1, 2, 3], [1, 2, 3], [0, 0, 0])
        call check_refused(model, 'a block of M reaches into body 2', error)
        call fresh()
        call model%pattern%build([1, 3, 5, 7], spread(2, 1, 3), 3, [1, 2, 2, 3], [1, 1, 2, 3], [0, 2, 0])
        call check_refused(model, 'row 2 is owned by body 2, and touches others', error)
        call fresh()
        call model%pattern%build([1, 3, 5, 7], spread(2, 1, 3), 3, [1, 2, 3], [1, 2, 3], [0, 1, 0])
        call check_refused(model, 'row 2 is owned by body 1, and touches others', error)
        call fresh()
        call model%pattern%build([1, 3, 5, 7], spread(2, 1, 3), 3, [1, 2, 3], [1, 1, 3], [1, 1, 0])
        call check_refused(model, 'body 1 owns the rows 1 and 2', error)
        call fresh()
        call model%pattern%build([1, 3, 5, 7], spread(2, 1, 3), 3, [1, 2, 3], [1, 2, 3], [0, 4, 0])
        call check_refused(model, 'row 2 has the owner 4', error)
        call fresh()
        call model%pattern%build([1, 3, 5, 7], spread(1, 1, 6), 3, [1, 2, 4], [1, 2, 3], [0, 0, 0])
        call check_refused(model, 'pair 3 is of row 4 and body 3, where there are 3 rows and 3 bodies', error)
        call fresh()
        call model%pattern%build([1, 3, 3, 7], spread(1, 1, 6), 3, [1, 2, 3], [1, 2, 3], [0, 0, 0])
        call check_refused(model, 'first does not ascend from 1', error)
        call fresh()
        call model%pattern%build([1, 3, 5, 7], spread(1, 1, 5), 3, [1, 2, 3], [1, 2, 3], [0, 0, 0])
        call check_refused(model, 'mass_blocks are not positive sizes', error)
        call fresh()
        model%pattern%column(3:4) = model%pattern%column(1:2)
        call check_refused(model, 'row 2 touches two coordinates with the same column of C', error)
        call fresh()
        deallocate (model%pattern)
        allocate (model%pattern)
        call check_refused(model, 'it was not built', error)

    contains

        !> The model with a pattern that fits.
        subroutine fresh()
            model = beads_type()
            call model%define(3)
        end subroutine fresh
    end subroutine test_patterns
end module test_model_check
