! SPDX-License-Identifier: MIT
!> The step size controller: tolerances into weights, error norms into new step sizes.
!>
!> Proportional-integral control of the error per step. Source: K. Gustafsson, ACM TOMS 17 (1991) 533-554; Hairer, Wanner,
!> Solving Ordinary Differential Equations II, section IV.2.
!>
!> If stability limits an explicit stepper, errors grow with the step far faster than its order predicts: steps that follow the
!> errors alone are rejected, repeated too small, and grow into the next rejection. So no step exceeds the limit set by the largest
!> eigenvalue, as estimated from the last steps.
module tandem_simulate_step_control
    use tandem_kinds, only: wp
    use tandem_options, only: options_type
    use tandem_pack, only: pack_type
    use tandem_stepper, only: properties_type
    implicit none (type, external)
    private

    public :: step_control_type

    type :: step_control_type
        !> The step to try next; 0 before the first.
        real(wp) :: h = 0.0_wp
        real(wp), private :: first_step = 0.0_wp
        !> The time scale of the model.
        real(wp), private :: unit = 1.0_wp
        !> 1 / (atol s + rtol |y|) for q and for qd (n), s the coordinate scales; allocated only under error control, like the
        !> following arrays.
        real(wp), allocatable :: weight_q(:), weight_qd(:)
        !> rtol and atol s for q and for qd (n).
        real(wp), allocatable, private :: rtol_q(:), rtol_qd(:), atol_q(:), atol_qd(:)
        !> Upper bound of |q| in tolerances (n): half a turn of an angle; only if there are angles.
        real(wp), allocatable, private :: largest_q(:)
        real(wp), private :: max_step = huge(1.0_wp)
        integer, private :: order = 4
        real(wp), private :: exponent = 0.2_wp, last_norm = 1.0e-4_wp
        !> The error norm of the last accepted step.
        real(wp) :: norm = 0.0_wp
        !> Ratio of a step to the one whose error norm would be 1, and the resulting target of the norm.
        real(wp), private :: safety = 0.8_wp, aim = 0.8_wp**5
        !> Weight of the last error, and h |lambda| from which on it counts in full.
        real(wp), private :: integral = 0.0_wp, damped_from = 0.0_wp
        !> True if the last step was at the limit of stability: nearly there, or not followed by a larger one for that reason.
        logical :: is_at_limit = .false.
        !> True if only errors and stability limited the last accepted step.
        logical :: is_free = .false.
        !> h |lambda| at the limit, 0 for none; the largest |lambda| of the last steps, 0 if unknown.
        real(wp), private :: stability_limit = 0.0_wp, lambda = 0.0_wp
        logical, private :: was_rejected = .false.
        !> True if the next error is predicted from the last two; the last accepted step, 0 for none.
        logical, private :: is_predictive = .false.
        real(wp), private :: last_step = 0.0_wp
        !> The last rejected step, 0 for none, and the number of accepted ones since; the longest step to be tried after two
        !> successive rejections at similar sizes, huge if there is no such limit.
        real(wp), private :: barrier = 0.0_wp, ceiling = huge(1.0_wp)
        integer, private :: since_barrier = 0
    contains
        procedure :: initialize, set_method, set_order, set_weights
        procedure :: accept, reject, fail
        procedure :: set_max_step, stay_below, limit, begin, restart, pack_state
        procedure, private :: round_down, meet_barrier
    end type step_control_type

    !> A step changes by no more than these factors.
    real(wp), parameter :: least_factor = 0.2_wp, largest_factor = 6.0_wp
    !> Estimates of h |lambda| up to this carry no information about lambda: a motion resolved by the steps has one of about 1, for
    !> all step sizes.
    real(wp), parameter :: resolved = 2.0_wp
    !> Factor of a step on the memory of an eigenvalue, and the part of the limit at which error control is stable by itself.
    real(wp), parameter :: fading = 0.8_wp, nearly = 0.9_wp
    !> Two rejected steps have one cause if their ratio is at most this and at most `soon` steps lie between them. Then steps stay
    !> below this part of the second, and each accepted one raises the limit by this factor.
    real(wp), parameter :: alike = 1.25_wp, below = 0.85_wp, rise = 1.02_wp
    integer, parameter :: soon = 10
    !> Explicit steps are the time scale times powers of this: rounding of an error must not affect the steps, which would amplify
    !> it at the limit of stability. So a run takes the same steps in other units, or with another compiler.
    real(wp), parameter :: notch = 2.0_wp**(1.0_wp/32)

