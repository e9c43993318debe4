! SPDX-License-Identifier: MIT
!> The settings that carry the inputs of a case to its scene: `table.key=value` as on the command line. Elements of one list share
!> one.
module tandem_io_sweep_carriers
    use tandem, only: atom_type, is_text, is_truth, long, wp
    use tandem_io_scene_text, only: to_toml
    use tandem_io_sweep_plan, only: plan_type
    implicit none (type, external)
    private

    public :: settings_of_case, joined, with_element, atom_to_toml, count_elements_of

    !> Room for a value that is longer than the typical one.
    integer, parameter :: longest = 4200

contains

    !> All settings of a case, beginning with the settings of the sweep's file.
    function settings_of_case(plan, case) result(settings)
        type(plan_type), intent(in) :: plan
        integer(long), intent(in) :: case
        character(len=:), allocatable :: settings(:)
        character(len=:), allocatable :: carrier
        character(len=len(plan%carriers) + longest) :: carriers(size(plan%carriers))
        real(wp) :: numbers(size(plan%inputs))
        integer :: i

        call plan%numbers_of(case, numbers)
        carriers = plan%carriers
        do i = 1, size(plan%inputs)
            associate (input => plan%inputs(i))
                carrier = trim(carriers(input%setting))
                if (input%element == 0) then
                    carrier = input%path//'='//atom_to_toml(plan%atom_of(i, numbers(i)), is_integer(carrier))
                else
                    carrier = with_element(carrier, input%element, atom_to_toml(plan%atom_of(i, numbers(i)), .false.))
                end if
                carriers(input%setting) = carrier
            end associate
        end do
        settings = joined(plan%settings, carriers)
    end function settings_of_case

    !> Two lists of texts, one after the other.
    pure function joined(first, second) result(all)
        character(len=*), intent(in) :: first(:), second(:)
        character(len=max(len(first), len(second))) :: all(size(first) + size(second))

        all(:size(first)) = first
        all(size(first) + 1:) = second
    end function joined

    !> A value as TOML.
    function atom_to_toml(atom, as_integer) result(text)
        type(atom_type), intent(in) :: atom
        !> True to write a whole number without a point.
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

    !> True if a setting gives an integer.
    pure logical function is_integer(setting)
        character(len=*), intent(in) :: setting

        is_integer = verify(setting(index(setting, '=') + 1:), '+-0123456789 ') == 0
    end function is_integer

    !> A setting `path=[...]` of numbers with another value at an element.
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

    !> Number of elements of a list of numbers; 0 if the text is not such a list.
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
