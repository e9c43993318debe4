! SPDX-License-Identifier: MIT
!> Bushings, forces along six coordinates between two frames: f = K x + C xd for displacements and small angles.
module tandem_mechanism_elements_bushing
    use tandem_error, only: error_type
    use tandem_kinds, only: wp
    use tandem_mechanism_builder, only: builder_type
    use tandem_mechanism_context, only: context_type
    use tandem_mechanism_coordinate, only: coordinate_type, differentiate_coordinate, is_rotation, measure_coordinate => measure, &
        subtract_force
    use tandem_mechanism_described_points, only: take_points
    use tandem_mechanism_element_keys, only: key_length
    use tandem_mechanism_element_kind, only: attachment_type, element_kind_type, most_measured, word_length
    use tandem_mechanism_key_reader, only: anything, reader_type
    use tandem_mechanism_pair, only: add_block, add_outer, columns, n_local, place_1, place_2, turn_1, turn_2
    use tandem_mechanism_pose, only: turned
    use tandem_mechanism_reaction, only: wrench_of
    use tandem_mechanism_sensor, only: add_quantity, sensor_type
    use tandem_model, only: model_type, quantity_type
    use tandem_model_derivatives, only: derivatives_type, need_dynamics_q, need_dynamics_qd
    implicit none (type, external)
    private

    public :: bushing_kind_type, bushing_type

    !> Forces along the displacements and small angles x between two frames that coincide in the reference configuration: three
    !> displacements and three angles in space, two displacements and one angle in the plane.
    type :: bushing_type
        integer :: n = 0
        type(coordinate_type) :: coordinates(6)
        !> K (N/m, N, N m/rad) and C (N s/m, N s, N m s/rad).
        real(wp) :: stiffness(6, 6) = 0.0_wp, damping(6, 6) = 0.0_wp
    end type bushing_type

    !> All bushings.
    type, extends(element_kind_type) :: bushing_kind_type
        type(bushing_type), allocatable, private :: list(:)
    contains
        procedure, nopass :: label, read => read_bushing
        procedure :: append, attachment, add_forces, add_energy, differentiate, list_quantities, measure
    end type bushing_kind_type

