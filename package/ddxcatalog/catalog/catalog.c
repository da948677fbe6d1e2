/* SPDX-License-Identifier: GPL-2.0-or-later */
#include "catalog.h"

#include <ddx_request.h>
#include <errno.h>
#include <standard.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <table_items.h>

#include "clock.h"
#include "directory.h"
#include "export.h"
#include "item.h"
#include "machines.h"
#include "mirror.h"
#include "state.h"

/* ---- The items catalog.machines (this machine's name, and the other machines) and catalog.items (their items) ---- */

#define TABLE "catalog" /* before the dot of both names */

_Static_assert(sizeof((CATALOG_MACHINES *)0)->machine / sizeof *((CATALOG_MACHINES *)0)->machine == NETWORK_MACHINES,
               "a line for each machine");

struct table {
    struct catalog *catalog;
    DDX_STORE_ITEM *machines, *items;
    CATALOG_ITEMS written, value;      /* the last value written; the new one */
    CATALOG_MACHINES machines_written; /* without clocks, which always change */
};

static void create(struct table *table, const char *suffix, const char *type, size_t size, DDX_STORE_ITEM **item) {
    char name[DDX_NAME_MAX + 1];

    snprintf(name, sizeof name, TABLE "%s", suffix);
    const struct ddx_item_spec spec = {.name = name, .type = type, .size = size};
    program_does_without(TABLE, suffix, ddx_store_create(table->catalog->id, &spec, item));
}

/* NULL: no memory. If an item cannot be created, the table works without it, after a line. */
static struct table *table_open(struct catalog *catalog) {
    struct table *table = calloc(1, sizeof *table);

    if (!table)
        return NULL;
    table->catalog = catalog;
    create(table, TABLE_MACHINES + strlen(TABLE), "CATALOG_MACHINES", sizeof(CATALOG_MACHINES), &table->machines);
    create(table, TABLE_ITEMS + strlen(TABLE), "CATALOG_ITEMS", sizeof(CATALOG_ITEMS), &table->items);
    return table;
}

static void add_item(struct table *table, const char *machine, const char *name, const char *type, bool heard,
                     unsigned readers) {
    CATALOG_ITEMS *value = &table->value;

    if (value->known++ >= TABLE_ITEMS_MAX)
        return;
    unsigned i = value->count++;
    snprintf(value->item[i].name, sizeof value->item[i].name, "%s%s%s", machine, *machine ? ":" : "", name);
    snprintf(value->item[i].type, sizeof value->item[i].type, "%s", type);
    value->item[i].heard = heard;
    value->item[i].readers = readers;
}

static void add_own(void *argument, const char *name, const char *type, unsigned readers) {
    add_item(argument, "", name, type, true, readers);
}

static void add_remote(void *argument, const struct machine *machine, const struct remote *remote) {
    add_item(argument, machine->name, remote->item, remote->type, !machine->away && !remote->away, 0);
}

static void write_items(struct table *table) {
    memset(&table->value, 0, sizeof table->value);
    exports_each(table->catalog->exports, add_own, table);
    directory_each(table->catalog->directory, add_remote, table);
    if (!table->items || !memcmp(&table->value, &table->written, sizeof table->value))
        return;
    if (!ddx_store_write(table->items, &table->value, NULL))
        table->written = table->value;
}

static void add_machines(const struct table *table, const struct machines *machines, CATALOG_MACHINES *value) {
    const struct identity *own = &table->catalog->identity;

    strcpy(value->name, own->name);
    strcpy(value->host, own->host);
    value->same = machines_of_host(machines, own);
    value->count = machines->count;
    value->refused = directory_refused(table->catalog->directory);
    for (unsigned i = 0; i < machines->count; i++) {
        const struct machine *machine = &machines->list[i];

        strcpy(value->machine[i].name, machine->name);
        strcpy(value->machine[i].host, machine->host);
        value->machine[i].id = machine->id;
        value->machine[i].heard = !machine->away;
        value->machine[i].items = machine->items;
    }
}

static void add_clocks(const struct machines *machines, CATALOG_MACHINES *value) {
    int64_t now = ddx_time_now();

    for (unsigned i = 0; i < machines->count; i++)
        if (!offset_get(&machines->list[i].offset, now, &value->machine[i].offset, &value->machine[i].bound))
            value->machine[i].bound = -1;
}

/* Write the current state, if it has changed apart from clocks, or if `clocks` is set. */
static void table_write(struct table *table, const struct machines *machines, bool clocks) {
    CATALOG_MACHINES value;

    memset(&value, 0, sizeof value);
    add_machines(table, machines, &value);
    if (clocks || memcmp(&value, &table->machines_written, sizeof value)) {
        table->machines_written = value;
        add_clocks(machines, &value);
        if (table->machines)
            ddx_store_write(table->machines, &value, NULL);
    }
    write_items(table);
}

/* The items then show that no catalog runs. NULL is allowed. */
static void table_close(struct table *table) {
    CATALOG_MACHINES value;

    if (!table)
        return;
    memset(&value, 0, sizeof value);
    memset(&table->value, 0, sizeof table->value);
    if (table->machines)
        ddx_store_write(table->machines, &value, NULL);
    if (table->items)
        ddx_store_write(table->items, &table->value, NULL);
    ddx_store_done_item(table->machines);
    ddx_store_done_item(table->items);
    free(table);
}

