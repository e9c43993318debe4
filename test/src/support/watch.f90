! SPDX-License-Identifier: MIT
!> Observers for the tests: the constraint errors measured independently of the library, the distance from a reference, and the
!> total energy.
module watch
    use reference, only: reference_type
    use tandem, only: at_end, at_start, failure_type => error_type, observer_type, set_error, simulation_type, &
        status_output_failed, terms_type, wp
    use terms_at, only: get_terms
    implicit none (type, external)
    private

    public :: error_watch_type, reference_watch_type, energy_watch_type, natural_errors

    !> The largest errors of the three constraint levels over all steps, from the model's own procedures.
    type, extends(observer_type) :: error_watch_type
        real(wp) :: errors(3) = 0.0_wp
        !> Interval in steps; the start and the end are always evaluated.
        integer :: every = 1
        integer :: looked_at = 0
        integer, private :: steps = 0
    contains
        procedure :: observe => observe_errors
    end type error_watch_type

    !> The largest distances from a reference solution at its times.
    type, extends(observer_type) :: reference_watch_type
        type(reference_type) :: table
        !> Largest errors of q, qd, qdd and lambda; the last two relative to the larger of 1 and the largest entry of the row.
        real(wp) :: q = 0.0_wp, qd = 0.0_wp, qdd = 0.0_wp, lambda = 0.0_wp
        !> A time at which the acceleration jumps, so that only q and qd are compared.
        real(wp) :: skip_acceleration_at = -huge(1.0_wp)
        !> Number of common rows of the table.
        integer :: met = 0
    contains
        procedure :: observe => observe_reference
    end type reference_watch_type

    !> Total energy, kinetic only if the model has no potential.
    type, extends(observer_type) :: energy_watch_type
        !> The energy at the start, and its largest relative deviation.
        real(wp) :: energy = 0.0_wp, deviation = 0.0_wp
    contains
        procedure :: observe => observe_energy
    end type energy_watch_type

contains

    !> Position, velocity and acceleration error of a state, max-norms over the rows of |residual| over the row's natural scale
    !> sum_j |C_ij| max(|y_j|, s_j) + |right-hand side|, y = q, qd, qdd.
    subroutine natural_errors(terms, n_holonomic, scale, q, qd, qdd, errors)
        type(terms_type), intent(in) :: terms
        integer, intent(in) :: n_holonomic
        real(wp), intent(in) :: scale(:), q(:), qd(:), qdd(:)
        real(wp), intent(out) :: errors(3)
        real(wp) :: row(size(q))
        integer :: i

        errors = 0.0_wp
        do i = 1, size(terms%nu)
            row = terms%jacobian(i, :)
            if (i <= n_holonomic) call raise(errors(1), terms%phi(i), sum(abs(row)*max(abs(q), scale)))
            call raise(errors(2), dot_product(row, qd) - terms%nu(i), sum(abs(row)*max(abs(qd), scale)) + abs(terms%nu(i)))
            call raise(errors(3), dot_product(row, qdd) + terms%gamma(i), &
                sum(abs(row)*max(abs(qdd), scale)) + abs(terms%gamma(i)))
        end do
    end subroutine natural_errors

    !> largest := max(largest, |residual|/scale); a NaN counts as infinite.
    pure subroutine raise(largest, residual, scale)
        real(wp), intent(inout) :: largest
        real(wp), intent(in) :: residual, scale

        if (.not. abs(residual) <= huge(1.0_wp)) then
            largest = huge(1.0_wp)
        else
            largest = max(largest, abs(residual)/scale)
        end if
    end subroutine raise

    subroutine observe_errors(self, simulation, occasion, error)
        class(error_watch_type), intent(inout) :: self
        class(simulation_type), intent(inout) :: simulation
        integer, intent(in) :: occasion
        type(failure_type), allocatable, intent(out) :: error
        type(terms_type) :: terms
        real(wp) :: errors(3)
        integer :: stat

        self%steps = self%steps + 1
        if (occasion /= at_end .and. occasion /= at_start .and. mod(self%steps, self%every) /= 0) return
        self%looked_at = self%looked_at + 1
        associate (model => simulation%model, state => simulation%state)
            call get_terms(model, state%t, state%q, state%qd, terms, stat)
            if (stat /= 0) then
                call set_error(error, status_output_failed, 'the model cannot be evaluated')
                return
            end if
            if (allocated(model%coordinate_scale)) then
                call natural_errors(terms, model%n_holonomic, model%coordinate_scale, state%q, state%qd, state%qdd, errors)
            else
                call natural_errors(terms, model%n_holonomic, spread(1.0_wp, 1, model%n), state%q, state%qd, state%qdd, errors)
            end if
        end associate
        self%errors = max(self%errors, errors)
    end subroutine observe_errors

    subroutine observe_reference(self, simulation, occasion, error)
        class(reference_watch_type), intent(inout) :: self
        class(simulation_type), intent(inout) :: simulation
        integer, intent(in) :: occasion
        type(failure_type), allocatable, intent(out) :: error
        real(wp), allocatable :: lambda(:)
        integer :: i

        if (occasion == at_end) return
        associate (table => self%table, state => simulation%state)
            i = table%find(state%t)
            if (i == 0) return
            self%met = self%met + 1
            self%q = max(self%q, maxval(abs(state%q - table%q(:, i))))
            self%qd = max(self%qd, maxval(abs(state%qd - table%qd(:, i))))
            if (table%find(self%skip_acceleration_at) == i) return
            self%qdd = max(self%qdd, maxval(abs(state%qdd - table%qdd(:, i)))/max(1.0_wp, maxval(abs(table%qdd(:, i)))))
            allocate (lambda(size(table%lambda, 1)))
            call simulation%multipliers(lambda)
            self%lambda = max(self%lambda, maxval(abs(lambda - table%lambda(:, i)))/max(1.0_wp, maxval(abs(table%lambda(:, i)))))
        end associate
    end subroutine observe_reference

    subroutine observe_energy(self, simulation, occasion, error)
        class(energy_watch_type), intent(inout) :: self
        class(simulation_type), intent(inout) :: simulation
        integer, intent(in) :: occasion
        type(failure_type), allocatable, intent(out) :: error
        real(wp) :: kinetic, potential
        integer :: stat(2)

        potential = 0.0_wp
        stat = 0
        call simulation%kinetic_energy(kinetic, stat(1))
        if (associated(simulation%model%potential_energy)) call simulation%potential_energy(potential, stat(2))
        if (any(stat /= 0)) then
            call set_error(error, status_output_failed, 'the energy cannot be evaluated')
            return
        end if
        if (occasion == at_start) self%energy = kinetic + potential
        self%deviation = max(self%deviation, abs((kinetic + potential)/self%energy - 1))
    end subroutine observe_energy
end module watch
