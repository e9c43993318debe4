! SPDX-License-Identifier: MIT
!> The terms of a model at a point, gathered without the library's evaluator.
module terms_at
    use tandem, only: model_type, need_force, need_gamma, need_jacobian, need_mass, need_nu, need_phi, terms_type, wp
    implicit none (type, external)
    private

    public :: get_terms, all_terms

    !> Every term.
    integer, parameter :: all_terms = need_phi + need_jacobian + need_nu + need_gamma + need_mass + need_force

contains

    !> Every term of a model at (t, q, qd); stat is the status of the first call that failed, or 0.
    subroutine get_terms(model, t, q, qd, terms, stat)
        class(model_type), intent(inout) :: model
        real(wp), intent(in) :: t, q(:), qd(:)
        type(terms_type), intent(inout) :: terms
        integer, intent(out) :: stat
        real(wp) :: part(size(q))
        integer :: failed, rest

        stat = 0
        call terms%allocate(model%n, model%n_holonomic, model%n_nonholonomic)
        if (associated(model%evaluate)) call model%evaluate(model%provides, t, q, qd, terms, stat)
        rest = iand(model%has_terms(), not(model%provides))
        if (stat == 0 .and. rest /= 0) call model%evaluate_single(rest, t, q, qd, terms, part, failed, stat)
    end subroutine get_terms
end module terms_at
