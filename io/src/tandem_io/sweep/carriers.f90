! SPDX-License-Identifier: MIT
!> Settings that pass the inputs of a case to its scene: `table.key=value` as on the command line. Inputs that are elements of the
!> same list share a setting.
module tandem_io_sweep_carriers
    use tandem, only: atom_type, is_text, is_truth, wp
    use tandem_io_scene_text, only: to_toml
    implicit none (type, external)
    private

    public :: with_element, atom_to_toml, count_elements_of

contains

    !> Value in TOML syntax.
    function atom_to_toml(atom, as_integer) result(text)
        type(atom_type), intent(in) :: atom
        !> True to write a whole number without a decimal point.
        logical, intent(in) :: as_integer
        character(len=:), allocatable :: text

        select case (atom%kind)
        case (is_text)
            text = to_toml(atom%text)
        case (is_truth)
            text = to_toml(atom%truth)
        case default
            text = to_toml(atom%number)
            if (as_integer .and. abs(atom%number) <= huge(1) .and. .not. abs(atom%number - anint(atom%number)) > 0.0_wp) then
                text = to_toml(nint(atom%number))
            end if
        end select
    end function atom_to_toml

    !> Replace an element in a setting `path=[...]`, a list of numbers.
    pure function with_element(setting, element, value) result(text)
        character(len=*), intent(in) :: setting, value
        integer, intent(in) :: element
        character(len=:), allocatable :: text
        integer :: i, from, to

        from = index(setting, '[')
        do i = 2, element
            from = from + index(setting(from + 1:), ',')
        end do
        to = from + scan(setting(from + 1:), ',]')
        text = setting(:from)//value//setting(to:)
    end function with_element

    !> Number of elements of a list of numbers; 0 if the text is not a list of numbers.
    pure integer function count_elements_of(text) result(n)
        character(len=*), intent(in) :: text
        integer :: i

        n = 0
        if (index(text, '[') /= 1) return
        if (scan(text, '"''{') > 0) return
        if (verify(text, '[] ') == 0) return
        n = 1
        do i = 1, len(text)
            if (text(i:i) == ',') n = n + 1
        end do
    end function count_elements_of
end module tandem_io_sweep_carriers
