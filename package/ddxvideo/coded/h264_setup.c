/* SPDX-License-Identifier: GPL-2.0-or-later */
#include "h264_setup.h"

#include <errno.h>

static int colour_space(int format) {
    return format == DDX_VIDEO_YUV422P ? X264_CSP_I422 : format == DDX_VIDEO_YUV444P ? X264_CSP_I444 : X264_CSP_I420;
}

int h264_set_up(x264_param_t *param, const char *preset, const struct ddxvideo_geometry *geometry, int rate_num,
                int rate_den) {
    if (x264_param_default_preset(param, preset, "zerolatency") < 0)
        return -EIO;
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
    param->i_fps_num = param->i_timebase_den = (uint32_t)rate_num;
    param->i_fps_den = param->i_timebase_num = (uint32_t)rate_den;
    param->b_repeat_headers = 0;
    param->i_threads = 1;
    param->b_sliced_threads = 0;
    param->i_slice_count = 1;
    return 0;
}

int h264_take_sets(x264_t *x264, x264_nal_t *sps, x264_nal_t *pps) {
    x264_nal_t *nal;
    int count, found = 0;

    if (x264_encoder_headers(x264, &nal, &count) < 0)
        return -EIO;
    for (; count > 0; count--, nal++) {
        if (nal->i_type == NAL_SPS)
            *sps = *nal;
        else if (nal->i_type == NAL_PPS)
            *pps = *nal;
        found |= nal->i_type == NAL_SPS ? 1 : nal->i_type == NAL_PPS ? 2 : 0;
    }
    return found == 3 ? 0 : -EIO;
}

void h264_set_picture(x264_picture_t *in, const struct ddxvideo_picture *picture, int format) {
    x264_picture_init(in);
    in->img.i_csp = colour_space(format);
    in->img.i_plane = 3;
    for (int i = 0; i < 3; i++) {
        in->img.plane[i] = (uint8_t *)(uintptr_t)picture->plane[i];
        in->img.i_stride[i] = picture->stride[i];
    }
}
