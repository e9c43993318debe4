! SPDX-License-Identifier: MIT
!> Checks every procedure of a model against differences of another one at random states, and reports the wrong ones with place and
!> size.
!>
!> Phi gives Phi_q and nu, C and nu give gamma and their own derivatives, M and the forces give theirs. Only for E, e, M and the
!> forces themselves there is no reference; M is checked for symmetry, constancy and blocks. States need not satisfy the
!> constraints. Rows of constraints may have any units: they are compared on their own scale, that of their entries in C.
module tandem_model_verification
    use tandem_error, only: error_type, set_error, to_text
    use tandem_kinds, only: long, wp
    use tandem_linalg_random, only: random_vector
    use tandem_model, only: model_type
    use tandem_model_check, only: check_model
    use tandem_model_derivatives, only: derivatives_type
    use tandem_model_evaluator, only: evaluator_type
    use tandem_model_reference, only: least_size, of_c_qd, of_c_qdd, of_force, of_gamma, of_mass, of_nu, of_phi, of_reaction, &
        reference_type
    use tandem_model_structure, only: structure_type
    use tandem_model_terms, only: need_gamma, need_jacobian, need_mass, need_nu
    use tandem_model_timer, only: of_force_q, of_force_qd, of_gamma_q, of_gamma_qd, of_jacobian_derivative, of_mass_derivative, &
        of_nu_derivative, of_reaction_derivative
    use tandem_pack, only: pack_type
    use tandem_status, only: status_callback_failed, status_not_evaluable, status_ok, status_work_limit
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
    !> Differences that leave more of their largest entry than this do not tell a right formula from a wrong one.
    real(wp), parameter :: most_doubt = 1.0e-3_wp
    !> Up to so many coordinates the matrices of a model with a pattern are full, as dense charts take them; more are compressed.
    !> Full ones of more than the second number take gigabytes.
    integer, parameter :: most_full = 200, most_coordinates = 5000

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
        type(reference_type) :: reference
        type(structure_type) :: structure
        type(pack_type) :: pack
        character(len=40) :: problem
        integer(long), allocatable :: memory(:)
        logical :: flags(size(ieee_all)), holds
        integer :: state, seed

        allocate (findings(0))
        call check_model(model, error)
        if (allocated(error)) return
        ! A model may count turns from state to state; restore its state, because no motion passes through the random states.
        call pack%begin_writing()
        call model%pack_state(pack)
        call pack%end_writing('model', memory)
        call model%set_time_scale(t, q, qd)
        call ieee_get_flag(ieee_all, flags)
        call choose_structure(model, structure)
        do
            call evaluator%initialize(model, compressed=structure%is_compressed)
            ! Compared below.
            evaluator%mass_is_trusted = .true.
            call reference%initialize(model, structure)
            seed = 12345
            do state = 1, n_states
                call verify_at(model, evaluator, reference, t, q, qd, seed, counts, findings, holds)
                if (.not. holds) exit
            end do
            if (holds .or. n_states < 1) exit
            ! Something depends on coordinates that the pattern does not tell of, which it may but for C and M.
            if (model%n > most_coordinates) then
                call set_error(error, status_work_limit, 'the model "'//model%name//'" has '//to_text(model%n)// &
                    ' coordinates, and depends on more of them than its pattern says: too many to compare its procedures', &
                    'check a smaller model of the same elements')
                exit
            end if
            deallocate (findings)
            allocate (findings(0))
            call structure%take_all(model%n, model%n_constraints())
        end do
        call pack%begin_reading('model', memory, problem)
        call model%pack_state(pack)
        call ieee_set_flag(ieee_all, flags)
    end subroutine verify_model

    !> Take the structure of a model from its pattern if it has one.
    subroutine choose_structure(model, structure)
        class(model_type), intent(in) :: model
        type(structure_type), intent(inout) :: structure
        integer, parameter :: of_pattern = need_jacobian + need_mass

        if (.not. allocated(model%pattern)) then
            call structure%take_all(model%n, model%n_constraints())
        else
            ! Single procedures set matrices that are not compressed.
            call structure%take_pattern(model%pattern, model%n > most_full .and. iand(model%provides, of_pattern) == of_pattern &
                .and. .not. has_single(model) .and. (model%provides_derivatives == 0 .or. model%derives_by_bodies))
        end if
    end subroutine choose_structure

    !> True if there are single derivative procedures.
    pure logical function has_single(model)
        class(model_type), intent(in) :: model
        integer :: part

        has_single = any([(model%gives(part), part=of_jacobian_derivative, of_force_qd)])
    end function has_single

    !> Compare at one random state.
    subroutine verify_at(model, evaluator, reference, t, q, qd, seed, counts, findings, holds)
        class(model_type), intent(inout), target :: model
        type(evaluator_type), intent(inout) :: evaluator
        type(reference_type), intent(inout) :: reference
        !> Near this state.
        real(wp), intent(in) :: t, q(:), qd(:)
        !> Of random numbers.
        integer, intent(inout) :: seed
        type(counts_type), intent(inout) :: counts
        type(finding_type), allocatable, intent(inout) :: findings(:)
        !> False where coordinates change more than they may by the pattern; looked at where there is no finding yet.
        logical, intent(out) :: holds
        character(len=len(evaluator%failed_term)) :: failed
        integer :: stat

        holds = .true.
        associate (scale => reference%scale, n => model%n)
            reference%t = t
            reference%q = q + 0.1_wp*scale*random_vector(seed, n)
            reference%qd = qd + scale/model%time_scale*random_vector(seed, n)
            reference%qdd = scale/model%time_scale**2*random_vector(seed, n)
            reference%lambda = random_vector(seed, model%n_constraints())
        end associate
        call reference%find_row_scales(model, evaluator, counts, stat)
        reference%lambda = reference%lambda/reference%row_scale
        if (stat == 0) call reference%differentiate(model, evaluator, counts, stat)
        if (stat == 0 .and. size(findings) == 0 .and. reference%structure%is_of_pattern) then
            call reference%check_structure(model, evaluator, counts, holds, stat)
            if (stat == 0 .and. .not. holds) return
        end if
        if (stat == 0) call compare_terms(model, evaluator, reference, counts, findings, stat)
        if (stat == 0) call compare_mass(model, evaluator, reference, counts, findings, stat)
        failed = evaluator%failed_term
        if (stat == 0) then
            call compare_single(model, reference, findings, failed, stat)
            if (stat == 0) call compare_fused(model, reference, findings, failed, stat)
            if (stat /= 0) stat = merge(status_not_evaluable, status_callback_failed, stat > 0)
        end if
        if (stat /= 0) call add_finding(findings, finding_type(name='evaluation of '//failed, passed=.false., stat=stat))
    end subroutine verify_at

    !> Phi_q, nu and gamma.
    subroutine compare_terms(model, evaluator, reference, counts, findings, stat)
        class(model_type), intent(in) :: model
        type(evaluator_type), intent(inout) :: evaluator
        type(reference_type), intent(in) :: reference
        type(counts_type), intent(inout) :: counts
        type(finding_type), allocatable, intent(inout) :: findings(:)
        integer, intent(out) :: stat
        real(wp), allocatable :: spread_out(:, :)

        call evaluator%evaluate(need_jacobian + need_nu + need_gamma + need_mass, reference%t, reference%q, reference%qd, counts, &
            stat)
        if (stat /= 0) return
        associate (terms => evaluator%terms, nh => model%n_holonomic)
            if (nh > 0) then
                if (terms%is_compressed) then
                    call spread_jacobian(spread_out)
                    call compare_rows('holonomic_jacobian', spread_out, reference%rows_q(:nh, :, of_phi), reference, findings)
                else
                    call compare_rows('holonomic_jacobian', terms%jacobian(:nh, :), reference%rows_q(:nh, :, of_phi), reference, &
                        findings)
                end if
                call compare_vector('holonomic_rate', -terms%nu(:nh), reference%phi_t, reference%phi_t_doubt, &
                    reference%row_scale, findings)
            end if
            if (model%n_constraints() > 0 .and. iand(evaluator%has, need_gamma) /= 0) then
                call compare_vector('constraint_acceleration', terms%gamma, reference%gamma, reference%gamma_doubt, &
                    reference%row_scale, findings)
            end if
        end associate

    contains

        !> Rows of Phi_q with the columns of the structure from those of the pattern.
        subroutine spread_jacobian(jacobian)
            real(wp), allocatable, intent(out) :: jacobian(:, :)
            integer :: i, j, k

            associate (nh => model%n_holonomic, s => reference%structure)
                allocate (jacobian(nh, s%width), source=0.0_wp)
                do j = 1, model%n
                    do k = s%row_start(s%set(j)), s%row_start(s%set(j) + 1) - 1
                        i = s%rows(k)
                        if (i <= nh) jacobian(i, s%column(j)) = evaluator%terms%jacobian(i, model%pattern%column(j))
                    end do
                end do
            end associate
        end subroutine spread_jacobian
    end subroutine compare_terms

    !> The symmetry, the constancy and the blocks of M, which was evaluated.
    subroutine compare_mass(model, evaluator, reference, counts, findings, stat)
        class(model_type), intent(in) :: model
        type(evaluator_type), intent(inout) :: evaluator
        type(reference_type), intent(in) :: reference
        type(counts_type), intent(inout) :: counts
        type(finding_type), allocatable, intent(inout) :: findings(:)
        integer, intent(out) :: stat
        real(wp), allocatable :: mass(:, :), other(:, :)

        stat = 0
        associate (terms => evaluator%terms)
            mass = terms%mass
            call transpose_mass(mass, other)
            call compare_masses('mass_matrix (symmetry)', mass, other)
            if (model%constant_mass) then
                ! It is evaluated once, unless it is asked for anew.
                evaluator%mass_is_known = .false.
                call evaluator%evaluate(need_mass, reference%t, reference%q, reference%qd, counts, stat)
                if (stat /= 0) return
                call compare_masses('constant_mass', terms%mass, mass)
                terms%mass = mass
                evaluator%mass_is_known = .true.
            end if
            ! A compressed matrix has no place outside of the blocks.
            if (.not. allocated(model%mass_blocks)) return
            other = mass
            if (.not. terms%is_compressed) other = in_blocks(model%mass_blocks, mass)
            call compare_masses('mass_blocks', mass, other)
        end associate

    contains

        !> M', compressed as M.
        subroutine transpose_mass(matrix, transposed)
            real(wp), intent(in) :: matrix(:, :)
            real(wp), allocatable, intent(out) :: transposed(:, :)
            integer :: c, first, i

            if (.not. evaluator%terms%is_compressed) then
                allocate (transposed, source=transpose(matrix))
                return
            end if
            allocate (transposed, mold=matrix)
            transposed = 0.0_wp
            associate (column => model%pattern%mass_column)
                do i = 1, model%n
                    first = i - column(i)
                    do c = 1, size(matrix, 2)
                        if (first + c > model%n) exit
                        ! The next block begins with column 1.
                        if (column(first + c) /= c) exit
                        transposed(i, c) = matrix(first + c, column(i))
                    end do
                end do
            end associate
        end subroutine transpose_mass

        !> Compare two of M, of which entries of compressed ones that belong to no block do not count.
        subroutine compare_masses(name, value, expected)
            character(len=*), intent(in) :: name
            real(wp), intent(in) :: value(:, :), expected(:, :)
            type(finding_type) :: finding
            real(wp) :: used(size(value, 1), size(value, 2))
            integer :: c, first, i

            if (.not. evaluator%terms%is_compressed) then
                call compare(name, value, expected, finding)
            else
                used = expected
                associate (column => model%pattern%mass_column)
                    do i = 1, model%n
                        first = i - column(i)
                        do c = 1, size(value, 2)
                            if (first + c <= model%n) then
                                if (column(first + c) == c) used(i, c) = value(i, c)
                            end if
                        end do
                    end do
                    call compare(name, used, expected, finding)
                    finding%column = finding%row - column(max(finding%row, 1)) + finding%column
                end associate
            end if
            call add_finding(findings, finding)
        end subroutine compare_masses
    end subroutine compare_mass

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

        has_gamma = iand(model%has_terms(), need_gamma) /= 0
    end function has_gamma

    !> The single derivative procedures that the model has.
    subroutine compare_single(model, reference, findings, failed, stat)
        class(model_type), intent(inout) :: model
        type(reference_type), intent(in) :: reference
        type(finding_type), allocatable, intent(inout) :: findings(:)
        !> Failed procedure, and its status.
        character(len=*), intent(inout) :: failed
        integer, intent(out) :: stat
        character(len=*), parameter :: name(of_jacobian_derivative:of_force_qd) = [character(len=20) :: 'jacobian_derivative', &
            'nu_derivative', 'gamma_q', 'gamma_qd', 'mass_derivative', 'reaction_derivative', 'force_q', 'force_qd']
        real(wp), allocatable :: block_m(:, :), block_n(:, :)
        integer :: part

        stat = 0
        if (.not. has_single(model)) return
        allocate (block_m(model%n_constraints(), model%n), block_n(model%n, model%n), source=0.0_wp)
        associate (t => reference%t, q => reference%q, qd => reference%qd, of_rows => reference%rows_q, &
            of_forces => reference%forces_q)
            do part = of_jacobian_derivative, of_force_qd
                if (.not. model%gives(part)) cycle
                if ((part == of_gamma_q .or. part == of_gamma_qd) .and. .not. has_gamma(model)) cycle
                failed = name(part)
                select case (part)
                case (of_mass_derivative)
                    call model%evaluate_part(part, t, q, reference%qdd, block_n, stat)
                case (of_reaction_derivative)
                    call model%evaluate_part(part, t, q, reference%lambda, block_n, stat)
                case (of_force_q, of_force_qd)
                    call model%evaluate_part(part, t, q, qd, block_n, stat)
                case default
                    call model%evaluate_part(part, t, q, qd, block_m, stat)
                end select
                if (stat /= 0) return
                select case (part)
                case (of_jacobian_derivative)
                    call compare_rows(name(part), block_m, of_rows(:, :, of_c_qd), reference, findings)
                case (of_nu_derivative)
                    call compare_rows(name(part), block_m, of_rows(:, :, of_nu), reference, findings)
                case (of_gamma_q)
                    call compare_rows(name(part), block_m, of_rows(:, :, of_gamma), reference, findings)
                case (of_gamma_qd)
                    call compare_rows(name(part), block_m, reference%gamma_qd, reference, findings)
                case (of_mass_derivative)
                    call compare_forces(name(part), block_n, of_forces(:, :, of_mass), reference, findings)
                case (of_reaction_derivative)
                    call compare_forces(name(part), block_n, of_forces(:, :, of_reaction), reference, findings)
                case (of_force_q)
                    call compare_forces(name(part), block_n, of_forces(:, :, of_force), reference, findings)
                case default ! of_force_qd
                    call compare_forces(name(part), block_n, reference%force_qd, reference, findings)
                end select
            end do
        end associate
    end subroutine compare_single

    !> The five sums of the fused procedure, as far as the model provides them.
    subroutine compare_fused(model, reference, findings, failed, stat)
        class(model_type), intent(inout) :: model
        type(reference_type), intent(in) :: reference
        type(finding_type), allocatable, intent(inout) :: findings(:)
        character(len=*), intent(inout) :: failed
        !> A status code.
        integer, intent(out) :: stat
        type(derivatives_type) :: d

        stat = 0
        if (model%provides_derivatives == 0) return
        if (reference%structure%is_compressed) then
            call d%allocate(model%n, model%n_constraints(), reference%structure%column)
        else
            call d%allocate(model%n, model%n_constraints())
        end if
        call model%evaluate_derivatives(model%provides_derivatives, reference%t, reference%q, reference%qd, reference%qdd, &
            reference%lambda, d, stat)
        failed = 'evaluate_derivatives'
        if (stat /= 0) return
        associate (of_rows => reference%rows_q, of_forces => reference%forces_q)
            if (btest(model%provides_derivatives, 0)) call compare_rows('evaluate_derivatives: velocity_q', d%velocity_q, &
                of_rows(:, :, of_c_qd) - of_rows(:, :, of_nu), reference, findings)
            if (btest(model%provides_derivatives, 1) .and. has_gamma(model)) call compare_rows( &
                'evaluate_derivatives: acceleration_q', d%acceleration_q, of_rows(:, :, of_c_qdd) + of_rows(:, :, of_gamma), &
                reference, findings)
            if (btest(model%provides_derivatives, 2) .and. has_gamma(model)) call compare_rows( &
                'evaluate_derivatives: acceleration_qd', d%acceleration_qd, reference%gamma_qd, reference, findings)
            if (btest(model%provides_derivatives, 3)) call compare_forces('evaluate_derivatives: dynamics_q', d%dynamics_q, &
                of_forces(:, :, of_mass) + of_forces(:, :, of_reaction) - of_forces(:, :, of_force), reference, findings)
            if (btest(model%provides_derivatives, 4)) call compare_forces('evaluate_derivatives: dynamics_qd', d%dynamics_qd, &
                -reference%force_qd, reference, findings)
        end associate
    end subroutine compare_fused

    !> Compare matrices with a row for each row of C, or for some of the first.
    subroutine compare_rows(name, value, expected, reference, findings)
        character(len=*), intent(in) :: name
        real(wp), intent(in) :: value(:, :), expected(:, :)
        type(reference_type), intent(in) :: reference
        type(finding_type), allocatable, intent(inout) :: findings(:)
        type(finding_type) :: finding

        call compare(name, value, expected, finding, reference%row_scale)
        if (reference%structure%is_compressed) finding%column = reference%structure%coordinate_of_row(finding%row, finding%column)
        call add_finding(findings, finding)
    end subroutine compare_rows

    !> Compare matrices with a row for each force.
    subroutine compare_forces(name, value, expected, reference, findings)
        character(len=*), intent(in) :: name
        real(wp), intent(in) :: value(:, :), expected(:, :)
        type(reference_type), intent(in) :: reference
        type(finding_type), allocatable, intent(inout) :: findings(:)
        type(finding_type) :: finding

        call compare(name, value, expected, finding)
        if (reference%structure%is_compressed) finding%column = reference%structure%coordinate_of_force(finding%row, &
            finding%column)
        call add_finding(findings, finding)
    end subroutine compare_forces

    !> Compare vectors.
    subroutine compare_vector(name, value, expected, doubt, row_scale, findings)
        character(len=*), intent(in) :: name
        real(wp), intent(in) :: value(:), expected(:)
        !> Uncertainty of the expected values on the scales of the rows, and these scales.
        real(wp), intent(in) :: doubt, row_scale(:)
        type(finding_type), allocatable, intent(inout) :: findings(:)
        type(finding_type) :: finding

        call compare(name, reshape(value, [size(value), 1]), reshape(expected, [size(expected), 1]), finding, row_scale, doubt)
        finding%column = 0
        call add_finding(findings, finding)
    end subroutine compare_vector

    !> Compare matrices and find the worst entry.
    subroutine compare(name, value, expected, finding, row_scale, doubt)
        character(len=*), intent(in) :: name
        real(wp), intent(in) :: value(:, :), expected(:, :)
        type(finding_type), intent(inout) :: finding
        !> The scales of the rows, at least as many as there are; 1 where absent.
        real(wp), intent(in), optional :: row_scale(:)
        !> Uncertainty of the expected values, from the difference of two ways to compute them; negligible if absent.
        real(wp), intent(in), optional :: doubt
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
