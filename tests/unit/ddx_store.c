/* SPDX-License-Identifier: GPL-2.0-or-later */
/* The library with a real store: the header's promises, call by call. */
#include <errno.h>
#include <pthread.h>
#include <stdbool.h>
#include <sys/resource.h>
#include <sys/stat.h>
#include <time.h>

#include "store_process.h"

DDX_STORE_TYPE(
    POSITION, struct {
        int number;
        double x, y;
    });
DDX_STORE_TYPE(
    OTHER, struct { float a; });
DDX_STORE_TYPE(
    BLOCK, struct {
        int number;
        char bytes[1000000];
    });

DDX_STORE_TYPE(
    BIG, struct {
        int number;
        char bytes[3000000]; /* more than one page table, and not whole ones */
    });

static DDX_STORE_ID *id;

static void nap(double seconds) {
    struct timespec time = {(time_t)seconds, (long)((seconds - (double)(time_t)seconds) * 1e9)};

    nanosleep(&time, NULL);
}

static DDX_STORE_ITEM *lookup(const char *name, const char *type, size_t size) {
    DDX_STORE_ITEM *item = NULL;

    /* The test before may have started the store a moment ago: beside other tests that takes over half a second. */
    for (int tries = 0; tries < 100 && !item && (!tries || errno == ECONNREFUSED); tries++) {
        if (tries)
            nap(0.1);
        item = ddx_store_lookup_item(id, name, type, (int)size);
    }
    if (!item) {
        fprintf(stderr, "%s: %s\n", name, ddx_error_text(errno));
        exit(1);
    }
    return item;
}

static void test_errors(void) {
    DDX_STORE_ITEM *item = lookup("errors", "POSITION", sizeof(POSITION)), *second;
    POSITION value = {1, 2, 3};
    OTHER other;

    errno = 0;
    CHECK(!ddx_store_lookup_item(id, "nothing", NULL, 0));
    CHECK_EQUAL(errno, ENOENT);
    CHECK(!ddx_store_lookup_item(id, "errors", "OTHER", sizeof other));
    CHECK_EQUAL(errno, EPROTOTYPE);
    CHECK(!ddx_store_lookup_item(id, "errors", "POSITION", 7));
    CHECK_EQUAL(errno, EMSGSIZE);
    CHECK(!ddx_store_lookup_item(id, "", "int", 4));
    CHECK_EQUAL(errno, EINVAL);
    CHECK(!ddx_store_lookup_item(id, "has space", "int", 4));
    CHECK_EQUAL(errno, EINVAL);
    for (const char **bad = (const char *[]){"two\nlines", "\033[31mred", "eight\233bits", NULL}; *bad; bad++) {
        struct ddx_item_spec spec = {.name = "name", .type = *bad, .declaration = "int"};

        CHECK(!ddx_store_lookup_item(id, *bad, "int", 4));
        CHECK_EQUAL(errno, EINVAL);
        CHECK(!ddx_store_lookup_item(id, "name", *bad, 4));
        CHECK_EQUAL(errno, EINVAL);
        CHECK_EQUAL(ddx_store_create(id, &spec, &second), -EINVAL);
    }
    CHECK_EQUAL(ddx_store_read(item, &value, NULL, 0, 0), -ETIMEDOUT);
    CHECK_EQUAL(ddx_store_write(item, &value, NULL), 0);
    second = lookup("errors", "POSITION", sizeof(POSITION));
    CHECK_EQUAL(ddx_store_write(second, &value, NULL), -EEXIST);
    ddx_store_done_item(item);
    CHECK_EQUAL(ddx_store_write(second, &value, NULL), 0); /* the role was given back */
    CHECK_EQUAL(ddx_store_publish(second, NULL), -EINVAL);
    CHECK_EQUAL(ddx_store_release(second), -EINVAL);
    ddx_store_done_item(second);
    CHECK(!ddx_store_open("elsewhere", 0, 0));
    CHECK_EQUAL(errno, EOPNOTSUPP);
    CHECK(!ddx_store_open(NULL, 2006, 0.1));
    CHECK_EQUAL(errno, ECONNREFUSED);
}

