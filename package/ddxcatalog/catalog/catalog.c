/* SPDX-License-Identifier: GPL-2.0-or-later */
#include "catalog.h"

#include <ddx_request.h>
#include <errno.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

#include "accept.h"
#include "clock.h"
#include "directory.h"
#include "export.h"
#include "mirror.h"
#include "table.h"

#define SERVICE "catalog"            /* the item that takes requests */
#define TURN 0.02                    /* s between two checks for requests */
#define LOOK_NS INT64_C(250000000)   /* between two checks of items and network */
#define TABLE_NS INT64_C(1000000000) /* between two updates of the clocks shown */
#define PROOF_NS INT64_C(3000000000) /* for another machine with this machine's name to answer */
#define SETTLE_NS INT64_C(500000000) /* others are heard before this machine announces its name */

static const char *const reasons[] = {"store", "bandwidth", "size", "network", "type", "budget", NULL};

/* Join "carol:gps", which comes in pieces, since a setting's name is shorter than an item's. */
static void name_of(const DDX_REQUEST *request, char name[DDX_REQUEST_CHANGES * DDX_REQUEST_NAME]) {
    *name = 0;
    for (uint32_t i = 0; i < request->count; i++)
        strcat(name, request->change[i].name);
}

static void answer(struct catalog *catalog, DDX_REQUESTS *requests) {
    char name[DDX_REQUEST_CHANGES * DDX_REQUEST_NAME], text[DDX_ANSWER_TEXT];
    DDX_REQUEST request;

    while (!ddx_requests_take(requests, &request)) {
        name_of(&request, name);
        int error = mirrors_want(catalog->mirrors, name);

        snprintf(text, sizeof text, "%.90s: %.90s", name, error ? ddx_error_text(error) : "");
        ddx_requests_answer(requests, error, error ? text : NULL);
    }
}

static void take_record(void *argument, const struct network_record *record, enum network_change change) {
    struct catalog *catalog = argument;

    directory_take(catalog->directory, record, change);
}

static void records_changed(void *argument) {
    struct catalog *catalog = argument;

    network_records_read(catalog->records, take_record, catalog);
}

/* Without a time limit: a robot may start before its network. */
static bool join(struct catalog *catalog) {
    bool told = false;

    for (;;) {
        int error = network_open(&catalog->config.network, &catalog->network);

        if (!error)
            return true;
        if (!told)
            say("the network cannot be used: %s; trying again", strerror(-error));
        told = true;
        if (!program_sleep_until(ddx_time_now() + LOOK_NS, catalog->book))
            return false;
    }
}

static void take_name(struct catalog *catalog, void (*take)(struct identity *identity)) {
    exports_withdraw(catalog->exports);
    take(&catalog->identity);
    machines_renamed(directory_machines(catalog->directory), &catalog->identity);
}

/*
 * Two machines must not have the same topics. Before this machine has announced its name, a record is enough to give it
 * up: it costs nothing, but the name is taken again if the other machine does not prove itself. Later only a machine
 * that has proven itself gets the name.
 */
static void choose_name(struct catalog *catalog) {
    struct identity *identity = &catalog->identity;
    const struct machines *machines = directory_machines(catalog->directory);
    bool own = !strcmp(identity->name, identity->host), proven = machines_take_name(machines, identity, true);
    int64_t now = ddx_time_now();

    if (own && (proven || (!catalog->known && machines_take_name(machines, identity, false)))) {
        take_name(catalog, identity_yield);
        catalog->proof = proven ? 0 : now + PROOF_NS;
        say("another machine is called %s: others see this one as %s until the next start; give it another host name",
            identity->host, identity->name);
    } else if (!own && proven) {
        catalog->proof = 0;
    } else if (catalog->proof && now >= catalog->proof) {
        catalog->proof = 0;
        take_name(catalog, identity_return);
        say("the other machine that is called %s does not answer: this one has this name again", identity->host);
    }
}

static void count_refused(struct catalog *catalog) {
    struct network_refused refused;

    network_records_refused(catalog->records, &refused);
    directory_refuse(catalog->directory, refused.count, refused.machine, refused.item);
}

static void look(struct catalog *catalog) {
    struct ddx_item_info *items;
    unsigned count;

    if (ddx_store_list(catalog->id, NULL, &items, &count)) /* the store is away: change nothing */
        return;
    if (ddx_time_now() >= catalog->settled) {
        exports_look(catalog->exports, items, count);
        catalog->known = true;
    }
    mirrors_look(catalog->mirrors, items, count);
    accepts_look(catalog->accepts, items, count);
    free(items);
}

static bool is_due(int64_t *due, int64_t period) {
    int64_t now = ddx_time_now();

    if (now < *due)
        return false;
    *due = now + period;
    return true;
}

/* Serve until a request to stop, or until the machine's address changes. */
static void serve(struct catalog *catalog, DDX_REQUESTS *requests) {
    int64_t due = 0, table_due = 0;

    catalog->settled = ddx_time_now() + SETTLE_NS;
    catalog->known = false;
    while (!program_stopping()) {
        if (is_due(&due, LOOK_NS)) {
            choose_name(catalog);
            look(catalog);
            count_refused(catalog);
            table_write(catalog->table, directory_machines(catalog->directory), is_due(&table_due, TABLE_NS));
            if (network_moved(catalog->network))
                return;
        }
        clock_tick(catalog->clock);
        network_wait(catalog->network, TURN);
        answer(catalog, requests);
        program_tick(catalog->book);
    }
}

static int run_in_network(struct catalog *catalog) {
    const struct network_event event = {records_changed, catalog};
    DDX_REQUESTS *requests = ddx_requests_open(catalog->id, SERVICE);

    catalog->records = NULL;
    int error = requests ? network_records_open(catalog->network, &event, &catalog->records) : -errno;

    catalog->exports = exports_open(catalog);
    catalog->directory = directory_open(catalog);
    catalog->mirrors = mirrors_open(catalog);
    catalog->accepts = accepts_open(catalog);
    catalog->table = table_open(catalog);
    catalog->clock = clock_open(catalog);
    if (!error && catalog->exports && catalog->directory && catalog->mirrors && catalog->accepts && catalog->table &&
        catalog->clock)
        serve(catalog, requests);
    else
        say("%s", ddx_error_text(error ? error : -ENOMEM));
    clock_close(catalog->clock);
    table_close(catalog->table);
    accepts_close(catalog->accepts);
    mirrors_close(catalog->mirrors);
    directory_close(catalog->directory);
    exports_close(catalog->exports);
    network_records_close(catalog->records);
    ddx_requests_close(requests);
    return error ? EXIT_FAILED : EXIT_OK;
}

int catalog_run(struct catalog *catalog) {
    int status = EXIT_OK;

    identity_begin(&catalog->identity, catalog->program.port);
    bucket_begin(&catalog->bucket, catalog->config.bandwidth, ddx_time_now());
    catalog->config.network.bucket = catalog->config.bandwidth ? &catalog->bucket : NULL;
    catalog->book = program_book(&catalog->program, reasons);
    catalog->id = program_connect(&catalog->program);
    if (catalog->id && !program_attach(&catalog->program, catalog->book, catalog->id, NULL))
        status = EXIT_FAILED;
    while (catalog->id && status == EXIT_OK && !program_stopping() && join(catalog)) {
        status = run_in_network(catalog);
        network_close(catalog->network);
        if (!program_stopping() && status == EXIT_OK)
            say("this machine has another address: joining the network again");
    }
    program_report(catalog->book);
    ddx_stats_close(catalog->book);
    ddx_store_close(catalog->id);
    return status;
}
