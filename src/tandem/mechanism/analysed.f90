! SPDX-License-Identifier: MIT
!> Queries of the analysis of small motions: rigid motions of a mechanism, partial time derivatives of its forces, and idle
!> coordinates.
submodule(tandem_mechanism) tandem_mechanism_analysed
    use tandem_mechanism_law, only: law_item_type, law_rate_type
    use tandem_mechanism_rigid_motions, only: list_rigid_motions
    implicit none (type, external)

contains

    module procedure list_motions
        call make_poses(self)
        call list_rigid_motions(self%planar, self%bodies, self%at%pose(:size(self%bodies)), motions)
    end procedure list_motions

    module procedure force_rate
        integer :: i

        is_given = .true.
        stat = 0
        value = 0.0_wp
        ! Set only the poses and the functions of time; evaluate no term.
        call self%evaluate(0, t, q, qd, self%at_row, stat)
        if (stat /= 0) return
        do i = 1, size(self%bodies)
            call set_rates(self%at%pose(i), qd)
        end do
        call set_displacements(self%at%pose(size(self%bodies) + 1:), 1, qd)
        call add_rates(self, value, stat)
    end procedure force_rate

    !> Add the partial time derivatives of the forces of all elements. The context holds the rates of functions and laws meanwhile.
    subroutine add_rates(self, value, stat)
        type(mechanism_type), intent(inout) :: self
        real(wp), intent(inout) :: value(:)
        integer, intent(inout) :: stat
        type(law_item_type), allocatable :: laws(:)
        real(wp), allocatable :: f(:, :)
        integer :: i

        call move_alloc(self%at%f, f)
        allocate (self%at%f(0:2, size(f, 2)), source=0.0_wp)
        self%at%f(0, :) = f(1, :)
        allocate (laws(size(self%at%laws)))
        do i = 1, size(laws)
            call move_alloc(self%at%laws(i)%law, laws(i)%law)
            allocate (law_rate_type :: self%at%laws(i)%law)
            select type (rate => self%at%laws(i)%law)
            type is (law_rate_type)
                allocate (rate%law, source=laws(i)%law)
            end select
        end do
        self%at%only_rates = .true.
        do i = 1, size(self%force_kinds)
            call self%kinds(self%force_kinds(i))%of%add_forces(self%at, value, stat)
        end do
        self%at%only_rates = .false.
        call move_alloc(f, self%at%f)
        do i = 1, size(laws)
            call move_alloc(laws(i)%law, self%at%laws(i)%law)
        end do
    end subroutine add_rates

    module procedure start_slides
        type(pose_type), allocatable :: pose(:)
        integer :: i

        if (self%n_of%slides == 0) return
        allocate (pose(0:ubound(self%at%pose, 1)), source=self%at%pose)
        do i = 1, size(self%bodies)
            if (self%planar .and. self%bodies(i)%turns) call set_angle(pose(i), self%bodies(i)%angle, &
                cos(self%bodies(i)%angle), sin(self%bodies(i)%angle))
            call set_position(pose(i), q)
            call set_rates(pose(i), qd)
        end do
        call set_displacements(pose(size(self%bodies) + 1:), 0, q)
        call set_displacements(pose(size(self%bodies) + 1:), 1, qd)
        do i = 1, size(self%row_kinds)
            call self%kinds(self%row_kinds(i))%of%start(pose)
        end do
        do i = size(self%bodies) + 1, ubound(pose, 1)
            q(self%first(i)) = pose(i)%r(1, 0)
            qd(self%first(i)) = pose(i)%r(1, 1)
        end do
    end procedure start_slides

    module procedure is_idle
        type(constraint_type), allocatable :: rows(:)
        integer :: i

        is_idle = .false.
        allocate (rows, source=rows_of_kinds(self, 1.0_wp))
        do i = 1, size(rows)
            if (rows(i)%can_be_freed .and. rows(i)%is_locked) is_idle(self%first(rows(i)%slide)) = .true.
        end do
    end procedure is_idle
end submodule tandem_mechanism_analysed
