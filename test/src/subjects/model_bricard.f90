! SPDX-License-Identifier: MIT
!> Bricard's mechanism as in the IFToMM library of computational benchmark problems: six rods of 1 m, joined end to end to a
!> closed ring by six revolute joints whose axes are perpendicular to both rods and, at the two ends of a rod, to each other. The
!> sixth rod is the ground. Counting joints gives 5 x 6 - 6 x 5 = 0 degrees of freedom, but there is one: one of the rows is
!> redundant all along the motion. n = 35, nh = 35 (rank 34), nd = 0.
!>
!> It is Bricard's trihedral (orthogonal) linkage with equal rods, which is also threefold-symmetric. At angle = 0 the rods lie
!> along six edges of the unit cube, P1 = (0, 0, 0), P2 = (1, 0, 0), P3 = (1, -1, 0), P4 = (1, -1, 1), P5 = (0, -1, 1),
!> P6 = (0, 0, 1); the ground is P6 P1. The joints turn from there by `angle` at P1, P3, P5 and by a second angle at P2, P4, P6,
!> with (1 - sin(angle)) (1 + sin(second)) = 1 (Chen, You and Tarnai, Threefold-symmetric Bricard linkages for deployable
!> structures, Int. J. Solids Struct. 42, 2005, for twists of 90 degrees; here in angles counted from the cube). The names of the
!> points and the direction of gravity are ours. `test_mechanisms` checks the closure, the rank and the motion.
!>
!> q = (r, p) of rods 1 ... 5: centre and Euler parameters. In a rod's own frame x' runs along it, y' is the axis of the joint where
!> it begins and z' that of the joint where it ends. The rods are thin: no moment of inertia about x', so that M is singular.
module model_bricard
    use tandem, only: derivatives_type, label_length, model_type, need_acceleration_q, need_acceleration_qd, &
        need_all_derivatives, need_dynamics_q, need_dynamics_qd, need_force, need_gamma, need_jacobian, need_mass, need_phi, &
        need_velocity_q, terms_type, wp
    use tandem_rigid_euler_parameters, only: b_matrix, b_product, g_product, g_sandwich, g_transposed_product, k_matrix, &
        rotation, t_matrix
    implicit none (type, external)
    private

    public :: bricard_type

    type, extends(model_type) :: bricard_type
        !> Mass of a rod (kg), gravity (m/s^2).
        real(wp) :: m = 1.0_wp, g(3) = [0.0_wp, -9.81_wp, 0.0_wp]
        !> Row to leave out, 0 for none. Near the cube any row may be dropped: the mechanism is the same and the rank full. But not
        !> every row takes part in the redundancy everywhere. Those of `y`, `z` and `Euler parameters` vanish at angle = -pi/2,
        !> which the motion from rest in the cube reaches after 1.25 s: without one of these rows the rank drops to 33 there. The
        !> rows `axis 2`, numbers 5, 10, ..., 30, can be dropped everywhere.
        integer :: left_out = 0
        integer, allocatable, private :: kept(:)
    contains
        procedure :: define
        procedure :: start
    end type bricard_type

    !> Centres and Euler parameters of all rods, or their rates: rods 0 and 6 are the ground.
    type :: rods_type
        real(wp) :: r(3, 0:6) = 0.0_wp, p(4, 0:6) = 0.0_wp
    end type rods_type

    !> Coordinates, and rows.
    integer, parameter :: n = 35
    !> Start and end of a rod, in its own frame (m).
    real(wp), parameter :: begins(3) = [-0.5_wp, 0.0_wp, 0.0_wp], ends(3) = [0.5_wp, 0.0_wp, 0.0_wp]
    !> Axis of the joint in the frame of the rod that ends there, and directions perpendicular to it in that of the rod that begins.
    real(wp), parameter :: axis(3) = [0.0_wp, 0.0_wp, 1.0_wp]
    real(wp), parameter :: across(3, 2) = reshape([1.0_wp, 0.0_wp, 0.0_wp, 0.0_wp, 0.0_wp, 1.0_wp], [3, 2])
    !> The pose of the ground: x', y', z' = -z, x, -y.
    real(wp), parameter :: ground_r(3) = [0.0_wp, 0.0_wp, 0.5_wp]
    real(wp), parameter :: ground_p(4) = [0.5_wp, 0.5_wp, 0.5_wp, -0.5_wp]

