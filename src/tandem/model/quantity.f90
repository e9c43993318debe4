! SPDX-License-Identifier: MIT
!> Quantities of a motion that a model provides in addition to its coordinates, for files and events.
module tandem_model_quantity
    implicit none (type, external)
    private

    public :: quantity_type, label_length

    !> Length of the names of coordinates, units and constraint rows.
    integer, parameter :: label_length = 96

    !> A quantity of the motion other than a coordinate.
    type :: quantity_type
        !> Path `NAME/WHAT` in files.
        character(len=label_length + 16) :: path = ''
        !> Number of components, 0 for a scalar.
        integer :: width = 0
        !> Unit and meaning.
        character(len=label_length) :: unit = ''
        character(len=80) :: meaning = ''
        !> Group of files, blank if none.
        character(len=16) :: group = 'sensors'
        !> Bodies of a force, where the first acts on the second; names of components that redundant constraints leave undetermined.
        character(len=label_length) :: between(2) = '', undetermined = ''
        !> True if the quantity depends on multipliers; true if a state without accelerations and history determines it.
        logical :: of_multipliers = .false., of_state = .true.
    contains
        procedure :: place
    end type quantity_type

contains

    !> Length of the path in files.
    pure integer function place_length(self)
        class(quantity_type), intent(in) :: self

        place_length = 1 + len_trim(self%group) + merge(1, 0, self%group /= '') + len_trim(self%path)
    end function place_length

    !> Path in files: /GROUP/NAME/WHAT.
    pure function place(self)
        class(quantity_type), intent(in) :: self
        character(len=place_length(self)) :: place

        place = '/'//trim(self%group)//merge('/', ' ', self%group /= '')
        place = trim(place)//trim(self%path)
    end function place
end module tandem_model_quantity
