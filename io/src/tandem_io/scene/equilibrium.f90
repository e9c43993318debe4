! SPDX-License-Identifier: MIT
!> Reads the keys of [initial] that request an equilibrium or a steady motion, and moves the start there.
module tandem_io_scene_equilibrium
    use tandem, only: affine_motion_type, any_motion, assemble, assembly_type, error_type, find_steady_from_words, &
        list_motions, model_type, motion_name_length, reader_type, equilibrium_search_type, wp
    implicit none (type, external)
    private

    public :: read_equilibrium, move_to_equilibrium, any_motion

contains

    !> Read the keys from the open table.
    subroutine read_equilibrium(reader, model, is_equilibrium, steady)
        class(reader_type), intent(inout) :: reader
        !> The model, defined.
        class(model_type), intent(inout) :: model
        !> True if the start is to be an equilibrium; motions of a steady motion, NAME or NAME=RATE, empty if it is not requested.
        logical, intent(out) :: is_equilibrium
        character(len=motion_name_length), allocatable, intent(out) :: steady(:)
        type(affine_motion_type), allocatable :: motions(:)
        character(len=motion_name_length), allocatable :: choices(:)
        integer :: i, last

        is_equilibrium = .false.
        allocate (steady(0))
        if (reader%failed()) return
        call reader%get('equilibrium', is_equilibrium, 'true: start at rest in the nearest equilibrium')
        ! The list of motions takes longer than everything else for thousands of bodies.
        allocate (motions(0))
        if (reader%gives('steady')) call list_motions(model, motions)
        choices = [character(len=motion_name_length) :: any_motion, motions%name]
        do i = 1, size(motions)
            last = index(motions(i)%name, '_', back=.true.) - 1
            if (last < 1) cycle
            if (any(choices == motions(i)%name(:last))) cycle
            choices = [character(len=motion_name_length) :: choices, motions(i)%name(:last)]
        end do
        call reader%get('steady', steady, choices, 'motions along which the nearest steady motion continues; ["any"] for all; '// &
            '"NAME=RATE" prescribes a rate', may_have_values=.true.)
        do i = 1, size(steady)
            last = index(steady(i), '=')
            if (last == 0) cycle
            if (all(motions%name /= steady(i)(:last - 1))) call reader%refuse('steady', 'has "'//trim(steady(i))// &
                '": only the rate of a single motion can be prescribed')
        end do
        if (is_equilibrium .and. size(steady) > 0) call reader%refuse('steady', 'cannot be combined with equilibrium = true')
    end subroutine read_equilibrium

    !> Move the start to an equilibrium or a steady motion, after assembling it if requested.
    subroutine move_to_equilibrium(model, is_equilibrium, steady, t, q, qd, search, error, assembly)
        class(model_type), intent(inout), target :: model
        logical, intent(in) :: is_equilibrium
        character(len=*), intent(in) :: steady(:)
        real(wp), intent(in) :: t
        real(wp), intent(inout) :: q(:), qd(:)
        !> Result of the equilibrium search.
        type(equilibrium_search_type), intent(inout) :: search
        type(error_type), allocatable, intent(out) :: error
        type(assembly_type), intent(in), optional :: assembly
        type(assembly_type) :: request

        if (present(assembly)) then
            request = assembly
            call assemble(model, request, t, q, qd, error)
            if (allocated(error)) return
        end if
        if (is_equilibrium) then
            call search%find_equilibrium(model, t, q, error)
        else
            call find_steady_from_words(search, model, t, q, qd, steady, error)
        end if
        if (allocated(error)) return
        q = search%q
        qd = search%qd
    end subroutine move_to_equilibrium
end module tandem_io_scene_equilibrium
