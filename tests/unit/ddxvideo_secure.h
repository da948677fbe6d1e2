/* SPDX-License-Identifier: GPL-2.0-or-later */
/* For the tests of encryption: a packet with room, and a sender or receiver with a key. */
#ifndef DDXVIDEO_TEST_SECURE_H
#define DDXVIDEO_TEST_SECURE_H

#include <sys/stat.h>

#include "../scratch.h"
#include "check.h"
#include "secure.h"

#define KEY "e1f97a0d3e018be0d64fa32c06de41390ec675ad498afeebb6960b3aabe6" /* of RFC 3711, B.3 */
#define SSRC 0xcafebabe

struct packet {
    uint8_t data[SECURE_PACKET_MAX + SECURE_ROOM] __attribute__((aligned(4)));
    size_t size;
};

static inline struct secure *secure_with(const char *key) {
    char *path = scratch_path("key"), error[KEY_FILE_ERROR_MAX];
    FILE *file = fopen(path, "w");

    CHECK(file && fputs(key, file) >= 0 && !fclose(file) && !chmod(path, 0600));
    struct secure *secure = secure_open(path, error);
    if (!secure)
        fprintf(stderr, "%s\n", error);
    CHECK(secure);
    free(path);
    return secure;
}

#endif
