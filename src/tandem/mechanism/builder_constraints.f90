! SPDX-License-Identifier: MIT
!> Builder procedures for constraints other than joints: rows at velocity level, distances.
submodule(tandem_mechanism_builder:tandem_mechanism_builder_joints) tandem_mechanism_builder_constraints
    implicit none (type, external)

contains

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
        call self%keep_name(name, of_row, size(self%rate_rows))
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
