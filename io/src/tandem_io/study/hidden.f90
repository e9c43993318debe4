! SPDX-License-Identifier: MIT
!> A model whose kinks and jumps are hidden: its terms depend on t in a piecewise manner, but it declares no breakpoints. This is a
!> common error of users.
module tandem_io_study_hidden
    use tandem, only: derivatives_type, model_type, terms_type, wp
    implicit none (type, external)
    private

    public :: hidden_type

    type, extends(model_type) :: hidden_type
        !> Model that declares its breakpoints.
        class(model_type), allocatable :: inner
    contains
        procedure :: hide
    end type hidden_type

contains

    !> Hide the breakpoints of a model that evaluates all terms and all derivatives in one procedure each.
    subroutine hide(self, inner)
        class(hidden_type), intent(inout) :: self
        class(model_type), intent(in) :: inner

        allocate (self%inner, source=inner)
        self%name = inner%name
        self%n = inner%n
        self%n_holonomic = inner%n_holonomic
        self%n_nonholonomic = inner%n_nonholonomic
        self%constant_mass = inner%constant_mass
        self%evaluate => evaluate
        self%provides = inner%provides
        self%evaluate_derivatives => evaluate_derivatives
        self%provides_derivatives = inner%provides_derivatives
        if (associated(inner%potential_energy)) self%potential_energy => potential_energy
    end subroutine hide

    !> Evaluate the terms of the smooth piece that contains t.
    subroutine evaluate(self, need, t, q, qd, terms, stat)
        class(model_type), intent(inout) :: self
        integer, intent(in) :: need
        real(wp), intent(in) :: t, q(:), qd(:)
        type(terms_type), intent(inout) :: terms
        integer, intent(out) :: stat

        stat = 0
        select type (self)
        class is (hidden_type)
            self%inner%segment = 1 + count(self%inner%breakpoints <= t)
            call self%inner%evaluate(need, t, q, qd, terms, stat)
        end select
    end subroutine evaluate

    subroutine evaluate_derivatives(self, need, t, q, qd, qdd, lambda, derivatives, stat)
        class(model_type), intent(inout) :: self
        integer, intent(in) :: need
        real(wp), intent(in) :: t, q(:), qd(:), qdd(:), lambda(:)
        type(derivatives_type), intent(inout) :: derivatives
        integer, intent(out) :: stat

        stat = 0
        select type (self)
        class is (hidden_type)
            self%inner%segment = 1 + count(self%inner%breakpoints <= t)
            call self%inner%evaluate_derivatives(need, t, q, qd, qdd, lambda, derivatives, stat)
        end select
    end subroutine evaluate_derivatives

    subroutine potential_energy(self, t, q, value, stat)
        class(model_type), intent(inout) :: self
        real(wp), intent(in) :: t, q(:)
        real(wp), intent(out) :: value
        integer, intent(out) :: stat

        stat = 0
        value = 0.0_wp
        select type (self)
        class is (hidden_type)
            call self%inner%potential_energy(t, q, value, stat)
        end select
    end subroutine potential_energy
end module tandem_io_study_hidden
