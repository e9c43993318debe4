! SPDX-License-Identifier: MIT
!> Forces along a scalar coordinate x, such as the length of a spring or the angle of a joint: f = s (k (x - x0) + c xd) + u(t) +
!> g(t, x, xd). The sense s is 1 for a tension and -1 for a force that accelerates the coordinate. Events may set the numbers k, c
!> and x0, which are arguments here: [k, c, x0].
module tandem_mechanism_coordinate_force
    use tandem_kinds, only: wp
    use tandem_mechanism_context, only: context_type
    implicit none (type, external)
    private

    public :: coordinate_force_type, energy_along, force_along, measure_along, slopes_along

    !> Sense s; indices of the function u(t) and of the law g, 0 if none.
    type :: coordinate_force_type
        real(wp) :: sense = 1.0_wp
        integer :: motion = 0, law = 0
    end type coordinate_force_type

contains

    !> Force f.
    pure real(wp) function force_along(it, numbers, context, x, v) result(f)
        type(coordinate_force_type), intent(in) :: it
        real(wp), intent(in) :: numbers(3)
        type(context_type), intent(in) :: context
        !> Coordinate and its rate.
        real(wp), intent(in) :: x, v

        f = 0.0_wp
        if (.not. context%only_rates) f = it%sense*(numbers(1)*(x - numbers(3)) + numbers(2)*v)
        if (it%motion > 0) f = f + context%f(0, it%motion)
        if (it%law > 0) f = f + context%laws(it%law)%law%force(context%t, x, v)
    end function force_along

    !> f, f_x and f_xd.
    pure function slopes_along(it, numbers, context, x, v) result(f)
        type(coordinate_force_type), intent(in) :: it
        real(wp), intent(in) :: numbers(3)
        type(context_type), intent(in) :: context
        real(wp), intent(in) :: x, v
        real(wp) :: f(0:2), g(0:2)

        f = it%sense*[numbers(1)*(x - numbers(3)) + numbers(2)*v, numbers(1), numbers(2)]
        if (it%motion > 0) f(0) = f(0) + context%f(0, it%motion)
        if (it%law > 0) then
            call context%laws(it%law)%law%evaluate(context%t, x, v, g)
            f = f + g
        end if
    end function slopes_along

    !> Potential energy k (x - x0)^2/2.
    pure real(wp) function energy_along(numbers, x) result(energy)
        real(wp), intent(in) :: numbers(3), x

        energy = numbers(1)*(x - numbers(3))**2/2
    end function energy_along

    !> Force, and power of its part without a potential.
    pure subroutine measure_along(it, numbers, context, x, v, more, f, power)
        type(coordinate_force_type), intent(in) :: it
        real(wp), intent(in) :: numbers(3)
        type(context_type), intent(in) :: context
        real(wp), intent(in) :: x, v
        !> Further force without a potential.
        real(wp), intent(in) :: more
        real(wp), intent(out) :: f, power
        real(wp) :: g(0:2), given, rest

        given = 0.0_wp
        if (it%motion > 0) given = context%f(0, it%motion)
        if (it%law > 0) then
            call context%laws(it%law)%law%evaluate(context%t, x, v, g)
            given = given + g(0)
        end if
        rest = it%sense*numbers(2)*v + (given + more)
        f = it%sense*numbers(1)*(x - numbers(3)) + rest
        power = -it%sense*rest*v
    end subroutine measure_along
end module tandem_mechanism_coordinate_force
