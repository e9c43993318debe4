! SPDX-License-Identifier: MIT
!> State of a model: all that a run or an analysis changes besides the current segment, and that is no parameter of the model.
module tandem_model_state
    use tandem_kinds, only: wp
    use tandem_model_timer, only: timer_type
    implicit none (type, external)
    private

    public :: model_state_type

    type :: model_state_type
        !> Time up to which the breakpoints of the model are complete; set by a model that searches during a run, see
        !> `know_breakpoints`.
        real(wp) :: breakpoints_until = huge(1.0_wp)
        !> Quantities currently requested from `measure`; not allocated: all.
        logical, allocatable :: asked(:)
        !> Values of `measure` for the current evaluation of events; allocated only while they are those of the point.
        real(wp), allocatable :: shown(:)
        !> Time integrals used by `measure`, zero at the start: the caller integrates `integrands`, and sets them before the call.
        !> Not allocated: none.
        real(wp), allocatable :: integrals(:)
        !> Impulses of the rows (nh + nd) at the last velocity jump by an event; allocated only by a model that reports them.
        real(wp), allocatable :: impulses(:)
        !> Inputs of the linearised system (0:2, inputs): if allocated, the model's procedures add them to the value and the first
        !> two derivatives of the functions in `input_name`. The version changes with every change of `input`.
        real(wp), allocatable :: input(:, :)
        integer :: input_version = 0
        !> Timer of the calls, see `profile_type`; not associated: none.
        class(timer_type), pointer :: timer => null()
    end type model_state_type
end module tandem_model_state
