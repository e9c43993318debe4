! SPDX-License-Identifier: MIT
!> Problems: the shipped scenes up to t = 10, and the motorcycle with a suspension a thousand times as stiff. References are those
!> of test/reference if there is one; otherwise two solutions that have only DOP853 in common and must agree: the index-1 equations
!> and tandem.
module tandem_bench_problems
    use tandem, only: error_type, set_error, to_text, wp
    use tandem_bench_by_tandem, only: new_tandem
    use tandem_bench_index1_motorcycle, only: index1_type => by_hand_type
    use tandem_bench_solver, only: problem_type, solver_type
    use tandem_io, only: find_scene, read_reference, read_scene, reference_type, scene_type
    use tandem_status, only: status_constraints_not_held
    implicit none (type, external)
    private

    public :: problem_names, make_problem

    !> The names of the problems.
    character(len=24), parameter :: problem_names(5) = [character(len=24) :: 'rolling_disk', 'articulated_vehicle', &
        'motorcycle', 'motorcycle_chopper', 'motorcycle_stiff']

contains

    !> Make one of the problems. The current folder must be the root of the checkout.
    subroutine make_problem(name, problem, error)
        character(len=*), intent(in) :: name
        type(problem_type), intent(out) :: problem
        type(error_type), allocatable, intent(out) :: error
        character(len=32), allocatable :: settings(:)
        character(len=:), allocatable :: path, scene_name
        type(scene_type) :: scene

        settings = [character(len=32) :: 'time.end=10']
        scene_name = trim(name)
        if (name == 'motorcycle_stiff') then
            scene_name = 'motorcycle'
            settings = [character(len=32) :: settings, 'model.stiffness=1.5e7', 'model.damping=1.5e6']
            problem%is_stiff = .true.
        end if
        call find_scene(scene_name, path, error)
        if (allocated(error)) return
        call read_scene(path, settings, scene, error)
        if (allocated(error)) return
        problem%name = name
        problem%model = scene%model
        problem%t_start = scene%t_start
        problem%t_end = scene%t_end
        problem%q = scene%q
        problem%qd = scene%qd
        problem%compared = size(scene%q)
        select case (name)
        case ('rolling_disk')
            problem%compared = 3
            call take_reference('test/reference/disk.txt', problem, error)
        case ('articulated_vehicle')
            call take_reference('test/reference/vehicle.txt', problem, error)
        case default
            call make_reference(problem, error)
        end select
    end subroutine make_problem

    !> Read the solution at the end from a file.
    subroutine take_reference(path, problem, error)
        character(len=*), intent(in) :: path
        type(problem_type), intent(inout) :: problem
        type(error_type), allocatable, intent(out) :: error
        type(reference_type) :: reference

        call read_reference(path, problem%t_start, problem%t_end, problem%q, problem%qd, 1, reference, error)
        if (allocated(error)) return
        if (abs(reference%t(size(reference%t)) - problem%t_end) > 0.0_wp) then
            call set_error(error, status_constraints_not_held, path//' does not reach the end')
            return
        end if
        problem%q_end = reference%q(:, size(reference%t))
    end subroutine take_reference

    !> Compute the solution at the end with two solvers.
    subroutine make_reference(problem, error)
        type(problem_type), intent(inout) :: problem
        type(error_type), allocatable, intent(out) :: error
        real(wp), parameter :: tolerance = 1.0e-13_wp, same = 1.0e-9_wp
        type(index1_type) :: index1
        class(solver_type), allocatable :: tandem
        integer :: stat

        allocate (tandem, source=new_tandem('dop853'))
        call solve(tandem, problem, tolerance, stat)
        if (stat == 0) call solve(index1, problem, tolerance, stat)
        if (stat == 0) then
            problem%q_end = index1%q
            problem%agreement = maxval(abs(index1%q - tandem%q))
            if (problem%agreement <= same) return
        end if
        call set_error(error, status_constraints_not_held, 'the two solutions of '//trim(problem%name)//' differ by '// &
            to_text(problem%agreement))
    end subroutine make_reference

    !> Prepare and run.
    subroutine solve(solver, problem, control, stat)
        class(solver_type), intent(inout), target :: solver
        type(problem_type), intent(in) :: problem
        real(wp), intent(in) :: control
        integer, intent(out) :: stat

        call solver%prepare(problem, control, stat)
        if (stat == 0) call solver%run(stat)
    end subroutine solve
end module tandem_bench_problems
