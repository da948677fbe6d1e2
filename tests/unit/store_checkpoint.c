/* SPDX-License-Identifier: GPL-2.0-or-later */
/*
 * The heap of the store's workers: each worker finds it as the previous one last committed it, at the same addresses,
 * whatever that worker did afterwards and whenever it died. Only changed pages are copied; free memory is returned.
 */
#include "../../package/ddx/store/checkpoint.h"

#include <errno.h>
#include <signal.h>
#include <stdatomic.h>
#include <stdint.h>
#include <stdlib.h>
#include <string.h>
#include <sys/mman.h>
#include <sys/wait.h>
#include <time.h>
#include <unistd.h>

#include "check.h"

#define PIECES 1000
#define LARGEST 5000
#define GENERATIONS 20
#define KILLS 60
#define CHANGES 40 /* pieces in one commit */
#define SMALL 2000
#define LARGE 20000 /* bytes: the declaration of a large type */
#define MANY 400    /* of these: 8 MB, and as much in either copy */

struct root {
    unsigned generation;
    unsigned char *piece[PIECES];
    size_t bytes[PIECES];
};

static unsigned char content(unsigned generation, unsigned i) {
    return (unsigned char)(generation * 31 + i);
}

static void fill(struct root *root, unsigned i) {
    root->bytes[i] = 1 + (root->generation * 7919 + i * 104729) % LARGEST;
    root->piece[i] = checkpoint_allocate(root->bytes[i]);
    CHECK(root->piece[i]);
    for (size_t k = 0; k < root->bytes[i]; k++)
        CHECK_EQUAL(root->piece[i][k], 0);
    memset(root->piece[i], content(root->generation, i), root->bytes[i]);
}

/* Every worker frees half of its pieces and allocates others; changes after its commit are never found. */
static void work(unsigned generation) {
    bool before = checkpoint_restore();
    struct root *root = before ? checkpoint_root() : checkpoint_allocate(sizeof *root);

    CHECK_EQUAL(before, generation > 0);
    CHECK(root && root == checkpoint_root());
    CHECK_EQUAL(root->generation, generation);
    root->generation++;
    for (unsigned i = 0; i < PIECES; i++) {
        for (size_t k = 0; k < root->bytes[i] && before; k++)
            CHECK_EQUAL(root->piece[i][k], *root->piece[i]);
        if (before && i % 2 == generation % 2) /* this one is of the last worker */
            CHECK_EQUAL(*root->piece[i], content(generation, i));
        if (!before || i % 2 != generation % 2) {
            checkpoint_free(root->piece[i]);
            fill(root, i);
        }
    }
    checkpoint_commit();
    root->generation = 77;
    for (unsigned i = 0; i < PIECES; i++) {
        memset(root->piece[i], 0xaa, root->bytes[i]);
        checkpoint_free(root->piece[i]);
    }
    CHECK(!checkpoint_allocate(SIZE_MAX / 2));
    while (generation == GENERATIONS - 1 && checkpoint_allocate(1 << 20)) /* all free memory */
        continue;
    _exit(0);
}

static void each_goes_on_where_the_one_before_committed(void) {
    for (unsigned generation = 0; generation < GENERATIONS; generation++) {
        int status;
        pid_t pid = fork();

        CHECK(pid >= 0);
        if (pid == 0)
            work(generation);
        CHECK_EQUAL(waitpid(pid, &status, 0), pid);
        CHECK_EQUAL(status, 0);
    }
}

/* Every piece is filled with one value, and the root has the sum of all values. */
struct balance {
    uint32_t commits, sum;
    uint32_t *piece[PIECES];
    size_t words[PIECES];
};

static void change(struct balance *balance, unsigned i, uint32_t content) {
    if (balance->piece[i]) {
        balance->sum -= *balance->piece[i];
        checkpoint_free(balance->piece[i]);
    }
    balance->words[i] = 1 + content % (SMALL / sizeof content);
    balance->piece[i] = checkpoint_allocate(balance->words[i] * sizeof content);
    CHECK(balance->piece[i]);
    for (size_t k = 0; k < balance->words[i]; k++)
        balance->piece[i][k] = content;
    balance->sum += content;
}

static void check_balance(const struct balance *balance) {
    uint32_t sum = 0;

    for (unsigned i = 0; i < PIECES; i++) {
        for (size_t k = 0; k < balance->words[i]; k++)
            CHECK_EQUAL(balance->piece[i][k], *balance->piece[i]);
        sum += balance->piece[i] ? *balance->piece[i] : 0;
    }
    CHECK_EQUAL(sum, balance->sum);
}

/* Commits until it is killed; *told: the number of commits that others may know. */
static void commit_on(_Atomic(uint32_t) *told) {
    struct balance *balance = checkpoint_restore() ? checkpoint_root() : checkpoint_allocate(sizeof *balance);
    uint32_t random = balance->commits + 1;

    CHECK(balance->commits >= atomic_load(told));
    check_balance(balance);
    for (;;) {
        for (unsigned i = 0; i < CHANGES; i++) {
            random = random * 1664525 + 1013904223;
            change(balance, (random >> 8) % PIECES, random >> 4);
        }
        balance->commits++;
        checkpoint_commit();
        atomic_store(told, balance->commits);
    }
}

