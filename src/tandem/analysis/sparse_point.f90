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
    use tandem_linalg_sparse_lu, only: sparse_lu_type, sparse_matrix_type
    use tandem_model, only: model_type
    use tandem_model_counts, only: counts_type
    use tandem_model_evaluator, only: evaluator_type
    use tandem_model_neighbours, only: find_groups, find_neighbours, order_unknowns
    use tandem_model_pattern, only: pattern_type
    use tandem_model_terms, only: need_force, need_gamma, need_jacobian, need_mass, need_nu, need_phi
    use tandem_status, only: status_invalid_model, status_not_finite, status_ok, status_singular_mass, status_work_limit
    implicit none (type, external)
    private

    public :: sparse_point_type, most_factor_entries, rounding_of_differences

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
        !> Columns of K, D and M: column j has the entries start(j) to start(j + 1) - 1, in the rows of its body and of its
        !> neighbours.
        integer, allocatable :: start(:), row(:)
        real(wp), allocatable :: stiffness(:), damping(:), mass(:)
        type(evaluator_type) :: evaluator
        type(counts_type) :: counts
        class(model_type), pointer :: model => null()
        type(pattern_type), pointer :: pattern => null()
        !> C' lambda - S - Q_A (n).
        real(wp), allocatable :: residual(:)
        !> Sums of the sizes of its terms (n).
        real(wp), allocatable :: sizes(:)
        !> [M/unit, C'; C, 0] and its factors, of the last `find_dependent_rows`.
        type(sparse_matrix_type) :: ties
        type(sparse_lu_type) :: of_ties
        real(wp) :: unit_of_ties = 1.0_wp
        !> Coordinates and rows in their order of elimination (n + m).
        integer, allocatable :: order(:)
        !> The body of each coordinate (n), neighbours of each body, their groups.
        integer, allocatable, private :: body_of(:), group(:)
        type(list_type), allocatable, private :: neighbours(:)
        integer, private :: n_groups = 0
    contains
        procedure :: initialize, look, balance, find_dependent_rows
        procedure :: differentiate, check_structure
        procedure :: assemble, solve, multiply
        procedure :: imbalance, violation, row_length, row_times, turning_times, row_size, size_errors
        procedure, private :: set_structure, add_forces, multiply_columns
    end type sparse_point_type

    !> Largest number of entries of factors: 2 GB.
    integer, parameter :: most_factor_entries = 80000000
    !> Largest number of groups of bodies: with more the matrix would be practically dense.
    integer, parameter :: most_groups = 100
    !> K and D are differences with steps of some 1/256 of the scale, which amplify the rounding of forces by this factor.
    real(wp), parameter :: rounding_of_differences = 3000*epsilon(1.0_wp)
    !> A row depends on others if its pivot falls to this part of its initial value: an angle of 1e-5, as in the sparse chart.
    real(wp), parameter :: least_pivot = 1.0e-10_wp

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
        self%model => model
        self%pattern => model%pattern
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
        call self%evaluator%initialize(model, compressed=.true.)
        call self%set_structure()
        if (self%n_groups > most_groups) call set_error(error, status_invalid_model, 'a body of the model "'//model%name// &
            '" has too many neighbours for differences by groups of bodies', &
            'use full matrices (tandem linearise without --near)')
    end subroutine initialize

    !> Neighbours, groups, order, and the positions of the entries of the columns.
    subroutine set_structure(self)
        class(sparse_point_type), intent(inout) :: self
        integer :: b, j, k, l, n

        associate (pattern => self%pattern, first => self%pattern%first)
            call find_neighbours(pattern, self%neighbours)
            call find_groups(self%neighbours, most_groups, self%group, self%n_groups)
            call order_unknowns(pattern, self%neighbours, self%order)
            self%body_of = spread(0, 1, self%n)
            self%start = spread(1, 1, self%n + 1)
            do b = 1, pattern%n_bodies
                self%body_of(first(b):first(b + 1) - 1) = b
            end do
            do l = 1, 2
                n = 0
                do j = 1, self%n
                    self%start(j) = n + 1
                    call list_rows(self%body_of(j))
                    do k = 1, self%neighbours(self%body_of(j))%n
                        call list_rows(self%neighbours(self%body_of(j))%item(k))
                    end do
                end do
                self%start(self%n + 1) = n + 1
                if (l == 1) self%row = spread(0, 1, n)
            end do
            self%stiffness = spread(0.0_wp, 1, n)
            self%damping = self%stiffness
            self%mass = self%stiffness
        end associate

    contains

        subroutine list_rows(body)
            integer, intent(in) :: body
            integer :: coordinate

            do coordinate = self%pattern%first(body), self%pattern%first(body + 1) - 1
                n = n + 1
                if (l == 2) self%row(n) = coordinate
            end do
        end subroutine list_rows
    end subroutine set_structure

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
                do k = self%start(j), self%start(j + 1) - 1
                    i = self%row(k)
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

        call multiply_columns(self, self%stiffness, self%scale, product, sizes)
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
        integer :: i
        logical :: may_leave(self%n + self%m)
        real(wp) :: gamma(self%m)

        self%is_out = .false.
        may_leave = [(i > self%n, i=1, self%n + self%m)]
        call factor_ties(may_leave)
        if (stat < 0) then
            stat = status_work_limit
            return
        else if (stat > 0 .or. any(self%of_ties%left_rows <= self%n)) then
            stat = status_singular_mass
            return
        end if
        self%is_out(self%of_ties%left_rows - self%n) = .true.
        if (any(self%is_out)) then
            may_leave = .false.
            call factor_ties(may_leave)
            if (stat /= 0) then
                stat = status_singular_mass
                return
            end if
        end if
        gamma = self%evaluator%terms%gamma
        if (present(metric)) gamma = 0.0_wp
        allocate (acceleration(self%n))
        call self%solve(self%ties, self%of_ties, self%unit_of_ties, self%evaluator%terms%force, -gamma, acceleration, self%lambda)

    contains

        !> Factors of the rows that are not left out.
        subroutine factor_ties(may_leave)
            logical, intent(in) :: may_leave(:)
            complex(wp), parameter :: zero = (0.0_wp, 0.0_wp), one = (1.0_wp, 0.0_wp)
            type(sparse_matrix_type) :: a
            integer, allocatable :: order(:)
            real(wp) :: unit

            if (present(metric)) then
                call self%assemble([zero, zero, zero], a, order, unit, metric)
            else
                call self%assemble([one, zero, zero], a, order, unit)
            end if
            call self%of_ties%factor(a, order, most_factor_entries, stat, may_leave(:a%n), least_pivot)
            self%ties%n = a%n
            call move_alloc(a%start, self%ties%start)
            call move_alloc(a%row, self%ties%row)
            call move_alloc(a%value, self%ties%value)
            self%unit_of_ties = unit
        end subroutine factor_ties
    end subroutine find_dependent_rows

    !> y = A x of one of the three matrices, and |A| |x|.
    pure subroutine multiply_columns(self, values, x, y, sizes)
        class(sparse_point_type), intent(in) :: self
        real(wp), intent(in) :: values(:), x(:)
        real(wp), intent(out) :: y(:), sizes(:)
        integer :: j, k

        y = 0.0_wp
        sizes = 0.0_wp
        do j = 1, self%n
            do k = self%start(j), self%start(j + 1) - 1
                y(self%row(k)) = y(self%row(k)) + values(k)*x(j)
                sizes(self%row(k)) = sizes(self%row(k)) + abs(values(k)*x(j))
            end do
        end do
    end subroutine multiply_columns

    !> y = (cm M + cd D + ck K) x.
    pure subroutine multiply(self, c, x, y)
        class(sparse_point_type), intent(in) :: self
        !> cm, cd, ck.
        complex(wp), intent(in) :: c(3), x(:)
        complex(wp), intent(out) :: y(:)
        integer :: j, k

        y = (0.0_wp, 0.0_wp)
        do j = 1, self%n
            do k = self%start(j), self%start(j + 1) - 1
                y(self%row(k)) = y(self%row(k)) + (c(1)*self%mass(k) + c(2)*self%damping(k) + c(3)*self%stiffness(k))*x(j)
            end do
        end do
    end subroutine multiply

    !> [(cm M + cd D + ck K)/unit, C'; C, 0] without rows that are left out, those of C over their lengths; below, rows at velocity
    !> level are C + ck/cd (C X q - nu)_q if cd is not zero.
    subroutine assemble(self, c, a, order, unit, diagonal)
        class(sparse_point_type), intent(in) :: self
        complex(wp), intent(in) :: c(3)
        type(sparse_matrix_type), intent(inout) :: a
        !> Order of its columns.
        integer, allocatable, intent(out) :: order(:)
        real(wp), intent(out) :: unit
        !> Added to the diagonal of the first block (n).
        real(wp), intent(in), optional :: diagonal(:)
        complex(wp) :: value, block(size(self%row))
        integer, allocatable :: next(:), number(:)
        integer :: i, j, k, pass, total
        real(wp) :: length

        allocate (number(self%n + self%m))
        total = 0
        do i = 1, self%n + self%m
            number(i) = 0
            if (i > self%n) then
                if (self%is_out(i - self%n)) cycle
            end if
            total = total + 1
            number(i) = total
        end do
        order = pack(number(self%order), number(self%order) > 0)
        block = c(1)*self%mass + c(2)*self%damping + c(3)*self%stiffness
        if (present(diagonal)) then
            do j = 1, self%n
                do k = self%start(j), self%start(j + 1) - 1
                    if (self%row(k) == j) block(k) = block(k) + diagonal(j)
                end do
            end do
        end if
        unit = maxval(size_of(block))
        if (.not. unit > 0.0_wp) unit = 1.0_wp
        block = block/unit
        a%n = total
        allocate (next(total + 1), source=0)
        associate (pattern => self%pattern, jacobian => self%evaluator%terms%jacobian)
            do pass = 1, 2
                do j = 1, self%n
                    do k = self%start(j), self%start(j + 1) - 1
                        if (size_of(block(k)) > 0.0_wp) call put(self%row(k), j, block(k))
                    end do
                end do
                do i = 1, self%m
                    if (number(self%n + i) == 0) cycle
                    length = row_length(self, i)
                    do k = pattern%row_start(i), pattern%row_start(i + 1) - 1
                        do j = pattern%first(pattern%row_body(k)), pattern%first(pattern%row_body(k) + 1) - 1
                            value = jacobian(i, pattern%column(j))/length
                            if (size_of(value) > 0.0_wp) call put(j, number(self%n + i), value)
                            if (i > self%nh .and. abs(c(2)) > 0.0_wp) value = value + &
                                c(3)/c(2)*self%turning(i, pattern%column(j))/length
                            if (size_of(value) > 0.0_wp) call put(number(self%n + i), j, value)
                        end do
                    end do
                end do
                if (pass == 2) exit
                a%start = spread(1, 1, total + 1)
                do j = 1, total
                    a%start(j + 1) = a%start(j) + next(j)
                end do
                next = a%start
                a%row = spread(0, 1, a%start(total + 1) - 1)
                a%value = spread((0.0_wp, 0.0_wp), 1, a%start(total + 1) - 1)
            end do
        end associate

    contains

        !> A measure of size without a square root.
        elemental real(wp) function size_of(number)
            complex(wp), intent(in) :: number

            size_of = abs(real(number, wp)) + abs(aimag(number))
        end function size_of

        subroutine put(row, column, entry)
            integer, intent(in) :: row, column
            complex(wp), intent(in) :: entry

            if (pass == 2) then
                a%row(next(column)) = row
                a%value(next(column)) = entry
            end if
            next(column) = next(column) + 1
        end subroutine put
    end subroutine assemble

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
        call multiply_columns(self, self%stiffness, scaled, forces, of_q)
        call multiply_columns(self, self%damping, max(abs(self%rest), self%scale/64), forces, of_qd)
        forces = self%sizes + of_q + of_qd
        sizes = 0.0_wp
        do j = 1, self%n
            do k = self%start(j), self%start(j + 1) - 1
                associate (i => self%row(k))
                    sizes(i) = sizes(i) + (part*(lambda**2*abs(self%mass(k)) + lambda*abs(self%damping(k)) + &
                        abs(self%stiffness(k))) + rounding_of_differences*(1 + lambda)*forces(i)/self%scale(j))*x(j)
                end associate
            end do
        end do
    end subroutine size_errors

    !> Solve A (x; lambda) = (f; g) with the real factors of `assemble` and `factor`.
    subroutine solve(self, a, lu, unit, f, g, x, lambda)
        class(sparse_point_type), intent(in) :: self
        type(sparse_matrix_type), intent(in) :: a
        type(sparse_lu_type), intent(in) :: lu
        real(wp), intent(in) :: unit
        !> (n), (m).
        real(wp), intent(in) :: f(:), g(:)
        real(wp), intent(out) :: x(:), lambda(:)
        complex(wp), dimension(a%n) :: b, y
        integer :: i, k

        b(:self%n) = f/unit
        k = self%n
        do i = 1, self%m
            if (self%is_out(i)) cycle
            k = k + 1
            b(k) = g(i)/row_length(self, i)
        end do
        call lu%solve_refined(a, b, y)
        x = real(y(:self%n), wp)
        lambda = 0.0_wp
        k = self%n
        do i = 1, self%m
            if (self%is_out(i)) cycle
            k = k + 1
            lambda(i) = unit*real(y(k), wp)/row_length(self, i)
        end do
    end subroutine solve
end module tandem_analysis_sparse_point
