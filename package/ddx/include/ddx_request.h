/* SPDX-License-Identifier: LGPL-2.1-or-later */
/*
 * ddx_request: ask the program that writes an item to change its settings.
 *
 * An item takes requests when its program keeps two more beside it. For an item `video`:
 *
 *     video.request   DDX_REQUEST   programs write requests here, one after the other
 *     video.answer    DDX_ANSWER    the result, written by the item's program
 *
 * What can be changed, and within which bounds, the program shows in an item of its own (a camera: `video.parameters`,
 * see ddxvideo.h), which also follows every change. `ddxctl set video brightness=128` is a request when video takes
 * requests; where it does not, it is a write.
 *
 *     char text[DDX_ANSWER_TEXT];
 *     const struct ddx_change changes[] = {{"brightness", 128}, {"contrast", 40}};
 *     int error = ddx_request(id, "video", changes, 2, 1.0, text);
 *     if (error)
 *         fprintf(stderr, "video: %s\n", text);  // "brightness: takes a whole number from 0 to 100, not 128"
 *
 * A request is taken as a whole or refused as a whole. It holds the writer's role of `video.request` until it is
 * answered, so requests of several programs queue up, each for its own timeout.
 */
#ifndef DDX_REQUEST_H
#define DDX_REQUEST_H

#include "ddx.h"

#ifdef __cplusplus
extern "C" {
#endif
#pragma GCC visibility push(default)

#define DDX_REQUEST_CHANGES 16 /* at most, in one request */
#define DDX_REQUEST_NAME 32    /* bytes of a setting's name, with the 0 byte at its end */
#define DDX_ANSWER_TEXT 196    /* bytes of an answer, with the 0 byte at its end */

/* The values of the two items. The layout is the same for 32-bit and 64-bit programs. */
DDX_STORE_TYPE(
    DDX_REQUEST, struct {
        uint64_t number; /* tells it from others */
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

/* Whether a living program takes requests for this item: 1 or 0; -errno if the store cannot say. */
int ddx_request_possible(DDX_STORE_ID *id, const char *item);

/*
 * Ask for these changes and wait for the answer, `timeout` seconds at most (for the store, 5 s at most). 0 when all
 * of them are made; else nothing was changed, and `text` says why:
 *   -EOPNOTSUPP  no living program takes requests for this item
 *   -EINVAL      there is no such setting; too many changes, a name too long
 *   -ERANGE      a value out of its bounds (the text has them)
 *   -EACCES      a setting that cannot be changed (now)
 *   -ETIMEDOUT   no answer in time: it may still be made later
 * and what the program itself met (-ENODEV: the camera is gone), and errors of ddx_store_lookup_item().
 */
int ddx_request(DDX_STORE_ID *id, const char *item, const struct ddx_change *changes, unsigned count, double timeout,
                char text[DDX_ANSWER_TEXT]);

/* ---- For the program that takes requests ---- */

typedef struct ddx_requests DDX_REQUESTS;

/* Take requests for this item from now on. NULL and errno, as ddx_store_create(). The result is the caller's. */
DDX_REQUESTS *ddx_requests_open(DDX_STORE_ID *id, const char *item);

/*
 * The next request, which is to be answered. Never waits. -ETIMEDOUT: there is none. Names end within their arrays and
 * the count is right, whatever was written there.
 */
int ddx_requests_take(DDX_REQUESTS *requests, DDX_REQUEST *request);

/* Answer the request that was taken last; `text` may be NULL when status is 0. Errors as ddx_store_write(). */
int ddx_requests_answer(DDX_REQUESTS *requests, int status, const char *text);

/* Take no more requests. NULL is allowed. Before ddx_store_close(). */
void ddx_requests_close(DDX_REQUESTS *requests);

#pragma GCC visibility pop
#ifdef __cplusplus
}
#endif
#endif
