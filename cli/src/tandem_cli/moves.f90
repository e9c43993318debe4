! SPDX-License-Identifier: MIT
!> Description of the changes made by the assembly of a start.
module tandem_cli_moves
    use tandem, only: assembly_type, model_type, to_text, wp
    use tandem_io, only: brief
    implicit none (type, external)
    private

    public :: moves_text

    !> Largest number of coordinates whose names are printed.
    integer, parameter :: most_named = 3

contains

    !> Coordinates and velocities with the largest changes, the rows that caused the changes, and the number of iterations.
    function moves_text(model, assembly) result(text)
        class(model_type), intent(in) :: model
        !> Result of the assembly.
        type(assembly_type), intent(in) :: assembly
        character(len=:), allocatable :: text

        text = 'position '//level(model, assembly%moved_q, assembly%row_q)//', velocity '// &
            level(model, assembly%moved_qd, assembly%row_qd)//', '//to_text(assembly%iterations)//' iterations'
        if (.not. assembly%is_nearest) text = text//', perhaps not the nearest position'
    end function moves_text

    !> Changes of coordinates or velocities in decreasing order, and the row that caused most of them.
    function level(model, moved, row) result(text)
        class(model_type), intent(in) :: model
        real(wp), intent(in) :: moved(:)
        integer, intent(in) :: row
        character(len=:), allocatable :: text
        logical :: left(size(moved))
        integer :: i, j

        text = 'unmoved'
        if (row == 0) return
        text = 'moved'
        left = abs(moved) > 0.0_wp
        do i = 1, most_named
            if (.not. any(left)) exit
            j = maxloc(abs(moved), dim=1, mask=left)
            left(j) = .false.
            if (i > 1) text = text//','
            text = text//' '//model%coordinate_label(j)//' by '//brief(moved(j))
        end do
        if (any(left)) text = text//', others less'
        text = text//' (most of it for "'//model%row_name(row)//'")'
    end function level
end module tandem_cli_moves
