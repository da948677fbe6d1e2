/* SPDX-License-Identifier: GPL-2.0-or-later */
#include "recording.h"

#include <errno.h>
#include <stdlib.h>
#include <string.h>
#include <unistd.h>

#include "coded_frames.h"
#include "crc32c.h"
#include "ddx_time.h"
#include "flusher.h"
#include "frame_queue.h"
#include "program.h"
#include "segment.h"
#include "video_layout.h"
#include "y4m.h"

struct recording {
    struct recording_plan plan;
    struct frame_queue queue;
    struct flusher flusher;
    pthread_t thread;
    unsigned turn;    /* number of recordings that write before this one */
    atomic_int error; /* 0 or -errno */
    atomic_bool done; /* the writing thread is done */
    /* of the reading thread: */
    int64_t start;       /* time of the first frame of the current file */
    uint64_t file_bytes; /* of the current file; 0: the next frame begins it */
    uint32_t file_frames;
    bool split;              /* the next frame begins another recording */
    _Atomic uint32_t begins; /* bit N: after the queue's cut N (modulo their number) another recording begins */
    uint64_t lost_store, lost_ring, lost_encode; /* since the last frame that was put */
    struct coded_frames coded;                   /* of MP4 files */
    bool waits;                                  /* for a key frame: a frame that was encoded before is missing */
    bool encoder_failed;                         /* reported; frames are lost */
    uint64_t all_bytes, all_frames;              /* put so far */
    _Atomic uint32_t lost_store_last, lost_ring_last, lost_encode_last; /* after the last one */
    /* of the writing thread: */
    uint32_t session;        /* number of the first segment */
    struct segment *segment; /* NULL: before the first one, or after an error */
    uint64_t position;       /* of the next byte, in the queue's count */
    char path[PATH_MAX];     /* of the current file, or the last one; "" before the first */
    uint32_t sum;            /* checksum of the bytes so far of the frame, or of the file's first line */
};

/* ---- The thread that writes ---- */

#define CHUNK (1u << 20) /* writes end at multiples of this, if enough bytes wait */

static void fail(struct recording *recording, int error) {
    int none = 0;

    atomic_compare_exchange_strong(&recording->error, &none, error);
}

/* The frame's last byte was taken from the queue. */
static void frame_is_out(struct recording *recording, const struct frame_queue_frame *frame) {
    if (recording->error) {
        ddx_stats_lost(recording->plan.book, LOST_WRITE, 1);
    } else {
        segment_add(recording->segment, frame, recording->sum);
    }
    recording->sum = 0;
    frame_queue_drop_oldest(&recording->queue);
    ddx_stats_write(recording->plan.book);
}

/* The last byte before the file's first frame was taken. */
static void head_is_out(struct recording *recording) {
    if (recording->segment)
        recording->segment->head = recording->sum;
    recording->sum = 0;
}

/* Assigns bytes that were written, or given up, to their frames. */
static void account(struct recording *recording, const unsigned char *bytes, size_t size) {
    struct frame_queue_frame frame;

    while (size && frame_queue_oldest(&recording->queue, &frame)) {
        bool inside = recording->position >= frame.begin;
        uint64_t left = (inside ? frame.end : frame.begin) - recording->position;
        size_t part = left < size ? (size_t)left : size;

        if (recording->plan.pool)
            recording->sum = crc32c(recording->sum, bytes, part);
        bytes += part;
        size -= part;
        recording->position += part;
        if (!inside && recording->position == frame.begin)
            head_is_out(recording);
        if (recording->position == frame.end)
            frame_is_out(recording, &frame);
    }
}

