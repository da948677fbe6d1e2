/* SPDX-License-Identifier: GPL-2.0-or-later */
/*
 * The orders of visitors: each is one program of the image with fixed words and some of the visitor's, which are
 * checked here. The process of root runs these and no other command, whatever the web process sends.
 */
#ifndef DDXPANEL_ORDER_H
#define DDXPANEL_ORDER_H

#include <stddef.h>
#include <stdint.h>

#define ORDER_WORDS 12 /* of a command, with its program, and NULL */

enum order_kind {
    ORDER_SHOWS,   /* is killed when its visitor has gone */
    ORDER_CHANGES, /* goes on without its visitor: half a change would be worse than a whole one */
    ORDER_BYTES    /* as ORDER_SHOWS; its output is the contents of a file, so its errors go to the log */
};

struct order {
    const char *form;                 /* "restart SERVICE": words in capitals are the visitor's */
    const char *command[ORDER_WORDS]; /* the path of the program, and its words before the visitor's */
    unsigned seconds;                 /* then it is killed */
    uint64_t output;                  /* bytes; with more it is killed */
    enum order_kind kind;
};

/*
 * Find the order of these words (an array that ends with NULL), and the command for execv(), whose words stay those of
 * the caller and of the table. NULL, and *reason: no such order, or a word that is refused.
 */
const struct order *order_find(const char *const *words, const char *command[ORDER_WORDS], const char **reason);

#endif
