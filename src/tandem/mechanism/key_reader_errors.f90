! SPDX-License-Identifier: MIT
!> Errors about keys, with the position of their entry.
submodule(tandem_mechanism_key_reader) tandem_mechanism_key_reader_errors
    use tandem_error, only: set_error
    use tandem_status, only: status_invalid_model, status_invalid_option, status_name
    implicit none (type, external)

contains

    module procedure fail
        integer :: k

        if (self%failed()) return
        k = self%find(key)
        associate (element => self%elements(self%current))
            if (k > 0) then
                call self%fail_at(k, self%entries%list(k)%key//': '//problem, advice)
            else
                if (element%n > 0) k = element%entries(1)
                call self%fail_at(k, trim(path_of(element)//merge('.', ' ', key /= '')//key)//': '//problem, advice)
            end if
        end associate
    end procedure fail

    module procedure refuse
        if (.not. self%failed()) call self%refuse_value(self%find(key), key, problem)
    end procedure refuse

    module procedure refuse_value
        if (self%failed()) return
        if (entry > 0) self%place = self%entries%list(entry)%place
        allocate (self%error)
        if (self%is_scene) then
            self%error%stat = status_invalid_option
            allocate (self%fault)
            associate (fault => self%fault, element => self%elements(self%current))
                fault%message = problem
                if (key /= '') fault%message = key//' '//problem
                fault%remark = 'in '//self%heading_of()
                fault%tail = ''
                fault%heading = self%heading_of()
                fault%source = element%source
                self%error%message = fault%message
            end associate
        else
            self%error%stat = status_invalid_model
            self%error%message = status_name(status_invalid_model)//': '//self%entries%list(entry)%key//': '//problem
        end if
    end procedure refuse_value

    module procedure refuse_at
        if (self%failed()) return
        call self%open_table('scene')
        call self%refuse_value(0, '', problem)
        self%place = place
        self%fault%remark = 'here'
    end procedure refuse_at

    module procedure refuse_all
        call self%fail_at(0, problem, advice)
    end procedure refuse_all

    module procedure blame
        if (.not. allocated(error) .or. self%failed()) return
        call move_alloc(error, self%error)
        self%place = place_in(self, self%elements(self%current))
    end procedure blame

    module procedure blame_named
        integer :: k

        if (.not. allocated(error) .or. self%failed()) return
        call move_alloc(error, self%error)
        self%place = 0
        do k = 1, self%n_elements
            if (self%elements(k)%name == '') cycle
            if (contains_word(self%error%message, trim(self%elements(k)%name))) self%place = place_in(self, self%elements(k))
            if (self%place > 0) return
        end do
    end procedure blame_named

    !> Position of an error within an element: of the key that the message contains, else of the text that it contains, else of the
    !> first key.
    pure integer function place_in(self, element) result(place)
        class(reader_type), intent(in) :: self
        type(element_type), intent(in) :: element
        integer :: i, j, k

        place = 0
        if (element%n > 0) place = self%entries%list(element%entries(1))%place
        do i = element%n, 1, -1
            k = element%entries(i)
            associate (atoms => self%entries%list(k)%value%atoms)
                do j = 1, size(atoms)
                    if (atoms(j)%kind /= is_text) cycle
                    if (contains_word(self%error%message, up_to_dot(atoms(j)%text))) place = self%entries%list(k)%place
                end do
            end associate
        end do
        do i = element%n, 1, -1
            k = element%entries(i)
            if (contains_word(self%error%message, key_of(self%entries%list(k), element))) place = self%entries%list(k)%place
        end do
    end function place_in

    module procedure fail_at
        if (self%failed()) return
        call set_error(self%error, status_invalid_model, problem, advice)
        if (entry > 0) self%place = self%entries%list(entry)%place
    end procedure fail_at

    !> True if a message contains a word as a whole.
    pure logical function contains_word(message, word)
        character(len=*), intent(in) :: message, word

        contains_word = scan_word(' ') .or. scan_word(':') .or. scan_word(';') .or. scan_word(',')

    contains

        !> True if a character separates words.
        pure logical function scan_word(sign)
            character(len=1), intent(in) :: sign

            scan_word = index(' '//message, ' '//word//sign) > 0
        end function scan_word
    end function contains_word

end submodule tandem_mechanism_key_reader_errors
