! SPDX-License-Identifier: MIT
!> Couplings, rows that constrain a sum of joint coordinates, Phi = sum of factor_i x_i(q) - f(t) - at: gears, racks, belts, screws.
!> Angles may exceed a full turn. Full turns are summed separately and exactly: the constraint of a pair of gears is as accurate
!> after a million turns as at the start.
!>
!> A row that events lock and free is always present, since the size of a model is constant. The row has a coordinate of its own,
!> the slack s. A free row is s = 0 and the joints are free; a locked row constrains the joints, and the slack remains constant. The
!> mass of a slack affects only rounding and is that of a body. Locking sets `at` to the current value of the sum.
!>
!> The row of an imposed angle in space is a coupling, Phi = phi - f(t) between -pi and pi: its only root is phi = f(t) up to full
!> turns, which do not change the orientations of bodies.
module tandem_mechanism_elements_coupling
    use tandem_error, only: error_type
    use tandem_kinds, only: sp, wp
    use tandem_mechanism_builder, only: builder_type
    use tandem_mechanism_context, only: context_type
    use tandem_mechanism_coordinate, only: coordinate_type, differentiate_coordinate, find_slope, is_angle, &
        is_rotation, measure_apart, pi
    use tandem_mechanism_element_keys, only: text_length
    use tandem_mechanism_element_kind, only: constraint_type, element_kind_type, word_length
    use tandem_mechanism_function, only: function_type
    use tandem_mechanism_key_reader, only: anything, not_negative, reader_type
    use tandem_mechanism_pair, only: add_holonomic, add_row, columns, columns_of_c, n_local
    use tandem_mechanism_pose, only: pose_type
    use tandem_model, only: model_type
    use tandem_model_derivatives, only: derivatives_type
    use tandem_model_terms, only: need_gamma, need_jacobian, need_nu, need_phi, terms_type
    implicit none (type, external)
    private

    public :: coupling_kind_type, coupling_type, max_coupled

    !> Largest number of coordinates of one row, including a sum that is a coordinate.
    integer, parameter :: max_coupled = 9
    !> Numbers of a coupling: the locked value `at`; 1 if the row is locked, 0 if it is free.
    integer, parameter :: at = 1, locked = 2

    !> A sum of factors times joint coordinates, which a row keeps equal to 0 or to a function of time.
    type :: coupling_type
        !> Row of Phi; index before that of its first coordinate, and number of coordinates.
        integer :: row = 0, before = 0, n = 0
        real(wp) :: factors(max_coupled) = 0.0_wp
        !> Index of f, 0 if none; true if full turns do not count in Phi.
        integer :: motion = 0
        logical :: drops_turns = .false.
        !> True for a row that can be freed; its slack is the coordinate behind those of the sum.
        logical :: can_be_freed = .false.
        !> Sum that is a coordinate with an inertia, such as the angle of a rotor: the last coordinate of the row, with the factor
        !> -1. Its index in the coordinates of the mechanism, 0 for all other rows.
        integer :: displacement = 0
    end type coupling_type

    !> All couplings.
    type, extends(element_kind_type) :: coupling_kind_type
        type(coupling_type), allocatable, private :: list(:)
    contains
        procedure, nopass :: label, table, read => read_coupling
        procedure :: append, touch, constraint, start, add_rows, differentiate, lock
    end type coupling_kind_type

    !> A sum of factors times numbers of turns, with its rounding error.
    type :: turns_type
        real(wp) :: total = 0.0_wp, rest = 0.0_wp
    end type turns_type

