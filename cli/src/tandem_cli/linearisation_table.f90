! SPDX-License-Identifier: MIT
!> Output of a linearised system as text tables.
module tandem_cli_linearisation_table
    use tandem, only: at_an_instant, floquet_type, in_steady_motion, kind_name, linearisation_type, mechanism_type, model_type, &
        of_family, of_motion, of_symmetry, to_text, wp
    use tandem_cli_messages, only: padded, say
    use tandem_io, only: body_motions, brief, scene_type
    implicit none (type, external)
    private

    public :: print_linearisation, print_multipliers, print_body_motions, shape_text, eigenvalue_text

    !> Largest number of coordinates printed for a mode.
    integer, parameter :: most_names = 6

contains

    !> Print the tables.
    subroutine print_linearisation(scene, linearisation)
        type(scene_type), intent(in) :: scene
        type(linearisation_type), intent(in) :: linearisation
        character(len=:), allocatable :: line
        integer :: k

        associate (it => linearisation, spectrum => linearisation%spectrum)
            call say(scene%name//' at t = '//to_text(it%t)//': '//trim(kind_name(it%kind))//', '//to_text(it%nv)// &
                ' coordinates and '//to_text(it%nw)//' velocities are free')
            if (it%kind == in_steady_motion) then
                line = 'moves along'
                do k = 1, size(it%rates)
                    if (abs(it%rates(k)) > 0.0_wp) line = line//' '//trim(it%symmetry%motions(k)%name)//' '// &
                        to_text(it%rates(k))//','
                end do
                call say(line(:len(line) - 1)//' (per second)')
            else if (it%kind == at_an_instant) then
                call say('no equilibrium and no steady motion: the eigenvalues are instantaneous and need not describe '// &
                    'growth or decay; see tandem equilibrium, and --steady')
                call say('residual of the rates: '//brief(it%residual)//' relative to their terms')
            end if
            if (it%depends_on_time) call say('the equations depend on time, which is held constant')
            if (.not. it%has_gradients) call say('finite differences replace missing derivatives of the model: expect '// &
                'some 10 digits')
            call say('')
            call print_eigenvalues(scene, it)
            call print_zeros(it)
        end associate
    end subroutine print_linearisation

    !> Print Floquet multipliers.
    subroutine print_multipliers(floquet)
        type(floquet_type), intent(in) :: floquet
        character(len=31) :: parts(4)
        integer :: i

        call say('')
        call say(padded('multiplier over '//to_text(floquet%period)//' s', 46)//'ln(multiplier)/period [1/s]')
        do i = 1, size(floquet%multipliers)
            associate (mu => floquet%multipliers(i), lambda => floquet%exponents(i))
                if (aimag(mu) < 0.0_wp) cycle
                write (parts, '(es20.12)') real(mu, wp), aimag(mu), real(lambda, wp), aimag(lambda)
                if (.not. aimag(mu) > 0.0_wp) parts(2) = ''
                if (.not. abs(aimag(lambda)) > 0.0_wp) parts(4) = ''
                if (parts(2) /= '') parts(2) = '+- '//trim(adjustl(parts(2)))//' i'
                if (parts(4) /= '') parts(4) = '+- '//trim(adjustl(parts(4)))//' i'
                call say(padded(trim(adjustl(parts(1))), 21)//padded(trim(parts(2)), 25)// &
                    padded(trim(adjustl(parts(3))), 21)//trim(parts(4)))
            end associate
        end do
    end subroutine print_multipliers

    !> Print eigenvalues that are not due to symmetries or families, one per complex pair, with their shapes.
    subroutine print_eigenvalues(scene, it)
        type(scene_type), intent(in) :: scene
        type(linearisation_type), intent(in) :: it
        integer :: i

        call say(padded('eigenvalue [1/s]', 46)//padded('frequency', 12)//padded('damping', 12)//padded('error', 10)//'shape')
        do i = 1, size(it%spectrum%values)
            if (it%spectrum%cause(i) /= of_motion) cycle
            associate (value => it%spectrum%values(i))
                if (aimag(value) < 0.0_wp) cycle
                call say(eigenvalue_text(value, .true.)//padded(hertz(it, i), 12)// &
                    padded(brief(it%spectrum%damping_ratio(i)), 12)//padded(brief(it%spectrum%error(i)), 10)// &
                    shape_text(scene%model, it%spectrum%shapes(:, i), aimag(value) > 0.0_wp))
            end associate
        end do
        if (all(it%spectrum%cause /= of_motion)) call say('none')
    end subroutine print_eigenvalues

    !> Frequency of an oscillation.
    function hertz(it, i) result(text)
        type(linearisation_type), intent(in) :: it
        integer, intent(in) :: i
        character(len=:), allocatable :: text

        text = '-'
        if (aimag(it%spectrum%values(i)) > 0.0_wp) text = brief(it%spectrum%frequency(i))//' Hz'
    end function hertz

    !> Eigenvalue, or one of a complex pair, in 46 characters.
    function eigenvalue_text(value, is_of_pair) result(text)
        complex(wp), intent(in) :: value
        logical, intent(in) :: is_of_pair
        character(len=:), allocatable :: text
        character(len=28) :: re, im

        write (re, '(es20.12)') real(value, wp)
        im = ''
        if (abs(aimag(value)) > 0.0_wp) write (im, '(es18.12, a)') abs(aimag(value)), ' i'
        if (im /= '' .and. is_of_pair) im = '+- '//im(:25)
        if (im /= '' .and. .not. is_of_pair) im = merge('+ ', '- ', aimag(value) > 0.0_wp)//im(:26)
        text = padded(trim(adjustl(re)), 21)//padded(trim(im), 25)
    end function eigenvalue_text

    !> Coordinates with the largest amplitudes, with amplitude and phase.
    function shape_text(model, shape, oscillates) result(text)
        class(model_type), intent(in) :: model
        complex(wp), intent(in) :: shape(:)
        logical, intent(in) :: oscillates
        character(len=:), allocatable :: text
        real(wp) :: amplitude(size(shape))
        integer :: k, n

        amplitude = abs(shape)
        text = ''
        do n = 1, min(most_names, size(shape))
            k = maxloc(amplitude, dim=1)
            if (amplitude(k) < 1.0e-3_wp) exit
            if (text /= '') text = text//', '
            text = text//model%coordinate_label(k)//' '//entry_text(shape(k), oscillates)
            amplitude(k) = 0.0_wp
        end do
    end function shape_text

    !> Amplitude and phase of an oscillation; otherwise the real number only.
    function entry_text(entry, oscillates) result(text)
        complex(wp), intent(in) :: entry
        logical, intent(in) :: oscillates
        character(len=:), allocatable :: text
        character(len=24) :: number

        if (oscillates) then
            write (number, '(f0.3, "<", i0)') abs(entry), nint(phase(entry))
        else
            write (number, '(sp, f0.3)') real(entry, wp)
        end if
        text = trim(number)
    end function entry_text

    !> Print modes as motions of bodies, one per complex pair, with one line per moving body.
    subroutine print_body_motions(model, q, values, shapes)
        class(model_type), intent(in) :: model
        real(wp), intent(in) :: q(:)
        complex(wp), intent(in) :: values(:)
        !> (n, size(values))
        complex(wp), intent(in) :: shapes(:, :)
        complex(wp), allocatable :: motions(:, :)
        character(len=:), allocatable :: line
        character(len=4), parameter :: heads(6) = [character(len=4) :: 'x', 'y', 'z', 'rx', 'ry', 'rz']
        integer :: i, k, mode, width

        select type (model)
        class is (mechanism_type)
            call body_motions(model, q, shapes, motions)
            width = max(20, maxval([0, len_trim(model%bodies%name)]) + 2)
            do mode = 1, size(values)
                if (aimag(values(mode)) < 0.0_wp) cycle
                call say('')
                call say('motions of bodies at '//trim(eigenvalue_text(values(mode), .true.))//': x, y, z in m, rotations in rad')
                line = padded('body', width)
                do k = 1, 6
                    line = line//padded(heads(k), 12)
                end do
                call say(line)
                do i = 1, size(model%bodies)
                    if (maxval(abs(motions(6*i - 5:6*i, mode))) < 1.0e-3_wp*maxval(abs(motions(:, mode)))) cycle
                    line = padded(trim(model%bodies(i)%name), width)
                    do k = 1, 6
                        if (abs(motions(6*i - 6 + k, mode)) < 5.0e-4_wp) then
                            line = line//padded('0', 12)
                        else
                            line = line//padded(entry_text(motions(6*i - 6 + k, mode), abs(aimag(values(mode))) > 0.0_wp), 12)
                        end if
                    end do
                    call say(line)
                end do
            end do
        class default
            call say('')
            call say('the model is not a mechanism: modes are given by coordinates only')
        end select
    end subroutine print_body_motions

    !> Phase in degrees.
    pure real(wp) function phase(z)
        complex(wp), intent(in) :: z

        phase = atan2(aimag(z), real(z, wp))*180/acos(-1.0_wp)
    end function phase

    !> Print the zeros due to symmetries and families.
    subroutine print_zeros(it)
        type(linearisation_type), intent(in) :: it
        character(len=:), allocatable :: line
        integer :: i, k

        associate (spectrum => it%spectrum)
            if (all(spectrum%cause == of_motion)) return
            call say('')
            if (any(spectrum%cause == of_symmetry)) then
                line = to_text(count(spectrum%cause == of_symmetry))//' of symmetries, which leave the equations unchanged:'
                do k = 1, size(it%symmetry%rates, 2)
                    line = line//' '//it%symmetry%name_of(it%symmetry%rates(:, k))//','
                end do
                call say(line(:len(line) - 1))
                do i = 1, size(spectrum%values)
                    if (spectrum%cause(i) /= of_symmetry .or. .not. aimag(spectrum%values(i)) > 0.0_wp) cycle
                    call say('  +- '//to_text(aimag(spectrum%values(i)))//' i among them: the frame rotates')
                end do
            end if
            k = count(spectrum%cause == of_family .and. .not. abs(spectrum%values) > 0.0_wp)
            if (k > 0) call say(to_text(k)//' zeros of families: '//family_text(it))
            k = count(spectrum%cause == of_family) - k
            if (k > 0) call say(to_text(k)//' of drift, at the rate of the rotating frame: free bodies move parallel to paths')
            if (spectrum%n_zeros == 0) return
            line = 'zeros in Jordan blocks:'
            do k = 1, size(spectrum%blocks)
                i = spectrum%blocks(k)
                if (k < size(spectrum%blocks)) i = i - spectrum%blocks(k + 1)
                if (i > 0) line = line//' '//to_text(i)//' of size '//to_text(k)//','
            end do
            call say(line(:len(line) - 1)//'; not separated, they would appear as eigenvalues of up to '// &
                brief(maxval(merge(spectrum%error, 0.0_wp, spectrum%cause /= of_motion))))
        end associate
    end subroutine print_zeros

    !> Origin of the families.
    function family_text(it) result(text)
        type(linearisation_type), intent(in) :: it
        character(len=:), allocatable :: text

        if (it%kind == at_an_instant) then
            text = 'the matrix is singular at this instant'
        else if (it%kind == in_steady_motion) then
            text = 'there are neighbouring steady motions with other rates'
        else if (it%nv > it%nw) then
            text = 'there are neighbouring equilibria, due to '//to_text(it%nv - it%nw)//' nonholonomic rows'
        else
            text = 'there are neighbouring equilibria or steady motions'
        end if
    end function family_text
end module tandem_cli_linearisation_table
