/* SPDX-License-Identifier: GPL-2.0-or-later */
/*
 * A request of the web server (SCGI): headers as one netstring, then the body. The bytes come from the network, through
 * lighttpd.
 */
#ifndef DDXPANEL_SCGI_H
#define DDXPANEL_SCGI_H

#include <stddef.h>

#define SCGI_HEAD_MAX (16u << 10) /* bytes of all headers: lighttpd takes 8 KiB of the browser's and adds its own */
#define SCGI_BODY_MAX (64u << 10)
#define SCGI_MAX (SCGI_HEAD_MAX + SCGI_BODY_MAX + 16)

struct scgi {
    const char *head; /* names and values, each with its 0 byte */
    size_t head_size;
    const char *body; /* not terminated */
    size_t body_size;
};

/*
 * Parse the first `size` bytes of a request, which must outlive `request`. 1: it is complete; 0: more bytes are needed;
 * -EBADMSG: not a request; -EMSGSIZE: its body is larger than SCGI_BODY_MAX, its headers can be asked for.
 */
int scgi_parse(const char *bytes, size_t size, struct scgi *request);

/* The value of a header, such as HTTP_HOST, printable and terminated; NULL if the request has none. */
const char *scgi_value(const struct scgi *request, const char *name);

/*
 * The value of a cookie in a header HTTP_COOKIE: *size bytes, not terminated; NULL if there is none, or two of that
 * name: another site on the same machine can set a second one.
 */
const char *scgi_cookie(const char *cookies, const char *name, size_t *size);

#endif
