! SPDX-License-Identifier: MIT
!> Protects a result file while it is written: excludes other writers, admits readers, keeps its end ahead of the data. The work
!> is done in guard.c.
module tandem_io_output_guard
    use, intrinsic :: iso_c_binding, only: c_char, c_int, c_int64_t, c_null_char
    implicit none (type, external)
    private

    public :: claim_type, guard_type, is_taken, system_reason, forget_reason

    !> The guard of one file.
    type :: guard_type
        integer(c_int), private :: file = -1_c_int
        character(len=:), allocatable, private :: path
    contains
        procedure :: take, mend, trim => trim_file, has_room, is_there, is_whole, release
    end type guard_type

    !> The claim of this process to change a file; it excludes other processes that want to change the file.
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

        function c_take(path) result(file) bind(c, name='tandem_guard_take')
            import :: c_char, c_int
            implicit none (type, external)
            character(kind=c_char), intent(in) :: path(*)
            integer(c_int) :: file
        end function c_take

        subroutine c_mend(file, end) bind(c, name='tandem_guard_mend')
            import :: c_int, c_int64_t
            implicit none (type, external)
            integer(c_int), value :: file
            integer(c_int64_t), value :: end
        end subroutine c_mend

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

        function c_is_there(file, path) result(answer) bind(c, name='tandem_guard_is_there')
            import :: c_char, c_int
            implicit none (type, external)
            integer(c_int), value :: file
            character(kind=c_char), intent(in) :: path(*)
            integer(c_int) :: answer
        end function c_is_there

        function c_is_whole(file) result(answer) bind(c, name='tandem_guard_is_whole')
            import :: c_int
            implicit none (type, external)
            integer(c_int), value :: file
            integer(c_int) :: answer
        end function c_is_whole

        function c_is_taken(path) result(answer) bind(c, name='tandem_guard_is_taken')
            import :: c_char, c_int
            implicit none (type, external)
            character(kind=c_char), intent(in) :: path(*)
            integer(c_int) :: answer
        end function c_is_taken

        function c_reason(text, size) result(length) bind(c, name='tandem_guard_reason')
            import :: c_char, c_int
            implicit none (type, external)
            character(kind=c_char), intent(inout) :: text(*)
            integer(c_int), value :: size
            integer(c_int) :: length
        end function c_reason

        !> So that an old refusal is not taken for a new one.
        subroutine forget_reason() bind(c, name='tandem_guard_forget_reason')
        end subroutine forget_reason
    end interface

contains

    !> Claim a file, unless that was done before.
    subroutine make_claim(self, path, is_refused)
        class(claim_type), intent(inout) :: self
        character(len=*), intent(in) :: path
        !> Another process has claimed it.
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

    !> Drop the claim.
    subroutine drop_claim(self)
        class(claim_type), intent(inout) :: self

        if (self%file >= 0) call c_release(self%file)
        self%file = -1_c_int
    end subroutine drop_claim

    !> Lock a file against other writers, unless it is locked already; readers are allowed.
    subroutine take(self, path)
        class(guard_type), intent(inout) :: self
        character(len=*), intent(in) :: path

        if (self%file >= 0) then
            if (self%path == path//c_null_char .and. self%is_there()) return
        end if
        call self%release()
        self%path = path//c_null_char
        self%file = c_take(self%path)
    end subroutine take

    !> Make the superblock acceptable to plain readers: without the mark left by a killed writer of another program, and with an end
    !> behind all pieces.
    subroutine mend(self, end)
        class(guard_type), intent(in) :: self
        !> Earliest future end of the file; 0 for the present end.
        integer(c_int64_t), intent(in) :: end

        if (self%file >= 0) call c_mend(self%file, end)
    end subroutine mend

    !> Cut a closed file at the end stated in its superblock.
    subroutine trim_file(self)
        class(guard_type), intent(in) :: self

        if (self%file >= 0) call c_trim(self%file)
    end subroutine trim_file

    !> True if the file may grow by so many bytes, or if there is no guard.
    logical function has_room(self, bytes)
        class(guard_type), intent(in) :: self
        integer(c_int64_t), intent(in) :: bytes

        has_room = .true.
        if (self%file >= 0) has_room = c_has_room(self%file, bytes) /= 0
    end function has_room

    !> True if the file still has the path at which it was created, or if there is no guard.
    logical function is_there(self)
        class(guard_type), intent(in) :: self

        is_there = .true.
        if (self%file >= 0) is_there = c_is_there(self%file, self%path) /= 0
    end function is_there

    !> True if the file has a superblock and is not shorter than stated there, or if there is no guard.
    logical function is_whole(self)
        class(guard_type), intent(in) :: self

        is_whole = .true.
        if (self%file >= 0) is_whole = c_is_whole(self%file) /= 0
    end function is_whole

    !> Let the file go.
    subroutine release(self)
        class(guard_type), intent(inout) :: self

        if (self%file >= 0) call c_release(self%file)
        self%file = -1_c_int
    end subroutine release

    !> True if another process has locked a file.
    logical function is_taken(path)
        character(len=*), intent(in) :: path

        is_taken = c_is_taken(path//c_null_char) /= 0
    end function is_taken

    !> The system's reason for its last refusal to write; blank if there was none.
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
