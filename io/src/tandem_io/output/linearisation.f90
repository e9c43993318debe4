! SPDX-License-Identifier: MIT
!> Writes a linearised system as an HDF5 file: the group /linearisation with the matrices, the eigenvalues and the modes.
module tandem_io_output_linearisation
    use tandem, only: cause_name, error_type, inputs_type, kind_name, label_length, linearisation_type, long, model_type, &
        nearest_type, set_error, wp
    use tandem_io_output_drawing, only: put_drawing
    use tandem_io_output_hdf5, only: hdf5_type
    use tandem_io_output_modes, only: put_body_motions
    use tandem_io_output_study_head, only: create_study
    use tandem_status, only: status_output_failed
    implicit none (type, external)
    private

    public :: write_linearisation, write_nearest

    character(len=*), parameter :: group = '/linearisation'

contains

    !> Write the file; an existing file is overwritten. Matrices are stored in row-major order.
    subroutine write_linearisation(path, scene, model, it, io, error)
        character(len=*), intent(in) :: path
        !> The complete scene as text.
        character(len=*), intent(in) :: scene
        class(model_type), intent(in) :: model
        type(linearisation_type), intent(in) :: it
        type(inputs_type), intent(in) :: io
        type(error_type), allocatable, intent(out) :: error
        type(hdf5_type) :: file

        call create_study(file, path, 'linearisation', scene)
        call file%add_group(group)
        call file%attach(group, 'kind', trim(kind_name(it%kind)))
        call file%attach(group, 'time', it%t)
        call file%attach(group, 'residual', it%residual)
        call file%attach(group, 'n_v', int(it%nv, long))
        call file%attach(group, 'n_w', int(it%nw, long))
        call file%put(group//'/a', it%a)
        call file%put(group//'/b', io%b)
        call file%put(group//'/c', io%c)
        call file%put(group//'/d', io%d)
        call file%put(group//'/v', it%v)
        call file%put(group//'/g', it%g)
        call file%put(group//'/w', it%w)
        call file%attach(group//'/v', 'meaning', 'dq = v dv, dqd = g dv + w dw')
        call file%put(group//'/scale', model%scales())
        call file%attach(group//'/scale', 'meaning', 'v and w are orthonormal if coordinates are divided by this')
        call file%put(group//'/q', it%q)
        call file%put(group//'/qd', it%qd)
        call put_names(file, model, it, io)
        call put_modes(file, it)
        call put_body_motions(file, group, model, it%q, it%spectrum%shapes)
        call put_drawing(file, model)
        call file%close()
        if (allocated(file%problem)) call set_error(error, status_output_failed, path//': '//file%problem)
    end subroutine write_linearisation

    !> Write the eigenvalues nearest to a shift, in order of increasing distance.
    subroutine write_nearest(path, scene, model, it, error)
        character(len=*), intent(in) :: path, scene
        class(model_type), intent(in) :: model
        type(nearest_type), intent(in) :: it
        type(error_type), allocatable, intent(out) :: error
        type(hdf5_type) :: file
        character(len=label_length) :: names(size(it%q))
        integer :: i

        call create_study(file, path, 'linearisation', scene)
        call file%add_group(group)
        call file%attach(group, 'kind', trim(merge('steady motion', 'equilibrium  ', it%frame%moves)))
        call file%attach(group, 'time', it%t)
        call file%attach(group, 'residual', it%residual)
        call file%attach(group, 'shift_re', real(it%shift, wp))
        call file%attach(group, 'shift_im', aimag(it%shift))
        do i = 1, size(names)
            names(i) = model%coordinate_label(i)
        end do
        call file%put(group//'/coordinates', names)
        call file%put(group//'/q', it%q)
        associate (values => it%values)
            call file%put(group//'/eigenvalues', reshape([real(values, wp), aimag(values)], [size(values), 2]))
            call file%attach(group//'/eigenvalues', 'unit', '1/s')
            call file%put(group//'/error', it%error)
            call file%put(group//'/frequency', abs(aimag(values))/(2*acos(-1.0_wp)))
            call file%attach(group//'/frequency', 'unit', 'Hz')
            call file%put(group//'/damping_ratio', -real(values, wp)/max(abs(values), tiny(1.0_wp)))
        end associate
        call file%put(group//'/shapes_re', transpose(real(it%shapes, wp)))
        call file%put(group//'/shapes_im', transpose(aimag(it%shapes)))
        call put_body_motions(file, group, model, it%q, it%shapes)
        call put_drawing(file, model)
        call file%close()
        if (allocated(file%problem)) call set_error(error, status_output_failed, path//': '//file%problem)
    end subroutine write_nearest

    !> Write the names of rows and columns of the matrices.
    subroutine put_names(file, model, it, io)
        type(hdf5_type), intent(inout) :: file
        class(model_type), intent(in) :: model
        type(linearisation_type), intent(in) :: it
        type(inputs_type), intent(in) :: io
        character(len=label_length) :: names(size(it%q))
        integer :: i

        do i = 1, size(names)
            names(i) = model%coordinate_label(i)
        end do
        call file%put(group//'/coordinates', names)
        call file%put(group//'/inputs', io%inputs)
        call file%put(group//'/outputs', io%outputs)
    end subroutine put_names

    !> Write the eigenvalues [re, im] and their properties. Each row of the shapes is one mode; it is zero for eigenvalues due to
    !> symmetries and families of equilibria.
    subroutine put_modes(file, it)
        type(hdf5_type), intent(inout) :: file
        type(linearisation_type), intent(in) :: it
        integer :: i

        associate (spectrum => it%spectrum, n => size(it%spectrum%values))
            call file%put(group//'/eigenvalues', reshape([real(spectrum%values, wp), aimag(spectrum%values)], [n, 2]))
            call file%attach(group//'/eigenvalues', 'unit', '1/s')
            call file%put(group//'/cause', cause_name(spectrum%cause))
            call file%put(group//'/error', spectrum%error)
            call file%put(group//'/frequency', [(spectrum%frequency(i), i=1, n)])
            call file%attach(group//'/frequency', 'unit', 'Hz')
            call file%put(group//'/damping_ratio', [(spectrum%damping_ratio(i), i=1, n)])
            call file%put(group//'/shapes_re', transpose(real(spectrum%shapes, wp)))
            call file%put(group//'/shapes_im', transpose(aimag(spectrum%shapes)))
        end associate
    end subroutine put_modes
end module tandem_io_output_linearisation
