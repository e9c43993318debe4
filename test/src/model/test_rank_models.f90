! SPDX-License-Identifier: MIT
!> Tests of the foundations of the rank tests: copies of rows, velocity constraints that are holonomic, and their checkers;
!> `test_mechanisms` has the mechanisms. None of them needs a solver with rank detection.
module test_rank_models
    use asserts, only: check_below, check_close, check_count, check_no_failure, check_true, format_real
    use differences, only: check_model_procedures, random_vector
    use integrability, only: frobenius_defects
    use model_bricard, only: bricard_type
    use model_disguised, only: disguise_names, disguised_type
    use model_four_bar, only: crank_rocker, four_bar_type
    use model_moving_pivot, only: moving_pivot_type
    use model_redundant, only: redundant_type
    use ranks, only: cut, judge
    use runs, only: get_start, new_scene, run
    use svd, only: get_null_space, pseudo_solve, singular_values
    use tandem, only: failure_type => error_type, finding_type, model_type, options_type, simulation_type, terms_type, &
        verify_model, wp
    use terms_at, only: get_terms
    use testdrive, only: error_type, new_unittest, unittest_type
    use watch, only: natural_errors
    implicit none (type, external)
    private

    public :: collect_rank_models

    integer, parameter :: n_subjects = 17
    character(len=10), parameter :: scenes(3) = [character(len=10) :: 'vehicle', 'disk', 'motorcycle']