static void begin_file(struct recording *recording) {
    struct segment *segment;
    const struct ddxvideo_geometry *geometry = &recording->plan.geometry;
    int error = segment_open(recording->plan.output, recording->plan.pool, recording->plan.book,
                             recording->plan.h264 ? &recording->coded.format : NULL, recording->session, &segment);

    if (error) {
        fail(recording, error);
        return;
    }
    if (!*recording->path)
        say("recording %s, %dx%d, to %s", recording->plan.output->name, geometry->width, geometry->height,
            segment->path);
    strcpy(recording->path, segment->path);
    if (recording->plan.pool)
        recording->session = segment->index->header.session;
    segment->begin = recording->position;
    flusher_add(&recording->flusher, segment);
    recording->segment = segment;
}

/* One file ends and another one begins. The flusher must get the new one first: otherwise it would give the old one its
 * name, and the recording would look finished until the new one is on the disk. */
static void change_file(struct recording *recording) {
    struct segment *before = recording->segment;
    uint32_t bit = 1u << recording->queue.cuts_taken % FRAME_QUEUE_CUTS;

    if (recording->begins & bit) {
        recording->begins &= ~bit;
        recording->session = 0; /* the next file has its own */
    }
    recording->position = frame_queue_next_file(&recording->queue);
    recording->segment = NULL;
    if (!recording->error)
        begin_file(recording);
    if (before)
        flusher_close_segment(&recording->flusher, before);
}

/* The previous recording may still be opening its first file, on a disk that hangs. */
static void wait_for_turn(struct recording *recording) {
    struct recording_turn *turn = recording->plan.turn;

    pthread_mutex_lock(&turn->lock);
    while (turn->written < recording->turn)
        pthread_cond_wait(&turn->changed, &turn->lock);
    pthread_mutex_unlock(&turn->lock);
}

void recording_end_turn(struct recording_turn *turn) {
    pthread_mutex_lock(&turn->lock);
    turn->written++;
    pthread_cond_broadcast(&turn->changed);
    pthread_mutex_unlock(&turn->lock);
}

/* The writing thread; the argument is the recording, whose queue begins with a cut. */
static void *recording_write(void *argument) {
    struct recording *recording = argument;
    const unsigned char *bytes;
    size_t size, limit = CHUNK;
    enum frame_queue_next next;

    program_thread_signals();
    wait_for_turn(recording);
    while ((next = frame_queue_peek(&recording->queue, &bytes, &size, limit)) != FRAME_QUEUE_END) {
        if (next == FRAME_QUEUE_CUT) {
            change_file(recording);
            limit = CHUNK;
            continue;
        }
        if (!recording->error) { /* otherwise the queue is only emptied, so that each frame is counted */
            ssize_t done = segment_write(recording->segment, bytes, size);
            if (done < 0)
                fail(recording, (int)done);
            else
                size = (size_t)done;
            limit = CHUNK - (size_t)(recording->segment->written % CHUNK);
        }
        account(recording, bytes, size);
        frame_queue_take(&recording->queue, size);
    }
    if (recording->segment) {
        recording->segment->lost_store = recording->lost_store_last;
        recording->segment->lost_ring = recording->lost_ring_last;
        recording->segment->lost_encode = recording->lost_encode_last;
        flusher_close_segment(&recording->flusher, recording->segment);
        recording->segment = NULL;
    }
    recording_end_turn(recording->plan.turn);
    flusher_stop(&recording->flusher);
    recording->done = true;
    return NULL;
}

/* ---- The thread that reads ---- */

#define QUEUE_FRAMES 64
#define QUEUE_BYTES_MAX (UINT64_C(256) << 20)
#define QUEUE_FRAMES_MIN 8

static uint64_t memory_share(void) {
    return (uint64_t)sysconf(_SC_PHYS_PAGES) * (uint64_t)sysconf(_SC_PAGESIZE) / 4;
}

uint64_t recording_queue_bytes_max(void) {
    return memory_share() < QUEUE_BYTES_MAX ? memory_share() : QUEUE_BYTES_MAX;
}

