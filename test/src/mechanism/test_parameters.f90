! SPDX-License-Identifier: MIT
!> Tests of parameters that are given by the others.
module test_parameters
    use asserts, only: check_close, check_failure, check_no_failure
    use tandem, only: failure_type => error_type, resolve_parameters, to_text, wp
    use testdrive, only: error_type, new_unittest, unittest_type
    implicit none (type, external)
    private

    public :: collect_parameters

    real(wp), parameter :: pi = acos(-1.0_wp)

contains

    !> The suite.
    subroutine collect_parameters(testsuite)
        type(unittest_type), allocatable, intent(out) :: testsuite(:)

        testsuite = [ &
            new_unittest('parameters-by-the-others', test_values), &
            new_unittest('wrong-parameters-are-named', test_wrong_parameters)]
    end subroutine collect_parameters

    !> In any order, for chains of any length.
    subroutine test_values(error)
        type(error_type), allocatable, intent(out) :: error
        integer, parameter :: n = 300
        type(failure_type), allocatable :: failure
        character(len=8) :: names(n)
        character(len=16) :: texts(n)
        real(wp) :: values(n)
        integer :: i

        call resolve_parameters([character(len=5) :: 'speed', 'l', 'area', 'n'], &
            [character(len=24) :: '2*pi*n', '0.3', 'l^2 + (-1)^n', '3'], values(:4), failure)
        call check_no_failure(error, failure)
        call check_close(error, values(:4), [6*pi, 0.3_wp, -0.91_wp, 3.0_wp], 1.0e-14_wp, 'values')
        ! Each depends on the next one, the worst order.
        do i = 1, n
            names(i) = 'p'//to_text(i)
            texts(i) = 'p'//to_text(i + 1)//' + 1'
        end do
        texts(n) = '0'
        call resolve_parameters(names, texts, values, failure)
        call check_no_failure(error, failure)
        call check_close(error, values, [(real(n - i, wp), i=1, n)], 0.0_wp, 'a long chain')
        call resolve_parameters(names(:0), texts(:0), values(:0), failure)
        call check_no_failure(error, failure)
    end subroutine test_values

    !> Each error has its own message.
    subroutine test_wrong_parameters(error)
        type(error_type), allocatable, intent(out) :: error
        character(len=8) :: names(30)
        character(len=8) :: texts(30)
        integer :: i

        call check([character(len=8) :: 'a', 'b', 'c', 'd'], [character(len=8) :: '1', 'c + a', '2*d', 'b'], &
            'parameters depend on each other cyclically: b -> c -> d -> b; ')
        call check([character(len=8) :: 'a', 'b'], [character(len=8) :: 'b', '2*b'], 'cyclically: b -> b; ')
        call check([character(len=8) :: 'a'], [character(len=8) :: 'a'], 'cyclically: a -> a; ')
        call check([character(len=8) :: 'a', 'a'], [character(len=8) :: '1', '2'], 'there are two parameters "a"')
        call check([character(len=8) :: 'pi'], [character(len=8) :: '3'], '"pi" is reserved in expressions')
        call check([character(len=8) :: 'sin'], [character(len=8) :: '3'], '"sin" is reserved in expressions')
        call check([character(len=8) :: '2a'], [character(len=8) :: '3'], '"2a" is not a valid name')
        call check([character(len=8) :: 'a b'], [character(len=8) :: '3'], '"a b" is not a valid name')
        call check([character(len=8) :: ''], [character(len=8) :: '3'], '"" is not a valid name')
        call check([character(len=8) :: 'a.'], [character(len=8) :: '3'], '"a." is not a valid name')
        call check([character(len=8) :: 'a', 'b'], [character(len=8) :: '1', '2*'], 'parameters.b: column 3 of "2*"')
        call check([character(len=8) :: 'mass', 'b'], [character(len=8) :: '1', 'mas'], 'did you mean "mass"?')
        call check([character(len=8) :: 'a', 'b'], [character(len=8) :: '0', '1/a'], &
            'parameters.b: "1/a" does not yield a finite number')
        do i = 1, size(names)
            names(i) = 'p'//to_text(i)
            texts(i) = 'p'//to_text(1 + mod(i, size(names)))
        end do
        call check(names, texts, 'p9 -> p10 -> ... -> ')

    contains

        subroutine check(names, texts, piece)
            character(len=*), intent(in) :: names(:), texts(:), piece
            type(failure_type), allocatable :: failure
            real(wp) :: values(size(names))

            call resolve_parameters(names, texts, values, failure, 'parameters.')
            call check_failure(error, failure, 'invalid_model', piece)
        end subroutine check
    end subroutine test_wrong_parameters
end module test_parameters
