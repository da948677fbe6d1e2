/* SPDX-License-Identifier: LGPL-2.1-or-later */
/*
 * The slot protocol: how one writer and many readers share frames without waiting for each other. Pure memory
 * operations on structures of layout.h, no system calls, so that a test may run it under ThreadSanitizer with threads
 * as parties.
 *
 * Writer, for each frame:                        Reader, for each frame:
 *   W1 choose a slot that is not the newest         R1 choose a slot (the newest, or the next in order)
 *   W2 generation := WRITING                        R2 pin := slot
 *   W3 notice version unchanged? else undo          R3 generation the expected one? else unpin, again
 *   W4 read every pin; pinned? undo, next slot      R4 use the frame
 *   W5 write the frame, its number, its time        R5 pin := none
 *   W6 generation := even
 *   W7 latest := slot, wake
 *
 * W2 before W4 and R2 before R3 need a full store-load barrier each (sequentially consistent operations here), so that
 * at least one side sees the other. Without them both can miss each other, and a pinned frame is overwritten.
 */
#ifndef DDX_RING_H
#define DDX_RING_H

#include <stdbool.h>

#include "layout.h"

struct ddx_ring_reader {
    const struct ddx_pin_page *page; /* as the writer maps it */
    uint32_t id;
    uint32_t share; /* frames that it may pin at a time */
};

struct ddx_ring_writer {
    struct ddx_control *control;
    const struct ddx_notice *notice;
    uint32_t epoch;
    uint32_t notice_seen; /* version up to which `reader` is complete */
    uint64_t sequence;    /* of the newest frame */
    unsigned slot_count, told_count, reader_count;
    uint8_t slot[DDX_SLOTS_MAX]; /* slots that may be used; readers know the first `told_count`, which are preferred */
    struct ddx_ring_reader reader[DDX_READERS_MAX];
};

/* Data of the frame that a reader has pinned. */
struct ddx_ring_frame {
    unsigned slot;
    uint64_t sequence;
    int64_t time;
};

/*
 * W1-W4: *slot is the writer's until ddx_ring_publish() or ddx_ring_cancel().
 * -EAGAIN: readers were added: receive the store's messages, then call again. -ENOBUFS: every slot is pinned; cannot
 * happen with two slots more than the sum of the readers' shares. A pin counts while its reader is in the list.
 */
int ddx_ring_choose(struct ddx_ring_writer *writer, unsigned *slot);

/* Whether the slot that ddx_ring_choose() would return now holds a frame that a reader has not seen. */
bool ddx_ring_outruns(const struct ddx_ring_writer *writer);

/* W6-W7 without the wake-up, which the caller does. */
void ddx_ring_publish(struct ddx_ring_writer *writer, unsigned slot, int64_t time);

/* Drop the frame in the slot; no reader sees it. */
void ddx_ring_cancel(struct ddx_ring_writer *writer, unsigned slot);

/* The slot of the newest frame, or DDX_NO_SLOT. *latest: the word that was read, to sleep on. */
unsigned ddx_ring_newest(const struct ddx_control *control, uint32_t *latest);

/*
 * The generation that ddx_ring_pin() must find in the slot of `latest`: that of the published frame, not of a newer
 * frame in the slot, which may be whole but not published yet. DDX_WRITING if the frame was overwritten.
 */
uint32_t ddx_ring_published(const struct ddx_control *control, uint32_t latest);

/*
 * The slot with the smallest published sequence number above `seen`, or DDX_NO_SLOT; *generation is what
 * ddx_ring_pin() must find.
 */
unsigned ddx_ring_next(const struct ddx_control *control, uint64_t seen, uint32_t *generation);

/* Whether a frame is left with a number above `seen` and up to `last`; the oldest of them must have a `base`. */
bool ddx_ring_left(const struct ddx_control *control, void *const *base, uint64_t seen, uint64_t last);

/*
 * The slot that probably gets the next frame: the one being written, or else the oldest. Only a slot that has a `base`,
 * and not `except`, which the caller has pinned. DDX_NO_SLOT if there is none.
 */
unsigned ddx_ring_coming(const struct ddx_control *control, void *const *base, unsigned except);

/*
 * R2-R3. `generation` is the expected one. -EAGAIN: overwritten, nothing is pinned. A slot pinned by this word before
 * is unpinned.
 */
int ddx_ring_pin(const struct ddx_control *control, ddx_word *pin, unsigned slot, uint32_t generation,
                 struct ddx_ring_frame *frame);

/* R5. */
void ddx_ring_unpin(ddx_word *pin);

/* Number and time of the newest frame, without a pin; false if there is none. */
bool ddx_ring_peek(const struct ddx_control *control, struct ddx_ring_frame *frame);

#endif
