! SPDX-License-Identifier: MIT
!> Tests of indices of names.
module test_name_index
    use asserts, only: check_count, check_true
    use tandem_name_index, only: name_index_type
    use testdrive, only: error_type, new_unittest, unittest_type
    implicit none (type, external)
    private

    public :: collect_name_index

contains

    !> The suite.
    subroutine collect_name_index(testsuite)
        type(unittest_type), allocatable, intent(out) :: testsuite(:)

        testsuite = [ &
            new_unittest('ten-thousand-names-are-found-and-others-are-not', test_many), &
            new_unittest('the-first-number-of-a-name-stays', test_twice), &
            new_unittest('blanks-at-the-end-do-not-count', test_blanks), &
            new_unittest('a-name-that-is-too-long-is-none', test_long), &
            new_unittest('nothing-is-left-after-clear', test_clear), &
            new_unittest('names-are-told-in-their-order', test_order)]
    end subroutine collect_name_index

    !> `body.car17` and so on.
    pure function name_of(number) result(name)
        integer, intent(in) :: number
        character(len=20) :: name

        write (name, '(a, i0)') 'body.car', number
    end function name_of

    subroutine test_many(error)
        type(error_type), allocatable, intent(out) :: error
        integer, parameter :: n = 10000
        type(name_index_type) :: names
        integer :: i, found, others

        call check_count(error, names%get('body.car1'), 0, 'before there is any')
        do i = 1, n
            call names%put(name_of(i), 3*i)
        end do
        found = 0
        others = 0
        do i = 1, n
            if (names%get(name_of(i)) == 3*i) found = found + 1
            if (names%get(name_of(n + i)) /= 0) others = others + 1
        end do
        call check_count(error, found, n, 'names that are found')
        call check_count(error, others, 0, 'names that are not there')
    end subroutine test_many

    !> Before and after the table is deallocated.
    subroutine test_order(error)
        type(error_type), allocatable, intent(out) :: error
        integer, parameter :: n = 1000
        type(name_index_type) :: names
        integer :: i

        do i = 1, n
            call names%put(name_of(i), 3*i)
        end do
        call check_count(error, names%n, n, 'how many there are')
        if (allocated(error)) return
        call check_true(error, names%name(77) == 'body.car77', 'the 77th name')
        if (allocated(error)) return
        call names%close()
        do i = 1, n
            call check_true(error, names%name(i) == name_of(i), 'names after the table is given up')
            if (allocated(error)) return
        end do
        call names%clear()
        call names%put('rod', 1)
        call check_true(error, names%name(1) == 'rod', 'a name after clear')
    end subroutine test_order

    subroutine test_twice(error)
        type(error_type), allocatable, intent(out) :: error
        type(name_index_type) :: names

        call names%put('rod', 1)
        call names%put('rod', 2)
        call check_count(error, names%get('rod'), 1, 'number')
        call check_count(error, names%get('ro'), 0, 'a part of it')
        call check_count(error, names%get('rod.x'), 0, 'more than it')
    end subroutine test_twice

    subroutine test_blanks(error)
        type(error_type), allocatable, intent(out) :: error
        type(name_index_type) :: names

        call names%put('rod   ', 7)
        call check_count(error, names%get('rod'), 7, 'without blanks')
        call check_count(error, names%get('rod  '), 7, 'with others')
        call check_count(error, names%get(' rod'), 0, 'a blank before it')
        call names%put('', 8)
        call check_count(error, names%get('  '), 8, 'the empty name')
    end subroutine test_blanks

    subroutine test_long(error)
        type(error_type), allocatable, intent(out) :: error
        type(name_index_type) :: names

        call names%put(repeat('x', 161), 1)
        call names%put(repeat('x', 160), 2)
        call check_count(error, names%get(repeat('x', 161)), 0, 'too long')
        call check_count(error, names%get(repeat('x', 160)), 2, 'just not too long')
    end subroutine test_long

    subroutine test_clear(error)
        type(error_type), allocatable, intent(out) :: error
        type(name_index_type) :: names
        integer :: i

        do i = 1, 100
            call names%put(name_of(i), i)
        end do
        call names%clear()
        call check_count(error, names%get(name_of(50)), 0, 'after clear')
        call names%put(name_of(50), 4)
        call check_count(error, names%get(name_of(50)), 4, 'once more')
        call check_count(error, names%get(name_of(51)), 0, 'that alone')
    end subroutine test_clear
end module test_name_index
