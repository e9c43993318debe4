! SPDX-License-Identifier: MIT
!> Runs of large mechanisms, step by step, for the suites of the sparse chart.
module large_runs
    use asserts, only: check_no_failure
    use large_mechanisms, only: make_large
    use tandem, only: failure_type => error_type, mechanism_type, options_type, simulation_type, wp
    use testdrive, only: error_type
    implicit none (type, external)
    private

    public :: begin, start, controlled, go_on, scenes

    !> What `make_large` makes of several kinds.
    character(len=14), parameter :: scenes(6) = [character(len=14) :: 'planar_chain', 'spatial_chain', 'four_bars', 'star', &
        'net', 'trailers']

contains

    !> Begin a run of a scene.
    subroutine begin(name, n, options, mechanism, simulation, error)
        character(len=*), intent(in) :: name
        integer, intent(in) :: n
        type(options_type), intent(in) :: options
        type(mechanism_type), intent(inout), target :: mechanism
        type(simulation_type), intent(inout) :: simulation
        type(error_type), allocatable, intent(inout) :: error
        type(failure_type), allocatable :: failure

        if (allocated(error)) return
        call make_large(name, n, mechanism, failure)
        call check_no_failure(error, failure)
        if (.not. allocated(error)) call start(mechanism, options, simulation, error)
    end subroutine begin

    !> Begin a run of a mechanism.
    subroutine start(mechanism, options, simulation, error)
        type(mechanism_type), intent(inout), target :: mechanism
        type(options_type), intent(in) :: options
        type(simulation_type), intent(inout) :: simulation
        type(error_type), allocatable, intent(inout) :: error
        type(failure_type), allocatable :: failure
        real(wp) :: q(mechanism%n), qd(mechanism%n)

        call mechanism%start(q, qd)
        call simulation%initialize(mechanism, options, 0.0_wp, q, qd, failure)
        call check_no_failure(error, failure)
    end subroutine start

    !> Options of controlled steps.
    pure function controlled(rtol, kind) result(options)
        real(wp), intent(in) :: rtol
        character(len=*), intent(in) :: kind
        type(options_type) :: options

        options%stepper = 'dop853'
        options%rtol = rtol
        options%chart_kind = kind
    end function controlled

    !> Run to a time.
    subroutine go_on(simulation, t, error)
        type(simulation_type), intent(inout) :: simulation
        real(wp), intent(in) :: t
        type(error_type), allocatable, intent(inout) :: error
        type(failure_type), allocatable :: failure

        if (allocated(error)) return
        call simulation%integrate(t, failure)
        call check_no_failure(error, failure)
    end subroutine go_on
end module large_runs
