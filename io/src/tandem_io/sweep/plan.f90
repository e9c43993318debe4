! SPDX-License-Identifier: MIT
!> Description of a sweep: a scene, inputs with their distributions, and kept quantities. The inputs of a case follow from the
!> number of the case alone.
!>
!> Cases are counted from 1. The order is: rows of the file of cases (outermost), lists (the last list varies fastest), draws
!> (innermost). The draws are the same at all points of the grid, so that the points can be compared.
module tandem_io_sweep_plan
    use tandem, only: atom_type, is_number, long, wp
    use tandem_io_scene_description, only: description_type
    use tandem_io_sweep_kept, only: kept_type
    use tandem_io_sweep_quantile, only: normal_quantile
    use tandem_io_sweep_random, only: permuted, random_number_at, random_words, stream_draw, stream_shift, stream_stratum
    use tandem_io_sweep_sobol, only: most_columns, sobol_type
    implicit none (type, external)
    private

    public :: plan_type, input_type, is_listed, is_from_file, is_uniform, is_log_uniform, is_normal, points_names, name_length
    public :: is_log_normal, is_triangular, is_choice
    public :: no_slash, reserved_names, random_points, latin_points, sobol_points

    !> Largest length of the name of an input.
    integer, parameter :: name_length = 160
    !> Reason for refusing a name with a slash.
    character(len=*), parameter :: no_slash = 'must not contain a slash, since it names a dataset'
    !> Names of columns that every table has.
    character(len=7), parameter :: reserved_names(4) = [character(len=7) :: 'case', 'status', 'seconds', 'message']
    !> Sources and distributions of the values of an input.
    integer, parameter :: is_listed = 1, is_from_file = 2, is_uniform = 3, is_log_uniform = 4, is_normal = 5, &
        is_log_normal = 6, is_triangular = 7, is_choice = 8
    !> Names of the methods by which draws are distributed.
    character(len=6), parameter :: points_names(3) = [character(len=6) :: 'random', 'latin', 'sobol']
    !> Indices of `points_names`.
    integer, parameter :: random_points = 1, latin_points = 2, sobol_points = 3

    !> An input of the sweep: a value of the scene that differs between cases.
    type :: input_type
        !> Key in the scene, `table.key`; index of an element if the value is a list, 0 for the whole value.
        character(len=:), allocatable :: path
        integer :: element = 0
        !> Name and unit in the table.
        character(len=name_length) :: name = ''
        character(len=32) :: unit = ''
        !> One of the kinds above.
        integer :: kind = is_listed
        !> Values of a list, of a column of the file of cases, or of a choice.
        type(atom_type), allocatable :: values(:)
        !> Bounds of an interval, or mean and standard deviation (of the logarithm for `is_log_normal`); mode of a triangular
        !> distribution.
        real(wp) :: a = 0.0_wp, b = 1.0_wp, mode = 0.5_wp
        !> True if a normal distribution is truncated; its limits.
        logical :: is_limited = .false.
        real(wp) :: low = 0.0_wp, high = 0.0_wp
        !> Index among the random inputs; index of the setting that passes the input to the scene.
        integer :: column = 0, setting = 0
        !> True if the values are texts, which are represented by their indices.
        logical :: holds_texts = .false.
    contains
        procedure :: is_drawn, value_at, probability_within
        procedure, private :: truncated_quantile
        procedure :: typical
    end type input_type

    type :: plan_type
        !> Path and text of the file of the sweep, and path of the scene.
        character(len=:), allocatable :: path, text, scene_path
        !> Path of the file of cases; empty if there is none.
        character(len=:), allocatable :: cases_path
        !> Settings of the scene given in the file of the sweep, as on the command line.
        character(len=:), allocatable :: settings(:)
        !> Settings that pass the inputs to the scene, initially with typical values; they are applied after `settings`.
        character(len=:), allocatable :: carriers(:)
        !> Keys of the scene with all settings applied; number of settings before `carriers`.
        type(description_type) :: scene_keys
        integer :: n_settings = 0
        !> Complete scene with all defaults, for the table.
        character(len=:), allocatable :: scene_text
        type(input_type), allocatable :: inputs(:)
        type(kept_type), allocatable :: kept(:)
        !> Number of draws per point of the grid, their method, and the seed.
        integer :: draws = 1, points = random_points, seed = 1
        !> True if Sobol' points are shifted at random; true if lists are combined row by row instead of as a grid.
        logical :: is_shifted = .true., is_side_by_side = .false.
        !> True if draws are arranged for Sobol' indices: each block consists of two points A and B, and of copies of A with one
        !> coordinate of B each.
        logical :: is_for_indices = .false.
        !> Largest time of a case, seconds; 0 for no limit.
        real(wp) :: max_seconds = 0.0_wp
        !> Folder for complete trajectories; empty if they are not kept.
        character(len=:), allocatable :: folder
        !> Checksum of the file of cases; blank if there is none.
        character(len=16) :: file_sum = ''
        !> Number of rows of the file of cases, of points of the grid, and of draws per point; number of random inputs.
        integer(long) :: n_rows = 1, n_points = 1, n_draws = 1
        integer :: n_drawn = 0
        type(sobol_type), private :: sobol
    contains
        procedure :: complete, n_cases, n_outputs, numbers_of, atom_of
        procedure, private :: uniform_number
    end type plan_type

