! SPDX-License-Identifier: MIT
!> Evaluates the terms of a model: by the fused procedure if the model has one, by single procedures otherwise. Terms that the model
!> lacks cost no call, and a constant mass matrix is evaluated once. Evaluations are counted.
module tandem_model_evaluator
    use tandem_kinds, only: long, wp
    use tandem_linalg_kernels, only: is_zero_where
    use tandem_model, only: model_type
    use tandem_model_derivatives, only: n_derivatives, need_dynamics_q, need_dynamics_qd
    use tandem_model_stiffness, only: stiffness_type
    use tandem_model_terms, only: n_terms, need_force, need_gamma, need_jacobian, need_mass, need_nu, need_phi, &
        term_name, terms_type
    use tandem_model_timer, only: of_applied_force, of_evaluate, of_evaluate_derivatives
    use tandem_pack, only: pack_type
    use tandem_status, only: status_callback_failed, status_invalid_model, status_not_evaluable, status_ok
    use tandem_model_counts, only: counts_type
    implicit none (type, external)
    private

    public :: evaluator_type

    !> Blocks that `evaluate_stiffness` of a model provides.
    integer, parameter :: need_dynamics = need_dynamics_q + need_dynamics_qd

    type :: evaluator_type
        !> Values from the last evaluation of each term, for the rows in use.
        type(terms_type) :: terms
        !> If rows were dropped: values of all rows of the model, and indices of the rows in use.
        type(terms_type), allocatable :: all_rows
        integer, allocatable :: kept(:)
        !> Terms that the model provides, a sum of need bits.
        integer :: has = 0
        !> Last term whose procedure failed, empty for the fused procedure.
        character(len=20) :: failed_term = ''
        class(model_type), pointer, private :: model => null()
        !> True if the mass matrix is constant and has been evaluated. Reset when a parameter changes.
        logical :: mass_is_known = .false.
        !> True if the mass matrix need not be checked for symmetry: the first one has been checked, or the caller checks it.
        logical :: mass_is_trusted = .false.
        !> True if all checks of the mass matrix have been made.
        logical, private :: mass_is_checked = .false.
        !> Terms that one call of the model's `evaluate` sets in place, a sum of need bits. None if a timer is attached, so that
        !> runs without a profile have no overhead.
        integer, private :: direct = 0
        !> First and last coordinate of each diagonal block of M with more than one entry. M is diagonal outside of these blocks.
        integer :: n_blocks = 0
        integer, allocatable :: blocks(:)
        !> 1 outside of the model's declared blocks in the lower triangle, where M must be zero, and 0 elsewhere (n, n). Not
        !> allocated if no blocks are declared.
        real(wp), allocatable, private :: outside(:, :)
        !> Work space of single procedures: one of two forces (n).
        real(wp), allocatable, private :: part(:)
        !> Friction on reactions at the last requested point: B (n, frictions), normal forces p (frictions) and their gradients
        !> (frictions, m). Allocated only for a model with such friction.
        real(wp), allocatable :: directions(:, :), normals(:), normals_gradient(:, :)
    contains
        procedure :: segment, constant_mass, evaluate_stiffness, initialize, evaluate, evaluate_phi
        procedure, private :: evaluate_parts, check_mass, copy_rows_in_use, copy_blocks
        procedure :: judge_blocks
        procedure, private :: check_symmetry, find_blocks, add_block
        procedure :: times_jacobian, find_directions, add_friction, set_magnitudes, pack_state
    end type evaluator_type

