! SPDX-License-Identifier: MIT
!> Check that a large mechanism moves steadily along its field X: its velocities satisfy the constraints, its acceleration is L X q,
!> and a neighbouring state keeps its accelerations when moved along X, so that X does not change the equations.
module tandem_analysis_steadiness
    use tandem_analysis_sparse_point, only: sparse_point_type
    use tandem_error, only: error_type, set_error
    use tandem_kinds, only: wp
    use tandem_linalg_random, only: random_vector
    use tandem_saddle_sparse, only: sparse_saddle_type
    use tandem_status, only: status_inconsistent_start, status_no_equilibrium, status_ok
    implicit none (type, external)
    private

    public :: check_rows, check_symmetry

    !> Rows and accelerations agree to this part of their size.
    real(wp), parameter :: bound = 1.0e-8_wp
    !> Distance of the neighbouring state, in coordinate scales.
    real(wp), parameter :: beside = 2.0_wp**(-6)
    character(len=*), parameter :: advice = 'name the motions along which it is steady, or start in a steady motion'

contains

    !> Refuse velocities that violate rows, and accelerations that differ from those of the frame, at an evaluated point.
    subroutine check_rows(point, error)
        type(sparse_point_type), intent(in) :: point
        type(error_type), allocatable, intent(inout) :: error
        real(wp), dimension(point%m) :: rows, sizes
        integer :: i

        associate (terms => point%evaluator%terms, pattern => point%pattern)
            call velocity_rows(point, point%rest, rows, sizes)
            if (any(abs(rows) > bound*sizes)) then
                call set_error(error, status_inconsistent_start, 'the velocities of the model "'//point%model%name// &
                    '" violate its constraints', 'assemble the start')
                return
            end if
            call pattern%multiply(terms%jacobian, point%frame%turned(point%rest), .false., rows)
            call pattern%multiply(terms%jacobian, point%frame%turned(point%rest), .true., sizes)
            sizes = sizes + abs(terms%gamma)
            rows = abs(rows + terms%gamma)/max(sizes, 1.0e-6_wp*maxval([0.0_wp, sizes]), tiny(1.0_wp))
            i = maxloc(rows, dim=1)
            if (any(rows > bound)) call set_error(error, status_no_equilibrium, 'the constraint "'//point%model%row_name(i)// &
                '" moves the model "'//point%model%name//'" away from a steady motion', advice)
        end associate
    end subroutine check_rows

    !> C qd - nu with the evaluator's terms, and the sizes of its terms.
    subroutine velocity_rows(point, qd, rows, sizes)
        type(sparse_point_type), intent(in) :: point
        !> (n), (m), (m).
        real(wp), intent(in) :: qd(:)
        real(wp), intent(out) :: rows(:), sizes(:)

        associate (terms => point%evaluator%terms)
            call point%pattern%multiply(terms%jacobian, qd, .false., rows)
            call point%pattern%multiply(terms%jacobian, qd, .true., sizes)
            rows = rows - terms%nu
            sizes = sizes + abs(terms%nu)
            sizes = max(sizes, 1.0e-6_wp*maxval([0.0_wp, sizes]))
        end associate
    end subroutine velocity_rows

    !> Refuse a field along which the equations change. The point is evaluated again afterwards, with its multipliers.
    subroutine check_symmetry(point, error)
        type(sparse_point_type), intent(inout) :: point
        type(error_type), allocatable, intent(inout) :: error
        real(wp), dimension(point%n) :: q, qd, start
        real(wp) :: vectors(point%n, 2), lambda(point%m), rows(point%m), sizes(point%m), time, duration
        logical :: is_out(point%m)
        real(wp), allocatable :: acceleration(:)
        integer :: i, seed, stat

        time = point%t
        start = point%q
        lambda = point%lambda
        is_out = point%is_out
        ! Half a radian, or half a metre.
        duration = 0.5_wp/maxval(abs(point%frame%rates))
        seed = 7654321
        call go_beside(point, seed, q, qd, stat)
        if (stat == status_ok) call point%look(time, q, stat, qd)
        if (stat == status_ok) call point%find_dependent_rows(acceleration, stat)
        if (stat == status_ok) then
            vectors(:, 1) = qd
            vectors(:, 2) = acceleration
            call point%frame%carry(duration, q, vectors)
            call point%look(time + duration, q, stat, vectors(:, 1))
        end if
        if (stat == status_ok) then
            ! Rows are named: functions of the time other than constant rates are the usual reason.
            call velocity_rows(point, vectors(:, 1), rows, sizes)
            i = maxloc(abs(rows)/max(sizes, tiny(1.0_wp)), dim=1)
            if (any(abs(rows) > bound*sizes)) call set_error(error, status_no_equilibrium, 'the constraint "'// &
                point%model%row_name(i)//'" of the model "'//point%model%name//'" changes along the motion, which is not '// &
                'steady', 'start in a steady motion, and use functions of time with constant rates')
            call point%find_dependent_rows(acceleration, stat)
        end if
        if (stat /= status_ok) then
            call set_error(error, stat, 'the model "'//point%model%name//'" cannot be evaluated near its steady motion')
        else if (allocated(error)) then
            continue
        else if (any(abs(acceleration - vectors(:, 2)) > bound*point%scale*maxval(abs(acceleration/point%scale))) .or. &
            point%violation() > bound) then
            call set_error(error, status_no_equilibrium, 'the equations of the model "'//point%model%name// &
                '" change along the motion, which is not steady', advice)
        end if
        point%is_out = is_out
        point%lambda = lambda
        call point%look(time, start, stat)
    end subroutine check_symmetry

    !> A state on the manifold beside the point, by simplified Newton iterations with the matrix of the point.
    subroutine go_beside(point, seed, q, qd, stat)
        type(sparse_point_type), intent(inout) :: point
        integer, intent(inout) :: seed
        real(wp), intent(out) :: q(:), qd(:)
        integer, intent(out) :: stat
        complex(wp), parameter :: mass_only(3) = [(1.0_wp, 0.0_wp), (0.0_wp, 0.0_wp), (0.0_wp, 0.0_wp)]
        integer, parameter :: most = 30
        type(sparse_saddle_type) :: saddle
        real(wp), dimension(point%n) :: change, none
        real(wp) :: g(point%m), unused(point%m)
        integer :: i

        none = 0.0_wp
        call point%load(mass_only, saddle)
        call saddle%factor(stat)
        if (stat /= 0) return
        q = point%q + beside*point%scale*random_vector(seed, point%n)
        do i = 1, most
            call point%look(point%t, q, stat)
            if (stat /= status_ok) return
            g = 0.0_wp
            g(:point%nh) = -point%evaluator%terms%phi
            call saddle%solve(none, g, change, unused)
            q = q + change
            if (maxval(abs(change/point%scale)) < 1.0e-13_wp*(1 + maxval(abs(q/point%scale)))) exit
        end do
        qd = point%frame%velocity(q)
        qd = qd + beside*maxval(abs(qd/point%scale))*point%scale*random_vector(seed, point%n)
        call point%look(point%t, q, stat, qd)
        if (stat /= status_ok) return
        call point%load(mass_only, saddle)
        call saddle%factor(stat)
        if (stat /= 0) return
        call velocity_rows(point, qd, g, unused)
        call saddle%solve(none, -g, change, unused)
        qd = qd + change
    end subroutine go_beside
end module tandem_analysis_steadiness
