/* SPDX-License-Identifier: GPL-2.0-or-later */
#include "h264_encode.h"

#include <errno.h>
#include <stdlib.h>
#include <string.h>

#include "h264_setup.h"
#include "video_layout.h"

#define RATE_UNKNOWN 25
#define LENGTH 4 /* bytes of a NAL unit's length */

const char *h264_refusal(const struct ddxvideo_geometry *geometry) {
    if (geometry->format == DDX_VIDEO_GREY16 || geometry->format == DDX_VIDEO_RGB24)
        return "has YUV and GREY8 only";
    if (geometry->width % 2 || geometry->height % 2)
        return "needs an even width and height";
    return NULL;
}

static void set_quality(x264_param_t *param, const struct h264_settings *settings) {
    if (!settings->quality) {
        param->rc.i_rc_method = X264_RC_CQP;
        param->rc.i_qp_constant = 0;
        return;
    }
    param->rc.i_rc_method = X264_RC_CRF;
    param->rc.f_rf_constant = (float)settings->quality;
    param->rc.i_vbv_max_bitrate = param->rc.i_vbv_buffer_size = (int)settings->bitrate;
}

static bool take_set(const x264_nal_t *nal, uint8_t *to, size_t *size) {
    *size = (size_t)nal->i_payload - LENGTH;
    if (nal->i_payload <= LENGTH || *size > MP4_SET_MAX)
        return false;
    memcpy(to, nal->p_payload + LENGTH, *size);
    return true;
}

static int take_sets(struct h264_encoder *encoder, struct mp4_format *format) {
    x264_nal_t sps, pps;
    int error = h264_take_sets(encoder->x264, &sps, &pps);

    if (error)
        return error;
    return take_set(&sps, format->sps, &format->sps_size) && take_set(&pps, format->pps, &format->pps_size) ? 0 : -EIO;
}

static struct mp4_format format_of(const struct ddxvideo_geometry *g, int rate_num, int rate_den) {
    int64_t duration = INT64_C(1000000) * rate_den / rate_num;

    return (struct mp4_format){.width = g->width,
                               .height = g->height,
                               .aspect_num = g->aspect_num,
                               .aspect_den = g->aspect_den,
                               .duration = duration < 1              ? 1
                                           : duration < MP4_STEP_MAX ? (uint32_t)duration
                                                                     : MP4_STEP_MAX,
                               .chroma = g->format == DDX_VIDEO_YUV422P   ? 2
                                         : g->format == DDX_VIDEO_YUV444P ? 3
                                                                          : 1};
}

int h264_encoder_open(struct h264_encoder *encoder, const struct ddxvideo_geometry *geometry,
                      const struct h264_settings *settings, struct mp4_format *format) {
    bool known = ddxvideo_rate_known(geometry->rate_num, geometry->rate_den);
    int rate_num = known ? geometry->rate_num : RATE_UNKNOWN, rate_den = known ? geometry->rate_den : 1;
    x264_param_t param;

    *encoder = (struct h264_encoder){.geometry = *geometry};
    *format = format_of(geometry, rate_num, rate_den);
    if (geometry->format == DDX_VIDEO_GREY8) {
        size_t bytes = (size_t)geometry->width * (size_t)geometry->height / 4;

        encoder->grey = malloc(bytes);
        if (!encoder->grey)
            return -ENOMEM;
        memset(encoder->grey, 128, bytes);
    }
    if (h264_set_up(&param, "ultrafast", geometry, rate_num, rate_den))
        return -EIO;
    param.b_annexb = 0;
    param.i_keyint_max = X264_KEYINT_MAX_INFINITE; /* key frames come when the caller asks for one, never by count */
    param.i_scenecut_threshold = 0;                /* nor by what the picture shows */
    set_quality(&param, settings);
    encoder->x264 = x264_encoder_open(&param);
    return encoder->x264 ? take_sets(encoder, format) : -EIO;
}

void h264_encoder_close(struct h264_encoder *encoder) {
    if (encoder->x264)
        x264_encoder_close(encoder->x264);
    free(encoder->grey);
    *encoder = (struct h264_encoder){.x264 = NULL};
}

void h264_encoder_set_quality(struct h264_encoder *encoder, long quality) {
    x264_param_t param;

    x264_encoder_parameters(encoder->x264, &param);
    param.rc.f_rf_constant = (float)quality;
    x264_encoder_reconfig(encoder->x264, &param); /* refuses no crf */
}

int h264_encode(struct h264_encoder *encoder, const struct ddxvideo_picture *picture, bool key, const uint8_t **data,
                size_t *size) {
    x264_picture_t in, out;
    x264_nal_t *nal;
    int count;

    h264_set_picture(&in, picture, encoder->geometry.format);
    in.i_type = key ? X264_TYPE_IDR : X264_TYPE_P;
    in.i_pts = encoder->number++;
    for (int i = 1; i < 3 && encoder->grey; i++) {
        in.img.plane[i] = encoder->grey;
        in.img.i_stride[i] = encoder->geometry.width / 2;
    }
    int bytes = x264_encoder_encode(encoder->x264, &nal, &count, &in, &out);
    if (bytes <= 0 || (key && !out.b_keyframe))
        return -EIO;
    *data = nal->p_payload;
    *size = (size_t)bytes;
    return 0;
}
