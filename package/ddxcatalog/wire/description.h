/* SPDX-License-Identifier: GPL-2.0-or-later */
/*
 * The description of a message for ROS 2 and DDS: structs of named fields. It is made from the text of a ros2msg
 * schema, which form.h has for an item. The first message is the one that is sent; it contains the others.
 */
#ifndef DDXCATALOG_DESCRIPTION_H
#define DDXCATALOG_DESCRIPTION_H

#include <stdbool.h>
#include <stddef.h>
#include <stdint.h>

#define DESCRIPTION_NAME 160

/* Numbers as in ROS's type_description_interfaces/msg/FieldType, since they are part of a type's hash. */
enum description_kind {
    DESCRIPTION_NESTED = 1,
    DESCRIPTION_INT8,
    DESCRIPTION_UINT8,
    DESCRIPTION_INT16,
    DESCRIPTION_UINT16,
    DESCRIPTION_INT32,
    DESCRIPTION_UINT32,
    DESCRIPTION_INT64,
    DESCRIPTION_UINT64,
    DESCRIPTION_FLOAT,
    DESCRIPTION_DOUBLE,
    DESCRIPTION_STRING = 17
};

struct description_field {
    char name[DESCRIPTION_NAME];
    enum description_kind kind;
    uint32_t count;              /* elements of an array, 0: no array */
    bool sequence;               /* any number of elements */
    char type[DESCRIPTION_NAME]; /* DESCRIPTION_NESTED: "ddx/SENSORWheel" */
};

struct description_message {
    char type[DESCRIPTION_NAME]; /* "ddx/SENSOR" */
    struct description_field *fields;
    unsigned count;
};

struct description {
    struct description_message *messages;
    unsigned count;
};

/*
 * `type`: of the first message, "ddx/msg/SENSOR". If several fields get the same name, a number is added. 0, -EINVAL
 * (not such a text, or a message is missing), -ENOMEM. The result is the caller's, until description_free().
 */
int description_parse(const char *type, const char *schema, struct description **result);

/* NULL is allowed. */
void description_free(struct description *description);

/* The message of this type, or NULL. */
const struct description_message *description_find(const struct description *description, const char *type);

/* ---- ROS 2's hash of a type (REP 2016), with which its tools notice that two programs use different structs ---- */

#define TYPEHASH_MAX 80 /* bytes of "RIHS01_<64 hexadecimal digits>", with the 0 byte */

/* 0, -ENOMEM. */
int typehash(const struct description *description, char text[TYPEHASH_MAX]);

#define SHA256_BYTES 32

/* SHA-256 (FIPS 180-4) of a short text. */
void sha256(const void *data, size_t size, uint8_t digest[SHA256_BYTES]);

#endif
