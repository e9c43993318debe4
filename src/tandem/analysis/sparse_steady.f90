! SPDX-License-Identifier: MIT
!> Steady motions of large mechanisms, on the sparse form: coordinates, multipliers, and rates of motions that are free, with
!>
!>   Phi = 0,   C X q = nu,   M L X q + C' lambda - S - Q_A = 0.
!>
!> A steady motion is never isolated: moved along a symmetry it is another one, and nonholonomic rows leave families. So corrections
!> s have least norm, with J s + r as small as possible, and delta a bound on the effect of a direction without influence:
!>
!>   [delta, J; J', -delta] (y; s) = (-r; 0).
!>
!> delta grows if r does not fall (K. Levenberg, Quart. Appl. Math. 2, 1944; D. W. Marquardt, J. SIAM 11, 1963; as one sparse system
!> A. Björck, Numerical Methods for Least Squares Problems, 1996, section 2.7).
module tandem_analysis_sparse_steady
    use tandem_analysis_corotating_frame, only: fit_rates
    use tandem_analysis_sparse_point, only: sparse_point_type
    use tandem_analysis_steadiness, only: check_rows, check_symmetry
    use tandem_analysis_symmetry, only: is_named, list_motions, symmetry_type
    use tandem_error, only: error_type, set_error, to_text
    use tandem_kinds, only: wp
    use tandem_linalg_singular, only: singular_type
    use tandem_linalg_sparse_lu, only: sparse_lu_type, sparse_matrix_type
    use tandem_model, only: model_type
    use tandem_linalg_order, only: list_type
    use tandem_model_affine_motion, only: affine_motion_type
    use tandem_model_neighbours, only: find_neighbours, order_unknowns
    use tandem_saddle_sparse, only: most_factor_entries
    use tandem_status, only: status_invalid_option, status_no_equilibrium, status_ok, status_work_limit
    implicit none (type, external)
    private

    public :: find_steady_sparsely

    !> Unknowns and data of the search.
    type :: problem_type
        type(sparse_point_type) :: point
        !> The motions along which it continues, their rates, and the numbers of those with free rates.
        type(affine_motion_type), allocatable :: motions(:)
        real(wp), allocatable :: rates(:)
        integer, allocatable :: free(:)
        !> Order of elimination of coordinates and rows (n + m).
        integer, allocatable :: order(:)
        !> Units of forces and of velocities; the lengths of rows in scaled coordinates (m).
        real(wp) :: unit = 1.0_wp, speed = 1.0_wp
        real(wp), allocatable :: length(:)
        !> Derivatives of all residuals with respect to the free rates (n + m, free).
        real(wp), allocatable :: by_rate(:, :)
    contains
        procedure :: look, residual, differentiate, assemble, iterate
    end type problem_type

    !> Largest number of iterations, and of free rates.
    integer, parameter :: most_iterations = 60, most_rates = 100
    !> The longest step over the size of the coordinates, and one at rounding level.
    real(wp), parameter :: longest = 0.5_wp, rounding = 1.0e-9_wp
    !> Forces are in balance if their residual is at most this part of their terms.
    real(wp), parameter :: balance_bound = 1.0e-9_wp

contains

    !> The steady motion near (q, qd) along named motions, or along all that compose these velocities. If none is fixed, the rates
    !> stay those of the velocities, if possible; else they change too. Errors: no_equilibrium, invalid_option, work_limit,
    !> invalid_model if there is no sparse form, and statuses of evaluating the model.
    subroutine find_steady_sparsely(model, t, q, qd, iterations, error, names, held, held_at)
        class(model_type), intent(inout), target :: model
        real(wp), intent(in) :: t
        !> (n); unchanged if none is found.
        real(wp), intent(inout) :: q(:), qd(:)
        integer, intent(inout) :: iterations
        type(error_type), allocatable, intent(out) :: error
        !> As of `find_steady_motion` of `equilibrium_search_type`.
        character(len=*), intent(in), optional :: names(:), held(:)
        real(wp), intent(in), optional :: held_at(:)
        type(problem_type), allocatable :: problem
        type(list_type), allocatable :: neighbours(:)
        real(wp), allocatable :: rates(:)
        integer, allocatable :: free(:)
        integer :: attempt, stat

        allocate (problem)
        call problem%point%initialize(model, error)
        if (allocated(error)) return
        call find_neighbours(model%pattern, neighbours)
        call order_unknowns(model%pattern, neighbours, problem%order)
        call choose_motions(problem, q, qd, error, names, held, held_at)
        if (allocated(error)) return
        allocate (rates, source=problem%rates)
        allocate (free, source=problem%free)
        stat = status_no_equilibrium
        do attempt = 1, 2
            ! With constant rates, then with free rates.
            if (attempt == 1 .and. size(free) > 0 .and. size(free) < size(rates)) cycle
            if (attempt == 2 .and. (size(free) == 0 .or. size(free) > most_rates)) exit
            problem%rates = rates
            problem%free = free(:merge(0, size(free), attempt == 1))
            call problem%iterate(t, q, iterations, stat)
            if (stat /= status_no_equilibrium) exit
        end do
        if (stat == status_no_equilibrium) then
            call set_error(error, stat, 'no steady motion of the model "'//model%name//'" was found in '//to_text(iterations)// &
                ' iterations', 'start nearer to one, name the motions along which it continues, or prescribe other rates')
        else if (stat /= status_ok) then
            call set_error(error, stat, 'the model "'//model%name//'" cannot be evaluated in the search for its steady motion', &
                'start nearer to it, or check the procedures there with verify_model or tandem check')
        else
            if (problem%point%frame%moves) then
                call check_rows(problem%point, error)
                if (.not. allocated(error)) call check_symmetry(problem%point, error)
            end if
            if (allocated(error)) return
            q = problem%point%q
            qd = problem%point%frame%velocity(q)
        end if
    end subroutine find_steady_sparsely

    !> The motions, and rates that best fit the velocities.
    subroutine choose_motions(problem, q, qd, error, names, held, held_at)
        type(problem_type), intent(inout) :: problem
        real(wp), intent(in) :: q(:), qd(:)
        type(error_type), allocatable, intent(inout) :: error
        character(len=*), intent(in), optional :: names(:), held(:)
        real(wp), intent(in), optional :: held_at(:)
        type(symmetry_type) :: all_motions
        real(wp), allocatable :: rates(:)
        logical, allocatable :: is_kept(:), is_held(:)
        integer :: i, j

        call list_motions(problem%point%model, all_motions%motions)
        associate (motions => all_motions%motions)
            allocate (is_kept(size(motions)), is_held(size(motions)), source=.false.)
            if (present(names)) then
                call all_motions%check_names(problem%point%model, names, error)
                if (allocated(error)) return
                do i = 1, size(motions)
                    is_kept(i) = is_named(trim(motions(i)%name), names)
                end do
                allocate (rates(size(motions)), source=0.0_wp)
            else
                call fit_rates(motions, q, qd, rates)
                is_kept = abs(rates) > 0.0_wp
            end if
            if (present(held) .and. present(held_at)) then
                do j = 1, size(held)
                    do i = 1, size(motions)
                        if (motions(i)%name /= held(j)) cycle
                        is_kept(i) = .true.
                        is_held(i) = .true.
                        rates(i) = held_at(j)
                    end do
                end do
            end if
            if (present(names)) call fit_named(motions, is_kept .and. .not. is_held, q, qd, rates, error)
            if (allocated(error)) return
            problem%motions = pack_motions(motions, is_kept)
            problem%rates = pack(rates, is_kept)
            is_held = pack(is_held, is_kept)
            problem%free = pack([(i, i=1, size(is_held))], .not. is_held)
        end associate
    end subroutine choose_motions

    !> Some of all motions; gfortran's `pack` loses allocatable components.
    pure function pack_motions(motions, is_kept) result(some)
        type(affine_motion_type), intent(in) :: motions(:)
        logical, intent(in) :: is_kept(:)
        type(affine_motion_type), allocatable :: some(:)
        integer :: i, k

        allocate (some(count(is_kept)))
        k = 0
        do i = 1, size(motions)
            if (.not. is_kept(i)) cycle
            k = k + 1
            some(k) = motions(i)
        end do
    end function pack_motions

    !> Rates of motions that best fit X q to velocities, the least of several solutions.
    subroutine fit_named(motions, is_fitted, q, qd, rates, error)
        type(affine_motion_type), intent(in) :: motions(:)
        logical, intent(in) :: is_fitted(:)
        real(wp), intent(in) :: q(:), qd(:)
        !> Rates to be fitted are 0 on entry.
        real(wp), intent(inout) :: rates(:)
        type(error_type), allocatable, intent(inout) :: error
        type(singular_type) :: svd
        real(wp), allocatable :: x(:, :), c(:)
        real(wp) :: rest(size(q))
        integer, allocatable :: numbers(:)
        integer :: i

        numbers = pack([(i, i=1, size(motions))], is_fitted)
        if (size(numbers) > most_rates) then
            call set_error(error, status_invalid_option, to_text(size(numbers))//' motions are named, more than '// &
                to_text(most_rates), 'name smaller groups, or "any" for those present in the velocities at the start')
            return
        end if
        rest = qd
        do i = 1, size(motions)
            if (abs(rates(i)) > 0.0_wp) call motions(i)%add_field(q, -rates(i), rest)
        end do
        allocate (x(size(q), size(numbers)), source=0.0_wp)
        allocate (c(size(numbers)))
        do i = 1, size(numbers)
            call motions(numbers(i))%add_field(q, 1.0_wp, x(:, i))
        end do
        call svd%allocate(size(numbers), size(numbers))
        call svd%factor(matmul(transpose(x), x))
        call svd%solve(matmul(transpose(x), rest), c)
        rates(numbers) = c
    end subroutine fit_named

    !> Levenberg and Marquardt's iteration from q.
    subroutine iterate(self, t, q, iterations, stat)
        class(problem_type), intent(inout) :: self
        real(wp), intent(in) :: t, q(:)
        integer, intent(inout) :: iterations
        !> A status code; no_equilibrium if the iteration does not converge.
        integer, intent(out) :: stat
        !> Limits of delta, relative to the entries of J.
        real(wp), parameter :: least = 1.0e-8_wp, most = 1.0e3_wp
        type(sparse_matrix_type) :: a
        type(sparse_lu_type) :: lu
        real(wp), allocatable :: acceleration(:)
        real(wp), dimension(size(q)) :: from
        real(wp), dimension(self%point%m) :: lambda
        real(wp), dimension(size(q) + self%point%m) :: r
        real(wp) :: rates(size(self%rates)), delta, norm, length, size_of_q, factor
        complex(wp), allocatable :: b(:), y(:)
        integer, allocatable :: order(:)
        integer :: i, j, info, n, total

        n = size(q)
        total = n + self%point%m
        delta = least
        self%speed = 1.0_wp
        if (size(self%rates) > 0) self%speed = max(maxval(abs(self%rates)), tiny(1.0_wp))
        call self%point%frame%set(self%motions, self%rates)
        call self%point%look(t, q, stat)
        if (stat == status_ok) call self%point%find_dependent_rows(acceleration, stat)
        if (stat == status_ok) call self%look(t, q, stat)
        if (stat /= status_ok) return
        allocate (b(2*total + size(self%free)), y(2*total + size(self%free)))
        do i = 1, most_iterations
            iterations = iterations + 1
            call self%differentiate(i == 1, stat)
            if (stat /= status_ok) return
            call self%residual(r)
            norm = norm2(r)
            from = self%point%q
            lambda = self%point%lambda
            rates = self%rates
            size_of_q = 1 + maxval(abs(from/self%point%scale))
            do
                call self%assemble(delta, a, order)
                call lu%factor(a, order, most_factor_entries, info)
                if (info /= 0) then
                    stat = merge(status_work_limit, status_no_equilibrium, info < 0)
                    return
                end if
                b = (0.0_wp, 0.0_wp)
                b(:total) = -r
                call lu%solve_refined(a, b, y)
                length = maxval(abs([real(y(total + 1:total + n), wp), real(y(2*total + 1:), wp)]))
                if (length <= 1.0e-14_wp*size_of_q) exit
                factor = min(1.0_wp, longest*size_of_q/length)
                self%point%lambda = lambda + factor*self%unit/self%length*real(y(total + n + 1:2*total), wp)
                do j = 1, size(self%free)
                    self%rates(self%free(j)) = rates(self%free(j)) + factor*real(y(2*total + j), wp)
                end do
                call self%point%frame%set(self%motions, self%rates)
                call self%look(t, from + factor*self%point%scale*real(y(total + 1:total + n), wp), stat)
                if (stat == status_ok) then
                    call self%residual(r)
                    if (norm2(r) < norm) exit
                    call restore(stat)
                    if (stat /= status_ok) return
                    call self%residual(r)
                    ! No further improvement.
                    if (length <= rounding*size_of_q) exit
                else
                    call restore(stat)
                    if (stat /= status_ok) return
                end if
                delta = 10*delta
                if (delta > most) then
                    stat = status_no_equilibrium
                    return
                end if
            end do
            if (length <= 1.0e-14_wp*size_of_q .or. .not. norm2(r) < norm) exit
            delta = max(least, delta/10)
        end do
        associate (point => self%point)
            if (i > most_iterations .or. .not. max(point%imbalance(), point%violation()) <= balance_bound) stat = &
                status_no_equilibrium
        end associate

    contains

        !> Return to the start of the step.
        subroutine restore(stat)
            integer, intent(out) :: stat

            self%point%lambda = lambda
            self%rates = rates
            call self%point%frame%set(self%motions, self%rates)
            call self%look(t, from, stat)
        end subroutine restore
    end subroutine iterate

    !> Evaluate the model in the co-rotating frame.
    subroutine look(self, t, q, stat)
        class(problem_type), intent(inout) :: self
        real(wp), intent(in) :: t, q(:)
        !> A status code.
        integer, intent(out) :: stat

        call self%point%look(t, q, stat)
        if (stat == status_ok) call self%point%balance()
    end subroutine look

    !> Residuals of all equations (n + m).
    subroutine residual(self, r)
        class(problem_type), intent(in) :: self
        real(wp), intent(out) :: r(:)
        real(wp) :: rows(self%point%m)

        associate (point => self%point, terms => self%point%evaluator%terms)
            r(:point%n) = point%scale*point%residual/self%unit
            call point%pattern%multiply(terms%jacobian, point%rest, .false., rows)
            rows = (rows - terms%nu)/self%speed
            rows(:point%nh) = terms%phi
            r(point%n + 1:) = rows/self%length
        end associate
    end subroutine residual

    !> All derivatives at the point, at which the model is evaluated before and after.
    subroutine differentiate(self, is_first, stat)
        class(problem_type), intent(inout) :: self
        !> True if units are to be chosen.
        logical, intent(in) :: is_first
        !> A status code.
        integer, intent(out) :: stat
        !> Step of central differences of terms of second order in velocities.
        real(wp), parameter :: h = 2.0_wp**(-10)
        real(wp), dimension(self%point%n + self%point%m) :: ahead, behind
        real(wp) :: rates(size(self%rates)), q(self%point%n)
        integer :: j, k

        associate (point => self%point)
            call point%differentiate(.false., stat)
            if (stat /= status_ok) return
            if (is_first) then
                call measure(self)
                if (allocated(self%by_rate)) deallocate (self%by_rate)
                allocate (self%by_rate(point%n + point%m, size(self%free)))
            end if
            if (size(self%free) == 0) return
            rates = self%rates
            q = point%q
            do k = 1, size(self%free)
                do j = 1, 2
                    self%rates = rates
                    self%rates(self%free(k)) = rates(self%free(k)) + merge(h, -h, j == 1)*self%speed
                    call point%frame%set(self%motions, self%rates)
                    call self%look(point%t, q, stat)
                    if (stat /= status_ok) return
                    if (j == 1) call self%residual(ahead)
                    if (j == 2) call self%residual(behind)
                end do
                self%by_rate(:, k) = (ahead - behind)/(2*h*self%speed)
            end do
            self%rates = rates
            call point%frame%set(self%motions, self%rates)
            call self%look(point%t, q, stat)
        end associate
    end subroutine differentiate

    !> The unit of forces and the lengths of rows.
    subroutine measure(self)
        class(problem_type), intent(inout) :: self
        integer :: i, j, k

        associate (point => self%point, pattern => self%point%pattern)
            self%unit = 0.0_wp
            do j = 1, point%n
                do k = point%columns%start(j), point%columns%start(j + 1) - 1
                    self%unit = max(self%unit, abs(point%scale(point%columns%row(k))*point%stiffness(k)*point%scale(j)))
                end do
            end do
            if (.not. self%unit > 0.0_wp) self%unit = 1.0_wp
            self%length = spread(0.0_wp, 1, point%m)
            do i = 1, point%m
                do k = pattern%row_start(i), pattern%row_start(i + 1) - 1
                    do j = pattern%first(pattern%row_body(k)), pattern%first(pattern%row_body(k) + 1) - 1
                        self%length(i) = self%length(i) + (point%evaluator%terms%jacobian(i, pattern%column(j))*point%scale(j))**2
                    end do
                end do
            end do
            self%length = sqrt(self%length)
            where (.not. self%length > 0.0_wp) self%length = 1.0_wp
        end associate
    end subroutine measure

    !> [delta, J; J', -delta] of scaled coordinates, multipliers and rates, and the order of its columns.
    subroutine assemble(self, delta, a, order)
        class(problem_type), intent(in) :: self
        real(wp), intent(in) :: delta
        type(sparse_matrix_type), intent(inout) :: a
        integer, allocatable, intent(out) :: order(:)
        integer, allocatable :: next(:)
        integer :: i, j, k, pass, n, total
        real(wp) :: value

        associate (point => self%point, pattern => self%point%pattern)
            n = point%n
            total = n + point%m
            a%n = 2*total + size(self%free)
            allocate (order(a%n))
            do k = 1, total
                order(2*k - 1) = self%order(k)
                order(2*k) = total + self%order(k)
            end do
            do k = 1, size(self%free)
                order(2*total + k) = 2*total + k
            end do
            allocate (next(a%n + 1), source=0)
            do pass = 1, 2
                do i = 1, total
                    call put(i, i, delta)
                    call put(total + i, total + i, -delta)
                end do
                do j = 1, n
                    do k = point%columns%start(j), point%columns%start(j + 1) - 1
                        i = point%columns%row(k)
                        call put_both(i, j, point%scale(i)*point%stiffness(k)*point%scale(j)/self%unit)
                    end do
                end do
                do i = 1, point%m
                    do k = pattern%row_start(i), pattern%row_start(i + 1) - 1
                        do j = pattern%first(pattern%row_body(k)), pattern%first(pattern%row_body(k) + 1) - 1
                            value = point%evaluator%terms%jacobian(i, pattern%column(j))*point%scale(j)/self%length(i)
                            call put_both(j, n + i, value)
                            if (i > point%nh) value = self%point%turning(i, pattern%column(j))*point%scale(j)/ &
                                (self%length(i)*self%speed)
                            call put_both(n + i, j, value)
                        end do
                    end do
                end do
                do k = 1, size(self%free)
                    call put(2*total + k, 2*total + k, -delta)
                    do i = 1, total
                        call put_both(i, total + k, self%by_rate(i, k))
                    end do
                end do
                if (pass == 2) exit
                a%start = spread(1, 1, a%n + 1)
                do j = 1, a%n
                    a%start(j + 1) = a%start(j) + next(j)
                end do
                next = a%start
                a%row = spread(0, 1, a%start(a%n + 1) - 1)
                a%value = spread((0.0_wp, 0.0_wp), 1, a%start(a%n + 1) - 1)
            end do
        end associate

    contains

        !> An entry of J, by the number of an equation and of an unknown.
        subroutine put_both(equation, unknown, entry)
            integer, intent(in) :: equation, unknown
            real(wp), intent(in) :: entry

            if (.not. abs(entry) > 0.0_wp) return
            call put(equation, total + unknown, entry)
            call put(total + unknown, equation, entry)
        end subroutine put_both

        subroutine put(row, column, entry)
            integer, intent(in) :: row, column
            real(wp), intent(in) :: entry

            if (pass == 2) then
                a%row(next(column)) = row
                a%value(next(column)) = entry
            end if
            next(column) = next(column) + 1
        end subroutine put
    end subroutine assemble
end module tandem_analysis_sparse_steady
