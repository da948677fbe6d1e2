/* SPDX-License-Identifier: GPL-2.0-or-later */
#include "package.h"

#include <errno.h>
#include <string.h>
#include <sys/stat.h>
#include <unistd.h>

#include "place.h"
#include "ustar.h"

enum { END_BLOCKS = 2, LAST_BLOCKS = 20 /* of an archive: tar pads to 10 KiB */ };

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
static int read_all(int fd, void *buffer, size_t size, int status) {
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
    const int status = read_all(fd, block, sizeof block, 2);

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
    const int failed = read_all(fd, padding, ustar_padding(size), status);

    return failed                                   ? failed
           : all_zero(padding, ustar_padding(size)) ? 0
                                                    : fail(status, "this is no update file: no zeros between members");
}

/* A small member as a whole. */
static int read_member(int fd, const char *name, uint64_t most, char *text, size_t *size) {
    uint64_t found;
    int status = member(fd, name, most, &found);

    if (!status)
        status = read_all(fd, text, found, 2);
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

int package_begin(int fd, const struct update_key *keys, unsigned count, struct manifest *manifest) {
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

int package_piece(int fd, const struct manifest *manifest, unsigned index, uint8_t *bytes) {
    return read_all(fd, bytes, manifest_piece(manifest, index), 1);
}

int package_end(int fd, const struct manifest *manifest) {
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
