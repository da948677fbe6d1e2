/* SPDX-License-Identifier: GPL-2.0-or-later */
/* The readers of the crash tests, and functions that all parties share. */
#include <errno.h>
#include <fcntl.h>
#include <signal.h>
#include <stdarg.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <sys/mman.h>
#include <sys/prctl.h>
#include <time.h>
#include <unistd.h>

#include "../../package/ddx/lib/handle.h"
#include "stage.h"

struct stage *stage;
volatile int leaving;
const char *const stream_name[STREAMS] = {"frames", "others"};
static struct actor *self;

void nap(double seconds) {
    struct timespec time = {(time_t)seconds, (long)((seconds - (double)(time_t)seconds) * 1e9)};

    nanosleep(&time, NULL);
}

void stage_open(bool create) {
    const char *path = getenv("DDX_FAULT_JOURNAL");
    int fd = path ? open(path, O_RDWR | O_CLOEXEC | (create ? O_CREAT : 0), 0600) : -1;

    if (fd < 0 || (create && ftruncate(fd, sizeof *stage)))
        abort();
    stage = mmap(NULL, sizeof *stage, PROT_READ | PROT_WRITE, MAP_SHARED, fd, 0);
    if (stage == MAP_FAILED)
        abort();
    close(fd);
}

void actor_fail(const char *format, ...) {
    va_list arguments;

    va_start(arguments, format);
    vsnprintf(self->failure, sizeof self->failure, format, arguments);
    va_end(arguments);
    self->failed = 1;
    stage->failures++;
    _exit(1);
}

bool later(int result) {
    return result == -ECONNREFUSED || result == -EBUSY || result == -ENOSPC || result == -EMFILE;
}

DDX_STORE_ITEM *actor_lookup(DDX_STORE_ID *id, const char *name) {
    int64_t deadline = ddx_time_now() + 30000000000;
    DDX_STORE_ITEM *item;

    while (!(item = ddx_store_lookup_item(id, name, "FRAME", sizeof(FRAME)))) {
        if (errno != ECONNREFUSED || ddx_time_now() > deadline)
            actor_fail("lookup: %s", ddx_error_text(errno));
        if (leaving)
            _exit(0);
        nap(0.002);
    }
    return item;
}

static void check_words(const FRAME *frame, uint64_t number, uint64_t term) {
    for (unsigned i = 0; i < WORDS; i++)
        if (frame->word[i] != content(number, term, i) || frame->number != number || frame->term != term)
            actor_fail("torn: frame %llu of term %llu at word %u", (unsigned long long)number, (unsigned long long)term,
                       i);
}

/* Counts a delivered frame: only `missed` is the library's number. */
static void account(struct actor *me, const struct stream *stream, const FRAME *frame, uint64_t missed,
                    uint64_t earliest) {
    int64_t now = ddx_time_now();
    uint64_t outside = frame->number - me->last - 1;

    check_words(frame, frame->number, frame->term);
    if (frame->term < 1 || frame->term > stream->terms || frame->term < me->term)
        actor_fail("frame of term %llu after %llu", (unsigned long long)frame->term, (unsigned long long)me->term);
    const struct term *term = &stream->term[frame->term];
    if (frame->number < term->first || frame->number > term->begun)
        actor_fail("frame %llu was not written in term %llu", (unsigned long long)frame->number,
                   (unsigned long long)frame->term);
    if (frame->number <= me->last)
        actor_fail("frame %llu after %llu", (unsigned long long)frame->number, (unsigned long long)me->last);
    if (me->frames && missed != outside)
        actor_fail("from %llu to %llu %llu are missing, but %llu were counted", (unsigned long long)me->last,
                   (unsigned long long)frame->number, (unsigned long long)outside, (unsigned long long)missed);
    if (!me->frames) {
        me->first = frame->number - missed;
        if (me->first < earliest + 1)
            actor_fail("counts from %llu, but %llu were there before", (unsigned long long)me->first,
                       (unsigned long long)earliest);
    }
    if (frame->term != me->term) {
        me->term_time = now;
        me->term = frame->term;
    }
    me->last = frame->number;
    me->missed += missed;
    me->frames++;
}

struct reader {
    struct actor *me;
    const struct stream *stream;
    DDX_STORE_ITEM *item;
    uint64_t earliest, missed;
    const FRAME *live;
    char kind;
};

/* Takes one frame in one of the four ways. */
static int take(struct reader *r, char way) {
    static FRAME copy;
    struct ddx_frame got = {0};
    const FRAME *frame;
    DDX_TIME time = 0;
    int result;

    switch (way) {
    case 'c':
        result = ddx_store_read(r->item, &copy, &time, 0.3, DDX_IN_ORDER);
        frame = &copy;
        break;
    case 'd':
        result = ddx_store_read_direct(r->item, &time, 0.3, DDX_NEXT);
        frame = r->live;
        break;
    default:
        result = ddx_store_acquire(r->item, &got, 0.3, way == 'n' ? DDX_NEXT : DDX_IN_ORDER);
        frame = got.data;
        time = got.time;
        break;
    }
    if (result)
        return result;
    r->me->delay[r->me->frames % DELAYS] = (uint32_t)((ddx_time_now() - time) / 1000);
    uint64_t missed = ddx_store_missed(r->item) - r->missed;
    if (got.data && (missed != got.missed || got.sequence != frame->number))
        actor_fail("frame %llu has number %llu", (unsigned long long)frame->number, (unsigned long long)got.sequence);
    r->missed += missed;
    account(r->me, r->stream, frame, missed, r->earliest);
    if (r->me->frames % 16 == 3) {
        nap(r->me->frames % 64 == 3 ? 0.12 : 0.004);  /* 0.12: until the writer has used all slots */
        check_words(frame, r->me->last, r->me->term); /* a held frame does not change */
    }
    if (got.data && ddx_store_release(r->item))
        actor_fail("a frame cannot be released");
    return 0;
}

