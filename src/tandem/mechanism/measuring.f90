! SPDX-License-Identifier: MIT
!> Output of a mechanism about its motion: values of sensors, work done on it, undetermined reactions. Only quantities required by
!> sensors are computed.
submodule(tandem_mechanism) tandem_mechanism_measuring
    use tandem_linalg_dependence, only: split_rows
    use tandem_mechanism_body, only: kinetic_energy_of
    use tandem_mechanism_element_kind, only: most_measured
    use tandem_mechanism_massless_wheel, only: find_contact_point
    use tandem_mechanism_reaction, only: reaction_on, turned_back
    use tandem_mechanism_rolling, only: find_contact
    use tandem_mechanism_sensor, only: measure_sensor, of_distance, of_joint, of_kind, of_knife_edge, of_massless_wheel, &
        of_wheel, quantities_of, sensed_balance, sensed_body, sensed_energy, sensed_force, sensed_joint, &
        sensed_reaction, sensor_type
    use tandem_mechanism_pose, only: turned
    use tandem_mechanism_point_vector, only: vector_between
    use, intrinsic :: ieee_arithmetic, only: ieee_quiet_nan, ieee_value
    implicit none (type, external)

    !> Rows of unit length are dependent if the remainder of one is smaller than this, as in the rank decision of charts.
    real(wp), parameter :: dependent = 1.0e-10_wp
    !> A component of a reaction is undetermined if redundant rows change it by more than this part of their largest effect.
    real(wp), parameter :: open = 1.0e-8_wp
    !> Largest number of entries of C for the search for undetermined reactions: a second of work.
    real(wp), parameter :: most_examined = 1.0e6_wp

