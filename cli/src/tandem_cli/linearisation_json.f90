! SPDX-License-Identifier: MIT
!> Output of a linearised system as one JSON object.
module tandem_cli_linearisation_json
    use tandem, only: cause_name, floquet_type, inputs_type, kind_name, linearisation_type, of_motion, wp
    use tandem_cli_messages, only: say
    use tandem_io, only: json_type, scene_type
    implicit none (type, external)
    private

    public :: print_linearisation_json

contains

    !> Print the object.
    subroutine print_linearisation_json(scene, linearisation, inputs, floquet)
        type(scene_type), intent(in) :: scene
        type(linearisation_type), intent(in) :: linearisation
        type(inputs_type), intent(in) :: inputs
        !> Floquet multipliers, if requested.
        type(floquet_type), intent(in), optional :: floquet
        type(json_type) :: json
        integer :: i, k

        call json%begin_object()
        call json%add('scene', scene%name)
        associate (it => linearisation, spectrum => linearisation%spectrum)
            call json%add('time', it%t)
            call json%add('kind', kind_name(it%kind))
            call json%add('residual', it%residual)
            call json%add('depends_on_time', it%depends_on_time)
            call json%add('exact_gradients', it%has_gradients)
            call json%add('n_v', it%nv)
            call json%add('n_w', it%nw)
            call add_pairs(json, 'eigenvalues', spectrum%values)
            call json%begin_array('modes')
            do i = 1, size(spectrum%values)
                call add_mode(json, scene, it, i)
            end do
            call json%end_array()
            call json%begin_object('zeros')
            call json%add('count', spectrum%n_zeros)
            call json%begin_array('jordan_blocks')
            ! blocks(k) is the number of blocks of size k or more.
            do k = size(spectrum%blocks), 1, -1
                do i = 1, spectrum%blocks(k) - sum(spectrum%blocks(k + 1:min(k + 1, size(spectrum%blocks))))
                    call json%add('', k)
                end do
            end do
            call json%end_array()
            call json%end_object()
            call add_motions(json, it)
            call json%add('q', it%q)
            call json%add('qd', it%qd)
            call add_matrix(json, 'a', it%a)
            call add_matrix(json, 'b', inputs%b)
            call add_matrix(json, 'c', inputs%c)
            call add_matrix(json, 'd', inputs%d)
            call json%add('inputs', inputs%inputs)
            call json%add('outputs', inputs%outputs)
            if (present(floquet)) then
                call json%add('period', floquet%period)
                call add_pairs(json, 'multipliers', floquet%multipliers)
                call add_pairs(json, 'exponents', floquet%exponents)
            end if
        end associate
        call json%end_object()
        call say(json%text)
    end subroutine print_linearisation_json

    !> Add an eigenvalue with its mode.
    subroutine add_mode(json, scene, it, i)
        type(json_type), intent(inout) :: json
        type(scene_type), intent(in) :: scene
        type(linearisation_type), intent(in) :: it
        integer, intent(in) :: i
        integer :: k

        associate (value => it%spectrum%values(i))
            call json%begin_object()
            call json%add('eigenvalue', [real(value, wp), aimag(value)])
            call json%add('cause', cause_name(it%spectrum%cause(i)))
            call json%add('error', it%spectrum%error(i))
            call json%add('frequency', it%spectrum%frequency(i))
            call json%add('natural_frequency', it%spectrum%natural_frequency(i))
            call json%add('damping_ratio', it%spectrum%damping_ratio(i))
            if (it%spectrum%cause(i) == of_motion) then
                call json%begin_object('shape')
                do k = 1, size(it%q)
                    associate (entry => it%spectrum%shapes(k, i))
                        call json%add(scene%model%coordinate_label(k), [real(entry, wp), aimag(entry)])
                    end associate
                end do
                call json%end_object()
            end if
            call json%end_object()
        end associate
    end subroutine add_mode

    !> Add the symmetries, and the rates of the steady motion.
    subroutine add_motions(json, it)
        type(json_type), intent(inout) :: json
        type(linearisation_type), intent(in) :: it
        integer :: k

        call json%begin_array('symmetries')
        do k = 1, size(it%symmetry%rates, 2)
            call json%add('', it%symmetry%name_of(it%symmetry%rates(:, k)))
        end do
        call json%end_array()
        call json%begin_object('steady')
        do k = 1, size(it%rates)
            if (abs(it%rates(k)) > 0.0_wp) call json%add(trim(it%symmetry%motions(k)%name), it%rates(k))
        end do
        call json%end_object()
    end subroutine add_motions

    !> Add complex numbers as pairs [re, im].
    subroutine add_pairs(json, name, values)
        type(json_type), intent(inout) :: json
        character(len=*), intent(in) :: name
        complex(wp), intent(in) :: values(:)
        integer :: i

        call json%begin_array(name)
        do i = 1, size(values)
            call json%add('', [real(values(i), wp), aimag(values(i))])
        end do
        call json%end_array()
    end subroutine add_pairs

    !> Add a matrix, row by row.
    subroutine add_matrix(json, name, matrix)
        type(json_type), intent(inout) :: json
        character(len=*), intent(in) :: name
        real(wp), intent(in) :: matrix(:, :)
        integer :: i

        call json%begin_array(name)
        do i = 1, size(matrix, 1)
            call json%add('', matrix(i, :))
        end do
        call json%end_array()
    end subroutine add_matrix
end module tandem_cli_linearisation_json
