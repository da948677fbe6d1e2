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
#include "index_mp4.h"
#include "mp4_read.h"
#include "program.h"
#include "video_layout.h"

/* ---- Check of the bytes ---- */

/*
 * Checks that a file has exactly the recorded bytes: those before the first frame and each frame match their checksums
 * in the index, and nothing follows the last frame but an MP4 file's table, which follows from them.
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
    if (check->position < sizeof check->begin) {
        size_t room = sizeof check->begin - (size_t)check->position;

        memcpy(check->begin + check->position, bytes, size < room ? size : room);
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
    check->tail = crc32c(check->tail, bytes, size);
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

    if (!length || first->offset > sizeof line || check->begin[length - 1] != '\n')
        return false;
    memcpy(line, check->begin, length);
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

/* ---- Of an MP4 file ---- */

/* Whether block 0 is as recorded, except for the 16 bytes that change at the end; *end: where they say the table is. */
static bool check_block(const struct check *check, struct mp4_format *format, uint64_t *end) {
    uint8_t first[MP4_BLOCK];

    return mp4_read_head(check->begin, format, end) && mp4_write_head(first, format) &&
           check->index->entry[0].offset == MP4_BLOCK && crc32c(0, first, sizeof first) == check->index->header.head;
}

static bool is_table(const struct check *check, const struct mp4_format *format) {
    size_t size;
    struct mp4_entry *entries = index_mp4_entries(check->index, check->frames);
    uint8_t *table = entries ? mp4_table(format, entries, check->frames, &size) : NULL;
    bool same = table && size == check->behind && crc32c(0, table, size) == check->tail;

    free(table);
    free(entries);
    return same;
}

/* All but the frames; prints a line for each error. `finished`: the file was read up to its end. */
static bool judge_mp4(const struct check *check, const char *shown, bool finished) {
    const struct index_entry *last = &check->index->entry[check->frames - 1];
    uint64_t frames_end = last->offset + last->bytes, end;
    struct mp4_format format;

    if (!check_block(check, &format, &end) || (finished && end && end != frames_end)) {
        say("%s: its first block, the MP4 header, is not what was recorded", shown);
        return false;
    }
    if (!finished)
        return true;
    if (check->index->header.bytes > frames_end || end) { /* it was finished with a table */
        bool good = end && is_table(check, &format);

        if (!good)
            say("%s: its table, by which players seek, is not what was recorded", shown);
        return good;
    }
    say("%s: has no table, so players cannot seek in it: an older recorder finished it, or there was no room", shown);
    if (check->behind)
        say("%s: bytes that were not recorded follow its last frame: %" PRIu64, shown, check->behind);
    return !check->behind;
}

/* ---- Verification ---- */

static int read_index(struct verify *verify, const struct found *found) {
    verify->index = malloc(sizeof *verify->index);
    if (!verify->index)
        return -ENOMEM;
    int error = index_read(verify->use.index_fd, verify->index);
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
    *verify = (struct verify){.bytes = found->bytes, .damaged = found->spoilt};
    if (found->spoilt)
        say("%s: its index is damaged: no frame has its sum", found->shown);
    int error = found_open(folder, found, &verify->use);
    if (!error && found->id)
        error = read_index(verify, found);
    if (!error && found_is_given_up(&verify->use, found))
        error = -EBUSY;
    if (error)
        say("%s: %s", found->shown,
            error == -EBUSY     ? "was given up for a new recording"
            : error == -EBADMSG ? "its index is damaged"
                                : strerror(-error));
    return error;
}

void verify_close(struct verify *verify) {
    free(verify->index);
    found_close(&verify->use);
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
    if (check->index->header.format == INDEX_MP4 && check->frames) {
        bool good = judge_mp4(check, found->shown, found->state < FOUND_INTERRUPTED && !verify->damaged);

        if (check->bad)
            say_bad(verify, found);
        return good && !check->bad && !verify->damaged;
    }
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
        error = bytes_read(verify.use.fd, verify.use.direct, verify.bytes, verify_bytes, &verify);
    if (good && error != -EINTR && found_is_given_up(&verify.use, found))
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