static void test_tail(void) {
    DDX_STORE_ITEM *out = lookup("tail", "POSITION", sizeof(POSITION)), *in = lookup("tail", NULL, 0);
    POSITION value = {0};
    DDX_TIME ts = 0, when = 123456789;
    struct ddx_frame frame;

    CHECK_EQUAL(ddx_store_keep(in, 6), 0);
    CHECK_EQUAL(ddx_store_read(in, &value, &ts, 0, DDX_CURRENT), -ETIMEDOUT);
    CHECK_EQUAL(ddx_store_keep(in, 7), 0);
    CHECK_EQUAL(ddx_store_keep(in, 2), 0);
    CHECK_EQUAL(ddx_store_keep(in, 1000), -EINVAL);
    for (value.number = 1; value.number <= 3; value.number++)
        CHECK_EQUAL(ddx_store_write(out, &value, value.number == 3 ? &when : NULL), 0);
    CHECK_EQUAL(ddx_store_acquire(in, &frame, 0, DDX_IN_ORDER), 0);
    CHECK_EQUAL(frame.sequence, 1);
    CHECK_EQUAL(frame.missed, 0);
    CHECK_EQUAL(((const POSITION *)frame.data)->number, 1);
    CHECK_EQUAL(ddx_store_acquire(in, &frame, 0, DDX_IN_ORDER), -EBUSY);
    CHECK_EQUAL(ddx_store_release(in), 0);
    CHECK_EQUAL(ddx_store_read(in, &value, &ts, 0, DDX_NEXT), 0);
    CHECK_EQUAL(value.number, 3);
    CHECK_EQUAL(ts, when);
    CHECK_EQUAL(ddx_store_missed(in), 1);
    CHECK_EQUAL(ddx_store_read(in, &value, &ts, 0.01, DDX_NEXT), -ETIMEDOUT);
    CHECK_EQUAL(ddx_store_read(in, &value, &ts, 0, DDX_CURRENT), 0);
    CHECK_EQUAL(value.number, 3);
    for (value.number = 4; value.number <= 100; value.number++)
        CHECK_EQUAL(ddx_store_write(out, &value, NULL), 0);
    CHECK_EQUAL(ddx_store_read(in, &value, &ts, 0, 97), 0);
    CHECK_EQUAL(value.number, 100);
    CHECK_EQUAL(ddx_store_read(in, &value, &ts, 0.01, 2), -ETIMEDOUT);
    CHECK_EQUAL(ddx_store_missed(in), 97);
    ddx_store_done_item(in);
    ddx_store_done_item(out);
}

/* The newest value is that of the newest writer, even if the previous writer left values that were never read. */
static void test_current_across_writers(void) {
    DDX_STORE_ITEM *in = lookup("current", "int", sizeof(int));
    int value, got;

    CHECK_EQUAL(ddx_store_read(in, &got, NULL, 0, DDX_NEXT), -ETIMEDOUT);
    for (int round = 0; round < 50; round++) {
        DDX_STORE_ITEM *out = lookup("current", "int", sizeof(int));

        for (value = 10 * round; value < 10 * round + 5; value++)
            CHECK_EQUAL(ddx_store_write(out, &value, NULL), 0);
        if (round % 2) {
            CHECK_EQUAL(ddx_store_read(in, &got, NULL, 0, DDX_CURRENT), 0);
            CHECK_EQUAL(got, value - 1);
        }
        ddx_store_done_item(out);
    }
    ddx_store_done_item(in);
}

