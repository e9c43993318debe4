! SPDX-License-Identifier: MIT
!> The rows of a result file: fields of states at steps or at times between them.
submodule(tandem_io_output_trajectory) tandem_io_output_rows
    use tandem_io_output_fields, only: field_acceleration_error, field_chart, field_lambda, field_position_error, &
        field_qdd, field_step, field_velocity_error
    use tandem_status, only: status_callback_failed
    implicit none (type, external)

contains

    module procedure gather
        real(wp) :: energy
        integer :: i, n, stat

        if (size(self%quantities) > 0) call self%measure(simulation, error)
        if (allocated(error)) return
        stat = 0
        energy = 0.0_wp
        n = 0
        self%gathered = self%gathered + 1
        do i = 0, ubound(self%series, 1)
            associate (row => self%series(i)%rows(:, self%gathered), state => simulation%state)
                select case (self%series(i)%field)
                case (0)
                    row(1) = state%t
                case (field_q)
                    row = state%q
                case (field_qd)
                    row = state%qd
                case (field_qdd)
                    row = state%qdd
                case (field_lambda)
                    call simulation%multipliers(self%series(i)%rows(:, self%gathered))
                case (field_position_error, field_velocity_error, field_acceleration_error)
                    row(1) = simulation%errors(self%series(i)%field - field_position_error + 1)
                case (field_kinetic_energy)
                    call simulation%kinetic_energy(row(1), stat)
                    energy = energy + row(1)
                case (field_potential_energy)
                    call simulation%potential_energy(row(1), stat)
                    energy = energy + row(1)
                case (field_step)
                    row(1) = merge(0.0_wp, simulation%last_step, self%is_between)
                case (field_chart)
                    row(1) = real(number_of_charts(simulation), wp)
                case default
                    row = self%quantities(n + 1:n + size(row))
                    n = n + size(row)
                end select
            end associate
            if (stat /= 0) then
                self%gathered = self%gathered - 1
                call set_error(error, status_callback_failed, 'the '//trim(fields(self%series(i)%field)%name)// &
                    ' could not be evaluated at t = '//to_text(simulation%state%t))
                return
            end if
        end do
        self%last_time = simulation%state%t
        if (self%rows == 0 .and. self%gathered == 1) self%energy%at_start = energy
        self%energy%deviation = max(self%energy%deviation, abs(energy - self%energy%at_start))
    end procedure gather

    module procedure measure
        integer :: stat

        if (size(self%rates) > 0) call self%integrate(simulation, error)
        if (allocated(error)) return
        associate (state => simulation%state)
            if (size(self%lambda) > 0) call simulation%multipliers(self%lambda)
            call simulation%model%measure(state%t, state%q, state%qd, state%qdd, self%quantities, stat, self%lambda)
            if (stat /= 0) call set_error(error, status_callback_failed, 'the sensors could not be evaluated at t = '// &
                to_text(state%t))
        end associate
    end procedure measure

    !> Advance the integrals of the model to the current time by Gaussian quadrature of order 10 on the dense output.
    module procedure integrate
        integer, parameter :: n = 5
        real(wp), parameter :: a = sqrt(5 - 2*sqrt(10/7.0_wp))/3, b = sqrt(5 + 2*sqrt(10/7.0_wp))/3
        real(wp), parameter :: point(n) = [-b, -a, 0.0_wp, a, b], c = 13*sqrt(70.0_wp)
        real(wp), parameter :: weight(n) = [322 - c, 322 + c, 512.0_wp, 322 + c, 322 - c]/900
        real(wp) :: from, to, total(size(self%rates))
        integer :: i, stat

        from = self%integrated_until
        to = simulation%state%t
        if (.not. to > from) return
        total = 0.0_wp
        do i = 1, n
            call simulation%look_at((from + to)/2 + point(i)*(to - from)/2, error)
            if (allocated(error)) return
            call simulation%multipliers(self%lambda)
            associate (state => simulation%state)
                call simulation%model%integrands(state%t, state%q, state%qd, self%lambda, self%rates, stat)
                if (stat /= 0) call set_error(error, status_callback_failed, 'the power could not be evaluated at t = '// &
                    to_text(state%t))
            end associate
            if (allocated(error)) return
            total = total + weight(i)*self%rates
        end do
        call simulation%look_at(to, error)
        simulation%model%state%integrals = simulation%model%state%integrals + (to - from)/2*total
        self%integrated_until = to
    end procedure integrate

    module procedure gather_between
        real(wp) :: t, end_of_step

        end_of_step = simulation%state%t
        do
            t = self%first_time + real(self%intervals + 1, wp)*self%interval
            ! By rounding, the time may lie just after the step although it is the end of the step.
            if (t > end_of_step + 1.0e-9_wp*self%interval) exit
            if (is_before_event .and. t >= end_of_step) exit
            t = min(t, end_of_step)
            call simulation%look_at(t, error)
            if (.not. allocated(error)) call self%gather(simulation, error)
            call simulation%look_back()
            if (allocated(error)) return
            self%intervals = self%intervals + 1
            if (self%gathered == self%capacity) call self%write_to_disk(simulation)
            if (allocated(self%file%problem)) return
        end do
    end procedure gather_between

    module procedure gather_spaced
        type(error_type), allocatable :: error
        real(wp) :: from, to
        integer(long) :: i, n

        to = simulation%state%t
        ! If an event has changed the state at the end of the step, the new state is not part of the motion within the step.
        if (.not. to > self%spaced_until) return
        self%spaced_until = to
        from = to - simulation%last_step
        ! The factor prevents one interval too many if rounding raises a whole quotient.
        n = ceiling((to - from)/self%spacing*(1 - 1.0e-9_wp), long)
        self%is_between = .true.
        do i = 1, n - 1
            call simulation%look_at(from + (to - from)*(real(i, wp)/real(n, wp)), error)
            if (.not. allocated(error)) call self%gather(simulation, error)
            if (self%gathered == self%capacity) call self%write_to_disk(simulation)
            if (allocated(self%file%problem)) exit
        end do
        self%is_between = .false.
        call simulation%look_back()
    end procedure gather_spaced

    module procedure write_rows
        integer :: i

        if (.not. allocated(self%series)) return
        do i = 0, ubound(self%series, 1)
            call self%series(i)%append(self%file, self%rows, self%gathered)
        end do
        if (.not. allocated(self%file%problem)) self%rows = self%rows + self%gathered
        ! Rows that could not be written are discarded too, because the write is not repeated.
        self%gathered = 0
    end procedure write_rows

    !> Running number of the current chart.
    integer(long) function number_of_charts(simulation)
        class(simulation_type), intent(in) :: simulation

        associate (statistics => simulation%statistics())
            number_of_charts = statistics%charts
        end associate
    end function number_of_charts
end submodule tandem_io_output_rows
