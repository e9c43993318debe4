! SPDX-License-Identifier: MIT
!> Runs the cases of a sweep one after the other. The file of the scene is read only once. For each case the values of the inputs
!> are changed, and the model, the start and the options are built again. Hence all checks of a scene apply to each case, and no
!> case depends on earlier ones.
module tandem_io_sweep_case
    use tandem, only: error_type, global_error_type, long, simulation_type, wp
    use tandem_io_output_observers, only: observer_list_type
    use tandem_io_output_trajectory, only: trajectory_type
    use tandem_io_scene, only: interpret_scene, scene_type
    use tandem_io_scene_description, only: description_type
    use tandem_io_scene_registry, only: scene_model_type
    use tandem_io_sweep_disk, only: sync_file, sync_folder_of
    use tandem_io_sweep_plan, only: plan_type
    use tandem_io_sweep_record, only: message_length, record_type
    use tandem_io_sweep_recorder, only: recorder_type
    use, intrinsic :: ieee_arithmetic, only: ieee_quiet_nan, ieee_value
    implicit none (type, external)
    private

    public :: case_runner_type

    type :: case_runner_type
        !> Sweep, owned by the caller.
        type(plan_type), pointer :: plan => null()
        type(scene_model_type), allocatable, private :: models(:)
        !> Keys of the scene with the values of the last case.
        type(description_type), private :: keys
        type(recorder_type), private :: recorder
        real(wp), allocatable, private :: numbers(:)
        !> Inputs of the last case; only changed inputs are passed to the keys.
        real(wp), allocatable, private :: last(:)
    contains
        procedure :: prepare, run
    end type case_runner_type

