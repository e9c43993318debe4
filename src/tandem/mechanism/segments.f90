! SPDX-License-Identifier: MIT
!> A mechanism from breakpoint to breakpoint: where its functions of time and its laws have kinks, and the smooth pieces of them
!> that hold between two.
submodule(tandem_mechanism) tandem_mechanism_segments
    use tandem_error, only: to_text
    implicit none (type, external)

contains

    module procedure find_breakpoints
        real(wp), allocatable :: places(:), kinks(:)
        integer, allocatable :: orders(:)
        logical, allocatable :: jumps(:)
        real(wp) :: first
        integer :: i, k, n

        allocate (kinks(0), jumps(0))
        do i = 1, size(self%motions)
            associate (motion => self%motions(i))
                call motion%f%find_kinks(self%times(1), self%times(2), places, orders, error)
                if (allocated(error)) return
                if (any(orders < motion%jump_order)) then
                    call set_error(error, status_invalid_model, 'the motion of '//trim(motion%name)//' jumps at t = '// &
                        to_text(places(findloc(orders, 0, dim=1))), 'let it be continuous: a smooth_step does what a step does')
                    return
                end if
                kinks = [kinks, places]
                jumps = [jumps, orders == motion%jump_order]
            end associate
        end do
        do i = 1, size(self%laws)
            call self%laws(i)%law%find_kinks(self%times(1), self%times(2), places, orders, error)
            if (allocated(error)) return
            kinks = [kinks, places]
            jumps = [jumps, spread(.false., 1, size(places))]
        end do
        do i = 1, size(self%formulas)
            call self%formulas(i)%pieces%find_kinks(self%times(1), self%times(2), places, orders, error)
            if (allocated(error)) return
            kinks = [kinks, places]
            jumps = [jumps, spread(.false., 1, size(places))]
        end do
        if (size(kinks) == 0) return

        ! In their order; those that differ by rounding alone are one.
        allocate (self%breakpoints(size(kinks)), self%nu_jumps(size(kinks)))
        n = 0
        do while (any(kinks < huge(first)))
            k = minloc(kinks, dim=1)
            first = kinks(k)
            n = n + 1
            self%breakpoints(n) = first
            associate (same => kinks - first <= 1.0e-12_wp*max(abs(first), self%times(2) - self%times(1)))
                self%nu_jumps(n) = any(same .and. jumps)
                where (same) kinks = huge(first)
            end associate
        end do
        self%breakpoints = self%breakpoints(:n)
        self%nu_jumps = self%nu_jumps(:n)
    end procedure find_breakpoints

    module procedure hold_segment
        real(wp) :: ends(2), t
        integer :: i

        self%held_segment = self%segment
        self%time_of_f = huge(t)
        if (.not. allocated(self%breakpoints)) return
        ends = self%times
        if (self%segment > 1) ends(1) = self%breakpoints(self%segment - 1)
        if (self%segment <= size(self%breakpoints)) ends(2) = self%breakpoints(self%segment)
        t = sum(ends)/2
        do i = 1, size(self%motions)
            call self%motions(i)%f%hold(t)
        end do
        do i = 1, size(self%laws)
            call self%laws(i)%law%hold(t)
        end do
        do i = 1, size(self%formulas)
            call self%formulas(i)%pieces%hold(t)
        end do
    end procedure hold_segment
end submodule tandem_mechanism_segments
