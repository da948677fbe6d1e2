/* SPDX-License-Identifier: GPL-2.0-or-later */
/* The sender's encoders: each picture gives a frame at once, of the requested size, and a renewal on demand. */
#include "encoder.h"

#include "check.h"
#include "payload.h"

#define WIDTH 352
#define HEIGHT 288
#define RATE 25
#define BITRATE 200000
#define BYTES (BITRATE / 8 / RATE)
#define PICTURES 300
#define WAVE (WIDTH / 16) /* pictures in which all columns are renewed */

enum { SLICE = 1, SLICE_IDR = 5, SEI = 6 };
enum { SEI_TEXT = 5, SEI_RECOVERY = 6 }; /* ISO 14496-10, D.1.1 */

static uint8_t planes[WIDTH * HEIGHT * 3 / 2];

/* A texture that moves, with a little noise: each frame has something new everywhere. */
static struct ddxvideo_picture draw(int number) {
    struct ddxvideo_picture picture = {.geometry = {.width = WIDTH, .height = HEIGHT}};
    unsigned seed = (unsigned)number;

    for (int y = 0; y < HEIGHT; y++)
        for (int x = 0; x < WIDTH; x++) {
            int wave = ((x + 2 * number) % 64 - 32) * ((y + number) % 48 - 24) / 8;
            seed = seed * 1664525u + 1013904223u;
            planes[y * WIDTH + x] = (uint8_t)(128 + wave / 2 + (int)(seed >> 29));
        }
    memset(planes + WIDTH * HEIGHT, 128, WIDTH * HEIGHT / 2);
    picture.plane[0] = planes;
    picture.plane[1] = planes + WIDTH * HEIGHT;
    picture.plane[2] = picture.plane[1] + WIDTH * HEIGHT / 4;
    picture.stride[0] = WIDTH;
    picture.stride[1] = picture.stride[2] = WIDTH / 2;
    return picture;
}

static void open_at(struct encoder *encoder, enum rtp_type type, bool fast, int rate) {
    const struct encoder_settings settings = {.type = type, .bitrate = BITRATE, .fast = fast};
    const struct ddxvideo_geometry geometry = {.width = WIDTH, .height = HEIGHT, .rate_num = rate, .rate_den = 1};
    CHECK_EQUAL(encoder_open(encoder, &settings, &geometry), 0);
    CHECK(encoder_is_open(encoder));
}

static void open_encoder(struct encoder *encoder, enum rtp_type type, bool fast) {
    open_at(encoder, type, fast, RATE);
}

static struct encoded encode(struct encoder *encoder, int number, size_t wanted) {
    const struct ddxvideo_picture picture = draw(number);
    struct encoded encoded = {0};
    CHECK_EQUAL(encoder_encode(encoder, &picture, wanted, &encoded), 0);
    CHECK(encoded.size > 0);
    return encoded;
}

/* The parts of an H.264 frame. */
struct parts {
    unsigned sets, slices, keys, recoveries, texts;
};

static struct parts look_at(const struct encoded *encoded) {
    struct parts parts = {0};
    struct h264_nal nal;
    for (const uint8_t *at = encoded->data; h264_next_nal(&at, encoded->data + encoded->size, &nal);) {
        int type = nal.data[0] & 31;
        parts.sets += type == H264_SPS || type == H264_PPS;
        parts.slices += type == SLICE || type == SLICE_IDR;
        parts.keys += type == SLICE_IDR;
        parts.recoveries += type == SEI && nal.data[1] == SEI_RECOVERY;
        parts.texts += type == SEI && nal.data[1] == SEI_TEXT;
    }
    return parts;
}

/* One slice a frame, parameter sets each second, one key frame, renewals as asked for, no text. */
static void test_h264_frames(bool fast) {
    struct encoder encoder;
    int sets_at = 0, recoveries = 0;
    open_encoder(&encoder, RTP_H264, fast);
    for (int i = 0; i < PICTURES; i++) {
        if (i && i % (4 * RATE) == 0)
            encoder_refresh(&encoder, false);
        struct encoded encoded = encode(&encoder, i, 0);
        struct parts parts = look_at(&encoded);
        CHECK_EQUAL(parts.slices, 1);
        CHECK_EQUAL(parts.texts, 0);
        CHECK_EQUAL(parts.keys, !i);
        CHECK(parts.sets == 0 || parts.sets == 2);
        sets_at = parts.sets ? i : sets_at;
        CHECK(i - sets_at < RATE);
        CHECK(parts.sets || !parts.recoveries);
        recoveries += parts.recoveries > 0;
    }
    CHECK_EQUAL(recoveries, (PICTURES - 1) / (4 * RATE));
    encoder_close(&encoder);
    CHECK(!encoder_is_open(&encoder));
}

/* Number of frames within 30 % of the requested size; *mean: of all sizes over all requests. */
static unsigned follow(enum rtp_type type, size_t (*wish)(int), double *mean) {
    struct encoder encoder;
    double wanted = 0, found = 0;
    unsigned near = 0;
    open_encoder(&encoder, type, false);
    for (int i = 0; i < PICTURES; i++) {
        size_t now = wish(i), size = encode(&encoder, i, now).size;
        wanted += (double)now;
        found += (double)size;
        near += size * 10 > now * 7 && size * 10 < now * 13;
    }
    *mean = found / wanted;
    encoder_close(&encoder);
    return near;
}

