/* SPDX-License-Identifier: GPL-2.0-or-later */
#include "mp4_write.h"

#include <errno.h>
#include <stdlib.h>
#include <string.h>
#include <unistd.h>

#include "bits.h"

#define SCALE 1000000 /* units of time a second */
#define TRACK 1
#define KEY_FLAGS UINT32_C(0x02000000)   /* depends on no other frame */
#define OTHER_FLAGS UINT32_C(0x01010000) /* depends on others, is no key frame */

/* Bytes in order. Without memory they are only counted. */
struct out {
    uint8_t *to;
    size_t at;
};

static void bytes(struct out *out, const void *from, size_t size) {
    if (out->to)
        memcpy(out->to + out->at, from, size);
    out->at += size;
}

static void zeros(struct out *out, size_t size) {
    if (out->to)
        memset(out->to + out->at, 0, size);
    out->at += size;
}

static void u8(struct out *out, unsigned value) {
    const uint8_t one = (uint8_t)value;

    bytes(out, &one, 1);
}

static void u16(struct out *out, unsigned value) {
    uint8_t two[2];

    put16(two, (uint16_t)value);
    bytes(out, two, sizeof two);
}

static void u32(struct out *out, uint32_t value) {
    uint8_t four[4];

    put32(four, value);
    bytes(out, four, sizeof four);
}

static void u64(struct out *out, uint64_t value) {
    uint8_t eight[8];

    put64(eight, value);
    bytes(out, eight, sizeof eight);
}

/* Begins a box; its size follows with end(). */
static size_t begin(struct out *out, const char type[4]) {
    size_t at = out->at;

    u32(out, 0);
    bytes(out, type, 4);
    return at;
}

static size_t begin_full(struct out *out, const char type[4], unsigned version, uint32_t flags) {
    size_t at = begin(out, type);

    u32(out, version << 24 | flags);
    return at;
}

static void end(struct out *out, size_t begin) {
    if (out->to)
        put32(out->to + begin, (uint32_t)(out->at - begin));
}

static void matrix(struct out *out) {
    static const uint32_t unity[9] = {0x10000, 0, 0, 0, 0x10000, 0, 0, 0, 0x40000000};

    for (int i = 0; i < 9; i++)
        u32(out, unity[i]);
}

/* Width on the screen of pictures whose pixels are not square. */
static uint32_t shown_width(const struct mp4_format *format) {
    uint64_t width = (uint64_t)format->width << 16;

    if (format->aspect_num > 0 && format->aspect_den > 0)
        width = width * (unsigned)format->aspect_num / (unsigned)format->aspect_den;
    return width < UINT32_MAX ? (uint32_t)width : UINT32_MAX;
}

/* ---- The description of the pictures ---- */

static void decoder_record(struct out *out, const struct mp4_format *format) {
    size_t box = begin(out, "avcC");

    u8(out, 1);
    bytes(out, format->sps + 1, 3); /* profile, compatibility, level */
    u8(out, 0xfc | 3);              /* lengths of NAL units have 4 bytes */
    u8(out, 0xe0 | 1);
    u16(out, (unsigned)format->sps_size);
    bytes(out, format->sps, format->sps_size);
    u8(out, 1);
    u16(out, (unsigned)format->pps_size);
    bytes(out, format->pps, format->pps_size);
    if (!mp4_is_simple(format->sps[1])) {
        u8(out, 0xfcu | (unsigned)format->chroma);
        u8(out, 0xf8); /* 8 bits */
        u8(out, 0xf8);
        u8(out, 0);
    }
    end(out, box);
}

static void sample_description(struct out *out, const struct mp4_format *format) {
    size_t stsd = begin_full(out, "stsd", 0, 0);
    u32(out, 1);
    size_t avc1 = begin(out, "avc1");
    zeros(out, 6);
    u16(out, 1);
    zeros(out, 16);
    u16(out, (unsigned)format->width);
    u16(out, (unsigned)format->height);
    u32(out, 72u << 16); /* dots an inch */
    u32(out, 72u << 16);
    u32(out, 0);
    u16(out, 1); /* a frame in each sample */
    zeros(out, 32);
    u16(out, 24);
    u16(out, 0xffff);
    decoder_record(out, format);
    if (format->aspect_num > 0 && format->aspect_den > 0) {
        size_t pasp = begin(out, "pasp");

        u32(out, (uint32_t)format->aspect_num);
        u32(out, (uint32_t)format->aspect_den);
        end(out, pasp);
    }
    end(out, avc1);
    end(out, stsd);
}

/* ---- The places and times of frames ---- */

static uint32_t step_of(const struct mp4_entry *entry) {
    return entry->step & ~MP4_KEY;
}

/* How long frame `at` is shown. */
static uint32_t duration_of(const struct mp4_format *format, const struct mp4_entry *entries, uint32_t count,
                            uint32_t at) {
    return at + 1 < count ? step_of(&entries[at + 1]) : format->duration;
}

