! SPDX-License-Identifier: MIT
!> Point at which the elements of a mechanism are evaluated, and the objects that elements share.
module tandem_mechanism_context
    use tandem_kinds, only: wp
    use tandem_mechanism_coordinate, only: coordinate_type
    use tandem_mechanism_formula, only: formula_type
    use tandem_mechanism_law, only: law_item_type
    use tandem_mechanism_pose, only: pose_type
    implicit none (type, external)
    private

    public :: context_type

    !> One argument for everything that an element may depend on.
    type :: context_type
        !> Time (s).
        real(wp) :: t = 0.0_wp
        !> True while forces are replaced by their partial derivatives with respect to time: functions and laws then have their
        !> rates in place of their values, and all other parts of forces are omitted.
        logical :: only_rates = .false.
        !> Poses: 0 is the ground, then bodies, then sliding parts that are not bodies, whose positions have one coordinate.
        type(pose_type), allocatable :: pose(:)
        !> Values and derivatives of the functions of time (0:2, functions).
        real(wp), allocatable :: f(:, :)
        !> Laws of forces, expressions of the state, coordinates of joints.
        type(law_item_type), allocatable :: laws(:)
        type(formula_type), allocatable :: formulas(:)
        type(coordinate_type), allocatable :: coordinates(:)
    end type context_type
end module tandem_mechanism_context
