/* SPDX-License-Identifier: GPL-2.0-or-later */
/* Compressed recordings: pictures, times and stamps come back; files that end anywhere are read and finished. */
#include <errno.h>
#include <fcntl.h>
#include <libavutil/log.h>
#include <sys/stat.h>
#include <unistd.h>

#include "check.h"
#include "clip.h"
#include "h264_encode.h"
#include "mp4_read.h"
#include "mp4_write.h"
#include "stamp.h"
#include "video_layout.h"

#define FRAMES 12
#define KEYS 5 /* frames from one key frame to the next */
#define START INT64_C(1234567890123)

static char path[] = "/tmp/coded-XXXXXX";
static struct mp4_format format;
static struct mp4_entry entries[FRAMES];
static unsigned char *raw[FRAMES];

static struct ddxvideo_geometry geometry_of(int layout, int width, int height) {
    return (struct ddxvideo_geometry){.width = width,
                                      .height = height,
                                      .fields = 2,
                                      .rate_num = 30000,
                                      .rate_den = 1001,
                                      .aspect_num = 12,
                                      .aspect_den = 11,
                                      .format = layout,
                                      .interlacing = 'p',
                                      .range = DDX_VIDEO_RANGE_FULL};
}

/* Uneven, with a ns part. */
static int64_t capture_time(int frame) {
    return START + (int64_t)frame * 33366700 + frame % 3 * 1001;
}

static void make_pictures(const struct ddxvideo_geometry *geometry) {
    size_t bytes = video_layout_bytes(geometry);
    unsigned seed = 7;

    for (int i = 0; i < FRAMES; i++) {
        free(raw[i]);
        raw[i] = malloc(bytes);
        for (size_t at = 0; at < bytes; at++) {
            seed = seed * 1103515245 + 12345;
            raw[i][at] = (unsigned char)((at * 3 + (size_t)i * 11) % 256 + (seed >> 16) % 8);
        }
    }
}

static void add(int fd, const void *bytes, size_t size) {
    CHECK_EQUAL(write(fd, bytes, size), (ssize_t)size);
}

/* Records all pictures as the recorder does; the file is not finished. Returns its size. */
static off_t record(const struct ddxvideo_geometry *geometry, long quality) {
    struct h264_encoder encoder;
    uint8_t head[MP4_BLOCK], nal[STAMP_NAL_MAX], begin[MP4_FRAGMENT];
    int fd = open(path, O_RDWR | O_TRUNC | O_CLOEXEC);
    int64_t before = 0;

    CHECK_EQUAL(h264_encoder_open(&encoder, geometry, &(struct h264_settings){.quality = quality}, &format), 0);
    CHECK(mp4_write_head(head, &format));
    add(fd, head, sizeof head);
    for (int i = 0; i < FRAMES; i++) {
        struct ddxvideo_picture picture = {.geometry = *geometry};
        struct stamp stamp = {.sequence = 100 + (uint64_t)i,
                              .frame = i - 3,
                              .source_sequence = -i,
                              .time = capture_time(i),
                              .wall = i ? capture_time(i) + 5 : 0,
                              .lost_store = (unsigned)i * 0x10000,
                              .lost_ring = 1,
                              .lost_encode = 256,
                              .key = i % KEYS == 0,
                              .geometry = *geometry};
        struct mp4_fragment fragment = {.number = (uint32_t)i + 1,
                                        .time = (uint64_t)(capture_time(i) - START) / 1000,
                                        .duration = format.duration,
                                        .key = stamp.key};
        const uint8_t *data;
        size_t size;

        video_layout_place(&picture, raw[i]);
        CHECK_EQUAL(h264_encode(&encoder, &picture, stamp.key, &data, &size), 0);
        size_t nal_size = stamp_write_nal(nal, &stamp);
        CHECK(size < 2 * video_layout_bytes(geometry) + H264_ROOM);
        fragment.bytes = (uint32_t)(nal_size + size);
        mp4_write_fragment(begin, &fragment);
        add(fd, begin, sizeof begin);
        add(fd, nal, nal_size);
        add(fd, data, size);
        entries[i] = (struct mp4_entry){fragment.bytes,
                                        (uint32_t)((int64_t)fragment.time - before) | (fragment.key ? MP4_KEY : 0)};
        before = (int64_t)fragment.time;
    }
    h264_encoder_close(&encoder);
    off_t size = lseek(fd, 0, SEEK_END);
    close(fd);
    return size;
}

