/* SPDX-License-Identifier: LGPL-2.1-or-later */
/* A request and its answer: one item for each direction; the writer's role serializes the requests. */
#include "exchange.h"

#include <errno.h>
#include <stdio.h>
#include <string.h>
#include <time.h>

_Static_assert(sizeof(DDX_REQUEST) == 16 + 40 * DDX_REQUEST_CHANGES, "layout");
_Static_assert(sizeof(DDX_ANSWER) == 208, "layout");

#define QUEUE_NS 5000000 /* between two attempts to become the writer */

int ddx_request_name(char name[DDX_NAME_MAX + 1], const char *item, const char *suffix) {
    int length = snprintf(name, DDX_NAME_MAX + 1, "%s.%s", item, suffix);

    return length > 0 && length <= DDX_NAME_MAX;
}

static int refuse(char *text, int error, const char *why) {
    snprintf(text, DDX_ANSWER_TEXT, "%s", why);
    return error;
}

static int fill(DDX_REQUEST *request, const struct ddx_change *changes, unsigned count, char *text) {
    if (!count || count > DDX_REQUEST_CHANGES)
        return refuse(text, -EINVAL, "takes 1 to 16 changes at once");
    *request = (DDX_REQUEST){.number = (uint64_t)ddx_time_now(), .count = count};
    for (unsigned i = 0; i < count; i++) {
        if (strlen(changes[i].name) >= DDX_REQUEST_NAME) {
            snprintf(text, DDX_ANSWER_TEXT, "%.100s: no such setting", changes[i].name);
            return -EINVAL;
        }
        strcpy(request->change[i].name, changes[i].name);
        request->change[i].value = changes[i].value;
    }
    return 0;
}

void ddx_request_clean(char *text, size_t bytes) {
    text[bytes - 1] = 0;
    for (; *text; text++)
        if (*text < ' ' || *text > '~')
            *text = '?';
}

/* Become the writer, after all earlier requests, and write. */
static int queue_up(DDX_STORE_ITEM *item, const DDX_REQUEST *request, int64_t deadline) {
    int error;

    while ((error = ddx_store_write(item, request, NULL)) == -EEXIST && ddx_time_now() < deadline)
        nanosleep(&(struct timespec){.tv_nsec = QUEUE_NS}, NULL);
    return error == -EEXIST ? -ETIMEDOUT : error;
}

static int wait_for_answer(DDX_STORE_ITEM *item, uint64_t number, int64_t deadline, char *text) {
    DDX_ANSWER answer;

    for (;;) {
        double left = (double)(deadline - ddx_time_now()) / 1e9;
        int error = ddx_store_read(item, &answer, NULL, left > 0 ? left : 0, DDX_NEXT);

        if (error)
            return error;
        if (answer.number == number)
            break;
    }
    ddx_request_clean(answer.text, DDX_ANSWER_TEXT);
    strcpy(text, answer.text);
    return answer.status;
}

static int ask(DDX_STORE_ITEM *to, DDX_STORE_ITEM *from, const DDX_REQUEST *request, double timeout, char *text) {
    int64_t deadline = ddx_time_now() + (int64_t)(timeout * 1e9);
    DDX_ANSWER former;

    ddx_store_read(from, &former, NULL, 0, DDX_CURRENT); /* so that DDX_NEXT returns only later answers */
    int error = queue_up(to, request, deadline);
    if (!error)
        error = wait_for_answer(from, request->number, deadline, text);
    if (error == -ETIMEDOUT)
        refuse(text, error, "no answer in time");
    return error;
}

int ddx_request_find(ddx_lookup *lookup, DDX_STORE_ID *id, const char *item, DDX_STORE_ITEM **to,
                     DDX_STORE_ITEM **from) {
    char to_name[DDX_NAME_MAX + 1], from_name[DDX_NAME_MAX + 1];
    struct ddx_item_info info;

    *to = *from = NULL;
    if (!ddx_request_name(to_name, item, "request") || !ddx_request_name(from_name, item, "answer"))
        return -EOPNOTSUPP;
    *from = lookup(id, from_name, NULL, 0);
    if (!*from)
        return errno == ENOENT ? -EOPNOTSUPP : -errno;
    int error = ddx_store_item_info(*from, &info);
    if (error || !info.writer_pid || strcmp(info.type, "DDX_ANSWER") != 0)
        return error ? error : -EOPNOTSUPP;
    *to = lookup(id, to_name, NULL, 0);
    if (!*to)
        return errno == ENOENT ? -EOPNOTSUPP : -errno;
    return strcmp(ddx_store_item_type(*to), "DDX_REQUEST") ? -EOPNOTSUPP : 0;
}

int ddx_request_by(ddx_lookup *lookup, DDX_STORE_ID *id, const char *item, const struct ddx_change *changes,
                   unsigned count, double timeout, char text[DDX_ANSWER_TEXT]) {
    DDX_STORE_ITEM *to, *from;
    DDX_REQUEST request;

    *text = 0;
    int error = fill(&request, changes, count, text);
    if (error)
        return error;
    error = ddx_request_find(lookup, id, item, &to, &from);
    if (!error)
        error = ask(to, from, &request, timeout, text);
    if (error == -EOPNOTSUPP)
        refuse(text, error, "no program takes requests for it");
    else if (error && !*text)
        refuse(text, error, ddx_error_text(error));
    ddx_store_done_item(from);
    ddx_store_done_item(to);
    return error;
}
