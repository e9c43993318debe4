! SPDX-License-Identifier: MIT
!> Bodies in the reference configuration, their named points, and the contributions of their masses to the equations of motion.
module tandem_mechanism_body
    use tandem_kinds, only: wp
    use tandem_mechanism_joint, only: name_length
    use tandem_mechanism_pose, only: pose_type
    use tandem_model_derivatives, only: derivatives_type, need_dynamics_q, need_dynamics_qd
    use tandem_rigid_euler_parameters, only: g_matrix, g_product, g_transposed_product, set_rotational_mass, t_matrix
    implicit none (type, external)
    private

    public :: body_type, point_type, set_mass, set_single_masses, add_gyroscopic, differentiate_inertia, kinetic_energy_of

    !> A rigid body, or a point mass, which has no rotation. In the plane the third component of a vector belongs to the angle.
    type :: body_type
        character(len=name_length) :: name = ''
        real(wp) :: mass = 0.0_wp
        !> About the centre of mass in the body's frame (kg m^2); in the plane the entry (3, 3).
        real(wp) :: inertia(3, 3) = 0.0_wp
        !> True if the body has a rotation; true if its axes are principal axes.
        logical :: turns = .true., is_principal = .true.
        !> Reference configuration: centre of mass, Euler parameters or angle, velocity, and angular velocity in the world frame.
        real(wp) :: position(3) = 0.0_wp, p(4) = [1.0_wp, 0.0_wp, 0.0_wp, 0.0_wp], angle = 0.0_wp
        real(wp) :: velocity(3) = 0.0_wp, omega(3) = 0.0_wp
        !> Shape, such as `box`, empty if none, and its dimensions (m); see `tandem_mechanism_shape`.
        character(len=8) :: shape = ''
        real(wp) :: sizes(3) = 0.0_wp
    end type body_type

    !> A named point of a body, 0 for the ground, in the body's frame.
    type :: point_type
        character(len=name_length) :: name = ''
        integer :: body = 0
        real(wp) :: place(3) = 0.0_wp
    end type point_type

contains

    !> Set the masses of a body in the plane or of a point mass, which are diagonal entries of M.
    pure subroutine set_single_masses(body, first, last, is_compressed, n, width, mass)
        type(body_type), intent(in) :: body
        !> The body's coordinates.
        integer, intent(in) :: first, last
        logical, intent(in) :: is_compressed
        !> Shape of the stored M.
        integer, intent(in) :: n, width
        real(wp), intent(inout) :: mass(n, width)
        integer :: i

        do i = first, last
            mass(i, merge(1, i, is_compressed)) = body%mass
        end do
        ! In the plane the angle is the last coordinate.
        if (body%turns) mass(last, merge(1, last, is_compressed)) = body%inertia(3, 3)
    end subroutine set_single_masses

    !> Set the block of M of a body that rotates in space; the block is zero on entry.
    pure subroutine set_mass(body, pose, n, width, mass)
        type(body_type), intent(in) :: body
        type(pose_type), intent(in) :: pose
        !> Shape of the stored M, which may be compressed.
        integer, intent(in) :: n, width
        real(wp), intent(inout) :: mass(n, width)
        real(wp) :: g(4, 4)
        integer :: i

        do i = pose%place, pose%place + pose%n_place - 1
            mass(i, pose%place_mass + (i - pose%place)*pose%mass_step) = body%mass
        end do
        if (body%is_principal) then
            call set_rotational_mass(pose%p(:, 0), [body%inertia(1, 1), body%inertia(2, 2), body%inertia(3, 3)], n, &
                mass(pose%turn, pose%turn_mass))
        else
            g = sandwich(pose%p(:, 0), body%inertia, pose%p(:, 0))
            mass(pose%turn:pose%turn + 3, pose%turn_mass:pose%turn_mass + 3) = 4*g
        end if
    end subroutine set_mass

    !> Kinetic energy of a body; the rates of its pose are set.
    pure real(wp) function kinetic_energy_of(body, pose) result(energy)
        type(body_type), intent(in) :: body
        type(pose_type), intent(in) :: pose
        real(wp) :: w(3)

        energy = body%mass*(pose%r(1, 1)**2 + pose%r(2, 1)**2 + pose%r(3, 1)**2)
        if (pose%n_turn == 1) then
            energy = energy + body%inertia(3, 3)*pose%p(1, 1)**2
        else if (pose%n_turn == 4) then
            w = 2*g_product(pose%p(:, 0), pose%p(:, 1))
            energy = energy + dot_product(w, times(body%inertia, w))
        end if
        energy = energy/2
    end function kinetic_energy_of

    !> J x.
    pure function times(j, x) result(y)
        real(wp), intent(in) :: j(3, 3), x(3)
        real(wp) :: y(3)

        y = j(:, 1)*x(1) + j(:, 2)*x(2) + j(:, 3)*x(3)
    end function times

    !> S = 8 G(pd)' J G(pd) p; zero for a body in the plane or a point mass.
    pure subroutine add_gyroscopic(body, pose, force)
        type(body_type), intent(in) :: body
        type(pose_type), intent(in) :: pose
        real(wp), intent(inout) :: force(:)
        real(wp) :: s(4)
        integer :: i

        if (pose%n_turn /= 4) return
        s = 8*g_transposed_product(pose%p(:, 1), times(body%inertia, g_product(pose%p(:, 1), pose%p(:, 0))))
        do i = 1, 4
            force(pose%turn + i - 1) = force(pose%turn + i - 1) + s(i)
        end do
    end subroutine add_gyroscopic

    !> (M qdd - S)_q and -S_qd.
    pure subroutine differentiate_inertia(body, pose, need, derivatives)
        type(body_type), intent(in) :: body
        type(pose_type), intent(in) :: pose
        integer, intent(in) :: need
        type(derivatives_type), intent(inout) :: derivatives

        if (pose%n_turn /= 4) return
        associate (p => pose%p(:, 0), pd => pose%p(:, 1), pdd => pose%p(:, 2), j => body%inertia)
            if (iand(need, need_dynamics_q) /= 0) call add(derivatives%dynamics_q, &
                4*t_matrix(times(j, g_product(p, pdd))) - 4*sandwich(p, j, pdd) - 8*sandwich(pd, j, pd))
            if (iand(need, need_dynamics_qd) /= 0) call add(derivatives%dynamics_qd, &
                8*sandwich(pd, j, p) - 8*t_matrix(times(j, g_product(pd, p))))
        end associate

    contains

        pure subroutine add(matrix, block)
            real(wp), intent(inout) :: matrix(:, :)
            real(wp), intent(in) :: block(4, 4)
            integer :: c, i, k

            do k = 1, 4
                c = derivatives%column_of(pose%turn + k - 1)
                do i = 1, 4
                    matrix(pose%turn + i - 1, c) = matrix(pose%turn + i - 1, c) + block(i, k)
                end do
            end do
        end subroutine add
    end subroutine differentiate_inertia

    !> G(p)' J G(x) (4, 4).
    pure function sandwich(p, j, x) result(s)
        real(wp), intent(in) :: p(4), j(3, 3), x(4)
        real(wp) :: s(4, 4), gp(3, 4), gx(3, 4), jgx(3)
        integer :: k, l

        gp = g_matrix(p)
        gx = g_matrix(x)
        do l = 1, 4
            jgx = times(j, gx(:, l))
            do k = 1, 4
                s(k, l) = gp(1, k)*jgx(1) + gp(2, k)*jgx(2) + gp(3, k)*jgx(3)
            end do
        end do
    end function sandwich
end module tandem_mechanism_body
