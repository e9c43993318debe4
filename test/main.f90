! SPDX-License-Identifier: MIT
!> Runs the tests: all of them, one suite, or one test. Usage: tandem-test [SUITE [TEST]]
program main
    use test_accuracy, only: collect_accuracy
    use test_assembly, only: collect_assembly
    use test_nearest_velocity, only: collect_nearest_velocity
    use test_nearest_position, only: collect_nearest_position
    use test_between, only: collect_between
    use test_breakpoints, only: collect_breakpoints
    use test_charts, only: collect_charts
    use test_checkpoint, only: collect_checkpoint
    use test_pack, only: collect_pack
    use test_consistency, only: collect_consistency
    use test_constraints, only: collect_constraints
    use test_control, only: collect_control
    use test_coordinate_scale, only: collect_coordinate_scale
    use test_counters, only: collect_counters
    use test_dense, only: collect_dense
    use test_derivatives, only: collect_derivatives
    use test_description, only: collect_description
    use test_newton_effort, only: collect_newton_effort
    use test_newton_matrix, only: collect_newton_matrix
    use test_verification, only: collect_verification
    use test_expression, only: collect_expression
    use test_parameters, only: collect_parameters
    use test_table_function, only: collect_table_function
    use test_estimates, only: collect_estimates
    use test_global_error, only: collect_global_error
    use test_euler_parameters, only: collect_euler_parameters
    use test_event_actions, only: collect_event_actions
    use test_events, only: collect_events
    use test_failures, only: collect_failures
    use test_faults, only: collect_faults
    use test_large, only: collect_large
    use test_functions_of_time, only: collect_functions_of_time
    use test_late_faults, only: collect_late_faults
    use test_collapse, only: collect_collapse
    use test_linearisation, only: collect_linearisation
    use test_spectra, only: collect_spectra
    use test_nearest, only: collect_nearest
    use test_nearest_steady, only: collect_nearest_steady
    use test_sparse_steady, only: collect_sparse_steady
    use test_lists, only: collect_lists
    use test_linalg_basis, only: collect_linalg_basis
    use test_linalg_elimination, only: collect_linalg_elimination
    use test_linalg_row_space, only: collect_linalg_row_space
    use test_linalg_orthogonal, only: collect_linalg_orthogonal
    use test_linalg_singular, only: collect_linalg_singular
    use test_saddle, only: collect_saddle
    use test_linalg_solvers, only: collect_linalg_solvers
    use test_mass_blocks, only: collect_mass_blocks
    use test_massless_wheel, only: collect_massless_wheel
    use test_sums, only: collect_sums
    use test_mechanism_elements, only: collect_mechanism_elements
    use test_mechanism_groups, only: collect_mechanism_groups
    use test_friction, only: collect_friction
    use test_mechanism_laws, only: collect_mechanism_laws
    use test_closed_loops, only: collect_closed_loops
    use test_mechanism_motion, only: collect_mechanism_motion
    use test_mechanism_references, only: collect_mechanism_references
    use test_mechanism_rows, only: collect_mechanism_rows
    use test_mechanisms, only: collect_mechanisms
    use test_model_check, only: collect_model_check
    use test_models, only: collect_models
    use test_motorcycle, only: collect_motorcycle
    use test_name_index, only: collect_name_index
    use test_number_text, only: collect_number_text
    use test_options, only: collect_options
    use test_order, only: collect_order
    use test_own_parts, only: collect_own_parts
    use test_profile, only: collect_profile
    use test_projection, only: collect_projection
    use test_quiet_events, only: collect_quiet_events
    use test_radau, only: collect_radau
    use test_rank, only: collect_rank
    use test_rank_models, only: collect_rank_models
    use test_reach, only: collect_reach
    use test_reference, only: collect_reference
    use test_rigid, only: collect_rigid
    use test_rk4, only: collect_rk4
    use test_root, only: collect_root
    use test_simulation, only: collect_simulation
    use test_sparse, only: collect_sparse
    use test_sparse_features, only: collect_sparse_features
    use test_sparse_implicit, only: collect_sparse_implicit
    use test_sparse_kernels, only: collect_sparse_kernels
    use test_sparse_nearby, only: collect_sparse_nearby
    use test_sparse_runs, only: collect_sparse_runs
    use test_sparse_turns, only: collect_sparse_turns
    use test_crossing, only: collect_crossing
    use test_singular, only: collect_singular
    use test_small_motions, only: collect_small_motions
    use test_small_systems, only: collect_small_systems
    use test_statuses, only: collect_statuses
    use test_auto, only: collect_auto
    use test_stiff, only: collect_stiff
    use test_stiff_charts, only: collect_stiff_charts
    use test_stiff_springs, only: collect_stiff_springs
    use test_stability, only: collect_stability
    use test_stability_limit, only: collect_stability_limit
    use test_study, only: collect_study
    use test_sweep, only: collect_sweep
    use test_dense_parts, only: collect_dense_parts
    use test_null_space_kernels, only: collect_null_space_kernels
    use test_free_motion, only: collect_free_motion
    use test_tolerances, only: collect_tolerances
    use test_within_crossings, only: collect_within_crossings
    use testdrive, only: get_argument, new_testsuite, run_selected, run_testsuite, select_suite, testsuite_type
    use, intrinsic :: iso_fortran_env, only: error_unit
    implicit none (type, external)
    type(testsuite_type), allocatable :: suites(:)
    character(len=:), allocatable :: suite_name, test_name
    integer :: i, n_failed

    suites = [ &
        new_testsuite('reference', collect_reference), &
        new_testsuite('lists', collect_lists), &
        new_testsuite('number_text', collect_number_text), &
        new_testsuite('linalg_basis', collect_linalg_basis), &
        new_testsuite('linalg_solvers', collect_linalg_solvers), &
        new_testsuite('linalg_elimination', collect_linalg_elimination), &
        new_testsuite('linalg_row_space', collect_linalg_row_space), &
        new_testsuite('linalg_orthogonal', collect_linalg_orthogonal), &
        new_testsuite('linalg_singular', collect_linalg_singular), &
        new_testsuite('saddle', collect_saddle), &
        new_testsuite('large', collect_large), &
        new_testsuite('euler_parameters', collect_euler_parameters), &
        new_testsuite('rigid', collect_rigid), &
        new_testsuite('models', collect_models), &
        new_testsuite('motorcycle', collect_motorcycle), &
        new_testsuite('dense_parts', collect_dense_parts), &
        new_testsuite('small_systems', collect_small_systems), &
        new_testsuite('null_space_kernels', collect_null_space_kernels), &
        new_testsuite('free_motion', collect_free_motion), &
        new_testsuite('mass_blocks', collect_mass_blocks), &
        new_testsuite('derivatives', collect_derivatives), &
        new_testsuite('newton_matrix', collect_newton_matrix), &
        new_testsuite('newton_effort', collect_newton_effort), &
        new_testsuite('verification', collect_verification), &
        new_testsuite('auto', collect_auto), &
        new_testsuite('stiff', collect_stiff), &
        new_testsuite('stiff_charts', collect_stiff_charts), &
        new_testsuite('stiff_springs', collect_stiff_springs), &
        new_testsuite('expression', collect_expression), &
        new_testsuite('parameters', collect_parameters), &
        new_testsuite('table_function', collect_table_function), &
        new_testsuite('name_index', collect_name_index), &
        new_testsuite('options', collect_options), &
        new_testsuite('model_check', collect_model_check), &
        new_testsuite('simulation', collect_simulation), &
        new_testsuite('assembly', collect_assembly), &
        new_testsuite('nearest_velocity', collect_nearest_velocity), &
        new_testsuite('nearest_position', collect_nearest_position), &
        new_testsuite('failures', collect_failures), &
        new_testsuite('faults', collect_faults), &
        new_testsuite('late_faults', collect_late_faults), &
        new_testsuite('functions_of_time', collect_functions_of_time), &
        new_testsuite('collapse', collect_collapse), &
        new_testsuite('statuses', collect_statuses), &
        new_testsuite('rk4', collect_rk4), &
        new_testsuite('accuracy', collect_accuracy), &
        new_testsuite('order', collect_order), &
        new_testsuite('radau', collect_radau), &
        new_testsuite('projection', collect_projection), &
        new_testsuite('consistency', collect_consistency), &
        new_testsuite('constraints', collect_constraints), &
        new_testsuite('charts', collect_charts), &
        new_testsuite('counters', collect_counters), &
        new_testsuite('breakpoints', collect_breakpoints), &
        new_testsuite('profile', collect_profile), &
        new_testsuite('control', collect_control), &
        new_testsuite('reach', collect_reach), &
        new_testsuite('own_parts', collect_own_parts), &
        new_testsuite('stability_limit', collect_stability_limit), &
        new_testsuite('tolerances', collect_tolerances), &
        new_testsuite('estimates', collect_estimates), &
        new_testsuite('global_error', collect_global_error), &
        new_testsuite('dense', collect_dense), &
        new_testsuite('between', collect_between), &
        new_testsuite('root', collect_root), &
        new_testsuite('events', collect_events), &
        new_testsuite('event_actions', collect_event_actions), &
        new_testsuite('quiet_events', collect_quiet_events), &
        new_testsuite('checkpoint', collect_checkpoint), &
        new_testsuite('pack', collect_pack), &
        new_testsuite('coordinate_scale', collect_coordinate_scale), &
        new_testsuite('mechanisms', collect_mechanisms), &
        new_testsuite('mechanism_elements', collect_mechanism_elements), &
        new_testsuite('mechanism_groups', collect_mechanism_groups), &
        new_testsuite('mechanism_rows', collect_mechanism_rows), &
        new_testsuite('mechanism_laws', collect_mechanism_laws), &
        new_testsuite('friction', collect_friction), &
        new_testsuite('massless_wheel', collect_massless_wheel), &
        new_testsuite('sums', collect_sums), &
        new_testsuite('closed_loops', collect_closed_loops), &
        new_testsuite('mechanism_motion', collect_mechanism_motion), &
        new_testsuite('sparse', collect_sparse), &
        new_testsuite('sparse_runs', collect_sparse_runs), &
        new_testsuite('sparse_features', collect_sparse_features), &
        new_testsuite('sparse_implicit', collect_sparse_implicit), &
        new_testsuite('sparse_kernels', collect_sparse_kernels), &
        new_testsuite('sparse_nearby', collect_sparse_nearby), &
        new_testsuite('sparse_turns', collect_sparse_turns), &
        new_testsuite('mechanism_references', collect_mechanism_references), &
        new_testsuite('linearisation', collect_linearisation), &
        new_testsuite('spectra', collect_spectra), &
        new_testsuite('small_motions', collect_small_motions), &
        new_testsuite('nearest', collect_nearest), &
        new_testsuite('nearest_steady', collect_nearest_steady), &
        new_testsuite('sparse_steady', collect_sparse_steady), &
        new_testsuite('rank_models', collect_rank_models), &
        new_testsuite('rank', collect_rank), &
        new_testsuite('crossing', collect_crossing), &
        new_testsuite('within_crossings', collect_within_crossings), &
        new_testsuite('singular', collect_singular), &
        new_testsuite('description', collect_description), &
        new_testsuite('study', collect_study), &
        new_testsuite('sweep', collect_sweep), &
        new_testsuite('stability', collect_stability)]
    n_failed = 0
    call get_argument(1, suite_name)
    call get_argument(2, test_name)
    if (allocated(suite_name)) then
        i = select_suite(suites, suite_name)
        if (i < 1 .or. i > size(suites)) then
            write (error_unit, '(a)') 'no suite "'//suite_name//'"; there are:'
            write (error_unit, '(2x, a)') (suites(i)%name, i=1, size(suites))
            error stop 2
        end if
        write (error_unit, '(a)') '# '//suites(i)%name
        if (allocated(test_name)) then
            call run_selected(suites(i)%collect, test_name, error_unit, n_failed)
            if (n_failed < 0) error stop 2
        else
            call run_testsuite(suites(i)%collect, error_unit, n_failed)
        end if
    else
        do i = 1, size(suites)
            write (error_unit, '(a)') '# '//suites(i)%name
            call run_testsuite(suites(i)%collect, error_unit, n_failed)
        end do
    end if
    if (n_failed > 0) then
        write (error_unit, '(i0, a)') n_failed, ' tests failed'
        error stop 1
    end if
end program main
