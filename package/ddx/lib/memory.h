/* SPDX-License-Identifier: LGPL-2.1-or-later */
/* Memory files: layout of an item's struct in a slot file, mapping, sealing. */
#ifndef DDX_MEMORY_H
#define DDX_MEMORY_H

#include <stdbool.h>
#include <sys/types.h>

#include "type.h"

/*
 * A range of pages, at offset `place` in the struct and `file` in the slot file; bytes, multiples of the page size.
 * `room` bytes are mapped for it: the last range extends to the end of its page table, so that the kernel can move
 * whole page tables.
 */
struct ddx_run {
    uint64_t place, file, bytes, room;
};

/* The pages of a struct that are in use. A slot file holds only these, so it is not larger than its content. */
struct ddx_runs {
    uint64_t file_bytes; /* of a slot file */
    uint64_t span_bytes; /* of address space */
    unsigned count;
    struct ddx_run run[DDX_FIELDS_MAX];
};

void ddx_runs_of(const struct ddx_layout *layout, struct ddx_runs *runs);

uint64_t ddx_page_round(uint64_t bytes);

#define DDX_MEMORY_STEP ((uint64_t)16 << 20) /* bytes that are cleared or copied at once: a few milliseconds */

/*
 * Create a memory file of fixed size, fully backed by memory. Descriptor, -ENOSPC, -ENOMEM. `step` (NULL: none) is
 * called after each DDX_MEMORY_STEP, because the kernel clears every page, which takes long for a large file.
 */
int ddx_memory_create(const char *name, uint64_t bytes, void (*step)(void));

/* Forbid any further writable mapping; existing ones remain. */
int ddx_memory_freeze(int fd);

/* Whether this is a memory file of this size, sealed against resizing (if `frozen`, also against writable mappings). */
bool ddx_memory_sound(int fd, uint64_t bytes, bool frozen);

/*
 * Hold a lock on the file that shows other processes that this one lives: the lock belongs to a separate description,
 * which the kernel closes when this process dies (also as a zombie). A child that inherits the descriptor must close
 * it, see keeper.c. Descriptor to close, or -1.
 */
int ddx_memory_hold(int fd);
bool ddx_memory_held(int fd);

/*
 * Make a read-only description of the file for other processes. ddx_memory_shared() reports whether any process still
 * has it: as a descriptor, as a mapping, or in an unread message. Descriptor to close, or -1 and errno.
 */
int ddx_memory_share(int fd);

/* Whether any shared description is left. `fd` must be a description from ddx_memory_watch(), which does not count. */
bool ddx_memory_shared(int fd);
int ddx_memory_watch(int fd); /* descriptor to close, or -1 and errno */

/* A memory file's number (inode), 0 for any other file. Whether two descriptors are the same memory file. */
uint64_t ddx_memory_number(int fd);
bool ddx_memory_same(int a, int b);

/* Map a whole small file. NULL and errno on failure. */
void *ddx_memory_map(int fd, size_t bytes, bool writable);

/* Address space for one slot, aligned so that the kernel can move whole page tables. Reads as zeros. NULL and errno. */
void *ddx_slot_reserve(uint64_t span_bytes);

/* Map a slot file into reserved address space, prefaulted. 0, -errno. */
int ddx_slot_map(void *base, const struct ddx_runs *runs, int fd, bool writable);

/*
 * Move the pages of a mapped slot from one address to another without copying; both remain mapped. Only pages in the
 * first `span_bytes`, the size that was reserved for the smaller of the two. 0, -errno.
 */
int ddx_slot_move(void *from, void *to, const struct ddx_runs *runs, uint64_t span_bytes, int fd);

void ddx_slot_unmap(void *base, uint64_t span_bytes);

#endif
