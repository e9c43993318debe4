! SPDX-License-Identifier: MIT
!> Paths of scenes. A scene is specified by its path or by the name NAME of a file NAME.toml. The file is searched in these folders:
!> - the folder given by the environment variable TANDEM_SCENES;
!> - `scenes` in the current folder;
!> - `share/tandem/scenes` beside the folder of the program, where `make install` puts scenes;
!> - `scenes` beside the program, or in one of the four folders above it, for programs built in a checkout.
module tandem_io_scene_shipped
    use tandem, only: error_type
    use tandem_io_scene_source, only: set_input_error
    use tandem_io_scene_text, only: listed, nearest_name
    use, intrinsic :: iso_c_binding, only: c_char, c_int, c_intptr_t, c_null_char, c_size_t
    implicit none (type, external)
    private

    public :: find_scene, path_length, program_path, shipped_scenes

    !> Number of folders above the program that are searched.
    integer, parameter :: levels = 4
    !> Largest number of scenes in a list.
    integer, parameter :: most = 256
    !> Largest length of a path.
    integer, parameter :: path_length = 4096
    !> File name extension of scenes.
    character(len=*), parameter :: ending = '.toml'

    interface
        !> Write the names in a folder, each followed by a newline. Returns the number of bytes written.
        function list_folder(path, names, size) result(length) bind(c, name='tandem_list_folder')
            import :: c_char, c_int
            implicit none (type, external)
            character(kind=c_char), intent(in) :: path(*)
            character(kind=c_char), intent(out) :: names(*)
            integer(c_int), value :: size
            integer(c_int) :: length
        end function list_folder

        !> Target of a symbolic link, without a terminating null. Returns its length; -1 after a failure.
        function read_link(path, target_, size) result(length) bind(c, name='readlink')
            import :: c_char, c_size_t, c_intptr_t
            implicit none (type, external)
            character(kind=c_char), intent(in) :: path(*)
            character(kind=c_char), intent(out) :: target_(*)
            integer(c_size_t), value :: size
            integer(c_intptr_t) :: length
        end function read_link
    end interface

contains

    !> Find the path of a scene. A name that contains a slash or ends in .toml is a path.
    subroutine find_scene(name, path, error)
        !> Path or name of a scene.
        character(len=*), intent(in) :: name
        character(len=:), allocatable, intent(out) :: path
        type(error_type), allocatable, intent(out) :: error
        character(len=path_length), allocatable :: folders(:), names(:)
        character(len=:), allocatable :: message
        logical :: exists
        integer :: i

        path = name
        if (index(name, '/') > 0) return
        if (len(name) > len(ending)) then
            if (name(len(name) - len(ending) + 1:) == ending) return
        end if
        allocate (folders, source=scene_folders())
        do i = 1, size(folders)
            path = trim(folders(i))//'/'//name//ending
            inquire (file=path, exist=exists)
            if (exists) return
        end do
        allocate (names, source=shipped_scenes())
        do i = 1, size(names)
            names(i) = name_of(names(i))
        end do
        message = 'there is no scene "'//name//'"'
        if (nearest_name(name, names) /= '') message = message//'; did you mean "'//nearest_name(name, names)//'"?'
        message = message//new_line('a')//'A scene is the path of a TOML file or the name of a shipped scene'
        if (size(names) > 0) then
            message = message//': '//listed(names)
        else
            message = message//'; the folder of shipped scenes was not found; set TANDEM_SCENES to it'
        end if
        call set_input_error(error, message)
    end subroutine find_scene

    !> Paths of all scenes in the searched folders, sorted by name.
    function shipped_scenes() result(paths)
        character(len=path_length), allocatable :: paths(:), folders(:), found(:)
        character(len=path_length) :: swap
        integer :: i, j, n

        allocate (folders, source=scene_folders())
        allocate (found(most))
        n = 0
        do i = 1, size(folders)
            call add_scenes(trim(folders(i)), found, n)
        end do
        do i = 2, n
            do j = i, 2, -1
                if (name_of(found(j)) >= name_of(found(j - 1))) exit
                swap = found(j)
                found(j) = found(j - 1)
                found(j - 1) = swap
            end do
        end do
        allocate (paths, source=found(:n))
    end function shipped_scenes

    !> Add the scenes of a folder, except those with the name of a scene already found.
    subroutine add_scenes(folder, found, n)
        character(len=*), intent(in) :: folder
        character(len=path_length), intent(inout) :: found(:)
        integer, intent(inout) :: n
        character(kind=c_char), allocatable :: names(:)
        character(len=:), allocatable :: name
        integer :: i, j, length

        allocate (names(65536))
        length = int(list_folder(folder//c_null_char, names, int(size(names), c_int)))
        name = ''
        do i = 1, length
            if (names(i) /= new_line('a')) then
                name = name//names(i)
                cycle
            end if
            j = len(name) - len(ending)
            if (j > 0 .and. n < size(found)) then
                if (name(j + 1:) == ending .and. name(1:1) /= '.' .and. &
                    .not. any([(name_of(found(j)) == name(:len(name) - len(ending)), j=1, n)])) then
                    n = n + 1
                    found(n) = folder//'/'//name
                end if
            end if
            name = ''
        end do
    end subroutine add_scenes

    !> Name of a scene file, without folder and extension.
    pure function name_of(path) result(name)
        character(len=*), intent(in) :: path
        character(len=:), allocatable :: name
        integer :: last

        name = trim(path(index(path, '/', back=.true.) + 1:))
        last = index(name, ending, back=.true.) - 1
        if (last > 0) name = name(:last)
    end function name_of

    !> Searched folders, in order.
    function scene_folders() result(folders)
        character(len=path_length), allocatable :: folders(:)
        character(len=:), allocatable :: program_
        character(len=path_length) :: named
        integer :: i, n, last, length, stat

        allocate (folders(levels + 4))
        n = 0
        call get_environment_variable('TANDEM_SCENES', named, length, stat)
        if (stat == 0 .and. length > 0) call add(trim(named))
        call add('scenes')
        program_ = program_path()
        do i = 0, levels
            last = index(program_, '/', back=.true.)
            if (last == 0) exit
            program_ = program_(:last - 1)
            if (i == 1) call add(program_//'/share/tandem/scenes')
            call add(program_//'/scenes')
        end do
        folders = folders(:n)
    contains
        !> Add a folder.
        subroutine add(folder)
            character(len=*), intent(in) :: folder

            n = n + 1
            folders(n) = folder
        end subroutine add
    end function scene_folders

    !> Absolute path of this program, or the path by which it was called if the system does not provide the former.
    function program_path() result(path)
        character(len=:), allocatable :: path
        character(kind=c_char) :: letters(path_length)
        character(len=path_length) :: called
        integer :: i, length, stat

        length = int(read_link('/proc/self/exe'//c_null_char, letters, int(path_length, c_size_t)))
        if (length > 0) then
            allocate (character(len=length) :: path)
            do i = 1, length
                path(i:i) = letters(i)
            end do
        else
            call get_command_argument(0, called, length, stat)
            path = trim(called)
        end if
    end function program_path
end module tandem_io_scene_shipped
