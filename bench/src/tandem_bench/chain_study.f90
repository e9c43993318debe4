! SPDX-License-Identifier: MIT
!> The chain of N rods: checks of the model, and the time of a step against N.
module tandem_bench_chain_study
    use tandem, only: error_type, finding_type, new_stepper, options_type, properties_type, set_error, simulation_type, &
        statistics_type, to_text, verify_model, wp
    use tandem_bench_chain, only: chain_type
    use tandem_bench_clock, only: cpu_seconds
    use tandem_io, only: column_type, journal_type
    use tandem_io_study_measure, only: median
    use tandem_io_study_table, only: cell_length, count_column, real_column, text_column
    use tandem_status, only: status_constraints_not_held
    use tandem_stepper, only: stepper_type
    implicit none (type, external)
    private

    public :: study_chain

    character(len=*), parameter :: newline = new_line('a')
    !> Steppers, numbers of rods, step size and angle at the start.
    character(len=8), parameter :: steppers(3) = [character(len=8) :: 'rk4', 'dop853', 'sdirk54']
    integer, parameter :: sizes(7) = [1, 2, 4, 8, 16, 32, 64]
    real(wp), parameter :: step = 1.0e-3_wp, angle = 1.0_wp
    !> Largest number and duration of the steps of a run; number of timed rounds, in each of which all runs take turns.
    integer, parameter :: most_steps = 200, rounds = 7
    real(wp), parameter :: most_seconds = 1.0_wp

    type(column_type), parameter :: columns(8) = [ &
        column_type('stepper', 'stepper', text_column, '', 'name of the stepper'), &
        column_type('rods', 'N', count_column, '1', 'number of rods'), &
        column_type('coordinates', 'n', count_column, '1', 'coordinates'), &
        column_type('constraints', 'm', count_column, '1', 'constraints'), &
        column_type('step_seconds', 's/step', real_column, 's', 'time of a step, median'), &
        column_type('evaluation_seconds', 's/rhs', real_column, 's', 'time of an evaluation of the equations of motion'), &
        column_type('slope', 'slope', real_column, '1', 'log of the ratio to the step with half as many rods, over log 2'), &
        column_type('energy_change', 'energy', real_column, '1', 'change of the energy, of the fall of the potential one')]

