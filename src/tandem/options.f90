! SPDX-License-Identifier: MIT
!> What a user may choose about a run, with its defaults and its checks.
module tandem_options
    use tandem_error, only: error_type, set_error, to_text
    use tandem_kinds, only: wp
    use tandem_pack, only: pack_type
    use tandem_status, only: status_invalid_option
    use, intrinsic :: ieee_arithmetic, only: ieee_is_finite
    implicit none (type, external)
    private

    public :: options_type, chart_policies, refresh_modes, basis_methods, projections

    !> When a new chart is made: at every step; by |D| and |Fbar|; by the paper's limits.
    character(len=10), parameter :: chart_policies(3) = [character(len=10) :: 'every_step', 'adaptive', 'paper']
    !> How the inverses B and H follow the motion: factored anew, or refined by the paper's iteration (20), (29).
    character(len=6), parameter :: refresh_modes(2) = [character(len=6) :: 'factor', 'refine']

    !> Where the bases V, U, W, X come from: pivoted QR, or the paper's singular value decompositions.
    character(len=3), parameter :: basis_methods(2) = [character(len=3) :: 'qr', 'svd']

    !> Where explicit steps are projected onto the constraints: at every stage, the paper's method, or at their ends alone.
    character(len=9), parameter :: projections(2) = [character(len=9) :: 'stages', 'step_ends']

    !> A tolerance below this is lost in rounding.
    real(wp), parameter :: smallest_tolerance = 1.0e-15_wp

    !> What a user may choose, each with its default; `check` refuses what cannot be.
    type :: options_type
        !> Name of the stepper, see `stepper_names` in `tandem_stepper_factory`.
        character(len=16) :: stepper = 'rk4'
        !> Step size h of fixed steps, in units of time.
        real(wp) :: step = 1.0e-3_wp
        !> Relative tolerance of q and qd, for steps whose size follows an error estimate; 0 means fixed steps.
        real(wp) :: rtol = 0.0_wp
        !> Absolute tolerance of q and qd in units of the coordinate scales; 0 stands for `rtol`.
        real(wp) :: atol = 0.0_wp
        !> Tolerances one a coordinate (n), for q and for qd, in the stead of `rtol` and `atol`. Not allocated: those for q stand
        !> for `rtol` and `atol`, those for qd for those for q. A zero in `atol_q` or `atol_qd` stands for the relative one there.
        real(wp), allocatable :: rtol_q(:), rtol_qd(:), atol_q(:), atol_qd(:)
        !> First and largest step under error control; 0 leaves the first to the program and the largest open.
        real(wp) :: first_step = 0.0_wp, max_step = 0.0_wp
        !> One of `chart_policies`.
        character(len=10) :: chart = 'every_step'
        !> One of `refresh_modes`.
        character(len=6) :: refresh = 'factor'
        !> One of `basis_methods`.
        character(len=3) :: basis = 'qr'
        !> One of `projections`; for explicit steppers.
        character(len=9) :: projection = 'stages'
        !> Largest constraint error on the natural scale of its row, at all three levels.
        real(wp) :: constraint_tolerance = 1.0e-12_wp
        !> Tolerance of the position iteration (17); 0 stands for a hundredth of `constraint_tolerance`, since what is left at every
        !> stage adds up, and under error control, within a step, for 0.003 `rtol` if that is larger.
        real(wp) :: utol = 0.0_wp
        !> Tolerance of the iteration for B (20); 0 stands for `constraint_tolerance`. Used by `refine`.
        real(wp) :: btol = 0.0_wp
        !> Tolerance of the iteration for H (29); 0 stands for `constraint_tolerance`. Used by `refine`.
        real(wp) :: htol = 0.0_wp
        !> Newton's iteration of implicit stages stops when what it leaves of q and qd is below this, against |q|, |qd| and the
        !> coordinate scales; 0 stands for a hundredth of `constraint_tolerance`, or a thousandth of `rtol` if that is larger.
        real(wp) :: intol = 0.0_wp
        !> `paper` policy: a new chart when |v|_2 passes this; 0 means no limit. Where none of the four limits is set, one of 70
        !> degrees on the angle to the tangent spaces stands for them, as it always does for implicit steppers.
        real(wp) :: v_limit = 0.0_wp
        !> `paper` policy: a new chart when |w|_2 passes this; 0 means no limit.
        real(wp) :: w_limit = 0.0_wp
        !> `paper` policy: a new chart when the condition number of (38) passes this; 0 means no limit.
        real(wp) :: condition_limit = 0.0_wp
        !> `paper` policy: a new chart when the iteration for u, B or H took more corrections than this; 0 means no limit.
        integer :: iteration_limit = 0
        !> `adaptive` policy: a new chart when |D|_2 or |Fbar|_2, the secants of the angles to the tangent spaces, pass this.
        real(wp) :: secant_limit = 1.5_wp
        !> Largest violation of the constraints by the start, on the natural scale; smaller ones are removed.
        real(wp) :: start_tolerance = 1.0e-8_wp
        !> Most events of one run.
        integer :: max_events = 100000
        !> Most steps of one run.
        integer :: max_steps = huge(1)
        !> Most evaluations of the right-hand side, those of rejected steps and of dense output included; 0 means no limit.
        integer :: max_evaluations = 0
        !> Most seconds of wall time, counted from the first step; 0 means no limit.
        real(wp) :: max_seconds = 0.0_wp
    contains
        procedure :: check
        procedure :: check_sizes
        procedure :: is_adaptive
        procedure :: has_one_tolerance
        procedure :: has_paper_limits
        procedure :: relative_tolerance
        procedure :: absolute_tolerance
        procedure :: fill_tolerances
        procedure :: position_tolerance
        procedure :: stage_tolerance
        procedure :: b_tolerance
        procedure :: h_tolerance
        procedure :: newton_tolerance
        procedure :: pack_state
        procedure :: first_difference
    end type options_type