contains

    !> Begin with tolerances, coordinate scales (n) and a method with an estimate.
    subroutine initialize(self, options, scale, time_scale, method, largest_q)
        class(step_control_type), intent(inout) :: self
        type(options_type), intent(in) :: options
        real(wp), intent(in) :: scale(:)
        !> A velocity has the scale s over this.
        real(wp), intent(in) :: time_scale
        type(properties_type), intent(in) :: method
        !> Upper bound of each |q| in its tolerance (n); no bound if absent.
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

    !> Control the steps of a method with an estimate.
    pure subroutine set_method(self, method)
        class(step_control_type), intent(inout) :: self
        type(properties_type), intent(in) :: method

        self%order = method%estimate_order
        self%exponent = 1.0_wp/real(method%estimate_order + 1, wp)
        ! Implicit steppers have no integral part: their errors jump with Newton's.
        self%safety = 0.8_wp
        self%integral = 0.0_wp
        if (.not. method%implicit) then
            self%safety = 0.7_wp
            self%integral = 0.04_wp
        end if
        ! The long steps of a method of high order cover another part of the motion each time: their last error predicts the next
        ! one only near the limit of stability, where it damps oscillations of the step size.
        self%damped_from = merge(0.25_wp*method%stability_limit, 0.0_wp, method%estimate_order >= 7)
        self%aim = self%safety**(1.0_wp/self%exponent)
        self%stability_limit = method%stability_limit
        self%is_predictive = method%is_predictive
    end subroutine set_method

    !> Change the order of the error estimate: errors of different orders give no prediction.
    pure subroutine set_order(self, estimate_order)
        class(step_control_type), intent(inout) :: self
        integer, intent(in) :: estimate_order

        if (estimate_order == self%order) return
        self%order = estimate_order
        self%exponent = 1.0_wp/real(estimate_order + 1, wp)
        self%aim = self%safety**(1.0_wp/self%exponent)
        self%last_step = 0.0_wp
    end subroutine set_order

    !> Weights for a step from (q0, qd0) to (q, qd).
    pure subroutine set_weights(self, q0, q, qd0, qd)
        class(step_control_type), intent(inout) :: self
        !> Coordinates and velocities at both ends (n).
        real(wp), intent(in), contiguous :: q0(:), q(:), qd0(:), qd(:)
        !> Rounding error of a large angle, which partly enters the error estimates.
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

    !> Choose the next step after an accepted one of size h with an error norm.
    subroutine accept(self, h, was_cut, norm, stiffness, longest)
        class(step_control_type), intent(inout) :: self
        !> The step, its error norm, and h |lambda| as the stepper estimates it.
        real(wp), intent(in) :: h, norm, stiffness
        !> The longest efficient next step, from the stepper.
        real(wp), intent(in) :: longest
        !> True if the step was cut short by a breakpoint or the end, so that `self%h` was not tried.
        logical, intent(in) :: was_cut
        real(wp) :: factor, integral, wanted

        integral = self%integral
        if (self%damped_from > 0.0_wp) integral = integral*min(1.0_wp, (stiffness/self%damped_from)**2)
        factor = (max(norm, tiny(1.0_wp))/self%aim)**(0.75_wp*integral - self%exponent)*(self%last_norm/self%aim)**integral
        ! An error that has grown from step to step is predicted to grow again (Gustafsson 1994; Hairer, Wanner II, (IV.8.25)).
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
        wanted = min(wanted, max(longest, least_factor*h), self%ceiling)
        if (self%ceiling < huge(1.0_wp)) self%ceiling = rise*self%ceiling
        if (self%ceiling > alike*self%barrier) self%ceiling = huge(1.0_wp)
        self%since_barrier = min(self%since_barrier, soon) + 1
        self%is_free = .not. was_cut .and. h < 0.9_wp*self%max_step
        self%h = self%limit(wanted)
        self%last_norm = max(norm, 1.0e-4_wp)
        self%norm = norm
        self%was_rejected = .false.
    end subroutine accept

    !> Choose a smaller step after one of size h whose error norm is above 1.
    subroutine reject(self, h, norm)
        class(step_control_type), intent(inout) :: self
        real(wp), intent(in) :: h, norm
        real(wp) :: factor

        factor = least_factor
        if (norm <= huge(1.0_wp)) factor = min(0.9_wp, max(least_factor, self%safety*norm**(-self%exponent)))
        self%h = self%round_down(factor*h)
        self%was_rejected = .true.
        call self%meet_barrier(h)
    end subroutine reject

    !> Choose a smaller step after one of size h that could not be completed.
    subroutine fail(self, h)
        class(step_control_type), intent(inout) :: self
        real(wp), intent(in) :: h

        self%h = 0.25_wp*h
        self%was_rejected = .true.
        call self%meet_barrier(h)
    end subroutine fail

    !> Record a rejected step of size h. At the end of a chart's reach, errors grow faster than the order predicts, and steps that
    !> grow by their errors alone are refused repeatedly: after two refusals at one size steps stay below it.
    pure subroutine meet_barrier(self, h)
        class(step_control_type), intent(inout) :: self
        real(wp), intent(in) :: h

        if (self%stability_limit > 0.0_wp .and. self%since_barrier > 0 .and. self%since_barrier <= soon .and. &
            max(h, self%barrier) < alike*min(h, self%barrier)) self%ceiling = below*h
        self%barrier = h
        self%since_barrier = 0
    end subroutine meet_barrier

    !> The largest step from here on.
    subroutine set_max_step(self, max_step)
        class(step_control_type), intent(inout) :: self
        real(wp), intent(in) :: max_step

        self%max_step = max_step
        self%first_step = min(self%first_step, max_step)
        self%h = min(self%h, max_step)
    end subroutine set_max_step

    !> The next step is no longer than this.
    pure subroutine stay_below(self, longest)
        class(step_control_type), intent(inout) :: self
        real(wp), intent(in) :: longest

        if (longest < self%h) self%h = self%limit(longest)
    end subroutine stay_below

    !> A step within the limits.
    pure real(wp) function limit(self, h)
        class(step_control_type), intent(in) :: self
        real(wp), intent(in) :: h

        limit = min(self%round_down(h), self%max_step)
    end function limit

    !> The largest notch, a power of `notch`, up to h; h itself for implicit steppers, which have no limit of stability.
    pure real(wp) function round_down(self, h)
        class(step_control_type), intent(in) :: self
        real(wp), intent(in) :: h
        !> A size that already is a notch is unchanged.
        real(wp), parameter :: hair = 1.0e-6_wp

        round_down = h
        ! An invalid step, zero or not a number, is refused elsewhere.
        if (.not. (self%stability_limit > 0.0_wp .and. h >= tiny(h) .and. h <= huge(h))) return
        round_down = self%unit*notch**floor(log(h/self%unit)/log(notch) + hair)
    end function round_down

    !> Clear the history of steps, so that the next one is chosen like the first one.
    pure subroutine begin(self)
        class(step_control_type), intent(inout) :: self

        self%h = self%first_step
        call self%restart()
    end subroutine begin

    !> Clear the history of errors, after a breakpoint.
    pure subroutine restart(self)
        class(step_control_type), intent(inout) :: self

        self%last_norm = self%aim
        self%last_step = 0.0_wp
        self%lambda = 0.0_wp
        self%is_at_limit = .false.
        self%was_rejected = .false.
        self%barrier = 0.0_wp
        self%ceiling = huge(1.0_wp)
        self%since_barrier = 0
    end subroutine restart

    !> The step to try next and the memory of the last.
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
        call pack%item(self%barrier, self%ceiling)
        call pack%item(self%since_barrier)
    end subroutine pack_state
end module tandem_simulate_step_control
