/* SPDX-License-Identifier: MIT */
/* Reads all contents of an HDF5 file except the rows: headers of objects, indices of datasets, and attributes. */
#include <hdf5.h>
#include <stdlib.h>
#include <string.h>

/* Largest depth of groups, which is 2 in files of tandem, and largest depth at which lists of users of scales are read. A deeper
   scale is a link to the time, which has one link per reported joint and a list of the same length: reading it for each link would
   take quadratic time. */
enum { deepest = 8, deepest_scale = 2 };

/* State of the search. Texts are stored outside the attributes, in collections without checksums. Unreadable texts are counted
   instead of reported, because they may have been incomplete when the program was killed. The checksum of the texts that stay
   constant during a run is the 64-bit FNV-1a hash (Fowler, Noll and Vo 1991) of the null-terminated names of objects and
   attributes and of the texts. */
struct contents {
    int lost;
    uint64_t sum;
    const char *object;
    int depth, in_report, in_events, in_singular;
};

static void add(struct contents *found, const char *text)
{
    do
        found->sum = (found->sum ^ (unsigned char)*text) * 0x100000001b3u;
    while (*text++);
}

/* True for text attributes that change at the end of a run. */
static int changes(const struct contents *found, const char *attribute)
{
    return found->in_report || found->in_singular ||
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
        /* Only texts of variable length were allocated by HDF5 and must be released. */
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

/* Read an object with all its contents; 0 on success. */
static int read_object(hid_t place, const char *name, int depth, struct contents *found)
{
    hid_t object = depth > deepest ? -1 : H5Oopen(place, name, H5P_DEFAULT);
    H5G_info_t group;
    char member[256];
    int stat;

    found->object = name;
    found->depth = depth;
    if (depth == 1) {
        found->in_report = strcmp(name, "report") == 0;
        found->in_events = strcmp(name, "events") == 0;
    }
    if (depth <= 2)
        found->in_singular = depth == 2 && found->in_events && strcmp(name, "singular") == 0;
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

/* Returns the number of unreadable texts; -1 if anything else is unreadable. */
int tandem_contents_read(int64_t file, uint64_t *sum)
{
    struct contents found = {0, 0xcbf29ce484222325u, NULL, 0, 0, 0, 0};
    int stat = read_object((hid_t)file, "/", 0, &found);

    *sum = found.sum;
    return stat < 0 ? -1 : found.lost;
}
