! SPDX-License-Identifier: MIT
!> Interface of all steppers: one-step methods on a chart. A stepper uses only t, h, increments, and the interface of the chart.
module tandem_stepper
    use tandem_chart, only: chart_type
    use tandem_kinds, only: wp
    use tandem_pack, only: pack_type
    use tandem_stepper_state, only: quintic, state_type
    implicit none (type, external)
    private

    public :: stepper_type, properties_type, weighted_norm

    !> Properties of a method.
    type :: properties_type
        !> Name in options and reports.
        character(len=16) :: name = ''
        !> Classical order and number of stages.
        integer :: order = 0, stages = 0
        !> True if stages are implicit.
        logical :: implicit = .false.
        !> Order of the error estimate, which is proportional to h**(estimate_order + 1); 0 if there is none.
        integer :: estimate_order = 0
        !> Stability in a keyword; source of the coefficients.
        character(len=48) :: stability = ''
        character(len=96) :: source = ''
        !> Order of the position between the ends of a step. For 6 (Hermite's polynomial) the order of the velocity is one less.
        integer :: dense_order = 6
        !> Fraction of the step at which the slope of the interpolant deviates most, or nearly so, from the rates of the motion.
        real(wp) :: dense_probe = 0.45_wp
        !> Explicit methods: limit of stability in terms of h |lambda|; 0 if there is none.
        real(wp) :: stability_limit = 0.0_wp
        !> True if stiff modes are damped: R(infinity) = 0.
        logical :: damps = .false.
        !> True if the step size controller predicts the next error from the last two (Gustafsson).
        logical :: is_predictive = .false.
        !> True if the order changes during a run. These properties are then those of the first steps.
        logical :: varies = .false.
        !> Stepper that replaces this one in runs for which it is cheaper; blank if none.
        character(len=16) :: partner = ''
    contains
        procedure :: has_fixed_steps
    end type properties_type

    !> A one-step method. Each stepper extends this type.
    type, abstract :: stepper_type
        !> For explicit methods: true if the chart restores the constraints at every stage, false if only at the end of a step. Set
        !> this before the first step.
        logical :: projects_stages = .true.
        !> Time scale of the model. Set it before `initialize`.
        real(wp) :: time_scale = 1.0_wp
    contains
        procedure(properties_interface), deferred, nopass :: properties
        procedure(initialize_interface), deferred :: initialize
        procedure(advance_interface), deferred :: advance
        procedure(estimate_interface), deferred :: estimate
        procedure(pack_interface), deferred :: pack_state
        procedure :: interpolate, stiffness, longest_next, order_of_estimate, learn_error
    end type stepper_type

    abstract interface
        !> Properties of the method.
        pure function properties_interface() result(properties)
            import :: properties_type
            implicit none (type, external)
            type(properties_type) :: properties
        end function properties_interface

        !> Allocate work space. Called once.
        subroutine initialize_interface(self, scale, newton_tolerance)
            import :: stepper_type, wp
            implicit none (type, external)
            class(stepper_type), intent(inout) :: self
            !> Coordinate scales (n).
            real(wp), intent(in) :: scale(:)
            !> For implicit steppers: tolerance of Newton's iteration for q and qd.
            real(wp), intent(in) :: newton_tolerance
        end subroutine initialize_interface

        !> Perform one step from `state` to `next`. `state` must be complete, including qdd; it is unchanged.
        subroutine advance_interface(self, chart, state, h, next, stat)
            import :: stepper_type, chart_type, state_type, wp
            implicit none (type, external)
            class(stepper_type), intent(inout) :: self
            class(chart_type), intent(inout) :: chart
            type(state_type), intent(in) :: state
            !> Step size.
            real(wp), intent(in) :: h
            !> On entry next%t, state%t + h up to rounding; on return the state at this time, complete if stat = 0.
            type(state_type), intent(inout) :: next
            !> A status code.
            integer, intent(out) :: stat
        end subroutine advance_interface

        !> Error of the last step in the norm of `weighted_norm`. Called only if `estimate_order` > 0.
        subroutine estimate_interface(self, chart, h, weight_q, weight_qd, norm)
            import :: stepper_type, chart_type, wp
            implicit none (type, external)
            class(stepper_type), intent(inout) :: self
            class(chart_type), intent(inout) :: chart
            !> Size of the last step.
            real(wp), intent(in) :: h
            !> Weights of the errors of q and qd (n): 1 / (atol + rtol |y|).
            real(wp), intent(in), contiguous :: weight_q(:), weight_qd(:)
            !> At most 1 if the step meets the tolerances.
            real(wp), intent(out) :: norm
        end subroutine estimate_interface

        !> Pack the state on which the next steps and the dense output of the last step depend.
        subroutine pack_interface(self, pack)
            import :: stepper_type, pack_type
            implicit none (type, external)
            class(stepper_type), intent(inout) :: self
            type(pack_type), intent(inout) :: pack
        end subroutine pack_interface
    end interface

contains

    !> True if the step size is fixed; false if errors and costs determine it.
    pure logical function has_fixed_steps(self)
        class(properties_type), intent(in) :: self

        has_fixed_steps = self%partner == '' .and. .not. self%varies
    end function has_fixed_steps

    !> Increments at a time within the last step, and their derivatives, by the polynomial of degree 5 through position increments,
    !> velocities and accelerations at both ends (Hermite). Position errors are of order h^6 and velocity errors of order h^5, which
    !> suffices for methods up to order 5. Methods with a better polynomial override this procedure.
    subroutine interpolate(self, chart, start, arrived, state, slope_q, slope_qd, stat)
        class(stepper_type), intent(inout) :: self
        class(chart_type), intent(inout) :: chart
        !> States at the ends of the step.
        type(state_type), intent(in) :: start, arrived
        !> On entry its time, between both ends; on return its increments.
        type(state_type), intent(inout) :: state
        !> Derivatives of the position and velocity increments (n).
        real(wp), intent(out), contiguous :: slope_q(:), slope_qd(:)
        !> A status code.
        integer, intent(out) :: stat
        real(wp) :: h, shape(6), slope(6), bend(6)

        stat = 0
        h = arrived%t - start%t
        call quintic(h, (state%t - start%t)/h, shape, slope, bend)
        state%dq(:) = shape(1)*start%dq + shape(2)*start%qd + shape(3)*start%qdd + &
            shape(4)*arrived%dq + shape(5)*arrived%qd + shape(6)*arrived%qdd
        slope_q = slope(1)*start%dq + slope(2)*start%qd + slope(3)*start%qdd + &
            slope(4)*arrived%dq + slope(5)*arrived%qd + slope(6)*arrived%qdd
        slope_qd = bend(1)*start%dq + bend(2)*start%qd + bend(3)*start%qdd + &
            bend(4)*arrived%dq + bend(5)*arrived%qd + bend(6)*arrived%qdd
        ! The origin of the chart cancels in the difference of velocity increment and velocity.
        state%dqd(:) = start%dqd - start%qd + slope_q
    end subroutine interpolate

    !> Store the relative error, with respect to scale + |y|, of recent steps of equal size. It determines the tolerance of the next
    !> stages.
    subroutine learn_error(self, relative)
        class(stepper_type), intent(inout) :: self
        real(wp), intent(in) :: relative

    end subroutine learn_error

    !> Estimate of h |lambda| at the end of the last step, where lambda is the largest eigenvalue of the equations of motion; 0 for
    !> methods without a stability limit.
    real(wp) function stiffness(self, h, arrived)
        class(stepper_type), intent(in) :: self
        !> Size of the last step.
        real(wp), intent(in) :: h
        !> State at the end of the last step.
        type(state_type), intent(in) :: arrived

        stiffness = 0.0_wp
    end function stiffness

    !> Largest efficient size of the next step, given the work on the stages of the last one.
    pure real(wp) function longest_next(self)
        class(stepper_type), intent(in) :: self

        longest_next = huge(1.0_wp)
    end function longest_next

    !> Order of the error estimate of the last step for a method of varying order; 0 for others.
    pure integer function order_of_estimate(self)
        class(stepper_type), intent(in) :: self

        order_of_estimate = 0
    end function order_of_estimate

    !> Root mean square of weighted errors of q and qd.
    pure real(wp) function weighted_norm(error_q, error_qd, weight_q, weight_qd)
        !> Errors and their weights (n).
        real(wp), intent(in), contiguous :: error_q(:), error_qd(:), weight_q(:), weight_qd(:)
        real(wp) :: total
        integer :: i

        total = 0.0_wp
        do i = 1, size(error_q)
            total = total + (error_q(i)*weight_q(i))**2 + (error_qd(i)*weight_qd(i))**2
        end do
        weighted_norm = sqrt(total/real(2*size(error_q), wp))
    end function weighted_norm
end module tandem_stepper
