/* SPDX-License-Identifier: LGPL-2.1-or-later */
/*
 * ddx_request: ask the program that writes an item to change its settings.
 *
 * An item takes requests if its program also creates two more items. For an item `video`:
 *
 *     video.request   DDX_REQUEST   programs write requests here, one after the other
 *     video.answer    DDX_ANSWER    the result, written by the item's program
 *
 * The program publishes its settings and their bounds in a further item (a camera: `video.parameters`, see ddxvideo.h),
 * which it updates after every change. `ddxctl set video brightness=128` is a request if video takes requests, and a
 * write if not.
 *
 *     char text[DDX_ANSWER_TEXT];
 *     const struct ddx_change changes[] = {{"brightness", 128}, {"contrast", 40}};
 *     int error = ddx_request(id, "video", changes, 2, 1.0, text);
 *     if (error)
 *         fprintf(stderr, "video: %s\n", text);  // "brightness: takes a whole number from 0 to 100, not 128"
 *
 * A request is accepted as a whole or refused as a whole. The requesting program holds the writer's role of
 * `video.request` until the answer, so requests of several programs queue up, each for its own timeout.
 */
#ifndef DDX_REQUEST_H
#define DDX_REQUEST_H

#include "ddx.h"

#ifdef __cplusplus
extern "C" {
#endif
#pragma GCC visibility push(default)

#define DDX_REQUEST_CHANGES 16 /* at most, in one request */
#define DDX_REQUEST_NAME 32    /* bytes of a setting's name, with the terminating 0 byte */
#define DDX_ANSWER_TEXT 196    /* bytes of an answer, with the terminating 0 byte */

/* The values of the two items. The layout is the same for 32-bit and 64-bit programs. */
DDX_STORE_TYPE(
    DDX_REQUEST, struct {
        uint64_t number; /* identifies the request */
        uint32_t count;  /* changes in use */
        uint32_t reserved;
        struct {
            char name[DDX_REQUEST_NAME];
            int64_t value;
        } change[DDX_REQUEST_CHANGES];
    });

DDX_STORE_TYPE(
    DDX_ANSWER, struct {
        uint64_t number; /* of the request */
        int32_t status;  /* 0, or -errno */
        char text[DDX_ANSWER_TEXT];
    });

/* ---- For programs that request a change ---- */

struct ddx_change {
    const char *name;
    int64_t value;
};

/* Whether a living program takes requests for this item: 1 or 0; -errno if the store cannot be asked. */
int ddx_request_possible(DDX_STORE_ID *id, const char *item);

/*
 * Request these changes and wait for the answer, `timeout` seconds at most (for the store, 5 s at most). 0: all changes
 * were made. Otherwise none was made, and `text` gives the reason:
 *   -EOPNOTSUPP  no living program takes requests for this item
 *   -EINVAL      an unknown setting; too many changes, a name too long
 *   -ERANGE      a value out of its bounds (the text states them)
 *   -EACCES      a setting that cannot be changed (now)
 *   -ETIMEDOUT   no answer in time: the changes may still be made later
 * or an error of the program itself (-ENODEV: camera unplugged), or one of ddx_store_lookup_item().
 */
int ddx_request(DDX_STORE_ID *id, const char *item, const struct ddx_change *changes, unsigned count, double timeout,
                char text[DDX_ANSWER_TEXT]);

/* ---- For the program that takes requests ---- */

typedef struct ddx_requests DDX_REQUESTS;

/* Take requests for this item from now on. NULL and errno, as ddx_store_create(). The caller owns the result. */
DDX_REQUESTS *ddx_requests_open(DDX_STORE_ID *id, const char *item);

/*
 * Get the next request, which must be answered. Never waits. -ETIMEDOUT: no request. Names are terminated and the count
 * is valid, whatever the requesting program wrote.
 */
int ddx_requests_take(DDX_REQUESTS *requests, DDX_REQUEST *request);

/* Answer the last request taken; `text` may be NULL if status is 0. Errors as ddx_store_write(). */
int ddx_requests_answer(DDX_REQUESTS *requests, int status, const char *text);

/* Take no more requests. NULL is allowed. To be called before ddx_store_close(). */
void ddx_requests_close(DDX_REQUESTS *requests);

#pragma GCC visibility pop
#ifdef __cplusplus
}
#endif
#endif
