! SPDX-License-Identifier: MIT
!> Comparison of a caller's procedures with differences. The report uses the notation of the caller's language: the first wrong
!> procedure, the entry, and both values.
module tandem_legacy_comparison
    use tandem_error, only: error_type, set_error, to_text
    use tandem_kinds, only: wp
    use tandem_legacy_callback_model, only: callback_model_type
    use tandem_model, only: label_length
    use tandem_model_segment, only: find_segment
    use tandem_model_terms, only: need_nu
    use tandem_model_verification, only: finding_type, verify_model
    use tandem_status, only: status_invalid_model, status_invalid_option
    use, intrinsic :: ieee_arithmetic, only: ieee_is_finite
    implicit none (type, external)
    private

    public :: compare_procedures

    !> Number of random states near the given state, as in `tandem check`.
    integer, parameter :: n_states = 10
    !> Length of the description of an entry.
    integer, parameter :: place_length = label_length + 48

contains

    !> Compare every procedure of a model with differences of other procedures near (t, q, qd). A running simulation of the model is
    !> not affected.
    subroutine compare_procedures(model, t, q, qd, error)
        class(callback_model_type), intent(inout), target :: model
        !> Time, coordinates and velocities (n).
        real(wp), intent(in) :: t, q(:), qd(:)
        !> invalid_option if t, q or qd is not finite; invalid_model if a procedure is missing or wrong; otherwise the status of a
        !> procedure that could not be evaluated.
        type(error_type), allocatable, intent(out) :: error
        type(finding_type), allocatable :: findings(:)
        integer :: segment

        if (.not. (ieee_is_finite(t) .and. all(ieee_is_finite(q)) .and. all(ieee_is_finite(qd)))) then
            call set_error(error, status_invalid_option, 'the time, q or qd is not finite', 'use finite numbers')
            return
        end if
        segment = model%segment
        call find_segment(model, t, error)
        if (.not. allocated(error)) call verify_model(model, t, q, qd, n_states, findings, error)
        model%segment = segment
        if (.not. allocated(error)) call report_first(model, t, findings, error)
    end subroutine compare_procedures

    !> Report the first wrong procedure, since errors of later procedures may have the same cause, and the number of wrong ones.
    subroutine report_first(model, t, findings, error)
        class(callback_model_type), intent(in) :: model
        real(wp), intent(in) :: t
        type(finding_type), intent(in) :: findings(:)
        type(error_type), allocatable, intent(out) :: error
        character(len=60) :: others
        integer :: first

        first = findloc(findings%passed, .false., dim=1)
        if (first == 0) return
        associate (finding => findings(first))
            if (finding%stat /= 0) then
                call set_error(error, finding%stat, 'the '//trim(finding%name)//' near t = '//to_text(t), &
                    'use a state where q may change by a tenth of coordinate_scale, qd by coordinate_scale, and t by 0.3')
                return
            end if
            if (.not. ieee_is_finite(finding%value)) then
                call set_error(error, status_invalid_model, trim(finding%name)//' gives '//to_text(finding%value)//': '// &
                    trim(location(model, finding))//' near the state', 'it must return finite numbers there, or the status 1')
                return
            else if (.not. ieee_is_finite(finding%expected)) then
                ! The compared procedure is not at fault: a value required for the differences is NaN.
                call set_error(error, status_invalid_model, trim(finding%name)//' cannot be compared: '// &
                    trim(source(model, finding))//' '//to_text(finding%expected)//' for '//trim(location(model, finding)), &
                    'check whether terms overflow in these units')
                return
            end if
            others = ''
            if (count(.not. findings%passed) > 1) others = '; '//to_text(count(.not. findings%passed) - 1)// &
                ' more are wrong, perhaps for that reason'
            call set_error(error, status_invalid_model, trim(subject(model, finding))//' by '// &
                to_text(finding%error)//' of its largest entry: '//trim(location(model, finding))//' is '// &
                to_text(finding%value)//', '//trim(source(model, finding))//' '//to_text(finding%expected)//trim(others), &
                'correct it, or the procedure that it is compared with')
        end associate
    end subroutine report_first

    !> Subject of the message.
    pure function subject(model, finding) result(text)
        class(callback_model_type), intent(in) :: model
        type(finding_type), intent(in) :: finding
        character(len=80) :: text

        select case (finding%name)
        case ('mass_matrix (symmetry)')
            text = 'mass_matrix is not symmetric,'
        case ('mass_blocks')
            text = 'mass_matrix is not zero outside of mass_blocks,'
        case ('holonomic_rate')
            text = 'holonomic_rate is wrong'
            if (.not. associated(model%holonomic_rate) .and. iand(model%provides, need_nu) == 0) then
                text = 'holonomic depends on the time, and holonomic_rate is missing: off'
            end if
        case default
            text = trim(finding%name)//' is wrong'
        end select
    end function subject

    !> Entry in the notation of the caller's language, and the constraint to which it belongs.
    pure function location(model, finding) result(text)
        class(callback_model_type), intent(in) :: model
        type(finding_type), intent(in) :: finding
        character(len=place_length) :: text

        text = entry_text(model%by_rows, finding%row, finding%column)
        select case (finding%name)
        case ('holonomic_jacobian', 'holonomic_rate', 'constraint_acceleration', 'jacobian_derivative', 'nu_derivative', &
            'gamma_q', 'gamma_qd')
            text = trim(text)//' (constraint "'//model%row_name(finding%row)//'")'
        case default ! Rows of the others are coordinates.
        end select
    end function location

    !> Indices of an entry, as [0][2] in C and (1,3) in Fortran.
    pure function entry_text(by_rows, row, column) result(text)
        logical, intent(in) :: by_rows
        !> Row and column from 1; column 0 for a vector.
        integer, intent(in) :: row, column
        character(len=40) :: text

        if (by_rows) then
            text = 'entry ['//to_text(row - 1)//']'
            if (column > 0) text = trim(text)//'['//to_text(column - 1)//']'
        else
            text = 'entry ('//to_text(row)
            if (column > 0) text = trim(text)//','//to_text(column)
            text = trim(text)//')'
        end if
    end function entry_text

    !> Source of the expected value.
    pure function source(model, finding) result(text)
        class(callback_model_type), intent(in) :: model
        type(finding_type), intent(in) :: finding
        character(len=64) :: text

        select case (finding%name)
        case ('holonomic_jacobian', 'holonomic_rate')
            text = 'differences of holonomic give'
        case ('constraint_acceleration')
            text = 'differences of the Jacobians and right sides give'
        case ('jacobian_derivative', 'reaction_derivative')
            text = 'differences of the Jacobians give'
        case ('nu_derivative')
            text = 'differences of holonomic_rate and nonholonomic_rhs give'
        case ('gamma_q', 'gamma_qd')
            text = 'differences of constraint_acceleration give'
        case ('force_q', 'force_qd')
            text = 'differences of the forces give'
        case ('mass_derivative')
            text = 'differences of mass_matrix give'
        case ('mass_matrix (symmetry)')
            text = trim(entry_text(model%by_rows, finding%column, finding%row))//' is'
        case default
            text = 'it should be'
        end select
    end function source
end module tandem_legacy_comparison
