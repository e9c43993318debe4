! SPDX-License-Identifier: MIT
!> Lines of a complete description, in which each key occurs once, with its value or default.
module tandem_mechanism_shown
    use tandem_mechanism_entries, only: value_type
    implicit none (type, external)
    private

    public :: shown_type

    !> A key with its value and a comment, or a comment alone.
    type :: shown_type
        !> Such as `body.rod`, and `mass`; a repeated element is listed under its template. A comment has no key.
        character(len=:), allocatable :: table, key
        !> Number of the table among several tables of its name; 0 for a single table.
        integer :: element = 0
        type(value_type) :: value
        !> True if the number is an integer.
        logical :: is_whole = .false.
        !> Unit and meaning; unit alone.
        character(len=:), allocatable :: comment, unit
        !> Source of the value, -1 for a default.
        integer :: source = -1
        !> True if others replace the key.
        logical :: is_hidden = .false.
    end type shown_type
end module tandem_mechanism_shown
