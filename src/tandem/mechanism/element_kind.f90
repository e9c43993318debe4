! SPDX-License-Identifier: MIT
!> Contract of a kind of elements. One object holds all elements of its kind, so that dispatch happens once per kind and evaluation;
!> a mechanism has one list of kinds. A kind overrides the procedures for what it has: only its word and its keys have no default.
module tandem_mechanism_element_kind
    use tandem_kinds, only: wp
    use tandem_mechanism_context, only: context_type
    use tandem_mechanism_coordinate, only: coordinate_type, number_slide
    use tandem_mechanism_key_reader, only: reader_type
    use tandem_mechanism_pose, only: pose_type
    use tandem_mechanism_sensor, only: sensor_type
    use tandem_model, only: model_type, quantity_type
    use tandem_model_derivatives, only: derivatives_type
    use tandem_model_terms, only: terms_type
    use tandem_pack, only: pack_type
    implicit none (type, external)
    private

    public :: element_kind_type, kind_item_type, attachment_type, constraint_type, visit_interface, word_length, most_measured

    !> Length of the word of a kind; largest number of values of a sensor of an element.
    integer, parameter :: word_length = 8, most_measured = 8

    !> Where an element is attached.
    type :: attachment_type
        !> The two bodies between which it acts: 0 for the ground, negative for sliding parts until these are numbered. The first
        !> one is -1 if it acts on one body only.
        integer :: body(2) = -1
        !> Its points in the axes of the bodies (m); true for each at which it is drawn.
        real(wp) :: point(3, 2) = 0.0_wp
        logical :: is_drawn(2) = .false.
        !> Joint at which it is drawn instead, 0 if none.
        integer :: joint = 0
        !> True if it acts along the line between its points, whose length then is a natural length of the mechanism.
        logical :: is_line = .false.
        !> True if it acts along a displacement; true if its force depends on multipliers.
        logical :: slides = .false., needs_multipliers = .false.
        !> Largest stiffness along a displacement (N/m) and about an axis (N m/rad).
        real(wp) :: stiffness(2) = 0.0_wp
    end type attachment_type

    !> The row of an element.
    type :: constraint_type
        !> Row of Phi; index of the function of time that drives it, 0 if none; true if it constrains an angle.
        integer :: row = 0, motion = 0
        logical :: is_angle = .false.
        !> True if events lock and free it; true if it is locked.
        logical :: can_be_freed = .false., is_locked = .true.
        !> Pose of the coordinate that the element has of its own, negative until it is numbered, 0 if none; index of this
        !> coordinate in those of the mechanism, 0 if no element may name it.
        integer :: slide = 0, displacement = 0
        !> Value if all angles are 1 and all displacements are a given length.
        real(wp) :: scale = 1.0_wp
    end type constraint_type

    !> All elements of a kind.
    type, abstract :: element_kind_type
        !> Number of elements.
        integer :: n = 0
        !> Numbers that events change, by the names of `list_settings` or by `lock` (3, n). Not allocated if the kind has none.
        real(wp), allocatable :: numbers(:, :)
        !> True if the elements have rows instead of forces.
        logical :: has_rows = .false.
        !> Joint coordinates of all elements, and their number; true if an element depends on their full turns.
        integer :: n_coordinates = 0
        type(coordinate_type), allocatable :: coordinates(:)
        logical :: counts_turns = .false.
    contains
        procedure(label_interface), deferred, nopass :: label
        procedure(read_interface), deferred, nopass :: read
        procedure, nopass :: table => force_table, list_settings => no_settings
        procedure :: attachment => no_attachment, touch => touch_both, renumber => keep_numbers
        procedure :: add_forces => add_nothing, add_energy => add_no_energy, differentiate => differentiate_nothing
        procedure :: list_quantities => no_quantities, measure => measure_nothing
        procedure :: constraint => no_constraint, start => start_nothing, add_rows => add_no_rows, lock => lock_nothing
        procedure, non_overridable :: add, fit, number_slides, visit_coordinates, pack_state
    end type element_kind_type

    !> Element of the list of kinds.
    type :: kind_item_type
        class(element_kind_type), allocatable :: of
    end type kind_item_type

    abstract interface
        !> Word of the kind in scenes and messages.
        pure function label_interface() result(label)
            import :: word_length
            implicit none (type, external)
            character(len=word_length) :: label
        end function label_interface

        !> Read the keys of an element after its type, close its table, and add it by the builder.
        subroutine read_interface(reader, mechanism, n_points)
            import :: model_type, reader_type
            implicit none (type, external)
            type(reader_type), intent(inout) :: reader
            !> A `builder_type`, whose module uses this one.
            class(model_type), intent(inout) :: mechanism
            !> Number of unnamed points so far.
            integer, intent(inout) :: n_points
        end subroutine read_interface

        !> Operation on a joint coordinate.
        pure subroutine visit_interface(coordinate, pose, f)
            import :: coordinate_type, pose_type, wp
            implicit none (type, external)
            type(coordinate_type), intent(inout) :: coordinate
            type(pose_type), intent(in) :: pose(0:)
            !> Values and derivatives of the functions of time.
            real(wp), intent(in), contiguous :: f(0:, :)
        end subroutine visit_interface
    end interface