contains

    pure function label()
        character(len=word_length) :: label

        label = 'bushing'
    end function label

    subroutine read_bushing(reader, mechanism, n_points)
        type(reader_type), intent(inout) :: reader
        class(model_type), intent(inout) :: mechanism
        integer, intent(inout) :: n_points
        character(len=:), allocatable :: name
        character(len=key_length) :: points(2)
        real(wp), allocatable :: matrix(:), rates(:), at(:), axis(:), across(:)
        type(error_type), allocatable :: error
        integer :: n

        select type (mechanism)
        class is (builder_type)
            name = reader%name
            call take_points(reader, 'between', mechanism, n_points, points, 'two bodies, or points of them', .true.)
            n = merge(3, 6, mechanism%planar)
            call reader%get_numbers('stiffness', [n, n*n], matrix, anything, 'N/m, N m/rad', &
                'along and about the axes of its frame, or the matrix, by its rows', row_length=n)
            call reader%get_numbers('damping', [n, n*n], rates, anything, 'N s/m, N m s/rad', 'damping, in the same form', &
                row_length=n)
            call reader%get_numbers('at', [merge(2, 3, mechanism%planar)], at, anything, 'm', &
                'position in the reference configuration')
            call reader%get_numbers('axis', [merge(2, 3, mechanism%planar)], axis, anything, '', &
                'z axis of its frame; in the plane the x axis')
            if (.not. mechanism%planar) call reader%get_numbers('across', [3], across, anything, '', &
                'direction nearest to the x axis')
            call reader%close_table()
            if (reader%failed()) return
            call mechanism%add_bushing(name, trim(points(1)), trim(points(2)), error, matrix, rates, at, axis, across)
        end select
        call reader%blame(error)
    end subroutine read_bushing

    !> Append a bushing.
    pure subroutine append(self, bushing)
        class(bushing_kind_type), intent(inout) :: self
        type(bushing_type), intent(in) :: bushing

        call self%add()
        if (.not. allocated(self%list)) allocate (self%list(1))
        if (self%n > size(self%list)) self%list = [self%list, self%list]
        self%list(self%n) = bushing
    end subroutine append

    pure function attachment(self, number)
        class(bushing_kind_type), intent(in) :: self
        integer, intent(in) :: number
        type(attachment_type) :: attachment
        integer :: i, k

        associate (it => self%list(number)%coordinates(1))
            attachment%body = [it%first, it%second]
            attachment%point(:, 2) = it%one%b
            attachment%is_drawn(2) = .true.
        end associate
        do k = 1, self%list(number)%n
            i = merge(2, 1, is_rotation(self%list(number)%coordinates(k)))
            attachment%stiffness(i) = max(attachment%stiffness(i), self%list(number)%stiffness(k, k))
        end do
    end function attachment

    !> force := force - sum over i of f_i x_i,q for every bushing.
    pure subroutine add_forces(self, context, force, stat)
        class(bushing_kind_type), intent(inout) :: self
        type(context_type), intent(inout) :: context
        real(wp), intent(inout) :: force(:)
        integer, intent(inout) :: stat
        real(wp) :: x(0:2, 6), gradient(n_local, 0:2, 6), f
        integer :: i, k

        if (context%only_rates) return
        do i = 1, self%n
            associate (it => self%list(i), n => self%list(i)%n)
                do k = 1, n
                    call differentiate_coordinate(it%coordinates(k), context%pose, 1, 0, x(:, k), gradient(:, :, k))
                end do
                do k = 1, n
                    f = dot_product(it%stiffness(k, :n), x(0, :n)) + dot_product(it%damping(k, :n), x(1, :n))
                    call subtract_force(it%coordinates(k), context%pose, f, gradient(:, 0, k), force)
                end do
            end associate
        end do
    end subroutine add_forces

    !> Energy x'K x/2.
    pure subroutine add_energy(self, context, energy)
        class(bushing_kind_type), intent(inout) :: self
        type(context_type), intent(in) :: context
        real(wp), intent(inout) :: energy
        real(wp) :: x(6)
        integer :: i, k

        do i = 1, self%n
            x = 0.0_wp
            do k = 1, self%list(i)%n
                call measure_coordinate(self%list(i)%coordinates(k), context%pose, x(k))
            end do
            energy = energy + dot_product(x, matmul(self%list(i)%stiffness, x))/2
        end do
    end subroutine add_energy

    pure subroutine differentiate(self, first, last, need, context, lambda, derivatives)
        class(bushing_kind_type), intent(inout) :: self
        integer, intent(in) :: first, last, need
        type(context_type), intent(inout) :: context
        real(wp), intent(in) :: lambda(:)
        type(derivatives_type), intent(inout) :: derivatives
        real(wp) :: x(0:2, 6), gradient(n_local, 0:2, 6), second(n_local, n_local, 6), by_q(n_local, n_local), &
            by_qd(n_local, n_local), f
        integer :: i, j, k, c(n_local), column(n_local)

        do i = first, last
            associate (it => self%list(i), n => self%list(i)%n)
                do k = 1, n
                    call differentiate_coordinate(it%coordinates(k), context%pose, 1, 1, x(:, k), gradient(:, :, k), &
                        second(:, :, k))
                end do
                by_q = 0.0_wp
                by_qd = 0.0_wp
                do k = 1, n
                    f = dot_product(it%stiffness(k, :n), x(0, :n)) + dot_product(it%damping(k, :n), x(1, :n))
                    by_q = by_q + f*second(:, :, k)
                    do j = 1, n
                        call add_outer(it%stiffness(k, j), gradient(:, 0, k), gradient(:, 0, j), by_q)
                        call add_outer(it%damping(k, j), gradient(:, 0, k), gradient(:, 1, j), by_q)
                        call add_outer(it%damping(k, j), gradient(:, 0, k), gradient(:, 0, j), by_qd)
                    end do
                end do
                c = columns(context%pose(it%coordinates(1)%first), context%pose(it%coordinates(1)%second))
                column = derivatives%column_of(c)
                if (iand(need, need_dynamics_q) /= 0) call add_block(c, column, 1.0_wp, by_q, derivatives%dynamics_q)
                if (iand(need, need_dynamics_qd) /= 0) call add_block(c, column, 1.0_wp, by_qd, derivatives%dynamics_qd)
            end associate
        end do
    end subroutine differentiate

    subroutine list_quantities(self, sensor, list)
        class(bushing_kind_type), intent(in) :: self
        type(sensor_type), intent(in) :: sensor
        type(quantity_type), allocatable, intent(inout) :: list(:)

        call add_quantity(sensor, list, 3, 'force', 'N', 'force on the second body, or on the loaded body, in world axes')
        call add_quantity(sensor, list, 3, 'torque', 'N m', 'torque about the point of application, in world axes')
        call add_quantity(sensor, list, 0, 'energy', 'J', 'potential energy')
        call add_quantity(sensor, list, 0, 'power', 'W', 'power of its dampers, laws and functions of time')
    end subroutine list_quantities

    !> Forces of a bushing, which act on the second body at its point.
    pure subroutine measure(self, number, context, lambda, values, power)
        class(bushing_kind_type), intent(inout) :: self
        integer, intent(in) :: number
        type(context_type), intent(inout) :: context
        real(wp), intent(in) :: lambda(:)
        real(wp), intent(out) :: values(most_measured), power
        real(wp) :: x(0:2, 6), gradient(n_local, 0:2, 6), along(3), turning(4), force(3), torque(3), energy, f
        integer :: k, n

        associate (it => self%list(number))
            n = it%n
            do k = 1, n
                call differentiate_coordinate(it%coordinates(k), context%pose, 1, 0, x(:, k), gradient(:, :, k))
            end do
            energy = 0.0_wp
            power = 0.0_wp
            along = 0.0_wp
            turning = 0.0_wp
            do k = 1, n
                f = dot_product(it%damping(k, :n), x(1, :n))
                power = power - f*x(1, k)
                energy = energy + x(0, k)*dot_product(it%stiffness(k, :n), x(0, :n))/2
                f = f + dot_product(it%stiffness(k, :n), x(0, :n))
                along = along - f*gradient(place_2 + 1:place_2 + 3, 0, k)
                turning = turning - f*gradient(turn_2 + 1:turn_2 + 4, 0, k)
            end do
            associate (one => context%pose(it%coordinates(1)%first), two => context%pose(it%coordinates(1)%second))
                if (two%n_place > 0) then
                    call wrench_of(two, along, turning, two%r(:, 0) + turned(two, 0, it%coordinates(1)%one%b), force, torque)
                else
                    ! The ground: take the opposite of the force on the first body.
                    along = 0.0_wp
                    turning = 0.0_wp
                    do k = 1, n
                        f = dot_product(it%stiffness(k, :n), x(0, :n)) + dot_product(it%damping(k, :n), x(1, :n))
                        along = along + f*gradient(place_1 + 1:place_1 + 3, 0, k)
                        turning = turning + f*gradient(turn_1 + 1:turn_1 + 4, 0, k)
                    end do
                    call wrench_of(one, along, turning, two%r(:, 0) + turned(two, 0, it%coordinates(1)%one%b), force, torque)
                end if
            end associate
            values = [force, torque, energy, power]
        end associate
    end subroutine measure
