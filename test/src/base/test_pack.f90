! SPDX-License-Identifier: MIT
!> Tests of the array of words with the state of objects.
module test_pack
    use asserts, only: check_true
    use tandem, only: long, pack_type, wp
    use testdrive, only: error_type, new_unittest, unittest_type
    implicit none (type, external)
    private

    public :: collect_pack

contains

    !> The suite.
    subroutine collect_pack(testsuite)
        type(unittest_type), allocatable, intent(out) :: testsuite(:)

        testsuite = [ &
            new_unittest('items-come-back-and-damage-is-noticed', test_items)]
    end subroutine collect_pack

    !> Items of all kinds are restored with their shapes, including unallocated ones; missing and extra words are detected.
    subroutine test_items(error)
        type(error_type), allocatable, intent(out) :: error
        type(pack_type) :: pack
        integer(long), allocatable :: words(:)
        real(wp), allocatable :: none(:), vector(:), matrix(:, :), cube(:, :, :)
        integer, allocatable :: numbers(:), no_numbers(:)
        character(len=:), allocatable :: text, no_text
        character(len=11) :: name
        character(len=32) :: problem
        real(wp) :: value
        logical :: flag

        allocate (vector(0))
        allocate (matrix, source=reshape([1.0_wp, -0.0_wp, huge(1.0_wp), 4.0_wp, tiny(1.0_wp), 6.0_wp], [2, 3]))
        allocate (cube, source=reshape([1.0_wp, 2.0_wp], [1, 2, 1]))
        allocate (numbers, source=[3, -4])
        text = 'longer than eight'
        name = 'eleven char'
        value = 0.1_wp
        flag = .true.
        call pack%begin_writing()
        call list()
        call pack%end_writing('test', words)
        deallocate (vector, cube, numbers, text)
        none = [1.0_wp]
        deallocate (matrix)
        allocate (matrix(1, 1), source=0.0_wp)
        no_numbers = [1]
        no_text = 'some'
        name = ''
        value = 0.0_wp
        flag = .false.
        call pack%begin_reading('test', words, problem)
        call list()
        call pack%end_reading()
        call check_true(error, problem == '' .and. .not. pack%has_failed, 'read')
        call check_true(error, .not. (allocated(none) .or. allocated(no_numbers) .or. allocated(no_text)), 'not allocated')
        if (allocated(error)) return
        call check_true(error, size(vector) == 0 .and. all(shape(matrix) == [2, 3]) .and. all(shape(cube) == [1, 2, 1]), 'shapes')
        if (allocated(error)) return
        call check_true(error, all(numbers == [3, -4]) .and. flag .and. name == 'eleven char' .and. text == 'longer than eight', &
            'values')
        call check_true(error, abs(value - 0.1_wp) <= 0.0_wp .and. sign(1.0_wp, matrix(2, 1)) < 0.0_wp .and. &
            abs(matrix(1, 3) - tiny(1.0_wp)) <= 0.0_wp .and. abs(cube(1, 2, 1) - 2.0_wp) <= 0.0_wp, 'numbers')

        call pack%begin_reading('test', words, problem)
        call pack%item(value)
        call pack%end_reading()
        call check_true(error, pack%has_failed, 'something is left')
        call pack%begin_reading('test', words, problem)
        call list()
        call pack%item(matrix)
        call check_true(error, pack%has_failed .and. .not. allocated(matrix), 'there is no more')

    contains

        subroutine list()
            call pack%item(value)
            call pack%item(none)
            call pack%item(vector)
            call pack%item(matrix)
            call pack%item(cube)
            call pack%item(numbers)
            call pack%item(no_numbers)
            call pack%text(text)
            call pack%text(no_text)
            call pack%item(name)
            call pack%item(flag)
        end subroutine list
    end subroutine test_items
end module test_pack