/* A held frame does not change while the writer continues. */
static void test_hold(void) {
    DDX_STORE_ITEM *out = lookup("hold", "BLOCK", sizeof(BLOCK)), *in = lookup("hold", NULL, 0);
    static BLOCK value, copy;
    const BLOCK *live = ddx_store_var_pointer(in);
    struct ddx_frame frame;

    CHECK(live);
    CHECK_EQUAL(live->number, 0); /* readable before the first frame */
    for (int i = 1; i <= 50; i++) {
        value.number = i;
        memset(value.bytes, i, sizeof value.bytes);
        CHECK_EQUAL(ddx_store_write(out, &value, NULL), 0);
        if (i == 1)
            CHECK_EQUAL(ddx_store_acquire(in, &frame, 0, DDX_CURRENT), 0);
        if (i == 10)
            CHECK_EQUAL(ddx_store_read_direct(in, NULL, 0, DDX_CURRENT), 0);
    }
    CHECK_EQUAL(((const BLOCK *)frame.data)->number, 1);
    CHECK_EQUAL(((const BLOCK *)frame.data)->bytes[999999], 1);
    CHECK_EQUAL(live->number, 10);
    CHECK_EQUAL(live->bytes[999999], 10);
    CHECK_EQUAL(ddx_store_release(in), 0);
    CHECK_EQUAL(ddx_store_read(in, &copy, NULL, 0, DDX_CURRENT), 0);
    CHECK_EQUAL(copy.number, 50);
    CHECK_EQUAL(live->number, 10);
    CHECK_EQUAL(ddx_store_read_direct(in, NULL, 0, DDX_NEXT), -ETIMEDOUT);
    CHECK_EQUAL(live->number, 10);
    CHECK_EQUAL(ddx_store_read_direct(in, NULL, 0, DDX_CURRENT), 0);
    CHECK_EQUAL(live->number, 50);
    CHECK_EQUAL(live->bytes[999999], 50);
    CHECK(live == ddx_store_var_pointer(in));
    ddx_store_done_item(in);
    ddx_store_done_item(out);
}

/* The window is unchanged after its reader waited in vain. */
static void test_window(void) {
    DDX_STORE_ITEM *out = lookup("window", "BIG", sizeof(BIG)), *in = lookup("window", NULL, 0);
    const BIG *live = ddx_store_var_pointer(in);
    static BIG value;
    struct ddx_frame frame;

    for (int i = 1; i <= 20; i++) {
        value.number = i;
        memset(value.bytes, i, sizeof value.bytes);
        CHECK_EQUAL(ddx_store_write(out, &value, NULL), 0);
        CHECK_EQUAL(ddx_store_read_direct(in, NULL, 0, DDX_CURRENT), 0);
        CHECK_EQUAL(live->number, i);
        CHECK_EQUAL(live->bytes[2999999], i);
        if (i % 2)
            CHECK_EQUAL(ddx_store_read_direct(in, NULL, 0.002, DDX_NEXT), -ETIMEDOUT);
        if (i % 3)
            CHECK_EQUAL(memcmp(live, &value, sizeof value), 0);
        if (i % 5 == 0) {
            CHECK_EQUAL(ddx_store_acquire(in, &frame, 0, DDX_CURRENT), 0);
            CHECK_EQUAL(memcmp(frame.data, &value, sizeof value), 0);
            CHECK_EQUAL(ddx_store_release(in), 0);
        }
    }
    CHECK(live == ddx_store_var_pointer(in));
    ddx_store_done_item(in);
    ddx_store_done_item(out);
}

struct delayed {
    DDX_STORE_ITEM *out;
    BIG value;
};

static void *write_delayed(void *argument) {
    struct delayed *delayed = argument;

    nap(0.003); /* the reader sleeps, the pages of the slot that it expects are in its window */
    CHECK_EQUAL(ddx_store_write(delayed->out, &delayed->value, NULL), 0);
    return NULL;
}

/* The window shows the new frame, whether it comes in the expected slot or in another one. */
static void test_expected(void) {
    static struct delayed delayed;
    DDX_STORE_ITEM *in = lookup("expected", "BIG", sizeof(BIG)), *other = lookup("expected", NULL, 0);
    const BIG *live = ddx_store_var_pointer(in);
    pthread_t writer;
    struct ddx_frame frame;

    delayed.out = lookup("expected", NULL, 0);
    for (int i = 1; i <= 24; i++) {
        delayed.value.number = i;
        memset(delayed.value.bytes, i, sizeof delayed.value.bytes);
        CHECK_EQUAL(pthread_create(&writer, NULL, write_delayed, &delayed), 0);
        CHECK_EQUAL(ddx_store_read_direct(in, NULL, 5, i == 1 ? DDX_CURRENT : DDX_NEXT), 0);
        CHECK_EQUAL(memcmp(live, &delayed.value, sizeof(BIG)), 0);
        pthread_join(writer, NULL);
        /* The other reader holds a frame for several turns: its slot is the oldest, but never the next. */
        if (i % 8 == 2)
            CHECK_EQUAL(ddx_store_acquire(other, &frame, 0, DDX_CURRENT), 0);
        if (i % 8 == 7) {
            CHECK_EQUAL(((const BIG *)frame.data)->bytes[2999999], i - 5);
            CHECK_EQUAL(ddx_store_release(other), 0);
        }
        if (i % 3 == 0) {
            CHECK_EQUAL(ddx_store_read_direct(in, NULL, 0.002, DDX_NEXT), -ETIMEDOUT);
            CHECK_EQUAL(memcmp(live, &delayed.value, sizeof(BIG)), 0);
        }
    }
    ddx_store_done_item(other);
    ddx_store_done_item(in);
    ddx_store_done_item(delayed.out);
}

