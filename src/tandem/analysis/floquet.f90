! SPDX-License-Identifier: MIT
!> Floquet multipliers: the growth of small motions over one period of a periodic motion, by the variational equations along it.
!>
!> The motion and its neighbours, X' = A(t) X in the model's coordinates, are integrated together by extrapolation of the modified
!> midpoint rule. A steady motion closes up to the action of its symmetries in the time, T(tau): the multipliers are then the
!> eigenvalues of T(tau)^-1 X(tau), and ln(mu)/tau those of the matrix of `tandem_analysis_linearisation`, computed independently:
!> without derivatives of the symmetries.
!>
!> Source: E. Hairer, S. P. Norsett, G. Wanner, Solving Ordinary Differential Equations I, section II.9.
module tandem_analysis_floquet
    use tandem_analysis_linearisation, only: linearisation_type
    use tandem_analysis_point, only: point_type
    use tandem_error, only: error_type, set_error, to_text
    use tandem_kinds, only: wp
    use tandem_linalg_eigenvalues, only: find_eigenvalues
    use tandem_model, only: model_type
    use tandem_status, only: status_invalid_option, status_ok, status_work_limit
    implicit none (type, external)
    private

    public :: floquet_type, exponential

    type :: floquet_type
        !> The period of the motion.
        real(wp) :: period = 0.0_wp
        !> Multipliers, and ln(mu)/period with imaginary parts up to pi/period, sorted by their real parts.
        complex(wp), allocatable :: multipliers(:), exponents(:)
        !> Distance of the motion from its start after the period, in scaled coordinates and velocities.
        real(wp) :: gap = 0.0_wp
        !> Steps of the extrapolation.
        integer :: steps = 0
    contains
        procedure :: find
    end type floquet_type

    !> Columns of the extrapolation, the most steps, and the permitted relative error of a step.
    integer, parameter :: columns = 8, most_steps = 2000
    real(wp), parameter :: tolerance = 1.0e-13_wp
    !> A motion that is further from its start than this, over its size, is not periodic.
    real(wp), parameter :: closed = 1.0e-6_wp

