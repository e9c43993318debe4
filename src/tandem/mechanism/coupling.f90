! SPDX-License-Identifier: MIT
!> Rows that constrain a sum of joint coordinates, Phi = sum of factor_i x_i(q) - f(t) - at: gears, racks, belts, screws. Angles may
!> exceed a full turn. Full turns are summed separately and exactly: the constraint of a pair of gears is as accurate after a
!> million turns as at the start.
!>
!> A row that events lock and free is always present, since the size of a model is constant. The row has a coordinate of its own,
!> the slack s. A free row is s = 0 and the joints are free; a locked row constrains the joints, and the slack remains constant. The
!> mass of a slack affects only rounding and is that of a body. Locking sets `at` to the current value of the sum.
!>
!> The row of an imposed angle in space is a coupling, Phi = phi - f(t) between -pi and pi: its only root is phi = f(t) up to full
!> turns, which do not change the orientations of bodies.
module tandem_mechanism_coupling
    use tandem_kinds, only: sp, wp
    use tandem_mechanism_coordinate, only: coordinate_type, differentiate_coordinate, measure_apart, pi
    use tandem_mechanism_pair, only: add_holonomic, add_row, columns, columns_of_c, n_local
    use tandem_mechanism_pose, only: pose_type
    use tandem_model_derivatives, only: derivatives_type
    use tandem_model_terms, only: need_gamma, need_jacobian, need_nu, need_phi, terms_type
    implicit none (type, external)
    private

    public :: coupling_type, max_coupled, evaluate_couplings, differentiate_couplings, lock_coupling

    !> Largest number of coordinates of one row, including a sum that is a coordinate.
    integer, parameter :: max_coupled = 9

    !> A sum of factors times joint coordinates, which a row keeps equal to 0 or to a function of time.
    type :: coupling_type
        !> Row of Phi; number of coordinates.
        integer :: row = 0, n = 0
        type(coordinate_type) :: coordinates(max_coupled)
        real(wp) :: factors(max_coupled) = 0.0_wp
        !> Index of f, 0 if none; true if full turns do not count in Phi.
        integer :: motion = 0
        logical :: drops_turns = .false.
        !> Row that can be freed: its slack (0 for all other rows) and the column of that in C, mass of the slack, true if locked,
        !> and locked value.
        logical :: can_be_freed = .false., is_locked = .true.
        integer :: slack = 0, slack_column = 0
        real(wp) :: slack_mass = 1.0_wp
        real(wp) :: at = 0.0_wp
        !> Sum that is a coordinate with an inertia, such as the angle of a rotor: the last coordinate of the row, with the factor
        !> -1. Its pose, 0 for all other rows; its inertia; index of the coordinate.
        integer :: sum = 0
        real(wp) :: inertia = 0.0_wp
        integer :: displacement = 0
    end type coupling_type

    !> A sum of factors times numbers of turns, with its rounding error.
    type :: turns_type
        real(wp) :: total = 0.0_wp, rest = 0.0_wp
    end type turns_type

