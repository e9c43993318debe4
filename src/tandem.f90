! SPDX-License-Identifier: MIT
!> The public face of tandem: re-exports only. `use tandem` is all that a program needs.
module tandem
    use tandem_analysis_floquet, only: floquet_type
    use tandem_analysis_inputs, only: channel_length, inputs_type
    use tandem_analysis_linearisation, only: at_an_instant, at_equilibrium, in_steady_motion, kind_name, linearisation_type, &
        most_linearised => most_coordinates
    use tandem_analysis_nearest, only: most_nearest, nearest_type
    use tandem_analysis_spectrum, only: cause_name, is_asymptotically_stable, is_marginal, is_unstable, of_family, &
        of_motion, of_symmetry, spectrum_type, stability_name
    use tandem_analysis_equilibrium_search, only: equilibrium_search_type
    use tandem_analysis_steady_words, only: any_motion, find_steady_from_words
    use tandem_analysis_symmetry, only: list_motions, symmetry_type
    use tandem_error, only: error_type, set_error, to_text
    use tandem_kinds, only: long, wp
    use tandem_mechanism, only: mechanism_type
    use tandem_mechanism_census, only: census_type, element_count_type, take_census
    use tandem_mechanism_expression, only: check_name, expression_type, parse_expression
    use tandem_mechanism_drawing, only: drawing_type, take_drawing
    use tandem_mechanism_description, only: build_mechanism, mechanism_kinds, mechanism_singles
    use tandem_mechanism_entries, only: atom_type, entries_type, entry_type, is_number, is_other, is_text, is_truth, value_type
    use tandem_mechanism_key_reader, only: anything, fault_type, not_negative, positive, reader_type
    use tandem_mechanism_function, only: constant_type, expression_function, function_type, polynomial_type, ramp, sine_type, &
        table_function
    use tandem_mechanism_law, only: expression_law, friction_law_type, law_type, table_law
    use tandem_mechanism_parameters, only: resolve_parameters
    use tandem_mechanism_plane, only: plane_type
    use tandem_mechanism_shown, only: shown_type
    use tandem_mechanism_table_function, only: table_ends, table_kinds, table_type
    use tandem_model, only: label_length, model_type, quantity_type
    use tandem_model_affine_motion, only: affine_motion_type, motion_name_length
    use tandem_model_derivatives, only: derivative_name, derivatives_type, n_derivatives, need_acceleration_q, &
        need_acceleration_qd, need_all_derivatives, need_dynamics_q, need_dynamics_qd, need_velocity_q
    use tandem_model_pattern, only: pattern_type
    use tandem_model_procedures, only: procedure_model_type
    use tandem_model_terms, only: n_terms, need_force, need_gamma, need_jacobian, need_mass, need_nu, need_phi, term_name, &
        terms_type
    use tandem_model_verification, only: finding_type, verify_model
    use tandem_models_articulated_vehicle, only: articulated_vehicle_type
    use tandem_models_motorcycle, only: motorcycle_type
    use tandem_models_rolling_disk, only: rolling_disk_type
    use tandem_option_rules, only: change_stepper, complete_options, conflict_type, find_conflict, projects_stages
    use tandem_options, only: basis_methods, chart_kinds, chart_policies, default_rtol, default_step, option_row_type, &
        option_visitor_type, options_type, projections, refresh_modes, singular_modes, steppers_without_estimate
    use tandem_pack, only: pack_type
    use tandem_chart, only: chart_memory_type, chart_type, goal_type, measure_type, step_end
    use tandem_chart_implicit, only: implicit_chart_type
    use tandem_profile_ledger, only: mark_type, profile_type
    use tandem_profile_observer, only: profiled_observer_type
    use tandem_profile_parts, only: n_part_groups, n_parts, part_blocks, part_checkpoint, part_group, part_group_name, part_name, &
        part_open, part_rows, part_start, part_watch, terms_of_part
    use tandem_simulate_error_warnings, only: allowed_error, find_error_warnings, short_run
    use tandem_simulate_crossing_data, only: crossing_record_type
    use tandem_simulate_event, only: event_record_type, event_type, threshold_event_type
    use tandem_simulate_assembly, only: assemble, assembly_type, velocity_metrics
    use tandem_simulate_figures, only: figure_reader_type, tell_figures
    use tandem_simulate_global_error, only: global_error_type
    use tandem_simulate_root, only: bracket_type
    use tandem_simulate_statistics, only: n_reasons, reason_name, statistics_type
    use tandem_simulate_warning, only: warning_type
    use tandem_simulation, only: at_end, at_event, at_start, at_step, observer_type, simulation_type
    use tandem_status, only: is_input_error, status_name, status_ok, status_output_failed
    use tandem_simulate_step_control, only: step_control_type
    use tandem_stepper, only: properties_type, stepper_type
    use tandem_stepper_explicit, only: explicit_type
    use tandem_stepper_implicit, only: implicit_type
    use tandem_stepper_factory, only: new_stepper, stepper_choices, stepper_names
    use tandem_stepper_state, only: state_type
    implicit none (type, external)
    private

    public :: wp, long
    public :: error_type, set_error, to_text, is_input_error, status_name, status_ok, status_output_failed
    public :: model_type, procedure_model_type, pattern_type, quantity_type, label_length, terms_type, n_terms, term_name
    public :: need_phi, need_jacobian, need_nu, need_gamma, need_mass, need_force
    public :: derivatives_type, n_derivatives, derivative_name, need_all_derivatives
    public :: need_velocity_q, need_acceleration_q, need_acceleration_qd, need_dynamics_q, need_dynamics_qd
    public :: finding_type, verify_model
    public :: options_type, option_row_type, option_visitor_type, basis_methods, chart_kinds, chart_policies, projections, &
        refresh_modes, singular_modes, steppers_without_estimate, default_rtol, default_step
    public :: change_stepper, complete_options, conflict_type, find_conflict, projects_stages
    public :: simulation_type, observer_type, at_start, at_step, at_end, at_event
    public :: crossing_record_type, event_type, event_record_type, threshold_event_type
    public :: statistics_type, n_reasons, reason_name, figure_reader_type, tell_figures, warning_type
    public :: bracket_type
    public :: assembly_type, assemble, velocity_metrics
    public :: global_error_type, find_error_warnings, allowed_error, short_run
    public :: profile_type, mark_type, profiled_observer_type
    public :: chart_type, implicit_chart_type, chart_memory_type, goal_type, measure_type, step_end
    public :: n_parts, part_name, part_group, n_part_groups, part_group_name, terms_of_part
    public :: part_start, part_watch, part_rows, part_blocks, part_checkpoint, part_open
    public :: pack_type
    public :: floquet_type, inputs_type, channel_length
    public :: linearisation_type, at_equilibrium, in_steady_motion, at_an_instant, kind_name, most_linearised
    public :: nearest_type, most_nearest
    public :: spectrum_type, of_motion, of_symmetry, of_family, cause_name
    public :: is_asymptotically_stable, is_marginal, is_unstable, stability_name
    public :: symmetry_type, affine_motion_type, motion_name_length, list_motions, equilibrium_search_type, any_motion, &
        find_steady_from_words
    public :: properties_type, stepper_type, explicit_type, implicit_type, state_type, step_control_type, new_stepper, &
        stepper_choices, stepper_names
    public :: expression_type, parse_expression, check_name, resolve_parameters, table_type, table_kinds, table_ends
    public :: entries_type, entry_type, value_type, atom_type, is_number, is_text, is_truth, is_other, build_mechanism, shown_type
    public :: reader_type, fault_type, anything, positive, not_negative
    public :: drawing_type, take_drawing, mechanism_kinds, mechanism_singles, census_type, element_count_type, take_census
    public :: mechanism_type, plane_type, friction_law_type
    public :: function_type, constant_type, polynomial_type, sine_type, ramp, expression_function, table_function, &
        law_type, expression_law, table_law
    public :: articulated_vehicle_type, motorcycle_type, rolling_disk_type
end module tandem
