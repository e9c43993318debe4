! SPDX-License-Identifier: MIT
!> A metric that weights stiff directions, from the Newton matrix M + beta D + beta^2 K of a step with beta = h a_ii, D and K the
!> symmetric parts of the gradients of the forces; and the complements that are orthogonal to the tangent spaces in it.
!>
!> A chart's complement is the direction in which a step is brought back to the constraints. If that moves a stiff coordinate, the
!> stiff force is nonlinear in the chart's coordinates, and an implicit method loses its order. In this metric a stiff coordinate is
!> weighted: the complement moves the others, the stiff force stays linear, and an L-stable method resolves the slow motion. Any
!> smooth complement gives the same motion, so the metric need not be exact, and is kept as long as the matrix is.
!>
!> Complements follow the metric if this saves steps. The displacement of the last step along the plain complement gives the strain
!> of stiff directions, as a velocity: their force over its resistance. Below a few tolerances it costs no steps.
module tandem_chart_dense_metric
    use tandem_kinds, only: wp
    use tandem_linalg_cholesky, only: cholesky_type
    use tandem_linalg_kernels, only: set_gram, set_product
    use tandem_linalg_singular, only: decompose_in
    use tandem_pack, only: pack_type
    implicit none (type, external)
    private

    public :: metric_type

    !> Displacement along the plain complement in a step with `beta` (n), in units of coordinate scales; work space for the next.
    type :: displacement_type
        logical :: is_known = .false.
        real(wp) :: beta = 0.0_wp
        real(wp), allocatable :: move(:), new_move(:)
    end type displacement_type

    !> Trial of the metric: steps so far, beta before it; remaining steps for which the outcome of the last trial is assumed, and
    !> their number after the next trial.
    type :: trial_type
        integer :: tried = 0, for_granted = 0, rest = 0
        real(wp) :: before = 0.0_wp
    end type trial_type

    !> The metric of the complements, and when it is used.
    type :: metric_type
        !> True if complements follow stiff directions.
        logical :: is_on = .false.
        !> True if the last matrix was not positive definite, as with masses that are so on the tangent spaces only.
        logical, private :: is_unusable = .false.
        integer, private :: n = 0
        !> M, D and K of the last `load` (n, n), symmetric; the sums of |D| and of |K| by rows (n), the mean of M's diagonal.
        real(wp), allocatable, private :: mass(:, :), damping(:, :), stiffness(:, :), row_damping(:), row_stiffness(:)
        real(wp), private :: mean = 0.0_wp
        !> Relative change of D and K since the last update of the metric. beta of the last `set`, of the metric and of the trace; a
        !> part of M that every direction has.
        real(wp), private :: drift = 0.0_wp, asked = 0.0_wp, beta = 0.0_wp, trace_beta = 0.0_wp, floor = 0.0_wp
        !> Part of the mass forces across the tangent space, at `trace_beta`.
        real(wp), private :: trace = 0.0_wp
        !> The velocity error that a run allows, in units of coordinate scales.
        real(wp), private :: tolerance = 0.0_wp
        !> Strain, in tolerances, from which the metric is used without a trial.
        real(wp), private :: many = huge(1.0_wp)
        type(displacement_type), private :: displacement
        type(trial_type), private :: trial
        !> beta D + beta^2 K, then the metric G (n, n), its factor and its inverse.
        real(wp), allocatable, private :: matrix(:, :), inverse(:, :)
        type(cholesky_type), private :: factor
        !> N' G^-1 N (m, m) and its factor for the positions and for the velocities, G^-1 N (n, *), and work space (n), (n**2).
        real(wp), allocatable, private :: gram(:, :), moved(:, :), row(:), shift(:)
        !> Scales of the bases over those of the coordinates (n).
        real(wp), allocatable, private :: unit(:)
        type(cholesky_type), private :: position_gram, velocity_gram
        !> Work space of the eigenvalues.
        real(wp), allocatable, private :: vectors(:, :), values(:), work(:)
    contains
        procedure :: allocate => allocate_metric, load, note_move, set, lean, pack_state
        procedure, private :: pays, end_trial, measure, is_felt, form, add_forces, find_trace
    end type metric_type

    !> A metric, and a trace, are reused for steps that are longer or shorter by up to this factor.
    real(wp), parameter :: near = 1.5_wp
    !> Forces above this part of the mass affect a step.
    real(wp), parameter :: felt = 0.1_wp
    !> Forces on a coordinate below this part of the mass belong to the motion itself.
    real(wp), parameter :: soft = 5.0e-3_wp

