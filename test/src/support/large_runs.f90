! SPDX-License-Identifier: MIT
!> Runs of large mechanisms, step by step, for the suites of the sparse chart.
module large_runs
    use asserts, only: check_count, check_no_failure, check_true
    use large_mechanisms, only: make_large
    use tandem, only: failure_type => error_type, long, mechanism_type, options_type, profile_type, simulation_type, wp
    use testdrive, only: error_type
    implicit none (type, external)
    private

    public :: begin, start, controlled, go_on, check_resumption, check_timed, scenes

    !> Kinds of mechanisms of `make_large`.
    character(len=14), parameter :: scenes(6) = [character(len=14) :: 'planar_chain', 'spatial_chain', 'four_bars', 'star', &
        'net', 'trailers']

contains

    !> Begin a run of a scene.
    subroutine begin(name, n, options, mechanism, simulation, error, ratio)
        character(len=*), intent(in) :: name
        integer, intent(in) :: n
        type(options_type), intent(in) :: options
        type(mechanism_type), intent(inout), target :: mechanism
        type(simulation_type), intent(inout) :: simulation
        type(error_type), allocatable, intent(inout) :: error
        !> For sliders.
        real(wp), intent(in), optional :: ratio
        type(failure_type), allocatable :: failure

        if (allocated(error)) return
        mechanism = mechanism_type()
        call make_large(name, n, mechanism, failure, ratio)
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
    pure function controlled(rtol, kind, stepper) result(options)
        real(wp), intent(in) :: rtol
        character(len=*), intent(in) :: kind
        !> dop853 by default.
        character(len=*), intent(in), optional :: stepper
        type(options_type) :: options

        options%stepper = 'dop853'
        if (present(stepper)) options%stepper = stepper
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

    !> A run of a scene that is continued from a checkpoint is bitwise equal.
    subroutine check_resumption(name, options, error)
        character(len=*), intent(in) :: name
        type(options_type), intent(in) :: options
        type(error_type), allocatable, intent(inout) :: error
        type(mechanism_type), target :: one, two
        type(simulation_type) :: first, again
        type(failure_type), allocatable :: failure
        integer(long), allocatable :: words(:), expected(:), found(:)

        call begin(name, 14, options, one, first, error)
        call begin(name, 14, options, two, again, error)
        call go_on(first, 0.021_wp, error)
        if (allocated(error)) return
        call first%save_state(words, failure)
        call check_no_failure(error, failure)
        call again%restore_state(words, failure)
        call check_no_failure(error, failure)
        call go_on(first, 0.05_wp, error)
        call go_on(again, 0.05_wp, error)
        if (allocated(error)) return
        call first%save_state(expected, failure)
        call again%save_state(found, failure)
        call check_true(error, all(abs(first%state%q - again%state%q) <= 0.0_wp) .and. &
            all(abs(first%state%qd - again%state%qd) <= 0.0_wp), name//' goes on otherwise')
        call check_count(error, size(found), size(expected), 'words of the state')
    end subroutine check_resumption

    !> A run of a scene with time measurement has its usual sparse chart, and takes the same steps.
    subroutine check_timed(name, options, error)
        character(len=*), intent(in) :: name
        type(options_type), intent(in) :: options
        type(error_type), allocatable, intent(inout) :: error
        type(mechanism_type), target :: one, two
        type(simulation_type) :: plain, timed
        type(profile_type), target :: profile
        type(failure_type), allocatable :: failure
        real(wp), allocatable :: q(:), qd(:)

        call begin(name, 20, options, one, plain, error)
        call make_large(name, 20, two, failure)
        call check_no_failure(error, failure)
        if (allocated(error)) return
        allocate (q(two%n), qd(two%n))
        call two%start(q, qd)
        call profile%begin()
        two%state%timer => profile
        call timed%initialize(two, options, 0.0_wp, q, qd, failure)
        call check_no_failure(error, failure)
        call check_true(error, timed%is_sparse .and. plain%is_sparse, 'a chart is dense')
        call go_on(plain, 0.02_wp, error)
        call go_on(timed, 0.02_wp, error)
        if (allocated(error)) return
        call check_true(error, all(abs(plain%state%q - timed%state%q) <= 0.0_wp), 'it takes other steps')
    end subroutine check_timed
end module large_runs
