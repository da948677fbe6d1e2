/* SPDX-License-Identifier: GPL-2.0-or-later */
/* Writers and readers that die at the worst moment, each in a separate process. */
#include <errno.h>
#include <stdbool.h>
#include <time.h>

#include "../../package/ddx/lib/handle.h"
#include "store_process.h"

#define ROUNDS 50
DDX_STORE_TYPE(
    BLOCK, struct {
        int number;
        int fill[5000];
    });

static void fill(BLOCK *block, int number) {
    block->number = number;
    for (int i = 0; i < 5000; i++)
        block->fill[i] = number;
}

/* Publishes `argument` frames, then dies while it writes the next one. */
static int play_writer(int count) {
    DDX_STORE_ID *id = ddx_store_open(NULL, 0, 2);
    DDX_STORE_ITEM *item = ddx_store_lookup_item(id, "block", "BLOCK", sizeof(BLOCK));
    void *data;

    CHECK(item);
    for (int i = 1; i <= count; i++) {
        CHECK_EQUAL(ddx_store_loan(item, &data), 0);
        fill(data, i);
        CHECK_EQUAL(ddx_store_publish(item, NULL), 0);
    }
    CHECK_EQUAL(ddx_store_loan(item, &data), 0);
    ((BLOCK *)data)->number = -1;
    raise(SIGKILL);
    return 1;
}

/*
 * Publishes a frame, and later another one, but dies before it wakes readers for the second. A byte comes from the pipe
 * `taken` when the reader has the first frame.
 */
static int play_untold(int taken) {
    DDX_STORE_ID *id = ddx_store_open(NULL, 0, 2);
    DDX_STORE_ITEM *item = ddx_store_lookup_item(id, "untold", "BLOCK", sizeof(BLOCK));
    static BLOCK block;
    void *data;
    char byte;

    CHECK(item);
    CHECK_EQUAL(ddx_store_write(item, &block, NULL), 0);
    CHECK_EQUAL(read(taken, &byte, 1), 1);
    nanosleep(&(struct timespec){0, 300000000}, NULL); /* until the reader sleeps */
    CHECK_EQUAL(ddx_store_loan(item, &data), 0);
    fill(data, 2);
    ddx_ring_publish(&item->writer.ring, (unsigned)item->writer.loaned, 0);
    raise(SIGKILL);
    return 1;
}

/* Dies while it holds a frame. */
static int play_reader(void) {
    DDX_STORE_ID *id = ddx_store_open(NULL, 0, 2);
    DDX_STORE_ITEM *item = ddx_store_lookup_item(id, "block", NULL, 0);
    struct ddx_frame frame;

    CHECK(item);
    CHECK_EQUAL(ddx_store_acquire(item, &frame, 2, DDX_CURRENT), 0);
    raise(SIGKILL);
    return 1;
}

static void run(const char *program, const char *role, const char *count) {
    int status;
    pid_t pid = fork();

    CHECK(pid >= 0);
    if (pid == 0) {
        execl(program, program, role, count, (char *)NULL);
        _exit(127);
    }
    CHECK_EQUAL(waitpid(pid, &status, 0), pid);
    CHECK(WIFSIGNALED(status) && WTERMSIG(status) == SIGKILL);
}

/* Numbers are compared by their low bits only: a reader that slept for days must not sleep for more days. */
static void test_long_sleep(DDX_STORE_ID *id) {
    static BLOCK block;
    DDX_STORE_ITEM *out = ddx_store_lookup_item(id, "sleep", "BLOCK", sizeof(BLOCK));
    DDX_STORE_ITEM *in = ddx_store_lookup_item(id, "sleep", NULL, 0);
    struct ddx_frame frame;

    CHECK(out && in);
    CHECK_EQUAL(ddx_store_write(out, &block, NULL), 0);
    CHECK_EQUAL(ddx_store_read(in, &block, NULL, 0, DDX_CURRENT), 0);
    out->writer.ring.sequence += 5000000;
    CHECK_EQUAL(ddx_store_write(out, &block, NULL), 0);
    CHECK_EQUAL(ddx_store_acquire(in, &frame, 0, DDX_NEXT), 0);
    CHECK_EQUAL(frame.sequence, 5000002);
    CHECK_EQUAL(frame.missed, 5000000);
    ddx_store_done_item(in);
    ddx_store_done_item(out);
}