contains

    pure function label()
        character(len=word_length) :: label

        label = 'coupling'
    end function label

    pure function table()
        character(len=10) :: table

        table = 'constraint'
    end function table

    subroutine read_coupling(reader, mechanism, n_points)
        type(reader_type), intent(inout) :: reader
        class(model_type), intent(inout) :: mechanism
        integer, intent(inout) :: n_points
        character(len=:), allocatable :: name
        character(len=text_length), allocatable :: texts(:)
        real(wp), allocatable :: factors(:), inertia
        class(function_type), allocatable :: motion
        logical, allocatable :: locked
        type(error_type), allocatable :: error

        name = reader%name
        call reader%get_texts('joints', 0, texts, 'joints whose coordinates, times factors, add up to 0 or to the motion', &
            required=.true.)
        if (allocated(texts)) call reader%get_numbers('factors', [size(texts)], factors, anything, '', &
            'one for each joint', required=.true.)
        call reader%get_function('motion', motion, '', 'of time')
        call reader%get_number('inertia', inertia, not_negative, 'kg m^2 or kg', &
            'makes the sum a free coordinate with this inertia, on which forces may act')
        if (reader%gives('locked')) locked = .true.
        if (allocated(locked)) call reader%get('locked', locked, 'true: initially locked; events lock and free it')
        call reader%close_table()
        if (reader%failed()) return
        select type (mechanism)
        class is (builder_type)
            call mechanism%add_coupling(name, texts, factors, error, motion, locked, inertia)
        end select
        call reader%blame(error)
    end subroutine read_coupling

    !> Append a coupling with its coordinates.
    pure subroutine append(self, coupling, coordinates, is_locked)
        class(coupling_kind_type), intent(inout) :: self
        type(coupling_type), intent(in) :: coupling
        !> The coordinates of the sum, and a slack.
        type(coordinate_type), intent(in) :: coordinates(:)
        logical, intent(in) :: is_locked

        call self%add([0.0_wp, merge(1.0_wp, 0.0_wp, is_locked), 0.0_wp], coordinates)
        if (.not. allocated(self%list)) allocate (self%list(1))
        if (self%n > size(self%list)) self%list = [self%list, self%list]
        self%list(self%n) = coupling
        self%list(self%n)%before = self%n_coordinates - size(coordinates)
        self%has_rows = .true.
        if (.not. coupling%drops_turns) self%counts_turns = .true.
    end subroutine append

    !> Bodies of all coordinates.
    subroutine touch(self, number, context, n, bodies)
        class(coupling_kind_type), intent(in) :: self
        integer, intent(in) :: number
        type(context_type), intent(in) :: context
        integer, intent(out) :: n
        integer, allocatable, intent(inout) :: bodies(:)
        integer :: k, last

        associate (it => self%list(number))
            last = it%n + merge(1, 0, it%can_be_freed)
            n = 2*last
            if (n > size(bodies)) bodies = spread(0, 1, n)
            do k = 1, last
                bodies(2*k - 1) = self%coordinates(it%before + k)%first
                bodies(2*k) = self%coordinates(it%before + k)%second
            end do
        end associate
    end subroutine touch

    pure function constraint(self, number, length)
        class(coupling_kind_type), intent(in) :: self
        integer, intent(in) :: number
        real(wp), intent(in) :: length
        type(constraint_type) :: constraint
        integer :: k, n

        associate (it => self%list(number))
            n = it%n
            if (it%displacement > 0) n = n - 1
            constraint%row = it%row
            constraint%motion = it%motion
            constraint%is_angle = self%coordinates(it%before + 1)%kind == is_angle
            constraint%can_be_freed = it%can_be_freed
            constraint%is_locked = self%numbers(locked, number) > 0.0_wp
            constraint%displacement = it%displacement
            if (it%can_be_freed .or. it%displacement > 0) constraint%slide = self%coordinates(it%before + n + 1)%second
            constraint%scale = 0.0_wp
            do k = 1, n
                constraint%scale = constraint%scale + abs(it%factors(k))*merge(1.0_wp, length, &
                    is_rotation(self%coordinates(it%before + k)))
            end do
        end associate
    end function constraint

    !> A sum that is a coordinate starts with the sum of its coordinates.
    subroutine start(self, pose)
        class(coupling_kind_type), intent(in) :: self
        type(pose_type), intent(inout) :: pose(0:)
        type(coordinate_type) :: coordinate
        real(wp) :: x(0:2), gradient(n_local, 0:2), total(0:1)
        integer :: i, k

        do i = 1, self%n
            associate (it => self%list(i))
                if (it%displacement == 0) cycle
                total = 0.0_wp
                do k = 1, it%n - 1
                    coordinate = self%coordinates(it%before + k)
                    call differentiate_coordinate(coordinate, pose, 1, 0, x, gradient)
                    total = total + it%factors(k)*x(0:1)
                end do
                ! A sum may be a part of another one.
                pose(self%coordinates(it%before + it%n)%second)%r(1, 0:1) = total
            end associate
        end do
    end subroutine start

    !> Add factor*turns. The product of the leading 24 bits of the factor and the number of turns is exact, and so is the remainder,
    !> for numbers up to 2**24; beyond that the error is at most that of a plain sum.
    pure subroutine add_turns(self, factor, turns)
        type(turns_type), intent(inout) :: self
        real(wp), intent(in) :: factor, turns
        real(wp) :: leading, part, sum, back

        if (.not. abs(turns) > 0.0_wp) return
        leading = 0.0_wp
        if (abs(factor) < huge(1.0_sp)) leading = real(real(factor, sp), wp)
        part = leading*turns
        sum = self%total + part
        back = sum - self%total
        self%rest = self%rest + ((self%total - (sum - back)) + (part - back)) + (factor - leading)*turns
        self%total = sum
    end subroutine add_turns

    !> The sum in radians.
    pure real(wp) function angle_of(self)
        type(turns_type), intent(in) :: self

        angle_of = 2*pi*(self%total + self%rest)
    end function angle_of

    pure subroutine add_rows(self, need, context, terms, stat)
        class(coupling_kind_type), intent(inout) :: self
        integer, intent(in) :: need
        type(context_type), intent(inout) :: context
        type(terms_type), intent(inout) :: terms
        integer, intent(inout) :: stat
        real(wp) :: x(0:2), sum(0:2), c(0:2), gradient(n_local, 0:2), counted
        type(turns_type) :: turns
        integer :: i, k, last, gradients
        logical :: needs_slopes

        last = merge(2, 0, iand(need, need_gamma) /= 0)
        gradients = merge(0, -1, iand(need, need_jacobian) /= 0)
        needs_slopes = gradients == 0 .and. iand(need, need_phi + need_gamma) == 0
        do i = 1, self%n
            associate (it => self%list(i))
                if (terms%is_compressed .and. iand(need, need_jacobian) /= 0) terms%jacobian(it%row, :) = 0.0_wp
                if (.not. self%numbers(locked, i) > 0.0_wp) then
                    call add_free_row(it%row, context%pose(self%coordinates(it%before + it%n + 1)%second), need, terms)
                    cycle
                end if
                sum = 0.0_wp
                turns = turns_type()
                do k = it%before + 1, it%before + it%n
                    associate (coordinate => self%coordinates(k), factor => it%factors(k - it%before))
                        if (iand(need, need_jacobian + need_gamma) == 0) then
                            call measure_apart(coordinate, context%pose, x(0), counted)
                            sum(0) = sum(0) + factor*x(0)
                            call add_turns(turns, factor, counted)
                            cycle
                        end if
                        if (needs_slopes) then
                            call find_slope(coordinate, context%pose, x(0:1), gradient(:, 0))
                        else
                            x = 0.0_wp
                            call differentiate_coordinate(coordinate, context%pose, last, gradients, x, gradient, turns=counted)
                            sum = sum + factor*x
                            call add_turns(turns, factor, counted)
                        end if
                        if (iand(need, need_jacobian) /= 0) call add_row(columns_of_c(context%pose(coordinate%first), &
                            context%pose(coordinate%second)), factor, gradient(:, 0), it%row, terms%jacobian)
                    end associate
                end do
                c = 0.0_wp
                if (it%motion > 0) c = context%f(:, it%motion)
                if (iand(need, need_phi) /= 0) then
                    if (it%drops_turns) then
                        terms%phi(it%row) = sum(0) - self%numbers(at, i) - c(0)
                        terms%phi(it%row) = terms%phi(it%row) - 2*pi*anint(terms%phi(it%row)/(2*pi))
                    else
                        terms%phi(it%row) = sum(0) + ((angle_of(turns) - self%numbers(at, i)) - c(0))
                    end if
                end if
                if (iand(need, need_nu) /= 0) terms%nu(it%row) = c(1)
                if (iand(need, need_gamma) /= 0) terms%gamma(it%row) = sum(2) - c(2)
            end associate
        end do
    end subroutine add_rows

    !> A free row keeps the slack zero.
    pure subroutine add_free_row(row, slack, need, terms)
        integer, intent(in) :: row, need
        type(pose_type), intent(in) :: slack
        type(terms_type), intent(inout) :: terms

        if (iand(need, need_phi) /= 0) terms%phi(row) = slack%r(1, 0)
        if (iand(need, need_jacobian) /= 0) terms%jacobian(row, slack%place_column) = 1.0_wp
        if (iand(need, need_gamma) /= 0) terms%gamma(row) = 0.0_wp
    end subroutine add_free_row

    pure subroutine differentiate(self, first, last, need, context, lambda, derivatives)
        class(coupling_kind_type), intent(inout) :: self
        integer, intent(in) :: first, last, need
        type(context_type), intent(inout) :: context
        real(wp), intent(in) :: lambda(:)
        type(derivatives_type), intent(inout) :: derivatives
        real(wp) :: x(0:2), gradient(n_local, 0:2), second(n_local, n_local)
        integer :: i, k

        do i = first, last
            if (.not. self%numbers(locked, i) > 0.0_wp) cycle
            associate (it => self%list(i))
                do k = 1, it%n
                    associate (coordinate => self%coordinates(it%before + k))
                        call differentiate_coordinate(coordinate, context%pose, 2, 2, x, gradient, second)
                        call add_holonomic(need, it%row, columns(context%pose(coordinate%first), &
                            context%pose(coordinate%second)), it%factors(k), gradient, second, lambda(it%row), derivatives)
                    end associate
                end do
            end associate
        end do
    end subroutine differentiate

    !> Lock a coupling at its current value, or free it.
    pure subroutine lock(self, number, locks, context)
        class(coupling_kind_type), intent(inout) :: self
        integer, intent(in) :: number
        logical, intent(in) :: locks
        type(context_type), intent(in) :: context
        real(wp) :: x, counted, value
        type(turns_type) :: turns
        integer :: k

        self%numbers(locked, number) = merge(1.0_wp, 0.0_wp, locks)
        if (.not. locks) return
        associate (it => self%list(number))
            value = 0.0_wp
            if (it%motion > 0) value = -context%f(0, it%motion)
            do k = 1, it%n
                call measure_apart(self%coordinates(it%before + k), context%pose, x, counted)
                value = value + it%factors(k)*x
                call add_turns(turns, it%factors(k), counted)
            end do
        end associate
        self%numbers(at, number) = value + angle_of(turns)
    end subroutine lock
