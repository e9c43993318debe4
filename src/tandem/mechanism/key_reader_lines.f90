! SPDX-License-Identifier: MIT
!> Lines of the complete description.
submodule(tandem_mechanism_key_reader) tandem_mechanism_key_reader_lines
    implicit none (type, external)

contains

    module procedure record_key
        type(shown_type) :: line
        integer :: of

        if (self%failed() .or. self%is_brief) return
        line%key = key
        line%value = value
        if (present(is_whole)) line%is_whole = is_whole
        associate (element => self%elements(self%current))
            line%table = path_of(element)
            if (self%is_scene .and. element%name /= '') then
                line%table = trim(element%kind)
                line%element = self%opened
            end if
            if (entry > 0) line%source = self%entries%list(entry)%source
            of = entry
            if (of == 0 .and. element%n > 0) of = element%entries(1)
            if (of > 0 .and. .not. self%is_scene) then
                associate (its => self%entries%list(of))
                    if (.not. its%is_first) return
                    if (allocated(its%template)) then
                        line%table = its%template(:its%n_heading)
                        if (entry > 0) line%key = its%template(its%n_heading + 2:)
                    end if
                    if (entry > 0) line%value = its%given
                end associate
            end if
        end associate
        line%comment = ''
        if (present(unit)) line%comment = unit
        if (present(unit)) line%unit = unit
        if (present(help)) then
            if (len(line%comment) > 0 .and. len(help) > 0) line%comment = line%comment//', '
            line%comment = line%comment//help
        end if
        call self%show(line)
    end procedure record_key

    module procedure show
        type(shown_type), allocatable :: longer(:)

        if (self%is_brief) return
        if (.not. allocated(self%shown)) allocate (self%shown(64))
        if (self%n_shown == size(self%shown)) then
            allocate (longer(2*self%n_shown))
            longer(:self%n_shown) = self%shown
            call move_alloc(longer, self%shown)
        end if
        self%n_shown = self%n_shown + 1
        self%shown(self%n_shown) = line
    end procedure show

    module procedure remark
        type(shown_type) :: line

        if (self%failed()) return
        line%table = path_of(self%elements(self%current))
        line%key = ''
        line%comment = words
        call self%show(line)
    end procedure remark

    module procedure hide
        character(len=:), allocatable :: given
        integer :: i

        if (self%failed()) return
        given = ''
        do i = 1, self%n_shown
            associate (line => self%shown(i))
                if (line%table /= path_of(self%elements(self%current))) cycle
                line%is_hidden = .true.
                if (line%source >= source) given = line%key
            end associate
        end do
        if (given /= '') call self%refuse(given, reason)
    end procedure hide
end submodule tandem_mechanism_key_reader_lines
