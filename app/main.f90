program main
    use tandem, only: wp
    use tandem_io, only: h5open_f
    implicit none
    integer :: ierr
    call h5open_f(ierr)
    print *, 'tandem', wp, ierr
end program main
