! SPDX-License-Identifier: MIT
!> Assembly of reliable starts: finds the consistent state nearest to a given one, with fixed and weighted entries, in bounded work.
!> Reports the displacement of each coordinate or, if there is no consistent state close enough, the constraint that causes the
!> failure.
module tandem_simulate_assembly
    use tandem_error, only: error_type, set_error, to_text
    use tandem_kinds, only: wp
    use tandem_model, only: label_length, model_type
    use tandem_model_check, only: check_model
    use tandem_model_evaluator, only: evaluator_type
    use tandem_model_segment, only: find_segment
    use tandem_simulate_nearest_position, only: nearest_position_type
    use tandem_simulate_nearest_velocity, only: nearest_velocity_type
    use tandem_status, only: status_inconsistent_start, status_invalid_option, status_of, status_ok, status_type
    use tandem_model_counts, only: counts_type
    use tandem_model_terms, only: need_phi
    use, intrinsic :: ieee_arithmetic, only: ieee_is_finite
    implicit none (type, external)
    private

    public :: assembly_type, assemble, velocity_metrics

    !> Values of `assembly_type%velocity_metric`.
    character(len=8), parameter :: velocity_metrics(2) = [character(len=8) :: 'mass', 'weights']

    !> Options and results of an assembly.
    type :: assembly_type
        !> Positive weights of the coordinates and velocities (n) in the squared distance; default 1/coordinate_scale**2.
        real(wp), allocatable :: weight_q(:), weight_qd(:)
        !> True for coordinates and velocities that keep their values (n); none by default.
        logical, allocatable :: fixed_q(:), fixed_qd(:)
        !> Metric in which the velocity is nearest: `mass`, where the weights apply to directions without mass, or `weights`.
        character(len=8) :: velocity_metric = 'mass'
        !> Largest changes of a coordinate and of a velocity, in units of coordinate_scale (and per unit of time); 0 for no limit.
        real(wp) :: largest_move_q = 1.0_wp, largest_move_qd = 0.0_wp
        !> Largest residual of a satisfied constraint, on its natural scale.
        real(wp) :: tolerance = 1.0e-12_wp
        !> Largest number of trial positions.
        integer :: iteration_limit = 200
        !> Resulting changes of q and qd (n).
        real(wp), allocatable :: moved_q(:), moved_qd(:)
        !> Rows of C with the largest contributions to the changes of q and qd, in units of coordinate_scale; 0 if nothing changed.
        integer :: row_q = 0, row_qd = 0
        !> Number of trial positions; true if q is known to be a local minimum of the distance.
        integer :: iterations = 0
        logical :: is_nearest = .false.
        !> Counters of the evaluations of the model's terms.
        type(counts_type) :: counts
    end type assembly_type