static void finish(void) {
    int fd = open(path, O_RDWR | O_CLOEXEC);

    int64_t bytes = mp4_finish(fd, &format, entries, FRAMES);
    CHECK_EQUAL(bytes, lseek(fd, 0, SEEK_END));
    CHECK(bytes - (int64_t)mp4_end(entries, FRAMES) <= (int64_t)mp4_table_room(FRAMES));
    close(fd);
}

static void check_stamps(void) {
    int fd = open(path, O_RDONLY | O_CLOEXEC);
    struct mp4_file file;
    struct mp4_fragment fragment;
    struct stamp stamp;

    CHECK_EQUAL(mp4_open(&file, fd), 0);
    for (int i = 0; i < FRAMES; i++) {
        CHECK_EQUAL(mp4_next_frame(&file, &fragment), MP4_FRAME);
        uint8_t *data = malloc(fragment.bytes);
        CHECK_EQUAL(pread(fd, data, fragment.bytes, (off_t)(file.at - fragment.bytes)), fragment.bytes);
        CHECK(stamp_read(data, fragment.bytes, &stamp));
        free(data);
        CHECK_EQUAL(stamp.sequence, 100 + i);
        CHECK_EQUAL(stamp.frame, i - 3);
        CHECK_EQUAL(stamp.source_sequence, -i);
        CHECK_EQUAL(stamp.time, capture_time(i));
        CHECK_EQUAL(stamp.wall, i ? capture_time(i) + 5 : 0);
        CHECK_EQUAL(stamp.lost_store, i * 0x10000);
        CHECK_EQUAL(stamp.lost_ring, 1);
        CHECK_EQUAL(stamp.lost_encode, 256);
        CHECK_EQUAL(stamp.key, i % KEYS == 0);
        CHECK_EQUAL(fragment.key, i % KEYS == 0);
        if (stamp.key) {
            CHECK_EQUAL(stamp.geometry.fields, 2);
            CHECK_EQUAL(stamp.geometry.rate_num, 30000);
        }
    }
    CHECK_EQUAL(mp4_next_frame(&file, &fragment), MP4_END);
    close(fd);
}

/* Plays the file; returns its pictures that were decoded. `exact`: they are those that were recorded. */
static int play(const struct ddxvideo_geometry *geometry, bool exact, enum clip_result last) {
    struct clip clip;
    struct ddxvideo_picture picture;
    int64_t time;
    int good = 0;
    enum clip_result result = clip_open(&clip, path, Y4M_SAME);

    CHECK_EQUAL(result, CLIP_OK);
    CHECK(!memcmp(&clip.geometry, geometry, sizeof *geometry));
    CHECK_EQUAL(clip.start, START);
    unsigned char *memory = malloc(video_layout_bytes(geometry));
    picture.geometry = *geometry;
    video_layout_place(&picture, memory);
    for (int i = 0;
         (result = clip_read(&clip, (unsigned char *const *)picture.plane, &time)) == CLIP_OK || result == CLIP_DAMAGED;
         i++) {
        CHECK(i < FRAMES);
        CHECK_EQUAL(time / 1000, (capture_time(i) - START) / 1000);
        if (result == CLIP_DAMAGED)
            continue;
        good++;
        CHECK(!exact || time == capture_time(i) - START);
        CHECK(!exact || !memcmp(memory, raw[i], video_layout_bytes(geometry)));
    }
    CHECK_EQUAL(result, last);
    CHECK(result == CLIP_END || clip.cut);
    CHECK_EQUAL(clip_rewind(&clip), CLIP_OK);
    CHECK_EQUAL(clip_read(&clip, (unsigned char *const *)picture.plane, &time), CLIP_OK);
    CHECK(!exact || !memcmp(memory, raw[0], video_layout_bytes(geometry)));
    clip_close(&clip);
    free(memory);
    return good;
}

