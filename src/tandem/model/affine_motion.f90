! SPDX-License-Identifier: MIT
!> Motions of all coordinates together: the vector field q' = L q + c with few nonzero entries. Translations are constant fields.
!> Rotations act linearly on positions and on Euler parameters.
!>
!> A model lists such fields (`list_motions`). The analysis finds those fields, and sums of them, that leave the equations of motion
!> invariant.
module tandem_model_affine_motion
    use tandem_kinds, only: wp
    implicit none (type, external)
    private

    public :: affine_motion_type, motion_name_length

    !> Length of the name of a motion, which may contain the names of two coordinates.
    integer, parameter :: motion_name_length = 196

    type :: affine_motion_type
        !> Name in messages and results.
        character(len=motion_name_length) :: name = ''
        !> True for a rotation of the whole system about a world axis, false for a rotation of one body about a body axis.
        logical :: turns_world = .false.
        !> Nonzero entries of L: row, column, value.
        integer, allocatable :: row(:), column(:)
        real(wp), allocatable :: entry(:)
        !> Nonzero entries of c: index, value.
        integer, allocatable :: place(:)
        real(wp), allocatable :: constant(:)
    contains
        procedure :: initialize, add_entry, add_constant, add_field, add_turned
    end type affine_motion_type

contains

    !> Construct a field without entries.
    pure subroutine initialize(self, name, turns_world)
        class(affine_motion_type), intent(inout) :: self
        character(len=*), intent(in) :: name
        logical, intent(in) :: turns_world

        self%name = name
        self%turns_world = turns_world
        self%row = [integer ::]
        self%column = [integer ::]
        self%place = [integer ::]
        self%entry = [real(wp) ::]
        self%constant = [real(wp) ::]
    end subroutine initialize

    !> Add an entry of L; a zero is omitted.
    pure subroutine add_entry(self, row, column, value)
        class(affine_motion_type), intent(inout) :: self
        integer, intent(in) :: row, column
        real(wp), intent(in) :: value

        if (.not. abs(value) > 0.0_wp) return
        self%row = [self%row, row]
        self%column = [self%column, column]
        self%entry = [self%entry, value]
    end subroutine add_entry

    !> Add an entry of c; a zero is omitted.
    pure subroutine add_constant(self, place, value)
        class(affine_motion_type), intent(inout) :: self
        integer, intent(in) :: place
        real(wp), intent(in) :: value

        if (.not. abs(value) > 0.0_wp) return
        self%place = [self%place, place]
        self%constant = [self%constant, value]
    end subroutine add_constant

    !> y := y + factor (L q + c).
    pure subroutine add_field(self, q, factor, y)
        class(affine_motion_type), intent(in) :: self
        !> Coordinates (n).
        real(wp), intent(in) :: q(:), factor
        real(wp), intent(inout) :: y(:)
        integer :: i

        call self%add_turned(q, factor, y)
        do i = 1, size(self%place)
            y(self%place(i)) = y(self%place(i)) + factor*self%constant(i)
        end do
    end subroutine add_field

    !> y := y + factor L x.
    pure subroutine add_turned(self, x, factor, y)
        class(affine_motion_type), intent(in) :: self
        !> Vector (n).
        real(wp), intent(in) :: x(:), factor
        real(wp), intent(inout) :: y(:)
        integer :: i

        do i = 1, size(self%row)
            y(self%row(i)) = y(self%row(i)) + factor*self%entry(i)*x(self%column(i))
        end do
    end subroutine add_turned
end module tandem_model_affine_motion
