! SPDX-License-Identifier: MIT
!> The words for knife edges, and for disks and spheres that roll.
submodule(tandem_mechanism_drawing) tandem_mechanism_drawing_rolling
    implicit none (type, external)

contains

    !> A knife edge, or a wheel that does not slip sideways: the point does not move along `across`.
    module procedure add_knife_edge
        type(edge_type) :: edge
        real(wp) :: r(3), a(3, 3)
        character(len=:), allocatable :: label
        logical :: is_point

        label = 'knife edge '//trim(name)
        call self%check_name(name, label, error)
        if (allocated(error)) return
        call self%take_point(label, on, edge%body, edge%point, is_point, error)
        if (.not. allocated(error)) call self%take_direction(label, 'across', across, edge%across, error)
        if (.not. allocated(error)) call self%need_turning_body(label, edge%body, error)
        if (allocated(error)) return
        call self%frame_of(edge%body, r, a)
        edge%across = matmul(edge%across, a)
        edge%moment = cross(edge%point, edge%across)
        self%rolling_name = [character(len=label_length) :: self%rolling_name, name]
        edge%row = size(self%rolling_name)
        self%edges = [self%edges, edge]
        call self%keep_name(name)
    end procedure add_knife_edge

    !> A disk with a sharp rim that rolls on a plane.
    module procedure add_rolling_disk

        call add_roller(self, 'rolling disk '//trim(name), name, centre, radius, error, axis, normal, height, open)
    end procedure add_rolling_disk

    !> A sphere that rolls on a plane.
    module procedure add_rolling_sphere

        call add_roller(self, 'rolling sphere '//trim(name), name, centre, radius, error, normal=normal, height=height, open=open)
    end procedure add_rolling_sphere

    subroutine add_roller(self, label, name, centre, radius, error, axis, normal, height, open)
        class(drawing_type), intent(inout) :: self
        character(len=*), intent(in) :: label, name, centre
        real(wp), intent(in) :: radius
        type(error_type), allocatable, intent(out) :: error
        real(wp), intent(in), optional :: axis(:), normal(:), height
        logical, intent(in), optional :: open
        type(roller_type) :: roller
        real(wp) :: r(3), a(3, 3), f(3, 3), gap
        logical :: is_point, may_be_open

        call self%check_name(name, label, error)
        if (allocated(error)) return
        if (self%planar .or. .not. radius > 0.0_wp) then
            call refuse(label//' is in the plane, or has a radius that is not positive', &
                'let it roll in space with a radius > 0 in m', error)
            return
        end if
        call self%take_point(label, centre, roller%body, roller%centre, is_point, error)
        if (.not. allocated(error)) call self%need_turning_body(label, roller%body, error)
        if (allocated(error)) return
        if (present(axis)) call self%take_direction(label, 'axis', axis, roller%axis, error)
        if (allocated(error)) return
        if (present(normal)) call self%take_direction(label, 'normal', normal, roller%normal, error)
        if (allocated(error)) return
        roller%radius = radius
        if (present(height)) roller%height = height
        if (abs(roller%normal(3) - 1) > 0.0_wp) then
            f = frame_along(roller%normal)
            roller%tangent = f(:, 1:2)
        end if
        gap = 1 - dot_product(roller%axis, roller%normal)**2
        if (.not. gap > 1.0e-6_wp) then
            call refuse(label//' lies flat on its plane', 'tilt it: a flat disk has no contact point', error)
            return
        end if
        call self%frame_of(roller%body, r, a)
        gap = dot_product(roller%normal, r + matmul(a, roller%centre)) - radius*sqrt(gap) - roller%height
        may_be_open = .false.
        if (present(open)) may_be_open = open
        if (abs(gap) > tolerance*(1 + norm2(r) + radius) .and. .not. may_be_open) then
            call refuse(label//' is '//to_text(gap)//' m above its plane in the drawing', &
                'move the body, or say that it is open and let the start be assembled', error)
            return
        end if
        roller%axis = matmul(roller%axis, a)
        call self%new_row(trim(name)//' height', 'N')
        roller%height_row = size(self%held_name)
        self%rolling_name = [character(len=label_length) :: self%rolling_name, trim(name)//' slip 1', trim(name)//' slip 2']
        roller%row = size(self%rolling_name) - 1
        self%rollers = [self%rollers, roller]
        call self%keep_name(name)
    end subroutine add_roller
end submodule tandem_mechanism_drawing_rolling
