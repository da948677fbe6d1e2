/* SPDX-License-Identifier: LGPL-2.1-or-later */
/* Memory files: how an item's struct lies in a slot file, mapping it, sealing it. */
#ifndef DDX_MEMORY_H
#define DDX_MEMORY_H

#include <stdbool.h>
#include <sys/types.h>

#include "type.h"

/*
 * A stretch of pages: `place` in the struct, `file` in the slot file; bytes, multiples of the page size. It is mapped
 * with `room` bytes: the last one up to where its page table ends, so that the kernel moves whole page tables.
 */
struct ddx_run {
    uint64_t place, file, bytes, room;
};

/* The pages of a struct that are in use. A slot file holds these and no others, so it is no larger than its content. */
struct ddx_runs {
    uint64_t file_bytes; /* of a slot file */
    uint64_t span_bytes; /* of address space */
    unsigned count;
    struct ddx_run run[DDX_FIELDS_MAX];
};

void ddx_runs_of(const struct ddx_layout *layout, struct ddx_runs *runs);

uint64_t ddx_page_round(uint64_t bytes);

#define DDX_MEMORY_STEP ((uint64_t)16 << 20) /* bytes that are cleared or copied at once: some milliseconds */

/*
 * A memory file of `bytes` bytes, all of them backed by memory, of a fixed size. Descriptor, -ENOSPC, -ENOMEM.
 * `step` (NULL: none) is called after each DDX_MEMORY_STEP: the kernel clears every page, and a large file takes long.
 */
int ddx_memory_create(const char *name, uint64_t bytes, void (*step)(void));

/* Forbid any further writable mapping; those that exist stay. */
int ddx_memory_freeze(int fd);

/* Is this a memory file of this size, sealed against resizing (and, if `frozen`, against new writable mappings)? */
bool ddx_memory_sound(int fd, uint64_t bytes, bool frozen);

/*
 * A sign of life that other processes can see: hold a lock on the file through a description of our own, which dies
 * with this process at once (also as a zombie). A child that inherits the descriptor must close it, see keeper.c.
 * Descriptor to close, or -1.
 */
int ddx_memory_hold(int fd);
bool ddx_memory_held(int fd);

/*
 * A read-only description of the file to give away, with a mark that others see as long as anybody has it: as a
 * descriptor, as a mapping, or in a message that was not read yet. Descriptor to close, or -1 and errno.
 */
int ddx_memory_share(int fd);

/* Whether one that was given away is left; to be asked of a description of one's own, which is no mark. */
bool ddx_memory_shared(int fd);
int ddx_memory_watch(int fd); /* makes one: descriptor to close, or -1 and errno */

/* A memory file's number (inode), 0 if it is none. The same memory file? */
uint64_t ddx_memory_number(int fd);
bool ddx_memory_same(int a, int b);

/* Map a whole small file. NULL and errno on failure. */
void *ddx_memory_map(int fd, size_t bytes, bool writable);

/* Address space for one slot, aligned so that the kernel can move whole page tables. Reads as zeros. NULL and errno. */
void *ddx_slot_reserve(uint64_t span_bytes);

/* Lay a slot file into reserved address space, prefaulted. 0, -errno. */
int ddx_slot_map(void *base, const struct ddx_runs *runs, int fd, bool writable);

/*
 * Move the pages of a mapped slot from one address to another without copying; both stay mapped. Only what lies in the
 * first `span_bytes`, for which one of the two was reserved. 0, -errno.
 */
int ddx_slot_move(void *from, void *to, const struct ddx_runs *runs, uint64_t span_bytes, int fd);

void ddx_slot_unmap(void *base, uint64_t span_bytes);

#endif
