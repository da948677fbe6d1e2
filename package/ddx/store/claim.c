/* SPDX-License-Identifier: GPL-2.0-or-later */
#include <errno.h>
#include <string.h>

#include "../lib/fault.h"
#include "../lib/futex.h"
#include "budget.h"
#include "terms.h"
#include "epoch.h"
#include "files.h"
#include "items.h"
#include "log.h"
#include "send.h"

#define BESIDE 4 /* other descriptors of an epoch: control page, notice, the readers' one, the one to watch its end */

/* Whether this client may write this layout. */
static int permitted(struct client *client, const struct ddx_layout *layout) {
    struct item *item = client->item;

    if (item_is_awaited(item))
        return -ENOENT; /* awaited: its type is unknown */
    if (item->writer)
        return item->writer == client ? -EINVAL : -EEXIST;
    if (item->adopted && !item->store->settled && ddx_memory_held(item->epoch->control_fd))
        return -EEXIST; /* its writer outlived the former store and will report, unless it is stopped */
    if (item->away && item->epoch && ddx_memory_held(item->epoch->control_fd))
        return -EEXIST;
    if (item->readers)
        return ddx_layout_may_become(item_layout(item), layout);
    return 0;
}

static int new_notice(struct item *item) {
    int fd = ddx_memory_create(memfd_name_of(item->name, "notice"), ddx_page_round(1), NULL);
    int result = fd < 0 ? fd : item_set_notice(item, fd);

    if (!result)
        readers_count(item);
    return result;
}

/*
 * Readers that awaited the item asked for frames before the size was known. The writer takes precedence: each reader
 * keeps half of its frames, at least one. False if no reader can keep less, or if readers have seen frames and rely on
 * their shares.
 */
static bool keep_less(struct item *item) {
    bool less = false;

    for (struct client *c = item->store->clients; c && !item->epochs; c = c->next) {
        unsigned keep = c->item == item && c->id && c->keep > 1 ? c->keep / 2 : 0;

        if (keep) {
            item->keep_total -= c->keep - keep;
            c->keep = keep;
            less = true;
        }
    }
    return less;
}

/* The budget that a new epoch needs: now for the former epochs' files and its own; later for its own and the next's. */
static uint64_t most_of(const struct item *item, uint64_t frame_bytes) {
    uint64_t one =
        ddx_page_round(sizeof(struct ddx_control)) + (2 + item->keep_total) * frame_bytes + ddx_page_round(1);
    uint64_t pins = item->readers * ddx_page_round(1);
    uint64_t old = (item->epoch ? item_bytes(item) - pins : 0) + retired_bytes(item->store, item);

    return (old > one ? old : one) + one + pins;
}

/* No number is used twice: a program may still have the files of an epoch that never began. */
static uint32_t next_number(const struct item *item) {
    uint32_t last = (int32_t)(item->numbered - item->epochs) > 0 ? item->numbered : item->epochs;

    return last + (DDX_EPOCH_OK(last + 1) ? 1 : 2);
}

static int make_files(struct item *item, struct epoch *epoch, unsigned slots) {
    descriptors_for_item(item, slots + BESIDE);
    int result = epoch_create_control(epoch, item->name);
    if (!result)
        result = epoch_add_slots(epoch, item->name, epoch_slots_a_turn(epoch, slots));
    if (result)
        return result;
    epoch->wanted = slots;
    DDX_PASS(STORE_PREPARED);
    result = new_notice(item);
    DDX_PASS(STORE_NOTICE);
    return result;
}

static int prepare(struct item *item, const struct ddx_layout *layout) {
    struct epoch *epoch = epoch_new(layout, next_number(item));
    int result;

    if (!epoch)
        return -errno;
    unsigned wanted = item->keep_total;
    while (!budget_allows(item, most_of(item, epoch->runs.file_bytes)) && keep_less(item))
        continue;
    if (item->keep_total < wanted)
        log_line("%s: %u frames are kept for its readers, not %u: the memory budget is used up; give the store more "
                 "with -m",
                 item->name, item->keep_total, wanted);
    unsigned slots = 2 + item->keep_total;
    if (slots > DDX_SLOTS_MAX || !budget_allows(item, most_of(item, epoch->runs.file_bytes)))
        result = -ENOSPC;
    else
        result = make_files(item, epoch, slots);
    if (result) {
        epoch_free(epoch);
        return result;
    }
    if (item->epoch)
        epoch_carry_over(item->epoch, epoch, &item->sequence);
    DDX_PASS(STORE_CARRIED);
    item->numbered = epoch->number;
    item->pending = epoch;
    return 0;
}

static void tell_all(struct client *client) {
    struct item *item = client->item;
    struct epoch *epoch = item->pending;
    struct ddx_message message = {.operation = DDX_CLAIMED, .epoch = epoch->number, .sequence = item->sequence};
    int fds[2] = {epoch->control_fd, item->notice_fd};

    client_send(client, &message, epoch->layout, fds, 2);
    notify_slots(item, epoch, client);
    notify_readers(item);
}

void writer_claim(struct client *client, const struct ddx_layout *layout) {
    struct item *item = client->item;
    int result = layout ? permitted(client, layout) : -EINVAL;

    if (!result)
        result = prepare(item, layout);
    if (result) {
        client_reply(client, DDX_DONE, result);
        return;
    }
    item->writer = client;
    item->adopted = item->away = false;
    tell_all(client); /* DONE follows when the writer is ready */
}

