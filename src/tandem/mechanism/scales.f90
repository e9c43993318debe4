! SPDX-License-Identifier: MIT
!> Natural scales of a mechanism, derived from its own dimensions, so that runs take the same steps in any system of units.
submodule(tandem_mechanism) tandem_mechanism_scales
    use tandem_error, only: to_text
    use tandem_mechanism_coordinate, only: pi
    use tandem_mechanism_point_vector, only: point_vector_type
    implicit none (type, external)

    !> Accumulator for a geometric mean.
    type :: mean_type
        real(wp) :: total = 0.0_wp
        integer :: n = 0
    end type mean_type

contains

    module procedure set_scales
        type(constraint_type), allocatable :: rows(:)
        integer :: i

        self%size_of_bodies = typical_length(self)
        self%coordinate_scale = spread(1.0_wp, 1, self%n)
        do i = 1, size(self%first) - 1
            associate (scale => self%coordinate_scale(self%first(i):self%first(i + 1) - 1))
                ! The displacement of a massless wheel is a length.
                if (i > size(self%bodies)) then
                    scale = self%size_of_bodies
                else
                    scale(:merge(2, 3, self%planar)) = self%size_of_bodies
                end if
            end associate
        end do
        allocate (rows, source=rows_of_kinds(self, self%size_of_bodies))
        do i = 1, size(rows)
            if (rows(i)%slide > 0) call scale_slide(self, rows(i)%slide, rows(i)%scale)
        end do
        if (.not. (self%planar .and. any(self%bodies%turns))) return
        self%coordinate_period = spread(0.0_wp, 1, self%n)
        do i = 1, size(self%bodies)
            if (self%bodies(i)%turns) self%coordinate_period(self%first(i) + 2) = 2*pi
        end do
    end procedure set_scales

    !> Set the scale of the coordinate of an element, and the mass of a slack.
    subroutine scale_slide(self, pose, unit)
        class(mechanism_type), intent(inout) :: self
        integer, intent(in) :: pose
        real(wp), intent(in) :: unit
        real(wp) :: mass

        associate (slide => self%slides(pose - size(self%bodies)), scale => self%coordinate_scale(self%first(pose)))
            scale = unit
            if (.not. slide%is_slack) return
            mass = sum(self%bodies%mass)/size(self%bodies)*(self%size_of_bodies/unit)**2
            if (mass > 0.0_wp .and. mass <= huge(1.0_wp)) then
                slide%inertia = mass
            else
                scale = 1.0_wp
            end if
        end associate
    end subroutine scale_slide

    module procedure check_inertias
        real(wp), parameter :: rounding = 1.0e-9_wp
        logical :: is_impossible(size(self%bodies))
        character(len=:), allocatable :: others
        integer :: i, k

        if (self%planar) return
        do i = 1, size(self%bodies)
            associate (j => self%bodies(i)%inertia)
                is_impossible(i) = 2*max(j(1, 1), j(2, 2), j(3, 3)) > (j(1, 1) + j(2, 2) + j(3, 3))*(1 + rounding)
            end associate
        end do
        k = findloc(is_impossible, .true., dim=1)
        if (k == 0) return
        others = ''
        if (count(is_impossible) > 1) others = ', as '//to_text(count(is_impossible) - 1)//' others,'
        self%warning = 'body '//trim(self%bodies(k)%name)//others// &
            ' has a moment of inertia that is larger than the sum of the two others, which is impossible: check the three values'
    end procedure check_inertias

    !> Time scale: about half a period of a pendulum of typical length. Without gravity it is the time in which bodies and drives
    !> move by 4 rad, or by four lengths, with their initial rates and accelerations. If these are only rounding errors of springs
    !> in balance, it follows from the springs.
    module procedure set_time_scale
        real(wp), parameter :: rounding = 1.0e-6_wp, way = 4.0_wp
        real(wp) :: rate, swing

        if (norm2(self%gravity) > 0.0_wp) then
            rate = sqrt(norm2(self%gravity)/self%size_of_bodies)
        else
            rate = max(rate_of_start(self, qd), rate_of_motions(self, t), rate_of_forces(self, t, q, qd))
            swing = rate_of_springs(self)
            if (.not. rate > rounding*swing) rate = swing
        end if
        self%time_scale = way/rate
        if (.not. (self%time_scale > 0.0_wp .and. self%time_scale <= huge(1.0_wp))) self%time_scale = 1.0_wp
    end procedure set_time_scale

    !> Largest initial velocity relative to the scales of the coordinates.
    pure real(wp) function rate_of_start(self, qd) result(rate)
        class(mechanism_type), intent(in) :: self
        real(wp), intent(in) :: qd(:)

        rate = maxval([0.0_wp, abs(qd)/self%coordinate_scale])
    end function rate_of_start

    !> Rate of the functions of time that drive joints and distances, at a given time.
    real(wp) function rate_of_motions(self, t) result(rate)
        class(mechanism_type), intent(in) :: self
        real(wp), intent(in) :: t
        type(constraint_type), allocatable :: rows(:)
        integer :: i

        rate = 0.0_wp
        do i = 1, size(self%perpendiculars)
            call add(self%perpendiculars(i)%motion, self%size_of_bodies)
        end do
        do i = 1, size(self%distances)
            call add(self%distances(i)%motion, self%size_of_bodies)
        end do
        do i = 1, size(self%angles)
            call add(self%angles(i)%motion, 1.0_wp)
        end do
        allocate (rows, source=rows_of_kinds(self, self%size_of_bodies))
        do i = 1, size(rows)
            call add(rows(i)%motion, rows(i)%scale)
        end do

    contains

        subroutine add(motion, unit)
            integer, intent(in) :: motion
            !> Scale of the driven quantity.
            real(wp), intent(in) :: unit
            real(wp) :: f(0:2)

            if (motion == 0) return
            call self%motions(motion)%f%evaluate(t, f)
            if (all(abs(f) <= huge(1.0_wp))) rate = max(rate, abs(f(1))/unit, sqrt(abs(f(2))/unit))
        end subroutine add
    end function rate_of_motions

    !> Rate of the motion that the forces would cause without constraints.
    real(wp) function rate_of_forces(self, t, q, qd) result(rate)
        class(mechanism_type), intent(inout) :: self
        real(wp), intent(in) :: t, q(:), qd(:)
        type(terms_type) :: terms
        real(wp) :: inertia
        integer :: i, last, stat

        rate = 0.0_wp
        if (iand(self%provides, need_force) == 0) return
        allocate (terms%force(self%n), source=0.0_wp)
        terms%is_compressed = self%is_compressed
        stat = 0
        call self%evaluate(need_force, t, q, qd, terms, stat)
        if (stat /= 0) return
        do i = 1, size(self%bodies)
            associate (body => self%bodies(i), first => self%first(i), turn => self%first(i) + merge(2, 3, self%planar))
                last = self%first(i + 1) - 1
                if (body%mass > 0.0_wp) call add(norm2(terms%force(first:turn - 1)), body%mass*self%size_of_bodies)
                ! Inertia of Euler parameters: that of 4 J.
                inertia = merge(body%inertia(3, 3), 4*(body%inertia(1, 1) + body%inertia(2, 2) + body%inertia(3, 3)), self%planar)
                if (last >= turn .and. inertia > 0.0_wp) call add(norm2(terms%force(turn:last)), inertia)
            end associate
        end do

    contains

        subroutine add(force, mass)
            real(wp), intent(in) :: force, mass

            if (force <= huge(1.0_wp)) rate = max(rate, sqrt(force/mass))
        end subroutine add
    end function rate_of_forces

    !> Rate of oscillations of the bodies on linear springs.
    pure real(wp) function rate_of_springs(self) result(rate)
        class(mechanism_type), intent(in) :: self
        real(wp) :: mass, inertia, square
        integer :: i, k

        mass = maxval(self%bodies%mass)
        inertia = max(mass*self%size_of_bodies**2, tiny(1.0_wp))
        mass = max(mass, tiny(1.0_wp))
        square = 0.0_wp
        do k = 1, size(self%kinds)
            do i = 1, self%kinds(k)%of%n
                associate (it => self%kinds(k)%of%attachment(i))
                    square = max(square, it%stiffness(1)/mass, it%stiffness(2)/inertia)
                end associate
            end do
        end do
        rate = sqrt(square)
    end function rate_of_springs

    module procedure set_magnitudes
        integer :: i, turn

        magnitude = q
        if (.not. self%planar) return
        do i = 1, size(self%bodies)
            if (.not. self%bodies(i)%turns) cycle
            turn = self%first(i) + 2
            associate (place => magnitude(turn - 2:turn - 1))
                place = max(abs(place), self%size_of_bodies*abs(q(turn)))
            end associate
        end do
    end procedure set_magnitudes

    !> Elements that act along the line between two points.
    subroutine list_lines(self, lines)
        class(mechanism_type), intent(in) :: self
        type(point_vector_type), allocatable, intent(out) :: lines(:)
        integer :: i, k, n

        allocate (lines(sum([(self%kinds(k)%of%n, k=1, size(self%kinds))])))
        n = 0
        do k = 1, size(self%kinds)
            do i = 1, self%kinds(k)%of%n
                associate (it => self%kinds(k)%of%attachment(i))
                    if (.not. it%is_line) exit
                    n = n + 1
                    lines(n) = point_vector_type(first=it%body(1), second=it%body(2), s1=it%point(:, 1), s2=it%point(:, 2))
                end associate
            end do
        end do
        lines = lines(:n)
    end subroutine list_lines

    !> Geometric mean of the sizes of bodies and of the distances between their points, which is insensitive to a few parts of
    !> different size. For point masses only: lengths of springs, else distances between the bodies, else distances from the origin.
    function typical_length(self) result(length)
        class(mechanism_type), intent(in) :: self
        real(wp) :: length
        type(mean_type) :: mean
        type(point_vector_type), allocatable :: lines(:)
        real(wp) :: extents(0:size(self%bodies))
        integer :: i, j

        extents = 0.0_wp
        call list_lines(self, lines)
        do i = 1, size(self%bodies)
            associate (body => self%bodies(i))
                if (.not. (body%turns .and. body%mass > 0.0_wp)) cycle
                extents(i) = sqrt(max(maxval([(body%inertia(j, j), j=1, 3)]), 0.0_wp)/body%mass)
            end associate
        end do
        do i = 1, size(self%coincidences)
            call extend(self%coincidences(i))
        end do
        do i = 1, size(self%distances)
            call extend(self%distances(i))
        end do
        do i = 1, size(lines)
            call extend(lines(i))
        end do
        do i = 1, size(self%perpendiculars)
            associate (perpendicular => self%perpendiculars(i))
                if (perpendicular%is_point) extents(perpendicular%second) = max(extents(perpendicular%second), &
                    norm2(perpendicular%b))
            end associate
        end do
        do i = 1, size(self%bodies)
            call add(extents(i))
        end do
        do i = 1, size(self%distances)
            call add(self%reference_length(self%distances(i)))
        end do
        if (mean%n == 0) then
            do i = 1, size(lines)
                call add(self%reference_length(lines(i)))
            end do
        end if
        if (mean%n == 0) then
            do i = 2, size(self%bodies)
                call add(norm2(self%bodies(i)%position - self%bodies(1)%position))
            end do
        end if
        if (mean%n == 0) then
            do i = 1, size(self%bodies)
                call add(norm2(self%bodies(i)%position))
            end do
        end if
        length = 1.0_wp
        if (mean%n > 0) length = exp(mean%total/real(mean%n, wp))

    contains

        !> Extend the sizes of two bodies to their points of a point-to-point vector.
        subroutine extend(vector)
            type(point_vector_type), intent(in) :: vector

            extents(vector%first) = max(extents(vector%first), norm2(vector%s1))
            extents(vector%second) = max(extents(vector%second), norm2(vector%s2))
        end subroutine extend

        subroutine add(x)
            real(wp), intent(in) :: x

            if (.not. (x > 0.0_wp .and. x <= huge(1.0_wp))) return
            mean%total = mean%total + log(x)
            mean%n = mean%n + 1
        end subroutine add
    end function typical_length
end submodule tandem_mechanism_scales
