! SPDX-License-Identifier: MIT
!> Pins, coincident points in the plane,
!>     Phi = r2 + A2 s2' - r1 - A1 s1',
!> by the arms A s' of the points, and the angles of bodies in the plane with their cosines and sines, `lane` at a time.
module tandem_mechanism_pin
    use tandem_kinds, only: lane, wp
    use tandem_mechanism_pose, only: pose_type
    use tandem_mechanism_point_vector, only: point_vector_type
    use tandem_model_pattern, only: pattern_type
    use tandem_model_terms, only: need_gamma, need_jacobian, need_phi, terms_type
    use tandem_rigid_angle_lanes, only: set_cosines_and_sines
    implicit none (type, external)
    private

    public :: pin_type, angles_type, gather_pins, place_pins, find_pin_blocks, evaluate_pins

    !> Bodies with a rotation in the plane.
    type :: angles_type
        !> Number of bodies, and their indices.
        integer :: n = 0
        integer, allocatable :: body(:)
        !> Coordinate that is the angle of each body; the last one is repeated up to a multiple of `lane`.
        integer, allocatable :: coordinate(:)
        !> Angle at the last point, cosine and sine; index 0 is for sides without a rotation.
        real(wp), allocatable :: angle(:), c(:), s(:)
    contains
        procedure :: gather => gather_angles, set => set_angles
    end type angles_type

    !> A pin of two bodies in the plane: coincident points, two rows.
    type :: pin_type
        !> First row; true for each side that is a body, not the ground; index of its angle, 0 for a side without a rotation; offset
        !> of its coordinates, and offset of its columns in the stored C.
        integer :: row = 0
        logical :: is_body(2) = .false.
        integer :: angle(2) = 0, before(2) = 0, column(2) = 0
        !> True if a chart uses the rows as blocks; offset of the block of each body.
        logical :: has_blocks = .false.
        integer :: block(2) = -1
        !> Bodies, 0 for the ground.
        integer :: body(2) = 0
        !> -s1' and s2'.
        real(wp) :: arm(2, 2) = 0.0_wp
    end type pin_type