static void *write_later(void *number) {
    POSITION value = {*(int *)number, 0, 0};
    DDX_STORE_ITEM *out;

    nap(*(int *)number % 8 * 0.0005); /* before, while and after the reader falls asleep */
    out = lookup("asleep", "POSITION", sizeof(POSITION));
    CHECK_EQUAL(ddx_store_write(out, &value, NULL), 0);
    ddx_store_done_item(out);
    return NULL;
}

/* A reader that sleeps without a limit wakes for the next writer, though it sleeps on the dead writer's word. */
static void test_asleep(void) {
    DDX_STORE_ITEM *first = lookup("asleep", "POSITION", sizeof(POSITION)), *in = lookup("asleep", NULL, 0);
    POSITION value = {0, 0, 0};
    pthread_t writer;

    CHECK_EQUAL(ddx_store_write(first, &value, NULL), 0);
    CHECK_EQUAL(ddx_store_read(in, &value, NULL, 0, DDX_CURRENT), 0);
    ddx_store_done_item(first);
    for (int i = 1; i <= 100; i++) {
        CHECK_EQUAL(pthread_create(&writer, NULL, write_later, &i), 0);
        DDX_TIME before = ddx_time_now();
        CHECK_EQUAL(ddx_store_read(in, &value, NULL, 60, DDX_NEXT), 0);
        CHECK_EQUAL(value.number, i);
        CHECK(ddx_time_now() - before < 30000000000); /* woken, not timed out */
        CHECK_EQUAL(pthread_join(writer, NULL), 0);
    }
    ddx_store_done_item(in);
}

static void test_loan(void) {
    DDX_STORE_ITEM *out = lookup("loan", "POSITION", sizeof(POSITION)), *in = lookup("loan", NULL, 0);
    void *data, *again;
    POSITION value;

    CHECK_EQUAL(ddx_store_loan(out, &data), 0);
    CHECK_EQUAL(ddx_store_loan(out, &again), -EBUSY);
    ((POSITION *)data)->number = 77;
    CHECK_EQUAL(ddx_store_cancel(out), 0);
    CHECK_EQUAL(ddx_store_read(in, &value, NULL, 0, DDX_CURRENT), -ETIMEDOUT);
    CHECK_EQUAL(ddx_store_loan(out, &data), 0);
    ((POSITION *)data)->number = 78;
    CHECK_EQUAL(ddx_store_publish(out, NULL), 0);
    CHECK_EQUAL(ddx_store_read(in, &value, NULL, 0, DDX_CURRENT), 0);
    CHECK_EQUAL(value.number, 78);
    while (ddx_store_readers(out) < 1) /* a reader counts once the store has added its slot */
        continue;
    CHECK_EQUAL(ddx_store_readers(out), 1);
    ddx_store_done_item(in);
    ddx_store_done_item(out);
}

#define KEPT 8

static void *begin_to_read(void *item) {
    POSITION value = {.number = -1};

    CHECK_EQUAL(ddx_store_keep(item, KEPT), 0);
    if (ddx_store_read(item, &value, NULL, 0, DDX_IN_ORDER)) /* else the writer was quick */
        CHECK_EQUAL(value.number, -1);
    else
        CHECK_EQUAL(value.number, 0);
    return NULL;
}

