! SPDX-License-Identifier: MIT
!> Builds a mechanism from a scene: the tables are converted to the keys of `build_mechanism`.
module tandem_io_scene_mechanism
    use tandem, only: build_mechanism, entries_type, error_type, mechanism_kinds, mechanism_singles, mechanism_type, model_type, &
        reader_type, shown_type, wp
    use tandem_io_scene_description, only: key_length
    implicit none (type, external)
    private

    public :: build_mechanism_scene, mechanism_tables

    !> Tables of a mechanism.
    character(len=key_length), parameter :: mechanism_tables(12) = [character(len=key_length) :: mechanism_singles, mechanism_kinds]

contains

    !> Build the mechanism and its start in the reference configuration. The table [scene] is open.
    subroutine build_mechanism_scene(reader, model, q, qd)
        class(reader_type), intent(inout) :: reader
        class(model_type), allocatable, intent(out) :: model
        !> Coordinates and velocities at the start (n).
        real(wp), allocatable, intent(out) :: q(:), qd(:)
        type(mechanism_type), allocatable :: mechanism
        type(entries_type) :: entries
        type(shown_type), allocatable :: shown(:)
        type(error_type), allocatable :: error
        logical :: planar
        real(wp) :: times(2)
        integer :: i, place

        planar = .false.
        call reader%get('planar', planar, 'true: bodies have x, y and angle; false: x, y, z and Euler parameters')
        call reader%open_table('model')
        call reader%close_table()
        if (reader%failed()) return
        call reader%entries%of_tables(mechanism_tables, entries)
        allocate (mechanism)
        ! Shown values from tables that are read later.
        times = [reader%entries%number_at('time.start'), reader%entries%number_at('time.end')]
        call build_mechanism(entries, planar, reader%entries%truth_at('initial.assemble'), times, mechanism, error, place, shown)
        if (allocated(error)) then
            call reader%refuse_at(place, error%message(index(error%message, ': ') + 2:))
            return
        end if
        do i = 1, size(shown)
            call reader%show(shown(i))
        end do
        allocate (q(mechanism%n), qd(mechanism%n))
        call mechanism%start(q, qd)
        call move_alloc(mechanism, model)
        call reader%open_table('initial')
    end subroutine build_mechanism_scene
end module tandem_io_scene_mechanism
