! SPDX-License-Identifier: MIT
!> Lines of a complete description, which contains every key once, with its value or default.
module tandem_mechanism_shown
    use tandem_mechanism_entries, only: value_type
    implicit none (type, external)
    private

    public :: shown_type

    !> Line of a complete description: a key with its value and comment, or a comment only.
    type :: shown_type
        !> Such as `body.rod` and `mass`. A repeated element is listed once, under its name with braces. A comment has no key.
        character(len=:), allocatable :: table, key
        !> Index among several tables with the same name; 0 for a single table.
        integer :: element = 0
        type(value_type) :: value
        !> True if the number is an integer.
        logical :: is_whole = .false.
        !> Unit and meaning; unit only.
        character(len=:), allocatable :: comment, unit
        !> Source of the value, -1 for a default.
        integer :: source = -1
        !> True if other keys replace this one.
        logical :: is_hidden = .false.
    end type shown_type
end module tandem_mechanism_shown
