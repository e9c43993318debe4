! SPDX-License-Identifier: MIT
!> Bodies that rotate in space in large mechanisms: evaluates their blocks of M, the gyroscopic forces and the norm rows of the
!> Euler parameters, (p'p - 1)/2 = 0, for `lane` bodies at a time, directly from q and qd. Each array has one entry per body of a
!> group.
module tandem_mechanism_rotating_bodies
    use tandem_kinds, only: lane, wp
    use tandem_mechanism_body, only: body_type
    use tandem_mechanism_pose, only: pose_type
    use tandem_model_pattern, only: pattern_type
    use tandem_model_terms, only: need_gamma, need_jacobian, need_phi, terms_type
    use tandem_rigid_euler_lanes, only: take_four
    implicit none (type, external)
    private

    public :: rotating_group_type, gather_rotating_bodies, store_columns, find_norm_blocks
    public :: evaluate_norms, set_masses, add_inertia_forces

    !> A group of n bodies. Copies of the last body fill the group; their results are discarded.
    type :: rotating_group_type
        integer :: n = 0
        !> For each body: its index; offset of its Euler parameters in q; norm row; offset of the parameters in the columns of the
        !> stored C; offset in the blocks of a chart. True if the chart stores all norm rows of the group in blocks.
        integer :: body(lane) = 0, offset(lane) = 0, row(lane) = 0, column(lane) = 0, block(lane) = -1
        logical :: has_blocks = .false.
        !> Columns of the stored M: first column of the position, offset of the columns of the Euler parameters, distance between
        !> the columns of the position.
        integer :: place_mass(lane) = 0, turn_mass(lane) = 0, mass_step = 1
        !> Mass, and entries 11, 22, 33, 12, 13, 23 of J.
        real(wp) :: mass(lane) = 0.0_wp, inertia(lane, 6) = 0.0_wp
    end type rotating_group_type

contains

    !> Form groups of the bodies that rotate in space.
    pure subroutine gather_rotating_bodies(indices, bodies, pose, before_norms, groups)
        !> Indices of the bodies.
        integer, intent(in) :: indices(:)
        type(body_type), intent(in) :: bodies(:)
        type(pose_type), intent(in) :: pose(0:)
        !> Number of rows before the first norm row.
        integer, intent(in) :: before_norms
        type(rotating_group_type), allocatable, intent(out) :: groups(:)
        integer :: i, l, place

        allocate (groups((size(indices) + lane - 1)/lane))
        do i = 1, size(indices)
            place = mod(i - 1, lane) + 1
            associate (group => groups((i - 1)/lane + 1), body => indices(i), j => bodies(indices(i))%inertia)
                group%n = place
                do l = place, lane
                    group%body(l) = body
                    group%offset(l) = pose(body)%turn - 1
                    group%row(l) = before_norms + i
                    group%mass(l) = bodies(body)%mass
                    group%inertia(l, :) = [j(1, 1), j(2, 2), j(3, 3), j(1, 2), j(1, 3), j(2, 3)]
                end do
            end associate
        end do
    end subroutine gather_rotating_bodies

    !> Copy the columns of C and M from the poses.
    pure subroutine store_columns(pose, groups)
        type(pose_type), intent(in) :: pose(0:)
        type(rotating_group_type), intent(inout) :: groups(:)
        integer :: i

        do i = 1, size(groups)
            groups(i)%column = pose(groups(i)%body)%turn_column - 1
            groups(i)%place_mass = pose(groups(i)%body)%place_mass
            groups(i)%turn_mass = pose(groups(i)%body)%turn_mass - 1
            groups(i)%mass_step = pose(groups(i)%body(1))%mass_step
        end do
    end subroutine store_columns

    !> Store the offsets of the chart's blocks and mark the rows that are set in blocks. All rows of a group are set in the same
    !> way.
    pure subroutine find_norm_blocks(pattern, groups)
        type(pattern_type), intent(inout) :: pattern
        type(rotating_group_type), intent(inout) :: groups(:)
        integer :: i, l

        do i = 1, size(groups)
            associate (group => groups(i))
                do l = 1, lane
                    group%block(l) = pattern%block_of(group%row(l), 1, group%body(l))
                end do
                group%has_blocks = all(group%block >= 0)
                ! The block of a body begins with the columns of its position.
                group%block = group%block + 3
                if (group%has_blocks) pattern%in_blocks(group%row) = .true.
            end associate
        end do
    end subroutine find_norm_blocks

    !> Set the norm rows.
    pure subroutine evaluate_norms(groups, need, n, q, qd, terms)
        type(rotating_group_type), intent(in) :: groups(:)
        integer, intent(in) :: need, n
        !> Coordinates and velocities (n). Velocities are used only if gamma is requested.
        real(wp), intent(in) :: q(n), qd(n)
        type(terms_type), intent(inout) :: terms
        integer :: i, k, l

        do i = 1, size(groups)
            associate (group => groups(i))
                if (iand(need, need_phi) /= 0) then
                    do l = 1, group%n
                        terms%phi(group%row(l)) = 0.5_wp*(square(q, group%offset(l)) - 1.0_wp)
                    end do
                end if
                if (iand(need, need_jacobian) /= 0 .and. group%has_blocks .and. allocated(terms%blocks)) then
                    do l = 1, group%n
                        do k = 1, 4
                            terms%blocks(group%block(l) + k) = q(group%offset(l) + k)
                        end do
                    end do
                else if (iand(need, need_jacobian) /= 0) then
                    do l = 1, group%n
                        do k = 1, 4
                            terms%jacobian(group%row(l), group%column(l) + k) = q(group%offset(l) + k)
                        end do
                    end do
                end if
                if (iand(need, need_gamma) /= 0) then
                    do l = 1, group%n
                        terms%gamma(group%row(l)) = square(qd, group%offset(l))
                    end do
                end if
            end associate
        end do

    contains

        !> Sum of the squares of the four parameters.
        pure real(wp) function square(x, offset)
            real(wp), intent(in) :: x(n)
            integer, intent(in) :: offset

            square = x(offset + 1)**2 + x(offset + 2)**2 + x(offset + 3)**2 + x(offset + 4)**2
        end function square
    end subroutine evaluate_norms

    !> Set the blocks of M: the mass for positions, 4 G'J G for Euler parameters. Other entries are unchanged.
    pure subroutine set_masses(groups, n, width, q, mass)
        type(rotating_group_type), intent(in) :: groups(:)
        !> Shape of the stored M, which may be compressed.
        integer, intent(in) :: n, width
        real(wp), intent(in) :: q(n)
        real(wp), intent(inout) :: mass(n, width)
        !> Number of entries of the lower triangle, column by column; index in this triangle of each entry of the full block.
        integer, parameter :: n_lower = 10, entry(4, 4) = reshape([1, 2, 3, 4, 2, 5, 6, 7, 3, 6, 8, 9, 4, 7, 9, 10], [4, 4])
        real(wp) :: p(lane, 4), block(lane, n_lower)
        integer :: i, j, k, l

        do i = 1, size(groups)
            associate (group => groups(i))
                call take_four(group%offset, 0, n, q, p)
                call set_blocks(p, group%inertia, block)
                do l = 1, group%n
                    associate (row => group%offset(l), column => group%turn_mass(l))
                        do k = 0, 2
                            mass(row - 2 + k, group%place_mass(l) + k*group%mass_step) = group%mass(l)
                        end do
                        do j = 1, 4
                            do k = 1, 4
                                mass(row + k, column + j) = block(l, entry(k, j))
                            end do
                        end do
                    end associate
                end do
            end associate
        end do
    end subroutine set_masses

    !> Lower triangle of 4 G'J G, column by column. The columns of G are (-e1, -e2, -e3), (e0, -e3, e2), (e3, e0, -e1), (-e2, e1,
    !> e0).
    pure subroutine set_blocks(p, inertia, block)
        real(wp), intent(in) :: p(lane, 4), inertia(lane, 6)
        real(wp), intent(out) :: block(lane, 10)
        real(wp) :: e0, e1, e2, e3, h1, h2, h3, j11, j12, j13, j22, j23, j33
        integer :: l

        !GCC$ UNROLL 1
        do l = 1, lane
            e0 = p(l, 1)
            e1 = p(l, 2)
            e2 = p(l, 3)
            e3 = p(l, 4)
            j11 = 4*inertia(l, 1)
            j22 = 4*inertia(l, 2)
            j33 = 4*inertia(l, 3)
            j12 = 4*inertia(l, 4)
            j13 = 4*inertia(l, 5)
            j23 = 4*inertia(l, 6)
            ! J times a column of G, then G' times the product.
            h1 = j11*e1 + j12*e2 + j13*e3
            h2 = j12*e1 + j22*e2 + j23*e3
            h3 = j13*e1 + j23*e2 + j33*e3
            block(l, 1) = e1*h1 + e2*h2 + e3*h3
            block(l, 2) = e3*h2 - e0*h1 - e2*h3
            block(l, 3) = e1*h3 - e3*h1 - e0*h2
            block(l, 4) = e2*h1 - e1*h2 - e0*h3
            h1 = j11*e0 - j12*e3 + j13*e2
            h2 = j12*e0 - j22*e3 + j23*e2
            h3 = j13*e0 - j23*e3 + j33*e2
            block(l, 5) = e0*h1 - e3*h2 + e2*h3
            block(l, 6) = e3*h1 + e0*h2 - e1*h3
            block(l, 7) = e1*h2 - e2*h1 + e0*h3
            h1 = j11*e3 + j12*e0 - j13*e1
            h2 = j12*e3 + j22*e0 - j23*e1
            h3 = j13*e3 + j23*e0 - j33*e1
            block(l, 8) = e3*h1 + e0*h2 - e1*h3
            block(l, 9) = e1*h2 - e2*h1 + e0*h3
            h1 = j12*e1 - j11*e2 + j13*e0
            h2 = j22*e1 - j12*e2 + j23*e0
            h3 = j23*e1 - j13*e2 + j33*e0
            block(l, 10) = e1*h2 - e2*h1 + e0*h3
        end do
    end subroutine set_blocks

    !> Add the inertia forces S = 8 G(pd)'J G(pd) p.
    pure subroutine add_inertia_forces(groups, n, q, qd, force)
        type(rotating_group_type), intent(in) :: groups(:)
        integer, intent(in) :: n
        !> Coordinates and velocities (n).
        real(wp), intent(in) :: q(n), qd(n)
        real(wp), intent(inout) :: force(n)
        real(wp) :: p(lane, 4), pd(lane, 4), s(lane, 4)
        integer :: i, k, l

        do i = 1, size(groups)
            associate (group => groups(i))
                call take_four(group%offset, 0, n, q, p)
                call take_four(group%offset, 0, n, qd, pd)
                call set_gyroscopic(p, pd, group%inertia, s)
                do l = 1, group%n
                    do k = 1, 4
                        force(group%offset(l) + k) = force(group%offset(l) + k) + s(l, k)
                    end do
                end do
            end associate
        end do
    end subroutine add_inertia_forces

    !> S = 8 G(pd)'J G(pd) p for the bodies of a group.
    pure subroutine set_gyroscopic(p, pd, inertia, s)
        real(wp), intent(in) :: p(lane, 4), pd(lane, 4), inertia(lane, 6)
        real(wp), intent(out) :: s(lane, 4)
        real(wp) :: e0, e1, e2, e3, h1, h2, h3, w1, w2, w3
        integer :: l

        !GCC$ UNROLL 1
        do l = 1, lane
            e0 = pd(l, 1)
            e1 = pd(l, 2)
            e2 = pd(l, 3)
            e3 = pd(l, 4)
            ! 8 G(pd) p, J times this vector, and G(pd)' times the product.
            w1 = 8*(e0*p(l, 2) - e1*p(l, 1) + e3*p(l, 3) - e2*p(l, 4))
            w2 = 8*(e0*p(l, 3) - e2*p(l, 1) - e3*p(l, 2) + e1*p(l, 4))
            w3 = 8*(e0*p(l, 4) - e3*p(l, 1) + e2*p(l, 2) - e1*p(l, 3))
            h1 = inertia(l, 1)*w1 + inertia(l, 4)*w2 + inertia(l, 5)*w3
            h2 = inertia(l, 4)*w1 + inertia(l, 2)*w2 + inertia(l, 6)*w3
            h3 = inertia(l, 5)*w1 + inertia(l, 6)*w2 + inertia(l, 3)*w3
            s(l, 1) = -e1*h1 - e2*h2 - e3*h3
            s(l, 2) = e0*h1 - e3*h2 + e2*h3
            s(l, 3) = e3*h1 + e0*h2 - e1*h3
            s(l, 4) = e1*h2 - e2*h1 + e0*h3
        end do
    end subroutine set_gyroscopic
end module tandem_mechanism_rotating_bodies
