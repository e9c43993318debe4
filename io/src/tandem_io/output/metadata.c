/* SPDX-License-Identifier: MIT */
#include <hdf5.h>

/* Keep all metadata of a file's objects in memory while it is open. If HDF5 has no room for another object, it drops others
   first, and in the mode "single writer, multiple readers" that fails for the indices of datasets (1.10.8): of some thousand
   datasets none can be written any more. 0 on success. */
int tandem_metadata_keep(int64_t access)
{
    H5AC_cache_config_t cache;

    cache.version = H5AC__CURR_CACHE_CONFIG_VERSION;
    if (H5Pget_mdc_config((hid_t)access, &cache) < 0)
        return -1;
    cache.incr_mode = H5C_incr__off;
    cache.flash_incr_mode = H5C_flash_incr__off;
    cache.decr_mode = H5C_decr__off;
    cache.evictions_enabled = 0;
    return H5Pset_mdc_config((hid_t)access, &cache) < 0 ? -1 : 0;
}

/* Let go of nearly all of it, which is on the disk and not in use any more. To close the file HDF5 looks through what is left once
   for every index of a dataset, which takes the square of their number. */
void tandem_metadata_let_go(int64_t file)
{
    H5AC_cache_config_t cache;

    cache.version = H5AC__CURR_CACHE_CONFIG_VERSION;
    if (H5Fget_mdc_config((hid_t)file, &cache) < 0 || cache.evictions_enabled)
        return;
    cache.evictions_enabled = 1;
    cache.set_initial_size = 1;
    cache.initial_size = cache.min_size;
    if (H5Fset_mdc_config((hid_t)file, &cache) >= 0)
        H5Lexists((hid_t)file, "trajectory", H5P_DEFAULT);
}