contains

    !> Move (q, qd) to the nearest consistent state at t, in the segment of the model that contains or begins at t. Errors:
    !> invalid_model, invalid_option, inconsistent_start, callback_failed, not_evaluable, not_finite; q and qd are then unchanged.
    subroutine assemble(model, request, t, q, qd, error)
        class(model_type), intent(inout), target :: model
        type(assembly_type), intent(inout) :: request
        !> Time, coordinates (n), velocities (n).
        real(wp), intent(in) :: t
        real(wp), intent(inout) :: q(:), qd(:)
        type(error_type), allocatable, intent(out) :: error
        type(evaluator_type) :: evaluator
        type(nearest_position_type) :: position
        type(nearest_velocity_type) :: velocity
        logical :: fixed_q(size(q)), fixed_qd(size(q))
        real(wp) :: scale(size(q)), move(size(q)), new_q(size(q)), new_qd(size(q))
        real(wp), allocatable :: contribution(:, :)
        logical :: move_is_known
        integer :: stat

        call check_model(model, error)
        if (.not. allocated(error)) call check_request(model, request, t, q, qd, error)
        if (allocated(error)) return
        call model%set_time_scale(t, q, qd)
        request%counts = counts_type()
        request%row_q = 0
        request%row_qd = 0
        request%moved_q = spread(0.0_wp, 1, model%n)
        request%moved_qd = request%moved_q
        scale = model%scales()
        fixed_q = .false.
        if (allocated(request%fixed_q)) fixed_q = request%fixed_q
        fixed_qd = .false.
        if (allocated(request%fixed_qd)) fixed_qd = request%fixed_qd
        call find_segment(model, t, error)
        if (allocated(error)) return
        call evaluator%initialize(model)

        new_q = q
        request%iterations = 0
        call position%initialize(model%n_holonomic, fixed_q, weights(request%weight_q, scale), scale, request%tolerance, &
            request%iteration_limit)
        call approach_imposed_angles(model, request, evaluator, position, t, new_q, move, contribution, move_is_known)
        call position%find(evaluator, t, new_q, request%counts, stat)
        request%iterations = request%iterations + position%trials
        if (.not. move_is_known) then
            move = new_q - q
            contribution = position%contribution
        end if
        request%is_nearest = position%is_nearest
        if (stat == status_inconsistent_start) then
            call set_error(error, stat, 'no consistent position near the start: constraint "'// &
                model%row_name(position%failed_row)//'" remains violated by '// &
                trim(residual_text(position%failed_amount, position%failed_value))//' after '// &
                to_text(position%trials)//' iterations'// &
                trim(fixed_text(model, fixed_q)), trim(advice_for(fixed_q, 'coordinates', 'position')))
        else if (stat /= status_ok) then
            call fail(evaluator, stat, 'while the position was assembled', error)
        else
            request%row_q = dominant_row(position%contribution, scale)
            call check_move(model, contribution, move/scale, request%largest_move_q, '', error)
        end if
        if (allocated(error)) return

        new_qd = qd
        call velocity%initialize(model%n_constraints(), fixed_qd, weights(request%weight_qd, scale), scale/model%time_scale, &
            request%velocity_metric == 'mass', request%tolerance)
        call velocity%find(evaluator, t, new_q, new_qd, request%counts, stat)
        if (stat == status_inconsistent_start) then
            call set_error(error, stat, 'no velocity satisfies all constraints: "'//model%row_name(velocity%failed_row)// &
                '" remains violated by '//trim(residual_text(velocity%failed_amount, velocity%failed_value))// &
                trim(fixed_text(model, fixed_qd)), trim(advice_for(fixed_qd, 'velocities', 'velocity')))
        else if (stat /= status_ok) then
            call fail(evaluator, stat, 'while the velocity was assembled', error)
        else
            request%row_qd = dominant_row(velocity%contribution, scale)
            call check_move(model, velocity%contribution, (new_qd - qd)*(model%time_scale/scale), request%largest_move_qd, &
                'velocity of ', error)
        end if
        if (allocated(error)) return

        request%moved_q = new_q - q
        request%moved_qd = new_qd - qd
        q = new_q
        qd = new_qd
    end subroutine assemble

    !> Find the displacement of q that constraints without imposed motions require. If an imposed angle is far from its value at the
    !> start, approach it in small steps, in which Phi of the imposed rows decreases uniformly to 0. A single large Newton step
    !> could lead to another branch of the joints. If the steps fail, q is unchanged.
    subroutine approach_imposed_angles(model, request, evaluator, position, t, q, move, contribution, move_is_known)
        class(model_type), intent(in) :: model
        type(assembly_type), intent(inout) :: request
        type(evaluator_type), intent(inout) :: evaluator
        type(nearest_position_type), intent(inout) :: position
        !> Time, coordinates (n).
        real(wp), intent(in) :: t
        real(wp), intent(inout), contiguous :: q(:)
        !> Displacement of q that the other rows require, to which the limit applies (n); contribution of each row to the
        !> displacement of each coordinate (nh, n); true if both were found.
        real(wp), intent(out) :: move(:)
        real(wp), allocatable, intent(out) :: contribution(:, :)
        logical, intent(out) :: move_is_known
        !> Largest step of an angle (rad); largest number of steps.
        real(wp), parameter :: largest = 0.4_wp
        integer, parameter :: most = 1000
        real(wp) :: start(size(q)), phi(model%n_holonomic), rest
        logical :: is_imposed(model%n_holonomic), is_angle(model%n_holonomic)
        integer :: i, n, stat

        move = 0.0_wp
        move_is_known = .false.
        call model%list_imposed(is_imposed, is_angle)
        if (.not. any(is_imposed)) return
        call evaluator%evaluate(need_phi, t, q, q, request%counts, stat)
        if (stat /= status_ok) return
        phi = evaluator%terms%phi
        if (.not. maxval(abs(phi), mask=is_imposed) > 0.0_wp) return
        rest = 0.0_wp
        if (any(is_angle)) rest = maxval(abs(phi), mask=is_angle)
        n = 1
        if (rest > largest .and. rest < most*largest) n = ceiling(rest/largest)
        start = q
        do i = 0, n
            position%goal = merge(real(n - i, wp)/n*phi, 0.0_wp, is_imposed)
            call position%find(evaluator, t, q, request%counts, stat)
            request%iterations = request%iterations + position%trials
            if (stat /= status_ok) exit
            if (i == 0) then
                move = q - start
                contribution = position%contribution
                move_is_known = .true.
            end if
            if (n == 1) exit
        end do
        if (n == 1 .or. stat /= status_ok) q = start
        position%goal = 0.0_wp
    end subroutine approach_imposed_angles

    !> Refuse invalid requests.
    subroutine check_request(model, request, t, q, qd, error)
        class(model_type), intent(in) :: model
        type(assembly_type), intent(in) :: request
        real(wp), intent(in) :: t, q(:), qd(:)
        type(error_type), allocatable, intent(out) :: error

        if (size(q) /= model%n .or. size(qd) /= model%n) then
            call refuse('q0 and qd0 have '//to_text(size(q))//' and '//to_text(size(qd))//' entries, the model has n = '// &
                to_text(model%n), 'give n entries each')
        else if (.not. (ieee_is_finite(t) .and. all(ieee_is_finite(q)) .and. all(ieee_is_finite(qd)))) then
            call refuse('the start time, q0 or qd0 is not finite', 'use finite numbers')
        else if (.not. any(velocity_metrics == request%velocity_metric)) then
            call refuse('velocity_metric = "'//trim(request%velocity_metric)//'" is unknown', 'use mass or weights')
        else if (.not. (request%largest_move_q >= 0.0_wp .and. request%largest_move_qd >= 0.0_wp)) then
            call refuse('largest_move_q or largest_move_qd is negative', 'give a limit, or 0 for none')
        else if (.not. (request%tolerance > 0.0_wp .and. ieee_is_finite(request%tolerance))) then
            call refuse('tolerance = '//to_text(request%tolerance)//' must be positive', 'use about 1e-12')
        else if (request%iteration_limit < 1) then
            call refuse('iteration_limit = '//to_text(request%iteration_limit)//' must be positive', 'use several hundred')
        end if
        call check_weights('weight_q', request%weight_q)
        call check_weights('weight_qd', request%weight_qd)
        call check_fixed('fixed_q', request%fixed_q)
        call check_fixed('fixed_qd', request%fixed_qd)

    contains

        !> Check n weights: positive, with square roots that are valid divisors.
        subroutine check_weights(name, values)
            character(len=*), intent(in) :: name
            real(wp), allocatable, intent(in) :: values(:)

            if (allocated(error) .or. .not. allocated(values)) return
            call check_length(name, size(values))
            if (allocated(error)) return
            if (any(.not. (values > tiny(1.0_wp) .and. values < huge(1.0_wp)))) then
                call refuse('an entry of '//name//' is not positive and finite', &
                    'fix coordinates that must not move, and use small weights for those that may')
            end if
        end subroutine check_weights

        subroutine check_fixed(name, values)
            character(len=*), intent(in) :: name
            logical, allocatable, intent(in) :: values(:)

            if (allocated(error) .or. .not. allocated(values)) return
            call check_length(name, size(values))
        end subroutine check_fixed

        subroutine check_length(name, length)
            character(len=*), intent(in) :: name
            integer, intent(in) :: length

            if (length /= model%n) call refuse(name//' has '//to_text(length)//' entries instead of '//to_text(model%n), &
                'give one for each coordinate')
        end subroutine check_length

        subroutine refuse(problem, advice)
            character(len=*), intent(in) :: problem, advice

            call set_error(error, status_invalid_option, problem, advice)
        end subroutine refuse
    end subroutine check_request

    !> Given weights, or default weights.
    pure function weights(given, scale) result(weight)
        real(wp), allocatable, intent(in) :: given(:)
        real(wp), intent(in) :: scale(:)
        real(wp) :: weight(size(scale))

        weight = max(tiny(1.0_wp), min(huge(1.0_wp), (1.0_wp/scale)**2))
        if (allocated(given)) weight = given
    end function weights

    !> Refuse an excessive displacement of a coordinate, and name the row with the largest contribution.
    subroutine check_move(model, contribution, move, limit, what, error)
        class(model_type), intent(in) :: model
        !> Contribution of each row to the displacement of each coordinate; displacements in units of the scales; their limit.
        real(wp), intent(in) :: contribution(:, :), move(:), limit
        !> Text before the name of the coordinate.
        character(len=*), intent(in) :: what
        type(error_type), allocatable, intent(out) :: error
        character(len=13) :: unit
        integer :: i, j

        if (.not. limit > 0.0_wp .or. size(contribution, 1) == 0) return
        j = maxloc(abs(move), dim=1)
        if (abs(move(j)) <= limit) return
        i = maxloc(contribution(:, j)*sign(1.0_wp, move(j)), dim=1)
        unit = ''
        if (allocated(model%coordinate_scale)) unit = ' of its scale'
        call set_error(error, status_inconsistent_start, 'the '//what//'coordinate "'//model%coordinate_label(j)// &
            '" would move by '//to_text(move(j))//trim(unit)//' (allowed: '//to_text(limit)// &
            ') to satisfy the constraints, most of it for "'//model%row_name(i)//'"', &
            'start nearer to the constraints, or allow a larger change')
    end subroutine check_move

    !> Row with the largest contribution to the displacements; 0 if nothing moved.
    pure integer function dominant_row(contribution, scale)
        real(wp), intent(in) :: contribution(:, :), scale(:)
        real(wp) :: size_of(size(contribution, 1))
        integer :: i

        dominant_row = 0
        if (size(contribution, 1) == 0) return
        size_of = [(norm2(contribution(i, :)/scale), i=1, size(contribution, 1))]
        if (maxval(size_of) > 0.0_wp) dominant_row = maxloc(size_of, dim=1)
    end function dominant_row

    !> Text about the residual of a row, padded with blanks.
    pure function residual_text(amount, value) result(text)
        !> Residual of the row, and the residual on its natural scale.
        real(wp), intent(in) :: amount, value
        character(len=80) :: text
        !> Limit above which the natural scale, and with it all coefficients of the row, has vanished.
        real(wp), parameter :: vanished = 1.0e3_wp

        if (value < vanished) then
            text = to_text(amount)//' ('//to_text(value)//' of its natural scale)'
        else
            text = to_text(amount)//' (and no motion changes it there)'
        end if
    end function residual_text

    !> Text that lists fixed coordinates, padded with blanks.
    function fixed_text(model, is_fixed) result(text)
        class(model_type), intent(in) :: model
        logical, intent(in) :: is_fixed(:)
        character(len=13 + (label_length + 2)*size(is_fixed)) :: text
        integer :: j

        text = ''
        do j = 1, size(is_fixed)
            if (.not. is_fixed(j)) cycle
            text = trim(text)//', '//model%coordinate_label(j)
        end do
        if (text /= '') text = ', with fixed '//trim(text(3:))
    end function fixed_text

    !> Advice if there is no consistent state near the start, padded with blanks.
    pure function advice_for(is_fixed, things, start) result(text)
        logical, intent(in) :: is_fixed(:)
        !> Names of the quantities that may be fixed, and of the given start.
        character(len=*), intent(in) :: things, start
        character(len=160) :: text

        text = 'give a '//start//' nearer to a solution, or correct the constraint'
        if (any(is_fixed)) text = 'the fixed '//things//' may exclude a solution: free some of them; or '//trim(text)
    end function advice_for

    !> Error of the model's procedures.
    subroutine fail(evaluator, stat, when, error)
        type(evaluator_type), intent(in) :: evaluator
        integer, intent(in) :: stat
        character(len=*), intent(in) :: when
        type(error_type), allocatable, intent(out) :: error
        type(status_type) :: row

        row = status_of(stat)
        call set_error(error, stat, trim(row%meaning)//' '//when//', term '//trim(evaluator%failed_term), &
            'check the model''s procedure there, and the start')
    end subroutine fail
end module tandem_simulate_assembly
