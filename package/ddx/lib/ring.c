/* SPDX-License-Identifier: LGPL-2.1-or-later */
#include "ring.h"

#include <errno.h>
#include <string.h>

#include "fault.h"

#define ROUNDS 1000 /* over all slots, while pins move; honest readers cause a few at most */

static uint64_t join(const ddx_word *low, const ddx_word *high) {
    return (uint64_t)atomic_load_explicit(high, memory_order_relaxed) << 32 |
           atomic_load_explicit(low, memory_order_relaxed);
}

/*
 * Acquire: later loads must not move before this one. For readers without a pin, which check afterwards whether the
 * frame was overwritten.
 */
static uint64_t join_first(const ddx_word *low, const ddx_word *high) {
    return (uint64_t)atomic_load_explicit(high, memory_order_acquire) << 32 |
           atomic_load_explicit(low, memory_order_acquire);
}

static void split(ddx_word *low, ddx_word *high, uint64_t value) {
    atomic_store_explicit(low, (uint32_t)value, memory_order_relaxed);
    atomic_store_explicit(high, (uint32_t)(value >> 32), memory_order_relaxed);
}

static uint64_t sequence_of(const struct ddx_slot_state *state) {
    return join(&state->sequence_low, &state->sequence_high);
}

/*
 * A reader with a share of one frame that pins two slots is lying about one of them. The other pin is read last: an
 * honest reader has cleared it before it set the one that was found.
 */
DDX_COLD static bool has_two_pins(const struct ddx_ring_writer *writer, const struct ddx_ring_reader *reader,
                                  unsigned k) {
    uint32_t other = atomic_load(&reader->page->pin[DDX_PIN_READ]);

    return k != DDX_PIN_READ && reader->share == 1 && other && other >> 8 == (writer->epoch & 0xffffffu);
}

DDX_HOT static bool pinned(const struct ddx_ring_writer *writer, unsigned slot) {
    uint32_t pin = DDX_PIN(writer->epoch, slot);

    for (unsigned i = 0; i < writer->reader_count; i++)
        for (unsigned k = 0; k < DDX_PINS; k++)
            if (atomic_load(&writer->reader[i].page->pin[k]) == pin && !has_two_pins(writer, &writer->reader[i], k))
                return true;
    return false;
}

/* Skip pinned slots without marking them: WRITING, even for a moment, hides a frame from readers in order. */
DDX_HOT static void leave_out(const struct ddx_ring_writer *writer, bool *tried) {
    for (unsigned i = 0; i < writer->slot_count; i++)
        tried[writer->slot[i]] = pinned(writer, writer->slot[i]);
}

static void collect(const struct ddx_ring_writer *writer, uint32_t *pins) {
    for (unsigned i = 0; i < writer->reader_count; i++)
        for (unsigned k = 0; k < DDX_PINS; k++)
            pins[i * DDX_PINS + k] = atomic_load(&writer->reader[i].page->pin[k]);
}

/*
 * No slot was free when it was checked, but readers move their pins during the check. If two reads of all pins are
 * equal, all slots checked between them were pinned at the same time.
 */
DDX_COLD static bool pins_rest(const struct ddx_ring_writer *writer, bool *tried) {
    uint32_t before[DDX_READERS_MAX * DDX_PINS], now[DDX_READERS_MAX * DDX_PINS];

    collect(writer, before);
    leave_out(writer, tried);
    collect(writer, now);
    return !memcmp(before, now, writer->reader_count * DDX_PINS * sizeof *now);
}

/* Oldest first, so that late readers find as many frames as there are spare slots. */
DDX_HOT static unsigned oldest_of(const struct ddx_ring_writer *writer, unsigned begin, unsigned end, unsigned newest,
                                  const bool *tried) {
    unsigned best = DDX_NO_SLOT;
    uint64_t best_sequence = UINT64_MAX;

    for (unsigned i = begin; i < end; i++) {
        unsigned slot = writer->slot[i];
        uint64_t sequence = sequence_of(&writer->control->slot[slot]);

        if (slot != newest && !tried[slot] && sequence < best_sequence) {
            best = slot;
            best_sequence = sequence;
        }
    }
    return best;
}

/*
 * A slot that readers do not know yet is taken only if there is no other: if the store stopped now, they would miss the
 * frame.
 */
DDX_HOT static unsigned oldest(const struct ddx_ring_writer *writer, unsigned newest, const bool *tried) {
    unsigned slot = oldest_of(writer, 0, writer->told_count, newest, tried);

    return slot != DDX_NO_SLOT ? slot : oldest_of(writer, writer->told_count, writer->slot_count, newest, tried);
}