contains

    !> The multipliers of the motion of a linearised system, over a time. Errors: invalid_option if it is not periodic with this
    !> time, work_limit, and statuses of evaluating the model.
    subroutine find(self, it, model, period, error)
        class(floquet_type), intent(out) :: self
        type(linearisation_type), intent(in) :: it
        !> The model of the linearised system.
        class(model_type), intent(inout), target :: model
        real(wp), intent(in) :: period
        type(error_type), allocatable, intent(out) :: error
        type(point_type), allocatable :: point
        real(wp) :: y(2*size(it%q), 1 + it%nv + it%nw), monodromy(it%nv + it%nw, it%nv + it%nw)
        real(wp), dimension(it%nv + it%nw) :: condition
        complex(wp) :: vectors(it%nv + it%nw, it%nv + it%nw)
        integer :: n, stat

        if (.not. (period > 0.0_wp .and. period <= huge(period))) then
            call set_error(error, status_invalid_option, 'the period '//to_text(period)//' is not a positive number')
            return
        end if
        n = size(it%q)
        self%period = period
        allocate (point)
        call point%initialize(model)
        y = 0.0_wp
        y(:n, 1) = it%q
        y(n + 1:, 1) = it%qd
        y(:n, 2:1 + it%nv) = it%v
        y(n + 1:, 2:1 + it%nv) = it%g
        y(n + 1:, 2 + it%nv:) = it%w
        call integrate(point, it%t, period, y, self%steps, stat)
        if (stat == status_work_limit) then
            call set_error(error, stat, 'the model "'//model%name//'" could not be integrated over '//to_text(period)//' s in '// &
                to_text(most_steps)//' steps of the extrapolation', 'use a shorter period; for a steady motion any time is valid')
            return
        end if
        call point%describe(stat, 'could not be integrated over the period', error)
        if (allocated(error)) return
        call go_back(it, period, y)
        self%gap = max(maxval(abs(y(:n, 1) - it%q)/point%scale)/(1 + maxval(abs(it%q)/point%scale)), &
            maxval(abs(y(n + 1:, 1) - it%qd)/point%scale)/(1 + maxval(abs(it%qd)/point%scale)))
        if (self%gap > closed) then
            call set_error(error, status_invalid_option, 'the motion is not periodic with '//to_text(period)//' s: the gap is '// &
                to_text(self%gap)//' of its size', 'use the period of a periodic motion, or any time for a steady one')
            return
        end if
        monodromy(:it%nv, :) = matmul(it%dual_v, y(:n, 2:))
        monodromy(it%nv + 1:, :) = matmul(it%dual_w, y(n + 1:, 2:))
        allocate (self%multipliers(it%nv + it%nw))
        call find_eigenvalues(monodromy, self%multipliers, vectors, condition, stat)
        if (stat /= 0) then
            call set_error(error, status_work_limit, 'the multipliers did not converge')
            return
        end if
        call sort(self)
    end subroutine find

    !> The exponents, and both in the order of their real parts.
    subroutine sort(self)
        type(floquet_type), intent(inout) :: self
        complex(wp) :: swap
        integer :: i, k

        do i = 1, size(self%multipliers) - 1
            k = i - 1 + minloc(abs(self%multipliers(i:)), dim=1)
            swap = self%multipliers(i)
            self%multipliers(i) = self%multipliers(k)
            self%multipliers(k) = swap
        end do
        allocate (self%exponents(size(self%multipliers)))
        do i = 1, size(self%multipliers)
            self%exponents(i) = cmplx(-huge(1.0_wp), 0.0_wp, wp)
            if (abs(self%multipliers(i)) > 0.0_wp) self%exponents(i) = log(self%multipliers(i))/self%period
        end do
    end subroutine sort

    !> y := T(period)^-1 y for the symmetries of the motion: the state and its neighbours.
    subroutine go_back(it, period, y)
        type(linearisation_type), intent(in) :: it
        real(wp), intent(in) :: period
        real(wp), intent(inout) :: y(:, :)
        real(wp) :: field(size(it%q) + 1, size(it%q) + 1), turn(size(it%q) + 1, size(it%q) + 1)
        integer :: n

        n = size(it%q)
        field = 0.0_wp
        field(:n, :n) = it%symmetry%matrix(it%rates, n)
        field(:n, n + 1) = it%symmetry%field(it%rates, spread(0.0_wp, 1, n))
        turn = exponential(-period*field)
        y(:n, :) = matmul(turn(:n, :n), y(:n, :))
        y(n + 1:, :) = matmul(turn(:n, :n), y(n + 1:, :))
        y(:n, 1) = y(:n, 1) + turn(:n, n + 1)
    end subroutine go_back

    !> exp(A) by its series, after halving the argument, and squaring. For matrices of rotations there is no cancellation.
    function exponential(a) result(e)
        real(wp), intent(in) :: a(:, :)
        real(wp) :: e(size(a, 1), size(a, 1)), term(size(a, 1), size(a, 1)), part(size(a, 1), size(a, 1))
        integer :: halvings, i

        halvings = max(0, ceiling(log(max(norm2(a), tiny(1.0_wp))*4)/log(2.0_wp)))
        part = a/2.0_wp**halvings
        e = 0.0_wp
        do i = 1, size(a, 1)
            e(i, i) = 1.0_wp
        end do
        term = e
        do i = 1, 16
            term = matmul(term, part)/i
            e = e + term
        end do
        do i = 1, halvings
            e = matmul(e, e)
        end do
    end function exponential

    !> Integrate y = [(q, qd), X] from t over a time.
    subroutine integrate(point, t, period, y, steps, stat)
        type(point_type), intent(inout) :: point
        real(wp), intent(in) :: t, period
        real(wp), intent(inout) :: y(:, :)
        integer, intent(out) :: steps
        !> A status code.
        integer, intent(out) :: stat
        real(wp) :: next(size(y, 1), size(y, 2)), done, h, error
        integer :: tries

        done = 0.0_wp
        h = min(period, 0.05_wp)
        steps = 0
        do tries = 1, most_steps
            if (done >= period) return
            ! No tiny step at the end.
            if (period - done < 1.01_wp*h) h = period - done
            call extrapolate(point, t + done, h, y, next, error, stat)
            if (stat == status_ok .and. error <= tolerance) then
                done = done + h
                if (period - done <= epsilon(1.0_wp)*period) done = period
                y = next
                steps = steps + 1
                if (error < 0.01_wp*tolerance) h = 1.3_wp*h
            else
                h = h/2
            end if
        end do
        if (stat == status_ok) stat = status_work_limit
    end subroutine integrate

    !> A step by the modified midpoint rule with 2, 4, ..., 2 columns parts, extrapolated in the square of their size.
    subroutine extrapolate(point, t, h, y, next, error, stat)
        type(point_type), intent(inout) :: point
        real(wp), intent(in) :: t, h, y(:, :)
        real(wp), intent(out) :: next(:, :)
        !> Difference of the last two extrapolations over the largest value of each level, on the scales of the model.
        real(wp), intent(out) :: error
        integer, intent(out) :: stat
        real(wp), dimension(size(y, 1), size(y, 2)) :: before, now, after, slope, change
        real(wp), allocatable :: table(:, :, :)
        real(wp) :: part, ratio, unit(size(y, 1))
        integer :: j, k, i, parts

        error = huge(error)
        allocate (table(size(y, 1), size(y, 2), columns))
        do j = 1, columns
            parts = 2*j
            part = h/parts
            call rates(point, t, y, slope, stat)
            if (stat /= status_ok) return
            before = y
            now = y + part*slope
            do i = 1, parts - 1
                call rates(point, t + i*part, now, slope, stat)
                if (stat /= status_ok) return
                after = before + 2*part*slope
                before = now
                now = after
            end do
            call rates(point, t + h, now, slope, stat)
            if (stat /= status_ok) return
            table(:, :, j) = (now + before + part*slope)/2
            change = table(:, :, j)
            do k = j - 1, 1, -1
                ratio = (real(j, wp)/k)**2 - 1
                if (k == 1) change = table(:, :, 1)
                table(:, :, k) = table(:, :, k + 1) + (table(:, :, k + 1) - table(:, :, k))/ratio
            end do
        end do
        next = table(:, :, 1)
        ! Separately for each column, because columns grow differently.
        error = 0.0_wp
        unit = [point%scale, point%rate*point%scale]
        do j = 1, size(y, 2)
            error = max(error, maxval(abs(next(:, j) - change(:, j))/unit)/max(1.0_wp, maxval(abs(next(:, j))/unit)))
        end do
    end subroutine extrapolate

    !> The rates of the state and of its neighbours.
    subroutine rates(point, t, y, slope, stat)
        type(point_type), intent(inout) :: point
        real(wp), intent(in) :: t, y(:, :)
        real(wp), intent(out) :: slope(:, :)
        integer, intent(out) :: stat
        real(wp), dimension(point%n, size(y, 2) - 1) :: dq, dqd, dqdd
        integer :: n, i

        n = point%n
        call point%evaluate(t, y(:n, 1), y(n + 1:, 1), stat)
        if (stat /= status_ok) return
        call point%make_bases()
        call point%refuse_friction(stat)
        if (stat == status_ok) call point%solve_dynamics(stat)
        if (stat == status_ok) call point%differentiate(stat)
        if (stat /= status_ok) return
        slope(:n, :) = y(n + 1:, :)
        slope(n + 1:, 1) = point%qdd
        do i = 1, n
            dq(i, :) = y(i, 2:)/point%scale(i)
            dqd(i, :) = y(n + i, 2:)/point%scale(i)
        end do
        call point%vary_acceleration(dq, dqd, dqdd)
        do i = 1, n
            slope(n + i, 2:) = point%scale(i)*dqdd(i, :)
        end do
    end subroutine rates
end module tandem_analysis_floquet
