/* SPDX-License-Identifier: GPL-2.0-or-later */
#include "form.h"

#include <errno.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

#include "fields.h"
#include "type.h"

/* ---- An item's fields as a C declaration, in types of fixed width, and such a declaration as fields again ---- */

static const struct {
    const char *name;
    enum ddx_kind kind;
    uint32_t bytes;
} types[] = {
    {"int8_t", DDX_KIND_INT, 1},        {"int16_t", DDX_KIND_INT, 2},       {"int32_t", DDX_KIND_INT, 4},
    {"int64_t", DDX_KIND_INT, 8},       {"uint8_t", DDX_KIND_UNSIGNED, 1},  {"uint16_t", DDX_KIND_UNSIGNED, 2},
    {"uint32_t", DDX_KIND_UNSIGNED, 4}, {"uint64_t", DDX_KIND_UNSIGNED, 8}, {"float", DDX_KIND_FLOAT, 4},
    {"double", DDX_KIND_FLOAT, 8},      {"char", DDX_KIND_CHAR, 1},
};
#define TYPES (sizeof types / sizeof *types)

static const char *type_name(const struct form_field *field) {
    for (size_t i = 0; i < TYPES; i++)
        if (types[i].kind == field->kind && types[i].bytes == field->bytes)
            return types[i].name;
    return "char";
}

static void write_fields(FILE *to, const struct form_fields *fields, unsigned first, unsigned end) {
    for (unsigned i = first; i < end; i += 1 + fields->field[i].children) {
        const struct form_field *field = &fields->field[i];

        if (field->kind == DDX_KIND_STRUCT) {
            fputs("struct { ", to);
            write_fields(to, fields, i + 1, i + 1 + field->children);
            fprintf(to, "} %s", field->name);
        } else {
            fprintf(to, "%s %s", type_name(field), field->name);
        }
        if (field->bound > 1)
            fprintf(to, "[%u]", (unsigned)field->bound);
        fputs("; ", to);
    }
}

/* The text of a C declaration; the caller frees it. NULL: no memory. */
static char *declaration_of(const struct form_fields *fields) {
    char *text = NULL;
    size_t size;
    FILE *to = open_memstream(&text, &size);

    if (!to)
        return NULL;
    if (fields->count == 1 && !*fields->field->name) {
        fputs(type_name(fields->field), to);
    } else {
        fputs("struct { ", to);
        write_fields(to, fields, 0, fields->count);
        fputs("}", to);
    }
    bool bad = ferror(to);
    if (fclose(to) || bad) {
        free(text);
        return NULL;
    }
    return text;
}

/* The list of the extents; the caller frees it. NULL: no memory. */
static char *extents_of(const struct form_fields *fields) {
    char *text = NULL;
    size_t size;
    FILE *to = open_memstream(&text, &size);

    if (!to)
        return NULL;
    const char *space = "";
    for (unsigned i = 0; i < fields->count; i += 1 + fields->field[i].children)
        if (fields->field[i].extent) {
            fprintf(to, "%s%s=%llu", space, fields->field[i].name,
                    (unsigned long long)fields->field[i].bytes * fields->field[i].count);
            space = " ";
        }
    bool bad = ferror(to);
    if (fclose(to) || bad) {
        free(text);
        return NULL;
    }
    return text;
}

/* Apply the extents. A struct field has no size here, so it cannot have an extent. */
static int apply_extents(struct form_fields *fields, const char *extents) {
    while (*extents) {
        size_t length = strcspn(extents, "=");
        char *end;
        struct form_field *found = NULL;

        for (unsigned i = 0; i < fields->count && !found; i += 1 + fields->field[i].children)
            if (strlen(fields->field[i].name) == length && !strncmp(fields->field[i].name, extents, length))
                found = &fields->field[i];
        if (!found || extents[length] != '=' || !found->bytes)
            return -EINVAL;
        unsigned long long bytes = strtoull(extents + length + 1, &end, 10);
        if (end == extents + length + 1 || bytes / found->bytes > found->bound || (bytes && bytes < found->bytes))
            return -EINVAL;
        found->count = (uint32_t)(bytes / found->bytes);
        found->extent = true;
        extents = end + strspn(end, " ");
    }
    return 0;
}

