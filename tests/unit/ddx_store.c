/* SPDX-License-Identifier: GPL-2.0-or-later */
/* The library against a real store: what the header promises, call by call. */
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
    DDX_STORE_ITEM *item = ddx_store_lookup_item(id, name, type, (int)size);

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
    CHECK_EQUAL(ddx_store_keep(in, 6), -EBUSY);
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

/* The newest value is that of the newest writer, also when the one before left values that were never looked at. */
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

/* What a reader holds stays as it is while the writer goes on. */
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

/* The window shows the same while its reader waits, and after it waited in vain. */
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

static void *write_later(void *number) {
    POSITION value = {*(int *)number, 0, 0};
    DDX_STORE_ITEM *out;

    nap(*(int *)number % 8 * 0.0005); /* before the reader sleeps, just then, and when it is asleep */
    out = lookup("asleep", "POSITION", sizeof(POSITION));
    CHECK_EQUAL(ddx_store_write(out, &value, NULL), 0);
    ddx_store_done_item(out);
    return NULL;
}

/* A reader that sleeps without limit hears of the next writer, though it sleeps on a word of the one that is gone. */
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
        CHECK(ddx_time_now() - before < 30000000000); /* woken, not at the end of its patience */
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
    CHECK_EQUAL(ddx_store_readers(out), 1);
    ddx_store_done_item(in);
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

/* A picture may change its size; a reader that is not told in advance follows. 4K included. */
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

/* Memory that the store holds, counted by the kernel. */
static uint64_t backed_memory(void) {
    uint64_t sum = 0;

    for (int fd = 0; fd < 4096; fd++) {
        char path[64], target[64] = "";
        struct stat status;

        snprintf(path, sizeof path, "/proc/%d/fd/%d", (int)store_pid, fd);
        if (readlink(path, target, sizeof target - 1) > 0 && strstr(target, "memfd:") && !stat(path, &status))
            sum += (uint64_t)status.st_blocks * 512;
    }
    return sum;
}

static void test_budget(void) {
    struct ddx_item_info before, with_readers, *items;
    struct ddx_store_info after;
    unsigned count;
    DDX_STORE_ITEM *out = lookup("budget", "BLOCK", sizeof(BLOCK)), *in[400];
    static BLOCK value;
    int readers = 0, result = 0;

    CHECK_EQUAL(ddx_store_write(out, &value, NULL), 0);
    CHECK_EQUAL(ddx_store_item_info(out, &before), 0);
    while (readers < 400 && !result) {
        in[readers] = lookup("budget", NULL, 0);
        result = ddx_store_read(in[readers++], &value, NULL, 0, DDX_CURRENT);
    }
    CHECK_EQUAL(result, -EBUSY);
    CHECK_EQUAL(ddx_store_list(id, &after, &items, &count), 0);
    free(items);
    CHECK_EQUAL(ddx_store_item_info(out, &with_readers), 0);
    CHECK(after.reserved <= after.budget);
    CHECK(after.budget - after.reserved < 3 * 1003520); /* used up, but for less than one reader more */
    CHECK_EQUAL(with_readers.bytes - before.bytes, (uint64_t)(readers - 1) * (1003520 + 4096));
    CHECK_EQUAL(after.bytes, backed_memory());
    CHECK_EQUAL(ddx_store_write(out, &value, NULL), 0); /* the writer does not notice */
    DDX_STORE_ITEM *more = lookup("too.much", "BLOCK", sizeof(BLOCK));
    CHECK_EQUAL(ddx_store_write(more, &value, NULL), -ENOSPC);
    ddx_store_done_item(more);
    while (readers)
        ddx_store_done_item(in[--readers]);
    ddx_store_done_item(out);
}

