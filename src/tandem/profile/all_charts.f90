! SPDX-License-Identifier: MIT
!> List of all charts with time measurement.
submodule(tandem_profile_factory) tandem_profile_all
    use tandem_chart_factory, only: choose_chart, cost_type
    use tandem_profile_chart, only: profiled_chart_type
    use tandem_profile_sparse_chart, only: profiled_sparse_chart_type => profiled_chart_type
    use tandem_stepper, only: properties_type, stepper_type
    use tandem_stepper_factory, only: new_stepper, stepper_choices
    implicit none (type, external)

contains

    module procedure new_profiled_chart
        class(stepper_type), allocatable :: stepper
        type(properties_type) :: method
        type(profiled_chart_type) :: dense
        type(profiled_sparse_chart_type) :: sparse
        type(cost_type) :: cost
        logical :: is_sparse

        is_sparse = .false.
        if (any(stepper_choices == options%stepper)) then
            call new_stepper(options%stepper, stepper)
            method = stepper%properties()
            call choose_chart(model, options, method%implicit, t, q, qd, is_sparse, cost)
        end if
        if (is_sparse) then
            sparse%profile => profile
            allocate (chart, source=sparse)
        else
            dense%profile => profile
            allocate (chart, source=dense)
        end if
    end procedure new_profiled_chart
end submodule tandem_profile_all