contains

    !> Add factor*turns. The product of the leading 24 bits of the factor and the number of turns is exact, and so is the remainder,
    !> for numbers up to 2**24; beyond that the error is at most that of a plain sum.
    pure subroutine add_turns(self, factor, turns)
        type(turns_type), intent(inout) :: self
        real(wp), intent(in) :: factor, turns
        real(wp) :: leading, part, sum, back

        if (.not. abs(turns) > 0.0_wp) return
        leading = 0.0_wp
        if (abs(factor) < huge(1.0_sp)) leading = real(real(factor, sp), wp)
        part = leading*turns
        sum = self%total + part
        back = sum - self%total
        self%rest = self%rest + ((self%total - (sum - back)) + (part - back)) + (factor - leading)*turns
        self%total = sum
    end subroutine add_turns

    !> The sum in radians.
    pure real(wp) function angle_of(self)
        type(turns_type), intent(in) :: self

        angle_of = 2*pi*(self%total + self%rest)
    end function angle_of

    !> Add the terms of every row; the Jacobian is zero on entry.
    pure subroutine evaluate_couplings(couplings, need, q, pose, f, terms)
        type(coupling_type), intent(inout) :: couplings(:)
        integer, intent(in) :: need
        !> Coordinates, for the slacks.
        real(wp), intent(in) :: q(:)
        type(pose_type), intent(in) :: pose(0:)
        !> Values and derivatives of the functions of time.
        real(wp), intent(in), contiguous :: f(0:, :)
        type(terms_type), intent(inout) :: terms
        real(wp) :: x(0:2), sum(0:2), c(0:2), gradient(n_local, 0:2), counted
        type(turns_type) :: turns
        integer :: i, k, last

        last = merge(2, 0, iand(need, need_gamma) /= 0)
        do i = 1, size(couplings)
            associate (it => couplings(i))
                if (.not. it%is_locked) then
                    if (iand(need, need_phi) /= 0) terms%phi(it%row) = q(it%slack)
                    if (iand(need, need_jacobian) /= 0) terms%jacobian(it%row, it%slack_column) = 1.0_wp
                    if (iand(need, need_gamma) /= 0) terms%gamma(it%row) = 0.0_wp
                    cycle
                end if
                sum = 0.0_wp
                turns = turns_type()
                do k = 1, it%n
                    if (iand(need, need_jacobian + need_gamma) == 0) then
                        call measure_apart(it%coordinates(k), pose, x(0), counted)
                        sum(0) = sum(0) + it%factors(k)*x(0)
                        call add_turns(turns, it%factors(k), counted)
                        cycle
                    end if
                    x = 0.0_wp
                    call differentiate_coordinate(it%coordinates(k), pose, last, 0, x, gradient, turns=counted)
                    sum = sum + it%factors(k)*x
                    call add_turns(turns, it%factors(k), counted)
                    if (iand(need, need_jacobian) /= 0) call add_row(columns_of_c(pose(it%coordinates(k)%first), &
                        pose(it%coordinates(k)%second)), it%factors(k), gradient(:, 0), it%row, terms%jacobian)
                end do
                c = 0.0_wp
                if (it%motion > 0) c = f(:, it%motion)
                if (iand(need, need_phi) /= 0) then
                    if (it%drops_turns) then
                        terms%phi(it%row) = sum(0) - it%at - c(0)
                        terms%phi(it%row) = terms%phi(it%row) - 2*pi*anint(terms%phi(it%row)/(2*pi))
                    else
                        terms%phi(it%row) = sum(0) + ((angle_of(turns) - it%at) - c(0))
                    end if
                end if
                if (iand(need, need_nu) /= 0) terms%nu(it%row) = c(1)
                if (iand(need, need_gamma) /= 0) terms%gamma(it%row) = sum(2) - c(2)
            end associate
        end do
    end subroutine evaluate_couplings

    !> Add the gradient blocks of every row; the blocks are zero on entry.
    pure subroutine differentiate_couplings(couplings, need, pose, lambda, derivatives)
        type(coupling_type), intent(inout) :: couplings(:)
        integer, intent(in) :: need
        type(pose_type), intent(in) :: pose(0:)
        real(wp), intent(in) :: lambda(:)
        type(derivatives_type), intent(inout) :: derivatives
        real(wp) :: x(0:2), gradient(n_local, 0:2), second(n_local, n_local)
        integer :: i, k

        do i = 1, size(couplings)
            associate (it => couplings(i))
                if (.not. it%is_locked) cycle
                do k = 1, it%n
                    call differentiate_coordinate(it%coordinates(k), pose, 2, 2, x, gradient, second)
                    call add_holonomic(need, it%row, columns(pose(it%coordinates(k)%first), pose(it%coordinates(k)%second)), &
                        it%factors(k), gradient, second, lambda(it%row), derivatives)
                end do
            end associate
        end do
    end subroutine differentiate_couplings

    !> Lock a coupling at its current value; positions and rotations of the poses are set.
    pure subroutine lock_coupling(coupling, pose, f)
        type(coupling_type), intent(inout) :: coupling
        type(pose_type), intent(in) :: pose(0:)
        !> Values and derivatives of the functions of time.
        real(wp), intent(in) :: f(0:, :)
        real(wp) :: x, counted
        type(turns_type) :: turns
        integer :: k

        coupling%at = 0.0_wp
        if (coupling%motion > 0) coupling%at = -f(0, coupling%motion)
        do k = 1, coupling%n
            call measure_apart(coupling%coordinates(k), pose, x, counted)
            coupling%at = coupling%at + coupling%factors(k)*x
            call add_turns(turns, coupling%factors(k), counted)
        end do
        coupling%at = coupling%at + angle_of(turns)
        coupling%is_locked = .true.
    end subroutine lock_coupling
end module tandem_mechanism_coupling
