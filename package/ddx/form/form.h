/* SPDX-License-Identifier: GPL-2.0-or-later */
/*
 * The layout of an item's values in a file (ddxlog) and on the network (catalog): as in ROS 2 (CDR, little endian,
 * after its header of four bytes), described by a ros2msg schema, so that the usual tools show them. It differs from a
 * C struct only in padding, so a value is packed by a few copies, in most cases one. Padding, and bytes beyond an
 * extent, are omitted, so the message is the same for 32-bit and 64-bit machines.
 */
#ifndef DDX_FORM_H
#define DDX_FORM_H

#include <ddx.h>
#include <stdbool.h>

#define FORM_ENCODING "cdr"
#define FORM_SCHEMA_ENCODING "ros2msg"
#define FORM_HEADER 4
#define FORM_LEAVES_MAX 65536

/* A number, or an array of numbers: a field, or a field of one element in an array of structs. */
struct form_leaf {
    char *name; /* "wheel[1].gears" */
    enum ddx_kind kind;
    uint32_t bytes, count;
    uint64_t item;  /* offset in the item */
    size_t message; /* offset in the message */
};

struct form_span {
    uint64_t item;
    size_t message, bytes;
};

struct form {
    char *declaration; /* "struct { int32_t a; ... }"; "" for a type of which only the size is known */
    char *extents;     /* "y=101376 u=0": bytes in use of outermost fields, "" if no field has an extent */
    char *schema;      /* ros2msg */
    char *schema_name; /* "ddx/msg/SENSOR" */
    char type[DDX_NAME_MAX + 1];
    uint64_t item_size;
    size_t message_size;
    struct form_leaf *leaves;
    unsigned leaf_count;
    struct form_span *spans;
    unsigned span_count;
};

/* The form of an open item, with its current layout. 0, -ENOMEM, -E2BIG (more than FORM_LEAVES_MAX), -ECONNREFUSED. */
int form_of_item(DDX_STORE_ITEM *item, struct form **form);

/*
 * The form of a channel in a log, without a store: leaves and sizes in the message, not in the item. -EINVAL: not a
 * declaration, or one whose sizes depend on the machine, as form_of_item() makes none.
 */
int form_of_text(const char *type, const char *declaration, const char *extents, struct form **form);

/* The size of the form that form_of_text() would make; `bytes`: the memory of its leaves and spans, about. */
struct form_measures {
    unsigned leaves;
    size_t message_size, bytes;
};

/* Measure a form without making it: needs little memory, whatever the declaration is. Errors as form_of_text(). */
int form_measure(const char *declaration, const char *extents, struct form_measures *measures);

void form_free(struct form *form);

/* Whether both have the same type, declaration, extents and sizes. */
bool form_same(const struct form *a, const struct form *b);

/* Convert form->extents to the store's form; `text` is cut into pieces. Returns their number, at most `room`. */
unsigned form_list_extents(char *text, struct ddx_extent *extents, unsigned room);

/* Pack a value into message[message_size]; unpack a message into a value of the item. */
void form_pack(const struct form *form, const void *value, unsigned char *message);
void form_unpack(const struct form *form, const unsigned char *message, void *value);

#endif
