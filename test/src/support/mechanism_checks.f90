! SPDX-License-Identifier: MIT
!> Common parts of the suites of mechanisms: two bodies for an element between them, the comparison of all procedures with
!> differences, and runs.
module mechanism_checks
    use asserts, only: check_below, check_count, check_no_failure, check_true, format_real
    use runs, only: run
    use tandem, only: failure_type => error_type, finding_type, mechanism_type, options_type, simulation_type, terms_type, &
        verify_model, wp
    use terms_at, only: get_terms
    use testdrive, only: error_type
    implicit none (type, external)
    private

    public :: draw, verify, check_drawing, go

    !> Differences of fourth order have errors of about 3e-13 of the function, which is up to a thousand times the derivative here.
    real(wp), parameter :: bound = 1.0e-9_wp

contains

    !> Two bodies of any shape, rotated in the reference configuration, with a point each.
    subroutine draw(mechanism, planar)
        type(mechanism_type), intent(out) :: mechanism
        logical, intent(in) :: planar
        type(failure_type), allocatable :: failure

        mechanism%planar = planar
        mechanism%gravity = [0.3_wp, -9.81_wp, 1.0_wp]
        if (planar) then
            call mechanism%add_body('first', 1.3_wp, [0.4_wp, 0.2_wp], failure, inertia=[0.7_wp], orientation=[0.3_wp])
            call mechanism%add_body('second', 0.7_wp, [1.1_wp, 0.9_wp], failure, inertia=[0.2_wp], orientation=[-0.8_wp])
            call mechanism%add_point('first', 'tip', [0.3_wp, 0.1_wp], failure)
            call mechanism%add_point('second', 'tip', [-0.2_wp, 0.4_wp], failure)
        else
            call mechanism%add_body('first', 1.3_wp, [0.4_wp, 0.2_wp, -0.1_wp], failure, inertia=[0.7_wp, 0.8_wp, 0.9_wp], &
                orientation=[0.8_wp, 0.2_wp, -0.4_wp, 0.3_wp])
            call mechanism%add_body('second', 0.7_wp, [1.1_wp, 0.9_wp, 0.3_wp], failure, &
                inertia=[0.5_wp, 0.6_wp, 0.7_wp, 0.05_wp, -0.02_wp, 0.01_wp], orientation=[0.5_wp, -0.6_wp, 0.2_wp, 0.4_wp])
            call mechanism%add_point('first', 'tip', [0.3_wp, 0.1_wp, 0.2_wp], failure)
            call mechanism%add_point('second', 'tip', [-0.2_wp, 0.4_wp, 0.1_wp], failure)
        end if
        if (allocated(failure)) error stop 'draw: '//failure%message
    end subroutine draw

    !> Compare all procedures at random states near the reference configuration.
    subroutine verify(mechanism, what, error)
        type(mechanism_type), intent(inout), target :: mechanism
        character(len=*), intent(in) :: what
        type(error_type), allocatable, intent(inout) :: error
        type(finding_type), allocatable :: findings(:)
        type(failure_type), allocatable :: failure
        real(wp), allocatable :: q(:), qd(:)
        integer :: i

        if (allocated(error)) return
        call mechanism%define(failure)
        call check_no_failure(error, failure)
        if (allocated(error)) return
        allocate (q(mechanism%n), qd(mechanism%n))
        call mechanism%start(q, qd)
        call verify_model(mechanism, 0.4_wp, q, qd, 5, findings, failure)
        call check_no_failure(error, failure)
        do i = 1, size(findings)
            call check_true(error, findings(i)%passed .and. findings(i)%error <= bound, &
                what//': '//trim(findings(i)%name)//', error '//format_real(findings(i)%error))
        end do
    end subroutine verify

    !> Phi = 0 in the reference configuration, up to rounding of coordinates of about 1.
    subroutine check_drawing(mechanism, what, error)
        type(mechanism_type), intent(inout) :: mechanism
        character(len=*), intent(in) :: what
        type(error_type), allocatable, intent(inout) :: error
        type(terms_type) :: terms
        real(wp), allocatable :: q(:), qd(:)
        integer :: stat

        if (allocated(error)) return
        allocate (q(mechanism%n), qd(mechanism%n))
        call mechanism%start(q, qd)
        call get_terms(mechanism, 0.0_wp, q, qd, terms, stat)
        call check_count(error, stat, 0, what//': status')
        call check_below(error, maxval(abs([0.0_wp, terms%phi])), 1.0e-14_wp, what//': Phi in the drawing')
    end subroutine check_drawing

    !> Integrate a mechanism from its reference configuration to a time, by dop853 or another stepper.
    subroutine go(mechanism, rtol, t_end, simulation, error, stepper, chart_kind)
        type(mechanism_type), intent(inout), target :: mechanism
        real(wp), intent(in) :: rtol, t_end
        type(simulation_type), intent(inout) :: simulation
        type(error_type), allocatable, intent(inout) :: error
        character(len=*), intent(in), optional :: stepper, chart_kind
        type(failure_type), allocatable :: failure
        type(options_type) :: options
        real(wp), allocatable :: q(:), qd(:)

        if (allocated(error)) return
        call mechanism%define(failure)
        call check_no_failure(error, failure)
        if (allocated(error)) return
        allocate (q(mechanism%n), qd(mechanism%n))
        call mechanism%start(q, qd)
        options%stepper = 'dop853'
        if (present(stepper)) options%stepper = stepper
        if (present(chart_kind)) options%chart_kind = chart_kind
        options%rtol = rtol
        call run(simulation, mechanism, options, 0.0_wp, q, qd, t_end, failure)
        call check_no_failure(error, failure)
    end subroutine go
end module mechanism_checks
