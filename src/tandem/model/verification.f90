! SPDX-License-Identifier: MIT
!> Checks every procedure of a model against differences of another one at random states, and reports the wrong ones with place and
!> size.
!>
!> Phi gives Phi_q and nu, C and nu give gamma and their own derivatives, M and the forces give theirs. Only for E, e, M and the
!> forces themselves there is no reference; M is checked for symmetry, constancy and blocks. States need not satisfy the
!> constraints. Rows of constraints may have any units: they are compared on their own scale, that of their entries in C.
module tandem_model_verification
    use tandem_error, only: error_type
    use tandem_kinds, only: long, wp
    use tandem_linalg_random, only: random_vector
    use tandem_model, only: model_type
    use tandem_model_check, only: check_model
    use tandem_model_derivatives, only: derivatives_type
    use tandem_model_evaluator, only: evaluator_type
    use tandem_model_terms, only: need_force, need_gamma, need_jacobian, need_mass, need_nu, need_phi
    use tandem_pack, only: pack_type
    use tandem_status, only: status_callback_failed, status_not_evaluable, status_ok
    use tandem_model_counts, only: counts_type
    use, intrinsic :: ieee_exceptions, only: ieee_all, ieee_get_flag, ieee_set_flag
    implicit none (type, external)
    private

    public :: finding_type, verify_model

    !> Result of the comparison of one procedure.
    type :: finding_type
        !> Procedure, or part of a fused one.
        character(len=48) :: name = ''
        !> Largest difference over all states, relative to the largest entry of either side.
        real(wp) :: error = 0.0_wp
        !> Row and column of this entry (column 0 for a vector), its value and that of differences.
        integer :: row = 0, column = 0
        real(wp) :: value = 0.0_wp, expected = 0.0_wp
        !> False if the error exceeds that of differences, or a procedure failed.
        logical :: passed = .true.
        !> Status of a failed procedure; 0 if all could be evaluated.
        integer :: stat = 0
    end type finding_type

    !> Central differences of fourth order have an error of about eps**(4/5) = 3e-13 of the size of the function; the error of a
    !> wrong formula is 1e-3 and more. Functions may be large compared with their derivatives.
    real(wp), parameter :: tolerance = 1.0e-6_wp
    !> Differences are 8 (f(1) - f(-1)) - (f(2) - f(-2)) over 12 h, summed in an order in which a constant of any size cancels
    !> exactly, also with fused multiply-add: sum := factor sum + sign f(place).
    real(wp), parameter :: place(4) = [-1.0_wp, 1.0_wp, 2.0_wp, -2.0_wp]
    real(wp), parameter :: sign_of(4) = [-1.0_wp, 1.0_wp, -1.0_wp, 1.0_wp], factor(4) = [1.0_wp, 1.0_wp, 8.0_wp, 1.0_wp]
    real(wp), parameter :: divisor = 12.0_wp
    !> Steps in coordinates with an estimated error below `enough` are not shortened; derivatives below `least_size` are treated as
    !> being of that size.
    real(wp), parameter :: enough = 3.0e-11_wp, least_size = 1.0e-3_wp

    !> Steps in time: the longest one, and the factor to the next. The time scale of a model is not known: comparison with its
    !> neighbours shows for one of the steps that it is neither too long nor lost in the rounding of t. The longest one is not a
    !> simple fraction of a second, at which a motion with so many periods per second would appear constant.
    integer, parameter :: n_steps = 14
    real(wp), parameter :: longest_step = 0.2887_wp, next_step = 0.25_wp
    !> Largest error of differences, relative to their largest entry, with which a wrong formula is distinguished from a right one.
    real(wp), parameter :: most_doubt = 1.0e-3_wp

    !> Derivatives by differences at one state, each part separately; for those in time, the possible error of differences.
    type :: parts_type
        real(wp) :: phi_t_doubt = 0.0_wp, gamma_doubt = 0.0_wp
        !> Scale of each row of C: its largest entry times the scale of the coordinate.
        real(wp), allocatable :: row_scale(:)
        real(wp), allocatable :: phi_q(:, :), phi_t(:), gamma(:), c_qd_q(:, :), c_qdd_q(:, :), nu_q(:, :)
        real(wp), allocatable :: gamma_q(:, :), gamma_qd(:, :), mass_q(:, :), reaction_q(:, :), force_q(:, :), force_qd(:, :)
    end type parts_type

