! SPDX-License-Identifier: MIT
!> Functions of time: imposed motions, lengths, forces. Each gives its value and its first two derivatives, so that rows that
!> depend on time keep an exact gamma.
module tandem_mechanism_function
    use tandem_kinds, only: wp
    implicit none (type, external)
    private

    public :: function_type, constant_type, polynomial_type, sine_type, ramp

    !> A function of time; extend it for another one.
    type, abstract :: function_type
    contains
        procedure(evaluate_interface), deferred :: evaluate
    end type function_type

    abstract interface
        !> Value, first and second derivative.
        pure subroutine evaluate_interface(self, t, f)
            import :: function_type, wp
            implicit none (type, external)
            class(function_type), intent(in) :: self
            !> Time (s).
            real(wp), intent(in) :: t
            !> f, f', f''.
            real(wp), intent(out) :: f(0:2)
        end subroutine evaluate_interface
    end interface

    !> A number.
    type, extends(function_type) :: constant_type
        real(wp) :: value = 0.0_wp
    contains
        procedure :: evaluate => evaluate_constant
    end type constant_type

    !> sum over k of coefficient(k) t**(k - 1).
    type, extends(function_type) :: polynomial_type
        real(wp), allocatable :: coefficient(:)
    contains
        procedure :: evaluate => evaluate_polynomial
    end type polynomial_type

    !> offset + amplitude sin(rate t + phase).
    type, extends(function_type) :: sine_type
        real(wp) :: offset = 0.0_wp, amplitude = 1.0_wp, rate = 1.0_wp, phase = 0.0_wp
    contains
        procedure :: evaluate => evaluate_sine
    end type sine_type

contains

    !> start + rate t.
    pure function ramp(start, rate) result(f)
        real(wp), intent(in) :: start, rate
        type(polynomial_type) :: f

        allocate (f%coefficient, source=[start, rate])
    end function ramp

    pure subroutine evaluate_constant(self, t, f)
        class(constant_type), intent(in) :: self
        real(wp), intent(in) :: t
        real(wp), intent(out) :: f(0:2)

        ! Every function looks at the time, this one in vain.
        f = [self%value, 0.0_wp*t, 0.0_wp*t]
    end subroutine evaluate_constant

    !> Horner's scheme, for the derivatives too.
    pure subroutine evaluate_polynomial(self, t, f)
        class(polynomial_type), intent(in) :: self
        real(wp), intent(in) :: t
        real(wp), intent(out) :: f(0:2)
        integer :: k

        f = 0.0_wp
        if (.not. allocated(self%coefficient)) return
        do k = size(self%coefficient), 1, -1
            f(2) = f(2)*t + 2*f(1)
            f(1) = f(1)*t + f(0)
            f(0) = f(0)*t + self%coefficient(k)
        end do
    end subroutine evaluate_polynomial

    pure subroutine evaluate_sine(self, t, f)
        class(sine_type), intent(in) :: self
        real(wp), intent(in) :: t
        real(wp), intent(out) :: f(0:2)
        real(wp) :: s, c

        s = self%amplitude*sin(self%rate*t + self%phase)
        c = self%amplitude*cos(self%rate*t + self%phase)
        f = [self%offset + s, self%rate*c, -self%rate**2*s]
    end subroutine evaluate_sine
end module tandem_mechanism_function
