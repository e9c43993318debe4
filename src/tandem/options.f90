! SPDX-License-Identifier: MIT
!> Options of a run, with their defaults, and the one table of all options, whose rows are visited to check them, to store them in a
!> checkpoint, to read them from a scene, or to set them from C and Fortran 77.
module tandem_options
    use tandem_error, only: error_type, set_error, to_text
    use tandem_kinds, only: long, wp
    use tandem_pack, only: pack_type
    use tandem_status, only: status_invalid_option
    use, intrinsic :: ieee_arithmetic, only: ieee_is_finite
    implicit none (type, external)
    private

    public :: options_type, option_row_type, option_visitor_type, check_word
    public :: stepper_names, stepper_choices, chart_kinds, chart_policies, refresh_modes, basis_methods, projections, &
        singular_modes
    public :: steppers_without_estimate, explicit_steppers, default_rtol, default_step

    !> All methods of fixed order; `tandem_stepper_factory` creates them.
    character(len=16), parameter :: stepper_names(6) = [character(len=16) :: 'rk4', 'dopri5', 'dop853', 'trapezoid', 'sdirk54', &
        'radau5']
    !> All names of steppers: the methods, the one with varying order, and the one that switches between methods.
    character(len=16), parameter :: stepper_choices(size(stepper_names) + 2) = [stepper_names, [character(len=16) :: 'radau', &
        'auto']]
    !> Steppers without an error estimate, which take fixed steps, and steppers with explicit stages.
    character(len=16), parameter :: steppers_without_estimate(1) = [character(len=16) :: 'rk4']
    character(len=16), parameter :: explicit_steppers(3) = [character(len=16) :: 'rk4', 'dopri5', 'dop853']
    !> Tolerance of steps with an error estimate and size of fixed steps, if neither is given.
    real(wp), parameter :: default_rtol = 1.0e-6_wp, default_step = 1.0e-3_wp
    !> Matrices of a chart: chosen by the program; dense; blocks of a sparse factor.
    character(len=9), parameter :: chart_kinds(3) = [character(len=9) :: 'automatic', 'dense', 'sparse']
    !> Rule for a new chart: at every step; by |D| and |Fbar|; by the paper's limits.
    character(len=10), parameter :: chart_policies(3) = [character(len=10) :: 'every_step', 'adaptive', 'paper']
    !> Update of the inverses B and H: by factorisation, or by the paper's iteration (20), (29).
    character(len=6), parameter :: refresh_modes(2) = [character(len=6) :: 'factor', 'refine']

    !> Computation of the bases V, U, W, X: pivoted QR, or the paper's singular value decompositions.
    character(len=3), parameter :: basis_methods(2) = [character(len=3) :: 'qr', 'svd']

    !> Points of an explicit step that are projected onto the constraints: chosen by `projects_stages`; every stage, as in the
    !> paper; only the end.
    character(len=9), parameter :: projections(3) = [character(len=9) :: 'automatic', 'stages', 'step_ends']

    !> Treatment of configurations in which C loses rank at one instant while the motion is smooth: pass them, or end the run.
    character(len=4), parameter :: singular_modes(2) = [character(len=4) :: 'pass', 'stop']

    !> Smaller tolerances are lost in rounding; larger ones are meaningless.
    real(wp), parameter :: smallest_tolerance = 1.0e-15_wp, largest_tolerance = 1.0e-2_wp

    !> Ranges of a number: any; from 1 on; above 1; above 0, or 0 if not given; above 0, or 0 for no limit; a tolerance; a
    !> tolerance, or 0 for another one.
    integer, parameter :: anything = 0, from_one = 1, above_one = 2, unset_or_positive = 3, limit = 4, tolerance = 5, &
        unset_or_tolerance = 6

    !> Definition of an option.
    type :: option_row_type
        !> Name of the component of `options_type`.
        character(len=20) :: name
        !> Unit and meaning of its value, in one line.
        character(len=1) :: unit
        character(len=88) :: help
        !> Range of a number, or of each number in a list.
        integer, private :: rule = anything
        !> Key in scenes if it differs from the name; a list has the key of the number that it overrides.
        character(len=4) :: key = ''
    contains
        procedure :: problem_of
    end type option_row_type

    !> Visitor of the options: to be extended.
    type, abstract :: option_visitor_type
    contains
        procedure(take_interface), deferred :: take
    end type option_visitor_type

    abstract interface
        !> Visit one option; its value may be changed.
        subroutine take_interface(self, row, number, whole, word, list, choices)
            import :: option_row_type, option_visitor_type, wp
            implicit none (type, external)
            class(option_visitor_type), intent(inout) :: self
            type(option_row_type), intent(in) :: row
            !> The value: one of these. A number may be followed by the list that overrides it, which has a row of its own.
            real(wp), intent(inout), optional :: number
            integer, intent(inout), optional :: whole
            character(len=*), intent(inout), optional :: word
            real(wp), allocatable, intent(inout), optional :: list(:)
            !> Valid words.
            character(len=*), intent(in), optional :: choices(:)
        end subroutine take_interface
    end interface

    !> Options with their defaults; `check` refuses invalid values.
    type :: options_type
        !> One of `stepper_choices`. With a fixed step, `auto` is rk4.
        character(len=16) :: stepper = 'auto'
        !> Step size h of fixed steps, in units of time; excludes the tolerances. 0: error control; steppers without an error
        !> estimate use `default_step`.
        real(wp) :: step = 0.0_wp
        !> Relative tolerance of q and qd, for error control; 0 selects `default_rtol`, or fixed steps if `step` is given or the
        !> stepper has no error estimate.
        real(wp) :: rtol = 0.0_wp
        !> Absolute tolerance of q and qd in units of the coordinate scales; 0 selects `rtol`.
        real(wp) :: atol = 0.0_wp
        !> Tolerances per coordinate (n), for q and for qd; override `rtol` and `atol`. Not allocated: those for q default to `rtol`
        !> and `atol`, those for qd to those for q. A zero in `atol_q` or `atol_qd` selects the relative one there.
        real(wp), allocatable :: rtol_q(:), rtol_qd(:), atol_q(:), atol_qd(:)
        !> First and largest step under error control; 0 selects an automatic first step, and no limit.
        real(wp) :: first_step = 0.0_wp, max_step = 0.0_wp
        !> One of `chart_kinds`.
        character(len=9) :: chart_kind = 'automatic'
        !> One of `chart_policies`.
        character(len=10) :: chart = 'every_step'
        !> One of `refresh_modes`.
        character(len=6) :: refresh = 'factor'
        !> One of `basis_methods`.
        character(len=3) :: basis = 'qr'
        !> One of `projections`; for explicit steppers.
        character(len=9) :: projection = 'automatic'
        !> One of `singular_modes`.
        character(len=4) :: singular = 'pass'
        !> Largest constraint error on the natural scale of its row, at all three levels.
        real(wp) :: constraint_tolerance = 1.0e-12_wp
        !> Tolerance of the position iteration (17); 0 selects a hundredth of `constraint_tolerance`, because the remainders of all
        !> stages add up, and under error control, within a step, 0.003 `rtol` if that is larger.
        real(wp) :: utol = 0.0_wp
        !> Tolerance of the iteration for B (20); 0 selects `constraint_tolerance`. Used by `refine`.
        real(wp) :: btol = 0.0_wp
        !> Tolerance of the iteration for H (29); 0 selects `constraint_tolerance`. Used by `refine`.
        real(wp) :: htol = 0.0_wp
        !> Tolerance of Newton's iteration of implicit stages for q and qd, relative to |q|, |qd| and the coordinate scales; 0
        !> selects a hundredth of `constraint_tolerance`, or if that is larger `rtol` times the smaller of rtol**(1/4)/100 and
        !> 1/1000, or with fixed steps of `sdirk54` a hundredth of the error of steps, up to a hundred times as much.
        real(wp) :: intol = 0.0_wp
        !> `paper` policy: a new chart when |v|_2 passes this; 0 means no limit. If none of the four limits is set, a limit of 70
        !> degrees on the angle to the tangent spaces applies, as it always does for implicit steppers.
        real(wp) :: v_limit = 0.0_wp
        !> `paper` policy: a new chart when |w|_2 passes this; 0 means no limit.
        real(wp) :: w_limit = 0.0_wp
        !> `paper` policy: a new chart when the condition number of (38) passes this; 0 means no limit.
        real(wp) :: condition_limit = 0.0_wp
        !> `paper` policy: a new chart when the iteration for u, B or H took more corrections than this; 0 means no limit.
        integer :: iteration_limit = 0
        !> `adaptive` policy: a new chart when |D|_2 or |Fbar|_2, the secants of the angles to the tangent spaces, pass this.
        real(wp) :: secant_limit = 1.5_wp
        !> Largest constraint error of the start, on the natural scale; smaller ones are removed.
        real(wp) :: start_tolerance = 1.0e-8_wp
        !> Largest number of events in a run.
        integer :: max_events = 100000
        !> Largest number of steps in a run.
        integer :: max_steps = huge(1)
        !> Largest number of evaluations of the right-hand side, including rejected steps and dense output; 0 means no limit.
        integer :: max_evaluations = 0
        !> Largest wall time (s), from the first step on; 0 means no limit.
        real(wp) :: max_seconds = 0.0_wp
    contains
        procedure :: visit
        procedure, private :: visit_course
        procedure :: check, check_sizes, is_adaptive, has_tolerance, has_one_tolerance, has_paper_limits
        procedure :: relative_tolerance, absolute_tolerance, fill_tolerances
        procedure :: position_tolerance, stage_tolerance, b_tolerance, h_tolerance, newton_tolerance
        procedure :: pack_state, first_difference
    end type options_type

    !> Finds the first option with an invalid value.
    type, extends(option_visitor_type) :: checker_type
        type(error_type), allocatable :: error
    contains
        procedure :: take => check_option
    end type checker_type

    !> Writes or reads the options.
    type, extends(option_visitor_type) :: packer_type
        type(pack_type), pointer :: pack => null()
    contains
        procedure :: take => pack_option
    end type packer_type

    !> Stores one set of options, then finds the first option that differs in another set.
    type, extends(option_visitor_type) :: comparer_type
        !> Number of words of each value, and these words, one value after the other; number of words compared.
        integer(long), allocatable :: words(:)
        logical :: is_comparing = .false.
        integer :: n = 0
        character(len=20) :: difference = ''
    contains
        procedure :: take => compare_option
    end type comparer_type

