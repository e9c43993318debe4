! SPDX-License-Identifier: MIT
!> Derivatives of the terms of a model by differences, as references for its procedures. Coordinates that change no row and no force
!> in common are displaced together, so that the number of evaluations does not grow with the number of bodies.
module tandem_model_reference
    use tandem_kinds, only: wp
    use tandem_linalg_random, only: random_vector
    use tandem_model, only: model_type
    use tandem_model_counts, only: counts_type
    use tandem_model_evaluator, only: evaluator_type
    use tandem_model_structure, only: structure_type
    use tandem_model_terms, only: need_force, need_gamma, need_jacobian, need_mass, need_nu, need_phi
    use tandem_status, only: status_not_evaluable, status_ok
    implicit none (type, external)
    private

    public :: reference_type, least_size, of_phi, of_c_qd, of_c_qdd, of_nu, of_gamma, of_mass, of_reaction, of_force

    !> Parts to be differentiated: of the constraint rows and of the forces.
    integer, parameter :: of_phi = 1, of_c_qd = 2, of_c_qdd = 3, of_nu = 4, of_gamma = 5, n_of_rows = 5
    integer, parameter :: of_mass = 1, of_reaction = 2, of_force = 3, n_of_forces = 3

    !> Fourth-order difference (8 (f(1) - f(-1)) - (f(2) - f(-2)))/(12 h). It is accumulated by sum := factor sum + sign f(place),
    !> in an order in which a constant, however large, cancels exactly, even with fused multiply-add instructions.
    real(wp), parameter :: offsets(4) = [-1.0_wp, 1.0_wp, 2.0_wp, -2.0_wp]
    real(wp), parameter :: sign_of(4) = [-1.0_wp, 1.0_wp, -1.0_wp, 1.0_wp], factor(4) = [1.0_wp, 1.0_wp, 8.0_wp, 1.0_wp]
    real(wp), parameter :: divisor = 12.0_wp
    !> Estimated relative error at which steps in coordinates are not shortened any more; smallest size to which errors of
    !> derivatives are related.
    real(wp), parameter :: enough = 3.0e-11_wp, least_size = 1.0e-3_wp

    !> Steps in time: the longest one, and the factor of the following ones. The rate at which a model changes with time is unknown
    !> in advance. Among neighbouring steps, the best agreement identifies a step that is neither too long nor dominated by the
    !> rounding of t. The longest step is not a simple fraction of a second, for which a motion with a whole number of periods per
    !> second would appear constant.
    integer, parameter :: n_steps = 14
    real(wp), parameter :: longest_step = 0.2887_wp, next_step = 0.25_wp

    !> Values of all parts: of the rows (m, parts) and of the forces (n, parts).
    type :: values_type
        real(wp), allocatable :: rows(:, :), forces(:, :)
    end type values_type

    !> A state and the derivatives of each part there.
    type :: reference_type
        type(structure_type) :: structure
        !> Time, coordinates, velocities, accelerations, coordinate scales (n), multipliers (m).
        real(wp) :: t = 0.0_wp, time_scale = 1.0_wp
        real(wp), allocatable :: q(:), qd(:), qdd(:), scale(:), lambda(:)
        !> Scale of each row of C: its largest entry times the scale of the entry's coordinate.
        real(wp), allocatable :: row_scale(:)
        !> Derivatives with respect to q (m, width, parts) and (n, width, parts); with respect to qd of gamma (m, width) and of the
        !> forces (n, width).
        real(wp), allocatable :: rows_q(:, :, :), forces_q(:, :, :), gamma_qd(:, :), force_qd(:, :)
        !> Derivatives with respect to time: Phi_t (nh) and gamma (m); their uncertainties.
        real(wp), allocatable :: phi_t(:), gamma(:)
        real(wp) :: uncertainty_of_phi_t = 0.0_wp, uncertainty_of_gamma = 0.0_wp
        !> Values of the parts, fourth-order differences, second-order differences, and largest values.
        type(values_type), private :: values, now, lower, largest
    contains
        procedure :: initialize, find_row_scales, differentiate, check_structure
        procedure, private :: differentiate_together, accumulate_differences, set_values, store_better, differentiate_in_time
    end type reference_type

