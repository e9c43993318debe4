! SPDX-License-Identifier: MIT
!> Assignment of entries to tables and elements, and the keys of the open one.
submodule(tandem_mechanism_key_reader) tandem_mechanism_key_reader_elements
    use tandem_mechanism_element_keys, only: add_to
    use tandem_mechanism_entries, only: is_number
    use tandem_mechanism_joint, only: name_length
    use tandem_names, only: nearest_name, question
    implicit none (type, external)

contains

    module procedure take
        character(len=:), allocatable :: key, kind, name
        integer :: i, j, k

        self%entries => entries
        allocate (self%elements(16))
        allocate (self%used(entries%n), source=.false.)
        self%n_elements = 0
        k = 0
        do i = 1, entries%n
            if (self%failed()) return
            key = entries%list(i)%key
            kind = up_to_dot(key)
            name = ''
            if (any(kinds == kind)) then
                key = key(min(len(kind) + 2, len(key) + 1):)
                name = up_to_dot(key)
                if (len(name) == 0 .or. len(name) == len(key)) then
                    call self%fail_at(i, entries%list(i)%key//' is a table, not a value', &
                        'write '//kind//'.NAME.KEY = ...')
                    return
                end if
                call check_length(self, i, name)
                if (self%failed()) return
            else if (.not. any(singles == kind)) then
                call self%fail_at(i, 'a mechanism has no table "'//kind//'"'//question(kind, [kinds, singles]), &
                    'use one of'//listed([kinds, singles]))
                return
            else if (len(kind) == len(key)) then
                call self%fail_at(i, kind//' is a table, not a value', 'write '//kind//'.KEY = ...')
                return
            end if
            if (k > 0) then
                if (self%elements(k)%kind /= kind .or. self%elements(k)%name /= name) k = 0
            end if
            if (k == 0) call find_element(self, kind, name, k)
            do j = 1, self%elements(k)%n
                if (entries%list(self%elements(k)%entries(j))%key /= entries%list(i)%key) cycle
                call self%fail_at(i, entries%list(i)%key//' is given twice', 'use other names in the repetition')
                return
            end do
            call add_to(self%elements(k), i)
        end do
    end procedure take

    module procedure take_tables
        character(len=:), allocatable :: key, kind, name
        logical :: has_key
        integer :: i, k

        self%is_scene = .true.
        self%entries => entries
        allocate (self%elements(16))
        allocate (self%used(entries%n), source=.false.)
        do i = 1, entries%n
            key = entries%list(i)%key
            kind = up_to_dot(key)
            name = ''
            if (any(arrays == kind)) name = up_to_dot(key(len(kind) + 2:))
            ! A table without keys has an entry of its own.
            has_key = len(key) > len(kind) + len(name) + count([name /= ''])
            call find_element(self, kind, name, k)
            if (self%elements(k)%n == 0) self%elements(k)%source = entries%list(i)%source
            if (has_key) call add_to(self%elements(k), i)
            if (name /= '') self%elements(k)%source = min(self%elements(k)%source, entries%list(i)%source)
        end do
    end procedure take_tables

    !> Refuse a name that is too long for an element or a point.
    subroutine check_length(self, entry, name)
        class(reader_type), intent(inout) :: self
        !> Entry whose key contains the name.
        integer, intent(in) :: entry
        character(len=*), intent(in) :: name

        if (len(name) > name_length) call self%fail_at(entry, 'the name "'//name(:name_length)//'..." is longer than '// &
            to_text(name_length)//' characters', 'shorten it')
    end subroutine check_length

    !> Index of the element with a name, which is appended if it does not exist.
    subroutine find_element(self, kind, name, k)
        class(reader_type), intent(inout) :: self
        character(len=*), intent(in) :: kind, name
        integer, intent(out) :: k
        type(element_type), allocatable :: longer(:)

        k = self%by_name%get(joined(trim(kind), trim(name)))
        if (k > 0) return
        k = self%n_elements + 1
        if (k > size(self%elements)) then
            allocate (longer(2*size(self%elements)))
            longer(:size(self%elements)) = self%elements
            call move_alloc(longer, self%elements)
        end if
        self%n_elements = k
        self%elements(k)%kind = kind
        self%elements(k)%name = name
        allocate (self%elements(k)%entries(8))
        call self%by_name%put(joined(trim(kind), trim(name)), k)
    end subroutine find_element

    module procedure n_of
        n_of = 0
        if (.not. self%failed()) n_of = count(self%elements(:self%n_elements)%kind == kind)
    end procedure n_of

    module procedure open_table
        integer :: k, n, nth

        if (self%failed()) return
        nth = 1
        if (present(number)) nth = number
        ! Search from the element opened last, because elements of a kind are opened in order.
        n = 0
        k = 1
        if (self%current > 0 .and. self%opened < nth) then
            if (self%elements(self%current)%kind == table) then
                n = self%opened
                k = self%current + 1
            end if
        end if
        do k = k, self%n_elements
            if (self%elements(k)%kind == table) n = n + 1
            if (n == nth) exit
        end do
        if (k > self%n_elements) call find_element(self, table, '', k)
        self%current = k
        self%opened = nth
        associate (element => self%elements(k))
            self%name = trim(element%name)
            if (.not. allocated(element%known)) allocate (element%known(32))
        end associate
    end procedure open_table

    module procedure close_table
        character(len=:), allocatable :: key
        integer :: i, k

        if (self%failed() .or. self%is_brief) return
        associate (element => self%elements(self%current))
            do i = 1, element%n
                k = element%entries(i)
                if (self%used(k)) cycle
                key = key_of(self%entries%list(k), element)
                associate (known => element%known(:element%n_known))
                    if (.not. self%is_scene) then
                        call self%fail_at(k, 'unknown key "'//key//'" of '//path_of(element)//question(key, known), &
                            'its keys are'//listed(known))
                        return
                    end if
                    if (any(known == key)) cycle
                    call refuse_unknown(self, k, key, known)
                end associate
                return
            end do
            deallocate (element%known)
            element%n_known = 0
        end associate
    end procedure close_table

    !> Refuse an unknown key of a scene table.
    subroutine refuse_unknown(self, entry, key, known)
        class(reader_type), intent(inout) :: self
        integer, intent(in) :: entry
        character(len=*), intent(in) :: key, known(:)
        character(len=:), allocatable :: near, keys

        near = nearest_name(key, known)
        keys = listed(known)
        if (size(known) == 0) keys = ' none'
        call self%refuse_value(entry, '', 'unknown key "'//key//'" in '//self%heading_of())
        self%fault%is_at_key = .true.
        self%fault%remark = ''
        if (near /= '') self%fault%remark = 'did you mean "'//near//'"?'
        self%fault%tail = 'the keys of '//self%heading_of()//':'//keys
    end subroutine refuse_unknown

    module procedure keys_below
        character(len=:), allocatable :: its
        integer :: i

        names = [character(len=key_length) ::]
        if (self%failed()) return
        call self%propose(key)
        associate (element => self%elements(self%current))
            do i = 1, element%n
                its = key_of(self%entries%list(element%entries(i)), element)
                if (index(its, key//'.') /= 1) cycle
                call check_length(self, element%entries(i), its(len(key) + 2:))
                names = [character(len=key_length) :: names, its(len(key) + 2:)]
            end do
        end associate
    end procedure keys_below

    module procedure propose
        if (self%failed()) return
        associate (element => self%elements(self%current))
            if (element%n_known == size(element%known)) element%known = [element%known, element%known]
            element%n_known = element%n_known + 1
            element%known(element%n_known) = key
        end associate
    end procedure propose

    module procedure replace
        integer :: i, k
        logical :: is_zero

        do i = 1, size(by)
            k = self%find(trim(by(i)))
            if (k == 0) cycle
            associate (entry => self%entries%list(k))
                if (entry%source == 0) cycle
                is_zero = .not. entry%value%is_list .and. all(entry%value%atoms%kind == is_number)
                if (is_zero) then
                    associate (atom => entry%value%atoms(1))
                        is_zero = .not. (allocated(atom%problem) .or. abs(atom%number) > 0.0_wp)
                    end associate
                end if
            end associate
            if (.not. is_zero) call drop(keys)
        end do
    contains
        !> Remove entries of the open table that the description gives.
        subroutine drop(keys)
            character(len=*), intent(in) :: keys(:)
            integer, allocatable :: kept(:)
            integer :: i

            associate (element => self%elements(self%current))
                allocate (kept(0))
                do i = 1, element%n
                    associate (entry => self%entries%list(element%entries(i)))
                        if (entry%source == 0 .and. any(keys == key_of(entry, element))) cycle
                    end associate
                    kept = [kept, element%entries(i)]
                end do
                element%n = size(kept)
                element%entries(:element%n) = kept
            end associate
        end subroutine drop
    end procedure replace

    module procedure index_of
        k = 0
        if (self%failed()) return
        call self%propose(key)
        k = self%find(key)
        if (k > 0) then
            self%used(k) = .true.
            call check_rows(self, k, key, row_length)
            if (self%failed()) k = 0
            return
        end if
        if (.not. present(required)) return
        if (.not. required) return
        if (self%is_scene) then
            call self%refuse_value(0, '', 'the key '//key//' is missing in '//self%heading_of())
            self%fault%heading = ''
        else
            call self%fail('', 'the key '//key//' is missing', 'add it')
        end if
    end procedure index_of

    !> Refuse a list of lists that is not a matrix, or whose rows have another length.
    subroutine check_rows(self, entry, key, expected)
        class(reader_type), intent(inout) :: self
        integer, intent(in) :: entry
        character(len=*), intent(in) :: key
        !> Required length of the rows.
        integer, intent(in), optional :: expected

        associate (given => self%entries%list(entry)%value%row_length)
            if (given == 0) return
            if (.not. present(expected)) then
                call self%refuse_value(entry, key, 'is a list of lists; give one list')
            else if (given /= expected) then
                call self%refuse_value(entry, key, 'has rows of '//to_text(given)//'; give '//to_text(expected)//' rows of '// &
                    to_text(expected))
            end if
        end associate
    end subroutine check_rows
end submodule tandem_mechanism_key_reader_elements