static void test_layouts(void) {
    static const int layouts[] = {DDX_VIDEO_420,     DDX_VIDEO_420_JPEG, DDX_VIDEO_420_MPEG2, DDX_VIDEO_420_PALDV,
                                  DDX_VIDEO_YUV422P, DDX_VIDEO_YUV444P,  DDX_VIDEO_GREY8};

    for (size_t i = 0; i < sizeof layouts / sizeof *layouts; i++) {
        struct ddxvideo_geometry geometry = geometry_of(layouts[i], 48 + 2 * (int)i, 36);

        make_pictures(&geometry);
        record(&geometry, 0);
        check_stamps();
        CHECK_EQUAL(play(&geometry, true, CLIP_END), FRAMES);
        finish();
        CHECK_EQUAL(play(&geometry, true, CLIP_END), FRAMES);
        record(&geometry, 30);
        CHECK_EQUAL(play(&geometry, false, CLIP_END), FRAMES);
    }
}

static void test_refusals(void) {
    struct ddxvideo_geometry geometry = geometry_of(DDX_VIDEO_GREY16, 16, 16);

    CHECK(h264_refusal(&geometry));
    geometry.format = DDX_VIDEO_RGB24;
    CHECK(h264_refusal(&geometry));
    geometry = geometry_of(DDX_VIDEO_YUV444P, 17, 16);
    CHECK(h264_refusal(&geometry));
    geometry = geometry_of(DDX_VIDEO_GREY8, 16, 17);
    CHECK(h264_refusal(&geometry));
    geometry = geometry_of(DDX_VIDEO_420, 2, 4); /* the smallest one of two fields */
    CHECK(!h264_refusal(&geometry));
    make_pictures(&geometry);
    record(&geometry, 18);
    CHECK_EQUAL(play(&geometry, false, CLIP_END), FRAMES);
}

static uint8_t *contents(size_t *size) {
    struct stat status;

    CHECK_EQUAL(stat(path, &status), 0);
    *size = (size_t)status.st_size;
    uint8_t *bytes = malloc(*size);
    int fd = open(path, O_RDONLY | O_CLOEXEC);
    CHECK_EQUAL(read(fd, bytes, *size), status.st_size);
    close(fd);
    return bytes;
}

static void put_contents(const uint8_t *bytes, size_t size) {
    int fd = open(path, O_WRONLY | O_TRUNC | O_CLOEXEC);

    add(fd, bytes, size);
    close(fd);
}

/* Finishes the file as the next recorder does. Returns its frames. */
static int64_t recover(void) {
    int fd = open(path, O_RDWR | O_CLOEXEC);
    struct mp4_file file;
    struct mp4_entry *found;
    enum mp4_next last;

    CHECK_EQUAL(mp4_open(&file, fd), 0);
    int64_t count = mp4_entries(&file, &found, &last);
    CHECK(last == MP4_END || last == MP4_CUT);
    if (count && !file.end) {
        CHECK_EQUAL(ftruncate(fd, (off_t)file.at), 0);
        CHECK(mp4_finish(fd, &file.format, found, (uint32_t)count) > 0);
    }
    free(found);
    close(fd);
    return count;
}

/* A file that was left at any byte: its whole frames are played, and the next recorder finishes it. */
static void test_cuts(void) {
    struct ddxvideo_geometry geometry = geometry_of(DDX_VIDEO_420_JPEG, 32, 32);
    size_t size, finished_size, rest;

    make_pictures(&geometry);
    size_t frames_end = (size_t)record(&geometry, 0);
    uint8_t *plain = contents(&size);
    finish();
    uint8_t *finished = contents(&finished_size);
    CHECK(size == frames_end && finished_size > size);
    uint64_t at = MP4_BLOCK;
    for (int i = 0; i < FRAMES; i++) {
        const size_t cuts[] = {(size_t)at, (size_t)at + 1, (size_t)at + MP4_FRAGMENT - 1, (size_t)at + MP4_FRAGMENT,
                               (size_t)at + MP4_FRAGMENT + entries[i].bytes - 1};
        for (size_t j = 0; j < sizeof cuts / sizeof *cuts; j++) {
            put_contents(plain, cuts[j]);
            if (i)
                CHECK_EQUAL(play(&geometry, true, j ? CLIP_BAD : CLIP_END), i);
            CHECK_EQUAL(recover(), i);
            if (i)
                CHECK_EQUAL(play(&geometry, true, CLIP_END), i);
        }
        at += MP4_FRAGMENT + entries[i].bytes;
    }
    /* The end: a part of the table, all of it, and then the 16 bytes. */
    for (size_t end = frames_end; end <= finished_size; end += end + 7 < finished_size ? 7 : 1) {
        put_contents(plain, size);
        int fd = open(path, O_RDWR | O_CLOEXEC);
        CHECK_EQUAL(pwrite(fd, finished + size, end - size, (off_t)size), (ssize_t)(end - size));
        close(fd);
        CHECK_EQUAL(recover(), FRAMES);
        uint8_t *recovered = contents(&rest);
        CHECK_EQUAL(rest, finished_size);
        CHECK(!memcmp(recovered, finished, rest));
        free(recovered);
    }
    put_contents(finished, size - 1); /* a finished file that a copy cut */
    CHECK_EQUAL(play(&geometry, true, CLIP_BAD), FRAMES - 1);
    free(plain);
    free(finished);
}

