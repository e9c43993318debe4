! SPDX-License-Identifier: MIT
!> Common parts of tests of linearised systems: a linearised scene, and comparisons of sets of eigenvalues.
module linearised
    use asserts, only: check_below, check_true
    use tandem, only: failure_type => error_type, linearisation_type, nearest_type, of_motion, simulation_type, wp
    use tandem_io, only: find_scene, read_scene, scene_type
    use testdrive, only: error_type, test_failed
    implicit none (type, external)
    private

    public :: linearise_scene, linearise_text, check_eigenvalues, check_nearest, has_eigenvalue

contains

    !> Linearise a shipped scene at its start.
    subroutine linearise_scene(name, settings, scene, it, error)
        character(len=*), intent(in) :: name, settings(:)
        type(scene_type), intent(inout), target :: scene
        type(linearisation_type), intent(inout) :: it
        type(error_type), allocatable, intent(inout) :: error
        type(failure_type), allocatable :: failure
        character(len=:), allocatable :: path

        if (allocated(error)) return
        call find_scene(name, path, failure)
        if (.not. allocated(failure)) call read_scene(path, settings, scene, failure)
        call linearise_start(scene, it, failure)
        if (allocated(failure)) call test_failed(error, failure%message)
    end subroutine linearise_scene

    !> Linearise a scene that is given as text.
    subroutine linearise_text(text, settings, scene, it, error)
        character(len=*), intent(in) :: text, settings(:)
        type(scene_type), intent(inout), target :: scene
        type(linearisation_type), intent(inout) :: it
        type(error_type), allocatable, intent(inout) :: error
        type(failure_type), allocatable :: failure

        if (allocated(error)) return
        call read_scene('test.toml', settings, scene, failure, text=text)
        call linearise_start(scene, it, failure)
        if (allocated(failure)) call test_failed(error, failure%message)
    end subroutine linearise_text

    !> Linearise at the start of a run.
    subroutine linearise_start(scene, it, failure)
        type(scene_type), intent(inout), target :: scene
        type(linearisation_type), intent(inout) :: it
        type(failure_type), allocatable, intent(inout) :: failure
        type(simulation_type), allocatable :: simulation

        if (allocated(failure)) return
        allocate (simulation)
        call simulation%initialize(scene%model, scene%options, scene%t_start, scene%q, scene%qd, failure, scene%assembly)
        if (allocated(failure)) return
        call it%make(scene%model, simulation%state%t, simulation%state%q, simulation%state%qd, failure)
    end subroutine linearise_start

    !> The distance to the nearest of some eigenvalues.
    pure real(wp) function distance(values, value)
        complex(wp), intent(in) :: values(:), value

        distance = minval(abs(values - value))
    end function distance

    !> True if there is an eigenvalue within a bound.
    pure logical function has_eigenvalue(it, value, bound)
        type(linearisation_type), intent(in) :: it
        complex(wp), intent(in) :: value
        real(wp), intent(in) :: bound

        has_eigenvalue = distance(it%spectrum%values, value) <= bound
    end function has_eigenvalue

    !> All eigenvalues except exact zeros and those due to symmetries are the expected ones, in the same number.
    subroutine check_eigenvalues(it, expected, bound, what, error)
        type(linearisation_type), intent(in) :: it
        complex(wp), intent(in) :: expected(:)
        !> Absolute bound.
        real(wp), intent(in) :: bound
        character(len=*), intent(in) :: what
        type(error_type), allocatable, intent(inout) :: error
        complex(wp), allocatable :: others(:)
        character(len=240) :: message
        integer :: i

        if (allocated(error)) return
        others = pack(it%spectrum%values, it%spectrum%cause == 1)
        if (size(others) /= size(expected)) then
            write (message, '(a, i0, a, i0)') what//': eigenvalues that nothing explains: ', size(others), ', expected ', &
                size(expected)
            call test_failed(error, trim(message))
            return
        end if
        do i = 1, size(expected)
            if (distance(others, expected(i)) <= bound .and. distance(expected, others(i)) <= bound) cycle
            write (message, '(a, 2es24.15, a, es9.2)') what//': no eigenvalue ', expected(i), ', the nearest is off by ', &
                distance(others, expected(i))
            call test_failed(error, trim(message))
            return
        end do
    end subroutine check_eigenvalues

    !> The k eigenvalues nearest to a shift are those of the dense analysis.
    subroutine check_nearest(nearest, it, shift, k, bounds, is_wanted, what, error)
        type(nearest_type), intent(in) :: nearest
        type(linearisation_type), intent(in) :: it
        complex(wp), intent(in) :: shift
        integer, intent(in) :: k
        !> Relative, and an absolute addition for eigenvalues that are not of a motion.
        real(wp), intent(in) :: bounds(2)
        !> Eigenvalues of the dense analysis that must be found if they are near enough.
        logical, intent(in) :: is_wanted(:)
        character(len=*), intent(in) :: what
        type(error_type), allocatable, intent(inout) :: error
        logical :: is_taken(size(is_wanted))
        integer :: i, j

        call check_true(error, nearest%is_complete, what//': all are found')
        is_taken = .false.
        do i = 1, size(nearest%values)
            j = minloc(merge(huge(1.0_wp), abs(it%spectrum%values - nearest%values(i)), is_taken), dim=1)
            call check_below(error, abs(it%spectrum%values(j) - nearest%values(i)), bounds(1)*abs(it%spectrum%values(j)) + &
                merge(0.0_wp, bounds(2), it%spectrum%cause(j) == of_motion), what//': difference of an eigenvalue')
            is_taken(j) = .true.
        end do
        ! No nearer one was missed.
        do j = 1, size(is_taken)
            if (is_taken(j) .or. size(nearest%values) == 0 .or. .not. is_wanted(j)) cycle
            call check_true(error, abs(it%spectrum%values(j) - shift) >= (1 - 1.0e-9_wp)*abs(nearest%values(min(k, &
                size(nearest%values))) - shift), what//': none is missed')
        end do
    end subroutine check_nearest
end module linearised
