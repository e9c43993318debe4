! SPDX-License-Identifier: MIT
!> A particle with four coordinates (x, y, z, w) under velocity constraints E qd = e, some of which are holonomic in disguise:
!> n = 4, nh = 0, nd = 1 or 2. With f = z + x y - y**2/2, g = w - sin x + y and the integrating factor mu = 2 + sin(x + y):
!>
!> - `disguised`: mu df = 0, integrable: f is constant. mu df itself is not closed.
!> - `driven`: mu df = mu cos(2 t) dt, integrable with the time: f - sin(2 t)/2 is constant.
!> - `detuned`: mu df = cos(2 t) dt; E is that of `driven`, but with the time it is not integrable.
!> - `contact`: dw - y dx = 0, not integrable.
!> - `pair`: df + sin(x) dg = 0 and dg + sin(y) df/2 = 0: neither is integrable alone, together they are: f and g are constant.
!> - `mixed`: `disguised` and `contact`.
module model_disguised
    use tandem, only: label_length, model_type, procedure_model_type, wp
    implicit none (type, external)
    private

    public :: disguised_type, disguise_names

    !> Values of `kind`.
    character(len=9), parameter :: disguise_names(6) = [character(len=9) :: 'disguised', 'driven', 'detuned', 'contact', 'pair', &
        'mixed']

    type, extends(procedure_model_type) :: disguised_type
        !> One of `disguise_names`; the rows carry these names, those of `pair` are `first` and `second`.
        character(len=9) :: kind = 'disguised'
    contains
        procedure :: define
        procedure :: start
        procedure :: invariants
    end type disguised_type

    !> Masses (kg), stiffness of springs to the origin (N/m), and a weight along -z (N).
    real(wp), parameter :: masses(4) = [1.0_wp, 1.5_wp, 0.8_wp, 1.2_wp], stiffness(4) = [2.0_wp, 1.0_wp, 3.0_wp, 1.5_wp]
    real(wp), parameter :: weight = 4.0_wp

