! SPDX-License-Identifier: MIT
!> Observer that shows the progress of a run on stderr: a line that is overwritten on a terminal, otherwise one line per 10 %.
module tandem_cli_progress
    use, intrinsic :: iso_fortran_env, only: error_unit
    use tandem, only: at_end, at_start, error_type, long, observer_type, simulation_type, to_text, wp
    use tandem_cli_terminal, only: stderr_is_terminal
    implicit none (type, external)
    private

    public :: progress_type

    !> Number of steps between readings of the clock; largest number of updates per second on a terminal.
    integer, parameter :: steps_unwatched = 64, lines_a_second = 5
    !> Width of the line on a terminal.
    integer, parameter :: width = 78

    type, extends(observer_type) :: progress_type
        !> Start and end of the run.
        real(wp) :: t_start = 0.0_wp, t_end = 1.0_wp
        logical, private :: on_terminal = .false.
        integer, private :: unwatched = 0, tenths = 0
        integer(long), private :: started = 0, shown = 0
    contains
        procedure :: observe
        procedure, private :: show
    end type progress_type

contains

    !> Update the line if enough time has passed.
    subroutine observe(self, simulation, occasion, error)
        class(progress_type), intent(inout) :: self
        class(simulation_type), intent(inout) :: simulation
        !> `at_start`, `at_step`, `at_event` or `at_end`.
        integer, intent(in) :: occasion
        type(error_type), allocatable, intent(out) :: error
        integer(long) :: now, rate

        if (occasion == at_start) then
            self%on_terminal = stderr_is_terminal()
            call system_clock(self%started)
            self%shown = self%started
            return
        end if
        self%unwatched = self%unwatched + 1
        if (self%unwatched < steps_unwatched .and. occasion /= at_end) return
        self%unwatched = 0
        if (self%on_terminal) then
            call system_clock(now, rate)
            if (occasion == at_end) then
                ! Remove the line before the report is printed.
                write (error_unit, '(a)', advance='no') achar(13)//repeat(' ', width)//achar(13)
                flush (error_unit)
            else if ((now - self%shown)*lines_a_second >= rate) then
                self%shown = now
                call self%show(simulation)
            end if
        else
            call self%show(simulation)
        end if
    end subroutine observe

    !> Write the line if it has changed.
    subroutine show(self, simulation)
        class(progress_type), intent(inout) :: self
        class(simulation_type), intent(in) :: simulation
        character(len=:), allocatable :: line
        real(wp) :: share, seconds
        integer(long) :: now, rate

        share = (simulation%state%t - self%t_start)/(self%t_end - self%t_start)
        if (.not. self%on_terminal .and. .not. share*10 >= self%tenths + 1) return
        self%tenths = int(share*10)
        call system_clock(now, rate)
        seconds = real(now - self%started, wp)/real(rate, wp)
        line = to_text(int(100*share))//' %, t = '//short(simulation%state%t)//' of '//short(self%t_end)//' s, '// &
            short(seconds)//' s elapsed'
        if (share > 0.0_wp) line = line//', '//short(seconds*(1.0_wp - share)/share)//' s left'
        if (self%on_terminal) then
            line = line(:min(len(line), width))
            write (error_unit, '(a)', advance='no') achar(13)//line//repeat(' ', width - len(line))
            flush (error_unit)
        else
            write (error_unit, '(a)') line
        end if
    end subroutine show

    !> A number with about four digits.
    pure function short(value) result(text)
        real(wp), intent(in) :: value
        character(len=:), allocatable :: text
        character(len=16) :: buffer

        write (buffer, '(g0.4)') value
        if (abs(value) < 1.0e5_wp .and. abs(value) >= 1.0e-3_wp) write (buffer, '(f0.3)') value
        text = trim(adjustl(buffer))
        if (text(1:1) == '.') text = '0'//text
    end function short
end module tandem_cli_progress
