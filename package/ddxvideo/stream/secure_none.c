/* SPDX-License-Identifier: GPL-2.0-or-later */
/* Replaces secure.c in a build without libsrtp2: no key can be read, so the other functions are never called with
 * one. */
#include <errno.h>
#include <stdio.h>

#include "secure.h"

struct secure *secure_open(const char *path, char *error) {
    snprintf(error, KEY_FILE_ERROR_MAX, "%.200s: this build has no encryption, because libsrtp2 was missing", path);
    return NULL;
}

void secure_close(struct secure *secure) {
    (void)secure;
}

int secure_protect(struct secure *secure, uint8_t *packet, size_t *size) {
    (void)secure, (void)packet, (void)size;
    return -EINVAL;
}

int secure_protect_report(struct secure *secure, uint8_t *packet, size_t *size) {
    return secure_protect(secure, packet, size);
}

int secure_unprotect(struct secure *secure, uint8_t *packet, size_t *size) {
    (void)secure, (void)packet, (void)size;
    return -EBADMSG;
}

int secure_unprotect_report(struct secure *secure, uint8_t *packet, size_t *size) {
    return secure_unprotect(secure, packet, size);
}

const struct secure_count *secure_received(const struct secure *secure) {
    static const struct secure_count none;

    (void)secure;
    return &none;
}

const struct secure_count *secure_received_reports(const struct secure *secure) {
    return secure_received(secure);
}

size_t secure_sdp(const struct secure *secure, char *text) {
    (void)secure;
    *text = 0;
    return 0;
}
