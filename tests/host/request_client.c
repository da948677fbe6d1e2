/* SPDX-License-Identifier: GPL-2.0-or-later */
/* request_client serve ITEM MS      takes requests for level (0 to 100) and gain (0 to 7); answers after MS
 * request_client ask ITEM N NAME    sets NAME to 0, 1, ... N-1, with a request for each
 * request_client lose INSTANCE N REASON   counts N frames lost for this reason */
#include <ddx_request.h>
#include <ddx_stats.h>
#include <errno.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <time.h>

static void pause_ms(long ms) {
    nanosleep(&(struct timespec){.tv_sec = ms / 1000, .tv_nsec = ms % 1000 * 1000000}, NULL);
}

static int check(const DDX_REQUEST *request, char *text) {
    for (unsigned i = 0; i < request->count; i++) {
        const char *name = request->change[i].name;
        int64_t most = !strcmp(name, "level") ? 100 : !strcmp(name, "gain") ? 7 : -1;
        if (most < 0) {
            snprintf(text, DDX_ANSWER_TEXT, "%s: no such parameter", name);
            return -EINVAL;
        }
        if (request->change[i].value < 0 || request->change[i].value > most) {
            snprintf(text, DDX_ANSWER_TEXT, "%s: takes a whole number from 0 to %d", name, (int)most);
            return -ERANGE;
        }
    }
    return 0;
}

static int serve(DDX_STORE_ID *id, const char *item, long ms) {
    DDX_REQUESTS *requests = ddx_requests_open(id, item);
    if (!requests)
        return 1;
    printf("serves\n");
    fflush(stdout);
    for (;;) {
        DDX_REQUEST request;
        char text[DDX_ANSWER_TEXT] = "";
        if (ddx_requests_take(requests, &request)) {
            pause_ms(2);
            continue;
        }
        pause_ms(ms);
        int status = check(&request, text);
        for (unsigned i = 0; !status && i < request.count; i++)
            printf("%s=%lld\n", request.change[i].name, (long long)request.change[i].value);
        fflush(stdout);
        ddx_requests_answer(requests, status, text);
    }
}

static int ask(DDX_STORE_ID *id, const char *item, int count, const char *name) {
    for (int i = 0; i < count; i++) {
        char text[DDX_ANSWER_TEXT];
        const struct ddx_change change = {name, i};
        int error = ddx_request(id, item, &change, 1, 5.0, text);
        if (error) {
            printf("%d %s\n", error, text);
            return 1;
        }
    }
    return 0;
}

static int lose(DDX_STORE_ID *id, const char *instance, int count, const char *reason) {
    const char *const reasons[] = {reason, NULL};
    DDX_STATS_BOOK *book = ddx_stats_open(instance, reasons);
    if (!book || ddx_stats_attach(book, id, NULL))
        return 1;
    ddx_stats_lost(book, 0, (uint64_t)count);
    return ddx_stats_write(book) != 0;
}

int main(int argc, char **argv) {
    DDX_STORE_ID *id = ddx_store_open(NULL, 0, 1.0);
    if (!id || argc < 4)
        return 2;
    int number = atoi(argv[3]), status;
    if (!strcmp(argv[1], "serve"))
        status = serve(id, argv[2], number);
    else
        status = (!strcmp(argv[1], "ask") ? ask : lose)(id, argv[2], number, argc > 4 ? argv[4] : "");
    ddx_store_close(id);
    return status;
}
