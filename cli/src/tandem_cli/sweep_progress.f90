! SPDX-License-Identifier: MIT
!> Progress of a sweep on stderr: finished and failed cases, cases per second, remaining time, and load. On a terminal this is a
!> line that is overwritten, otherwise one line per 10 %.
module tandem_cli_sweep_progress
    use tandem, only: long, to_text, wp
    use tandem_cli_interruption, only: caught_signal
    use tandem_cli_study_progress, only: study_progress_type
    use tandem_cli_terminal, only: stderr_is_terminal
    use tandem_io, only: sweep_journal_type, watcher_type
    implicit none (type, external)
    private

    public :: sweep_progress_type

    !> Largest number of updates per second on a terminal.
    integer, parameter :: lines_a_second = 5

    type, extends(watcher_type) :: sweep_progress_type
        !> True to suppress all output.
        logical :: quiet = .false.
        type(study_progress_type), private :: progress
        integer(long), private :: started = -1, shown = -1
        integer, private :: tenths = 0
    contains
        procedure :: begin, tell, stops, remark, clear
    end type sweep_progress_type

contains

    !> Start the clock before the first case.
    subroutine begin(self)
        class(sweep_progress_type), intent(inout) :: self

        call system_clock(self%started)
    end subroutine begin

    !> Update the number of finished cases.
    subroutine tell(self, journal, workers, busy)
        class(sweep_progress_type), intent(inout) :: self
        type(sweep_journal_type), intent(in) :: journal
        integer, intent(in) :: workers
        real(wp), intent(in) :: busy
        character(len=:), allocatable :: line
        integer(long) :: now, rate, total
        integer :: tenths
        real(wp) :: seconds, speed

        if (self%quiet) return
        call system_clock(now, rate)
        total = journal%last - journal%first + 1
        tenths = int(10*journal%done/total)
        if (stderr_is_terminal()) then
            if (self%shown >= 0 .and. (now - self%shown)*lines_a_second < rate) return
        else if (tenths <= self%tenths) then
            return
        end if
        self%shown = now
        self%tenths = tenths
        seconds = max(real(now - self%started, wp)/real(rate, wp), 1.0e-6_wp)
        speed = real(journal%done - journal%resumed, wp)/seconds
        line = to_text(int(journal%done))//' of '//to_text(int(total))//' cases, '//to_text(int(journal%failed))//' failed, '// &
            short(speed)//' a second, '
        if (speed > 0.0_wp .and. journal%done < total) line = line//short(real(total - journal%done, wp)/speed)//' s left, '
        line = line//'load '//short(min(busy/seconds, real(workers, wp)))//' of '//to_text(workers)
        if (stderr_is_terminal()) then
            call self%progress%show(line)
        else
            call self%progress%remark(line)
        end if
    end subroutine tell

    !> True after a signal.
    logical function stops(self)
        class(sweep_progress_type), intent(inout) :: self

        stops = caught_signal() /= 0
    end function stops

    !> Write a permanent line.
    subroutine remark(self, text)
        class(sweep_progress_type), intent(in) :: self
        character(len=*), intent(in) :: text

        if (.not. self%quiet) call self%progress%remark(text)
    end subroutine remark

    !> Remove the temporary line.
    subroutine clear(self)
        class(sweep_progress_type), intent(in) :: self

        if (.not. self%quiet) call self%progress%clear()
    end subroutine clear

    !> A number with three or four digits.
    pure function short(value) result(text)
        real(wp), intent(in) :: value
        character(len=:), allocatable :: text
        character(len=16) :: buffer

        if (value >= 100.0_wp .and. value < 1.0e9_wp) then
            write (buffer, '(i0)') nint(value)
        else if (value < 100.0_wp .and. value >= 0.01_wp) then
            write (buffer, '(f0.2)') value
        else
            write (buffer, '(es9.2)') value
        end if
        text = trim(adjustl(buffer))
        if (text(1:1) == '.') text = '0'//text
    end function short
end module tandem_cli_sweep_progress