contains

    !> Attach a model. `evaluator` has been initialised for it, compressed as in the structure.
    subroutine initialize(self, model, structure)
        class(reference_type), intent(inout) :: self
        class(model_type), intent(in) :: model
        type(structure_type), intent(in) :: structure
        integer :: m

        m = model%n_constraints()
        self%structure = structure
        self%time_scale = model%time_scale
        self%scale = model%scales()
        if (allocated(self%rows_q)) deallocate (self%rows_q, self%forces_q, self%gamma_qd, self%force_qd, self%phi_t, self%gamma)
        allocate (self%rows_q(m, structure%width, n_of_rows), self%gamma_qd(m, structure%width), self%phi_t(model%n_holonomic), &
            self%gamma(m), self%forces_q(model%n, structure%width, n_of_forces), self%force_qd(model%n, structure%width), &
            source=0.0_wp)
        self%row_scale = spread(1.0_wp, 1, m)
        call allocate_values(self%values)
        call allocate_values(self%now)
        call allocate_values(self%lower)
        call allocate_values(self%largest)

    contains

        pure subroutine allocate_values(values)
            type(values_type), intent(inout) :: values

            if (allocated(values%rows)) deallocate (values%rows, values%forces)
            allocate (values%rows(m, n_of_rows), values%forces(model%n, n_of_forces), source=0.0_wp)
        end subroutine allocate_values
    end subroutine initialize

    !> Scales of the rows of C; 1 for a row without entries.
    subroutine find_row_scales(self, model, evaluator, counts, stat)
        class(reference_type), intent(inout) :: self
        class(model_type), intent(in) :: model
        type(evaluator_type), intent(inout) :: evaluator
        type(counts_type), intent(inout) :: counts
        integer, intent(out) :: stat
        real(wp) :: largest
        integer :: i, k

        self%row_scale = 1.0_wp
        call evaluator%evaluate(need_jacobian, self%t, self%q, self%q, counts, stat)
        if (stat /= 0) return
        do i = 1, size(self%row_scale)
            if (evaluator%terms%is_compressed) then
                largest = 0.0_wp
                associate (pattern => model%pattern)
                    do k = pattern%row_start(i), pattern%row_start(i + 1) - 1
                        associate (first => pattern%first(pattern%row_body(k)), last => pattern%first(pattern%row_body(k) + 1) - 1)
                            largest = max(largest, maxval(abs(evaluator%terms%jacobian(i, pattern%column(first): &
                                pattern%column(last)))*self%scale(first:last)))
                        end associate
                    end do
                end associate
            else
                largest = maxval(abs(evaluator%terms%jacobian(i, :))*self%scale)
            end if
            ! A NaN is found later, by the comparison of the terms.
            if (largest > 0.0_wp .and. largest <= huge(1.0_wp)) self%row_scale(i) = largest
        end do
    end subroutine find_row_scales

    !> Differentiate all terms at the state.
    subroutine differentiate(self, model, evaluator, counts, stat)
        class(reference_type), intent(inout) :: self
        class(model_type), intent(in) :: model
        type(evaluator_type), intent(inout) :: evaluator
        type(counts_type), intent(inout) :: counts
        integer, intent(out) :: stat
        integer :: k

        self%rows_q = 0.0_wp
        self%forces_q = 0.0_wp
        self%gamma_qd = 0.0_wp
        self%force_qd = 0.0_wp
        self%phi_t = 0.0_wp
        self%gamma = 0.0_wp
        do k = 1, self%structure%n_directions
            associate (columns => self%structure%direction(self%structure%start(k):self%structure%start(k + 1) - 1))
                call self%differentiate_together(model, evaluator, .false., columns, counts, stat)
                if (stat == 0) call self%differentiate_together(model, evaluator, .true., columns, counts, stat)
            end associate
            if (stat /= 0) return
        end do
        if (model%n_holonomic > 0) call self%differentiate_in_time(evaluator, model%time_scale, .false., counts, stat)
        if (stat /= 0 .or. size(self%gamma) == 0) return
        call self%differentiate_in_time(evaluator, 1.0_wp/max(1.0_wp/model%time_scale, &
            maxval(abs(self%qd)/max(abs(self%q), self%scale))), .true., counts, stat)
    end subroutine differentiate

    !> Differentiate all terms with respect to several coordinates or velocities that change nothing in common. A step of the order
    !> of the coordinate's scale is too long if the model changes over a small fraction of it, such as a spring of a few centimetres
    !> between coordinates in metres. The difference between second-order and fourth-order differences shows this; its square
    !> estimates the error of the latter. Steps are then shortened, and for each part the step with the smallest sum of truncation
    !> and rounding errors is used. The derivatives of the model do not influence the choice.
    subroutine differentiate_together(self, model, evaluator, by_qd, columns, counts, stat)
        class(reference_type), intent(inout) :: self
        class(model_type), intent(in) :: model
        type(evaluator_type), intent(inout) :: evaluator
        !> True for derivatives with respect to velocities; indices of the coordinates.
        logical, intent(in) :: by_qd
        integer, intent(in) :: columns(:)
        type(counts_type), intent(inout) :: counts
        integer, intent(out) :: stat
        real(wp), parameter :: step = epsilon(1.0_wp)**0.2_wp
        integer, parameter :: most_shorter = 5
        real(wp) :: moved(model%n), uncertainty(n_of_rows + n_of_forces, size(columns))
        logical :: is_done(size(columns))
        integer :: c, k

        stat = 0
        uncertainty = huge(1.0_wp)
        is_done = .false.
        do k = 0, most_shorter
            moved = 0.0_wp
            do c = 1, size(columns)
                if (is_done(c)) cycle
                associate (j => columns(c))
                    if (by_qd) then
                        moved(j) = step*next_step**k*max(abs(self%qd(j)), self%scale(j)/self%time_scale)
                    else
                        moved(j) = step*next_step**k*max(abs(self%q(j)), self%scale(j))
                    end if
                end associate
            end do
            call self%accumulate_differences(model, evaluator, by_qd, moved, counts, stat)
            if (stat /= 0) return
            do c = 1, size(columns)
                if (.not. is_done(c)) call self%store_better(model%n_holonomic, by_qd, columns(c), moved(columns(c)), k == 0, &
                    uncertainty(:, c), is_done(c))
            end do
            if (all(is_done)) exit
        end do
    end subroutine differentiate_together

    !> Accumulate the differences, at the four places of a displacement, of all parts that it changes.
    subroutine accumulate_differences(self, model, evaluator, by_qd, displacement, counts, stat)
        class(reference_type), intent(inout) :: self
        class(model_type), intent(in) :: model
        type(evaluator_type), intent(inout) :: evaluator
        logical, intent(in) :: by_qd
        !> Displacement of the coordinates or velocities (n).
        real(wp), intent(in) :: displacement(:)
        type(counts_type), intent(inout) :: counts
        integer, intent(out) :: stat
        real(wp) :: q(model%n), qd(model%n)
        integer :: i

        self%now%rows = 0.0_wp
        self%now%forces = 0.0_wp
        self%largest%rows = 0.0_wp
        self%largest%forces = 0.0_wp
        q = self%q
        qd = self%qd
        do i = 1, size(offsets)
            if (by_qd) then
                qd = self%qd + offsets(i)*displacement
                call evaluator%evaluate(need_gamma + need_force, self%t, q, qd, counts, stat)
            else
                q = self%q + offsets(i)*displacement
                call evaluator%evaluate(need_phi + need_jacobian + need_nu + need_gamma + need_mass + need_force, self%t, q, qd, &
                    counts, stat)
            end if
            if (stat == 0) call evaluator%add_friction(self%t, q, qd, self%lambda, stat)
            if (stat /= 0) return
            call self%set_values(model, evaluator, by_qd)
            self%now%rows = factor(i)*self%now%rows + sign_of(i)*self%values%rows
            self%now%forces = factor(i)*self%now%forces + sign_of(i)*self%values%forces
            self%largest%rows = max(self%largest%rows, abs(self%values%rows))
            self%largest%forces = max(self%largest%forces, abs(self%values%forces))
            if (i == 2) self%lower = self%now
        end do
    end subroutine accumulate_differences

    !> Evaluate the parts at a point.
    subroutine set_values(self, model, evaluator, by_qd)
        class(reference_type), intent(inout) :: self
        class(model_type), intent(in) :: model
        type(evaluator_type), intent(in) :: evaluator
        logical, intent(in) :: by_qd

        associate (terms => evaluator%terms, rows => self%values%rows, forces => self%values%forces)
            rows(:, of_gamma) = terms%gamma
            forces(:, of_force) = terms%force
            if (by_qd) return
            rows(:model%n_holonomic, of_phi) = terms%phi
            rows(:, of_nu) = terms%nu
            call evaluator%times_jacobian(self%qd, .false., rows(:, of_c_qd))
            call evaluator%times_jacobian(self%qdd, .false., rows(:, of_c_qdd))
            if (terms%is_compressed) then
                call model%pattern%multiply_mass(terms%mass, self%qdd, forces(:, of_mass))
                forces(:, of_reaction) = 0.0_wp
                call model%pattern%add_transposed(terms%jacobian, self%lambda, .false., forces(:, of_reaction))
            else
                forces(:, of_mass) = matmul(terms%mass, self%qdd)
                forces(:, of_reaction) = matmul(self%lambda, terms%jacobian)
            end if
        end associate
    end subroutine set_values

    !> For each part, store the new differences with respect to a coordinate if they are more accurate than the stored ones.
    subroutine store_better(self, nh, by_qd, j, h, is_first, uncertainty, is_done)
        class(reference_type), intent(inout) :: self
        integer, intent(in) :: nh
        logical, intent(in) :: by_qd
        !> Index of the coordinate, and its displacement.
        integer, intent(in) :: j
        real(wp), intent(in) :: h
        !> True for the first differences, which are stored even if they are NaN.
        logical, intent(in) :: is_first
        !> Estimated relative errors of the stored differences.
        real(wp), intent(inout) :: uncertainty(:)
        !> True if shorter steps cannot improve any part.
        logical, intent(out) :: is_done
        integer :: column, l

        is_done = .true.
        associate (s => self%structure, set => self%structure%set(j))
            column = s%column(j)
            associate (rows => s%rows(s%row_start(set):s%row_start(set + 1) - 1), &
                forces => s%forces(s%force_start(set):s%force_start(set + 1) - 1))
                if (by_qd) then
                    call choose(rows, of_gamma, self%now%rows, self%lower%rows, self%largest%rows, 1, self%gamma_qd(:, column), &
                        self%row_scale)
                    call choose(forces, of_force, self%now%forces, self%lower%forces, self%largest%forces, 2, &
                        self%force_qd(:, column))
                    return
                end if
                do l = 1, n_of_rows
                    if (l == of_phi .and. nh == 0) cycle
                    call choose(rows, l, self%now%rows, self%lower%rows, self%largest%rows, l, self%rows_q(:, column, l), &
                        self%row_scale)
                end do
                do l = 1, n_of_forces
                    call choose(forces, l, self%now%forces, self%lower%forces, self%largest%forces, n_of_rows + l, &
                        self%forces_q(:, column, l))
                end do
            end associate
        end associate

    contains

        !> Store the differences of one part if they are more accurate.
        subroutine choose(places, part, now, lower, largest, number, entries, unit)
            integer, intent(in) :: places(:), part, number
            real(wp), intent(in) :: now(:, :), lower(:, :), largest(:, :)
            real(wp), intent(inout) :: entries(:)
            !> Units of the entries; 1 by default.
            real(wp), intent(in), optional :: unit(:)
            real(wp) :: size_of, deviation, rounding, truncation, u, value
            integer :: i, k

            if (size(places) == 0) return
            size_of = least_size
            deviation = 0.0_wp
            rounding = 0.0_wp
            u = 1.0_wp
            do i = 1, size(places)
                k = places(i)
                if (present(unit)) u = unit(k)
                value = now(k, part)/(divisor*h)
                size_of = max(size_of, abs(value)/u)
                deviation = max(deviation, abs(value - lower(k, part)/(2*h))/u)
                rounding = max(rounding, largest(k, part)/u)
            end do
            truncation = (deviation/size_of)**2
            rounding = epsilon(h)*rounding/(h*size_of)
            if (is_first .or. truncation + rounding < uncertainty(number)) then
                do i = 1, size(places)
                    entries(places(i)) = now(places(i), part)/(divisor*h)
                end do
                uncertainty(number) = truncation + rounding
            end if
            if (truncation > max(enough, rounding)) is_done = .false.
        end subroutine choose
    end subroutine store_better

    !> Check the structure: compare the derivatives times a random direction with differences along this direction. They agree if
    !> each coordinate changes no more than the structure allows. To be called after `differentiate`.
    subroutine check_structure(self, model, evaluator, counts, holds, stat)
        class(reference_type), intent(inout) :: self
        class(model_type), intent(in) :: model
        type(evaluator_type), intent(inout) :: evaluator
        type(counts_type), intent(inout) :: counts
        logical, intent(out) :: holds
        integer, intent(out) :: stat
        real(wp), parameter :: step = epsilon(1.0_wp)**0.2_wp
        !> The first steps may be too long.
        integer, parameter :: most_shorter = 3
        real(wp), dimension(model%n) :: displacement, direction, ones
        integer :: k, l, seed

        seed = 54321
        direction = random_vector(seed, model%n)
        ones = 1.0_wp
        do k = 0, most_shorter
            displacement = step*next_step**k*self%scale*direction
            call self%accumulate_differences(model, evaluator, .false., displacement, counts, stat)
            if (stat /= 0) return
            holds = .true.
            do l = 1, n_of_rows
                if (holds) holds = is_product(self%structure%row_start, self%structure%rows, self%rows_q(:, :, l), &
                    self%now%rows(:, l), self%largest%rows(:, l), self%row_scale)
            end do
            do l = 1, n_of_forces
                if (holds) holds = is_product(self%structure%force_start, self%structure%forces, self%forces_q(:, :, l), &
                    self%now%forces(:, l), self%largest%forces(:, l), ones)
            end do
            displacement = displacement/self%time_scale
            call self%accumulate_differences(model, evaluator, .true., displacement, counts, stat)
            if (stat /= 0) return
            if (holds) holds = is_product(self%structure%row_start, self%structure%rows, self%gamma_qd, &
                self%now%rows(:, of_gamma), self%largest%rows(:, of_gamma), self%row_scale)
            if (holds) holds = is_product(self%structure%force_start, self%structure%forces, self%force_qd, &
                self%now%forces(:, of_force), self%largest%forces(:, of_force), ones)
            if (holds) return
        end do

    contains

        !> True if differences are the product of a matrix with the displacement.
        logical function is_product(start, changed, matrix, now, largest, unit) result(is)
            !> Indices that each set of coordinates changes, as lists.
            integer, intent(in) :: start(:), changed(:)
            real(wp), intent(in) :: matrix(:, :), now(:), largest(:), unit(:)
            !> Tolerance relative to the largest entry; smaller than that of procedures.
            real(wp), parameter :: bound = 1.0e-7_wp
            real(wp), dimension(size(now)) :: product, sizes
            integer :: i, j, k

            product = 0.0_wp
            sizes = 0.0_wp
            associate (s => self%structure)
                do j = 1, model%n
                    do k = start(s%set(j)), start(s%set(j) + 1) - 1
                        i = changed(k)
                        product(i) = product(i) + matrix(i, s%column(j))*displacement(j)
                        sizes(i) = sizes(i) + abs(matrix(i, s%column(j))*displacement(j))
                    end do
                end do
            end associate
            is = .true.
            if (size(now) == 0) return
            is = all(abs(now/divisor - product) <= bound*unit*max(maxval(sizes/unit), least_size*maxval(abs(displacement))) + &
                100*epsilon(1.0_wp)*largest)
        end function is_product
    end subroutine check_structure

    !> Phi_t, or d/dt (C qd - nu) along qd. Uses the step that agrees best with the next longer one.
    subroutine differentiate_in_time(self, evaluator, share, of_velocity, counts, stat)
        class(reference_type), intent(inout) :: self
        type(evaluator_type), intent(inout) :: evaluator
        !> Factor of all steps.
        real(wp), intent(in) :: share
        !> True to differentiate C qd - nu.
        logical, intent(in) :: of_velocity
        type(counts_type), intent(inout) :: counts
        !> Status of the last step if no step could be compared with the next longer one; not_evaluable if steps vanish in the
        !> rounding of t.
        integer, intent(out) :: stat
        real(wp), dimension(merge(size(self%gamma), size(self%phi_t), of_velocity)) :: rate, now, last, values, unit
        real(wp) :: uncertainty, change, largest, h, wanted
        logical :: is_taken
        integer :: i, k, last_stat

        is_taken = .false.
        rate = 0.0_wp
        uncertainty = huge(1.0_wp)
        stat = status_ok
        last_stat = status_not_evaluable
        unit = self%row_scale(:size(unit))
        wanted = longest_step*share
        do k = 1, n_steps
            ! Round the step so that adding it to t is exact.
            h = (self%t + wanted) - self%t
            if (.not. h > 0.0_wp) exit
            now = 0.0_wp
            largest = 1.0_wp
            do i = 1, 4
                call evaluator%evaluate(merge(need_jacobian + need_nu, need_phi, of_velocity), self%t + offsets(i)*h, &
                    self%q + merge(offsets(i)*h, 0.0_wp, of_velocity)*self%qd, self%qd, counts, stat)
                if (stat /= 0) exit
                if (of_velocity) then
                    call evaluator%times_jacobian(self%qd, .false., values)
                    values = values - evaluator%terms%nu
                else
                    values = evaluator%terms%phi
                end if
                now = factor(i)*now + sign_of(i)*values
                largest = max(largest, maxval(abs(values)/unit))
            end do
            now = now/(divisor*h)
            ! A long step may reach times at which the model cannot be evaluated.
            if (stat == 0 .and. last_stat == 0) then
                ! Two steps may agree by chance. Add the rounding errors of the values and of t within the model.
                change = maxval(abs(now - last)/unit) + maxval(abs(now)/unit)*spacing(self%t)/h + epsilon(h)*largest/h
                ! Store the first derivative without comparison, so that a NaN is not lost.
                if (change < uncertainty .or. .not. is_taken) rate = now
                if (change < uncertainty) uncertainty = change
                is_taken = .true.
            end if
            last = now
            last_stat = stat
            wanted = next_step*wanted
        end do
        if (of_velocity) then
            self%gamma = rate
            self%uncertainty_of_gamma = uncertainty
        else
            self%phi_t = rate
            self%uncertainty_of_phi_t = uncertainty
        end if
        if (is_taken) then
            stat = status_ok
        else if (stat == status_ok) then
            stat = status_not_evaluable
            evaluator%failed_term = 'differences in time'
        end if
    end subroutine differentiate_in_time
end module tandem_model_reference