bool recording_same_header(const struct ddxvideo_geometry *a, const struct ddxvideo_geometry *b) {
    return ddxvideo_same_layout(a, b) && a->rate_num == b->rate_num && a->rate_den == b->rate_den &&
           a->aspect_num == b->aspect_num && a->aspect_den == b->aspect_den;
}

uint64_t recording_frame_memory(const struct ddxvideo_geometry *geometry) {
    return video_layout_bytes(geometry) + Y4M_FRAME_LINE_WRITTEN + sizeof(struct frame_queue_frame);
}

/* 2.5 s. */
static uint64_t usual_frames(const struct ddxvideo_geometry *geometry) {
    if (!ddxvideo_rate_known(geometry->rate_num, geometry->rate_den))
        return QUEUE_FRAMES;
    uint64_t num = (uint64_t)geometry->rate_num, den = (uint64_t)geometry->rate_den;
    uint64_t frames = (UINT64_C(5) * num / 2 + den - 1) / den;
    return frames > QUEUE_FRAMES ? frames : QUEUE_FRAMES;
}

unsigned recording_queue_frames(const struct ddxvideo_geometry *geometry, unsigned asked) {
    uint64_t frames = asked ? asked : usual_frames(geometry);
    uint64_t fits = (asked ? memory_share() : recording_queue_bytes_max()) / recording_frame_memory(geometry);
    uint64_t least = asked && asked < QUEUE_FRAMES_MIN ? asked : QUEUE_FRAMES_MIN;

    if (fits < frames)
        frames = fits;
    return (unsigned)(frames < least ? least : frames);
}

/* ---- Begin and end ---- */

#define CODED_BYTES_MAX (UINT64_C(64) << 20)
#define CODED_FRAMES_MIN 4 /* raw ones: two of them must be free for each frame */
#define CODED_LEAST 2048   /* bytes of a frame, for the length of the list */
#define CODED_LIST_MAX 8192

size_t recording_coded_memory(const struct ddxvideo_geometry *geometry, unsigned queue_frames, unsigned *list) {
    uint64_t raw = video_layout_bytes(geometry) + Y4M_FRAME_LINE_WRITTEN;
    uint64_t memory = queue_frames * raw, least = CODED_FRAMES_MIN * raw;

    if (memory > CODED_BYTES_MAX)
        memory = CODED_BYTES_MAX;
    if (memory < least)
        memory = least;
    memory += MP4_BLOCK + 2 * H264_ROOM;
    uint64_t frames = memory / CODED_LEAST;
    if (frames > CODED_LIST_MAX)
        frames = CODED_LIST_MAX;
    if (frames < queue_frames)
        frames = queue_frames;
    *list = (unsigned)frames;
    return (size_t)memory;
}

/* The encoder, and a queue with the memory of the usual one, within bounds, and a longer list of frames. */
static int begin_coded(struct recording *recording) {
    const struct recording_plan *plan = &recording->plan;
    unsigned list;
    size_t memory = recording_coded_memory(&plan->geometry, plan->queue_frames, &list);
    int error = 0;

    recording->waits = true;
    if (plan->coded) {
        recording->coded = *plan->coded;
        *plan->coded = (struct coded_frames){.number = 0};
    } else {
        error = coded_frames_open(&recording->coded, &plan->geometry, plan->h264);
    }
    return error ? error : frame_queue_init(&recording->queue, list, memory / list + 1);
}

/* Bytes of a file with a frame of `raw` bytes, at most. */
static uint64_t least_file(const struct recording_plan *plan, size_t raw) {
    return plan->h264 ? coded_frames_room(&plan->geometry) + mp4_table_room(1) : raw + Y4M_HEADER_WRITTEN;
}

/*
 * A power cut loses what came after the last flush. An encoded frame comes late, by the time of its encoding, but there
 * is little to write: so the flush comes earlier, and no more is lost than of Y4M.
 */