static void durations(struct out *out, const struct mp4_format *format, const struct mp4_entry *entries,
                      uint32_t count) {
    size_t box = begin_full(out, "stts", 0, 0), place = out->at;
    uint32_t runs = 0;

    u32(out, 0);
    for (uint32_t at = 0, next; at < count; at = next, runs++) {
        uint32_t duration = duration_of(format, entries, count, at);

        for (next = at + 1; next < count && duration_of(format, entries, count, next) == duration;)
            next++;
        u32(out, next - at);
        u32(out, duration);
    }
    if (out->to)
        put32(out->to + place, runs);
    end(out, box);
}

static void key_frames(struct out *out, const struct mp4_entry *entries, uint32_t count) {
    size_t box = begin_full(out, "stss", 0, 0), place = out->at;
    uint32_t keys = 0;

    u32(out, 0);
    for (uint32_t at = 0; at < count; at++) {
        if (!(entries[at].step & MP4_KEY))
            continue;
        u32(out, at + 1);
        keys++;
    }
    if (out->to)
        put32(out->to + place, keys);
    end(out, box);
}

static void places(struct out *out, const struct mp4_entry *entries, uint32_t count) {
    size_t box = begin_full(out, "stsc", 0, 0);
    u32(out, count ? 1 : 0);
    if (count) { /* from the first chunk on, a frame in each */
        u32(out, 1);
        u32(out, 1);
        u32(out, 1);
    }
    end(out, box);
    box = begin_full(out, "stsz", 0, 0);
    u32(out, 0);
    u32(out, count);
    for (uint32_t at = 0; at < count; at++)
        u32(out, entries[at].bytes);
    end(out, box);
    box = begin_full(out, "co64", 0, 0);
    u32(out, count);
    uint64_t place = MP4_BLOCK;
    for (uint32_t at = 0; at < count; at++) {
        u64(out, place + MP4_FRAGMENT);
        place += MP4_FRAGMENT + entries[at].bytes;
    }
    end(out, box);
}

/* ---- The film ---- */

static void film_header(struct out *out, uint64_t duration) {
    size_t box = begin_full(out, "mvhd", 1, 0);

    zeros(out, 16); /* no dates: a robot's clock may be wrong, and the SEI has the time of each frame */
    u32(out, SCALE);
    u64(out, duration);
    u32(out, 0x10000); /* rate, */
    u16(out, 0x100);   /* volume: as usual */
    zeros(out, 10);
    matrix(out);
    zeros(out, 24);
    u32(out, TRACK + 1);
    end(out, box);
}

static void track_header(struct out *out, const struct mp4_format *format, uint64_t duration) {
    size_t box = begin_full(out, "tkhd", 1, 3); /* enabled, part of the film */

    zeros(out, 16);
    u32(out, TRACK);
    u32(out, 0);
    u64(out, duration);
    zeros(out, 16);
    matrix(out);
    u32(out, shown_width(format));
    u32(out, (uint32_t)format->height << 16);
    end(out, box);
}

static void media_headers(struct out *out, uint64_t duration) {
    size_t box = begin_full(out, "mdhd", 1, 0);
    zeros(out, 16);
    u32(out, SCALE);
    u64(out, duration);
    u16(out, 0x55c4); /* no language */
    u16(out, 0);
    end(out, box);
    box = begin_full(out, "hdlr", 0, 0);
    u32(out, 0);
    bytes(out, "vide", 4);
    zeros(out, 12);
    bytes(out, "ddxvideosave", sizeof "ddxvideosave");
    end(out, box);
}

static void media_place(struct out *out) {
    size_t box = begin_full(out, "vmhd", 0, 1);
    zeros(out, 8);
    end(out, box);
    size_t dinf = begin(out, "dinf"), dref = begin_full(out, "dref", 0, 0);
    u32(out, 1);
    box = begin_full(out, "url ", 0, 1); /* in this file */
    end(out, box);
    end(out, dref);
    end(out, dinf);
}

/* Of an unfinished file without frames, and with room for fragments. */
static void film(struct out *out, const struct mp4_format *format, const struct mp4_entry *entries, uint32_t count) {
    uint64_t duration = count ? format->duration : 0;

    for (uint32_t at = 1; at < count; at++)
        duration += step_of(&entries[at]);
    size_t moov = begin(out, "moov");
    film_header(out, duration);
    size_t trak = begin(out, "trak");
    track_header(out, format, duration);
    size_t mdia = begin(out, "mdia");
    media_headers(out, duration);
    size_t minf = begin(out, "minf");
    media_place(out);
    size_t stbl = begin(out, "stbl");
    sample_description(out, format);
    durations(out, format, entries, count);
    if (count)
        key_frames(out, entries, count);
    places(out, entries, count);
    end(out, stbl);
    end(out, minf);
    end(out, mdia);
    end(out, trak);
    if (!count) {
        size_t mvex = begin(out, "mvex"), trex = begin_full(out, "trex", 0, 0);

        u32(out, TRACK);
        u32(out, 1);
        u32(out, format->duration);
        u32(out, 0);
        u32(out, OTHER_FLAGS);
        end(out, trex);
        end(out, mvex);
    }
    end(out, moov);
}

