! SPDX-License-Identifier: MIT
!> A metric in which what is stiff in a step is dear, from its Newton matrix M + beta D + beta^2 K with beta = h a_ii, D and K the
!> symmetric parts of the gradients of the forces; and the complements that are orthogonal to the tangent spaces in it.
!>
!> A chart's complement is the direction in which a step is brought back to the constraints. Where that moves a stiff coordinate,
!> the stiff force is nonlinear in the chart's coordinates, and an implicit method loses its order. In this metric a stiff
!> coordinate is dear: the complement moves the others, the stiff force stays linear, and an L-stable method sees the slow motion.
!> Any smooth complement gives the same motion, so the metric need not be exact, and is kept as long as the matrix is.
module tandem_chart_dense_metric
    use tandem_kinds, only: wp
    use tandem_linalg_cholesky, only: cholesky_type
    use tandem_linalg_kernels, only: set_gram, set_product
    use tandem_linalg_singular, only: decompose_in
    use tandem_pack, only: pack_type
    implicit none (type, external)
    private

    public :: metric_type

    type :: metric_type
        !> Whether something is so stiff that complements are to follow it.
        logical :: is_on = .false.
        integer, private :: n = 0
        !> M, D and K of the last `load` (n, n), symmetric; beta of the last `set`; a part of M that every direction has.
        real(wp), allocatable, private :: mass(:, :), damping(:, :), stiffness(:, :)
        real(wp), private :: beta = 0.0_wp, floor = 0.0_wp
        !> beta D + beta^2 K, then the metric G (n, n), its factor and its inverse.
        real(wp), allocatable, private :: matrix(:, :), inverse(:, :)
        type(cholesky_type), private :: factor
        !> N' G^-1 N (m, m) and its factor for the positions and for the velocities, G^-1 N (n, *), and work space (n), (n**2).
        real(wp), allocatable, private :: gram(:, :), moved(:, :), row(:), shift(:)
        type(cholesky_type), private :: position_gram, velocity_gram
        !> Work space of the eigenvalues.
        real(wp), allocatable, private :: vectors(:, :), values(:), work(:)
    contains
        procedure :: allocate => allocate_metric
        procedure :: load
        procedure :: set
        procedure :: lean
        procedure :: pack_state
        procedure, private :: add_forces
        procedure, private :: trace_across
    end type metric_type

