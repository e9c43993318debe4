! SPDX-License-Identifier: MIT
!> bench [FOLDER [ROUNDS [PROBLEM...]]]: measures tandem and other solvers and writes tables to a folder. `make bench` calls it in
!> the root of the checkout.
program bench
    use, intrinsic :: iso_fortran_env, only: error_unit, output_unit
    use tandem, only: error_type
    use tandem_bench_measure, only: measure_series, series_type
    use tandem_bench_problems, only: make_problem, problem_names
    use tandem_bench_report, only: report_type
    use tandem_bench_solver, only: problem_type, solver_holder_type
    use tandem_bench_solvers, only: make_solvers
    implicit none (type, external)
    type(report_type) :: report
    type(error_type), allocatable :: error
    character(len=256) :: folder, argument
    character(len=:), allocatable :: text
    character(len=24), allocatable :: names(:)
    integer :: i, rounds, stat

    folder = 'build/bench'
    rounds = 7
    if (command_argument_count() >= 1) call get_command_argument(1, folder)
    if (command_argument_count() >= 2) then
        call get_command_argument(2, argument)
        read (argument, *, iostat=stat) rounds
        if (stat /= 0 .or. rounds < 1) error stop 2
    end if
    names = problem_names
    if (command_argument_count() >= 3) then
        deallocate (names)
        allocate (names(command_argument_count() - 2))
        do i = 1, size(names)
            call get_command_argument(2 + i, names(i))
        end do
    end if
    call report%start(trim(folder), rounds, error)
    do i = 1, size(names)
        if (.not. allocated(error)) call measure(names(i))
    end do
    if (.not. allocated(error)) call report%finish(text, error)
    if (allocated(error)) then
        write (error_unit, '(2a)') 'bench: ', error%message
        error stop 1
    end if
    write (output_unit, '(a)') text

contains

    !> Measure all solvers of a problem.
    subroutine measure(name)
        character(len=*), intent(in) :: name
        type(problem_type) :: problem
        type(solver_holder_type), allocatable :: solvers(:)
        type(series_type), allocatable :: series(:)

        write (error_unit, '(a)') trim(name)
        call make_problem(name, problem, error)
        if (allocated(error)) return
        call make_solvers(problem, solvers)
        call measure_series(problem, solvers, rounds, series)
        call report%add(problem, solvers, series, error)
    end subroutine measure
end program bench
