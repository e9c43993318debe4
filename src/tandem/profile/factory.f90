! SPDX-License-Identifier: MIT
!> The chart that a run would get, as one that books its time.
module tandem_profile_factory
    use tandem_chart, only: chart_type
    use tandem_chart_factory, only: wants_sparse
    use tandem_model, only: model_type
    use tandem_options, only: options_type
    use tandem_profile_chart, only: profiled_chart_type
    use tandem_profile_ledger, only: profile_type
    use tandem_profile_sparse_chart, only: profiled_sparse_chart_type => profiled_chart_type
    use tandem_stepper, only: properties_type, stepper_type
    use tandem_stepper_factory, only: new_stepper, stepper_choices
    implicit none (type, external)
    private

    public :: new_profiled_chart

contains

    !> For `initialize` of the simulation.
    subroutine new_profiled_chart(model, options, profile, chart)
        class(model_type), intent(in) :: model
        type(options_type), intent(in) :: options
        !> Where the time is booked; it must outlive the simulation.
        type(profile_type), intent(in), target :: profile
        class(chart_type), allocatable, intent(out) :: chart
        class(stepper_type), allocatable :: stepper
        type(properties_type) :: method
        type(profiled_chart_type) :: dense
        type(profiled_sparse_chart_type) :: sparse
        logical :: is_sparse

        is_sparse = .false.
        if (any(stepper_choices == options%stepper)) then
            call new_stepper(options%stepper, stepper)
            method = stepper%properties()
            is_sparse = wants_sparse(model, options, method%implicit)
        end if
        if (is_sparse) then
            sparse%profile => profile
            allocate (chart, source=sparse)
        else
            dense%profile => profile
            allocate (chart, source=dense)
        end if
    end subroutine new_profiled_chart
end module tandem_profile_factory