static void killed_at_any_moment(void) {
    _Atomic(uint32_t) *told = mmap(NULL, sizeof *told, PROT_READ | PROT_WRITE, MAP_SHARED | MAP_ANONYMOUS, -1, 0);
    int status;

    CHECK(told != MAP_FAILED);
    for (unsigned i = 0; i < KILLS; i++) {
        uint32_t before = atomic_load(told);
        pid_t pid = fork();

        CHECK(pid >= 0);
        if (pid == 0)
            commit_on(told);
        while (atomic_load(told) < before + 3) {
            CHECK_EQUAL(waitpid(pid, &status, WNOHANG), 0);
            nanosleep(&(struct timespec){0, 10000}, NULL);
        }
        nanosleep(&(struct timespec){0, (long)(i * 7919 % 97) * 3000}, NULL);
        kill(pid, SIGKILL);
        CHECK_EQUAL(waitpid(pid, &status, 0), pid);
        CHECK(WIFSIGNALED(status) && WTERMSIG(status) == SIGKILL);
    }
}

/* KiB of the heap that are in memory, from this address on. */
static unsigned long resident_heap(char *from) {
    static unsigned char pages[MANY * LARGE / 4096 + 1];
    size_t page = (size_t)sysconf(_SC_PAGESIZE), count = (size_t)MANY * LARGE / page;
    unsigned long sum = 0;

    CHECK_EQUAL(mincore(from - (uintptr_t)from % page, count * page, pages), 0);
    for (size_t i = 0; i < count; i++)
        sum += pages[i] & 1;
    return sum * page >> 10;
}

/* KiB of memory that this process shares with others: both copies. */
static unsigned long resident_copies(void) {
    FILE *file = fopen("/proc/self/status", "re");
    unsigned long found = 0;
    char line[128];

    while (file && fgets(line, sizeof line, file) && sscanf(line, "RssShmem: %lu", &found) != 1)
        continue;
    CHECK(file);
    fclose(file);
    return found;
}

static void copies_what_has_changed_and_gives_back(void) {
    static char *piece[MANY];

    CHECK(!checkpoint_restore());
    char *root = checkpoint_allocate(1);
    for (unsigned i = 0; i < MANY; i++)
        CHECK((piece[i] = checkpoint_allocate(LARGE)));
    checkpoint_commit();
    CHECK(checkpoint_copied() >= (size_t)MANY * LARGE);
    for (unsigned i = 0; i < 3; i++) {
        checkpoint_commit();
        *piece[i] = *root = 1;
    }
    checkpoint_commit();
    CHECK(checkpoint_copied() < (size_t)MANY * LARGE / 20);
    /* Some pieces stay, the topmost among them. */
    CHECK(resident_heap(piece[0]) > MANY * (LARGE >> 10));
    CHECK(resident_copies() > MANY * (LARGE >> 10));
    for (unsigned i = 0; i < MANY; i++)
        if (i % 100 != 99)
            checkpoint_free(piece[i]);
    for (unsigned i = 0; i < 3; i++)
        checkpoint_commit();
    CHECK(resident_heap(piece[0]) < MANY * (LARGE >> 10) / 5);
    CHECK(resident_copies() < MANY * (LARGE >> 10) / 5);
    for (unsigned i = 99; i < MANY; i += 100)
        checkpoint_free(piece[i]);
    CHECK(checkpoint_allocate((size_t)MANY * LARGE)); /* the free pieces have become one */
}

static void each_account_has_a_share(void) {
    char *piece, *last = NULL;
    size_t count = 0;

    CHECK(!checkpoint_restore());
    struct checkpoint_account *greedy = checkpoint_allocate(sizeof *greedy);
    CHECK(greedy);
    checkpoint_charge(greedy, CHECKPOINT_SHARE);
    while ((piece = checkpoint_allocate(LARGE))) {
        last = piece;
        count++;
    }
    CHECK_EQUAL(errno, EDQUOT);
    CHECK(greedy->refused && greedy->bytes <= CHECKPOINT_SHARE && count > CHECKPOINT_SHARE / LARGE - 10);
    CHECK(checkpoint_account(last) == greedy);
    checkpoint_charge(NULL, 0);
    CHECK(checkpoint_allocate(LARGE));
    checkpoint_free(last);
    CHECK(greedy->bytes < CHECKPOINT_SHARE - LARGE + 1000);
    checkpoint_charge(greedy, CHECKPOINT_SHARE);
    CHECK(checkpoint_allocate(LARGE - 1000));
}

/* In a separate process, with its own memory. */
static void apart(void (*test)(void)) {
    int status;
    pid_t pid = fork();

    CHECK(pid >= 0);
    if (pid == 0) {
        CHECK_EQUAL(checkpoint_begin(), 0);
        test();
        exit(0);
    }
    CHECK_EQUAL(waitpid(pid, &status, 0), pid);
    CHECK_EQUAL(status, 0);
}

int main(void) {
    apart(each_goes_on_where_the_one_before_committed);
    apart(killed_at_any_moment);
    apart(copies_what_has_changed_and_gives_back);
    apart(each_account_has_a_share);
    return 0;
}
