/* SPDX-License-Identifier: LGPL-2.1-or-later */
/* The parts of a handle, and what they do for each other. With `lock` held, except in item.c and keeper.c. */
#ifndef DDX_ROLES_H
#define DDX_ROLES_H

#include "handle.h"

/* ---- Opening items of this machine's store: item.c. request.c adds the items of other machines ---- */

/* Wait for the store until `deadline`. 0 or -errno. */
int ddx_local_open(int port, int64_t deadline, DDX_STORE_ID **id);

/* As ddx_store_lookup_item(). 0 or -errno. */
int ddx_local_lookup(DDX_STORE_ID *id, const char *name, const char *type, int size, DDX_STORE_ITEM **item);

/*
 * ---- The keeper: keeper.c ----
 *
 * One thread per process that receives the store's messages for all items. It maps new slots, readers and epochs before
 * the frame path needs them, and offers the items to a restarted store, even while the program itself sleeps.
 */

/* Both take the keeper's lock. */
int ddx_keeper_add(DDX_STORE_ITEM *item);
void ddx_keeper_remove(DDX_STORE_ITEM *item); /* after that the keeper does not use the item */

/* ---- The store's messages, answers and notifications: receive.c ---- */

/* Handle all waiting messages. 0; -EPIPE: the store has disconnected. */
int ddx_item_service(DDX_STORE_ITEM *item);
/* Send, then wait for `answer`. 0, the answer's status, -ECONNREFUSED. */
int ddx_item_request(DDX_STORE_ITEM *item, const struct ddx_message *message, const struct ddx_layout *layout,
                     uint32_t answer);
void ddx_item_disconnect(DDX_STORE_ITEM *item);
/* After a restart of the store: connect, and offer this handle's memory files. 0, or -errno. */
int ddx_item_reconnect(DDX_STORE_ITEM *item);

/* ---- A reader gets a frame: it attaches to the item, waits for the wanted frame, and pins it: reader.c ---- */

/* Ask the store for memory for this number of frames. */
int ddx_reader_ask(DDX_STORE_ITEM *item, unsigned frames);
/*
 * Wait for a frame according to `tail` and pin it with pin number `pin`. `lock` is released while sleeping. On success
 * frame->slot is pinned in item->reader.term; until then the pin holds the former frame.
 */
int ddx_reader_take(DDX_STORE_ITEM *item, unsigned pin, struct ddx_ring_frame *frame, uint64_t *missed, double timeout,
                    int tail);
/*
 * Wake the reader if it has slept since before the last message. Returns whether it has: then call again soon, since
 * the reader may be about to sleep, and sleeps on the writer's word only.
 */
bool ddx_reader_wake(const DDX_STORE_ITEM *item);

/* ---- The reader's role: reader_role.c ---- */

/* Reserve a window that is large enough for `shown`. 0, or -errno. */
int ddx_window_make(struct ddx_reader_role *reader, const struct ddx_layout *shown);
/* For a reader that is about to sleep: move the pages of the probable next slot in advance. */
void ddx_window_prepare(struct ddx_reader_role *reader);
/* No frame came: show the former one again. */
void ddx_window_restore(struct ddx_reader_role *reader);
/*
 * No newer frame could be pinned: pin the shown frame again. False if that frame was overwritten, so that the window
 * needs another one. True also if the window shows nothing, or a frame of an epoch that has ended.
 */
bool ddx_window_keep(struct ddx_reader_role *reader);
/* Show the pinned slot of the reader's term. 0, or -errno if the caller's struct cannot hold its value. */
int ddx_window_show(struct ddx_reader_role *reader, unsigned slot);

void ddx_reader_on_epoch(DDX_STORE_ITEM *item, struct ddx_packet *packet);
void ddx_reader_on_slot(struct ddx_reader_role *reader, struct ddx_packet *packet);
void ddx_reader_on_attached(struct ddx_reader_role *reader, struct ddx_packet *packet);

/* Set the number of the newest frame seen, also in the pin page, if there is one. */
void ddx_reader_saw(struct ddx_reader_role *reader, uint64_t sequence);
void ddx_reader_follow(struct ddx_reader_role *reader); /* switch to the coming term, if no frame is held */
void ddx_reader_end(struct ddx_reader_role *reader);

/* ---- A writer: writer.c ---- */

/* Become the item's writer, unless this handle is the writer already. 0, or -errno. */
int ddx_writer_claim(DDX_STORE_ITEM *item);

/* ---- The writer's role: writer_role.c ---- */

void ddx_writer_on_reader(DDX_STORE_ITEM *item, struct ddx_packet *packet);
void ddx_writer_on_reader_gone(struct ddx_writer_role *writer, const struct ddx_message *m);

/*
 * Remove readers whose pin page no process holds any more: only leaving ones, or `all`. The store's READER_GONE is not
 * sufficient, because the store may have disconnected a reader that was only stopped. True if any was removed.
 */
bool ddx_writer_forget(struct ddx_writer_role *writer, bool all);

void ddx_writer_on_claimed(DDX_STORE_ITEM *item, struct ddx_packet *packet); /* its term begins */
void ddx_writer_on_slot(DDX_STORE_ITEM *item, struct ddx_packet *packet);
void ddx_writer_on_slot_told(struct ddx_writer_role *writer, const struct ddx_message *m); /* readers know it */
void ddx_writer_on_done(struct ddx_writer_role *writer, const struct ddx_message *m);
void ddx_writer_on_offered(struct ddx_writer_role *writer, const struct ddx_message *m);

void ddx_writer_end(struct ddx_writer_role *writer);

#endif
