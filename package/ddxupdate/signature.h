/* SPDX-License-Identifier: GPL-2.0-or-later */
/* Keys and signatures in the form of minisign 0.11: Ed25519 over BLAKE2b-512 ("prehashed", ED). The older form, which
 * signs the message itself (Ed), is refused. */
#ifndef DDXUPDATE_SIGNATURE_H
#define DDXUPDATE_SIGNATURE_H

#include <stdbool.h>
#include <stddef.h>
#include <stdint.h>

enum { SIGNATURE_MAX = 1024, KEY_FILE_MAX = 1024, KEY_ID = 8 }; /* bytes of a file, and of a key's number */

struct update_key {
    uint8_t id[KEY_ID], key[32];
};

struct signature {
    uint8_t id[KEY_ID], value[64], over_all[64]; /* the second one signs the first and the comment */
    const char *comment;                         /* in the text that was parsed */
    size_t comment_size;
};

bool key_parse(const char *text, size_t size, struct update_key *key);

/* NULL, or what is wrong with it. */
const char *signature_parse(const char *text, size_t size, struct signature *signature);

/* Whether the key has signed the message. */
bool signature_fits(const struct signature *signature, const struct update_key *key, const void *message, size_t size);

enum { KEYS_MAX = 32 };

/*
 * Read the keys that this image trusts: the files in this folder, /etc/ddx/update-keys. A key is revoked by leaving it
 * out of an image. A file that is no key is reported and left out. Returns the number of keys.
 */
unsigned keys_read(const char *folder, struct update_key keys[KEYS_MAX]);

#endif