/* The store dies; frames flow on; items that anybody holds are back in its successor, even if their program sleeps. */
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
    late = lookup("restart", NULL, 0); /* a newcomer finds the item */
    CHECK_EQUAL(ddx_store_read(late, &value, NULL, 0, DDX_CURRENT), 0);
    CHECK_EQUAL(value.number, 20);
    idle = lookup("idle", NULL, 0);
    number = 0;
    CHECK_EQUAL(ddx_store_read(idle, &number, NULL, 0, DDX_CURRENT), 0);
    CHECK_EQUAL(number, 41);
    CHECK_EQUAL(ddx_store_write(idle, &number, NULL), 0); /* nobody wrote it any more */
    /* The newcomer's pin counts for the writer that was there before the restart. */
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

/* Every frame once and none missed, while the store goes and comes back and a reader is busy with what it has. */
static void test_restart_without_a_gap(void) {
    DDX_STORE_ITEM *out = lookup("gap", "POSITION", sizeof(POSITION)), *in = lookup("gap", NULL, 0);
    POSITION value = {0};
    DDX_TIME begin = ddx_time_now(), time;
    bool stopped = false, started = false;

    CHECK_EQUAL(ddx_store_read(in, &value, NULL, 0, DDX_IN_ORDER), -ETIMEDOUT);
    for (uint64_t expected = 1; (time = ddx_time_now() - begin) < 600000000; expected++) {
        struct ddx_frame frame;

        if (!stopped && time > 50000000) {
            store_stop(SIGKILL);
            stopped = true;
        }
        if (!started && time > 100000000) {
            store_start("64M");
            started = true;
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

/* A store that cannot listen for a while after its restart does not give away what living programs hold. */
static void test_restart_and_stop(void) {
    DDX_STORE_ITEM *out = lookup("stopped", "int", sizeof(int)), *rival;
    int value = 0;

    for (value = 1; value <= 9; value++)
        CHECK_EQUAL(ddx_store_write(out, &value, NULL), 0);
    rival = lookup("stopped", "int", sizeof(int));
    store_stop(SIGKILL);
    store_start("64M");
    DDX_STORE_ID *probe = ddx_store_open(NULL, 0, 2);
    CHECK_EQUAL(kill(store_pid, SIGSTOP), 0);
    nap(0.4);
    CHECK_EQUAL(kill(store_pid, SIGCONT), 0);
    CHECK_EQUAL(ddx_store_write(rival, &value, NULL), -EEXIST);
    CHECK_EQUAL(ddx_store_read(rival, &value, NULL, 0, DDX_CURRENT), 0);
    CHECK_EQUAL(value, 9);
    ddx_store_close(probe);
    ddx_store_done_item(rival);
    ddx_store_done_item(out);
}

static double store_seconds(void) {
    struct timespec used;
    clockid_t clock;

    CHECK_EQUAL(clock_getcpuclockid(store_pid, &clock), 0);
    CHECK_EQUAL(clock_gettime(clock, &used), 0);
    return (double)used.tv_sec + (double)used.tv_nsec / 1e9;
}

/* Newcomers wait while holders report to a store that was restarted; it sleeps meanwhile. */
static void test_newcomers_wait_quietly(void) {
    store_stop(SIGKILL);
    store_start("64M");
    DDX_STORE_ID *other = ddx_store_open(NULL, 0, 2);
    CHECK(other);
    double before = store_seconds();
    DDX_TIME begin = ddx_time_now();
    DDX_STORE_ITEM *item = ddx_store_lookup_item(other, "newcomer", "int", sizeof(int));
    CHECK(item);
    CHECK(ddx_time_now() - begin > 150000000);
    CHECK(store_seconds() - before < 0.005); /* in vain: 0.016 and more */
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
    test_asleep();
    test_loan();
    test_pictures();
    test_budget();
    test_restart();
    test_restart_without_a_gap();
    test_restart_and_stop();
    test_newcomers_wait_quietly();
    ddx_store_close(id);
    store_stop(SIGTERM);
    store_folder_remove();
    return 0;
}
