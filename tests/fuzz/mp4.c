/* SPDX-License-Identifier: GPL-2.0-or-later */
/* Fuzz target: an MP4 recording, its frames and their stamps; and finishing it, as after a kill. */
#include <assert.h>
#include <stdlib.h>
#include <sys/mman.h>
#include <sys/stat.h>
#include <unistd.h>

#include "mp4_read.h"
#include "stamp.h"

#define FRAMES_MAX 64

int LLVMFuzzerTestOneInput(const uint8_t *data, size_t size);

static void read_frames(struct mp4_file *file) {
    struct mp4_fragment fragment;
    struct stamp stamp;

    for (int i = 0; i < FRAMES_MAX && mp4_next_frame(file, &fragment) == MP4_FRAME; i++) {
        assert(file->at <= file->size && fragment.bytes <= file->at - MP4_BLOCK);
        uint8_t *frame = malloc(fragment.bytes); /* of its exact size, for the sanitizer */
        ssize_t got = pread(file->fd, frame, fragment.bytes, (off_t)(file->at - fragment.bytes));
        assert(got == (ssize_t)fragment.bytes);
        if (stamp_read(frame, fragment.bytes, &stamp) && stamp.key)
            assert(!ddxvideo_geometry_error(&stamp.geometry));
        free(frame);
    }
}

/* A recovered file has all whole frames, and is finished. */
static void recover(struct mp4_file *file) {
    struct mp4_entry *entries;
    enum mp4_next last;
    int64_t count = mp4_entries(file, &entries, &last);

    if (count > 0 && !file->end && !ftruncate(file->fd, (off_t)file->at)) {
        struct mp4_file again;
        struct mp4_fragment fragment;
        uint64_t end = file->at;

        assert(mp4_finish(file->fd, &file->format, entries, (uint32_t)count) > 0);
        assert(!mp4_open(&again, file->fd) && again.end == end);
        assert(mp4_last_frame(&again, &fragment) && fragment.number == count);
        struct mp4_entry *same;
        assert(mp4_entries(&again, &same, &last) == count && last == MP4_END);
        free(same);
    }
    free(entries);
}

int LLVMFuzzerTestOneInput(const uint8_t *data, size_t size) {
    struct mp4_file file;
    int fd = memfd_create("mp4", MFD_CLOEXEC);

    if (fd < 0 || write(fd, data, size) != (ssize_t)size)
        abort();
    if (!mp4_open(&file, fd)) {
        read_frames(&file);
        recover(&file);
    }
    close(fd);
    return 0;
}
