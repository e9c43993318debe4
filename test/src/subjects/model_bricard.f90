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
!> points and the direction of gravity are ours. It is built as a `mechanism_type`,
!> of which a row may be left out. `test_mechanisms` checks the closure, the rank and the motion.
!>
!> q = (r, p) of rods 1 ... 5: centre and Euler parameters. In a rod's own frame x' runs along it, y' is the axis of the joint where
!> it begins and z' that of the joint where it ends. The rods are thin: no moment of inertia about x', so that M is singular.
module model_bricard
    use tandem, only: derivatives_type, error_type, mechanism_type, model_type, need_acceleration_q, &
        need_acceleration_qd, need_dynamics_q, need_dynamics_qd, need_force, need_gamma, need_jacobian, need_mass, need_phi, &
        need_velocity_q, terms_type, wp
    use tandem_mechanism_vector, only: cross
    use tandem_rigid_euler_parameters, only: g_transposed_product, rotation
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
        !> The mechanism with all rows, its terms and derivatives.
        type(mechanism_type), private :: mechanism
        type(terms_type), private :: terms
        type(derivatives_type), private :: derivatives
    contains
        procedure :: define
        procedure :: start
    end type bricard_type

    !> Number of coordinates, and of rows.
    integer, parameter :: n = 35
    !> The pose of the ground: x', y', z' = -z, x, -y.
    real(wp), parameter :: ground_p(4) = [0.5_wp, 0.5_wp, 0.5_wp, -0.5_wp]

contains

    !> Associate the procedures.
    subroutine define(self)
        class(bricard_type), intent(inout) :: self
        integer :: i

        call build(self, self%mechanism)
        call self%terms%allocate(n, n, 0)
        call self%derivatives%allocate(n, n)
        self%name = 'Bricard'
        self%n = n
        self%kept = pack([(i, i=1, n)], [(i /= self%left_out, i=1, n)])
        self%n_holonomic = size(self%kept)
        if (allocated(self%holonomic_name)) deallocate (self%holonomic_name)
        allocate (self%holonomic_name(size(self%kept)))
        do i = 1, size(self%kept)
            self%holonomic_name(i) = self%mechanism%row_name(self%kept(i))
        end do
        self%evaluate => evaluate
        self%provides = self%mechanism%provides
        self%evaluate_derivatives => evaluate_derivatives
        self%provides_derivatives = self%mechanism%provides_derivatives
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

    !> Add rods and joints in the cube. Joint k has the rows x, y, z in the frame of the world, and `axis 1`, `axis 2`: its axis, on
    !> the rod that ends there, is perpendicular to x' and z' of the rod that begins there.
    subroutine build(self, mechanism)
        class(bricard_type), intent(in) :: self
        type(mechanism_type), intent(out) :: mechanism
        type(error_type), allocatable :: error
        character(len=6) :: rod(0:6)
        real(wp) :: q(n), qd(n), a(3, 3, 0:6), place(3)
        integer :: k

        call self%start(0.0_wp, 0.0_wp, q, qd)
        mechanism%gravity = self%g
        rod = 'ground'
        a(:, :, 0) = rotation(ground_p)
        a(:, :, 6) = a(:, :, 0)
        do k = 1, 5
            write (rod(k), '(a, i0)') 'rod', k
            associate (r => q(7*k - 6:7*k - 4), p => q(7*k - 3:7*k))
                call mechanism%add_body(trim(rod(k)), self%m, r, error, inertia=self%m*[0.0_wp, 1.0_wp, 1.0_wp]/12, orientation=p)
                if (allocated(error)) error stop error%message
                a(:, :, k) = rotation(p)
            end associate
        end do
        place = 0.0_wp
        do k = 1, 6
            call mechanism%add_joint('P'//achar(iachar('0') + k), 'revolute', trim(rod(k)), trim(rod(k - 1)), error, &
                at=place, axis=a(:, 3, k - 1), across=a(:, 1, k))
            if (allocated(error)) error stop error%message
            place = place + a(:, 1, k)
        end do
        call mechanism%define(error)
        if (allocated(error)) error stop error%message
    end subroutine build

    subroutine evaluate(self, need, t, q, qd, terms, stat)
        class(model_type), intent(inout) :: self
        integer, intent(in) :: need
        real(wp), intent(in) :: t, q(:), qd(:)
        type(terms_type), intent(inout) :: terms
        integer, intent(out) :: stat

        stat = 0
        select type (self)
        class is (bricard_type)
            associate (all => self%terms, kept => self%kept)
                call self%mechanism%evaluate(need, t, q, qd, all, stat)
                if (iand(need, need_phi) /= 0) terms%phi = all%phi(kept)
                if (iand(need, need_jacobian) /= 0) terms%jacobian = all%jacobian(kept, :)
                if (iand(need, need_gamma) /= 0) terms%gamma = all%gamma(kept)
                if (iand(need, need_mass) /= 0) terms%mass = all%mass
                if (iand(need, need_force) /= 0) terms%force = all%force
            end associate
        end select
    end subroutine evaluate

    subroutine evaluate_derivatives(self, need, t, q, qd, qdd, lambda, derivatives, stat)
        class(model_type), intent(inout) :: self
        integer, intent(in) :: need
        real(wp), intent(in) :: t, q(:), qd(:), qdd(:), lambda(:)
        type(derivatives_type), intent(inout) :: derivatives
        integer, intent(out) :: stat
        real(wp) :: multipliers(n)

        stat = 0
        select type (self)
        class is (bricard_type)
            associate (all => self%derivatives, kept => self%kept)
                multipliers = 0.0_wp
                multipliers(kept) = lambda
                call self%mechanism%evaluate_derivatives(need, t, q, qd, qdd, multipliers, all, stat)
                if (iand(need, need_velocity_q) /= 0) derivatives%velocity_q = all%velocity_q(kept, :)
                if (iand(need, need_acceleration_q) /= 0) derivatives%acceleration_q = all%acceleration_q(kept, :)
                if (iand(need, need_acceleration_qd) /= 0) derivatives%acceleration_qd = all%acceleration_qd(kept, :)
                if (iand(need, need_dynamics_q) /= 0) derivatives%dynamics_q = all%dynamics_q
                if (iand(need, need_dynamics_qd) /= 0) derivatives%dynamics_qd = all%dynamics_qd
            end associate
        end select
    end subroutine evaluate_derivatives

    subroutine potential(self, t, q, value, stat)
        class(model_type), intent(inout) :: self
        real(wp), intent(in) :: t, q(:)
        real(wp), intent(out) :: value
        integer, intent(out) :: stat

        stat = 0
        value = 0.0_wp
        select type (self)
        class is (bricard_type)
            call self%mechanism%potential_energy(t, q, value, stat)
        end select
    end subroutine potential
end module model_bricard
