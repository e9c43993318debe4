! SPDX-License-Identifier: MIT
!> Checks that a model is complete: sizes are valid, required procedures are present, and lists have the right length.
module tandem_model_check
    use tandem_error, only: error_type, set_error, to_text
    use tandem_model, only: model_type
    use tandem_model_procedures, only: procedure_model_type
    use tandem_model_terms, only: need_force, need_jacobian, need_mass, need_phi
    use tandem_model_timer, only: of_force_q, of_force_qd
    use tandem_kinds, only: long, wp
    use tandem_status, only: status_invalid_model
    use, intrinsic :: ieee_arithmetic, only: ieee_is_finite
    implicit none (type, external)
    private

    public :: check_model

contains

    !> Refuse an incomplete model. The message names the missing part.
    subroutine check_model(model, error)
        class(model_type), intent(in) :: model
        type(error_type), allocatable, intent(out) :: error

        call check_sizes(model, error)
        if (.not. allocated(error)) call check_procedures(model, error)
        if (.not. allocated(error)) call check_friction(model, error)
        if (.not. allocated(error)) call check_lists(model, error)
        if (.not. allocated(error)) call check_breakpoints(model, error)
        if (.not. allocated(error)) call check_pattern(model, error)
    end subroutine check_model

    subroutine check_sizes(model, error)
        class(model_type), intent(in) :: model
        type(error_type), allocatable, intent(out) :: error

        if (model%n < 1) then
            call refuse('n = '//to_text(model%n)//' coordinates', 'a model has at least one coordinate', error)
        else if (model%n_holonomic < 0 .or. model%n_nonholonomic < 0) then
            call refuse('n_holonomic = '//to_text(model%n_holonomic)//' and n_nonholonomic = '// &
                to_text(model%n_nonholonomic), 'numbers of constraints are not negative', error)
        else if (model%n_holonomic > model%n - model%n_nonholonomic .and. .not. model%rows_may_repeat) then
            call refuse(to_text(model%n_holonomic)//' holonomic and '//to_text(model%n_nonholonomic)// &
                ' nonholonomic constraints on '//to_text(model%n)//' coordinates', &
                'there are at most as many constraints as coordinates', error)
        end if
    end subroutine check_sizes

    subroutine check_procedures(model, error)
        class(model_type), intent(in) :: model
        type(error_type), allocatable, intent(out) :: error
        !> True for each required procedure that the model has, whether fused or single.
        logical :: has(4)

        if (model%provides /= 0 .and. .not. associated(model%evaluate)) then
            call refuse('provides is set, but the procedure evaluate is missing', 'associate it', error)
            return
        end if
        if (model%provides_derivatives /= 0 .and. .not. associated(model%evaluate_derivatives)) then
            call refuse('provides_derivatives is set, but the procedure evaluate_derivatives is missing', 'associate it', error)
            return
        end if
        has = .false.
        select type (model)
        class is (procedure_model_type)
            has = [associated(model%holonomic), associated(model%holonomic_jacobian), associated(model%nonholonomic_jacobian), &
                associated(model%mass_matrix)]
            if (associated(model%holonomic_rate) .and. model%n_holonomic == 0) then
                call refuse('holonomic_rate is associated, but n_holonomic = 0', 'remove one of them', error)
            else if (associated(model%nonholonomic_rhs) .and. model%n_nonholonomic == 0) then
                call refuse('nonholonomic_rhs is associated, but n_nonholonomic = 0', 'remove one of them', error)
            end if
        end select
        call require(model%n_holonomic > 0, need_phi, has(1), 'holonomic')
        call require(model%n_holonomic > 0, need_jacobian, has(2), 'holonomic_jacobian')
        call require(model%n_nonholonomic > 0, need_jacobian, has(3), 'nonholonomic_jacobian')
        call require(.true., need_mass, has(4), 'mass_matrix')

    contains

        subroutine require(needed, bit, has_procedure, name)
            logical, intent(in) :: needed, has_procedure
            integer, intent(in) :: bit
            character(len=*), intent(in) :: name

            if (allocated(error) .or. .not. needed .or. has_procedure .or. iand(model%provides, bit) /= 0) return
            call refuse('the procedure '//name//' is missing', 'associate it, or let evaluate provide it', error)
        end subroutine require
    end subroutine check_procedures

    subroutine check_friction(model, error)
        class(model_type), intent(in) :: model
        type(error_type), allocatable, intent(out) :: error

        if (model%n_frictions < 0) then
            call refuse('n_frictions = '//to_text(model%n_frictions), 'numbers of frictions are not negative', error)
        else if (model%n_frictions > 0 .and. (model%gives(of_force_q) .or. model%gives(of_force_qd))) then
            call refuse('force_q and force_qd do not contain friction on reactions', &
                'evaluate_derivatives must return the sums, or nothing', error)
        else if (model%n_frictions > 0 .and. iand(model%has_terms(), need_force) == 0) then
            call refuse('friction on reactions requires applied forces', 'associate applied_force', error)
        end if
    end subroutine check_friction

    subroutine check_lists(model, error)
        class(model_type), intent(in) :: model
        type(error_type), allocatable, intent(out) :: error

        if (allocated(model%coordinate_name)) call check_length('coordinate_name', size(model%coordinate_name), model%n)
        if (allocated(model%coordinate_unit)) call check_length('coordinate_unit', size(model%coordinate_unit), model%n)
        if (allocated(model%holonomic_name)) call check_length('holonomic_name', size(model%holonomic_name), model%n_holonomic)
        if (allocated(model%nonholonomic_name)) then
            call check_length('nonholonomic_name', size(model%nonholonomic_name), model%n_nonholonomic)
        end if
        if (allocated(model%multiplier_unit)) then
            call check_length('multiplier_unit', size(model%multiplier_unit), model%n_constraints())
        end if
        if (.not. (model%time_scale > 0.0_wp .and. ieee_is_finite(model%time_scale))) then
            call refuse('time_scale is not positive and finite', 'give a typical time of the motion', error)
            return
        end if
        if (allocated(model%coordinate_scale)) then
            call check_length('coordinate_scale', size(model%coordinate_scale), model%n)
            if (allocated(error)) return
            if (.not. all(model%coordinate_scale > 0.0_wp .and. ieee_is_finite(model%coordinate_scale))) then
                call refuse('an entry of coordinate_scale is not positive and finite', 'give typical magnitudes', error)
            end if
        end if

        if (allocated(model%mass_blocks)) then
            if (any(model%mass_blocks < 1) .or. sum(int(model%mass_blocks, long)) /= model%n) then
                call refuse('mass_blocks are not positive sizes that add up to n', &
                    'give the size of each diagonal block of M', error)
            end if
        end if

    contains

        subroutine check_length(name, found, expected)
            character(len=*), intent(in) :: name
            integer, intent(in) :: found, expected

            if (allocated(error) .or. found == expected) return
            call refuse(name//' has '//to_text(found)//' entries instead of '//to_text(expected), 'give one for each', error)
        end subroutine check_length
    end subroutine check_lists

    subroutine check_breakpoints(model, error)
        class(model_type), intent(in) :: model
        type(error_type), allocatable, intent(out) :: error
        integer :: n

        if (allocated(model%nu_jumps)) then
            n = 0
            if (allocated(model%breakpoints)) n = size(model%breakpoints)
            if (size(model%nu_jumps) /= n) call refuse('nu_jumps has '//to_text(size(model%nu_jumps))// &
                ' entries instead of '//to_text(n), 'give one per breakpoint', error)
        end if
        if (allocated(error) .or. .not. allocated(model%breakpoints)) return
        n = size(model%breakpoints)
        if (.not. all(ieee_is_finite(model%breakpoints)) .or. any(model%breakpoints(2:) <= model%breakpoints(:n - 1))) then
            call refuse('the breakpoints do not ascend', 'sort them and remove duplicates', error)
        end if
    end subroutine check_breakpoints

    !> Refuse a pattern that does not match the model, since a chart would compute a different motion.
    subroutine check_pattern(model, error)
        class(model_type), intent(in) :: model
        type(error_type), allocatable, intent(out) :: error
        character(len=120) :: fault

        if (.not. allocated(model%pattern)) return
        fault = model%pattern%find_fault(model%n, model%n_constraints())
        if (fault /= '') call refuse('the pattern of C and M does not match the model: '//trim(fault), &
            'correct the arguments of build of the pattern', error)
    end subroutine check_pattern

    subroutine refuse(problem, advice, error)
        character(len=*), intent(in) :: problem, advice
        type(error_type), allocatable, intent(out) :: error

        call set_error(error, status_invalid_model, problem, advice)
    end subroutine refuse
end module tandem_model_check
