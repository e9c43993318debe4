! SPDX-License-Identifier: MIT
!> Builder procedures for knife edges, and for rolling disks and spheres.
submodule(tandem_mechanism_builder) tandem_mechanism_builder_rolling
    use tandem_error, only: to_text
    use tandem_mechanism_pose, only: pose_type
    use tandem_mechanism_refusal, only: refuse, take_vector
    use tandem_mechanism_rolling, only: find_contact
    use tandem_mechanism_sensor, only: of_knife_edge, of_wheel
    use tandem_mechanism_vector, only: cross, frame_along
    implicit none (type, external)

contains

    module procedure add_knife_edge
        type(knife_edge_type) :: edge
        real(wp) :: r(3), a(3, 3), pivot(3)
        character(len=:), allocatable :: label
        logical :: is_point

        label = 'knife edge '//trim(name)
        call self%check_name(name, label, error)
        if (allocated(error)) return
        call self%take_point(label, on, edge%body, edge%point, is_point, error)
        if (.not. allocated(error)) call self%take_direction(label, 'across', across, edge%across, error)
        if (.not. allocated(error)) call self%need_turning_body(label, edge%body, error)
        if (allocated(error)) return
        pivot = [0.0_wp, 0.0_wp, 1.0_wp]
        if (.not. self%planar .and. (present(steer) .neqv. present(about))) then
            call refuse(label//' has only one of steer and its axis', 'give steer and about', error)
        else if (present(about)) then
            call self%take_direction(label, 'about', about, pivot, error)
            if (.not. allocated(error) .and. (self%planar .or. abs(dot_product(pivot, edge%across)) > tolerance)) then
                call refuse(label//': about is not perpendicular to across, or is given in the plane', 'correct it', error)
            end if
        end if
        if (allocated(error)) return
        if (present(steer)) call self%take_motion(name, steer, 0, edge%steer)
        call self%frame_of(edge%body, r, a)
        edge%towards = matmul(cross(pivot, edge%across), a)
        edge%across = matmul(edge%across, a)
        edge%moment = cross(edge%point, edge%across)
        call self%rolling%add(name, 'N')
        edge%row = self%rolling%n
        self%n_of%knife_edges = self%n_of%knife_edges + 1
        if (self%n_of%knife_edges > size(self%knife_edges)) self%knife_edges = [self%knife_edges, self%knife_edges, edge]
        self%knife_edges(self%n_of%knife_edges) = edge
        call self%keep_name(name, of_knife_edge, self%n_of%knife_edges)
    end procedure add_knife_edge

    module procedure add_rolling_disk
        type(roller_type) :: roller
        character(len=:), allocatable :: label

        label = 'rolling disk '//trim(name)
        roller%radius = radius
        if (present(crown)) roller%crown = crown
        if (present(crown)) roller%radius = radius - crown
        call self%take_direction(label, 'axis', axis, roller%axis, error)
        if (.not. allocated(error) .and. (roller%crown < 0.0_wp .or. .not. roller%radius > 0.0_wp)) then
            call refuse(label//' has a radius that is not positive, or a crown that is not between 0 and it', &
                'give a radius > 0 in m, and a smaller crown >= 0', error)
        end if
        if (.not. allocated(error)) call add_roller(self, label, name, centre, roller, error, plane)
    end procedure add_rolling_disk

    module procedure add_rolling_sphere
        type(roller_type) :: roller
        character(len=:), allocatable :: label

        label = 'rolling sphere '//trim(name)
        roller%radius = radius
        if (.not. radius > 0.0_wp) call refuse(label//' has a radius that is not positive', 'give a radius > 0 in m', &
            error)
        if (.not. allocated(error)) call add_roller(self, label, name, centre, roller, error, plane)
    end procedure add_rolling_sphere

    module procedure add_rolling_ellipsoid
        type(roller_type) :: roller
        character(len=:), allocatable :: label

        label = 'rolling ellipsoid '//trim(name)
        roller%is_ellipsoid = .true.
        roller%squares = semi_axes**2
        if (.not. all(semi_axes > 0.0_wp)) call refuse(label//' has a semi-axis that is not positive', 'give three > 0 in m', error)
        if (.not. allocated(error)) call add_roller(self, label, name, centre, roller, error, plane)
    end procedure add_rolling_ellipsoid

    !> Add a rolling body and its plane. The shape is set; its axis is in the world frame.
    subroutine add_roller(self, label, name, centre, roller, error, given_plane)
        class(builder_type), intent(inout) :: self
        character(len=*), intent(in) :: label, name, centre
        type(roller_type), intent(inout) :: roller
        type(error_type), allocatable, intent(out) :: error
        type(plane_type), intent(in), optional :: given_plane
        type(plane_type) :: plane
        type(pose_type) :: pose
        real(wp) :: r(3), a(3, 3), f(3, 3), gap, y(3), level(0:2)
        logical :: is_point
        integer :: k

        call self%check_name(name, label, error)
        if (allocated(error)) return
        if (self%planar) then
            call refuse(label//' is in the plane', 'use it in space', error)
            return
        end if
        if (present(given_plane)) plane = given_plane
        call self%take_point(label, centre, roller%body, roller%centre, is_point, error)
        if (.not. allocated(error)) call self%need_turning_body(label, roller%body, error)
        if (allocated(error)) return
        if (allocated(plane%normal)) call self%take_direction(label, 'normal', plane%normal, roller%normal, error)
        if (.not. allocated(error) .and. allocated(plane%pivot)) call take_vector(.false., label, 'pivot', plane%pivot, &
            roller%pivot, error)
        if (.not. allocated(error) .and. allocated(plane%along)) call self%take_direction(label, 'along', plane%along, &
            roller%along, error)
        if (allocated(error)) return
        if (allocated(plane%slide) .neqv. allocated(plane%along)) then
            call refuse(label//' has only one of slide and along', 'give both', error)
            return
        else if (abs(dot_product(roller%along, roller%normal)) > tolerance) then
            call refuse(label//' has a plane that slides out of itself', 'make along perpendicular to the normal', error)
            return
        end if
        roller%height = plane%height
        if (abs(roller%normal(3) - 1) > 0.0_wp) then
            f = frame_along(roller%normal)
            roller%tangent = f(:, 1:2)
        end if
        if (.not. 1 - dot_product(roller%axis, roller%normal)**2 > 1.0e-6_wp) then
            call refuse(label//' lies flat on its plane', 'tilt it: a flat disk has no unique contact point', error)
            return
        end if
        call self%frame_of(roller%body, r, a)
        roller%axis = matmul(roller%axis, a)
        pose%r(:, 0) = r
        pose%a(:, :, 0) = a
        call find_contact(roller, pose, y)
        gap = dot_product(roller%normal, r + y) - roller%height
        if (allocated(plane%rise)) then
            call plane%rise%evaluate(self%times(1), level)
            gap = gap - level(0)
        end if
        if (abs(gap) > tolerance*(1 + norm2(r) + norm2(y)) .and. .not. plane%open) then
            call refuse(label//' is '//to_text(gap)//' m above its plane in the reference configuration', &
                'move the body, or assemble the start, in a scene by [initial] assemble = true', error)
            return
        end if
        if (allocated(plane%rise)) call self%take_motion(name, plane%rise, 1, roller%rise)
        if (allocated(plane%rotation)) call self%take_motion(name, plane%rotation, 1, roller%rotation)
        if (allocated(plane%slide)) call self%take_motion(name, plane%slide, 1, roller%slide)
        call self%held%add(trim(name)//' height', 'N')
        roller%height_row = self%held%n
        do k = 1, 2
            call self%rolling%add(trim(name)//' slip '//merge('1', '2', k == 1), 'N')
        end do
        roller%row = self%rolling%n - 1
        self%n_of%rollers = self%n_of%rollers + 1
        if (self%n_of%rollers > size(self%rollers)) self%rollers = [self%rollers, self%rollers, roller]
        self%rollers(self%n_of%rollers) = roller
        call self%keep_name(name, of_wheel, self%n_of%rollers)
    end subroutine add_roller
end submodule tandem_mechanism_builder_rolling
