! SPDX-License-Identifier: MIT
!> Reads the keys of [initial] that specify the assembly of the start.
module tandem_io_scene_assembly
    use tandem, only: assembly_type, label_length, model_type, not_negative, positive, reader_type, velocity_metrics, wp
    implicit none (type, external)
    private

    public :: read_assembly

    !> Keys that require `assemble`.
    character(len=21), parameter :: details(7) = [character(len=21) :: 'fixed', 'fixed_velocities', 'weights', &
        'velocity_weights', 'velocity_metric', 'largest_move', 'largest_velocity_move']

contains

    !> Read the keys from the open table. The details appear in the complete scene only if the start is assembled.
    subroutine read_assembly(reader, model, assembly)
        class(reader_type), intent(inout) :: reader
        !> The model, defined.
        class(model_type), intent(in) :: model
        !> Settings for the assembly; not allocated if the start is not assembled.
        type(assembly_type), allocatable, intent(out) :: assembly
        logical :: assembles
        integer :: i

        if (reader%failed()) return
        assembles = .false.
        call reader%get('assemble', assembles, 'true: move the start to the nearest consistent state')
        if (assembles) then
            allocate (assembly)
            call read_details(reader, model, assembly)
            return
        end if
        do i = 1, size(details)
            call reader%propose(trim(details(i)))
            if (reader%source_of(trim(details(i))) >= 0) call reader%refuse(trim(details(i)), 'needs assemble = true')
        end do
    end subroutine read_assembly

    !> Read the fixed coordinates, the weights of the others, and the largest corrections.
    subroutine read_details(reader, model, assembly)
        class(reader_type), intent(inout) :: reader
        class(model_type), intent(in) :: model
        type(assembly_type), intent(inout) :: assembly
        character(len=label_length) :: names(model%n)
        character(len=label_length), allocatable :: fixed(:)
        real(wp), allocatable :: weights(:)
        integer :: i

        names = [character(len=label_length) :: (model%coordinate_label(i), i=1, model%n)]
        allocate (fixed(0))
        call reader%get('fixed', fixed, names, 'coordinates that keep their values')
        assembly%fixed_q = [(any(fixed == names(i)), i=1, model%n)]
        deallocate (fixed)
        allocate (fixed(0))
        call reader%get('fixed_velocities', fixed, names, 'coordinates whose velocities keep their values')
        assembly%fixed_qd = [(any(fixed == names(i)), i=1, model%n)]
        weights = spread(1.0_wp, 1, model%n)
        if (allocated(model%coordinate_scale)) then
            weights = max(tiny(1.0_wp), min(huge(1.0_wp), (1.0_wp/model%coordinate_scale)**2))
        end if
        assembly%weight_q = weights
        assembly%weight_qd = weights
        call reader%get_numbers('weights', [model%n], assembly%weight_q, positive, &
            help='of the coordinates; a large weight means a small displacement')
        call reader%get_numbers('velocity_weights', [model%n], assembly%weight_qd, positive, &
            help='of the velocities, for directions without mass')
        call reader%get('velocity_metric', assembly%velocity_metric, velocity_metrics, 'norm of the change of velocities')
        call reader%get('largest_move', assembly%largest_move_q, not_negative, &
            help='of a coordinate, in units of its scale; 0 for no limit')
        call reader%get('largest_velocity_move', assembly%largest_move_qd, not_negative, help='of a velocity, likewise')
    end subroutine read_details
end module tandem_io_scene_assembly
