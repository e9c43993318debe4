! SPDX-License-Identifier: MIT
!> Detection of rank loss of C on a sparse chart. The root of the smallest pivot, relative to its diagonal entry, is cheap, and
!> falls linearly towards a loss. A loss between two points is detected by the combination y of rows that is nearest to zero at
!> each: behind a loss C'y has turned around, so that (C0'y0 . M^-1 C1'y1)(y0.y1) is negative. This holds even if several ranks are
!> lost at once, unlike the sign of a determinant.
module tandem_chart_sparse_rank
    use tandem_chart_sparse_system, only: system_type
    use tandem_kinds, only: wp
    use tandem_pack, only: pack_type
    implicit none (type, external)
    private

    public :: rank_type

    type :: rank_type
        !> At the last evaluated point: the combination (unknowns of nodes), C'y (n); not allocated before the first evaluation.
        real(wp), allocatable :: y(:), force(:)
        logical :: has_combination = .false.
        !> Work space.
        real(wp), allocatable, private :: next_y(:), next_force(:)
    contains
        procedure :: begin, has_passed_loss, find_rows, pack_state
    end type rank_type

contains

    !> Compare the next point with the origin.
    subroutine begin(self, system)
        class(rank_type), intent(inout) :: self
        type(system_type), intent(inout) :: system

        call find_combination(self, system, system%base)
        call keep_combination(self)
    end subroutine begin

    !> The combination of rows that is nearest to zero at the point of a factor, by three inverse iterations, in the work space.
    subroutine find_combination(self, system, place)
        class(rank_type), intent(inout) :: self
        type(system_type), intent(inout) :: system
        !> Index of the factor.
        integer, intent(in) :: place
        integer, parameter :: iterations = 3
        real(wp) :: length
        integer :: i, k, n

        if (.not. allocated(self%next_y)) then
            allocate (self%next_y(system%analysis%n_unknowns), self%next_force(system%analysis%n), source=0.0_wp)
            if (.not. allocated(self%y)) allocate (self%y, source=self%next_y)
            if (.not. allocated(self%force)) allocate (self%force, source=self%next_force)
        end if
        associate (a => system%analysis, here => system%factor(place), y => self%next_y)
            ! Start with the weakest row; all others have a weight, too, as they may be relevant.
            system%g = 1.0e-3_wp
            if (here%weakest > 0) system%g(here%weakest) = 1.0_wp
            do k = 1, iterations
                do i = 1, a%n_bodies
                    if (a%own_row(i) > 0) system%g(a%own_row(i)) = 0.0_wp
                end do
                call here%solve(a, .false., system%x, system%g, self%next_force, y)
                length = 0.0_wp
                do n = 1, a%n_nodes
                    if (a%is_body(n)) then
                        y(a%place(n) + 1:a%place(n) + a%height(n)) = 0.0_wp
                    else
                        length = length + sum(y(a%place(n) + 1:a%place(n) + a%height(n))**2)
                    end if
                end do
                y(:) = -y/max(sqrt(length), tiny(1.0_wp))
                do n = 1, a%n_nodes
                    if (.not. a%is_body(n)) system%g(a%origin(n):a%origin(n) + a%height(n) - 1) = &
                        y(a%place(n) + 1:a%place(n) + a%height(n))
                end do
            end do
            self%next_force = 0.0_wp
            system%g(:) = -system%g
            call here%add_reactions(a, system%g, self%next_force)
        end associate
    end subroutine find_combination

    !> Keep the combination that was found last.
    subroutine keep_combination(self)
        class(rank_type), intent(inout) :: self

        self%y(:) = self%next_y
        self%force(:) = self%next_force
        self%has_combination = .true.
    end subroutine keep_combination

    !> True if C has lost rank between the point of the last combination and the last factorisation of the system, whose combination
    !> replaces it. False if they are too different to decide.
    logical function has_passed_loss(self, system, is_decided)
        class(rank_type), intent(inout) :: self
        type(system_type), intent(inout) :: system
        !> False if they are too different.
        logical, intent(out), optional :: is_decided
        !> Combinations that have less in common are unrelated.
        real(wp), parameter :: least_common = 0.3_wp
        real(wp) :: common, along

        has_passed_loss = .false.
        if (present(is_decided)) is_decided = .false.
        call find_combination(self, system, system%here)
        if (self%has_combination) then
            common = dot_product(self%y, self%next_y)
            call system%factor(system%here)%move(system%analysis, self%next_force, system%x)
            along = dot_product(self%force, system%x)
            has_passed_loss = abs(common) > least_common .and. common*along < 0.0_wp
            if (present(is_decided)) is_decided = abs(common) > least_common
        end if
        if (.not. has_passed_loss) call keep_combination(self)
    end function has_passed_loss

    !> The rows of a combination.
    function find_rows(self, system) result(rows)
        class(rank_type), intent(in) :: self
        type(system_type), intent(in) :: system
        integer, allocatable :: rows(:)
        real(wp) :: share
        integer :: i, n

        allocate (rows(0))
        ! The smallest relevant factor.
        share = 0.1_wp*maxval(abs(self%y))
        associate (a => system%analysis)
            do n = 1, a%n_nodes
                if (a%is_body(n)) cycle
                do i = 1, a%height(n)
                    if (abs(self%y(a%place(n) + i)) > share) rows = [rows, a%origin(n) + i - 1]
                end do
            end do
        end associate
    end function find_rows

    subroutine pack_state(self, pack)
        class(rank_type), intent(inout) :: self
        type(pack_type), intent(inout) :: pack

        call pack%item(self%y, self%force)
        call pack%item(self%has_combination)
    end subroutine pack_state
end module tandem_chart_sparse_rank
