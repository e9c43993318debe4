! SPDX-License-Identifier: MIT
!> What the C and the Fortran 77 interface cost: the rolling disk by RK4 through each of them and natively, from the same
!> procedures. All take turns in many short runs; what an interface costs is the median of the ratios of its run to the native one
!> next to it. Checks that results are bitwise the same, and says what the interfaces cost: times are no test.
module disk_terms
    use tandem, only: model_type, need_all_derivatives, need_force, need_gamma, need_jacobian, need_mass, need_phi, &
        rolling_disk_type, terms_type, wp
    use, intrinsic :: iso_c_binding, only: c_double, c_f_pointer, c_int, c_ptr
    implicit none (type, external)
    private

    public :: evaluate_native, evaluate_f77, evaluate_c, n, nh, nd, provided, disk_terms_type

    integer, parameter :: n = 9, nh = 4, nd = 2
    integer, parameter :: provided = need_phi + need_jacobian + need_gamma + need_mass + need_force

    !> The disk, and where its terms go: all three ways evaluate the same procedure and copy the same numbers.
    type, extends(model_type) :: disk_terms_type
        type(rolling_disk_type) :: disk
        type(terms_type) :: terms
    end type disk_terms_type

contains

    !> The terms in explicit-shape arrays; `by_rows` is the only difference between the three.
    subroutine set_terms(self, need, t, q, qd, phi, jacobian, gamma, mass, force, by_rows, stat)
        type(disk_terms_type), intent(inout) :: self
        integer, intent(in) :: need
        real(wp), intent(in) :: t, q(n), qd(n)
        real(wp), intent(inout) :: phi(nh), jacobian(*), gamma(nh + nd), mass(n, n), force(n)
        logical, intent(in) :: by_rows
        integer, intent(out) :: stat
        integer :: i, j

        call self%disk%evaluate(need, t, q, qd, self%terms, stat)
        if (iand(need, need_phi) /= 0) phi = self%terms%phi
        if (iand(need, need_jacobian) /= 0) then
            if (by_rows) then
                do i = 1, nh + nd
                    do j = 1, n
                        jacobian((i - 1)*n + j) = self%terms%jacobian(i, j)
                    end do
                end do
            else
                do j = 1, n
                    do i = 1, nh + nd
                        jacobian((j - 1)*(nh + nd) + i) = self%terms%jacobian(i, j)
                    end do
                end do
            end if
        end if
        if (iand(need, need_gamma) /= 0) gamma = self%terms%gamma
        if (iand(need, need_mass) /= 0) mass = self%terms%mass
        if (iand(need, need_force) /= 0) force = self%terms%force
    end subroutine set_terms

    subroutine evaluate_native(self, need, t, q, qd, terms, stat)
        class(model_type), intent(inout) :: self
        integer, intent(in) :: need
        real(wp), intent(in) :: t, q(:), qd(:)
        type(terms_type), intent(inout) :: terms
        integer, intent(out) :: stat

        stat = -1
        select type (self)
        type is (disk_terms_type)
            call set_terms(self, need, t, q, qd, terms%phi, terms%jacobian, terms%gamma, terms%mass, terms%force, .false., stat)
        end select
    end subroutine evaluate_native

    !> A subroutine in the style of Fortran 77; IPAR holds the address of the disk.
    subroutine evaluate_f77(need, n_, nh_, nd_, t, q, qd, phi, c, anu, gam, am, f, rpar, ipar, istat)
        use, intrinsic :: iso_c_binding, only: c_intptr_t, c_null_ptr
        integer, intent(in) :: need, n_, nh_, nd_
        real(wp), intent(in) :: t, q(*), qd(*)
        real(wp), intent(inout) :: phi(*), c(*), anu(*), gam(*), am(*), f(*)
        real(wp), intent(inout) :: rpar(*)
        integer, intent(inout) :: ipar(*), istat
        type(disk_terms_type), pointer :: self
        integer(c_intptr_t) :: address

        address = transfer(ipar(1:2), address)
        call c_f_pointer(transfer(address, c_null_ptr), self)
        call set_terms(self, need, t, q, qd, phi, c, gam, am, f, .false., istat)
    end subroutine evaluate_f77

    !> A function of C; user_data is the address of the disk.
    integer(c_int) function evaluate_c(need, t, q, qd, phi, jacobian, nu, gamma, mass, force, user_data) bind(C)
        integer(c_int), value :: need
        real(c_double), value :: t
        real(c_double), intent(in) :: q(*), qd(*)
        real(c_double), intent(inout) :: phi(*), jacobian(*), nu(*), gamma(*), mass(*), force(*)
        type(c_ptr), value :: user_data
        type(disk_terms_type), pointer :: self

        call c_f_pointer(user_data, self)
        call set_terms(self, need, t, q, qd, phi, jacobian, gamma, mass, force, .true., evaluate_c)
    end function evaluate_c
