/* SPDX-License-Identifier: GPL-2.0-or-later */
#include "epoch.h"

#include <errno.h>
#include <stdio.h>
#include <string.h>
#include <sys/mman.h>
#include <sys/stat.h>
#include <unistd.h>

#include "checkpoint.h"
#include "files.h"
#include "holder.h"

#define MEMFD_NAME_MAX 128

/* ---- Names of memory files ---- */

/* The names of memory files. A returned name is valid until the next call. */

/*
 * A memory file's name states its purpose, and its owner the user that made it; no holder of the file can change
 * either. So after a restart the store recognizes the files of the former store, accepts no others, and accepts each
 * only for its item, epoch, layout and slot.
 */

static uint64_t memfd_name_digest(const struct ddx_layout *layout) { /* FNV-1a */
    const unsigned char *byte = (const unsigned char *)layout;
    uint64_t sum = 0xcbf29ce484222325u;

    for (size_t i = 0; i < ddx_layout_bytes(layout->field_count); i++)
        sum = (sum ^ byte[i]) * 0x100000001b3u;
    return sum;
}

const char *memfd_name_of(const char *item, const char *what) {
    static char label[MEMFD_NAME_MAX];

    snprintf(label, sizeof label, "%s %s", item, what);
    return label;
}

const char *memfd_name_of_slot(const char *item, const struct epoch *epoch, unsigned slot) {
    static char label[MEMFD_NAME_MAX];
    int length =
        snprintf(label, sizeof label, "%s %u %016llx ", item, epoch->number, (unsigned long long)epoch->digest);

    if (slot == DDX_NO_SLOT)
        strcpy(label + length, "control");
    else
        snprintf(label + length, sizeof label - (size_t)length, "frame %u", slot);
    return label;
}

bool memfd_name_is(int fd, const char *label) {
    char path[32], wanted[MEMFD_NAME_MAX + 32], found[MEMFD_NAME_MAX + 32];
    struct stat status;

    if (fd < 0 || fstat(fd, &status) || status.st_uid != geteuid())
        return false;
    snprintf(path, sizeof path, "/proc/self/fd/%d", fd);
    int length = snprintf(wanted, sizeof wanted, "/memfd:%s (deleted)", label);
    return readlink(path, found, sizeof found) == length && !memcmp(wanted, found, (size_t)length);
}

/* ---- Epochs ---- */

#define NUMBER_MAX (UINT64_MAX / 4) /* no writer reaches it; beyond it numbers could overflow */
#define CARRY_ATTEMPTS 20           /* to copy a frame that a replaced but living writer overwrites */

struct ddx_layout *store_layout(const struct ddx_layout *layout) {
    size_t bytes = ddx_layout_bytes(layout->field_count);
    struct ddx_layout *copy = checkpoint_allocate(bytes);

    return copy ? memcpy(copy, layout, bytes) : NULL;
}

struct epoch *epoch_new(const struct ddx_layout *layout, uint32_t number) {
    struct epoch *epoch = checkpoint_allocate(sizeof *epoch);

    if (!epoch || !(epoch->layout = store_layout(layout))) {
        checkpoint_free(epoch);
        return NULL;
    }
    epoch->number = number;
    epoch->digest = memfd_name_digest(layout);
    ddx_runs_of(layout, &epoch->runs);
    epoch->control_fd = epoch->readers_fd = -1;
    for (unsigned i = 0; i < DDX_SLOTS_MAX; i++)
        epoch->slot_fd[i] = -1;
    return epoch;
}

int epoch_create_control(struct epoch *epoch, const char *name) {
    epoch->control_fd = ddx_memory_create(memfd_name_of_slot(name, epoch, DDX_NO_SLOT),
                                          ddx_page_round(sizeof(struct ddx_control)), NULL);
    if (epoch->control_fd < 0)
        return epoch->control_fd;
    epoch->control = ddx_memory_map(epoch->control_fd, sizeof(struct ddx_control), true);
    if (!epoch->control)
        return -errno;
    epoch->control->magic = DDX_CONTROL_MAGIC;
    epoch->control->version = DDX_LAYOUT_VERSION;
    epoch->control->epoch = epoch->number;
    atomic_store(&epoch->control->latest, DDX_LATEST(0, DDX_NO_SLOT));
    for (unsigned i = 0; i < DDX_SLOTS_MAX; i++)
        atomic_store(&epoch->control->slot[i].generation, DDX_EMPTY);
    return 0;
}

int epoch_add_slots(struct epoch *epoch, const char *name, unsigned count) {
    unsigned before = epoch->slots;

    for (unsigned i = 0; i < DDX_SLOTS_MAX && count; i++) {
        if (epoch->slot_fd[i] >= 0)
            continue;
        int fd = ddx_memory_create(memfd_name_of_slot(name, epoch, i), epoch->runs.file_bytes, holder_beat);
        if (fd < 0)
            break;
        epoch->slot_fd[i] = fd;
        epoch->slots++;
        count--;
    }
    if (!count)
        return 0;
    /* All or none. The writer does not know the new ones yet. */
    for (unsigned i = DDX_SLOTS_MAX; i-- > 0 && epoch->slots > before;)
        if (epoch->slot_fd[i] >= 0 && !epoch->slot_ready[i] && !epoch->slot_told[i]) {
            file_close(epoch->slot_fd[i]);
            epoch->slot_fd[i] = -1;
            epoch->slots--;
        }
    return -ENOSPC;
}

