! SPDX-License-Identifier: MIT
!> Writes the geometry of a mechanism for viewers: the group /drawing (see doc/output.md).
module tandem_io_output_drawing
    use tandem, only: drawing_type, error_type, mechanism_type, model_type, set_error, take_drawing, wp
    use tandem_io_output_hdf5, only: hdf5_type
    use tandem_io_output_study_head, only: create_study
    use tandem_status, only: status_output_failed
    implicit none (type, external)
    private

    public :: put_drawing, renew_drawing, write_drawing

    character(len=*), parameter :: drawing_group = '/drawing', samples_path = drawing_group//'/functions'

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
        call file%put(samples_path, drawing%samples)
    end subroutine put_drawing

    !> Replace the values of functions of time, which are listed up to the end of the run: it may have changed.
    subroutine renew_drawing(file, model)
        type(hdf5_type), intent(inout) :: file
        class(model_type), intent(in) :: model
        type(drawing_type) :: drawing

        if (.not. file%has(drawing_group)) return
        if (.not. file%has(samples_path)) return
        select type (model)
        class is (mechanism_type)
            call take_drawing(model, drawing)
            call file%put(samples_path, drawing%samples)
        class default
            return
        end select
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

        call create_study(file, path, 'drawing', scene)
        call put_drawing(file, model)
        call file%close()
        if (allocated(file%problem)) call set_error(error, status_output_failed, path//': '//file%problem)
    end subroutine write_drawing
end module tandem_io_output_drawing