contains

    !> True if an input is random.
    pure logical function is_drawn(self)
        class(input_type), intent(in) :: self

        is_drawn = self%kind >= is_uniform
    end function is_drawn

    !> Value of a random input for a uniformly distributed number `u` between 0 and 1.
    pure real(wp) function value_at(self, u) result(value)
        class(input_type), intent(in) :: self
        real(wp), intent(in) :: u

        select case (self%kind)
        case (is_uniform)
            value = self%a + (self%b - self%a)*u
        case (is_log_uniform)
            value = exp(log(self%a) + (log(self%b) - log(self%a))*u)
        case (is_triangular)
            if (u*(self%b - self%a) < self%mode - self%a) then
                value = self%a + sqrt(u*(self%b - self%a)*(self%mode - self%a))
            else
                value = self%b - sqrt((1.0_wp - u)*(self%b - self%a)*(self%b - self%mode))
            end if
        case (is_choice)
            value = real(min(size(self%values), 1 + int(u*size(self%values))), wp)
            if (.not. self%holds_texts) value = self%values(nint(value))%number
        case default
            value = self%a + self%b*self%truncated_quantile(u)
            if (self%kind == is_log_normal) value = exp(value)
            ! Rounding may exceed the limits.
            if (self%is_limited) value = max(self%low, min(self%high, value))
        end select
    end function value_at

    !> Quantile of the standard normal distribution, truncated to the limits if there are any.
    pure real(wp) function truncated_quantile(self, u) result(z)
        class(input_type), intent(in) :: self
        real(wp), intent(in) :: u
        real(wp) :: p(2)

        if (.not. self%is_limited) then
            z = normal_quantile(u)
            return
        end if
        p = probabilities(self)
        z = normal_quantile(p(1) + (p(2) - p(1))*u)
        if (p(2) < p(1)) z = -z
    end function truncated_quantile

    !> Probability that a normally distributed input lies within its limits.
    pure real(wp) function probability_within(self)
        class(input_type), intent(in) :: self
        real(wp) :: p(2)

        p = [0.0_wp, 1.0_wp]
        if (self%is_limited) p = probabilities(self)
        probability_within = abs(p(2) - p(1))
    end function probability_within

    !> Probabilities below each limit. If both limits are above the mean, probabilities above each limit, which lose no digits.
    pure function probabilities(self) result(p)
        class(input_type), intent(in) :: self
        real(wp) :: p(2), ends(2)

        ends = [self%low, self%high]
        if (self%kind == is_log_normal) ends = log(ends)
        ends = (ends - self%a)/self%b
        if (ends(1) > 0.0_wp) ends = -ends
        p = 0.5_wp*erfc(-ends/sqrt(2.0_wp))
    end function probabilities

    !> Representative value: the first of a list, the median of a distribution.
    pure function typical(self) result(atom)
        class(input_type), intent(in) :: self
        type(atom_type) :: atom

        if (self%is_drawn() .and. self%kind /= is_choice) then
            atom%number = self%value_at(0.5_wp)
        else
            atom = self%values(1)
        end if
    end function typical

    !> Count the cases after all inputs have been read.
    subroutine complete(self)
        class(plan_type), intent(inout) :: self
        integer :: i

        self%n_drawn = 0
        self%n_rows = 1
        self%n_points = 1
        do i = 1, size(self%inputs)
            associate (input => self%inputs(i))
                if (allocated(input%values)) input%holds_texts = any(input%values%kind /= is_number)
                if (input%is_drawn()) then
                    self%n_drawn = self%n_drawn + 1
                    input%column = self%n_drawn
                else if (input%kind == is_from_file) then
                    self%n_rows = size(input%values)
                else if (self%is_side_by_side) then
                    self%n_points = size(input%values)
                else
                    self%n_points = self%n_points*size(input%values)
                end if
            end associate
        end do
        self%n_draws = self%draws
        if (self%is_for_indices) self%n_draws = self%n_draws*(self%n_drawn + 2)
        if (self%points == sobol_points) call self%sobol%prepare(min(most_columns, &
            merge(2, 1, self%is_for_indices)*self%n_drawn))
    end subroutine complete

    !> Number of cases.
    pure integer(long) function n_cases(self)
        class(plan_type), intent(in) :: self

        n_cases = self%n_rows*self%n_points*self%n_draws
    end function n_cases

    !> Number of kept numbers per case.
    pure integer function n_outputs(self)
        class(plan_type), intent(in) :: self
        integer :: i

        n_outputs = 0
        do i = 1, size(self%kept)
            n_outputs = n_outputs + self%kept(i)%width()
        end do
    end function n_outputs

    !> Inputs of a case as numbers; for texts, the indices of the texts.
    pure subroutine numbers_of(self, case, numbers)
        class(plan_type), intent(in) :: self
        !> Number of the case, from 1 to `n_cases`.
        integer(long), intent(in) :: case
        real(wp), intent(out) :: numbers(:)
        integer(long) :: draw, grid_point, row
        integer :: i, chosen

        draw = mod(case - 1, self%n_draws)
        grid_point = mod((case - 1)/self%n_draws, self%n_points)
        row = (case - 1)/self%n_draws/self%n_points
        ! The last list varies fastest.
        do i = size(self%inputs), 1, -1
            associate (input => self%inputs(i))
                if (input%is_drawn()) then
                    numbers(i) = input%value_at(self%uniform_number(draw, input%column))
                    cycle
                else if (input%kind == is_from_file) then
                    chosen = int(row) + 1
                else if (self%is_side_by_side) then
                    chosen = int(grid_point) + 1
                else
                    chosen = int(mod(grid_point, size(input%values, kind=long))) + 1
                    grid_point = grid_point/size(input%values)
                end if
                if (input%holds_texts) then
                    numbers(i) = real(chosen, wp)
                else
                    numbers(i) = input%values(chosen)%number
                end if
            end associate
        end do
    end subroutine numbers_of

    !> Value that a number of `numbers_of` represents.
    pure function atom_of(self, i, number) result(atom)
        class(plan_type), intent(in) :: self
        !> Index of the input.
        integer, intent(in) :: i
        real(wp), intent(in) :: number
        type(atom_type) :: atom

        if (self%inputs(i)%holds_texts) then
            atom = self%inputs(i)%values(nint(number))
        else
            atom%number = number
        end if
    end function atom_of

    !> Uniformly distributed number between 0 and 1 of a draw in a column.
    pure real(wp) function uniform_number(self, draw, column) result(u)
        class(plan_type), intent(in) :: self
        !> Number of the draw, from 0.
        integer(long), intent(in) :: draw
        integer, intent(in) :: column
        integer(long) :: point, words(4)
        integer :: from, part

        point = draw
        from = column
        if (self%is_for_indices) then
            point = draw/(self%n_drawn + 2)
            part = int(mod(draw, int(self%n_drawn + 2, long)))
            ! Part 0 of a block is A, part 1 is B, part j + 1 is A with coordinate j of B.
            if (part == 1 .or. part == column + 1) from = column + self%n_drawn
        end if
        select case (self%points)
        case (sobol_points)
            words = 0
            if (self%is_shifted) words = random_words(self%seed, 0_long, from, stream_shift)
            u = (real(ieor(self%sobol%point(point, from), words(1)), wp) + 0.5_wp)*2.0_wp**(-32)
        case (latin_points)
            u = (real(permuted(self%seed, point, int(self%draws, long), from), wp) + &
                random_number_at(self%seed, point, from, stream_stratum))/real(self%draws, wp)
        case default
            u = random_number_at(self%seed, point, from, stream_draw)
        end select
    end function uniform_number
end module tandem_io_sweep_plan
