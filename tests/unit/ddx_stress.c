/* SPDX-License-Identifier: GPL-2.0-or-later */
/*
 * One writer, eight readers, each in a separate process, 100,000 frames; one reader is slow, one is stopped and
 * continues, one is killed and one comes late. Every word of every frame that a reader gets is checked, and its frames
 * and those reported as missed are all frames. The writer must never fail or wait.
 *
 * DDX_OTHER_PROGRAM: the same test built for another ABI, which then runs the readers.
 */
#include <errno.h>
#include <stdbool.h>
#include <time.h>

#include "store_process.h"

#define WORDS 2048
#define READERS 8
#ifndef FRAMES
#define FRAMES 100000
#endif

DDX_STORE_TYPE(
    FRAME, struct {
        uint64_t number;
        uint64_t word[WORDS];
    });

static void nap(double seconds) {
    struct timespec time = {(time_t)seconds, (long)((seconds - (double)(time_t)seconds) * 1e9)};

    nanosleep(&time, NULL);
}

/* The item of this name, once it exists. */
static DDX_STORE_ITEM *await_item(DDX_STORE_ID *id, const char *name) {
    DDX_STORE_ITEM *item = NULL;

    for (int i = 0; i < 20000 && !(item = ddx_store_lookup_item(id, name, NULL, 0)); i++)
        nap(0.001);
    CHECK(item);
    return item;
}

static int play_writer(void) {
    DDX_STORE_ID *id = ddx_store_open(NULL, 0, 5);
    DDX_STORE_ITEM *item = ddx_store_lookup_item(id, "stress", "FRAME", sizeof(FRAME));
    void *data;

    CHECK(item);
    /* The first frame makes this program the writer; then all readers can attach. */
    for (uint64_t number = 1; number <= FRAMES; number++) {
        CHECK_EQUAL(ddx_store_loan(item, &data), 0);
        FRAME *frame = data;
        frame->number = number;
        for (unsigned i = 0; i < WORDS; i++)
            frame->word[i] = number * 0x9e3779b97f4a7c15u + i;
        for (int wait = 0; number == 2 && ddx_store_readers(item) < READERS && wait < 20000; wait++)
            nap(0.001);
        if (number == FRAMES / 2)
            await_item(id, "halfway"); /* one was stopped, one was killed, one came late */
        CHECK_EQUAL(ddx_store_publish(item, NULL), 0);
    }
    ddx_store_close(id);
    return 0;
}

static void check_frame(const struct ddx_frame *got) {
    const FRAME *frame = got->data;

    CHECK_EQUAL(frame->number, got->sequence);
    for (unsigned i = 0; i < WORDS; i++)
        CHECK_EQUAL(frame->word[i], got->sequence * 0x9e3779b97f4a7c15u + i);
}

/* Kinds: n newest, o in order, s in order but slow, d direct pointer. */
static int play_reader(char kind) {
    DDX_STORE_ID *id = ddx_store_open(NULL, 0, 5);
    DDX_STORE_ITEM *item = await_item(id, "stress");
    const FRAME *live = ddx_store_var_pointer(item);
    uint64_t seen = 0, first = 0, last = 0, missed = 0;

    while (last < FRAMES) {
        struct ddx_frame frame = {0};
        int tail = kind == 'n' || kind == 'd' ? DDX_NEXT : DDX_IN_ORDER;
        int result =
            kind == 'd' ? ddx_store_read_direct(item, NULL, 20, tail) : ddx_store_acquire(item, &frame, 20, tail);

        CHECK_EQUAL(result, 0);
        if (kind == 'd') {
            frame = (struct ddx_frame){
                .data = live, .sequence = live->number, .missed = last ? live->number - last - 1 : 0};
        }
        check_frame(&frame);
        CHECK(frame.sequence > last);
        if (kind == 's' && seen % 64 == 0) {
            nap(0.01);
            check_frame(&frame); /* a held frame does not change */
        }
        if (!first)
            first = frame.sequence - frame.missed;
        missed += frame.missed;
        last = frame.sequence;
        seen++;
        if (kind != 'd')
            CHECK_EQUAL(ddx_store_release(item), 0);
    }
    CHECK_EQUAL(seen + missed, FRAMES - first + 1);
    if (kind != 'd')
        CHECK_EQUAL(ddx_store_missed(item), missed);
    printf("reader %c: saw %llu, missed %llu, from %llu\n", kind, (unsigned long long)seen, (unsigned long long)missed,
           (unsigned long long)first);
    ddx_store_close(id);
    return 0;
}

static pid_t start(const char *program, const char *role) {
    pid_t pid = fork();

    CHECK(pid >= 0);
    if (pid == 0) {
        prctl(PR_SET_PDEATHSIG, SIGKILL);
        execl(program, program, role, (char *)NULL);
        _exit(127);
    }
    return pid;
}

static int wait_for(pid_t pid) {
    int status;

    CHECK_EQUAL(waitpid(pid, &status, 0), pid);
    return status;
}

static void wait_for_frames(DDX_STORE_ID *id, uint64_t frames) {
    DDX_STORE_ITEM *item = await_item(id, "stress");
    struct ddx_item_info info = {.sequence = 0};

    while (info.sequence < frames) {
        CHECK_EQUAL(ddx_store_item_info(item, &info), 0);
        nap(0.001);
    }
    ddx_store_done_item(item);
}

int main(int argc, char **argv) {
    static const char *const kinds[READERS] = {"n", "o", "o", "s", "d", "n", "o", "d"};
    const char *other = getenv("DDX_OTHER_PROGRAM");
    pid_t reader[READERS], writer, late;

    if (argc > 1)
        return argv[1][0] == 'w' ? play_writer() : play_reader(argv[1][0]);
    store_folder_make();
    store_start("8M");
    writer = start(argv[0], "w");
    for (unsigned i = 0; i < READERS; i++)
        reader[i] = start(other ? other : argv[0], kinds[i]);
    DDX_STORE_ID *id = ddx_store_open(NULL, 0, 5);
    CHECK(id);
    wait_for_frames(id, FRAMES / 4);
    CHECK_EQUAL(kill(reader[0], SIGSTOP), 0);
    CHECK_EQUAL(kill(reader[1], SIGKILL), 0);
    late = start(other ? other : argv[0], "o");
    wait_for_frames(id, FRAMES / 2 - 1);
    nap(0.2); /* the late one attaches */
    CHECK(ddx_store_lookup_item(id, "halfway", "int", sizeof(int)));
    CHECK_EQUAL(wait_for(writer), 0); /* although reader 0 is stopped */
    CHECK_EQUAL(kill(reader[0], SIGCONT), 0);
    for (unsigned i = 0; i < READERS; i++) {
        int status = wait_for(reader[i]);

        if (i == 1)
            CHECK(WIFSIGNALED(status));
        else
            CHECK_EQUAL(status, 0);
    }
    CHECK_EQUAL(wait_for(late), 0);
    ddx_store_close(id);
    store_stop(SIGTERM);
    return 0;
}
