! SPDX-License-Identifier: MIT
!> Builder procedures for springs.
submodule(tandem_mechanism_builder) tandem_mechanism_builder_forces
    use tandem_mechanism_refusal, only: refuse
    use tandem_mechanism_sensor, only: of_spring
    implicit none (type, external)

contains

    module procedure add_spring
        type(spring_type) :: spring
        character(len=:), allocatable :: label
        logical :: points(2)

        label = 'spring '//trim(name)
        call self%check_name(name, label, error)
        if (allocated(error)) return
        call self%take_pair(label, first, second, spring%vector, points, error)
        if (allocated(error)) return
        spring%length = self%reference_length(spring%vector)
        if (.not. spring%length > 0.0_wp) then
            call refuse(label//' has length zero in the reference configuration, hence no direction', 'move one of its ends', error)
            return
        end if
        if (present(stiffness)) spring%stiffness = stiffness
        if (present(damping)) spring%damping = damping
        if (present(length)) spring%length = length
        if (present(motion)) call self%take_motion(name, motion, -1, spring%motion)
        if (present(law)) call self%take_law(law, spring%law)
        self%n_of%springs = self%n_of%springs + 1
        if (self%n_of%springs > size(self%springs)) self%springs = [self%springs, self%springs, spring]
        self%springs(self%n_of%springs) = spring
        call self%keep_name(name, of_spring, self%n_of%springs)
    end procedure add_spring
end submodule tandem_mechanism_builder_forces
