! SPDX-License-Identifier: MIT
!> The method of Dormand and Prince of order 8 with two embedded estimates of orders 5 and 3, 12 stages, explicit.
!> Source: P. J. Prince, J. R. Dormand, J. Comp. Appl. Math. 7 (1981) 67-75, with the estimates of Hairer, Norsett, Wanner,
!> Solving Ordinary Differential Equations I, 2nd ed., section II.10.
module tandem_stepper_dop853
    use tandem_kinds, only: wp
    use tandem_stepper, only: properties_type
    use tandem_stepper_explicit, only: explicit_type
    implicit none (type, external)
    private

    public :: dop853_type

    type, extends(explicit_type) :: dop853_type
    contains
        procedure, nopass :: properties
        procedure :: set_tableau
    end type dop853_type

contains

    !> What the method is.
    pure function properties() result(properties_)
        type(properties_type) :: properties_

        properties_ = properties_type('dop853', 8, 12, .false., 7, 'conditional (|h lambda| < 6)', &
            'Prince, Dormand 1981; Hairer, Norsett, Wanner I, section II.10')
    end function properties

    !> The tableau.
    subroutine set_tableau(self)
        class(dop853_type), intent(inout) :: self

        self%c = [ &
            0.0_wp, 0.05260015195876773_wp, 0.0789002279381516_wp, 0.1183503419072274_wp, &
            0.2816496580927726_wp, 0.3333333333333333_wp, 0.25_wp, 0.3076923076923077_wp, &
            0.6512820512820513_wp, 0.6_wp, 0.8571428571428571_wp, 1.0_wp]
        self%b = [ &
            0.054293734116568765_wp, 0.0_wp, 0.0_wp, 0.0_wp, 0.0_wp, 4.450312892752409_wp, &
            1.8915178993145003_wp, -5.801203960010585_wp, 0.3111643669578199_wp, &
            -0.1521609496625161_wp, 0.20136540080403034_wp, 0.04471061572777259_wp]
        if (allocated(self%a)) deallocate (self%a, self%e)
        allocate (self%a(12, 12), self%e(13, 2), source=0.0_wp)
        self%a(:1, 2) = [ &
            0.05260015195876773_wp]
        self%a(:2, 3) = [ &
            0.0197250569845379_wp, 0.0591751709536137_wp]
        self%a(:3, 4) = [ &
            0.02958758547680685_wp, 0.0_wp, 0.08876275643042054_wp]
        self%a(:4, 5) = [ &
            0.2413651341592667_wp, 0.0_wp, -0.8845494793282861_wp, 0.924834003261792_wp]
        self%a(:5, 6) = [ &
            0.037037037037037035_wp, 0.0_wp, 0.0_wp, 0.17082860872947386_wp, 0.12546768756682242_wp]
        self%a(:6, 7) = [ &
            0.037109375_wp, 0.0_wp, 0.0_wp, 0.17025221101954405_wp, 0.06021653898045596_wp, &
            -0.017578125_wp]
        self%a(:7, 8) = [ &
            0.03709200011850479_wp, 0.0_wp, 0.0_wp, 0.17038392571223998_wp, 0.10726203044637328_wp, &
            -0.015319437748624402_wp, 0.008273789163814023_wp]
        self%a(:8, 9) = [ &
            0.6241109587160757_wp, 0.0_wp, 0.0_wp, -3.3608926294469414_wp, -0.868219346841726_wp, &
            27.59209969944671_wp, 20.154067550477894_wp, -43.48988418106996_wp]
        self%a(:9, 10) = [ &
            0.47766253643826434_wp, 0.0_wp, 0.0_wp, -2.4881146199716677_wp, -0.590290826836843_wp, &
            21.230051448181193_wp, 15.279233632882423_wp, -33.28821096898486_wp, &
            -0.020331201708508627_wp]
        self%a(:10, 11) = [ &
            -0.9371424300859873_wp, 0.0_wp, 0.0_wp, 5.186372428844064_wp, 1.0914373489967295_wp, &
            -8.149787010746927_wp, -18.52006565999696_wp, 22.739487099350505_wp, 2.4936055526796523_wp, &
            -3.0467644718982196_wp]
        self%a(:11, 12) = [ &
            2.273310147516538_wp, 0.0_wp, 0.0_wp, -10.53449546673725_wp, -2.0008720582248625_wp, &
            -17.9589318631188_wp, 27.94888452941996_wp, -2.8589982771350235_wp, -8.87285693353063_wp, &
            12.360567175794303_wp, 0.6433927460157636_wp]
        ! The differences to the embedded methods of orders 5 and 3.
        self%e(:, 1) = [ &
            0.01312004499419488_wp, 0.0_wp, 0.0_wp, 0.0_wp, 0.0_wp, -1.2251564463762044_wp, &
            -0.4957589496572502_wp, 1.6643771824549864_wp, -0.35032884874997366_wp, &
            0.3341791187130175_wp, 0.08192320648511571_wp, -0.022355307863886294_wp, 0.0_wp]
        self%e(:, 2) = [ &
            -0.18980075407240762_wp, 0.0_wp, 0.0_wp, 0.0_wp, 0.0_wp, 4.450312892752409_wp, &
            1.8915178993145003_wp, -5.801203960010585_wp, -0.4226823213237919_wp, &
            -0.1521609496625161_wp, 0.20136540080403034_wp, 0.02265179219836082_wp, 0.0_wp]
    end subroutine set_tableau
end module tandem_stepper_dop853
