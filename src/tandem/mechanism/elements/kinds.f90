! SPDX-License-Identifier: MIT
!> Registration of the kinds of elements. Forces are added in this order, and messages list the words in this order.
submodule(tandem_mechanism_definition) tandem_mechanism_elements_kinds
    use tandem_mechanism_elements_bushing, only: bushing_kind_type
    use tandem_mechanism_elements_coupling, only: coupling_kind_type
    use tandem_mechanism_elements_friction, only: friction_kind_type
    use tandem_mechanism_elements_load, only: load_kind_type
    use tandem_mechanism_elements_spring, only: spring_kind_type
    use tandem_mechanism_elements_torsion, only: torsion_kind_type
    implicit none (type, external)

contains

    module procedure list_kinds
        if (allocated(kinds)) deallocate (kinds)
        allocate (kinds(6))
        allocate (spring_kind_type :: kinds(1)%of)
        allocate (torsion_kind_type :: kinds(2)%of)
        allocate (bushing_kind_type :: kinds(3)%of)
        allocate (load_kind_type :: kinds(4)%of)
        allocate (friction_kind_type :: kinds(5)%of)
        allocate (coupling_kind_type :: kinds(6)%of)
    end procedure list_kinds
end submodule tandem_mechanism_elements_kinds
