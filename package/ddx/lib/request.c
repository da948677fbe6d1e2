/* SPDX-License-Identifier: LGPL-2.1-or-later */
/* Requests: the calls of ddx_request.h. */
#include <errno.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <time.h>

#include "ddx_request.h"
#include "futex.h"
#include "roles.h"
#include "type.h"

/* As ddx_store_lookup_item(); a request to the catalog looks up items of this machine only. */
typedef DDX_STORE_ITEM *ddx_lookup(DDX_STORE_ID *id, const char *name, const char *type, int size);

/* ---- Exchange of messages ---- */

/* A request and its answer: one item for each direction; the writer's role serializes the requests. */

_Static_assert(sizeof(DDX_REQUEST) == 16 + 40 * DDX_REQUEST_CHANGES, "layout");
_Static_assert(sizeof(DDX_ANSWER) == 208, "layout");

#define QUEUE_NS 5000000 /* between two attempts to become the writer */

/* "<item>.request", "<item>.answer"; false if that is too long. */
static int ddx_request_name(char name[DDX_NAME_MAX + 1], const char *item, const char *suffix) {
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

/* Terminate another program's text and replace control characters, since it goes to logs and terminals. */
static void ddx_request_clean(char *text, size_t bytes) {
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

/* Open the two request items of a living program. 0; -EOPNOTSUPP, else as `lookup`. */
static int ddx_request_find(ddx_lookup *lookup, DDX_STORE_ID *id, const char *item, DDX_STORE_ITEM **to,
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

/* As ddx_request(). */
static int ddx_request_by(ddx_lookup *lookup, DDX_STORE_ID *id, const char *item, const struct ddx_change *changes,
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

/* ---- Items of other machines ---- */

/* Items of other machines: the catalog makes them in this machine's store, on request. */

#define CATALOG "catalog"
#define OPEN_STEP_NS 20000000 /* between two attempts to find a machine */
#define ASK 5.0               /* s that the catalog may take to answer */

/* As ddx_store_lookup_item(), for items of this machine. */
static DDX_STORE_ITEM *find_here(DDX_STORE_ID *id, const char *name, const char *type, int size) {
    DDX_STORE_ITEM *item = NULL;
    int error = ddx_local_lookup(id, name, type, size, &item);

    if (!error)
        return item;
    errno = -error;
    return NULL;
}

/* Ask the catalog for "carol:gps", or with "carol:" whether it has heard from that machine. 0 or -errno. */
static int ask_catalog(const DDX_STORE_ID *id, const char *name, double timeout) {
    char pieces[DDX_NAME_MAX / (DDX_REQUEST_NAME - 1) + 1][DDX_REQUEST_NAME], text[DDX_ANSWER_TEXT];
    struct ddx_change changes[sizeof pieces / sizeof *pieces];
    DDX_STORE_ID here = {.port = id->port}; /* requests do not cross machines */
    unsigned count = 0;

    for (size_t at = 0; at < strlen(name); at += DDX_REQUEST_NAME - 1) {
        snprintf(pieces[count], DDX_REQUEST_NAME, "%s", name + at);
        changes[count] = (struct ddx_change){pieces[count], 1};
        count++;
    }
    return ddx_request_by(find_here, &here, CATALOG, changes, count, timeout, text);
}

static int wait_for_machine(const DDX_STORE_ID *id, const char *host, int64_t deadline) {
    char name[DDX_NAME_MAX + 1];
    int error;

    if (snprintf(name, sizeof name, "%s:", host) >= DDX_NAME_MAX || !ddx_item_name_ok(name) || strchr(host, ':'))
        return -EINVAL;
    /* The catalog may be started after this program. */
    while (((error = ask_catalog(id, name, ASK)) == -EHOSTUNREACH || error == -EOPNOTSUPP) && ddx_time_now() < deadline)
        nanosleep(&(struct timespec){.tv_nsec = OPEN_STEP_NS}, NULL);
    return error;
}

DDX_STORE_ID *ddx_store_open(const char *host, int port, double timeout) {
    int64_t deadline = timeout < 0 || timeout > 1e9 ? DDX_FOREVER : ddx_time_now() + (int64_t)(timeout * 1e9);
    DDX_STORE_ID *id = NULL;
    int error = port < 0 || port > 65535 ? -EINVAL : ddx_local_open(port, deadline, &id);

    if (!error && host && strcmp(host, "localhost") != 0) {
        error = wait_for_machine(id, host, deadline);
        if (!error)
            strcpy(id->host, host);
    }
    if (!error)
        return id;
    ddx_store_close(id);
    errno = -error;
    return NULL;
}

/* The name in this store of the item that the program calls `name`. */
static int full_name(const DDX_STORE_ID *id, const char *name, char full[DDX_NAME_MAX + 1]) {
    int length = snprintf(full, DDX_NAME_MAX + 1, "%s%s%s", id->host, *id->host ? ":" : "", name);

    return length > DDX_NAME_MAX ? -EINVAL : 0;
}

DDX_STORE_ITEM *ddx_store_lookup_item(DDX_STORE_ID *id, const char *name, const char *type, int size) {
    char full[DDX_NAME_MAX + 1];
    DDX_STORE_ITEM *item = NULL;
    int error = !id || !name ? -EINVAL : full_name(id, name, full);
    int asked = !error && strchr(full, ':') ? ask_catalog(id, full, ASK) : 0;

    /* Only the catalog makes items of other machines. Their last value can be read while the machine is away. */
    if (!error && *id->host)
        error = ddx_local_lookup(id, full, NULL, 0, &item);
    else if (!error)
        error = ddx_local_lookup(id, full, type, size, &item);
    if (error == -ENOENT && asked && asked != -EOPNOTSUPP)
        error = asked;
    if (!error)
        return item;
    errno = -error;
    return NULL;
}

/* ---- Public calls ---- */

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
