/* SPDX-License-Identifier: MIT */
/* Threads inside BLAS. Matrices are small here, and on a busy machine threads of OpenBLAS wait for each other's turns: a run takes
   many times longer. One thread, then, where the user does not say otherwise. */
#define _GNU_SOURCE
#include <dlfcn.h>
#include <stdlib.h>

void tandem_use_one_blas_thread(void)
{
    if (getenv("OPENBLAS_NUM_THREADS") || getenv("GOTO_NUM_THREADS") || getenv("OMP_NUM_THREADS"))
        return;
    /* OpenBLAS reads its variables before the program begins, so it has to be told; other libraries do not know the name. */
    void (*set_number)(int) = (void (*)(int))dlsym(RTLD_DEFAULT, "openblas_set_num_threads");
    if (set_number)
        set_number(1);
}
