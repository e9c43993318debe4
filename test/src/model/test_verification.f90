! SPDX-License-Identifier: MIT
!> Tests of the comparison of all procedures of a model with differences: right ones pass, wrong ones are named.
module test_verification
    use asserts, only: check_close, check_count, check_no_failure, check_text, check_true, format_real
    use large_mechanisms, only: make_large
    use model_moving_pivot, only: moving_pivot_type
    use model_perturbed, only: perturbed_type
    use model_skater, only: single_names, skater_type
    use subjects, only: new_subject, subject_names
    use tandem, only: derivative_name, failure_type => error_type, finding_type, model_type, n_derivatives, rolling_disk_type, &
        expression_type, mechanism_type, parse_expression, status_name, term_name, verify_model, wp
    use tandem_model_derivatives, only: derivatives_type
    use testdrive, only: error_type, new_unittest, unittest_type
    use, intrinsic :: ieee_arithmetic, only: ieee_quiet_nan, ieee_value
    implicit none (type, external)
    private

    public :: collect_verification

    !> The procedure that `spoiled` calls.
    procedure(spoiled), pointer :: right => null()

contains

    !> The suite.
    subroutine collect_verification(testsuite)
        type(unittest_type), allocatable, intent(out) :: testsuite(:)

        testsuite = [ &
            new_unittest('verification-passes-on-every-model', test_verify), &
            new_unittest('verification-names-a-wrong-fused-derivative', test_verify_derivatives), &
            new_unittest('verification-names-a-wrong-term', test_verify_terms), &
            new_unittest('verification-names-a-wrong-single-procedure', test_verify_single), &
            new_unittest('verification-names-a-procedure-that-fails', test_verify_failing), &
            new_unittest('verification-finds-the-nan', test_verify_nan), &
            new_unittest('verification-blames-no-derivative-of-a-missing-gamma', test_verify_no_gamma), &
            new_unittest('verification-names-the-misprint-of-the-paper', test_verify_misprint), &
            new_unittest('verification-of-fast-motions-and-late-times', test_verify_fast), &
            new_unittest('verification-says-that-time-is-too-coarse', test_verify_late), &
            new_unittest('verification-of-rows-in-any-units', test_verify_units), &
            new_unittest('verification-finds-a-mass-that-is-not-constant', test_verify_constant), &
            new_unittest('verification-of-many-bodies', test_verify_large), &
            new_unittest('verification-names-a-wrong-entry-among-many-bodies', test_verify_large_wrong), &
            new_unittest('verification-sees-what-the-pattern-does-not-tell', test_verify_beyond_pattern)]
    end subroutine collect_verification

    subroutine test_verify(error)
        type(error_type), allocatable, intent(out) :: error
        class(model_type), allocatable, target :: model
        type(finding_type), allocatable :: findings(:)
        type(failure_type), allocatable :: failure
        real(wp), allocatable :: q(:), qd(:)
        integer :: i, k

        do k = 1, size(subject_names)
            call new_subject(trim(subject_names(k)), model, q, qd)
            call verify_model(model, 0.5_wp, q, qd, 3, findings, failure)
            call check_no_failure(error, failure)
            do i = 1, size(findings)
                call check_true(error, findings(i)%passed, trim(subject_names(k))//': '//trim(findings(i)%name)//', error '// &
                    format_real(findings(i)%error))
            end do
            ! Phi_q, Phi_t, gamma, the symmetry of M, its constancy and its blocks, and five fused or eight single derivatives.
            call check_count(error, size(findings), merge(12, 9, k == size(subject_names)) + &
                merge(1, 0, model%constant_mass) + merge(1, 0, allocated(model%mass_blocks)), trim(subject_names(k))//': findings')
        end do
    end subroutine test_verify

    !> Mechanisms of more coordinates than are compared by full matrices: all that small ones are asked is right.
    subroutine test_verify_large(error)
        type(error_type), allocatable, intent(out) :: error
        character(len=*), parameter :: names(7) = [character(len=14) :: 'planar_chain', 'spatial_chain', 'four_bars', 'net', &
            'trailers', 'sprung_chain', 'sprung_plane']
        type(mechanism_type), allocatable, target :: small, large
        type(finding_type), allocatable :: findings(:), few(:)
        type(failure_type), allocatable :: failure
        real(wp), allocatable :: q(:), qd(:)
        integer :: i, k

        do k = 1, size(names)
            allocate (small, large)
            call make_large(names(k), 9, small, failure)
            call check_no_failure(error, failure)
            allocate (q(small%n), qd(small%n))
            call small%start(q, qd)
            call verify_model(small, 0.5_wp, q, qd, 1, few, failure)
            call check_no_failure(error, failure)
            deallocate (q, qd)
            call make_large(names(k), 80, large, failure)
            call check_no_failure(error, failure)
            call check_true(error, large%n > 200, trim(names(k))//': coordinates')
            allocate (q(large%n), qd(large%n))
            call large%start(q, qd)
            call verify_model(large, 0.5_wp, q, qd, 2, findings, failure)
            call check_no_failure(error, failure)
            call check_count(error, size(findings), size(few), trim(names(k))//': findings')
            if (allocated(error)) return
            do i = 1, size(findings)
                call check_text(error, findings(i)%name, trim(few(i)%name))
                call check_true(error, findings(i)%passed .and. findings(i)%error < 1.0e-9_wp, trim(names(k))//': '// &
                    trim(findings(i)%name)//', error '//format_real(findings(i)%error))
            end do
            deallocate (q, qd, small, large)
        end do
    end subroutine test_verify_large

    !> One entry of the derivatives of the forces of a chain is wrong: row and coordinate are named, though columns are shared.
    subroutine test_verify_large_wrong(error)
        type(error_type), allocatable, intent(out) :: error
        type(mechanism_type), target :: model
        type(finding_type), allocatable :: findings(:)
        type(failure_type), allocatable :: failure
        real(wp), allocatable :: q(:), qd(:)

        call make_large('spatial_chain', 40, model, failure)
        call check_no_failure(error, failure)
        allocate (q(model%n), qd(model%n))
        call model%start(q, qd)
        right => model%evaluate_derivatives
        model%evaluate_derivatives => spoiled
        call verify_model(model, 0.5_wp, q, qd, 2, findings, failure)
        call check_no_failure(error, failure)
        call check_findings(findings, 'evaluate_derivatives: dynamics_q', 152, 150, 20.0_wp, error)
    end subroutine test_verify_large_wrong

    !> The derivatives of a model with a wrong entry.
    subroutine spoiled(self, need, t, q, qd, qdd, lambda, derivatives, stat)
        class(model_type), intent(inout) :: self
        integer, intent(in) :: need
        real(wp), intent(in) :: t, q(:), qd(:), qdd(:), lambda(:)
        type(derivatives_type), intent(inout) :: derivatives
        integer, intent(out) :: stat

        call right(self, need, t, q, qd, qdd, lambda, derivatives, stat)
        associate (column => derivatives%column_of(150))
            derivatives%dynamics_q(152, column) = derivatives%dynamics_q(152, column) + 20
        end associate
    end subroutine spoiled

    !> A row at velocity level whose coefficient depends on a body that it does not touch: right, as full matrices show.
    subroutine test_verify_beyond_pattern(error)
        type(error_type), allocatable, intent(out) :: error
        integer, parameter :: n_bodies = 72
        type(mechanism_type), target :: model
        type(expression_type) :: coefficient(1)
        type(finding_type), allocatable :: findings(:)
        type(failure_type), allocatable :: failure
        real(wp), allocatable :: q(:), qd(:)
        character(len=8) :: name
        integer :: i

        model%planar = .true.
        do i = 1, n_bodies
            write (name, '("b",i0)') i
            call model%add_body(name, 1.0_wp, [real(i, wp), 0.0_wp], failure, inertia=[0.1_wp])
            call check_no_failure(error, failure)
        end do
        call parse_expression(coefficient(1), '1 + sin(b70.y)', model%variable_names(), failure)
        call check_no_failure(error, failure)
        call model%add_rate_row('row', ['b1.vx'], coefficient, failure)
        call check_no_failure(error, failure)
        call model%define(failure)
        call check_no_failure(error, failure)
        if (allocated(error)) return
        allocate (q(model%n), qd(model%n))
        call model%start(q, qd)
        call verify_model(model, 0.5_wp, q, qd, 1, findings, failure)
        call check_no_failure(error, failure)
        call check_true(error, all(findings%passed), 'all procedures: '//trim(wrong_name(findings)))
    end subroutine test_verify_beyond_pattern

    !> Every other row in units that make it vast or tiny: right ones pass, and an entry that is wrong by as much of the row as in
    !> units of one is found.
    subroutine test_verify_units(error)
        type(error_type), allocatable, intent(out) :: error
        real(wp), parameter :: units(5) = [1.0_wp, 1.0e-200_wp, 1.0e-30_wp, 1.0e30_wp, 1.0e200_wp]
        character(len=*), parameter :: names(2) = [character(len=7) :: 'disk', 'vehicle']
        class(model_type), allocatable, target :: model
        type(perturbed_type), target :: perturbed
        type(finding_type), allocatable :: findings(:)
        type(failure_type), allocatable :: failure
        real(wp), allocatable :: q(:), qd(:)
        integer :: i, k, term

        do k = 1, size(names)
            call new_subject(trim(names(k)), model, q, qd)
            call perturbed%wrap(model)
            perturbed%row = 1
            do i = 1, size(units)
                perturbed%unit = units(i)
                perturbed%term = 0
                call verify_model(perturbed, 0.5_wp, q, qd, 2, findings, failure)
                call check_no_failure(error, failure)
                call check_true(error, all(findings%passed), trim(names(k))//' in units of '//format_real(1/units(i))//': '// &
                    wrong_name(findings))
                ! C and gamma; nu is zero.
                do term = 2, 4, 2
                    perturbed%term = term
                    perturbed%amount = 0.1_wp
                    call verify_model(perturbed, 0.5_wp, q, qd, 2, findings, failure)
                    call check_no_failure(error, failure)
                    call check_true(error, .not. all(findings%passed), trim(names(k))//' in units of '// &
                        format_real(1/units(i))//': a wrong '//term_name(term))
                end do
                if (allocated(error)) return
            end do
        end do
    end subroutine test_verify_units

    !> First procedure that did not pass, empty if all did.
    pure function wrong_name(findings) result(name)
        type(finding_type), intent(in) :: findings(:)
        character(len=48) :: name
        integer :: i

        name = ''
        i = findloc(findings%passed, .false., dim=1)
        if (i > 0) name = findings(i)%name
    end function wrong_name

    !> The rolling disk, with the mass matrix that its Euler parameters change.
    subroutine test_verify_constant(error)
        type(error_type), allocatable, intent(out) :: error
        class(model_type), allocatable, target :: model
        type(finding_type), allocatable :: findings(:)
        type(failure_type), allocatable :: failure
        real(wp), allocatable :: q(:), qd(:)
        integer :: i

        call new_subject('disk', model, q, qd)
        model%constant_mass = .true.
        call verify_model(model, 0.5_wp, q, qd, 3, findings, failure)
        call check_no_failure(error, failure)
        i = findloc(findings%name == 'constant_mass', .true., dim=1)
        call check_true(error, i > 0, 'it is compared')
        if (allocated(error)) return
        call check_true(error, .not. findings(i)%passed .and. findings(i)%error > 0.01_wp, 'it is not constant')
    end subroutine test_verify_constant

    !> A pivot that swings slowly or 3200 times per second, at its start and when rounding of t is the ten thousandth part of a
    !> second: passes if right, and fails if wrong by a thousandth of its largest value. 64 times per second it returns to its
    !> position after all simple fractions of a second.
    subroutine test_verify_fast(error)
        type(error_type), allocatable, intent(out) :: error
        type(moving_pivot_type), target :: model
        type(finding_type), allocatable :: findings(:)
        type(failure_type), allocatable :: failure
        real(wp), parameter :: rates(5) = [0.01_wp, 3.0_wp, 200.0_wp, 128*acos(-1.0_wp), 2.0e4_wp]
        real(wp), parameter :: latest(5) = [1.0e12_wp, 1.0e9_wp, 1.0e7_wp, 1.0e7_wp, 1.0e5_wp]
        real(wp) :: q(2), qd(2), times(2)
        integer :: i, k
        character(len=40) :: what

        model%speed = 0.0_wp
        model%fall = 0.0_wp
        model%swing = 0.3_wp
        do i = 1, size(rates)
            model%rate = rates(i)
            times = [0.5_wp, latest(i)]
            do k = 1, size(times)
                write (what, '("rate ",es9.2,", t ",es9.2,": ")') rates(i), times(k)
                q = [model%swing*sin(model%rate*times(k)) + 0.4_wp, -0.6_wp]
                qd = [0.3_wp, 0.8_wp]
                call model%define()
                call verify_model(model, times(k), q, qd, 3, findings, failure)
                call check_no_failure(error, failure)
                associate (f => findings(max(1, findloc(findings%passed, .false., dim=1))))
                    call check_true(error, f%passed, trim(what)//' '//trim(f%name)//', error '//format_real(f%error))
                end associate
                model%holonomic_rate => wrong_rate
                call verify_model(model, times(k), q, qd, 3, findings, failure)
                ! gamma is compared with differences of the wrong nu, and may fail too.
                call check_true(error, all((findings%passed .neqv. findings%name == 'holonomic_rate') .or. &
                    findings%name == 'constraint_acceleration'), trim(what)//' wrong rate')
                call model%define()
                model%constraint_acceleration => wrong_acceleration
                call verify_model(model, times(k), q, qd, 3, findings, failure)
                call check_true(error, all(findings%passed .neqv. findings%name == 'constraint_acceleration'), &
                    trim(what)//' wrong acceleration')
                if (allocated(error)) return
            end do
        end do
    end subroutine test_verify_fast

    !> Phi_t of the swinging pivot, a hundredth too large.
    subroutine wrong_rate(self, t, q, value, stat)
        class(model_type), intent(inout) :: self
        real(wp), intent(in) :: t, q(:)
        real(wp), intent(out) :: value(:)
        integer, intent(out) :: stat

        stat = 0
        value = 0.0_wp
        select type (self)
        class is (moving_pivot_type)
            value = -1.01_wp*(q(1) - self%swing*sin(self%rate*t))*self%swing*self%rate*cos(self%rate*t)
        end select
    end subroutine wrong_rate

    !> Its gamma, a hundredth too large.
    subroutine wrong_acceleration(self, t, q, qd, value, stat)
        class(model_type), intent(inout) :: self
        real(wp), intent(in) :: t, q(:), qd(:)
        real(wp), intent(out) :: value(:)
        integer, intent(out) :: stat
        real(wp) :: p, pd, pdd

        stat = 0
        value = 0.0_wp
        select type (self)
        class is (moving_pivot_type)
            p = self%swing*sin(self%rate*t)
            pd = self%swing*self%rate*cos(self%rate*t)
            pdd = -self%swing*self%rate**2*sin(self%rate*t)
            value = 1.01_wp*((qd(1) - pd)**2 + qd(2)**2 - (q(1) - p)*pdd)
        end select
    end subroutine wrong_acceleration

    !> Exactly one finding fails, that of a name, with place and amount.
    subroutine check_findings(findings, name, row, column, amount, error)
        type(finding_type), intent(in) :: findings(:)
        character(len=*), intent(in) :: name
        integer, intent(in) :: row, column
        real(wp), intent(in) :: amount
        type(error_type), allocatable, intent(inout) :: error
        integer :: i

        call check_count(error, count(.not. findings%passed), 1, name//': findings that fail')
        if (allocated(error)) return
        i = findloc(findings%passed, .false., dim=1)
        call check_text(error, findings(i)%name, name)
        call check_count(error, findings(i)%row, row, name//': row')
        call check_count(error, findings(i)%column, column, name//': column')
        ! Differences of fourth order leave 1e-10 of entries up to 1e4.
        call check_close(error, [findings(i)%value - findings(i)%expected], [amount], 1.0e-5_wp, name//': amounts')
    end subroutine check_findings

    !> Each of the five, on the disk and on the motorcycle, off by a thousandth of the largest entry.
    subroutine test_verify_derivatives(error)
        type(error_type), allocatable, intent(out) :: error
        class(model_type), allocatable, target :: inner
        type(perturbed_type), target :: model
        type(finding_type), allocatable :: findings(:)
        type(failure_type), allocatable :: failure
        real(wp), allocatable :: q(:), qd(:)
        integer :: i, k

        do k = 2, 3
            call new_subject(trim(subject_names(k)), inner, q, qd)
            call model%wrap(inner)
            do i = 1, n_derivatives
                model%derivative = i
                model%row = 2 + mod(i, 3)
                model%column = 3 + i
                model%amount = 20.0_wp
                call verify_model(model, 0.5_wp, q, qd, 3, findings, failure)
                call check_no_failure(error, failure)
                call check_findings(findings, 'evaluate_derivatives: '//trim(derivative_name(i)), model%row, model%column, &
                    model%amount, error)
            end do
        end do
    end subroutine test_verify_derivatives

    !> gamma and nu of the motorcycle by single faults; a wrong entry of Phi_q affects others, but is still named.
    subroutine test_verify_terms(error)
        type(error_type), allocatable, intent(out) :: error
        class(model_type), allocatable, target :: inner
        type(perturbed_type), target :: model
        type(finding_type), allocatable :: findings(:)
        type(failure_type), allocatable :: failure
        real(wp), allocatable :: q(:), qd(:)

        call new_subject('motorcycle', inner, q, qd)
        call model%wrap(inner)
        model%amount = 0.01_wp
        model%term = 4
        model%row = 7
        call verify_model(model, 0.5_wp, q, qd, 3, findings, failure)
        call check_findings(findings, 'constraint_acceleration', 7, 0, model%amount, error)
        model%term = 3
        model%row = 4
        call verify_model(model, 0.5_wp, q, qd, 3, findings, failure)
        ! nu = -Phi_t.
        call check_findings(findings, 'holonomic_rate', 4, 0, -model%amount, error)
        model%term = 2
        model%row = 3
        model%column = 8
        call verify_model(model, 0.5_wp, q, qd, 3, findings, failure)
        call check_findings(findings, 'holonomic_jacobian', 3, 8, model%amount, error)
        model%term = 5
        model%row = 2
        model%column = 6
        call verify_model(model, 0.5_wp, q, qd, 3, findings, failure)
        call check_true(error, count(.not. findings%passed) == 1, 'one finding fails')
        call check_text(error, findings(findloc(findings%passed, .false., dim=1))%name, 'mass_matrix (symmetry)')
    end subroutine test_verify_terms

    subroutine test_verify_single(error)
        type(error_type), allocatable, intent(out) :: error
        type(skater_type), target :: model
        type(finding_type), allocatable :: findings(:)
        type(failure_type), allocatable :: failure
        real(wp) :: q(4), qd(4)
        integer :: i

        call model%define()
        call model%start(q, qd)
        do i = 1, size(single_names)
            model%broken = single_names(i)
            call verify_model(model, 0.5_wp, q, qd, 3, findings, failure)
            call check_no_failure(error, failure)
            call check_findings(findings, trim(single_names(i)), 1, 1, 0.125_wp, error)
        end do
        model%broken = 'holonomic_jacobian'
        call verify_model(model, 0.5_wp, q, qd, 3, findings, failure)
        call check_findings(findings, 'holonomic_jacobian', 1, 1, 0.125_wp, error)
        model%broken = 'constraint_acceleration'
        call verify_model(model, 0.5_wp, q, qd, 3, findings, failure)
        call check_findings(findings, 'constraint_acceleration', 1, 0, 0.125_wp, error)
    end subroutine test_verify_single

    !> A derivative that requests a stop or another point is named, with its status.
    subroutine test_verify_failing(error)
        type(error_type), allocatable, intent(out) :: error
        type(skater_type), target :: model
        type(finding_type), allocatable :: findings(:)
        type(failure_type), allocatable :: failure
        real(wp) :: q(4), qd(4)
        integer :: i

        call model%define()
        call model%start(q, qd)
        model%gamma_qd => stops
        call verify_model(model, 0.5_wp, q, qd, 3, findings, failure)
        call check_no_failure(error, failure)
        i = findloc(findings%passed, .false., dim=1)
        call check_text(error, findings(i)%name, 'evaluation of gamma_qd')
        call check_text(error, status_name(findings(i)%stat), 'callback_failed')
        model%gamma_q => fails
        call verify_model(model, 0.5_wp, q, qd, 3, findings, failure)
        i = findloc(findings%passed, .false., dim=1)
        call check_text(error, findings(i)%name, 'evaluation of gamma_q')
        call check_text(error, status_name(findings(i)%stat), 'not_evaluable')
    end subroutine test_verify_failing

    !> A NaN is at the place of the finding, not in the first entry.
    subroutine test_verify_nan(error)
        type(error_type), allocatable, intent(out) :: error
        type(skater_type), target :: model
        type(finding_type), allocatable :: findings(:)
        type(failure_type), allocatable :: failure
        real(wp) :: q(4), qd(4)
        integer :: i

        call model%define()
        call model%start(q, qd)
        model%gamma_qd => has_nan
        call verify_model(model, 0.5_wp, q, qd, 3, findings, failure)
        call check_no_failure(error, failure)
        i = findloc(findings%passed, .false., dim=1)
        call check_text(error, findings(i)%name, 'gamma_qd')
        call check_count(error, findings(i)%row, 2, 'row of the NaN')
        call check_count(error, findings(i)%column, 3, 'column of the NaN')
    end subroutine test_verify_nan

    !> Steps in time that are lost in the rounding of t leave a status with its name.
    subroutine test_verify_late(error)
        type(error_type), allocatable, intent(out) :: error
        type(skater_type), target :: model
        type(finding_type), allocatable :: findings(:)
        type(failure_type), allocatable :: failure
        real(wp) :: q(4), qd(4)
        integer :: i, k

        call model%define()
        call model%start(q, qd)
        do k = 1, 2
            ! At the later time there is no step, at the other one a single one, without another for comparison.
            call verify_model(model, merge(1.0e300_wp, 2.0_wp**50, k == 1), q, qd, 3, findings, failure)
            call check_no_failure(error, failure)
            i = findloc(findings%passed, .false., dim=1)
            call check_text(error, findings(i)%name, 'evaluation of differences in time')
            call check_text(error, status_name(findings(i)%stat), 'not_evaluable')
        end do
    end subroutine test_verify_late

    !> Without a gamma there is no reference for its derivatives.
    subroutine test_verify_no_gamma(error)
        type(error_type), allocatable, intent(out) :: error
        type(skater_type), target :: model
        type(finding_type), allocatable :: findings(:)
        type(failure_type), allocatable :: failure
        real(wp) :: q(4), qd(4)

        call model%define()
        call model%start(q, qd)
        model%constraint_acceleration => null()
        call verify_model(model, 0.5_wp, q, qd, 3, findings, failure)
        call check_no_failure(error, failure)
        call check_true(error, all(findings%passed), 'all that can be compared is right')
        call check_count(error, size(findings), 9, 'findings')
    end subroutine test_verify_no_gamma

    subroutine stops(self, t, q, qd, value, stat)
        class(model_type), intent(inout) :: self
        real(wp), intent(in) :: t, q(:), qd(:)
        real(wp), intent(out) :: value(:, :)
        integer, intent(out) :: stat

        value = 0.0_wp*(t + q(1) + qd(1) + self%n)
        stat = -1
    end subroutine stops

    subroutine fails(self, t, q, qd, value, stat)
        class(model_type), intent(inout) :: self
        real(wp), intent(in) :: t, q(:), qd(:)
        real(wp), intent(out) :: value(:, :)
        integer, intent(out) :: stat

        call stops(self, t, q, qd, value, stat)
        stat = 1
    end subroutine fails

    subroutine has_nan(self, t, q, qd, value, stat)
        class(model_type), intent(inout) :: self
        real(wp), intent(in) :: t, q(:), qd(:)
        real(wp), intent(out) :: value(:, :)
        integer, intent(out) :: stat

        call stops(self, t, q, qd, value, stat)
        value(2, 3) = ieee_value(t, ieee_quiet_nan)
        stat = 0
    end subroutine has_nan

    !> (69) as printed: wrong in the lower block of gamma_qd and nowhere else.
    subroutine test_verify_misprint(error)
        type(error_type), allocatable, intent(out) :: error
        type(rolling_disk_type), target :: inner
        type(perturbed_type), target :: model
        type(finding_type), allocatable :: findings(:)
        type(failure_type), allocatable :: failure
        real(wp) :: q(9), qd(9)
        integer :: i

        call inner%define()
        call inner%start([-1.0_wp, 0.01_wp, 0.0_wp], 0.0_wp, q, qd)
        call model%wrap(inner)
        model%as_printed = .true.
        call verify_model(model, 0.0_wp, q, qd, 3, findings, failure)
        call check_no_failure(error, failure)
        call check_count(error, count(.not. findings%passed), 1, 'findings that fail')
        if (allocated(error)) return
        i = findloc(findings%passed, .false., dim=1)
        call check_text(error, findings(i)%name, 'acceleration_qd')
        call check_true(error, findings(i)%row >= 5, 'the row is nonholonomic')
    end subroutine test_verify_misprint
end module test_verification
