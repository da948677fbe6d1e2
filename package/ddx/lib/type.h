/* SPDX-License-Identifier: LGPL-2.1-or-later */
/* The layout of an item's struct: parsed from C text, compared, sent between programs. */
#ifndef DDX_TYPE_H
#define DDX_TYPE_H

#include <stdbool.h>

#include "ddx.h"

#define DDX_FIELDS_MAX 200u
#define DDX_SIZE_MAX ((uint64_t)1 << 30)

/* As sent in messages: fixed width. Outermost fields are in the order of their offsets. */
struct ddx_layout_field {
    char name[DDX_NAME_MAX + 1];
    uint8_t kind;   /* enum ddx_kind */
    uint8_t extent; /* `used` was given: the array bound is not part of the type */
    uint16_t children;
    uint32_t bytes, count;
    uint32_t unused;
    uint64_t offset, used;
};

/* No fields: an opaque type, of which only name and size are known. */
struct ddx_layout {
    uint64_t size;
    uint32_t field_count;
    uint32_t unused;
    struct ddx_layout_field field[];
};

/*
 * Valid names of an item or a type: 1 to DDX_NAME_MAX printable ASCII characters, since names are listed and logged
 * without escaping. An item's name has no blank and no '/'.
 */
bool ddx_item_name_ok(const char *name);
bool ddx_type_name_ok(const char *name);

/* Memory of a layout with that number of fields, in bytes. */
static inline size_t ddx_layout_bytes(unsigned fields) {
    return sizeof(struct ddx_layout) + fields * sizeof(struct ddx_layout_field);
}

/*
 * Parse "struct { int a; char b[64]; }" or "int" by this program's own ABI. The caller frees the result with free().
 * -EINVAL: not understood, or cannot be shared; -ENOMEM.
 */
int ddx_layout_parse(const char *text, struct ddx_layout **layout);

/* The same with the types of a list; on -EINVAL *bad points to the word that is not understood. */
int ddx_layout_parse_known(const char *text, const struct ddx_type_declaration_ *known, struct ddx_layout **layout,
                           const char **bad);

/* The same for text of another machine: -EINVAL for types whose size depends on the machine. */
int ddx_layout_parse_portable(const char *text, struct ddx_layout **layout);

/* The first declaration of this name by DDX_STORE_TYPE, or NULL. */
const struct ddx_type_declaration_ *ddx_type_declared(const char *name);

/*
 * The layout of the type that this program knows by `name`: declared by DDX_STORE_TYPE, or a plain C type ("int").
 * -ENOENT: neither; -EPROTOTYPE: declared twice and differently; else as ddx_layout_parse().
 */
int ddx_layout_of(const char *name, struct ddx_layout **layout);

/* A layout of which only the size is known. NULL: no memory. */
struct ddx_layout *ddx_layout_opaque(uint64_t size);

struct ddx_layout *ddx_layout_copy(const struct ddx_layout *layout);

/* Use only the first `bytes` of an outermost field; 0: none. -EINVAL: no such field, or longer than the field. */
int ddx_layout_use(struct ddx_layout *layout, const char *field, uint64_t bytes);

/* Whether any field has an extent. */
bool ddx_layout_extents(const struct ddx_layout *layout);

/* Whether the extents leave no byte in use, which is not allowed for an item. */
bool ddx_layout_empty(const struct ddx_layout *layout);

/* Whether this layout, received in `bytes` bytes, is consistent and safe to use. */
bool ddx_layout_valid(const struct ddx_layout *layout, size_t bytes);

/* Whether the layouts are equal, extents included, so that a value of one is also a value of the other. */
bool ddx_layout_same(const struct ddx_layout *a, const struct ddx_layout *b);

/* Index of the outermost field after field i; field_count at the end. */
static inline unsigned ddx_layout_after(const struct ddx_layout *layout, unsigned i) {
    return i + 1u + layout->field[i].children;
}

/* A range of `bytes` bytes, at offset `item` in the item and `own` in the caller's struct. */
struct ddx_span {
    uint64_t item, own, bytes;
};

/*
 * Where the ranges of a value are in the item's layout and in a program's `own` struct: spans (to free()) and their
 * count. 0; -EPROTOTYPE: different types; -EMSGSIZE: same type but other size, or the bytes in use do not fit.
 */
int ddx_layout_match(const struct ddx_layout *item, const struct ddx_layout *own, struct ddx_span **spans,
                     unsigned *count);

/* Whether an item of layout `old` may get layout `fresh`: only extents and the bounds of their fields may differ. */
int ddx_layout_may_become(const struct ddx_layout *old, const struct ddx_layout *fresh);

#endif
