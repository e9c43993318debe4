! SPDX-License-Identifier: MIT
!> Explicit method of Dormand and Prince of order 8 with 12 stages and two embedded error estimates of orders 5 and 3.
!> Source: P. J. Prince, J. R. Dormand, J. Comp. Appl. Math. 7 (1981) 67-75, with the estimates of Hairer, Norsett, Wanner,
!> Solving Ordinary Differential Equations I, 2nd ed., section II.10.
module tandem_stepper_dop853
    use tandem_kinds, only: wp
    use tandem_stepper, only: properties_type
    use tandem_stepper_combination, only: combination_type
    use tandem_stepper_explicit, only: explicit_type
    use tandem_stepper_state, only: state_type
    use tandem_chart, only: chart_type
    implicit none (type, external)
    private

    public :: dop853_type, properties

    !> The method of order 8.
    type, extends(explicit_type) :: dop853_type
        private
        !> Nodes of the three additional stages of dense output; their weights, and the weights of the interpolating polynomial.
        real(wp) :: extra_c(3) = 0.0_wp
        type(combination_type) :: extra_sum(3), dense_sum(4)
    contains
        procedure, nopass :: properties
        procedure :: set_tableau, interpolate
    end type dop853_type

contains

    !> Properties of the method.
    pure function properties() result(properties_)
        type(properties_type) :: properties_

        properties_ = properties_type('dop853', 8, 12, .false., 7, 'conditional (|h lambda| < 6)', &
            'Prince, Dormand 1981; Hairer, Norsett, Wanner I, section II.10', 7, dense_probe=2.0_wp/3, stability_limit=6.1_wp)
    end function properties

    !> Set the tableau.
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
        ! Differences from the embedded methods of orders 5 and 3.
        self%e(:, 1) = [ &
            0.01312004499419488_wp, 0.0_wp, 0.0_wp, 0.0_wp, 0.0_wp, -1.2251564463762044_wp, &
            -0.4957589496572502_wp, 1.6643771824549864_wp, -0.35032884874997366_wp, &
            0.3341791187130175_wp, 0.08192320648511571_wp, -0.022355307863886294_wp, 0.0_wp]
        self%e(:, 2) = [ &
            -0.18980075407240762_wp, 0.0_wp, 0.0_wp, 0.0_wp, 0.0_wp, 4.450312892752409_wp, &
            1.8915178993145003_wp, -5.801203960010585_wp, -0.4226823213237919_wp, &
            -0.1521609496625161_wp, 0.20136540080403034_wp, 0.02265179219836082_wp, 0.0_wp]
        ! Dense output of order 7.
        self%n_extra = 3
        self%extra_c = [0.1_wp, 0.2_wp, 7.0_wp/9]
        call self%extra_sum(1)%set([ &
            0.056167502283047954_wp, 0.0_wp, 0.0_wp, 0.0_wp, 0.0_wp, 0.0_wp, 0.25350021021662483_wp, &
            -0.2462390374708025_wp, -0.12419142326381637_wp, 0.15329179827876568_wp, &
            0.00820105229563469_wp, 0.007567897660545699_wp, -0.008298_wp])
        call self%extra_sum(2)%set([ &
            0.03183464816350214_wp, 0.0_wp, 0.0_wp, 0.0_wp, 0.0_wp, 0.028300909672366776_wp, &
            0.053541988307438566_wp, -0.05492374857139099_wp, 0.0_wp, 0.0_wp, &
            -0.00010834732869724932_wp, 0.0003825710908356584_wp, -0.00034046500868740456_wp, &
            0.1413124436746325_wp])
        call self%extra_sum(3)%set([ &
            -0.42889630158379194_wp, 0.0_wp, 0.0_wp, 0.0_wp, 0.0_wp, -4.697621415361164_wp, &
            7.683421196062599_wp, 4.06898981839711_wp, 0.3567271874552811_wp, 0.0_wp, 0.0_wp, 0.0_wp, &
            -0.0013990241651590145_wp, 2.9475147891527724_wp, -9.15095847217987_wp])
        call self%dense_sum(1)%set([ &
            -8.428938276109013_wp, 0.0_wp, 0.0_wp, 0.0_wp, 0.0_wp, 0.5667149535193777_wp, &
            -3.0689499459498917_wp, 2.38466765651207_wp, 2.117034582445028_wp, -0.871391583777973_wp, &
            2.2404374302607883_wp, 0.6315787787694688_wp, -0.08899033645133331_wp, &
            18.148505520854727_wp, -9.194632392478356_wp, -4.436036387594894_wp])
        call self%dense_sum(2)%set([ &
            10.427508642579134_wp, 0.0_wp, 0.0_wp, 0.0_wp, 0.0_wp, 242.28349177525817_wp, &
            165.20045171727028_wp, -374.5467547226902_wp, -22.113666853125306_wp, 7.733432668472264_wp, &
            -30.674084731089398_wp, -9.332130526430229_wp, 15.697238121770845_wp, &
            -31.139403219565178_wp, -9.35292435884448_wp, 35.81684148639408_wp])
        call self%dense_sum(3)%set([ &
            19.985053242002433_wp, 0.0_wp, 0.0_wp, 0.0_wp, 0.0_wp, -387.0373087493518_wp, &
            -189.17813819516758_wp, 527.8081592054236_wp, -11.57390253995963_wp, 6.8812326946963_wp, &
            -1.0006050966910838_wp, 0.7777137798053443_wp, -2.778205752353508_wp, &
            -60.19669523126412_wp, 84.32040550667716_wp, 11.99229113618279_wp])
        call self%dense_sum(4)%set([ &
            -25.69393346270375_wp, 0.0_wp, 0.0_wp, 0.0_wp, 0.0_wp, -154.18974869023643_wp, &
            -231.5293791760455_wp, 357.6391179106141_wp, 93.40532418362432_wp, -37.45832313645163_wp, &
            104.0996495089623_wp, 29.8402934266605_wp, -43.53345659001114_wp, 96.32455395918828_wp, &
            -39.17726167561544_wp, -149.72683625798564_wp])
    end subroutine set_tableau

    !> Increments at a time within the last step, of order 7. Three additional stages are evaluated once per step.
    subroutine interpolate(self, chart, start, arrived, state, slope_q, slope_qd, stat)
        class(dop853_type), intent(inout) :: self
        class(chart_type), intent(inout) :: chart
        type(state_type), intent(in) :: start, arrived
        type(state_type), intent(inout) :: state
        real(wp), intent(out), contiguous :: slope_q(:), slope_qd(:)
        integer, intent(out) :: stat
        real(wp) :: h, x, factor
        integer :: i, k

        stat = 0
        h = arrived%t - start%t
        if (.not. self%has_extra) then
            call self%start_near(start)
            do i = 1, 3
                call self%set_near(chart, h, start%t + self%extra_c(i)*h, self%extra_sum(i), 13 + i, stat)
                if (stat /= 0) return
            end do
            self%has_extra = .true.
        end if
        x = (state%t - start%t)/h
        self%y = 0.0_wp
        self%slope = 0.0_wp
        do k = 4, 1, -1
            call self%dense_sum(k)%add(size(self%rate, 1), size(self%rate, 2), h, self%rate, self%y, self%part)
            factor = merge(x, 1.0_wp - x, mod(k, 2) == 0)
            self%y = factor*self%part
            self%slope = factor*self%slope + merge(1.0_wp, -1.0_wp, mod(k, 2) == 0)*self%part
        end do
        associate (n => self%n, offset => self%offset, rate => self%rate)
            call nested_polynomial(self%y(:n), self%slope(:n), start%dq, arrived%dq, rate(:n, 1), rate(:n, 13), state%dq, slope_q)
            call nested_polynomial(self%y(offset + 1:offset + n), self%slope(offset + 1:offset + n), start%dqd, arrived%dqd, &
                rate(offset + 1:offset + n, 1), rate(offset + 1:offset + n, 13), state%dqd, slope_qd)
        end associate

    contains

        !> Interpolating polynomial of Hairer, Norsett, Wanner I, section II.6, in nested form, and its derivative.
        elemental subroutine nested_polynomial(inner, inner_slope, y0, y1, rate0, rate1, y, slope)
            !> Inner part of the nested form and its derivative with respect to x; values and rates at both ends.
            real(wp), intent(in) :: inner, inner_slope, y0, y1, rate0, rate1
            real(wp), intent(out) :: y, slope

            y = inner + 2*(y1 - y0) - h*(rate0 + rate1)
            slope = y + inner_slope*x
            y = y*x + h*rate0 - (y1 - y0)
            slope = slope*(1.0_wp - x) - y
            y = y*(1.0_wp - x) + y1 - y0
            slope = (slope*x + y)/h
            y = y0 + y*x
        end subroutine nested_polynomial
    end subroutine interpolate
end module tandem_stepper_dop853
