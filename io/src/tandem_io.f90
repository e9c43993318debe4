! SPDX-License-Identifier: MIT
!> Public interface of tandem-io, which re-exports entities of its modules.
module tandem_io
    use tandem_io_json, only: json_type
    use tandem_io_output_checkpoint, only: read_snapshot, snapshot_type
    use tandem_io_output_checksums, only: finding_type
    use tandem_io_output_drawing, only: write_drawing
    use tandem_io_output_fields, only: default_fields, field_names, output_type
    use tandem_io_output_linearisation, only: write_linearisation, write_nearest
    use tandem_io_output_modes, only: body_motions
    use tandem_io_output_observers, only: observer_list_type
    use tandem_io_output_target, only: check_target
    use tandem_io_output_trajectory, only: energy_type, trajectory_type
    use tandem_io_output_verification, only: verify_result
    use tandem_io_path, only: is_same_file
    use tandem, only: anything, not_negative, positive, reader_type
    use tandem_io_scene, only: interpret_scene, open_scene, read_scene, repeat_scene, scene_type
    use tandem_io_scene_description, only: description_type
    use tandem_io_scene_registry, only: scene_model_type, shipped_models
    use tandem_io_scene_shipped, only: find_scene, path_length, shipped_scenes
    use tandem_io_scene_text, only: listed, nearest_name, to_toml
    use tandem_io_study_cases, only: case_groups, case_names
    use tandem_io_study_journal, only: journal_type
    use tandem_io_study_measure, only: make_reference, prepare_scene
    use tandem_io_study_modes, only: at_meeting, at_pair, at_zero, critical_type, crossing_name, locus_point_type, modes_type
    use tandem_io_study_paper, only: paper_columns, paper_type
    use tandem_io_study_precision, only: precision_columns, precision_type
    use tandem_io_study_reference, only: read_reference, reference_type, write_reference
    use tandem_io_study_stability, only: select_cases, stability_columns, stability_type
    use tandem_io_study_table, only: brief, column_type, count_column, real_column, table_type
    use tandem_io_sweep_case, only: case_runner_type
    use tandem_io_sweep_file, only: read_sweep, settings_of
    use tandem_io_sweep_journal, only: sweep_journal_type
    use tandem_io_sweep_plan, only: plan_type
    use tandem_io_sweep_processes, only: cores, processes_type
    use tandem_io_sweep_record, only: name_of_status, record_type, words_of_record
    use tandem_io_sweep_schedule, only: distribute, watcher_type
    use tandem_io_sweep_summary, only: bins, column_summary_type, index_type, read_column, sensitivities, summarise
    use tandem_io_sweep_table, only: csv_path, indices_path, output_path, write_table
    use tandem_io_version, only: build_text, format_version, tandem_version
    implicit none (type, external)
    private

    public :: scene_type, read_scene, repeat_scene, description_type, open_scene, interpret_scene, find_scene, path_length, &
        shipped_scenes, scene_model_type, shipped_models, listed, nearest_name, to_toml
    public :: reader_type, anything, positive, not_negative
    public :: json_type
    public :: snapshot_type, read_snapshot
    public :: finding_type, verify_result
    public :: is_same_file
    public :: output_type, trajectory_type, energy_type, observer_list_type, field_names, default_fields
    public :: journal_type, table_type, column_type, count_column, real_column, brief
    public :: write_drawing, write_linearisation, write_nearest, body_motions, check_target
    public :: modes_type, locus_point_type, critical_type, at_zero, at_pair, at_meeting, crossing_name
    public :: paper_type, paper_columns
    public :: precision_type, precision_columns, reference_type, make_reference, prepare_scene, read_reference, &
        write_reference
    public :: stability_type, stability_columns, select_cases, case_groups, case_names
    public :: plan_type, read_sweep, settings_of, case_runner_type, record_type, name_of_status, sweep_journal_type, &
        processes_type, cores, distribute, watcher_type, write_table, csv_path, indices_path, output_path, bins, &
        column_summary_type, index_type, read_column, sensitivities, summarise, words_of_record
    public :: tandem_version, format_version, build_text
end module tandem_io
