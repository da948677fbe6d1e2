/* SPDX-License-Identifier: LGPL-2.1-or-later */
/*
 * Layout of the shared memory. Fixed-width fields only, the same for i386 and x86_64; a change here needs a new
 * DDX_LAYOUT_VERSION. Four kinds of memory file, all made by the store:
 *
 *   control  one per epoch (one writer's term). Written by the writer, mapped read-only by readers.
 *   slot     one per frame, the item's struct without its unused pages. Written by the writer, read-only for readers.
 *   pin      one page per reader. Written by that reader, read-only for the writer: a bad reader harms only itself.
 *   notice   one page per item, shared by store and writer only: the store announces new readers there.
 *
 * Control and slots are sealed against resizing and, once the writer has mapped them, against any further writable
 * mapping (F_SEAL_FUTURE_WRITE). Hence every new writer gets new files: a new epoch.
 */
#ifndef DDX_LAYOUT_H
#define DDX_LAYOUT_H

#include <assert.h>
#include <stdatomic.h>
#include <stddef.h>
#include <stdint.h>

/*
 * When a frame comes, the code that delivers it is usually not in the cache. So the functions of the frame path are
 * placed side by side, without rarely used code between them.
 */
#define DDX_HOT __attribute__((hot))
#define DDX_COLD __attribute__((cold, noinline))

#define DDX_LAYOUT_VERSION 2u
#define DDX_CONTROL_MAGIC 0x43584444u /* "DDXC" */
#define DDX_SLOTS_MAX 255u
#define DDX_NO_SLOT 255u
#define DDX_READERS_MAX (DDX_SLOTS_MAX - 2u)

typedef _Atomic(uint32_t) ddx_word; /* 32 bits: lock-free on all machines, also on a read-only page */

/*
 * Generation of a slot.
 *   even   a whole frame; bits 1..31 are the low 31 bits of its sequence number
 *   odd    not readable: DDX_EMPTY (never written, or given back) or DDX_WRITING
 */
#define DDX_EMPTY 1u
#define DDX_WRITING 3u

struct ddx_slot_state {
    ddx_word generation;
    ddx_word sequence_low, sequence_high;
    ddx_word time_low, time_high;
    uint32_t unused[3];
};

/* `latest`: low 23 bits of the sequence number of the newest frame, and its slot. The word that readers sleep on. */
#define DDX_LATEST(sequence, slot) (((uint32_t)(sequence)&0x7fffffu) << 8 | (uint32_t)(slot))
#define DDX_LATEST_SLOT(latest) ((latest)&0xffu)
#define DDX_LATEST_SEQUENCE(latest) ((latest) >> 8 & 0x7fffffu)

struct ddx_control {
    uint32_t magic, version, epoch, unused0[13]; /* constant */
    ddx_word latest;                             /* a cache line of its own: the only word that every reader polls */
    uint32_t unused1[15];
    ddx_word slots; /* slots in use have numbers below this */
    uint32_t unused2[31];
    struct ddx_slot_state slot[DDX_SLOTS_MAX];
};
static_assert(offsetof(struct ddx_control, latest) == 64, "shared layout");
static_assert(offsetof(struct ddx_control, slot) == 256, "shared layout");
static_assert(sizeof(struct ddx_slot_state) == 32, "shared layout");
static_assert(sizeof(struct ddx_control) == 256 + 32 * DDX_SLOTS_MAX, "shared layout");

/* `pin`: the slot and epoch that this reader holds, 0 for none. The low 24 bits of an epoch are never all 0, so that
 * slot 0 differs from none. */
#define DDX_EPOCH_OK(epoch) (((epoch)&0xffffffu) != 0)
#define DDX_PIN(epoch, slot) (((epoch)&0xffffffu) << 8 | (uint32_t)(slot))

#define DDX_PIN_READ 0   /* by ddx_store_acquire(), and while ddx_store_read() copies */
#define DDX_PIN_DIRECT 1 /* by ddx_store_read_direct() */
#define DDX_PINS 2

struct ddx_pin_page {
    ddx_word pin[DDX_PINS];
    ddx_word missed_low, missed_high; /* for display: number of missed frames */
    ddx_word seen;                    /* low bits of the newest frame taken: for a writer that can delay its writes */
};

struct ddx_notice {
    ddx_word version; /* changes after each message about a new reader was queued for the writer */
    ddx_word readers; /* number of readers that frames are kept for */
};

#endif
