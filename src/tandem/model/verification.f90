! SPDX-License-Identifier: MIT
!> Verifies every procedure of a model by differences of other procedures at random states, and reports wrong ones with the position
!> and the size of the error.
!>
!> Differences of Phi give Phi_q and nu; those of C and nu give gamma and the derivatives of C and nu; those of M and of the forces
!> give their derivatives. There is no reference for E, e, M and the forces themselves; M is checked for symmetry, constancy and
!> block structure. States need not satisfy the constraints. Constraint rows may have any units: errors are related to the entries
!> of the row in C.
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

    !> Result of the verification of one procedure.
    type :: finding_type
        !> Name of the procedure, or of a part of a fused one.
        character(len=48) :: name = ''
        !> Largest error over all states, relative to the largest entry of both values.
        real(wp) :: error = 0.0_wp
        !> Row and column of the largest error (column 0 for a vector), value of the procedure, and value by differences.
        integer :: row = 0, column = 0
        real(wp) :: value = 0.0_wp, expected = 0.0_wp
        !> False if the error exceeds the error of differences, or if the procedure failed.
        logical :: passed = .true.
        !> Status of a procedure that failed; 0 if it could be evaluated at all states.
        integer :: stat = 0
    end type finding_type

    !> Work data of the verification of a model.
    type :: comparison_type
        class(model_type), pointer :: model => null()
        type(evaluator_type) :: evaluator
        type(reference_type) :: reference
        type(counts_type) :: counts
        type(finding_type), allocatable :: findings(:)
        !> Name of the procedure called last.
        character(len=20) :: failed = ''
    end type comparison_type

    !> Fourth-order central differences have an error of about eps**(4/5) = 3e-13 times the size of the function, which may be large
    !> compared with its derivatives. The error of a wrong formula is 1e-3 or more.
    real(wp), parameter :: tolerance = 1.0e-6_wp
    !> Differences with a larger uncertainty, relative to their largest entry, cannot show that a formula is wrong.
    real(wp), parameter :: most_uncertain = 1.0e-3_wp
    !> Largest number of coordinates for full matrices, as on dense charts, if the model has a pattern; matrices of larger models
    !> are compressed. Largest number for full matrices without a usable pattern, which would take gigabytes.
    integer, parameter :: most_full = 200, most_coordinates = 5000

