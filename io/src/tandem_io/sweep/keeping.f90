! SPDX-License-Identifier: MIT
!> Reads the kept quantities of a sweep: the tables [[keep]].
module tandem_io_sweep_keeping
    use tandem, only: is_number, reader_type, to_text, value_type
    use tandem_io_scene, only: scene_type
    use tandem_io_scene_source, only: set_input_error
    use tandem_io_scene_text, only: to_toml
    use tandem_io_sweep_kept, only: kept_type, of_estimate, of_figure, take_names, take_times
    use tandem_io_sweep_plan, only: no_slash, reserved_names, plan_type
    implicit none (type, external)
    private

    public :: read_kept

contains

    !> Read the tables [[keep]]. Without such a table, all coordinates at the end of the run are kept.
    subroutine read_kept(reader, scene, plan)
        type(reader_type), intent(inout) :: reader
        type(scene_type), intent(in) :: scene
        type(plan_type), intent(inout) :: plan
        character(len=:), allocatable :: problem, quantity, name, unit
        character(len=12) :: take
        integer :: i

        if (reader%failed()) return
        allocate (plan%kept(reader%n_of('keep')))
        do i = 1, size(plan%kept)
            associate (kept => plan%kept(i))
                call reader%open_table('keep', i)
                quantity = ''
                name = ''
                unit = ''
                call reader%get('quantity', quantity, required=.true.)
                call reader%get('name', name, 'of its column')
                call reader%get('unit', unit, 'unit in the table')
                take = 'end'
                if (reader%source_of('take') >= 0) then
                    call reader%get('take', take, take_names(:size(take_names) - 1))
                    kept%take = findloc(take_names, take, dim=1)
                else
                    call reader%propose('take')
                end if
                call read_times(reader, scene, kept)
                if (reader%failed()) return
                kept%quantity = trim(quantity)
                call kept%resolve(scene, problem)
                if (problem /= '') call reader%refuse(trim(merge('take    ', 'quantity', index(problem, 'take') > 0 .and. &
                    reader%source_of('take') >= 0)), problem)
                if (reader%failed()) return
                if (unit /= '') kept%unit = unit
                if (index(name, '/') > 0 .or. name == '.') call reader%refuse('name', no_slash)
                if (len_trim(name) > len(kept%name)) call reader%refuse('name', 'must not be longer than '//to_text(len(kept%name)))
                kept%name = name
                if (name == '') kept%name = default_name(kept)
                problem = name_clash(plan, i)
                if (problem /= '') call reader%refuse(trim(merge('name    ', 'quantity', name /= '')), problem)
                call reader%close_table()
            end associate
        end do
        if (reader%failed() .or. size(plan%kept) > 0) return
        deallocate (plan%kept)
        allocate (plan%kept(scene%model%n))
        do i = 1, size(plan%kept)
            plan%kept(i)%quantity = 'q:'//scene%model%coordinate_label(i)
            call plan%kept(i)%resolve(scene, problem)
            plan%kept(i)%name = default_name(plan%kept(i))
            problem = name_clash(plan, i)
            if (problem /= '') call set_input_error(reader%error, plan%path//' keeps all coordinates, one of which '//problem// &
                '; write [[keep]] for each')
        end do
    end subroutine read_kept

    !> Reason why the name of quantity i clashes with the name of another column of the table or of the comma-separated values;
    !> empty if it does not.
    function name_clash(plan, i) result(problem)
        type(plan_type), intent(in) :: plan
        !> Index of the quantity; quantities before it must have names.
        integer, intent(in) :: i
        character(len=:), allocatable :: problem
        integer :: j

        problem = ''
        associate (kept => plan%kept(i))
            do j = 1, i - 1
                if (plan%kept(j)%name == kept%name) then
                    problem = 'has the name of another, "'//trim(kept%name)//'"; give it a name'
                else if (is_name_of_times(plan%kept(j), kept%name)) then
                    problem = 'has the name "'//trim(kept%name)//'", which the times of "'//trim(plan%kept(j)%name)// &
                        '" take; give it a name'
                else if (is_name_of_times(kept, plan%kept(j)%name)) then
                    problem = 'has times, which take the name of another, "'//trim(plan%kept(j)%name)//'"; give it a name'
                end if
            end do
            if (any(plan%inputs%name == kept%name)) problem = 'has the name of an input, "'//trim(kept%name)//'"; give it a name'
            do j = 1, size(plan%inputs)
                if (is_name_of_times(kept, plan%inputs(j)%name)) problem = 'has times, which take the name of an input, "'// &
                    trim(plan%inputs(j)%name)//'"; give it a name'
            end do
            if (any(reserved_names == kept%name)) then
                problem = 'has the name "'//trim(kept%name)//'", which is reserved in the table; give it a name'
            end if
            if (plan%is_for_indices .and. kept%name == 'inputs') then
                problem = 'has the name "inputs", which is reserved in the table of indices; give it a name'
            end if
        end associate
    end function name_clash

    !> True if a name is used for the times of a quantity: by the dataset of the times, or by a column of the comma-separated
    !> values.
    pure logical function is_name_of_times(kept, name)
        type(kept_type), intent(in) :: kept
        character(len=*), intent(in) :: name

        is_name_of_times = kept%take == take_times .and. (name == trim(kept%name)//'.times' .or. &
            index(name, trim(kept%name)//'@') == 1)
    end function is_name_of_times

    !> Read the times at which a quantity is evaluated, if they are given.
    subroutine read_times(reader, scene, kept)
        type(reader_type), intent(inout) :: reader
        type(scene_type), intent(in) :: scene
        type(kept_type), intent(inout) :: kept
        type(value_type), allocatable :: times
        integer :: i

        call reader%get_list('at', times)
        if (.not. allocated(times) .or. reader%failed()) return
        if (reader%source_of('take') >= 0) call reader%refuse('at', 'defines the times; remove take')
        kept%take = take_times
        if (any(times%atoms%kind /= is_number)) then
            call reader%refuse('at', 'must be a list of times')
            return
        end if
        kept%times = times%atoms%number
        do i = 2, size(kept%times)
            if (.not. kept%times(i) > kept%times(i - 1)) call reader%refuse('at', 'must be ascending times')
        end do
        if (kept%times(1) < scene%t_start) call reader%refuse('at', 'must not begin before the start of the run, '// &
            to_toml(scene%t_start))
    end subroutine read_times

    !> Default name of a column: the quantity and the operation.
    pure function default_name(kept) result(name)
        type(kept_type), intent(in) :: kept
        character(len=len(kept%name)) :: name
        integer :: i

        name = kept%quantity
        if (name(:2) == 'q:') name = name(3:)
        if (all(kept%kind /= [of_figure, of_estimate]) .and. kept%take /= take_times) name = trim(name)//'_'//take_names(kept%take)
        if (kept%kind == of_figure) name = name(index(name, ':') + 1:)
        if (kept%kind == of_estimate) name = 'error_'//name(index(name, ':') + 1:)
        do i = 1, len_trim(name)
            if (scan(name(i:i), ':/ ') > 0) name(i:i) = '.'
        end do
    end function default_name
end module tandem_io_sweep_keeping
