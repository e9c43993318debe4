program main
    use testdrive, only: error_type
    use tandem, only: wp
    implicit none (type, external)
    print *, wp
end program main
