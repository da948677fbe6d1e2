/* SPDX-License-Identifier: LGPL-2.1-or-later */
/* Requests: the calls of ddx_request.h. */
#include "ddx_request.h"

#include <errno.h>
#include <stdio.h>
#include <stdlib.h>

#include "exchange.h"

struct ddx_requests {
    DDX_STORE_ITEM *request, *answer;
    uint64_t number; /* of the request that was taken last */
};

/* ---- The program that requests a change ---- */

int ddx_request_possible(DDX_STORE_ID *id, const char *item) {
    DDX_STORE_ITEM *to, *from;
    int error = ddx_request_find(ddx_store_lookup_item, id, item, &to, &from);

    ddx_store_done_item(from);
    ddx_store_done_item(to);
    return error == -EOPNOTSUPP ? 0 : error ? error : 1;
}

int ddx_request(DDX_STORE_ID *id, const char *item, const struct ddx_change *changes, unsigned count, double timeout,
                char text[DDX_ANSWER_TEXT]) {
    return ddx_request_by(ddx_store_lookup_item, id, item, changes, count, timeout, text);
}

/* ---- The program that takes requests ---- */

static int open_items(DDX_REQUESTS *requests, DDX_STORE_ID *id, const char *item) {
    char name[DDX_NAME_MAX + 1];
    DDX_REQUEST former;

    if (!ddx_request_name(name, item, "request"))
        return -EINVAL;
    requests->request = ddx_store_lookup_item(id, name, "DDX_REQUEST", sizeof(DDX_REQUEST));
    if (!requests->request)
        return -errno;
    ddx_store_read(requests->request, &former, NULL, 0, DDX_CURRENT); /* skip requests to an earlier program */
    ddx_request_name(name, item, "answer");
    const struct ddx_item_spec spec = {.name = name, .type = "DDX_ANSWER", .size = sizeof(DDX_ANSWER)};
    return ddx_store_create(id, &spec, &requests->answer);
}

DDX_REQUESTS *ddx_requests_open(DDX_STORE_ID *id, const char *item) {
    DDX_REQUESTS *requests = calloc(1, sizeof *requests);

    if (!requests)
        return NULL;
    int error = open_items(requests, id, item);
    if (!error)
        return requests;
    ddx_requests_close(requests);
    errno = -error;
    return NULL;
}

int ddx_requests_take(DDX_REQUESTS *requests, DDX_REQUEST *request) {
    int error = ddx_store_read(requests->request, request, NULL, 0, DDX_NEXT);

    if (error)
        return error;
    requests->number = request->number;
    if (request->count > DDX_REQUEST_CHANGES)
        request->count = DDX_REQUEST_CHANGES;
    for (unsigned i = 0; i < DDX_REQUEST_CHANGES; i++)
        ddx_request_clean(request->change[i].name, DDX_REQUEST_NAME);
    return 0;
}

int ddx_requests_answer(DDX_REQUESTS *requests, int status, const char *text) {
    DDX_ANSWER answer = {.number = requests->number, .status = status};

    snprintf(answer.text, sizeof answer.text, "%s", text ? text : "");
    return ddx_store_write(requests->answer, &answer, NULL);
}

void ddx_requests_close(DDX_REQUESTS *requests) {
    if (!requests)
        return;
    ddx_store_done_item(requests->request);
    ddx_store_done_item(requests->answer);
    free(requests);
}
