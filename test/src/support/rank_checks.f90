! SPDX-License-Identifier: MIT
!> Results of a simulation for tests of rank detection: its warnings, its motion and its multipliers against those without the
!> redundant rows.
module rank_checks
    use asserts, only: check_below, check_close
    use ranks, only: cut
    use svd, only: pseudo_solve
    use tandem, only: simulation_type, terms_type, wp
    use terms_at, only: get_terms
    use testdrive, only: error_type
    implicit none (type, external)
    private

    public :: n_warnings, all_warnings, check_same_motion, check_multipliers

contains

    !> Number of warnings.
    integer function n_warnings(simulation)
        type(simulation_type), intent(in) :: simulation

        n_warnings = 0
        if (allocated(simulation%warnings)) n_warnings = size(simulation%warnings)
    end function n_warnings

    !> All warnings, one after the other.
    function all_warnings(simulation) result(text)
        type(simulation_type), intent(in) :: simulation
        character(len=:), allocatable :: text
        integer :: i

        text = ''
        do i = 1, n_warnings(simulation)
            text = text//simulation%warnings(i)%text//' | '
        end do
    end function all_warnings

    !> The states of two runs agree.
    subroutine check_same_motion(error, simulation, without, bound)
        type(error_type), allocatable, intent(inout) :: error
        type(simulation_type), intent(in) :: simulation, without
        real(wp), intent(in) :: bound

        associate (a => simulation%state, b => without%state, name => simulation%model%name)
            call check_below(error, abs(a%t - b%t), 0.0_wp, name//': difference of the times')
            call check_close(error, a%q, b%q, bound*max(1.0_wp, maxval(abs(b%q))), name//': q')
            call check_close(error, a%qd, b%qd, bound*max(1.0_wp, maxval(abs(b%qd))), name//': qd')
            ! Accelerations also have the condition of D' M D; the motorcycle's are large.
            call check_close(error, a%qdd, b%qdd, 100*bound*max(1.0_wp, maxval(abs(b%qdd))), name//': qdd')
        end associate
    end subroutine check_same_motion

    !> lambda is the pseudo-inverse of C' times S + Q_A - M qdd, and its forces are those of the model without copies.
    subroutine check_multipliers(error, simulation, without, bound)
        type(error_type), allocatable, intent(inout) :: error
        type(simulation_type), intent(inout) :: simulation, without
        !> Of differences relative to the largest: they are differences of large forces, times the condition of C, about 1e2.
        real(wp), intent(in) :: bound
        type(terms_type) :: terms, terms_without
        real(wp) :: lambda(simulation%model%n_constraints()), lambda_without(without%model%n_constraints())
        real(wp), allocatable :: expected(:), force(:)
        integer :: stat

        if (allocated(error)) return
        associate (state => simulation%state, name => simulation%model%name)
            call simulation%multipliers(lambda)
            call without%multipliers(lambda_without)
            call get_terms(simulation%model, state%t, state%q, state%qd, terms, stat)
            call get_terms(without%model, state%t, without%state%q, without%state%qd, terms_without, stat)
            expected = pseudo_solve(transpose(terms%jacobian), terms%force - matmul(terms%mass, state%qdd), cut)
            call check_close(error, lambda, expected, bound*max(1.0_wp, maxval(abs(expected))), name//': lambda')
            force = matmul(lambda_without, terms_without%jacobian)
            call check_close(error, matmul(lambda, terms%jacobian), force, bound*max(1.0_wp, maxval(abs(force))), &
                name//': C'' lambda')
        end associate
    end subroutine check_multipliers
end module rank_checks