contains

    !> Count a new element, and store its numbers and its joint coordinates.
    pure subroutine add(self, numbers, coordinates)
        class(element_kind_type), intent(inout) :: self
        real(wp), intent(in), optional :: numbers(3)
        type(coordinate_type), intent(in), optional :: coordinates(:)
        integer :: n

        self%n = self%n + 1
        if (present(numbers)) then
            if (.not. allocated(self%numbers)) allocate (self%numbers(3, 1))
            n = size(self%numbers, 2)
            if (self%n > n) self%numbers = reshape(self%numbers, [3, 2*n], pad=[0.0_wp])
            self%numbers(:, self%n) = numbers
        end if
        if (present(coordinates)) then
            if (.not. allocated(self%coordinates)) self%coordinates = coordinates
            n = self%n_coordinates + size(coordinates)
            if (n > size(self%coordinates)) self%coordinates = [self%coordinates, self%coordinates, coordinates]
            self%coordinates(self%n_coordinates + 1:n) = coordinates
            self%n_coordinates = n
        end if
    end subroutine add

    !> Trim the numbers and the coordinates to their used lengths.
    pure subroutine fit(self)
        class(element_kind_type), intent(inout) :: self

        if (allocated(self%numbers)) self%numbers = self%numbers(:, :self%n)
        if (allocated(self%coordinates)) self%coordinates = self%coordinates(:self%n_coordinates)
    end subroutine fit

    !> Move sliding part -i of each coordinate behind all bodies.
    pure subroutine number_slides(self, n_bodies)
        class(element_kind_type), intent(inout) :: self
        integer, intent(in) :: n_bodies
        integer :: i

        do i = 1, self%n_coordinates
            call number_slide(self%coordinates(i), n_bodies)
        end do
    end subroutine number_slides

    !> Call `visit` for all coordinates.
    pure subroutine visit_coordinates(self, visit, context)
        class(element_kind_type), intent(inout) :: self
        procedure(visit_interface) :: visit
        type(context_type), intent(in) :: context
        integer :: i

        if (.not. self%counts_turns) return
        do i = 1, self%n_coordinates
            call visit(self%coordinates(i), context%pose, context%f)
        end do
    end subroutine visit_coordinates

    !> Pack the numbers that events may set, and counted turns.
    subroutine pack_state(self, pack)
        class(element_kind_type), intent(inout) :: self
        type(pack_type), intent(inout) :: pack
        integer :: i

        call pack%item(self%numbers)
        do i = 1, self%n_coordinates
            call pack%item(self%coordinates(i)%last)
        end do
    end subroutine pack_state

    !> Replace preliminary numbers of rows: row -i at velocity level becomes the row behind all holonomic ones.
    pure subroutine keep_numbers(self, n_holonomic)
        class(element_kind_type), intent(inout) :: self
        integer, intent(in) :: n_holonomic
    end subroutine keep_numbers

    !> Table of scenes that contains the elements.
    pure function force_table() result(table)
        character(len=10) :: table

        table = 'force'
    end function force_table

    !> Where an element is attached.
    pure function no_attachment(self, number) result(attachment)
        class(element_kind_type), intent(in) :: self
        !> Index of the element.
        integer, intent(in) :: number
        type(attachment_type) :: attachment

        attachment = attachment_type()
    end function no_attachment

    !> List the bodies on whose coordinates an element depends, beginning with those on which it exerts a force.
    subroutine touch_both(self, number, context, n, bodies)
        class(element_kind_type), intent(in) :: self
        integer, intent(in) :: number
        type(context_type), intent(in) :: context
        !> Number of bodies, and the bodies; the list may be longer, so that it is seldom allocated.
        integer, intent(out) :: n
        integer, allocatable, intent(inout) :: bodies(:)
        type(attachment_type) :: attachment

        attachment = self%attachment(number)
        n = 2
        bodies(1:2) = attachment%body
    end subroutine touch_both

    !> Add the forces of all elements at the poses and rates of the context, or their partial derivatives with respect to time if
    !> `only_rates` of the context is true. stat > 0 if a force is undefined.
    pure subroutine add_nothing(self, context, force, stat)
        class(element_kind_type), intent(inout) :: self
        type(context_type), intent(inout) :: context
        real(wp), intent(inout) :: force(:)
        integer, intent(inout) :: stat
    end subroutine add_nothing

    !> Add the potential energy of all elements to a sum (J), at the poses of the context.
    pure subroutine add_no_energy(self, context, energy)
        class(element_kind_type), intent(inout) :: self
        type(context_type), intent(in) :: context
        real(wp), intent(inout) :: energy
    end subroutine add_no_energy

    !> Add the requested gradient blocks of the forces or rows of a range of elements.
    pure subroutine differentiate_nothing(self, first, last, need, context, lambda, derivatives)
        class(element_kind_type), intent(inout) :: self
        integer, intent(in) :: first, last, need
        type(context_type), intent(inout) :: context
        !> Multipliers.
        real(wp), intent(in) :: lambda(:)
        type(derivatives_type), intent(inout) :: derivatives
    end subroutine differentiate_nothing

    !> The row of an element.
    pure function no_constraint(self, number, length) result(constraint)
        class(element_kind_type), intent(in) :: self
        integer, intent(in) :: number
        !> Length that gives the scale of the row.
        real(wp), intent(in) :: length
        type(constraint_type) :: constraint

        constraint = constraint_type()
    end function no_constraint

    !> Set the values and rates of coordinates that elements have of their own, in poses of the reference configuration.
    subroutine start_nothing(self, pose)
        class(element_kind_type), intent(in) :: self
        type(pose_type), intent(inout) :: pose(0:)
    end subroutine start_nothing

    !> Set the requested terms of all rows, at the poses and rates of the context. Rows of C are zero on entry unless they are
    !> compressed.
    pure subroutine add_no_rows(self, need, context, terms, stat)
        class(element_kind_type), intent(inout) :: self
        integer, intent(in) :: need
        type(context_type), intent(inout) :: context
        type(terms_type), intent(inout) :: terms
        integer, intent(inout) :: stat
    end subroutine add_no_rows

    !> Lock or free the row of an element that can be freed, at the poses of the context.
    pure subroutine lock_nothing(self, number, locks, context)
        class(element_kind_type), intent(inout) :: self
        integer, intent(in) :: number
        logical, intent(in) :: locks
        type(context_type), intent(in) :: context
    end subroutine lock_nothing

    !> Append the quantities of a sensor of an element. The last one is the power of forces without a potential.
    subroutine no_quantities(self, sensor, list)
        class(element_kind_type), intent(in) :: self
        type(sensor_type), intent(in) :: sensor
        type(quantity_type), allocatable, intent(inout) :: list(:)
    end subroutine no_quantities

    !> Values of these quantities, without gaps, at the poses and rates of the context. For files, not for steps.
    pure subroutine measure_nothing(self, number, context, lambda, values, power)
        class(element_kind_type), intent(inout) :: self
        integer, intent(in) :: number
        type(context_type), intent(inout) :: context
        !> Multipliers; may be empty if the element does not need them.
        real(wp), intent(in) :: lambda(:)
        real(wp), intent(out) :: values(most_measured)
        !> Power of the part of the force without a potential (W), negative for a damper.
        real(wp), intent(out) :: power

        values = 0.0_wp
        power = 0.0_wp
    end subroutine measure_nothing

    !> List the names of the three numbers of an element that events may set, blank if there are none. gfortran 12 fails on a
    !> function with this result.
    pure subroutine no_settings(names)
        character(len=9), intent(out) :: names(3)

        names = ''
    end subroutine no_settings
end module tandem_mechanism_element_kind