/* The reverse; the caller frees fields->field; offsets are 0. -EINVAL, -ENOMEM. */
static int parse_fields(const char *declaration, const char *extents, struct form_fields *fields) {
    struct ddx_layout *layout;
    int error = ddx_layout_parse_portable(declaration, &layout);

    *fields = (struct form_fields){NULL, 0};
    if (error)
        return error;
    fields->field = calloc(layout->field_count, sizeof *fields->field);
    for (; fields->field && fields->count < layout->field_count; fields->count++) {
        const struct ddx_layout_field *from = &layout->field[fields->count];
        struct form_field *to = &fields->field[fields->count];
        const char *dot = strrchr(from->name, '.');

        *to = (struct form_field){
            .kind = from->kind, .count = from->count, .bound = from->count, .children = from->children};
        if (to->kind != DDX_KIND_STRUCT) /* a struct's size depends on the machine */
            to->bytes = from->bytes;
        snprintf(to->name, sizeof to->name, "%s", dot ? dot + 1 : from->name);
    }
    free(layout);
    return fields->field ? apply_extents(fields, extents) : -ENOMEM;
}

unsigned form_list_extents(char *text, struct ddx_extent *extents, unsigned room) {
    unsigned count = 0;

    for (char *word, *rest = text; count < room && (word = strtok_r(rest, " ", &rest));) {
        char *equals = strchr(word, '=');

        if (!equals)
            continue;
        *equals = 0;
        extents[count++] = (struct ddx_extent){word, strtoull(equals + 1, NULL, 10)};
    }
    return count;
}

/* ---- The form ---- */

#define ALLOCATED 32 /* bytes of the smallest piece of memory with its management, at most */

struct walk {
    const struct form_fields *fields;
    struct form *form;
    size_t message; /* after the header */
};

/* CDR aligns each number by its own size, counted from the end of the header. Returns where the field begins. */
static int place(size_t *message, const struct form_field *field, size_t *begin) {
    *begin = (*message + field->bytes - 1) / field->bytes * field->bytes;
    /* In 64 bits: a declaration of another machine may name more bytes than this one can address. */
    uint64_t end = *begin + (uint64_t)field->bytes * field->count;
    if (end > UINT64_C(1) << 30)
        return -E2BIG;
    *message = (size_t)end;
    return 0;
}

static int add_leaf(struct walk *walk, const struct form_field *field, const char *prefix, uint64_t shift) {
    struct form *form = walk->form;

    if (form->leaf_count == FORM_LEAVES_MAX)
        return -E2BIG;
    if (!(form->leaf_count & (form->leaf_count - 1))) {
        size_t room = form->leaf_count ? form->leaf_count * 2 : 1;
        struct form_leaf *more = realloc(form->leaves, room * sizeof *more);

        if (!more)
            return -ENOMEM;
        form->leaves = more;
    }
    size_t begin;
    int error = place(&walk->message, field, &begin);
    if (error)
        return error;
    struct form_leaf leaf = {.kind = field->kind,
                             .bytes = field->bytes,
                             .count = field->count,
                             .item = field->offset + shift,
                             .message = FORM_HEADER + begin};
    if (asprintf(&leaf.name, "%s%s", prefix, *field->name ? field->name : "value") < 0)
        return -ENOMEM;
    form->leaves[form->leaf_count++] = leaf;
    return 0;
}

