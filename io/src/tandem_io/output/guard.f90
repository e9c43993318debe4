! SPDX-License-Identifier: MIT
!> Protection of a result file while it is written: excludes other writers, admits readers, and keeps the stated end of the file
!> after the data. Implemented in guard.c.
module tandem_io_output_guard
    use, intrinsic :: iso_c_binding, only: c_char, c_int, c_int64_t, c_null_char
    implicit none (type, external)
    private

    public :: claim_type, guard_type, is_locked, system_reason, clear_reason

    !> The guard of one file.
    type :: guard_type
        integer(c_int), private :: file = -1_c_int
        character(len=:), allocatable, private :: path
    contains
        procedure :: lock, repair, trim => trim_file, has_room, still_exists, is_whole, release
    end type guard_type

    !> Exclusive right of this process to change a file; other processes cannot claim the file.
    type :: claim_type
        integer(c_int), private :: file = -1_c_int
        character(len=:), allocatable, private :: path
    contains
        procedure :: make => make_claim, drop => drop_claim
    end type claim_type

    interface
        function c_claim(path) result(file) bind(c, name='tandem_guard_claim')
            import :: c_char, c_int
            implicit none (type, external)
            character(kind=c_char), intent(in) :: path(*)
            integer(c_int) :: file
        end function c_claim

        function c_lock(path) result(file) bind(c, name='tandem_guard_lock')
            import :: c_char, c_int
            implicit none (type, external)
            character(kind=c_char), intent(in) :: path(*)
            integer(c_int) :: file
        end function c_lock

        subroutine c_repair(file, end) bind(c, name='tandem_guard_repair')
            import :: c_int, c_int64_t
            implicit none (type, external)
            integer(c_int), value :: file
            integer(c_int64_t), value :: end
        end subroutine c_repair

        subroutine c_trim(file) bind(c, name='tandem_guard_trim')
            import :: c_int
            implicit none (type, external)
            integer(c_int), value :: file
        end subroutine c_trim

        function c_has_room(file, bytes) result(answer) bind(c, name='tandem_guard_has_room')
            import :: c_int, c_int64_t
            implicit none (type, external)
            integer(c_int), value :: file
            integer(c_int64_t), value :: bytes
            integer(c_int) :: answer
        end function c_has_room

        subroutine c_release(file) bind(c, name='tandem_guard_release')
            import :: c_int
            implicit none (type, external)
            integer(c_int), value :: file
        end subroutine c_release

        function c_still_exists(file, path) result(answer) bind(c, name='tandem_guard_still_exists')
            import :: c_char, c_int
            implicit none (type, external)
            integer(c_int), value :: file
            character(kind=c_char), intent(in) :: path(*)
            integer(c_int) :: answer
        end function c_still_exists

        function c_is_whole(file) result(answer) bind(c, name='tandem_guard_is_whole')
            import :: c_int
            implicit none (type, external)
            integer(c_int), value :: file
            integer(c_int) :: answer
        end function c_is_whole

        function c_is_locked(path) result(answer) bind(c, name='tandem_guard_is_locked')
            import :: c_char, c_int
            implicit none (type, external)
            character(kind=c_char), intent(in) :: path(*)
            integer(c_int) :: answer
        end function c_is_locked

        function c_reason(text, size) result(length) bind(c, name='tandem_guard_reason')
            import :: c_char, c_int
            implicit none (type, external)
            character(kind=c_char), intent(inout) :: text(*)
            integer(c_int), value :: size
            integer(c_int) :: length
        end function c_reason

        !> Clear the system's last error, which would otherwise be reported as the reason of a later failure.
        subroutine clear_reason() bind(c, name='tandem_guard_clear_reason')
        end subroutine clear_reason
    end interface

contains

    !> Claim a file, unless this object has claimed it already.
    subroutine make_claim(self, path, is_refused)
        class(claim_type), intent(inout) :: self
        character(len=*), intent(in) :: path
        !> True if another process has claimed the file.
        logical, intent(out) :: is_refused

        is_refused = .false.
        if (self%file >= 0) then
            if (self%path == path) return
        end if
        call self%drop()
        self%path = path
        self%file = c_claim(path//c_null_char)
        is_refused = self%file < -1_c_int
    end subroutine make_claim

    !> Release the claim.
    subroutine drop_claim(self)
        class(claim_type), intent(inout) :: self

        if (self%file >= 0) call c_release(self%file)
        self%file = -1_c_int
    end subroutine drop_claim

    !> Lock a file against other writers, unless this object has locked it already; readers are admitted.
    subroutine lock(self, path)
        class(guard_type), intent(inout) :: self
        character(len=*), intent(in) :: path

        if (self%file >= 0) then
            if (self%path == path//c_null_char .and. self%still_exists()) return
        end if
        call self%release()
        self%path = path//c_null_char
        self%file = c_lock(self%path)
    end subroutine lock

    !> Make the superblock acceptable to plain readers: remove the mark left by a killed writer of another program, and set an end
    !> of file after all blocks.
    subroutine repair(self, end)
        class(guard_type), intent(in) :: self
        !> Lower bound of the new end of file; 0 to keep the present one.
        integer(c_int64_t), intent(in) :: end

        if (self%file >= 0) call c_repair(self%file, end)
    end subroutine repair

    !> Truncate a closed file to the end stated in its superblock.
    subroutine trim_file(self)
        class(guard_type), intent(in) :: self

        if (self%file >= 0) call c_trim(self%file)
    end subroutine trim_file

    !> True if the file can grow by a number of bytes, or if there is no guard.
    logical function has_room(self, bytes)
        class(guard_type), intent(in) :: self
        integer(c_int64_t), intent(in) :: bytes

        has_room = .true.
        if (self%file >= 0) has_room = c_has_room(self%file, bytes) /= 0
    end function has_room

    !> True if the path still refers to this file, or if there is no guard.
    logical function still_exists(self)
        class(guard_type), intent(in) :: self

        still_exists = .true.
        if (self%file >= 0) still_exists = c_still_exists(self%file, self%path) /= 0
    end function still_exists

    !> True if the file has a superblock and is not shorter than stated in it, or if there is no guard.
    logical function is_whole(self)
        class(guard_type), intent(in) :: self

        is_whole = .true.
        if (self%file >= 0) is_whole = c_is_whole(self%file) /= 0
    end function is_whole

    !> Unlock the file.
    subroutine release(self)
        class(guard_type), intent(inout) :: self

        if (self%file >= 0) call c_release(self%file)
        self%file = -1_c_int
    end subroutine release

    !> True if another process has locked a file.
    logical function is_locked(path)
        character(len=*), intent(in) :: path

        is_locked = c_is_locked(path//c_null_char) /= 0
    end function is_locked

    !> Reason of the system's last refusal to write; blank if there was none.
    function system_reason() result(text)
        character(len=80) :: text
        character(kind=c_char) :: letters(len(text))
        integer :: i

        text = ''
        do i = 1, int(c_reason(letters, int(len(text), c_int)))
            text(i:i) = letters(i)
        end do
    end function system_reason
end module tandem_io_output_guard