contains

    !> Copy the keys of the scene.
    subroutine prepare(self, plan, models)
        class(case_runner_type), intent(inout) :: self
        !> The sweep; must outlive the runner.
        type(plan_type), intent(in), target :: plan
        type(scene_model_type), intent(in) :: models(:)

        self%plan => plan
        allocate (self%models, source=models)
        allocate (self%numbers(size(plan%inputs)))
        allocate (self%last(size(plan%inputs)), source=ieee_value(1.0_wp, ieee_quiet_nan))
        self%keys = plan%scene_keys
        call self%recorder%initialize(plan%kept)
    end subroutine prepare

    !> Run a case.
    subroutine run(self, case, record)
        class(case_runner_type), intent(inout) :: self
        !> Number of the case, from 1.
        integer(long), intent(in) :: case
        !> Result of the case.
        type(record_type), intent(inout) :: record
        type(scene_type), target :: scene
        type(error_type), allocatable :: error
        character(len=:), allocatable :: remark
        integer(long) :: from, to, rate

        call system_clock(from)
        self%recorder%values = ieee_value(1.0_wp, ieee_quiet_nan)
        call self%plan%numbers_of(case, self%numbers)
        call read_case(self, scene, error)
        if (.not. allocated(error)) call integrate(self, case, scene, remark, error)
        call system_clock(to, rate)
        record%case = case
        record%seconds = real(to - from, wp)/real(rate, wp)
        record%status = 0
        record%message = ''
        if (allocated(remark)) record%message = on_one_line(remark)
        record%values = self%recorder%values
        if (.not. allocated(error)) return
        record%status = error%stat
        record%message = on_one_line(error%message)
        record%values = ieee_value(1.0_wp, ieee_quiet_nan)
    end subroutine run

    !> Build the scene of a case.
    subroutine read_case(self, scene, error)
        type(case_runner_type), intent(inout) :: self
        type(scene_type), intent(inout) :: scene
        type(error_type), allocatable, intent(out) :: error
        integer :: i

        associate (plan => self%plan)
            do i = 1, size(self%numbers)
                if (self%numbers(i) >= self%last(i) .and. self%numbers(i) <= self%last(i)) cycle
                call self%keys%change(plan%n_settings + plan%inputs(i)%setting, plan%inputs(i)%element, &
                    plan%atom_of(i, self%numbers(i)))
            end do
            self%last = self%numbers
            ! A trajectory file contains the complete text of the scene.
            call interpret_scene(self%keys, self%models, scene, error, is_brief=plan%folder == '')
            if (plan%max_seconds > 0.0_wp) then
                if (.not. scene%options%max_seconds > 0.0_wp .or. scene%options%max_seconds > plan%max_seconds) then
                    scene%options%max_seconds = plan%max_seconds
                end if
            end if
        end associate
    end subroutine read_case

    !> Integrate a case.
    subroutine integrate(self, case, scene, remark, error)
        type(case_runner_type), intent(inout), target :: self
        integer(long), intent(in) :: case
        type(scene_type), intent(inout), target :: scene
        !> Remark on a case that did not fail; not allocated if there is none.
        character(len=:), allocatable, intent(out) :: remark
        type(error_type), allocatable, intent(out) :: error
        type(simulation_type) :: simulation
        type(trajectory_type), target :: trajectory
        type(observer_list_type) :: observers
        type(error_type), allocatable :: output_error
        type(global_error_type), target :: global_error
        character(len=20) :: number
        integer :: i

        call self%recorder%resolve(scene, error)
        if (allocated(error)) return
        call simulation%initialize(scene%model, scene%options, scene%t_start, scene%q, scene%qd, error, scene%assembly)
        if (allocated(error)) return
        do i = 1, size(scene%events)
            call simulation%add_event(scene%events(i))
        end do
        if (self%plan%folder == '' .and. .not. self%recorder%needs_estimate) then
            call simulation%integrate(scene%t_end, error, self%recorder)
            return
        end if
        call observers%add(self%recorder)
        if (self%recorder%needs_estimate) then
            if (allocated(scene%assembly)) then
                ! The second run starts from the assembled state.
                scene%q = simulation%state%q
                scene%qd = simulation%state%qd
            end if
            call global_error%initialize(scene%model%n, scene%t_start, scene%t_end)
            call observers%add(global_error)
        end if
        if (self%plan%folder == '') then
            call simulation%integrate(scene%t_end, error, observers)
        else
            call integrate_into_file()
        end if
        if (self%recorder%needs_estimate .and. .not. allocated(error)) call estimate(self, scene, global_error, remark)
    contains
        !> Integrate the case and write its complete trajectory.
        subroutine integrate_into_file()
            write (number, '(i0.6)') case
            scene%output%file = self%plan%folder//'/case_'//trim(number)//'.h5'
            call trajectory%open(scene%output, simulation, error, scene%text, 'case '//trim(number)//' of '//self%plan%path, &
                .true.)
            if (allocated(error)) return
            call observers%add(trajectory)
            call simulation%integrate(scene%t_end, error, observers)
            call trajectory%close(simulation, error, output_error)
            ! The file must be on the disk before the case counts as finished, so that after a power failure every finished case has
            ! its file.
            if (.not. allocated(output_error)) call sync_file(scene%output%file, output_error)
            if (.not. allocated(output_error)) call sync_folder_of(scene%output%file, output_error)
            if (allocated(output_error) .and. .not. allocated(error)) call move_alloc(output_error, error)
        end subroutine integrate_into_file
    end subroutine integrate

    !> Estimate the error of the run by a second run. The second run has a separate model, because a run may change its model. The
    !> case does not fail if there is no estimate: its values are then NaN, and the remark gives the reason.
    subroutine estimate(self, scene, global_error, remark)
        type(case_runner_type), intent(inout) :: self
        !> Scene of the case, and the error estimator that observed the run.
        type(scene_type), intent(in) :: scene
        type(global_error_type), intent(inout) :: global_error
        character(len=:), allocatable, intent(inout) :: remark
        type(scene_type), target :: again
        type(error_type), allocatable :: error

        call read_case(self, again, error)
        if (.not. allocated(error)) call global_error%estimate(again%model, scene%options, scene%q, scene%qd, error)
        if (allocated(error)) then
            remark = 'error not estimated: '//error%message
            return
        end if
        call self%recorder%take_estimate(global_error)
        if (global_error%is_bound) remark = 'the error estimate is only a bound: the tolerances cannot be smaller'
    end subroutine estimate

    !> Convert a message to a single line for a cell of the table.
    pure function on_one_line(message) result(text)
        character(len=*), intent(in) :: message
        character(len=message_length) :: text
        integer :: i, n

        text = ''
        n = 0
        do i = 1, len(message)
            if (n == len(text)) exit
            ! Leading blanks of a line only position its marks.
            if (message(i:i) == new_line('a') .or. message(i:i) == ' ') then
                if (n > 0) then
                    if (text(n:n) /= ' ') n = n + 1
                end if
                cycle
            end if
            n = n + 1
            text(n:n) = message(i:i)
        end do
    end function on_one_line
end module tandem_io_sweep_case
