/* SPDX-License-Identifier: GPL-2.0-or-later */
#include "output.h"

#include <errno.h>
#include <string.h>

static struct ddxvideo_geometry geometry_of(const AVFrame *picture, AVRational rate) {
    bool known = ddxvideo_rate_known(rate.num, rate.den); /* the sender's values are not trusted */
    AVRational aspect = picture->sample_aspect_ratio;
    bool has_aspect = aspect.num > 0 && aspect.den > 0;

    return (struct ddxvideo_geometry){.width = picture->width,
                                      .height = picture->height,
                                      .fields = 1,
                                      .rate_num = known ? rate.num : 0,
                                      .rate_den = known ? rate.den : 0,
                                      .aspect_num = has_aspect ? aspect.num : 0,
                                      .aspect_den = has_aspect ? aspect.den : 0,
                                      .format = DDX_VIDEO_420_MPEG2,
                                      .interlacing = 'p',
                                      .range = picture->color_range == AVCOL_RANGE_JPEG ? DDX_VIDEO_RANGE_FULL
                                                                                        : DDX_VIDEO_RANGE_LIMITED};
}

struct ddxvideo_picture output_picture(const AVFrame *frame, AVRational rate) {
    struct ddxvideo_picture picture = {.geometry = geometry_of(frame, rate)};

    for (int i = 0; i < 3; i++) {
        picture.plane[i] = frame->data[i];
        picture.stride[i] = frame->linesize[i];
        picture.rows[i] = i ? (frame->height + 1) / 2 : frame->height;
    }
    return picture;
}

#define CREATE_AGAIN 500000000 /* ns, between attempts, since a store that hangs blocks its clients for seconds */

bool output_is_refused(int error) {
    return error && error != -ECONNREFUSED && error != -ENOBUFS && error != -EMFILE;
}

/* An item for pictures like this one. */
static int choose_item(struct output_item *output, DDX_STORE_ID *id, const struct ddxvideo_geometry *geometry) {
    bool same = ddxvideo_same_layout(&output->geometry, geometry);

    if (output->item && same)
        return 0;
    if (ddx_time_now() < output->create && (same || output->error == -ECONNREFUSED))
        return output->error;
    output_close(output);
    output->geometry = *geometry;
    output->error = ddxvideo_create(id, output->name, geometry, &output->item);
    output->create = output->error ? ddx_time_now() + CREATE_AGAIN : 0;
    return output->error;
}

static void copy_planes(struct ddxvideo_frame *frame, const AVFrame *picture) {
    for (int i = 0; i < 3; i++)
        for (int row = 0; row < frame->rows[i]; row++)
            memcpy(frame->plane[i] + (size_t)row * (size_t)frame->stride[i],
                   picture->data[i] + row * (ptrdiff_t)picture->linesize[i], (size_t)frame->stride[i]);
}

int output_write(struct output_item *output, DDX_STORE_ID *id, const AVFrame *picture, AVRational rate,
                 const struct ddxvideo_stamp *stamp) {
    struct ddxvideo_geometry geometry = geometry_of(picture, rate);
    struct ddxvideo_frame frame;

    if (!output->name)
        return 0;
    if (picture->format != AV_PIX_FMT_YUV420P && picture->format != AV_PIX_FMT_YUVJ420P)
        return -EINVAL;
    int error = choose_item(output, id, &geometry);
    if (error)
        return error;
    error = ddxvideo_loan(output->item, &geometry, &frame);
    if (!error) {
        copy_planes(&frame, picture);
        frame.stamp = *stamp;
        error = ddxvideo_publish(output->item, &frame);
    }
    if (output_is_refused(error)) /* another program writes it now */
        output_close(output);
    return error;
}

void output_close(struct output_item *output) {
    ddx_store_done_item(output->item);
    output->item = NULL;
}
