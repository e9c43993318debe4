! SPDX-License-Identifier: MIT
!> Quantiles of the normal distribution, which convert uniformly to normally distributed numbers.
module tandem_io_sweep_quantile
    use tandem, only: wp
    implicit none (type, external)
    private

    public :: normal_quantile

    ! Rational functions PPND16 of M. J. Wichura, Algorithm AS 241, Applied Statistics 37 (1988) 477-484, with relative errors of
    ! about 1e-16. Coefficients are in order of ascending powers.
    real(wp), parameter :: a(0:7) = [3.3871328727963666080_wp, 1.3314166789178437745e+2_wp, 1.9715909503065514427e+3_wp, &
        1.3731693765509461125e+4_wp, 4.5921953931549871457e+4_wp, 6.7265770927008700853e+4_wp, 3.3430575583588128105e+4_wp, &
        2.5090809287301226727e+3_wp]
    real(wp), parameter :: b(0:7) = [1.0_wp, 4.2313330701600911252e+1_wp, 6.8718700749205790830e+2_wp, &
        5.3941960214247511077e+3_wp, 2.1213794301586595867e+4_wp, 3.9307895800092710610e+4_wp, 2.8729085735721942674e+4_wp, &
        5.2264952788528545610e+3_wp]
    real(wp), parameter :: c(0:7) = [1.42343711074968357734_wp, 4.63033784615654529590_wp, 5.76949722146069140550_wp, &
        3.64784832476320460504_wp, 1.27045825245236838258_wp, 2.41780725177450611770e-1_wp, 2.27238449892691845833e-2_wp, &
        7.74545014278341407640e-4_wp]
    real(wp), parameter :: d(0:7) = [1.0_wp, 2.05319162663775882187_wp, 1.67638483018380384940_wp, &
        6.89767334985100004550e-1_wp, 1.48103976427480074590e-1_wp, 1.51986665636164571966e-2_wp, &
        5.47593808499534494600e-4_wp, 1.05075007164441684324e-9_wp]
    real(wp), parameter :: e(0:7) = [6.65790464350110377720_wp, 5.46378491116411436990_wp, 1.78482653991729133580_wp, &
        2.96560571828504891230e-1_wp, 2.65321895265761230930e-2_wp, 1.24266094738807843860e-3_wp, &
        2.71155556874348757815e-5_wp, 2.01033439929228813265e-7_wp]
    real(wp), parameter :: f(0:7) = [1.0_wp, 5.99832206555887937690e-1_wp, 1.36929880922735805310e-1_wp, &
        1.48753612908506148525e-2_wp, 7.86869131145613259100e-4_wp, 1.84631831751005468180e-5_wp, &
        1.42151175831644588870e-7_wp, 2.04426310338993978564e-15_wp]

contains

    !> Quantile p of the standard normal distribution.
    pure real(wp) function normal_quantile(p) result(x)
        !> Probability between 0 and 1, exclusive.
        real(wp), intent(in) :: p
        real(wp) :: q, r

        q = p - 0.5_wp
        if (abs(q) <= 0.425_wp) then
            r = 0.180625_wp - q*q
            x = q*polynomial(a, r)/polynomial(b, r)
            return
        end if
        r = sqrt(-log(merge(p, 1.0_wp - p, q < 0.0_wp)))
        if (r <= 5.0_wp) then
            x = polynomial(c, r - 1.6_wp)/polynomial(d, r - 1.6_wp)
        else
            x = polynomial(e, r - 5.0_wp)/polynomial(f, r - 5.0_wp)
        end if
        x = sign(x, q)
    end function normal_quantile

    pure real(wp) function polynomial(coefficients, x) result(value)
        real(wp), intent(in) :: coefficients(0:), x
        integer :: i

        value = coefficients(ubound(coefficients, 1))
        do i = ubound(coefficients, 1) - 1, 0, -1
            value = value*x + coefficients(i)
        end do
    end function polynomial
end module tandem_io_sweep_quantile