contains

    module procedure list_quantities
        type(quantity_type), allocatable :: list(:), all_of_them(:)
        integer :: i, k, m, n

        if (size(self%sensors) == 0) return
        allocate (all_of_them(16))
        n = 0
        do i = 1, size(self%sensors)
            associate (sensor => self%sensors(i))
                list = quantities_of(sensor)
                if (sensor%of > of_kind) call self%kinds(sensor%of - of_kind)%of%list_quantities(sensor, list)
                sensor%width = sum(max(1, list%width))
                sensor%first = n + 1
                sensor%n_quantities = size(list)
                ! Allocate spare room, so that adding a sensor does not copy the list each time.
                if (n + size(list) > size(all_of_them)) all_of_them = [quantity_type :: all_of_them, all_of_them, list]
                all_of_them(n + 1:n + size(list)) = list
                n = n + size(list)
                where (sensor%rows < 0) sensor%rows = self%n_holonomic - sensor%rows
            end associate
        end do
        self%quantities = all_of_them(:n)
        self%measures_every_step = .not. self%planar .and. any(self%sensors%kind == sensed_joint .and. self%sensors%turns)
        if (.not. any(self%sensors%kind == sensed_reaction .or. self%sensors%kind == sensed_balance .or. &
            self%sensors%has_reaction_friction)) return
        self%measures_multipliers = .true.
        m = self%n_constraints()
        allocate (self%at_row%nu(m), source=0.0_wp)
        if (any(self%sensors%kind == sensed_reaction)) then
            ! For many bodies a full C would take more memory than everything else.
            self%at_row%is_compressed = allocated(self%pattern)
            k = self%n
            if (allocated(self%pattern)) k = self%pattern%width
            allocate (self%at_row%jacobian(m, k), source=0.0_wp)
        end if
        if (any(self%sensors%can_be_freed)) allocate (self%state%impulses(m), source=0.0_wp)
        if (.not. any(self%sensors%kind == sensed_balance)) return
        self%state%integrals = [0.0_wp, 0.0_wp]
    end procedure list_quantities

    !> Evaluate the sensors.
    module procedure measure
        logical :: with_reactions
        integer :: i, n

        stat = 0
        call set_poses(self, t, q, qd, stat)
        if (stat /= 0) return
        if (.not. allocated(self%state%asked)) then
            do i = 1, size(self%bodies)
                call set_accelerations(self%at%pose(i), qdd)
            end do
            call set_displacements(self%at%pose(size(self%bodies) + 1:), 2, qdd)
        end if
        with_reactions = present(lambda) .and. any(self%sensors%kind == sensed_reaction)
        if (with_reactions .and. allocated(self%state%asked)) then
            with_reactions = any(self%state%asked .and. self%quantities%of_multipliers)
        end if
        if (with_reactions) then
            call self%evaluate(iand(self%provides, need_jacobian + need_nu), t, q, qd, self%at_row, stat)
            if (stat /= 0) return
        end if
        n = 0
        do i = 1, size(self%sensors)
            associate (sensor => self%sensors(i), shown => values(n + 1:n + self%sensors(i)%width))
                n = n + sensor%width
                if (.not. is_asked_for(self, sensor)) cycle
                if ((sensor%kind == sensed_reaction .or. sensor%has_reaction_friction) .and. .not. present(lambda)) then
                    shown = ieee_value(t, ieee_quiet_nan)
                else if (sensor%kind == sensed_reaction) then
                    call measure_reaction(self, sensor, lambda, shown)
                else if (sensor%has_reaction_friction) then
                    call measure_force(self, sensor, lambda, shown)
                else if (sensor%kind == sensed_force) then
                    call measure_force(self, sensor, [real(wp) ::], shown)
                else if (sensor%kind == sensed_balance) then
                    call measure_balance(self, sensor, t, q, shown, stat)
                else
                    call measure_sensor(sensor, t, self%at%pose, self%at%f, energies_of(self, sensor, t, q, stat), &
                        shown)
                end if
            end associate
            if (stat /= 0) return
        end do
    end procedure measure

    !> True if all quantities are requested, or one of this sensor.
    pure logical function is_asked_for(self, sensor)
        type(mechanism_type), intent(in) :: self
        type(sensor_type), intent(in) :: sensor

        is_asked_for = .not. allocated(self%state%asked)
        if (.not. is_asked_for) is_asked_for = any(self%state%asked(sensor%first:sensor%first + sensor%n_quantities - 1))
    end function is_asked_for

    !> Set the poses with their rates, and the functions of time.
    subroutine set_poses(self, t, q, qd, stat)
        type(mechanism_type), intent(inout) :: self
        real(wp), intent(in) :: t, q(:), qd(:)
        integer, intent(out) :: stat
        integer :: i

        ! Evaluate no term, only the common quantities of all terms.
        call self%evaluate(0, t, q, qd, self%at_row, stat)
        do i = 1, size(self%bodies)
            call set_rates(self%at%pose(i), qd)
        end do
        call set_displacements(self%at%pose(size(self%bodies) + 1:), 1, qd)
    end subroutine set_poses

    !> Kinetic and potential energy for a sensor: of the mechanism, or of a body.
    function energies_of(self, sensor, t, q, stat) result(energies)
        type(mechanism_type), intent(inout) :: self
        type(sensor_type), intent(in) :: sensor
        real(wp), intent(in) :: t, q(:)
        integer, intent(inout) :: stat
        real(wp) :: energies(2)
        integer :: i

        energies = 0.0_wp
        select case (sensor%kind)
        case (sensed_energy, sensed_balance)
            do i = 1, size(self%bodies)
                energies(1) = energies(1) + kinetic_energy_of(self%bodies(i), self%at%pose(i))
            end do
            do i = 1, size(self%slides)
                if (.not. self%slides(i)%is_slack) energies(1) = energies(1) + &
                    self%slides(i)%inertia*self%at%pose(size(self%bodies) + i)%r(1, 1)**2/2
            end do
            call self%potential_energy(t, q, energies(2), stat)
        case (sensed_body)
            associate (body => self%bodies(sensor%number), pose => self%at%pose(sensor%number))
                energies(1) = kinetic_energy_of(body, pose)
                energies(2) = -body%mass*dot_product(self%gravity, pose%r(:, 0))
            end associate
        case default
            return
        end select
    end function energies_of

    !> Measure the reaction of an element, and the power of its motion; C and nu are set.
    subroutine measure_reaction(self, sensor, lambda, values)
        type(mechanism_type), intent(inout) :: self
        type(sensor_type), intent(in) :: sensor
        real(wp), intent(in) :: lambda(:)
        real(wp), intent(out) :: values(:)
        real(wp) :: point(3), force(3), torque(3), d(3)
        integer :: n

        associate (rows => sensor%rows(:sensor%n_rows), body => self%at%pose(sensor%vector%second), &
            jacobian => self%at_row%jacobian)
            select case (sensor%of)
            case (of_joint)
                call find_wrench(self, sensor, lambda, force, torque)
                values(1:6) = [force, torque]
                values(7:9) = turned_back(body, force)
                values(10:12) = turned_back(body, torque)
                n = 12
            case (of_wheel, of_knife_edge, of_massless_wheel)
                if (sensor%of == of_wheel) then
                    call find_contact(self%rollers(sensor%number), body, point)
                    point = point + body%r(:, 0)
                else if (sensor%of == of_massless_wheel) then
                    associate (wheel => self%massless_wheels(sensor%number))
                        call find_contact_point(wheel, body, self%at%pose(wheel%slide), self%at%f, point)
                    end associate
                else
                    point = body%r(:, 0) + turned(body, 0, sensor%vector%s2)
                end if
                call reaction_on(body, rows, lambda, jacobian, point, force, torque)
                values(1:6) = [point, force]
                values(7:9) = turned_back(body, force)
                n = 9
            case (of_distance)
                ! Phi = (d.d - l^2)/(2 w).
                d = vector_between(sensor%vector, self%at%pose, 0)*lambda(rows(1))/sensor%vector%weight
                values(1:4) = [sign(norm2(d), lambda(rows(1))), -d]
                n = 4
            case default
                ! Reaction -C' lambda along the sum with the gradient C.
                values(1) = -lambda(rows(1))
                n = 1
                if (sensor%can_be_freed) then
                    values(2) = -self%state%impulses(rows(1))
                    n = 2
                end if
            end select
            ! Power of the reaction, -C' lambda times qd, with C qd = nu.
            if (sensor%is_driven) values(n + 1) = -dot_product(lambda(rows), self%at_row%nu(rows))
        end associate
    end subroutine measure_reaction

    !> Force and torque of a joint on its second body, about the joint's point on it.
    subroutine find_wrench(self, sensor, lambda, force, torque)
        type(mechanism_type), intent(in) :: self
        type(sensor_type), intent(in) :: sensor
        real(wp), intent(in) :: lambda(:)
        real(wp), intent(out) :: force(3), torque(3)
        real(wp) :: point(3)

        associate (one => self%at%pose(sensor%vector%first), two => self%at%pose(sensor%vector%second), &
            rows => sensor%rows(:sensor%n_rows))
            point = two%r(:, 0) + turned(two, 0, sensor%vector%s2)
            if (two%n_place > 0) then
                call reaction_on(two, rows, lambda, self%at_row%jacobian, point, force, torque)
            else
                ! The ground has no coordinates: take the opposite of the reaction on the first body.
                call reaction_on(one, rows, lambda, self%at_row%jacobian, point, force, torque)
                force = -force
                torque = -torque
            end if
        end associate
    end subroutine find_wrench

    !> Measure the force and the energy of a force element.
    subroutine measure_force(self, sensor, lambda, values)
        type(mechanism_type), intent(inout) :: self
        type(sensor_type), intent(in) :: sensor
        !> Multipliers are used for friction on a reaction.
        real(wp), intent(in) :: lambda(:)
        real(wp), intent(out) :: values(:)
        real(wp) :: measured(most_measured), power

        call self%kinds(sensor%of - of_kind)%of%measure(sensor%number, self%at, lambda, measured, power)
        values = measured(:size(values))
    end subroutine measure_force

    !> Measure the energy balance; the work is integrated over time.
    subroutine measure_balance(self, sensor, t, q, values, stat)
        type(mechanism_type), intent(inout) :: self
        type(sensor_type), intent(inout) :: sensor
        real(wp), intent(in) :: t, q(:)
        real(wp), intent(out) :: values(:)
        integer, intent(inout) :: stat

        values(1:2) = energies_of(self, sensor, t, q, stat)
        values(3:4) = self%state%integrals
        if (.not. sensor%has_begun) sensor%first_energy = sum(values(1:2)) - sum(self%state%integrals)
        sensor%has_begun = .true.
        values(5) = values(1) + values(2) - sensor%first_energy - sum(self%state%integrals)
    end subroutine measure_balance

    !> Power of imposed motions, and power of forces without a potential.
    module procedure integrands
        real(wp) :: measured(most_measured), power
        integer :: i, k

        stat = 0
        values = 0.0_wp
        if (iand(self%provides, need_nu) /= 0) then
            call self%evaluate(need_nu, t, q, qd, self%at_row, stat)
            if (stat /= 0) return
            values(1) = -dot_product(lambda, self%at_row%nu)
        end if
        call set_poses(self, t, q, qd, stat)
        if (stat /= 0) return
        do k = 1, size(self%force_kinds)
            associate (kind => self%kinds(self%force_kinds(k))%of)
                do i = 1, kind%n
                    call kind%measure(i, self%at, lambda, measured, power)
                    values(2) = values(2) + power
                end do
            end associate
        end do
    end procedure integrands

    !> Report the components of reactions that redundant rows leave undetermined: those that a combination of multipliers with C'
    !> lambda = 0 changes.
    module procedure begin_measuring
        type(terms_type) :: full
        real(wp), allocatable :: combination(:, :), z(:), shown(:)
        integer, allocatable :: kept(:), dropped(:)
        integer :: i, k, n

        stat = 0
        if (size(lambda) == 0 .or. .not. allocated(self%at_row%jacobian)) return
        if (real(size(lambda), wp)*self%n > most_examined) then
            where (self%quantities%of_multipliers) self%quantities%undetermined = 'not examined'
            return
        end if
        allocate (full%jacobian(size(lambda), self%n), full%nu(size(lambda)), source=0.0_wp)
        call self%evaluate(iand(self%provides, need_jacobian), t, q, qd, full, stat)
        if (stat /= 0) return
        call split_rows(full%jacobian, [(1.0_wp, i=1, self%n)], self%n_holonomic, dependent, kept, dropped, combination)
        if (size(dropped) == 0) return
        call set_poses(self, t, q, qd, stat)
        if (stat == 0) call self%evaluate(iand(self%provides, need_jacobian + need_nu), t, q, qd, self%at_row, stat)
        if (stat /= 0) return
        allocate (z(size(lambda)))
        do k = 1, size(dropped)
            z = 0.0_wp
            z(dropped(k)) = 1.0_wp
            z(kept) = -combination(k, :)
            n = 0
            do i = 1, size(self%sensors)
                associate (sensor => self%sensors(i))
                    if (sensor%kind == sensed_reaction) then
                        if (allocated(shown)) deallocate (shown)
                        allocate (shown(sensor%width))
                        call measure_reaction(self, sensor, z, shown)
                        call mark(self, n, sensor, shown, open*maxval(abs(z))*maxval(abs(self%at_row%jacobian)))
                    end if
                    n = n + sensor%n_quantities
                end associate
            end do
        end do
    end procedure begin_measuring

    !> Report the components of the force, torque and multipliers of a reaction that are not small.
    subroutine mark(self, before, sensor, shown, small)
        type(mechanism_type), intent(inout) :: self
        !> Number of quantities before those of the sensor.
        integer, intent(in) :: before
        type(sensor_type), intent(in) :: sensor
        real(wp), intent(in) :: shown(:), small
        character(len=1), parameter :: axis(3) = ['x', 'y', 'z']
        integer :: i, k, n

        n = 0
        do i = 1, sensor%n_quantities
            associate (quantity => self%quantities(before + i))
                do k = 1, max(1, quantity%width)
                    n = n + 1
                    if (abs(shown(n)) <= small .or. index(quantity%path, '/position') + index(quantity%path, '/impulse') > 0) cycle
                    if (quantity%width == 0) then
                        quantity%undetermined = 'all of it'
                    else if (index(quantity%undetermined, axis(k)) == 0) then
                        quantity%undetermined = trim(quantity%undetermined)//merge(' ', ',', quantity%undetermined == '')//axis(k)
                        quantity%undetermined = adjustl(quantity%undetermined)
                    end if
                end do
            end associate
        end do
    end subroutine mark
end submodule tandem_mechanism_measuring
