! SPDX-License-Identifier: MIT
!> The models that a scene may name: the shipped ones, and those added by a user's program.
module tandem_io_scene_registry
    use tandem, only: model_type, reader_type, wp
    use tandem_io_scene_articulated_vehicle, only: build_articulated_vehicle
    use tandem_io_scene_description, only: key_length
    use tandem_io_scene_mechanism, only: build_mechanism_scene, mechanism_tables
    use tandem_io_scene_motorcycle, only: build_motorcycle
    use tandem_io_scene_rolling_disk, only: build_rolling_disk
    implicit none (type, external)
    private

    public :: scene_model_type, shipped_models

    abstract interface
        !> Read [model] and the model's own keys of [initial]; the latter table stays open for the caller. On entry, [scene] is open
        !> for additional keys of the model. Errors are stored in the reader.
        subroutine build_interface(reader, model, q, qd)
            import :: reader_type, model_type, wp
            implicit none (type, external)
            class(reader_type), intent(inout) :: reader
            !> The model, defined; not allocated if the reader has failed.
            class(model_type), allocatable, intent(out) :: model
            !> Coordinates and velocities at the start (n).
            real(wp), allocatable, intent(out) :: q(:), qd(:)
        end subroutine build_interface
    end interface

    !> Name of a model in scenes, and the procedure that builds it: `scene_model_type('pendulum', build_pendulum)`.
    type :: scene_model_type
        character(len=key_length) :: name
        procedure(build_interface), pointer, nopass :: build
        !> Tables of the model in addition to those of every scene.
        character(len=key_length), allocatable :: tables(:)
    end type scene_model_type

contains

    !> Models of this package. A new model needs a file beside this one and a line in this list.
    function shipped_models() result(models)
        type(scene_model_type) :: models(4)

        models = [ &
            scene_model_type('articulated_vehicle', build_articulated_vehicle), &
            scene_model_type('mechanism', build_mechanism_scene, mechanism_tables), &
            scene_model_type('motorcycle', build_motorcycle), &
            scene_model_type('rolling_disk', build_rolling_disk)]
    end function shipped_models
end module tandem_io_scene_registry
