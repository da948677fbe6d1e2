/* SPDX-License-Identifier: GPL-2.0-or-later */
#include "checkpoint.h"

#include <errno.h>
#include <signal.h>
#include <stdatomic.h>
#include <stdint.h>
#include <string.h>
#include <sys/mman.h>
#include <unistd.h>

#include "heap.h"

#define ROOM ((size_t)64 << 20) /* address space; only used pages take memory */
#define PAGES (ROOM / 4096)     /* at most; pages may be larger */
#define OPEN 32                 /* pages that stay open: copying these is cheaper than page faults */
#define RANGES 64               /* returned by one commit at most; the next commit returns more */

/* Shared by all workers: which copy is valid. */
static struct version {
    _Atomic(uint32_t) newest; /* 0: none yet; else 1 or 2 */
} *version;
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
