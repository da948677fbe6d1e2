/* SPDX-License-Identifier: GPL-2.0-or-later */
#include "slot.h"

#include <errno.h>
#include <fcntl.h>
#include <sodium.h>
#include <stdlib.h>
#include <string.h>
#include <unistd.h>

#include "place.h"

enum {
    ALIGNED = 4096,
    SECTOR = 512,      /* is written whole or not at all, also when the power fails */
    WRITE = 256 << 10, /* bytes of a write: a recorder's write waits for one of these at most */
    FLUSH = 4 << 20,   /* bytes between two flushes */
};

int slot_open(struct slot *slot, const char *device) {
    *slot = (struct slot){.device = device};
    slot->fd = open(device, O_RDWR | O_DIRECT | O_EXCL | O_CLOEXEC);
    if (slot->fd < 0)
        return fail(-errno, "%s: %s", device, errno == EBUSY ? "is mounted" : strerror(errno));
    const off_t size = lseek(slot->fd, 0, SEEK_END);
    slot->size = size < 0 ? 0 : (uint64_t)size;
    slot->piece = aligned_alloc(ALIGNED, MEBIBYTE);
    slot->first = aligned_alloc(ALIGNED, MEBIBYTE);
    if (slot->piece && slot->first)
        return 0;
    slot_close(slot);
    return fail(-ENOMEM, "no memory");
}

static int slot_flush(struct slot *slot) {
    slot->unflushed = 0;
    return fdatasync(slot->fd) ? fail(-errno, "%s: cannot be flushed: %s", slot->device, strerror(errno)) : 0;
}

static int write_all(struct slot *slot, const uint8_t *bytes, size_t size, uint64_t offset) {
    for (size_t at = 0; at < size;) {
        const size_t piece = size - at < WRITE ? size - at : WRITE;
        const double begin = pace_now();
        const ssize_t done = pwrite(slot->fd, bytes + at, piece, (off_t)(offset + at));
        if (done <= 0)
            return fail(done ? -errno : -EIO, "%s: cannot be written: %s", slot->device, strerror(done ? errno : EIO));
        at += (size_t)done;
        slot->unflushed += (unsigned)done;
        if (slot->pace)
            pace_rest(slot->pace, pace_now() - begin);
    }
    return slot->unflushed < FLUSH ? 0 : slot_flush(slot);
}

static int read_all(const struct slot *slot, uint8_t *bytes, size_t size, uint64_t offset) {
    for (size_t at = 0; at < size;) {
        const ssize_t done = pread(slot->fd, bytes + at, size - at, (off_t)(offset + at));
        if (done <= 0)
            return done ? -errno : -EIO;
        at += (size_t)done;
    }
    return 0;
}

int slot_clear(struct slot *slot) {
    const size_t size = slot->size < MEBIBYTE ? (size_t)slot->size : MEBIBYTE;

    memset(slot->piece, 0, MEBIBYTE);
    int error = write_all(slot, slot->piece, SECTOR, 0);
    if (!error)
        error = slot_flush(slot);
    if (!error)
        error = write_all(slot, slot->piece + SECTOR, size - SECTOR, SECTOR);
    return error ? error : slot_flush(slot);
}

int slot_finish(struct slot *slot, const struct manifest *manifest) {
    int error = slot_flush(slot);

    if (!error)
        error = write_all(slot, slot->first + SECTOR, manifest_piece(manifest, 0) - SECTOR, SECTOR);
    if (!error)
        error = slot_flush(slot);
    if (!error)
        error = write_all(slot, slot->first, SECTOR, 0);
    return error ? error : slot_flush(slot);
}

bool slot_fits(const struct manifest *manifest, unsigned index, const uint8_t *bytes) {
    uint8_t hash[crypto_hash_sha256_BYTES];

    crypto_hash_sha256(hash, bytes, manifest_piece(manifest, index));
    return !memcmp(hash, manifest->hashes[index], sizeof hash);
}

/* Whether the disk has this piece already, compared byte by byte in small steps. */
static bool has(const struct slot *slot, const uint8_t *bytes, size_t size, uint64_t offset) {
    _Alignas(ALIGNED) uint8_t part[64 << 10];

    for (size_t at = 0, step; at < size; at += step) {
        step = size - at < sizeof part ? size - at : sizeof part;
        if (read_all(slot, part, step, offset + at) || memcmp(part, bytes + at, step) != 0)
            return false;
    }
    return true;
}

int slot_put(struct slot *slot, const struct manifest *manifest, unsigned index) {
    const size_t size = manifest_piece(manifest, index);
    const uint64_t offset = (uint64_t)index * MEBIBYTE;

    return has(slot, slot->piece, size, offset) ? 0 : write_all(slot, slot->piece, size, offset);
}

int slot_compare(struct slot *slot, const struct manifest *manifest) {
    for (unsigned i = 0; i < manifest->count; i++) {
        const int error = read_all(slot, slot->piece, manifest_piece(manifest, i), (uint64_t)i * MEBIBYTE);
        if (error)
            return fail(error, "%s: cannot be read: %s", slot->device, strerror(-error));
        if (!slot_fits(manifest, i, slot->piece))
            return fail(-EIO, "%s: MiB %u differs from what was written; the card is worn out", slot->device, i);
    }
    return 0;
}

void slot_close(struct slot *slot) {
    if (slot->fd >= 0)
        close(slot->fd);
    free(slot->piece);
    free(slot->first);
}
