! SPDX-License-Identifier: MIT
!> Error control of the motion between the ends of steps, if states there are requested.
submodule(tandem_simulation) tandem_simulate_between
    use tandem_simulate_warning, only: dense_limit
    implicit none (type, external)

contains

    module procedure judge_between
        !> Steps of fewer spacings of the time than this show rounding.
        real(wp), parameter :: shortest = 1.0e4_wp
        real(wp) :: h, norm
        integer :: order, stat

        is_refused = .false.
        h = self%state%t - self%start%t
        if (.not. (self%between%control%is_due(self%control%norm) .and. h > shortest*spacing(abs(self%state%t)))) then
            call self%between%control%skip()
            return
        end if
        call measure(self, norm, stat)
        ! A request there reports the failure of its evaluation.
        if (stat /= status_ok .or. .not. norm <= huge(1.0_wp)) return
        order = self%method%estimate_order
        if (self%method%varies) order = self%stepper%order_of_estimate()
        call self%between%control%judge(h, norm, self%control%norm, real(order + 1, wp), is_refused)
        if (.not. is_refused) return
        self%tally%rejected = self%tally%rejected + 1
        call self%control%reject(h, norm)
        call self%lost_rank%go_back(h)
        call self%chart%set_memory()
        self%attempts%hindrance = status_ok
    end procedure judge_between

    !> The error within the last step relative to its limit: at the method's position, and unless it is far below the limit also
    !> near the end, where errors are largest in steps into a bend of the motion.
    subroutine measure(self, norm, stat)
        class(simulation_type), intent(inout) :: self
        real(wp), intent(out) :: norm
        integer, intent(out) :: stat
        !> The error at such a position may be this part of the largest.
        real(wp), parameter :: share = 0.5_wp
        real(wp), parameter :: near_end = 0.9_wp, far_below = 0.1_wp
        real(wp) :: second

        call measure_at(self%method%dense_probe, norm)
        if (stat /= status_ok .or. .not. (norm > far_below .and. norm <= 1.0_wp)) return
        call measure_at(near_end, second)
        norm = max(norm, second)

    contains

        subroutine measure_at(place, norm)
            real(wp), intent(in) :: place
            real(wp), intent(out) :: norm

            call self%between%output%measure(place, self%stepper, self%chart, self%model, self%method%implicit, self%local_error, &
                self%start, self%state, self%control%weight_q, self%control%weight_qd, norm, stat)
            norm = norm/(share*dense_limit)
        end subroutine measure_at
    end subroutine measure
end submodule tandem_simulate_between
