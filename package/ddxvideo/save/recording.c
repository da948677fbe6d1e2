/* SPDX-License-Identifier: GPL-2.0-or-later */
#include "recording.h"

#include <errno.h>
#include <fcntl.h>
#include <stdatomic.h>
#include <stdlib.h>
#include <string.h>
#include <sys/stat.h>
#include <unistd.h>

#include "program.h"
#include "ring.h"
#include "y4m.h"

#define CHUNK (1u << 20) /* writes end at multiples of this, when so much is waiting */
#define SYNC_NS INT64_C(1000000000)
#define RING_FRAMES 64
#define RING_BYTES_MAX (UINT64_C(256) << 20)
#define RING_FRAMES_MIN 8

struct recording {
    struct ring ring;
    pthread_t thread;
    DDX_STATS_BOOK *book;
    struct ddxvideo_geometry geometry;
    int64_t start;    /* time of the first frame */
    bool begun;       /* which has been put into the ring */
    atomic_int error; /* 0 or -errno */
    /* of the writing thread: */
    int fd;
    bool regular;      /* a file that can be cut and synced, not a pipe or device */
    uint64_t written;  /* bytes */
    uint64_t whole;    /* bytes up to the end of the last whole frame */
    uint64_t synced;   /* bytes for which writing to disk has been started */
    int64_t sync_time; /* of the last fdatasync() */
    char path[PATH_MAX];
};

static size_t picture_bytes(const struct ddxvideo_geometry *geometry) {
    return (size_t)geometry->width * (size_t)geometry->height / 2 * 3;
}

unsigned recording_ring_frames(const struct ddxvideo_geometry *geometry) {
    uint64_t frames = RING_FRAMES, bytes = RING_BYTES_MAX;
    if (geometry->rate_num && geometry->rate_den) {
        uint64_t wanted = (UINT64_C(5) * (uint64_t)geometry->rate_num / 2 + (uint64_t)geometry->rate_den - 1) /
                          (uint64_t)geometry->rate_den;
        if (wanted > frames)
            frames = wanted;
    }
    uint64_t memory = (uint64_t)sysconf(_SC_PHYS_PAGES) * (uint64_t)sysconf(_SC_PAGESIZE) / 4;
    if (memory < bytes)
        bytes = memory;
    uint64_t fits = bytes / picture_bytes(geometry);
    if (fits < frames)
        frames = fits;
    return frames < RING_FRAMES_MIN ? RING_FRAMES_MIN : (unsigned)frames;
}

/* ---- The writing thread ---- */

/* Tell the book about the frames whose last byte was taken from the ring. */
static void account(struct recording *recording) {
    struct ring_frame frame;
    while (ring_next_frame(&recording->ring, &frame)) {
        if (recording->error) {
            ddx_stats_lost(recording->book, LOST_WRITE, 1);
        } else {
            recording->whole = frame.end;
            ddx_stats_out(recording->book, 1, ddx_time_now() - frame.stamp);
        }
    }
    ddx_stats_write(recording->book);
}

/* The disk failed: cut the file behind its last whole frame. A frame that is half there is not recorded. */
static void give_up(struct recording *recording, int error) {
    recording->error = error;
    if (!recording->regular)
        return;
    if (!recording->whole)
        unlink(recording->path); /* not one frame: an empty file would only be in the way */
    else if (ftruncate(recording->fd, (off_t)recording->whole))
        say("%s: cannot be cut behind its last whole frame: %s", recording->path, strerror(errno));
}

/* Have the disk work steadily instead of in bursts, and lose at most a second in a power cut. */
static int sync_file(struct recording *recording) {
    if (!recording->regular)
        return 0;
    if (recording->written - recording->synced >= CHUNK) {
        sync_file_range(recording->fd, (off_t)recording->synced, (off_t)(recording->written - recording->synced),
                        SYNC_FILE_RANGE_WRITE);
        recording->synced = recording->written;
    }
    int64_t now = ddx_time_now();
    if (now - recording->sync_time < SYNC_NS)
        return 0;
    recording->sync_time = now;
    return fdatasync(recording->fd) ? -errno : 0;
}

