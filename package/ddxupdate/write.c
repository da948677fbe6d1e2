/* SPDX-License-Identifier: GPL-2.0-or-later */
/*
 * Writes an update into the slot that does not run. The order of writes leaves, at any power cut, a chosen slot that is
 * whole: first the running slot becomes the chosen one; then the other one loses its begin, so that the boot loader
 * finds no kernel there; its begin is written last, and only `start` chooses it.
 */
#include <errno.h>
#include <fcntl.h>
#include <inttypes.h>
#include <sodium.h>
#include <stdbool.h>
#include <stdint.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <sys/stat.h>
#include <unistd.h>

#include "decide.h"
#include "manifest.h"
#include "pace.h"
#include "place.h"
#include "signature.h"
#include "state.h"
#include "ustar.h"

/* An update file is read from a stream: an archive of `manifest`, `manifest.minisig` and `root`. */

enum { END_BLOCKS = 2, LAST_BLOCKS = END_BLOCKS + 19 /* of an archive: after both, tar pads it to 20 blocks */ };

/* The bytes that could be read before the file's end; less than 0: -errno. */
static ssize_t read_some(int fd, void *buffer, size_t size) {
    size_t at = 0;

    while (at < size) {
        const ssize_t done = read(fd, (char *)buffer + at, size - at);
        if (done < 0 && errno != EINTR)
            return -errno;
        if (!done)
            break;
        at += done > 0 ? (size_t)done : 0;
    }
    return (ssize_t)at;
}

/* 0, or `status` after a line: the file ends here. */
static int read_whole(int fd, void *buffer, size_t size, int status) {
    const ssize_t done = read_some(fd, buffer, size);

    if (done < 0)
        return fail(1, "the update file cannot be read: %s", strerror((int)-done));
    return done == (ssize_t)size ? 0 : fail(status, "the update file is cut short");
}

static bool all_zero(const uint8_t *bytes, size_t size) {
    for (size_t i = 0; i < size; i++)
        if (bytes[i])
            return false;
    return true;
}

/* The header of the member that must come now, with 1 to `most` bytes. */
static int member(int fd, const char *name, uint64_t most, uint64_t *size) {
    uint8_t block[USTAR_BLOCK];
    struct ustar_member found;
    const int status = read_whole(fd, block, sizeof block, 2);

    if (status)
        return status;
    if (!ustar_parse(block, &found) || strcmp(found.name, name) != 0)
        return fail(2, "this is no update file: its member '%s' is not where it should be", name);
    if (!found.size || found.size > most)
        return fail(2, "this is no update file: its member '%s' has a wrong length", name);
    *size = found.size;
    return 0;
}

static int read_padding(int fd, uint64_t size, int status) {
    uint8_t padding[USTAR_BLOCK];
    const int failed = read_whole(fd, padding, ustar_padding(size), status);

    return failed                                   ? failed
           : all_zero(padding, ustar_padding(size)) ? 0
                                                    : fail(status, "this is no update file: no zeros between members");
}

/* A small member as a whole. */
static int read_member(int fd, const char *name, uint64_t most, char *text, size_t *size) {
    uint64_t found;
    int status = member(fd, name, most, &found);

    if (!status)
        status = read_whole(fd, text, found, 2);
    if (!status)
        status = read_padding(fd, found, 2);
    *size = status ? 0 : (size_t)found;
    return status;
}

static int check_signature(const char *text, size_t size, const char *minisig, size_t minisig_size,
                           const struct update_key *keys, unsigned count) {
    struct signature signature;
    const char *wrong = signature_parse(minisig, minisig_size, &signature);

    if (wrong)
        return fail(2, "the signature %s", wrong);
    for (unsigned i = 0; i < count; i++)
        if (!memcmp(signature.id, keys[i].id, KEY_ID))
            return signature_fits(&signature, &keys[i], text, size)
                       ? 0
                       : fail(2, "the signature is wrong: the file was changed after it was signed");
    return fail(2, "the file is signed with a key that this image does not trust");
}

/*
 * Read up to the begin of `root`: check the signature over the raw manifest, then parse it. Returns the exit status: 0;
 * 2 after a line, the file is refused; 1, it cannot be read.
 */
