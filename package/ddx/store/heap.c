/* SPDX-License-Identifier: GPL-2.0-or-later */
#include "heap.h"

#include <stdint.h>
#include <string.h>

#define UNIT 16u      /* bytes; sizes are multiples of it */
#define BINS 32       /* lists of free blocks: of 1 unit, 2 to 3, 4 to 7, ... */
#define LOOKS 8       /* blocks to try that may be too small; each block of the next list is large enough */
#define WORTH 65536u  /* bytes to return to the system at least; for less the call costs more than the memory saved */

/* In front of each piece. */
struct block {
    _Alignas(16) void *owner;
    uint32_t before;    /* size of the block below this one; 0: none */
    uint32_t size : 31; /* in units, with this header */
    uint32_t spare : 1;
};

/* A free block. It is never the last block (`used` shrinks instead), and never next to another free block. */
struct spare {
    struct block block;
    struct spare *next, *former;
    uint32_t fresh; /* units that were in use since the block was last returned to the system */
};
#define LEAST ((uint32_t)((sizeof(struct spare) + UNIT - 1) / UNIT))

struct heap {
    _Alignas(16) size_t room, used; /* bytes, counted from this struct */
    size_t top;                     /* maximum of `used` since the memory above it was last returned to the system */
    uint32_t last;                  /* size of the last block, in units */
    bool loose;                     /* there may be a free block that is worth returning */
    struct spare *bin[BINS];
};

static size_t place(const struct heap *heap, const void *block) {
    return (size_t)((const char *)block - (const char *)heap);
}

static struct block *above(const struct heap *heap, struct block *block) {
    char *end = (char *)block + (size_t)block->size * UNIT;

    return place(heap, end) < heap->used ? (void *)end : NULL;
}

static struct block *below(struct block *block) {
    return block->before ? (void *)((char *)block - (size_t)block->before * UNIT) : NULL;
}

static unsigned bin_of(uint32_t size) {
    return 31u - (unsigned)__builtin_clz(size);
}

static void put_in(struct heap *heap, struct block *block, uint32_t fresh) {
    struct spare *spare = (void *)block, **bin = &heap->bin[bin_of(block->size)];

    block->spare = 1;
    spare->fresh = fresh < block->size ? fresh : block->size;
    spare->former = NULL;
    spare->next = *bin;
    if (*bin)
        (*bin)->former = spare;
    *bin = spare;
    heap->loose |= (size_t)spare->fresh * UNIT >= WORTH;
}

/* Returns `fresh` of the block. */
static uint32_t take_out(struct heap *heap, struct block *block) {
    struct spare *spare = (void *)block;

    if (spare->next)
        spare->next->former = spare->former;
    if (spare->former)
        spare->former->next = spare->next;
    else
        heap->bin[bin_of(block->size)] = spare->next;
    block->spare = 0;
    return spare->fresh;
}

static struct block *find(const struct heap *heap, uint32_t size) {
    unsigned bin = bin_of(size);
    struct spare *spare = heap->bin[bin];

    for (unsigned i = 0; spare && i < LOOKS && spare->block.size < size; i++)
        spare = spare->next;
    if (spare && spare->block.size >= size)
        return &spare->block;
    while (++bin < BINS)
        if (heap->bin[bin])
            return &heap->bin[bin]->block;
    return NULL;
}

/* Take a free block; the rest of the block stays free. */
static struct block *cut(struct heap *heap, struct block *block, uint32_t size) {
    uint32_t fresh = take_out(heap, block), rest = block->size - size;
    struct block *tail = (void *)((char *)block + (size_t)size * UNIT);

    if (rest < LEAST)
        return block;
    block->size = size;
    tail->size = rest;
    tail->before = size;
    above(heap, tail)->before = rest;
    put_in(heap, tail, fresh);
    return block;
}

static struct block *extend(struct heap *heap, uint32_t size) {
    struct block *block = (void *)((char *)heap + heap->used);

    if ((size_t)size * UNIT > heap->room - heap->used)
        return NULL;
    block->size = size;
    block->before = heap->last;
    heap->last = size;
    heap->used += (size_t)size * UNIT;
    if (heap->used > heap->top)
        heap->top = heap->used;
    return block;
}

void heap_begin(struct heap *heap, size_t room) {
    heap->room = room;
    heap->used = heap->top = sizeof *heap;
}

void *heap_allocate(struct heap *heap, size_t bytes, void *owner) {
    if (bytes > heap->room)
        return NULL;
    uint32_t size = (uint32_t)((bytes + sizeof(struct block) + UNIT - 1) / UNIT);
    if (size < LEAST)
        size = LEAST;
    struct block *block = find(heap, size);
    block = block ? cut(heap, block, size) : extend(heap, size);
    if (!block)
        return NULL;
    block->spare = 0;
    block->owner = owner;
    return memset(block + 1, 0, (size_t)block->size * UNIT - sizeof *block);
}

void heap_free(struct heap *heap, void *memory) {
    struct block *block = (struct block *)memory - 1, *next = above(heap, block), *former = below(block);
    uint32_t fresh = block->size;

    if (next && next->spare) {
        fresh += take_out(heap, next);
        block->size += next->size;
    }
    if (former && former->spare) {
        fresh += take_out(heap, former);
        former->size += block->size;
        block = former;
    }
    next = above(heap, block);
    if (next) {
        next->before = block->size;
        put_in(heap, block, fresh);
        return;
    }
    heap->used = place(heap, block);
    heap->last = block->before;
}

void *heap_first(struct heap *heap) {
    return (char *)(heap + 1) + sizeof(struct block);
}

void *heap_owner(const void *memory) {
    return ((const struct block *)memory - 1)->owner;
}

size_t heap_bytes(const void *memory) {
    return (size_t)((const struct block *)memory - 1)->size * UNIT;
}

void heap_copy(char *to, const struct heap *heap) {
    const char *from = (const char *)heap;

    memcpy(to, from, sizeof *heap);
    for (size_t at = sizeof *heap; at < heap->used;) {
        const struct block *block = (const void *)(from + at);
        size_t bytes = (size_t)block->size * UNIT;

        memcpy(to + at, from + at, block->spare ? sizeof(struct spare) : bytes);
        at += bytes;
    }
}

/* Above the last block. */
static bool spare_top(struct heap *heap, size_t *from, size_t *to) {
    if (heap->top - heap->used < WORTH)
        return false;
    *from = heap->used;
    *to = heap->top;
    heap->top = heap->used;
    return true;
}

bool heap_spare(struct heap *heap, size_t *from, size_t *to) {
    if (spare_top(heap, from, to))
        return true;
    for (unsigned bin = bin_of(WORTH / UNIT); heap->loose && bin < BINS; bin++)
        for (struct spare *spare = heap->bin[bin]; spare; spare = spare->next)
            if ((size_t)spare->fresh * UNIT >= WORTH) {
                spare->fresh = 0;
                *from = place(heap, spare + 1);
                *to = place(heap, spare) + (size_t)spare->block.size * UNIT;
                return true;
            }
    if (heap->loose)
        heap->loose = false;
    return false;
}