contains

    !> Associate the procedures.
    subroutine define(self)
        class(bricard_type), intent(inout) :: self
        character(len=*), parameter :: row(5) = [character(len=6) :: 'x', 'y', 'z', 'axis 1', 'axis 2']
        character(len=*), parameter :: coordinate(7) = [character(len=2) :: 'x', 'y', 'z', 'e0', 'e1', 'e2', 'e3']
        character(len=label_length) :: name(n)
        integer :: i, k

        self%name = 'Bricard'
        self%n = n
        self%kept = pack([(i, i=1, n)], [(i /= self%left_out, i=1, n)])
        self%n_holonomic = size(self%kept)
        if (.not. allocated(self%coordinate_name)) allocate (self%coordinate_name(n), self%coordinate_unit(n))
        do k = 1, 6
            do i = 1, 5
                write (name(5*k - 5 + i), '(a, i0, 2a)') 'P', k, ' ', trim(row(i))
            end do
        end do
        do k = 1, 5
            write (name(30 + k), '(a, i0)') 'Euler parameters ', k
            do i = 1, 7
                write (self%coordinate_name(7*k - 7 + i), '(a, i0)') trim(coordinate(i)), k
                self%coordinate_unit(7*k - 7 + i) = merge('m', '1', i <= 3)
            end do
        end do
        self%holonomic_name = name(self%kept)
        self%evaluate => evaluate
        self%provides = need_phi + need_jacobian + need_gamma + need_mass + need_force
        self%evaluate_derivatives => evaluate_derivatives
        self%provides_derivatives = need_all_derivatives
        self%potential_energy => potential
    end subroutine define

    !> The state on the mechanism's one path at an angle (rad, above -pi/2, below pi/6) at P1, P3, P5, with a rate (rad/s).
    pure subroutine start(self, angle, rate, q, qd)
        class(bricard_type), intent(in) :: self
        real(wp), intent(in) :: angle, rate
        real(wp), intent(out) :: q(35), qd(35)
        real(wp) :: turn(2), speed(2), a(3, 3), b(3, 3), p(4), omega(3), point(3), velocity(3)
        integer :: k

        turn = [angle, asin(sin(angle)/(1 - sin(angle)))]
        speed = rate*[1.0_wp, cos(angle)/((1 - sin(angle))**2*cos(turn(2)))]
        a = rotation(ground_p)
        omega = 0.0_wp
        point = 0.0_wp
        velocity = 0.0_wp
        do k = 1, 5
            associate (i => 2 - mod(k, 2), j => 7*k - 7)
                ! The next rod's x' is this one's y' or -y', turned about z', and its y' is this one's -z' or z', alternately.
                omega = omega + speed(i)*a(:, 3)
                b(:, 1) = sin(turn(i))*a(:, 1) - cos(turn(i))*a(:, 2)
                b(:, 1) = merge(-b(:, 1), b(:, 1), i == 1)
                b(:, 2) = merge(-a(:, 3), a(:, 3), i == 1)
                b(:, 3) = cross(b(:, 1), b(:, 2))
                a = b
                p = euler_parameters(a)
                q(j + 1:j + 3) = point + a(:, 1)/2
                qd(j + 1:j + 3) = velocity + cross(omega, a(:, 1)/2)
                q(j + 4:j + 7) = p
                qd(j + 4:j + 7) = g_transposed_product(p, matmul(omega, a))/2
                point = point + a(:, 1)
                velocity = velocity + cross(omega, a(:, 1))
            end associate
        end do
    end subroutine start

    !> a x b.
    pure function cross(a, b) result(c)
        real(wp), intent(in) :: a(3), b(3)
        real(wp) :: c(3)

        c = [a(2)*b(3) - a(3)*b(2), a(3)*b(1) - a(1)*b(3), a(1)*b(2) - a(2)*b(1)]
    end function cross

    !> Unit Euler parameters of a rotation, from the largest of them (Shepperd 1978).
    pure function euler_parameters(a) result(p)
        real(wp), intent(in) :: a(3, 3)
        real(wp) :: p(4)
        real(wp) :: square(4), s
        integer :: i, j, k

        square = [1 + a(1, 1) + a(2, 2) + a(3, 3), 1 + a(1, 1) - a(2, 2) - a(3, 3), 1 - a(1, 1) + a(2, 2) - a(3, 3), &
            1 - a(1, 1) - a(2, 2) + a(3, 3)]/4
        i = maxloc(square, dim=1)
        s = sqrt(square(i))
        if (i == 1) then
            p = [s, (a(3, 2) - a(2, 3))/(4*s), (a(1, 3) - a(3, 1))/(4*s), (a(2, 1) - a(1, 2))/(4*s)]
        else
            ! i, j, k in cyclic order, as axes 1, 2, 3.
            i = i - 1
            j = modulo(i, 3) + 1
            k = modulo(j, 3) + 1
            p(1) = (a(k, j) - a(j, k))/(4*s)
            p(1 + i) = s
            p(1 + j) = (a(j, i) + a(i, j))/(4*s)
            p(1 + k) = (a(k, i) + a(i, k))/(4*s)
        end if
    end function euler_parameters

    !> Rods 1 ... 5 of a vector.
    pure type(rods_type) function rods_of(x)
        real(wp), intent(in) :: x(:)
        integer :: k

        do k = 1, 5
            rods_of%r(:, k) = x(7*k - 6:7*k - 4)
            rods_of%p(:, k) = x(7*k - 3:7*k)
        end do
    end function rods_of

    !> Rods 1 ... 5 of the coordinates, and the ground.
    pure type(rods_type) function poses_of(q)
        real(wp), intent(in) :: q(:)

        poses_of = rods_of(q)
        poses_of%r(:, 0) = ground_r
        poses_of%r(:, 6) = ground_r
        poses_of%p(:, 0) = ground_p
        poses_of%p(:, 6) = ground_p
    end function poses_of

    subroutine evaluate(self, need, t, q, qd, terms, stat)
        class(model_type), intent(inout) :: self
        integer, intent(in) :: need
        real(wp), intent(in) :: t, q(:), qd(:)
        type(terms_type), intent(inout) :: terms
        integer, intent(out) :: stat
        type(rods_type) :: x, xd
        real(wp) :: vector(n), matrix(n, n)
        integer :: k, i

        stat = 0
        x = poses_of(q)
        select type (self)
        class is (bricard_type)
            if (iand(need, need_phi) /= 0) then
                call set_phi(x, vector)
                terms%phi = vector(self%kept)
            end if
            if (iand(need, need_jacobian) /= 0) then
                call set_jacobian(x, matrix)
                terms%jacobian = matrix(self%kept, :)
            end if
            if (iand(need, need_gamma) /= 0) then
                call set_gamma(x, rods_of(qd), vector)
                terms%gamma = vector(self%kept)
            end if
            if (iand(need, need_mass) /= 0) then
                terms%mass = 0.0_wp
                do k = 1, 5
                    do i = 7*k - 6, 7*k - 4
                        terms%mass(i, i) = self%m
                    end do
                    terms%mass(7*k - 3:7*k, 7*k - 3:7*k) = 4*g_sandwich(x%p(:, k), inertia(self), x%p(:, k))
                end do
            end if
            if (iand(need, need_force) /= 0) then
                xd = rods_of(qd)
                do k = 1, 5
                    terms%force(7*k - 6:7*k - 4) = self%m*self%g
                    terms%force(7*k - 3:7*k) = g_transposed_product(xd%p(:, k), 8*inertia(self)* &
                        g_product(xd%p(:, k), x%p(:, k)))
                end do
            end if
        end select
    end subroutine evaluate

    !> Moments of inertia of a thin rod of 1 m in its own frame (kg m^2).
    pure function inertia(self) result(j)
        class(bricard_type), intent(in) :: self
        real(wp) :: j(3)

        j = self%m*[0.0_wp, 1.0_wp, 1.0_wp]/12
    end function inertia

    pure subroutine set_phi(x, phi)
        type(rods_type), intent(in) :: x
        real(wp), intent(inout) :: phi(:)
        real(wp) :: a(3, 3), b(3, 3)
        integer :: k, row

        do k = 1, 6
            row = 5*k - 5
            a = rotation(x%p(:, k - 1))
            b = rotation(x%p(:, k))
            phi(row + 1:row + 3) = x%r(:, k - 1) + matmul(a, ends) - x%r(:, k) - matmul(b, begins)
            phi(row + 4:row + 5) = matmul(matmul(a, axis), matmul(b, across))
        end do
        do k = 1, 5
            phi(30 + k) = (dot_product(x%p(:, k), x%p(:, k)) - 1)/2
        end do
    end subroutine set_phi

    pure subroutine set_jacobian(x, c)
        type(rods_type), intent(in) :: x
        real(wp), intent(inout) :: c(:, :)
        real(wp) :: a(3, 3), b(3, 3)
        integer :: k, row, left, right, i

        c = 0.0_wp
        do k = 1, 6
            row = 5*k - 5
            left = 7*k - 14
            right = 7*k - 7
            a = rotation(x%p(:, k - 1))
            b = rotation(x%p(:, k))
            if (k > 1) then
                do i = 1, 3
                    c(row + i, left + i) = 1.0_wp
                end do
                c(row + 1:row + 3, left + 4:left + 7) = b_matrix(x%p(:, k - 1), ends)
                do i = 1, 2
                    c(row + 3 + i, left + 4:left + 7) = matmul(matmul(b, across(:, i)), b_matrix(x%p(:, k - 1), axis))
                end do
            end if
            if (k < 6) then
                do i = 1, 3
                    c(row + i, right + i) = -1.0_wp
                end do
                c(row + 1:row + 3, right + 4:right + 7) = -b_matrix(x%p(:, k), begins)
                do i = 1, 2
                    c(row + 3 + i, right + 4:right + 7) = matmul(matmul(a, axis), b_matrix(x%p(:, k), across(:, i)))
                end do
                c(30 + k, right + 4:right + 7) = x%p(:, k)
            end if
        end do
    end subroutine set_jacobian

    !> A is quadratic in p, so that d^2/dt^2 (A a) without second derivatives is B(pd, a) pd.
    pure subroutine set_gamma(x, xd, gamma)
        type(rods_type), intent(in) :: x, xd
        real(wp), intent(inout) :: gamma(:)
        real(wp) :: a(3), ad(3), add(3), b(3), bd(3), bdd(3)
        integer :: k, i, row

        do k = 1, 6
            row = 5*k - 5
            associate (p => x%p(:, k - 1), pd => xd%p(:, k - 1), o => x%p(:, k), od => xd%p(:, k))
                gamma(row + 1:row + 3) = b_product(pd, ends, pd) - b_product(od, begins, od)
                a = matmul(rotation(p), axis)
                ad = b_product(p, axis, pd)
                add = b_product(pd, axis, pd)
                do i = 1, 2
                    b = matmul(rotation(o), across(:, i))
                    bd = b_product(o, across(:, i), od)
                    bdd = b_product(od, across(:, i), od)
                    gamma(row + 3 + i) = dot_product(add, b) + 2*dot_product(ad, bd) + dot_product(a, bdd)
                end do
            end associate
        end do
        do k = 1, 5
            gamma(30 + k) = dot_product(xd%p(:, k), xd%p(:, k))
        end do
    end subroutine set_gamma

    subroutine evaluate_derivatives(self, need, t, q, qd, qdd, lambda, derivatives, stat)
        class(model_type), intent(inout) :: self
        integer, intent(in) :: need
        real(wp), intent(in) :: t, q(:), qd(:), qdd(:), lambda(:)
        type(derivatives_type), intent(inout) :: derivatives
        integer, intent(out) :: stat
        type(rods_type) :: x, xd, xdd
        real(wp) :: gradient(n, n), multipliers(n)
        integer :: k, i, j

        stat = 0
        x = poses_of(q)
        xd = rods_of(qd)
        xdd = rods_of(qdd)
        select type (self)
        class is (bricard_type)
            call set_gradient(x, xd, rods_type(), 0.0_wp, gradient)
            if (iand(need, need_velocity_q) /= 0) derivatives%velocity_q = gradient(self%kept, :)
            ! gamma is (C qd)_q qd and Phi_qq is symmetric, so that gamma_qd = 2 (C qd)_q.
            if (iand(need, need_acceleration_qd) /= 0) derivatives%acceleration_qd = 2*gradient(self%kept, :)
            if (iand(need, need_acceleration_q) /= 0) then
                call set_gradient(x, xdd, xd, 1.0_wp, gradient)
                derivatives%acceleration_q = gradient(self%kept, :)
            end if
            if (iand(need, need_dynamics_q) /= 0) then
                multipliers = 0.0_wp
                multipliers(self%kept) = lambda
                call set_reaction_gradient(x, multipliers, derivatives%dynamics_q)
                do k = 1, 5
                    i = 7*k - 3
                    j = 7*k
                    derivatives%dynamics_q(i:j, i:j) = derivatives%dynamics_q(i:j, i:j) &
                        + 4*t_matrix(inertia(self)*g_product(x%p(:, k), xdd%p(:, k))) &
                        - 4*g_sandwich(x%p(:, k), inertia(self), xdd%p(:, k)) &
                        - 8*g_sandwich(xd%p(:, k), inertia(self), xd%p(:, k))
                end do
            end if
            if (iand(need, need_dynamics_qd) /= 0) then
                derivatives%dynamics_qd = 0.0_wp
                do k = 1, 5
                    i = 7*k - 3
                    j = 7*k
                    derivatives%dynamics_qd(i:j, i:j) = 8*g_sandwich(xd%p(:, k), inertia(self), x%p(:, k)) &
                        - 8*t_matrix(inertia(self)*g_product(xd%p(:, k), x%p(:, k)))
                end do
            end if
        end select
    end subroutine evaluate_derivatives

    !> (C(q) y)_q + with_gamma gamma(q, qd)_q, for y in the place of qd or qdd.
    pure subroutine set_gradient(x, y, xd, with_gamma, gradient)
        type(rods_type), intent(in) :: x, y, xd
        real(wp), intent(in) :: with_gamma
        real(wp), intent(inout) :: gradient(:, :)
        real(wp) :: a(3), ay(3), ad(3), b(3), by(3), bd(3)
        integer :: k, i, row, left, right

        gradient = 0.0_wp
        do k = 1, 6
            row = 5*k - 5
            left = 7*k - 10
            right = 7*k - 3
            associate (p => x%p(:, k - 1), o => x%p(:, k), py => y%p(:, k - 1), oy => y%p(:, k), &
                pd => xd%p(:, k - 1), od => xd%p(:, k))
                ! First and second derivatives of the axis a and of b without qdd, at qd, and with y for it.
                a = matmul(rotation(p), axis)
                ad = b_product(p, axis, pd)
                ay = b_product(p, axis, py) + with_gamma*b_product(pd, axis, pd)
                if (k > 1) gradient(row + 1:row + 3, left:left + 3) = b_matrix(py, ends)
                if (k < 6) gradient(row + 1:row + 3, right:right + 3) = -b_matrix(oy, begins)
                do i = 1, 2
                    b = matmul(rotation(o), across(:, i))
                    bd = b_product(o, across(:, i), od)
                    by = b_product(o, across(:, i), oy) + with_gamma*b_product(od, across(:, i), od)
                    ! Row: ay'b + a'by + 2 ad'bd.
                    if (k > 1) gradient(row + 3 + i, left:left + 3) = matmul(b, b_matrix(py, axis)) + &
                        matmul(by, b_matrix(p, axis)) + 2*with_gamma*matmul(bd, b_matrix(pd, axis))
                    if (k < 6) gradient(row + 3 + i, right:right + 3) = matmul(a, b_matrix(oy, across(:, i))) + &
                        matmul(ay, b_matrix(o, across(:, i))) + 2*with_gamma*matmul(ad, b_matrix(od, across(:, i)))
                end do
            end associate
            if (k < 6) gradient(30 + k, right:right + 3) = y%p(:, k)
        end do
    end subroutine set_gradient

    !> (C' lambda)_q; (B(p, a)' b)_p = K(a, b).
    subroutine set_reaction_gradient(x, lambda, gradient)
        type(rods_type), intent(in) :: x
        real(wp), intent(in) :: lambda(:)
        real(wp), intent(inout) :: gradient(:, :)
        real(wp) :: a(3), b(3), block(4, 4)
        integer :: k, i, row, left, right

        gradient = 0.0_wp
        do k = 1, 6
            row = 5*k - 5
            left = 7*k - 10
            right = 7*k - 3
            a = matmul(rotation(x%p(:, k - 1)), axis)
            if (k > 1) call add(left, left, k_matrix(ends, lambda(row + 1:row + 3)))
            if (k < 6) call add(right, right, -k_matrix(begins, lambda(row + 1:row + 3)))
            do i = 1, 2
                b = matmul(rotation(x%p(:, k)), across(:, i))
                if (k > 1) call add(left, left, lambda(row + 3 + i)*k_matrix(axis, b))
                if (k < 6) call add(right, right, lambda(row + 3 + i)*k_matrix(across(:, i), a))
                if (k > 1 .and. k < 6) then
                    block = lambda(row + 3 + i)*matmul(transpose(b_matrix(x%p(:, k - 1), axis)), &
                        b_matrix(x%p(:, k), across(:, i)))
                    call add(left, right, block)
                    call add(right, left, transpose(block))
                end if
            end do
        end do
        do k = 1, 5
            do i = 7*k - 3, 7*k
                gradient(i, i) = gradient(i, i) + lambda(30 + k)
            end do
        end do

    contains

        !> Add a block whose first entry is (i, j).
        subroutine add(i, j, values)
            integer, intent(in) :: i, j
            real(wp), intent(in) :: values(4, 4)

            gradient(i:i + 3, j:j + 3) = gradient(i:i + 3, j:j + 3) + values
        end subroutine add
    end subroutine set_reaction_gradient

    subroutine potential(self, t, q, value, stat)
        class(model_type), intent(inout) :: self
        real(wp), intent(in) :: t, q(:)
        real(wp), intent(out) :: value
        integer, intent(out) :: stat
        type(rods_type) :: x

        stat = 0
        value = 0.0_wp
        x = rods_of(q)
        select type (self)
        class is (bricard_type)
            value = -self%m*dot_product(self%g, sum(x%r(:, 1:5), dim=2))
        end select
    end subroutine potential
end module model_bricard
