! SPDX-License-Identifier: MIT
!> Wraps any model and makes one of its constraint procedures wrong, or noisy, or undefined outside of a time interval.
module model_altered
    use tandem, only: model_type, need_force, need_gamma, need_jacobian, need_mass, need_nu, need_phi, terms_type, wp
    use terms_at, only: all_terms, get_terms
    implicit none (type, external)
    private

    public :: altered_type

    type, extends(model_type) :: altered_type
        !> Row of C that is wrong, and factors of gamma, nu and one entry of C there.
        integer :: row = 1, column = 1
        real(wp) :: of_gamma = 1.0_wp, of_nu = 1.0_wp, of_jacobian = 1.0_wp
        !> Noise of Phi and C: the largest change of an entry, relative to the largest of its row and to the coordinate scales.
        real(wp) :: noise = 0.0_wp
        !> Times before and after which there is no value; value returned there, and number of such calls.
        real(wp) :: wall(2) = [-huge(1.0_wp), huge(1.0_wp)]
        integer :: n_behind = 0
        class(model_type), pointer, private :: inner => null()
    contains
        procedure :: wrap
    end type altered_type

contains

    !> Copy sizes, names and procedures of a model that is already set up.
    subroutine wrap(self, inner)
        class(altered_type), intent(inout) :: self
        class(model_type), intent(in), target :: inner

        self%inner => inner
        self%name = 'altered '//inner%name
        self%n = inner%n
        self%n_holonomic = inner%n_holonomic
        self%n_nonholonomic = inner%n_nonholonomic
        self%constant_mass = inner%constant_mass
        if (allocated(inner%holonomic_name)) self%holonomic_name = inner%holonomic_name
        if (allocated(inner%nonholonomic_name)) self%nonholonomic_name = inner%nonholonomic_name
        if (allocated(inner%coordinate_scale)) self%coordinate_scale = inner%coordinate_scale
        if (allocated(inner%breakpoints)) self%breakpoints = inner%breakpoints
        if (allocated(inner%nu_jumps)) self%nu_jumps = inner%nu_jumps
        self%evaluate => evaluate
        self%provides = all_terms
    end subroutine wrap

    subroutine evaluate(self, need, t, q, qd, terms, stat)
        class(model_type), intent(inout) :: self
        integer, intent(in) :: need
        real(wp), intent(in) :: t, q(:), qd(:)
        type(terms_type), intent(inout) :: terms
        integer, intent(out) :: stat
        type(terms_type) :: right

        stat = -1
        select type (self)
        class is (altered_type)
            if (t < self%wall(1) .or. t > self%wall(2)) then
                self%n_behind = self%n_behind + 1
                stat = 1
                return
            end if
            self%inner%segment = self%segment
            call get_terms(self%inner, t, q, qd, right, stat)
            if (stat /= 0) return
            associate (i => self%row, j => self%column)
                right%gamma(i) = self%of_gamma*right%gamma(i)
                right%nu(i) = self%of_nu*right%nu(i)
                right%jacobian(i, j) = self%of_jacobian*right%jacobian(i, j)
            end associate
            if (self%noise > 0.0_wp) call add_noise(self%noise, t, q, right)
        end select
        if (iand(need, need_phi) /= 0) terms%phi = right%phi
        if (iand(need, need_jacobian) /= 0) terms%jacobian = right%jacobian
        if (iand(need, need_nu) /= 0) terms%nu = right%nu
        if (iand(need, need_gamma) /= 0) terms%gamma = right%gamma
        if (iand(need, need_mass) /= 0) terms%mass = right%mass
        if (iand(need, need_force) /= 0) terms%force = right%force
    end subroutine evaluate

    !> Change every entry of Phi and C in an unpredictable way, identical at identical points.
    subroutine add_noise(noise, t, q, terms)
        real(wp), intent(in) :: noise, t, q(:)
        type(terms_type), intent(inout) :: terms
        integer :: i, j

        do i = 1, size(terms%jacobian, 1)
            associate (size_ => noise*sum(abs(terms%jacobian(i, :))))
                if (i <= size(terms%phi)) terms%phi(i) = terms%phi(i) + size_*draw(i)
                do j = 1, size(q)
                    terms%jacobian(i, j) = terms%jacobian(i, j) + size_*draw(i + 31*j)
                end do
            end associate
        end do

    contains

        !> A number between -1 and 1 from the last digits of the point.
        pure real(wp) function draw(seed)
            integer, intent(in) :: seed
            integer :: k

            draw = 2*modulo(1.0e6_wp*sin(seed + 1.0e9_wp*(t + sum(q*[(sqrt(real(k, wp)), k=1, size(q))]))), 1.0_wp) - 1.0_wp
        end function draw
    end subroutine add_noise
end module model_altered
