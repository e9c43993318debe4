! SPDX-License-Identifier: MIT
!> Composition of a mechanism: the rows of each element, the redundant rows at a state, and the degrees of freedom at position and
!> at velocity level. For reports; these procedures allocate.
module tandem_mechanism_census
    use tandem_kinds, only: wp
    use tandem_linalg_dependence, only: split_rows
    use tandem_mechanism, only: mechanism_type
    use tandem_mechanism_joint, only: name_length
    use tandem_model_terms, only: need_jacobian, terms_type
    implicit none (type, external)
    private

    public :: census_type, element_count_type, take_census

    !> An element with rows.
    type :: element_count_type
        character(len=name_length) :: name = ''
        !> Kind, such as revolute; empty if the name is sufficient.
        character(len=16) :: kind = ''
        !> Numbers of rows at position level, of rows at velocity level, and of redundant rows.
        integer :: n_position = 0, n_velocity = 0, n_redundant = 0
    end type element_count_type

    !> The rows of all elements of a mechanism, and its degrees of freedom.
    type :: census_type
        type(element_count_type), allocatable :: elements(:)
        !> n minus the number of idle coordinates minus the rank of Phi_q; the same with the rank of C.
        integer :: position_freedom = 0, velocity_freedom = 0
    end type census_type

    !> Rows of unit length are dependent if the remainder of one is smaller than this, as in the rank decision of charts.
    real(wp), parameter :: dependent = 1.0e-10_wp

contains

    !> Count rows and freedoms at a state. The status is that of the evaluation.
    subroutine take_census(mechanism, t, q, qd, census, stat)
        !> `define` has been called.
        class(mechanism_type), intent(inout) :: mechanism
        real(wp), intent(in) :: t, q(:), qd(:)
        type(census_type), intent(out) :: census
        integer, intent(out) :: stat
        type(terms_type) :: terms
        real(wp), allocatable :: combination(:, :), ones(:)
        integer, allocatable :: kept(:), dropped(:)
        integer :: i, k, m, n

        stat = 0
        m = mechanism%n_constraints()
        n = count(.not. mechanism%is_idle())
        census%position_freedom = n
        census%velocity_freedom = n
        allocate (census%elements(0), dropped(0))
        if (m == 0) return
        allocate (terms%jacobian(m, mechanism%n))
        call mechanism%evaluate(need_jacobian, t, q, qd, terms, stat)
        if (stat /= 0) return
        allocate (ones(mechanism%n), source=1.0_wp)
        associate (nh => mechanism%n_holonomic)
            if (nh > 0) then
                call split_rows(terms%jacobian(:nh, :), ones, nh, dependent, kept, dropped, combination)
                census%position_freedom = n - size(kept)
            end if
            call split_rows(terms%jacobian, ones, nh, dependent, kept, dropped, combination)
            census%velocity_freedom = n - size(kept)
            do i = 1, m
                k = element_of(mechanism, i, census)
                associate (element => census%elements(k))
                    if (i <= nh) element%n_position = element%n_position + 1
                    if (i > nh) element%n_velocity = element%n_velocity + 1
                    if (any(dropped == i)) element%n_redundant = element%n_redundant + 1
                end associate
            end do
        end associate
    end subroutine take_census

    !> Index of the element of a row, whose name begins with that of the element; all norms of Euler parameters are one element.
    integer function element_of(mechanism, row, census) result(k)
        class(mechanism_type), intent(in) :: mechanism
        integer, intent(in) :: row
        type(census_type), intent(inout) :: census
        type(element_count_type) :: element
        character(len=:), allocatable :: name
        integer :: i

        name = mechanism%row_name(row)
        if (row <= mechanism%n_holonomic .and. index(name, ' norm') > 0) then
            element%name = 'Euler parameters'
        else
            element%name = name(:index(name//' ', ' ') - 1)
        end if
        do k = 1, size(census%elements)
            if (census%elements(k)%name == element%name) return
        end do
        do i = 1, size(mechanism%joints)
            if (mechanism%joints(i)%name == element%name) element%kind = mechanism%joints(i)%kind_name
        end do
        census%elements = [census%elements, element]
    end function element_of
end module tandem_mechanism_census