static int64_t flush_period(const struct recording_plan *plan) {
    int64_t period = plan->pool ? SECOND / 2 : SECOND * 3 / 4;

    return plan->h264 ? period / 2 : period;
}

int recording_begin(const struct recording_plan *plan, struct recording **result) {
    struct recording *recording = calloc(1, sizeof *recording);

    if (!recording)
        return -ENOMEM;
    recording->plan = *plan;
    recording->turn = plan->turn->begun;
    recording->lost_store = plan->lost_store;
    recording->lost_ring = plan->lost_ring;
    size_t bytes = video_layout_bytes(&plan->geometry) + Y4M_FRAME_LINE_WRITTEN;
    int error = plan->h264 ? begin_coded(recording) : frame_queue_init(&recording->queue, plan->queue_frames, bytes);
    if (error)
        goto no_queue;
    error = plan->pool && least_file(plan, bytes) > pool_file_bytes(plan->pool) ? -EFBIG : 0;
    if (!error)
        error = flusher_start(&recording->flusher, flush_period(plan), &recording->error);
    if (error)
        goto no_flusher;
    frame_queue_cut(&recording->queue); /* a file begins: the writing thread opens it, and may wait for the disk */
    error = -pthread_create(&recording->thread, NULL, recording_write, recording);
    if (error)
        goto no_thread;
    plan->turn->begun++;
    *result = recording;
    return 0;

no_thread:
    flusher_stop(&recording->flusher);
no_flusher:
    frame_queue_free(&recording->queue);
no_queue:
    coded_frames_close(&recording->coded);
    free(recording);
    return error;
}

void recording_close(struct recording *recording) {
    recording->lost_store_last = (uint32_t)recording->lost_store;
    recording->lost_ring_last = (uint32_t)recording->lost_ring;
    recording->lost_encode_last = (uint32_t)recording->lost_encode;
    frame_queue_close(&recording->queue);
}

bool recording_is_on_disk(const struct recording *recording) {
    return recording->done;
}

int recording_finish(struct recording *recording, char *path) {
    recording_close(recording);
    pthread_join(recording->thread, NULL);
    int error = recording->error;
    strcpy(path, recording->path);
    coded_frames_close(&recording->coded);
    frame_queue_free(&recording->queue);
    free(recording);
    return error;
}

/* ---- Frame by frame ---- */

int64_t recording_time(const struct ddxvideo_picture *view, int64_t published) {
    return view->stamp.time ? view->stamp.time : published;
}

/* Whether the current file has no space for a frame of that many bytes at most, its table included. */
static bool is_full(const struct recording *recording, size_t bytes) {
    size_t table = recording->plan.h264 ? mp4_table_room(recording->file_frames + 1) : 0;

    return recording->file_bytes + bytes + table > pool_file_bytes(recording->plan.pool) ||
           recording->file_frames >= INDEX_ENTRIES;
}

/* Ends the file before the next frame. False if the queue has no room for the end. */
static bool end_file(struct recording *recording) {
    _Static_assert(FRAME_QUEUE_CUTS == 32, "each has a bit");
    uint32_t bit = 1u << recording->queue.cuts_put % FRAME_QUEUE_CUTS;
    if (recording->split)
        recording->begins |= bit; /* before the writing thread can see the cut */
    if (!frame_queue_cut(&recording->queue)) {
        if (recording->split)
            recording->begins &= ~bit;
        return false;
    }
    recording->split = false;
    recording->file_bytes = recording->file_frames = 0;
    if (recording->plan.h264)
        coded_frames_next_file(&recording->coded);
    return true;
}

/*
 * In a pool: ends the file if the next frame, of that many bytes at most and captured then, does not fit into it, or
 * begins another recording. False if the frame cannot be put: the queue has no room for the end of a file, or the frame
 * is no key frame, with which the next file could begin.
 */
