! SPDX-License-Identifier: MIT
!> State of a model: everything that a run or an analysis changes, except for the current segment and for parameters.
module tandem_model_state
    use tandem_kinds, only: wp
    use tandem_model_timer, only: timer_type
    implicit none (type, external)
    private

    public :: model_state_type

    type :: model_state_type
        !> Time up to which the breakpoints of the model are complete. Set by models that search for breakpoints during a run, see
        !> `know_breakpoints`.
        real(wp) :: breakpoints_until = huge(1.0_wp)
        !> Quantities currently requested from `measure`; not allocated: all.
        logical, allocatable :: asked(:)
        !> Values of `measure` at the point at which events are currently evaluated; allocated only while they are valid.
        real(wp), allocatable :: shown(:)
        !> Time integrals that `measure` uses, zero at the start. The caller integrates `integrands` and sets them before each call.
        !> Not allocated if there are none.
        real(wp), allocatable :: integrals(:)
        !> Impulses of the rows (nh + nd) at the last velocity jump by an event; allocated only by models that report them.
        real(wp), allocatable :: impulses(:)
        !> Inputs of the linearised system (0:2, inputs). If allocated, procedures of the model add them to the value and to the
        !> first two derivatives of the functions in `input_name`. Every change of `input` changes the version.
        real(wp), allocatable :: input(:, :)
        integer :: input_version = 0
        !> Timer of the calls, see `profile_type`; not associated if calls are not timed.
        class(timer_type), pointer :: timer => null()
    end type model_state_type
end module tandem_model_state
