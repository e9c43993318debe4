! SPDX-License-Identifier: MIT
!> Quantities that a model can tell of a motion besides its coordinates, for files and events.
module tandem_model_quantity
    implicit none (type, external)
    private

    public :: quantity_type, label_length

    !> Length of a coordinate's, unit's or constraint row's name.
    integer, parameter :: label_length = 96

    !> Something that a model can tell of a motion besides its coordinates.
    type :: quantity_type
        !> `NAME/WHAT`, as files call it.
        character(len=label_length + 16) :: path = ''
        !> How many numbers it has, 0 for a single one.
        integer :: width = 0
        !> Its unit, and what it is.
        character(len=label_length) :: unit = ''
        character(len=80) :: meaning = ''
        !> The group of files that it stands in, none where it is blank.
        character(len=16) :: group = 'sensors'
        !> What a force acts between: the first on the second; and its entries that redundant constraints leave undetermined.
        character(len=label_length) :: between(2) = '', undetermined = ''
        !> Whether it is made of multipliers, and whether it can be told at a state without accelerations and without a history.
        logical :: of_multipliers = .false., of_state = .true.
    contains
        procedure :: place
    end type quantity_type

contains

    !> The length of the path in files.
    pure integer function place_length(self)
        class(quantity_type), intent(in) :: self

        place_length = 1 + len_trim(self%group) + merge(1, 0, self%group /= '') + len_trim(self%path)
    end function place_length

    !> The path in files: /GROUP/NAME/WHAT.
    pure function place(self)
        class(quantity_type), intent(in) :: self
        character(len=place_length(self)) :: place

        place = '/'//trim(self%group)//merge('/', ' ', self%group /= '')
        place = trim(place)//trim(self%path)
    end function place
end module tandem_model_quantity
