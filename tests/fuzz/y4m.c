/* SPDX-License-Identifier: GPL-2.0-or-later */
/* Fuzz target: a Y4M file, its lines, and its frames converted to each layout. */
#include <assert.h>
#include <libavutil/log.h>
#include <stdlib.h>
#include <sys/mman.h>
#include <unistd.h>

#include "video_layout.h"
#include "y4m.h"

#define PIXELS_MAX (1 << 18) /* larger pictures take long and find no more */
#define FRAMES_MAX 4

int LLVMFuzzerTestOneInput(const uint8_t *data, size_t size);

static void read_frames(struct y4m_reader *reader) {
    const struct ddxvideo_geometry *geometry = &reader->header.geometry;
    unsigned char *plane[3];
    for (int i = 0; i < 3; i++) {
        int stride, rows;
        video_layout_plane(video_layout_of(geometry->format), geometry->width, geometry->height, i, &stride, &rows);
        plane[i] = malloc((size_t)stride * (size_t)rows);
    }
    for (int i = 0; i < FRAMES_MAX; i++) {
        int64_t time;
        enum y4m_result result = y4m_read(reader, plane, &time);
        if (result == Y4M_OK)
            assert(time >= -1 && time <= Y4M_TIME_MAX);
        else if (result != Y4M_END)
            assert(*reader->error);
        if (result != Y4M_OK && (result != Y4M_END || y4m_rewind(reader) != Y4M_OK))
            break;
    }
    for (int i = 0; i < 3; i++)
        free(plane[i]);
}

int LLVMFuzzerTestOneInput(const uint8_t *data, size_t size) {
    char path[32];
    struct y4m_reader reader;
    int fd = memfd_create("y4m", MFD_CLOEXEC);
    if (fd < 0 || write(fd, data, size) != (ssize_t)size)
        abort();
    av_log_set_level(AV_LOG_QUIET);
    snprintf(path, sizeof(path), "/proc/self/fd/%d", fd);
    /* All layouts, in turn. */
    static const int formats[] = {DDX_VIDEO_420,    DDX_VIDEO_YUV422P, DDX_VIDEO_YUV444P, DDX_VIDEO_GREY8,
                                  DDX_VIDEO_GREY16, DDX_VIDEO_RGB24,   Y4M_SAME};
    int format = formats[size % (sizeof(formats) / sizeof(*formats))];
    enum y4m_result result = y4m_open(&reader, path, format);
    const struct ddxvideo_geometry *geometry = &reader.header.geometry;
    if (result == Y4M_OK) {
        assert(!ddxvideo_geometry_error(geometry));
        if (geometry->width * geometry->height <= PIXELS_MAX)
            read_frames(&reader);
    } else {
        assert(*reader.error);
    }
    y4m_close(&reader);
    close(fd);
    return 0;
}
