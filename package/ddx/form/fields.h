/* SPDX-License-Identifier: GPL-2.0-or-later */
/* Between form.c, schema.c and declaration.c: the fields of a type. */
#ifndef DDX_FIELDS_H
#define DDX_FIELDS_H

#include <ddx.h>
#include <stdbool.h>

/* As struct ddx_field, of which it is a copy; names are short. */
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

/* The text of a C declaration, a list of its extents; to free(). NULL: no memory. */
char *form_declaration(const struct form_fields *fields);
char *form_extents(const struct form_fields *fields);
/* The reverse; fields->field is to free(), offsets are 0. -EINVAL, -ENOMEM. */
int form_parse(const char *declaration, const char *extents, struct form_fields *fields);
/* A ros2msg schema, and its name; to free(). NULL: no memory. */
char *form_schema(const struct form_fields *fields, const char *type);
char *form_schema_name(const char *type);

#endif
