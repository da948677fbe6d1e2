/* SPDX-License-Identifier: GPL-2.0-or-later */
/*
 * Pieces of memory in one stretch of address space, which need not start at the same address when it is only read.
 * Free neighbours become one, and the used part gets shorter when its last pieces are free. Knows of no process and no
 * copy: see checkpoint.h.
 */
#ifndef STORE_HEAP_H
#define STORE_HEAP_H

#include <stdbool.h>
#include <stddef.h>

struct heap;

/* An empty heap at the beginning of `room` bytes, all zeros. */
void heap_begin(struct heap *heap, size_t room);

/* All zeros; NULL: no room. The owner is only kept. */
void *heap_allocate(struct heap *heap, size_t bytes, void *owner);
void heap_free(struct heap *heap, void *memory);
void *heap_first(struct heap *heap); /* the piece at the lowest address */

void *heap_owner(const void *memory);
size_t heap_bytes(const void *memory); /* that the piece takes, its header included */

/* Copy what is in use, and not what is free, to the same places of another stretch. */
void heap_copy(char *to, const struct heap *heap);

/*
 * A range of bytes, counted from the beginning, that was in use since it was given back last, and is worth giving back
 * now. To be asked until it says false. The content of such a range counts for nothing.
 */
bool heap_spare(struct heap *heap, size_t *from, size_t *to);

#endif