static int package_begin(int fd, const struct update_key *keys, unsigned count, struct manifest *manifest) {
    char text[MANIFEST_MAX], minisig[SIGNATURE_MAX];
    size_t size, minisig_size;
    uint64_t root;
    struct stat file;
    int status = read_member(fd, "manifest", sizeof text, text, &size);

    if (!status)
        status = read_member(fd, "manifest.minisig", sizeof minisig, minisig, &minisig_size);
    if (!status)
        status = check_signature(text, size, minisig, minisig_size, keys, count);
    if (status)
        return status;
    const char *wrong = manifest_parse(text, size, manifest);
    if (wrong)
        return fail(2, "the manifest is not of a version that this image can read: %s", wrong);
    status = member(fd, "root", UINT64_MAX, &root);
    if (status)
        return status;
    if (root != manifest->size)
        return fail(2, "this is no update file: its member 'root' has a wrong length");
    /* From a file, it is known now whether there is enough; from a pipe, only at its end. */
    const off_t at = lseek(fd, 0, SEEK_CUR);
    if (at >= 0 && !fstat(fd, &file) && S_ISREG(file.st_mode) && (uint64_t)(file.st_size - at) < manifest->size)
        return fail(2, "the update file is cut short");
    return 0;
}

/* Read the next piece of `root`. 0, or 1 after a line. */
static int package_piece(int fd, const struct manifest *manifest, unsigned index, uint8_t *bytes) {
    return read_whole(fd, bytes, manifest_piece(manifest, index), 1);
}

/* After the last piece: only the archive's end may follow. 0, or 1 after a line. */
static int package_end(int fd, const struct manifest *manifest) {
    uint8_t blocks[LAST_BLOCKS * USTAR_BLOCK + 1];
    const int status = read_padding(fd, manifest->size, 1);

    if (status)
        return status;
    const ssize_t size = read_some(fd, blocks, sizeof blocks);
    if (size < 0)
        return fail(1, "the update file cannot be read: %s", strerror((int)-size));
    if (size < END_BLOCKS * USTAR_BLOCK || size == (ssize_t)sizeof blocks || !all_zero(blocks, (size_t)size))
        return fail(1, "the update file does not end after its member 'root'");
    return 0;
}

/*
 * The contents of the slot that does not run. The first MiB is zeros while the rest is written: the boot loader then
 * finds no kernel there, and boots the other slot. The first sector alone decides that, since it is written whole or
 * not at all. Reads and writes bypass the page cache, so that what is read back comes from the disk.
 */
struct slot {
    const char *device;
    int fd;
    uint64_t size;
    uint8_t *piece,
        *first;         /* memory of 1 MiB each, for O_DIRECT: any piece, and the first one, which is written last */
    struct pace *pace;  /* between writes; NULL: none */
    unsigned unflushed; /* bytes written since the last flush */
};

enum {
    ALIGNED = 4096,
    SECTOR = 512,      /* is written whole or not at all, also when the power fails */
    WRITE = 256 << 10, /* bytes of a write: a recorder's write waits for one of these at most */
    FLUSH = 4 << 20,   /* bytes between two flushes */
};

static void slot_close(struct slot *slot) {
    if (slot->fd >= 0)
        close(slot->fd);
    free(slot->piece);
    free(slot->first);
}

