! SPDX-License-Identifier: MIT
!> Steady motion of a large mechanism: all of it along motions of the world, bodies also about their own axes, at rates determined
!> by its velocities and accelerations at one point, qd = X q and qdd = L qd. The field X q = L q + c of all these motions together
!> has few entries.
!>
!> With q = T(t) p, T the flow of X, co-rotating coordinates p are at rest, and in them, with L and T commuting,
!>
!>   M p'' + M (L X p + 2 L p') + C' lambda - S(p, X p + p') - Q_A(p, X p + p') = 0,   C (X p + p') = nu.
module tandem_analysis_corotating_frame
    use tandem_analysis_symmetry, only: list_motions
    use tandem_error, only: error_type, set_error, to_text
    use tandem_kinds, only: wp
    use tandem_linalg_singular, only: singular_type
    use tandem_model, only: model_type
    use tandem_model_affine_motion, only: affine_motion_type, motion_name_length
    use tandem_status, only: status_no_equilibrium
    implicit none (type, external)
    private

    public :: corotating_frame_type, fit_rates

    type :: corotating_frame_type
        !> True if anything moves.
        logical :: moves = .false.
        !> The motions with rates that are not zero, and their rates (1/s, m/s, rad/s).
        character(len=motion_name_length), allocatable :: names(:)
        real(wp), allocatable :: rates(:)
        !> The sum of the motions.
        type(affine_motion_type), private :: field
    contains
        procedure :: find, set, velocity, turned, carry
    end type corotating_frame_type

    !> Values below this part of the largest are rounding; limit of velocities that no motion explains.
    real(wp), parameter :: rounding = 1.0e-13_wp, unexplained = 1.0e-9_wp

contains

    !> The motions that compose the velocities at a point. Errors: no_equilibrium if there are none.
    subroutine find(self, model, q, qd, qdd, turns_tell, error)
        class(corotating_frame_type), intent(out) :: self
        class(model_type), intent(inout) :: model
        !> (n)
        real(wp), intent(in) :: q(:), qd(:), qdd(:)
        !> As of `fit_rates`.
        logical, intent(in) :: turns_tell
        type(error_type), allocatable, intent(out) :: error
        type(affine_motion_type), allocatable :: motions(:)
        real(wp), allocatable :: rates(:)
        real(wp) :: rest(size(qd))
        integer :: i

        allocate (self%names(0), self%rates(0))
        if (.not. any(abs(qd) > 0.0_wp)) return
        call list_motions(model, motions)
        call fit_rates(motions, q, qd, rates, qdd, turns_tell)
        call self%set(motions, rates)
        self%moves = .true.
        rest = qd - self%velocity(q)
        if (maxval(abs(rest)) <= unexplained*maxval(abs(qd))) return
        i = maxloc(abs(rest), dim=1)
        call set_error(error, status_no_equilibrium, 'the motion of the model "'//model%name// &
            '" is not a rigid motion with spinning bodies: the velocity of '//model%coordinate_label(i)//' would be '// &
            to_text(qd(i) - rest(i))//', and is '// &
            to_text(qd(i)), 'eigenvalues near a shift require an equilibrium or a steady motion (--steady)')
    end subroutine find

    !> Set motions and their rates.
    subroutine set(self, motions, rates)
        class(corotating_frame_type), intent(inout) :: self
        type(affine_motion_type), intent(in) :: motions(:)
        real(wp), intent(in) :: rates(:)
        character(len=motion_name_length), allocatable :: names(:)
        integer :: k

        allocate (names(size(motions)))
        do k = 1, size(motions)
            names(k) = motions(k)%name
        end do
        self%names = pack(names, abs(rates) > 0.0_wp)
        self%rates = pack(rates, abs(rates) > 0.0_wp)
        self%moves = size(self%rates) > 0
        call add_up(self%field, motions, rates)
    end subroutine set

    !> The rates of all motions of a mechanism that best fit velocities at a point: first motions of the world, fitted to the
    !> positions, then motions of bodies, fitted to the remainder. Without accelerations a rotation may be taken for a translation
    !> if one body alone has no direction.
    subroutine fit_rates(motions, q, qd, rates, qdd, turns_tell)
        type(affine_motion_type), intent(in) :: motions(:)
        !> (n)
        real(wp), intent(in) :: q(:), qd(:)
        real(wp), allocatable, intent(out) :: rates(:)
        real(wp), intent(in), optional :: qdd(:)
        !> True if rotations of bodies also determine the motion of the world, which is necessary if all positions lie on the axis.
        logical, intent(in), optional :: turns_tell
        real(wp) :: rest(size(qd)), rest_qdd(size(qd)), x(size(qd))
        logical :: of_world(size(qd))
        integer :: i, k

        allocate (rates(size(motions)), source=0.0_wp)
        ! Positions determine the motion of the world: no rotation of a body about itself changes them.
        of_world = .true.
        do k = 1, size(motions)
            if (is_of_world(motions(k))) cycle
            of_world(motions(k)%row) = .false.
            of_world(motions(k)%place) = .false.
        end do
        if (present(turns_tell)) of_world = of_world .or. turns_tell
        rest = qd
        rest_qdd = 0.0_wp
        if (present(qdd)) rest_qdd = qdd
        do i = 1, 2
            call fit_world(motions, q, qd, of_world, present(qdd), rest, rest_qdd, rates)
        end do
        rest = qd
        do k = 1, size(motions)
            if (.not. is_of_world(motions(k))) cycle
            x = 0.0_wp
            call motions(k)%add_field(q, rates(k), x)
            if (maxval(abs(x)) <= rounding*maxval(abs(qd))) rates(k) = 0.0_wp
            if (abs(rates(k)) > 0.0_wp) rest = rest - x
        end do
        do k = 1, size(motions)
            if (is_of_world(motions(k))) cycle
            ! About axes of one body: fields that are perpendicular to each other.
            x = 0.0_wp
            call motions(k)%add_field(q, 1.0_wp, x)
            rates(k) = dot_product(x, rest)/max(dot_product(x, x), tiny(1.0_wp))
            if (abs(rates(k)) > rounding*maxval(abs(qd))) rest = rest - rates(k)*x
        end do
        where (abs(rates) <= rounding*maxval(abs(rates))) rates = 0.0_wp
    end subroutine fit_rates

    !> True if a motion moves all bodies together.
    pure logical function is_of_world(motion)
        type(affine_motion_type), intent(in) :: motion

        is_of_world = index(motion%name, 'world.') == 1
    end function is_of_world

    !> Add to the rates of motions of the world the best fit to velocities and accelerations of positions, and subtract it from
    !> these. The accelerations distinguish a rotation from a translation if one body alone has no direction.
    subroutine fit_world(motions, q, qd, of_world, uses_qdd, rest, rest_qdd, rates)
        type(affine_motion_type), intent(in) :: motions(:)
        real(wp), intent(in) :: q(:), qd(:)
        logical, intent(in) :: of_world(:), uses_qdd
        real(wp), intent(inout) :: rest(:), rest_qdd(:), rates(:)
        type(singular_type) :: svd
        real(wp), allocatable :: x(:, :), y(:, :), more(:)
        real(wp) :: weight
        integer, allocatable :: numbers(:)
        integer :: i, k

        numbers = pack([(k, k=1, size(motions))], [(is_of_world(motions(k)), k=1, size(motions))])
        allocate (x(size(q), size(numbers)), source=0.0_wp)
        allocate (y, source=x)
        allocate (more(size(numbers)))
        do i = 1, size(numbers)
            call motions(numbers(i))%add_field(q, 1.0_wp, x(:, i))
            call motions(numbers(i))%add_turned(qd, 1.0_wp, y(:, i))
            where (.not. of_world) x(:, i) = 0.0_wp
            where (.not. of_world) y(:, i) = 0.0_wp
        end do
        weight = 0.0_wp
        if (uses_qdd) weight = sum(x**2)/max(sum(y**2), tiny(1.0_wp))
        call svd%allocate(size(numbers), size(numbers))
        call svd%factor(matmul(transpose(x), x) + weight*matmul(transpose(y), y))
        call svd%solve(matmul(transpose(x), rest) + weight*matmul(transpose(y), rest_qdd), more)
        rates(numbers) = rates(numbers) + more
        do i = 1, size(numbers)
            call motions(numbers(i))%add_field(q, -more(i), rest)
            call motions(numbers(i))%add_turned(qd, -more(i), rest_qdd)
        end do
    end subroutine fit_world

    !> The sum of motions times rates, with its entries merged.
    pure subroutine add_up(field, motions, rates)
        type(affine_motion_type), intent(inout) :: field
        type(affine_motion_type), intent(in) :: motions(:)
        real(wp), intent(in) :: rates(:)
        integer :: k, n_entries, n_constants, i, j

        n_entries = 0
        n_constants = 0
        do k = 1, size(motions)
            if (.not. abs(rates(k)) > 0.0_wp) cycle
            n_entries = n_entries + size(motions(k)%row)
            n_constants = n_constants + size(motions(k)%place)
        end do
        call field%initialize('', .false.)
        deallocate (field%row, field%column, field%entry, field%place, field%constant)
        allocate (field%row(n_entries), field%column(n_entries), field%entry(n_entries))
        allocate (field%place(n_constants), field%constant(n_constants))
        i = 0
        j = 0
        do k = 1, size(motions)
            if (.not. abs(rates(k)) > 0.0_wp) cycle
            associate (motion => motions(k))
                field%row(i + 1:i + size(motion%row)) = motion%row
                field%column(i + 1:i + size(motion%row)) = motion%column
                field%entry(i + 1:i + size(motion%row)) = rates(k)*motion%entry
                field%place(j + 1:j + size(motion%place)) = motion%place
                field%constant(j + 1:j + size(motion%place)) = rates(k)*motion%constant
                i = i + size(motion%row)
                j = j + size(motion%place)
            end associate
        end do
    end subroutine add_up

    !> X q = L q + c.
    pure function velocity(self, q) result(qd)
        class(corotating_frame_type), intent(in) :: self
        real(wp), intent(in) :: q(:)
        real(wp) :: qd(size(q))

        qd = 0.0_wp
        if (self%moves) call self%field%add_field(q, 1.0_wp, qd)
    end function velocity

    !> L x.
    pure function turned(self, x) result(y)
        class(corotating_frame_type), intent(in) :: self
        real(wp), intent(in) :: x(:)
        real(wp) :: y(size(x))

        y = 0.0_wp
        if (self%moves) call self%field%add_turned(x, 1.0_wp, y)
    end function turned

    !> Move a state along the flow for a time in which nothing turns by more than half a radian or so: q by the flow, vectors by its
    !> linear part.
    pure subroutine carry(self, time, q, vectors)
        class(corotating_frame_type), intent(in) :: self
        real(wp), intent(in) :: time
        !> (n), (n, any)
        real(wp), intent(inout) :: q(:), vectors(:, :)
        real(wp) :: term(size(q))
        integer :: i, k

        term = time*self%velocity(q)
        do k = 2, 30
            q = q + term
            term = time/k*self%turned(term)
        end do
        do i = 1, size(vectors, 2)
            term = time*self%turned(vectors(:, i))
            do k = 2, 30
                vectors(:, i) = vectors(:, i) + term
                term = time/k*self%turned(term)
            end do
        end do
    end subroutine carry
end module tandem_analysis_corotating_frame
