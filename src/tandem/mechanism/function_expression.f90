! SPDX-License-Identifier: MIT
!> A function of time that is given by an expression of t.
module tandem_mechanism_function_expression
    use tandem_kinds, only: wp
    use tandem_mechanism_expression, only: expression_type
    use tandem_mechanism_function, only: function_type
    implicit none (type, external)
    private

    public :: expression_of_time_type

    type, extends(function_type) :: expression_of_time_type
        type(expression_type) :: expression
    contains
        procedure :: evaluate
    end type expression_of_time_type

contains

    !> Value, first and second derivative.
    pure subroutine evaluate(self, t, f)
        class(expression_of_time_type), intent(in) :: self
        real(wp), intent(in) :: t
        real(wp), intent(out) :: f(0:2)

        call self%expression%evaluate_along([t], [1.0_wp], f(0), f(1), f(2))
    end subroutine evaluate
end module tandem_mechanism_function_expression
