! SPDX-License-Identifier: MIT
!> The last point of a chart, and the quantities known there: avoids repeated evaluations at a point.
module tandem_chart_dense_visited_point
    use tandem_kinds, only: wp
    use tandem_linalg_kernels, only: are_same, copy
    use tandem_pack, only: pack_type
    implicit none (type, external)
    private

    public :: visited_point_type

    type :: visited_point_type
        !> The time of the point where C, nu and M were evaluated last.
        real(wp) :: t = 0.0_wp
        !> True if R and D, and Phi, belong to it; true if C and nu are known to be finite there.
        logical :: has_velocity_basis = .false., has_phi = .false., is_finite = .false.
        !> True if it is a stage whose acceleration is requested next; its coordinates are not stored.
        logical :: is_passed = .false.
        !> True if its coordinates are stored; true if gamma and the forces belong to it and to a velocity.
        logical, private :: has_point = .false., has_motion = .false.
        real(wp), allocatable, private :: q(:), qd(:)
    contains
        procedure :: allocate => allocate_point, is_at, leave, arrive, pass, leave_passed, forget, pack_state
        procedure :: note_velocity_basis, forget_velocity_basis, is_moving_with, note_motion, forget_motion
    end type visited_point_type

contains

    !> For n coordinates.
    subroutine allocate_point(self, n)
        class(visited_point_type), intent(inout) :: self
        integer, intent(in) :: n

        self%q = spread(0.0_wp, 1, n)
        self%qd = self%q
    end subroutine allocate_point

    !> True if (t, q) is the point.
    pure logical function is_at(self, t, q)
        class(visited_point_type), intent(in) :: self
        real(wp), intent(in) :: t
        real(wp), intent(in), contiguous :: q(:)

        is_at = self%has_point .and. .not. (t > self%t .or. t < self%t)
        if (is_at) is_at = are_same(size(q), q, self%q)
    end function is_at

    !> Another point is to be evaluated.
    pure subroutine leave(self)
        class(visited_point_type), intent(inout) :: self

        self%has_point = .false.
        self%has_velocity_basis = .false.
        self%has_motion = .false.
        self%is_passed = .false.
    end subroutine leave

    !> C, nu and M were evaluated at (t, q).
    pure subroutine arrive(self, t, q)
        class(visited_point_type), intent(inout) :: self
        real(wp), intent(in) :: t
        real(wp), intent(in), contiguous :: q(:)

        self%is_finite = .false.
        self%t = t
        self%has_point = .true.
        call copy(size(q), q, self%q)
    end subroutine arrive

    !> A stage at time t is to be evaluated; later calls request only its acceleration, at once.
    pure subroutine pass(self, t)
        class(visited_point_type), intent(inout) :: self
        real(wp), intent(in) :: t

        call self%leave()
        self%is_finite = .false.
        self%is_passed = .true.
        self%t = t
    end subroutine pass

    !> The acceleration of a stage is computed.
    pure subroutine leave_passed(self)
        class(visited_point_type), intent(inout) :: self

        self%is_passed = .false.
    end subroutine leave_passed

    !> R and D were found there, which requires a finite C.
    pure subroutine note_velocity_basis(self)
        class(visited_point_type), intent(inout) :: self

        self%has_velocity_basis = .true.
        self%is_finite = .true.
    end subroutine note_velocity_basis

    !> R and D belong to another chart.
    pure subroutine forget_velocity_basis(self)
        class(visited_point_type), intent(inout) :: self

        self%has_velocity_basis = .false.
    end subroutine forget_velocity_basis

    !> True if gamma and the forces were evaluated there with this velocity.
    pure logical function is_moving_with(self, qd)
        class(visited_point_type), intent(in) :: self
        real(wp), intent(in), contiguous :: qd(:)

        is_moving_with = self%has_motion
        if (is_moving_with) is_moving_with = are_same(size(qd), qd, self%qd)
    end function is_moving_with

    !> Gamma and the forces are to be evaluated with another velocity.
    pure subroutine forget_motion(self)
        class(visited_point_type), intent(inout) :: self

        self%has_motion = .false.
    end subroutine forget_motion

    !> Gamma and the forces were evaluated with this velocity.
    pure subroutine note_motion(self, qd)
        class(visited_point_type), intent(inout) :: self
        real(wp), intent(in), contiguous :: qd(:)

        self%has_motion = .true.
        call copy(size(qd), qd, self%qd)
    end subroutine note_motion

    !> Invalidate the point and all data there.
    pure subroutine forget(self)
        class(visited_point_type), intent(inout) :: self

        call self%leave()
        self%has_phi = .false.
    end subroutine forget

    !> All components.
    subroutine pack_state(self, pack)
        class(visited_point_type), intent(inout) :: self
        type(pack_type), intent(inout) :: pack

        call pack%item(self%has_point, self%is_finite, self%has_velocity_basis, self%has_phi, self%has_motion)
        call pack%item(self%t)
        call pack%item(self%q, self%qd)
    end subroutine pack_state
end module tandem_chart_dense_visited_point