DDX_HOT int ddx_ring_choose(struct ddx_ring_writer *writer, unsigned *chosen) {
    unsigned newest = DDX_LATEST_SLOT(atomic_load_explicit(&writer->control->latest, memory_order_relaxed));
    bool tried[DDX_SLOTS_MAX] = {false};
    unsigned rounds = 0;

    leave_out(writer, tried);
    for (;;) {
        unsigned slot = oldest(writer, newest, tried);

        if (slot == DDX_NO_SLOT) {
            /* While this loop runs, readers pin ever newer frames up to `newest`, so the loop ends; ROUNDS is for a
             * malicious reader that moves its pins for ever. */
            bool rest = pins_rest(writer, tried);
            if (oldest(writer, newest, tried) == DDX_NO_SLOT && (rest || ++rounds == ROUNDS))
                return -ENOBUFS;
            continue;
        }
        ddx_word *generation = &writer->control->slot[slot].generation;
        uint32_t before = atomic_load_explicit(generation, memory_order_relaxed);

        DDX_PASS(WRITER_CHOSEN);
        /* W2 before W3 and W4, sequentially consistent: see ring.h. */
        atomic_store(generation, DDX_WRITING);
        DDX_PASS(WRITER_MARKED);
        if ((int32_t)(atomic_load(&writer->notice->version) - writer->notice_seen) > 0) {
            atomic_store_explicit(generation, before, memory_order_release);
            DDX_PASS(WRITER_NEWS);
            return -EAGAIN;
        }
        DDX_PASS(WRITER_UNCHANGED);
        if (!pinned(writer, slot)) {
            *chosen = slot;
            DDX_PASS(WRITER_OWNS);
            return 0;
        }
        atomic_store_explicit(generation, before, memory_order_release);
        tried[slot] = true;
        DDX_PASS(WRITER_COLLIDED);
    }
}

bool ddx_ring_outruns(const struct ddx_ring_writer *writer) {
    unsigned newest = DDX_LATEST_SLOT(atomic_load_explicit(&writer->control->latest, memory_order_relaxed));
    bool out[DDX_SLOTS_MAX] = {false};

    leave_out(writer, out);
    unsigned slot = oldest(writer, newest, out);
    uint64_t sequence = slot == DDX_NO_SLOT ? 0 : sequence_of(&writer->control->slot[slot]);

    for (unsigned i = 0; i < writer->reader_count && sequence; i++) {
        uint32_t seen = atomic_load_explicit(&writer->reader[i].page->seen, memory_order_relaxed);

        if ((int32_t)((uint32_t)sequence - seen) > 0)
            return true;
    }
    return false;
}

DDX_HOT void ddx_ring_publish(struct ddx_ring_writer *writer, unsigned slot, int64_t time) {
    struct ddx_slot_state *state = &writer->control->slot[slot];
    uint64_t sequence = ++writer->sequence;

    DDX_PASS(WRITER_WRITTEN);
    split(&state->sequence_low, &state->sequence_high, sequence);
    split(&state->time_low, &state->time_high, (uint64_t)time);
    DDX_PASS(WRITER_NUMBERED);
    /* Release: a reader that finds the generation even finds the whole frame. Before `latest`, or a reader that
     * learns of the frame would find it unreadable and retry in vain until the next one. */
    atomic_store_explicit(&state->generation, (uint32_t)sequence << 1, memory_order_release);
    DDX_PASS(WRITER_WHOLE);
    atomic_store_explicit(&writer->control->latest, DDX_LATEST(sequence, slot), memory_order_release);
    DDX_PASS(WRITER_PUBLISHED);
}

void ddx_ring_cancel(struct ddx_ring_writer *writer, unsigned slot) {
    struct ddx_slot_state *state = &writer->control->slot[slot];

    split(&state->sequence_low, &state->sequence_high, 0);
    atomic_store_explicit(&state->generation, DDX_EMPTY, memory_order_release);
    DDX_PASS(WRITER_CANCELLED);
}

DDX_HOT unsigned ddx_ring_newest(const struct ddx_control *control, uint32_t *latest) {
    *latest = atomic_load_explicit(&control->latest, memory_order_acquire);
    return DDX_LATEST_SLOT(*latest);
}

DDX_HOT uint32_t ddx_ring_published(const struct ddx_control *control, uint32_t latest) {
    const ddx_word *generation = &control->slot[DDX_LATEST_SLOT(latest)].generation;
    uint32_t found = atomic_load_explicit(generation, memory_order_relaxed);

    return !(found & 1) && (found >> 1 & 0x7fffffu) == DDX_LATEST_SEQUENCE(latest) ? found : DDX_WRITING;
}

/* All 64 bits of the newest frame's number. False: the frame was overwritten during the read. */
DDX_HOT static bool newest_number(const struct ddx_control *control, uint32_t latest, uint64_t *number) {
    const struct ddx_slot_state *state = &control->slot[DDX_LATEST_SLOT(latest)];
    uint32_t generation = atomic_load_explicit(&state->generation, memory_order_acquire);

    *number = sequence_of(state);
    return generation == (uint32_t)*number << 1 && (*number & 0x7fffffu) == DDX_LATEST_SEQUENCE(latest);
}

