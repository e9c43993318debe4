! SPDX-License-Identifier: MIT
!> A linearised system as tables to read.
module tandem_cli_linearisation_table
    use tandem, only: at_an_instant, floquet_type, in_steady_motion, kind_name, linearisation_type, of_family, of_motion, &
        of_symmetry, to_text, wp
    use tandem_cli_messages, only: padded, say
    use tandem_io, only: brief, scene_type
    implicit none (type, external)
    private

    public :: print_linearisation, print_multipliers

    !> Most coordinates of a mode that are named.
    integer, parameter :: most_names = 6

contains

    !> Print it.
    subroutine print_linearisation(scene, linearisation)
        type(scene_type), intent(in) :: scene
        type(linearisation_type), intent(in) :: linearisation
        character(len=:), allocatable :: line
        integer :: k

        associate (it => linearisation, spectrum => linearisation%spectrum)
            call say(scene%name//' at t = '//to_text(it%t)//': '//trim(kind_name(it%kind))//', '//to_text(it%nv)// &
                ' coordinates and '//to_text(it%nw)//' velocities are free')
            if (it%kind == in_steady_motion) then
                line = 'goes on along'
                do k = 1, size(it%rates)
                    if (abs(it%rates(k)) > 0.0_wp) line = line//' '//trim(it%symmetry%motions(k)%name)//' '// &
                        to_text(it%rates(k))//','
                end do
                call say(line(:len(line) - 1)//' (per second)')
            else if (it%kind == at_an_instant) then
                call say('no equilibrium and no steady motion: the eigenvalues are those of this instant, and what grows or '// &
                    'decays need not follow them; see tandem equilibrium, and --steady')
                call say('what is left of the rates: '//brief(it%residual)//' of the size of their terms')
            end if
            if (it%depends_on_time) call say('the equations depend on the time, which stands still here')
            if (.not. it%has_gradients) call say('differences stand in for derivatives that the model does not give: expect '// &
                'some 10 digits')
            call say('')
            call print_eigenvalues(scene, it)
            call print_zeros(it)
        end associate
    end subroutine print_linearisation

    !> Floquet multipliers.
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

    !> The eigenvalues that are not explained by symmetries and families, one of each pair, with their shapes.
    subroutine print_eigenvalues(scene, it)
        type(scene_type), intent(in) :: scene
        type(linearisation_type), intent(in) :: it
        character(len=28) :: re, im
        integer :: i

        call say(padded('eigenvalue [1/s]', 46)//padded('frequency', 12)//padded('damping', 12)//padded('error', 10)//'shape')
        do i = 1, size(it%spectrum%values)
            if (it%spectrum%cause(i) /= of_motion) cycle
            associate (value => it%spectrum%values(i))
                if (aimag(value) < 0.0_wp) cycle
                write (re, '(es20.12)') real(value, wp)
                im = ''
                if (aimag(value) > 0.0_wp) write (im, '(es18.12, a)') aimag(value), ' i'
                if (im /= '') im = '+- '//im(:25)
                call say(padded(trim(adjustl(re)), 21)//padded(trim(im), 25)//padded(hertz(it, i), 12)// &
                    padded(brief(it%spectrum%damping_ratio(i)), 12)//padded(brief(it%spectrum%error(i)), 10)// &
                    shape_text(scene, it, i))
            end associate
        end do
        if (all(it%spectrum%cause /= of_motion)) call say('none')
    end subroutine print_eigenvalues

    !> The frequency, where there is one.
    function hertz(it, i) result(text)
        type(linearisation_type), intent(in) :: it
        integer, intent(in) :: i
        character(len=:), allocatable :: text

        text = '-'
        if (aimag(it%spectrum%values(i)) > 0.0_wp) text = brief(it%spectrum%frequency(i))//' Hz'
    end function hertz

    !> The coordinates that move most, with amplitude and phase.
    function shape_text(scene, it, i) result(text)
        type(scene_type), intent(in) :: scene
        type(linearisation_type), intent(in) :: it
        integer, intent(in) :: i
        character(len=:), allocatable :: text
        real(wp) :: amplitude(size(it%q))
        character(len=24) :: numbers
        integer :: k, n

        amplitude = abs(it%spectrum%shapes(:, i))
        text = ''
        do n = 1, most_names
            k = maxloc(amplitude, dim=1)
            if (amplitude(k) < 1.0e-3_wp) exit
            if (aimag(it%spectrum%values(i)) > 0.0_wp) then
                write (numbers, '(f0.3, "<", i0)') amplitude(k), nint(phase(it%spectrum%shapes(k, i)))
            else
                write (numbers, '(sp, f0.3)') real(it%spectrum%shapes(k, i), wp)
            end if
            if (text /= '') text = text//', '
            text = text//scene%model%coordinate_label(k)//' '//trim(numbers)
            amplitude(k) = 0.0_wp
        end do
    end function shape_text

    !> In degrees.
    pure real(wp) function phase(z)
        complex(wp), intent(in) :: z

        phase = atan2(aimag(z), real(z, wp))*180/acos(-1.0_wp)
    end function phase

    !> What symmetries and families explain.
    subroutine print_zeros(it)
        type(linearisation_type), intent(in) :: it
        character(len=:), allocatable :: line
        integer :: i, k

        associate (spectrum => it%spectrum)
            if (all(spectrum%cause == of_motion)) return
            call say('')
            if (any(spectrum%cause == of_symmetry)) then
                line = to_text(count(spectrum%cause == of_symmetry))//' of symmetries, which move it to where it is the same:'
                do k = 1, size(it%symmetry%rates, 2)
                    line = line//' '//it%symmetry%name_of(it%symmetry%rates(:, k))//','
                end do
                call say(line(:len(line) - 1))
                do i = 1, size(spectrum%values)
                    if (spectrum%cause(i) /= of_symmetry .or. .not. aimag(spectrum%values(i)) > 0.0_wp) cycle
                    call say('  +- '//to_text(aimag(spectrum%values(i)))//' i among them: the frame turns')
                end do
            end if
            if (any(spectrum%cause == of_family)) call say(to_text(count(spectrum%cause == of_family))// &
                ' zeros of families: '//family_text(it))
            if (spectrum%n_zeros == 0) return
            line = 'zeros in Jordan blocks:'
            do k = 1, size(spectrum%blocks)
                i = spectrum%blocks(k)
                if (k < size(spectrum%blocks)) i = i - spectrum%blocks(k + 1)
                if (i > 0) line = line//' '//to_text(i)//' of size '//to_text(k)//','
            end do
            call say(line(:len(line) - 1)//'; computed with the others, they would come out as up to '// &
                brief(maxval(merge(spectrum%error, 0.0_wp, spectrum%cause /= of_motion))))
        end associate
    end subroutine print_zeros

    !> Where families come from.
    function family_text(it) result(text)
        type(linearisation_type), intent(in) :: it
        character(len=:), allocatable :: text

        if (it%kind == at_an_instant) then
            text = 'the matrix is singular at this instant'
        else if (it%kind == in_steady_motion) then
            text = 'steady motions with other rates lie beside this one'
        else if (it%nv > it%nw) then
            text = 'equilibria lie beside this one, as '//to_text(it%nv - it%nw)//' nonholonomic rows leave them'
        else
            text = 'equilibria or steady motions lie beside this one'
        end if
    end function family_text
end module tandem_cli_linearisation_table
