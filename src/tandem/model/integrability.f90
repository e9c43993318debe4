! SPDX-License-Identifier: MIT
!> Finds integrable nonholonomic rows. Such rows are equivalent to constraints on the position and should be holonomic, because the
!> position error is controlled only for holonomic rows.
!>
!> Frobenius' theorem: a row E_i qd = e_i, with the form w = E_i dq - e_i dt, is integrable on the manifold of Phi if the three-form
!> w dw vanishes on all directions of (q, t) that dPhi allows. Several rows are integrable together if every dw_i vanishes on the
!> directions that all of them allow. A form that vanishes on some random directions vanishes on all directions with probability
!> one. Central differences along a few directions therefore test all rows, and neither work nor memory is quadratic in the number
!> of rows. Tests at other points and times exclude coincidences: a wheel that is steered by 1 - cos(t) has the rows of an unsteered
!> wheel at t = 0.
!> Source: R. M. Murray, Z. Li, S. S. Sastry, A Mathematical Introduction to Robotic Manipulation, CRC Press 1994, section 6.2 and
!> chapter 7.
module tandem_model_integrability
    use tandem_kinds, only: wp
    use tandem_linalg_basis, only: basis_type, rank_tolerance
    use tandem_linalg_random, only: random_vector
    use tandem_model, only: model_type
    use tandem_model_evaluator, only: evaluator_type
    use tandem_model_terms, only: need_jacobian, need_nu
    use tandem_status, only: status_ok
    use tandem_model_counts, only: counts_type
    implicit none (type, external)
    private

    public :: find_integrable_rows

    !> Forms and their derivatives at one point.
    type :: forms_type
        !> Time of the point, its coordinates, and the scales there: of time and of the coordinates (n).
        real(wp) :: t = 0.0_wp, time_scale = 1.0_wp
        real(wp), allocatable :: q(:), scale(:)
        !> Rows of [C, -nu] in scaled (q, t), normalised to unit length (m, n + 1), and their lengths (m).
        real(wp), allocatable :: rows(:, :), length(:)
        !> Random directions a (n + 1, k); slopes, with dw_i(a, b) = slope(i, b, a) - slope(i, a, b); sums of the absolute values of
        !> the terms in the slopes.
        real(wp), allocatable :: directions(:, :), slope(:, :, :), magnitude(:, :, :)
    end type forms_type

    !> Numbers of random directions for one row and for all rows together: four give four triples, three give three pairs.
    integer, parameter :: n_alone = 4, n_together = 3
    !> Largest value of a vanishing form relative to its terms. Differences have an error of about 1e-9.
    real(wp), parameter :: small = 1.0e-6_wp

