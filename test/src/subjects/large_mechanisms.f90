! SPDX-License-Identifier: MIT
!> Mechanisms of any number of bodies: chains in the plane and in space, four-bars side by side, a star, a net, a train, and sprung
!> chains with stiff springs and dampers along their hinges, and a chain of sliders on stiff springs.
module large_mechanisms
    use tandem, only: error_type, mechanism_type, wp
    implicit none (type, external)
    private

    public :: make_large, large_names

    character(len=14), parameter :: large_names(9) = [character(len=14) :: 'planar_chain', 'spatial_chain', 'four_bars', 'star', &
        'net', 'trailers', 'sprung_chain', 'sprung_plane', 'sliders']

contains

    !> Build one of them with about n bodies, and define it.
    subroutine make_large(name, n, mechanism, error, ratio)
        character(len=*), intent(in) :: name
        integer, intent(in) :: n
        type(mechanism_type), intent(inout) :: mechanism
        type(error_type), allocatable, intent(out) :: error
        !> For sliders: ratio of the frequency of their springs to that of a pendulum, 100 by default.
        real(wp), intent(in), optional :: ratio

        mechanism%planar = any(name == [character(len=14) :: 'planar_chain', 'four_bars', 'trailers', 'sprung_plane', &
            'sliders'])
        mechanism%gravity = [0.0_wp, 0.0_wp, -9.81_wp]
        if (mechanism%planar) mechanism%gravity = [0.0_wp, -9.81_wp, 0.0_wp]
        select case (name)
        case ('planar_chain', 'spatial_chain')
            call draw_chain(n, mechanism, error)
        case ('sprung_chain', 'sprung_plane')
            call draw_chain(n, mechanism, error)
            if (.not. allocated(error)) call add_springs(n, mechanism, error)
        case ('four_bars')
            call draw_four_bars((n - 1)/2, mechanism, error)
        case ('star')
            call draw_star(n - 1, mechanism, error)
        case ('net')
            call draw_net(nint(sqrt(real(n, wp))), mechanism, error)
        case ('sliders')
            if (present(ratio)) then
                call draw_sliders(n/2, ratio, mechanism, error)
            else
                call draw_sliders(n/2, 100.0_wp, mechanism, error)
            end if
        case default
            mechanism%gravity = 0.0_wp
            call draw_trailers(n, mechanism, error)
        end select
        if (.not. allocated(error)) call mechanism%define(error)
    end subroutine make_large

    !> A name with a number.
    function numbered(name, i) result(text)
        character(len=*), intent(in) :: name
        integer, intent(in) :: i
        character(len=16) :: text

        write (text, '(a, i0)') name, i
    end function numbered

    !> A chain of rods of 1 m and 1 kg from the ground, horizontal at the start; in space the axes of its hinges alternate.
    subroutine draw_chain(n, mechanism, error)
        integer, intent(in) :: n
        type(mechanism_type), intent(inout) :: mechanism
        type(error_type), allocatable, intent(out) :: error
        real(wp), parameter :: l = 1.0_wp, mass = 1.0_wp, inertia = mass*l**2/12
        real(wp) :: axis(3)
        character(len=16) :: last
        integer :: i

        last = 'ground'
        do i = 1, n
            if (mechanism%planar) then
                call mechanism%add_body(numbered('b', i), mass, [(i - 0.5_wp)*l, 0.0_wp], error, inertia=[inertia])
                if (.not. allocated(error)) call mechanism%add_joint(numbered('j', i), 'revolute', trim(last), &
                    numbered('b', i), error, at=[(i - 1)*l, 0.0_wp])
            else
                axis = merge([0.0_wp, 1.0_wp, 0.0_wp], [0.0_wp, 0.8_wp, 0.6_wp], mod(i, 2) == 1)
                call mechanism%add_body(numbered('b', i), mass, [(i - 0.5_wp)*l, 0.0_wp, 0.0_wp], error, &
                    inertia=[0.1_wp, 1.0_wp, 1.0_wp]*inertia)
                if (.not. allocated(error)) call mechanism%add_joint(numbered('j', i), 'revolute', trim(last), &
                    numbered('b', i), error, at=[(i - 1)*l, 0.0_wp, 0.0_wp], axis=axis)
            end if
            if (allocated(error)) return
            last = numbered('b', i)
        end do
    end subroutine draw_chain

    !> Stiff springs and dampers along the hinges of a chain, and soft ones to the next body but one.
    subroutine add_springs(n, mechanism, error)
        integer, intent(in) :: n
        type(mechanism_type), intent(inout) :: mechanism
        type(error_type), allocatable, intent(out) :: error
        integer :: i

        do i = 1, n
            call mechanism%add_torsion(numbered('s', i), numbered('j', i), error, stiffness=1.0e4_wp, damping=10.0_wp)
            if (i > 2 .and. .not. allocated(error)) call mechanism%add_spring(numbered('f', i), numbered('b', i - 2), &
                numbered('b', i), error, stiffness=100.0_wp, damping=1.0_wp)
            if (allocated(error)) return
        end do
    end subroutine add_springs

    !> Sliders of 1 kg in the plane, each on a spring with half the critical damping along a light arm of 1 m that rotates about the
    !> previous slider, horizontal at the start: pendulums on stiff springs. Stiff springs have no visible effect on the motion.
    subroutine draw_sliders(n, ratio, mechanism, error)
        integer, intent(in) :: n
        real(wp), intent(in) :: ratio
        type(mechanism_type), intent(inout) :: mechanism
        type(error_type), allocatable, intent(out) :: error
        real(wp), parameter :: mass = 1.0_wp, gravity = 9.81_wp, x(2) = [1.0_wp, 0.0_wp]
        character(len=16) :: last
        real(wp) :: stiffness
        integer :: i

        stiffness = ratio**2*mass*gravity
        last = 'ground'
        do i = 1, n
            call mechanism%add_body(numbered('a', i), 0.01_wp, (i - 0.5_wp)*x, error, inertia=[0.001_wp])
            if (.not. allocated(error)) call mechanism%add_body(numbered('s', i), mass, i*x, error, inertia=[0.01_wp])
            if (.not. allocated(error)) call mechanism%add_joint(numbered('h', i), 'revolute', trim(last), numbered('a', i), &
                error, at=(i - 1)*x)
            if (.not. allocated(error)) call mechanism%add_joint(numbered('r', i), 'prismatic', numbered('a', i), &
                numbered('s', i), error, at=i*x, axis=x)
            if (.not. allocated(error)) call mechanism%add_torsion(numbered('k', i), numbered('r', i), error, &
                stiffness=stiffness, damping=sqrt(stiffness*mass))
            if (allocated(error)) return
            last = numbered('s', i)
        end do
    end subroutine draw_sliders

    !> The problem A02 of the benchmarks of the IFToMM: n four-bars in a row.
    subroutine draw_four_bars(n, mechanism, error)
        integer, intent(in) :: n
        type(mechanism_type), intent(inout) :: mechanism
        type(error_type), allocatable, intent(out) :: error
        integer :: i

        do i = 0, n
            call mechanism%add_body(numbered('u', i), 1.0_wp, [real(i, wp), 0.5_wp], error, inertia=[1/12.0_wp], &
                velocity=[0.5_wp, 0.0_wp], omega=[-1.0_wp])
            if (.not. allocated(error)) call mechanism%add_joint(numbered('f', i), 'revolute', 'ground', numbered('u', i), error, &
                at=[real(i, wp), 0.0_wp])
            if (allocated(error)) return
        end do
        do i = 1, n
            call mechanism%add_body(numbered('c', i), 1.0_wp, [i - 0.5_wp, 1.0_wp], error, inertia=[1/12.0_wp], &
                velocity=[1.0_wp, 0.0_wp])
            if (.not. allocated(error)) call mechanism%add_joint(numbered('l', i), 'revolute', numbered('u', i - 1), &
                numbered('c', i), error, at=[i - 1.0_wp, 1.0_wp])
            if (.not. allocated(error)) call mechanism%add_joint(numbered('r', i), 'revolute', numbered('c', i), &
                numbered('u', i), error, at=[real(i, wp), 1.0_wp])
            if (allocated(error)) return
        end do
    end subroutine draw_four_bars

    !> n arms on hinges around a hub that rotates about the vertical.
    subroutine draw_star(n, mechanism, error)
        integer, intent(in) :: n
        type(mechanism_type), intent(inout) :: mechanism
        type(error_type), allocatable, intent(out) :: error
        real(wp), parameter :: pi = acos(-1.0_wp), l = 0.3_wp, mass = 0.1_wp, inertia = mass*l**2/12
        real(wp) :: angle
        integer :: i

        call mechanism%add_body('hub', 10.0_wp, [0.0_wp, 0.0_wp, 0.0_wp], error, inertia=[1.0_wp, 1.0_wp, 2.0_wp], &
            omega=[0.0_wp, 0.0_wp, 1.0_wp])
        if (.not. allocated(error)) call mechanism%add_joint('bearing', 'revolute', 'ground', 'hub', error, &
            at=[0.0_wp, 0.0_wp, 0.0_wp], axis=[0.0_wp, 0.0_wp, 1.0_wp])
        do i = 1, n
            if (allocated(error)) return
            angle = 2*pi*i/n
            associate (c => cos(angle), s => sin(angle))
                call mechanism%add_body(numbered('a', i), mass, [1.15_wp*c, 1.15_wp*s, 0.0_wp], error, &
                    inertia=[0.1_wp, 1.0_wp, 1.0_wp]*inertia, velocity=[-1.15_wp*s, 1.15_wp*c, 0.0_wp], &
                    orientation=[cos(angle/2), 0.0_wp, 0.0_wp, sin(angle/2)], omega=[0.0_wp, 0.0_wp, 1.0_wp])
                if (.not. allocated(error)) call mechanism%add_joint(numbered('h', i), 'revolute', 'hub', numbered('a', i), &
                    error, at=[c, s, 0.0_wp], axis=[-s, c, 0.0_wp])
            end associate
        end do
    end subroutine draw_star

    !> Bodies in a square grid of k by k: columns on spherical joints, the first of which is on the ground, connected by distances.
    subroutine draw_net(k, mechanism, error)
        integer, intent(in) :: k
        type(mechanism_type), intent(inout) :: mechanism
        type(error_type), allocatable, intent(out) :: error
        real(wp), parameter :: l = 0.1_wp, mass = 0.1_wp
        integer :: i, j

        do j = 1, k
            do i = 1, k
                call mechanism%add_body(numbered('b', i + k*(j - 1)), mass, [i*l, j*l, 0.0_wp], error, &
                    inertia=[1.0_wp, 1.0_wp, 2.0_wp]*mass*l**2/12)
                if (j == 1 .and. .not. allocated(error)) call mechanism%add_joint(numbered('g', i), 'spherical', 'ground', &
                    numbered('b', i), error, at=[i*l, 0.5_wp*l, 0.0_wp])
                if (j > 1 .and. .not. allocated(error)) call mechanism%add_joint(numbered('y', i + k*(j - 1)), 'spherical', &
                    numbered('b', i + k*(j - 2)), numbered('b', i + k*(j - 1)), error, at=[i*l, (j - 0.5_wp)*l, 0.0_wp])
                if (allocated(error)) return
            end do
        end do
        ! These close loops.
        do j = 1, k
            do i = 2, k, 4
                call mechanism%add_distance(numbered('x', i + k*(j - 1)), numbered('b', i - 1 + k*(j - 1)), &
                    numbered('b', i + k*(j - 1)), error)
                if (allocated(error)) return
            end do
        end do
    end subroutine draw_net

    !> A train of trailers with a knife edge each, connected by hinges.
    subroutine draw_trailers(n, mechanism, error)
        integer, intent(in) :: n
        type(mechanism_type), intent(inout) :: mechanism
        type(error_type), allocatable, intent(out) :: error
        integer :: i

        do i = 1, n
            call mechanism%add_body(numbered('b', i), 1.0_wp, [-real(i, wp), 0.0_wp], error, inertia=[0.1_wp], &
                velocity=[1.0_wp, 0.0_wp])
            if (.not. allocated(error)) call mechanism%add_point(numbered('b', i), 'w', [-0.3_wp, 0.0_wp], error)
            if (.not. allocated(error)) call mechanism%add_knife_edge(numbered('w', i), trim(numbered('b', i))//'.w', &
                [0.0_wp, 1.0_wp], error)
            if (i > 1 .and. .not. allocated(error)) call mechanism%add_joint(numbered('j', i), 'revolute', numbered('b', i - 1), &
                numbered('b', i), error, at=[-i + 0.5_wp, 0.0_wp])
            if (allocated(error)) return
        end do
    end subroutine draw_trailers
end module large_mechanisms