/* A reader that the writer counts gets every frame from then on, however fast they come. */
static void test_counted_reader(void) {
    for (int turn = 0; turn < 20; turn++) {
        DDX_STORE_ITEM *out = lookup("counted", "POSITION", sizeof(POSITION)), *in = lookup("counted", NULL, 0);
        POSITION value = {.number = -1};
        pthread_t thread;

        CHECK_EQUAL(ddx_store_readers(out), -EINVAL);
        CHECK_EQUAL(ddx_store_write(out, &value, NULL), 0);
        CHECK_EQUAL(pthread_create(&thread, NULL, begin_to_read, in), 0);
        while (ddx_store_readers(out) < 1)
            continue;
        for (value.number = 0; value.number <= KEPT; value.number++)
            CHECK_EQUAL(ddx_store_write(out, &value, NULL), 0);
        CHECK_EQUAL(pthread_join(thread, NULL), 0);
        while (!ddx_store_read(in, &value, NULL, 0, DDX_IN_ORDER))
            continue;
        CHECK_EQUAL(value.number, KEPT);
        CHECK_EQUAL(ddx_store_missed(in), 0);
        ddx_store_done_item(in);
        ddx_store_done_item(out);
    }
}

/* A writer that checks its readers first writes no frame that one of them misses; other writers do not wait. */
static void test_outruns(void) {
    DDX_STORE_ITEM *out = lookup("outrun", "POSITION", sizeof(POSITION)), *in = lookup("outrun", NULL, 0);
    DDX_STORE_ITEM *newest = lookup("outrun", NULL, 0);
    POSITION value = {0};
    void *data;

    CHECK_EQUAL(ddx_store_outruns(NULL), -EINVAL);
    CHECK_EQUAL(ddx_store_outruns(out), -EINVAL);
    CHECK_EQUAL(ddx_store_write(out, &value, NULL), 0);
    begin_to_read(in);
    CHECK_EQUAL(ddx_store_read(newest, &value, NULL, 0, DDX_CURRENT), 0);
    while (ddx_store_readers(out) < 2)
        continue;
    int written = 0, read = 0;
    for (int turn = 0; turn < 5; turn++) {
        while (!ddx_store_outruns(out)) {
            value.number = ++written;
            CHECK_EQUAL(ddx_store_write(out, &value, NULL), 0);
            CHECK_EQUAL(ddx_store_read(newest, &value, NULL, 0, DDX_CURRENT), 0);
        }
        CHECK(written - read > KEPT);
        CHECK_EQUAL(ddx_store_outruns(out), 1);
        CHECK_EQUAL(ddx_store_read(in, &value, NULL, 0, DDX_IN_ORDER), 0);
        CHECK_EQUAL(value.number, ++read);
        CHECK_EQUAL(ddx_store_outruns(out), 0);
        while (!ddx_store_read(in, &value, NULL, 0, DDX_IN_ORDER))
            CHECK_EQUAL(value.number, ++read);
        CHECK_EQUAL(read, written);
    }
    CHECK_EQUAL(ddx_store_missed(in), 0);
    CHECK_EQUAL(ddx_store_loan(out, &data), 0);
    CHECK_EQUAL(ddx_store_outruns(out), -EBUSY);
    CHECK_EQUAL(ddx_store_cancel(out), 0);
    for (int i = 0; i < 3 * KEPT; i++)
        CHECK_EQUAL(ddx_store_write(out, &value, NULL), 0);
    CHECK_EQUAL(ddx_store_outruns(out), 1);
    ddx_store_done_item(in);
    ddx_store_done_item(newest);
    while (ddx_store_readers(out)) /* the store notes the readers that left */
        continue;
    CHECK_EQUAL(ddx_store_outruns(out), 0);
    ddx_store_done_item(out);
}

static int create_picture(const char *name, int luma, int bound, DDX_STORE_ITEM **item) {
    char text[128];
    struct ddx_extent extents[] = {{"y", (size_t)luma}, {"u", (size_t)luma / 4}};
    struct ddx_item_spec spec = {
        .name = name, .type = "PICTURE", .declaration = text, .extents = extents, .extent_count = 2};

    snprintf(text, sizeof text, "struct { int number; char y[%d]; char u[%d]; long long time; }", bound, bound / 4);
    return ddx_store_create(id, &spec, item);
}

