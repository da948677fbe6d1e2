/* SPDX-License-Identifier: GPL-2.0-or-later */
/*
 * An allocator in one range of address space; a heap that is only read may be at another address. Adjacent free pieces
 * are merged, and the used part shrinks when its last pieces are free. The allocator knows no processes and no copies:
 * see checkpoint.h.
 */
#ifndef STORE_HEAP_H
#define STORE_HEAP_H

#include <stdbool.h>
#include <stddef.h>

struct heap;

/* An empty heap at the beginning of `room` bytes, all zeros. */
void heap_begin(struct heap *heap, size_t room);

/* All zeros; NULL: no room. The owner is stored with the piece. */
void *heap_allocate(struct heap *heap, size_t bytes, void *owner);
void heap_free(struct heap *heap, void *memory);
void *heap_first(struct heap *heap); /* the piece at the lowest address */

void *heap_owner(const void *memory);
size_t heap_bytes(const void *memory); /* size of the piece with its header */

/* Copy the pieces in use, but not the free ones, to the same offsets of another range. */
void heap_copy(char *to, const struct heap *heap);

/*
 * Get a free range, in bytes from the beginning, that is large enough to be returned to the system and was in use since
 * its last return. To be called until it returns false. The content of the range is not needed.
 */
bool heap_spare(struct heap *heap, size_t *from, size_t *to);

#endif
