/* SPDX-License-Identifier: MIT */
/* Reads what an HDF5 file holds besides its rows: the headers of all objects, the indices of all datasets, and all attributes. */
#include <hdf5.h>
#include <stdlib.h>
#include <string.h>

/* Groups in groups; ours are two deep. Below that a scale is a link to one above, whose users are not read again: the time has a
   link for each joint that is told of, and as many users. */
enum { deepest = 8, deepest_scale = 2 };

/* Contents found. Texts are stored apart from the attributes, in collections without checksums. Unreadable texts are counted:
   they may have been in transit when the program was killed. Texts that stay constant during a run have a sum: FNV-1a (Fowler, Noll
   and Vo 1991) of 64 bits over the names of objects and attributes and the letters, each with the 0 that ends it. */
struct contents {
    int lost;
    uint64_t sum;
    const char *object;
    int depth, in_report;
};

static void add(struct contents *found, const char *text)
{
    do
        found->sum = (found->sum ^ (unsigned char)*text) * 0x100000001b3u;
    while (*text++);
}

/* True for texts that a run changes at its end. */
static int changes(const struct contents *found, const char *attribute)
{
    return found->in_report ||
           (strcmp(found->object, "/") == 0 && (strcmp(attribute, "status") == 0 || strcmp(attribute, "status_message") == 0));
}

static herr_t read_attribute(hid_t object, const char *name, const H5A_info_t *info, void *data)
{
    struct contents *found = data;
    hid_t attribute, type = -1, space = -1;
    hssize_t count;
    herr_t stat = -1;
    void *values = NULL;

    (void)info;
    if (found->depth > deepest_scale && strcmp(name, "REFERENCE_LIST") == 0)
        return 0;
    attribute = H5Aopen(object, name, H5P_DEFAULT);
    if (attribute >= 0)
        type = H5Aget_type(attribute);
    if (attribute >= 0)
        space = H5Aget_space(attribute);
    count = space >= 0 ? H5Sget_simple_extent_npoints(space) : -1;
    if (type >= 0 && count >= 0)
        values = calloc((size_t)count + 1, H5Tget_size(type));
    if (values) {
        stat = H5Aread(attribute, type, values);
        /* References to other objects are no memory of ours. */
        if (H5Tget_class(type) == H5T_STRING && H5Tis_variable_str(type) > 0) {
            if (stat >= 0 && !changes(found, name)) {
                add(found, found->object);
                add(found, name);
                for (hssize_t i = 0; i < count; i++)
                    add(found, ((char **)values)[i] ? ((char **)values)[i] : "");
            }
            H5Dvlen_reclaim(type, space, H5P_DEFAULT, values);
            found->lost += stat < 0;
            stat = 0;
        }
        free(values);
    }
    if (space >= 0)
        H5Sclose(space);
    if (type >= 0)
        H5Tclose(type);
    if (attribute >= 0)
        H5Aclose(attribute);
    return stat < 0 ? -1 : 0;
}

/* 0 if an object and all its contents were read. */
static int read_object(hid_t place, const char *name, int depth, struct contents *found)
{
    hid_t object = depth > deepest ? -1 : H5Oopen(place, name, H5P_DEFAULT);
    H5G_info_t group;
    char member[256];
    int stat;

    found->object = name;
    found->depth = depth;
    if (depth == 1)
        found->in_report = strcmp(name, "report") == 0;
    stat = object < 0 || H5Aiterate2(object, H5_INDEX_NAME, H5_ITER_INC, NULL, read_attribute, found) < 0 ? -1 : 0;
    if (stat == 0 && H5Iget_type(object) == H5I_GROUP) {
        stat = H5Gget_info(object, &group) < 0 ? -1 : 0;
        for (hsize_t i = 0; stat == 0 && i < group.nlinks; i++) {
            if (H5Lget_name_by_idx(object, ".", H5_INDEX_NAME, H5_ITER_INC, i, member, sizeof member, H5P_DEFAULT) < 0)
                stat = -1;
            else
                stat = read_object(object, member, depth + 1, found);
        }
    }
    if (object >= 0)
        H5Oclose(object);
    return stat;
}

/* How many texts cannot be read; -1 where something else cannot. */
int tandem_contents_read(int64_t file, uint64_t *sum)
{
    struct contents found = {0, 0xcbf29ce484222325u, NULL, 0, 0};
    int stat = read_object((hid_t)file, "/", 0, &found);

    *sum = found.sum;
    return stat < 0 ? -1 : found.lost;
}