end module disk_terms

program main
    use disk_terms, only: disk_terms_type, evaluate_c, evaluate_f77, evaluate_native, n, nd, nh, provided
    use tandem, only: error_type, long, options_type, simulation_type, wp
    use, intrinsic :: iso_c_binding, only: c_char, c_double, c_funloc, c_funptr, c_int, c_intptr_t, c_loc, c_null_char, c_ptr
    implicit none (type, external)
    interface
        type(c_ptr) function tandem_new(n, nh, nd, user_data) bind(C)
            import :: c_int, c_ptr
            implicit none (type, external)
            integer(c_int), value :: n, nh, nd
            type(c_ptr), value :: user_data
        end function tandem_new
        subroutine tandem_free(problem) bind(C)
            import :: c_ptr
            implicit none (type, external)
            type(c_ptr), value :: problem
        end subroutine tandem_free
        integer(c_int) function tandem_set_evaluate(problem, function_, provides) bind(C)
            import :: c_funptr, c_int, c_ptr
            implicit none (type, external)
            type(c_ptr), value :: problem
            type(c_funptr), value :: function_
            integer(c_int), value :: provides
        end function tandem_set_evaluate
        integer(c_int) function tandem_set_real(problem, name, value) bind(C)
            import :: c_char, c_double, c_int, c_ptr
            implicit none (type, external)
            type(c_ptr), value :: problem
            character(kind=c_char), intent(in) :: name(*)
            real(c_double), value :: value
        end function tandem_set_real
        integer(c_int) function tandem_start(problem, t, q, qd) bind(C)
            import :: c_double, c_int, c_ptr
            implicit none (type, external)
            type(c_ptr), value :: problem
            real(c_double), value :: t
            real(c_double), intent(in) :: q(*), qd(*)
        end function tandem_start
        integer(c_int) function tandem_integrate(problem, t_end) bind(C)
            import :: c_double, c_int, c_ptr
            implicit none (type, external)
            type(c_ptr), value :: problem
            real(c_double), value :: t_end
        end function tandem_integrate
        integer(c_int) function tandem_get_state(problem, t, q, qd, qdd) bind(C)
            import :: c_double, c_int, c_ptr
            implicit none (type, external)
            type(c_ptr), value :: problem
            real(c_double), intent(out) :: t
            real(c_double), intent(inout) :: q(*), qd(*), qdd(*)
        end function tandem_get_state
        subroutine tdnew(h, n, nh, nd, ierr)
            implicit none (type, external)
            integer, intent(out) :: h(4)
            integer, intent(in) :: n, nh, nd
            integer, intent(out) :: ierr
        end subroutine tdnew
        subroutine tdfree(h, ierr)
            implicit none (type, external)
            integer, intent(inout) :: h(4)
            integer, intent(out) :: ierr
        end subroutine tdfree
        subroutine tdeval(h, sub, iprov, ierr)
            use disk_terms, only: evaluate_f77
            implicit none (type, external)
            integer, intent(in) :: h(4), iprov
            procedure(evaluate_f77) :: sub
            integer, intent(out) :: ierr
        end subroutine tdeval
        subroutine tdsetr(h, name, value, ierr)
            import :: wp
            implicit none (type, external)
            integer, intent(in) :: h(4)
            character(len=*), intent(in) :: name
            real(wp), intent(in) :: value
            integer, intent(out) :: ierr
        end subroutine tdsetr
        subroutine tdstrt(h, t, q, qd, rpar, ipar, ierr)
            import :: wp
            implicit none (type, external)
            integer, intent(in) :: h(4)
            real(wp), intent(in) :: t, q(*), qd(*)
            real(wp), intent(inout) :: rpar(*)
            integer, intent(inout) :: ipar(*)
            integer, intent(out) :: ierr
        end subroutine tdstrt
        subroutine tdintg(h, t, q, qd, tend, rpar, ipar, ierr)
            import :: wp
            implicit none (type, external)
            integer, intent(in) :: h(4)
            real(wp), intent(inout) :: t, q(*), qd(*)
            real(wp), intent(in) :: tend
            real(wp), intent(inout) :: rpar(*)
            integer, intent(inout) :: ipar(*)
            integer, intent(out) :: ierr
        end subroutine tdintg
    end interface
    integer, parameter :: ways = 3
    character(len=6), parameter :: name(ways) = [character(len=6) :: 'native', 'c', 'f77']
    type(disk_terms_type), target :: disk
    ! 200 steps a run, some milliseconds: short enough to be left alone now and then.
    real(wp), parameter :: t_end = 0.2_wp
    integer, parameter :: rounds = 201
    real(wp) :: q0(n), qd0(n), state(2*n, ways), seconds(rounds, ways), ratio(ways)
    integer :: round, way, k
    logical :: agrees

    call disk%disk%define()
    call disk%disk%start([0.1_wp, 2.0_wp, -0.6_wp], 0.3_wp, q0, qd0)
    call disk%terms%allocate(n, nh, nd)
    disk%n = n
    disk%n_holonomic = nh
    disk%n_nonholonomic = nd
    disk%evaluate => evaluate_native
    disk%provides = provided
    agrees = .true.
    do round = 1, rounds
        do k = 1, ways
            way = 1 + mod(round + k, ways)
            call run(way, state(:, way), seconds(round, way))
        end do
        agrees = agrees .and. all(transfer(state, [0_long]) == transfer(spread(state(:, 1), 2, ways), [0_long]))
    end do
    ratio = [(median(seconds(:, way)/seconds(:, 1)), way=1, ways)]
    print '(a)', trim(merge('ok    ', 'not ok', agrees))//' disk-is-bitwise-the-same-through-every-interface'
    print '(4x, a, f9.4, a, sp, f6.2, a)', (name(way), 1000*median(seconds(:, way)), ' ms', 100*(ratio(way) - 1), ' %', &
        way=1, ways)
    if (.not. agrees) error stop 1

