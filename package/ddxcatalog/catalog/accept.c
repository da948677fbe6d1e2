/* SPDX-License-Identifier: GPL-2.0-or-later */
#include "accept.h"

#include <errno.h>
#include <standard.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

#include "item.h"

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

static void take(void *argument, uint64_t writer, const unsigned char *message, size_t size) {
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

    network_read(accepted->reader, take, accepted);
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
static bool still_fits(const struct accepted *accepted) {
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
    if (still_fits(accepted)) { /* for example after the first message, which makes this program the item's writer */
        accepted->info = *info;
        return;
    }
    close_accepted(accepted);
    open_accepted(accepted, info);
}

void accepts_look(struct accepts *accepts, const struct ddx_item_info *items, unsigned count) {
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

struct accepts *accepts_open(struct catalog *catalog) {
    struct accepts *accepts = calloc(1, sizeof *accepts);

    if (!accepts)
        return NULL;
    accepts->count = catalog->config.accept_count;
    for (unsigned i = 0; i < accepts->count; i++)
        accepts->list[i] = (struct accepted){.catalog = catalog, .rule = &catalog->config.accepts[i]};
    return accepts;
}

void accepts_close(struct accepts *accepts) {
    for (unsigned i = 0; accepts && i < accepts->count; i++)
        close_accepted(&accepts->list[i]);
    free(accepts);
}
