! SPDX-License-Identifier: MIT
!> A particle on a line with a force, for scenes: m qdd = pull. Depending on `fault`, its procedures end the process or never
!> return.
module model_faulty
    use tandem, only: model_type, procedure_model_type, wp
    use tandem_io, only: reader_type, scene_model_type
    use, intrinsic :: iso_c_binding, only: c_int
    implicit none (type, external)
    private

    public :: faulty_models

    type, extends(procedure_model_type) :: faulty_type
        real(wp) :: m = 1.0_wp, pull = 1.0_wp
        !> 0 none; 1 the process is killed; 2 it exits; 3 the procedure never returns; 4 the force is a NaN.
        integer :: fault = 0
    end type faulty_type

    interface
        function c_raise(signal) result(stat) bind(c, name='raise')
            import :: c_int
            implicit none (type, external)
            integer(c_int), value :: signal
            integer(c_int) :: stat
        end function c_raise

        subroutine c_leave(code) bind(c, name='_exit')
            import :: c_int
            implicit none (type, external)
            integer(c_int), value :: code
        end subroutine c_leave
    end interface

contains

    !> The model for scenes.
    function faulty_models() result(models)
        type(scene_model_type) :: models(1)

        models = [scene_model_type('faulty', build)]
    end function faulty_models

    subroutine build(reader, model, q, qd)
        class(reader_type), intent(inout) :: reader
        class(model_type), allocatable, intent(out) :: model
        real(wp), allocatable, intent(out) :: q(:), qd(:)
        type(faulty_type), allocatable :: faulty

        allocate (faulty)
        call reader%open_table('model')
        call reader%get('mass', faulty%m, unit='kg')
        call reader%get('pull', faulty%pull, unit='N')
        call reader%get('fault', faulty%fault)
        call reader%close_table()
        call reader%open_table('initial')
        if (reader%failed()) return
        faulty%name = 'faulty'
        faulty%n = 1
        faulty%constant_mass = .true.
        faulty%mass_matrix => mass
        faulty%applied_force => force
        allocate (q(1), qd(1), source=0.0_wp)
        call move_alloc(faulty, model)
    end subroutine build

    subroutine mass(self, q, value, stat)
        class(model_type), intent(inout) :: self
        real(wp), intent(in) :: q(:)
        real(wp), intent(out) :: value(:, :)
        integer, intent(out) :: stat

        stat = 0
        value = 0.0_wp
        select type (self)
        class is (faulty_type)
            value = self%m
        end select
    end subroutine mass

    subroutine force(self, t, q, qd, value, stat)
        class(model_type), intent(inout) :: self
        real(wp), intent(in) :: t, q(:), qd(:)
        real(wp), intent(out) :: value(:)
        integer, intent(out) :: stat
        integer, parameter :: killed = 9

        stat = 0
        value = 0.0_wp
        select type (self)
        class is (faulty_type)
            value = self%pull
            select case (self%fault)
            case (1)
                stat = int(c_raise(killed))
            case (2)
                call c_leave(0_c_int)
            case (3)
                do while (stat == 0)
                    if (t > 1.0e9_wp) stat = 1
                end do
            case (4)
                value = sqrt(-value)
            case default
                continue
            end select
        end select
    end subroutine force
end module model_faulty
