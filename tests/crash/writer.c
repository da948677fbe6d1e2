/* SPDX-License-Identifier: GPL-2.0-or-later */
/* A writer that stands by until the item has none, then continues after the last whole frame. */
#include <errno.h>
#include <string.h>

#include "stage.h"

struct writer {
    struct stream *stream;
    struct term *term; /* NULL: stands by */
    uint32_t number;
    uint64_t published; /* in this term, by the library's return values */
    DDX_STORE_ITEM *item, *look;
};

/* Reads the predecessor's last frame, which must agree with the predecessor's record. */
static void begin(struct writer *w, unsigned index) {
    static FRAME last;
    int result;

    while ((result = ddx_store_read(w->look, &last, NULL, 0, DDX_CURRENT)) && later(result))
        nap(0.001);
    if (result)
        last.number = 0;
    if (result && result != -ETIMEDOUT)
        actor_fail("the new writer cannot read: %s", ddx_error_text(result));
    w->number = w->stream->terms + 1;
    if (w->number >= TERMS)
        actor_fail("too many terms for the stage");
    const struct term *before = &w->stream->term[w->number - 1];
    if (last.number < before->done || last.number > before->begun)
        actor_fail("term %u goes on from %llu, but its predecessor published %llu, perhaps %llu", w->number,
                   (unsigned long long)last.number, (unsigned long long)before->done,
                   (unsigned long long)before->begun);
    w->term = &w->stream->term[w->number];
    w->published = 0;
    w->term->first = last.number + 1;
    w->term->begun = w->term->done = last.number;
    w->stream->owner = index;
    w->stream->terms = w->number;
}

static void write_one(struct writer *w, void *data) {
    FRAME *frame = data;
    uint64_t number = w->term->done + 1;

    frame->number = number;
    frame->term = w->number;
    for (unsigned i = 0; i < WORDS; i++)
        frame->word[i] = content(number, w->number, i);
    if (number % 50 == 7 && number != w->term->first) {
        frame->word[3] = 0;
        int result = ddx_store_cancel(w->item);
        if (!result)
            result = ddx_store_loan(w->item, &data);
        if (result == -EEXIST)
            return; /* superseded just now */
        if (result)
            actor_fail("a loaned frame cannot be given back");
        frame = data;
        frame->number = number;
        frame->term = w->number;
        for (unsigned i = 0; i < WORDS; i++)
            frame->word[i] = content(number, w->number, i);
    }
    w->term->begun = number;
    w->stream->begun = number;
    if (number == w->term->first)
        w->term->time = ddx_time_now();
    int result = ddx_store_publish(w->item, NULL);
    if (result == -EEXIST)
        return;
    if (result)
        actor_fail("publish: %s", ddx_error_text(result));
    w->published++;
    w->term->done = number;
    w->stream->done = number;
}

/* Another writer took over while this one was stopped: the library must know how many frames no reader saw. */
static void superseded(struct writer *w) {
    const struct term *next = &w->stream->term[w->number + 1];
    int64_t until = ddx_time_now() + 8000000000;

    while (w->stream->terms <= w->number) { /* it claimed the item, but has not recorded yet what it found */
        if (ddx_time_now() > until || leaving)
            return;
        nap(0.001);
    }
    uint64_t seen = next->first - w->term->first, lost = ddx_store_lost(w->item);
    if (seen + lost != w->published)
        actor_fail("%llu published, %llu of them seen, but %llu counted as lost", (unsigned long long)w->published,
                   (unsigned long long)seen, (unsigned long long)lost);
    w->stream->lost += lost;
}

void play_writer(struct actor *me, unsigned stream, unsigned index, double period) {
    struct writer w = {.stream = &stage->stream[stream]};
    DDX_STORE_ID *id = ddx_store_open(NULL, 0, 30);
    static FRAME copy;
    void *data;
    int result;

    if (!id)
        actor_fail("no store: %s", ddx_error_text(errno));
    w.item = actor_lookup(id, stream_name[stream]);
    w.look = actor_lookup(id, stream_name[stream]);
    while (!leaving && (result = ddx_store_read(w.look, &copy, NULL, 0, DDX_CURRENT)) && result != -ETIMEDOUT) {
        if (!later(result))
            actor_fail("the writer's own reader: %s", ddx_error_text(result));
        nap(0.002);
    }
    for (; !leaving; me->beats++) {
        if (!w.term && !(w.stream->allowed & 1u << index)) {
            nap(0.001);
            continue;
        }
        result = ddx_store_loan(w.item, &data);
        if (result == -EEXIST && w.term) { /* stopped for so long that another took over: begin again */
            superseded(&w);
            w.term = NULL;
            ddx_store_done_item(w.item);
            w.item = actor_lookup(id, stream_name[stream]);
            continue;
        }
        if (later(result) || result == -EEXIST) {
            nap(0.002);
            continue;
        }
        if (result)
            actor_fail("loan: %s", ddx_error_text(result));
        if (!w.term)
            begin(&w, index);
        if (w.stream->terms == w.number)
            write_one(&w, data);
        else if (!ddx_store_publish(w.item, NULL)) /* no reader is left, and the message is on its way */
            w.published++;
        me->frames++;
        nap(period);
    }
    ddx_store_close(id);
}
