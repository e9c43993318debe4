! SPDX-License-Identifier: MIT
!> Fields of a result file except the time, and their selection by a scene. All fields are listed in the table of this module.
module tandem_io_output_fields
    use tandem, only: model_type, wp
    implicit none (type, external)
    private

    public :: output_type, field_type, fields, field_names, field_length, default_fields, index_of
    public :: field_q, field_qd, field_qdd, field_lambda, field_position_error, field_velocity_error
    public :: field_acceleration_error, field_kinetic_energy, field_potential_energy, field_step, field_chart
    public :: one, each_coordinate, each_constraint

    !> Length of the name of a field.
    integer, parameter :: field_length = 24
    !> Numbers of a field per row: a single one, one per coordinate, or one per constraint.
    integer, parameter :: one = 0, each_coordinate = 1, each_constraint = 2

    !> Indices of `fields`.
    integer, parameter :: field_q = 1, field_qd = 2, field_qdd = 3, field_lambda = 4, field_position_error = 5
    integer, parameter :: field_velocity_error = 6, field_acceleration_error = 7, field_kinetic_energy = 8
    integer, parameter :: field_potential_energy = 9, field_step = 10, field_chart = 11

    !> A field of the result file.
    type :: field_type
        !> Name in scenes, and the group and name of its dataset.
        character(len=field_length) :: name, group
        !> `one`, `each_coordinate` or `each_constraint`.
        integer :: width
        !> True if the field is a count, which is stored as an integer.
        logical :: counts
        !> Power of one second in the unit of a field with width `each_coordinate`: 0 for positions, -1 for velocities, -2 for
        !> accelerations.
        integer :: rate
        !> Unit of a field with width `one`.
        character(len=8) :: unit
        !> Description of the field.
        character(len=80) :: meaning
    end type field_type

    type(field_type), parameter :: fields(11) = [ &
        field_type('q', 'trajectory', each_coordinate, .false., 0, '', 'generalized coordinates'), &
        field_type('qd', 'trajectory', each_coordinate, .false., -1, '', 'velocities, dq/dt'), &
        field_type('qdd', 'trajectory', each_coordinate, .false., -2, '', 'accelerations, d2q/dt2'), &
        field_type('lambda', 'trajectory', each_constraint, .false., 0, '', &
            'multipliers: M qdd + C^T lambda = S + Q_A, holonomic rows first'), &
        field_type('position_error', 'diagnostics', one, .false., 0, '1', &
            'max-norm of Phi, each row on its natural scale'), &
        field_type('velocity_error', 'diagnostics', one, .false., 0, '1', &
            'max-norm of C qd - nu, each row on its natural scale'), &
        field_type('acceleration_error', 'diagnostics', one, .false., 0, '1', &
            'max-norm of C qdd + gamma, each row on its natural scale'), &
        field_type('kinetic_energy', 'diagnostics', one, .false., 0, 'J', 'kinetic energy'), &
        field_type('potential_energy', 'diagnostics', one, .false., 0, 'J', 'potential energy'), &
        field_type('step', 'diagnostics', one, .false., 0, 's', 'size of the step that ended here, 0 if none did'), &
        field_type('chart', 'diagnostics', one, .true., 0, '1', 'running number of the chart, from 1')]

    !> Names of the fields.
    character(len=field_length), parameter :: field_names(size(fields)) = fields%name

    !> Default fields: quantities that the integration computes anyway.
    character(len=field_length), parameter :: default_fields(8) = [character(len=field_length) :: 'q', 'qd', 'qdd', &
        'position_error', 'velocity_error', 'acceleration_error', 'step', 'chart']

    !> Output requested by a scene.
    type :: output_type
        !> Path of the result file.
        character(len=:), allocatable :: file
        !> Number of grid steps between rows.
        integer :: every = 1
        !> Time between rows, which are interpolated by dense output; 0 for rows at steps according to `every`.
        real(wp) :: interval = 0.0_wp
        !> Largest time between rows at all steps and intermediate rows by dense output; 0 for no intermediate rows.
        real(wp) :: spacing = 0.0_wp
        !> Wall time after which rows and the state of the run are written to the disk, seconds; 0 to write after every step.
        real(wp) :: flush = 1.0_wp
        !> Names of the fields.
        character(len=field_length), allocatable :: fields(:)
    contains
        procedure :: asks_for, problem
    end type output_type

contains

    !> True if a field is requested.
    pure logical function asks_for(self, field)
        class(output_type), intent(in) :: self
        !> Index in `fields`.
        integer, intent(in) :: field

        asks_for = .false.
        if (allocated(self%fields)) asks_for = any(self%fields == fields(field)%name)
    end function asks_for

    !> Reason why the requested fields are invalid; empty if they are valid.
    pure function problem(self, model) result(text)
        class(output_type), intent(in) :: self
        !> Model of the run.
        class(model_type), intent(in) :: model
        character(len=:), allocatable :: text
        integer :: i

        text = ''
        if (.not. allocated(self%fields)) return
        do i = 1, size(self%fields)
            if (.not. any(self%fields(i) == field_names)) text = 'contain "'//trim(self%fields(i))//'", which does not exist'
        end do
        if (self%asks_for(field_potential_energy) .and. .not. associated(model%potential_energy)) then
            text = 'contain potential_energy, which the model does not have'
        end if
        if (self%asks_for(field_lambda) .and. model%n_constraints() == 0) then
            text = 'contain lambda, but the model has no constraints'
        end if
    end function problem

    !> Index of the field with a name; 0 if unknown.
    pure integer function index_of(name)
        character(len=field_length), intent(in) :: name

        index_of = findloc(field_names, name, dim=1)
    end function index_of
end module tandem_io_output_fields