/* A picture may change its size, up to 4K; a reader follows without notice. */
static void test_pictures(void) {
    DDX_STORE_ITEM *out, *in;
    struct ddx_frame frame;
    struct ddx_item_info info;
    void *data;

    CHECK_EQUAL(create_picture("picture", 64 * 48, 2073600, &out), 0);
    in = lookup("picture", NULL, 0);
    CHECK_EQUAL(ddx_store_loan(out, &data), 0);
    *(int *)data = 1;
    memset((char *)data + 4, 9, 64 * 48);
    CHECK_EQUAL(ddx_store_publish(out, NULL), 0);
    CHECK_EQUAL(ddx_store_item_info(out, &info), 0);
    CHECK(info.frame_bytes <= 4 * 4096); /* not the 2.6 MB that the struct declares */
    CHECK_EQUAL(ddx_store_acquire(in, &frame, 1, DDX_CURRENT), 0);
    CHECK_EQUAL(((const char *)frame.data)[4 + 64 * 48 - 1], 9);
    CHECK_EQUAL(ddx_store_release(in), 0);
    ddx_store_done_item(out);
    CHECK_EQUAL(create_picture("picture", 3840 * 2160, 3840 * 2160, &out), 0);
    CHECK_EQUAL(ddx_store_loan(out, &data), 0);
    memset((char *)data + 4, 5, 3840 * 2160);
    CHECK_EQUAL(ddx_store_publish(out, NULL), 0);
    CHECK_EQUAL(ddx_store_acquire(in, &frame, 1, DDX_NEXT), 0);
    CHECK_EQUAL(frame.sequence, 2);
    CHECK_EQUAL(ddx_store_field_named(in, "y")->used, 3840 * 2160);
    CHECK_EQUAL(((const char *)frame.data)[4 + 3840 * 2160 - 1], 5);
    CHECK_EQUAL(ddx_store_release(in), 0);
    ddx_store_done_item(in);
    ddx_store_done_item(out);
}

/* Memory that the store holds, counted by the kernel; a file that is open twice counts once. */
static uint64_t backed_memory(void) {
    static ino_t seen[4096];
    unsigned files = 0;
    uint64_t sum = 0;

    for (int fd = 0; fd < 4096; fd++) {
        char path[64], target[64] = "";
        struct stat status;

        snprintf(path, sizeof path, "/proc/%d/fd/%d", (int)store_pid, fd);
        if (readlink(path, target, sizeof target - 1) <= 0 || !strstr(target, "memfd:") || stat(path, &status))
            continue;
        unsigned known = 0;
        while (known < files && seen[known] != status.st_ino)
            known++;
        if (known < files)
            continue;
        seen[files++] = status.st_ino;
        sum += (uint64_t)status.st_blocks * 512;
    }
    return sum;
}

/*
 * One more reader takes a frame in use, and another one for a change of writer. When the budget is used up, there is
 * still room for that change.
 */
static void test_budget(void) {
    struct ddx_item_info before, with_readers, with_one_less, *items;
    struct ddx_store_info after;
    unsigned count;
    DDX_STORE_ITEM *out = lookup("budget", "BLOCK", sizeof(BLOCK)), *in[400];
    static BLOCK value;
    int readers = 0, result = 0;

    CHECK_EQUAL(ddx_store_write(out, &value, NULL), 0);
    CHECK_EQUAL(ddx_store_item_info(out, &before), 0);
    with_one_less = before;
    while (readers < 400 && !result) {
        in[readers] = lookup("budget", NULL, 0);
        result = ddx_store_read(in[readers++], &value, NULL, 0, DDX_CURRENT);
        CHECK_EQUAL(ddx_store_item_info(out, &with_readers), 0);
        CHECK_EQUAL(with_readers.frames - with_one_less.frames, result ? 0 : 1);
        CHECK_EQUAL(with_readers.bytes - with_one_less.bytes, result ? 0 : 1003520 + 4096);
        CHECK_EQUAL(with_readers.reserved - with_one_less.reserved, result ? 0 : 2 * 1003520 + 4096);
        with_one_less = with_readers;
    }
    CHECK_EQUAL(result, -EBUSY);
    CHECK_EQUAL(ddx_store_list(id, &after, &items, &count), 0);
    free(items);
    CHECK_EQUAL(ddx_store_item_info(out, &with_readers), 0);
    CHECK(after.reserved <= after.budget);
    CHECK(after.budget - after.reserved < 3 * 1003520); /* no room for another reader */
    CHECK_EQUAL(with_readers.bytes - before.bytes, (uint64_t)(readers - 1) * (1003520 + 4096));
    CHECK_EQUAL(after.bytes, backed_memory());
    CHECK_EQUAL(ddx_store_write(out, &value, NULL), 0); /* the writer does not notice */
    ddx_store_done_item(out);
    out = lookup("budget", "BLOCK", sizeof(BLOCK));
    CHECK_EQUAL(ddx_store_write(out, &value, NULL), 0);
    CHECK_EQUAL(ddx_store_read(in[0], &value, NULL, 0, DDX_CURRENT), 0);
    DDX_STORE_ITEM *more = lookup("too.much", "BLOCK", sizeof(BLOCK));
    CHECK_EQUAL(ddx_store_write(more, &value, NULL), -ENOSPC);
    ddx_store_done_item(more);
    while (readers)
        ddx_store_done_item(in[--readers]);
    ddx_store_done_item(out);
}

