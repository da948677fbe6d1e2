/* SPDX-License-Identifier: LGPL-2.1-or-later */
#include "type.h"

#include <errno.h>
#include <stdlib.h>
#include <string.h>

#define FIELD_CHARACTERS "abcdefghijklmnopqrstuvwxyzABCDEFGHIJKLMNOPQRSTUVWXYZ0123456789_."

bool ddx_type_name_ok(const char *name) {
    size_t length = strnlen(name, DDX_NAME_MAX + 1);

    for (size_t i = 0; i < length; i++)
        if (name[i] < ' ' || name[i] > '~')
            return false;
    return length >= 1 && length <= DDX_NAME_MAX;
}

bool ddx_item_name_ok(const char *name) {
    return ddx_type_name_ok(name) && !strpbrk(name, " /");
}

struct ddx_layout *ddx_layout_opaque(uint64_t size) {
    struct ddx_layout *layout = calloc(1, ddx_layout_bytes(0));

    if (layout)
        layout->size = size;
    return layout;
}

struct ddx_layout *ddx_layout_copy(const struct ddx_layout *layout) {
    size_t bytes = ddx_layout_bytes(layout->field_count);
    struct ddx_layout *copy = malloc(bytes);

    return copy ? memcpy(copy, layout, bytes) : NULL;
}

int ddx_layout_use(struct ddx_layout *layout, const char *name, uint64_t bytes) {
    for (unsigned i = 0; i < layout->field_count; i = ddx_layout_after(layout, i)) {
        struct ddx_layout_field *field = &layout->field[i];

        if (strcmp(field->name, name))
            continue;
        if (bytes > (uint64_t)field->bytes * field->count)
            return -EINVAL;
        field->used = bytes;
        field->extent = 1;
        return 0;
    }
    return -EINVAL;
}

bool ddx_layout_extents(const struct ddx_layout *layout) {
    for (unsigned i = 0; i < layout->field_count; i++)
        if (layout->field[i].extent)
            return true;
    return false;
}

bool ddx_layout_empty(const struct ddx_layout *layout) {
    for (unsigned i = 0; i < layout->field_count; i = ddx_layout_after(layout, i))
        if (layout->field[i].used)
            return false;
    return layout->field_count > 0;
}

/* Identifiers, joined by dots; "" is a type that is not a struct. */
static bool is_field_name(const char *name) {
    size_t length = strnlen(name, DDX_NAME_MAX + 1);

    return length <= DDX_NAME_MAX && strspn(name, FIELD_CHARACTERS) == length;
}

static bool is_field_valid(const struct ddx_layout *layout, unsigned i, uint64_t begin, uint64_t end) {
    const struct ddx_layout_field *field = &layout->field[i];
    uint64_t bytes = (uint64_t)field->bytes * field->count;

    if (!is_field_name(field->name) || field->kind < DDX_KIND_INT || field->kind > DDX_KIND_STRUCT)
        return false;
    if (field->bytes < 1 || field->count < 1 || bytes > DDX_SIZE_MAX || field->used > bytes ||
        (!field->used && !field->extent))
        return false;
    if (field->offset < begin || field->offset > end || bytes > end - field->offset)
        return false;
    if (field->kind != DDX_KIND_STRUCT)
        return field->children == 0 && field->bytes <= 8 && (field->bytes & (field->bytes - 1)) == 0;
    unsigned last = i + field->children;
    if (field->children < 1 || last >= layout->field_count)
        return false;
    for (unsigned child = i + 1; child <= last; child = ddx_layout_after(layout, child)) {
        if (!is_field_valid(layout, child, field->offset, field->offset + field->bytes) ||
            child + layout->field[child].children > last)
            return false;
    }
    return true;
}

bool ddx_layout_valid(const struct ddx_layout *layout, size_t bytes) {
    if (bytes < ddx_layout_bytes(0) || layout->field_count > DDX_FIELDS_MAX ||
        bytes != ddx_layout_bytes(layout->field_count) || layout->size < 1 || layout->size > DDX_SIZE_MAX)
        return false;
    uint64_t begin = 0;
    for (unsigned i = 0; i < layout->field_count; i = ddx_layout_after(layout, i)) {
        const struct ddx_layout_field *field = &layout->field[i];

        if (!is_field_valid(layout, i, begin, layout->size))
            return false;
        begin = field->offset + (uint64_t)field->bytes * field->count;
    }
    return !ddx_layout_empty(layout);
}

