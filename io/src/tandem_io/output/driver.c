/* SPDX-License-Identifier: MIT */
/* A variant of HDF5's POSIX driver with which a file can be opened at every moment while it is being written:
   - The mark "open for writing" never reaches the disk. HDF5 would refuse a file with this mark even after its writer was killed.
   - The file is never shorter than its superblock states.
   Exclusive access is the task of guard.c.

   The driver relies on exclusive access. If the file has become shorter, reading and writing fail. Repeated reading of the same
   metadata fails too, because the metadata are then damaged: in the mode "single writer, multiple readers", HDF5 reads metadata
   with a wrong checksum 100 times and doubles the delay each time, which never ends in practice. HDF5's property for the number
   of attempts has no effect on the writer. */
#include "heap.h"
#include "superblock.h"
#include <hdf5.h>
#if H5_VERSION_GE(1, 14, 0)
#include <H5FDdevelop.h>
#endif
#include <stdlib.h>
#include <string.h>
#include <sys/stat.h>
#include <unistd.h>

/* An open file. The first component is used by HDF5; `inner` is the same file opened by HDF5's POSIX driver. */
typedef struct {
    H5FD_t known;
    H5FD_t *inner;
    /* Expected length of the file in bytes; a shorter file was truncated by another process. */
    uint64_t size;
    /* Address and size of the metadata that were read last, and the number of consecutive reads without a write. */
    haddr_t last_at;
    size_t last_size;
    int times;
} file_type;

/* Largest number of consecutive reads of the same metadata. */
enum { most_times = 10 };

static H5FD_t *inner_of(const H5FD_t *file)
{
    return ((const file_type *)file)->inner;
}

/* Length of the file in bytes; 0 if unknown. */
static uint64_t size_of(H5FD_t *inner)
{
    struct stat about;
    void *descriptor;

    if (H5FDget_vfd_handle(inner, H5P_DEFAULT, &descriptor) < 0 || fstat(*(int *)descriptor, &about) != 0)
        return 0;
    return (uint64_t)about.st_size;
}

static H5FD_t *open_file(const char *name, unsigned flags, hid_t access, haddr_t largest)
{
    file_type *file = calloc(1, sizeof *file);
    hid_t plain = H5Pcreate(H5P_FILE_ACCESS);

    (void)access;
    if (file && H5Pset_fapl_sec2(plain) >= 0)
        file->inner = H5FDopen(name, flags, plain, largest);
    H5Pclose(plain);
    if (file && file->inner) {
        file->size = size_of(file->inner);
        return &file->known;
    }
    free(file);
    return NULL;
}

static herr_t close_file(H5FD_t *file)
{
    herr_t stat = H5FDclose(inner_of(file));

    free(file);
    return stat;
}

static int compare(const H5FD_t *one, const H5FD_t *other)
{
    return H5FDcmp(inner_of(one), inner_of(other));
}

/* Features of HDF5's POSIX driver; in addition, small blocks of metadata and of data may be combined. */
static herr_t query(const H5FD_t *file, unsigned long *features)
{
    (void)file;
    *features = H5FD_FEAT_AGGREGATE_METADATA | H5FD_FEAT_ACCUMULATE_METADATA | H5FD_FEAT_DATA_SIEVE |
                H5FD_FEAT_AGGREGATE_SMALLDATA | H5FD_FEAT_POSIX_COMPAT_HANDLE | H5FD_FEAT_SUPPORTS_SWMR_IO |
                H5FD_FEAT_DEFAULT_VFD_COMPATIBLE;
    return 0;
}

static haddr_t end_of_addresses(const H5FD_t *file, H5FD_mem_t type)
{
    return H5FDget_eoa(inner_of(file), type);
}

static herr_t set_end_of_addresses(H5FD_t *file, H5FD_mem_t type, haddr_t end)
{
    return H5FDset_eoa(inner_of(file), type, end);
}

static haddr_t end_of_file(const H5FD_t *file, H5FD_mem_t type)
{
    return H5FDget_eof(inner_of(file), type);
}

static herr_t handle(H5FD_t *file, hid_t access, void **handle)
{
    return H5FDget_vfd_handle(inner_of(file), access, handle);
}

/* Refuse a collection of texts with invalid lengths. HDF5 reads the beginning of a collection first, and then the rest, according
   to the stated length. */
static herr_t check_heap(H5FD_t *inner, H5FD_mem_t type, hid_t transfer, haddr_t at, size_t size, const unsigned char *beginning)
{
    uint64_t length = tandem_heap_length(beginning, size);
    unsigned char *all;
    int is_sound;

    if (length == 0)
        return 0;
    if (length <= size)
        return tandem_heap_is_sound(beginning, length) ? 0 : -1;
    all = length > size_of(inner) ? NULL : malloc((size_t)length);
    is_sound = all && H5FDread(inner, type, transfer, at, (size_t)length, all) >= 0 && tandem_heap_is_sound(all, length);
    free(all);
    return is_sound ? 0 : -1;
}