static void *write_file(void *argument) {
    struct recording *recording = argument;
    const unsigned char *bytes;
    size_t size;
    program_thread_signals();
    while ((size = ring_peek(&recording->ring, &bytes, CHUNK - (size_t)(recording->written % CHUNK)))) {
        if (!recording->error) { /* else the ring is emptied, so that every frame is accounted for */
            ssize_t done = write(recording->fd, bytes, size);
            if (done < 0 && errno == EINTR)
                continue;
            if (done < 0)
                give_up(recording, -errno);
            else
                size = (size_t)done;
        }
        ring_take(&recording->ring, size);
        recording->written += size;
        account(recording);
        int error = recording->error ? 0 : sync_file(recording);
        if (error)
            give_up(recording, error);
    }
    if (!recording->error && recording->regular && fdatasync(recording->fd))
        give_up(recording, -errno);
    return NULL;
}

/* ---- The reading thread ---- */

/* When the first frame was captured; an item without times (the paper's seven fields) has only the time of the
 * write. */
static int64_t capture_time(const struct ddxvideo_picture *view, int64_t published) {
    return view->stamp.time ? view->stamp.time : published;
}

int recording_begin(const struct output *output, const struct ddxvideo_picture *first, int64_t published,
                    unsigned ring_frames, DDX_STATS_BOOK *book, struct recording **result) {
    struct recording *recording = calloc(1, sizeof(*recording));
    if (!recording)
        return -ENOMEM;
    recording->book = book;
    recording->geometry = first->geometry;
    recording->start = capture_time(first, published);
    recording->sync_time = ddx_time_now();
    int error = ring_init(&recording->ring, ring_frames, picture_bytes(&first->geometry) + Y4M_FRAME_LINE_WRITTEN);
    if (error)
        goto no_ring;
    recording->fd = error = output_open(output, recording->path);
    if (error < 0)
        goto no_file;
    struct stat status;
    recording->regular = !fstat(recording->fd, &status) && S_ISREG(status.st_mode);
    char line[Y4M_HEADER_WRITTEN];
    ring_put_bytes(&recording->ring, line, y4m_write_header(line, &recording->geometry));
    error = -pthread_create(&recording->thread, NULL, write_file, recording);
    if (error)
        goto no_thread;
    *result = recording;
    return 0;

no_thread:
    close(recording->fd);
no_file:
    ring_free(&recording->ring);
no_ring:
    free(recording);
    return error;
}

bool recording_put(struct recording *recording, const struct ddxvideo_picture *view, int64_t published) {
    char line[Y4M_FRAME_LINE_WRITTEN];
    struct iovec pieces[4] = {{line, 0}};
    int64_t time;
    if (__builtin_sub_overflow(capture_time(view, published), recording->start, &time) || time < 0)
        time = 0; /* the source's clock went back: nothing that a Y4M file can say */
    int64_t start = 0, wall = 0;
    if (!recording->begun) {
        start = recording->start;
        if (view->stamp.wall_offset && __builtin_add_overflow(start, view->stamp.wall_offset, &wall))
            wall = 0;
    }
    pieces[0].iov_len = y4m_write_frame(line, time < Y4M_TIME_MAX ? time : Y4M_TIME_MAX, start, wall);
    for (int i = 0; i < 3; i++)
        pieces[i + 1] =
            (struct iovec){(void *)(uintptr_t)view->plane[i], (size_t)view->stride[i] * (size_t)view->rows[i]};
    if (ring_put(&recording->ring, pieces, 4, published)) {
        recording->begun = true;
        return true;
    }
    ddx_stats_lost(recording->book, LOST_RING, 1);
    return false;
}

const struct ddxvideo_geometry *recording_geometry(const struct recording *recording) {
    return &recording->geometry;
}

const char *recording_path(const struct recording *recording) {
    return recording->path;
}

int recording_error(const struct recording *recording) {
    return recording->error;
}

void recording_close(struct recording *recording) {
    ring_close(&recording->ring);
}

int recording_finish(struct recording *recording) {
    recording_close(recording);
    pthread_join(recording->thread, NULL);
    int error = recording->error;
    if (close(recording->fd) && !error)
        error = -errno;
    ring_free(&recording->ring);
    free(recording);
    return error;
}
