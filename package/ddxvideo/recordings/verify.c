/* SPDX-License-Identifier: GPL-2.0-or-later */
#include "verify.h"

#include <errno.h>
#include <inttypes.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <unistd.h>

#include "bytes.h"
#include "crc32c.h"
#include "program.h"
#include "video_layout.h"

/* ---- Check of the bytes ---- */

/*
 * Checks that a file has exactly the recorded bytes: the first line and each frame match their checksums in the index,
 * and nothing follows the last frame.
 */

static void judge(struct check *check, bool good) {
    if (!good && !check->bad++)
        check->first = check->last = check->frame;
    else if (!good && check->last + 1 == check->frame)
        check->last++;
    check->frame++;
    check->sum = 0;
}

static void take_head(struct check *check, const unsigned char *bytes, size_t size) {
    check->head = crc32c(check->head, bytes, size);
    if (check->position < sizeof check->line) {
        size_t room = sizeof check->line - (size_t)check->position;

        memcpy(check->line + check->position, bytes, size < room ? size : room);
    }
}

/* Check the next bytes of the file. */
static void check_bytes(struct check *check, const unsigned char *bytes, size_t size) {
    while (size && check->frame < check->frames) {
        const struct index_entry *entry = &check->index->entry[check->frame];
        bool inside = check->position >= entry->offset;
        uint64_t end = inside ? entry->offset + entry->bytes : entry->offset;
        size_t part = end - check->position < size ? (size_t)(end - check->position) : size;

        if (inside)
            check->sum = crc32c(check->sum, bytes, part);
        else
            take_head(check, bytes, part);
        bytes += part;
        size -= part;
        check->position += part;
        if (inside && check->position == end)
            judge(check, check->sum == entry->sum);
    }
    check->position += size;
    check->behind += size;
}

/* At the end of the file: count missing frames as bad. */
static void check_end(struct check *check) {
    while (check->frame < check->frames)
        judge(check, false);
}

/* Whether the line, up to the first frame, is a header for pictures of the size of that frame. */
static bool fits(const struct check *check) {
    const struct index_entry *first = &check->index->entry[0];
    struct y4m_header header;
    char line[Y4M_HEADER_MAX], error[Y4M_ERROR_MAX];
    size_t length = (size_t)first->offset;

    if (!length || first->offset > sizeof line || check->line[length - 1] != '\n')
        return false;
    memcpy(line, check->line, length);
    line[length - 1] = 0;
    if (strlen(line) != length - 1 || !y4m_parse_header(line, Y4M_SAME, &header, error) || !y4m_is_plain(&header))
        return false;
    uint64_t picture = video_layout_bytes(&header.geometry);
    return first->bytes > picture && first->bytes - picture < Y4M_FRAME_LINE_WRITTEN;
}

/*
 * Whether the first line is as recorded. An index of an older recorder has no checksum of it: then whether it is a Y4M
 * header for pictures of the size in the index.
 */
static bool check_head(const struct check *check) {
    const struct index_header *header = &check->index->header;

    if (!check->frames)
        return true; /* its length is not known */
    return header->flags & INDEX_HEAD ? check->head == header->head : fits(check);
}

/* ---- Verification ---- */

static int read_index(struct verify *verify, const struct found *found) {
    verify->index = malloc(sizeof *verify->index);
    if (!verify->index)
        return -ENOMEM;
    int error = index_read(verify->index_fd, verify->index);
    if (error)
        return error;
    const struct index_header *header = &verify->index->header;
    verify->check = (struct check){.index = verify->index, .frames = index_count(verify->index, UINT64_MAX)};
    if (header->state != INDEX_RECORDING && verify->check.frames < header->frames) {
        say("%s: its index is damaged: %u of %u frames have their sums", found->shown, verify->check.frames,
            header->frames);
        verify->damaged = true;
    }
    /* The index may have more entries, of frames that were given up when the file was finished. */
    if (header->state != INDEX_RECORDING && verify->check.frames > header->frames)
        verify->check.frames = header->frames;
    const struct index_entry *last = verify->check.frames ? &verify->index->entry[verify->check.frames - 1] : NULL;
    if (found->state >= FOUND_INTERRUPTED) /* the frames in the index by now */
        verify->bytes = last ? last->offset + last->bytes : 0;
    return 0;
}

