! SPDX-License-Identifier: MIT
!> User-defined steppers and step size controllers, passed to a run as objects.
module test_own_parts
    use asserts, only: check_below, check_between, check_failure, check_no_failure, check_true
    use reference, only: read_reference, reference_type
    use runs, only: get_start
    use tandem, only: explicit_type, failure_type => error_type, global_error_type, options_type, properties_type, &
        rolling_disk_type, simulation_type, statistics_type, step_control_type, wp
    use testdrive, only: error_type, new_unittest, unittest_type
    implicit none (type, external)
    private

    public :: collect_own_parts

    !> The pair of Bogacki and Shampine, which the package does not include.
    type, extends(explicit_type) :: third_order_type
    contains
        procedure, nopass :: properties => properties_of_third_order
        procedure :: set_tableau
    end type third_order_type

    !> The same without a name, and with an unknown partner.
    type, extends(third_order_type) :: nameless_type
    contains
        procedure, nopass :: properties => properties_of_nameless
    end type nameless_type
    type, extends(third_order_type) :: paired_type
    contains
        procedure, nopass :: properties => properties_of_paired
    end type paired_type

    !> Keeps one step size, whatever the error.
    type, extends(step_control_type) :: stubborn_type
        real(wp) :: step = 0.01_wp
        integer :: n_asked = 0
    contains
        procedure :: accept
    end type stubborn_type

