/* SPDX-License-Identifier: MIT */
/* Number of BLAS threads: one, unless the user specifies otherwise. For the small matrices of this program, threads of OpenBLAS
   mostly wait for each other, and on a busy machine a run takes many times longer. */
#define _GNU_SOURCE
#include <dlfcn.h>
#include <stdlib.h>

void tandem_use_one_blas_thread(void)
{
    if (getenv("OPENBLAS_NUM_THREADS") || getenv("GOTO_NUM_THREADS") || getenv("OMP_NUM_THREADS"))
        return;
    /* OpenBLAS reads its environment variables before the program begins, so that a call is necessary. Other libraries lack this
       function. */
    void (*set_number)(int) = (void (*)(int))dlsym(RTLD_DEFAULT, "openblas_set_num_threads");
    if (set_number)
        set_number(1);
}
