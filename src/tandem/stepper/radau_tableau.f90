! SPDX-License-Identifier: MIT
!> Coefficients of Radau IIA with 3, 5 and 7 stages, orders 5, 9 and 13, and the transformation for solving their stages together:
!> T^-1 A T is block diagonal, with one real eigenvalue and complex pairs.
!> Source: Hairer, Wanner, Solving Ordinary Differential Equations II, 2nd ed., sections IV.5 and IV.8; for 5 and 7 stages computed
!> with 80 digits from the definition, collocation at the zeros of P_s - P_(s-1), shifted to [0, 1]. Suite `radau` checks them.
module tandem_stepper_radau_tableau
    use tandem_kinds, only: wp
    implicit none (type, external)
    private

    public :: tableau_type, tableau_of, most_stages, a3

    !> Number of stages of the largest method.
    integer, parameter :: most_stages = 7

    !> A Radau IIA method. Arrays with one column per stage are filled up to the number of stages.
    type :: tableau_type
        integer :: stages = 0
        !> Nodes and coefficients; a(:, i) is the row of stage i.
        real(wp) :: c(most_stages) = 0.0_wp, a(most_stages, most_stages) = 0.0_wp
        !> Real eigenvalue of A; one eigenvalue of each complex pair, divided by the real one.
        real(wp) :: diagonal = 0.0_wp
        complex(wp) :: ratio((most_stages - 1)/2) = (0.0_wp, 0.0_wp)
        !> T and its inverse; t(:, i) and t_inverse(:, i) are their i-th rows.
        real(wp) :: t(most_stages, most_stages) = 0.0_wp, t_inverse(most_stages, most_stages) = 0.0_wp
        !> Weights of the embedded formula of order equal to the number of stages. Its difference from the method is h times
        !> `diagonal` times the sum of the rate at the start of the step and the products of these weights with the rates of the
        !> stages.
        real(wp) :: weight(most_stages) = 0.0_wp
        !> For h = 1: the ratio of this difference to the divided difference of all these rates.
        real(wp) :: principal = 0.0_wp
    end type tableau_type

    !> Method with three stages: nodes and coefficients in closed form.
    real(wp), parameter :: s6 = sqrt(6.0_wp)
    real(wp), parameter :: c3(3) = [(4 - s6)/10, (4 + s6)/10, 1.0_wp]
    real(wp), parameter :: a3(3, 3) = reshape([ &
        (88 - 7*s6)/360, (296 - 169*s6)/1800, (-2 + 3*s6)/225, &
        (296 + 169*s6)/1800, (88 + 7*s6)/360, (-2 - 3*s6)/225, &
        (16 - s6)/36, (16 + s6)/36, 1.0_wp/9], [3, 3])
    !> Cube roots of 81 and 9, for the eigenvalues.
    real(wp), parameter :: root81 = 81.0_wp**(1.0_wp/3), root9 = 9.0_wp**(1.0_wp/3)
    real(wp), parameter :: diagonal3 = (6 + root81 - root9)/30
    complex(wp), parameter :: pairs3(1) = [cmplx((12 - root81 + root9)/60, -(root81 + root9)*sqrt(3.0_wp)/60, wp)]
    !> Transformation of the program RADAU5, for three stages.
    real(wp), parameter :: t3(3, 3) = reshape([ &
        9.1232394870892942792e-02_wp, -0.14125529502095420843_wp, -3.0029194105147424492e-02_wp, &
        0.24171793270710701896_wp, 0.20412935229379993199_wp, 0.38294211275726193779_wp, &
        0.96604818261509293619_wp, 1.0_wp, 0.0_wp], [3, 3])
    real(wp), parameter :: t_inverse3(3, 3) = reshape([ &
        4.3255798900631553510_wp, 0.33919925181580986954_wp, 0.54177053993587487119_wp, &
        -4.1787185915519047273_wp, -0.32768282076106238708_wp, 0.47662355450055045196_wp, &
        -0.50287263494578687595_wp, 2.5719269498556054292_wp, -0.59603920482822492497_wp], [3, 3])
    !> (IV.8.18) with the increments of the stages.
    real(wp), parameter :: e3(3) = [-(13 + 7*s6)/3, (-13 + 7*s6)/3, -1.0_wp/3]
    real(wp), parameter :: weight3(3) = [ &
        e3(1)*a3(1, 1) + e3(2)*a3(1, 2) + e3(3)*a3(1, 3), &
        e3(1)*a3(2, 1) + e3(2)*a3(2, 2) + e3(3)*a3(2, 3), &
        e3(1)*a3(3, 1) + e3(2)*a3(3, 2) + e3(3)*a3(3, 3)]

    real(wp), parameter :: diagonal5 = 0.15906584442746912048_wp
    complex(wp), parameter :: pairs5(2) = [ &
        (0.13317907701829959895_wp, -0.074994511835818522924_wp), &
        (0.065065778545743618594_wp, -0.11646852774031707573_wp)]
    real(wp), parameter :: c5(5) = [ &
        0.057104196114517682193_wp, 0.27684301363812382768_wp, 0.58359043236891682006_wp, 0.86024013565621944785_wp, &
        1.0_wp]
    real(wp), parameter :: a5(5, 5) = reshape([ &
        0.072998864317903324306_wp, -0.026735331107945571878_wp, 0.018676929763984354412_wp, -0.012879106093306439854_wp, &
        0.0050428392338820152067_wp, 0.15377523147918246867_wp, 0.14621486784749350665_wp, -0.036444568905128089527_wp, &
        0.021233063119304719422_wp, -0.0079355799027287775326_wp, 0.14006304568480987151_wp, 0.2989671294912834794_wp, &
        0.16758507013524896344_wp, -0.033969101686617746572_wp, 0.010944288744192252274_wp, 0.14489430810953475754_wp, &
        0.27650006876015922756_wp, 0.32579792291042102998_wp, 0.12875675325490976116_wp, -0.015708917378805328388_wp, &
        0.14371356079122594132_wp, 0.28135601514946206019_wp, 0.31182652297574125408_wp, 0.2231039010835707444_wp, &
        0.04_wp], [5, 5])
    real(wp), parameter :: t5(5, 5) = reshape([ &
        0.013576867344947943248_wp, -0.011478515255229514708_wp, -0.014019858892875410281_wp, -0.01024204781790882707_wp, &
        0.047673877290295723863_wp, 0.0016179004017190874764_wp, -0.0076688307491801628852_wp, &
        0.024708578426518526813_wp, 0.050172864517371058163_wp, -0.094331819181611436981_wp, 0.079157853347447207645_wp, &
        0.019398463998828950911_wp, 0.081800353703751170836_wp, -0.23053953404341794672_wp, 0.10270304538012589979_wp, &
        0.41225608268046145198_wp, 0.40760117128019906662_wp, 0.19968242788680252594_wp, 0.37789390224886124954_wp, &
        0.46674413033249435929_wp, 1.0_wp, 1.0_wp, 0.0_wp, 1.0_wp, 0.0_wp], [5, 5])
    real(wp), parameter :: t_inverse5(5, 5) = reshape([ &
        27.697693775684088409_wp, 12.783337911304406015_wp, 3.2084893867134298598_wp, -0.95149041224891622127_wp, &
        0.74155049602598960335_wp, -33.041880213519000008_wp, -17.376953479063567019_wp, -0.17212906325400556115_wp, &
        -0.099169777982542642588_wp, 0.53122811583830666718_wp, -8.6114439798752919777_wp, 9.6999914095288082313_wp, &
        1.9147286396968742849_wp, 2.4186920060849400264_wp, -1.0474634879353374187_wp, 5.3441864378349115989_wp, &
        4.5936155677591610045_wp, -3.0363603234594242986_wp, 1.0506601902314588639_wp, -0.27277861186429627054_wp, &
        3.7480598074398048601_wp, -3.9849657363438846673_wp, -1.0444156416080187929_wp, 1.1840985681379484872_wp, &
        -0.4499177701567803689_wp], [5, 5])
    real(wp), parameter :: weight5(5) = [ &
        -1.5864079001863282498_wp, 1.0081178814983729891_wp, -0.73097486615978746141_wp, 0.5092648848477427221_wp, &
        -0.2_wp]
    real(wp), parameter :: diagonal7 = 0.11189646530003507594_wp
    complex(wp), parameter :: pairs7(3) = [ &
        (0.10228556649689874019_wp, -0.039427496438063535233_wp), &
        (0.075280411819775111094_wp, -0.069819600780833305239_wp), &
        (0.035716558264077841516_wp, -0.082953154313331607823_wp)]
    real(wp), parameter :: c7(7) = [ &
        0.029316427159784891972_wp, 0.14807859966848429185_wp, 0.3369846902811542991_wp, 0.55867151877155013208_wp, &
        0.76923386203005450092_wp, 0.92694567131974111485_wp, 1.0_wp]
    real(wp), parameter :: a7(7, 7) = reshape([ &
        0.037546264993921331334_wp, -0.014039334556460401538_wp, 0.010352789600742300937_wp, &
        -0.0081583225402750119092_wp, 0.0063884138795346849438_wp, -0.0046023267791486554994_wp, &
        0.001828942561470643704_wp, 0.080147596515618967795_wp, 0.08106206398589153668_wp, -0.021237992120711034937_wp, &
        0.014000291238817118984_wp, -0.010234185730090163829_wp, 0.0071534651513645904981_wp, &
        -0.0028126393724067233403_wp, 0.072063846941881902113_wp, 0.17106835498388661942_wp, 0.10961456404007210923_wp, &
        -0.024619871728984053862_wp, 0.014760377043950817073_wp, -0.0095752593967914005563_wp, &
        0.0036726783971383056716_wp, 0.075705125819824420425_wp, 0.15409015514217114465_wp, 0.22710773667320238641_wp, &
        0.11747818703702478199_wp, -0.023810827153044173582_wp, 0.012709985533661205634_wp, -0.0046088442812896334403_wp, &
        0.073912342163191846541_wp, 0.16135560761594243219_wp, 0.20686724155210419782_wp, 0.23700711534269423476_wp, &
        0.10308679353381344662_wp, -0.01885413915258044884_wp, 0.005858900974888791824_wp, 0.074705562059796230172_wp, &
        0.15830722387246870066_wp, 0.21415342326720003111_wp, 0.21987784703186003999_wp, 0.1987521216806352698_wp, &
        0.069265501605509133231_wp, -0.0081160081977282901079_wp, 0.074494235556010317933_wp, 0.15910211573365074087_wp, &
        0.2123518895029778042_wp, 0.22355491450728323475_wp, 0.1904749368221155769_wp, 0.11961374461265620289_wp, &
        0.020408163265306122449_wp], [7, 7])
    real(wp), parameter :: t7(7, 7) = reshape([ &
        0.0024435843048706115407_wp, -0.0012386461879528740564_wp, -0.0027606174805438524995_wp, &
        -0.0040551614523310238982_wp, 0.0044272327532682854797_wp, 0.021567551351320773387_wp, &
        0.0087835679251441444073_wp, -0.0018153396483193171605_wp, -6.6666353393963381818e-5_wp, &
        0.0031854748251662098487_wp, 0.0084155682765595892372_wp, -0.0040319495702245494923_wp, &
        -0.038131648134411546694_wp, -0.021525560594006875524_wp, 0.0046053393311618748042_wp, &
        -0.0023521809829433383405_wp, 4.1690777252975626914e-4_wp, -0.0085604310616034320602_wp, &
        -0.0069232126650239089241_wp, 0.057396508939381715398_wp, 0.058850529208426791056_wp, 0.017870023342853069058_wp, &
        0.0031150711523461752527_wp, 0.025116604913438821928_wp, -0.037371242302384457419_wp, &
        0.0082390072985077194045_wp, -0.038214693596968350485_wp, -0.16573681127294385124_wp, 0.12818100807728391008_wp, &
        0.10171773248171514681_wp, 0.09504502035604622821_wp, 0.0053667613791817700943_wp, 0.19321111610126201443_wp, &
        -0.24917421246526368633_wp, 0.27356330579866232121_wp, 0.5200651497488246866_wp, 0.52175194527476528529_wp, &
        0.12807194463554389441_wp, 0.52657422645844926291_wp, 0.27553439498962581419_wp, 0.53158464908362842921_wp, &
        0.48632283661757289406_wp, 1.0_wp, 1.0_wp, 0.0_wp, 1.0_wp, 0.0_wp, 1.0_wp, 0.0_wp], [7, 7])
    real(wp), parameter :: t_inverse7(7, 7) = reshape([ &
        227.51530596268068904_wp, 166.64802246760974611_wp, 43.265145884526215054_wp, 3.6230900613410161325_wp, &
        3.5726748329387980313_wp, -2.7435563656033673145_wp, 1.4514535402547503515_wp, -299.18624802825209668_wp, &
        -243.04074536874479118_wp, -48.777104078037869212_wp, -2.0386719057419344053_wp, 1.6735602398610849443_wp, &
        -1.0873740320571061645_wp, 0.90193824929609937384_wp, -93.076502897435305912_wp, 23.881631056281144277_wp, &
        39.278880730813843827_wp, 14.38891568549108007_wp, -3.5104383993993612211_wp, 4.8632848855661807012_wp, &
        -2.2464827295912399164_wp, 74.678332235022699772_wp, 87.408588979900816402_wp, 4.024158737379997877_wp, &
        -3.7148063151583641866_wp, -3.4300939859823173507_wp, 2.6966048097653123789_wp, -0.93869274360754619336_wp, &
        58.356528851906577242_wp, -10.068773957800180963_wp, -30.366388842566671208_wp, -1.020020865184865985_wp, &
        -0.11241750037842496213_wp, 1.8906408310003776228_wp, -0.97164863938314822822_wp, -3.0073901694512921317_wp, &
        -11.015866078765771329_wp, 1.4877994561316562815_wp, 2.1303881595592824594_wp, -1.8161410868175656248_wp, &
        1.1343255878951611001_wp, -0.41469904594330353199_wp, -8.4419631883210846818_wp, -0.65052527405751500282_wp, &
        6.9406707303698764788_wp, -3.2050475255978984316_wp, 1.0712809435464785898_wp, -0.35485074912162218797_wp, &
        0.091985491327865541544_wp], [7, 7])
    real(wp), parameter :: weight7(7) = [ &
        -1.5940642185610417812_wp, 1.036553752196476461_wp, -0.79382172349079268752_wp, 0.63257765224993422526_wp, &
        -0.49761071360300131344_wp, 0.35922239406556795304_wp, -0.14285714285714285714_wp]

