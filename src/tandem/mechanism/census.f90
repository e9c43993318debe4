! SPDX-License-Identifier: MIT
!> Composition of a mechanism: the rows of each element, the redundant rows at a state, and the degrees of freedom at position and
!> at velocity level. For reports; these procedures allocate.
module tandem_mechanism_census
    use tandem_kinds, only: wp
    use tandem_linalg_dependence, only: split_rows
    use tandem_mechanism, only: mechanism_type
    use tandem_mechanism_joint, only: name_length
    use tandem_model_terms, only: need_jacobian, terms_type
    use tandem_saddle_sparse, only: sparse_saddle_type
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
    !> Rows whose squared distances from each other are above this part of their squared lengths do not depend on each other.
    real(wp), parameter :: clearly = 1.0e-6_wp
    !> Full matrices of more coordinates take minutes.
    integer, parameter :: most_full = 1000

contains

    !> Count rows and freedoms at a state. The status is that of the evaluation.
    subroutine take_census(mechanism, t, q, qd, census, stat)
        !> `define` has been called.
        class(mechanism_type), intent(inout) :: mechanism
        real(wp), intent(in) :: t, q(:), qd(:)
        type(census_type), intent(out) :: census
        integer, intent(out) :: stat
        logical, allocatable :: is_redundant(:)
        integer :: i, k, m, n, rank, rank_of_phi

        stat = 0
        m = mechanism%n_constraints()
        n = count(.not. mechanism%is_idle())
        census%position_freedom = n
        census%velocity_freedom = n
        allocate (census%elements(0))
        if (m == 0) return
        call find_redundant(mechanism, t, q, qd, rank_of_phi, rank, is_redundant, stat)
        if (stat /= 0) return
        census%position_freedom = n - rank_of_phi
        census%velocity_freedom = n - rank
        do i = 1, m
            k = element_of(mechanism, i, census)
            associate (element => census%elements(k))
                if (i <= mechanism%n_holonomic) element%n_position = element%n_position + 1
                if (i > mechanism%n_holonomic) element%n_velocity = element%n_velocity + 1
                if (is_redundant(i)) element%n_redundant = element%n_redundant + 1
            end associate
        end do
    end subroutine take_census

    !> The ranks of Phi_q and of C, and which rows repeat others. Sparse factors say at once that there are none; those that
    !> there are, are chosen by full matrices, as long as these are not too large.
    subroutine find_redundant(mechanism, t, q, qd, rank_of_phi, rank, is_redundant, stat)
        class(mechanism_type), intent(inout), target :: mechanism
        real(wp), intent(in) :: t, q(:), qd(:)
        integer, intent(out) :: rank_of_phi, rank
        logical, allocatable, intent(out) :: is_redundant(:)
        integer, intent(out) :: stat
        type(terms_type) :: terms
        type(sparse_saddle_type) :: rows
        real(wp) :: ones(mechanism%n)
        logical :: is_known

        ones = 1.0_wp
        rank_of_phi = 0
        is_known = allocated(mechanism%pattern)
        if (is_known) then
            allocate (terms%jacobian(mechanism%n_constraints(), mechanism%pattern%width), source=0.0_wp)
            terms%is_compressed = .true.
            call mechanism%evaluate(need_jacobian, t, q, qd, terms, stat)
            if (stat /= 0) return
            call rows%analyse(mechanism%pattern, ones)
            rows%drops_dependent = .true.
            call rows%load_rows(terms%jacobian, is_full=.false.)
            call rows%factor(stat)
            is_known = stat == 0 .and. (mechanism%n > most_full .or. (.not. any(rows%is_out) .and. &
                rows%independence() > clearly))
            if (is_known) then
                is_redundant = rows%is_out
                rank = count(.not. is_redundant)
                rank_of_phi = mechanism%n_holonomic
                if (any(is_redundant)) then
                    call rows%load_rows(terms%jacobian(:rank_of_phi, :), is_full=.false.)
                    call rows%factor(stat)
                    rank_of_phi = count(.not. rows%is_out)
                end if
            end if
            deallocate (terms%jacobian)
            stat = 0
        end if
        if (.not. is_known) call split(mechanism, t, q, qd, rank_of_phi, rank, is_redundant, stat)
    end subroutine find_redundant

    !> The same by full matrices.
    subroutine split(mechanism, t, q, qd, rank_of_phi, rank, is_redundant, stat)
        class(mechanism_type), intent(inout) :: mechanism
        real(wp), intent(in) :: t, q(:), qd(:)
        integer, intent(out) :: rank_of_phi, rank
        logical, allocatable, intent(out) :: is_redundant(:)
        integer, intent(out) :: stat
        type(terms_type) :: terms
        real(wp), allocatable :: combination(:, :)
        real(wp) :: ones(mechanism%n)
        integer, allocatable :: kept(:), dropped(:)

        ones = 1.0_wp
        rank_of_phi = 0
        rank = 0
        allocate (is_redundant(mechanism%n_constraints()), source=.false.)
        allocate (terms%jacobian(mechanism%n_constraints(), mechanism%n), source=0.0_wp)
        call mechanism%evaluate(need_jacobian, t, q, qd, terms, stat)
        if (stat /= 0) return
        associate (nh => mechanism%n_holonomic)
            if (nh > 0) then
                call split_rows(terms%jacobian(:nh, :), ones, nh, dependent, kept, dropped, combination)
                rank_of_phi = size(kept)
            end if
            call split_rows(terms%jacobian, ones, nh, dependent, kept, dropped, combination)
        end associate
        rank = size(kept)
        is_redundant(dropped) = .true.
    end subroutine split

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