/* Add all fields from `first` up to `end`, with their offsets increased by `shift`. */
static int walk_fields(struct walk *walk, unsigned first, unsigned end, const char *prefix, uint64_t shift) {
    for (unsigned i = first; i < end; i += 1 + walk->fields->field[i].children) {
        const struct form_field *field = &walk->fields->field[i];
        int error = 0;

        if (field->kind != DDX_KIND_STRUCT && field->count)
            error = add_leaf(walk, field, prefix, shift);
        for (uint32_t k = 0; field->kind == DDX_KIND_STRUCT && k < field->count && !error; k++) {
            char *inner;

            if ((field->bound > 1 ? asprintf(&inner, "%s%s[%u].", prefix, field->name, (unsigned)k)
                                  : asprintf(&inner, "%s%s.", prefix, field->name)) < 0)
                return -ENOMEM;
            error = walk_fields(walk, i + 1, i + 1 + field->children, inner, shift + (uint64_t)k * field->bytes);
            free(inner);
        }
        if (error)
            return error;
    }
    return 0;
}

/* Adjacent leaves become one span, also with padding between them if it is the same in item and message. */
static int make_spans(struct form *form) {
    form->spans = calloc(form->leaf_count, sizeof *form->spans);
    if (!form->spans)
        return -ENOMEM;
    for (unsigned i = 0; i < form->leaf_count; i++) {
        const struct form_leaf *leaf = &form->leaves[i];
        struct form_span *last = form->span_count ? &form->spans[form->span_count - 1] : NULL;
        size_t bytes = (size_t)leaf->bytes * leaf->count;
        size_t gap = last ? leaf->message - last->message - last->bytes : 0;

        if (last && leaf->item == last->item + last->bytes + gap)
            last->bytes += gap + bytes;
        else
            form->spans[form->span_count++] = (struct form_span){leaf->item, leaf->message, bytes};
    }
    return 0;
}

static int make_form(const struct form_fields *fields, const char *type, struct form **result) {
    struct form *form = calloc(1, sizeof *form);

    if (!form)
        return -ENOMEM;
    struct walk walk = {fields, form, 0};
    snprintf(form->type, sizeof form->type, "%s", type);
    form->declaration = declaration_of(fields);
    form->extents = extents_of(fields);
    form->schema = form_schema(fields, type);
    form->schema_name = form_schema_name(type);
    int error = !form->declaration || !form->extents || !form->schema || !form->schema_name ? -ENOMEM : 0;
    if (!error)
        error = walk_fields(&walk, 0, fields->count, "", 0);
    if (!error)
        error = form->leaf_count ? make_spans(form) : -EINVAL;
    form->message_size = FORM_HEADER + walk.message;
    if (error)
        form_free(form);
    else
        *result = form;
    return error;
}

/* A type of which only the size is known is an array of bytes. */
static int make_opaque(uint64_t size, const char *type, struct form **form) {
    struct form_field field = {.name = "data", .kind = DDX_KIND_UNSIGNED, .bytes = 1, .count = (uint32_t)size};

    field.bound = field.count;
    struct form_fields fields = {&field, 1};
    int error = size && size <= UINT32_MAX ? make_form(&fields, type, form) : -EINVAL;
    if (!error)
        *(*form)->declaration = 0;
    return error;
}

static void copy_field(struct form_field *to, const struct ddx_field *from) {
    const char *dot = strrchr(from->name, '.');

    *to = (struct form_field){.kind = from->kind,
                              .bytes = from->bytes,
                              .count = (uint32_t)(from->used / from->bytes),
                              .bound = from->count,
                              .children = from->children,
                              .offset = from->offset,
                              .extent = from->extent != 0};
    snprintf(to->name, sizeof to->name, "%s", dot ? dot + 1 : from->name);
}

int form_of_item(DDX_STORE_ITEM *item, struct form **form) {
    struct form_fields fields = {NULL, 0};
    struct ddx_item_info info;
    const struct ddx_field *from;
    int error = 0;

    while (ddx_store_field(item, fields.count))
        fields.count++;
    if (!fields.count) {
        error = ddx_store_item_info(item, &info);
        if (!error)
            error = make_opaque(info.size, ddx_store_item_type(item), form);
        if (!error)
            (*form)->item_size = info.size;
        return error;
    }
    fields.field = calloc(fields.count, sizeof *fields.field);
    if (!fields.field)
        return -ENOMEM;
    uint64_t end = 0;
    for (unsigned i = 0; i < fields.count; i++) {
        if (!(from = ddx_store_field(item, i))) {
            free(fields.field);
            return -EAGAIN;
        }
        copy_field(&fields.field[i], from);
        if (from->offset + (uint64_t)from->bytes * from->count > end)
            end = from->offset + (uint64_t)from->bytes * from->count;
    }
    error = make_form(&fields, ddx_store_item_type(item), form);
    if (!error)
        (*form)->item_size = end;
    free(fields.field);
    return error;
}