end module tandem_mechanism_elements_coupling

!> Builder procedures for couplings.
submodule(tandem_mechanism_builder) tandem_mechanism_elements_coupling_builder
    use tandem_error, only: to_text
    use tandem_mechanism_coordinate, only: is_displacement, slide_coordinate
    use tandem_mechanism_elements_coupling, only: coupling_kind_type, coupling_type, max_coupled
    use tandem_mechanism_refusal, only: refuse
    use tandem_mechanism_sensor, only: of_kind
    use, intrinsic :: ieee_arithmetic, only: ieee_is_finite
    implicit none (type, external)

contains

    module procedure add_coupling
        type(coupling_type) :: coupling
        type(coordinate_type), allocatable :: coordinates(:)
        character(len=:), allocatable :: label, unit
        integer :: i, k, numbers(max_coupled), slide
        logical :: is_locked

        label = 'coupling '//trim(name)
        call self%check_name(name, label, error)
        if (allocated(error)) return
        if (size(joints) < 1 .or. size(joints) > max_coupled - 1 .or. size(factors) /= size(joints)) then
            call refuse(label//' has '//to_text(size(joints))//' joints and '//to_text(size(factors))//' factors', &
                'give 1 to '//to_text(max_coupled - 1)//' of each', error)
            return
        else if (.not. all(abs(factors) > 0.0_wp .and. ieee_is_finite(factors))) then
            call refuse(label//' has a factor that is zero or not finite', 'correct it, or remove the joint', error)
            return
        end if
        do i = 1, size(joints)
            call self%find_coordinate(label, joints(i), numbers(i), error)
            if (allocated(error)) return
        end do
        if (present(inertia)) then
            if (present(motion) .or. present(locked) .or. .not. (inertia >= 0.0_wp .and. ieee_is_finite(inertia))) then
                call refuse(label//' has an inertia that is negative, or with motion or locked', &
                    'give an inertia >= 0 in kg m^2 or kg, and neither motion nor locked', error)
                return
            end if
        end if
        if (present(motion)) call self%take_motion(name, motion, 1, coupling%motion)
        coupling%n = size(joints)
        coupling%factors(:coupling%n) = factors
        coordinates = self%at%coordinates(numbers(:size(joints)))
        is_locked = .true.
        if (present(locked)) then
            coupling%can_be_freed = .true.
            is_locked = locked
            call self%take_slide(name, '1', 1.0_wp, slide)
            coordinates = [coordinates, slide_coordinate(slide)]
        end if
        if (present(inertia)) then
            unit = trim(merge('m  ', 'rad', coordinates(1)%kind == is_displacement))
            call self%take_slide(name, unit, inertia, slide, coupling%displacement)
            coordinates = [coordinates, slide_coordinate(slide)]
            coupling%n = coupling%n + 1
            coupling%factors(coupling%n) = -1.0_wp
        end if
        call self%held%add(name, trim(merge('N  ', 'N m', coordinates(1)%kind == is_displacement)))
        coupling%row = self%held%n
        k = self%kind_number('coupling')
        select type (couplings => self%kinds(k)%of)
        type is (coupling_kind_type)
            call couplings%append(coupling, coordinates, is_locked)
            call self%keep_name(name, of_kind + k, couplings%n)
        end select
    end procedure add_coupling

    module procedure add_sum
        type(coupling_type) :: coupling

        call self%held%add(name, unit)
        coupling%row = self%held%n
        coupling%n = size(factors)
        coupling%factors(:coupling%n) = factors
        coupling%motion = motion
        coupling%drops_turns = drops_turns
        select type (couplings => self%kinds(self%kind_number('coupling'))%of)
        type is (coupling_kind_type)
            call couplings%append(coupling, coordinates, .true.)
        end select
    end procedure add_sum
end submodule tandem_mechanism_elements_coupling_builder
