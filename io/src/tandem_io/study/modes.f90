! SPDX-License-Identifier: MIT
!> Root loci: the eigenvalues of a linearised scene as functions of one of its parameters, and the critical values of the parameter
!> at which eigenvalues cross the imaginary axis.
!>
!> Critical values are found between two samples in three ways:
!> - Real eigenvalue. The product of all eigenvalues changes its sign if a real eigenvalue passes zero, or if two real eigenvalues
!>   of opposite signs meet at zero and become a pair on the axis. The product is followed because it depends smoothly on the
!>   parameter, unlike the eigenvalues.
!> - Pair. A pair that has passed the axis is matched with the nearest pair of the other sample. If the followed pair jumps, the
!>   match was wrong.
!> - Two pairs. In systems without damping, two pairs on the axis may meet and leave it on both sides (Krein, 1950). The square of
!>   half their difference is smooth and changes its sign.
!>
!> If the number of growing eigenvalues changes in another way, the interval is halved. Two crossings in opposite directions between
!> two samples are not detected.
module tandem_io_study_modes
    use tandem, only: atom_type, bracket_type, error_type, linearisation_type, of_motion, set_error, simulation_type, wp
    use tandem_io_scene, only: interpret_scene, open_scene, scene_type
    use tandem_io_scene_description, only: description_type
    use tandem_io_scene_registry, only: scene_model_type
    use tandem_status, only: status_output_failed
    implicit none (type, external)
    private

    public :: modes_type, locus_point_type, critical_type, at_zero, at_pair, at_meeting, crossing_name

    !> Crossings of the axis: a real eigenvalue at zero, a pair (Hopf), or a collision of two pairs on the axis (Krein).
    integer, parameter :: at_zero = 1, at_pair = 2, at_meeting = 3
    character(len=5), parameter :: crossing_name(3) = [character(len=5) :: 'zero', 'hopf', 'krein']
    !> Largest number of halvings of an interval; largest number of samples per critical value.
    integer, parameter :: deepest = 8, most_points = 80
    !> Width of the final bracket of a critical value, relative to the value or to the interval.
    real(wp), parameter :: finest = 1.0e-13_wp
    !> Largest change of a followed function over the final bracket, relative to its values; a larger change is a jump.
    real(wp), parameter :: smooth = 1.0e-4_wp

    !> Eigenvalues at one value of the parameter.
    type :: locus_point_type
        real(wp) :: value = 0.0_wp
        !> Kind of the linearisation, see `linearisation_type`.
        integer :: kind = 0
        !> All eigenvalues in order, their causes and errors.
        complex(wp), allocatable :: values(:)
        integer, allocatable :: cause(:)
        real(wp), allocatable :: error(:)
    end type locus_point_type

    !> A parameter value at which stability changes.
    type :: critical_type
        real(wp) :: value = 0.0_wp
        !> `at_zero`, `at_pair` or `at_meeting`; critical eigenvalue.
        integer :: crossing = 0
        complex(wp) :: eigenvalue = (0.0_wp, 0.0_wp)
        !> True if the eigenvalue grows for larger values of the parameter, false if it grows for smaller ones.
        logical :: grows_beyond = .false.
        !> Half the width of the final bracket, plus the effect of the errors of the eigenvalues.
        real(wp) :: uncertainty = 0.0_wp
    end type critical_type

    type :: modes_type
        !> Path of the scene, settings of the command line, and key of the varied parameter.
        character(len=:), allocatable :: path, key, settings(:)
        type(scene_model_type), allocatable :: models(:)
        !> Keys of the scene; the varied key is the last setting.
        type(description_type), private :: keys
        !> Samples, and critical values, each in ascending order of the parameter.
        type(locus_point_type), allocatable :: points(:)
        type(critical_type), allocatable :: critical(:)
    contains
        procedure :: open, sample, find_critical, write_csv
        procedure, private :: search, find_zero, interpolate, find_pairs, refine_pair, find_collision
    end type modes_type

