/* SPDX-License-Identifier: MIT */
/* Threads of BLAS. Matrices are small here, and on a busy machine threads of OpenBLAS wait for each other: a run takes many times
   longer. One thread is used unless the user specifies otherwise. */
#define _GNU_SOURCE
#include <dlfcn.h>
#include <stdlib.h>

void tandem_use_one_blas_thread(void)
{
    if (getenv("OPENBLAS_NUM_THREADS") || getenv("GOTO_NUM_THREADS") || getenv("OMP_NUM_THREADS"))
        return;
    /* OpenBLAS reads its variables before the program begins, so a call is necessary; other libraries lack this function. */
    void (*set_number)(int) = (void (*)(int))dlsym(RTLD_DEFAULT, "openblas_set_num_threads");
    if (set_number)
        set_number(1);
}
