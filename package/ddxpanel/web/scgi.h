/* SPDX-License-Identifier: GPL-2.0-or-later */
/*
 * A request of the web server (SCGI): headers as one netstring, then the body; and what is in them. The bytes come
 * from the network, through lighttpd.
 */
#ifndef DDXPANEL_SCGI_H
#define DDXPANEL_SCGI_H

#include <stdbool.h>
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

#define WORDS_MAX 16     /* words of an order */
#define WORDS_SIZE 1024u /* bytes of all words, with a 0 byte each */

/* The words of an order: the body of a request, a word a line. */
struct words {
    unsigned count;
    size_t size;
    char text[WORDS_SIZE];           /* the words, each with its 0 byte */
    const char *word[WORDS_MAX + 1]; /* into `text`; NULL after the last */
};

/*
 * Split a text into its lines; the last one needs no line feed. 0; -EINVAL: no word, an empty one, or one that has
 * other characters than those from ' ' to '~'; -E2BIG: too many, or too long.
 */
int words_split(struct words *words, const char *text, size_t size);

/*
 * A name in the address of a request: of an item, or of a recording's file. Whether the first `size` bytes of `text`
 * are a name with fewer than `room` bytes: visible characters without '/', each as itself or as %XX. If so, writes it
 * with its 0 byte.
 */
bool name_parse(char *name, size_t room, const char *text, size_t size);

#endif