static size_t steady(int number) {
    (void)number;
    return BYTES;
}

static size_t steps(int number) {
    return number / RATE % 2 ? BYTES : BYTES * 2 / 5;
}

static size_t dips(int number) {
    return number % 50 < 5 ? BYTES / 4 : BYTES;
}

static void test_sizes(void) {
    static size_t (*const wishes[])(int) = {steady, steps, dips};
    for (int i = 0; i < 3; i++) {
        double mean, mean_mpeg4;
        unsigned near = follow(RTP_H264, wishes[i], &mean);
        follow(RTP_MPEG4, wishes[i], &mean_mpeg4);
        fprintf(stderr, "wish %d: %u of %d frames near, mean %.2f; MPEG-4: mean %.2f\n", i, near, PICTURES, mean,
                mean_mpeg4);
        CHECK(near > PICTURES * 2 / 3);
        CHECK(mean > 0.75 && mean < 1.1);
        CHECK(mean_mpeg4 > 0.75 && mean_mpeg4 < 1.25);
    }
}

/* Each frame rate that a source may state. */
static void test_rates(void) {
    static const int rates[][2] = {{0, 0}, {1, 65535}, {1, 100000}, {10000, 1}, {30000, 1001}, {1, 10}};
    for (int i = 0; i < 12; i++) {
        struct encoder encoder;
        const struct encoder_settings settings = {.type = i % 2 ? RTP_MPEG4 : RTP_H264, .bitrate = BITRATE};
        const struct ddxvideo_geometry geometry = {
            .width = WIDTH, .height = HEIGHT, .rate_num = rates[i / 2][0], .rate_den = rates[i / 2][1]};
        CHECK_EQUAL(encoder_open(&encoder, &settings, &geometry), 0);
        for (int number = 0; number < 5; number++)
            encode(&encoder, number, number % 2 ? 0 : BYTES);
        encoder_close(&encoder);
    }
}

/* A requested renewal begins at the latest when the current one is done. */
static void test_refresh_h264(void) {
    struct encoder encoder;
    int begun = -1;
    open_encoder(&encoder, RTP_H264, false);
    for (int i = 0; i < 3 * RATE; i++) {
        if (i == 2 * RATE)
            encoder_refresh(&encoder, false);
        struct encoded encoded = encode(&encoder, i, 0);
        if (i && look_at(&encoded).recoveries)
            begun = i;
        CHECK(begun < 0 || begun == 2 * RATE);
    }
    CHECK_EQUAL(begun, 2 * RATE);
    encoder_refresh(&encoder, false);
    encode(&encoder, 3 * RATE, 0);
    encoder_refresh(&encoder, false); /* during a renewal */
    for (int i = 1; i <= WAVE + 2; i++) {
        struct encoded encoded = encode(&encoder, 3 * RATE + i, 0);
        if (look_at(&encoded).recoveries)
            begun = i;
    }
    CHECK(begun >= WAVE - 2 && begun <= WAVE + 2);
    encoder_close(&encoder);
}

/* At five pictures a second, four seconds have fewer pictures than each has columns: it is renewed all the time. */
static void test_renewal_of_slow_pictures(void) {
    struct encoder encoder;
    open_at(&encoder, RTP_H264, false, 5);
    for (int i = 0; i < 50; i++) {
        struct encoded encoded = encode(&encoder, i, 0);
        CHECK_EQUAL(look_at(&encoded).recoveries > 0, i == 20 || i == 40);
    }
    encoder_close(&encoder);
}

/* A whole picture is one key frame, with parameter sets. */
static void test_whole_h264(void) {
    struct encoder encoder;
    open_encoder(&encoder, RTP_H264, false);
    for (int i = 0; i < 2 * RATE; i++) {
        if (i == 10)
            encoder_refresh(&encoder, true);
        struct encoded encoded = encode(&encoder, i, i == 10 ? 2 * BYTES : 0);
        struct parts parts = look_at(&encoded);
        CHECK_EQUAL(parts.keys, i == 0 || i == 10);
        CHECK(!parts.keys || parts.sets == 2);
        CHECK(i != 10 || encoded.size < 3 * BYTES);
    }
    encoder_close(&encoder);
}

static void test_refresh_mpeg4(void) {
    struct encoder encoder;
    open_encoder(&encoder, RTP_MPEG4, false);
    for (int i = 0; i < RATE; i++) {
        if (i == 10)
            encoder_refresh(&encoder, false);
        struct encoded encoded = encode(&encoder, i, 0);
        const uint8_t *at = encoded.data;
        struct mpeg4_vol vol;
        CHECK_EQUAL(mpeg4_next_vol(&at, at + encoded.size, &vol), i == 0 || i == 10);
    }
    encoder_close(&encoder);
}

int main(void) {
    av_log_set_level(AV_LOG_FATAL);
    test_h264_frames(false);
    test_h264_frames(true);
    test_sizes();
    test_rates();
    test_refresh_h264();
    test_renewal_of_slow_pictures();
    test_whole_h264();
    test_refresh_mpeg4();
    return 0;
}
