! SPDX-License-Identifier: MIT
!> The articulated vehicle with a bushing instead of its joint: a spring and a damper connect the two chassis.
module tandem_io_study_bushing
    use tandem, only: articulated_vehicle_type, label_length, model_type, need_force, need_gamma, need_jacobian, need_mass, &
        need_phi, terms_type, wp
    implicit none (type, external)
    private

    public :: bushing_type

    type, extends(model_type) :: bushing_type
        !> Stiffness (N/m) and damping (N s/m) of the bushing.
        real(wp) :: stiffness = 1.0e6_wp, damping = 0.0_wp
        !> Vehicle with its joint.
        type(articulated_vehicle_type) :: vehicle
        type(terms_type), private :: terms
    contains
        procedure :: define
    end type bushing_type

contains

    !> Set the procedures; the vehicle must be defined.
    subroutine define(self)
        class(bushing_type), intent(inout) :: self

        self%name = 'vehicle with a bushing'
        self%n = 6
        self%n_nonholonomic = 3
        self%constant_mass = .true.
        self%coordinate_name = self%vehicle%coordinate_name
        self%coordinate_unit = self%vehicle%coordinate_unit
        self%nonholonomic_name = [character(len=label_length) :: 'front wheel', 'joint wheel', 'rear wheel']
        self%breakpoints = self%vehicle%breakpoints
        self%evaluate => evaluate
        self%provides = need_jacobian + need_gamma + need_mass + need_force
        call self%terms%allocate(6, 2, 3)
    end subroutine define

    !> Evaluate the terms: wheels and masses of the vehicle, and the bushing's force -k d - c dd on the front end of the gap, where
    !> the gap d is Phi of the joint.
    subroutine evaluate(self, need, t, q, qd, terms, stat)
        class(model_type), intent(inout) :: self
        integer, intent(in) :: need
        real(wp), intent(in) :: t, q(:), qd(:)
        type(terms_type), intent(inout) :: terms
        integer, intent(out) :: stat
        real(wp) :: pull(2)
        integer :: i

        stat = 0
        select type (self)
        class is (bushing_type)
            self%vehicle%segment = self%segment
            call self%vehicle%evaluate(ior(need, need_jacobian + need_phi), t, q, qd, self%terms, stat)
            associate (vehicle => self%terms)
                if (iand(need, need_jacobian) /= 0) terms%jacobian = vehicle%jacobian(3:, :)
                if (iand(need, need_gamma) /= 0) terms%gamma = vehicle%gamma(3:)
                if (iand(need, need_mass) /= 0) terms%mass = vehicle%mass
                if (iand(need, need_force) /= 0) then
                    do i = 1, 2
                        pull(i) = -self%stiffness*vehicle%phi(i) - self%damping*dot_product(vehicle%jacobian(i, :), qd)
                    end do
                    terms%force = pull(1)*vehicle%jacobian(1, :) + pull(2)*vehicle%jacobian(2, :)
                end if
            end associate
        end select
    end subroutine evaluate
end module tandem_io_study_bushing