contains

    !> The method of 3, 5 or 7 stages.
    pure function tableau_of(stages) result(tableau)
        integer, intent(in) :: stages
        type(tableau_type) :: tableau

        select case (stages)
        case (5)
            tableau = tableau_from(c5, a5, diagonal5, pairs5, t5, t_inverse5, weight5)
        case (7)
            tableau = tableau_from(c7, a7, diagonal7, pairs7, t7, t_inverse7, weight7)
        case default
            tableau = tableau_from(c3, a3, diagonal3, pairs3, t3, t_inverse3, weight3)
        end select
    end function tableau_of

    !> Method with given coefficients.
    pure function tableau_from(c, a, diagonal, pairs, t, t_inverse, weight) result(tableau)
        real(wp), intent(in) :: c(:), a(:, :), diagonal, t(:, :), t_inverse(:, :), weight(:)
        !> Eigenvalues of A.
        complex(wp), intent(in) :: pairs(:)
        type(tableau_type) :: tableau

        associate (s => size(c))
            tableau%stages = s
            tableau%c(:s) = c
            tableau%a(:s, :s) = a
            tableau%diagonal = diagonal
            tableau%ratio(:size(pairs)) = pairs/diagonal
            tableau%t(:s, :s) = t
            tableau%t_inverse(:s, :s) = t_inverse
            tableau%weight(:s) = weight
            ! The divided difference of x**s is 1.
            tableau%principal = diagonal*sum(weight*c**s)
        end associate
    end function tableau_from
end module tandem_stepper_radau_tableau
