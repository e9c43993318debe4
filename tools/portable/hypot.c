/* SPDX-License-Identifier: MIT */
/* glibc 2.35 gave hypot a new version that sets no errno. The older one computes the same and is in older glibc too; the linker's
   --wrap=hypot leads all calls here. */
double hypot_of_any_glibc(double x, double y);
__asm__(".symver hypot_of_any_glibc, hypot@GLIBC_2.2.5");

double __wrap_hypot(double x, double y)
{
    return hypot_of_any_glibc(x, y);
}
