! SPDX-License-Identifier: MIT
!> A model at rest at one point, for the analysis of large mechanisms: M, K = (C' lambda - S - Q_A)_q and D = -(S + Q_A)_qd by
!> bodies that share rows or forces, in memory and time proportional to their number. In a steady motion it is at rest in
!> co-rotating coordinates (`corotating_frame.f90`): M (L X q + 2 L qd) is then one of the forces, and rows at velocity level depend
!> on coordinates.
!>
!> K and D are central differences of eighth order along groups of coordinates whose bodies have no neighbour in common, so that
!> their number does not grow with the number of bodies. A comparison along a random direction detects entries missing from the
!> pattern.
!>
!> Source: A. R. Curtis, M. J. D. Powell, J. K. Reid, J. Inst. Maths Applics 13 (1974) 117-119.
module tandem_analysis_sparse_point
    use tandem_analysis_corotating_frame, only: corotating_frame_type
    use tandem_error, only: error_type, set_error
    use tandem_kinds, only: wp
    use tandem_linalg_order, only: list_type
    use tandem_model, only: model_type
    use tandem_model_counts, only: counts_type
    use tandem_model_derivatives, only: derivatives_type
    use tandem_model_differences, only: differences_type
    use tandem_model_evaluator, only: evaluator_type
    use tandem_model_neighbours, only: find_groups, find_neighbours
    use tandem_model_pattern, only: pattern_type
    use tandem_model_terms, only: need_force, need_gamma, need_jacobian, need_mass, need_nu, need_phi
    use tandem_saddle, only: saddle_too_large, saddle_type
    use tandem_saddle_columns, only: columns_type
    use tandem_saddle_sparse, only: sparse_saddle_type
    use tandem_status, only: status_invalid_model, status_not_finite, status_ok, status_singular_mass, status_work_limit
    implicit none (type, external)
    private

    public :: sparse_point_type, rounding_of_differences

    type :: sparse_point_type
        !> Numbers of coordinates, rows of Phi and rows of C.
        integer :: n = 0, nh = 0, m = 0
        real(wp) :: t = 0.0_wp
        !> The point, coordinate scales, the velocities there, X q (n); multipliers (m).
        real(wp), allocatable :: q(:), scale(:), rest(:), lambda(:)
        !> The co-rotating frame.
        type(corotating_frame_type) :: frame
        !> (C X q - nu)_q of rows at velocity level, compressed as C.
        real(wp), allocatable :: turning(:, :)
        !> Rows that depend on others (m): they take no part, and their multipliers are zero.
        logical, allocatable :: is_out(:)
        !> K, D and M by columns.
        type(columns_type) :: columns
        real(wp), allocatable :: stiffness(:), damping(:), mass(:)
        type(evaluator_type) :: evaluator
        type(counts_type) :: counts
        class(model_type), pointer :: model => null()
        type(pattern_type), pointer :: pattern => null()
        !> C' lambda - S - Q_A (n).
        real(wp), allocatable :: residual(:)
        !> Sums of the sizes of its terms (n).
        real(wp), allocatable :: sizes(:)
        !> The system of the last `find_dependent_rows`.
        class(saddle_type), allocatable :: ties
        !> The model's own derivatives, used for full matrices.
        type(differences_type), allocatable, private :: differences
        type(derivatives_type), allocatable, private :: derivatives
        !> Groups of bodies.
        integer, allocatable, private :: group(:)
        integer, private :: n_groups = 0
    contains
        procedure :: initialize, attach, look, balance, find_dependent_rows
        procedure :: differentiate, check_structure
        procedure :: load, multiply
        procedure :: imbalance, violation, row_length, row_times, turning_times, row_size, size_errors
        procedure, private :: add_forces
    end type sparse_point_type

    !> Largest number of groups of bodies: with more the matrix would be practically dense.
    integer, parameter :: most_groups = 100
    !> K and D are differences with steps of some 1/256 of the scale, which amplify the rounding of forces by this factor.
    real(wp), parameter :: rounding_of_differences = 3000*epsilon(1.0_wp)
    interface
        !> K and D for the point's multipliers.
        module subroutine differentiate(self, with_damping, stat, is_rough)
            implicit none (type, external)
            class(sparse_point_type), intent(inout) :: self
            logical, intent(in) :: with_damping
            !> A status code.
            integer, intent(out) :: stat
            !> True for differences of second order, a quarter of the work.
            logical, intent(in), optional :: is_rough
        end subroutine differentiate

        !> Compare K and D times a random direction with differences along it: detects forces between bodies that the model does not
        !> declare, and laws that change within a step of differences.
        module subroutine check_structure(self, error)
            implicit none (type, external)
            class(sparse_point_type), intent(inout) :: self
            type(error_type), allocatable, intent(out) :: error
        end subroutine check_structure
    end interface

contains

    !> Attach a model that `check_model` has accepted. Errors: invalid_model if it has no pattern or too many neighbours.
    subroutine initialize(self, model, error)
        class(sparse_point_type), intent(inout) :: self
        !> It must outlive the point.
        class(model_type), intent(inout), target :: model
        type(error_type), allocatable, intent(out) :: error

        if (.not. allocated(model%pattern)) then
            call set_error(error, status_invalid_model, 'the model "'//model%name//'" does not state which rows '// &
                'involve which bodies, as required for large systems', 'use full matrices (tandem linearise without --near)')
            return
        end if
        if (any(model%is_idle())) then
            call set_error(error, status_invalid_model, 'the model "'//model%name//'" has locked couplings', &
                'use full matrices (tandem linearise without --near)')
            return
        end if
        if (model%n_frictions > 0) then
            call set_error(error, status_invalid_model, 'in the model "'//model%name//'" friction depends on reactions', &
                'linearise it without a shift')
            return
        end if
        allocate (sparse_saddle_type :: self%ties)
        call self%attach(model, model%pattern, is_compressed=.true.)
        if (self%n_groups > most_groups) call set_error(error, status_invalid_model, 'a body of the model "'//model%name// &
            '" has too many neighbours for differences by groups of bodies', &
            'use full matrices (tandem linearise without --near)')
    end subroutine initialize

    !> The same with the given pattern, which may be that of full matrices, and the allocated `ties`.
    subroutine attach(self, model, pattern, is_compressed)
        class(sparse_point_type), intent(inout) :: self
        class(model_type), intent(inout), target :: model
        type(pattern_type), intent(in), target :: pattern
        !> True if the model stores its terms compressed by the pattern.
        logical, intent(in) :: is_compressed
        type(list_type), allocatable :: neighbours(:)

        self%model => model
        self%pattern => pattern
        self%n = model%n
        self%nh = model%n_holonomic
        self%m = model%n_constraints()
        self%scale = model%scales()
        self%rest = spread(0.0_wp, 1, self%n)
        self%q = self%rest
        self%residual = self%rest
        self%sizes = self%rest
        self%lambda = spread(0.0_wp, 1, self%m)
        self%is_out = spread(.false., 1, self%m)
        call self%evaluator%initialize(model, compressed=is_compressed)
        call find_neighbours(pattern, neighbours)
        call find_groups(neighbours, most_groups, self%group, self%n_groups)
        call self%ties%analyse(pattern, self%scale)
        self%ties%drops_dependent = .true.
        self%columns = self%ties%columns
        self%stiffness = spread(0.0_wp, 1, size(self%columns%row))
        self%damping = self%stiffness
        self%mass = self%stiffness
        if (is_compressed) return
        allocate (self%differences, self%derivatives)
        call self%differences%initialize(model, self%scale, saves_memory=.true.)
        if (self%differences%has_all_derivatives()) then
            call self%derivatives%allocate(self%n, self%m)
        else
            deallocate (self%differences, self%derivatives)
        end if
    end subroutine attach

    !> All terms at rest at a point, or with other velocities, with M in columns.
    subroutine look(self, t, q, stat, qd)
        class(sparse_point_type), intent(inout) :: self
        real(wp), intent(in) :: t, q(:)
        !> A status code.
        integer, intent(out) :: stat
        real(wp), intent(in), optional :: qd(:)
        integer :: i, j, k, column

        self%t = t
        self%q = q
        self%rest = self%frame%velocity(q)
        if (present(qd)) self%rest = qd
        call self%evaluator%evaluate(need_phi + need_jacobian + need_nu + need_gamma + need_mass + need_force, t, self%q, &
            self%rest, self%counts, stat)
        if (stat /= status_ok) return
        associate (terms => self%evaluator%terms)
            if (.not. (sum(abs(terms%jacobian)) <= huge(1.0_wp) .and. sum(abs(terms%mass)) <= huge(1.0_wp) .and. &
                sum(abs(terms%force)) <= huge(1.0_wp) .and. sum(abs(terms%phi)) <= huge(1.0_wp) .and. &
                sum(abs(terms%gamma)) <= huge(1.0_wp) .and. sum(abs(terms%nu)) <= huge(1.0_wp))) then
                stat = status_not_finite
                return
            end if
            self%mass = 0.0_wp
            do j = 1, self%n
                do k = self%columns%start(j), self%columns%start(j + 1) - 1
                    i = self%columns%row(k)
                    ! The block of M of column j begins at the coordinate whose compressed column is 1.
                    if (i - self%pattern%mass_column(i) /= j - self%pattern%mass_column(j)) cycle
                    column = self%pattern%mass_column(j)
                    self%mass(k) = terms%mass(i, column)
                end do
            end do
        end associate
    end subroutine look

    !> C' lambda - S - Q_A of the last point, and the sizes of its terms.
    subroutine balance(self)
        class(sparse_point_type), intent(inout) :: self

        real(wp) :: inertia(self%n)

        call add_forces(self, self%lambda, self%frame%turned(self%rest), self%residual)
        self%sizes = abs(self%evaluator%terms%force)
        call self%pattern%add_transposed(self%evaluator%terms%jacobian, self%lambda, .true., self%sizes)
        if (.not. self%frame%moves) return
        call self%pattern%multiply_mass(self%evaluator%terms%mass, self%frame%turned(self%rest), inertia)
        self%sizes = self%sizes + abs(inertia)
    end subroutine balance

    !> Residual of the forces over the size of their terms: a relative error of the coordinates of this size would explain it. After
    !> `differentiate` and `balance`.
    pure real(wp) function imbalance(self)
        class(sparse_point_type), intent(in) :: self
        real(wp), dimension(self%n) :: product, sizes

        call self%columns%multiply(self%stiffness, self%scale, product, sizes)
        sizes = self%sizes + sizes*(1 + maxval(abs(self%q/self%scale)))
        imbalance = maxval(abs(self%residual)/max(sizes, 1.0e-6_wp*maxval(sizes), tiny(1.0_wp)))
    end function imbalance

    !> The largest error of a position row over the natural scale of the row.
    pure real(wp) function violation(self)
        class(sparse_point_type), intent(in) :: self
        real(wp) :: scales(self%nh)

        scales = 0.0_wp
        call self%pattern%add_row_scales(self%evaluator%terms%jacobian, self%q, self%scale, scales)
        violation = maxval([0.0_wp, abs(self%evaluator%terms%phi)/max(scales, tiny(1.0_wp))])
    end function violation

    !> C' lambda - S - Q_A with the evaluator's terms, at an acceleration (n).
    subroutine add_forces(self, lambda, acceleration, residual)
        class(sparse_point_type), intent(in) :: self
        real(wp), intent(in) :: lambda(:)
        real(wp), intent(in), contiguous :: acceleration(:)
        real(wp), intent(out), contiguous :: residual(:)

        residual = 0.0_wp
        if (self%frame%moves) call self%pattern%multiply_mass(self%evaluator%terms%mass, acceleration, residual)
        residual = residual - self%evaluator%terms%force
        call self%pattern%add_transposed(self%evaluator%terms%jacobian, lambda, .false., residual)
    end subroutine add_forces

    !> Find the rows that depend on others, and the acceleration (n) from rest with its multipliers; with a metric D in place of M,
    !> D^-1 times the remaining forces.
    subroutine find_dependent_rows(self, acceleration, stat, metric)
        class(sparse_point_type), intent(inout) :: self
        real(wp), allocatable, intent(out) :: acceleration(:)
        !> A status code.
        integer, intent(out) :: stat
        !> The diagonal of D (n).
        real(wp), intent(in), optional :: metric(:)
        real(wp) :: gamma(self%m), h(size(self%columns%row))

        self%is_out = .false.
        self%ties%is_out = .false.
        gamma = self%evaluator%terms%gamma
        h = self%mass
        if (present(metric)) then
            gamma = 0.0_wp
            h = 0.0_wp
            call self%columns%add_diagonal(metric, h)
        end if
        call self%ties%load(h, self%evaluator%terms%jacobian)
        call self%ties%factor(stat)
        if (stat /= 0) then
            stat = merge(status_work_limit, status_singular_mass, stat == saddle_too_large)
            return
        end if
        self%is_out = self%ties%is_out
        allocate (acceleration(self%n))
        call self%ties%solve(self%evaluator%terms%force, -gamma, acceleration, self%lambda)
    end subroutine find_dependent_rows

    !> y = (cm M + cd D + ck K) x.
    pure subroutine multiply(self, c, x, y)
        class(sparse_point_type), intent(in) :: self
        !> cm, cd, ck.
        complex(wp), intent(in) :: c(3), x(:)
        complex(wp), intent(out) :: y(:)
        integer :: j, k

        y = (0.0_wp, 0.0_wp)
        do j = 1, self%n
            do k = self%columns%start(j), self%columns%start(j + 1) - 1
                associate (i => self%columns%row(k))
                    y(i) = y(i) + (c(1)*self%mass(k) + c(2)*self%damping(k) + c(3)*self%stiffness(k))*x(j)
                end associate
            end do
        end do
    end subroutine multiply

    !> Load H = cm M + cd D + ck K, without rows that are left out. Rows at velocity level are below C + ck/cd (C X q - nu)_q if cd
    !> is not zero.
    subroutine load(self, c, saddle)
        class(sparse_point_type), intent(in) :: self
        complex(wp), intent(in) :: c(3)
        type(sparse_saddle_type), intent(inout) :: saddle

        if (saddle%n == 0) call saddle%analyse(self%pattern, self%scale)
        saddle%is_out = self%is_out
        associate (h => c(1)*self%mass + c(2)*self%damping + c(3)*self%stiffness, jacobian => self%evaluator%terms%jacobian)
            if (self%m > self%nh .and. abs(c(2)) > 0.0_wp) then
                call saddle%load_complex(h, jacobian, self%turning, c(3)/c(2))
            else
                call saddle%load_complex(h, jacobian)
            end if
        end associate
    end subroutine load

    !> The length of a row of C, 1 for one of zeros.
    pure real(wp) function row_length(self, i) result(length)
        class(sparse_point_type), intent(in) :: self
        integer, intent(in) :: i
        integer :: j, k

        length = 0.0_wp
        associate (pattern => self%pattern)
            do k = pattern%row_start(i), pattern%row_start(i + 1) - 1
                do j = pattern%first(pattern%row_body(k)), pattern%first(pattern%row_body(k) + 1) - 1
                    length = length + self%evaluator%terms%jacobian(i, pattern%column(j))**2
                end do
            end do
        end associate
        length = sqrt(length)
        if (.not. length > 0.0_wp) length = 1.0_wp
    end function row_length

    !> Row i of C times x (n); at velocity level of C + (C X q - nu)_q/value if a value is given.
    pure complex(wp) function row_times(self, i, x, value) result(product)
        class(sparse_point_type), intent(in) :: self
        integer, intent(in) :: i
        complex(wp), intent(in) :: x(:)
        complex(wp), intent(in), optional :: value
        integer :: j, k

        product = (0.0_wp, 0.0_wp)
        associate (pattern => self%pattern)
            do k = pattern%row_start(i), pattern%row_start(i + 1) - 1
                do j = pattern%first(pattern%row_body(k)), pattern%first(pattern%row_body(k) + 1) - 1
                    product = product + self%evaluator%terms%jacobian(i, pattern%column(j))*x(j)
                end do
            end do
        end associate
        if (present(value) .and. i > self%nh) product = product + self%turning_times(i, x)/value
    end function row_times

    !> (C X q - nu)_q of a row times x (n); zero of a row of Phi.
    pure complex(wp) function turning_times(self, i, x) result(product)
        class(sparse_point_type), intent(in) :: self
        integer, intent(in) :: i
        complex(wp), intent(in) :: x(:)
        integer :: j, k

        product = (0.0_wp, 0.0_wp)
        if (i <= self%nh .or. .not. allocated(self%turning)) return
        associate (pattern => self%pattern)
            do k = pattern%row_start(i), pattern%row_start(i + 1) - 1
                do j = pattern%first(pattern%row_body(k)), pattern%first(pattern%row_body(k) + 1) - 1
                    product = product + self%turning(i, pattern%column(j))*x(j)
                end do
            end do
        end associate
    end function turning_times

    !> Sum of the sizes of the terms of row i of C times x (n).
    pure real(wp) function row_size(self, i, x) result(total)
        class(sparse_point_type), intent(in) :: self
        integer, intent(in) :: i
        complex(wp), intent(in) :: x(:)
        integer :: j, k

        total = 0.0_wp
        associate (pattern => self%pattern)
            do k = pattern%row_start(i), pattern%row_start(i + 1) - 1
                do j = pattern%first(pattern%row_body(k)), pattern%first(pattern%row_body(k) + 1) - 1
                    total = total + abs(self%evaluator%terms%jacobian(i, pattern%column(j))*x(j))
                end do
            end do
        end associate
    end function row_size

    !> Bounds on the errors of (lambda^2 M + lambda D + K) x (n): a part of each term, and rounding of the differences in K and D,
    !> for forces as large as the terms of the balance and as the changes of forces by K and D due to rounding of coordinates.
    pure subroutine size_errors(self, lambda, part, x, sizes)
        class(sparse_point_type), intent(in) :: self
        !> The modulus of lambda, the part, and moduli of x (n).
        real(wp), intent(in) :: lambda, part, x(:)
        real(wp), intent(out) :: sizes(:)
        real(wp), dimension(self%n) :: forces, of_q, of_qd, scaled
        integer :: j, k

        scaled = max(abs(self%q), self%scale/64)
        call self%columns%multiply(self%stiffness, scaled, forces, of_q)
        call self%columns%multiply(self%damping, max(abs(self%rest), self%scale/64), forces, of_qd)
        forces = self%sizes + of_q + of_qd
        sizes = 0.0_wp
        do j = 1, self%n
            do k = self%columns%start(j), self%columns%start(j + 1) - 1
                associate (i => self%columns%row(k))
                    sizes(i) = sizes(i) + (part*(lambda**2*abs(self%mass(k)) + lambda*abs(self%damping(k)) + &
                        abs(self%stiffness(k))) + rounding_of_differences*(1 + lambda)*forces(i)/self%scale(j))*x(j)
                end associate
            end do
        end do
    end subroutine size_errors
end module tandem_analysis_sparse_point
