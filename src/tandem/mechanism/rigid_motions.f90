! SPDX-License-Identifier: MIT
!> Rigid motions of a mechanism: of the world as a whole (`world.x`, `world.rotation_z`), and of each body about its own centre of
!> mass (`BODY.spin_y`, about the body's axis y). Those that leave the equations invariant give steady motions.
module tandem_mechanism_rigid_motions
    use tandem_kinds, only: wp
    use tandem_mechanism_body, only: body_type
    use tandem_mechanism_pose, only: pose_type
    use tandem_model_affine_motion, only: affine_motion_type
    implicit none (type, external)
    private

    public :: list_rigid_motions

    character(len=1), parameter :: axis_name(3) = ['x', 'y', 'z']

contains

    !> All of them.
    pure subroutine list_rigid_motions(planar, bodies, pose, motions)
        logical, intent(in) :: planar
        type(body_type), intent(in) :: bodies(:)
        !> Poses of the bodies, whose coordinates are numbered; 0 is the ground.
        type(pose_type), intent(in) :: pose(0:)
        type(affine_motion_type), allocatable, intent(out) :: motions(:)
        integer :: first, i, k, n, n_axes

        n_axes = merge(2, 3, planar)
        first = merge(3, 1, planar)
        ! Set each motion in place: gfortran 12 leaks components of such objects in an array constructor.
        allocate (motions(n_axes + (4 - first)*(1 + count(pose(1:size(bodies))%n_turn > 0))))
        n = 0
        do k = 1, n_axes
            n = n + 1
            call translation(k, pose, motions(n))
        end do
        do k = first, 3
            n = n + 1
            call rotation_of_world(planar, k, pose, motions(n))
        end do
        do i = 1, size(bodies)
            if (pose(i)%n_turn == 0) cycle
            do k = first, 3
                n = n + 1
                call spin(trim(bodies(i)%name), planar, k, pose(i), motions(n))
            end do
        end do
    end subroutine list_rigid_motions

    !> Translation of all bodies along an axis of the world.
    pure subroutine translation(k, pose, motion)
        integer, intent(in) :: k
        type(pose_type), intent(in) :: pose(0:)
        type(affine_motion_type), intent(inout) :: motion
        integer :: i

        call motion%initialize('world.'//axis_name(k), .false.)
        do i = 1, ubound(pose, 1)
            call motion%add_constant(pose(i)%place + k - 1, 1.0_wp)
        end do
    end subroutine translation

    !> Rotation of all bodies about an axis of the world through its origin.
    pure subroutine rotation_of_world(planar, k, pose, motion)
        logical, intent(in) :: planar
        integer, intent(in) :: k
        type(pose_type), intent(in) :: pose(0:)
        type(affine_motion_type), intent(inout) :: motion
        integer :: i, a, b

        if (planar) then
            call motion%initialize('world.rotation', .true.)
        else
            call motion%initialize('world.rotation_'//axis_name(k), .true.)
        end if
        a = modulo(k, 3)
        b = modulo(k + 1, 3)
        do i = 1, ubound(pose, 1)
            ! omega x r about axis k: axis k + 1 moves along k + 2, and axis k + 2 against k + 1.
            call motion%add_entry(pose(i)%place + b, pose(i)%place + a, 1.0_wp)
            call motion%add_entry(pose(i)%place + a, pose(i)%place + b, -1.0_wp)
            if (pose(i)%n_turn == 1) call motion%add_constant(pose(i)%turn, 1.0_wp)
            if (pose(i)%n_turn == 4) call add_turn(motion, pose(i)%turn, k, 1.0_wp)
        end do
    end subroutine rotation_of_world

    !> Rotation of a body about one of its axes through its centre of mass.
    pure subroutine spin(name, planar, k, pose, motion)
        character(len=*), intent(in) :: name
        logical, intent(in) :: planar
        integer, intent(in) :: k
        type(pose_type), intent(in) :: pose
        type(affine_motion_type), intent(inout) :: motion

        if (planar) then
            call motion%initialize(name//'.spin', .false.)
            call motion%add_constant(pose%turn, 1.0_wp)
        else
            call motion%initialize(name//'.spin_'//axis_name(k), .false.)
            call add_turn(motion, pose%turn, k, -1.0_wp)
        end if
    end subroutine spin

    !> pd = E(p)' omega / 2 for an axis of the world (side 1), G(p)' omega / 2 for one of the body (side -1): both are linear in p.
    pure subroutine add_turn(motion, turn, k, side)
        type(affine_motion_type), intent(inout) :: motion
        !> First of the Euler parameters.
        integer, intent(in) :: turn, k
        real(wp), intent(in) :: side
        real(wp), parameter :: half = 0.5_wp
        integer :: a, b

        a = turn + 1 + modulo(k, 3)
        b = turn + 1 + modulo(k + 1, 3)
        call motion%add_entry(turn, turn + k, -half)
        call motion%add_entry(turn + k, turn, half)
        call motion%add_entry(b, a, side*half)
        call motion%add_entry(a, b, -side*half)
    end subroutine add_turn
end module tandem_mechanism_rigid_motions