/* The store dies; frames continue; the next store gets each item that a program holds, even if the program sleeps. */
static void test_restart(void) {
    DDX_STORE_ITEM *out = lookup("restart", "POSITION", sizeof(POSITION)), *in = lookup("restart", NULL, 0), *late;
    DDX_STORE_ITEM *idle = lookup("idle", "int", sizeof(int)), *only_reader;
    POSITION value = {0};
    int number = 41;

    CHECK_EQUAL(ddx_store_write(idle, &number, NULL), 0);
    only_reader = lookup("idle", NULL, 0);
    CHECK_EQUAL(ddx_store_read(only_reader, &number, NULL, 0, DDX_CURRENT), 0);
    ddx_store_done_item(idle); /* now it has no writer, but a reader that holds it */
    CHECK_EQUAL(ddx_store_read(in, &value, NULL, 0, DDX_CURRENT), -ETIMEDOUT);
    for (value.number = 1; value.number <= 20; value.number++) {
        POSITION got;

        if (value.number == 5)
            store_stop(SIGKILL);
        if (value.number == 10)
            store_start("64M");
        CHECK_EQUAL(ddx_store_write(out, &value, NULL), 0);
        CHECK_EQUAL(ddx_store_read(in, &got, NULL, 0.5, DDX_NEXT), 0);
        CHECK_EQUAL(got.number, value.number);
        nap(0.02);
    }
    nap(0.3);
    late = lookup("restart", NULL, 0); /* a new reader finds the item */
    CHECK_EQUAL(ddx_store_read(late, &value, NULL, 0, DDX_CURRENT), 0);
    CHECK_EQUAL(value.number, 20);
    idle = lookup("idle", NULL, 0);
    number = 0;
    CHECK_EQUAL(ddx_store_read(idle, &number, NULL, 0, DDX_CURRENT), 0);
    CHECK_EQUAL(number, 41);
    CHECK_EQUAL(ddx_store_write(idle, &number, NULL), 0); /* the item had no writer */
    /* The new reader's pin counts for the writer from before the restart. */
    struct ddx_frame frame;
    CHECK_EQUAL(ddx_store_acquire(late, &frame, 0, DDX_CURRENT), 0);
    for (value.number = 21; value.number <= 60; value.number++)
        CHECK_EQUAL(ddx_store_write(out, &value, NULL), 0);
    CHECK_EQUAL(((const POSITION *)frame.data)->number, 20);
    ddx_store_done_item(late);
    ddx_store_done_item(idle);
    ddx_store_done_item(only_reader);
    ddx_store_done_item(in);
    ddx_store_done_item(out);
}

/* Every frame once and none missed, while the store restarts and a reader is busy with a frame. */
static void test_restart_without_a_gap(void) {
    DDX_STORE_ITEM *out = lookup("gap", "POSITION", sizeof(POSITION)), *in = lookup("gap", NULL, 0);
    POSITION value = {0};
    DDX_TIME begin = ddx_time_now(), time = begin, stopped = 0, started = 0;

    CHECK_EQUAL(ddx_store_read(in, &value, NULL, 0, DDX_IN_ORDER), -ETIMEDOUT);
    /* Until 0.5 s after the restart, however long the store takes to die: on a busy machine that can be over 0.5 s. */
    for (uint64_t expected = 1; !started || time - started < 500000000; expected++) {
        struct ddx_frame frame;

        time = ddx_time_now();
        if (!stopped && expected > 1 && time - begin > 50000000) { /* a writer claims its item with its first write */
            store_stop(SIGKILL);
            stopped = ddx_time_now();
        }
        if (stopped && !started && time - stopped > 50000000) {
            store_start("64M");
            started = ddx_time_now();
        }
        CHECK_EQUAL(ddx_store_write(out, &value, NULL), 0);
        CHECK_EQUAL(ddx_store_acquire(in, &frame, 0.5, DDX_IN_ORDER), 0);
        CHECK_EQUAL(frame.sequence, expected);
        CHECK_EQUAL(frame.missed, 0);
        CHECK_EQUAL(ddx_store_release(in), 0);
    }
    ddx_store_done_item(in);
    ddx_store_done_item(out);
}

