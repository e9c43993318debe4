! SPDX-License-Identifier: MIT
!> Writes the geometry of a mechanism for viewers: the group /drawing (see doc/output.md).
module tandem_io_output_drawing
    use tandem, only: drawing_type, error_type, long, mechanism_type, model_type, set_error, take_drawing, wp
    use tandem_io_output_hdf5, only: hdf5_type
    use tandem_io_version, only: format_version, tandem_version
    use tandem_status, only: status_output_failed
    implicit none (type, external)
    private

    public :: put_drawing, renew_drawing, write_drawing

    character(len=*), parameter :: drawing_group = '/drawing'

contains

    !> Create the group in a file; models other than mechanisms have none.
    subroutine put_drawing(file, model)
        type(hdf5_type), intent(inout) :: file
        class(model_type), intent(in) :: model
        type(drawing_type) :: drawing

        select type (model)
        class is (mechanism_type)
            call take_drawing(model, drawing)
        class default
            return
        end select
        call file%add_group(drawing_group)
        call file%put(drawing_group//'/gravity', drawing%gravity)
        call file%put(drawing_group//'/body', drawing%bodies)
        call file%put(drawing_group//'/bodies', drawing%body_values)
        call file%put(drawing_group//'/kind', drawing%elements%kind)
        call file%put(drawing_group//'/name', drawing%elements%name)
        call file%put(drawing_group//'/elements', table_of(drawing))
        if (size(drawing%functions) == 0) return
        call file%put(drawing_group//'/function', drawing%functions)
        call file%put(drawing_group//'/functions', drawing%samples)
    end subroutine put_drawing

    !> Write the group again if it lists functions of time, up to the end of the run, which may have changed.
    subroutine renew_drawing(file, model)
        type(hdf5_type), intent(inout) :: file
        class(model_type), intent(in) :: model

        if (.not. file%has(drawing_group)) return
        if (.not. file%has(drawing_group//'/functions')) return
        call file%remove(drawing_group)
        call put_drawing(file, model)
    end subroutine renew_drawing

    !> Numbers of the elements: body, position, axis, sizes.
    pure function table_of(drawing) result(table)
        type(drawing_type), intent(in) :: drawing
        real(wp) :: table(size(drawing%elements), 10)
        integer :: i

        do i = 1, size(drawing%elements)
            associate (it => drawing%elements(i))
                table(i, :) = [real(it%body, wp), it%position, it%axis, it%sizes]
            end associate
        end do
    end function table_of

    !> Write a file that contains the drawing only; an existing file is overwritten.
    subroutine write_drawing(path, scene, model, error)
        character(len=*), intent(in) :: path
        !> The complete scene as text.
        character(len=*), intent(in) :: scene
        class(model_type), intent(in) :: model
        type(error_type), allocatable, intent(out) :: error
        type(hdf5_type) :: file

        call file%create(path)
        call file%attach('/', 'format_version', int(format_version, long))
        call file%attach('/', 'tandem_version', tandem_version)
        call file%attach('/', 'study', 'drawing')
        call file%attach('/', 'scene', scene)
        call put_drawing(file, model)
        call file%close()
        if (allocated(file%problem)) call set_error(error, status_output_failed, path//': '//file%problem)
    end subroutine write_drawing
end module tandem_io_output_drawing
