! SPDX-License-Identifier: MIT
!> tandem equilibrium: the equilibrium of a scene and its stability.
module tandem_cli_equilibrium
    use tandem, only: error_type, linearisation_type, stability_name, to_text, wp
    use tandem_cli_arguments, only: arguments_type
    use tandem_cli_messages, only: print_to_stderr, done, input_wrong, padded, run_failed, say
    use tandem_io, only: brief, find_scene, json_type, read_scene, scene_type
    use tandem_status, only: status_no_equilibrium
    implicit none (type, external)
    private

    public :: equilibrium

    !> Largest number of coordinates that are printed as text; JSON output contains all.
    integer, parameter :: most_names = 60
    !> Largest number of coordinates for the stability analysis, which uses full matrices and takes minutes beyond this size.
    integer, parameter :: most_judged = 300

contains

    !> Find the equilibrium nearest to the start of a scene.
    subroutine equilibrium(arguments, code)
        type(arguments_type), intent(in) :: arguments
        !> Exit code: 1 if none was found.
        integer, intent(out) :: code
        type(scene_type), target :: scene
        type(linearisation_type) :: linearisation
        type(error_type), allocatable :: error
        character(len=:), allocatable :: path

        call find_scene(arguments%scene, path, error)
        if (.not. allocated(error)) call read_scene(path, arguments%settings, scene, error, models=arguments%models)
        code = input_wrong
        if (allocated(error)) then
            if (error%stat == status_no_equilibrium) code = run_failed
            call print_to_stderr(error%message)
            return
        end if
        if (scene%model%n <= most_judged) call linearisation%make(scene%model, scene%t_start, scene%q, scene%qd, error)
        if (allocated(error)) then
            call print_to_stderr(error%message)
            code = run_failed
            return
        end if
        if (arguments%json) then
            call print_json(scene, linearisation)
        else
            call print_equilibrium(scene, linearisation)
        end if
        code = done
    end subroutine equilibrium

    !> Print the result as text.
    subroutine print_equilibrium(scene, linearisation)
        type(scene_type), intent(in) :: scene
        type(linearisation_type), intent(in) :: linearisation
        character(len=24) :: number
        integer :: i, width

        associate (search => scene%search, spectrum => linearisation%spectrum)
            call say(scene%name//' is in equilibrium; found in '//to_text(search%iterations)//' iterations and '// &
                to_text(search%relaxations)//' steps along the forces, '//brief(search%moved)//' from the start at most')
            if (allocated(spectrum%values)) then
                call say('linear stability: '//trim(stability_name(spectrum%stability())))
            else
                call say('linear stability: not computed for so many coordinates; see tandem linearise --near')
            end if
            if (search%n_free > 0) call say('free: '//to_text(search%n_free)//' directions lead to other equilibria; '// &
                'this one is the nearest')
            if (linearisation%depends_on_time) call say('functions of time are held constant at t = '//to_text(scene%t_start))
            call say('')
            width = maxval([24, (len(scene%model%coordinate_label(i)), i=1, min(size(scene%q), most_names))])
            do i = 1, min(size(scene%q), most_names)
                write (number, '(es23.15)') scene%q(i)
                call say(padded(scene%model%coordinate_label(i), width)//number)
            end do
            if (size(scene%q) > most_names) call say('... (--json has all)')
        end associate
    end subroutine print_equilibrium

    !> Print the result as one JSON object.
    subroutine print_json(scene, linearisation)
        type(scene_type), intent(in) :: scene
        type(linearisation_type), intent(in) :: linearisation
        type(json_type) :: json
        integer :: i

        associate (search => scene%search, spectrum => linearisation%spectrum)
            call json%begin_object()
            call json%add('scene', scene%name)
            call json%add('time', scene%t_start)
            if (allocated(spectrum%values)) call json%add('stability', stability_name(spectrum%stability()))
            call json%add('iterations', search%iterations)
            call json%add('relaxations', search%relaxations)
            call json%add('moved', search%moved)
            call json%add('free', search%n_free)
            call json%add('q', scene%q)
            if (allocated(spectrum%values)) then
                call json%add('residual', linearisation%residual)
                call json%add('depends_on_time', linearisation%depends_on_time)
                call json%begin_array('eigenvalues')
                do i = 1, size(spectrum%values)
                    call json%add('', [real(spectrum%values(i), wp), aimag(spectrum%values(i))])
                end do
                call json%end_array()
            end if
            call json%end_object()
            call say(json%text)
        end associate
    end subroutine print_json
end module tandem_cli_equilibrium