contains

    !> List the bodies with a rotation in the plane.
    pure subroutine gather_angles(self, pose)
        class(angles_type), intent(inout) :: self
        type(pose_type), intent(in) :: pose(0:)
        integer :: i, n

        self%body = pack([(i, i=1, ubound(pose, 1))], pose(1:)%n_turn == 1)
        self%n = size(self%body)
        n = lane*((self%n + lane - 1)/lane)
        self%coordinate = [(pose(self%body(min(i, self%n)))%turn, i=1, n)]
        if (allocated(self%angle)) deallocate (self%angle, self%c, self%s)
        allocate (self%angle(0:n), self%s(0:n), source=0.0_wp)
        allocate (self%c(0:n), source=1.0_wp)
    end subroutine gather_angles

    !> Set the angles at q. They are kept from the last point, because several sets of terms are evaluated at one point.
    pure subroutine set_angles(self, n, q)
        class(angles_type), intent(inout) :: self
        integer, intent(in) :: n
        real(wp), intent(in) :: q(n)
        real(wp) :: x(lane)
        integer :: b, l
        logical :: is_known

        do b = 0, size(self%coordinate) - lane, lane
            is_known = .true.
            do l = 1, lane
                x(l) = q(self%coordinate(b + l))
                is_known = is_known .and. x(l) <= self%angle(b + l) .and. x(l) >= self%angle(b + l)
            end do
            if (is_known) cycle
            self%angle(b + 1:b + lane) = x
            call set_cosines_and_sines(x, self%c(b + 1:b + lane), self%s(b + 1:b + lane))
        end do
    end subroutine set_angles

    !> Collect the pins of a mechanism in the plane.
    pure subroutine gather_pins(coincidences, pose, angles, pins)
        type(point_vector_type), intent(in) :: coincidences(:)
        !> Poses of the bodies, whose coordinates are numbered; 0 is the ground.
        type(pose_type), intent(in) :: pose(0:)
        type(angles_type), intent(in) :: angles
        type(pin_type), allocatable, intent(out) :: pins(:)
        integer :: number(0:ubound(pose, 1)), i

        number = 0
        do i = 1, angles%n
            number(angles%body(i)) = i
        end do
        allocate (pins(size(coincidences)))
        do i = 1, size(coincidences)
            associate (vector => coincidences(i), pin => pins(i))
                pin%row = vector%row
                pin%body = [vector%first, vector%second]
                pin%is_body = pin%body > 0
                pin%angle = [number(vector%first), number(vector%second)]
                pin%before = [pose(vector%first)%place, pose(vector%second)%place] - 1
                pin%arm(:, 1) = -vector%s1(:2)
                pin%arm(:, 2) = vector%s2(:2)
            end associate
        end do
    end subroutine gather_pins

    !> Copy the columns of C from the poses.
    pure subroutine place_pins(pose, pins)
        type(pose_type), intent(in) :: pose(0:)
        type(pin_type), intent(inout) :: pins(:)
        integer :: i, side

        do i = 1, size(pins)
            do side = 1, 2
                pins(i)%column(side) = pose(pins(i)%body(side))%place_column - 1
            end do
        end do
    end subroutine place_pins

    !> Store the offsets of the blocks that a chart uses, and mark the rows that are set there: those of bodies with a rotation.
    pure subroutine find_pin_blocks(pattern, pins)
        type(pattern_type), intent(inout) :: pattern
        type(pin_type), intent(inout) :: pins(:)
        integer :: i, side

        do i = 1, size(pins)
            associate (pin => pins(i))
                do side = 1, 2
                    pin%block(side) = pattern%block_of(pin%row, 2, pin%body(side))
                end do
                pin%has_blocks = all(pin%body == 0 .or. (pin%block >= 0 .and. pin%angle > 0))
                if (pin%has_blocks) pattern%in_blocks(pin%row) = .true.
            end associate
        end do
    end subroutine find_pin_blocks

    !> Add the terms of every pin. Entries of C that are not set here stay zero, as allocated.
    pure subroutine evaluate_pins(pins, need, angles, n, q, qd, terms)
        type(pin_type), intent(in) :: pins(:)
        integer, intent(in) :: need, n
        !> Angles at q.
        type(angles_type), intent(in) :: angles
        !> (n) each; qd is not used unless gamma is needed.
        real(wp), intent(in) :: q(n), qd(n)
        type(terms_type), intent(inout) :: terms

        if (iand(need, need_phi) /= 0) call set_phi(size(pins), pins, size(angles%c), angles%c, angles%s, n, q, &
            size(terms%phi), terms%phi)
        if (iand(need, need_jacobian) /= 0) then
            if (allocated(terms%blocks)) call set_blocks(size(pins), pins, size(angles%c), angles%c, angles%s, &
                size(terms%blocks), terms%blocks)
            call set_rows(size(pins), pins, allocated(terms%blocks), size(angles%c), angles%c, angles%s, &
                size(terms%jacobian, 1), size(terms%jacobian, 2), terms%jacobian)
        end if
        if (iand(need, need_gamma) /= 0) call set_gamma(size(pins), pins, size(angles%c), angles%c, angles%s, n, qd, &
            size(terms%gamma), terms%gamma)
    end subroutine evaluate_pins

    pure subroutine set_phi(n_pins, pins, n_angles, c, s, n, q, m, phi)
        integer, intent(in) :: n_pins, n_angles, n, m
        type(pin_type), intent(in) :: pins(n_pins)
        real(wp), intent(in) :: c(0:n_angles - 1), s(0:n_angles - 1), q(n)
        real(wp), intent(inout) :: phi(m)
        real(wp) :: x, y
        integer :: i

        do i = 1, n_pins
            associate (pin => pins(i), one => pins(i)%angle(1), two => pins(i)%angle(2))
                x = (c(one)*pin%arm(1, 1) - s(one)*pin%arm(2, 1)) + (c(two)*pin%arm(1, 2) - s(two)*pin%arm(2, 2))
                y = (s(one)*pin%arm(1, 1) + c(one)*pin%arm(2, 1)) + (s(two)*pin%arm(1, 2) + c(two)*pin%arm(2, 2))
                if (pin%is_body(1)) then
                    x = x - q(pin%before(1) + 1)
                    y = y - q(pin%before(1) + 2)
                end if
                if (pin%is_body(2)) then
                    x = x + q(pin%before(2) + 1)
                    y = y + q(pin%before(2) + 2)
                end if
                phi(pin%row) = x
                phi(pin%row + 1) = y
            end associate
        end do
    end subroutine set_phi

    !> Set the two rows of C of the pins with blocks of a chart, in which the columns of positions are constant.
    pure subroutine set_blocks(n_pins, pins, n_angles, c, s, n_entries, blocks)
        integer, intent(in) :: n_pins, n_angles, n_entries
        type(pin_type), intent(in) :: pins(n_pins)
        real(wp), intent(in) :: c(0:n_angles - 1), s(0:n_angles - 1)
        real(wp), intent(inout) :: blocks(n_entries)
        integer :: i, side

        do i = 1, n_pins
            if (.not. pins(i)%has_blocks) cycle
            do side = 1, 2
                if (.not. pins(i)%is_body(side)) cycle
                associate (at => pins(i)%block(side), arm => pins(i)%arm, angle => pins(i)%angle(side))
                    blocks(at + 5) = -(s(angle)*arm(1, side) + c(angle)*arm(2, side))
                    blocks(at + 6) = c(angle)*arm(1, side) - s(angle)*arm(2, side)
                end associate
            end do
        end do
    end subroutine set_blocks

    !> Set the two rows of C of the other pins.
    pure subroutine set_rows(n_pins, pins, with_blocks, n_angles, c, s, m, width, jacobian)
        integer, intent(in) :: n_pins, n_angles
        type(pin_type), intent(in) :: pins(n_pins)
        !> True if pins with blocks are skipped, because their blocks are set.
        logical, intent(in) :: with_blocks
        real(wp), intent(in) :: c(0:n_angles - 1), s(0:n_angles - 1)
        !> Shape of the stored C, which may be compressed.
        integer, intent(in) :: m, width
        real(wp), intent(inout) :: jacobian(m, width)
        integer :: i, side

        do i = 1, n_pins
            if (with_blocks .and. pins(i)%has_blocks) cycle
            do side = 1, 2
                if (.not. pins(i)%is_body(side)) cycle
                associate (row => pins(i)%row, column => pins(i)%column(side), arm => pins(i)%arm, angle => pins(i)%angle(side))
                    jacobian(row, column + 1) = 2.0_wp*side - 3.0_wp
                    jacobian(row + 1, column + 2) = 2.0_wp*side - 3.0_wp
                    if (angle == 0) cycle
                    jacobian(row, column + 3) = -(s(angle)*arm(1, side) + c(angle)*arm(2, side))
                    jacobian(row + 1, column + 3) = c(angle)*arm(1, side) - s(angle)*arm(2, side)
                end associate
            end do
        end do
    end subroutine set_rows

    !> Second derivatives of Phi along the motion for qdd = 0.
    pure subroutine set_gamma(n_pins, pins, n_angles, c, s, n, qd, m, gamma)
        integer, intent(in) :: n_pins, n_angles, n, m
        type(pin_type), intent(in) :: pins(n_pins)
        real(wp), intent(in) :: c(0:n_angles - 1), s(0:n_angles - 1), qd(n)
        real(wp), intent(inout) :: gamma(m)
        real(wp) :: square
        integer :: i, side

        do i = 1, n_pins
            associate (pin => pins(i), row => pins(i)%row)
                gamma(row) = 0.0_wp
                gamma(row + 1) = 0.0_wp
                do side = 1, 2
                    associate (angle => pin%angle(side))
                        if (angle == 0) cycle
                        square = qd(pin%before(side) + 3)**2
                        gamma(row) = gamma(row) - square*(c(angle)*pin%arm(1, side) - s(angle)*pin%arm(2, side))
                        gamma(row + 1) = gamma(row + 1) - square*(s(angle)*pin%arm(1, side) + c(angle)*pin%arm(2, side))
                    end associate
                end do
            end associate
        end do
    end subroutine set_gamma
end module tandem_mechanism_pin
