! SPDX-License-Identifier: MIT
!> Derivatives of the constraints and of the equations of motion at one point (t, q, qd, qdd, lambda), as the Newton matrix of
!> an implicit step needs them, and the bits that name them in a need mask.
!>
!> The terms (60)-(72) of the paper enter its Jacobian (76), (77) only in five sums: the gradients of the velocity constraints, of
!> the acceleration constraints, and of the equations of motion. An error in a derivative slows down or stops Newton's iteration,
!> but cannot change the solution.
module tandem_model_derivatives
    use tandem_kinds, only: wp
    implicit none (type, external)
    private

    public :: derivatives_type, n_derivatives, derivative_name, need_all_derivatives
    public :: need_velocity_q, need_acceleration_q, need_acceleration_qd, need_dynamics_q, need_dynamics_qd

    !> (C qd - nu)_q = C2(q, qd) - nu_q, see (56), (72).
    integer, parameter :: need_velocity_q = 1
    !> (C qdd + gamma)_q = C2(q, qdd) + gamma_q, see (71), (72).
    integer, parameter :: need_acceleration_q = 2
    !> gamma_qd, see (71) and doc/theory.md for its lower block.
    integer, parameter :: need_acceleration_qd = 4
    !> (M qdd + C' lambda - S - Q_A)_q = M2(q, qdd) + (C' lambda)_q - S_q - Q_Aq, see (60), (64).
    integer, parameter :: need_dynamics_q = 8
    !> -(S + Q_A)_qd.
    integer, parameter :: need_dynamics_qd = 16
    !> All derivatives.
    integer, parameter :: need_all_derivatives = 31

    !> Number of derivatives; derivative i has the bit 2**(i - 1).
    integer, parameter :: n_derivatives = 5
    !> Names in reports, in the order of the bits.
    character(len=16), parameter :: derivative_name(n_derivatives) = &
        [character(len=16) :: 'velocity_q', 'acceleration_q', 'acceleration_qd', 'dynamics_q', 'dynamics_qd']

    !> Values of the derivatives. A derivative that vanishes for a model remains zero.
    type :: derivatives_type
        !> (C qd - nu)_q, (C qdd + gamma)_q and gamma_qd (nh + nd, n).
        real(wp), allocatable :: velocity_q(:, :), acceleration_q(:, :), acceleration_qd(:, :)
        !> (M qdd + C' lambda - S - Q_A)_q and -(S + Q_A)_qd (n, n).
        real(wp), allocatable :: dynamics_q(:, :), dynamics_qd(:, :)
        !> Column of each coordinate in compressed matrices (n). Coordinates share a column if no row of any matrix has entries of
        !> both. Not allocated if the matrices are not compressed.
        integer, allocatable :: column(:)
    contains
        procedure :: allocate => allocate_derivatives, column_of
    end type derivatives_type

contains

    !> Allocate all derivatives, set to zero.
    pure subroutine allocate_derivatives(self, n, m, column)
        class(derivatives_type), intent(inout) :: self
        !> Numbers of coordinates and of constraints.
        integer, intent(in) :: n, m
        !> Columns of the coordinates (n), which compresses the matrices. Only for models with `derives_by_bodies`.
        integer, intent(in), optional :: column(:)
        integer :: width

        if (allocated(self%velocity_q)) deallocate (self%velocity_q, self%acceleration_q, self%acceleration_qd, &
            self%dynamics_q, self%dynamics_qd)
        if (allocated(self%column)) deallocate (self%column)
        width = n
        if (present(column)) then
            allocate (self%column(n), source=column)
            width = maxval(column)
        end if
        allocate (self%velocity_q(m, width), self%acceleration_q(m, width), self%acceleration_qd(m, width), source=0.0_wp)
        allocate (self%dynamics_q(n, width), self%dynamics_qd(n, width), source=0.0_wp)
    end subroutine allocate_derivatives

    !> Column of a coordinate; 0 for coordinate 0.
    elemental integer function column_of(self, coordinate) result(column)
        class(derivatives_type), intent(in) :: self
        !> Index of the coordinate, or 0.
        integer, intent(in) :: coordinate

        column = coordinate
        if (allocated(self%column) .and. coordinate > 0) column = self%column(coordinate)
    end function column_of
end module tandem_model_derivatives