contains

    !> Refuse values that cannot be; the message names the option.
    subroutine check(self, error)
        class(options_type), intent(in) :: self
        type(error_type), allocatable, intent(out) :: error

        if (.not. any(self%chart == chart_policies)) then
            call set_error(error, status_invalid_option, 'chart = "'//trim(self%chart)//'" is unknown', &
                'use every_step, adaptive or paper')
        else if (.not. any(self%refresh == refresh_modes)) then
            call set_error(error, status_invalid_option, 'refresh = "'//trim(self%refresh)//'" is unknown', &
                'use factor or refine')
        else if (.not. any(self%basis == basis_methods)) then
            call set_error(error, status_invalid_option, 'basis = "'//trim(self%basis)//'" is unknown', 'use qr or svd')
        else if (.not. any(self%projection == projections)) then
            call set_error(error, status_invalid_option, 'projection = "'//trim(self%projection)//'" is unknown', &
                'use stages or step_ends')
        else if (self%max_steps < 1) then
            call set_error(error, status_invalid_option, 'max_steps = '//to_text(self%max_steps)//' must be at least 1')
        else if (self%max_events < 1) then
            call set_error(error, status_invalid_option, 'max_events = '//to_text(self%max_events)//' must be at least 1')
        end if
        if (allocated(error)) return
        if (self%max_evaluations < 0) then
            call set_error(error, status_invalid_option, 'max_evaluations = '//to_text(self%max_evaluations)// &
                ' must be positive, or 0 for no limit')
            return
        end if
        call check_limit('max_seconds', self%max_seconds, error)
        if (allocated(error)) return
        call check_positive('step', self%step, error)
        if (allocated(error)) return
        if (.not. is_unset(self%rtol)) call check_tolerance('rtol', self%rtol, error)
        if (allocated(error)) return
        call check_limit('atol', self%atol, error)
        if (allocated(error)) return
        call check_list('rtol_q', self%rtol_q, .true., error)
        if (allocated(error)) return
        call check_list('rtol_qd', self%rtol_qd, .true., error)
        if (allocated(error)) return
        call check_list('atol_q', self%atol_q, .false., error)
        if (allocated(error)) return
        call check_list('atol_qd', self%atol_qd, .false., error)
        if (allocated(error)) return
        call check_limit('first_step', self%first_step, error)
        if (allocated(error)) return
        call check_limit('max_step', self%max_step, error)
        if (allocated(error)) return
        call check_limit('v_limit', self%v_limit, error)
        if (allocated(error)) return
        call check_limit('w_limit', self%w_limit, error)
        if (allocated(error)) return
        call check_tolerance('constraint_tolerance', self%constraint_tolerance, error)
        if (allocated(error)) return
        call check_tolerance('utol', self%position_tolerance(), error)
        if (allocated(error)) return
        call check_tolerance('btol', self%b_tolerance(), error)
        if (allocated(error)) return
        call check_tolerance('htol', self%h_tolerance(), error)
        if (allocated(error)) return
        call check_tolerance('intol', self%newton_tolerance(), error)
        if (allocated(error)) return
        call check_limit('condition_limit', self%condition_limit, error)
        if (allocated(error)) return
        if (self%iteration_limit < 0) then
            call set_error(error, status_invalid_option, 'iteration_limit = '//to_text(self%iteration_limit)// &
                ' must be positive, or 0 for no limit')
            return
        end if
        call check_tolerance('start_tolerance', self%start_tolerance, error)
        if (allocated(error)) return
        if (.not. self%secant_limit > 1.0_wp) then
            call set_error(error, status_invalid_option, 'secant_limit = '//to_text(self%secant_limit)//' must be above 1')
        end if
    end subroutine check

    !> Refuse tolerances that are not one a coordinate.
    subroutine check_sizes(self, n, error)
        class(options_type), intent(in) :: self
        !> Number of coordinates.
        integer, intent(in) :: n
        type(error_type), allocatable, intent(out) :: error

        call check_size('rtol_q', self%rtol_q, n, error)
        if (.not. allocated(error)) call check_size('rtol_qd', self%rtol_qd, n, error)
        if (.not. allocated(error)) call check_size('atol_q', self%atol_q, n, error)
        if (.not. allocated(error)) call check_size('atol_qd', self%atol_qd, n, error)
    end subroutine check_sizes

    !> Whether steps follow an error estimate.
    pure logical function is_adaptive(self)
        class(options_type), intent(in) :: self

        is_adaptive = .not. is_unset(self%rtol) .or. allocated(self%rtol_q) .or. allocated(self%rtol_qd)
    end function is_adaptive

    !> Whether rtol is the tolerance of everything, relative and absolute.
    pure logical function has_one_tolerance(self)
        class(options_type), intent(in) :: self

        has_one_tolerance = abs(self%absolute_tolerance() - self%rtol) <= 0.0_wp .and. .not. (allocated(self%rtol_q) .or. &
            allocated(self%rtol_qd) .or. allocated(self%atol_q) .or. allocated(self%atol_qd))
    end function has_one_tolerance

    !> Whether any of the paper's limits on a chart is set.
    pure logical function has_paper_limits(self)
        class(options_type), intent(in) :: self

        has_paper_limits = self%v_limit > 0.0_wp .or. self%w_limit > 0.0_wp .or. self%condition_limit > 0.0_wp .or. &
            self%iteration_limit > 0
    end function has_paper_limits

    !> The smallest relative tolerance in use: rtol where there is one for all coordinates. 0 for fixed steps.
    pure real(wp) function relative_tolerance(self)
        class(options_type), intent(in) :: self

        relative_tolerance = huge(1.0_wp)
        if (allocated(self%rtol_q)) then
            relative_tolerance = minval(self%rtol_q)
        else if (.not. is_unset(self%rtol)) then
            relative_tolerance = self%rtol
        end if
        if (allocated(self%rtol_qd)) relative_tolerance = min(relative_tolerance, minval(self%rtol_qd))
        if (.not. self%is_adaptive()) relative_tolerance = 0.0_wp
    end function relative_tolerance

    !> The absolute tolerance for all coordinates: atol, or what stands for it.
    pure real(wp) function absolute_tolerance(self)
        class(options_type), intent(in) :: self

        absolute_tolerance = merge(self%relative_tolerance(), self%atol, is_unset(self%atol))
    end function absolute_tolerance

    !> The tolerances of every coordinate and velocity.
    pure subroutine fill_tolerances(self, rtol_q, rtol_qd, atol_q, atol_qd)
        class(options_type), intent(in) :: self
        !> Relative ones, and absolute ones in units of the coordinate scales (n).
        real(wp), intent(out), contiguous :: rtol_q(:), rtol_qd(:), atol_q(:), atol_qd(:)

        rtol_q = merge(self%relative_tolerance(), self%rtol, is_unset(self%rtol))
        if (allocated(self%rtol_q)) rtol_q = self%rtol_q
        rtol_qd = rtol_q
        if (allocated(self%rtol_qd)) rtol_qd = self%rtol_qd
        atol_q = self%atol
        if (allocated(self%atol_q)) atol_q = self%atol_q
        atol_qd = atol_q
        if (allocated(self%atol_qd)) atol_qd = self%atol_qd
        where (is_unset(atol_q)) atol_q = rtol_q
        where (is_unset(atol_qd)) atol_qd = rtol_qd
    end subroutine fill_tolerances

    !> utol, or what stands for it.
    pure real(wp) function position_tolerance(self)
        class(options_type), intent(in) :: self

        position_tolerance = merge(max(0.01_wp*self%constraint_tolerance, smallest_tolerance), self%utol, is_unset(self%utol))
    end function position_tolerance

    !> The tolerance of (17) within a step whose size follows an error estimate: a small part of that error. 0 for that of the ends
    !> of steps; a utol that was set holds everywhere. The part: no errors of runs were larger than with 0.001, but with 0.01 those
    !> of a disk that spins at 1000 rad/s were three times as large.
    pure real(wp) function stage_tolerance(self)
        class(options_type), intent(in) :: self
        real(wp), parameter :: part = 3.0e-3_wp

        stage_tolerance = 0.0_wp
        if (is_unset(self%utol) .and. self%is_adaptive()) stage_tolerance = part*self%relative_tolerance()
    end function stage_tolerance

    !> Btol, or what stands for it.
    pure real(wp) function b_tolerance(self)
        class(options_type), intent(in) :: self

        b_tolerance = merge(self%constraint_tolerance, self%btol, is_unset(self%btol))
    end function b_tolerance

    !> Htol, or what stands for it.
    pure real(wp) function h_tolerance(self)
        class(options_type), intent(in) :: self

        h_tolerance = merge(self%constraint_tolerance, self%htol, is_unset(self%htol))
    end function h_tolerance

    !> intol, or what stands for it.
    pure real(wp) function newton_tolerance(self)
        class(options_type), intent(in) :: self

        newton_tolerance = self%intol
        if (is_unset(self%intol)) newton_tolerance = max(0.01_wp*self%constraint_tolerance, 1.0e-3_wp*self%relative_tolerance(), &
            smallest_tolerance)
    end function newton_tolerance

    !> All that the course of a run depends on: not the limits that only end it, nor what concerns the start alone.
    subroutine pack_state(self, pack)
        class(options_type), intent(inout) :: self
        type(pack_type), intent(inout) :: pack

        call pack%item(self%stepper)
        call pack%item(self%step)
        call pack%item(self%rtol)
        call pack%item(self%atol)
        call pack%item(self%rtol_q)
        call pack%item(self%rtol_qd)
        call pack%item(self%atol_q)
        call pack%item(self%atol_qd)
        call pack%item(self%first_step)
        call pack%item(self%max_step)
        call pack%item(self%chart)
        call pack%item(self%refresh)
        call pack%item(self%basis)
        call pack%item(self%projection)
        call pack%item(self%constraint_tolerance)
        call pack%item(self%utol)
        call pack%item(self%btol)
        call pack%item(self%htol)
        call pack%item(self%intol)
        call pack%item(self%v_limit)
        call pack%item(self%w_limit)
        call pack%item(self%condition_limit)
        call pack%item(self%iteration_limit)
        call pack%item(self%secant_limit)
    end subroutine pack_state

    !> The first of the options in `pack_state` that another set has with another value, blank where there is none.
    pure function first_difference(self, other) result(name)
        class(options_type), intent(in) :: self
        type(options_type), intent(in) :: other
        character(len=20) :: name

        name = ''
        if (is_other(self%secant_limit, other%secant_limit)) name = 'secant_limit'
        if (self%iteration_limit /= other%iteration_limit) name = 'iteration_limit'
        if (is_other(self%condition_limit, other%condition_limit)) name = 'condition_limit'
        if (is_other(self%w_limit, other%w_limit)) name = 'w_limit'
        if (is_other(self%v_limit, other%v_limit)) name = 'v_limit'
        if (is_other(self%intol, other%intol)) name = 'intol'
        if (is_other(self%htol, other%htol)) name = 'htol'
        if (is_other(self%btol, other%btol)) name = 'btol'
        if (is_other(self%utol, other%utol)) name = 'utol'
        if (is_other(self%constraint_tolerance, other%constraint_tolerance)) name = 'constraint_tolerance'
        if (self%projection /= other%projection) name = 'projection'
        if (self%basis /= other%basis) name = 'basis'
        if (self%refresh /= other%refresh) name = 'refresh'
        if (self%chart /= other%chart) name = 'chart'
        if (is_other(self%max_step, other%max_step)) name = 'max_step'
        if (is_other(self%first_step, other%first_step)) name = 'first_step'
        if (differs(self%atol_qd, other%atol_qd)) name = 'atol_qd'
        if (differs(self%atol_q, other%atol_q)) name = 'atol_q'
        if (differs(self%rtol_qd, other%rtol_qd)) name = 'rtol_qd'
        if (differs(self%rtol_q, other%rtol_q)) name = 'rtol_q'
        if (is_other(self%atol, other%atol)) name = 'atol'
        if (is_other(self%rtol, other%rtol)) name = 'rtol'
        if (is_other(self%step, other%step)) name = 'step'
        if (self%stepper /= other%stepper) name = 'stepper'
    end function first_difference

    !> Whether one list of tolerances is not the other.
    pure logical function differs(one, other)
        real(wp), allocatable, intent(in) :: one(:), other(:)

        differs = allocated(one) .neqv. allocated(other)
        if (.not. (allocated(one) .and. allocated(other))) return
        differs = size(one) /= size(other)
        if (.not. differs) differs = any(is_other(one, other))
    end function differs

    !> Whether two finite numbers are not the same.
    pure elemental logical function is_other(one, other)
        real(wp), intent(in) :: one, other

        is_other = one < other .or. one > other
    end function is_other

    !> Whether a tolerance was left at the zero that stands for another.
    pure elemental logical function is_unset(value)
        real(wp), intent(in) :: value

        is_unset = abs(value) <= 0.0_wp
    end function is_unset

    subroutine check_positive(name, value, error)
        character(len=*), intent(in) :: name
        real(wp), intent(in) :: value
        type(error_type), allocatable, intent(out) :: error

        if (value > 0.0_wp .and. ieee_is_finite(value)) return
        call set_error(error, status_invalid_option, name//' = '//to_text(value)//' must be positive and finite')
    end subroutine check_positive

    subroutine check_limit(name, value, error)
        character(len=*), intent(in) :: name
        real(wp), intent(in) :: value
        type(error_type), allocatable, intent(out) :: error

        if (value >= 0.0_wp .and. ieee_is_finite(value)) return
        call set_error(error, status_invalid_option, name//' = '//to_text(value)//' must be positive, or 0 for no limit')
    end subroutine check_limit

    !> A list of tolerances, one a coordinate.
    subroutine check_list(name, values, is_relative, error)
        character(len=*), intent(in) :: name
        real(wp), allocatable, intent(in) :: values(:)
        !> Relative tolerances must be resolvable, absolute ones need not.
        logical, intent(in) :: is_relative
        type(error_type), allocatable, intent(out) :: error
        integer :: i

        if (.not. allocated(values)) return
        do i = 1, size(values)
            if (is_relative) then
                call check_tolerance(name//'('//to_text(i)//')', values(i), error)
            else
                call check_limit(name//'('//to_text(i)//')', values(i), error)
            end if
            if (allocated(error)) return
        end do
    end subroutine check_list

    subroutine check_size(name, values, n, error)
        character(len=*), intent(in) :: name
        real(wp), allocatable, intent(in) :: values(:)
        integer, intent(in) :: n
        type(error_type), allocatable, intent(out) :: error

        if (.not. allocated(values)) return
        if (size(values) == n) return
        call set_error(error, status_invalid_option, name//' has '//to_text(size(values))//' entries, the model has n = '// &
            to_text(n), 'give one a coordinate')
    end subroutine check_size

    !> A tolerance must be resolvable in double precision and must mean something.
    subroutine check_tolerance(name, value, error)
        character(len=*), intent(in) :: name
        real(wp), intent(in) :: value
        type(error_type), allocatable, intent(out) :: error
        real(wp), parameter :: largest = 1.0e-2_wp

        if (value >= smallest_tolerance .and. value <= largest) return
        call set_error(error, status_invalid_option, name//' = '//to_text(value)//' must lie between 1e-15 and 1e-2')
    end subroutine check_tolerance
end module tandem_options
