program main
    use testdrive, only: error_type
    use tandem, only: wp
    implicit none
    print *, wp
end program main
