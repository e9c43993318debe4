! SPDX-License-Identifier: MIT
!> Storage of C in a factor: by links if models set its rows in blocks, else copied from a compressed C.
submodule(tandem_chart_sparse_factor) tandem_chart_sparse_rows
    use tandem_chart_sparse_meetings, only: n_of_place
    implicit none (type, external)

contains

    !> The unit matrix with the sign of the joint.
    module procedure put_places
        integer :: b, i, l

        do b = 1, a%n_bodies
            if (n_of_place(a%joints_of_body(b)) > 0) cycle
            do l = a%link_start(b), a%link_start(b + 1) - 1
                do i = 0, n_of_place(a%joint_of_node(a%link_node(l))) - 1
                    c(a%link(3, l) + i*(a%link(2, l) + 1) + 1) = real(a%link(6, l), wp)
                end do
            end do
        end do
    end procedure put_places

    !> Store owned rows by coordinates, too.
    module procedure load_rows
        integer :: b, j, start

        call move_alloc(blocks, self%c)
        if (.not. pattern%all_in_blocks) call take_rows(a, pattern, jacobian, self%c)
        ! In one pass if the model sets all rows in blocks, except for hubs.
        if (pattern%all_in_blocks) call take_owned(a%n, self%c(a%n_entries + read_behind + 1), self%own)
        if (.not. pattern%all_in_blocks .or. size(self%added) > 0) then
            do b = 1, a%n_bodies
                if (a%norm_row(b) == 0 .or. (pattern%all_in_blocks .and. .not. a%is_kept(b))) cycle
                start = -1
                if (allocated(pattern%in_blocks)) then
                    if (pattern%in_blocks(a%norm_row(b))) start = pattern%block_start(pattern%row_start(a%norm_row(b)))
                end if
                if (start >= 0) then
                    do j = a%first(b), a%first(b + 1) - 1
                        self%own(j) = self%c(start + 1 + j - a%first(b))
                    end do
                else
                    do j = a%first(b), a%first(b + 1) - 1
                        self%own(j) = jacobian(a%norm_row(b), pattern%column(j))
                    end do
                end if
            end do
        end if
        self%has_rows = .true.
        self%is_factored = .false.
    end procedure load_rows

    pure subroutine take_owned(n, rows, own)
        integer, intent(in) :: n
        real(wp), intent(in) :: rows(n)
        real(wp), intent(out) :: own(n)

        own(:) = rows
    end subroutine take_owned

    !> Copy the rows of the nodes by links, except for those already set.
    pure subroutine take_rows(a, pattern, jacobian, c)
        type(analysis_type), intent(in) :: a
        type(pattern_type), intent(in) :: pattern
        real(wp), intent(in), contiguous :: jacobian(:, :)
        real(wp), intent(inout) :: c(*)
        integer :: b, from, i, j, k, l, row

        do b = 1, a%n_bodies
            from = a%first(b) + n_of_place(a%joints_of_body(b))
            do l = a%link_start(b), a%link_start(b + 1) - 1
                k = a%link(3, l) + a%link(2, l)*n_of_place(a%joints_of_body(b))
                row = a%link(4, l)
                if (allocated(pattern%in_blocks)) then
                    if (pattern%in_blocks(row)) cycle
                end if
                ! A copy of variable length would be a call.
                select case (a%link(2, l))
                case (5)
                    do j = from, a%first(b + 1) - 1
                        do i = 0, 4
                            c(k + 1 + i) = jacobian(row + i, pattern%column(j))
                        end do
                        k = k + 5
                    end do
                case (3)
                    do j = from, a%first(b + 1) - 1
                        do i = 0, 2
                            c(k + 1 + i) = jacobian(row + i, pattern%column(j))
                        end do
                        k = k + 3
                    end do
                case (2)
                    do j = from, a%first(b + 1) - 1
                        c(k + 1) = jacobian(row, pattern%column(j))
                        c(k + 2) = jacobian(row + 1, pattern%column(j))
                        k = k + 2
                    end do
                case default
                    do j = from, a%first(b + 1) - 1
                        do i = 1, a%link(2, l)
                            c(k + i) = jacobian(row + i - 1, pattern%column(j))
                        end do
                        k = k + a%link(2, l)
                    end do
                end select
            end do
        end do
    end subroutine take_rows

    !> Columns of positions are constant units.
    module procedure add_squares
        real(wp) :: entry
        integer :: b, i, j, k, l, n_place

        do b = 1, a%n_bodies
            n_place = n_of_place(a%joints_of_body(b))
            do j = a%first(b), a%first(b + 1) - 1
                do l = a%link_start(b), a%link_start(b + 1) - 1
                    associate (s => a%height(a%link_node(l)), origin => a%origin(a%link_node(l)))
                        i = j - a%first(b)
                        if (i < n_place) then
                            if (.not. present(other)) squares(origin + i) = squares(origin + i) + scale(j)**2
                            cycle
                        end if
                        k = a%link_offset(l) + (j - a%first(b))*s
                        do i = 1, s
                            entry = self%c(k + i)
                            if (present(other)) entry = entry - other%c(k + i)
                            squares(origin + i - 1) = squares(origin + i - 1) + (entry*scale(j))**2
                        end do
                    end associate
                end do
                if (a%own_row(b) == 0) cycle
                entry = self%own(j)
                if (present(other)) entry = entry - other%own(j)
                squares(a%own_row(b)) = squares(a%own_row(b)) + (entry*scale(j))**2
            end do
        end do
    end procedure add_squares
end submodule tandem_chart_sparse_rows
