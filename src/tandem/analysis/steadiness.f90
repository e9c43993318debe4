! SPDX-License-Identifier: MIT
!> Whether a large mechanism goes on steadily along its field X: its velocities satisfy the constraints, its acceleration is L X q,
!> and a state beside it, carried along for a while, accelerates as it did before, so that X leaves the equations as they are.
module tandem_analysis_steadiness
    use tandem_analysis_sparse_point, only: most_factor_entries, sparse_point_type
    use tandem_error, only: error_type, set_error
    use tandem_kinds, only: wp
    use tandem_linalg_random, only: random_vector
    use tandem_linalg_sparse_lu, only: sparse_lu_type, sparse_matrix_type
    use tandem_status, only: status_inconsistent_start, status_no_equilibrium, status_ok
    implicit none (type, external)
    private

    public :: check_rows, check_symmetry

    !> Rows and accelerations agree to this part of their size.
    real(wp), parameter :: bound = 1.0e-8_wp
    !> How far the state beside is away, in coordinate scales.
    real(wp), parameter :: beside = 2.0_wp**(-6)
    character(len=*), parameter :: advice = 'eigenvalues near a shift are those of an equilibrium or of a steady motion'

contains

    !> Refuse velocities that rows do not allow, and accelerations that are not those of the frame, of a point that was looked at.
    subroutine check_rows(point, error)
        type(sparse_point_type), intent(in) :: point
        type(error_type), allocatable, intent(inout) :: error
        real(wp), dimension(point%m) :: rows, sizes

        associate (terms => point%evaluator%terms, pattern => point%pattern)
            call pattern%multiply(terms%jacobian, point%rest, .false., rows)
            call pattern%multiply(terms%jacobian, point%rest, .true., sizes)
            if (any(abs(rows - terms%nu) > bound*max(sizes, 1.0e-6_wp*maxval([0.0_wp, sizes])))) then
                call set_error(error, status_inconsistent_start, 'the velocities of the model "'//point%model%name// &
                    '" violate its constraints', 'let [initial] assemble find others')
                return
            end if
            call pattern%multiply(terms%jacobian, point%frame%turned(point%rest), .false., rows)
            call pattern%multiply(terms%jacobian, point%frame%turned(point%rest), .true., sizes)
            sizes = sizes + abs(terms%gamma)
            if (any(abs(rows + terms%gamma) > bound*max(sizes, 1.0e-6_wp*maxval([0.0_wp, sizes])))) call set_error(error, &
                status_no_equilibrium, 'the constraints of the model "'//point%model%name//'" lead it away from a steady motion', &
                advice)
        end associate
    end subroutine check_rows

    !> Refuse a field along which the equations change. The point is looked at again afterwards, with its multipliers.
    subroutine check_symmetry(point, error)
        type(sparse_point_type), intent(inout) :: point
        type(error_type), allocatable, intent(inout) :: error
        real(wp), dimension(point%n) :: q, qd, start
        real(wp) :: vectors(point%n, 2), lambda(point%m), time, duration
        logical :: is_out(point%m)
        real(wp), allocatable :: acceleration(:)
        integer :: seed, stat

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
        if (stat == status_ok) call point%find_dependent_rows(acceleration, stat)
        if (stat /= status_ok) then
            call set_error(error, stat, 'the model "'//point%model%name//'" cannot be evaluated beside its steady motion')
        else if (any(abs(acceleration - vectors(:, 2)) > bound*point%scale*maxval(abs(acceleration/point%scale))) .or. &
            point%violation() > bound) then
            call set_error(error, status_no_equilibrium, 'the equations of the model "'//point%model%name// &
                '" change as it goes on, so that it does not move steadily', advice)
        end if
        point%is_out = is_out
        point%lambda = lambda
        call point%look(time, start, stat)
    end subroutine check_symmetry

    !> A state on the manifold beside the point, in simplified Newton iterations with the matrix of this.
    subroutine go_beside(point, seed, q, qd, stat)
        type(sparse_point_type), intent(inout) :: point
        integer, intent(inout) :: seed
        real(wp), intent(out) :: q(:), qd(:)
        integer, intent(out) :: stat
        complex(wp), parameter :: mass_only(3) = [(1.0_wp, 0.0_wp), (0.0_wp, 0.0_wp), (0.0_wp, 0.0_wp)]
        integer, parameter :: most = 30
        type(sparse_matrix_type) :: a
        type(sparse_lu_type) :: lu
        integer, allocatable :: order(:)
        real(wp), dimension(point%n) :: change, none
        real(wp) :: unit, g(point%m), unused(point%m)
        integer :: i

        none = 0.0_wp
        call point%assemble(mass_only, a, order, unit)
        call lu%factor(a, order, most_factor_entries, stat)
        if (stat /= 0) return
        q = point%q + beside*point%scale*random_vector(seed, point%n)
        do i = 1, most
            call point%look(point%t, q, stat)
            if (stat /= status_ok) return
            g = 0.0_wp
            g(:point%nh) = -point%evaluator%terms%phi
            call point%solve(a, lu, unit, none, g, change, unused)
            q = q + change
            if (maxval(abs(change/point%scale)) < 1.0e-13_wp*(1 + maxval(abs(q/point%scale)))) exit
        end do
        qd = point%frame%velocity(q)
        qd = qd + beside*maxval(abs(qd/point%scale))*point%scale*random_vector(seed, point%n)
        call point%look(point%t, q, stat, qd)
        if (stat /= status_ok) return
        call point%assemble(mass_only, a, order, unit)
        call lu%factor(a, order, most_factor_entries, stat)
        if (stat /= 0) return
        call point%pattern%multiply(point%evaluator%terms%jacobian, qd, .false., g)
        call point%solve(a, lu, unit, none, -g, change, unused)
        qd = qd + change
    end subroutine go_beside
end module tandem_analysis_steadiness