contains

    !> The suite.
    subroutine collect_rank_models(testsuite)
        type(unittest_type), allocatable, intent(out) :: testsuite(:)

        testsuite = [ &
            new_unittest('singular-values-and-pseudo-inverse-of-a-known-matrix', test_svd), &
            new_unittest('models-agree-with-differences', test_procedures), &
            new_unittest('derivatives-agree-with-differences', test_derivatives), &
            new_unittest('copies-depend-on-their-rows', test_copies), &
            new_unittest('copies-leave-the-rest-alone', test_copies_rest), &
            new_unittest('spoiled-copies-contradict-where-they-should', test_spoiled), &
            new_unittest('disguised-rows-keep-their-invariants', test_invariants), &
            new_unittest('frobenius-tells-disguised-rows-from-true-ones', test_frobenius), &
            new_unittest('no-row-of-a-scene-is-integrable', test_scenes_are_nonholonomic)]
    end subroutine collect_rank_models

    !> a = sum_k s_k u_k v_k' with s = (3, 2, 0) and orthonormal u, v.
    subroutine test_svd(error)
        type(error_type), allocatable, intent(out) :: error
        real(wp) :: u(4, 2), v(3, 3), a(4, 3)
        real(wp), allocatable :: basis(:, :)

        u(:, 1) = [1, 1, 1, 1]/2.0_wp
        u(:, 2) = [1, -1, 1, -1]/2.0_wp
        v(:, 1) = [1, 2, 2]/3.0_wp
        v(:, 2) = [2, 1, -2]/3.0_wp
        v(:, 3) = [2, -2, 1]/3.0_wp
        a = 3*outer(u(:, 1), v(:, 1)) + 2*outer(u(:, 2), v(:, 2))
        ! Rounding of a few sums of terms of order one.
        call check_close(error, singular_values(a), [3.0_wp, 2.0_wp, 0.0_wp], 1.0e-14_wp, 'singular values')
        call check_close(error, singular_values(transpose(a)), [3.0_wp, 2.0_wp, 0.0_wp], 1.0e-14_wp, 'those of the transpose')
        call check_close(error, pseudo_solve(a, 6*u(:, 1) + 4*u(:, 2), cut), 2*v(:, 1) + 2*v(:, 2), 1.0e-14_wp, 'solution')
        call check_close(error, pseudo_solve(transpose(a), 6*v(:, 1) + v(:, 3), cut), 2*u(:, 1), 1.0e-14_wp, &
            'solution of the transposed, inconsistent system')
        call get_null_space(a, cut, basis)
        call check_count(error, size(basis, 2), 1, 'dimension of the null space')
        if (allocated(error)) return
        call check_close(error, basis(:, 1)*sign(1.0_wp, basis(1, 1)), v(:, 3), 1.0e-14_wp, 'null space')
    end subroutine test_svd

    !> a b'.
    pure function outer(a, b) result(c)
        real(wp), intent(in) :: a(:), b(:)
        real(wp) :: c(size(a), size(b))

        c = spread(a, 2, size(b))*spread(b, 1, size(a))
    end function outer

    !> Each of the models, by its number.
    subroutine get_subject(number, model, inner, q, qd)
        integer, intent(in) :: number
        class(model_type), allocatable, target, intent(out) :: model
        !> Memory for a model that `model` wraps.
        class(model_type), pointer, intent(inout) :: inner
        real(wp), allocatable, intent(out) :: q(:), qd(:)
        type(four_bar_type), allocatable :: four_bar
        type(bricard_type), allocatable :: bricard
        type(disguised_type), allocatable :: disguised
        type(redundant_type), allocatable :: redundant
        type(moving_pivot_type), allocatable :: pivot

        select case (number)
        case (1, 2)
            allocate (four_bar, q(9), qd(9))
            if (number == 2) four_bar%length = crank_rocker
            call four_bar%define()
            call four_bar%start(0.8_wp, 1.3_wp, q, qd)
            call move_alloc(four_bar, model)
        case (3, 4)
            allocate (bricard, q(35), qd(35))
            if (number == 4) bricard%left_out = 17
            call bricard%define()
            call bricard%start(0.2_wp, 1.3_wp, q, qd)
            call move_alloc(bricard, model)
        case (5:10)
            allocate (disguised, q(4), qd(4))
            disguised%kind = disguise_names(number - 4)
            call disguised%define()
            call disguised%start(3.0_wp, q, qd)
            call move_alloc(disguised, model)
        case default
            allocate (redundant)
            if (number == 15) then
                call wrap_scene('motorcycle', inner, q, qd)
                call redundant%wrap(inner, [7], [2.0_wp], 'twin')
            else if (number == 16) then
                ! Models without fused procedures.
                allocate (disguised, q(4), qd(4))
                disguised%kind = 'driven'
                call disguised%define()
                call disguised%start(3.0_wp, q, qd)
                if (associated(inner)) deallocate (inner)
                allocate (inner, source=disguised)
                call redundant%wrap(inner, [1], [2.0_wp], 'twin')
            else if (number == 17) then
                allocate (pivot, q(2), qd(2))
                pivot%swing = 0.2_wp
                call pivot%define()
                call pivot%motion(3.0_wp, 0.4_wp, 1.0_wp, q, qd)
                if (associated(inner)) deallocate (inner)
                allocate (inner, source=pivot)
                call redundant%wrap(inner, [1], [2.0_wp], 'twin', as_velocity=.true.)
            else
                call wrap_scene('disk', inner, q, qd)
                if (number == 11) call redundant%wrap(inner, [2, 4], [2.0_wp, -3.0_wp], 'twin')
                if (number == 12) call redundant%wrap(inner, [6], [0.5_wp], 'twin')
                if (number == 13) call redundant%wrap(inner, [2, 6], [1.5_wp, 0.5_wp], 'twin')
                if (number == 14) call redundant%wrap(inner, [1], [-1.0_wp], 'twin', as_velocity=.true.)
                redundant%growth = 0.3_wp
                redundant%growth_from = 1.0_wp
            end if
            call move_alloc(redundant, model)
        end select
    end subroutine get_subject

    !> A scene that outlives the procedure that wraps it, and its start.
    subroutine wrap_scene(name, inner, q, qd)
        character(len=*), intent(in) :: name
        class(model_type), pointer, intent(inout) :: inner
        real(wp), allocatable, intent(out) :: q(:), qd(:)
        class(model_type), allocatable :: scene

        call new_scene(name, scene)
        if (associated(inner)) deallocate (inner)
        allocate (inner, source=scene)
        call get_start(name, q, qd)
    end subroutine wrap_scene

    !> At random points, off the constraints.
    subroutine test_procedures(error)
        type(error_type), allocatable, intent(out) :: error
        class(model_type), allocatable, target :: model
        class(model_type), pointer :: inner
        real(wp), allocatable :: q(:), qd(:)
        real(wp) :: t(1)
        integer :: number, i, seed

        inner => null()
        do number = 1, n_subjects
            ! The damper of the motorcycle, number 15, is a force that is not in Lagrange's equations.
            if (number == 15) cycle
            call get_subject(number, model, inner, q, qd)
            seed = 100*number
            do i = 1, merge(2, 5, model%n == 35)
                call random_vector(seed, t)
                call random_vector(seed, q)
                call random_vector(seed, qd)
                call check_model_procedures(model, 3 + t(1), q, qd, error)
            end do
        end do
        if (associated(inner)) deallocate (inner)
    end subroutine test_procedures

    !> Close to a consistent state.
    subroutine test_derivatives(error)
        type(error_type), allocatable, intent(out) :: error
        class(model_type), allocatable, target :: model
        class(model_type), pointer :: inner
        type(finding_type), allocatable :: findings(:)
        type(failure_type), allocatable :: failure
        real(wp), allocatable :: q(:), qd(:)
        integer :: number, i

        inner => null()
        do number = 1, n_subjects
            call get_subject(number, model, inner, q, qd)
            call verify_model(model, 3.0_wp, q, qd, 3, findings, failure)
            call check_no_failure(error, failure)
            do i = 1, size(findings)
                call check_true(error, findings(i)%passed, model%name//': '//trim(findings(i)%name)//' is right')
            end do
            ! Terms and derivatives: as many as the model has.
            call check_true(error, size(findings) >= 2, model%name//' is compared at all')
        end do
        if (associated(inner)) deallocate (inner)
    end subroutine test_derivatives

    !> Every row of every scene, twice: the rank is that of the scene, and the copy is satisfied by the scene's state.
    subroutine test_copies(error)
        type(error_type), allocatable, intent(out) :: error
        class(model_type), pointer :: inner
        type(redundant_type) :: model
        real(wp), allocatable :: q(:), qd(:)
        real(wp) :: smallest, noise
        integer :: i, row, rank

        inner => null()
        do i = 1, size(scenes)
            call wrap_scene(trim(scenes(i)), inner, q, qd)
            do row = 1, inner%n_constraints()
                call model%wrap(inner, [row], [-2.5_wp], 'twin')
                call check_copy(merge(inner%n_holonomic + 1, inner%n_constraints() + 1, row <= inner%n_holonomic))
                call model%wrap(inner, [row], [1.0_wp], 'twin', as_velocity=.true.)
                call check_copy(inner%n_constraints() + 1)
            end do
            call model%wrap(inner, [1, 2], [0.3_wp, -0.7_wp], 'twin')
            call check_copy(inner%n_holonomic + 1)
            call model%wrap(inner, [2, inner%n_constraints()], [0.3_wp, -0.7_wp], 'twin')
            call check_copy(inner%n_constraints() + 1)
        end do
        deallocate (inner)

    contains

        subroutine check_copy(place)
            integer, intent(in) :: place

            call check_count(error, model%new_row, place, 'place of the copy')
            call check_count(error, model%n_constraints(), inner%n_constraints() + 1, 'rows')
            call check_true(error, model%row_name(place) == 'twin', 'the copy has its name')
            call check_true(error, model%row_name(1) == inner%row_name(1), 'the others keep their names')
            call judge(model, 0.0_wp, q, rank, smallest, noise)
            call check_count(error, rank, inner%n_constraints(), 'rank of '//model%name)
            call check_below(error, noise, 1.0e-15_wp, 'the zero singular value of '//model%name)
            call check_copied_state()
        end subroutine check_copy

        !> The scene's own start is good to 1e-14 or so, and qdd is that of the pseudo-inverse.
        subroutine check_copied_state()
            type(terms_type) :: terms
            real(wp), allocatable :: x(:)
            real(wp) :: errors(3)
            integer :: stat

            call get_terms(model, 0.0_wp, q, qd, terms, stat)
            x = pseudo_solve(terms%jacobian, -terms%gamma, cut)
            call natural_errors(terms, model%n_holonomic, spread(1.0_wp, 1, size(q)), q, qd, x, errors)
            call check_below(error, maxval(errors), 1.0e-13_wp, 'constraint errors of '//model%name)
        end subroutine check_copied_state
    end subroutine test_copies

    !> The terms of the scene are those of the wrapped one without the new row, in every segment, and so are the energies.
    subroutine test_copies_rest(error)
        type(error_type), allocatable, intent(out) :: error
        class(model_type), pointer :: inner
        type(redundant_type) :: model, twice
        type(terms_type) :: terms, with_copy
        real(wp), allocatable :: q(:), qd(:)
        integer, allocatable :: others(:)
        real(wp) :: value(2)
        integer :: i, k, segment, stat

        inner => null()
        do i = 1, size(scenes)
            call wrap_scene(trim(scenes(i)), inner, q, qd)
            call model%wrap(inner, [1], [2.0_wp], 'twin')
            call twice%wrap(model, [model%n_constraints()], [-1.0_wp], 'third')
            do segment = 1, 2
                twice%segment = segment
                call get_terms(twice, 0.4_wp, q, qd, with_copy, stat)
                inner%segment = segment
                call get_terms(inner, 0.4_wp, q, qd, terms, stat)
                others = pack([(k, k=1, size(with_copy%nu))], [(k /= model%new_row .and. k /= twice%new_row, &
                    k=1, size(with_copy%nu))])
                call check_close(error, with_copy%phi(:inner%n_holonomic), terms%phi, 0.0_wp, 'Phi')
                call check_close(error, pack(with_copy%jacobian(others, :), .true.), pack(terms%jacobian, .true.), 0.0_wp, 'C')
                call check_close(error, with_copy%nu(others), terms%nu, 0.0_wp, 'nu')
                call check_close(error, with_copy%gamma(others), terms%gamma, 0.0_wp, 'gamma')
                call check_close(error, pack(with_copy%mass, .true.), pack(terms%mass, .true.), 0.0_wp, 'M')
                call check_close(error, with_copy%force, terms%force, 0.0_wp, 'forces')
            end do
            call check_true(error, allocated(inner%breakpoints) .eqv. allocated(twice%breakpoints), 'breakpoints are kept')
            call check_true(error, allocated(inner%nu_jumps) .eqv. allocated(twice%nu_jumps), 'jumps of nu are kept')
            call check_true(error, associated(inner%potential_energy) .eqv. associated(twice%potential_energy), &
                'a potential energy is kept')
            if (associated(inner%potential_energy)) then
                call inner%potential_energy(0.4_wp, q, value(1), stat)
                call twice%potential_energy(0.4_wp, q, value(2), stat)
                call check_close(error, value(:1), value(2:), 0.0_wp, 'potential energy')
            end if
        end do
        deallocate (inner)
    end subroutine test_copies_rest

    !> Offsets show in their term only; the growth begins at its time. (That it agrees with itself is in the first tests.)
    subroutine test_spoiled(error)
        type(error_type), allocatable, intent(out) :: error
        class(model_type), pointer :: inner
        type(redundant_type) :: model
        type(terms_type) :: clean, spoiled
        real(wp), allocatable :: q(:), qd(:)
        integer :: stat

        inner => null()
        call wrap_scene('disk', inner, q, qd)
        call model%wrap(inner, [4], [2.0_wp], 'twin')
        call get_terms(model, 0.7_wp, q, qd, clean, stat)
        model%phi_offset = 0.5_wp
        model%nu_offset = 0.25_wp
        model%gamma_offset = 0.125_wp
        call get_terms(model, 0.7_wp, q, qd, spoiled, stat)
        call check_close(error, spoiled%phi - clean%phi, [0.0_wp, 0.0_wp, 0.0_wp, 0.0_wp, 0.5_wp], 1.0e-15_wp, 'Phi')
        call check_close(error, spoiled%nu - clean%nu, [0.0_wp, 0.0_wp, 0.0_wp, 0.0_wp, 0.25_wp, 0.0_wp, 0.0_wp], 1.0e-15_wp, 'nu')
        call check_close(error, spoiled%gamma - clean%gamma, [0.0_wp, 0.0_wp, 0.0_wp, 0.0_wp, 0.125_wp, 0.0_wp, 0.0_wp], &
            1.0e-15_wp, 'gamma')
        model%phi_offset = 0.0_wp
        model%nu_offset = 0.0_wp
        model%gamma_offset = 0.0_wp
        model%growth = 1.0_wp
        model%growth_from = 0.7_wp
        call get_terms(model, 0.7_wp, q, qd, spoiled, stat)
        call check_close(error, [spoiled%phi, spoiled%nu, spoiled%gamma], [clean%phi, clean%nu, clean%gamma], 0.0_wp, &
            'terms before the growth')
        call get_terms(model, 1.2_wp, q, qd, spoiled, stat)
        call check_close(error, [spoiled%phi(5), spoiled%nu(5), spoiled%gamma(5) - clean%gamma(5)], &
            [0.125_wp, -0.75_wp, 3.0_wp], 1.0e-14_wp, 'terms after it')
        deallocate (inner)
    end subroutine test_spoiled

    !> f and g along motions that the solver computes with the unchanged rows.
    subroutine test_invariants(error)
        type(error_type), allocatable, intent(out) :: error
        type(disguised_type), target :: model
        type(simulation_type) :: simulation
        type(failure_type), allocatable :: failure
        type(options_type) :: options
        real(wp) :: q(4), qd(4), change(2)
        ! Thirty times the tolerance.
        real(wp), parameter :: bound = 3.0e-9_wp
        integer :: i

        options%stepper = 'dop853'
        options%rtol = 1.0e-10_wp
        do i = 1, size(disguise_names)
            model%kind = disguise_names(i)
            call model%define()
            call model%start(0.2_wp, q, qd)
            call run(simulation, model, options, 0.2_wp, q, qd, 2.2_wp, failure)
            call check_no_failure(error, failure)
            change = model%invariants(simulation%state%q) - model%invariants(q)
            call check_below(error, -norm2(simulation%state%q - q), -0.3_wp, 'minus the way of '//trim(model%kind))
            select case (model%kind)
            case ('disguised', 'mixed')
                call check_below(error, abs(change(1)), bound, trim(model%kind)//': change of f')
            case ('driven')
                call check_below(error, abs(change(1) - (sin(4.4_wp) - sin(0.4_wp))/2), bound, 'driven: error of f')
            case ('pair')
                call check_below(error, maxval(abs(change)), bound, 'pair: change of f and g')
            case default
                call check_below(error, -abs(change(1)), -1.0e-2_wp, trim(model%kind)//': minus the change of f')
            end select
        end do
    end subroutine test_invariants

    !> The differences leave 1e-13; true defects are of order one.
    subroutine test_frobenius(error)
        type(error_type), allocatable, intent(out) :: error
        type(disguised_type) :: model
        real(wp), allocatable :: alone(:), together(:)
        real(wp) :: q(4), qd(4)
        integer :: i

        do i = 1, size(disguise_names)
            model%kind = disguise_names(i)
            call model%define()
            call model%start(0.2_wp, q, qd)
            call frobenius_defects(model, 0.2_wp, q, alone, together)
            select case (model%kind)
            case ('disguised', 'driven')
                call check_below(error, alone(1), 1.0e-12_wp, trim(model%kind)//': defect')
            case ('detuned', 'contact')
                call check_below(error, -alone(1), -0.05_wp, trim(model%kind)//': minus the defect')
            case ('pair')
                call check_below(error, -minval(alone), -0.1_wp, 'pair: minus the defect alone')
                call check_below(error, maxval(together), 1.0e-12_wp, 'pair: defect together')
            case default
                call check_below(error, alone(1), 1.0e-12_wp, 'mixed: defect of the disguised row')
                call check_below(error, -alone(2), -0.1_wp, 'mixed: minus the defect of the contact row alone')
                call check_below(error, -together(2), -0.1_wp, 'mixed: minus the defect of the contact row together')
            end select
        end do
    end subroutine test_frobenius

    !> At a state near the start. At the start itself the second row of the upright disk has no defect, and two rows of the vehicle
    !> have none together, since one degree of freedom is left and only the front wheel is steered.
    subroutine test_scenes_are_nonholonomic(error)
        type(error_type), allocatable, intent(out) :: error
        class(model_type), allocatable :: model
        real(wp), allocatable :: q(:), qd(:), alone(:), together(:)
        integer :: i, seed

        do i = 1, size(scenes)
            call new_scene(trim(scenes(i)), model)
            call get_start(trim(scenes(i)), q, qd)
            seed = 7
            call random_vector(seed, qd)
            call frobenius_defects(model, 0.3_wp, q + 0.1_wp*qd, alone, together)
            call check_below(error, -minval(alone), -1.0e-2_wp, trim(scenes(i))//': minus the smallest defect of a row, '// &
                format_real(minval(alone)))
            call check_below(error, -maxval(together), -1.0e-4_wp, trim(scenes(i))//': minus the largest defect together')
        end do
        call new_scene('disk', model)
        call get_start('disk', q, qd)
        call frobenius_defects(model, 0.0_wp, q, alone, together)
        call check_below(error, minval(alone), 1.0e-12_wp, 'smallest defect of the upright disk')
    end subroutine test_scenes_are_nonholonomic
end module test_rank_models
