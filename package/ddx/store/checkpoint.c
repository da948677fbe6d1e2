/* SPDX-License-Identifier: GPL-2.0-or-later */
#include "checkpoint.h"

#include <errno.h>
#include <signal.h>
#include <stdatomic.h>
#include <stdint.h>
#include <string.h>
#include <sys/mman.h>
#include <unistd.h>

/* ---- Heap ---- */

/*
 * An allocator in one range of address space; a heap that is only read may be at another address. Adjacent free pieces
 * are merged, and the used part shrinks when its last pieces are free. The allocator knows no processes and no copies:
 * see checkpoint.h.
 */

#define UNIT 16u     /* bytes; sizes are multiples of it */
#define BINS 32      /* lists of free blocks: of 1 unit, 2 to 3, 4 to 7, ... */
#define LOOKS 8      /* blocks to try that may be too small; each block of the next list is large enough */
#define WORTH 65536u /* bytes to return to the system at least; for less the call costs more than the memory saved */

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

static struct block *find_free(const struct heap *heap, uint32_t size) {
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

/* An empty heap at the beginning of `room` bytes, all zeros. */
static void heap_begin(struct heap *heap, size_t room) {
    heap->room = room;
    heap->used = heap->top = sizeof *heap;
}

/* All zeros; NULL: no room. The owner is stored with the piece. */
static void *heap_allocate(struct heap *heap, size_t bytes, void *owner) {
    if (bytes > heap->room)
        return NULL;
    uint32_t size = (uint32_t)((bytes + sizeof(struct block) + UNIT - 1) / UNIT);
    if (size < LEAST)
        size = LEAST;
    struct block *block = find_free(heap, size);
    block = block ? cut(heap, block, size) : extend(heap, size);
    if (!block)
        return NULL;
    block->spare = 0;
    block->owner = owner;
    return memset(block + 1, 0, (size_t)block->size * UNIT - sizeof *block);
}

static void heap_free(struct heap *heap, void *memory) {
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

/* the piece at the lowest address */
static void *heap_first(struct heap *heap) {
    return (char *)(heap + 1) + sizeof(struct block);
}

static void *heap_owner(const void *memory) {
    return ((const struct block *)memory - 1)->owner;
}

/* size of the piece with its header */
static size_t heap_bytes(const void *memory) {
    return (size_t)((const struct block *)memory - 1)->size * UNIT;
}

/* Copy the pieces in use, but not the free ones, to the same offsets of another range. */
static void heap_copy(char *to, const struct heap *heap) {
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

/*
 * Get a free range, in bytes from the beginning, that is large enough to be returned to the system and was in use since
 * its last return. To be called until it returns false. The content of the range is not needed.
 */
static bool heap_spare(struct heap *heap, size_t *from, size_t *to) {
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

/* ---- Checkpoint ---- */

#define ROOM ((size_t)64 << 20) /* address space; only used pages take memory */
#define PAGES (ROOM / 4096)     /* at most; pages may be larger */
#define OPEN 32                 /* pages that stay open: copying these is cheaper than page faults */
#define RANGES 64               /* returned by one commit at most; the next commit returns more */

/* Shared by all workers: which copy is valid. */
static struct version { _Atomic(uint32_t) newest; /* 0: none yet; else 1 or 2 */ } * version;
static char *copy[2];
static struct heap *heap;
static struct checkpoint_payer payer;

/* Numbers of pages. */
struct pages {
    unsigned count;
    uint32_t page[PAGES];
};
static struct pages open;  /* writable; in the order of opening */
static struct pages stale; /* closed by the last commit, not yet copied to the older copy */
static size_t page_bytes, copied;
static struct sigaction former;

static void *room(int kind) {
    void *memory = mmap(NULL, ROOM, PROT_READ | PROT_WRITE, kind | MAP_ANONYMOUS | MAP_NORESERVE, -1, 0);

    return memory == MAP_FAILED ? NULL : memory;
}

int checkpoint_begin(void) {
    page_bytes = (size_t)sysconf(_SC_PAGESIZE);
    version = mmap(NULL, sizeof *version, PROT_READ | PROT_WRITE, MAP_SHARED | MAP_ANONYMOUS, -1, 0);
    copy[0] = room(MAP_SHARED);
    copy[1] = room(MAP_SHARED);
    heap = room(MAP_PRIVATE); /* empty and at the same address in each worker */
    if (version == MAP_FAILED || !copy[0] || !copy[1] || !heap)
        return -ENOMEM;
    madvise(heap, ROOM, MADV_NOHUGEPAGE); /* its pages are opened one by one */
    return 0;
}

static bool protect(size_t page, size_t count, int how) {
    return !mprotect((char *)heap + page * page_bytes, count * page_bytes, how);
}

static void add(struct pages *list, size_t page) {
    list->page[list->count++] = (uint32_t)page;
}

/* A write to a page that is not open opens the page. Any other access is an error and kills the worker. */
static void on_fault(int number, siginfo_t *info, void *context) {
    size_t place = (uintptr_t)info->si_addr - (uintptr_t)heap;

    (void)number, (void)context;
    if (place < ROOM && info->si_code == SEGV_ACCERR && open.count < PAGES &&
        protect(place / page_bytes, 1, PROT_READ | PROT_WRITE))
        add(&open, place / page_bytes);
    else
        sigaction(SIGSEGV, &former, NULL);
}

static void close_all(void) {
    struct sigaction action = {.sa_sigaction = on_fault, .sa_flags = SA_SIGINFO};

    open.count = stale.count = 0;
    protect(0, ROOM / page_bytes, PROT_READ);
    sigaction(SIGSEGV, &action, &former);
}

/* Make the other copy equal to the newest one: the worker that died may have left it inconsistent. */
bool checkpoint_restore(void) {
    uint32_t newest = atomic_load(&version->newest);

    if (newest) {
        const struct heap *from = (const void *)copy[newest - 1];

        heap_copy((char *)heap, from);
        madvise(copy[2 - newest], ROOM, MADV_REMOVE);
        heap_copy(copy[2 - newest], from);
    }
    close_all();
    if (!newest)
        heap_begin(heap, ROOM);
    return newest;
}

static void copy_pages(char *to, const struct pages *list) {
    for (unsigned i = 0; i < list->count; i++)
        memcpy(to + list->page[i] * page_bytes, (char *)heap + list->page[i] * page_bytes, page_bytes);
    copied += list->count * page_bytes;
}

/* Close the pages that were opened first. */
static void close_some(void) {
    unsigned some = open.count > OPEN ? open.count - OPEN : 0;

    for (stale.count = 0; stale.count < some;) {
        protect(open.page[stale.count], 1, PROT_READ);
        add(&stale, open.page[stale.count]);
    }
    open.count -= some;
    memmove(open.page, open.page + some, open.count * sizeof *open.page);
}

static void leave_out(struct pages *list, size_t first, size_t end) {
    unsigned count = 0;

    for (unsigned i = 0; i < list->count; i++)
        if (list->page[i] < first || list->page[i] >= end)
            list->page[count++] = list->page[i];
    list->count = count;
}

/* Heap and copies may differ in this range afterwards: free memory has no content. */
static void give_back(size_t from, size_t to) {
    size_t first = (from + page_bytes - 1) / page_bytes, end = to / page_bytes;

    if (first >= end)
        return;
    size_t place = first * page_bytes, bytes = (end - first) * page_bytes;
    leave_out(&open, first, end);
    leave_out(&stale, first, end);
    protect(first, end - first, PROT_READ);
    madvise((char *)heap + place, bytes, MADV_DONTNEED);
    for (unsigned i = 0; i < 2; i++)
        madvise(copy[i] + place, bytes, MADV_REMOVE);
}

void checkpoint_commit(void) {
    uint32_t next = atomic_load(&version->newest) == 1 ? 2 : 1;
    size_t from[RANGES], to[RANGES];
    unsigned ranges = 0;

    while (ranges < RANGES && heap_spare(heap, &from[ranges], &to[ranges]))
        ranges++;
    copied = 0;
    copy_pages(copy[next - 1], &stale);
    copy_pages(copy[next - 1], &open);
    /* After the whole copy: a worker that dies before this leaves the former copy valid. */
    atomic_store(&version->newest, next);
    close_some();
    /* Only now: until here the former copy was valid, in which these ranges may be in use. */
    for (unsigned i = 0; i < ranges; i++)
        give_back(from[i], to[i]);
}

size_t checkpoint_copied(void) {
    return copied;
}

struct checkpoint_payer checkpoint_charge(struct checkpoint_account *account, size_t most) {
    struct checkpoint_payer before = payer;

    payer = (struct checkpoint_payer){account, most};
    return before;
}

void *checkpoint_allocate(size_t bytes) {
    struct checkpoint_account *account = payer.account;

    if (account && (bytes > payer.most || account->bytes > payer.most - bytes)) {
        account->refused = true;
        errno = EDQUOT;
        return NULL;
    }
    void *memory = heap_allocate(heap, bytes, account);
    if (!memory)
        errno = ENOMEM;
    else if (account)
        account->bytes += heap_bytes(memory);
    return memory;
}

void *checkpoint_root(void) {
    return heap_first(heap);
}

struct checkpoint_account *checkpoint_account(const void *memory) {
    return heap_owner(memory);
}

void checkpoint_free(void *memory) {
    if (!memory)
        return;
    struct checkpoint_account *account = checkpoint_account(memory);
    if (account)
        account->bytes -= heap_bytes(memory);
    heap_free(heap, memory);
}
