/* SPDX-License-Identifier: GPL-2.0-or-later */
/* Pictures of the store as JPEG: levels, colours, sizes, each layout; judged by FFmpeg's decoder. */
#include <libavcodec/avcodec.h>
#include <stdbool.h>
#include <stdlib.h>
#include <string.h>

#include "check.h"
#include "jpeg.h"
#include "video_layout.h"

#define WIDTH 64
#define HEIGHT 48
#define NEAR 3 /* how far a level may be from the right one, of 255 */

static struct jpeg_encoder encoder;

/* A picture whose left half has one colour and whose right half another one. */
static struct ddxvideo_picture picture_new(int format, int range, const int left[3], const int right[3]) {
    struct ddxvideo_picture picture = {
        .geometry = {.width = WIDTH, .height = HEIGHT, .fields = 1, .format = format, .range = range}};
    const struct video_layout *layout = video_layout_of(format);
    unsigned char *memory = calloc(1, video_layout_bytes(&picture.geometry));

    CHECK(memory);
    video_layout_place(&picture, memory);
    for (int i = 0; i < 3; i++)
        for (int row = 0; row < picture.rows[i]; row++)
            for (int x = 0; x < picture.stride[i]; x++) {
                int component = layout->samples == 3 ? x % 3 : i;
                int level = 2 * x < picture.stride[i] ? left[component] : right[component];

                /* The high byte of 16 bits is the second one. */
                *memory++ = (unsigned char)(layout->bytes == 2 && x % 2 == 0 ? 0 : level);
            }
    return picture;
}

static AVFrame *decode(const unsigned char *bytes, size_t size) {
    AVCodecContext *context = avcodec_alloc_context3(avcodec_find_decoder(AV_CODEC_ID_MJPEG));
    AVPacket *packet = av_packet_alloc();
    AVFrame *frame = av_frame_alloc();

    CHECK(context && packet && frame && !avcodec_open2(context, NULL, NULL));
    CHECK(!av_new_packet(packet, (int)size));
    memcpy(packet->data, bytes, size);
    CHECK(!avcodec_send_packet(context, packet) && !avcodec_receive_frame(context, frame));
    av_packet_free(&packet);
    avcodec_free_context(&context);
    return frame;
}

static AVFrame *coded(const struct ddxvideo_picture *picture, int quality, int divisor) {
    const struct jpeg_form form = {quality, divisor};
    const unsigned char *bytes;
    size_t size;

    CHECK_EQUAL(jpeg_encode(&encoder, picture, &form, &bytes, &size), 0);
    return decode(bytes, size);
}

static bool is_near(const AVFrame *frame, int quarters, const int levels[3]) {
    for (int i = 0; i < 3; i++) {
        int width = i ? frame->width / 2 : frame->width, height = i ? frame->height / 2 : frame->height;
        int level = frame->data[i][height / 2 * frame->linesize[i] + width * quarters / 4];

        if (abs(level - levels[i]) > NEAR) {
            fprintf(stderr, "level of plane %d is %d, not %d\n", i, level, levels[i]);
            return false;
        }
    }
    return true;
}

static void check_levels(int format, int range, const int left[3], const int right[3], const int wanted_left[3],
                         const int wanted_right[3]) {
    struct ddxvideo_picture picture = picture_new(format, range, left, right);

    for (int divisor = 1; divisor <= 2; divisor++) {
        AVFrame *frame = coded(&picture, 3, divisor);

        CHECK_EQUAL(frame->width, WIDTH / divisor);
        CHECK_EQUAL(frame->height, HEIGHT / divisor);
        CHECK(frame->format == AV_PIX_FMT_YUVJ420P);
        CHECK(is_near(frame, 1, wanted_left));
        CHECK(is_near(frame, 3, wanted_right));
        av_frame_free(&frame);
    }
    free((void *)picture.plane[0]);
}