contains

    !> Associate the procedures.
    subroutine define(self)
        class(disguised_type), intent(inout) :: self

        self%name = 'particle, '//trim(self%kind)
        self%n = 4
        self%constant_mass = .true.
        self%nonholonomic_rhs => null()
        select case (self%kind)
        case ('pair')
            self%nonholonomic_name = [character(len=label_length) :: 'first', 'second']
        case ('mixed')
            self%nonholonomic_name = [character(len=label_length) :: 'disguised', 'contact']
        case ('disguised', 'contact')
            self%nonholonomic_name = [character(len=label_length) :: self%kind]
        case ('driven', 'detuned')
            self%nonholonomic_name = [character(len=label_length) :: self%kind]
            self%nonholonomic_rhs => drive
        case default
            error stop 'disguised: no such kind'
        end select
        self%n_nonholonomic = size(self%nonholonomic_name)
        self%nonholonomic_jacobian => rows
        self%constraint_acceleration => acceleration
        self%mass_matrix => mass
        self%applied_force => force
        self%potential_energy => potential
    end subroutine define

    !> A consistent state at a time: the velocities of x and y are given, zd or wd or both follow.
    subroutine start(self, t, q, qd)
        class(disguised_type), intent(inout) :: self
        real(wp), intent(in) :: t
        real(wp), intent(out) :: q(4), qd(4)
        real(wp) :: e(2, 4), right(2)
        integer :: stat

        q = [0.4_wp, 0.3_wp, -0.2_wp, 0.5_wp]
        qd = [0.7_wp, -0.5_wp, 0.0_wp, 0.6_wp]
        e = 0.0_wp
        right = 0.0_wp
        call rows(self, t, q, e(:self%n_nonholonomic, :), stat)
        if (associated(self%nonholonomic_rhs)) call drive(self, t, q, right(:1), stat)
        right = right - matmul(e(:, :2), qd(:2))
        select case (self%kind)
        case ('pair', 'mixed')
            qd(3:4) = [e(2, 4)*right(1) - e(1, 4)*right(2), e(1, 3)*right(2) - e(2, 3)*right(1)]/ &
                (e(1, 3)*e(2, 4) - e(1, 4)*e(2, 3))
        case ('contact')
            qd(4) = right(1)
        case default
            qd(3) = right(1)/e(1, 3)
        end select
    end subroutine start

    !> f and g; which of them is constant depends on the kind.
    pure function invariants(self, q) result(values)
        class(disguised_type), intent(in) :: self
        real(wp), intent(in) :: q(4)
        real(wp) :: values(2)

        values = [q(3) + q(1)*q(2) - q(2)**2/2, q(4) - sin(q(1)) + q(2)]
    end function invariants

    !> The gradients of f and g.
    pure subroutine set_gradients(q, df, dg)
        real(wp), intent(in) :: q(:)
        real(wp), intent(out) :: df(4), dg(4)

        df = [q(2), q(1) - q(2), 1.0_wp, 0.0_wp]
        dg = [-cos(q(1)), 1.0_wp, 0.0_wp, 1.0_wp]
    end subroutine set_gradients

    subroutine rows(self, t, q, value, stat)
        class(model_type), intent(inout) :: self
        real(wp), intent(in) :: t, q(:)
        real(wp), intent(out) :: value(:, :)
        integer, intent(out) :: stat
        real(wp) :: df(4), dg(4)

        stat = 0
        value = 0.0_wp
        call set_gradients(q, df, dg)
        select type (self)
        class is (disguised_type)
            if (self%kind == 'pair') then
                value(1, :) = df + sin(q(1))*dg
                value(2, :) = dg + sin(q(2))/2*df
                return
            end if
            if (self%kind /= 'contact') value(1, :) = (2 + sin(q(1) + q(2)))*df
            if (self%kind == 'contact' .or. self%kind == 'mixed') then
                value(self%n_nonholonomic, :) = [-q(2), 0.0_wp, 0.0_wp, 1.0_wp]
            end if
        end select
    end subroutine rows

    subroutine drive(self, t, q, value, stat)
        class(model_type), intent(inout) :: self
        real(wp), intent(in) :: t, q(:)
        real(wp), intent(out) :: value(:)
        integer, intent(out) :: stat

        stat = 0
        value = cos(2*t)
        select type (self)
        class is (disguised_type)
            if (self%kind == 'driven') value = (2 + sin(q(1) + q(2)))*value
        end select
    end subroutine drive

    !> gamma = d/dt (E qd - e) without qdd.
    subroutine acceleration(self, t, q, qd, value, stat)
        class(model_type), intent(inout) :: self
        real(wp), intent(in) :: t, q(:), qd(:)
        real(wp), intent(out) :: value(:)
        integer, intent(out) :: stat
        real(wp) :: df(4), dg(4), fd, gd, fdd, gdd, mu, mud

        stat = 0
        value = 0.0_wp
        call set_gradients(q, df, dg)
        fd = dot_product(df, qd)
        gd = dot_product(dg, qd)
        fdd = 2*qd(1)*qd(2) - qd(2)**2
        gdd = sin(q(1))*qd(1)**2
        mu = 2 + sin(q(1) + q(2))
        mud = cos(q(1) + q(2))*(qd(1) + qd(2))
        select type (self)
        class is (disguised_type)
            if (self%kind == 'pair') then
                value(1) = fdd + sin(q(1))*gdd + cos(q(1))*qd(1)*gd
                value(2) = gdd + sin(q(2))/2*fdd + cos(q(2))/2*qd(2)*fd
                return
            end if
            if (self%kind /= 'contact') value(1) = mu*fdd + mud*fd
            if (self%kind == 'driven') value(1) = value(1) + 2*mu*sin(2*t) - mud*cos(2*t)
            if (self%kind == 'detuned') value(1) = value(1) + 2*sin(2*t)
            if (self%kind == 'contact' .or. self%kind == 'mixed') value(self%n_nonholonomic) = -qd(2)*qd(1)
        end select
    end subroutine acceleration

    subroutine mass(self, q, value, stat)
        class(model_type), intent(inout) :: self
        real(wp), intent(in) :: q(:)
        real(wp), intent(out) :: value(:, :)
        integer, intent(out) :: stat
        integer :: i

        stat = 0
        value = 0.0_wp
        do i = 1, 4
            value(i, i) = masses(i)
        end do
    end subroutine mass

    subroutine force(self, t, q, qd, value, stat)
        class(model_type), intent(inout) :: self
        real(wp), intent(in) :: t, q(:), qd(:)
        real(wp), intent(out) :: value(:)
        integer, intent(out) :: stat

        stat = 0
        value = -stiffness*q
        value(3) = value(3) - weight
    end subroutine force

    subroutine potential(self, t, q, value, stat)
        class(model_type), intent(inout) :: self
        real(wp), intent(in) :: t, q(:)
        real(wp), intent(out) :: value
        integer, intent(out) :: stat

        stat = 0
        value = dot_product(stiffness, q**2)/2 + weight*q(3)
    end subroutine potential
end module model_disguised