contains

    !> Allocate for n coordinates, nh holonomic and m constraints in all, and the velocity error that a run allows, relative to
    !> coordinate scales; 0 if unspecified.
    subroutine allocate_metric(self, n, nh, m, tolerance, rate)
        class(metric_type), intent(inout) :: self
        integer, intent(in) :: n, nh, m
        real(wp), intent(in) :: tolerance
        !> 1 over the time scale.
        real(wp), intent(in) :: rate
        !> Default tolerance for fixed steps.
        real(wp), parameter :: usual = 1.0e-7_wp

        self%n = n
        self%is_on = .false.
        self%is_unusable = .false.
        self%displacement%is_known = .false.
        self%trial%tried = 0
        self%trial%for_granted = 0
        self%drift = 0.0_wp
        self%asked = 0.0_wp
        self%beta = 0.0_wp
        self%trace_beta = 0.0_wp
        self%tolerance = rate*merge(tolerance, usual, tolerance > 0.0_wp)
        ! A trial compares the lengths of steps, which tells nothing about fixed ones.
        self%many = merge(huge(1.0_wp), 200.0_wp, tolerance > 0.0_wp)
        if (allocated(self%mass)) deallocate (self%mass, self%damping, self%stiffness, self%matrix, self%gram, self%moved, &
            self%inverse, self%row, self%shift, self%vectors, self%values, self%work, self%row_damping, self%row_stiffness, &
            self%displacement%move, self%displacement%new_move, self%unit)
        allocate (self%mass(n, n), self%damping(n, n), self%stiffness(n, n), self%matrix(n, n), self%gram(m, m), &
            self%inverse(n, n), self%row(n), self%shift(n*n), self%moved(n, max(m, n - m)), self%vectors(n, n), &
            self%values(n), self%work(34*n), self%row_damping(n), self%row_stiffness(n), &
            self%displacement%move(n), self%displacement%new_move(n), &
            self%unit(n), source=0.0_wp)
        call self%factor%allocate(n)
        call self%position_gram%allocate(nh)
        call self%velocity_gram%allocate(m)
    end subroutine allocate_metric

    !> Take M, D and K at a point.
    subroutine load(self, mass, damping, stiffness, scale, unit)
        class(metric_type), intent(inout) :: self
        !> M, the gradients of the equations of motion by qd and by q (n, n), scales of the bases and of coordinates (n).
        real(wp), intent(in), contiguous :: mass(:, :), damping(:, :), stiffness(:, :), scale(:), unit(:)
        !> Relative change of forces above which the metric changes.
        real(wp), parameter :: alike = 0.05_wp
        real(wp) :: change(3), total(3), new
        integer :: i, j

        self%mean = 0.0_wp
        self%row_damping = 0.0_wp
        self%row_stiffness = 0.0_wp
        change = 0.0_wp
        total = 0.0_wp
        do j = 1, self%n
            self%unit(j) = scale(j)/unit(j)
            do i = 1, self%n
                new = scale(i)*scale(j)*mass(i, j)
                change(1) = change(1) + abs(new - self%mass(i, j))
                total(1) = total(1) + abs(new)
                self%mass(i, j) = new
                new = 0.5_wp*scale(i)*scale(j)*(damping(i, j) + damping(j, i))
                change(2) = change(2) + abs(new - self%damping(i, j))
                self%row_damping(i) = self%row_damping(i) + abs(new)
                self%damping(i, j) = new
                new = 0.5_wp*scale(i)*scale(j)*(stiffness(i, j) + stiffness(j, i))
                change(3) = change(3) + abs(new - self%stiffness(i, j))
                self%row_stiffness(i) = self%row_stiffness(i) + abs(new)
                self%stiffness(i, j) = new
            end do
            self%mean = self%mean + self%mass(j, j)/real(self%n, wp)
        end do
        total(2) = sum(self%row_damping)
        total(3) = sum(self%row_stiffness)
        ! Any smooth complement will do, so a complement for nearly equal matrices will, too.
        self%drift = self%drift + maxval(change/max(total, tiny(1.0_wp)))
        if (self%drift <= alike) return
        self%drift = 0.0_wp
        self%beta = 0.0_wp
        self%trace_beta = 0.0_wp
    end subroutine load

    !> Record the displacement of a step along the plain complement. A step may repeat a larger displacement of earlier steps.
    subroutine note_move(self, complement, q0, q, scale)
        class(metric_type), intent(inout) :: self
        !> Complement of the positions, orthonormal in scaled coordinates (n, nh).
        real(wp), intent(in), contiguous :: complement(:, :)
        !> Start and end of the step, coordinate scales (n).
        real(wp), intent(in), contiguous :: q0(:), q(:), scale(:)
        !> Factor by which a step reduces the memory of earlier steps.
        real(wp), parameter :: fading = 0.25_wp
        real(wp) :: part
        integer :: i, j

        if (.not. self%asked > 0.0_wp) return
        if (.not. self%is_felt(self%asked)) return
        do i = 1, self%n
            self%row(i) = (q(i) - q0(i))/scale(i)
        end do
        if (all(abs(self%row) <= 0.0_wp)) return
        self%displacement%new_move = 0.0_wp
        do j = 1, size(complement, 2)
            part = 0.0_wp
            do i = 1, self%n
                part = part + complement(i, j)*self%row(i)
            end do
            do i = 1, self%n
                self%displacement%new_move(i) = self%displacement%new_move(i) + part*complement(i, j)
            end do
        end do
        if (self%displacement%is_known) then
            ! In one step the displacement grows as beta**2.
            part = fading*(self%asked/self%displacement%beta)**2
            self%displacement%move = part*self%displacement%move
            self%displacement%beta = self%asked
            if (sum(self%displacement%new_move**2) < sum(self%displacement%move**2)) return
        end if
        self%displacement%move = self%displacement%new_move
        self%displacement%beta = self%asked
        self%displacement%is_known = .true.
    end subroutine note_move

    !> Form the metric for beta = h a_ii, if complements are to follow it.
    subroutine set(self, beta, complement, tangent, has_changed)
        class(metric_type), intent(inout) :: self
        real(wp), intent(in) :: beta
        !> The plain complement of the velocities and the tangent space, orthonormal in scaled coordinates (n, m), (n, n - m).
        real(wp), intent(in), contiguous :: complement(:, :), tangent(:, :)
        !> False if complements need not change.
        logical, intent(out) :: has_changed

        self%asked = beta
        has_changed = self%is_on
        if (self%pays(beta, complement, tangent)) then
            has_changed = .not. ((self%is_on .or. self%is_unusable) .and. is_near(beta, self%beta))
            if (.not. has_changed) return
            call self%find_trace(beta, complement, tangent)
            call self%form(beta)
        else
            self%is_on = .false.
        end if
    end subroutine set

    !> True if a metric or a trace made for one beta can be reused for another; false if there is none.
    pure logical function is_near(beta, made_for)
        real(wp), intent(in) :: beta, made_for

        is_near = made_for > 0.0_wp .and. beta <= near*made_for .and. made_for <= near*beta
    end function is_near

    !> True if the plain complement would cost steps. In the first step this is unknown: it is assumed if forces are felt. Later the
    !> metric is used if springs dominate. A strain of a few tolerances is harmless; above, a few steps with the metric are tried:
    !> if they do not become longer, the next ones use the plain complement; later the trial is repeated.
    logical function pays(self, beta, complement, tangent)
        class(metric_type), intent(inout) :: self
        real(wp), intent(in) :: beta
        real(wp), intent(in), contiguous :: complement(:, :), tangent(:, :)
        !> Only the part of a strain that the method's stages miss is an error. Measured: with the plain complement, steps on stiff
        !> pendulums become so short that it is five to a hundred tolerances; forty cost none on suspensions, nine hundred none on
        !> bushings of a spatial mechanism, whose steps the metric shortened.
        real(wp), parameter :: few = 4.0_wp
        !> Above this dominance of springs the plain complement is unsuitable.
        real(wp), parameter :: stiff = 0.3_wp
        !> Below this part of the mass, forces across the tangent space are those of gravity and of turning bodies.
        real(wp), parameter :: least = 2.0e-3_wp
        !> Steps of a trial, the growth of steps required, and the number of steps for which the first outcome is assumed.
        integer, parameter :: trial = 5, shortest = 32
        real(wp), parameter :: growth = 1.5_wp
        real(wp) :: strain, dominance

        pays = self%is_felt(beta)
        if (.not. pays) return
        if (.not. self%displacement%is_known) then
            call self%find_trace(beta, complement, tangent)
            pays = self%trace > felt
            self%trial%for_granted = 0
            self%trial%rest = shortest
            return
        end if
        call self%measure(beta, strain, dominance)
        if (strain > few*self%tolerance .and. .not. dominance > stiff) then
            call self%find_trace(beta, complement, tangent)
            if (.not. self%trace > least) strain = 0.0_wp
        end if
        pays = dominance > stiff .or. strain > self%many*self%tolerance
        if (pays .or. .not. strain > few*self%tolerance) then
            ! Steps of a trial have become so short that nothing strains.
            if (self%trial%tried > 0 .and. .not. pays .and. beta < self%trial%before) call self%end_trial()
            self%trial%tried = 0
            ! The plain complement takes over without a trial: it is not assumed to pay for long.
            if (self%is_on) self%trial%for_granted = min(self%trial%for_granted, shortest)
            return
        end if
        pays = self%is_on
        if (self%trial%for_granted > 0) then
            self%trial%for_granted = self%trial%for_granted - 1
        else if (self%trial%tried == 0) then
            ! If the metric is on, the effect of the plain complement is unknown.
            pays = .not. self%is_on
            if (pays) self%trial%before = beta
            if (pays) self%trial%tried = 1
        else if (self%trial%tried < trial) then
            self%trial%tried = self%trial%tried + 1
        else
            pays = beta > growth*self%trial%before
            call self%end_trial()
        end if
    end function pays

    !> Assume the outcome of a trial for a number of steps that doubles.
    subroutine end_trial(self)
        class(metric_type), intent(inout) :: self
        integer, parameter :: longest = 1024

        self%trial%tried = 0
        self%trial%for_granted = self%trial%rest
        self%trial%rest = min(2*self%trial%rest, longest)
    end subroutine end_trial

    !> The velocity by which the plain complement strains stiff directions in a step, as far as the method's stages miss it, in
    !> units of coordinate scales. With a = beta D and b = beta^2 K over the mass of a coordinate, its spring moves it by
    !> b/(1 + a + b) of the displacement. Of that, a method of stage order 1 misses a part that falls with a + b if a step resolves
    !> the spring, and if a damper holds the coordinate, which then follows slowly and is resolved by the step, too.
    pure subroutine measure(self, beta, strain, dominance)
        class(metric_type), intent(in) :: self
        real(wp), intent(in) :: beta
        !> The velocity, and the largest missed part of a displacement.
        real(wp), intent(out) :: strain, dominance
        real(wp) :: force, part, a, b
        integer :: i, j

        strain = 0.0_wp
        dominance = 0.0_wp
        do i = 1, self%n
            a = max(beta*self%damping(i, i), 0.0_wp)/self%mean
            b = max(beta*beta*self%stiffness(i, i), 0.0_wp)/self%mean
            if (.not. a + b > soft) cycle
            part = (a + b)/(1.0_wp + a + b)*min(1.0_wp, (1.0_wp + b)/(1.0_wp + a))**2
            dominance = max(dominance, part)
            force = 0.0_wp
            do j = 1, self%n
                force = force + self%stiffness(j, i)*self%displacement%move(j)
            end do
            force = part*beta*force/(self%mean + beta*(self%row_damping(i) + beta*self%row_stiffness(i)))
            strain = strain + (self%unit(i)*force)**2
        end do
        strain = sqrt(strain)*(beta/self%displacement%beta)**2
    end subroutine measure

    !> True if springs and dampers of a coordinate are more than soft.
    pure logical function is_felt(self, beta)
        class(metric_type), intent(in) :: self
        real(wp), intent(in) :: beta
        integer :: i

        is_felt = .false.
        do i = 1, self%n
            is_felt = is_felt .or. beta*(self%damping(i, i) + beta*self%stiffness(i, i)) > soft*self%mean
        end do
    end function is_felt

    !> Form and factor the metric.
    subroutine form(self, beta)
        class(metric_type), intent(inout) :: self
        real(wp), intent(in) :: beta
        !> Metric of a direction without mass, relative to the mean mass; and its upper limit, because of rounding.
        real(wp), parameter :: massless = 1.0e-3_wp, most = 1.0e12_wp
        !> Forces that are a times the mean mass count for the fourth power of a times this factor. Soft directions hardly count:
        !> complements would reach far for softer ones. Stiff directions count so much that complements do not move them.
        real(wp), parameter :: steep = 30.0_wp
        !> Steps that the plain complement has shortened are stiff in steps that are longer by at most this factor.
        real(wp), parameter :: longest = 15.0_wp
        real(wp) :: weight
        integer :: i, j, stat

        self%beta = beta
        call self%add_forces(beta*min(longest, sqrt(1.0_wp/min(1.0_wp, max(self%trace, 1.0_wp/longest**2)))))
        call decompose_in(self%work, self%matrix, self%values)
        do j = 1, self%n
            weight = sqrt(self%floor*min(most, (steep*max(self%values(j)/self%floor, 0.0_wp))**4))
            do i = 1, self%n
                self%vectors(j, i) = weight*self%matrix(i, j)
            end do
        end do
        call set_gram(self%vectors, self%vectors, self%matrix)
        self%matrix = self%matrix + self%mass
        do i = 1, self%n
            self%matrix(i, i) = self%matrix(i, i) + massless*self%floor
        end do
        call self%factor%factor(self%matrix, stat)
        self%is_on = stat == 0
        self%is_unusable = .not. self%is_on
        if (self%is_unusable) return
        self%inverse = 0.0_wp
        do j = 1, self%n
            self%inverse(j, j) = 1.0_wp
        end do
        call self%factor%solve_rows(self%inverse)
    end subroutine form

    !> beta D + beta^2 K.
    pure subroutine add_forces(self, beta)
        class(metric_type), intent(inout) :: self
        real(wp), intent(in) :: beta
        integer :: i, j

        do j = 1, self%n
            do i = 1, self%n
                self%matrix(i, j) = beta*(self%damping(i, j) + beta*self%stiffness(i, j))
            end do
        end do
    end subroutine add_forces

    !> The trace of (N' M N + floor)^-1 N' (beta D + beta^2 K) N for a beta near this one: independent of the choice of the basis N
    !> of the complement. 0 if there is none.
    subroutine find_trace(self, beta, complement, tangent)
        class(metric_type), intent(inout) :: self
        real(wp), intent(in) :: beta
        real(wp), intent(in), contiguous :: complement(:, :), tangent(:, :)
        integer :: j, m, stat

        if (is_near(beta, self%trace_beta)) return
        self%trace_beta = beta
        self%trace = 0.0_wp
        associate (moved => self%moved(:, :size(tangent, 2)))
            call set_product(self%mass, tangent, moved)
            self%floor = sum(tangent*moved)/real(max(size(tangent, 2), 1), wp)
        end associate
        call self%add_forces(beta)
        m = size(complement, 2)
        call set_product(self%mass, complement, self%moved(:, :m))
        call set_gram(complement, self%moved(:, :m), self%gram)
        do j = 1, m
            self%gram(j, j) = self%gram(j, j) + self%floor
        end do
        call self%velocity_gram%factor(self%gram, stat)
        if (stat /= 0) return
        call set_product(self%matrix, complement, self%moved(:, :m))
        call set_gram(complement, self%moved(:, :m), self%gram)
        call self%velocity_gram%solve_rows(self%gram)
        do j = 1, m
            self%trace = self%trace + self%gram(j, j)
        end do
    end subroutine find_trace

    !> The complements U of null(Phi_q) and X of null(C) in the metric, and the duals of V and W that vanish on them:
    !> U := G^-1 N (N' G^-1 N)^-1, so that N' U = I as for the plain complement, and V - N U' V; alike with C.
    subroutine lean(self, nh, m, basis, scale, u_basis, v_dual, x_basis, w_dual)
        class(metric_type), intent(inout) :: self
        !> Holonomic constraints and all.
        integer, intent(in) :: nh, m
        !> Orthonormal in scaled coordinates (n, n): range(Phi_q'), the rest of range(C'), null(C); coordinate scales (n).
        real(wp), intent(in), contiguous :: basis(:, :), scale(:)
        !> U (n, nh), the dual of V (n, n - nh), X (n, m), the dual of W (n, n - m). If the metric does not separate complement and
        !> tangent space, all are unchanged.
        real(wp), intent(inout), contiguous :: u_basis(:, :), v_dual(:, :), x_basis(:, :), w_dual(:, :)
        integer :: stat

        ! The first nh columns of the product for C are those for Phi_q.
        call set_product(self%inverse, basis(:, :m), self%moved(:, :m))
        call set_gram(basis(:, :m), self%moved(:, :m), self%gram)
        call self%velocity_gram%factor(self%gram, stat)
        if (stat /= 0) return
        if (nh < m) then
            call self%position_gram%factor(self%gram(:nh, :nh), stat)
            if (stat /= 0) return
        end if
        call lean_by(self%velocity_gram, basis(:, :m), basis(:, m + 1:), self%moved(:, :m), scale, self%shift, x_basis, w_dual)
        if (nh == m) then
            u_basis(:, :m) = x_basis
            v_dual(:, :) = w_dual
        else if (nh > 0) then
            call lean_by(self%position_gram, basis(:, :nh), basis(:, nh + 1:), self%moved(:, :nh), scale, self%shift, &
                u_basis(:, :nh), v_dual)
        end if
    end subroutine lean

    !> Adapt one of the two complements and its dual.
    subroutine lean_by(gram, plain, tangent, moved, scale, shift, complement, dual)
        !> Factor of N' G^-1 N.
        type(cholesky_type), intent(in) :: gram
        !> N and the tangent space, orthonormal (n, m), (n, n - m), G^-1 N (n, m), coordinate scales (n).
        real(wp), intent(in), contiguous :: plain(:, :), tangent(:, :), moved(:, :), scale(:)
        !> Work space.
        real(wp), intent(inout) :: shift(size(plain, 2), size(tangent, 2))
        !> (n, m), (n, n - m).
        real(wp), intent(inout), contiguous :: complement(:, :), dual(:, :)
        integer :: i, j, k

        complement = moved
        call gram%solve_rows(complement)
        ! U' V, then V - N U' V.
        call set_gram(complement, tangent, shift)
        call set_product(plain, shift, dual)
        do j = 1, size(tangent, 2)
            do i = 1, size(scale)
                dual(i, j) = (tangent(i, j) - dual(i, j))/scale(i)
            end do
        end do
        ! U = N + V V' U, which keeps N' U = I and the dual's zero on U even if the metric is too ill-conditioned for its factors to
        ! preserve it: Newton's corrections would never remove the component of U along the dual.
        do j = 1, size(plain, 2)
            complement(:, j) = plain(:, j)
            do k = 1, size(tangent, 2)
                do i = 1, size(scale)
                    complement(i, j) = complement(i, j) + shift(j, k)*tangent(i, k)
                end do
            end do
            do i = 1, size(scale)
                complement(i, j) = scale(i)*complement(i, j)
            end do
        end do
    end subroutine lean_by

    !> State on which later charts depend.
    subroutine pack_state(self, pack)
        class(metric_type), intent(inout) :: self
        type(pack_type), intent(inout) :: pack

        call pack%item(self%is_on, self%is_unusable)
        call pack%item(self%drift, self%asked, self%beta, self%trace_beta, self%trace)
        call pack%item(self%floor, self%mean)
        call pack%item(self%displacement%is_known)
        call pack%item(self%displacement%beta)
        call pack%item(self%trial%tried, self%trial%for_granted, self%trial%rest)
        call pack%item(self%trial%before)
        call pack%item(self%displacement%move, self%unit, self%row_damping, self%row_stiffness)
        call pack%item(self%mass, self%damping, self%stiffness, self%inverse)
    end subroutine pack_state
end module tandem_chart_dense_metric
