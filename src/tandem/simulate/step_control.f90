! SPDX-License-Identifier: MIT
!> Step size controller: converts tolerances to weights, and error norms to step sizes.
!>
!> Proportional-integral control of the error per step. Source: K. Gustafsson, ACM TOMS 17 (1991) 533-554; Hairer, Wanner,
!> Solving Ordinary Differential Equations II, section IV.2.
!>
!> If stability limits an explicit stepper, errors grow with the step size far faster than the order predicts. Steps that follow the
!> errors alone would be rejected, repeated with a size that is too small, and grow until the next rejection. Steps are therefore
!> limited by the largest eigenvalue, as estimated from the last steps.
module tandem_simulate_step_control
    use tandem_kinds, only: wp
    use tandem_options, only: options_type
    use tandem_pack, only: pack_type
    use tandem_stepper, only: properties_type
    implicit none (type, external)
    private

    public :: step_control_type

    type :: step_control_type
        !> Next step size to try; 0 before the first step.
        real(wp) :: h = 0.0_wp
        real(wp), private :: first_step = 0.0_wp
        !> The time scale of the model.
        real(wp), private :: unit = 1.0_wp
        !> 1/(atol scale + rtol |y|) for q and qd (n). Like the following arrays, allocated only under error control.
        real(wp), allocatable :: weight_q(:), weight_qd(:)
        !> rtol, and atol times scale, for q and qd (n).
        real(wp), allocatable, private :: rtol_q(:), rtol_qd(:), atol_q(:), atol_qd(:)
        !> Upper bounds of |q| in tolerances (n), pi for an angle; allocated only if any coordinate is an angle.
        real(wp), allocatable, private :: largest_q(:)
        real(wp), private :: max_step = huge(1.0_wp)
        integer, private :: order = 4
        real(wp), private :: exponent = 0.2_wp, last_norm = 1.0e-4_wp
        !> Error norm of the last accepted step.
        real(wp) :: norm = 0.0_wp
        !> Ratio of a step size to the one with an error norm of 1; corresponding target of the norm.
        real(wp), private :: safety = 0.8_wp, aim = 0.8_wp**5
        !> Weight of the last error; h |lambda| at which it has the full weight.
        real(wp), private :: integral = 0.0_wp, damped_from = 0.0_wp
        !> True if the last step was at the limit of stability: close to it, or not followed by a larger one because of it.
        logical :: is_at_limit = .false.
        !> True if only errors and stability limited the last accepted step.
        logical :: is_free = .false.
        !> h |lambda| at the limit of stability, 0 if there is none; largest |lambda| of the last steps, 0 if unknown.
        real(wp), private :: stability_limit = 0.0_wp, lambda = 0.0_wp
        logical, private :: was_rejected = .false.
        !> True if the next error is predicted from the last two; size of the last accepted step, 0 if there is none.
        logical, private :: is_predictive = .false.
        real(wp), private :: last_step = 0.0_wp
        !> Size of the last rejected step, 0 if there is none; number of accepted steps since then; limit of the step size after two
        !> successive rejections at similar sizes, huge if there is none.
        real(wp), private :: rejected_size = 0.0_wp, rejection_limit = huge(1.0_wp)
        integer, private :: steps_since_rejection = 0
    contains
        procedure :: initialize, set_method, set_order, set_weights
        procedure :: accept, reject, fail
        procedure :: set_max_step, stay_below, limit, begin, restart, pack_state
        procedure, private :: round_down, record_rejection
    end type step_control_type

    !> Bounds of the ratio of successive step sizes.
    real(wp), parameter :: least_factor = 0.2_wp, largest_factor = 6.0_wp
    !> Estimates of h |lambda| up to this value give no information about lambda, because steps that resolve a motion have a value
    !> of about 1 at all sizes.
    real(wp), parameter :: resolved = 2.0_wp
    !> Decay factor per step of a stored eigenvalue; fraction of the stability limit below which error control itself is stable.
    real(wp), parameter :: fading = 0.8_wp, nearly = 0.9_wp
    !> Two rejections have the same cause if the ratio of their step sizes is at most `alike` and at most `soon` steps lie between
    !> them. The step size is then limited to the fraction `below` of the second; each accepted step raises this limit by the factor
    !> `rise`.
    real(wp), parameter :: alike = 1.25_wp, below = 0.85_wp, rise = 1.02_wp
    integer, parameter :: soon = 10
    !> Sizes of explicit steps are the time scale times powers of this number. Otherwise rounding errors of the error norm would
    !> change the step sizes, and be amplified at the limit of stability. Runs thus take the same steps in other units and with
    !> other compilers.
    real(wp), parameter :: grid_ratio = 2.0_wp**(1.0_wp/32)

