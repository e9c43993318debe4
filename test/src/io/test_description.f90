! SPDX-License-Identifier: MIT
!> Tests of descriptions: keys that are parsed once and read any number of times, and settings that change them.
module test_description
    use asserts, only: check_close, check_no_failure, check_text, check_true
    use tandem, only: atom_type, failure_type => error_type, is_text, wp
    use tandem_io, only: description_type, interpret_scene, open_scene, read_scene, repeat_scene, scene_type, shipped_models
    use testdrive, only: error_type, new_unittest, unittest_type
    implicit none (type, external)
    private

    public :: collect_description

contains

    !> The suite.
    subroutine collect_description(testsuite)
        type(unittest_type), allocatable, intent(out) :: testsuite(:)

        testsuite = [ &
            new_unittest('scenes-are-made-again-from-their-keys', test_repeated), &
            new_unittest('changed-settings-are-those-of-a-new-text', test_changed), &
            new_unittest('a-changed-value-is-shown-in-the-message', test_message), &
            new_unittest('events-are-counted-anew-when-one-is-removed', test_removed)]
    end subroutine collect_description

    !> One scene of each model.
    subroutine test_repeated(error)
        type(error_type), allocatable, intent(out) :: error
        character(len=*), parameter :: scenes(4) = [character(len=20) :: 'rolling_disk', 'articulated_vehicle', 'motorcycle', &
            'bicycle']
        type(scene_type), target :: scene, again
        type(failure_type), allocatable :: failure
        integer :: i

        do i = 1, size(scenes)
            call read_scene('scenes/'//trim(scenes(i))//'.toml', [character(len=14) :: 'time.end=0.125'], scene, failure)
            if (.not. allocated(failure)) call repeat_scene(scene, again, failure)
            call check_no_failure(error, failure)
            if (allocated(error)) return
            call check_close(error, again%q, scene%q, 0.0_wp, 'q of '//trim(scenes(i)))
            call check_close(error, again%qd, scene%qd, 0.0_wp, 'qd of '//trim(scenes(i)))
            call check_close(error, [again%t_end], [0.125_wp], 0.0_wp, 'end of '//trim(scenes(i)))
        end do
    end subroutine test_repeated

    !> A number, an element of a list and a text.
    subroutine test_changed(error)
        type(error_type), allocatable, intent(out) :: error
        type(description_type) :: keys
        type(scene_type) :: scene, other
        type(failure_type), allocatable :: failure

        call open_scene('scenes/rolling_disk.toml', [character(len=24) :: 'model.mass=3', 'initial.omega=[1,2,3]', &
            'solver.stepper=rk4', '--unset solver.step'], shipped_models(), keys, failure)
        call check_no_failure(error, failure)
        if (allocated(error)) return
        call check_true(error, keys%n_settings() == 3, 'three settings give values')
        call keys%change(1, 0, atom_type(number=4.5_wp))
        call keys%change(2, 2, atom_type(number=-0.75_wp))
        call keys%change(3, 0, atom_type(kind=is_text, text='dop853'))
        call interpret_scene(keys, shipped_models(), scene, failure)
        call check_no_failure(error, failure)
        call read_scene('scenes/rolling_disk.toml', [character(len=28) :: 'model.mass=4.5', 'initial.omega=[1,-0.75,3]', &
            'solver.stepper=dop853', '--unset solver.step'], other, failure)
        call check_no_failure(error, failure)
        if (allocated(error)) return
        call check_true(error, scene%text == other%text, 'the complete scenes are equal')
        call check_close(error, scene%qd, other%qd, 0.0_wp, 'the starts are equal')
    end subroutine test_changed

    !> The line and the mark are those of the changed value.
    subroutine test_message(error)
        type(error_type), allocatable, intent(out) :: error
        type(description_type) :: keys
        type(scene_type) :: scene
        type(failure_type), allocatable :: failure

        call open_scene('scenes/rolling_disk.toml', [character(len=24) :: 'model.mass=3'], shipped_models(), keys, failure)
        call check_no_failure(error, failure)
        if (allocated(error)) return
        call keys%change(1, 0, atom_type(number=-0.015625_wp))
        call interpret_scene(keys, shipped_models(), scene, failure)
        call check_true(error, allocated(failure), 'a negative mass is refused')
        if (allocated(error)) return
        call check_text(error, failure%message, 'mass must be positive')
        call check_text(error, failure%message, '--set:1:12-20')
        call check_text(error, failure%message, 'model.mass=-0.015625')
        ! The next value is good again.
        call keys%change(1, 0, atom_type(number=2.0_wp))
        call interpret_scene(keys, shipped_models(), scene, failure)
        call check_no_failure(error, failure)
    end subroutine test_message

    !> Tables that may come several times, some without keys of their own.
    subroutine test_removed(error)
        type(error_type), allocatable, intent(out) :: error
        character(len=*), parameter :: events = 'event=[{name="a", watch="rx"}, {name="b", watch="ry"}, {name="c", watch="rz"}]'
        type(scene_type) :: scene
        type(failure_type), allocatable :: failure

        call read_scene('scenes/rolling_disk.toml', [character(len=len(events)) :: events, '--unset event.1', &
            'event.2.value=0.25', '--unset event.1.name', 'event.1.name=d', 'event.3.name=e', 'event.3.watch=rx'], scene, failure)
        call check_no_failure(error, failure)
        if (allocated(error)) return
        call check_true(error, size(scene%events) == 3, 'three events')
        if (allocated(error)) return
        call check_text(error, scene%events(1)%name, 'd')
        call check_text(error, scene%events(2)%name, 'c')
        call check_text(error, scene%events(3)%name, 'e')
        call check_close(error, scene%events%value, [0.0_wp, 0.25_wp, 0.0_wp], 0.0_wp, 'values of the events')
        call read_scene('scenes/rolling_disk.toml', [character(len=len(events)) :: events, 'event=[{}]'], scene, failure)
        call check_true(error, allocated(failure), 'an event without keys is refused')
        if (allocated(failure)) call check_text(error, failure%message, 'the key name is missing in [[event]] of --set')
    end subroutine test_removed
end module test_description