static herr_t read_piece(H5FD_t *known, H5FD_mem_t type, hid_t transfer, haddr_t at, size_t size, void *to)
{
    file_type *file = (file_type *)known;

    if (type != H5FD_MEM_DRAW) {
        file->times = file->last_at == at && file->last_size == size ? file->times + 1 : 1;
        file->last_at = at;
        file->last_size = size;
        if (file->times > most_times || size_of(file->inner) < file->size)
            return -1;
    }
    if (H5FDread(file->inner, type, transfer, at, size, to) < 0)
        return -1;
    return check_heap(file->inner, type, transfer, at, size, to);
}

/* Extend the file to at least this length. */
static herr_t extend(H5FD_t *inner, uint64_t size)
{
    void *descriptor;

    if (size_of(inner) >= size)
        return 0;
    return H5FDget_vfd_handle(inner, H5P_DEFAULT, &descriptor) < 0 || ftruncate(*(int *)descriptor, (off_t)size) != 0 ? -1 : 0;
}

/* Write a block; a superblock is written without the mark "open for writing". */
static herr_t write_on(H5FD_t *inner, H5FD_mem_t type, hid_t transfer, haddr_t at, size_t size, const void *from)
{
    const unsigned char *rest = (const unsigned char *)from + superblock_size;
    unsigned char bytes[superblock_size];
    uint64_t end;

    if (at != 0 || size < superblock_size || !tandem_superblock_is_known(from))
        return H5FDwrite(inner, type, transfer, at, size, from);
    end = tandem_superblock_end(from);
    memcpy(bytes, from, sizeof bytes);
    tandem_superblock_set(bytes, end);
    /* The superblock is written last, when all data that it refers to exist. */
    if (size > sizeof bytes && H5FDwrite(inner, type, transfer, sizeof bytes, size - sizeof bytes, rest) < 0)
        return -1;
    return extend(inner, end) < 0 ? -1 : H5FDwrite(inner, type, transfer, 0, sizeof bytes, bytes);
}

static herr_t write_piece(H5FD_t *known, H5FD_mem_t type, hid_t transfer, haddr_t at, size_t size, const void *from)
{
    file_type *file = (file_type *)known;

    file->times = 0;
    if (size_of(file->inner) < file->size || write_on(file->inner, type, transfer, at, size, from) < 0)
        return -1;
    file->size = size_of(file->inner);
    return 0;
}

static herr_t flush(H5FD_t *file, hid_t transfer, hbool_t is_closing)
{
    return H5FDflush(inner_of(file), transfer, is_closing);
}

static herr_t truncate_file(H5FD_t *file, hid_t transfer, hbool_t is_closing)
{
    file_type *ours = (file_type *)file;

    /* A file truncated by another process must not be extended again. */
    if (size_of(ours->inner) < ours->size || H5FDtruncate(ours->inner, transfer, is_closing) < 0)
        return -1;
    ours->size = size_of(ours->inner);
    return 0;
}

/* Select this driver for files opened with the access properties. Returns its HDF5 identifier; negative after a failure. Each call
   registers a separate driver, so that HDF5 regards a file opened with different drivers as different files. */
int64_t tandem_driver_set(int64_t access)
{
    static const H5FD_class_t driver = {
#if H5_VERSION_GE(1, 14, 0)
        .version = H5FD_CLASS_VERSION,
        /* Identifier from the range that HDF5 leaves to unregistered drivers. */
        .value = 512,
#endif
        .name = "tandem",
        .maxaddr = INT64_MAX,
        .fc_degree = H5F_CLOSE_WEAK,
        .open = open_file,
        .close = close_file,
        .cmp = compare,
        .query = query,
        .get_eoa = end_of_addresses,
        .set_eoa = set_end_of_addresses,
        .get_eof = end_of_file,
        .get_handle = handle,
        .read = read_piece,
        .write = write_piece,
        .flush = flush,
        .truncate = truncate_file,
        .fl_map = H5FD_FLMAP_DICHOTOMY,
    };
    hid_t id = H5FDregister(&driver);

    if (id >= 0 && H5Pset_driver((hid_t)access, id, NULL) < 0) {
        H5FDunregister(id);
        return -1;
    }
    return (int64_t)id;
}

/* Release a driver. The file must be closed: HDF5 uses data of the driver until the file is closed. A driver that is not released
   remains registered until HDF5 is closed. */
void tandem_driver_release(int64_t driver)
{
    if (driver >= 0)
        H5FDunregister((hid_t)driver);
}
