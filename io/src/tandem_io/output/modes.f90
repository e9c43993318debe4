! SPDX-License-Identifier: MIT
!> Motions of bodies in the modes of a linearised system, for viewers.
module tandem_io_output_modes
    use tandem, only: mechanism_type, model_type, wp
    use tandem_io_output_hdf5, only: hdf5_type
    implicit none (type, external)
    private

    public :: put_body_motions, body_motions

contains

    !> Compute the motions of the bodies in each mode (6 n_bodies, n_modes): dx, dy, dz and rotations about x, y, z of body 1, then
    !> of body 2, and so on. The result has no rows for models other than mechanisms.
    subroutine body_motions(model, q, shapes, motions)
        class(model_type), intent(in) :: model
        real(wp), intent(in) :: q(:)
        !> (n, n_modes)
        complex(wp), intent(in) :: shapes(:, :)
        complex(wp), allocatable, intent(out) :: motions(:, :)
        complex(wp), allocatable :: of_mode(:, :)
        integer :: k

        select type (model)
        class is (mechanism_type)
            allocate (motions(6*size(model%bodies), size(shapes, 2)), of_mode(6, size(model%bodies)))
            do k = 1, size(shapes, 2)
                call model%find_body_motions(q, shapes(:, k), of_mode)
                motions(:, k) = reshape(of_mode, [size(of_mode)])
            end do
        class default
            allocate (motions(0, size(shapes, 2)))
        end select
    end subroutine body_motions

    !> Write the datasets `bodies`, `motions_re` and `motions_im` of a group.
    subroutine put_body_motions(file, group, model, q, shapes)
        type(hdf5_type), intent(inout) :: file
        character(len=*), intent(in) :: group
        class(model_type), intent(in) :: model
        real(wp), intent(in) :: q(:)
        complex(wp), intent(in) :: shapes(:, :)
        complex(wp), allocatable :: motions(:, :)

        select type (model)
        class is (mechanism_type)
            call body_motions(model, q, shapes, motions)
            call file%put(group//'/bodies', model%bodies%name)
            call file%put(group//'/motions_re', transpose(real(motions, wp)))
            call file%put(group//'/motions_im', transpose(aimag(motions)))
            call file%attach(group//'/motions_re', 'meaning', &
                'of each body dx, dy, dz (m) and the rotations about x, y, z (rad), '//'real part; one mode per row')
            call file%attach(group//'/motions_im', 'meaning', 'imaginary part of the same')
        class default
            return
        end select
    end subroutine put_body_motions
end module tandem_io_output_modes