end module tandem_mechanism_elements_bushing

!> Builder procedure for bushings.
submodule(tandem_mechanism_builder) tandem_mechanism_elements_bushing_builder
    use tandem_error, only: to_text
    use tandem_mechanism_coordinate, only: is_angle, is_displacement, is_tilt
    use tandem_mechanism_elements_bushing, only: bushing_kind_type, bushing_type
    use tandem_mechanism_joint, only: find_kind
    use tandem_mechanism_refusal, only: refuse
    use tandem_mechanism_sensor, only: of_kind
    use, intrinsic :: ieee_arithmetic, only: ieee_is_finite
    implicit none (type, external)

contains

    module procedure add_bushing
        type(bushing_type) :: bushing
        type(placed_joint_type) :: joint
        character(len=:), allocatable :: label
        integer :: k, l, m

        label = 'bushing '//trim(name)
        call self%check_name(name, label, error)
        if (allocated(error)) return
        ! Locate the bushing like a joint without rows.
        joint%kind = find_kind('fixed', self%planar)
        ! Points that are apart load it.
        joint%may_be_open = .true.
        call self%place_joint(label, joint, first, second, error, at, axis, across)
        if (.not. allocated(error) .and. joint%first > 0) call self%need_turning_body(label, joint%first, error)
        if (.not. allocated(error) .and. joint%second > 0) call self%need_turning_body(label, joint%second, error)
        if (.not. allocated(error) .and. present(stiffness)) call take_matrix('stiffness', stiffness, bushing%stiffness)
        if (.not. allocated(error) .and. present(damping)) call take_matrix('damping', damping, bushing%damping)
        if (allocated(error)) return
        bushing%n = merge(3, 6, self%planar)
        bushing%coordinates%first = joint%first
        bushing%coordinates%second = joint%second
        do k = 1, merge(2, 3, self%planar)
            associate (way => bushing%coordinates(k))
                way%kind = is_displacement
                way%one = perpendicular_type(first=joint%first, second=joint%second, is_point=.true., a=joint%axes1(:, k), &
                    b=joint%s2)
                way%offset = dot_product(joint%axes1(:, k), joint%s1)
            end associate
        end do
        if (self%planar) then
            bushing%coordinates(3)%kind = is_angle
            bushing%coordinates(3)%offset = self%angle_of(joint%second) - self%angle_of(joint%first)
        else
            do k = 1, 3
                l = mod(k, 3) + 1
                m = mod(l, 3) + 1
                associate (turn => bushing%coordinates(3 + k))
                    ! About k: m1.l2 = sin, l1.m2 = -sin.
                    turn%kind = is_tilt
                    turn%one = perpendicular_type(first=joint%first, second=joint%second, a=joint%axes1(:, m), b=joint%axes2(:, l))
                    turn%other = perpendicular_type(first=joint%first, second=joint%second, a=joint%axes1(:, l), &
                        b=joint%axes2(:, m))
                end associate
            end do
        end if
        k = self%kind_number('bushing')
        select type (bushings => self%kinds(k)%of)
        type is (bushing_kind_type)
            call bushings%append(bushing)
            call self%keep_name(name, of_kind + k, bushings%n)
        end select

    contains

        !> Read a diagonal or a symmetric matrix.
        subroutine take_matrix(what, given, matrix)
            character(len=*), intent(in) :: what
            real(wp), intent(in) :: given(:)
            real(wp), intent(inout) :: matrix(6, 6)
            integer :: n, i

            n = merge(3, 6, self%planar)
            if (all(size(given) /= [n, n*n]) .or. .not. all(ieee_is_finite(given))) then
                call refuse(label//': '//what//' has '//to_text(size(given))//' entries, or one that is not finite', &
                    'give '//to_text(n)//', or a symmetric matrix of '//to_text(n*n), error)
            else if (size(given) == n) then
                do i = 1, n
                    matrix(i, i) = given(i)
                end do
            else
                matrix(:n, :n) = reshape(given, [n, n])
                if (any(abs(matrix - transpose(matrix)) > tolerance*maxval(abs(matrix)))) call refuse(label//': '//what// &
                    ' is not symmetric', 'make entries i, j and j, i equal', error)
            end if
        end subroutine take_matrix
    end procedure add_bushing
end submodule tandem_mechanism_elements_bushing_builder