static const int black[] = {16, 128, 128}, white[] = {235, 128, 128};
static const int full_black[] = {0, 128, 128}, full_white[] = {255, 128, 128};

static void test_limited_range_is_made_full(void) {
    static const int layouts[] = {DDX_VIDEO_420,     DDX_VIDEO_420_MPEG2, DDX_VIDEO_YUV422P,
                                  DDX_VIDEO_YUV444P, DDX_VIDEO_GREY8,     DDX_VIDEO_GREY16};

    for (size_t i = 0; i < sizeof layouts / sizeof *layouts; i++) {
        check_levels(layouts[i], DDX_VIDEO_RANGE_LIMITED, black, white, full_black, full_white);
        check_levels(layouts[i], DDX_VIDEO_RANGE_UNKNOWN, black, white, full_black, full_white);
        check_levels(layouts[i], DDX_VIDEO_RANGE_FULL, black, white, black, white);
    }
}

static void test_colours(void) {
    static const int blue[] = {41, 240, 110}, red[] = {81, 90, 240}, rgb_blue[] = {0, 0, 255}, rgb_red[] = {255, 0, 0};
    static const int full_blue[] = {29, 255, 107}, full_red[] = {76, 85, 255};

    check_levels(DDX_VIDEO_420, DDX_VIDEO_RANGE_LIMITED, blue, red, full_blue, full_red);
    check_levels(DDX_VIDEO_420_JPEG, DDX_VIDEO_RANGE_FULL, full_blue, full_red, full_blue, full_red);
    check_levels(DDX_VIDEO_YUV444P, DDX_VIDEO_RANGE_LIMITED, blue, red, full_blue, full_red);
    check_levels(DDX_VIDEO_RGB24, DDX_VIDEO_RANGE_FULL, rgb_blue, rgb_red, full_blue, full_red);
}

static size_t size_of(const struct ddxvideo_picture *picture, int quality) {
    const struct jpeg_form form = {quality, 1};
    const unsigned char *bytes;
    size_t size;

    CHECK_EQUAL(jpeg_encode(&encoder, picture, &form, &bytes, &size), 0);
    return size;
}

static void test_each_quality_is_smaller_than_the_one_before(void) {
    static const int qualities[] = {3, 6, 10, 16};
    struct ddxvideo_picture picture = picture_new(DDX_VIDEO_420, DDX_VIDEO_RANGE_LIMITED, black, white);
    unsigned char *luma = (unsigned char *)picture.plane[0];

    for (int i = 0; i < WIDTH * HEIGHT; i++)
        luma[i] = (unsigned char)(16 + i * 7919 % 211);
    size_t before = size_of(&picture, JPEG_BEST);
    for (size_t i = 0; i < sizeof qualities / sizeof *qualities; i++) {
        size_t size = size_of(&picture, qualities[i]);
        CHECK(size < before);
        CHECK_EQUAL(size_of(&picture, qualities[i]), size);
        before = size;
    }
    free(luma);
}

static void test_small_pictures(void) {
    unsigned char samples[3 * 16] = {0};
    const struct jpeg_form half = {6, 2};
    const unsigned char *bytes;
    size_t size;

    for (int side = 1; side <= 4; side++) {
        struct ddxvideo_picture picture = {
            .geometry = {.width = side, .height = side, .fields = 1, .format = DDX_VIDEO_YUV444P}};

        video_layout_place(&picture, samples);
        int error = jpeg_encode(&encoder, &picture, &half, &bytes, &size);
        CHECK_EQUAL(error, side < 2 ? -ERANGE : 0);
        if (error)
            continue;
        AVFrame *frame = decode(bytes, size);
        CHECK_EQUAL(frame->width, 2);
        CHECK_EQUAL(frame->height, 2);
        av_frame_free(&frame);
    }
}

int main(void) {
    test_limited_range_is_made_full();
    test_colours();
    test_each_quality_is_smaller_than_the_one_before();
    test_small_pictures();
    jpeg_close(&encoder);
    return 0;
}