/*
 * Kinds: n newest, o in order, k in order and patient on a busy machine, c copies in order, d stable pointer; m all but
 * k in turn.
 */
static void play_reader(struct actor *me, unsigned stream, char kind) {
    DDX_STORE_ID *id = ddx_store_open(NULL, 0, 30);
    struct reader r = {.me = me, .stream = &stage->stream[stream], .kind = kind};
    int64_t before = 0;

    if (!id)
        actor_fail("no store: %s", ddx_error_text(errno));
    r.item = actor_lookup(id, stream_name[stream]);
    if ((kind == 'o' || kind == 'k') && ddx_store_keep(r.item, kind == 'k' ? 64 : 8))
        actor_fail("keep is refused");
    r.live = kind == 'd' || kind == 'm' ? ddx_store_var_pointer(r.item) : NULL;
    r.earliest = r.stream->done;
    for (unsigned turn = 0; !leaving; turn++, me->beats++) {
        int result = take(&r, kind == 'm' ? "nodc"[turn % 4] : kind);
        int64_t now = ddx_time_now();

        if (result && result != -ETIMEDOUT && !later(result))
            actor_fail("reading: %s", ddx_error_text(result));
        if (later(result))
            nap(0.002);
        if (!result) {
            if (before && now - before > me->longest)
                me->longest = now - before;
            before = now;
        }
    }
    ddx_store_close(id);
}

/* A reader that always holds a frame, each for a while. */
static void play_holder(struct actor *me, unsigned stream) {
    DDX_STORE_ID *id = ddx_store_open(NULL, 0, 30);
    DDX_STORE_ITEM *item = id ? actor_lookup(id, stream_name[stream]) : NULL;
    struct ddx_frame frame;

    for (; !leaving; me->beats++) {
        if (item && !ddx_store_acquire(item, &frame, 0.3, DDX_CURRENT)) {
            const FRAME *held = frame.data;

            me->frames++;
            check_words(held, frame.sequence, held->term);
            nap(0.02);
            check_words(held, frame.sequence, held->term);
            ddx_store_release(item);
        }
    }
    ddx_store_close(id);
}

/* A reader that lies: it claims to pin random slots until it is noticed or stopped. */
static void play_liar(struct actor *me, unsigned stream) {
    DDX_STORE_ID *id = ddx_store_open(NULL, 0, 30);
    DDX_STORE_ITEM *item = id ? actor_lookup(id, stream_name[stream]) : NULL;
    struct ddx_frame frame;

    while (!leaving && (!item || ddx_store_acquire(item, &frame, 1, DDX_CURRENT)))
        nap(0.002);
    for (unsigned turn = 0; !leaving; turn++, me->beats++) {
        uint32_t epoch = item->reader.coming ? item->reader.coming->epoch : item->reader.term->epoch;

        for (unsigned pin = 0; pin < DDX_PINS; pin++)
            atomic_store(&item->reader.page->pin[pin], DDX_PIN(epoch, (turn + pin * 7) % 12));
        if (turn % 1000 == 0) /* to free memory and follow to other epochs */
            ddx_store_release(item), ddx_store_acquire(item, &frame, 0, DDX_CURRENT);
    }
    _exit(0);
}

/* Opens an item without a writer, and leaves it, so that the item disappears. */
static void play_tourist(struct actor *me) {
    DDX_STORE_ID *id = ddx_store_open(NULL, 0, 30);

    for (; !leaving; me->beats++) {
        DDX_STORE_ITEM *item = id ? ddx_store_lookup_item(id, "sights", "FRAME", sizeof(FRAME)) : NULL;

        me->frames += item != NULL;
        ddx_store_done_item(item);
        nap(0.002);
    }
    ddx_store_close(id);
}

static void on_term(int number) {
    (void)number;
    leaving = 1;
}

int actor_main(char kind, unsigned stream, unsigned index, double period) {
    struct sigaction action = {.sa_handler = on_term};
    sigset_t term;

    prctl(PR_SET_PDEATHSIG, SIGKILL);
    sigaction(SIGTERM, &action, NULL);
    sigemptyset(&term);
    sigaddset(&term, SIGTERM);
    sigprocmask(SIG_UNBLOCK, &term, NULL);
    stage_open(false);
    self = &stage->actor[index];
    switch (kind) {
    case 'w': play_writer(self, stream, index, period); break;
    case 't': play_tourist(self); break;
    case 'v': play_vandal(self, stream); break;
    case 'f': play_flood(self); break;
    case 'h': play_holder(self, stream); break;
    case 'l': play_liar(self, stream); break;
    default: play_reader(self, stream, kind); break;
    }
    return 0;
}