/* The last frame of a finished file is found through the table; of no other file. */
static void test_last(void) {
    struct ddxvideo_geometry geometry = geometry_of(DDX_VIDEO_420_JPEG, 32, 32);
    struct mp4_file file;
    struct mp4_fragment last;
    size_t size;

    make_pictures(&geometry);
    record(&geometry, 18);
    int fd = open(path, O_RDWR | O_CLOEXEC);
    CHECK_EQUAL(mp4_open(&file, fd), 0);
    CHECK(!mp4_last_frame(&file, &last));
    finish();
    CHECK_EQUAL(mp4_open(&file, fd), 0);
    CHECK(mp4_last_frame(&file, &last));
    CHECK_EQUAL(last.number, FRAMES);
    CHECK_EQUAL(last.bytes, entries[FRAMES - 1].bytes);
    CHECK_EQUAL(last.time, (uint64_t)(capture_time(FRAMES - 1) - START) / 1000);
    free(contents(&size));
    CHECK_EQUAL(ftruncate(fd, (off_t)size - 1), 0); /* a copy cut it */
    CHECK_EQUAL(mp4_open(&file, fd), 0);
    CHECK(!mp4_last_frame(&file, &last));
    close(fd);
}

/* Times are those of the capture as far as a file can express them. */
static void test_times(void) {
    struct mp4_times times = {.begun = false};
    const int64_t s = 1000000000;

    CHECK(!mp4_times_is_gap(&times, INT64_MAX));
    CHECK_EQUAL(mp4_times_next(&times, 5 * s), 0);
    CHECK_EQUAL(mp4_times_next(&times, 5 * s + 40000999), 40000);
    CHECK_EQUAL(mp4_times_next(&times, 5 * s + 40001000), 1);
    CHECK_EQUAL(mp4_times_next(&times, 3 * s), 1); /* the clock went back */
    CHECK_EQUAL(mp4_times_next(&times, 3 * s + 40000000), 40000);
    CHECK(!mp4_times_is_gap(&times, 3 * s + 40000000 + 1800 * s));
    CHECK(mp4_times_is_gap(&times, 3 * s + 40000001 + 1800 * s));
    CHECK_EQUAL(mp4_times_next(&times, 9000 * s), MP4_STEP_MAX);
    CHECK_EQUAL(mp4_times_next(&times, 9000 * s + 40000000), 40000);
    CHECK_EQUAL(mp4_times_next(&times, INT64_MIN), 1); /* no time of a camera, but nothing overflows */
    CHECK_EQUAL(mp4_times_next(&times, INT64_MAX), MP4_STEP_MAX);
    CHECK_EQUAL(times.shown, 40000 + 1 + 1 + 40000 + MP4_STEP_MAX + 40000 + 1 + UINT64_C(1800000000));
}

/* The table names each frame's bytes and its whole duration. */
static void test_table(void) {
    struct mp4_entry few[3] = {{10, MP4_KEY}, {20, 40000}, {30, 40000}};
    static const uint8_t times[] = {0, 0, 0, 24, 's', 't', 't', 's', 0, 0, 0,    0,
                                    0, 0, 0, 2,  0,   0,   0,   2,   0, 0, 0x9c, 0x40};
    static const uint8_t sizes[] = {0, 0, 0, 32, 's', 't', 's', 'z', 0, 0, 0, 0,  0, 0, 0, 0,
                                    0, 0, 0, 3,  0,   0,   0,   10,  0, 0, 0, 20, 0, 0, 0, 30};
    static const uint8_t places[] = {0, 0, 0, 40, 'c', 'o', '6',  '4',  0, 0, 0, 0, 0, 0, 0,    3,
                                     0, 0, 0, 0,  0,   0,   0x10, 0x6c, 0, 0, 0, 0, 0, 0, 0x10, 0xe2};
    size_t size;
    uint8_t *table = mp4_table(&format, few, 3, &size);

    CHECK(table);
    CHECK(memmem(table, size, times + 4, sizeof times - 4));
    CHECK(memmem(table, size, sizes, sizeof sizes));
    CHECK(memmem(table, size, places, sizeof places));
    free(table);
    CHECK(!mp4_table(&format, few, 0, &size));
}

