! SPDX-License-Identifier: MIT
!> large [SCENE [STEPPER [KIND [NUMBER...]]]]: cost of a step of large mechanisms, with steps of 1 ms. One line each: bodies,
!> microseconds per body and step, largest constraint error of the steps, kB per body. KIND is a kind of chart.
!> For all scenes, the sprung ones take sdirk54 and the others rk4.
program large
    use, intrinsic :: iso_fortran_env, only: output_unit
    use tandem, only: error_type, mechanism_type, options_type, simulation_type, statistics_type, wp
    use large_mechanisms, only: large_names, make_large
    implicit none (type, external)
    character(len=16) :: scene, stepper, kind, word
    integer, parameter :: usual(6) = [10, 30, 100, 1000, 3000, 10000]
    integer, allocatable :: numbers(:)
    integer :: i, j, n

    scene = argument(1, 'all')
    stepper = argument(2, 'usual')
    kind = argument(3, 'sparse')
    numbers = usual
    if (command_argument_count() > 3) then
        numbers = [integer ::]
        do i = 4, command_argument_count()
            word = argument(i, '')
            read (word, *) n
            numbers = [numbers, n]
        end do
    end if
    write (output_unit, '(a)') 'scene          bodies  us a body and step   largest error   kB a body'
    do i = 1, size(large_names)
        if (scene /= 'all' .and. scene /= large_names(i)) cycle
        do j = 1, size(numbers)
            call measure(trim(large_names(i)), numbers(j))
        end do
    end do

contains

    !> An argument, or its default.
    function argument(number, default)
        integer, intent(in) :: number
        character(len=*), intent(in) :: default
        character(len=16) :: argument

        argument = default
        if (command_argument_count() >= number) call get_command_argument(number, argument)
    end function argument

    !> Measure a scene: the best of three rounds, each with the number of steps that takes a third of a second.
    subroutine measure(name, n)
        character(len=*), intent(in) :: name
        integer, intent(in) :: n
        type(mechanism_type), target :: mechanism
        type(simulation_type) :: simulation
        type(statistics_type) :: statistics
        type(options_type) :: options
        type(error_type), allocatable :: error
        real(wp), allocatable :: q(:), qd(:)
        real(wp) :: seconds, best, memory
        integer :: k, round, steps
        !> Four-bars of A02 lie flat at t = 0.72 s: each round is restarted before that.
        integer, parameter :: most_steps = 600

        memory = memory_in_kb()
        call make_large(name, n, mechanism, error)
        if (.not. allocated(error)) then
            allocate (q(mechanism%n), qd(mechanism%n))
            call mechanism%start(q, qd)
            options%stepper = stepper
            if (stepper == 'usual') options%stepper = merge('sdirk54', 'rk4    ', index(name, 'sprung') == 1)
            options%step = 1.0e-3_wp
            options%chart_kind = kind(:len(options%chart_kind))
            call simulation%initialize(mechanism, options, 0.0_wp, q, qd, error)
            if (name /= 'four_bars') deallocate (q, qd)
        end if
        if (allocated(error)) then
            write (output_unit, '(a14, i7, 2x, a)') name, n, error%message
            return
        end if
        best = huge(1.0_wp)
        steps = 10
        do round = 1, 4
            if (name == 'four_bars') then
                steps = min(steps, most_steps)
                call simulation%initialize(mechanism, options, 0.0_wp, q, qd, error)
            end if
            seconds = now()
            do k = 1, steps
                call simulation%step(huge(1.0_wp), error)
                if (allocated(error)) then
                    write (output_unit, '(a14, i7, 2x, a)') name, n, error%message
                    return
                end if
            end do
            seconds = now() - seconds
            if (round > 1) best = min(best, seconds/steps)
            if (round == 1) steps = max(10, min(1000, int(0.33_wp*steps/seconds)))
        end do
        statistics = simulation%statistics()
        n_bodies: associate (bodies => size(mechanism%bodies))
            write (output_unit, '(a14, i7, f14.3, 7x, es10.1, f14.2)') name, bodies, 1.0e6_wp*best/bodies, &
                max(statistics%position_error, statistics%velocity_error, statistics%acceleration_error), &
                (memory_in_kb() - memory)/bodies
        end associate n_bodies
        flush (output_unit)
    end subroutine measure

    !> Processor time, which is less disturbed by other processes than wall time.
    real(wp) function now()
        call cpu_time(now)
    end function now

    !> Memory of the process (Linux), else 0.
    real(wp) function memory_in_kb()
        character(len=80) :: line
        integer :: unit, stat

        memory_in_kb = 0.0_wp
        open (newunit=unit, file='/proc/self/status', status='old', action='read', iostat=stat)
        if (stat /= 0) return
        do
            read (unit, '(a)', iostat=stat) line
            if (stat /= 0) exit
            if (line(:6) == 'VmRSS:') read (line(7:), *) memory_in_kb
        end do
        close (unit)
    end function memory_in_kb
end program large