static bool choose_pool_file(struct recording *recording, size_t bytes, int64_t time, bool key) {
    bool must = is_full(recording, bytes) || (recording->plan.h264 && coded_frames_is_gap(&recording->coded, time));

    if (!recording->file_bytes || (!must && !recording->split))
        return true;
    return (key && end_file(recording)) || !must;
}

static bool refuse(struct recording *recording) {
    ddx_stats_lost(recording->plan.book, LOST_RING, 1);
    recording->lost_ring++;
    return false;
}

static struct frame_queue_facts facts_of(const struct recording *recording, const struct ddxvideo_picture *view,
                                         const struct recording_frame *frame) {
    struct frame_queue_facts facts = {.published = frame->published,
                                      .time = recording_time(view, frame->published),
                                      .sequence = frame->sequence,
                                      .frame = view->stamp.frame,
                                      .lost_store = (unsigned)recording->lost_store,
                                      .lost_ring = (unsigned)recording->lost_ring,
                                      .lost_encode = (unsigned)recording->lost_encode};

    if (view->stamp.wall_offset && __builtin_add_overflow(facts.time, view->stamp.wall_offset, &facts.wall))
        facts.wall = 0;
    return facts;
}

static void is_put(struct recording *recording, size_t bytes) {
    recording->file_bytes += bytes;
    recording->file_frames++;
    recording->all_bytes += bytes;
    recording->all_frames++;
    recording->lost_store = recording->lost_ring = recording->lost_encode = 0;
}

/* ---- Into MP4 ---- */

bool recording_is_gap(const struct recording *recording, const struct ddxvideo_picture *view,
                      const struct recording_frame *frame) {
    return recording->plan.h264 && !recording->plan.pool &&
           coded_frames_is_gap(&recording->coded, recording_time(view, frame->published));
}

static void encoder_failed(struct recording *recording, int frame) {
    if (!recording->encoder_failed)
        say("losing frames from %d on: the encoder failed", frame);
    recording->encoder_failed = true;
    ddx_stats_lost(recording->plan.book, LOST_ENCODE, 1);
    recording->lost_encode++;
}

/* A frame that was encoded before is refused: later ones refer to it, up to the next key frame. */
static bool refuse_coded(struct recording *recording, const struct recording_frame *frame) {
    if (frame->encoded) {
        recording->waits = true;
        coded_frames_need_key(&recording->coded);
    }
    return refuse(recording);
}

/* Whether file and queue have room for it. */
static bool fits(struct recording *recording, const struct recording_frame *frame, int64_t time) {
    const struct recording_encoded *encoded = frame->encoded;
    size_t room = coded_frames_room(&recording->plan.geometry);
    size_t bytes = encoded ? encoded->picture.size + CODED_EXTRA + MP4_BLOCK : room;
    bool key = !encoded || encoded->picture.key;

    return (key || !recording->waits) &&
           (!recording->plan.pool || choose_pool_file(recording, encoded ? encoded->bytes : room, time, key)) &&
           frame_queue_has_room(&recording->queue, bytes);
}

/* Encodes the picture, unless that was done. False: the encoder failed. */
static bool encode(struct recording *recording, const struct ddxvideo_picture *view,
                   const struct recording_frame *frame, int64_t time, struct coded_picture *coded) {
    unsigned level = frame_queue_level(&recording->queue);

    if (frame->encoded) {
        *coded = frame->encoded->picture;
        return true;
    }
    recording->plan.load->coarse += coded_frames_give_way(&recording->coded, frame->late > level ? frame->late : level);
    int64_t begin = encode_load_now();
    int error = coded_frames_encode(&recording->coded, view, time, coded);
    recording->plan.load->spent += (uint64_t)(encode_load_now() - begin);
    return !error;
}

