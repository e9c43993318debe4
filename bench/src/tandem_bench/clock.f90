! SPDX-License-Identifier: MIT
!> Processor time in nanoseconds, which is least disturbed by other processes, and wall time.
module tandem_bench_clock
    use tandem, only: wp
    use, intrinsic :: iso_c_binding, only: c_int, c_long
    implicit none (type, external)
    private

    public :: cpu_seconds, wall_seconds

    !> CLOCK_MONOTONIC and CLOCK_PROCESS_CPUTIME_ID of Linux.
    integer(c_int), parameter :: of_wall = 1, of_process = 2

    !> C's timespec.
    type, bind(c) :: timespec_type
        integer(c_long) :: seconds = 0, nanoseconds = 0
    end type timespec_type

    interface
        !> Read a clock; 0 on success.
        function clock_gettime(clock, time) result(stat) bind(c, name='clock_gettime')
            import :: c_int, timespec_type
            implicit none (type, external)
            integer(c_int), value :: clock
            type(timespec_type), intent(out) :: time
            integer(c_int) :: stat
        end function clock_gettime
    end interface

contains

    !> Processor time of this process in seconds; use differences.
    real(wp) function cpu_seconds()
        cpu_seconds = seconds_of(of_process)
    end function cpu_seconds

    !> Wall time in seconds; use differences.
    real(wp) function wall_seconds()
        wall_seconds = seconds_of(of_wall)
    end function wall_seconds

    !> Time of one of the clocks in seconds.
    real(wp) function seconds_of(clock)
        integer(c_int), intent(in) :: clock
        type(timespec_type) :: time

        seconds_of = 0.0_wp
        if (clock_gettime(clock, time) /= 0) return
        seconds_of = real(time%seconds, wp) + 1.0e-9_wp*real(time%nanoseconds, wp)
    end function seconds_of
end module tandem_bench_clock
