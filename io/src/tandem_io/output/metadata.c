/* SPDX-License-Identifier: MIT */
#include <hdf5.h>

/* Keep all metadata of open files in memory; 0 on success. Otherwise HDF5 evicts metadata when its cache is full, and in the mode
   "single writer, multiple readers" this fails for the indices of datasets (HDF5 1.10.8), so that a file with some thousand
   datasets cannot be written. */
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

/* Evict nearly all metadata, which are on the disk and no longer in use, before the file is closed. On closing, HDF5 searches the
   remaining metadata once per index of a dataset, which would take quadratic time. */
void tandem_metadata_release(int64_t file)
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