contains

    !> Find the nonholonomic rows that are integrable at and near (t, q).
    subroutine find_integrable_rows(model, scale, t, q, counts, alone, together)
        class(model_type), intent(inout), target :: model
        !> Coordinate scales (n), time and coordinates (n).
        real(wp), intent(in) :: scale(:), t, q(:)
        type(counts_type), intent(inout) :: counts
        !> Rows of C that are integrable individually.
        integer, allocatable, intent(out) :: alone(:)
        !> True if all nonholonomic rows are integrable together, none of them individually.
        logical, intent(out) :: together
        integer, parameter :: n_points = 3
        real(wp), parameter :: distance = 0.01_wp
        logical :: is_alone(model%n_nonholonomic)
        type(evaluator_type) :: evaluator
        type(forms_type) :: forms
        integer :: i, j, seed, stat

        is_alone = .true.
        together = model%n_nonholonomic > 1
        call evaluator%initialize(model, wants_mass=.false.)
        forms%time_scale = model%time_scale
        forms%scale = scale
        seed = 12345
        do i = 1, n_points
            forms%t = t + (i - 1)*distance*forms%time_scale
            forms%q = q + (i - 1)*distance*scale*[(sin(real(i + 3*j, wp)), j=1, size(q))]
            call evaluate_forms(evaluator, forms, counts, stat)
            if (stat == status_ok .and. any(is_alone)) then
                call test_alone(evaluator, model%n_holonomic, forms, seed, counts, is_alone, stat)
            end if
            if (stat == status_ok .and. together) then
                call test_together(evaluator, model%n_holonomic, forms, seed, counts, together, stat)
            end if
            ! A point that cannot be evaluated gives no result.
            if (stat /= status_ok) is_alone = .false.
            if (stat /= status_ok) together = .false.
            if (.not. (any(is_alone) .or. together)) exit
        end do
        alone = pack([(model%n_holonomic + j, j=1, size(is_alone))], is_alone)
        together = together .and. size(alone) == 0
    end subroutine find_integrable_rows

    !> Evaluate the forms at their point, normalised to unit length.
    subroutine evaluate_forms(evaluator, forms, counts, stat)
        type(evaluator_type), intent(inout) :: evaluator
        type(forms_type), intent(inout) :: forms
        type(counts_type), intent(inout) :: counts
        integer, intent(out) :: stat
        integer :: i

        if (.not. allocated(forms%rows)) allocate (forms%rows(size(evaluator%terms%nu), size(forms%q) + 1))
        call evaluate(evaluator, forms, forms%t, forms%q, counts, forms%rows, stat)
        if (stat /= status_ok) return
        forms%length = [(norm2(forms%rows(i, :)), i=1, size(forms%rows, 1))]
        where (.not. forms%length > 0.0_wp) forms%length = 1.0_wp
        do i = 1, size(forms%rows, 2)
            forms%rows(:, i) = forms%rows(:, i)/forms%length
        end do
    end subroutine evaluate_forms

    !> Evaluate the rows of [C diag(s), -nu] in scaled time.
    subroutine evaluate(evaluator, forms, time, place, counts, rows, stat)
        type(evaluator_type), intent(inout) :: evaluator
        type(forms_type), intent(in) :: forms
        real(wp), intent(in) :: time, place(:)
        type(counts_type), intent(inout) :: counts
        real(wp), intent(out) :: rows(:, :)
        integer, intent(out) :: stat
        integer :: k

        counts%start_evaluations = counts%start_evaluations + 1
        call evaluator%evaluate(need_jacobian + need_nu, time, place, place, counts, stat)
        associate (terms => evaluator%terms, n => size(place))
            do k = 1, n
                rows(:, k) = terms%jacobian(:, k)*forms%scale(k)
            end do
            rows(:, n + 1) = -terms%nu*forms%time_scale
        end associate
        if (.not. sum(abs(rows)) <= huge(1.0_wp)) stat = -1
    end subroutine evaluate

    !> Test each row by itself: w dw of three directions that Phi allows.
    subroutine test_alone(evaluator, nh, forms, seed, counts, is_alone, stat)
        type(evaluator_type), intent(inout) :: evaluator
        integer, intent(in) :: nh
        type(forms_type), intent(inout) :: forms
        integer, intent(inout) :: seed
        type(counts_type), intent(inout) :: counts
        !> True for rows that have passed all tests so far (nd).
        logical, intent(inout) :: is_alone(:)
        integer, intent(out) :: stat
        !> Orthonormal basis of the rows of dPhi; part of each row orthogonal to them; values of these parts along the directions.
        real(wp), allocatable :: fixed(:, :), own(:, :), value(:, :)
        real(wp) :: length, size_of_terms, three_form
        logical :: can
        integer :: a, b, c, i

        ! Fewer than three directions always pass.
        stat = status_ok
        call generate_directions(forms, nh, n_alone, 3, seed, fixed, can)
        if (.not. can) then
            is_alone = .false.
            return
        end if
        own = forms%rows(nh + 1:, :)
        own = own - matmul(matmul(own, fixed), transpose(fixed))
        value = matmul(own, forms%directions)
        call differentiate(evaluator, nh, forms, counts, stat)
        if (stat /= status_ok) return
        do i = 1, size(is_alone)
            length = norm2(own(i, :))
            if (.not. length > rank_tolerance) is_alone(i) = .false.
            do c = 3, size(value, 2)
                do b = 2, c - 1
                    do a = 1, b - 1
                        if (.not. is_alone(i)) cycle
                        three_form = curl(i, a, b)*value(i, c) + curl(i, b, c)*value(i, a) + curl(i, c, a)*value(i, b)
                        size_of_terms = magnitude(i, a, b)*abs(value(i, c)) + magnitude(i, b, c)*abs(value(i, a)) + &
                            magnitude(i, c, a)*abs(value(i, b))
                        is_alone(i) = abs(three_form) <= small*max(length, size_of_terms)
                    end do
                end do
            end do
        end do

    contains

        pure real(wp) function curl(row, one, other)
            integer, intent(in) :: row, one, other

            curl = forms%slope(row, other, one) - forms%slope(row, one, other)
        end function curl

        pure real(wp) function magnitude(row, one, other)
            integer, intent(in) :: row, one, other

            magnitude = forms%magnitude(row, other, one) + forms%magnitude(row, one, other)
        end function magnitude
    end subroutine test_alone

    !> Test all rows together: every dw of two directions that all rows allow.
    subroutine test_together(evaluator, nh, forms, seed, counts, together, stat)
        type(evaluator_type), intent(inout) :: evaluator
        integer, intent(in) :: nh
        type(forms_type), intent(inout) :: forms
        integer, intent(inout) :: seed
        type(counts_type), intent(inout) :: counts
        logical, intent(out) :: together
        integer, intent(out) :: stat
        real(wp), allocatable :: fixed(:, :)
        integer :: a, b

        stat = status_ok
        call generate_directions(forms, size(forms%rows, 1), n_together, 2, seed, fixed, together)
        if (.not. together) return
        deallocate (fixed)
        together = .false.
        call differentiate(evaluator, nh, forms, counts, stat)
        if (stat /= status_ok) return
        do b = 2, size(forms%directions, 2)
            do a = 1, b - 1
                if (any(abs(forms%slope(:, b, a) - forms%slope(:, a, b)) > small*max(1.0_wp, forms%magnitude(:, b, a) + &
                    forms%magnitude(:, a, b)))) return
            end do
        end do
        together = .true.
    end subroutine test_together

    !> Generate random directions that the first rows allow.
    subroutine generate_directions(forms, n_rows, most, least, seed, fixed, can)
        type(forms_type), intent(inout) :: forms
        !> Number of rows; largest and smallest number of directions.
        integer, intent(in) :: n_rows, most, least
        integer, intent(inout) :: seed
        !> Orthonormal basis of the rows (n + 1, n_rows).
        real(wp), allocatable, intent(out) :: fixed(:, :)
        !> False if there are too few directions or if the rows are dependent.
        logical, intent(out) :: can
        type(basis_type) :: basis
        integer :: a, n

        n = size(forms%rows, 2)
        can = n - n_rows >= least
        if (.not. can) return
        call basis%allocate(n, n_rows, n_rows, n_rows)
        call basis%factor_qr(forms%rows(:n_rows, :), spread(1.0_wp, 1, n), n_rows)
        can = .not. basis%deficient
        if (.not. can) return
        if (allocated(forms%directions)) deallocate (forms%directions)
        allocate (forms%directions(n, min(most, n - n_rows)))
        do a = 1, size(forms%directions, 2)
            forms%directions(:, a) = random_vector(seed, n)
        end do
        fixed = basis%q(:, :n_rows)
        forms%directions = forms%directions - matmul(fixed, matmul(transpose(fixed), forms%directions))
    end subroutine generate_directions

    !> Differentiate the nonholonomic rows along all directions and contract the derivatives with all directions.
    subroutine differentiate(evaluator, nh, forms, counts, stat)
        type(evaluator_type), intent(inout) :: evaluator
        integer, intent(in) :: nh
        type(forms_type), intent(inout) :: forms
        type(counts_type), intent(inout) :: counts
        integer, intent(out) :: stat
        !> Displacement of central differences, eps**(1/3).
        real(wp), parameter :: delta = epsilon(1.0_wp)**(1.0_wp/3)
        real(wp), allocatable :: ahead(:, :), behind(:, :)
        real(wp) :: later, step(size(forms%q))
        integer :: a, i, k, n

        n = size(forms%q)
        k = size(forms%directions, 2)
        allocate (ahead, behind, source=forms%rows)
        if (allocated(forms%slope)) deallocate (forms%slope, forms%magnitude)
        allocate (forms%slope(size(ahead, 1) - nh, k, k), forms%magnitude(size(ahead, 1) - nh, k, k))
        do a = 1, k
            later = delta*forms%directions(n + 1, a)*forms%time_scale
            step = delta*forms%directions(:n, a)*forms%scale
            call evaluate(evaluator, forms, forms%t + later, forms%q + step, counts, ahead, stat)
            if (stat /= status_ok) return
            call evaluate(evaluator, forms, forms%t - later, forms%q - step, counts, behind, stat)
            if (stat /= status_ok) return
            do i = 1, n + 1
                ahead(:, i) = (ahead(:, i) - behind(:, i))/(2*delta*forms%length)
            end do
            forms%slope(:, :, a) = matmul(ahead(nh + 1:, :), forms%directions)
            forms%magnitude(:, :, a) = matmul(abs(ahead(nh + 1:, :)), abs(forms%directions))
        end do
    end subroutine differentiate
end module tandem_model_integrability