/* A store that is stopped right after its restart does not give away the items of living programs. */
static void test_restart_and_stop(void) {
    DDX_STORE_ITEM *out = lookup("stopped", "int", sizeof(int)), *rival;
    int value = 0;

    for (value = 1; value <= 9; value++)
        CHECK_EQUAL(ddx_store_write(out, &value, NULL), 0);
    rival = lookup("stopped", "int", sizeof(int));
    store_stop(SIGKILL);
    store_start("64M");
    DDX_STORE_ID *probe = ddx_store_open(NULL, 0, 2);
    store_signal(SIGSTOP);
    nap(0.4);
    store_signal(SIGCONT);
    /* A busy machine may keep the store from an answer for longer than a program waits. */
    DDX_TIME begin = ddx_time_now();
    int result;
    do
        result = ddx_store_write(rival, &value, NULL);
    while (result == -ECONNREFUSED && ddx_time_now() - begin < 20000000000);
    CHECK_EQUAL(result, -EEXIST);
    CHECK_EQUAL(ddx_store_read(rival, &value, NULL, 0, DDX_CURRENT), 0);
    CHECK_EQUAL(value, 9);
    ddx_store_close(probe);
    ddx_store_done_item(rival);
    ddx_store_done_item(out);
}

/*
 * New readers wait while holders report to a restarted store, which sleeps in that time: 250 ms are a dozen sleeps of
 * 20 ms, however slow the machine; a busy loop does not sleep, or sleeps hundreds of times.
 */
static void test_newcomers_wait_quietly(void) {
    store_stop(SIGKILL);
    DDX_TIME begin = ddx_time_now();
    store_start("64M");
    DDX_STORE_ID *other = ddx_store_open(NULL, 0, 2);
    CHECK(other);
    DDX_STORE_ITEM *item = ddx_store_lookup_item(other, "newcomer", "int", sizeof(int));
    CHECK(item);
    unsigned long sleeps = store_sleeps();
    DDX_TIME waited = ddx_time_now() - begin;
    CHECK(waited > 250000000);
    CHECK(sleeps >= 8); /* some turns handle messages instead */
    if (sleeps > (unsigned long)(waited / 2500000))
        fprintf(stderr, "%lu sleeps in %lld ms\n", sleeps, (long long)waited / 1000000);
    CHECK(sleeps <=
          (unsigned long)(waited / 2500000)); /* a busy machine starts the store slowly, and waits for longer */
    ddx_store_close(other);
}

int main(void) {
    struct rlimit limit;

    CHECK_EQUAL(getrlimit(RLIMIT_NOFILE, &limit), 0);
    limit.rlim_cur = limit.rlim_max; /* dozens of readers in one process */
    CHECK_EQUAL(setrlimit(RLIMIT_NOFILE, &limit), 0);
    CHECK(!ddx_store_open(NULL, 0, 0));
    store_folder_make();
    CHECK(!ddx_store_open(NULL, 0, 0));
    CHECK_EQUAL(errno, ECONNREFUSED);
    store_start("64M"); /* room for one 4K picture */
    id = ddx_store_open(NULL, 0, 2);
    CHECK(id);
    test_errors();
    test_tail();
    test_current_across_writers();
    test_hold();
    test_window();
    test_expected();
    test_asleep();
    test_loan();
    test_counted_reader();
    test_outruns();
    test_pictures();
    test_budget();
    test_restart();
    test_restart_without_a_gap();
    test_restart_and_stop();
    test_newcomers_wait_quietly();
    ddx_store_close(id);
    store_stop(SIGTERM);
    return 0;
}