static void go_live(struct item *item) {
    if (item->epoch)
        item->ended[item->epoch->number % ENDED] = (struct ended){item->epoch->number, item->sequence};
    item_begin_epoch(item, item->pending);
    item->pending = NULL;
    item->foreign = false;
    DDX_PASS(STORE_LIVE);
    notify_epoch_to_all(item);
    readers_count(item);
    /* After the notifications to the readers: they must see the first frame that is written after the claim. */
    client_reply(item->writer, DDX_DONE, 0);
    log_line("%s: the writer is %d, %llu bytes a frame", item->name, (int)item->writer->pid,
             (unsigned long long)item->epoch->runs.file_bytes);
}

/* Once the new writer knows all readers and has mapped all slots. */
static void go_live_if_ready(struct item *item) {
    if (item->pending && epoch_ready(item->pending) && item->taken == item->announced)
        go_live(item);
}

/* The claim fails. */
static void give_up(struct client *client, int status) {
    client_reply(client, DDX_DONE, status);
    writer_left(client);
}

static void make_more(struct item *item) {
    struct epoch *epoch = item->pending;
    unsigned count = epoch_slots_a_turn(epoch, epoch->wanted - epoch->slots);

    descriptors_for_item(item, epoch->wanted - epoch->slots);
    if (epoch_add_slots(epoch, item->name, count)) {
        give_up(item->writer, -ENOSPC);
        return;
    }
    notify_slots(item, epoch, item->writer);
}

bool writers_go_on(struct store *store) {
    bool any = false;

    for (struct client *client = store->clients; client; client = client->next) {
        struct item *item = client->item;

        if (client->gone || !item || item->writer != client || !item->pending ||
            item->pending->slots >= item->pending->wanted)
            continue;
        make_more(item);
        any = true;
    }
    return any;
}

/*
 * The writer cannot map a file. If the file belongs to the pending epoch, the claim fails; otherwise the writer
 * continues, and the reader that the file was for is refused.
 */
static void refused(struct client *client, struct epoch *epoch, const struct ddx_message *m) {
    if (epoch == client->item->pending) {
        give_up(client, m->status);
        return;
    }
    if (m->index < DDX_SLOTS_MAX && epoch->slot_fd[m->index] >= 0 && !epoch->slot_ready[m->index]) {
        file_close(epoch->slot_fd[m->index]);
        epoch->slot_fd[m->index] = -1;
        epoch->slot_told[m->index] = false;
        epoch->slots--;
    }
}

void writer_ready(struct client *client, const struct ddx_message *m) {
    struct item *item = client->item;

    if (!item || item->writer != client)
        return;
    struct epoch *epoch = item->pending ? item->pending : item->epoch;
    if (!epoch || m->epoch != epoch->number)
        return;
    DDX_PASS(STORE_READY);
    if (m->status) {
        refused(client, epoch, m);
        return;
    }
    /* The store checks this itself: readers must not get a file that a program could map writable. */
    if (m->index == DDX_NO_SLOT)
        epoch->control_ready = ddx_memory_sound(epoch->control_fd, ddx_page_round(sizeof(struct ddx_control)), true);
    else if (m->index < DDX_SLOTS_MAX && epoch->slot_fd[m->index] >= 0 && !epoch->slot_ready[m->index] &&
             ddx_memory_sound(epoch->slot_fd[m->index], epoch->runs.file_bytes, true)) {
        epoch->slot_ready[m->index] = true;
        if (epoch == item->epoch) {
            notify_slot_to_all(item, m->index);
            struct ddx_message answer = {.operation = DDX_SLOT, .epoch = epoch->number, .index = m->index};

            answer.flags = DDX_FLAG_READER | DDX_FLAG_WRITER;
            client_send(client, &answer, NULL, NULL, 0);
            readers_count(item);
        }
    }
    go_live_if_ready(item);
}

void writer_taken(struct client *client, const struct ddx_message *m) {
    struct item *item = client->item;

    if (!item || item->writer != client || (int32_t)((uint32_t)m->sequence - item->taken) <= 0 ||
        (int32_t)((uint32_t)m->sequence - item->announced) > 0)
        return;
    item->taken = (uint32_t)m->sequence;
    DDX_PASS(STORE_TAKEN_READER);
    struct client *reader = NULL;
    while ((reader = item_next_reader(item, reader)) && reader->id != m->index)
        continue;
    if (m->status && reader && reader->admitted && !reader->asked && item->pending) {
        give_up(client, m->status); /* it would overwrite frames that this reader holds */
        return;
    }
    /* First: a reader that is admitted now must get the new epoch before the answer that it is admitted, to find the
     * newest value. */
    go_live_if_ready(item);
    if (reader)
        reader_taken(reader, m->status);
}

void writer_left(struct client *client) {
    struct item *item = client->item;

    if (!item || item->writer != client)
        return;
    log_line("%s: its writer %d has left; the last frame remains", item->name, (int)client->pid);
    item->writer = NULL;
    item->away = !item->pending;
    /* The writer may have died between W7 and the wake-up: then readers sleep although a frame is there. */
    if (item->epoch)
        ddx_futex_wake(&item->epoch->control->latest);
    epoch_retire(item, item->pending);
    item->pending = NULL;
    readers_without_writer(item);
    DDX_PASS(STORE_WRITER_LEFT);
}