contains

    !> One run, set-up not counted.
    subroutine run(way, reached, time)
        integer, intent(in) :: way
        real(wp), intent(out) :: reached(2*n), time
        type(simulation_type) :: simulation
        type(error_type), allocatable :: error
        type(c_ptr) :: problem
        real(wp) :: t, q(n), qd(n), qdd(n), rpar(1)
        integer :: h(4), ipar(2), stat
        real(wp) :: before, after

        stat = 0
        q = q0
        qd = qd0
        t = 0.0_wp
        select case (way)
        case (1)
            call simulation%initialize(disk, options_type(step=1.0e-3_wp), 0.0_wp, q0, qd0, error)
            call cpu_time(before)
            if (.not. allocated(error)) call simulation%integrate(t_end, error)
            call cpu_time(after)
            if (allocated(error)) error stop error%message
            q = simulation%state%q
            qd = simulation%state%qd
        case (2)
            problem = tandem_new(n, nh, nd, c_loc(disk))
            stat = stat + tandem_set_evaluate(problem, c_funloc(evaluate_c), provided)
            stat = stat + tandem_set_real(problem, 'step'//c_null_char, 1.0e-3_wp)
            stat = stat + tandem_start(problem, t, q, qd)
            call cpu_time(before)
            stat = stat + tandem_integrate(problem, t_end)
            call cpu_time(after)
            stat = stat + tandem_get_state(problem, t, q, qd, qdd)
            call tandem_free(problem)
        case default
            ipar = transfer(transfer(c_loc(disk), 0_c_intptr_t), ipar)
            rpar = 0.0_wp
            call tdnew(h, n, nh, nd, stat)
            if (stat == 0) call tdeval(h, evaluate_f77, provided, stat)
            if (stat == 0) call tdsetr(h, 'step', 1.0e-3_wp, stat)
            if (stat == 0) call tdstrt(h, t, q, qd, rpar, ipar, stat)
            call cpu_time(before)
            if (stat == 0) call tdintg(h, t, q, qd, t_end, rpar, ipar, stat)
            call cpu_time(after)
            if (stat == 0) call tdfree(h, stat)
        end select
        if (stat /= 0) error stop 'a run failed'
        reached = [q, qd]
        time = after - before
    end subroutine run

    pure real(wp) function median(values)
        real(wp), intent(in) :: values(:)
        real(wp) :: sorted(size(values)), kept
        integer :: i, j

        sorted = values
        do i = 2, size(sorted)
            kept = sorted(i)
            do j = i - 1, 1, -1
                if (sorted(j) <= kept) exit
                sorted(j + 1) = sorted(j)
            end do
            sorted(j + 1) = kept
        end do
        median = sorted((size(sorted) + 1)/2)
    end function median
end program main
