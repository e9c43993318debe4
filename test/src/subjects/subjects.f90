! SPDX-License-Identifier: MIT
!> Models with all derivatives, each with a start at t = 0, for the tests of implicit steps.
module subjects
    use model_skater, only: skater_type
    use tandem, only: articulated_vehicle_type, model_type, motorcycle_type, rolling_disk_type, wp
    implicit none (type, external)
    private

    public :: subject_names, new_subject

    !> Their names; `driven` is a motorcycle with a driving force that steers more than the paper's.
    character(len=10), parameter :: subject_names(6) = [character(len=10) :: 'vehicle', 'disk', 'motorcycle', 'chopper', &
        'driven', 'skater']

contains

    !> A model and its start.
    subroutine new_subject(name, model, q, qd)
        !> One of `subject_names`.
        character(len=*), intent(in) :: name
        class(model_type), allocatable, intent(out) :: model
        real(wp), allocatable, intent(out) :: q(:), qd(:)
        type(articulated_vehicle_type), allocatable :: vehicle
        type(rolling_disk_type), allocatable :: disk
        type(motorcycle_type), allocatable :: motorcycle
        type(skater_type), allocatable :: skater
        integer :: stat

        stat = 0
        select case (name)
        case ('vehicle')
            allocate (vehicle)
            call vehicle%define()
            allocate (q(6), qd(6))
            call vehicle%start(15.0_wp, q, qd)
            call move_alloc(vehicle, model)
        case ('disk')
            allocate (disk)
            call disk%define()
            allocate (q(9), qd(9))
            call disk%start([-1.0_wp, 0.01_wp, 0.0_wp], 0.0_wp, q, qd)
            call move_alloc(disk, model)
        case ('motorcycle', 'chopper', 'driven')
            allocate (motorcycle)
            if (name == 'chopper') then
                motorcycle%fork_angle = atan(1.0_wp)
                motorcycle%amplitude = 0.0078_wp
            else if (name == 'driven') then
                motorcycle%fork_angle = 0.5_wp
                motorcycle%amplitude = 0.1_wp
                motorcycle%frequency = 1.7_wp
                motorcycle%driving_force = 70.0_wp
            end if
            call motorcycle%define()
            allocate (q(10), qd(10))
            call motorcycle%start(merge(5.0_wp, 15.0_wp, name == 'driven'), q, qd, stat)
            call move_alloc(motorcycle, model)
        case ('skater')
            allocate (skater)
            call skater%define()
            allocate (q(4), qd(4))
            call skater%start(q, qd)
            call move_alloc(skater, model)
        case default
            error stop 'new_subject: unknown subject'
        end select
        if (stat /= 0) error stop 'new_subject: no start'
    end subroutine new_subject
end module subjects
