! SPDX-License-Identifier: MIT
!> Overhead of a sweep over a bare loop of the library: runs the disks of a sweep's table, as comma-separated values, one after the
!> other, and compares the heights at the end bit by bit.
!>
!> Usage: disks TABLE.csv    columns case, model.mass, initial.omega[2], initial.tilt, rz_end; runs of 1 s in steps of 1 ms
program disks
    use tandem, only: error_type, options_type, rolling_disk_type, simulation_type, wp
    use, intrinsic :: iso_fortran_env, only: int64
    implicit none (type, external)
    integer, parameter :: most = 1000000
    real(wp), allocatable :: columns(:, :)
    character(len=4096) :: path, line
    integer(int64) :: from, to, rate
    integer :: unit, stat, n, i, same
    real(wp) :: height, case

    call get_command_argument(1, path)
    open (newunit=unit, file=trim(path), status='old', action='read', iostat=stat)
    if (stat /= 0) error stop 'disks: cannot read the table'
    allocate (columns(4, most))
    read (unit, '(a)', iostat=stat) line
    n = 0
    do while (stat == 0 .and. n < most)
        read (unit, *, iostat=stat) case, columns(:, n + 1)
        if (stat == 0) n = n + 1
    end do
    close (unit)
    same = 0
    call system_clock(from, rate)
    do i = 1, n
        call run(columns(1, i), columns(2, i), columns(3, i), height)
        if (height >= columns(4, i) .and. height <= columns(4, i)) same = same + 1
    end do
    call system_clock(to)
    print '(i0, a, f0.3, a, f0.1, a, i0, a)', n, ' disks in ', real(to - from, wp)/rate, ' s, ', n*real(rate, wp)/(to - from), &
        ' a second, ', same, ' with the height of the table'
contains
    !> Run a disk with its own model, options and start.
    subroutine run(mass, omega, tilt, height)
        real(wp), intent(in) :: mass, omega, tilt
        real(wp), intent(out) :: height
        type(rolling_disk_type), target :: disk
        type(simulation_type) :: simulation
        type(error_type), allocatable :: error
        real(wp) :: q(9), qd(9)

        disk%mass = mass
        disk%inertia = [5.0_wp, 2.5001_wp, 2.5001_wp]
        disk%radius = 1.0_wp
        disk%gravity = 9.6_wp
        call disk%define()
        call disk%start([-1.0_wp, omega, 0.0_wp], tilt, q, qd)
        call simulation%initialize(disk, options_type(step=1.0e-3_wp), 0.0_wp, q, qd, error)
        if (.not. allocated(error)) call simulation%integrate(1.0_wp, error)
        if (allocated(error)) error stop error%message
        height = simulation%state%q(3)
    end subroutine run
end program disks
