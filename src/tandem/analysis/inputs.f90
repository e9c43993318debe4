! SPDX-License-Identifier: MIT
!> Inputs and outputs of a linearised system: x' = A x + B u, y = C x + D u.
!>
!> Inputs are functions of time of the model (`input_name`): forces, and motions that are imposed. A motion u enters the
!> constraints, with its rate and its acceleration, so that it has three columns; zero columns are left out. With the derivatives of
!> the residuals by an input, the chain is that of A: dq = -Phi_q^+ Phi_u, C dqd = -(vel_q dq + vel_u), and dqdd from acc_u and
!> dyn_u. Outputs are the measured quantities of the model (sensors), by central differences of fourth order along the motions.
module tandem_analysis_inputs
    use tandem_analysis_linearisation, only: in_steady_motion, linearisation_type
    use tandem_analysis_point, only: point_type
    use tandem_error, only: error_type
    use tandem_kinds, only: wp
    use tandem_model, only: model_type
    use tandem_status, only: status_callback_failed, status_ok
    implicit none (type, external)
    private

    public :: inputs_type, channel_length

    !> Length of a channel's name.
    integer, parameter :: channel_length = 128

    type :: inputs_type
        !> B (nv + nw, inputs), C (outputs, nv + nw), D (outputs, inputs).
        real(wp), allocatable :: b(:, :), c(:, :), d(:, :)
        !> `NAME`, `NAME'` and `NAME''` for a motion with its rate and acceleration; `SENSOR/WHAT`, with [1], [2], ... of vectors.
        character(len=channel_length), allocatable :: inputs(:), outputs(:)
    contains
        procedure :: make
        procedure, private :: add_input, make_outputs
    end type inputs_type

    !> Displacements and weights of central differences of fourth order.
    real(wp), parameter :: place(4) = [-2.0_wp, -1.0_wp, 1.0_wp, 2.0_wp], weight(4) = [1.0_wp, -8.0_wp, 8.0_wp, -1.0_wp]/12.0_wp