contains

    !> Show a visitor every option.
    subroutine visit(self, visitor)
        class(options_type), intent(inout) :: self
        class(option_visitor_type), intent(inout) :: visitor

        call self%visit_course(visitor)
        call visitor%take(option_row_type('start_tolerance', '', &
            'largest constraint error of the start', tolerance), number=self%start_tolerance)
        call visitor%take(option_row_type('max_steps', '', 'largest number of steps', from_one), whole=self%max_steps)
        call visitor%take(option_row_type('max_evaluations', '', &
            'largest number of evaluations of the right-hand side; 0 for no limit', limit), whole=self%max_evaluations)
        call visitor%take(option_row_type('max_seconds', 's', 'largest wall time; 0 for no limit', limit), number=self%max_seconds)
        call visitor%take(option_row_type('max_events', '', 'largest number of events', from_one), whole=self%max_events)
    end subroutine visit

    !> Show a visitor the options that affect the course of a run: neither limits that only end it, nor options of the start.
    subroutine visit_course(self, visitor)
        class(options_type), intent(inout) :: self
        class(option_visitor_type), intent(inout) :: visitor

        call visitor%take(option_row_type('stepper', '', 'integration method; auto selects rk4 with a fixed step'), &
            word=self%stepper, choices=stepper_choices)
        call visitor%take(option_row_type('step', 's', &
            'size of fixed steps; excludes rtol; 0: not set (rk4 then takes 1e-3)', unset_or_positive), number=self%step)
        call visitor%take(option_row_type('rtol', '', &
            'relative tolerance, scalar or per coordinate; 0: 1e-6, or fixed steps with step or rk4', unset_or_tolerance), &
            number=self%rtol, list=self%rtol_q)
        call visitor%take(option_row_type('atol', '', &
            'absolute tolerance, scalar or per coordinate, in units of its scale; 0: equal to rtol', limit), &
            number=self%atol, list=self%atol_q)
        call visitor%take(option_row_type('rtol_q', '', &
            'relative tolerance per coordinate; overrides rtol', tolerance, key='rtol'), list=self%rtol_q)
        call visitor%take(option_row_type('rtol_qd', '', &
            'relative tolerance per velocity; overrides rtol', tolerance), list=self%rtol_qd)
        call visitor%take(option_row_type('atol_q', '', &
            'absolute tolerance per coordinate; overrides atol', limit, key='atol'), list=self%atol_q)
        call visitor%take(option_row_type('atol_qd', '', &
            'absolute tolerance per velocity; overrides atol', limit), list=self%atol_qd)
        call visitor%take(option_row_type('first_step', 's', &
            'first step under error control; 0: chosen automatically', limit), number=self%first_step)
        call visitor%take(option_row_type('max_step', 's', 'largest step under error control; 0 for no limit', limit), &
            number=self%max_step)
        call visitor%take(option_row_type('chart_kind', '', &
            'matrices of a chart: dense, or sparse for many bodies'), word=self%chart_kind, choices=chart_kinds)
        call visitor%take(option_row_type('chart', '', 'rule for a new chart'), word=self%chart, choices=chart_policies)
        call visitor%take(option_row_type('refresh', '', &
            'update of the inverses B and H'), word=self%refresh, choices=refresh_modes)
        call visitor%take(option_row_type('basis', '', &
            'factorization that yields the bases of a chart'), word=self%basis, choices=basis_methods)
        call visitor%take(option_row_type('projection', '', &
            'points of explicit steps that are projected onto the constraints'), word=self%projection, choices=projections)
        call visitor%take(option_row_type('singular', '', &
            'configurations where constraints lose rank at one instant: pass them, or stop there'), word=self%singular, &
            choices=singular_modes)
        call visitor%take(option_row_type('constraint_tolerance', '', &
            "largest constraint error, on each row's natural scale", tolerance), number=self%constraint_tolerance)
        call visitor%take(option_row_type('utol', '', &
            'tolerance of the position iteration; 0 for constraint_tolerance/100', unset_or_tolerance), number=self%utol)
        call visitor%take(option_row_type('btol', '', &
            'tolerance of the iteration for B, with refine; 0 for constraint_tolerance', unset_or_tolerance, key='Btol'), &
            number=self%btol)
        call visitor%take(option_row_type('htol', '', &
            'tolerance of the iteration for H, with refine; 0 for constraint_tolerance', unset_or_tolerance, key='Htol'), &
            number=self%htol)
        call visitor%take(option_row_type('intol', '', &
            'tolerance of the iteration of implicit stages; 0 for constraint_tolerance/100, or more', &
            unset_or_tolerance), number=self%intol)
        call visitor%take(option_row_type('v_limit', '', &
            'limit on |v| in a chart, with paper; 0 for none; 70 degrees if no limit is set', limit), number=self%v_limit)
        call visitor%take(option_row_type('w_limit', '', &
            'limit on |w| in a chart, with paper; 0 for none', limit), number=self%w_limit)
        call visitor%take(option_row_type('condition_limit', '', &
            'limit on the condition number of (38), with paper; 0 for none', limit), number=self%condition_limit)
        call visitor%take(option_row_type('iteration_limit', '', &
            'limit on the corrections of u, B, H, with paper; 0 for none', limit), whole=self%iteration_limit)
        call visitor%take(option_row_type('secant_limit', '', &
            'limit on |D| and |Fbar| in a chart, with adaptive', above_one), number=self%secant_limit)
    end subroutine visit_course

    !> Refuse invalid values; the message names the option.
    subroutine check(self, error)
        class(options_type), intent(in) :: self
        type(error_type), allocatable, intent(out) :: error
        type(options_type) :: options
        type(checker_type) :: checker

        options = self
        call options%visit(checker)
        call move_alloc(checker%error, error)
    end subroutine check

    subroutine check_option(self, row, number, whole, word, list, choices)
        class(checker_type), intent(inout) :: self
        type(option_row_type), intent(in) :: row
        real(wp), intent(inout), optional :: number
        integer, intent(inout), optional :: whole
        character(len=*), intent(inout), optional :: word
        real(wp), allocatable, intent(inout), optional :: list(:)
        character(len=*), intent(in), optional :: choices(:)
        integer :: i

        if (allocated(self%error)) return
        if (present(word)) then
            call check_word(row, word, choices, self%error)
        else if (present(whole)) then
            if (row%problem_of(real(whole, wp)) /= '') call refuse('', to_text(whole), real(whole, wp))
        else if (present(number)) then
            if (row%problem_of(number) /= '') call refuse('', to_text(number), number)
        else if (allocated(list)) then
            do i = 1, size(list)
                if (row%problem_of(list(i)) == '') cycle
                call refuse('('//to_text(i)//')', to_text(list(i)), list(i))
                return
            end do
        end if
    contains
        subroutine refuse(place, text, value)
            character(len=*), intent(in) :: place, text
            real(wp), intent(in) :: value

            call set_error(self%error, status_invalid_option, trim(row%name)//place//' = '//text//' '//trim(row%problem_of(value)))
        end subroutine refuse
    end subroutine check_option

    !> Refuse an invalid word.
    subroutine check_word(row, word, choices, error)
        type(option_row_type), intent(in) :: row
        character(len=*), intent(in) :: word, choices(:)
        !> invalid_option with the list of valid words.
        type(error_type), allocatable, intent(out) :: error
        character(len=:), allocatable :: text
        integer :: i

        if (any(choices == word)) return
        text = trim(choices(1))
        do i = 2, size(choices)
            text = text//trim(merge(' or', ',  ', i == size(choices)))//' '//trim(choices(i))
        end do
        call set_error(error, status_invalid_option, trim(row%name)//' = "'//trim(word)//'" is unknown', 'use '//text)
    end subroutine check_word

    !> Problem of a number; blank if none.
    pure function problem_of(self, value) result(problem)
        class(option_row_type), intent(in) :: self
        real(wp), intent(in) :: value
        character(len=40) :: problem

        problem = ''
        select case (self%rule)
        case (from_one)
            if (.not. value >= 1.0_wp) problem = 'must be at least 1'
        case (above_one)
            if (.not. value > 1.0_wp) problem = 'must be above 1'
        case (unset_or_positive)
            if (.not. (value >= 0.0_wp .and. ieee_is_finite(value))) problem = 'must be positive and finite, or 0'
        case (limit)
            if (.not. (value >= 0.0_wp .and. ieee_is_finite(value))) problem = 'must be positive, or 0 for no limit'
        case (tolerance, unset_or_tolerance)
            if (self%rule == unset_or_tolerance .and. is_unset(value)) return
            if (.not. (value >= smallest_tolerance .and. value <= largest_tolerance)) problem = 'must lie between 1e-15 and 1e-2'
        case default ! Any number.
        end select
    end function problem_of

    !> Refuse lists of tolerances whose length is not the number of coordinates.
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

    !> True if steps follow an error estimate: a tolerance is given, or no step for a stepper with an estimate.
    pure logical function is_adaptive(self)
        class(options_type), intent(in) :: self

        is_adaptive = self%has_tolerance() .or. (is_unset(self%step) .and. .not. any(steppers_without_estimate == self%stepper))
    end function is_adaptive

    !> True if a relative tolerance is given.
    pure logical function has_tolerance(self)
        class(options_type), intent(in) :: self

        has_tolerance = .not. is_unset(self%rtol) .or. allocated(self%rtol_q) .or. allocated(self%rtol_qd)
    end function has_tolerance

    !> True if rtol is the only tolerance, relative and absolute.
    pure logical function has_one_tolerance(self)
        class(options_type), intent(in) :: self

        has_one_tolerance = abs(self%absolute_tolerance() - self%relative_tolerance()) <= 0.0_wp .and. .not. &
            (allocated(self%rtol_q) .or. allocated(self%rtol_qd) .or. allocated(self%atol_q) .or. allocated(self%atol_qd))
    end function has_one_tolerance

    !> True if any of the paper's limits on a chart is set.
    pure logical function has_paper_limits(self)
        class(options_type), intent(in) :: self

        has_paper_limits = self%v_limit > 0.0_wp .or. self%w_limit > 0.0_wp .or. self%condition_limit > 0.0_wp .or. &
            self%iteration_limit > 0
    end function has_paper_limits

    !> Smallest relative tolerance in use: rtol if it applies to all coordinates. 0 for fixed steps.
    pure real(wp) function relative_tolerance(self)
        class(options_type), intent(in) :: self

        relative_tolerance = huge(1.0_wp)
        if (allocated(self%rtol_q)) then
            relative_tolerance = minval(self%rtol_q)
        else if (.not. is_unset(self%rtol)) then
            relative_tolerance = self%rtol
        end if
        if (allocated(self%rtol_qd)) relative_tolerance = min(relative_tolerance, minval(self%rtol_qd))
        if (.not. self%has_tolerance()) relative_tolerance = merge(default_rtol, 0.0_wp, self%is_adaptive())
    end function relative_tolerance

    !> Absolute tolerance for all coordinates: atol, or its default.
    pure real(wp) function absolute_tolerance(self)
        class(options_type), intent(in) :: self

        absolute_tolerance = merge(self%relative_tolerance(), self%atol, is_unset(self%atol))
    end function absolute_tolerance

    !> Tolerances of every coordinate and velocity.
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

    !> utol, or its default.
    pure real(wp) function position_tolerance(self)
        class(options_type), intent(in) :: self

        position_tolerance = merge(max(0.01_wp*self%constraint_tolerance, smallest_tolerance), self%utol, is_unset(self%utol))
    end function position_tolerance

    !> Tolerance of (17) within a step under error control: a small part of the allowed error. 0 if it is that of the ends of steps;
    !> a given utol applies everywhere. The part: errors of runs did not grow with 0.001, but with 0.01 those of a disk that spins
    !> at 1000 rad/s were three times as large.
    pure real(wp) function stage_tolerance(self)
        class(options_type), intent(in) :: self
        real(wp), parameter :: part = 3.0e-3_wp

        stage_tolerance = 0.0_wp
        if (is_unset(self%utol) .and. self%is_adaptive()) stage_tolerance = part*self%relative_tolerance()
    end function stage_tolerance

    !> Btol, or its default.
    pure real(wp) function b_tolerance(self)
        class(options_type), intent(in) :: self

        b_tolerance = merge(self%constraint_tolerance, self%btol, is_unset(self%btol))
    end function b_tolerance

    !> Htol, or its default.
    pure real(wp) function h_tolerance(self)
        class(options_type), intent(in) :: self

        h_tolerance = merge(self%constraint_tolerance, self%htol, is_unset(self%htol))
    end function h_tolerance

    !> intol, or its default. Steps shrink as rtol**(1/4), and the error of Radau IIA with three stages at the end of a run as their
    !> fifth power: the remainders of the iteration must shrink as rtol**(5/4), or they dominate at tight tolerances.
    pure real(wp) function newton_tolerance(self)
        class(options_type), intent(in) :: self

        newton_tolerance = self%intol
        if (is_unset(self%intol)) newton_tolerance = max(0.01_wp*self%constraint_tolerance, &
            min(1.0e-3_wp, 1.0e-2_wp*self%relative_tolerance()**0.25_wp)*self%relative_tolerance(), smallest_tolerance)
    end function newton_tolerance

    !> Pack all options that affect the course of a run.
    subroutine pack_state(self, pack)
        class(options_type), intent(inout) :: self
        type(pack_type), intent(inout), target :: pack
        type(packer_type) :: packer

        packer%pack => pack
        call self%visit_course(packer)
    end subroutine pack_state

    subroutine pack_option(self, row, number, whole, word, list, choices)
        class(packer_type), intent(inout) :: self
        type(option_row_type), intent(in) :: row
        real(wp), intent(inout), optional :: number
        integer, intent(inout), optional :: whole
        character(len=*), intent(inout), optional :: word
        real(wp), allocatable, intent(inout), optional :: list(:)
        character(len=*), intent(in), optional :: choices(:)

        if (present(number)) then
            call self%pack%item(number)
        else if (present(whole)) then
            call self%pack%item(whole)
        else if (present(word)) then
            call self%pack%item(word)
        else
            call self%pack%item(list)
        end if
    end subroutine pack_option

    !> First of the options in `pack_state` with a different value in another set, blank if there is none.
    function first_difference(self, other) result(name)
        class(options_type), intent(in) :: self
        type(options_type), intent(in) :: other
        character(len=20) :: name
        type(options_type) :: options
        type(comparer_type) :: comparer

        options = self
        allocate (comparer%words(0))
        call options%visit_course(comparer)
        comparer%is_comparing = .true.
        options = other
        call options%visit_course(comparer)
        name = comparer%difference
    end function first_difference

    subroutine compare_option(self, row, number, whole, word, list, choices)
        class(comparer_type), intent(inout) :: self
        type(option_row_type), intent(in) :: row
        real(wp), intent(inout), optional :: number
        integer, intent(inout), optional :: whole
        character(len=*), intent(inout), optional :: word
        real(wp), allocatable, intent(inout), optional :: list(:)
        character(len=*), intent(in), optional :: choices(:)
        integer(long), allocatable :: bits(:)
        integer :: i

        if (present(number)) then
            ! Adding zero converts a negative zero.
            allocate (bits, source=transfer([number + 0.0_wp], [0_long]))
        else if (present(whole)) then
            allocate (bits, source=[int(whole, long)])
        else if (present(word)) then
            allocate (bits, source=[(iachar(word(i:i), long), i=1, len(word))])
        else if (allocated(list)) then
            allocate (bits, source=transfer(list + 0.0_wp, [0_long]))
        else
            allocate (bits(0))
        end if
        bits = [size(bits, kind=long), bits]
        if (.not. self%is_comparing) then
            self%words = [self%words, bits]
        else if (self%difference == '') then
            ! If the sizes differ, the first word differs; nothing is compared after it.
            if (self%words(self%n + 1) /= bits(1)) then
                self%difference = row%name
            else if (any(self%words(self%n + 1:self%n + size(bits)) /= bits)) then
                self%difference = row%name
            end if
            self%n = self%n + size(bits)
        end if
    end subroutine compare_option

    !> True if a tolerance is zero, which selects its default.
    pure elemental logical function is_unset(value)
        real(wp), intent(in) :: value

        is_unset = abs(value) <= 0.0_wp
    end function is_unset

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
end module tandem_options