/* The queue must have room for any frame before it is encoded: later frames refer to each that was. */
static bool put_coded(struct recording *recording, const struct ddxvideo_picture *view,
                      const struct recording_frame *frame) {
    struct frame_queue_facts facts = facts_of(recording, view, frame);
    struct stamp stamp = {.sequence = facts.sequence,
                          .frame = facts.frame,
                          .source_sequence = view->stamp.source_sequence,
                          .time = facts.time,
                          .wall = facts.wall,
                          .lost_store = facts.lost_store,
                          .lost_ring = facts.lost_ring,
                          .lost_encode = (uint32_t)recording->lost_encode};
    struct coded_picture picture;
    struct coded_frame coded;

    if (!fits(recording, frame, facts.time))
        return refuse_coded(recording, frame);
    if (!encode(recording, view, frame, facts.time, &picture)) {
        encoder_failed(recording, facts.frame);
        return true;
    }
    recording->encoder_failed = recording->waits = false;
    coded_frames_add(&recording->coded, &picture, &stamp, &coded);
    facts.header = (unsigned)coded.piece[0].iov_len;
    facts.step = coded.step;
    frame_queue_put(&recording->queue, coded.piece, CODED_PIECES, &facts); /* has room */
    is_put(recording, coded.bytes);
    return true;
}

/* ---- Into Y4M ---- */

static bool put_plain(struct recording *recording, const struct ddxvideo_picture *view,
                      const struct recording_frame *frame) {
    char header[Y4M_HEADER_WRITTEN], line[Y4M_FRAME_LINE_WRITTEN];
    size_t bytes = video_layout_bytes(&recording->plan.geometry) + sizeof line;

    if (recording->plan.pool && !choose_pool_file(recording, bytes, 0, true))
        return refuse(recording);
    struct frame_queue_facts facts = facts_of(recording, view, frame);
    bool first = !recording->file_bytes;
    if (first) {
        recording->start = facts.time;
        facts.header = (unsigned)y4m_write_header(header, &recording->plan.geometry);
    }
    int64_t time;
    if (__builtin_sub_overflow(facts.time, recording->start, &time) || time < 0)
        time = 0; /* the source's clock went back, which a Y4M file cannot express */
    size_t length = y4m_write_frame(line, time < Y4M_TIME_MAX ? time : Y4M_TIME_MAX, first ? facts.time : 0,
                                    first ? facts.wall : 0);
    struct iovec pieces[5] = {{header, facts.header}, {line, length}};
    size_t total = facts.header + length;
    int count = 2;
    for (int i = 0; i < 3 && view->rows[i]; i++) {
        pieces[count] =
            (struct iovec){(void *)(uintptr_t)view->plane[i], (size_t)view->stride[i] * (size_t)view->rows[i]};
        total += pieces[count++].iov_len;
    }
    if (!frame_queue_put(&recording->queue, pieces, count, &facts))
        return refuse(recording);
    is_put(recording, total);
    return true;
}

bool recording_put(struct recording *recording, const struct ddxvideo_picture *view,
                   const struct recording_frame *frame) {
    recording->lost_store += frame->missed;
    return recording->plan.h264 ? put_coded(recording, view, frame) : put_plain(recording, view, frame);
}

void recording_split(struct recording *recording) {
    recording->split = recording->file_bytes > 0;
}

void recording_missed(struct recording *recording, uint64_t frames) {
    recording->lost_store += frames;
}

/* ---- State ---- */

const struct ddxvideo_geometry *recording_geometry(const struct recording *recording) {
    return &recording->plan.geometry;
}

unsigned recording_frame_bytes(const struct recording *recording) {
    return (unsigned)(recording->all_frames ? recording->all_bytes / recording->all_frames
                                            : video_layout_bytes(&recording->plan.geometry));
}

uint64_t recording_queue_bytes(const struct recording *recording) {
    return recording->queue.size + recording->queue.frame_limit * sizeof *recording->queue.frames;
}

unsigned recording_level(struct recording *recording) {
    return frame_queue_level(&recording->queue);
}

int recording_error(const struct recording *recording) {
    return recording->error;
}
