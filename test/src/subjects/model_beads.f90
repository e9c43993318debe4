! SPDX-License-Identifier: MIT
!> Beads in the plane, strung on rods from the origin: n = 2 beads, nh = beads. A user-defined model with a pattern of C and M, with
!> all terms from one procedure or, with `is_single`, by procedures that ignore the pattern.
module model_beads
    use tandem, only: model_type, procedure_model_type, need_force, need_gamma, need_jacobian, need_mass, need_phi, terms_type, wp
    implicit none (type, external)
    private

    public :: beads_type

    type, extends(procedure_model_type) :: beads_type
        real(wp) :: length = 0.3_wp, g = 9.81_wp
        !> True if the terms come from single procedures.
        logical :: is_single = .false.
    contains
        procedure :: define
        procedure :: start
    end type beads_type

contains

    !> Set a number of beads; bead i weighs i kg.
    subroutine define(self, beads)
        class(beads_type), intent(inout) :: self
        integer, intent(in) :: beads
        integer :: i

        self%name = 'beads'
        self%n = 2*beads
        self%n_holonomic = beads
        self%constant_mass = .true.
        allocate (self%state%impulses(beads), source=0.0_wp)
        allocate (self%pattern)
        call self%pattern%build([(2*i - 1, i=1, beads + 1)], spread(1, 1, 2*beads), beads, &
            [(i, i=1, beads), (i, i=2, beads)], [(i, i=1, beads), (i - 1, i=2, beads)], spread(0, 1, beads))
        if (self%is_single) then
            self%holonomic => holonomic
            self%holonomic_jacobian => jacobian
            self%constraint_acceleration => acceleration
            self%mass_matrix => mass
            self%applied_force => force
        else
            self%evaluate => evaluate
            self%provides = need_phi + need_jacobian + need_gamma + need_mass + need_force
        end if
    end subroutine define

    !> Bead i is at 0.2 i rad from the previous one; the string rotates by 1 rad/s about the origin.
    subroutine start(self, q, qd)
        class(beads_type), intent(in) :: self
        real(wp), intent(out) :: q(:), qd(:)
        integer :: i

        do i = 1, self%n/2
            q(2*i - 1:2*i) = self%length*[sin(0.2_wp*i), -cos(0.2_wp*i)]
            if (i > 1) q(2*i - 1:2*i) = q(2*i - 1:2*i) + q(2*i - 3:2*i - 2)
            qd(2*i - 1:2*i) = [-q(2*i), q(2*i - 1)]
        end do
    end subroutine start

    !> The rod to bead i.
    pure function rod(q, i) result(d)
        real(wp), intent(in) :: q(:)
        integer, intent(in) :: i
        real(wp) :: d(2)

        d = q(2*i - 1:2*i)
        if (i > 1) d = d - q(2*i - 3:2*i - 2)
    end function rod

    !> All terms, compressed or not.
    subroutine evaluate(self, need, t, q, qd, terms, stat)
        class(model_type), intent(inout) :: self
        integer, intent(in) :: need
        real(wp), intent(in) :: t, q(:), qd(:)
        type(terms_type), intent(inout) :: terms
        integer, intent(out) :: stat
        real(wp) :: d(2), v(2)
        integer :: i, j, k

        stat = 0
        select type (self)
        class is (beads_type)
            do i = 1, self%n/2
                d = rod(q, i)
                v = rod(qd, i)
                if (iand(need, need_phi) /= 0) terms%phi(i) = (dot_product(d, d) - self%length**2)/2
                if (iand(need, need_gamma) /= 0) terms%gamma(i) = dot_product(v, v)
                do k = 1, 2
                    j = 2*i - 2 + k
                    if (iand(need, need_jacobian) /= 0) then
                        if (i > 1) terms%jacobian(i, column(j - 2)) = -d(k)
                        terms%jacobian(i, column(j)) = d(k)
                    end if
                    if (iand(need, need_mass) /= 0) terms%mass(j, merge(1, j, terms%is_compressed)) = i
                    if (iand(need, need_force) /= 0) terms%force(j) = merge(0.0_wp, -i*self%g, k == 1)
                end do
            end do
        end select

    contains

        !> Column of a coordinate in C.
        integer function column(coordinate)
            integer, intent(in) :: coordinate

            column = coordinate
            if (terms%is_compressed) column = self%pattern%column(coordinate)
        end function column
    end subroutine evaluate

    subroutine holonomic(self, t, q, value, stat)
        class(model_type), intent(inout) :: self
        real(wp), intent(in) :: t, q(:)
        real(wp), intent(out) :: value(:)
        integer, intent(out) :: stat
        integer :: i

        stat = 0
        select type (self)
        class is (beads_type)
            value = [((dot_product(rod(q, i), rod(q, i)) - self%length**2)/2, i=1, size(value))]
        end select
    end subroutine holonomic

    subroutine jacobian(self, t, q, value, stat)
        class(model_type), intent(inout) :: self
        real(wp), intent(in) :: t, q(:)
        real(wp), intent(out) :: value(:, :)
        integer, intent(out) :: stat
        integer :: i

        stat = 0
        value = 0.0_wp
        do i = 1, self%n/2
            value(i, 2*i - 1:2*i) = rod(q, i)
            if (i > 1) value(i, 2*i - 3:2*i - 2) = -rod(q, i)
        end do
    end subroutine jacobian

    subroutine acceleration(self, t, q, qd, value, stat)
        class(model_type), intent(inout) :: self
        real(wp), intent(in) :: t, q(:), qd(:)
        real(wp), intent(out) :: value(:)
        integer, intent(out) :: stat
        integer :: i

        stat = 0
        value = [(dot_product(rod(qd, i), rod(qd, i)), i=1, size(value))]
    end subroutine acceleration

    subroutine mass(self, q, value, stat)
        class(model_type), intent(inout) :: self
        real(wp), intent(in) :: q(:)
        real(wp), intent(out) :: value(:, :)
        integer, intent(out) :: stat
        integer :: j

        stat = 0
        value = 0.0_wp
        do j = 1, self%n
            value(j, j) = (j + 1)/2
        end do
    end subroutine mass

    subroutine force(self, t, q, qd, value, stat)
        class(model_type), intent(inout) :: self
        real(wp), intent(in) :: t, q(:), qd(:)
        real(wp), intent(out) :: value(:)
        integer, intent(out) :: stat
        integer :: i

        stat = 0
        value = 0.0_wp
        select type (self)
        class is (beads_type)
            value(2::2) = [(-i*self%g, i=1, self%n/2)]
        end select
    end subroutine force
end module model_beads
