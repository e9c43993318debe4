! SPDX-License-Identifier: MIT
!> Masses and moments of inertia of simple homogeneous shapes.
module tandem_mechanism_shape
    use tandem_kinds, only: wp
    implicit none (type, external)
    private

    public :: shape_names, shape_sizes, set_mass_of_shape

    !> Shapes and their dimensions. In the plane: bar (length, width). In space: box (edges), cylinder about z (radius, length),
    !> sphere (radius).
    character(len=8), parameter :: shape_names(4) = [character(len=8) :: 'bar', 'box', 'cylinder', 'sphere']
    integer, parameter :: shape_sizes(4) = [2, 3, 2, 1]

contains

    !> Set the inertia about the centre of mass in the axes of the shape and, if a density is given, the mass. The inertia is not
    !> allocated if there is no such shape in the plane or in space.
    subroutine set_mass_of_shape(shape, sizes, planar, density, mass, inertia)
        character(len=*), intent(in) :: shape
        !> Dimensions of the shape (m).
        real(wp), intent(in) :: sizes(:)
        logical, intent(in) :: planar
        !> Density (kg/m^3, in the plane kg/m^2).
        real(wp), intent(in), optional :: density
        real(wp), allocatable, intent(inout) :: mass
        real(wp), allocatable, intent(out) :: inertia(:)
        real(wp), parameter :: pi = acos(-1.0_wp)
        real(wp) :: volume

        if (planar .neqv. shape == 'bar') return
        associate (a => sizes**2)
            select case (shape)
            case ('bar')
                volume = product(sizes)
                inertia = [(a(1) + a(2))/12]
            case ('box')
                volume = product(sizes)
                inertia = [a(2) + a(3), a(1) + a(3), a(1) + a(2)]/12
            case ('cylinder')
                volume = pi*a(1)*sizes(2)
                inertia = [a(1)/4 + a(2)/12, a(1)/4 + a(2)/12, a(1)/2]
            case default
                volume = 4*pi*a(1)*sizes(1)/3
                inertia = [0.4_wp*a(1), 0.4_wp*a(1), 0.4_wp*a(1)]
            end select
        end associate
        if (present(density)) mass = density*volume
        inertia = mass*inertia
    end subroutine set_mass_of_shape
end module tandem_mechanism_shape