/* ---- Items of this store that programs of other machines may write, according to exports.conf ---- */

struct accepted {
    struct catalog *catalog;
    const struct config_accept *rule;
    struct ddx_item_info info; /* at the time when the form was read */
    bool tried;                /* opening was tried with this info */
    DDX_STORE_ITEM *item;
    struct form *form;
    struct standard *standard;
    struct network_event event;
    struct network_reader *reader;
};

struct accepts {
    unsigned count;
    struct accepted list[CONFIG_ACCEPTS_MAX];
};

static int write_value(struct accepted *accepted, const unsigned char *message, size_t size) {
    void *data;
    int error = standard_check(accepted->standard, accepted->form, message, size) ? 0 : -EBADMSG;

    if (!error)
        error = item_loan(accepted->item, accepted->form, &data);
    if (error)
        return error;
    standard_read(accepted->standard, accepted->form, message, data);
    return ddx_store_publish(accepted->item, NULL);
}

static void take_message(void *argument, uint64_t writer, const unsigned char *message, size_t size) {
    (void)writer;
    struct accepted *accepted = argument;
    DDX_STATS_BOOK *book = accepted->catalog->book;
    int64_t begin = ddx_time_now();
    int error = write_value(accepted, message, size);

    ddx_stats_in(book, 1, 0);
    if (error)
        ddx_stats_lost(book, error == -EBADMSG ? LOST_TYPE : LOST_BUDGET, 1);
    else
        ddx_stats_out(book, 1, ddx_time_now() - begin);
}

static void ready(void *argument) {
    struct accepted *accepted = argument;

    network_read(accepted->reader, take_message, accepted);
}

static void close_accepted(struct accepted *accepted) {
    network_reader_close(accepted->reader);
    standard_close(accepted->standard);
    form_free(accepted->form);
    ddx_store_done_item(accepted->item);
    *accepted = (struct accepted){.catalog = accepted->catalog, .rule = accepted->rule};
}

static int subscribe(struct accepted *accepted) {
    char topic[NAME_TOPIC];

    snprintf(topic, sizeof topic, "rt%s", accepted->rule->topic);
    accepted->event = (struct network_event){ready, accepted};
    return network_reader_open(accepted->catalog->network, topic, accepted->standard->description,
                               accepted->form->message_size, &accepted->event, &accepted->reader);
}

static void open_accepted(struct accepted *accepted, const struct ddx_item_info *info) {
    const struct config_accept *rule = accepted->rule;
    char why[STANDARD_WHY] = "";

    accepted->tried = true;
    accepted->info = *info;
    accepted->item = ddx_store_lookup_item(accepted->catalog->id, rule->item, NULL, 0);
    int error = accepted->item ? form_of_item(accepted->item, &accepted->form) : -errno;
    if (!error)
        error = standard_open(rule->as, accepted->form, &accepted->standard, why);
    if (!error)
        error = subscribe(accepted);
    if (error)
        say("accept %s as %s: %s", rule->topic, rule->item, *why ? why : ddx_error_text(error));
}

/* Then the reader is kept: publishers would not repeat messages for a new one. */
static bool has_same_form(const struct accepted *accepted) {
    struct form *form;

    if (!accepted->reader || form_of_item(accepted->item, &form))
        return false;
    bool same = form_same(form, accepted->form);
    form_free(form);
    return same;
}

static void look_at(struct accepted *accepted, const struct ddx_item_info *info) {
    if (accepted->tried && item_is_unchanged(info, &accepted->info))
        return;
    if (has_same_form(accepted)) { /* for example after the first message, which makes this program the item's writer */
        accepted->info = *info;
        return;
    }
    close_accepted(accepted);
    open_accepted(accepted, info);
}

/* Follow the store's items: an item accepts values only after a program of this machine has declared it. */
static void accepts_look(struct accepts *accepts, const struct ddx_item_info *items, unsigned count) {
    for (unsigned i = 0; i < accepts->count; i++) {
        struct accepted *accepted = &accepts->list[i];
        bool there = false;

        for (unsigned k = 0; k < count && !there; k++)
            if ((there = !strcmp(items[k].name, accepted->rule->item)))
                look_at(accepted, &items[k]);
        if (!there && accepted->tried)
            close_accepted(accepted);
    }
}

/* NULL: no memory. */
static struct accepts *accepts_open(struct catalog *catalog) {
    struct accepts *accepts = calloc(1, sizeof *accepts);

    if (!accepts)
        return NULL;
    accepts->count = catalog->config.accept_count;
    for (unsigned i = 0; i < accepts->count; i++)
        accepts->list[i] = (struct accepted){.catalog = catalog, .rule = &catalog->config.accepts[i]};
    return accepts;
}

static void accepts_close(struct accepts *accepts) {
    for (unsigned i = 0; accepts && i < accepts->count; i++)
        close_accepted(&accepts->list[i]);
    free(accepts);
}

/* ---- The catalog ---- */

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
    bool is_reported = false;

    for (;;) {
        int error = network_open(&catalog->config.network, &catalog->network);

        if (!error)
            return true;
        if (!is_reported)
            say("the network cannot be used: %s; trying again", strerror(-error));
        is_reported = true;
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
