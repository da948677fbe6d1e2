/* SPDX-License-Identifier: GPL-2.0-or-later */
#include "export.h"

#include <picture.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

#include "item.h"
#include "outlet.h"

struct export {
    struct export *next;
    struct catalog *catalog;
    char name[DDX_NAME_MAX + 1], topic[NAME_TOPIC];
    const struct config_rule *rule;
    struct form *form;
    struct outlet *own, *as;   /* with the item's own type; as a standard message */
    struct ddx_item_info info; /* at the time when the form was read */
    bool announced, there;
};

struct exports {
    struct catalog *catalog;
    struct export *first;
    unsigned count;
    bool full, announced; /* the machine itself */
};

static struct network_record record_of_machine(const struct catalog *catalog) {
    const struct identity *identity = &catalog->identity;
    static char none[] = "";

    return (struct network_record){.machine = identity->id,
                                   .item = none,
                                   .since = identity->since,
                                   .name = (char *)identity->name,
                                   .host = (char *)identity->host,
                                   .boot = (char *)identity->boot,
                                   .type = none,
                                   .declaration = none,
                                   .extents = none,
                                   .topic = none};
}

static struct network_record record_of(const struct export *export) {
    struct network_record record = record_of_machine(export->catalog);

    record.item = (char *)export->name;
    record.type = (char *)export->form->type;
    record.declaration = export->form->declaration;
    record.extents = export->form->extents;
    record.topic = (char *)export->topic;
    return record;
}

static void close_export(struct export *export) {
    outlet_close(export->own);
    outlet_close(export->as);
    if (export->form && export->announced) {
        struct network_record record = record_of(export);

        network_records_withdraw(export->catalog->records, &record);
    }
    form_free(export->form);
    free(export);
}

static struct form *form_now(struct catalog *catalog, const char *name) {
    DDX_STORE_ITEM *item = ddx_store_lookup_item(catalog->id, name, NULL, 0);
    struct form *form = NULL;

    if (item && form_of_item(item, &form))
        form = NULL;
    ddx_store_done_item(item);
    return form;
}

static int open_outlet(struct export *export, const char *topic, struct standard *standard, struct outlet **outlet) {
    const struct sender_source source = {
        .rule = export->rule, .item = export->name, .form = export->form, .standard = standard};

    return outlet_open(export->catalog, topic, &source, outlet);
}

/* Also publish the values as a standard message, if exports.conf says so. */
static void open_as(struct export *export) {
    const struct config_rule *rule = export->rule;
    char topic[NAME_TOPIC], why[STANDARD_WHY] = "";
    struct standard *standard;

    if (!rule->as)
        return;
    snprintf(topic, sizeof topic, "rt%s", rule->topic);
    int error = standard_open(rule->as, export->form, &standard, why);
    if (!error)
        error = open_outlet(export, topic, standard, &export->as);
    if (!error && picture_is(export->form))
        say("item %s as=%s: a frame is some hundred packets; over radio, use ddxvideosend", export->name, rule->as);
    if (error)
        say("item %s as=%s: %s", export->name, rule->as, *why ? why : ddx_error_text(error));
}

static bool has_topic(const struct exports *exports, const char *topic) {
    for (const struct export *export = exports->first; export; export = export->next)
        if (!strcmp(export->topic, topic))
            return true;
    return false;
}

/* "video.frame" and "video_frame" would have one topic: the later one gets a number. */
static void choose_topic(const struct exports *exports, struct export *export) {
    char name[NAME_TOPIC];

    name_topic(exports->catalog->identity.name, export->name, name);
    strcpy(export->topic, name);
    for (unsigned number = 2; has_topic(exports, export->topic); number++)
        name_number(name, number, export->topic);
}

static void add(struct exports *exports, const struct ddx_item_info *info, const struct config_rule *rule) {
    struct export *export = exports->count < ITEMS_MAX ? calloc(1, sizeof *export) : NULL;

    if (!export) {
        if (!exports->full)
            say("more than %d items: other machines do not see %s and later ones", ITEMS_MAX, info->name);
        exports->full = true;
        return;
    }
    export->catalog = exports->catalog;
    export->rule = rule;
    export->info = *info;
    export->there = true;
    strcpy(export->name, info->name);
    choose_topic(exports, export);
    export->form = form_now(exports->catalog, info->name);
    int error = export->form ? open_outlet(export, export->topic, NULL, &export->own) : 0;
    if (error)
        say("%s: other machines cannot read it: %s", info->name, ddx_error_text(error));
    if (export->form)
        open_as(export);
    export->next = exports->first;
    exports->first = export;
    exports->count++;
}

/* Whether the item still has the announced form. */
static bool has_same_form(struct export *export, const struct ddx_item_info *info) {
    if (item_is_unchanged(info, &export->info))
        return true;
    struct form *form = form_now(export->catalog, export->name);
    bool same = form && export->form && form_same(form, export->form);
    form_free(form);
    export->info = *info;
    return same;
}

static void look_at(struct exports *exports, const struct ddx_item_info *info, const struct config_rule *rule) {
    struct export *export = exports->first;

    while (export && strcmp(export->name, info->name))
        export = export->next;
    if (!export)
        add(exports, info, rule);
    else
        export->there = has_same_form(export, info);
}

static void announce(const struct exports *exports, struct export *export) {
    if (!exports->announced || export->announced || !export->own)
        return;
    struct network_record record = record_of(export);
    export->announced = !network_records_write(export->catalog->records, &record);
}

/* Before its items, since other catalogs ignore items of machines that they do not know. */
static void announce_machine(struct exports *exports) {
    if (exports->announced)
        return;
    struct network_record record = record_of_machine(exports->catalog);
    exports->announced = !network_records_write(exports->catalog->records, &record);
}

void exports_look(struct exports *exports, const struct ddx_item_info *items, unsigned count) {
    network_linger(exports->catalog->network);
    announce_machine(exports);
    for (struct export *export = exports->first; export; export = export->next)
        export->there = false;
    for (unsigned i = 0; i < count; i++) {
        const struct config_rule *rule = config_rule_of(&exports->catalog->config, items[i].name, items[i].type);

        if (rule)
            look_at(exports, &items[i], rule);
    }
    for (struct export **at = &exports->first; *at;) {
        struct export *export = *at;

        if (export->there) {
            announce(exports, export);
            outlet_look(export->own);
            outlet_look(export->as);
            at = &export->next;
        } else { /* an item with another form is added again by the next call */
            *at = export->next;
            exports->count--;
            close_export(export);
        }
    }
}

void exports_each(const struct exports *exports, exports_take *take, void *argument) {
    for (const struct export *export = exports->first; export; export = export->next)
        if (export->announced)
            take(argument, export->name, export->form->type, outlet_readers(export->own) + outlet_readers(export->as));
}

struct exports *exports_open(struct catalog *catalog) {
    struct exports *exports = calloc(1, sizeof *exports);

    if (exports)
        exports->catalog = catalog;
    return exports;
}

void exports_withdraw(struct exports *exports) {
    network_linger(exports->catalog->network);
    while (exports->first) {
        struct export *export = exports->first;

        exports->first = export->next;
        close_export(export);
    }
    exports->count = 0;
    if (exports->announced) {
        struct network_record record = record_of_machine(exports->catalog);

        network_records_withdraw(exports->catalog->records, &record);
    }
    exports->announced = false;
}

void exports_close(struct exports *exports) {
    if (exports)
        exports_withdraw(exports);
    free(exports);
}