unsigned epoch_slots_a_turn(const struct epoch *epoch, unsigned count) {
    uint64_t fit = epoch->runs.file_bytes ? DDX_MEMORY_STEP / epoch->runs.file_bytes : count;

    return count <= fit ? count : fit ? (unsigned)fit : 1;
}

unsigned epoch_slots_planned(const struct epoch *epoch) {
    return epoch->slots > epoch->wanted ? epoch->slots : epoch->wanted;
}

bool epoch_ready(const struct epoch *epoch) {
    if (epoch->slots < epoch->wanted)
        return false;
    for (unsigned i = 0; i < DDX_SLOTS_MAX; i++)
        if (epoch->slot_fd[i] >= 0 && !epoch->slot_ready[i])
            return false;
    return epoch->control_ready;
}

/* The copy is whole if the frame is still in its slot afterwards: a replaced writer may still live, and write. */
static bool copy_frame(const struct epoch *from, const struct ddx_ring_frame *frame, void *to) {
    const ddx_word *generation = &from->control->slot[frame->slot].generation;
    size_t bytes = (size_t)from->runs.file_bytes;
    void *old = ddx_memory_map(from->slot_fd[frame->slot], bytes, false);

    if (!old)
        return false;
    for (size_t at = 0; at < bytes; at += DDX_MEMORY_STEP) {
        memcpy((char *)to + at, (char *)old + at, bytes - at < DDX_MEMORY_STEP ? bytes - at : DDX_MEMORY_STEP);
        holder_beat();
    }
    munmap(old, bytes);
#pragma GCC diagnostic push
#pragma GCC diagnostic ignored "-Wtsan" /* ThreadSanitizer knows neither fences nor other processes */
    atomic_thread_fence(memory_order_acquire);
#pragma GCC diagnostic pop
    return atomic_load_explicit(generation, memory_order_relaxed) == (uint32_t)frame->sequence << 1;
}

/*
 * The newest published frame whose slot the store has: the last one may be in a slot that no remaining holder knows.
 */
static bool newest_left(const struct epoch *from, uint64_t last, struct ddx_ring_frame *frame) {
    bool found = false;

    for (unsigned i = 0; i < DDX_SLOTS_MAX; i++) {
        const struct ddx_slot_state *slot = &from->control->slot[i];
        uint32_t generation = atomic_load_explicit(&slot->generation, memory_order_acquire);
        uint64_t number = (uint64_t)slot->sequence_high << 32 | slot->sequence_low;

        if (from->slot_fd[i] < 0 || (generation & 1) || generation != (uint32_t)number << 1 || number > last ||
            (found && number < frame->sequence))
            continue;
        *frame = (struct ddx_ring_frame){i, number, (int64_t)((uint64_t)slot->time_high << 32 | slot->time_low)};
        found = true;
    }
    return found;
}

/* The last whole frame of a former writer becomes the first one of the next writer, so that it remains readable. */
bool epoch_carry_over(struct epoch *from, struct epoch *to, uint64_t *sequence) {
    size_t bytes = (size_t)to->runs.file_bytes;
    bool same = ddx_layout_same(from->layout, to->layout), carried = false;
    void *fresh = same ? ddx_memory_map(to->slot_fd[0], bytes, true) : NULL;
    struct ddx_ring_frame frame;

    for (int attempt = 0; attempt < CARRY_ATTEMPTS && !carried && ddx_ring_peek(from->control, &frame); attempt++) {
        *sequence = frame.sequence <= NUMBER_MAX ? frame.sequence : 0;
        if (!fresh || !*sequence || (from->slot_fd[frame.slot] < 0 && !newest_left(from, *sequence, &frame)))
            break;
        carried = copy_frame(from, &frame, fresh);
    }
    if (carried) {
        struct ddx_ring_writer writer = {.control = to->control, .sequence = frame.sequence - 1};

        atomic_store(&to->control->slots, 1);
        ddx_ring_publish(&writer, 0, frame.time);
    }
    if (fresh)
        munmap(fresh, bytes);
    return carried;
}

void epoch_free(struct epoch *epoch) {
    if (!epoch)
        return;
    for (unsigned i = 0; i < DDX_SLOTS_MAX; i++)
        if (epoch->slot_fd[i] >= 0)
            file_close(epoch->slot_fd[i]);
    if (epoch->control)
        munmap(epoch->control, sizeof(struct ddx_control));
    if (epoch->control_fd >= 0)
        file_close(epoch->control_fd);
    if (epoch->readers_fd >= 0)
        file_close(epoch->readers_fd);
    checkpoint_free(epoch->layout);
    checkpoint_free(epoch);
}