contains

    !> Read the scene and check it.
    subroutine open(self, value, error)
        class(modes_type), intent(inout) :: self
        !> First value of the parameter.
        real(wp), intent(in) :: value
        type(error_type), allocatable, intent(out) :: error
        type(scene_type), allocatable :: scene
        character(len=24) :: number

        allocate (scene)
        call open_scene(self%path, self%settings, self%models, self%keys, error)
        if (allocated(error)) return
        write (number, '(es24.16)') value
        call self%keys%apply(self%key//'='//trim(adjustl(number)), error)
        if (.not. allocated(error)) call interpret_scene(self%keys, self%models, scene, error)
    end subroutine open

    !> Compute the eigenvalues at a value of the parameter.
    subroutine sample(self, value, point, error)
        class(modes_type), intent(in) :: self
        real(wp), intent(in) :: value
        type(locus_point_type), intent(out) :: point
        type(error_type), allocatable, intent(out) :: error
        type(scene_type), allocatable, target :: scene
        type(simulation_type), allocatable :: simulation
        type(linearisation_type) :: it
        type(description_type) :: keys

        allocate (scene, simulation)
        keys = self%keys
        call keys%change(keys%n_settings(), 0, atom_type(number=value))
        call interpret_scene(keys, self%models, scene, error, is_brief=.true.)
        if (allocated(error)) return
        call simulation%initialize(scene%model, scene%options, scene%t_start, scene%q, scene%qd, error, scene%assembly)
        if (allocated(error)) return
        call it%make(scene%model, simulation%state%t, simulation%state%q, simulation%state%qd, error)
        if (allocated(error)) return
        point%value = value
        point%kind = it%kind
        point%values = it%spectrum%values
        point%cause = it%spectrum%cause
        point%error = it%spectrum%error
    end subroutine sample

    !> Find all critical values between the samples.
    subroutine find_critical(self, error)
        class(modes_type), intent(inout) :: self
        type(error_type), allocatable, intent(out) :: error
        integer :: i, last, n(size(self%points))

        allocate (self%critical(0))
        n = [(count(self%points(i)%cause == of_motion), i=1, size(n))]
        last = 1
        do i = 2, size(n)
            ! At a critical value, an eigenvalue is classified as zero and not as part of the motion. Skip such a sample; the
            ! interval between its neighbours contains the critical value.
            if (i < size(n)) then
                if (n(i) < min(n(i - 1), n(i + 1))) cycle
            end if
            call self%search(self%points(last), self%points(i), 0, error)
            if (allocated(error)) return
            last = i
        end do
    end subroutine find_critical

    !> Find the critical values between two samples.
    recursive subroutine search(self, a, b, depth, error)
        class(modes_type), intent(inout) :: self
        type(locus_point_type), intent(in) :: a, b
        integer, intent(in) :: depth
        type(error_type), allocatable, intent(out) :: error
        type(locus_point_type) :: middle
        type(critical_type) :: found(size(a%values) + 1)
        integer :: n, change

        if (a%kind /= b%kind .and. min(a%kind, b%kind) == 3) return
        n = 0
        change = 0
        if (product_sign(a)*product_sign(b) < 0) then
            call self%find_zero(a, b, found, n, change, error)
            if (allocated(error)) return
        end if
        call self%find_pairs(a, b, found, n, change, error)
        if (allocated(error)) return
        if (abs(growing(b) - growing(a) - change) == 2) then
            call self%find_collision(a, b, found, n, change, error)
            if (allocated(error)) return
        end if
        if (change /= growing(b) - growing(a) .and. depth < deepest) then
            call self%sample((a%value + b%value)/2, middle, error)
            if (.not. allocated(error)) call self%search(a, middle, depth + 1, error)
            if (.not. allocated(error)) call self%search(middle, b, depth + 1, error)
            return
        end if
        call sort(found(:n))
        self%critical = [self%critical, found(:n)]
    end subroutine search

    !> Sort critical values in ascending order.
    pure subroutine sort(found)
        type(critical_type), intent(inout) :: found(:)
        type(critical_type) :: swap
        integer :: i, k

        do i = 1, size(found) - 1
            k = i - 1 + minloc(found(i:)%value, dim=1)
            swap = found(i)
            found(i) = found(k)
            found(k) = swap
        end do
    end subroutine sort

    !> Number of eigenvalues whose real part is positive by more than its error.
    pure integer function growing(point)
        type(locus_point_type), intent(in) :: point

        growing = count(point%cause == of_motion .and. real(point%values, wp) > point%error)
    end function growing

    !> Sign of the product of the eigenvalues of the motion.
    pure integer function product_sign(point)
        type(locus_point_type), intent(in) :: point

        product_sign = 1 - 2*modulo(count(point%cause == of_motion .and. .not. abs(aimag(point%values)) > 0.0_wp .and. &
            real(point%values, wp) < 0.0_wp), 2)
    end function product_sign

    !> Product of the eigenvalues of the motion, divided by the product at another sample; zero if an eigenvalue is classified as
    !> zero.
    pure real(wp) function product_of(point, other) result(value)
        type(locus_point_type), intent(in) :: point, other
        real(wp), parameter :: largest = 300.0_wp

        value = 0.0_wp
        if (count(point%cause == of_motion) < count(other%cause == of_motion)) return
        ! The product of many eigenvalues would overflow; its logarithm does not.
        value = sum(log(abs(point%values)), point%cause == of_motion) - sum(log(abs(other%values)), other%cause == of_motion)
        value = product_sign(point)*exp(min(max(value, -largest), largest))
    end function product_of

    !> Find the value at which a real eigenvalue passes zero.
    subroutine find_zero(self, a, b, found, n, change, error)
        class(modes_type), intent(in) :: self
        type(locus_point_type), intent(in) :: a, b
        type(critical_type), intent(inout) :: found(:)
        !> Number of critical values found, and total change of the number of growing eigenvalues at them.
        integer, intent(inout) :: n, change
        type(error_type), allocatable, intent(out) :: error
        type(bracket_type) :: bracket
        type(locus_point_type) :: point
        real(wp) :: x, value, slope, rounding
        integer :: i, n_motion, n_real

        n_motion = count(a%cause == of_motion)
        if (count(b%cause == of_motion) /= n_motion) return
        bracket%a = a%value
        bracket%b = b%value
        bracket%value_a = product_of(a, a)
        bracket%value_b = product_of(b, a)
        slope = 0.0_wp
        rounding = max(error_of_product(a, a), error_of_product(b, a))
        do i = 1, most_points
            call update_slope(bracket, b%value - a%value, slope)
            if (is_narrow(bracket, a, b)) exit
            x = bracket%next_point()
            call self%sample(x, point, error)
            if (allocated(error)) return
            value = product_of(point, a)
            if (.not. abs(value) > 0.0_wp) exit
            rounding = error_of_product(point, a)
            call bracket%narrow(x, value)
        end do
        n = n + 1
        found(n)%value = (bracket%a + bracket%b)/2
        found(n)%uncertainty = (bracket%b - bracket%a)/2 + rounding/abs(slope)
        if (.not. is_narrow(bracket, a, b)) call self%interpolate(x, bracket, a, found(n), error)
        if (allocated(error)) return
        found(n)%crossing = at_zero
        ! The change of the number of growing real eigenvalues determines the direction of the crossing.
        n_real = real_growing(b) - real_growing(a)
        found(n)%grows_beyond = n_real > 0
        change = change + sign(1, n_real)
    end subroutine find_zero

    !> Error of the product of eigenvalues divided by the product at another sample.
    pure real(wp) function error_of_product(point, other) result(error)
        type(locus_point_type), intent(in) :: point, other

        error = abs(product_of(point, other))*sum(point%error/abs(point%values), mask=point%cause == of_motion)
    end function error_of_product

    !> Update the slope of the followed function while the bracket is so wide that rounding is negligible.
    pure subroutine update_slope(bracket, whole, slope)
        type(bracket_type), intent(in) :: bracket
        !> Initial width of the bracket.
        real(wp), intent(in) :: whole
        real(wp), intent(inout) :: slope
        real(wp), parameter :: least = 1.0e-5_wp

        if (bracket%b - bracket%a < least*whole) return
        slope = (bracket%value_b - bracket%value_a)/(bracket%b - bracket%a)
    end subroutine update_slope

    !> Interpolate the critical value. Near zero, an eigenvalue is classified as zero, so that the product cannot be evaluated.
    !> Therefore the parameter is interpolated between four samples, as a cubic function of the product. The difference from a
    !> quadratic interpolation is the uncertainty.
    subroutine interpolate(self, x, bracket, other, found, error)
        class(modes_type), intent(in) :: self
        !> Value of the parameter at which an eigenvalue is classified as zero.
        real(wp), intent(in) :: x
        type(bracket_type), intent(in) :: bracket
        !> Sample whose product divides the other products.
        type(locus_point_type), intent(in) :: other
        type(critical_type), intent(inout) :: found
        type(error_type), allocatable, intent(out) :: error
        real(wp), parameter :: point_at(4) = [-2.0_wp, -1.0_wp, 1.0_wp, 2.0_wp]
        type(locus_point_type) :: point
        real(wp) :: values(4), delta, rounding
        integer :: i

        delta = min(x - bracket%a, bracket%b - x, 1.0e-3_wp*max(abs(bracket%a), abs(bracket%b)))/2
        found%value = x
        found%uncertainty = delta
        rounding = 0.0_wp
        do i = 1, 4
            call self%sample(x + point_at(i)*delta, point, error)
            if (allocated(error)) return
            values(i) = product_of(point, other)
            rounding = max(rounding, error_of_product(point, other))
        end do
        ! The samples do not enclose the zero if it is too close to an end of the interval.
        if (any(abs(values) <= 0.0_wp) .or. values(2)*values(3) > 0.0_wp) return
        found%value = x + delta*lagrange(values, point_at)
        ! The interpolation weights of the two inner values add up to 4/3, those of the outer values to 1/3.
        found%uncertainty = abs(delta)*(abs(lagrange(values, point_at) - lagrange(values(:3), point_at(:3))) + &
            2*rounding*abs(point_at(3) - point_at(2))/abs(values(3) - values(2)))
    end subroutine interpolate

    !> Value at zero of the polynomial through the points (values, points).
    pure real(wp) function lagrange(values, points) result(point_at)
        real(wp), intent(in) :: values(:), points(:)
        real(wp) :: weight
        integer :: i, k

        point_at = 0.0_wp
        do i = 1, size(values)
            weight = points(i)
            do k = 1, size(values)
                if (k /= i) weight = weight*values(k)/(values(k) - values(i))
            end do
            point_at = point_at + weight
        end do
    end function lagrange

    !> Number of growing real eigenvalues.
    pure integer function real_growing(point)
        type(locus_point_type), intent(in) :: point

        real_growing = count(point%cause == of_motion .and. .not. abs(aimag(point%values)) > 0.0_wp .and. &
            real(point%values, wp) > 0.0_wp)
    end function real_growing

    !> Find values at which pairs cross the imaginary axis.
    subroutine find_pairs(self, a, b, found, n, change, error)
        class(modes_type), intent(in) :: self
        type(locus_point_type), intent(in) :: a, b
        type(critical_type), intent(inout) :: found(:)
        integer, intent(inout) :: n, change
        type(error_type), allocatable, intent(out) :: error
        logical :: is_free(size(b%values)), is_crossing
        integer :: i, k

        is_free = b%cause == of_motion .and. aimag(b%values) > 0.0_wp
        do i = 1, size(a%values)
            if (a%cause(i) /= of_motion .or. .not. aimag(a%values(i)) > 0.0_wp .or. .not. any(is_free)) cycle
            k = minloc(abs(b%values - a%values(i)), dim=1, mask=is_free)
            is_free(k) = .false.
            if (min(abs(real(a%values(i), wp)) - a%error(i), abs(real(b%values(k), wp)) - b%error(k)) <= 0.0_wp) cycle
            if ((real(a%values(i), wp) > 0.0_wp) .eqv. (real(b%values(k), wp) > 0.0_wp)) cycle
            call self%refine_pair(a, b, a%values(i), b%values(k), found(n + 1), is_crossing, error)
            if (allocated(error)) return
            if (.not. is_crossing) cycle
            n = n + 1
            change = change + merge(2, -2, found(n)%grows_beyond)
        end do
    end subroutine find_pairs

    !> Find the value at which the real part of a pair vanishes. The pair is followed from both ends of the interval.
    subroutine refine_pair(self, a, b, value_a, value_b, found, is_crossing, error)
        class(modes_type), intent(in) :: self
        type(locus_point_type), intent(in) :: a, b
        complex(wp), intent(in) :: value_a, value_b
        type(critical_type), intent(inout) :: found
        !> True for a crossing; false if a jump shows that two different pairs were matched.
        logical, intent(out) :: is_crossing
        type(error_type), allocatable, intent(out) :: error
        type(bracket_type) :: bracket
        type(locus_point_type) :: point
        complex(wp) :: at_a, at_b, expected, value
        real(wp) :: x, slope, rounding
        integer :: i, k

        is_crossing = .false.
        slope = 0.0_wp
        rounding = max(a%error(minloc(abs(a%values - value_a), dim=1)), b%error(minloc(abs(b%values - value_b), dim=1)))
        at_a = value_a
        at_b = value_b
        value = (at_a + at_b)/2
        bracket%a = a%value
        bracket%b = b%value
        bracket%value_a = real(at_a, wp)
        bracket%value_b = real(at_b, wp)
        do i = 1, most_points
            call update_slope(bracket, b%value - a%value, slope)
            if (is_narrow(bracket, a, b)) exit
            x = bracket%next_point()
            call self%sample(x, point, error)
            if (allocated(error)) return
            expected = at_a + (x - bracket%a)/(bracket%b - bracket%a)*(at_b - at_a)
            k = minloc(abs(point%values - expected), dim=1, mask=point%cause == of_motion)
            value = point%values(k)
            rounding = point%error(k)
            call bracket%narrow(x, real(value, wp))
            if (bracket%a >= x) at_a = value
            if (bracket%b <= x) at_b = value
        end do
        is_crossing = abs(bracket%value_b - bracket%value_a) <= rounding + smooth*(abs(real(value_a, wp)) + abs(real(value_b, wp)))
        found%value = (bracket%a + bracket%b)/2
        found%uncertainty = (bracket%b - bracket%a)/2 + rounding/abs(slope)
        found%crossing = at_pair
        found%eigenvalue = cmplx(0.0_wp, abs(aimag(value)), wp)
        found%grows_beyond = bracket%value_b > 0.0_wp
    end subroutine refine_pair

    !> Find the value at which two pairs on the imaginary axis meet and leave it, or return to it. At one end of the interval both
    !> pairs are neutral; at the other end one pair grows, and the other decays at the same rate and has the same frequency.
    subroutine find_collision(self, a, b, found, n, change, error)
        class(modes_type), intent(in) :: self
        type(locus_point_type), intent(in) :: a, b
        type(critical_type), intent(inout) :: found(:)
        integer, intent(inout) :: n, change
        type(error_type), allocatable, intent(out) :: error
        type(bracket_type) :: bracket
        type(locus_point_type) :: point
        complex(wp) :: at_a, at_b, centre
        real(wp) :: x, square, slope, rounding
        logical :: grows_beyond
        integer :: i, k

        grows_beyond = growing(b) > growing(a)
        if (grows_beyond) then
            k = fastest_pair(b)
        else
            k = fastest_pair(a)
        end if
        if (k == 0) return
        if (grows_beyond) then
            at_b = cmplx(0.0_wp, aimag(b%values(k)), wp)
            at_a = at_b
        else
            at_a = cmplx(0.0_wp, aimag(a%values(k)), wp)
            at_b = at_a
        end if
        slope = 0.0_wp
        call measure_two_pairs(a, at_a, bracket%value_a, rounding)
        call measure_two_pairs(b, at_b, bracket%value_b, rounding)
        if (.not. bracket%value_a*bracket%value_b < 0.0_wp .or. (bracket%value_b > 0.0_wp .neqv. grows_beyond)) return
        bracket%a = a%value
        bracket%b = b%value
        do i = 1, most_points
            call update_slope(bracket, b%value - a%value, slope)
            if (is_narrow(bracket, a, b)) exit
            x = bracket%next_point()
            call self%sample(x, point, error)
            if (allocated(error)) return
            centre = at_a + (x - bracket%a)/(bracket%b - bracket%a)*(at_b - at_a)
            call measure_two_pairs(point, centre, square, rounding)
            call bracket%narrow(x, square)
            if (bracket%a >= x) at_a = centre
            if (bracket%b <= x) at_b = centre
        end do
        n = n + 1
        found(n)%value = (bracket%a + bracket%b)/2
        found(n)%uncertainty = (bracket%b - bracket%a)/2 + rounding/abs(slope)
        found(n)%crossing = at_meeting
        found(n)%eigenvalue = cmplx(0.0_wp, aimag(at_a + at_b)/2, wp)
        found(n)%grows_beyond = grows_beyond
        change = change + merge(2, -2, grows_beyond)
    end subroutine find_collision

    !> Index of the growing pair with the largest growth rate, with positive imaginary part; 0 if there is none.
    pure integer function fastest_pair(point)
        type(locus_point_type), intent(in) :: point
        logical :: grows(size(point%values))

        fastest_pair = 0
        grows = point%cause == of_motion .and. aimag(point%values) > 0.0_wp .and. real(point%values, wp) > point%error
        if (any(grows)) fastest_pair = maxloc(real(point%values, wp), dim=1, mask=grows)
    end function fastest_pair

    !> For the two eigenvalues above the real axis nearest to `centre`, compute their mean `centre` and the square of half their
    !> difference. The square is negative for two eigenvalues on the imaginary axis, and positive for two on either side of it.
    pure subroutine measure_two_pairs(point, centre, square, rounding)
        type(locus_point_type), intent(in) :: point
        complex(wp), intent(inout) :: centre
        !> The square and its error.
        real(wp), intent(out) :: square, rounding
        logical :: is_free(size(point%values))
        complex(wp) :: two(2)
        real(wp) :: errors(2)
        integer :: i, k

        square = 0.0_wp
        rounding = 0.0_wp
        is_free = point%cause == of_motion .and. aimag(point%values) > 0.0_wp
        if (count(is_free) < 2) return
        do i = 1, 2
            k = minloc(abs(point%values - centre), dim=1, mask=is_free)
            two(i) = point%values(k)
            errors(i) = point%error(k)
            is_free(k) = .false.
        end do
        square = real(((two(1) - two(2))/2)**2, wp)
        rounding = abs(two(1) - two(2))*sum(errors)/2 + sum(errors)**2/4
        centre = (two(1) + two(2))/2
    end subroutine measure_two_pairs

    !> True if a bracket is as narrow as possible.
    pure logical function is_narrow(bracket, a, b)
        type(bracket_type), intent(in) :: bracket
        type(locus_point_type), intent(in) :: a, b

        is_narrow = abs(bracket%b - bracket%a) <= finest*max(abs(bracket%a), abs(bracket%b), b%value - a%value)
    end function is_narrow

    !> Write all eigenvalues as lines `value,re,im,cause`.
    subroutine write_csv(self, file, error)
        class(modes_type), intent(in) :: self
        character(len=*), intent(in) :: file
        type(error_type), allocatable, intent(out) :: error
        character(len=8), parameter :: cause(3) = [character(len=8) :: 'motion', 'symmetry', 'family']
        integer :: unit, stat, i, k
        character(len=200) :: message

        message = ''
        open (newunit=unit, file=file, action='write', status='replace', iostat=stat, iomsg=message)
        if (stat == 0) write (unit, '(a)', iostat=stat, iomsg=message) 'value,re,im,cause'
        do i = 1, size(self%points)
            do k = 1, size(self%points(i)%values)
                if (stat /= 0) exit
                associate (value => self%points(i)%values(k))
                    write (unit, '(2(es24.16, ","), es24.16, ",", a)', iostat=stat, iomsg=message) self%points(i)%value, &
                        real(value, wp), aimag(value), trim(cause(self%points(i)%cause(k)))
                end associate
            end do
        end do
        if (stat == 0) close (unit, iostat=stat, iomsg=message)
        if (stat /= 0) call set_error(error, status_output_failed, 'cannot write '//file//': '//trim(message))
    end subroutine write_csv
end module tandem_io_study_modes