contains

    !> Verify a model at `n_states` random states near (t, q, qd). An error means that the model is incomplete or could not be
    !> evaluated; wrong procedures are findings. The flags of floating-point exceptions are restored, because a long step of a
    !> difference may cause overflow in a model, which the program would report at its end.
    subroutine verify_model(model, t, q, qd, n_states, findings, error)
        class(model_type), intent(inout), target :: model
        !> State at which the model can be evaluated (n). Velocities near zero are replaced by random ones of the order of their
        !> scale.
        real(wp), intent(in) :: t, q(:), qd(:)
        integer, intent(in) :: n_states
        !> One finding per verified procedure.
        type(finding_type), allocatable, intent(out) :: findings(:)
        type(error_type), allocatable, intent(out) :: error
        type(comparison_type) :: work
        type(structure_type) :: structure
        type(pack_type) :: pack
        character(len=40) :: problem
        integer(long), allocatable :: memory(:)
        logical :: flags(size(ieee_all)), holds
        integer :: state, seed

        allocate (findings(0))
        call check_model(model, error)
        if (allocated(error)) return
        ! A model may count revolutions from state to state. Restore its state, because random states do not form a motion.
        call pack%begin_writing()
        call model%pack_state(pack)
        call pack%end_writing('model', memory)
        call model%set_time_scale(t, q, qd)
        call ieee_get_flag(ieee_all, flags)
        call choose_structure(model, structure)
        work%model => model
        do
            work%findings = [finding_type ::]
            call work%evaluator%initialize(model, compressed=structure%is_compressed)
            ! Symmetry is checked below.
            work%evaluator%mass_is_trusted = .true.
            call work%reference%initialize(model, structure)
            seed = 12345
            do state = 1, n_states
                call choose_state()
                call compare_all(work, holds)
                if (.not. holds) exit
            end do
            if (holds .or. n_states < 1) exit
            ! A term depends on coordinates outside of the pattern, which is an error only for C and M.
            if (model%n > most_coordinates) then
                call set_error(error, status_work_limit, 'the model "'//model%name//'" has '//to_text(model%n)// &
                    ' coordinates, and depends on more of them than its pattern says: too many to compare its procedures', &
                    'check a smaller model of the same elements')
                exit
            end if
            call structure%set_full(model%n, model%n_constraints())
        end do
        if (.not. allocated(error)) call move_alloc(work%findings, findings)
        call pack%begin_reading('model', memory, problem)
        call model%pack_state(pack)
        call ieee_set_flag(ieee_all, flags)

    contains

        !> Set a random state near the given one.
        subroutine choose_state()
            associate (there => work%reference, scale => work%reference%scale, n => model%n)
                there%t = t
                there%q = q + 0.1_wp*scale*random_vector(seed, n)
                there%qd = qd + scale/model%time_scale*random_vector(seed, n)
                there%qdd = scale/model%time_scale**2*random_vector(seed, n)
                there%lambda = random_vector(seed, model%n_constraints())
            end associate
        end subroutine choose_state
    end subroutine verify_model

    !> Set the structure of a model, from its pattern if it has one.
    subroutine choose_structure(model, structure)
        class(model_type), intent(in) :: model
        type(structure_type), intent(inout) :: structure
        integer, parameter :: of_pattern = need_jacobian + need_mass

        if (.not. allocated(model%pattern)) then
            call structure%set_full(model%n, model%n_constraints())
        else
            ! Single procedures set matrices that are not compressed.
            call structure%use_pattern(model%pattern, model%n > most_full .and. iand(model%provides, of_pattern) == of_pattern &
                .and. .not. has_single(model) .and. (model%provides_derivatives == 0 .or. model%derives_by_bodies))
        end if
    end subroutine choose_structure

    !> True if the model has single derivative procedures.
    pure logical function has_single(model)
        class(model_type), intent(in) :: model
        integer :: part

        has_single = any([(model%gives(part), part=of_jacobian_derivative, of_force_qd)])
    end function has_single

    !> Verify all procedures at one state.
    subroutine compare_all(self, holds)
        type(comparison_type), intent(inout) :: self
        !> False if terms depend on coordinates outside of the pattern. Tested at the first state only.
        logical, intent(out) :: holds
        integer :: stat

        holds = .true.
        associate (model => self%model, evaluator => self%evaluator, reference => self%reference, counts => self%counts)
            call reference%find_row_scales(model, evaluator, counts, stat)
            reference%lambda = reference%lambda/reference%row_scale
            if (stat == 0) call reference%differentiate(model, evaluator, counts, stat)
            if (stat == 0 .and. size(self%findings) == 0 .and. reference%structure%is_of_pattern) then
                call reference%check_structure(model, evaluator, counts, holds, stat)
                if (stat == 0 .and. .not. holds) return
            end if
            if (stat == 0) call compare_terms(self, stat)
            if (stat == 0) call compare_mass(self, stat)
            self%failed = evaluator%failed_term
        end associate
        if (stat == 0) then
            call compare_single(self, stat)
            if (stat == 0) call compare_fused(self, stat)
            if (stat /= 0) stat = merge(status_not_evaluable, status_callback_failed, stat > 0)
        end if
        if (stat /= 0) call add_finding(self, finding_type(name='evaluation of '//self%failed, passed=.false., stat=stat))
    end subroutine compare_all

    !> Verify Phi_q, nu and gamma.
    subroutine compare_terms(self, stat)
        type(comparison_type), intent(inout) :: self
        integer, intent(out) :: stat
        real(wp), allocatable :: jacobian(:, :)

        associate (model => self%model, evaluator => self%evaluator, reference => self%reference)
            call evaluator%evaluate(need_jacobian + need_nu + need_gamma + need_mass, reference%t, reference%q, reference%qd, &
                self%counts, stat)
            if (stat /= 0) return
            associate (terms => evaluator%terms, nh => model%n_holonomic)
                if (nh > 0) then
                    if (terms%is_compressed) then
                        call spread_jacobian(reference%structure)
                    else
                        jacobian = terms%jacobian(:nh, :)
                    end if
                    call compare_rows(self, 'holonomic_jacobian', jacobian, reference%rows_q(:nh, :, of_phi))
                    call compare_vector(self, 'holonomic_rate', -terms%nu(:nh), reference%phi_t, reference%uncertainty_of_phi_t)
                end if
                if (model%n_constraints() > 0 .and. iand(evaluator%has, need_gamma) /= 0) call compare_vector(self, &
                    'constraint_acceleration', terms%gamma, reference%gamma, reference%uncertainty_of_gamma)
            end associate
        end associate

    contains

        !> Copy rows of Phi_q from the columns of the pattern to the columns of the structure.
        subroutine spread_jacobian(s)
            type(structure_type), intent(in) :: s
            integer :: i, j, k

            allocate (jacobian(self%model%n_holonomic, s%width), source=0.0_wp)
            do j = 1, self%model%n
                do k = s%row_start(s%set(j)), s%row_start(s%set(j) + 1) - 1
                    i = s%rows(k)
                    if (i > size(jacobian, 1)) cycle
                    jacobian(i, s%column(j)) = self%evaluator%terms%jacobian(i, self%model%pattern%column(j))
                end do
            end do
        end subroutine spread_jacobian
    end subroutine compare_terms

    !> Verify symmetry, constancy and block structure of M, which has been evaluated.
    subroutine compare_mass(self, stat)
        type(comparison_type), intent(inout) :: self
        integer, intent(out) :: stat
        real(wp), allocatable :: mass(:, :), other(:, :)

        stat = 0
        associate (model => self%model, evaluator => self%evaluator, terms => self%evaluator%terms, reference => self%reference)
            mass = terms%mass
            call transpose_mass(mass, other)
            call compare_masses('mass_matrix (symmetry)', mass, other)
            if (model%constant_mass) then
                ! Evaluate M again.
                evaluator%mass_is_known = .false.
                call evaluator%evaluate(need_mass, reference%t, reference%q, reference%qd, self%counts, stat)
                if (stat /= 0) return
                call compare_masses('constant_mass', terms%mass, mass)
                terms%mass = mass
                evaluator%mass_is_known = .true.
            end if
            ! A compressed matrix has no entries outside of the blocks.
            if (.not. allocated(model%mass_blocks)) return
            other = mass
            if (.not. terms%is_compressed) other = in_blocks(model%mass_blocks, mass)
            call compare_masses('mass_blocks', mass, other)
        end associate

    contains

        !> Transpose of M, compressed as M.
        subroutine transpose_mass(matrix, transposed)
            real(wp), intent(in) :: matrix(:, :)
            real(wp), allocatable, intent(out) :: transposed(:, :)
            integer :: c, first, i

            if (.not. self%evaluator%terms%is_compressed) then
                allocate (transposed, source=transpose(matrix))
                return
            end if
            allocate (transposed, mold=matrix)
            transposed = 0.0_wp
            associate (column => self%model%pattern%mass_column)
                do i = 1, self%model%n
                    first = i - column(i)
                    do c = 1, size(matrix, 2)
                        if (first + c > self%model%n) exit
                        ! The next block begins with column 1.
                        if (column(first + c) /= c) exit
                        transposed(i, c) = matrix(first + c, column(i))
                    end do
                end do
            end associate
        end subroutine transpose_mass

        !> Compare two mass matrices. Entries of compressed ones outside of the blocks are ignored.
        subroutine compare_masses(name, value, expected)
            character(len=*), intent(in) :: name
            real(wp), intent(in) :: value(:, :), expected(:, :)
            type(finding_type) :: finding
            real(wp) :: used(size(value, 1), size(value, 2))
            integer :: c, first, i

            if (.not. self%evaluator%terms%is_compressed) then
                call compare(name, value, expected, finding)
            else
                used = expected
                associate (column => self%model%pattern%mass_column)
                    do i = 1, self%model%n
                        first = i - column(i)
                        do c = 1, size(value, 2)
                            if (first + c <= self%model%n) then
                                if (column(first + c) == c) used(i, c) = value(i, c)
                            end if
                        end do
                    end do
                    call compare(name, used, expected, finding)
                    finding%column = finding%row - column(max(finding%row, 1)) + finding%column
                end associate
            end if
            call add_finding(self, finding)
        end subroutine compare_masses
    end subroutine compare_mass

    !> Copy of a matrix in which entries outside of its diagonal blocks are zero.
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

    !> True if differences can be compared with a gamma of the model.
    pure logical function has_gamma(model)
        class(model_type), intent(in) :: model

        has_gamma = iand(model%has_terms(), need_gamma) /= 0
    end function has_gamma

    !> Verify single derivative procedures.
    subroutine compare_single(self, stat)
        type(comparison_type), intent(inout) :: self
        integer, intent(out) :: stat
        character(len=*), parameter :: name(of_jacobian_derivative:of_force_qd) = [character(len=20) :: 'jacobian_derivative', &
            'nu_derivative', 'gamma_q', 'gamma_qd', 'mass_derivative', 'reaction_derivative', 'force_q', 'force_qd']
        real(wp), allocatable :: block_m(:, :), block_n(:, :)
        integer :: part

        stat = 0
        associate (model => self%model, there => self%reference, of_rows => self%reference%rows_q, &
            of_forces => self%reference%forces_q)
            if (.not. has_single(model)) return
            allocate (block_m(model%n_constraints(), model%n), block_n(model%n, model%n), source=0.0_wp)
            do part = of_jacobian_derivative, of_force_qd
                if (.not. model%gives(part)) cycle
                if ((part == of_gamma_q .or. part == of_gamma_qd) .and. .not. has_gamma(model)) cycle
                self%failed = name(part)
                select case (part)
                case (of_mass_derivative)
                    call model%evaluate_part(part, there%t, there%q, there%qdd, block_n, stat)
                case (of_reaction_derivative)
                    call model%evaluate_part(part, there%t, there%q, there%lambda, block_n, stat)
                case (of_force_q, of_force_qd)
                    call model%evaluate_part(part, there%t, there%q, there%qd, block_n, stat)
                case default
                    call model%evaluate_part(part, there%t, there%q, there%qd, block_m, stat)
                end select
                if (stat /= 0) return
                select case (part)
                case (of_jacobian_derivative); call compare_rows(self, name(part), block_m, of_rows(:, :, of_c_qd))
                case (of_nu_derivative); call compare_rows(self, name(part), block_m, of_rows(:, :, of_nu))
                case (of_gamma_q); call compare_rows(self, name(part), block_m, of_rows(:, :, of_gamma))
                case (of_gamma_qd); call compare_rows(self, name(part), block_m, there%gamma_qd)
                case (of_mass_derivative); call compare_forces(self, name(part), block_n, of_forces(:, :, of_mass))
                case (of_reaction_derivative); call compare_forces(self, name(part), block_n, of_forces(:, :, of_reaction))
                case (of_force_q); call compare_forces(self, name(part), block_n, of_forces(:, :, of_force))
                case default; call compare_forces(self, name(part), block_n, there%force_qd)
                end select
            end do
        end associate
    end subroutine compare_single

    !> Verify the five derivatives of the fused procedure, as far as it provides them.
    subroutine compare_fused(self, stat)
        type(comparison_type), intent(inout) :: self
        !> Status of the procedure.
        integer, intent(out) :: stat
        character(len=*), parameter :: label = 'evaluate_derivatives: '
        type(derivatives_type) :: d

        stat = 0
        associate (model => self%model, there => self%reference, of_rows => self%reference%rows_q, &
            of_forces => self%reference%forces_q, given => self%model%provides_derivatives)
            if (given == 0) return
            if (there%structure%is_compressed) then
                call d%allocate(model%n, model%n_constraints(), there%structure%column)
            else
                call d%allocate(model%n, model%n_constraints())
            end if
            self%failed = 'evaluate_derivatives'
            call model%evaluate_derivatives(given, there%t, there%q, there%qd, there%qdd, there%lambda, d, stat)
            if (stat /= 0) return
            if (btest(given, 0)) call compare_rows(self, label//'velocity_q', d%velocity_q, &
                of_rows(:, :, of_c_qd) - of_rows(:, :, of_nu))
            if (btest(given, 1) .and. has_gamma(model)) call compare_rows(self, label//'acceleration_q', d%acceleration_q, &
                of_rows(:, :, of_c_qdd) + of_rows(:, :, of_gamma))
            if (btest(given, 2) .and. has_gamma(model)) call compare_rows(self, label//'acceleration_qd', d%acceleration_qd, &
                there%gamma_qd)
            if (btest(given, 3)) call compare_forces(self, label//'dynamics_q', d%dynamics_q, &
                of_forces(:, :, of_mass) + of_forces(:, :, of_reaction) - of_forces(:, :, of_force))
            if (btest(given, 4)) call compare_forces(self, label//'dynamics_qd', d%dynamics_qd, -there%force_qd)
        end associate
    end subroutine compare_fused

    !> Compare matrices whose rows belong to all rows of C or to the first ones.
    subroutine compare_rows(self, name, value, expected)
        type(comparison_type), intent(inout) :: self
        character(len=*), intent(in) :: name
        real(wp), intent(in) :: value(:, :), expected(:, :)
        type(finding_type) :: finding

        call compare(name, value, expected, finding, self%reference%row_scale)
        associate (s => self%reference%structure)
            if (s%is_compressed) finding%column = s%coordinate_of_row(finding%row, finding%column)
        end associate
        call add_finding(self, finding)
    end subroutine compare_rows

    !> Compare matrices whose rows belong to the forces.
    subroutine compare_forces(self, name, value, expected)
        type(comparison_type), intent(inout) :: self
        character(len=*), intent(in) :: name
        real(wp), intent(in) :: value(:, :), expected(:, :)
        type(finding_type) :: finding

        call compare(name, value, expected, finding)
        associate (s => self%reference%structure)
            if (s%is_compressed) finding%column = s%coordinate_of_force(finding%row, finding%column)
        end associate
        call add_finding(self, finding)
    end subroutine compare_forces

    !> Compare vectors.
    subroutine compare_vector(self, name, value, expected, uncertainty)
        type(comparison_type), intent(inout) :: self
        character(len=*), intent(in) :: name
        real(wp), intent(in) :: value(:), expected(:)
        !> Uncertainty of the expected values on the scales of the rows.
        real(wp), intent(in) :: uncertainty
        type(finding_type) :: finding

        call compare(name, reshape(value, [size(value), 1]), reshape(expected, [size(expected), 1]), finding, &
            self%reference%row_scale, uncertainty)
        finding%column = 0
        call add_finding(self, finding)
    end subroutine compare_vector

    !> Compare matrices and find the entry with the largest error.
    subroutine compare(name, value, expected, finding, row_scale, uncertainty)
        character(len=*), intent(in) :: name
        real(wp), intent(in) :: value(:, :), expected(:, :)
        type(finding_type), intent(inout) :: finding
        !> Scales of the rows; 1 by default.
        real(wp), intent(in), optional :: row_scale(:)
        !> Uncertainty of the expected values, estimated from two ways to compute them; negligible by default.
        real(wp), intent(in), optional :: uncertainty
        real(wp) :: allowed, scale, deviation(size(value, 1), size(value, 2)), unit(size(value, 1))
        integer :: position_of_worst(2), j

        finding%name = name
        if (size(value) > 0) then
            unit = 1.0_wp
            if (present(row_scale)) unit = row_scale(:size(unit))
            scale = least_size
            do j = 1, size(value, 2)
                scale = max(scale, maxval(abs(value(:, j))/unit), maxval(abs(expected(:, j))/unit))
                deviation(:, j) = abs(value(:, j) - expected(:, j))/unit
            end do
            ! maxloc ignores NaN.
            position_of_worst = findloc(deviation <= huge(1.0_wp), .false.)
            if (position_of_worst(1) == 0) position_of_worst = maxloc(deviation)
            finding%row = position_of_worst(1)
            finding%column = position_of_worst(2)
            finding%value = value(finding%row, finding%column)
            finding%expected = expected(finding%row, finding%column)
            finding%error = deviation(finding%row, finding%column)/scale
            allowed = tolerance
            if (present(uncertainty)) allowed = max(tolerance, min(10*uncertainty/scale, most_uncertain))
            finding%passed = all(abs(value) <= huge(1.0_wp)) .and. finding%error <= allowed
        end if
    end subroutine compare

    !> Add a finding. If there is one with the same name, store the worse of both.
    subroutine add_finding(self, finding)
        type(comparison_type), intent(inout) :: self
        type(finding_type), intent(in) :: finding
        integer :: i

        do i = 1, size(self%findings)
            associate (known => self%findings(i))
                if (known%name /= finding%name) cycle
                if ((known%passed .and. .not. finding%passed) .or. finding%error > known%error) known = finding
                return
            end associate
        end do
        self%findings = [self%findings, finding]
    end subroutine add_finding
end module tandem_model_verification
