/* SPDX-License-Identifier: GPL-2.0-or-later */
/* The fields of a type, for form.c and schema.c. */
#ifndef DDX_FIELDS_H
#define DDX_FIELDS_H

#include <ddx.h>
#include <stdbool.h>

/* A copy of struct ddx_field, with short names. */
struct form_field {
    char name[DDX_NAME_MAX + 1];
    enum ddx_kind kind;
    uint32_t bytes, count, bound; /* elements in use; as declared */
    uint32_t children;
    uint64_t offset;
    bool extent;
};

struct form_fields {
    struct form_field *field;
    unsigned count;
};

/* A ros2msg schema, and its name; the caller frees them. NULL: no memory. */
char *form_schema(const struct form_fields *fields, const char *type);
char *form_schema_name(const char *type);

#endif
