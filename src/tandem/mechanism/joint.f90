! SPDX-License-Identifier: MIT
!> The joint primitive: a frame on each body, which coincide in the reference configuration, and for each of its six freedoms (in
!> the plane three) free or constrained. The table of this module lists the constrained freedoms of each kind of joint, and the
!> freedom that a motion may drive.
!>
!> In space the freedoms are the displacements along x1, y1, z1 and the rotations about x, y, z. Rotations are constrained by
!> directions a1.b2 = 0: two constrained rotations leave the third axis common, one constrained rotation about z keeps x1 and y2
!> perpendicular (a universal joint). In the plane they are the displacements along x1 and y1 and the angle.
module tandem_mechanism_joint
    use tandem_kinds, only: wp
    implicit none (type, external)
    private

    public :: kind_type, joint_type, placed_joint_type, find_kind, kind_names, name_length, free

    !> Length of the names of bodies, points and other elements.
    integer, parameter :: name_length = 64
    !> Entry of a free freedom in the table of kinds.
    logical, parameter :: free = .false.

    !> Freedoms of a kind of joint.
    type :: kind_type
        character(len=16) :: name
        !> True for each constrained freedom, six in space, three in the plane.
        logical :: held(6)
        !> Freedom that a motion drives; 0 if none.
        integer :: driven
        !> True if an axis is required.
        logical :: has_axis
    end type kind_type

    !> A joint, as used after the definition.
    type :: joint_type
        character(len=name_length) :: name = ''
        !> Name of its kind.
        character(len=16) :: kind_name = ''
        !> Bodies, 0 for the ground, the joint's point on each in the frame of that body, and its axes on the first in columns.
        integer :: first = 0, second = 0
        real(wp) :: s1(3) = 0.0_wp, s2(3) = 0.0_wp, axes1(3, 3) = 0.0_wp
        !> Its rows of C at position level.
        integer :: row = 0, n_rows = 0
        !> Indices of its coordinates: the angle about its axis and the displacement along it, 0 if none.
        integer :: rotation = 0, displacement = 0
        !> Indices of the successive angles of a universal joint or a gimbal, 0 if none.
        integer :: angles(3) = 0
        !> Freedom that a function of time drives at position level, 0 if none, and index of the function.
        integer :: driven = 0, motion = 0
    end type joint_type

    !> A joint during the definition.
    type, extends(joint_type) :: placed_joint_type
        type(kind_type) :: kind
        !> Axes on the second body.
        real(wp) :: axes2(3, 3) = 0.0_wp
        !> Freedoms constrained at velocity level.
        logical :: at_velocity_level(6) = .false.
        !> True if its sides may be apart in the reference configuration.
        logical :: may_be_open = .false.
    end type placed_joint_type

    logical, parameter :: o = .true.
    type(kind_type), parameter :: in_space(12) = [ &
        kind_type('fixed', [o, o, o, o, o, o], 0, .false.), &
        kind_type('revolute', [o, o, o, o, o, free], 6, .true.), &
        kind_type('prismatic', [o, o, free, o, o, o], 3, .true.), &
        kind_type('cylindrical', [o, o, free, o, o, free], 0, .true.), &
        kind_type('spherical', [o, o, o, free, free, free], 0, .false.), &
        kind_type('universal', [o, o, o, free, free, o], 0, .true.), &
        kind_type('gimbal', [o, o, o, free, free, free], 0, .true.), &
        kind_type('screw', [o, o, free, o, o, free], 0, .true.), &
        kind_type('primitive', free, 0, .false.), &
        kind_type('planar', [free, free, o, o, o, free], 0, .true.), &
        kind_type('point_on_line', [o, o, free, free, free, free], 3, .true.), &
        kind_type('point_on_plane', [free, free, o, free, free, free], 0, .true.)]
    type(kind_type), parameter :: in_plane(5) = [ &
        kind_type('fixed', [o, o, o, free, free, free], 0, .false.), &
        kind_type('revolute', [o, o, free, free, free, free], 3, .false.), &
        kind_type('prismatic', [free, o, o, free, free, free], 1, .true.), &
        kind_type('point_on_line', [free, o, free, free, free, free], 1, .true.), &
        kind_type('primitive', free, 0, .false.)]

contains

    !> Kind of a name; its own name is empty if there is no such kind.
    pure function find_kind(name, planar) result(kind)
        character(len=*), intent(in) :: name
        logical, intent(in) :: planar
        type(kind_type) :: kind
        integer :: i

        kind = kind_type('', free, 0, .false.)
        if (planar) then
            do i = 1, size(in_plane)
                if (in_plane(i)%name == name) kind = in_plane(i)
            end do
        else
            do i = 1, size(in_space)
                if (in_space(i)%name == name) kind = in_space(i)
            end do
        end if
    end function find_kind

    !> Names of all kinds, for messages.
    pure function kind_names(planar) result(names)
        logical, intent(in) :: planar
        character(len=160) :: names
        integer :: i

        names = ''
        if (planar) then
            do i = 1, size(in_plane)
                names = trim(names)//merge(',', ' ', i > 1)//' '//in_plane(i)%name
            end do
        else
            do i = 1, size(in_space)
                names = trim(names)//merge(',', ' ', i > 1)//' '//in_space(i)%name
            end do
        end if
        names = adjustl(names)
    end function kind_names
end module tandem_mechanism_joint
