! SPDX-License-Identifier: MIT
!> Parts of a run in a profile: their names and groups.
module tandem_profile_parts
    use tandem_model_derivatives, only: derivative_name, n_derivatives, need_all_derivatives
    use tandem_model_terms, only: term_name
    use tandem_model_timer, only: n_operations, of_acceleration, of_correction, of_energy, of_errors, of_evaluate, &
        of_evaluate_derivatives, of_filter, of_matrix, of_multipliers, of_origin, of_policy, of_position, of_projection, of_rank, &
        of_refresh, of_reuse, of_stage, of_velocity
    implicit none (type, external)
    private

    public :: n_parts, part_name, part_group, n_part_groups, part_group_name, terms_of_part
    public :: part_control, part_start, part_watch, part_rows, part_blocks, part_checkpoint, part_open
    public :: part_chart, part_renew, part_refresh, part_position, part_velocity, part_acceleration, part_errors, part_rank, &
        part_health, part_multipliers, part_energy, part_projection
    public :: part_matrix, part_reuse, part_correction, part_stage, part_filter
    public :: part_single, part_terms, part_derivatives
    public :: group_model, group_chart, group_newton, group_control, group_output, group_start, group_watch

    !> Everything that is not in another part: sums of steppers, choice of steps, states, events.
    integer, parameter :: part_control = 1
    !> Start of a simulation; observers that do not write output.
    integer, parameter :: part_start = 2, part_watch = 3
    !> Parts of output: rows collected in memory, rows written to disk, state for checkpoints, opening and closing of the file.
    integer, parameter :: part_rows = 4, part_blocks = 5, part_checkpoint = 6, part_open = 7
    !> Operation i of a chart (`tandem_model_timer`) is the part `part_chart + i`.
    integer, parameter :: part_chart = 7, part_renew = part_chart + of_origin, part_refresh = part_chart + of_refresh, &
        part_position = part_chart + of_position, part_velocity = part_chart + of_velocity, &
        part_acceleration = part_chart + of_acceleration, part_errors = part_chart + of_errors, &
        part_rank = part_chart + of_rank, part_health = part_chart + of_policy, part_multipliers = part_chart + of_multipliers, &
        part_energy = part_chart + of_energy, part_projection = part_chart + of_projection
    !> Newton's iteration: matrices computed and factored; matrices reused from previous steps; corrections; points, residuals and
    !> systems of iterates; filter of the error estimate.
    integer, parameter :: part_matrix = part_chart + of_matrix, part_reuse = part_chart + of_reuse, &
        part_correction = part_chart + of_correction, part_stage = part_chart + of_stage, part_filter = part_chart + of_filter
    !> Call i of a procedure of a model (`tandem_model_timer`) is the part `part_single + i`; single procedures come first
    !> (`single_name`).
    integer, parameter :: part_single = part_chart + n_operations, n_singles = of_evaluate
    !> A call of `evaluate` with the need mask m is the part `part_terms + m`, a call of `evaluate_derivatives` the part
    !> `part_derivatives + m`.
    integer, parameter :: part_terms = part_single + of_evaluate, part_derivatives = part_single + of_evaluate_derivatives
    !> Number of parts.
    integer, parameter :: n_parts = part_derivatives + need_all_derivatives

    !> Groups of parts.
    integer, parameter :: group_model = 1, group_chart = 2, group_newton = 3, group_control = 4, group_output = 5, &
        group_start = 6, group_watch = 7
    !> Number of groups.
    integer, parameter :: n_part_groups = 7
    character(len=20), parameter :: part_group_name(n_part_groups) = [character(len=20) :: 'model', 'chart', 'Newton', &
        'stepper and control', 'output', 'start', 'watching']

    !> Length of the name of a part.
    integer, parameter :: name_length = 88

    character(len=name_length), parameter :: own_name(part_single) = [character(len=name_length) :: 'stepper and control', &
        'start', 'watching', 'rows', 'writing and flushing', 'state for a checkpoint', 'opening and closing', 'new charts', &
        'old charts kept', 'position', 'velocity', 'acceleration', 'constraint errors', 'rank', 'state of the chart', &
        'multipliers', 'kinetic energy', 'velocity after a jump', 'matrices', 'matrices kept', 'corrections', &
        'points of stages', 'error filter']

    !> Single procedures of a model, in the order of `procedure_model_type`; bit of the term if the procedure evaluates one of
    !> `term_name`.
    character(len=24), parameter :: single_name(n_singles) = [character(len=24) :: 'holonomic', 'holonomic_jacobian', &
        'holonomic_rate', 'nonholonomic_jacobian', 'nonholonomic_rhs', 'constraint_acceleration', 'mass_matrix', &
        'inertia_force', 'applied_force', 'kinetic_energy', 'potential_energy', 'jacobian_derivative', 'nu_derivative', &
        'gamma_q', 'gamma_qd', 'mass_derivative', 'reaction_derivative', 'force_q', 'force_qd']
    integer, parameter :: single_term(n_singles) = [1, 2, 4, 2, 4, 8, 16, 32, 32, 0, 0, 0, 0, 0, 0, 0, 0, 0, 0]

contains

    !> Name of a part, padded with blanks. Parts of the model are named after its procedures.
    pure function part_name(part) result(name)
        !> Index of the part.
        integer, intent(in) :: part
        character(len=name_length) :: name

        if (part > part_derivatives) then
            name = 'evaluate_derivatives: all'
            if (part - part_derivatives < need_all_derivatives) call add_names(part - part_derivatives, derivative_name, name(22:))
        else if (part > part_terms) then
            name = 'evaluate:'
            call add_names(part - part_terms, term_name, name(10:))
        else if (part > part_single) then
            name = single_name(part - part_single)
        else
            name = own_name(part)
        end if
    end function part_name

    !> Append the names of the bits in a need mask, separated by blanks.
    pure subroutine add_names(mask, names, text)
        integer, intent(in) :: mask
        !> Names in the order of the bits.
        character(len=*), intent(in) :: names(:)
        character(len=*), intent(out) :: text
        integer :: i, last

        text = ''
        do i = 1, size(names)
            if (.not. btest(mask, i - 1)) cycle
            last = len_trim(text)
            text(last + 2:) = names(i)
        end do
    end subroutine add_names

    !> Group of a part.
    pure integer function part_group(part)
        !> Index of the part.
        integer, intent(in) :: part

        select case (part)
        case (part_control)
            part_group = group_control
        case (part_start)
            part_group = group_start
        case (part_watch)
            part_group = group_watch
        case (part_rows:part_open)
            part_group = group_output
        case (part_renew:part_projection)
            part_group = group_chart
        case (part_matrix:part_filter)
            part_group = group_newton
        case default
            part_group = group_model
        end select
    end function part_group

    !> Terms of the model that a call evaluates in a part, a sum of need bits.
    pure integer function terms_of_part(part)
        !> Index of the part.
        integer, intent(in) :: part

        terms_of_part = 0
        if (part > part_terms .and. part <= part_derivatives) terms_of_part = part - part_terms
        if (part > part_single .and. part <= part_terms) terms_of_part = single_term(part - part_single)
    end function terms_of_part
end module tandem_profile_parts
