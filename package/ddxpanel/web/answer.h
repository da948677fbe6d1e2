/* SPDX-License-Identifier: GPL-2.0-or-later */
/* The web process's answer to a request: logins and orders by way of the process of root. */
#ifndef DDXPANEL_ANSWER_H
#define DDXPANEL_ANSWER_H

#include <stddef.h>

#include "download.h"
#include "guard.h"
#include "message.h"
#include "picture.h"
#include "scgi.h"

#define ANSWER_TEXT \
    (MESSAGE_PIECE + 1024) /* headers and a short body, or a piece of output and what follows the last */

struct visitors {
    int root; /* socket of the process of root */
    struct sessions sessions;
};

struct answer {
    char text[ANSWER_TEXT]; /* for the web server */
    size_t size;
    int order;       /* socket from which the rest comes, see struct message_end; -1: that was all */
    bool is_picture; /* it is to be answered when there is a picture: */
    struct picture_wanted wanted;
    bool is_download; /* it begins with the first output of the order, see answer_download(): */
    struct download download;
};

/* Answer a complete request. 0; -errno: the process of root does not answer, this one has no use any more. */
int answer_request(struct visitors *visitors, const struct scgi *request, struct answer *answer);

/* Answer with the headers of a picture, or of none if `said` has none, after waiting for that many ms. */
void answer_picture(struct answer *answer, const struct picture_said *said, int64_t waited);

/* Answer with the headers of a file of this size, of which answer->download is wanted. False: it has no such part, and
 * the answer is a refusal. */
bool answer_download(struct answer *answer, uint64_t size);

/* Answer with a status and a line of text. */
void answer_refuse(struct answer *answer, unsigned status, const char *reason);

#endif