contains

    !> Check the chain, then measure it; the table is written to a folder, its text to the terminal.
    subroutine study_chain(folder, text, error)
        character(len=*), intent(in) :: folder
        character(len=:), allocatable, intent(out) :: text
        type(error_type), allocatable, intent(out) :: error
        type(journal_type) :: journal
        character(len=cell_length) :: cells(size(columns))
        real(wp) :: seconds(0:rounds, size(sizes), size(steppers)), of_step, before
        real(wp), dimension(size(sizes), size(steppers)) :: evaluations, change
        integer :: i, j, round, steps(size(sizes), size(steppers))

        call check_single(error)
        if (.not. allocated(error)) call check_double(error)
        if (.not. allocated(error)) call journal%open(folder, 'chain', columns, &
            '[chain]'//newline//'step = '//to_text(step)//newline, .true., error)
        if (allocated(error)) return
        steps = most_steps
        do round = 0, rounds
            do i = 1, size(steppers)
                do j = 1, size(sizes)
                    call measure(trim(steppers(i)), sizes(j), steps(j, i), seconds(round, j, i), evaluations(j, i), change(j, i), &
                        error)
                    if (allocated(error)) return
                    ! The first round only determines the number of steps.
                    if (round == 0) steps(j, i) = max(5, min(most_steps, int(most_seconds/seconds(round, j, i))))
                end do
            end do
        end do
        do i = 1, size(steppers)
            do j = 1, size(sizes)
                of_step = median(seconds(1:, j, i))
                associate (table => journal%table)
                    cells = table%new_row()
                    call table%put(cells, 'stepper', trim(steppers(i)))
                    call table%put(cells, 'rods', int(sizes(j), kind=8))
                    call table%put(cells, 'coordinates', int(3*sizes(j), kind=8))
                    call table%put(cells, 'constraints', int(2*sizes(j), kind=8))
                    call table%put(cells, 'step_seconds', of_step)
                    call table%put(cells, 'evaluation_seconds', of_step/evaluations(j, i))
                    if (j > 1) call table%put(cells, 'slope', log(of_step/before)/log(2.0_wp))
                    call table%put(cells, 'energy_change', change(j, i))
                end associate
                before = of_step
                call journal%append(cells, error)
                if (allocated(error)) return
            end do
        end do
        call journal%close()
        call journal%write_hdf5('chain', 'time of a step of a chain of rods', [character(len=1) ::], [real(wp) ::], error)
        text = journal%table%header()//newline
        do i = 1, journal%table%rows()
            text = text//journal%table%line(i)//newline
        end do
        text = text//'files: '//journal%path//'.csv, .h5'
    end subroutine study_chain

    !> Run a chain; `angles` are those of its rods at the end.
    subroutine run(rods, options, t_end, simulation, model, error)
        integer, intent(in) :: rods
        type(options_type), intent(in) :: options
        real(wp), intent(in) :: t_end
        type(simulation_type), intent(inout) :: simulation
        type(chain_type), intent(inout), target :: model
        type(error_type), allocatable, intent(out) :: error
        real(wp) :: q(3*rods), qd(3*rods)

        model%rods = rods
        call model%define()
        call model%start(angle, q, qd)
        call simulation%initialize(model, options, 0.0_wp, q, qd, error)
        if (.not. allocated(error)) call simulation%integrate(t_end, error)
    end subroutine run

    !> One rod swings to the other side in half a period, 2 sqrt(2 l / (3 g)) K(sin(angle / 2)).
    subroutine check_single(error)
        type(error_type), allocatable, intent(out) :: error
        real(wp), parameter :: pi = 4.0_wp*atan(1.0_wp)
        type(options_type) :: options
        type(simulation_type) :: simulation
        type(chain_type), target :: model
        real(wp) :: a, b, mean

        a = 1.0_wp
        b = cos(0.5_wp*angle)
        do while (abs(a - b) > 4*epsilon(1.0_wp))
            mean = 0.5_wp*(a + b)
            b = sqrt(a*b)
            a = mean
        end do
        options%stepper = 'dop853'
        options%rtol = 1.0e-12_wp
        call run(1, options, 2*sqrt(2*model%length/(3*model%gravity))*pi/(2*a), simulation, model, error)
        if (allocated(error)) return
        if (abs(simulation%state%q(3) + angle) > 1.0e-9_wp) call set_error(error, status_constraints_not_held, &
            'the chain of one rod is off by '//to_text(abs(simulation%state%q(3) + angle)))
    end subroutine check_single

    !> Two rods move as the double pendulum in minimal coordinates, and every procedure agrees with differences.
    subroutine check_double(error)
        type(error_type), allocatable, intent(out) :: error
        real(wp), parameter :: t_end = 2.0_wp
        integer, parameter :: steps = 20000
        type(options_type) :: options
        type(simulation_type) :: simulation
        type(chain_type), target :: model
        type(finding_type), allocatable :: findings(:)
        real(wp) :: y(4), k(4, 4), h
        integer :: i

        y = [angle, angle, 0.0_wp, 0.0_wp]
        h = t_end/steps
        do i = 1, steps
            k(:, 1) = double_pendulum(model, y)
            k(:, 2) = double_pendulum(model, y + 0.5_wp*h*k(:, 1))
            k(:, 3) = double_pendulum(model, y + 0.5_wp*h*k(:, 2))
            k(:, 4) = double_pendulum(model, y + h*k(:, 3))
            y = y + h/6*(k(:, 1) + 2*k(:, 2) + 2*k(:, 3) + k(:, 4))
        end do
        options%stepper = 'dop853'
        options%rtol = 1.0e-12_wp
        call run(2, options, t_end, simulation, model, error)
        if (allocated(error)) return
        if (maxval(abs(simulation%state%q([3, 6]) - y(:2))) > 1.0e-9_wp) then
            call set_error(error, status_constraints_not_held, 'the chain of two rods is off by '// &
                to_text(maxval(abs(simulation%state%q([3, 6]) - y(:2)))))
            return
        end if
        call verify_model(model, 0.0_wp, simulation%state%q, simulation%state%qd, 3, findings, error)
        if (allocated(error)) return
        do i = 1, size(findings)
            if (.not. findings(i)%passed) call set_error(error, status_constraints_not_held, 'the chain: '//trim(findings(i)%name))
        end do
    end subroutine check_double

    !> The rates of (phi1, phi2, phi1d, phi2d) of two equal rods.
    pure function double_pendulum(model, y) result(f)
        type(chain_type), intent(in) :: model
        real(wp), intent(in) :: y(4)
        real(wp) :: f(4), m12, r1, r2, determinant

        m12 = 0.5_wp*cos(y(1) - y(2))
        r1 = -0.5_wp*sin(y(1) - y(2))*y(4)**2 - 1.5_wp*model%gravity/model%length*sin(y(1))
        r2 = 0.5_wp*sin(y(1) - y(2))*y(3)**2 - 0.5_wp*model%gravity/model%length*sin(y(2))
        determinant = 4.0_wp/9 - m12**2
        f = [y(3), y(4), (r1/3 - m12*r2)/determinant, (4*r2/3 - m12*r1)/determinant]
    end function double_pendulum

    !> Run a number of steps.
    subroutine measure(stepper, rods, steps, seconds, evaluations, change, error)
        character(len=*), intent(in) :: stepper
        integer, intent(in) :: rods, steps
        !> Time of a step, number of evaluations per step, and change of the energy.
        real(wp), intent(out) :: seconds, evaluations, change
        type(error_type), allocatable, intent(out) :: error
        type(options_type) :: options
        type(simulation_type) :: simulation
        type(statistics_type) :: statistics
        type(chain_type), target :: model
        real(wp) :: begun, q(3*rods), qd(3*rods), kinetic, potential, fallen
        integer :: stat

        options%stepper = stepper
        options%step = step
        model%rods = rods
        call model%define()
        call model%start(angle, q, qd)
        call simulation%initialize(model, options, 0.0_wp, q, qd, error)
        if (allocated(error)) return
        begun = cpu_seconds()
        call simulation%integrate(steps*step, error)
        if (allocated(error)) return
        seconds = (cpu_seconds() - begun)/steps
        statistics = simulation%statistics()
        evaluations = real(statistics%right_hand_sides, wp)/real(statistics%steps, wp)
        call model%potential_energy(0.0_wp, q, fallen, stat)
        call simulation%kinetic_energy(kinetic, stat)
        call simulation%potential_energy(potential, stat)
        change = abs(kinetic + potential - fallen)/abs(fallen - potential)
    end subroutine measure
end module tandem_bench_chain_study
