! SPDX-License-Identifier: MIT
!> Saves the last state of a run, as a scene that starts from it, if the results cannot be written. The scene is written beside the
!> result, otherwise to the folder for temporary files, otherwise to stderr.
module tandem_cli_rescue
    use, intrinsic :: iso_fortran_env, only: error_unit
    use tandem, only: error_type, simulation_type, to_text
    use tandem_cli_messages, only: print_to_stderr
    use tandem_io, only: scene_type, to_toml
    use tandem_io_study_files, only: write_whole
    implicit none (type, external)
    private

    public :: save_last_state

    !> Largest number of file names that are tried; the last one is overwritten.
    integer, parameter :: most_numbers = 1000

contains

    !> Save the state and report the path of the file.
    subroutine save_last_state(scene, simulation)
        type(scene_type), intent(in) :: scene
        type(simulation_type), intent(in) :: simulation
        character(len=:), allocatable :: text, name, path
        type(error_type), allocatable :: error
        character(len=256) :: folder
        integer :: start, stat

        associate (file => scene%output%file)
            start = index(file, '/', back=.true.)
            name = file(start + 1:)
            if (index(name, '.', back=.true.) > 1) name = name(:index(name, '.', back=.true.) - 1)
            call get_environment_variable('TMPDIR', folder, status=stat)
            if (stat /= 0 .or. folder == '') folder = '/tmp'
            text = scene_from(scene, simulation)
            call write_new(file(:start)//name, text, path, error)
            if (allocated(error)) call write_new(trim(folder)//'/'//name, text, path, error)
        end associate
        if (allocated(error)) then
            call print_to_stderr('the last state cannot be saved in a file; this scene starts from it:')
            write (error_unit, '(a)') text
        else
            call print_to_stderr('the last state, t = '//to_text(simulation%state%t)//', is saved: tandem run '//path// &
                ' continues from it')
        end if
    end subroutine save_last_state

    !> Write a file with a new name.
    subroutine write_new(stem, text, path, error)
        !> Path without extension.
        character(len=*), intent(in) :: stem, text
        !> Path of the written file.
        character(len=:), allocatable, intent(out) :: path
        type(error_type), allocatable, intent(out) :: error
        logical :: exists
        integer :: number

        path = stem//'.last.toml'
        do number = 2, most_numbers
            inquire (file=path, exist=exists)
            if (.not. exists) exit
            path = stem//'.last-'//to_text(number)//'.toml'
        end do
        call write_whole(path, text, error)
    end subroutine write_new

    !> Complete scene with the state as its start.
    function scene_from(scene, simulation) result(text)
        type(scene_type), intent(in) :: scene
        type(simulation_type), intent(in) :: simulation
        character(len=:), allocatable :: text
        character(len=*), parameter :: newline = new_line('a')
        integer :: initial, time, start, rest

        initial = index(scene%text, newline//'[initial]'//newline)
        time = index(scene%text, newline//'[time]'//newline)
        start = time + index(scene%text(time + 1:), newline//'start = ')
        rest = start + index(scene%text(start + 1:), newline)
        associate (state => simulation%state)
            text = scene%text(:initial)//'[initial]'//newline//'q = '//to_toml(state%q)//newline//'qd = '//to_toml(state%qd)// &
                newline//scene%text(time:start)//'start = '//to_toml(state%t)//scene%text(rest:)
        end associate
    end function scene_from
end module tandem_cli_rescue
