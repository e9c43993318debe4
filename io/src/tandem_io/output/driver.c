/* SPDX-License-Identifier: MIT */
/* HDF5's driver for POSIX, but such that a file that is being written can be opened at every moment: the mark "open for writing",
   with which HDF5 would refuse it for ever once its writer was killed, never reaches the disk, and the file never is shorter than
   its superblock says. Who may write is for guard.c to say.

   Nobody else writes the file. A file that has become shorter is neither read nor written any more; and what HDF5 reads
   again and again is damaged: from a file with one writer and many readers it reads metadata whose checksum is wrong 100 times, and
   sleeps twice as long before each, which ends in no lifetime. Its property for that does not hold for the writer. */
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

/* A file: the data of HDF5, and the same file opened by HDF5's own driver. */
typedef struct {
    H5FD_t known;
    H5FD_t *inner;
    /* Bytes that exist unless others have truncated the file. */
    uint64_t size;
    /* The last piece of metadata that was read, if nothing was written since, and how often it was read in a row. */
    haddr_t last_at;
    size_t last_size;
    int times;
} file_type;

/* Most readings of a piece of metadata in a row. */
enum { most_times = 10 };

static H5FD_t *inner_of(const H5FD_t *file)
{
    return ((const file_type *)file)->inner;
}

/* The bytes of the file; 0 where they cannot be told. */
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

/* Features of HDF5's own driver; in addition, pieces of metadata and of data may be combined into large ones. */
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

/* Refuse texts whose lengths are damaged. HDF5 reads the beginning of a collection first, and the rest by what that says. */
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

/* Write a piece; the superblock as it may stand on the disk. */
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
    /* The superblock comes last: all data to which it refers then exist. */
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

    /* A file that was truncated by others is not extended again. */
    if (size_of(ours->inner) < ours->size || H5FDtruncate(ours->inner, transfer, is_closing) < 0)
        return -1;
    ours->size = size_of(ours->inner);
    return 0;
}

/* Let files that are opened with these properties be written by this driver, and give its number to HDF5; a negative one where
   that fails. Each call makes a separate driver, so that HDF5 treats a file opened with another driver as another file. */
int64_t tandem_driver_set(int64_t access)
{
    static const H5FD_class_t driver = {
#if H5_VERSION_GE(1, 14, 0)
        .version = H5FD_CLASS_VERSION,
        /* An unregistered number. */
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

/* Release a driver after its file was closed, not before: HDF5 still reads data of a driver after releasing it for the file. A
   driver that is not released lasts until HDF5 ends. */
void tandem_driver_release(int64_t driver)
{
    if (driver >= 0)
        H5FDunregister((hid_t)driver);
}