contains

    !> Magnitudes of the coordinates in rows of Phi, see `model_type`.
    subroutine set_magnitudes(self, q, magnitude)
        class(evaluator_type), intent(in) :: self
        real(wp), intent(in), contiguous :: q(:)
        real(wp), intent(out), contiguous :: magnitude(:)

        call self%model%set_magnitudes(q, magnitude)
    end subroutine set_magnitudes

    !> Attach a checked model.
    subroutine initialize(self, model, kept, compressed, wants_mass, wants_jacobian)
        class(evaluator_type), intent(inout) :: self
        class(model_type), intent(inout), target :: model
        !> Indices of the constraint rows to use, in increasing order; all rows by default.
        integer, intent(in), optional :: kept(:)
        !> True to store terms in compressed form, for a model with a pattern.
        logical, intent(in), optional :: compressed
        !> False if M will never be requested.
        logical, intent(in), optional :: wants_mass
        !> False if the caller sets C. C then has no columns here.
        logical, intent(in), optional :: wants_jacobian
        logical :: compresses, fills_mass
        integer :: nh, nd

        self%model => model
        compresses = .false.
        if (present(compressed)) compresses = compressed
        fills_mass = .true.
        if (present(wants_mass)) fills_mass = wants_mass
        self%mass_is_known = .false.
        self%mass_is_trusted = .false.
        self%mass_is_checked = .false.
        nh = model%n_holonomic
        nd = model%n_nonholonomic
        if (allocated(self%all_rows)) deallocate (self%all_rows)
        if (present(kept)) then
            self%kept = kept
            nh = count(kept <= model%n_holonomic)
            nd = size(kept) - nh
            allocate (self%all_rows)
            call allocate_terms(self%all_rows, model%n_holonomic, model%n_nonholonomic)
        end if
        call allocate_terms(self%terms, nh, nd)
        if (allocated(self%part)) deallocate (self%part)
        self%has = model%has_terms()
        allocate (self%part(merge(model%n, 0, iand(self%has - model%provides, need_force) /= 0)), source=0.0_wp)
        if (compresses) then
            ! Compressed storage has no entries outside of the blocks.
            self%n_blocks = 0
            self%blocks = [integer ::]
            if (allocated(self%outside)) deallocate (self%outside)
        else
            call self%copy_blocks()
        end if
        self%direct = merge(0, model%provides, present(kept) .or. associated(model%state%timer))
        if (allocated(self%directions)) deallocate (self%directions, self%normals, self%normals_gradient)
        if (model%n_frictions > 0) allocate (self%directions(model%n, model%n_frictions), self%normals(model%n_frictions), &
            self%normals_gradient(model%n_frictions, model%n_constraints()), source=0.0_wp)

    contains

        !> Allocate terms with the given numbers of rows.
        subroutine allocate_terms(terms, nh, nd)
            type(terms_type), intent(inout) :: terms
            integer, intent(in) :: nh, nd

            if (compresses) then
                call terms%allocate(model%n, nh, nd, fills_mass, model%pattern, wants_jacobian)
            else
                call terms%allocate(model%n, nh, nd, fills_mass)
            end if
        end subroutine allocate_terms
    end subroutine initialize

    !> C x, or with `of_moduli` |C| |x|, for all rows of the model; no row may be dropped.
    pure subroutine times_jacobian(self, x, of_moduli, y)
        class(evaluator_type), intent(in) :: self
        !> (n)
        real(wp), intent(in) :: x(:)
        logical, intent(in) :: of_moduli
        !> (m)
        real(wp), intent(out) :: y(:)

        if (self%terms%is_compressed) then
            call self%model%pattern%multiply(self%terms%jacobian, x, of_moduli, y)
        else if (of_moduli) then
            y = matmul(abs(self%terms%jacobian), abs(x))
        else
            y = matmul(self%terms%jacobian, x)
        end if
    end subroutine times_jacobian

    !> Evaluate the matrix B of friction on reactions, for a model with such friction.
    subroutine find_directions(self, t, q, qd, stat)
        class(evaluator_type), intent(inout) :: self
        real(wp), intent(in) :: t, q(:), qd(:)
        !> A status code.
        integer, intent(out) :: stat

        if (associated(self%model%state%timer)) call self%model%state%timer%begin_call(of_applied_force)
        call self%model%friction_directions(t, q, qd, self%directions, stat)
        if (associated(self%model%state%timer)) call self%model%state%timer%end_call()
        if (stat == 0 .and. .not. sum(abs(self%directions)) <= huge(t)) stat = 1
        if (stat == 0) return
        self%failed_term = 'friction'
        stat = merge(status_not_evaluable, status_callback_failed, stat > 0)
    end subroutine find_directions

    !> Add friction on reactions, for given multipliers, to the forces that have been evaluated.
    subroutine add_friction(self, t, q, qd, lambda, stat)
        class(evaluator_type), intent(inout) :: self
        real(wp), intent(in) :: t, q(:), qd(:), lambda(:)
        !> A status code.
        integer, intent(out) :: stat

        stat = 0
        if (.not. allocated(self%directions)) return
        call self%find_directions(t, q, qd, stat)
        if (stat /= 0) return
        call self%model%normal_forces(lambda, self%normals, self%normals_gradient)
        self%terms%force = self%terms%force + matmul(self%directions, self%normals)
    end subroutine add_friction

    !> Current segment of the model.
    pure integer function segment(self)
        class(evaluator_type), intent(in) :: self

        segment = self%model%segment
    end function segment

    !> True if M does not depend on q.
    pure logical function constant_mass(self)
        class(evaluator_type), intent(in) :: self

        constant_mass = self%model%constant_mass
    end function constant_mass

    !> Evaluate the derivatives of the forces by blocks of bodies.
    subroutine evaluate_stiffness(self, t, q, qd, qdd, lambda, stiffness, counts, stat)
        class(evaluator_type), intent(inout) :: self
        !> Arguments of the model's procedure.
        real(wp), intent(in) :: t, q(:), qd(:), qdd(:), lambda(:)
        type(stiffness_type), intent(inout) :: stiffness
        type(counts_type), intent(inout) :: counts
        !> A status code.
        integer, intent(out) :: stat
        integer :: i

        if (associated(self%model%state%timer)) call self%model%state%timer%begin_call(of_evaluate_derivatives + need_dynamics)
        call self%model%evaluate_stiffness(t, q, qd, qdd, lambda, stiffness, stat)
        if (associated(self%model%state%timer)) call self%model%state%timer%end_call()
        do i = 1, n_derivatives
            if (btest(need_dynamics, i - 1)) counts%derivatives(i) = counts%derivatives(i) + 1
        end do
        if (stat /= 0) stat = merge(status_not_evaluable, status_callback_failed, stat > 0)
    end subroutine evaluate_stiffness

    !> Evaluate the terms of a need mask that the model has.
    subroutine evaluate(self, need, t, q, qd, counts, stat)
        class(evaluator_type), intent(inout) :: self
        !> Requested terms, a sum of need bits.
        integer, intent(in) :: need
        !> Time, coordinates (n), velocities (n; not used unless gamma or force is requested).
        real(wp), intent(in) :: t, q(self%model%n), qd(self%model%n)
        type(counts_type), intent(inout) :: counts
        !> A status code.
        integer, intent(out) :: stat
        ! Indices of the table below. In the module they would be global variables.
        integer :: i, mask
        !> Number of evaluations of each term for each need mask.
        integer(long), parameter :: term_count(n_terms, 0:2**n_terms - 1) = &
            reshape([((iand(shiftr(int(mask, long), i - 1), 1_long), i=1, n_terms), mask=0, 2**n_terms - 1)], &
            [n_terms, 2**n_terms])
        integer :: wanted

        wanted = iand(need, self%has)
        if (self%mass_is_known) wanted = iand(wanted, not(need_mass))
        stat = 0
        if (wanted == 0) return
        counts%terms(:) = counts%terms + term_count(:, wanted)
        if (wanted == iand(wanted, self%direct)) then
            ! Most frequent case.
            counts%fused_calls = counts%fused_calls + 1
            call self%model%evaluate(wanted, t, q, qd, self%terms, stat)
            if (stat /= 0) self%failed_term = 'evaluate'
        else
            call self%evaluate_parts(wanted, t, q, qd, counts, stat)
        end if
        if (stat /= 0) then
            stat = merge(status_not_evaluable, status_callback_failed, stat > 0)
        else if (iand(wanted, need_mass) /= 0 .and. .not. self%mass_is_checked) then
            call self%check_mass(stat)
        end if
    end subroutine evaluate

    !> Evaluate only Phi, as iterations for the position do repeatedly.
    subroutine evaluate_phi(self, t, q, counts, stat)
        class(evaluator_type), intent(inout) :: self
        !> Time, coordinates (n).
        real(wp), intent(in) :: t, q(self%model%n)
        type(counts_type), intent(inout) :: counts
        !> A status code.
        integer, intent(out) :: stat

        ! Phi does not depend on the velocity; q is passed in its place.
        if (iand(need_phi, self%direct) == 0) then
            call self%evaluate(need_phi, t, q, q, counts, stat)
            return
        end if
        counts%terms(1) = counts%terms(1) + 1
        counts%fused_calls = counts%fused_calls + 1
        call self%model%evaluate(need_phi, t, q, q, self%terms, stat)
        if (stat == 0) return
        self%failed_term = 'evaluate'
        stat = merge(status_not_evaluable, status_callback_failed, stat > 0)
    end subroutine evaluate_phi

    !> Evaluate terms by several procedures, with dropped rows, or with a timer.
    subroutine evaluate_parts(self, wanted, t, q, qd, counts, stat)
        class(evaluator_type), intent(inout) :: self
        integer, intent(in) :: wanted
        real(wp), intent(in) :: t, q(:), qd(:)
        type(counts_type), intent(inout) :: counts
        !> Status of the procedure.
        integer, intent(out) :: stat
        integer :: failed

        if (iand(wanted, self%model%provides) /= 0) counts%fused_calls = counts%fused_calls + 1
        if (allocated(self%all_rows)) then
            call evaluate_terms(self%model, wanted, t, q, qd, self%all_rows, self%part, failed, stat)
            if (stat == 0) call self%copy_rows_in_use(wanted)
        else
            call evaluate_terms(self%model, wanted, t, q, qd, self%terms, self%part, failed, stat)
        end if
        if (stat == 0) return
        self%failed_term = 'evaluate'
        if (failed > 0) self%failed_term = term_name(failed)
    end subroutine evaluate_parts

    !> Evaluate terms by the fused procedure as far as it provides them, and by single procedures otherwise.
    subroutine evaluate_terms(model, wanted, t, q, qd, terms, part, failed_term, stat)
        class(model_type), intent(inout) :: model
        integer, intent(in) :: wanted
        real(wp), intent(in) :: t, q(:), qd(:)
        type(terms_type), intent(inout) :: terms
        !> Work space (n).
        real(wp), intent(inout) :: part(:)
        !> Index of the term whose procedure failed; 0 for the fused procedure.
        integer, intent(out) :: failed_term
        !> Status of the procedure.
        integer, intent(out) :: stat
        integer :: fused

        stat = 0
        failed_term = 0
        fused = iand(wanted, model%provides)
        if (fused /= 0) then
            if (associated(model%state%timer)) call model%state%timer%begin_call(of_evaluate + fused)
            call model%evaluate(fused, t, q, qd, terms, stat)
        end if
        if (stat == 0 .and. wanted /= fused) call model%evaluate_single(wanted - fused, t, q, qd, terms, part, failed_term, stat)
        if (associated(model%state%timer)) call model%state%timer%end_call()
    end subroutine evaluate_terms

    !> Check a mass matrix after its evaluation: the first one of the run, or a constant one.
    subroutine check_mass(self, stat)
        class(evaluator_type), intent(inout) :: self
        !> A status code.
        integer, intent(out) :: stat

        stat = status_ok
        if (.not. self%mass_is_trusted) then
            call self%check_symmetry(stat)
            if (stat == status_ok) call self%judge_blocks(stat)
        end if
        if (self%model%constant_mass) then
            if (.not. self%terms%is_compressed) call self%find_blocks()
            self%mass_is_known = .true.
        else
            self%mass_is_checked = .true.
        end if
    end subroutine check_mass

    !> Copy the diagonal blocks of M declared by the model.
    subroutine copy_blocks(self)
        class(evaluator_type), intent(inout) :: self
        integer :: b, first, last

        associate (n => self%model%n)
            self%blocks = [1, n]
            self%n_blocks = merge(1, 0, n > 1)
            if (allocated(self%outside)) deallocate (self%outside)
            if (.not. allocated(self%model%mass_blocks)) return
            allocate (self%outside(n, n), source=0.0_wp)
            self%n_blocks = 0
            self%blocks = [integer ::]
            last = 0
            do b = 1, size(self%model%mass_blocks)
                first = last + 1
                last = last + self%model%mass_blocks(b)
                call self%add_block(first, last)
                self%outside(last + 1:, first:last) = 1.0_wp
            end do
        end associate
    end subroutine copy_blocks

    !> Find the smallest diagonal blocks that contain all entries of a constant M.
    subroutine find_blocks(self)
        class(evaluator_type), intent(inout) :: self
        integer :: first, i, j, last

        self%n_blocks = 0
        self%blocks = [integer ::]
        first = 1
        last = 1
        associate (mass => self%terms%mass)
            do j = 1, size(mass, 1)
                do i = last + 1, size(mass, 1)
                    if (.not. (abs(mass(i, j)) <= 0.0_wp .and. abs(mass(j, i)) <= 0.0_wp)) last = i
                end do
                if (j < last) cycle
                call self%add_block(first, last)
                first = last + 1
                last = first
            end do
        end associate
    end subroutine find_blocks

    !> Append a block, except for a block of one entry.
    pure subroutine add_block(self, first, last)
        class(evaluator_type), intent(inout) :: self
        integer, intent(in) :: first, last

        if (first == last) return
        self%n_blocks = self%n_blocks + 1
        self%blocks = [self%blocks, first, last]
    end subroutine add_block

    !> Refuse a mass matrix with nonzero entries outside of the model's declared blocks, since omitting such entries would change
    !> the motion. For a constant M the blocks are computed instead.
    subroutine judge_blocks(self, stat)
        class(evaluator_type), intent(inout) :: self
        !> `status_ok` or `status_invalid_model`.
        integer, intent(out) :: stat
        integer :: i, j

        stat = status_ok
        if (self%mass_is_known .or. .not. allocated(self%outside)) return
        if (is_zero_where(size(self%outside), self%outside, self%terms%mass)) return
        do j = 1, size(self%terms%mass, 2)
            do i = j + 1, size(self%terms%mass, 1)
                if (.not. self%outside(i, j)*abs(self%terms%mass(i, j)) > 0.0_wp) cycle
                stat = status_invalid_model
                write (self%failed_term, '("outside(",i0,",",i0,")")') i, j
                return
            end do
        end do
    end subroutine judge_blocks

    !> Refuse an asymmetric mass matrix. NaN are detected elsewhere.
    subroutine check_symmetry(self, stat)
        class(evaluator_type), intent(inout) :: self
        !> `status_ok` or `status_invalid_model`.
        integer, intent(out) :: stat
        !> Tolerances relative to both entries and to the largest entry. Models may compute the two entries of a pair by different
        !> formulas.
        real(wp), parameter :: of_entry = 1.0e-6_wp, of_largest = 1.0e-12_wp
        real(wp) :: largest, allowed
        integer :: i, j

        stat = status_ok
        self%mass_is_trusted = .true.
        if (self%terms%is_compressed) then
            call check_compressed_symmetry()
            return
        end if
        associate (mass => self%terms%mass)
            largest = maxval(abs(mass))
            do j = 2, size(mass, 2)
                do i = 1, j - 1
                    allowed = of_entry*max(abs(mass(i, j)), abs(mass(j, i))) + of_largest*largest
                    if (.not. abs(mass(i, j) - mass(j, i)) > allowed) cycle
                    stat = status_invalid_model
                    write (self%failed_term, '("mass(",i0,",",i0,")")') i, j
                    return
                end do
            end do
        end associate

    contains

        !> Check a compressed matrix.
        subroutine check_compressed_symmetry()
            integer :: first

            first = 1
            associate (mass => self%terms%mass, column => self%model%pattern%mass_column)
                largest = maxval(abs(mass))
                do j = 1, size(column)
                    if (column(j) == 1) first = j
                    do i = first, j - 1
                        allowed = of_entry*max(abs(mass(i, column(j))), abs(mass(j, column(i)))) + of_largest*largest
                        if (.not. abs(mass(i, column(j)) - mass(j, column(i))) > allowed) cycle
                        stat = status_invalid_model
                        write (self%failed_term, '("mass(",i0,",",i0,")")') i, j
                        return
                    end do
                end do
            end associate
        end subroutine check_compressed_symmetry
    end subroutine check_symmetry

    !> Copy the rows in use.
    subroutine copy_rows_in_use(self, wanted)
        class(evaluator_type), intent(inout) :: self
        !> Evaluated terms.
        integer, intent(in) :: wanted

        associate (terms => self%terms, all_rows => self%all_rows, kept => self%kept)
            if (iand(wanted, need_phi) /= 0) terms%phi = all_rows%phi(kept(:size(terms%phi)))
            if (iand(wanted, need_jacobian) /= 0) terms%jacobian = all_rows%jacobian(kept, :)
            if (iand(wanted, need_nu) /= 0) terms%nu = all_rows%nu(kept)
            if (iand(wanted, need_gamma) /= 0) terms%gamma = all_rows%gamma(kept)
            if (iand(wanted, need_mass) /= 0) terms%mass = all_rows%mass
            if (iand(wanted, need_force) /= 0) terms%force = all_rows%force
        end associate
    end subroutine copy_rows_in_use

    !> Pack the last evaluation.
    subroutine pack_state(self, pack)
        class(evaluator_type), intent(inout) :: self
        type(pack_type), intent(inout) :: pack

        call self%terms%pack_state(pack)
        if (allocated(self%all_rows)) call self%all_rows%pack_state(pack)
        call pack%item(self%kept)
        call pack%item(self%mass_is_known)
        call pack%item(self%n_blocks)
        call pack%item(self%blocks)
        call pack%item(self%failed_term)
        if (.not. allocated(self%directions)) return
        call pack%item(self%directions, self%normals_gradient)
    end subroutine pack_state
end module tandem_model_evaluator