int verify_open(struct verify *verify, const struct folder *folder, const struct found *found) {
    *verify = (struct verify){.fd = -1, .index_fd = -1, .hold = -1, .bytes = found->bytes, .damaged = found->spoilt};
    int error = found->id ? found_hold(folder, found, &verify->hold) : 0;
    if (found->spoilt)
        say("%s: its index is damaged: no frame has its sum", found->shown);
    if (found->id && !error) {
        verify->index_fd = found_open_index(folder, found);
        error = verify->index_fd < 0 ? verify->index_fd : read_index(verify, found);
    }
    if (!error && verify_is_given_up(verify, found))
        error = -EBUSY;
    if (!error) {
        verify->fd = found_open(folder, found, &verify->direct);
        error = verify->fd < 0 ? verify->fd : 0;
    }
    if (error)
        say("%s: %s", found->shown,
            error == -EBUSY     ? "was given up for a new recording"
            : error == -EBADMSG ? "its index is damaged"
                                : strerror(-error));
    return error;
}

void verify_close(struct verify *verify) {
    free(verify->index);
    if (verify->fd >= 0)
        close(verify->fd);
    if (verify->index_fd >= 0)
        close(verify->index_fd);
    if (verify->hold >= 0)
        close(verify->hold);
}

bool verify_is_given_up(const struct verify *verify, const struct found *found) {
    return found->id && found_is_given_up(verify->index_fd, found);
}

/* Reports bad frames, of which there is at least one. */
static void say_bad(const struct verify *verify, const struct found *found) {
    const struct check *check = &verify->check;
    const struct index_entry *entry = &verify->index->entry[check->first];
    if (check->bad == 1)
        say("%s: frame %u is not what was recorded (number %" PRIu64 " of the item)", found->shown, check->first,
            entry->sequence);
    else if (check->last - check->first + 1 == check->bad)
        say("%s: frames %u to %u are not what was recorded", found->shown, check->first, check->last);
    else
        say("%s: %u frames are not what was recorded, the first is frame %u", found->shown, check->bad, check->first);
}

bool verify_judge(struct verify *verify, const struct found *found) {
    struct check *check = &verify->check;

    if (!verify->index)
        return !verify->damaged;
    check_end(check);
    bool head = check_head(check), behind = check->behind && !verify->damaged;
    if (!head)
        say("%s: its first line, the Y4M header, is not what was recorded", found->shown);
    if (check->bad)
        say_bad(verify, found);
    if (behind)
        say("%s: bytes that were not recorded follow its last frame: %" PRIu64, found->shown, check->behind);
    return head && !check->bad && !behind && !verify->damaged;
}

int verify_bytes(void *to, const unsigned char *bytes, size_t size) {
    struct verify *verify = to;

    if (verify->index)
        check_bytes(&verify->check, bytes, size);
    return 0;
}

bool verify_file(const struct folder *folder, const struct found *found) {
    struct verify verify;
    int error = verify_open(&verify, folder, found);
    bool good = !error;

    if (good)
        error = bytes_read(verify.fd, verify.direct, verify.bytes, verify_bytes, &verify);
    if (good && error != -EINTR && verify_is_given_up(&verify, found))
        error = -EBUSY;
    if (good && error && error != -ENODATA)
        say("%s: %s", found->shown,
            error == -EINTR   ? "not verified, told to stop"
            : error == -EBUSY ? "was given up for a new recording while it was read"
                              : strerror(-error));
    if (!error || error == -ENODATA)
        good = verify_judge(&verify, found);
    good = good && !error && found->state != FOUND_CUT_OFF;
    if (good && found->id)
        printf("%s: good, %u frames\n", found->shown, verify.check.frames);
    else if (good)
        printf("%s: readable, %" PRIu64 " frames; without an index nothing more is known\n", found->shown,
               found->frames);
    else if (found->state == FOUND_CUT_OFF)
        say("%s: after %" PRIu64 " whole frames comes something else", found->shown, found->frames);
    fflush(stdout);
    verify_close(&verify);
    return good;
}