contains

    !> Begin with tolerances, coordinate scales (n) and a method with an error estimate.
    subroutine initialize(self, options, scale, time_scale, method, largest_q)
        class(step_control_type), intent(inout) :: self
        type(options_type), intent(in) :: options
        real(wp), intent(in) :: scale(:)
        !> Velocities have the scale of their coordinates divided by this time.
        real(wp), intent(in) :: time_scale
        type(properties_type), intent(in) :: method
        !> Upper bound of each |q| in its tolerance (n); unbounded by default.
        real(wp), intent(in), optional :: largest_q(:)

        self%unit = time_scale
        self%max_step = huge(1.0_wp)
        if (options%max_step > 0.0_wp) self%max_step = options%max_step
        self%first_step = min(options%first_step, self%max_step)
        call self%set_method(method)
        call self%begin()
        if (allocated(self%largest_q)) deallocate (self%largest_q)
        if (.not. options%is_adaptive()) return
        if (present(largest_q)) self%largest_q = largest_q
        self%weight_q = scale
        self%weight_qd = scale
        self%rtol_q = scale
        self%rtol_qd = scale
        self%atol_q = scale
        self%atol_qd = scale
        call options%fill_tolerances(self%rtol_q, self%rtol_qd, self%atol_q, self%atol_qd)
        self%atol_q = self%atol_q*scale
        self%atol_qd = self%atol_qd*(scale/time_scale)
    end subroutine initialize

    !> Set the method, which must have an error estimate.
    pure subroutine set_method(self, method)
        class(step_control_type), intent(inout) :: self
        type(properties_type), intent(in) :: method

        self%order = method%estimate_order
        self%exponent = 1.0_wp/real(method%estimate_order + 1, wp)
        ! No integral part for implicit steppers: their errors vary irregularly with the accuracy of Newton's iteration.
        self%safety = 0.8_wp
        self%integral = 0.0_wp
        if (.not. method%implicit) then
            self%safety = 0.7_wp
            self%integral = 0.04_wp
        end if
        ! The long steps of a method of high order cover a different part of the motion each time. Their last error predicts the
        ! next one only near the limit of stability, where it damps oscillations of the step size.
        self%damped_from = merge(0.25_wp*method%stability_limit, 0.0_wp, method%estimate_order >= 7)
        self%aim = self%safety**(1.0_wp/self%exponent)
        self%stability_limit = method%stability_limit
        self%is_predictive = method%is_predictive
    end subroutine set_method

    !> Change the order of the error estimate. Errors of different orders cannot be used for prediction.
    pure subroutine set_order(self, estimate_order)
        class(step_control_type), intent(inout) :: self
        integer, intent(in) :: estimate_order

        if (estimate_order == self%order) return
        self%order = estimate_order
        self%exponent = 1.0_wp/real(estimate_order + 1, wp)
        self%aim = self%safety**(1.0_wp/self%exponent)
        self%last_step = 0.0_wp
    end subroutine set_order

    !> Set the weights for a step from (q0, qd0) to (q, qd).
    pure subroutine set_weights(self, q0, q, qd0, qd)
        class(step_control_type), intent(inout) :: self
        !> Coordinates and velocities at both ends (n).
        real(wp), intent(in), contiguous :: q0(:), q(:), qd0(:), qd(:)
        !> Rounding error of a large angle, part of which enters the error estimates.
        real(wp), parameter :: rounding = 4*epsilon(1.0_wp)
        real(wp) :: large
        integer :: i

        do i = 1, size(q)
            self%weight_q(i) = 1.0_wp/(self%atol_q(i) + self%rtol_q(i)*max(abs(q0(i)), abs(q(i))))
            self%weight_qd(i) = 1.0_wp/(self%atol_qd(i) + self%rtol_qd(i)*max(abs(qd0(i)), abs(qd(i))))
        end do
        if (.not. allocated(self%largest_q)) return
        do i = 1, size(q)
            large = max(abs(q0(i)), abs(q(i)))
            if (large > self%largest_q(i)) self%weight_q(i) = 1.0_wp/max(self%atol_q(i) + self%rtol_q(i)*self%largest_q(i), &
                rounding*large)
        end do
    end subroutine set_weights

    !> Choose the next step size after an accepted step of size h with the given error norm.
    subroutine accept(self, h, was_cut, norm, stiffness, longest)
        class(step_control_type), intent(inout) :: self
        !> Step size, its error norm, and h |lambda| as estimated by the stepper.
        real(wp), intent(in) :: h, norm, stiffness
        !> Longest efficient next step, from the stepper.
        real(wp), intent(in) :: longest
        !> True if the step was shortened by a breakpoint or the end of the run, so that the size `self%h` was not tried.
        logical, intent(in) :: was_cut
        real(wp) :: factor, integral, wanted

        integral = self%integral
        if (self%damped_from > 0.0_wp) integral = integral*min(1.0_wp, (stiffness/self%damped_from)**2)
        factor = (max(norm, tiny(1.0_wp))/self%aim)**(0.75_wp*integral - self%exponent)*(self%last_norm/self%aim)**integral
        ! Predict that an error that has grown in the last step grows again (Gustafsson 1994; Hairer, Wanner II, (IV.8.25)).
        if (self%is_predictive .and. self%last_step > 0.0_wp) factor = min(factor, h/self%last_step* &
            (self%aim*max(self%last_norm, 0.01_wp)/max(norm, tiny(1.0_wp))**2)**self%exponent)
        self%last_step = h
        factor = min(largest_factor, max(least_factor, factor))
        if (self%was_rejected) factor = min(1.0_wp, factor)
        wanted = factor*h
        self%is_at_limit = .false.
        if (self%stability_limit > 0.0_wp) then
            self%lambda = max(merge(stiffness/h, 0.0_wp, stiffness > resolved), fading*self%lambda)
            self%is_at_limit = stiffness > nearly*self%stability_limit
            if (self%lambda*wanted > max(self%stability_limit, self%lambda*h)) then
                wanted = max(h, self%stability_limit/self%lambda)
                self%is_at_limit = self%is_at_limit .or. wanted < 2*h
            end if
        end if
        if (was_cut) wanted = max(wanted, self%h)
        wanted = min(wanted, max(longest, least_factor*h), self%rejection_limit)
        if (self%rejection_limit < huge(1.0_wp)) self%rejection_limit = rise*self%rejection_limit
        if (self%rejection_limit > alike*self%rejected_size) self%rejection_limit = huge(1.0_wp)
        self%steps_since_rejection = min(self%steps_since_rejection, soon) + 1
        self%is_free = .not. was_cut .and. h < 0.9_wp*self%max_step
        self%h = self%limit(wanted)
        self%last_norm = max(norm, 1.0e-4_wp)
        self%norm = norm
        self%was_rejected = .false.
    end subroutine accept

    !> Choose a smaller step size after a step of size h with an error norm above 1.
    subroutine reject(self, h, norm)
        class(step_control_type), intent(inout) :: self
        real(wp), intent(in) :: h, norm
        real(wp) :: factor

        factor = least_factor
        if (norm <= huge(1.0_wp)) factor = min(0.9_wp, max(least_factor, self%safety*norm**(-self%exponent)))
        self%h = self%round_down(factor*h)
        self%was_rejected = .true.
        call self%record_rejection(h)
    end subroutine reject

    !> Choose a smaller step size after a failed step of size h.
    subroutine fail(self, h)
        class(step_control_type), intent(inout) :: self
        real(wp), intent(in) :: h

        self%h = 0.25_wp*h
        self%was_rejected = .true.
        call self%record_rejection(h)
    end subroutine fail

    !> Record a rejected step of size h. Near the limit of a chart, errors grow faster than the order predicts, and step sizes that
    !> follow the errors would be rejected repeatedly. After two rejections at similar sizes, step sizes remain below them.
    pure subroutine record_rejection(self, h)
        class(step_control_type), intent(inout) :: self
        real(wp), intent(in) :: h

        if (self%stability_limit > 0.0_wp .and. self%steps_since_rejection > 0 .and. self%steps_since_rejection <= soon .and. &
            max(h, self%rejected_size) < alike*min(h, self%rejected_size)) self%rejection_limit = below*h
        self%rejected_size = h
        self%steps_since_rejection = 0
    end subroutine record_rejection

    !> Set the largest step size from now on.
    subroutine set_max_step(self, max_step)
        class(step_control_type), intent(inout) :: self
        real(wp), intent(in) :: max_step

        self%max_step = max_step
        self%first_step = min(self%first_step, max_step)
        self%h = min(self%h, max_step)
    end subroutine set_max_step

    !> Limit the next step size.
    pure subroutine stay_below(self, longest)
        class(step_control_type), intent(inout) :: self
        real(wp), intent(in) :: longest

        if (longest < self%h) self%h = self%limit(longest)
    end subroutine stay_below

    !> Step size within the limits.
    pure real(wp) function limit(self, h)
        class(step_control_type), intent(in) :: self
        real(wp), intent(in) :: h

        limit = min(self%round_down(h), self%max_step)
    end function limit

    !> Largest allowed step size, a power of `grid_ratio`, up to h. Returns h for implicit steppers, which have no limit of
    !> stability.
    pure real(wp) function round_down(self, h)
        class(step_control_type), intent(in) :: self
        real(wp), intent(in) :: h
        !> Slack by which a size on the grid is recognised and left unchanged.
        real(wp), parameter :: slack = 1.0e-6_wp

        round_down = h
        ! Invalid step sizes, zero or NaN, are refused elsewhere.
        if (.not. (self%stability_limit > 0.0_wp .and. h >= tiny(h) .and. h <= huge(h))) return
        round_down = self%unit*grid_ratio**floor(log(h/self%unit)/log(grid_ratio) + slack)
    end function round_down

    !> Clear the history, so that the next step is chosen like the first step.
    pure subroutine begin(self)
        class(step_control_type), intent(inout) :: self

        self%h = self%first_step
        call self%restart()
    end subroutine begin

    !> Clear the history of errors after a breakpoint.
    pure subroutine restart(self)
        class(step_control_type), intent(inout) :: self

        self%last_norm = self%aim
        self%last_step = 0.0_wp
        self%lambda = 0.0_wp
        self%is_at_limit = .false.
        self%was_rejected = .false.
        self%rejected_size = 0.0_wp
        self%rejection_limit = huge(1.0_wp)
        self%steps_since_rejection = 0
    end subroutine restart

    !> Pack the next step size and the history.
    subroutine pack_state(self, pack)
        class(step_control_type), intent(inout) :: self
        type(pack_type), intent(inout) :: pack
        integer :: order

        order = self%order
        call pack%item(self%h)
        call pack%item(order)
        call self%set_order(order)
        call pack%item(self%last_norm, self%last_step, self%lambda)
        call pack%item(self%is_at_limit, self%was_rejected, self%is_free)
        call pack%item(self%rejected_size, self%rejection_limit)
        call pack%item(self%steps_since_rejection)
    end subroutine pack_state
end module tandem_simulate_step_control
