/* SPDX-License-Identifier: GPL-2.0-or-later */
#include "h264_encode.h"

#include <errno.h>
#include <stdlib.h>
#include <string.h>

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

static int colour_space(int format) {
    return format == DDX_VIDEO_YUV422P ? X264_CSP_I422 : format == DDX_VIDEO_YUV444P ? X264_CSP_I444 : X264_CSP_I420;
}

/* Key frames come when the caller asks for one, never by count or by what the picture shows. */
static void set_format(x264_param_t *param, const struct ddxvideo_geometry *geometry) {
    bool known = ddxvideo_rate_known(geometry->rate_num, geometry->rate_den);

    param->i_log_level = X264_LOG_NONE;
    param->i_width = geometry->width;
    param->i_height = geometry->height;
    param->i_csp = colour_space(geometry->format);
    param->vui.b_fullrange = geometry->range == DDX_VIDEO_RANGE_FULL;
    if (geometry->aspect_num > 0 && geometry->aspect_den > 0) {
        param->vui.i_sar_width = geometry->aspect_num;
        param->vui.i_sar_height = geometry->aspect_den;
    }
    if (param->i_csp == X264_CSP_I420) /* 0: on the left luma column, as players assume */
        param->vui.i_chroma_loc = geometry->format == DDX_VIDEO_420_JPEG || geometry->format == DDX_VIDEO_GREY8;
    param->b_vfr_input = 0;
    param->i_fps_num = param->i_timebase_den = known ? (uint32_t)geometry->rate_num : RATE_UNKNOWN;
    param->i_fps_den = param->i_timebase_num = known ? (uint32_t)geometry->rate_den : 1;
    param->b_repeat_headers = 0;
    param->b_annexb = 0;
    param->i_threads = 1;
    param->b_sliced_threads = 0;
    param->i_slice_count = 1;
    param->i_keyint_max = X264_KEYINT_MAX_INFINITE;
    param->i_scenecut_threshold = 0;
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

/* Without x264's text on its version and settings. */
static int take_sets(struct h264_encoder *encoder, struct mp4_format *format) {
    x264_nal_t *nal;
    int count;
    bool good = true;

    if (x264_encoder_headers(encoder->x264, &nal, &count) < 0)
        return -EIO;
    for (; count > 0; count--, nal++) {
        if (nal->i_type == NAL_SPS)
            good = good && take_set(nal, format->sps, &format->sps_size);
        if (nal->i_type == NAL_PPS)
            good = good && take_set(nal, format->pps, &format->pps_size);
    }
    return good && format->sps_size && format->pps_size ? 0 : -EIO;
}

static struct mp4_format format_of(const struct ddxvideo_geometry *g) {
    bool known = ddxvideo_rate_known(g->rate_num, g->rate_den);
    int64_t duration = INT64_C(1000000) * (known ? g->rate_den : 1) / (known ? g->rate_num : RATE_UNKNOWN);

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
    x264_param_t param;

    *encoder = (struct h264_encoder){.geometry = *geometry};
    *format = format_of(geometry);
    if (geometry->format == DDX_VIDEO_GREY8) {
        size_t bytes = (size_t)geometry->width * (size_t)geometry->height / 4;

        encoder->grey = malloc(bytes);
        if (!encoder->grey)
            return -ENOMEM;
        memset(encoder->grey, 128, bytes);
    }
    if (x264_param_default_preset(&param, "ultrafast", "zerolatency") < 0)
        return -EIO;
    set_format(&param, geometry);
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

    x264_picture_init(&in);
    in.i_type = key ? X264_TYPE_IDR : X264_TYPE_P;
    in.i_pts = encoder->number++;
    in.img.i_csp = colour_space(encoder->geometry.format);
    in.img.i_plane = 3;
    for (int i = 0; i < 3; i++) { /* x264 copies them */
        bool grey = i && encoder->grey;

        in.img.plane[i] = grey ? encoder->grey : (uint8_t *)(uintptr_t)picture->plane[i];
        in.img.i_stride[i] = grey ? encoder->geometry.width / 2 : picture->stride[i];
    }
    int bytes = x264_encoder_encode(encoder->x264, &nal, &count, &in, &out);
    if (bytes <= 0 || (key && !out.b_keyframe))
        return -EIO;
    *data = nal->p_payload;
    *size = (size_t)bytes;
    return 0;
}
