!> Swings the pendulum from rest at 60 degrees for ten periods and a quarter, to the passage of the lowest point, and compares with
!> exact values: the period 2 pi sqrt(l/g) / agm(1, cos 30), and the speed from the energy.
program main
    use pendulum, only: pendulum_type
    use tandem, only: error_type, options_type, simulation_type, wp
    implicit none (type, external)
    real(wp), parameter :: pi = acos(-1.0_wp), start_angle = pi/3
    type(pendulum_type), target :: model
    type(simulation_type) :: simulation
    type(error_type), allocatable :: error
    real(wp) :: period, q(2), qd(2), a, g
    integer :: i

    model%length = 2.0_wp
    call model%define()
    a = 1.0_wp
    g = cos(start_angle/2)
    do i = 1, 6 ! the arithmetic-geometric mean converges quadratically
        period = (a + g)/2
        g = sqrt(a*g)
        a = period
    end do
    period = 2*pi*sqrt(model%length/model%gravity)/a

    call simulation%initialize(model, options_type(step=1.0e-3_wp), 0.0_wp, &
        model%length*[sin(start_angle), -cos(start_angle)], [0.0_wp, 0.0_wp], error)
    if (.not. allocated(error)) call simulation%integrate(10.25_wp*period, error)
    if (allocated(error)) error stop error%message
    q = [0.0_wp, -model%length]
    qd = [-sqrt(2*model%gravity*model%length*(1 - cos(start_angle))), 0.0_wp]
    print '(a, 4f12.8)', 'x, y, xd, yd: ', simulation%state%q, simulation%state%qd
    print '(a, es8.1)', 'error: ', max(maxval(abs(simulation%state%q - q)), maxval(abs(simulation%state%qd - qd)))
end program main
