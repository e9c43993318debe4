! SPDX-License-Identifier: MIT
!> Find the nodes that are hinges or pins, and the bodies with these joints alone.
submodule(tandem_chart_sparse_analysis) tandem_chart_sparse_joints
    use tandem_chart_sparse_meetings, only: n_in_plane, n_in_space, n_of_place, of_hinges, of_others, of_pins
    implicit none (type, external)

contains

    module procedure find_joints
        integer, allocatable :: next(:)
        integer :: b, joint, k, l, n

        self%joint_of_node = spread(of_others, 1, self%n_nodes)
        self%joints_of_body = spread(of_others, 1, self%n_bodies)
        if (allocated(pattern%meeting_height)) then
            do n = 1, self%n_nodes
                if (self%is_body(n)) cycle
                if (pattern%meeting_height(rows(self%origin(n))) /= self%height(n)) cycle
                if (self%height(n) == 5) self%joint_of_node(n) = of_hinges
                if (self%height(n) == 2) self%joint_of_node(n) = of_pins
            end do
        end if
        allocate (next, source=self%node_start)
        if (allocated(self%body)) deallocate (self%body)
        allocate (self%body(5, self%n_bodies))
        self%n_moved = 0
        ! Offsets must not be negative.
        self%n_entries = most_rows*n_of_place(of_hinges)
        do b = 1, self%n_bodies
            joint = of_others
            if (.not. self%is_kept(b) .and. self%link_start(b + 1) > self%link_start(b)) then
                if (self%kind(b) == of_rigid_body .and. self%norm_row(b) > 0) joint = of_hinges
                if (self%kind(b) == of_single_blocks .and. self%first(b + 1) - self%first(b) == 3 .and. self%norm_row(b) == 0) then
                    joint = of_pins
                end if
                do l = self%link_start(b), self%link_start(b + 1) - 1
                    if (self%joint_of_node(self%link_node(l)) /= joint) joint = of_others
                end do
            end if
            self%joints_of_body(b) = joint
            self%body(:, b) = [self%first(b), self%link_start(b), self%link_start(b + 1) - self%link_start(b), &
                self%norm_row(b), joint]
            do l = self%link_start(b), self%link_start(b + 1) - 1
                n = self%link_node(l)
                ! Behind the columns that are not stored.
                self%n_entries = self%n_entries - self%height(n)*n_of_place(joint)
                self%link_offset(l) = self%n_entries
                self%link(3, l) = self%n_entries
                self%node_link(3, next(n)) = self%n_entries
                self%n_entries = self%n_entries + self%height(n)*(self%first(b + 1) - self%first(b))
                self%link(5, l) = self%n_moved
                if (joint == of_hinges) then
                    self%n_moved = self%n_moved + n_in_space
                else if (joint == of_pins) then
                    self%n_moved = self%n_moved + n_in_plane
                else if (.not. self%is_kept(b)) then
                    ! Hubs are eliminated with their nodes: their inverse mass is never applied alone.
                    self%n_moved = self%n_moved + self%height(n)*(self%first(b + 1) - self%first(b))
                end if
                if (self%joint_of_node(n) /= of_others) then
                    do k = pattern%row_start(rows(self%origin(n))), pattern%row_start(rows(self%origin(n)) + 1) - 1
                        if (pattern%row_body(k) == b) self%link(6, l) = pattern%meeting_sign(k)
                    end do
                end if
                self%node_link(4, next(n)) = self%link(6, l)
                next(n) = next(n) + 1
            end do
        end do
    end procedure find_joints
end submodule tandem_chart_sparse_joints
