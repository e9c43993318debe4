! SPDX-License-Identifier: MIT
!> Reader procedures for sweeps: lists of any length, and values that change from case to case.
submodule(tandem_io_scene_reader) tandem_io_scene_reader_lists
    use tandem, only: is_text, is_truth
    use tandem_io_scene_flattening, only: convert_value
    use tomlf, only: toml_array, toml_keyval
    use tomlf_constants, only: tfi, toml_type
    implicit none (type, external)

contains

    module procedure get_list
        class(toml_value), pointer :: found
        character(len=:), allocatable :: problem
        integer :: source

        if (allocated(values)) deallocate (values)
        call self%find(key, found, source)
        if (.not. associated(found)) then
            call self%propose(key)
            return
        end if
        allocate (values)
        call convert_value(self%sources(source), found, values, problem)
        if (problem == '' .and. values%row_length > 0) problem = 'must not have lists in it'
        if (problem == '' .and. .not. values%is_list) problem = 'must be a list, as in [1.0, 2.0]'
        if (problem /= '') then
            call self%refuse_value(key, found, source, problem)
            deallocate (values)
            return
        end if
        call self%propose(key)
    end procedure get_list

    module procedure change
        class(toml_value), pointer :: found, member
        type(toml_key), allocatable :: names(:)

        ! A setting is one key in tables that hold nothing else.
        found => null()
        allocate (names(0))
        call self%sources(setting)%root%get_keys(names)
        call self%sources(setting)%root%get(names(1)%key, found)
        do
            select type (found)
            type is (toml_table)
                call found%get_keys(names)
                call found%get(names(1)%key, member)
            type is (toml_array)
                if (element == 0) exit
                call found%get(element, member)
            class default
                exit
            end select
            if (.not. associated(member)) return
            found => member
        end do
        select type (found)
        type is (toml_keyval)
            if (atom%kind == is_text) then
                call found%set(atom%text)
            else if (atom%kind == is_truth) then
                call found%set(atom%truth)
            else if (found%get_type() == toml_type%int .and. is_whole(atom%number)) then
                call found%set(int(atom%number, tfi))
            else
                call found%set(atom%number)
            end if
            ! The place in the text no longer shows the value.
            found%origin_value = 0
        end select
    end procedure change

    !> True if a number is whole and exactly representable as an integer.
    pure logical function is_whole(number)
        real(wp), intent(in) :: number

        is_whole = abs(number) <= 2.0_wp**53 .and. .not. abs(number - anint(number)) > 0.0_wp
    end function is_whole

    module procedure unit_of
        unit = self%ledger%unit_of(table, key)
    end procedure unit_of

    module procedure value_of
        integer :: i

        text = self%ledger%value_of(table, key)
        do i = 1, len(text)
            if (text(i:i) == new_line('a')) text(i:i) = ' '
        end do
    end procedure value_of
end submodule tandem_io_scene_reader_lists