contains

    !> The tests of this suite.
    subroutine collect_own_parts(testsuite)
        type(unittest_type), allocatable, intent(out) :: testsuite(:)

        testsuite = [ &
            new_unittest('a-stepper-of-ones-own-has-its-order', test_order), &
            new_unittest('a-stepper-of-ones-own-follows-the-tolerance-and-states-its-error', test_tolerance), &
            new_unittest('a-controller-of-ones-own-chooses-the-steps', test_controller), &
            new_unittest('steppers-that-cannot-be-are-refused', test_refused)]
    end subroutine collect_own_parts

    pure function properties_of_third_order() result(properties)
        type(properties_type) :: properties

        properties = properties_type('third_order', 3, 3, .false., 2, 'conditional (|h lambda| < 2.5)', &
            'Bogacki, Shampine 1989', stability_limit=2.5_wp)
    end function properties_of_third_order

    pure function properties_of_nameless() result(properties)
        type(properties_type) :: properties

        properties = properties_of_third_order()
        properties%name = ''
    end function properties_of_nameless

    pure function properties_of_paired() result(properties)
        type(properties_type) :: properties

        properties = properties_of_third_order()
        properties%partner = 'leapfrog'
    end function properties_of_paired

    subroutine set_tableau(self)
        class(third_order_type), intent(inout) :: self

        self%c = [0.0_wp, 0.5_wp, 0.75_wp]
        self%b = [2.0_wp/9, 1.0_wp/3, 4.0_wp/9]
        self%a = reshape([0.0_wp, 0.0_wp, 0.0_wp, 0.5_wp, 0.0_wp, 0.0_wp, 0.0_wp, 0.75_wp, 0.0_wp], [3, 3])
        self%e = reshape([-5.0_wp/72, 1.0_wp/12, 1.0_wp/9, -1.0_wp/8], [4, 1])
    end subroutine set_tableau

    subroutine accept(self, h, was_cut, norm, stiffness, longest)
        class(stubborn_type), intent(inout) :: self
        real(wp), intent(in) :: h, norm, stiffness
        real(wp), intent(in) :: longest
        logical, intent(in) :: was_cut

        call self%step_control_type%accept(h, was_cut, norm, stiffness, longest)
        self%h = self%step
        self%n_asked = self%n_asked + 1
    end subroutine accept

    !> Half the step gives an eighth of the error on the disk, against an independent reference.
    subroutine test_order(error)
        type(error_type), allocatable, intent(out) :: error
        type(rolling_disk_type), target :: model
        type(third_order_type) :: stepper
        type(simulation_type) :: simulation
        type(failure_type), allocatable :: failure
        type(reference_type) :: expected
        real(wp), allocatable :: q(:), qd(:)
        real(wp) :: found(2)
        integer :: i

        call read_reference('disk', expected)
        call model%define()
        call get_start('disk', q, qd)
        do i = 1, 2
            call simulation%initialize(model, options_type(step=0.002_wp/i), 0.0_wp, q, qd, failure, stepper=stepper)
            if (.not. allocated(failure)) call simulation%integrate(2.0_wp, failure)
            call check_no_failure(error, failure)
            if (allocated(error)) return
            found(i) = maxval(abs(simulation%state%q - expected%q_at(2.0_wp)))
        end do
        call check_between(error, log(found(1)/found(2))/log(2.0_wp), 2.9_wp, 3.1_wp, 'order')
        call check_true(error, simulation%options%stepper == 'third_order', 'the run knows its name')
        call check_below(error, maxval(simulation%errors), 1.0e-12_wp, 'constraint errors')
    end subroutine test_order

    !> Under error control, with the error by a second run with the same stepper.
    subroutine test_tolerance(error)
        type(error_type), allocatable, intent(out) :: error
        type(rolling_disk_type), target :: model, second
        type(third_order_type) :: stepper
        type(simulation_type) :: simulation
        type(global_error_type) :: global_error
        type(failure_type), allocatable :: failure
        type(reference_type) :: expected
        type(options_type) :: options
        real(wp), allocatable :: q(:), qd(:)
        real(wp) :: true

        call read_reference('disk', expected)
        call model%define()
        call get_start('disk', q, qd)
        options%rtol = 1.0e-7_wp
        options%atol = 1.0e-7_wp
        call second%define()
        call global_error%initialize(model%n, 0.0_wp, 2.0_wp)
        call simulation%initialize(model, options, 0.0_wp, q, qd, failure, stepper=stepper)
        if (.not. allocated(failure)) call simulation%integrate(2.0_wp, failure, global_error)
        if (.not. allocated(failure)) call global_error%estimate(second, options, q, qd, failure, stepper=stepper)
        call check_no_failure(error, failure)
        if (allocated(error)) return
        true = maxval(abs(simulation%state%q - expected%q_at(2.0_wp)))
        call check_below(error, true, 1.0e-4_wp, 'true error')
        call check_true(error, global_error%is_known, 'the second run states an error')
        call check_between(error, global_error%error_q/true, 0.7_wp, 1.3_wp, 'stated over true error')
    end subroutine test_tolerance

    !> It is called after every step, and its step sizes are used.
    subroutine test_controller(error)
        type(error_type), allocatable, intent(out) :: error
        type(rolling_disk_type), target :: model
        type(stubborn_type) :: control
        type(simulation_type) :: simulation
        type(statistics_type) :: statistics
        type(failure_type), allocatable :: failure
        real(wp), allocatable :: q(:), qd(:)

        call model%define()
        call get_start('disk', q, qd)
        call simulation%initialize(model, options_type(stepper='dop853', rtol=1.0e-3_wp, atol=1.0e-3_wp, first_step=0.01_wp), &
            0.0_wp, q, qd, failure, control=control)
        if (.not. allocated(failure)) call simulation%integrate(1.0_wp, failure)
        call check_no_failure(error, failure)
        if (allocated(error)) return
        statistics = simulation%statistics()
        call check_true(error, statistics%steps >= 100 .and. statistics%steps <= 101, 'a hundred steps of 0.01')
        call check_between(error, statistics%largest_step, 0.01_wp - 1.0e-12_wp, 0.01_wp + 1.0e-12_wp, 'the largest of them')
        if (allocated(error)) return
        ! Without it the tolerance takes longer ones.
        call simulation%initialize(model, options_type(stepper='dop853', rtol=1.0e-3_wp, atol=1.0e-3_wp, first_step=0.01_wp), &
            0.0_wp, q, qd, failure)
        if (.not. allocated(failure)) call simulation%integrate(1.0_wp, failure)
        call check_no_failure(error, failure)
        if (allocated(error)) return
        statistics = simulation%statistics()
        call check_true(error, statistics%steps < 50, 'fewer steps by the controller of the package')
    end subroutine test_controller

    !> With its name, before a run.
    subroutine test_refused(error)
        type(error_type), allocatable, intent(out) :: error
        type(rolling_disk_type), target :: model
        type(nameless_type) :: nameless
        type(paired_type) :: paired
        type(simulation_type) :: simulation
        type(failure_type), allocatable :: failure
        real(wp), allocatable :: q(:), qd(:)

        call model%define()
        call get_start('disk', q, qd)
        call simulation%initialize(model, options_type(), 0.0_wp, q, qd, failure, stepper=nameless)
        call check_failure(error, failure, 'invalid_option', 'name')
        if (allocated(error)) return
        call simulation%initialize(model, options_type(rtol=1.0e-6_wp), 0.0_wp, q, qd, failure, stepper=paired)
        call check_failure(error, failure, 'invalid_option', 'leapfrog')
    end subroutine test_refused
end module test_own_parts