int form_of_text(const char *type, const char *declaration, const char *extents, struct form **form) {
    struct form_fields fields = {NULL, 0};
    int error = parse_fields(declaration, extents, &fields);

    if (!error)
        error = make_form(&fields, type, form);
    free(fields.field);
    return error;
}

static unsigned digits(uint32_t number) {
    return number < 10 ? 1 : 1 + digits(number / 10);
}

/* As walk_fields(); `prefix`: the length of the names before. */
static int measure_fields(const struct form_fields *fields, unsigned first, unsigned end, size_t prefix,
                          size_t *message, struct form_measures *measures) {
    for (unsigned i = first; i < end; i += 1 + fields->field[i].children) {
        const struct form_field *field = &fields->field[i];
        size_t begin, name = prefix + strlen(field->name) + 1; /* with the 0 byte, or a dot */
        int error = 0;

        if (field->kind != DDX_KIND_STRUCT && field->count) {
            error = measures->leaves++ == FORM_LEAVES_MAX ? -E2BIG : place(message, field, &begin);
            measures->bytes += sizeof(struct form_leaf) + sizeof(struct form_span) + ALLOCATED + name;
        }
        for (uint32_t k = 0; field->kind == DDX_KIND_STRUCT && k < field->count && !error; k++)
            error = measure_fields(fields, i + 1, i + 1 + field->children,
                                   name + (field->bound > 1 ? 2 + digits(k) : 0), message, measures);
        if (error)
            return error;
    }
    return 0;
}

int form_measure(const char *declaration, const char *extents, struct form_measures *measures) {
    struct form_fields fields = {NULL, 0};
    size_t message = 0;
    int error = parse_fields(declaration, extents, &fields);

    *measures = (struct form_measures){0, 0, 0};
    if (!error)
        error = measure_fields(&fields, 0, fields.count, 0, &message, measures);
    free(fields.field);
    measures->message_size = FORM_HEADER + message;
    return error ? error : measures->leaves ? 0 : -EINVAL;
}

void form_free(struct form *form) {
    if (!form)
        return;
    for (unsigned i = 0; i < form->leaf_count; i++)
        free(form->leaves[i].name);
    free(form->leaves);
    free(form->spans);
    free(form->declaration);
    free(form->extents);
    free(form->schema);
    free(form->schema_name);
    free(form);
}

bool form_same(const struct form *a, const struct form *b) {
    return a->item_size == b->item_size && a->message_size == b->message_size && !strcmp(a->type, b->type) &&
           !strcmp(a->declaration, b->declaration) && !strcmp(a->extents, b->extents);
}

void form_pack(const struct form *form, const void *value, unsigned char *message) {
    static const unsigned char header[FORM_HEADER] = {0, 1, 0, 0}; /* CDR, little endian */
    size_t at = FORM_HEADER;

    memcpy(message, header, sizeof header);
    for (unsigned i = 0; i < form->span_count; i++) {
        const struct form_span *span = &form->spans[i];

        memset(message + at, 0, span->message - at);
        memcpy(message + span->message, (const unsigned char *)value + span->item, span->bytes);
        at = span->message + span->bytes;
    }
}

void form_unpack(const struct form *form, const unsigned char *message, void *value) {
    for (unsigned i = 0; i < form->span_count; i++) {
        const struct form_span *span = &form->spans[i];

        memcpy((unsigned char *)value + span->item, message + span->message, span->bytes);
    }
}