contains

    !> Allocate for n coordinates, nh holonomic and m constraints in all.
    subroutine allocate_metric(self, n, nh, m)
        class(metric_type), intent(inout) :: self
        integer, intent(in) :: n, nh, m

        self%n = n
        self%is_on = .false.
        self%beta = 0.0_wp
        if (allocated(self%mass)) deallocate (self%mass, self%damping, self%stiffness, self%matrix, self%gram, self%moved, &
            self%inverse, self%row, self%shift, self%vectors, self%values, self%work)
        allocate (self%mass(n, n), self%damping(n, n), self%stiffness(n, n), self%matrix(n, n), self%gram(m, m), &
            self%inverse(n, n), self%row(n), self%shift(n*n), self%moved(n, max(m, n - m)), self%vectors(n, n), &
            self%values(n), self%work(34*n), source=0.0_wp)
        call self%factor%allocate(n)
        call self%position_gram%allocate(nh)
        call self%velocity_gram%allocate(m)
    end subroutine allocate_metric

    !> Take M, D and K at a point.
    subroutine load(self, mass, damping, stiffness, scale)
        class(metric_type), intent(inout) :: self
        !> M, the gradients of the equations of motion by qd and by q (n, n), coordinate scales (n).
        real(wp), intent(in), contiguous :: mass(:, :), damping(:, :), stiffness(:, :), scale(:)
        integer :: i, j

        do j = 1, self%n
            do i = 1, self%n
                self%mass(i, j) = scale(i)*scale(j)*mass(i, j)
                self%damping(i, j) = 0.5_wp*scale(i)*scale(j)*(damping(i, j) + damping(j, i))
                self%stiffness(i, j) = 0.5_wp*scale(i)*scale(j)*(stiffness(i, j) + stiffness(j, i))
            end do
        end do
        self%beta = 0.0_wp
    end subroutine load

    !> Form the metric for beta = h a_ii, if complements are to follow it: where the forces are felt in a direction in which the
    !> plain complement moves.
    subroutine set(self, beta, complement, tangent, has_changed)
        class(metric_type), intent(inout) :: self
        real(wp), intent(in) :: beta
        !> The plain complement of the velocities and the tangent space, orthonormal in scaled coordinates (n, m), (n, n - m).
        real(wp), intent(in), contiguous :: complement(:, :), tangent(:, :)
        !> False where complements may stay as they are.
        logical, intent(out) :: has_changed
        !> A metric serves steps that are so many times longer or shorter.
        real(wp), parameter :: near = 1.5_wp
        !> The part of the mass from which on forces are felt in a step.
        real(wp), parameter :: felt = 0.1_wp
        !> What a direction without mass has, of the mean mass; and the most that the metric is of it, for the sake of rounding.
        real(wp), parameter :: massless = 1.0e-3_wp, most = 1.0e12_wp
        !> Forces that are a times the mean mass count for the fourth power of so many times a. What is soft in a step hardly
        !> counts: complements would reach far for what is softer still. What is stiff counts for so much that they do not move it.
        real(wp), parameter :: steep = 30.0_wp
        real(wp) :: weight
        integer :: i, j, stat

        has_changed = .false.
        if (self%beta > 0.0_wp .and. beta <= near*self%beta .and. self%beta <= near*beta) return
        self%beta = beta
        has_changed = self%is_on
        associate (moved => self%moved(:, :size(tangent, 2)))
            call set_product(self%mass, tangent, moved)
            self%floor = sum(tangent*moved)/real(max(size(tangent, 2), 1), wp)
        end associate
        call self%add_forces(beta)
        self%is_on = self%trace_across(complement) > felt
        if (.not. self%is_on) return
        has_changed = .true.
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
        if (.not. self%is_on) return
        self%inverse = 0.0_wp
        do j = 1, self%n
            self%inverse(j, j) = 1.0_wp
            call self%factor%solve(self%inverse(:, j))
        end do
    end subroutine set

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

    !> The trace of (N' M N + floor)^-1 N' (beta D + beta^2 K) N: it does not depend on which basis of the complement N is. 0 where
    !> there is none.
    real(wp) function trace_across(self, complement)
        class(metric_type), intent(inout) :: self
        real(wp), intent(in), contiguous :: complement(:, :)
        integer :: j, m, stat

        m = size(complement, 2)
        trace_across = 0.0_wp
        call set_product(self%mass, complement, self%moved(:, :m))
        call set_gram(complement, self%moved(:, :m), self%gram)
        do j = 1, m
            self%gram(j, j) = self%gram(j, j) + self%floor
        end do
        call self%velocity_gram%factor(self%gram, stat)
        if (stat /= 0) return
        call set_product(self%matrix, complement, self%moved(:, :m))
        call set_gram(complement, self%moved(:, :m), self%gram)
        do j = 1, m
            call self%velocity_gram%solve(self%gram(:, j))
            trace_across = trace_across + self%gram(j, j)
        end do
    end function trace_across

    !> The complements U of null(Phi_q) and X of null(C) in the metric, and the duals of V and W that vanish on them:
    !> U := G^-1 N (N' G^-1 N)^-1, so that N' U = I as for the plain complement, and V - N U' V; alike with C.
    subroutine lean(self, nh, m, basis, scale, u_basis, v_dual, x_basis, w_dual)
        class(metric_type), intent(inout) :: self
        !> Holonomic constraints and all.
        integer, intent(in) :: nh, m
        !> Orthonormal in scaled coordinates (n, n): range(Phi_q'), the rest of range(C'), null(C); coordinate scales (n).
        real(wp), intent(in), contiguous :: basis(:, :), scale(:)
        !> U (n, nh), the dual of V (n, n - nh), X (n, m), the dual of W (n, n - m). Where the metric does not tell complement and
        !> tangent space apart, all stay as they are.
        real(wp), intent(inout), contiguous :: u_basis(:, :), v_dual(:, :), x_basis(:, :), w_dual(:, :)
        integer :: stat

        ! The first nh columns of what is needed for C are those for Phi_q.
        call set_product(self%inverse, basis(:, :m), self%moved(:, :m))
        call set_gram(basis(:, :m), self%moved(:, :m), self%gram)
        call self%velocity_gram%factor(self%gram, stat)
        if (stat /= 0) return
        if (nh < m) then
            call self%position_gram%factor(self%gram(:nh, :nh), stat)
            if (stat /= 0) return
        end if
        call lean_by(self%velocity_gram, m, basis, self%moved, scale, self%row, self%shift, x_basis, w_dual)
        if (nh == m) then
            u_basis(:, :m) = x_basis
            v_dual(:, :) = w_dual
        else if (nh > 0) then
            call lean_by(self%position_gram, nh, basis, self%moved, scale, self%row, self%shift, u_basis(:, :nh), v_dual)
        end if
    end subroutine lean

    !> One of the two.
    subroutine lean_by(gram, m, basis, moved, scale, row, shift, complement, dual)
        !> Where N' G^-1 N is factored.
        type(cholesky_type), intent(inout) :: gram
        integer, intent(in) :: m
        !> N and the tangent space (n, n), G^-1 N in its first columns (n, *), coordinate scales (n).
        real(wp), intent(in), contiguous :: basis(:, :), moved(:, :), scale(:)
        !> Work space.
        real(wp), intent(inout) :: row(m), shift(m, size(scale) - m)
        !> (n, m), (n, n - m).
        real(wp), intent(inout), contiguous :: complement(:, :), dual(:, :)
        integer :: i, j, n

        n = size(scale)
        do i = 1, n
            do j = 1, m
                row(j) = moved(i, j)
            end do
            call gram%solve(row)
            do j = 1, m
                complement(i, j) = row(j)
            end do
        end do
        ! U' V, then V - N U' V.
        call set_gram(complement, basis(:, m + 1:), shift)
        call set_product(basis(:, :m), shift, dual)
        do j = 1, n - m
            do i = 1, n
                dual(i, j) = (basis(i, m + j) - dual(i, j))/scale(i)
            end do
        end do
        do j = 1, m
            do i = 1, n
                complement(i, j) = scale(i)*complement(i, j)
            end do
        end do
    end subroutine lean_by

    !> All that later charts depend on.
    subroutine pack_state(self, pack)
        class(metric_type), intent(inout) :: self
        type(pack_type), intent(inout) :: pack

        call pack%item(self%is_on)
        call pack%item(self%beta)
        call pack%item(self%floor)
        call pack%item(self%mass)
        call pack%item(self%damping)
        call pack%item(self%stiffness)
        call pack%item(self%inverse)
    end subroutine pack_state
end module tandem_chart_dense_metric
