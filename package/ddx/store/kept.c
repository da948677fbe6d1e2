/* SPDX-License-Identifier: GPL-2.0-or-later */
#include "kept.h"

#include <errno.h>
#include <stdatomic.h>
#include <stdint.h>
#include <string.h>
#include <sys/mman.h>

#define ROOM ((size_t)64 << 20) /* address space; only what is used takes memory */
#define CLASSES 20              /* of pieces: 64 bytes, 128, ... */
#define SMALLEST 64

/* In front of each piece. What is free is in a list of its class. */
struct piece {
    _Alignas(16) struct piece *next;
    uint32_t class;
};

struct heap {
    _Alignas(16) size_t used; /* bytes from here on */
    struct piece *free[CLASSES];
    void *root;
};

/* Seen by all workers: which copy counts. */
static struct kept {
    _Atomic(uint32_t) newest; /* 0: none yet; else 1 or 2 */
} *kept;
static char *copy[2];
static struct heap *heap;

static void *room(int kind) {
    void *memory = mmap(NULL, ROOM, PROT_READ | PROT_WRITE, kind | MAP_ANONYMOUS | MAP_NORESERVE, -1, 0);

    return memory == MAP_FAILED ? NULL : memory;
}

int kept_begin(void) {
    kept = mmap(NULL, sizeof *kept, PROT_READ | PROT_WRITE, MAP_SHARED | MAP_ANONYMOUS, -1, 0);
    copy[0] = room(MAP_SHARED);
    copy[1] = room(MAP_SHARED);
    heap = room(MAP_PRIVATE); /* each worker finds it empty, and at the same address */
    return kept == MAP_FAILED || !copy[0] || !copy[1] || !heap ? -ENOMEM : 0;
}

bool kept_restore(void) {
    uint32_t newest = atomic_load(&kept->newest);

    if (!newest) {
        heap->used = sizeof *heap;
        return false;
    }
    const char *from = copy[newest - 1];
    memcpy(heap, from, ((const struct heap *)(const void *)from)->used);
    return true;
}

void kept_commit(void) {
    uint32_t next = atomic_load(&kept->newest) == 1 ? 2 : 1;

    memcpy(copy[next - 1], heap, heap->used);
    /* Last, and after all of the copy: who dies before this leaves the former one. */
    atomic_store(&kept->newest, next);
}

void *kept_allocate(size_t bytes) {
    uint32_t class = 0;
    size_t size = SMALLEST;

    while (size < bytes && class < CLASSES) {
        size <<= 1;
        class++;
    }
    if (class == CLASSES)
        return NULL;
    struct piece *piece = heap->free[class];
    if (piece)
        heap->free[class] = piece->next;
    else if (heap->used + sizeof *piece + size > ROOM)
        return NULL;
    else {
        piece = (void *)((char *)heap + heap->used);
        heap->used += sizeof *piece + size;
    }
    piece->class = class;
    memset(piece + 1, 0, size);
    if (!heap->root)
        heap->root = piece + 1;
    return piece + 1;
}

void *kept_root(void) {
    return heap->root;
}

void kept_free(void *memory) {
    struct piece *piece = memory;

    if (!memory)
        return;
    piece--;
    piece->next = heap->free[piece->class];
    heap->free[piece->class] = piece;
}
