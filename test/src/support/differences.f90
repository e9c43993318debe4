! SPDX-License-Identifier: MIT
!> A model's procedures against differences of each other, at any point (on the constraints or not).
module differences
    use asserts, only: check_below
    use tandem, only: model_type, terms_type, wp
    use terms_at, only: get_terms
    use testdrive, only: error_type, test_failed
    implicit none (type, external)
    private

    public :: check_model_procedures, random_vector, weight, h

    !> Sixth-order central differences: f' = sum_i weight_i (f(i h) - f(-i h))/h.
    real(wp), parameter :: weight(3) = [45.0_wp, -9.0_wp, 1.0_wp]/60.0_wp
    !> With h = 1e-2 the truncation h**6/140 f(7) and the rounding eps/h are both about 1e-14 for functions of order one.
    real(wp), parameter :: h = 1.0e-2_wp
    !> Required accuracy, relative to the largest entry: a factor 1e3 above that, and far below any mistake.
    real(wp), parameter :: tolerance = 1.0e-10_wp

contains

    !> Phi_q against Phi, nu against Phi_t, gamma against d/dt (C qd - nu) at constant qd, S against M by Lagrange's equations,
    !> Q_A against the potential energy, the symmetry of M.
    subroutine check_model_procedures(model, t, q, qd, error)
        class(model_type), intent(inout) :: model
        real(wp), intent(in) :: t, q(:), qd(:)
        type(error_type), allocatable, intent(inout) :: error
        type(terms_type) :: here
        integer :: stat

        if (allocated(error)) return
        call get_terms(model, t, q, qd, here, stat)
        if (stat /= 0) then
            call test_failed(error, model%name//': the model cannot be evaluated')
            return
        end if
        call check_position_level(model, t, q, qd, here, error)
        call check_gamma(model, t, q, qd, here, error)
        call check_forces(model, t, q, qd, here, error)
    end subroutine check_model_procedures

    !> Phi_q and Phi_t.
    subroutine check_position_level(model, t, q, qd, here, error)
        class(model_type), intent(inout) :: model
        real(wp), intent(in) :: t, q(:), qd(:)
        type(terms_type), intent(in) :: here
        type(error_type), allocatable, intent(inout) :: error
        type(terms_type) :: plus, minus
        real(wp) :: column(model%n_holonomic), e(size(q)), worst
        integer :: i, j, stat

        if (model%n_holonomic == 0) return
        worst = 0.0_wp
        do j = 1, size(q)
            e = 0.0_wp
            e(j) = h
            column = 0.0_wp
            do i = 1, 3
                call get_terms(model, t, q + i*e, qd, plus, stat)
                call get_terms(model, t, q - i*e, qd, minus, stat)
                column = column + weight(i)*(plus%phi - minus%phi)/h
            end do
            worst = max(worst, maxval(abs(column - here%jacobian(:model%n_holonomic, j))))
        end do
        call check_below(error, worst/max(1.0_wp, maxval(abs(here%jacobian))), tolerance, model%name//': error of Phi_q')
        column = 0.0_wp
        do i = 1, 3
            call get_terms(model, t + i*h, q, qd, plus, stat)
            call get_terms(model, t - i*h, q, qd, minus, stat)
            column = column + weight(i)*(plus%phi - minus%phi)/h
        end do
        call check_below(error, maxval(abs(column + here%nu(:model%n_holonomic)))/max(1.0_wp, maxval(abs(here%nu))), tolerance, &
            model%name//': error of nu = -Phi_t')
    end subroutine check_position_level

    !> gamma, all rows.
    subroutine check_gamma(model, t, q, qd, here, error)
        class(model_type), intent(inout) :: model
        real(wp), intent(in) :: t, q(:), qd(:)
        type(terms_type), intent(in) :: here
        type(error_type), allocatable, intent(inout) :: error
        type(terms_type) :: plus, minus
        real(wp) :: rate(model%n_constraints())
        integer :: i, stat

        if (model%n_constraints() == 0) return
        rate = 0.0_wp
        do i = 1, 3
            call get_terms(model, t + i*h, q + i*h*qd, qd, plus, stat)
            call get_terms(model, t - i*h, q - i*h*qd, qd, minus, stat)
            rate = rate + weight(i)*(matmul(plus%jacobian - minus%jacobian, qd) - (plus%nu - minus%nu))/h
        end do
        call check_below(error, maxval(abs(rate - here%gamma))/max(1.0_wp, maxval(abs(here%gamma))), tolerance, &
            model%name//': error of gamma')
    end subroutine check_gamma

    !> M = M', S = (qd' M qd/2)_q - (dM/dt) qd, and -V_q where it gives the whole force at rest.
    subroutine check_forces(model, t, q, qd, here, error)
        class(model_type), intent(inout) :: model
        real(wp), intent(in) :: t, q(:), qd(:)
        type(terms_type), intent(in) :: here
        type(error_type), allocatable, intent(inout) :: error
        type(terms_type) :: plus, minus, rest
        real(wp) :: e(size(q)), s(size(q)), force(size(q)), v_plus, v_minus
        integer :: i, j, stat

        call check_below(error, maxval(abs(here%mass - transpose(here%mass)))/maxval(abs(here%mass)), 1.0e-15_wp, &
            model%name//': asymmetry of M')
        call get_terms(model, t, q, 0*qd, rest, stat)
        if (.not. model%constant_mass .or. associated(model%evaluate)) then
            s = 0.0_wp
            do i = 1, 3
                call get_terms(model, t, q + i*h*qd, qd, plus, stat)
                call get_terms(model, t, q - i*h*qd, qd, minus, stat)
                s = s - weight(i)*matmul(plus%mass - minus%mass, qd)/h
                do j = 1, size(q)
                    e = 0.0_wp
                    e(j) = i*h
                    call get_terms(model, t, q + e, qd, plus, stat)
                    call get_terms(model, t, q - e, qd, minus, stat)
                    s(j) = s(j) + weight(i)*dot_product(qd, matmul(plus%mass - minus%mass, qd))/2/h
                end do
            end do
            call check_below(error, maxval(abs(here%force - rest%force - s))/max(1.0_wp, maxval(abs(here%force))), tolerance, &
                model%name//': error of S')
        end if
        if (.not. associated(model%potential_energy)) return
        force = 0.0_wp
        do j = 1, size(q)
            do i = 1, 3
                e = 0.0_wp
                e(j) = i*h
                call model%potential_energy(t, q + e, v_plus, stat)
                call model%potential_energy(t, q - e, v_minus, stat)
                force(j) = force(j) - weight(i)*(v_plus - v_minus)/h
            end do
        end do
        call check_below(error, maxval(abs(rest%force - force))/max(1.0_wp, maxval(abs(rest%force))), tolerance, &
            model%name//': error of Q_A = -V_q')
    end subroutine check_forces

    !> Numbers from -1 to 1, identical in every run and with every compiler.
    subroutine random_vector(seed, values)
        !> Changes with every call.
        integer, intent(inout) :: seed
        real(wp), intent(out) :: values(:)
        integer :: i

        do i = 1, size(values)
            ! Park and Miller's minimal standard generator, by Schrage's method.
            seed = 16807*mod(seed, 127773) - 2836*(seed/127773)
            if (seed <= 0) seed = seed + huge(1)
            values(i) = 2*real(seed, wp)/real(huge(1), wp) - 1
        end do
    end subroutine random_vector
end module differences
