/* SPDX-License-Identifier: GPL-2.0-or-later */
/*
 * What visitors can order: each order is one program of the image with fixed words and some of the visitor's, which are
 * checked here. The process of root runs these and nothing else, whatever the web process sends.
 */
#ifndef DDXPANEL_ORDER_H
#define DDXPANEL_ORDER_H

#include <stdbool.h>
#include <stddef.h>

#define ORDER_WORDS 8 /* of a command, with its program */

struct order {
    const char *form;                 /* "restart SERVICE": words in capitals are the visitor's */
    const char *command[ORDER_WORDS]; /* the path of the program, and its words before the visitor's */
    unsigned seconds;                 /* then it is killed */
    size_t output;                    /* bytes; with more it is killed */
    bool whole;                       /* goes on without its visitor: half a change would be worse than a whole one */
};

/*
 * Find the order of these words (an array that ends with NULL), and the command for execv(), whose words stay those of
 * the caller and of the table. NULL, and *reason: no such order, or a word that is refused.
 */
const struct order *order_find(const char *const *words, const char *command[ORDER_WORDS], const char **reason);

#endif
