! SPDX-License-Identifier: MIT
!> Reads the table [solver]. What values may be is `options_type`'s to say; here its word gets the line of the file.
module tandem_io_scene_solver
    use tandem, only: basis_methods, chart_policies, error_type, options_type, projections, refresh_modes, stepper_names
    use tandem_io_scene_reader, only: reader_type
    implicit none (type, external)
    private

    public :: read_solver

contains

    !> The options of a run.
    subroutine read_solver(reader, n, options)
        class(reader_type), intent(inout) :: reader
        !> Number of coordinates.
        integer, intent(in) :: n
        !> The defaults before, the options after.
        type(options_type), intent(inout) :: options
        character(len=*), parameter :: unset = '0 for constraint_tolerance'

        call reader%open_table('solver')
        call reader%get('stepper', options%stepper, stepper_names)
        call reader%get('step', options%step, unit='s', help='of fixed steps')
        call verify('step')
        call reader%get_for_each('rtol', n, options%rtol_q, options%rtol, &
            help='for all or one a coordinate; above 0, steps follow an error estimate')
        call verify('rtol')
        call reader%get_for_each('atol', n, options%atol_q, options%atol, &
            help='for all or one a coordinate, in units of the coordinate scales; 0 for rtol')
        call verify('atol')
        call reader%get_for_each('rtol_qd', n, options%rtol_qd, help='of the velocities, where it is not rtol')
        call verify('rtol_qd')
        call reader%get_for_each('atol_qd', n, options%atol_qd, help='of the velocities, where it is not atol')
        call verify('atol_qd')
        call reader%get('first_step', options%first_step, unit='s', help='with rtol; 0: tandem chooses')
        call verify('first_step')
        call reader%get('max_step', options%max_step, unit='s', help='with rtol; 0 for none')
        call verify('max_step')
        call reader%get('chart', options%chart, chart_policies, 'when it is renewed')
        call reader%get('refresh', options%refresh, refresh_modes, 'how the inverses follow the motion')
        call reader%get('basis', options%basis, basis_methods, 'where the bases of a chart come from')
        call reader%get('projection', options%projection, projections, 'where explicit steps meet the constraints')
        call reader%get('constraint_tolerance', options%constraint_tolerance, help="of each row's natural scale")
        call verify('constraint_tolerance')
        call reader%get('utol', options%utol, help='of the position iteration; 0 for constraint_tolerance/100')
        call verify('utol')
        call reader%get('Btol', options%btol, help='of the iteration for B, with refine; '//unset)
        call verify('Btol')
        call reader%get('Htol', options%htol, help='of the iteration for H, with refine; '//unset)
        call verify('Htol')
        call reader%get('intol', options%intol, help='of the iteration of implicit stages; 0 for constraint_tolerance/100')
        call verify('intol')
        call reader%get('v_limit', options%v_limit, help='of |v| in a chart, with paper; 0 for none, and 70 degrees without any')
        call verify('v_limit')
        call reader%get('w_limit', options%w_limit, help='of |w| in a chart, with paper; 0 for none')
        call verify('w_limit')
        call reader%get('condition_limit', options%condition_limit, help='of the condition number of (38), with paper; 0 for none')
        call verify('condition_limit')
        call reader%get('iteration_limit', options%iteration_limit, help='of corrections of u, B, H, with paper; 0 for none')
        call verify('iteration_limit')
        call reader%get('secant_limit', options%secant_limit, help='of |D| and |Fbar| in a chart, with adaptive')
        call verify('secant_limit')
        call reader%get('start_tolerance', options%start_tolerance, help='largest constraint error of the start')
        call verify('start_tolerance')
        call reader%get('max_steps', options%max_steps, help='of the run')
        call verify('max_steps')
        call reader%get('max_evaluations', options%max_evaluations, help='of the right-hand side; 0 for no limit')
        call verify('max_evaluations')
        call reader%get('max_seconds', options%max_seconds, unit='s', help='of wall time; 0 for no limit')
        call verify('max_seconds')
        call reader%get('max_events', options%max_events, help='of the run')
        call verify('max_events')
        call reader%close_table()
    contains
        !> The options were right before this key was read: what is wrong now is its fault.
        subroutine verify(key)
            character(len=*), intent(in) :: key
            type(error_type), allocatable :: error

            if (reader%failed()) return
            call options%check(error)
            if (allocated(error)) call reader%refuse(key, problem_of(error%message))
        end subroutine verify
    end subroutine read_solver

    !> What is wrong, without the option's name and value, which the line shows, and without the advice.
    pure function problem_of(message) result(problem)
        !> `status: name = value must ...; advice`.
        character(len=*), intent(in) :: message
        character(len=:), allocatable :: problem
        integer :: first, last

        first = max(1, index(message, ' must ') + 1)
        last = index(message, ';') - 1
        if (last < first) last = len(message)
        problem = message(first:last)
    end function problem_of
end module tandem_io_scene_solver