bool ddx_layout_same(const struct ddx_layout *a, const struct ddx_layout *b) {
    if (a->size != b->size || a->field_count != b->field_count)
        return false;
    for (unsigned i = 0; i < a->field_count; i++) {
        const struct ddx_layout_field *x = &a->field[i], *y = &b->field[i];

        if (x->kind != y->kind || x->bytes != y->bytes || x->count != y->count || x->children != y->children ||
            x->offset != y->offset || x->used != y->used)
            return false;
    }
    return true;
}

/* Whether two fields are equal, except for the offset in the outermost struct, and for the bound if `open_bound`. */
static bool is_alike(const struct ddx_layout *a, unsigned i, const struct ddx_layout *b, unsigned j, bool open_bound) {
    const struct ddx_layout_field *x = &a->field[i], *y = &b->field[j];

    if (x->kind != y->kind || x->bytes != y->bytes || x->children != y->children ||
        (x->count != y->count && !open_bound))
        return false;
    for (unsigned child = 1; child <= x->children; child++) {
        const struct ddx_layout_field *u = &a->field[i + child], *v = &b->field[j + child];

        if (u->kind != v->kind || u->bytes != v->bytes || u->count != v->count || u->children != v->children ||
            u->offset - x->offset != v->offset - y->offset)
            return false;
    }
    return true;
}

/* One span for the whole struct; for opaque types. */
static int match_whole(const struct ddx_layout *item, struct ddx_span **spans, unsigned *count) {
    *spans = malloc(sizeof **spans);
    if (!*spans)
        return -ENOMEM;
    **spans = (struct ddx_span){0, 0, item->size};
    *count = 1;
    return 0;
}

static void add_span(struct ddx_span *spans, unsigned *count, struct ddx_span span) {
    struct ddx_span *last = *count ? &spans[*count - 1] : NULL;

    if (last && last->item + last->bytes == span.item && last->own + last->bytes == span.own)
        last->bytes += span.bytes;
    else
        spans[(*count)++] = span;
}

int ddx_layout_match(const struct ddx_layout *item, const struct ddx_layout *own, struct ddx_span **spans,
                     unsigned *count) {
    bool open = ddx_layout_extents(item);
    unsigned i = 0, j = 0;
    int result = 0;

    if ((!open || !own->field_count) && item->size != own->size)
        return -EMSGSIZE;
    if (open && !own->field_count)
        own = item; /* only the size of `own` is known, and it is equal: assume the same layout */
    if (!open && (item->field_count == 0 || own->field_count == 0))
        return match_whole(item, spans, count);
    *count = 0;
    *spans = calloc(item->field_count, sizeof **spans);
    if (!*spans)
        return -ENOMEM;
    /* With extents, a program may know only the first fields, and have bounds of its own. */
    for (; i < item->field_count && j < own->field_count; i = ddx_layout_after(item, i), j = ddx_layout_after(own, j)) {
        const struct ddx_layout_field *x = &item->field[i], *y = &own->field[j];

        if (!is_alike(item, i, own, j, x->extent) || (!open && x->offset != y->offset))
            result = -EPROTOTYPE;
        else if (!result && x->used > (uint64_t)y->bytes * y->count)
            result = -EMSGSIZE;
        if (x->used)
            add_span(*spans, count, (struct ddx_span){x->offset, y->offset, x->used});
    }
    if (j < own->field_count || (!open && i < item->field_count))
        result = -EPROTOTYPE;
    if (!result && !open) {
        /* Padding included: a plain struct is one memcpy. */
        (*spans)[0] = (struct ddx_span){0, 0, item->size};
        *count = 1;
    }
    if (result)
        free(*spans);
    return result;
}

int ddx_layout_may_become(const struct ddx_layout *old, const struct ddx_layout *fresh) {
    unsigned i = 0, j = 0;

    if (!ddx_layout_extents(old) && old->size != fresh->size)
        return -EMSGSIZE;
    if (old->field_count == 0 || fresh->field_count == 0)
        return old->size == fresh->size ? 0 : -EPROTOTYPE;
    for (; i < old->field_count && j < fresh->field_count;
         i = ddx_layout_after(old, i), j = ddx_layout_after(fresh, j)) {
        bool extent = old->field[i].extent && fresh->field[j].extent;

        if (!is_alike(old, i, fresh, j, extent) ||
            (!ddx_layout_extents(old) && old->field[i].offset != fresh->field[j].offset))
            return -EPROTOTYPE;
    }
    return i == old->field_count && j == fresh->field_count ? 0 : -EPROTOTYPE;
}