contains

    !> B, C and D at the point of a linearised system.
    subroutine make(self, it, model, error)
        class(inputs_type), intent(out) :: self
        type(linearisation_type), intent(in) :: it
        !> The model of the linearised system.
        class(model_type), intent(inout), target :: model
        type(error_type), allocatable, intent(out) :: error
        type(point_type), allocatable :: point
        real(wp), allocatable :: moves(:, :, :)
        character(len=2) :: primes
        integer :: i, order, stat, n_inputs

        allocate (point)
        call point%initialize(model)
        call point%evaluate(it%t, it%q, it%qd, stat)
        if (stat == status_ok) then
            call point%make_bases()
            call point%solve_dynamics(stat)
        end if
        if (stat == status_ok) call point%differentiate(stat)
        call point%describe(stat, 'cannot be evaluated at the point', error)
        if (allocated(error)) return
        n_inputs = 0
        if (allocated(model%input_name)) n_inputs = size(model%input_name)
        allocate (self%b(it%nv + it%nw, 0), self%inputs(0))
        ! Changes of coordinates, velocities and accelerations with inputs (n, 3, inputs).
        allocate (moves(point%n, 3, 0))
        do i = 1, n_inputs
            do order = 0, 2
                primes = repeat("'", order)
                call self%add_input(it, point, i, order, trim(model%input_name(i))//trim(primes), moves, stat)
                if (stat /= status_ok) exit
            end do
        end do
        call reset(model)
        call point%describe(stat, 'cannot be evaluated with other inputs', error)
        if (allocated(error)) return
        call self%make_outputs(it, point, moves, stat)
        call point%describe(stat, 'could not be measured', error)
    end subroutine make

    !> Reset inputs to zero.
    subroutine reset(model)
        class(model_type), intent(inout) :: model

        if (allocated(model%state%input)) deallocate (model%state%input)
        model%state%input_version = model%state%input_version + 1
    end subroutine reset

    !> A column of B, if it is not zero.
    subroutine add_input(self, it, point, number, order, name, moves, stat)
        class(inputs_type), intent(inout) :: self
        type(linearisation_type), intent(in) :: it
        type(point_type), intent(inout) :: point
        !> The input, and the order of its derivative in time.
        integer, intent(in) :: number, order
        character(len=*), intent(in) :: name
        real(wp), allocatable, intent(inout) :: moves(:, :, :)
        integer, intent(out) :: stat
        real(wp) :: by_input(point%nh + 2*point%m + point%n), column(it%nv + it%nw)
        real(wp), dimension(point%n, 1) :: dq, dqd, dqdd
        real(wp) :: l(point%n, point%n)
        integer :: i

        call differentiate_by_input(point, number, order, by_input, stat)
        if (stat /= status_ok .or. .not. any(abs(by_input) > 0.0_wp)) return
        associate (nh => point%nh, m => point%m, n => point%n)
            call point%apply_position_inverse(-by_input(:nh), dq(:, 1))
            call point%apply_right_inverse(reshape(-by_input(nh + 1:nh + m), [m, 1]) - matmul(point%velocity_q, dq), dqd)
            call point%vary_acceleration(dq, dqd, dqdd, by_input(nh + m + 1:nh + 2*m), by_input(nh + 2*m + 1:))
            do i = 1, n
                dq(i, :) = point%scale(i)*dq(i, :)
                dqd(i, :) = point%scale(i)*dqd(i, :)
                dqdd(i, :) = point%scale(i)*dqdd(i, :)
            end do
            l = 0.0_wp
            if (it%kind == in_steady_motion) l = it%symmetry%matrix(it%rates, n)
        end associate
        column(:it%nv) = matmul(it%dual_v, dqd(:, 1) - matmul(l, dq(:, 1)))
        column(it%nv + 1:) = matmul(it%dual_w, dqdd(:, 1) - matmul(l, dqd(:, 1)))
        self%b = reshape([self%b, column], [size(self%b, 1), size(self%b, 2) + 1])
        self%inputs = [character(len=channel_length) :: self%inputs, name]
        moves = reshape([moves, dq, dqd, dqdd], [point%n, 3, size(moves, 3) + 1])
    end subroutine add_input

    !> Derivatives of Phi, C qd - nu, C qdd + gamma and the equations of motion by an input, with everything else constant.
    subroutine differentiate_by_input(point, number, order, by_input, stat)
        type(point_type), intent(inout) :: point
        integer, intent(in) :: number, order
        real(wp), intent(out) :: by_input(:)
        integer, intent(out) :: stat
        real(wp), parameter :: h = 2.0_wp**(-10)
        real(wp) :: q(point%n), qd(point%n), s_qd(point%n), s_qdd(point%n), reference(size(by_input)), t
        integer :: i

        q = point%q
        qd = point%qd
        t = point%t
        s_qd = qd/point%scale
        s_qdd = point%qdd/point%scale
        by_input = 0.0_wp
        associate (model => point%model)
            if (.not. allocated(model%state%input)) allocate (model%state%input(0:2, size(model%input_name)), source=0.0_wp)
            reference = residuals()
            do i = 1, 4
                model%state%input(order, number) = place(i)*h
                model%state%input_version = model%state%input_version + 1
                call point%evaluate(t, q, qd, stat)
                if (stat /= status_ok) exit
                ! Terms independent of the input cancel exactly.
                by_input = by_input + weight(i)/h*(residuals() - reference)
            end do
            model%state%input = 0.0_wp
            model%state%input_version = model%state%input_version + 1
        end associate
        if (stat == status_ok) call point%evaluate(t, q, qd, stat)

    contains

        function residuals() result(r)
            real(wp) :: r(size(by_input))

            r = [point%phi, matmul(point%jacobian, s_qd) - point%nu, matmul(point%jacobian, s_qdd) + point%gamma, &
                matmul(point%mass, s_qdd) - point%force]
        end function residuals
    end subroutine differentiate_by_input

    !> C and D: changes of outputs along the motions of the state and of the inputs.
    subroutine make_outputs(self, it, point, moves, stat)
        class(inputs_type), intent(inout) :: self
        type(linearisation_type), intent(in) :: it
        type(point_type), intent(inout) :: point
        real(wp), intent(in) :: moves(:, :, :)
        integer, intent(out) :: stat
        real(wp), dimension(point%n, 1) :: dq, dqd, dqdd
        integer :: j, n_outputs, n_states

        stat = status_ok
        allocate (self%outputs(0))
        n_outputs = 0
        if (allocated(point%model%quantities)) then
            do j = 1, size(point%model%quantities)
                call name_outputs(self, point%model%quantities(j)%path, point%model%quantities(j)%width)
            end do
            n_outputs = size(self%outputs)
        end if
        n_states = it%nv + it%nw
        allocate (self%c(n_outputs, n_states), self%d(n_outputs, size(self%b, 2)), source=0.0_wp)
        if (n_outputs == 0) return
        do j = 1, n_states
            dq = 0.0_wp
            if (j <= it%nv) then
                dq(:, 1) = it%v(:, j)/point%scale
                dqd(:, 1) = it%g(:, j)/point%scale
            else
                dqd(:, 1) = it%w(:, j - it%nv)/point%scale
            end if
            call point%vary_acceleration(dq, dqd, dqdd)
            call measure_along(point, it, point%scale*dq(:, 1), point%scale*dqd(:, 1), point%scale*dqdd(:, 1), self%c(:, j), stat)
            if (stat /= status_ok) return
        end do
        do j = 1, size(self%b, 2)
            call measure_along(point, it, moves(:, 1, j), moves(:, 2, j), moves(:, 3, j), self%d(:, j), stat)
            if (stat /= status_ok) return
        end do
    end subroutine make_outputs

    !> Names of the components of a quantity.
    subroutine name_outputs(self, path, width)
        type(inputs_type), intent(inout) :: self
        character(len=*), intent(in) :: path
        !> 0 for a single one.
        integer, intent(in) :: width
        character(len=8) :: number
        integer :: i

        if (width == 0) self%outputs = [character(len=channel_length) :: self%outputs, path]
        do i = 1, width
            write (number, '("[", i0, "]")') i
            self%outputs = [character(len=channel_length) :: self%outputs, trim(path)//trim(number)]
        end do
    end subroutine name_outputs

    !> The derivative of the outputs along a motion.
    subroutine measure_along(point, it, dq, dqd, dqdd, rates, stat)
        type(point_type), intent(inout) :: point
        type(linearisation_type), intent(in) :: it
        real(wp), intent(in) :: dq(:), dqd(:), dqdd(:)
        real(wp), intent(out) :: rates(:)
        integer, intent(out) :: stat
        real(wp) :: values(size(rates)), h
        integer :: i

        ! Displacements of about 1e-3 in the largest component, relative to its own size.
        h = 2.0_wp**(-10)/max(1.0_wp, maxval(abs(dq)/point%scale), maxval(abs(dqd)/(point%scale*point%rate + abs(it%qd))), &
            maxval(abs(dqdd)/(point%scale*point%rate**2 + abs(it%qdd))))
        rates = 0.0_wp
        do i = 1, 4
            call point%model%measure(it%t, it%q + place(i)*h*dq, it%qd + place(i)*h*dqd, it%qdd + place(i)*h*dqdd, values, stat)
            if (stat /= 0) then
                stat = status_callback_failed
                return
            end if
            rates = rates + weight(i)/h*values
        end do
        stat = status_ok
    end subroutine measure_along
end module tandem_analysis_inputs
