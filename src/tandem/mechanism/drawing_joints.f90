! SPDX-License-Identifier: MIT
!> The words for joints and distances.
submodule(tandem_mechanism_drawing) tandem_mechanism_drawing_joints
    implicit none (type, external)

contains

    !> A joint between two bodies. Where it is in the drawing is said by `at` or by points of the bodies; with one point, the other
    !> side is where that is.
    module procedure add_joint
        type(joint_type) :: joint
        character(len=:), allocatable :: label
        real(wp) :: frame(3, 3), place(3), a1(3, 3), a2(3, 3), r1(3), r2(3), gap(3)
        logical :: points(2), may_be_open
        integer :: i, k

        label = 'joint '//trim(name)
        call self%check_name(name, label, error)
        if (allocated(error)) return
        joint%name = name
        joint%kind = find_kind(kind, self%planar)
        if (joint%kind%name == '') then
            call refuse(label//' has the type '//trim(kind), 'take one of '//trim(kind_names(self%planar)), error)
            return
        end if
        call self%take_pair(label, first, second, joint%first, joint%second, joint%s1, joint%s2, points, error)
        if (allocated(error)) return
        if (present(motion) .and. joint%kind%driven == 0) then
            call refuse(label//' cannot be driven', 'drive a revolute or a prismatic joint', error)
            return
        end if
        if (any(joint%kind%held(merge(3, 4, self%planar):merge(3, 6, self%planar))) .or. &
            (present(motion) .and. joint%kind%name == 'revolute')) then
            do k = 1, 2
                i = merge(joint%first, joint%second, k == 1)
                if (i > 0) call self%need_turning_body(label, i, error)
                if (allocated(error)) return
            end do
        end if
        call self%frame_of(joint%first, r1, a1)
        call self%frame_of(joint%second, r2, a2)
        if (present(at)) then
            call take_vector(self%planar, label, 'at', at, place, error)
            if (allocated(error)) return
            if (.not. points(1)) joint%s1 = matmul(place - r1, a1)
            if (.not. points(2)) joint%s2 = matmul(place - r2, a2)
        else if (points(1) .and. .not. points(2)) then
            joint%s2 = matmul(r1 + matmul(a1, joint%s1) - r2, a2)
        else if (points(2) .and. .not. points(1)) then
            joint%s1 = matmul(r2 + matmul(a2, joint%s2) - r1, a1)
        else if (.not. points(1)) then
            call refuse(label//' has no place', 'say at = ..., or name a point of one of the bodies', error)
            return
        end if
        call take_axes(self, label, joint%kind, axis, across, frame, error)
        if (allocated(error)) return
        joint%axes1 = matmul(transpose(a1), frame)
        joint%axes2 = matmul(transpose(a2), frame)
        gap = matmul(r2 + matmul(a2, joint%s2) - r1 - matmul(a1, joint%s1), frame)
        may_be_open = .false.
        if (present(open)) may_be_open = open
        do k = 1, merge(2, 3, self%planar)
            if (.not. joint%kind%held(k)) gap(k) = 0.0_wp
        end do
        if (norm2(gap) > tolerance*(1 + norm2(r1) + norm2(r2)) .and. .not. may_be_open) then
            call refuse(label//': its two sides are '//to_text(norm2(gap))//' m apart in the drawing', &
                'move a body or a point, or say that it is open and let the start be assembled', error)
            return
        end if
        call add_joint_rows(self, joint, motion)
        self%joints = [self%joints, joint]
        call self%keep_name(name)
    end procedure add_joint

    !> The joint's frame in the world, axes in columns.
    subroutine take_axes(self, label, kind, axis, across, frame, error)
        class(drawing_type), intent(in) :: self
        character(len=*), intent(in) :: label
        type(kind_type), intent(in) :: kind
        real(wp), intent(in), optional :: axis(:), across(:)
        real(wp), intent(out) :: frame(3, 3)
        type(error_type), allocatable, intent(inout) :: error
        real(wp), parameter :: z(3) = [0.0_wp, 0.0_wp, 1.0_wp]
        real(wp) :: a(3), b(3)

        a = merge([1.0_wp, 0.0_wp, 0.0_wp], z, self%planar)
        b = 0.0_wp
        if (present(axis)) call self%take_direction(label, 'axis', axis, a, error)
        if (present(across) .and. .not. allocated(error)) call self%take_direction(label, 'across', across, b, error)
        if (allocated(error)) return
        if (kind%has_axis .and. .not. present(axis)) then
            call refuse(label//' has no axis', 'say axis = ...', error)
            return
        end if
        if (present(across) .and. norm2(cross(a, b)) < 1.0e-6_wp) then
            call refuse(label//': across is parallel to the axis', 'take another direction', error)
            return
        end if
        if (self%planar) then
            frame = reshape([a, cross(z, a), z], [3, 3])
        else if (kind%name == 'universal') then
            if (.not. present(across) .or. abs(dot_product(a, b)) > tolerance) then
                call refuse(label//' has axes that are not perpendicular: their cosine is '//to_text(dot_product(a, b)), &
                    'give axis on the first body and across on the second, at 90 degrees in the drawing', error)
                return
            end if
            frame = reshape([a, b, cross(a, b)], [3, 3])
        else if (present(across)) then
            frame = frame_along(a, b)
        else
            frame = frame_along(a)
        end if
    end subroutine take_axes

    !> The rows of a joint.
    subroutine add_joint_rows(self, joint, motion)
        class(drawing_type), intent(inout) :: self
        type(joint_type), intent(inout) :: joint
        class(function_type), intent(in), optional :: motion
        character(len=1), parameter :: letter(3) = ['x', 'y', 'z']
        integer :: k, l, m, n, driven, number, before
        logical :: turn(3)

        before = size(self%held_name)
        n = merge(2, 3, self%planar)
        driven = 0
        number = 0
        if (present(motion)) then
            driven = joint%kind%driven
            call self%take_motion(motion, number)
        end if
        if (all(joint%kind%held(:n))) then
            self%meetings = [self%meetings, span_type(first=joint%first, second=joint%second, row=before + 1, &
                s1=joint%s1, s2=joint%s2)]
            do k = 1, n
                call self%new_row(trim(joint%name)//' '//letter(k), 'N')
            end do
        else
            do k = 1, n
                if (.not. joint%kind%held(k) .and. driven /= k) cycle
                call self%new_row(trim(joint%name)//merge(' motion', ' '//letter(k)//'     ', driven == k), 'N')
                self%dots = [self%dots, dot_type(first=joint%first, second=joint%second, row=size(self%held_name), &
                    is_point=.true., a=joint%axes1(:, k), b=joint%s2, c=dot_product(joint%axes1(:, k), joint%s1), &
                    motion=merge(number, 0, driven == k))]
            end do
        end if
        if (self%planar) then
            if (joint%kind%held(3) .or. driven == 3) then
                call self%new_row(trim(joint%name)//merge(' motion', ' angle ', driven == 3), 'N m')
                self%angles = [self%angles, angle_type(joint%first, joint%second, size(self%held_name), &
                    self%angle_of(joint%second) - self%angle_of(joint%first), merge(number, 0, driven == 3))]
            end if
        else
            turn = joint%kind%held(4:6)
            do k = 1, 3
                ! In a cycle k, l, m.
                l = mod(k, 3) + 1
                m = mod(l, 3) + 1
                if (count(turn) == 2 .and. .not. turn(k)) then
                    ! k is common: l1.k2 = 0 is the turn about m, m1.k2 = 0 that about l.
                    call add_direction(l, k, m)
                    call add_direction(m, k, l)
                    if (driven == k + 3) then
                        call self%new_row(trim(joint%name)//' motion', 'N m')
                        self%dots = [self%dots, dot_type(first=joint%first, second=joint%second, row=size(self%held_name), &
                            a=joint%axes1(:, m), b=joint%axes2(:, l), motion=number, is_turning=.true., &
                            across=joint%axes1(:, l))]
                    end if
                else if (count(turn) /= 2 .and. turn(k)) then
                    call add_direction(l, m, k)
                end if
            end do
        end if
        joint%row = before + 1
        joint%n_rows = size(self%held_name) - before

    contains

        !> a1.b2 = 0.
        subroutine add_direction(a, b, about)
            integer, intent(in) :: a, b, about

            call self%new_row(trim(joint%name)//' turn '//letter(about), 'N m')
            self%dots = [self%dots, dot_type(first=joint%first, second=joint%second, row=size(self%held_name), &
                a=joint%axes1(:, a), b=joint%axes2(:, b))]
        end subroutine add_direction
    end subroutine add_joint_rows

    !> A distance between two points that is held, by default that of the drawing, or imposed.
    module procedure add_distance
        type(span_type) :: span
        character(len=:), allocatable :: label
        real(wp) :: drawn, f(0:2)
        logical :: points(2)

        label = 'distance '//trim(name)
        call self%check_name(name, label, error)
        if (allocated(error)) return
        call self%take_pair(label, first, second, span%first, span%second, span%s1, span%s2, points, error)
        if (allocated(error)) return
        drawn = self%drawn_length(span)
        span%length = drawn
        if (present(length)) span%length = length
        if (present(motion)) then
            call self%take_motion(motion, span%motion)
            call motion%evaluate(0.0_wp, f)
            span%length = f(0)
        end if
        if (.not. span%length > 0.0_wp) then
            call refuse(label//' has the length '//to_text(span%length), &
                'give one > 0; for points that coincide take a spherical or revolute joint', error)
            return
        end if
        span%weight = span%length
        span%row = size(self%held_name) + 1
        call self%new_row(name, 'N')
        self%distances = [self%distances, span]
        call self%keep_name(name)
    end procedure add_distance
end submodule tandem_mechanism_drawing_joints
