! SPDX-License-Identifier: MIT
!> C interface to equilibria and linearised systems; see `tandem_legacy_c`.
module tandem_legacy_c_analysis
    use tandem_legacy_c_text, only: text_of
    use tandem_legacy_handle, only: find => problem_of
    use tandem_legacy_problem, only: problem_type
    use tandem_status, only: status_invalid_option
    use, intrinsic :: iso_c_binding, only: c_associated, c_double, c_int, c_ptr
    implicit none (type, external)
    private

    public :: c_linearise, c_find_equilibrium, c_find_steady_motion

contains

    !> Compute the eigenvalues of small motions about a state.
    integer(c_int) function c_linearise(handle, t, q, qd, count, re, im, a) bind(C, name='tandem_linearise')
        type(c_ptr), value :: handle
        real(c_double), value :: t
        !> Coordinates and velocities (n).
        real(c_double), intent(in), optional :: q(*), qd(*)
        !> Number of eigenvalues, at most 2 n.
        integer(c_int), intent(inout), optional :: count
        !> Real and imaginary parts of the eigenvalues, arrays of size 2 n; system matrix, an array of size 4 n^2.
        real(c_double), intent(inout), optional :: re(*), im(*), a(*)
        type(problem_type), pointer :: problem

        c_linearise = status_invalid_option
        call find(handle, problem)
        if (.not. associated(problem)) return
        if (present(q) .and. present(qd) .and. present(count) .and. present(re) .and. present(im)) then
            call problem%linearise(t, q, qd, count, re, im, a)
        else
            call problem%refuse('q, qd, count, re or im is NULL', 'only the matrix may be left out')
        end if
        c_linearise = problem%stat
    end function c_linearise

    !> Find the equilibrium nearest to given coordinates.
    integer(c_int) function c_find_equilibrium(handle, t, q) bind(C, name='tandem_find_equilibrium')
        type(c_ptr), value :: handle
        real(c_double), value :: t
        !> Coordinates (n): a guess on entry, the equilibrium on return.
        real(c_double), intent(inout), optional :: q(*)
        type(problem_type), pointer :: problem

        c_find_equilibrium = status_invalid_option
        call find(handle, problem)
        if (.not. associated(problem)) return
        if (present(q)) then
            call problem%find_equilibrium(t, q)
        else
            call problem%refuse('q is NULL', 'pass coordinates near the equilibrium')
        end if
        c_find_equilibrium = problem%stat
    end function c_find_equilibrium

    !> Find the steady motion nearest to a given state.
    integer(c_int) function c_find_steady_motion(handle, t, q, qd, motions) bind(C, name='tandem_find_steady_motion')
        type(c_ptr), value :: handle
        real(c_double), value :: t
        !> Coordinates and velocities (n): a guess on entry, the steady motion on return.
        real(c_double), intent(inout), optional :: q(*), qd(*)
        !> Names of the motions of symmetry along which the motion is steady, separated by blanks or commas, as a C string; NULL for
        !> all symmetries of the model.
        type(c_ptr), value :: motions
        type(problem_type), pointer :: problem

        c_find_steady_motion = status_invalid_option
        call find(handle, problem)
        if (.not. associated(problem)) return
        if (.not. (present(q) .and. present(qd))) then
            call problem%refuse('q or qd is NULL', 'pass a state near the steady motion')
        else if (c_associated(motions)) then
            call problem%find_steady_motion(t, q, qd, text_of(motions))
        else
            call problem%find_steady_motion(t, q, qd, '')
        end if
        c_find_steady_motion = problem%stat
    end function c_find_steady_motion
end module tandem_legacy_c_analysis
