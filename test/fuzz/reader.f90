! SPDX-License-Identifier: MIT
!> Reads scenes as `tandem show`, `check` and `run` do, one after the other in one process, and reports the result of each;
!> `fuzz.py` beside this file makes the scenes and judges the answers.
!>
!> Standard input contains for each scene these lines: its path, a path for a copy, the number of its settings and the length of the
!> longest, and the settings.
!> Standard output answers with a line `verdict status length` and a text of that length: for a refused scene the message, for an
!> accepted one the complete scene. The verdicts are
!>
!> - `refused`: with an error of the input;
!> - `changed`: the complete scene, written to the copy and read again, differs;
!> - `absurd`: a number that is not finite reached the model, or a successful run ended in one;
!> - `accepted`: none of these; the status is that of a very short run.
program fuzz_reader
    use tandem, only: error_type, simulation_type, wp
    use tandem_io, only: read_scene, scene_type
    use tandem_status, only: status_ok
    use, intrinsic :: ieee_arithmetic, only: ieee_is_finite
    use, intrinsic :: iso_fortran_env, only: input_unit, output_unit
    implicit none (type, external)
    character(len=:), allocatable :: path, copy, line
    integer :: n, longest
    logical :: is_there

    do
        call read_line(path, is_there)
        if (.not. is_there) exit
        call read_line(copy, is_there)
        call read_line(line, is_there)
        read (line, *) n, longest
        call try_next(path, copy, n, longest)
    end do

contains

    !> Read a scene, with the settings in the next lines of standard input, and answer.
    subroutine try_next(path, copy, n, longest)
        character(len=*), intent(in) :: path, copy
        !> Number of settings, and their largest length.
        integer, intent(in) :: n, longest
        character(len=longest) :: settings(n)
        character(len=:), allocatable :: line
        type(scene_type), target :: scene
        type(scene_type) :: again
        type(error_type), allocatable :: error
        character(len=0) :: none(0)
        integer :: i, stat
        logical :: is_there, is_sound

        do i = 1, n
            call read_line(line, is_there)
            settings(i) = line
        end do
        call read_scene(path, settings, scene, error)
        if (allocated(error)) then
            call answer('refused', error%stat, error%message)
            return
        end if
        call write_text(copy, scene%text)
        call read_scene(copy, none, again, error)
        if (allocated(error)) then
            call answer('changed', error%stat, error%message//new_line('a')//scene%text)
            return
        end if
        if (.not. (again%text == scene%text .and. same(again%q, scene%q) .and. same(again%qd, scene%qd) .and. &
            same([again%t_start, again%t_end], [scene%t_start, scene%t_end]))) then
            call answer('changed', 0, again%text//new_line('a')//scene%text)
            return
        end if
        if (.not. (all(ieee_is_finite(scene%q)) .and. all(ieee_is_finite(scene%qd)))) then
            call answer('absurd', 0, scene%text)
            return
        end if
        call run(scene, stat, is_sound)
        call answer(merge('accepted', 'absurd  ', is_sound), stat, scene%text)
    end subroutine try_next

    !> Start a scene and take a few steps.
    subroutine run(scene, stat, is_sound)
        type(scene_type), intent(inout), target :: scene
        !> Status of the run.
        integer, intent(out) :: stat
        !> False if the last state is not finite; it must be finite after a failure too.
        logical, intent(out) :: is_sound
        type(simulation_type) :: simulation
        type(error_type), allocatable :: error
        integer :: i

        stat = status_ok
        is_sound = .true.
        scene%options%max_steps = min(scene%options%max_steps, 3)
        scene%options%max_evaluations = 200
        call simulation%initialize(scene%model, scene%options, scene%t_start, scene%q, scene%qd, error, scene%assembly)
        if (.not. allocated(error)) then
            do i = 1, size(scene%events)
                call simulation%add_event(scene%events(i))
            end do
            call simulation%integrate(scene%t_end, error)
            is_sound = all(ieee_is_finite(simulation%state%q)) .and. all(ieee_is_finite(simulation%state%qd))
        end if
        if (allocated(error)) stat = error%stat
    end subroutine run

    !> Write the answer.
    subroutine answer(verdict, stat, text)
        character(len=*), intent(in) :: verdict, text
        integer, intent(in) :: stat

        write (output_unit, '(a, 2(1x, i0))') trim(verdict), stat, len(text)
        write (output_unit, '(a)') text
        flush (output_unit)
    end subroutine answer

    !> True if two lists of numbers are equal, bit by bit except for the sign of a zero.
    pure logical function same(a, b)
        real(wp), intent(in) :: a(:), b(:)

        same = size(a) == size(b)
        if (same) same = .not. any(a < b .or. a > b)
    end function same

    !> Write a file.
    subroutine write_text(path, text)
        character(len=*), intent(in) :: path, text
        integer :: unit

        open (newunit=unit, file=path, access='stream', form='unformatted', status='replace', action='write')
        write (unit) text
        close (unit)
    end subroutine write_text

    !> A line of standard input, of any length.
    subroutine read_line(line, is_there)
        character(len=:), allocatable, intent(out) :: line
        !> False at the end of the input.
        logical, intent(out) :: is_there
        character(len=4096) :: part
        integer :: length, stat

        line = ''
        do
            read (input_unit, '(a)', advance='no', size=length, iostat=stat) part
            if (stat /= 0) exit
            line = line//part
        end do
        is_there = is_iostat_eor(stat)
        if (is_there) line = line//part(:length)
    end subroutine read_line
end program fuzz_reader