/* Each changed bit of block 0 and of a fragment's begin is noticed. */
static void test_flips(void) {
    struct ddxvideo_geometry geometry = geometry_of(DDX_VIDEO_YUV422P, 32, 32);
    struct mp4_format read;
    struct mp4_fragment fragment, fields;
    uint64_t end;
    size_t size;

    make_pictures(&geometry);
    record(&geometry, 18);
    uint8_t *bytes = contents(&size);
    CHECK(mp4_read_head(bytes, &read, &end) && !end);
    CHECK(read.width == 32 && read.height == 32 && read.chroma == 2 && read.duration == 33366);
    CHECK(read.aspect_num == 12 && read.aspect_den == 11);
    unsigned taken = 0;
    for (size_t i = 0; i < MP4_BLOCK; i++) {
        bytes[i] ^= 0x80;
        taken += mp4_read_head(bytes, &read, &end);
        bytes[i] ^= 0x80;
    }
    /* Numbers that stand in one place only are any number: the parameter sets and the duration. */
    CHECK(taken <= format.sps_size + format.pps_size + 4);
    uint8_t *begin = bytes + MP4_BLOCK;
    CHECK(mp4_read_fragment(begin, &fragment));
    for (size_t i = 0; i < MP4_FRAGMENT; i++) {
        begin[i] ^= 0x80;
        if (mp4_read_fragment(begin, &fields))
            CHECK(memcmp(&fields, &fragment, sizeof fields));
        begin[i] ^= 0x80;
    }
    free(bytes);
}

/* A damaged picture is named, and from the next key frame on pictures are right. */
static void test_damage(void) {
    struct ddxvideo_geometry geometry = geometry_of(DDX_VIDEO_420_JPEG, 64, 64);
    size_t size;

    make_pictures(&geometry);
    record(&geometry, 0);
    uint8_t *bytes = contents(&size);
    uint64_t at = MP4_BLOCK;
    for (int i = 0; i < FRAMES; i++) {
        if (i == 1) /* a NAL unit that is longer than the frame */
            memset(bytes + at + MP4_FRAGMENT, 0xff, 8);
        at += MP4_FRAGMENT + entries[i].bytes;
    }
    put_contents(bytes, size);
    CHECK_EQUAL(play(&geometry, true, CLIP_END), FRAMES - (KEYS - 1));
    /* Any bytes: never a crash, or another number of frames. */
    for (unsigned seed = 1; seed < 60; seed++) {
        free(bytes);
        record(&geometry, 20);
        bytes = contents(&size);
        size_t place = MP4_BLOCK + MP4_FRAGMENT + entries[0].bytes + MP4_FRAGMENT;
        bytes[place + seed * 7919u % entries[1].bytes] ^= (uint8_t)(seed | 1);
        put_contents(bytes, size);
        CHECK(play(&geometry, false, CLIP_END) >= FRAMES - KEYS);
    }
    free(bytes);
}

/* Other programs' files, and no files at all. */
static void test_foreign(void) {
    struct clip clip;
    static const uint8_t other[64] = {0, 0, 0, 32, 'f', 't', 'y', 'p', 'i', 's', 'o', 'm'};

    put_contents(other, sizeof other);
    CHECK_EQUAL(clip_open(&clip, path, Y4M_SAME), CLIP_BAD);
    CHECK(strstr(clip.error, "not one of ddxvideosave") && strstr(clip.error, "ffmpeg"));
    clip_close(&clip);
    CHECK_EQUAL(clip_open(&clip, "/nonexistent", Y4M_SAME), CLIP_BAD);
    clip_close(&clip);
}

int main(void) {
    int fd = mkstemp(path);

    close(fd);
    av_log_set_level(AV_LOG_QUIET);
    test_layouts();
    test_refusals();
    test_cuts();
    test_last();
    test_times();
    test_table();
    test_flips();
    test_damage();
    test_foreign();
    unlink(path);
    for (int i = 0; i < FRAMES; i++)
        free(raw[i]);
    return 0;
}
