! SPDX-License-Identifier: MIT
!> Builder procedures for bodies and their points.
submodule(tandem_mechanism_builder) tandem_mechanism_builder_bodies
    use tandem_error, only: to_text
    use tandem_mechanism_refusal, only: refuse, take_vector
    use tandem_mechanism_sensor, only: of_distance, of_knife_edge, of_joint, of_kind, of_massless_wheel, of_row, of_wheel
    use, intrinsic :: ieee_arithmetic, only: ieee_is_finite
    implicit none (type, external)

    !> Parts of the largest moment of inertia below which negative ones are rounding.
    real(wp), parameter :: rounding = 1.0e-12_wp

contains

    module procedure add_body
        type(body_type) :: body
        character(len=:), allocatable :: label

        label = 'body '//trim(name)
        call self%check_name(name, label, error)
        if (allocated(error)) return
        if (.not. (mass >= 0.0_wp .and. ieee_is_finite(mass))) then
            call refuse(label//' has the mass '//to_text(mass), 'give a mass >= 0 in kg', error)
            return
        end if
        body%name = name
        body%mass = mass
        call take_vector(self%planar, label, 'position', position, body%position, error)
        if (allocated(error)) return
        if (present(velocity)) call take_vector(self%planar, label, 'velocity', velocity, body%velocity, error)
        if (allocated(error)) return
        body%turns = present(inertia)
        if (present(inertia)) call take_inertia(self%planar, label, inertia, body, error)
        if (allocated(error)) return
        if (present(orientation)) then
            if (size(orientation) /= merge(1, 4, self%planar)) then
                call refuse(label//': the orientation has '//to_text(size(orientation))//' entries', &
                    'give an angle in the plane, four Euler parameters in space', error)
            else if (self%planar) then
                body%angle = orientation(1)
            else if (norm2(orientation) > 0.0_wp) then
                body%p = orientation/norm2(orientation)
            else
                call refuse(label//': the Euler parameters are zero or not finite', 'give a unit quaternion', error)
            end if
            if (allocated(error)) return
        end if
        if (present(omega)) then
            if (size(omega) /= merge(1, 3, self%planar)) then
                call refuse(label//': omega has '//to_text(size(omega))//' entries', 'give one in the plane, three in space', error)
                return
            end if
            if (self%planar) then
                body%omega(3) = omega(1)
            else
                body%omega = omega
            end if
        end if
        self%n_of%bodies = self%n_of%bodies + 1
        if (self%n_of%bodies > size(self%bodies)) self%bodies = [self%bodies, self%bodies, body]
        self%bodies(self%n_of%bodies) = body
        call self%keep_name(name, 0, self%n_of%bodies)
    end procedure add_body

    module procedure add_point
        type(point_type) :: point

        ! A point of the ground may be the first element.
        if (.not. allocated(self%types)) call self%clear()
        point%name = name
        point%body = self%find_body(body)
        if (point%body < 0) then
            call refuse('point '//trim(name)//': there is no body '//trim(body), 'define the body before its points', error)
            return
        else if (len_trim(name) == 0 .or. len_trim(name) > name_length .or. index(trim(name), '.') > 0) then
            call refuse('a point of '//trim(body)//' has the name "'//trim(name)//'"', 'use 1 to '//to_text(name_length)// &
                ' characters without a dot', error)
            return
        end if
        if (self%index_of%points%get(trim(body)//'.'//name) > 0) then
            call refuse('point '//trim(body)//'.'//trim(name)//' exists already', 'use another name', error)
            return
        end if
        call take_vector(self%planar, 'point '//trim(body)//'.'//trim(name), 'place', place, point%place, error)
        if (allocated(error)) return
        self%n_of%points = self%n_of%points + 1
        if (self%n_of%points > size(self%points)) self%points = [self%points, self%points, point]
        self%points(self%n_of%points) = point
        call self%index_of%points%put(trim(body)//'.'//name, self%n_of%points)
    end procedure add_point

    module procedure check_name
        if (.not. allocated(self%types)) call self%clear()
        if (len_trim(name) == 0 .or. len_trim(name) > name_length .or. index(trim(name), '.') > 0 .or. &
            index(trim(name), ' ') > 0) then
            call refuse(label//': "'//trim(name)//'" is not a valid name', 'use 1 to '//to_text(name_length)// &
                ' characters without dots and blanks', error)
        else if (name == 'ground' .or. self%index_of%names%get(name) > 0) then
            call refuse(label//': there is another "'//trim(name)//'" already, '//trim(kind_of(self, name)), &
                'use another name: bodies, joints, constraints, wheels and forces share them', error)
        end if
    end procedure check_name

    module procedure take_point
        integer :: dot, k

        place = 0.0_wp
        dot = index(text, '.')
        is_point = dot > 0
        if (.not. is_point) dot = len(text) + 1
        body = self%find_body(text(:dot - 1))
        if (body < 0) then
            call refuse(label//': there is no body '//trim(text(:dot - 1)), 'define it first, or correct the name', error)
            return
        end if
        if (.not. is_point) return
        k = self%index_of%points%get(trim(text(:dot - 1))//text(dot:))
        if (k > 0) then
            place = self%points(k)%place
            return
        end if
        call refuse(label//': the body '//text(:dot - 1)//' has no point '//trim(text(dot + 1:)), &
            'define it first, or correct the name', error)
    end procedure take_point

    module procedure take_pair
        points = .false.
        call self%take_point(label, one, pair%first, pair%s1, points(1), error)
        if (.not. allocated(error)) call self%take_point(label, other, pair%second, pair%s2, points(2), error)
        if (allocated(error)) return
        if (pair%first == pair%second) call refuse(label//' connects a body to itself', 'name two different bodies', error)
    end procedure take_pair

    !> Set the inertia of a body from one, three or six values.
    subroutine take_inertia(planar, label, inertia, body, error)
        logical, intent(in) :: planar
        character(len=*), intent(in) :: label
        real(wp), intent(in) :: inertia(:)
        type(body_type), intent(inout) :: body
        type(error_type), allocatable, intent(inout) :: error
        integer :: i

        if (.not. all(ieee_is_finite(inertia))) then
            call refuse(label//' has an inertia that is not finite', 'give values in kg m^2', error)
        else if (planar) then
            if (size(inertia) /= 1) then
                call refuse(label//' has '//to_text(size(inertia))//' moments of inertia', 'in the plane there is one', error)
                return
            end if
            body%inertia(3, 3) = inertia(1)
            if (inertia(1) < 0.0_wp) call refuse(label//' has a negative inertia', 'give a value >= 0 in kg m^2', error)
        else
            if (all(size(inertia) /= [3, 6])) then
                call refuse(label//' has '//to_text(size(inertia))//' moments of inertia', &
                    'give three principal values, or six entries', error)
                return
            end if
            do i = 1, 3
                body%inertia(i, i) = inertia(i)
                ! Rounding of a program that computed it.
                if (inertia(i) < 0.0_wp .and. inertia(i) >= -rounding*maxval(abs(inertia))) body%inertia(i, i) = 0.0_wp
            end do
            if (size(inertia) == 6) then
                body%is_principal = .false.
                body%inertia(1, 2) = inertia(4)
                body%inertia(1, 3) = inertia(5)
                body%inertia(2, 3) = inertia(6)
                body%inertia(2, 1) = inertia(4)
                body%inertia(3, 1) = inertia(5)
                body%inertia(3, 2) = inertia(6)
            end if
            if (any([(body%inertia(i, i), i=1, 3)] < 0.0_wp)) then
                call refuse(label//' has a negative moment of inertia', 'give values >= 0 in kg m^2', error)
            else if (.not. is_semidefinite(body%inertia)) then
                call refuse(label//' has an inertia that is negative about one of its principal axes', &
                    'check the products of inertia: none may exceed the square root of the product of its two moments', error)
            end if
        end if
    end subroutine take_inertia

    !> True if every principal minor of a symmetric matrix with a nonnegative diagonal is nonnegative up to rounding.
    pure logical function is_semidefinite(a)
        real(wp), intent(in) :: a(3, 3)
        real(wp) :: size_of
        integer :: i, k

        size_of = maxval(abs(a))
        is_semidefinite = a(1, 1)*(a(2, 2)*a(3, 3) - a(2, 3)**2) - a(1, 2)*(a(1, 2)*a(3, 3) - a(2, 3)*a(1, 3)) + &
            a(1, 3)*(a(1, 2)*a(2, 3) - a(2, 2)*a(1, 3)) >= -rounding*size_of**3
        do i = 1, 3
            k = 1 + modulo(i, 3)
            is_semidefinite = is_semidefinite .and. a(i, i)*a(k, k) - a(i, k)**2 >= -rounding*size_of**2
        end do
    end function is_semidefinite

    !> Kind of the element of a name.
    pure function kind_of(self, name) result(kind)
        class(builder_type), intent(in) :: self
        character(len=*), intent(in) :: name
        character(len=16) :: kind
        integer :: type_of, number

        kind = 'the ground'
        if (name == 'ground') return
        call self%find_element(name, type_of, number)
        select case (type_of)
        case (0)
            kind = 'a body'
        case (of_joint)
            kind = 'a joint'
        case (of_wheel, of_knife_edge, of_massless_wheel)
            kind = 'a wheel or edge'
        case (of_row, of_distance)
            kind = 'a constraint'
        case default
            kind = 'a '//self%kinds(type_of - of_kind)%of%table()
        end select
    end function kind_of
end submodule tandem_mechanism_builder_bodies