bool mp4_write_head(uint8_t block[MP4_BLOCK], const struct mp4_format *format) {
    struct out out = {.to = block};

    if (format->sps_size < 4 || format->sps_size > MP4_SET_MAX || !format->pps_size || format->pps_size > MP4_SET_MAX)
        return false;
    size_t box = begin(&out, "ftyp");
    bytes(&out, "isom", 4);
    u32(&out, 0x200);
    bytes(&out, "isomiso5avc1mp41", 16);
    end(&out, box);
    box = begin(&out, "free");
    zeros(&out, MP4_COVER - 8);
    end(&out, box);
    film(&out, format, NULL, 0);
    box = begin(&out, "free");
    zeros(&out, MP4_BLOCK - out.at);
    end(&out, box);
    return true;
}

void mp4_write_fragment(uint8_t to[MP4_FRAGMENT], const struct mp4_fragment *fragment) {
    struct out out = {.to = to};
    size_t moof = begin(&out, "moof"), box = begin_full(&out, "mfhd", 0, 0);

    u32(&out, fragment->number);
    end(&out, box);
    size_t traf = begin(&out, "traf");
    box = begin_full(&out, "tfhd", 0, 0x020000); /* places count from this moof on */
    u32(&out, TRACK);
    end(&out, box);
    box = begin_full(&out, "tfdt", 1, 0);
    u64(&out, fragment->time);
    end(&out, box);
    box = begin_full(&out, "trun", 0, 0x701); /* with place, duration, size and flags */
    u32(&out, 1);
    u32(&out, MP4_FRAGMENT);
    u32(&out, fragment->duration);
    u32(&out, fragment->bytes);
    u32(&out, fragment->key ? KEY_FLAGS : OTHER_FLAGS);
    end(&out, box);
    end(&out, traf);
    end(&out, moof);
    u32(&out, fragment->bytes + 8);
    bytes(&out, "mdat", 4);
}

uint8_t *mp4_table(const struct mp4_format *format, const struct mp4_entry *entries, uint32_t count, size_t *size) {
    struct out out = {.to = NULL};

    if (!count || count > UINT32_MAX / 32)
        return NULL;
    film(&out, format, entries, count);
    out.to = malloc(out.at);
    *size = out.at;
    out.at = 0;
    if (out.to)
        film(&out, format, entries, count);
    return out.to;
}

void mp4_write_cover(uint8_t to[MP4_COVER], uint64_t end) {
    put32(to, 1); /* the size follows */
    memcpy(to + 4, "mdat", 4);
    put64(to + 8, end - MP4_COVER_AT);
}

static int write_all(int fd, const uint8_t *from, size_t size, uint64_t at) {
    while (size) {
        ssize_t done = pwrite(fd, from, size, (off_t)at);

        if (done < 0 && errno == EINTR)
            continue;
        if (done <= 0)
            return done ? -errno : -EIO;
        from += done;
        size -= (size_t)done;
        at += (uint64_t)done;
    }
    return 0;
}

uint64_t mp4_end(const struct mp4_entry *entries, uint32_t count) {
    uint64_t at = MP4_BLOCK;

    for (uint32_t i = 0; i < count; i++)
        at += MP4_FRAGMENT + (uint64_t)entries[i].bytes;
    return at;
}

int64_t mp4_finish(int fd, const struct mp4_format *format, const struct mp4_entry *entries, uint32_t count) {
    uint8_t cover[MP4_COVER];
    uint64_t at = mp4_end(entries, count);
    size_t size;
    uint8_t *table = mp4_table(format, entries, count, &size);

    if (!table)
        return -ENOMEM;
    int error = write_all(fd, table, size, at);
    free(table);
    if (!error && fdatasync(fd))
        error = -errno;
    mp4_write_cover(cover, at);
    if (!error)
        error = write_all(fd, cover, sizeof cover, MP4_COVER_AT);
    if (!error && fdatasync(fd))
        error = -errno;
    return error ? error : (int64_t)(at + size);
}

#define GAP_NS ((int64_t)MP4_STEP_MAX * 1000)

int64_t mp4_between(int64_t from, int64_t to) {
    int64_t result;

    return __builtin_sub_overflow(to, from, &result) ? (to > from ? INT64_MAX : INT64_MIN) : result;
}

bool mp4_times_is_gap(const struct mp4_times *times, int64_t time) {
    return times->begun && mp4_between(times->last, time) > GAP_NS;
}

uint32_t mp4_times_next(struct mp4_times *times, int64_t time) {
    uint64_t before = times->shown, shown;

    times->last = time;
    if (!times->begun) {
        *times = (struct mp4_times){.begun = true, .base = time, .last = time};
        return 0;
    }
    int64_t us = mp4_between(times->base, time) / 1000;
    shown = us < 0 ? 0 : (uint64_t)us;
    if (shown <= before || shown - before > MP4_STEP_MAX) {
        shown = before + (shown > before ? MP4_STEP_MAX : 1);
        if (__builtin_sub_overflow(time, (int64_t)shown * 1000, &times->base))
            times->base = time > 0 ? INT64_MAX : INT64_MIN;
    }
    times->shown = shown;
    return (uint32_t)(shown - before);
}