/* A sleeping reader is woken for its writer's last frame by the store, if not by the writer. */
static void test_untold(DDX_STORE_ID *id, const char *program) {
    DDX_STORE_ITEM *in = ddx_store_lookup_item(id, "untold", "BLOCK", sizeof(BLOCK));
    struct ddx_frame frame;
    int status, taken[2];

    CHECK_EQUAL(pipe(taken), 0);
    pid_t pid = fork();
    CHECK(in && pid >= 0);
    if (pid == 0) {
        char end[16];

        snprintf(end, sizeof end, "%d", taken[0]);
        execl(program, program, "u", end, (char *)NULL);
        _exit(127);
    }
    CHECK_EQUAL(ddx_store_acquire(in, &frame, 5, DDX_NEXT), 0);
    CHECK_EQUAL(frame.sequence, 1);
    CHECK_EQUAL(ddx_store_release(in), 0);
    CHECK_EQUAL(write(taken[1], "x", 1), 1);
    int64_t before = ddx_time_now();
    CHECK_EQUAL(ddx_store_acquire(in, &frame, 20, DDX_NEXT), 0);
    CHECK_EQUAL(frame.sequence, 2);
    CHECK(ddx_time_now() - before < 10000000000);
    CHECK_EQUAL(waitpid(pid, &status, 0), pid);
    CHECK(WIFSIGNALED(status) && WTERMSIG(status) == SIGKILL);
    close(taken[0]);
    close(taken[1]);
    ddx_store_done_item(in);
}

int main(int argc, char **argv) {
    if (argc > 1)
        return argv[1][0] == 'w'   ? play_writer(atoi(argv[2]))
               : argv[1][0] == 'u' ? play_untold(atoi(argv[2]))
                                   : play_reader();
    store_folder_make();
    store_start("8M");
    DDX_STORE_ID *id = ddx_store_open(NULL, 0, 2);
    DDX_STORE_ITEM *in = NULL;
    struct ddx_item_info info;
    uint64_t seen = 0;

    test_long_sleep(id);
    test_untold(id, argv[0]);

    for (int round = 0; round < ROUNDS; round++) {
        struct ddx_frame frame;

        run(argv[0], "w", "7");
        if (!in)
            in = ddx_store_lookup_item(id, "block", NULL, 0);
        CHECK(in);
        /* The last whole frame, not the unfinished one; and numbers continue across writers. */
        CHECK_EQUAL(ddx_store_acquire(in, &frame, 1, DDX_CURRENT), 0);
        CHECK_EQUAL(frame.sequence, 7 * (uint64_t)(round + 1));
        const BLOCK *block = frame.data;
        CHECK_EQUAL(block->number, 7);
        for (int i = 0; i < 5000; i++)
            CHECK_EQUAL(block->fill[i], 7);
        CHECK_EQUAL(ddx_store_release(in), 0);
        /* Seen and missed frames add up to all that were written since the first read. */
        seen++;
        CHECK_EQUAL(seen + ddx_store_missed(in), frame.sequence - 6);
        run(argv[0], "r", "");
        CHECK_EQUAL(ddx_store_item_info(in, &info), 0);
        CHECK_EQUAL(info.readers, 1); /* the dead reader's share was given back */
        CHECK_EQUAL(info.epoch, round + 1);
    }
    CHECK(info.frames <= 4);
    ddx_store_close(id);
    store_stop(SIGTERM);
    return 0;
}
