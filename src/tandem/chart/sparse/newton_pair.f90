! SPDX-License-Identifier: MIT
!> The Newton matrix of a complex pair of systems of stages that are solved together, factored by blocks L U. Its real and its
!> imaginary part are stored separately, so that kernels for real blocks apply to both.
module tandem_chart_sparse_newton_pair
    use tandem_chart_sparse_newton_analysis, only: newton_analysis_type
    use tandem_chart_sparse_newton_factor, only: most, newton_factor_type, newton_terms_type
    use tandem_chart_sparse_newton_kernels, only: multiply, multiply_block, subtract, subtract_product
    use tandem_kinds, only: wp
    use tandem_pack, only: pack_type
    use tandem_status, only: status_newton_failed, status_ok
    implicit none (type, external)
    private

    public :: newton_pair_type

    type :: newton_pair_type
        !> Ratio of its ha to the ha of the real system.
        complex(wp) :: ratio = (1.0_wp, 0.0_wp)
        !> The real and the imaginary part of the factor.
        type(newton_factor_type) :: re, im
    contains
        procedure :: allocate => allocate_pair, factor, solve, pack_state
    end type newton_pair_type

contains

    !> Allocate for a pattern.
    subroutine allocate_pair(self, analysis, ratio)
        class(newton_pair_type), intent(inout) :: self
        type(newton_analysis_type), intent(in) :: analysis
        complex(wp), intent(in) :: ratio

        self%ratio = ratio
        call self%re%allocate(analysis)
        call self%im%allocate(analysis)
    end subroutine allocate_pair

    !> Form and factor for the ha of the real system.
    subroutine factor(self, analysis, terms, ha, stat)
        class(newton_pair_type), intent(inout) :: self
        type(newton_analysis_type), intent(in) :: analysis
        type(newton_terms_type), intent(in) :: terms
        real(wp), intent(in) :: ha
        !> ok or `newton_failed`.
        integer, intent(out) :: stat
        complex(wp) :: first, second

        first = ha*self%ratio
        second = first**2
        call self%re%fill(analysis, terms, real(first, wp), real(second, wp), .true.)
        call self%im%fill(analysis, terms, aimag(first), aimag(second), .false.)
        call eliminate(analysis, self%re%lower, self%im%lower, self%re%upper, self%im%upper, stat)
    end subroutine factor

    !> Eliminate the nodes; the order of the blocks is as in `tandem_chart_sparse_newton_factor`.
    subroutine eliminate(a, lower, lower_im, upper, upper_im, stat)
        type(newton_analysis_type), intent(in) :: a
        real(wp), intent(inout) :: lower(*), lower_im(*), upper(*), upper_im(*)
        integer, intent(out) :: stat
        real(wp), dimension(most*most) :: minus_scaled_im, minus_upper_im, part, scaled, scaled_im
        integer :: d, i, j, k, n, p, q, s, target
        logical :: is_regular

        stat = status_ok
        associate (at => a%block%later)
            do n = 1, a%n_nodes
                s = a%height(n)
                associate (diagonal => a%block%diagonal(n) + 1)
                    call invert_complex(s, lower(diagonal), lower_im(diagonal), is_regular)
                    if (.not. is_regular) then
                        stat = status_newton_failed
                        return
                    end if
                    d = a%target%update_start(n)
                    do j = a%later_start(n), a%later_start(n + 1) - 1
                        p = a%height(a%later(j))
                        call multiply_block(p, s, s, lower(at(j) + 1), lower(diagonal), scaled)
                        call multiply_block(p, s, s, lower_im(at(j) + 1), lower_im(diagonal), part)
                        call multiply_block(p, s, s, lower(at(j) + 1), lower_im(diagonal), scaled_im)
                        do i = 1, p*s
                            scaled(i) = scaled(i) - part(i)
                        end do
                        call multiply_block(p, s, s, lower_im(at(j) + 1), lower(diagonal), part)
                        do i = 1, p*s
                            scaled_im(i) = scaled_im(i) + part(i)
                            minus_scaled_im(i) = -scaled_im(i)
                            lower(at(j) + i) = scaled(i)
                            lower_im(at(j) + i) = scaled_im(i)
                            minus_upper_im(i) = -upper_im(at(j) + i)
                        end do
                        do k = a%later_start(n), j
                            d = d + 1
                            q = a%height(a%later(k))
                            target = a%target%update(d) + 1
                            call subtract_product(p, q, s, scaled, upper(at(k) + 1), lower(target))
                            call subtract_product(p, q, s, minus_scaled_im, upper_im(at(k) + 1), lower(target))
                            call subtract_product(p, q, s, scaled, upper_im(at(k) + 1), lower_im(target))
                            call subtract_product(p, q, s, scaled_im, upper(at(k) + 1), lower_im(target))
                            if (k == j) cycle
                            call subtract_product(q, p, s, lower(at(k) + 1), upper(at(j) + 1), upper(target))
                            call subtract_product(q, p, s, lower_im(at(k) + 1), minus_upper_im, upper(target))
                            call subtract_product(q, p, s, lower(at(k) + 1), upper_im(at(j) + 1), upper_im(target))
                            call subtract_product(q, p, s, lower_im(at(k) + 1), upper(at(j) + 1), upper_im(target))
                        end do
                    end do
                end associate
            end do
        end associate
    end subroutine eliminate

    !> The inverse of a complex block in place, by Gauss and Jordan with exchanges of rows.
    pure subroutine invert_complex(s, x_re, x_im, is_regular)
        integer, intent(in) :: s
        real(wp), intent(inout) :: x_re(s, s), x_im(s, s)
        logical, intent(out) :: is_regular
        complex(wp) :: factor, kept, x(most, most)
        integer :: from(most), i, j, k, p

        x(:s, :s) = cmplx(x_re, x_im, wp)
        is_regular = .true.
        do k = 1, s
            p = k
            do i = k + 1, s
                if (size_of(x(i, k)) > size_of(x(p, k))) p = i
            end do
            from(k) = p
            if (.not. (size_of(x(p, k)) > 0.0_wp .and. size_of(x(p, k)) <= huge(1.0_wp))) then
                is_regular = .false.
                return
            end if
            factor = 1.0_wp/x(p, k)
            x(p, k) = x(k, k)
            x(k, k) = 1.0_wp
            do j = 1, s
                if (j /= k) then
                    kept = x(p, j)
                    x(p, j) = x(k, j)
                    x(k, j) = kept
                end if
                x(k, j) = x(k, j)*factor
            end do
            do i = 1, s
                if (i == k) cycle
                factor = x(i, k)
                x(i, k) = 0.0_wp
                do j = 1, s
                    x(i, j) = x(i, j) - factor*x(k, j)
                end do
            end do
        end do
        do k = s, 1, -1
            p = from(k)
            if (p == k) cycle
            do i = 1, s
                kept = x(i, k)
                x(i, k) = x(i, p)
                x(i, p) = kept
            end do
        end do
        x_re = real(x(:s, :s), wp)
        x_im = aimag(x(:s, :s))
    end subroutine invert_complex

    !> A measure of size that needs no square root.
    pure real(wp) function size_of(x)
        complex(wp), intent(in) :: x

        size_of = abs(real(x, wp)) + abs(aimag(x))
    end function size_of

    !> Solve in place for the unknowns of all nodes, z + i w.
    pure subroutine solve(self, a, z, w)
        class(newton_pair_type), intent(in) :: self
        type(newton_analysis_type), intent(in) :: a
        real(wp), intent(inout), contiguous :: z(:), w(:)

        call solve_nodes(a%n_nodes, size(a%behind, 2), a%node, a%later_start, a%behind, self%re%lower, self%im%lower, &
            self%re%upper, self%im%upper, z, w)
    end subroutine solve

    !> Nodes forward and back, in place.
    pure subroutine solve_nodes(n_nodes, n_behind, node, later_start, behind, lower, lower_im, upper, upper_im, z, w)
        integer, intent(in) :: n_nodes, n_behind, node(4, n_nodes), later_start(n_nodes + 1), behind(3, n_behind)
        real(wp), intent(in) :: lower(*), lower_im(*), upper(*), upper_im(*)
        real(wp), intent(inout) :: z(*), w(*)
        real(wp) :: minus(most), part(most), x(most), y(most)
        integer :: i, k, n, p, place, s

        do n = 1, n_nodes
            place = node(1, n)
            s = node(2, n)
            do i = 1, s
                minus(i) = -w(place + i)
            end do
            do k = later_start(n), later_start(n + 1) - 1
                p = behind(2, k)
                associate (at => behind(3, k) + 1, to => behind(1, k) + 1)
                    call subtract(p, s, lower(at), z(place + 1), z(to))
                    call subtract(p, s, lower_im(at), minus, z(to))
                    call subtract(p, s, lower(at), w(place + 1), w(to))
                    call subtract(p, s, lower_im(at), z(place + 1), w(to))
                end associate
            end do
        end do
        do n = n_nodes, 1, -1
            place = node(1, n)
            s = node(2, n)
            do i = 1, s
                x(i) = z(place + i)
                y(i) = w(place + i)
            end do
            do k = later_start(n), later_start(n + 1) - 1
                p = behind(2, k)
                associate (at => behind(3, k) + 1, from => behind(1, k))
                    do i = 1, p
                        minus(i) = -w(from + i)
                    end do
                    call subtract(s, p, upper(at), z(from + 1), x)
                    call subtract(s, p, upper_im(at), minus, x)
                    call subtract(s, p, upper(at), w(from + 1), y)
                    call subtract(s, p, upper_im(at), z(from + 1), y)
                end associate
            end do
            associate (at => node(3, n) + 1)
                call multiply(s, lower_im(at), y, part)
                call multiply(s, lower(at), x, z(place + 1))
                do i = 1, s
                    z(place + i) = z(place + i) - part(i)
                end do
                call multiply(s, lower_im(at), x, part)
                call multiply(s, lower(at), y, w(place + 1))
                do i = 1, s
                    w(place + i) = w(place + i) + part(i)
                end do
            end associate
        end do
    end subroutine solve_nodes

    !> The factor.
    subroutine pack_state(self, pack)
        class(newton_pair_type), intent(inout) :: self
        type(pack_type), intent(inout) :: pack

        call self%re%pack_state(pack)
        call self%im%pack_state(pack)
    end subroutine pack_state
end module tandem_chart_sparse_newton_pair
