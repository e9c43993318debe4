! SPDX-License-Identifier: MIT
!> Plane on which a body rolls, and its motion.
module tandem_mechanism_plane
    use tandem_kinds, only: wp
    use tandem_mechanism_function, only: function_type
    implicit none (type, external)
    private

    public :: plane_type

    !> A plane, by default z = 0 at rest.
    type :: plane_type
        !> Normal on the side of the body, by default z.
        real(wp), allocatable :: normal(:)
        !> Distance from the origin along the normal (m).
        real(wp) :: height = 0.0_wp
        !> True if the body may be off the plane in the reference configuration.
        logical :: open = .false.
        !> Functions of time: displacement along the normal (m), rotation about the normal (rad), displacement along a direction in
        !> the plane (m), which also moves the pivot.
        class(function_type), allocatable :: rise, rotation, slide
        !> Point of the rotation (m), by default the origin, and direction of the displacement.
        real(wp), allocatable :: pivot(:), along(:)
    end type plane_type

    interface plane_type
        module procedure new_plane
    end interface plane_type

contains

    !> A plane with given properties, as described above.
    function new_plane(normal, height, open, rise, rotation, pivot, slide, along) result(plane)
        real(wp), intent(in), optional :: normal(:), height
        logical, intent(in), optional :: open
        class(function_type), intent(in), optional :: rise, rotation, slide
        real(wp), intent(in), optional :: pivot(:), along(:)
        type(plane_type) :: plane

        if (present(normal)) allocate (plane%normal, source=normal)
        if (present(height)) plane%height = height
        if (present(open)) plane%open = open
        if (present(rise)) allocate (plane%rise, source=rise)
        if (present(rotation)) allocate (plane%rotation, source=rotation)
        if (present(pivot)) allocate (plane%pivot, source=pivot)
        if (present(slide)) allocate (plane%slide, source=slide)
        if (present(along)) allocate (plane%along, source=along)
    end function new_plane
end module tandem_mechanism_plane
