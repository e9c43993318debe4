! SPDX-License-Identifier: MIT
!> Builder procedures for constraints other than joints: couplings, rows at velocity level, distances.
submodule(tandem_mechanism_builder:tandem_mechanism_builder_joints) tandem_mechanism_builder_constraints
    implicit none (type, external)

contains

    module procedure add_coupling
        character(len=:), allocatable :: label
        integer :: i, numbers(max_coupled), motion_number

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
        motion_number = 0
        if (present(motion)) call self%take_motion(name, motion, 1, motion_number)
        call couple(self, name, numbers(:size(joints)), factors, &
            merge('N  ', 'N m', self%at%coordinates(numbers(1))%kind == is_displacement), motion_number)
        if (present(locked)) then
            associate (coupling => self%couplings(self%n_of%couplings))
                coupling%can_be_freed = .true.
                coupling%is_locked = locked
            end associate
        end if
        if (present(inertia)) call free_sum(self, self%couplings(self%n_of%couplings), inertia)
        call self%keep_name(name, of_row, self%n_of%couplings)
    end procedure add_coupling

    !> Make the sum of a coupling a coordinate with an inertia.
    subroutine free_sum(self, coupling, inertia)
        class(builder_type), intent(inout) :: self
        type(coupling_type), intent(inout) :: coupling
        real(wp), intent(in) :: inertia

        ! `define` numbers the poses of such coordinates, which follow those of all bodies.
        self%n_of%slides = self%n_of%slides + 1
        coupling%sum = -self%n_of%slides
        coupling%inertia = inertia
        call keep_coordinate(self, slide_coordinate(coupling%sum))
        coupling%displacement = self%n_of%coordinates
        coupling%n = coupling%n + 1
        coupling%coordinates(coupling%n) = slide_coordinate(coupling%sum)
        coupling%factors(coupling%n) = -1.0_wp
    end subroutine free_sum

    module procedure add_rate_row
        type(rate_row_type) :: row
        type(rate_row_type), allocatable :: longer(:)
        type(variable_type), allocatable :: variables(:)
        character(len=:), allocatable :: label
        integer :: i, k

        label = 'row '//trim(name)
        call self%check_name(name, label, error)
        if (allocated(error)) return
        if (size(velocities) /= size(coefficients) .or. size(velocities) == 0) then
            call refuse(label//' has '//to_text(size(velocities))//' velocities and '//to_text(size(coefficients))// &
                ' coefficients', 'give equal numbers of both', error)
            return
        end if
        allocate (variables, source=self%list_variables())
        associate (may_be_used => variables%kind == is_time .or. variables%kind == is_place .or. variables%kind == is_turn)
            do i = 1, size(coefficients)
                k = coefficients(i)%first_outside(may_be_used)
                if (k > 0) exit
            end do
            if (k == 0 .and. present(rhs)) k = rhs%first_outside(may_be_used)
        end associate
        if (k > 0) then
            call refuse(label//' depends on '//trim(variables(k)%name), 'use t, positions, angles and Euler parameters only', error)
            return
        end if
        allocate (row%velocities(size(velocities)))
        do i = 1, size(velocities)
            k = size(variables)
            do while (k > 0)
                if (variables(k)%name == velocities(i) .and. any(variables(k)%kind == [is_velocity, is_turn_rate, is_spin])) exit
                k = k - 1
            end do
            if (k == 0) then
                call refuse(label//': '//trim(velocities(i))//' is not a velocity', &
                    'write body.vx; angular velocities are body.omega in the plane, body.wx in space', error)
                return
            end if
            row%velocities(i) = variables(k)
        end do
        allocate (row%coefficients(size(coefficients)))
        do i = 1, size(coefficients)
            call self%take_formula(coefficients(i), row%coefficients(i))
        end do
        if (present(rhs)) call self%take_formula(rhs, row%rhs)
        call self%rolling%add(name, trim(merge('N  ', 'N m', any(row%velocities%kind == is_velocity))))
        row%row = self%rolling%n
        allocate (longer(size(self%rate_rows) + 1))
        longer(:size(self%rate_rows)) = self%rate_rows
        longer(size(longer)) = row
        call move_alloc(longer, self%rate_rows)
        ! Couplings have positive numbers.
        call self%keep_name(name, of_row, -size(self%rate_rows))
    end procedure add_rate_row

    module procedure add_distance
        type(point_vector_type) :: vector
        character(len=:), allocatable :: label
        real(wp) :: drawn, f(0:2)
        logical :: points(2)

        label = 'distance '//trim(name)
        call self%check_name(name, label, error)
        if (allocated(error)) return
        call self%take_pair(label, first, second, vector, points, error)
        if (allocated(error)) return
        drawn = self%reference_length(vector)
        vector%length = drawn
        if (present(length)) vector%length = length
        if (present(motion)) then
            call self%take_motion(name, motion, 1, vector%motion)
            call motion%evaluate(self%times(1), f)
            vector%length = f(0)
        end if
        if (.not. vector%length > 0.0_wp) then
            call refuse(label//' has the length '//to_text(vector%length), &
                'give a length > 0; for coincident points use a spherical or revolute joint', error)
            return
        end if
        vector%weight = vector%length
        vector%row = self%held%n + 1
        call self%held%add(name, 'N')
        self%n_of%distances = self%n_of%distances + 1
        if (self%n_of%distances > size(self%distances)) self%distances = [self%distances, self%distances, vector]
        self%distances(self%n_of%distances) = vector
        call self%keep_name(name, of_distance, self%n_of%distances)
    end procedure add_distance
end submodule tandem_mechanism_builder_constraints