DDX_HOT unsigned ddx_ring_next(const struct ddx_control *control, uint64_t seen, uint32_t *generation) {
    unsigned slots = atomic_load_explicit(&control->slots, memory_order_acquire);
    unsigned best = DDX_NO_SLOT;

    if (slots > DDX_SLOTS_MAX)
        slots = DDX_SLOTS_MAX;
    /* A writer that tries a slot and finds it pinned hides it for a moment: before skipping a frame, look again. */
    for (int attempt = 0; attempt < 16; attempt++) {
        uint64_t newest, oldest_new = UINT64_MAX;
        bool hidden = false;
        uint32_t latest;

        if (ddx_ring_newest(control, &latest) == DDX_NO_SLOT)
            return DDX_NO_SLOT;
        if (!newest_number(control, latest, &newest))
            continue;
        best = DDX_NO_SLOT;
        for (unsigned slot = 0; slot < slots; slot++) {
            uint32_t found = atomic_load_explicit(&control->slot[slot].generation, memory_order_acquire);
            uint32_t behind = ((uint32_t)newest - (found >> 1)) & 0x7fffffffu; /* the newest, modulo 2^31 */

            hidden |= found == DDX_WRITING;
            /* Far behind means ahead: whole, but not published. If the writer dies before W7, another frame gets this
             * number. */
            if (!(found & 1) && behind < 0x40000000u && newest - behind > seen && newest - behind < oldest_new) {
                best = slot;
                oldest_new = newest - behind;
                *generation = found;
            }
        }
        if (best == DDX_NO_SLOT || oldest_new == seen + 1 || !hidden)
            break;
    }
    return best;
}

bool ddx_ring_left(const struct ddx_control *control, void *const *base, uint64_t seen, uint64_t last) {
    uint64_t oldest_new = UINT64_MAX;
    bool mapped = false;

    for (unsigned slot = 0; slot < DDX_SLOTS_MAX; slot++) {
        const struct ddx_slot_state *state = &control->slot[slot];
        uint32_t generation = atomic_load_explicit(&state->generation, memory_order_acquire);
        uint64_t sequence = sequence_of(state);

        if (generation != (uint32_t)sequence << 1 || sequence <= seen || sequence > last || sequence > oldest_new)
            continue;
        oldest_new = sequence;
        mapped = base[slot];
    }
    return mapped;
}

unsigned ddx_ring_coming(const struct ddx_control *control, void *const *base, unsigned except) {
    unsigned slots = atomic_load_explicit(&control->slots, memory_order_relaxed), best = DDX_NO_SLOT;
    unsigned newest = DDX_LATEST_SLOT(atomic_load_explicit(&control->latest, memory_order_relaxed));
    uint64_t best_sequence = UINT64_MAX;

    for (unsigned slot = 0; slot < slots && slot < DDX_SLOTS_MAX; slot++) {
        uint64_t sequence = sequence_of(&control->slot[slot]);

        if (!base[slot] || slot == except || slot == newest)
            continue;
        if (atomic_load_explicit(&control->slot[slot].generation, memory_order_relaxed) == DDX_WRITING)
            return slot;
        if (sequence < best_sequence) {
            best = slot;
            best_sequence = sequence;
        }
    }
    return best;
}

DDX_HOT int ddx_ring_pin(const struct ddx_control *control, ddx_word *pin, unsigned slot, uint32_t generation,
                         struct ddx_ring_frame *frame) {
    const struct ddx_slot_state *state = &control->slot[slot];

    /* R2 before R3, sequentially consistent: see ring.h. */
    atomic_store(pin, DDX_PIN(control->epoch, slot));
    DDX_PASS(READER_PINNED);
    uint32_t found = atomic_load(&state->generation);

    if ((found & 1) || found != generation) {
        ddx_ring_unpin(pin);
        DDX_PASS(READER_OVERTAKEN);
        return -EAGAIN;
    }
    frame->slot = slot;
    frame->sequence = sequence_of(state);
    frame->time = (int64_t)join(&state->time_low, &state->time_high);
    DDX_PASS(READER_HOLDS);
    return 0;
}

DDX_HOT void ddx_ring_unpin(ddx_word *pin) {
    /* Release: a writer that finds the slot free must not write before this reader's last reads. */
    atomic_store_explicit(pin, 0, memory_order_release);
}

bool ddx_ring_peek(const struct ddx_control *control, struct ddx_ring_frame *frame) {
    for (int attempt = 0; attempt < 100; attempt++) {
        uint32_t latest;
        unsigned slot = ddx_ring_newest(control, &latest);

        if (slot >= DDX_SLOTS_MAX)
            return false;
        const struct ddx_slot_state *state = &control->slot[slot];
        uint32_t before = atomic_load_explicit(&state->generation, memory_order_acquire);
        frame->slot = slot;
        frame->sequence = join_first(&state->sequence_low, &state->sequence_high);
        frame->time = (int64_t)join_first(&state->time_low, &state->time_high);
        /* The words are atomics, so this is no data race; the number shows whether they belong together. */
        if (!(before & 1) && before == (uint32_t)frame->sequence << 1 &&
            before == atomic_load_explicit(&state->generation, memory_order_acquire))
            return true;
    }
    return false;
}
