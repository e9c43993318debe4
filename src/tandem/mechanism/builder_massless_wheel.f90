! SPDX-License-Identifier: MIT
!> Builder procedure for massless wheels.
submodule(tandem_mechanism_builder) tandem_mechanism_builder_massless_wheel
    use tandem_error, only: to_text
    use tandem_mechanism_massless_wheel, only: find_contact_point
    use tandem_mechanism_pose, only: pose_type
    use tandem_mechanism_refusal, only: refuse
    use tandem_mechanism_sensor, only: of_massless_wheel
    use tandem_mechanism_vector, only: cross
    implicit none (type, external)

contains

    !> Add a massless wheel on a body, or on a strut that slides on it.
    module procedure add_massless_wheel
        type(massless_wheel_type) :: wheel
        type(plane_type) :: ground
        real(wp), parameter :: small = 1.0e-6_wp
        real(wp) :: r(3), a(3, 3), pivot(3)
        character(len=:), allocatable :: label
        logical :: is_point

        label = 'massless wheel '//trim(name)
        call self%check_name(name, label, error)
        if (allocated(error)) return
        if (self%planar) then
            call refuse(label//' is in the plane', 'use a knife edge there', error)
            return
        end if
        if (present(plane)) ground = plane
        if (present(crown)) wheel%crown = crown
        wheel%radius = radius - wheel%crown
        if (wheel%crown < 0.0_wp .or. .not. wheel%radius > 0.0_wp) then
            call refuse(label//' has a radius that is not positive, or a crown that is not between 0 and it', &
                'give a radius > 0 in m, and a smaller crown >= 0', error)
            return
        end if
        call self%take_point(label, centre, wheel%body, wheel%centre, is_point, error)
        if (.not. allocated(error)) call self%need_turning_body(label, wheel%body, error)
        if (.not. allocated(error)) call self%take_direction(label, 'axis', axis, wheel%axle, error)
        if (.not. allocated(error) .and. allocated(ground%normal)) call self%take_direction(label, 'normal', ground%normal, &
            wheel%normal, error)
        if (.not. allocated(error) .and. present(along)) call self%take_direction(label, 'along', along, wheel%along, error)
        pivot = wheel%along
        if (.not. allocated(error) .and. present(about)) call self%take_direction(label, 'about', about, pivot, error)
        if (allocated(error)) return
        if (merge(.not. (present(along) .or. present(about)), present(about), present(steer))) then
            call refuse(label//' has only one of steer and its axis', 'give steer, and about or along', &
                error)
        else if (present(along) .and. .not. abs(dot_product(wheel%along, wheel%normal)) > small) then
            call refuse(label//' slides along its plane', 'along must not be parallel to the plane', error)
        else if (.not. 1 - dot_product(wheel%axle, wheel%normal)**2 > small) then
            call refuse(label//' lies flat on its plane', 'tilt it: a flat wheel has no unique contact point', error)
        end if
        if (allocated(error)) return
        wheel%height = ground%height
        ! In the body's frame.
        call self%frame_of(wheel%body, r, a)
        wheel%axle = matmul(wheel%axle, a)
        wheel%along = matmul(wheel%along, a)
        pivot = matmul(pivot, a)
        wheel%fixed = dot_product(pivot, wheel%axle)*pivot
        wheel%towards = cross(pivot, wheel%axle)
        if (.not. ground%open) call check_gap(self, label, wheel, error, ground, steer)
        if (allocated(error)) return
        if (present(steer)) call self%take_motion(name, steer, 1, wheel%steer)
        if (allocated(ground%rise)) call self%take_motion(name, ground%rise, 1, wheel%rise)
        call self%held%add(trim(name)//' height', 'N')
        wheel%height_row = self%held%n
        call self%rolling%add(trim(name)//' slip', 'N')
        wheel%row = self%rolling%n
        if (present(along)) then
            call self%take_slide(name, 'm', 0.0_wp, wheel%slide, wheel%displacement)
        end if
        self%n_of%massless_wheels = self%n_of%massless_wheels + 1
        if (self%n_of%massless_wheels > size(self%massless_wheels)) then
            self%massless_wheels = [self%massless_wheels, self%massless_wheels, wheel]
        end if
        self%massless_wheels(self%n_of%massless_wheels) = wheel
        call self%keep_name(name, of_massless_wheel, self%n_of%massless_wheels)
    end procedure add_massless_wheel

    !> Refuse a wheel that is off its plane in the reference configuration.
    subroutine check_gap(self, label, wheel, error, plane, steer)
        class(builder_type), intent(in) :: self
        character(len=*), intent(in) :: label
        type(massless_wheel_type), intent(inout) :: wheel
        type(error_type), allocatable, intent(inout) :: error
        type(plane_type), intent(in) :: plane
        class(function_type), intent(in), optional :: steer
        type(pose_type) :: body, ground
        real(wp) :: place(3), level(0:2), steered(0:2, 1), gap

        call self%frame_of(wheel%body, body%r(:, 0), body%a(:, :, 0))
        if (present(steer)) then
            call steer%evaluate(self%times(1), steered(:, 1))
            wheel%steer = 1
        end if
        call find_contact_point(wheel, body, ground, steered, place)
        wheel%steer = 0
        gap = dot_product(wheel%normal, place) - wheel%height
        if (allocated(plane%rise)) then
            call plane%rise%evaluate(self%times(1), level)
            gap = gap - level(0)
        end if
        if (abs(gap) > tolerance*(1 + norm2(place))) call refuse(label//' is '//to_text(gap)// &
            ' m above its plane in the reference configuration', &
            'move it, or assemble the start, in a scene by [initial] assemble = true', error)
    end subroutine check_gap
end submodule tandem_mechanism_builder_massless_wheel