contains

    !> Compare at `n_states` random states near (t, q, qd). An error means that the model is incomplete or could not be evaluated;
    !> wrong procedures are findings. Flags of floating-point exceptions are restored: a long step may lead to overflow in a model,
    !> which a program would report at its end.
    subroutine verify_model(model, t, q, qd, n_states, findings, error)
        class(model_type), intent(inout), target :: model
        !> State at which the model can be evaluated (n); velocities near zero are replaced by random ones of their scale.
        real(wp), intent(in) :: t, q(:), qd(:)
        integer, intent(in) :: n_states
        !> One per compared procedure.
        type(finding_type), allocatable, intent(out) :: findings(:)
        type(error_type), allocatable, intent(out) :: error
        type(evaluator_type) :: evaluator
        type(counts_type) :: counts
        type(parts_type) :: parts
        real(wp) :: scale(model%n), q1(model%n), qd1(model%n), qdd1(model%n), lambda(model%n_constraints())
        type(pack_type) :: pack
        character(len=len(evaluator%failed_term)) :: failed
        character(len=40) :: problem
        integer(long), allocatable :: memory(:)
        logical :: flags(size(ieee_all))
        integer :: state, seed, stat

        allocate (findings(0))
        call check_model(model, error)
        if (allocated(error)) return
        ! A model may count turns from state to state; restore its state, because no motion passes through the random states.
        call pack%begin_writing()
        call model%pack_state(pack)
        call pack%end_writing('model', memory)
        call model%set_time_scale(t, q, qd)
        scale = model%scales()
        call ieee_get_flag(ieee_all, flags)
        call evaluator%initialize(model)
        ! Symmetry is compared below.
        evaluator%mass_is_trusted = .true.
        seed = 12345
        do state = 1, n_states
            q1 = q + 0.1_wp*scale*random_vector(seed, model%n)
            qd1 = qd + scale/model%time_scale*random_vector(seed, model%n)
            qdd1 = scale/model%time_scale**2*random_vector(seed, model%n)
            lambda = random_vector(seed, size(lambda))
            call find_row_scales(evaluator, t, q1, scale, parts, counts, stat)
            lambda = lambda/parts%row_scale
            if (stat == 0) call differentiate(evaluator, model, t, q1, qd1, qdd1, lambda, scale, parts, counts, stat)
            if (stat == 0) call compare_terms(evaluator, model, t, q1, qd1, parts, counts, findings, stat)
            failed = evaluator%failed_term
            if (stat == 0) then
                call compare_single(model, t, q1, qd1, qdd1, lambda, parts, findings, failed, stat)
                if (stat == 0) call compare_fused(model, t, q1, qd1, qdd1, lambda, parts, findings, failed, stat)
                if (stat /= 0) stat = merge(status_not_evaluable, status_callback_failed, stat > 0)
            end if
            if (stat /= 0) call add_finding(findings, finding_type(name='evaluation of '//failed, passed=.false., stat=stat))
        end do
        call pack%begin_reading('model', memory, problem)
        call model%pack_state(pack)
        call ieee_set_flag(ieee_all, flags)
    end subroutine verify_model

    !> Scales of the rows of C, 1 for a row without entries.
    subroutine find_row_scales(evaluator, t, q, scale, parts, counts, stat)
        type(evaluator_type), intent(inout) :: evaluator
        real(wp), intent(in) :: t, q(:), scale(:)
        type(parts_type), intent(inout) :: parts
        type(counts_type), intent(inout) :: counts
        integer, intent(out) :: stat
        integer :: i

        parts%row_scale = spread(1.0_wp, 1, size(evaluator%terms%nu))
        call evaluator%evaluate(need_jacobian, t, q, q, counts, stat)
        if (stat /= 0) return
        associate (row_scale => parts%row_scale)
            do i = 1, size(row_scale)
                row_scale(i) = maxval(abs(evaluator%terms%jacobian(i, :))*scale)
                ! A NaN in the row is detected below.
                if (.not. (row_scale(i) > 0.0_wp .and. row_scale(i) <= huge(1.0_wp))) row_scale(i) = 1.0_wp
            end do
        end associate
    end subroutine find_row_scales

    !> Differences of every term.
    subroutine differentiate(evaluator, model, t, q, qd, qdd, lambda, scale, parts, counts, stat)
        type(evaluator_type), intent(inout) :: evaluator
        class(model_type), intent(in) :: model
        real(wp), intent(in) :: t, q(:), qd(:), qdd(:), lambda(:), scale(:)
        !> The scales of its rows are set.
        type(parts_type), intent(inout) :: parts
        type(counts_type), intent(inout) :: counts
        integer, intent(out) :: stat
        real(wp), allocatable :: by_q(:), by_qd(:), unit_q(:), unit_qd(:)
        integer :: j, m, n, nh

        n = model%n
        m = model%n_constraints()
        nh = model%n_holonomic
        parts = parts_type(row_scale=parts%row_scale)
        allocate (parts%phi_q(nh, n), parts%phi_t(nh), parts%gamma(m), source=0.0_wp)
        allocate (parts%c_qd_q(m, n), parts%c_qdd_q(m, n), parts%nu_q(m, n), parts%gamma_q(m, n), parts%gamma_qd(m, n), &
            parts%mass_q(n, n), parts%reaction_q(n, n), parts%force_q(n, n), parts%force_qd(n, n), source=0.0_wp)
        associate (rows => parts%row_scale)
            unit_q = [rows(:nh), rows, rows, rows, rows, spread(1.0_wp, 1, 3*n)]
            unit_qd = [rows, spread(1.0_wp, 1, n)]
        end associate
        allocate (by_q(size(unit_q)), by_qd(size(unit_qd)))
        do j = 1, n
            call differentiate_column(evaluator, .false., j, t, q, qd, qdd, lambda, scale(j), [nh, m, m, m, m, n, n, n], &
                unit_q, by_q, counts, stat)
            if (stat /= 0) return
            parts%phi_q(:, j) = by_q(:nh)
            parts%c_qd_q(:, j) = by_q(nh + 1:nh + m)
            parts%c_qdd_q(:, j) = by_q(nh + m + 1:nh + 2*m)
            parts%nu_q(:, j) = by_q(nh + 2*m + 1:nh + 3*m)
            parts%gamma_q(:, j) = by_q(nh + 3*m + 1:nh + 4*m)
            parts%mass_q(:, j) = by_q(nh + 4*m + 1:nh + 4*m + n)
            parts%reaction_q(:, j) = by_q(nh + 4*m + n + 1:nh + 4*m + 2*n)
            parts%force_q(:, j) = by_q(nh + 4*m + 2*n + 1:)
            call differentiate_column(evaluator, .true., j, t, q, qd, qdd, lambda, scale(j)/model%time_scale, [m, n], &
                unit_qd, by_qd, counts, stat)
            if (stat /= 0) return
            parts%gamma_qd(:, j) = by_qd(:m)
            parts%force_qd(:, j) = by_qd(m + 1:)
        end do
        if (nh > 0) call differentiate_in_time(evaluator, t, model%time_scale, .false., q, qd, parts%row_scale(:nh), parts%phi_t, &
            parts%phi_t_doubt, counts, stat)
        if (stat /= 0 .or. m == 0) return
        call differentiate_in_time(evaluator, t, 1.0_wp/max(1.0_wp/model%time_scale, maxval(abs(qd)/max(abs(q), scale))), .true., &
            q, qd, parts%row_scale, parts%gamma, parts%gamma_doubt, counts, stat)
    end subroutine differentiate

    !> Derivatives of all terms with respect to one coordinate or velocity. A step that fits the scale is too long if the model is
    !> nonlinear over a small part of it, such as a spring of some centimetres among coordinates in metres. Differences of second
    !> order show this: their error squared is about that of fourth order. Then the step is shortened, and each part is taken from
    !> the step with the smallest truncation and rounding errors. The model's own derivatives are not used.
    subroutine differentiate_column(evaluator, by_qd, j, t, q, qd, qdd, lambda, scale, widths, unit, column, counts, stat)
        type(evaluator_type), intent(inout) :: evaluator
        !> True for a velocity, and its index.
        logical, intent(in) :: by_qd
        integer, intent(in) :: j
        real(wp), intent(in) :: t, q(:), qd(:), qdd(:), lambda(:), scale
        !> Number of values of each part, and the scales of all.
        integer, intent(in) :: widths(:)
        real(wp), intent(in) :: unit(:)
        real(wp), intent(out) :: column(:)
        type(counts_type), intent(inout) :: counts
        integer, intent(out) :: stat
        real(wp), parameter :: step = epsilon(1.0_wp)**0.2_wp
        integer, parameter :: most_shorter = 5
        real(wp) :: moved(size(q)), values(size(column)), now(size(column)), lower(size(column)), largest(size(column))
        real(wp) :: doubt(size(widths)), truncation, rounding, size_of, h
        integer :: i, k, l, first, last
        logical :: is_done

        stat = 0
        doubt = huge(1.0_wp)
        do k = 0, most_shorter
            moved = merge(qd, q, by_qd)
            h = step*next_step**k*max(abs(moved(j)), scale)
            now = 0.0_wp
            largest = 0.0_wp
            do i = 1, 4
                moved(j) = merge(qd(j), q(j), by_qd) + place(i)*h
                if (by_qd) then
                    call evaluator%evaluate(need_gamma + need_force, t, q, moved, counts, stat)
                else
                    call evaluator%evaluate(need_phi + need_jacobian + need_nu + need_gamma + need_mass + need_force, t, moved, &
                        qd, counts, stat)
                end if
                if (stat == 0) call evaluator%add_friction(t, merge(q, moved, by_qd), merge(moved, qd, by_qd), lambda, stat)
                if (stat /= 0) return
                call line_up(evaluator, by_qd, qd, qdd, lambda, values)
                call add(i, values, now)
                largest = max(largest, abs(values))
                if (i == 2) lower = now/(2*h)
            end do
            now = now/(divisor*h)
            last = 0
            is_done = .true.
            do l = 1, size(widths)
                if (widths(l) == 0) cycle
                first = last + 1
                last = last + widths(l)
                associate (now => now(first:last), unit => unit(first:last))
                    size_of = max(least_size, maxval(abs(now)/unit))
                    truncation = (maxval(abs(now - lower(first:last))/unit)/size_of)**2
                    rounding = epsilon(h)*maxval(largest(first:last)/unit)/(h*size_of)
                    ! Take the first one without a comparison, so that a NaN is seen.
                    if (k == 0 .or. truncation + rounding < doubt(l)) then
                        column(first:last) = now
                        doubt(l) = truncation + rounding
                    end if
                    if (truncation > max(enough, rounding)) is_done = .false.
                end associate
            end do
            if (is_done) exit
        end do
    end subroutine differentiate_column

    !> Values to be differentiated, one part after the other.
    pure subroutine line_up(evaluator, by_qd, qd, qdd, lambda, values)
        type(evaluator_type), intent(in) :: evaluator
        logical, intent(in) :: by_qd
        real(wp), intent(in) :: qd(:), qdd(:), lambda(:)
        real(wp), intent(out) :: values(:)

        associate (terms => evaluator%terms)
            if (by_qd) then
                values = [terms%gamma, terms%force]
            else
                values = [terms%phi, matmul(terms%jacobian, qd), matmul(terms%jacobian, qdd), terms%nu, terms%gamma, &
                    matmul(terms%mass, qdd), matmul(lambda, terms%jacobian), terms%force]
            end if
        end associate
    end subroutine line_up

    !> Add the value at a place to the differences.
    pure subroutine add(i, value, differences)
        !> Index of the place.
        integer, intent(in) :: i
        real(wp), intent(in) :: value(:)
        real(wp), intent(inout) :: differences(:)

        differences = factor(i)*differences + sign_of(i)*value
    end subroutine add

    !> Phi_t, or d/dt (C qd - nu) along qd, by the step that agrees best with the next longer one.
    subroutine differentiate_in_time(evaluator, t, share, of_velocity, q, qd, row_scale, rate, doubt, counts, stat)
        type(evaluator_type), intent(inout) :: evaluator
        !> Time, and the part of the steps to take.
        real(wp), intent(in) :: t, share
        !> True to differentiate C qd - nu.
        logical, intent(in) :: of_velocity
        !> Coordinates, velocities, and the scales of the rows.
        real(wp), intent(in) :: q(:), qd(:), row_scale(:)
        !> Derivative, and its possible error on the scales of the rows, from the difference to the next longer step and from
        !> rounding.
        real(wp), intent(inout) :: rate(:)
        real(wp), intent(out) :: doubt
        type(counts_type), intent(inout) :: counts
        !> Status of the last step if no pair of consecutive steps could be evaluated; not_evaluable if steps are lost in the
        !> rounding of t.
        integer, intent(out) :: stat
        real(wp) :: now(size(rate)), last(size(rate)), values(size(rate)), change, largest, h, wanted
        logical :: is_taken
        integer :: i, k, last_stat

        is_taken = .false.
        doubt = huge(1.0_wp)
        stat = status_ok
        last_stat = status_not_evaluable
        wanted = longest_step*share
        do k = 1, n_steps
            ! A step that is added to t without rounding.
            h = (t + wanted) - t
            if (.not. h > 0.0_wp) exit
            now = 0.0_wp
            largest = 1.0_wp
            do i = 1, 4
                call evaluator%evaluate(merge(need_jacobian + need_nu, need_phi, of_velocity), t + place(i)*h, &
                    q + merge(place(i)*h, 0.0_wp, of_velocity)*qd, qd, counts, stat)
                if (stat /= 0) exit
                if (of_velocity) then
                    values = matmul(evaluator%terms%jacobian, qd) - evaluator%terms%nu
                else
                    values = evaluator%terms%phi
                end if
                call add(i, values, now)
                largest = max(largest, maxval(abs(values)/row_scale))
            end do
            now = now/(divisor*h)
            ! A long step may lead outside the domain of the model.
            if (stat == 0 .and. last_stat == 0) then
                ! Add the possible rounding of the values and of t in the model: two steps may agree by chance.
                change = maxval(abs(now - last)/row_scale) + maxval(abs(now)/row_scale)*spacing(t)/h + epsilon(h)*largest/h
                ! Take the first one without a comparison, so that NaN are seen.
                if (change < doubt .or. .not. is_taken) rate = now
                if (change < doubt) doubt = change
                is_taken = .true.
            end if
            last = now
            last_stat = stat
            wanted = next_step*wanted
        end do
        if (is_taken) then
            stat = status_ok
        else if (stat == status_ok) then
            stat = status_not_evaluable
            evaluator%failed_term = 'differences in time'
        end if
    end subroutine differentiate_in_time

    !> Phi_q, nu and gamma, the symmetry, the constancy and the blocks of M.
    subroutine compare_terms(evaluator, model, t, q, qd, parts, counts, findings, stat)
        type(evaluator_type), intent(inout) :: evaluator
        class(model_type), intent(in) :: model
        real(wp), intent(in) :: t, q(:), qd(:)
        type(parts_type), intent(in) :: parts
        type(counts_type), intent(inout) :: counts
        type(finding_type), allocatable, intent(inout) :: findings(:)
        integer, intent(out) :: stat
        real(wp) :: mass(model%n, model%n)

        call evaluator%evaluate(need_jacobian + need_nu + need_gamma + need_mass, t, q, qd, counts, stat)
        if (stat /= 0) return
        associate (terms => evaluator%terms, nh => model%n_holonomic)
            if (nh > 0) then
                call compare('holonomic_jacobian', terms%jacobian(:nh, :), parts%phi_q, findings, parts%row_scale)
                call compare_vector('holonomic_rate', -terms%nu(:nh), parts%phi_t, parts%phi_t_doubt, parts%row_scale, &
                    findings)
            end if
            if (model%n_constraints() > 0 .and. iand(evaluator%has, need_gamma) /= 0) then
                call compare_vector('constraint_acceleration', terms%gamma, parts%gamma, parts%gamma_doubt, &
                    parts%row_scale, findings)
            end if
            call compare('mass_matrix (symmetry)', terms%mass, transpose(terms%mass), findings)
            if (model%constant_mass) then
                ! M is evaluated again on request only.
                mass = terms%mass
                evaluator%mass_is_known = .false.
                call evaluator%evaluate(need_mass, t, q, qd, counts, stat)
                if (stat /= 0) return
                call compare('constant_mass', terms%mass, mass, findings)
                terms%mass = mass
                evaluator%mass_is_known = .true.
            end if
            if (allocated(model%mass_blocks)) then
                call compare('mass_blocks', terms%mass, in_blocks(model%mass_blocks, terms%mass), findings)
            end if
        end associate
    end subroutine compare_terms

    !> A matrix without the entries outside of its diagonal blocks.
    pure function in_blocks(sizes, matrix) result(blocks)
        integer, intent(in) :: sizes(:)
        real(wp), intent(in) :: matrix(:, :)
        real(wp) :: blocks(size(matrix, 1), size(matrix, 2))
        integer :: b, first, last

        blocks = 0.0_wp
        first = 1
        do b = 1, size(sizes)
            last = first + sizes(b) - 1
            blocks(first:last, first:last) = matrix(first:last, first:last)
            first = last + 1
        end do
    end function in_blocks

    !> True if there is a gamma from which differences can be taken.
    pure logical function has_gamma(model)
        class(model_type), intent(in) :: model

        has_gamma = associated(model%constraint_acceleration) .or. iand(model%provides, need_gamma) /= 0
    end function has_gamma

    !> Compare the single derivative procedures of the model.
    subroutine compare_single(model, t, q, qd, qdd, lambda, parts, findings, failed, stat)
        class(model_type), intent(inout) :: model
        real(wp), intent(in) :: t, q(:), qd(:), qdd(:), lambda(:)
        type(parts_type), intent(in) :: parts
        type(finding_type), allocatable, intent(inout) :: findings(:)
        !> Failed procedure, and its status.
        character(len=*), intent(inout) :: failed
        integer, intent(out) :: stat
        real(wp) :: block_m(model%n_constraints(), model%n), block_n(model%n, model%n)

        stat = 0
        if (associated(model%jacobian_derivative)) then
            call model%jacobian_derivative(t, q, qd, block_m, stat)
            failed = 'jacobian_derivative'
            if (stat /= 0) return
            call compare('jacobian_derivative', block_m, parts%c_qd_q, findings, parts%row_scale)
        end if
        if (associated(model%nu_derivative)) then
            call model%nu_derivative(t, q, block_m, stat)
            failed = 'nu_derivative'
            if (stat /= 0) return
            call compare('nu_derivative', block_m, parts%nu_q, findings, parts%row_scale)
        end if
        if (associated(model%gamma_q) .and. has_gamma(model)) then
            call model%gamma_q(t, q, qd, block_m, stat)
            failed = 'gamma_q'
            if (stat /= 0) return
            call compare('gamma_q', block_m, parts%gamma_q, findings, parts%row_scale)
        end if
        if (associated(model%gamma_qd) .and. has_gamma(model)) then
            call model%gamma_qd(t, q, qd, block_m, stat)
            failed = 'gamma_qd'
            if (stat /= 0) return
            call compare('gamma_qd', block_m, parts%gamma_qd, findings, parts%row_scale)
        end if
        if (associated(model%mass_derivative)) then
            call model%mass_derivative(q, qdd, block_n, stat)
            failed = 'mass_derivative'
            if (stat /= 0) return
            call compare('mass_derivative', block_n, parts%mass_q, findings)
        end if
        if (associated(model%reaction_derivative)) then
            call model%reaction_derivative(t, q, lambda, block_n, stat)
            failed = 'reaction_derivative'
            if (stat /= 0) return
            call compare('reaction_derivative', block_n, parts%reaction_q, findings)
        end if
        if (associated(model%force_q)) then
            call model%force_q(t, q, qd, block_n, stat)
            failed = 'force_q'
            if (stat /= 0) return
            call compare('force_q', block_n, parts%force_q, findings)
        end if
        if (associated(model%force_qd)) then
            call model%force_qd(t, q, qd, block_n, stat)
            failed = 'force_qd'
            if (stat /= 0) return
            call compare('force_qd', block_n, parts%force_qd, findings)
        end if
    end subroutine compare_single

    !> Compare the five sums of the fused procedure, as far as the model provides them.
    subroutine compare_fused(model, t, q, qd, qdd, lambda, parts, findings, failed, stat)
        class(model_type), intent(inout) :: model
        real(wp), intent(in) :: t, q(:), qd(:), qdd(:), lambda(:)
        type(parts_type), intent(in) :: parts
        type(finding_type), allocatable, intent(inout) :: findings(:)
        character(len=*), intent(inout) :: failed
        !> A status code.
        integer, intent(out) :: stat
        type(derivatives_type) :: d

        stat = 0
        if (model%provides_derivatives == 0) return
        call d%allocate(model%n, model%n_constraints())
        call model%evaluate_derivatives(model%provides_derivatives, t, q, qd, qdd, lambda, d, stat)
        failed = 'evaluate_derivatives'
        if (stat /= 0) return
        if (btest(model%provides_derivatives, 0)) then
            call compare('evaluate_derivatives: velocity_q', d%velocity_q, parts%c_qd_q - parts%nu_q, findings, &
                parts%row_scale)
        end if
        if (btest(model%provides_derivatives, 1) .and. has_gamma(model)) then
            call compare('evaluate_derivatives: acceleration_q', d%acceleration_q, parts%c_qdd_q + parts%gamma_q, &
                findings, parts%row_scale)
        end if
        if (btest(model%provides_derivatives, 2) .and. has_gamma(model)) then
            call compare('evaluate_derivatives: acceleration_qd', d%acceleration_qd, parts%gamma_qd, findings, &
                parts%row_scale)
        end if
        if (btest(model%provides_derivatives, 3)) call compare('evaluate_derivatives: dynamics_q', d%dynamics_q, &
            parts%mass_q + parts%reaction_q - parts%force_q, findings)
        if (btest(model%provides_derivatives, 4)) then
            call compare('evaluate_derivatives: dynamics_qd', d%dynamics_qd, -parts%force_qd, findings)
        end if
    end subroutine compare_fused

    !> Compare vectors.
    subroutine compare_vector(name, value, expected, doubt, row_scale, findings)
        character(len=*), intent(in) :: name
        real(wp), intent(in) :: value(:), expected(:)
        !> Uncertainty of the expected values on the scales of the rows, and these scales.
        real(wp), intent(in) :: doubt, row_scale(:)
        type(finding_type), allocatable, intent(inout) :: findings(:)

        call compare(name, reshape(value, [size(value), 1]), reshape(expected, [size(expected), 1]), findings, row_scale, doubt)
        findings(:)%column = merge(0, findings%column, findings%name == name)
    end subroutine compare_vector

    !> Compare matrices and store the worst entry.
    subroutine compare(name, value, expected, findings, row_scale, doubt)
        character(len=*), intent(in) :: name
        real(wp), intent(in) :: value(:, :), expected(:, :)
        type(finding_type), allocatable, intent(inout) :: findings(:)
        !> Scales of the rows, at least as many as there are rows; 1 if absent.
        real(wp), intent(in), optional :: row_scale(:)
        !> Uncertainty of the expected values, from the difference of two ways to compute them; negligible if absent.
        real(wp), intent(in), optional :: doubt
        type(finding_type) :: finding
        real(wp) :: allowed, scale, off(size(value, 1), size(value, 2)), unit(size(value, 1))
        integer :: place_of_worst(2), j

        finding%name = name
        if (size(value) > 0) then
            unit = 1.0_wp
            if (present(row_scale)) unit = row_scale(:size(unit))
            scale = least_size
            do j = 1, size(value, 2)
                scale = max(scale, maxval(abs(value(:, j))/unit), maxval(abs(expected(:, j))/unit))
                off(:, j) = abs(value(:, j) - expected(:, j))/unit
            end do
            ! maxloc ignores a NaN.
            place_of_worst = findloc(off <= huge(1.0_wp), .false.)
            if (place_of_worst(1) == 0) place_of_worst = maxloc(off)
            finding%row = place_of_worst(1)
            finding%column = place_of_worst(2)
            finding%value = value(finding%row, finding%column)
            finding%expected = expected(finding%row, finding%column)
            finding%error = off(finding%row, finding%column)/scale
            allowed = tolerance
            if (present(doubt)) allowed = max(tolerance, min(10*doubt/scale, most_doubt))
            finding%passed = all(abs(value) <= huge(1.0_wp)) .and. finding%error <= allowed
        end if
        call add_finding(findings, finding)
    end subroutine compare

    !> Add a finding, or keep the worse of two with the same name.
    subroutine add_finding(findings, finding)
        type(finding_type), allocatable, intent(inout) :: findings(:)
        type(finding_type), intent(in) :: finding
        integer :: i

        do i = 1, size(findings)
            if (findings(i)%name /= finding%name) cycle
            if ((findings(i)%passed .and. .not. finding%passed) .or. finding%error > findings(i)%error) findings(i) = finding
            return
        end do
        findings = [findings, finding]
    end subroutine add_finding
end module tandem_model_verification
