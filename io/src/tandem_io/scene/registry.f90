! SPDX-License-Identifier: MIT
!> The models that a scene may name. A new model is one file beside this one and one line in `builders`.
module tandem_io_scene_registry
    use tandem, only: model_type, wp
    use tandem_io_scene_articulated_vehicle, only: build_articulated_vehicle
    use tandem_io_scene_ledger, only: key_length
    use tandem_io_scene_motorcycle, only: build_motorcycle
    use tandem_io_scene_reader, only: reader_type
    use tandem_io_scene_rolling_disk, only: build_rolling_disk
    implicit none (type, external)
    private

    public :: model_names, build_model

    abstract interface
        !> Read [model] and what the model has in [initial]; the latter table stays open. Errors stay in the reader.
        subroutine build_interface(reader, model, q, qd)
            import :: reader_type, model_type, wp
            implicit none (type, external)
            class(reader_type), intent(inout) :: reader
            !> The model, defined; not allocated where the reader has failed.
            class(model_type), allocatable, intent(out) :: model
            !> Coordinates and velocities at the start (n).
            real(wp), allocatable, intent(out) :: q(:), qd(:)
        end subroutine build_interface
    end interface

    !> A name and what builds it.
    type :: builder_type
        character(len=key_length) :: name
        procedure(build_interface), pointer, nopass :: build
    end type builder_type

contains

    !> The models.
    function builders() result(list)
        type(builder_type), allocatable :: list(:)

        list = [ &
            builder_type('articulated_vehicle', build_articulated_vehicle), &
            builder_type('motorcycle', build_motorcycle), &
            builder_type('rolling_disk', build_rolling_disk)]
    end function builders

    !> Every name that `build_model` knows.
    function model_names() result(names)
        character(len=key_length), allocatable :: names(:)
        type(builder_type), allocatable :: list(:)

        allocate (list, source=builders())
        names = list%name
    end function model_names

    !> Build the model of a name; see `build_interface`.
    subroutine build_model(name, reader, model, q, qd)
        !> One of `model_names`.
        character(len=*), intent(in) :: name
        class(reader_type), intent(inout) :: reader
        class(model_type), allocatable, intent(out) :: model
        real(wp), allocatable, intent(out) :: q(:), qd(:)
        type(builder_type), allocatable :: list(:)
        integer :: i

        allocate (list, source=builders())
        do i = 1, size(list)
            if (list(i)%name == name) call list(i)%build(reader, model, q, qd)
        end do
    end subroutine build_model
end module tandem_io_scene_registry
