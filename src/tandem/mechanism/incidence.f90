! SPDX-License-Identifier: MIT
!> Bodies in each row of a mechanism, for the pattern of C, without the rows of the norms of Euler parameters.
module tandem_mechanism_incidence
    use tandem_kinds, only: wp
    use tandem_mechanism_builder, only: builder_type
    use tandem_mechanism_element_kind, only: constraint_type
    implicit none (type, external)
    private

    public :: list_incidence

contains

    !> Pairs of a row and a body, 0 for the ground; rows have their final numbers.
    subroutine list_incidence(drawing, n_more, rows, bodies)
        class(builder_type), intent(in) :: drawing
        !> Number of spare entries at the end: later longer copies would fragment the memory.
        integer, intent(in) :: n_more
        !> Of equal size.
        integer, allocatable, intent(out) :: rows(:), bodies(:)
        type(constraint_type) :: it
        integer, allocatable :: touched(:)
        integer :: i, j, k, n, n_touched, pass, n_coincidence

        allocate (touched(2))
        n_coincidence = merge(2, 3, drawing%planar)
        ! Count in the first pass, list in the second.
        do pass = 1, 2
            n = 0
            do i = 1, size(drawing%coincidences)
                do k = 0, n_coincidence - 1
                    call add(drawing%coincidences(i)%row + k, drawing%coincidences(i)%first, drawing%coincidences(i)%second)
                end do
            end do
            do i = 1, size(drawing%perpendiculars)
                call add(drawing%perpendiculars(i)%row, drawing%perpendiculars(i)%first, drawing%perpendiculars(i)%second)
            end do
            do i = 1, size(drawing%distances)
                call add(drawing%distances(i)%row, drawing%distances(i)%first, drawing%distances(i)%second)
            end do
            do i = 1, size(drawing%angles)
                call add(drawing%angles(i)%row, drawing%angles(i)%first, drawing%angles(i)%second)
            end do
            do k = 1, size(drawing%kinds)
                if (.not. drawing%kinds(k)%of%has_rows) cycle
                do i = 1, drawing%kinds(k)%of%n
                    it = drawing%kinds(k)%of%constraint(i, 1.0_wp)
                    call drawing%kinds(k)%of%touch(i, drawing%at, n_touched, touched)
                    do j = 1, n_touched
                        call add(it%row, touched(j), 0)
                    end do
                end do
            end do
            do i = 1, size(drawing%knife_edges)
                call add(drawing%knife_edges(i)%row, drawing%knife_edges(i)%body, 0)
            end do
            do i = 1, size(drawing%rollers)
                call add(drawing%rollers(i)%height_row, drawing%rollers(i)%body, 0)
                call add(drawing%rollers(i)%row, drawing%rollers(i)%body, 0)
                call add(drawing%rollers(i)%row + 1, drawing%rollers(i)%body, 0)
            end do
            do i = 1, size(drawing%massless_wheels)
                associate (wheel => drawing%massless_wheels(i))
                    call add(wheel%height_row, wheel%body, wheel%slide)
                    call add(wheel%row, wheel%body, wheel%slide)
                end associate
            end do
            do i = 1, size(drawing%velocity_joints)
                call add(drawing%velocity_joints(i)%row, drawing%velocity_joints(i)%first, drawing%velocity_joints(i)%second)
            end do
            do i = 1, size(drawing%rate_rows)
                do k = 1, size(drawing%rate_rows(i)%velocities)
                    call add(drawing%rate_rows(i)%row, drawing%rate_rows(i)%velocities(k)%owner, 0)
                end do
            end do
            if (pass == 1) allocate (rows(n + n_more), bodies(n + n_more))
        end do

    contains

        !> Append two pairs.
        subroutine add(row, one, two)
            integer, intent(in) :: row, one, two

            if (allocated(rows)) then
                rows(n + 1:n + 2) = row
                bodies(n + 1) = one
                bodies(n + 2) = two
            end if
            n = n + 2
        end subroutine add
    end subroutine list_incidence
end module tandem_mechanism_incidence