/* 0, or -errno after a line: -EBUSY, it is mounted. */
static int slot_open(struct slot *slot, const char *device) {
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

/* Write zeros over the first MiB, its first sector before the others, and flush. */
static int slot_clear(struct slot *slot) {
    const size_t size = slot->size < MEBIBYTE ? (size_t)slot->size : MEBIBYTE;

    memset(slot->piece, 0, MEBIBYTE);
    int error = write_all(slot, slot->piece, SECTOR, 0);
    if (!error)
        error = slot_flush(slot);
    if (!error)
        error = write_all(slot, slot->piece + SECTOR, size - SECTOR, SECTOR);
    return error ? error : slot_flush(slot);
}

/* After all others, write the first piece, slot->first, its first sector after the others; flush. */
static int slot_finish(struct slot *slot, const struct manifest *manifest) {
    int error = slot_flush(slot);

    if (!error)
        error = write_all(slot, slot->first + SECTOR, manifest_piece(manifest, 0) - SECTOR, SECTOR);
    if (!error)
        error = slot_flush(slot);
    if (!error)
        error = write_all(slot, slot->first, SECTOR, 0);
    return error ? error : slot_flush(slot);
}

/* Whether these bytes are the piece. */
static bool slot_fits(const struct manifest *manifest, unsigned index, const uint8_t *bytes) {
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

/* Write slot->piece, which is not the first one, unless the disk has it. Flushes every 4 MiB. */
static int slot_put(struct slot *slot, const struct manifest *manifest, unsigned index) {
    const size_t size = manifest_piece(manifest, index);
    const uint64_t offset = (uint64_t)index * MEBIBYTE;

    return has(slot, slot->piece, size, offset) ? 0 : write_all(slot, slot->piece, size, offset);
}

/* Read all pieces back; 0, -EIO after a line: a piece differs, or another error. */
static int slot_compare(struct slot *slot, const struct manifest *manifest) {
    for (unsigned i = 0; i < manifest->count; i++) {
        const int error = read_all(slot, slot->piece, manifest_piece(manifest, i), (uint64_t)i * MEBIBYTE);
        if (error)
            return fail(error, "%s: cannot be read: %s", slot->device, strerror(-error));
        if (!slot_fits(manifest, i, slot->piece))
            return fail(-EIO, "%s: MiB %u differs from what was written; the card is worn out", slot->device, i);
    }
    return 0;
}

/* The running slot becomes the chosen one, also if the block is lost later. */
static int stay_here(const struct request *request, struct block *block) {
    const struct place *place = &request->place;

    state_prove(place->state, place->here);
    if (block->slot == place->here)
        return 0;
    block->slot = place->here;
    block->left = 0;
    block->begun = 0;
    return choose_write(request, block);
}

static int write_pieces(struct slot *slot, const struct manifest *manifest) {
    if (slot_clear(slot))
        return 1;
    for (unsigned i = 0; i < manifest->count; i++) {
        uint8_t *bytes = i ? slot->piece : slot->first;
        if (package_piece(STDIN_FILENO, manifest, i, bytes))
            return 1;
        if (!slot_fits(manifest, i, bytes))
            return fail(1, "MiB %u of the update file is not the one that was signed", i);
        if (i && slot_put(slot, manifest, i))
            return 1;
    }
    if (package_end(STDIN_FILENO, manifest) || slot_finish(slot, manifest))
        return 1;
    if (!slot_compare(slot, manifest))
        return 0;
    slot_clear(slot);
    return 1;
}

static int write_slot(const struct request *request, struct block *block, const struct manifest *manifest, char other) {
    struct pace pace = {0};
    struct slot slot;

    if (slot_open(&slot, request->slots[other - 'A']))
        return 1;
    slot.pace = &pace;
    int status = manifest->size > slot.size ? fail(2, "version %s is too large for slot %c", manifest->version, other)
                                            : stay_here(request, block);
    if (!status)
        status = write_pieces(&slot, manifest);
    slot_close(&slot);
    return status;
}

int command_write(const struct request *request) {
    static struct manifest manifest;
    const struct place *place = &request->place;
    struct update_key keys[KEYS_MAX];
    struct release running;
    struct block block;
    int status = check_machine(place);

    if (status)
        return status;
    if (sodium_init() < 0)
        return fail(1, "no cryptography");
    if (!release_read(place->release, &running))
        return fail(1, "%s: names no board or no version", place->release);
    const unsigned count = keys_read(place->keys, keys);
    if (!count)
        return fail(2, "this image has no key that an update could be signed with; flash the card instead");
    status = choose_read(request, &block);
    if (!status)
        status = check_no_trial(place, &block);
    if (!status)
        status = package_begin(STDIN_FILENO, keys, count, &manifest);
    if (status)
        return status;
    struct release new = {.layout = manifest.layout, .serial = manifest.serial};
    snprintf(new.board, sizeof new.board, "%s", manifest.board);
    snprintf(new.version, sizeof new.version, "%s", manifest.version);
    status = check_version(place, &running, &new, request->older);
    const char other = block_other(place->here);
    if (!status)
        status = write_slot(request, &block, &manifest, other);
    if (!status)
        printf("slot %c: version %s; `ddxctl update start` restarts into it\n", other, manifest.version);
    return status;
}
