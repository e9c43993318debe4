! SPDX-License-Identifier: MIT
!> The symmetries of a model among its possible motions: fields q' = L q + c that leave its constraints and equations of motion
!> unchanged.
!>
!> A sum of fields with rates xi, and with the time advancing at a rate s, is a symmetry if at every state on the manifold, with
!> x = X q, x' = L qd,
!>
!>   Phi_q x + s Phi_t = 0,   vel_q x + C x' + s vel_t = 0,   W' (dyn_q x + dyn_qd x' + M L qdd + s dyn_t) = 0.
!>
!> All of this is linear in (xi, s): the symmetries are the null space of these rows at a few states and times in general position.
!> Rows of accelerations follow from those of velocities, which hold at all times. The gradients are exact, so that the rank is
!> clear; so are derivatives with respect to time, computed without differences: Phi_t = -nu, and
!>
!>   C_t = (gamma_qd - (C qd - nu)_q)(qd = 0),   nu_t = -gamma(qd = 0),   dyn_t = C_t' lambda - Q_A,t.
module tandem_analysis_symmetry
    use tandem_analysis_point, only: point_type
    use tandem_error, only: error_type, set_error
    use tandem_kinds, only: wp
    use tandem_linalg_random, only: random_vector
    use tandem_linalg_singular, only: singular_type, triangularise
    use tandem_model, only: model_type
    use tandem_model_affine_motion, only: affine_motion_type
    use tandem_status, only: status_callback_failed, status_no_equilibrium, status_ok
    implicit none (type, external)
    private

    public :: symmetry_type, is_named, list_motions

    type :: symmetry_type
        !> The tested fields.
        type(affine_motion_type), allocatable :: motions(:)
        !> The symmetries: rates of the fields (n_motions, k) at constant time.
        real(wp), allocatable :: rates(:, :)
        !> Rates of fields that accompany the time: zero if the equations do not depend on it; not allocated if no symmetry changes
        !> the time.
        real(wp), allocatable :: rates_of_time(:)
    contains
        procedure :: find, field, turned, matrix, name_of, knows, check_names
        procedure, nopass :: list_names
        procedure, private :: add_rows, reduce
    end type symmetry_type

    !> Bounds of residuals of cancelling terms, relative to their size.
    real(wp), parameter :: exact_bound = 1.0e-9_wp, difference_bound = 1.0e-6_wp
    !> Displacements in units of the step, weights, and the step over the time scale of central differences with respect to time.
    real(wp), parameter :: place(4) = [-2.0_wp, -1.0_wp, 1.0_wp, 2.0_wp], weight(4) = [1.0_wp, -8.0_wp, 8.0_wp, -1.0_wp]/12.0_wp
    real(wp), parameter :: step = 2.0_wp**(-11)

contains

    !> Find the symmetries from states around one on the manifold. `point` is evaluated elsewhere afterwards.
    subroutine find(self, point, t, q, qd, stat, names)
        class(symmetry_type), intent(inout) :: self
        type(point_type), intent(inout) :: point
        real(wp), intent(in) :: t, q(:), qd(:)
        integer, intent(out) :: stat
        !> Only these fields: a name, or the part before its last `_` (BODY.spin).
        character(len=*), intent(in), optional :: names(:)
        type(singular_type) :: svd
        real(wp), allocatable :: rows(:, :), span(:, :)
        integer, allocatable :: kept(:)
        integer :: n_samples, seed, i, k, per_sample
        real(wp) :: size_of_move, unit_of_time

        call list_motions(point%model, self%motions)
        k = size(self%motions)
        per_sample = max(point%nh + point%m, 1) + point%n
        n_samples = 4 + 2*(k + 1)/max(point%n, 1)
        ! For earlier samples the triangular factor is stored.
        allocate (rows(k + 1 + per_sample, k + 1), source=0.0_wp)
        seed = 20071
        unit_of_time = 1/max(point%rate, maxval(abs(qd)/max(abs(q), point%scale)))
        do i = 1, n_samples
            size_of_move = 0.1_wp
            do
                ! At incommensurable times.
                call go_nearby(point, t, q, qd, size_of_move, size_of_move*unit_of_time*sqrt(real(i, wp)), seed, stat)
                if (stat == status_ok) call point%make_bases()
                if (stat == status_ok) call point%solve_dynamics(stat)
                if (stat == status_ok) call point%differentiate(stat)
                if (stat == status_ok) exit
                size_of_move = size_of_move/4
                if (size_of_move < 1.0e-4_wp) return
            end do
            call self%add_rows(point, rows(k + 2:, :), stat)
            if (stat /= status_ok) return
            call triangularise(rows)
        end do
        rows = rows(:k + 1, :)
        ! The sizes of rows include all fields, before unnamed fields are removed: terms of a single field may be rounding.
        if (present(names)) then
            allocate (kept, source=pack([(i, i=1, k)], [(is_named(trim(self%motions(i)%name), names), i=1, k)]))
            rows = rows(:, [kept, k + 1])
            self%motions = self%motions(kept)
            k = size(kept)
        end if
        call svd%allocate(size(rows, 1), k + 1)
        call svd%factor(rows)
        svd%rank = count(svd%values > merge(exact_bound, difference_bound, point%has_gradients)*max(svd%values(1), 1.0_wp))
        call svd%get_null_basis(span)
        call self%reduce(span)
    end subroutine find

    !> The fields that the model lists, or all translations and rotations of its coordinates.
    subroutine list_motions(model, motions)
        class(model_type), intent(inout) :: model
        type(affine_motion_type), allocatable, intent(out) :: motions(:)
        !> Coordinates of a model that lists none: their rotations are n (n - 1)/2.
        integer, parameter :: few = 16
        type(affine_motion_type) :: motion
        integer :: i, j

        call model%list_motions(motions)
        if (allocated(motions)) return
        allocate (motions(0))
        do i = 1, model%n
            call motion%initialize(model%coordinate_label(i), .false.)
            call motion%add_constant(i, 1.0_wp)
            motions = [motions, motion]
        end do
        do i = 1, merge(model%n, 0, model%n <= few)
            do j = i + 1, model%n
                call motion%initialize(model%coordinate_label(i)//'-'//model%coordinate_label(j), .false.)
                call motion%add_entry(i, j, -1.0_wp)
                call motion%add_entry(j, i, 1.0_wp)
                motions = [motions, motion]
            end do
        end do
    end subroutine list_motions

    !> True if a name refers to tested fields.
    pure logical function knows(self, name)
        class(symmetry_type), intent(in) :: self
        character(len=*), intent(in) :: name
        integer :: i

        knows = .false.
        do i = 1, size(self%motions)
            knows = knows .or. is_named(trim(self%motions(i)%name), [name])
        end do
    end function knows

    !> Refuse a name that refers to no tested field.
    subroutine check_names(self, model, names, error)
        class(symmetry_type), intent(in) :: self
        class(model_type), intent(inout) :: model
        character(len=*), intent(in) :: names(:)
        type(error_type), allocatable, intent(inout) :: error
        character(len=:), allocatable :: known
        integer :: k

        do k = 1, size(names)
            if (self%knows(names(k))) cycle
            call list_names(model, known)
            call set_error(error, status_no_equilibrium, 'the model "'//model%name//'" cannot be moved along "'// &
                trim(names(k))//'"', 'name one of '//known)
            return
        end do
    end subroutine check_names

    !> The names of all fields of a model, separated by commas; if there are many, only the first.
    subroutine list_names(model, text)
        class(model_type), intent(inout) :: model
        !> Not a function: results of deferred length are stored in static memory (gfortran).
        character(len=:), allocatable, intent(out) :: text
        integer, parameter :: most = 40
        type(affine_motion_type), allocatable :: motions(:)
        integer :: i

        allocate (motions(0))
        call list_motions(model, motions)
        text = ''
        do i = 1, min(most, size(motions))
            text = text//', '//trim(motions(i)%name)
        end do
        text = text(3:)
        if (size(motions) > most) text = text//', ...'
    end subroutine list_names

    !> True if a field is one of those that were named.
    pure logical function is_named(name, names)
        character(len=*), intent(in) :: name, names(:)
        integer :: last

        last = index(name, '_', back=.true.) - 1
        if (last < 1) last = len(name)
        is_named = any(names == name) .or. any(names == name(:last))
    end function is_named

    !> Evaluate a state on the manifold near one that was moved by its velocities for a time.
    subroutine go_nearby(point, t, q, qd, size_of_move, later, seed, stat)
        type(point_type), intent(inout) :: point
        real(wp), intent(in) :: t, q(:), qd(:), size_of_move, later
        integer, intent(inout) :: seed
        integer, intent(out) :: stat
        real(wp) :: near(point%n), velocity(point%n), x(point%n, 1), speed

        near = q + later*qd + size_of_move*point%scale*random_vector(seed, point%n)
        call point%restore_position(t + later, qd, near, stat)
        if (stat /= status_ok) return
        ! Any velocity: the part in null(C) is free.
        speed = max(point%rate, maxval(abs(qd/point%scale)))
        velocity = qd/point%scale + speed*random_vector(seed, point%n)
        call point%evaluate(t + later, near, qd, stat)
        if (stat /= status_ok) return
        call point%make_bases()
        call point%apply_right_inverse(reshape(point%nu, [point%m, 1]), x)
        velocity = matmul(point%w, matmul(transpose(point%w), velocity)) + x(:, 1)
        call point%evaluate(t + later, near, point%scale*velocity, stat)
    end subroutine go_nearby

    !> The rows of one state, each over the size of its terms; the last column belongs to the time.
    subroutine add_rows(self, point, rows, stat)
        class(symmetry_type), intent(in) :: self
        type(point_type), intent(inout) :: point
        real(wp), intent(inout) :: rows(:, :)
        integer, intent(out) :: stat
        real(wp), dimension(point%n) :: x, x_rate, x_curve
        real(wp), dimension(point%n, size(self%motions)) :: forces, size_of_forces
        real(wp) :: sizes(size(rows, 1)), of_time(size(rows, 1)), least
        integer :: j, k, level, ends(4)

        rows = 0.0_wp
        sizes = 0.0_wp
        forces = 0.0_wp
        size_of_forces = 0.0_wp
        ends = [0, point%nh, point%nh + point%m, point%nh + point%m + point%nw]
        do k = 1, size(self%motions)
            x = 0.0_wp
            x_rate = 0.0_wp
            x_curve = 0.0_wp
            call self%motions(k)%add_field(point%q, 1.0_wp, x)
            call self%motions(k)%add_turned(point%qd, 1.0_wp, x_rate)
            call self%motions(k)%add_turned(point%qdd, 1.0_wp, x_curve)
            x = x/point%scale
            x_rate = x_rate/point%scale
            x_curve = x_curve/point%scale
            ! Most fields move one body: zero columns of other bodies are left out.
            associate (of_phi => rows(:ends(2), k), of_c => rows(ends(2) + 1:ends(3), k))
                do j = 1, point%n
                    if (abs(x(j)) > 0.0_wp) then
                        of_phi = of_phi + point%jacobian(:point%nh, j)*x(j)
                        of_c = of_c + point%velocity_q(:, j)*x(j)
                        forces(:, k) = forces(:, k) + point%dynamics_q(:, j)*x(j)
                    end if
                    if (abs(x_rate(j)) > 0.0_wp) then
                        of_c = of_c + point%jacobian(:, j)*x_rate(j)
                        forces(:, k) = forces(:, k) + point%dynamics_qd(:, j)*x_rate(j)
                    end if
                    if (abs(x_curve(j)) > 0.0_wp) forces(:, k) = forces(:, k) + point%mass(:, j)*x_curve(j)
                end do
            end associate
            call size_field(x, x_rate, x_curve, sizes, size_of_forces(:, k))
        end do
        rows(ends(3) + 1:ends(4), :size(self%motions)) = matmul(transpose(point%w), forces)
        sizes(ends(3) + 1:ends(4)) = max(0.0_wp, maxval(matmul(transpose(abs(point%w)), size_of_forces), dim=2))
        of_time = 0.0_wp
        if (point%has_gradients) then
            call differentiate_by_time(point, of_time(:ends(4)), stat)
        else
            call difference_by_time(point, of_time(:ends(4)), stat)
        end if
        if (stat /= status_ok) return
        rows(:, size(self%motions) + 1) = of_time
        sizes = max(sizes, abs(of_time))
        ! Rows whose terms are negligible beside the others of their level carry no information.
        do level = 1, 3
            associate (rows => rows(ends(level) + 1:ends(level + 1), :), sizes => sizes(ends(level) + 1:ends(level + 1)))
                if (size(sizes) == 0) cycle
                least = max(1.0e-4_wp*maxval(sizes), tiny(1.0_wp))
                do k = 1, size(sizes)
                    rows(k, :) = rows(k, :)/max(sizes(k), least)
                end do
            end associate
        end do

    contains

        !> The sizes of the terms of a field.
        pure subroutine size_field(x, x_rate, x_curve, sizes, size_of_forces)
            real(wp), intent(in) :: x(:), x_rate(:), x_curve(:)
            real(wp), intent(inout) :: sizes(:)
            real(wp), intent(inout) :: size_of_forces(:)
            real(wp) :: of_phi(point%nh), of_c(point%m)
            integer :: j

            of_phi = 0.0_wp
            of_c = 0.0_wp
            do j = 1, point%n
                if (abs(x(j)) > 0.0_wp) then
                    of_phi = of_phi + abs(point%jacobian(:point%nh, j)*x(j))
                    of_c = of_c + abs(point%velocity_q(:, j)*x(j))
                    size_of_forces = size_of_forces + abs(point%dynamics_q(:, j)*x(j))
                end if
                if (abs(x_rate(j)) > 0.0_wp) then
                    of_c = of_c + abs(point%jacobian(:, j)*x_rate(j))
                    size_of_forces = size_of_forces + abs(point%dynamics_qd(:, j)*x_rate(j))
                end if
                if (abs(x_curve(j)) > 0.0_wp) size_of_forces = size_of_forces + abs(point%mass(:, j)*x_curve(j))
            end do
            sizes(:ends(2)) = max(sizes(:ends(2)), of_phi)
            sizes(ends(2) + 1:ends(3)) = max(sizes(ends(2) + 1:ends(3)), of_c)
        end subroutine size_field
    end subroutine add_rows

    !> The derivatives of Phi, C qd - nu and W'(M qdd + C' lambda - S - Q_A) with respect to time alone, from gradients and gamma at
    !> qd = 0; exactly zero if nothing depends on it. Changes the point.
    subroutine differentiate_by_time(point, of_time, stat)
        type(point_type), intent(inout) :: point
        real(wp), intent(out) :: of_time(:)
        integer, intent(out) :: stat
        real(wp) :: qd(point%n), lambda(point%m), rates(point%n), w(point%n, point%nw), by_time(point%m, point%n)
        logical :: is_given

        stat = status_ok
        qd = point%qd
        lambda = point%lambda
        w = point%w
        call point%model%force_rate(point%t, point%q, qd, rates, is_given, stat)
        if (is_given) then
            if (stat /= 0) stat = status_callback_failed
        else
            call difference_forces(point, rates, stat)
        end if
        if (stat /= status_ok) return
        associate (nh => point%nh, m => point%m)
            of_time(:nh) = -point%nu(:nh)
            call point%evaluate(point%t, point%q, 0*qd, stat)
            if (stat /= status_ok) return
            point%qdd = 0.0_wp
            call point%differentiate(stat)
            by_time = point%acceleration_qd - point%velocity_q
            of_time(nh + 1:nh + m) = matmul(by_time, qd/point%scale) + point%gamma
            of_time(nh + m + 1:) = matmul(transpose(w), matmul(lambda, by_time) - point%scale*rates)
        end associate
    end subroutine differentiate_by_time

    !> The derivative of S + Q_A with respect to time alone by central differences, for a model that does not provide it.
    subroutine difference_forces(point, rates, stat)
        type(point_type), intent(inout) :: point
        real(wp), intent(out) :: rates(:)
        integer, intent(out) :: stat
        real(wp), dimension(point%n) :: q, qd, reference
        real(wp) :: h, t
        integer :: i

        h = step/point%rate
        q = point%q
        qd = point%qd
        t = point%t
        reference = point%force
        rates = 0.0_wp
        do i = 1, size(place)
            call point%evaluate(t + place(i)*h, q, qd, stat)
            if (stat /= status_ok) return
            rates = rates + weight(i)/h*(point%force - reference)/point%scale
        end do
        call point%evaluate(t, q, qd, stat)
    end subroutine difference_forces

    !> All of them by central differences, for a model without gradients; exactly zero if nothing depends on the time.
    subroutine difference_by_time(point, of_time, stat)
        type(point_type), intent(inout) :: point
        real(wp), intent(out) :: of_time(:)
        integer, intent(out) :: stat
        real(wp), dimension(point%n) :: q, qd, s_qd, s_qdd
        real(wp) :: h, t, w(point%n, point%nw), reference(size(of_time))
        integer :: i

        h = step/point%rate
        q = point%q
        qd = point%qd
        t = point%t
        w = point%w
        s_qd = qd/point%scale
        s_qdd = point%qdd/point%scale
        of_time = 0.0_wp
        reference = residuals()
        do i = 1, size(place)
            call point%evaluate(t + place(i)*h, q, qd, stat)
            if (stat /= status_ok) return
            of_time = of_time + weight(i)/h*(residuals() - reference)
        end do
        call point%evaluate(t, q, qd, stat)

    contains

        function residuals() result(r)
            real(wp) :: r(size(of_time))

            r = [point%phi, matmul(point%jacobian, s_qd) - point%nu, matmul(transpose(w), matmul(point%mass, s_qdd) + &
                matmul(transpose(point%jacobian), point%lambda) - point%force)]
        end function residuals
    end subroutine difference_by_time

    !> Transform any basis of the symmetries to readable echelon form, the time first.
    subroutine reduce(self, span)
        class(symmetry_type), intent(inout) :: self
        !> (n_motions + 1, any), the time last.
        real(wp), intent(inout) :: span(:, :)
        integer :: k, n, row, column, pivot, i
        integer, allocatable :: order(:)
        logical :: is_used(size(span, 2))
        real(wp) :: swap(size(span, 1))

        n = size(span, 1)
        k = size(span, 2)
        if (allocated(self%rates_of_time)) deallocate (self%rates_of_time)
        is_used = .false.
        ! Rotations of the world come last, so that the spin of a body is preferred if both are equal.
        allocate (order, source=[n])
        do i = 1, n - 1
            if (.not. self%motions(i)%turns_world) order = [order, i]
        end do
        do i = 1, n - 1
            if (self%motions(i)%turns_world) order = [order, i]
        end do
        do i = 1, n
            row = order(i)
            if (all(is_used)) exit
            pivot = maxloc(merge(abs(span(row, :)), -1.0_wp, .not. is_used), dim=1)
            if (abs(span(row, pivot)) < 1.0e-7_wp) cycle
            is_used(pivot) = .true.
            span(:, pivot) = span(:, pivot)/span(row, pivot)
            do column = 1, k
                if (column == pivot) cycle
                swap = span(row, column)*span(:, pivot)
                span(:, column) = span(:, column) - swap
                span(row, column) = 0.0_wp
            end do
            if (i == 1) allocate (self%rates_of_time(n - 1), source=0.0_wp)
        end do
        ! Rounding beside the ones.
        where (abs(span) < 1.0e-12_wp) span = 0.0_wp
        self%rates = span(:n - 1, :)
        if (.not. allocated(self%rates_of_time)) return
        self%rates_of_time = span(:n - 1, maxloc(abs(span(n, :)), dim=1))
        self%rates = self%rates(:, pack([(i, i=1, k)], .not. abs(span(n, :)) > 0.5_wp))
    end subroutine reduce

    !> X q (n) for rates of the fields.
    pure function field(self, rates, q) result(x)
        class(symmetry_type), intent(in) :: self
        real(wp), intent(in) :: rates(:), q(:)
        real(wp) :: x(size(q))
        integer :: k

        x = 0.0_wp
        do k = 1, size(self%motions)
            if (abs(rates(k)) > 0.0_wp) call self%motions(k)%add_field(q, rates(k), x)
        end do
    end function field

    !> L x (n) for rates of the fields.
    pure function turned(self, rates, x) result(y)
        class(symmetry_type), intent(in) :: self
        real(wp), intent(in) :: rates(:), x(:)
        real(wp) :: y(size(x))
        integer :: k

        y = 0.0_wp
        do k = 1, size(self%motions)
            if (abs(rates(k)) > 0.0_wp) call self%motions(k)%add_turned(x, rates(k), y)
        end do
    end function turned

    !> L (n, n) for rates of the fields.
    pure function matrix(self, rates, n) result(l)
        class(symmetry_type), intent(in) :: self
        real(wp), intent(in) :: rates(:)
        integer, intent(in) :: n
        real(wp) :: l(n, n)
        integer :: k, i

        l = 0.0_wp
        do k = 1, size(self%motions)
            associate (motion => self%motions(k))
                do i = 1, size(motion%row)
                    l(motion%row(i), motion%column(i)) = l(motion%row(i), motion%column(i)) + rates(k)*motion%entry(i)
                end do
            end associate
        end do
    end function matrix

    !> The name of a symmetry: the names of its fields, with rates other than one.
    function name_of(self, rates) result(name)
        class(symmetry_type), intent(in) :: self
        real(wp), intent(in) :: rates(:)
        character(len=:), allocatable :: name
        character(len=16) :: factor
        integer :: k

        name = ''
        do k = 1, size(self%motions)
            if (.not. abs(rates(k)) > 0.0_wp) cycle
            if (name /= '') name = name//' + '
            if (abs(rates(k) - 1.0_wp) > 1.0e-9_wp) then
                write (factor, '(g0.4)') rates(k)
                name = name//trim(factor)//' '
            end if
            name = name//trim(self%motions(k)%name)
        end do
    end function name_of
end module tandem_analysis_symmetry
