! SPDX-License-Identifier: MIT
!> Joint types. A joint has a frame on each of two bodies; the frames coincide in the reference configuration. Each of the six
!> freedoms between them (three in the plane) is free or constrained. A table lists the constrained freedoms of each type of joint,
!> and the freedom that a motion may drive.
!>
!> In space the freedoms are the displacements along x1, y1, z1 and the rotations about x, y, z, where the indices 1 and 2 denote
!> the axes of the first and of the second frame. Rotations are constrained by perpendicular directions, a1.b2 = 0. Two constrained
!> rotations keep the third axes parallel. One constrained rotation, about z, keeps x1 and y2 perpendicular (universal joint). In
!> the plane the freedoms are the displacements along x1 and y1 and the angle.
module tandem_mechanism_joint
    use tandem_kinds, only: wp
    implicit none (type, external)
    private

    public :: kind_type, joint_type, placed_joint_type, find_kind, kind_names, name_length, free

    !> Length of the names of bodies, points and other elements.
    integer, parameter :: name_length = 64
    !> Marks an unconstrained freedom in the table.
    logical, parameter :: free = .false.

    !> Type of joint: its constrained freedoms.
    type :: kind_type
        character(len=16) :: name
        !> True for each constrained freedom: six in space, three in the plane.
        logical :: held(6)
        !> Freedom that a motion drives, 0 if none.
        integer :: driven
        !> True if the definition must specify an axis.
        logical :: has_axis
    end type kind_type

    !> Joint of the completed model.
    type :: joint_type
        character(len=name_length) :: name = ''
        !> Type of the joint, such as `revolute`.
        character(len=16) :: kind_name = ''
        !> Bodies, 0 for the ground; the point of the joint on each, in the body frame; axes on the first body, in columns.
        integer :: first = 0, second = 0
        real(wp) :: s1(3) = 0.0_wp, s2(3) = 0.0_wp, axes1(3, 3) = 0.0_wp
        !> First of its holonomic rows of C, and their number.
        integer :: row = 0, n_rows = 0
        !> Indices of its coordinates: rotation angle about its axis and displacement along its axis, 0 if none.
        integer :: rotation = 0, displacement = 0
        !> Indices of the successive angles of a universal joint or a gimbal, 0 if none.
        integer :: angles(3) = 0
        !> Freedom that a function of time drives by a holonomic row, 0 if none; index of the function.
        integer :: driven = 0, motion = 0
    end type joint_type

    !> Joint during the definition, with data that the completed model does not need.
    type, extends(joint_type) :: placed_joint_type
        type(kind_type) :: kind
        !> Axes on the second body, in columns.
        real(wp) :: axes2(3, 3) = 0.0_wp
        !> True for freedoms constrained by velocity-level rows.
        logical :: at_velocity_level(6) = .false.
        !> True if the two points of the joint need not coincide in the reference configuration.
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

    !> Type of joint with a name; the result has an empty name if there is none.
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

    !> Names of all types of joints, for messages.
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
