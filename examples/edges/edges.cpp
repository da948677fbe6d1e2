// SPDX-License-Identifier: GPL-2.0-or-later
// Reads `video` without a copy, and writes the edges in it as the video item `edges`, in place as well.
#include <cstdio>
#include <cstring>

#include <ddxvideo.h>
#include <opencv2/imgproc.hpp>

// Draws the edges of one picture into a free frame of the item; 0 or -errno.
static int draw(DDX_STORE_ITEM *edges, const ddxvideo_picture &from) {
    ddxvideo_frame to;
    if (int error = ddxvideo_loan(edges, &from.geometry, &to))
        return error;
    cv::Mat grey(from.rows[0], from.geometry.width, CV_8UC1, const_cast<unsigned char *>(from.plane[0]),
                 static_cast<size_t>(from.stride[0]));
    cv::Mat lines(to.rows[0], to.geometry.width, CV_8UC1, to.plane[0], static_cast<size_t>(to.stride[0]));
    cv::Canny(grey, lines, 80, 160); // `lines` has the right size and type, so OpenCV draws into the store's memory
    for (int plane = 1; plane < 3; plane++)
        std::memset(to.plane[plane], 128, static_cast<size_t>(to.rows[plane] * to.stride[plane])); // grey
    to.stamp = from.stamp; // the number and the capture time of the picture that the edges belong to
    return ddxvideo_publish(edges, &to);
}

int main() {
    DDX_STORE_ID *id = ddx_store_open(nullptr, 0, 5.0);
    DDX_STORE_ITEM *video = id ? ddx_store_await_item(id, "video") : nullptr, *edges = nullptr;
    ddx_frame frame;
    ddxvideo_picture picture;
    unsigned long frames = 0, missed = 0;
    int error = video ? 0 : -ECONNREFUSED;

    while (!error && !(error = ddx_store_acquire(video, &frame, 5.0, DDX_NEXT))) {
        error = ddxvideo_view(video, frame.data, &picture);
        if (!error && !edges)
            error = ddxvideo_create(id, "edges", &picture.geometry, &edges);
        if (!error)
            error = draw(edges, picture);
        ddx_store_release(video); // from here on the writer may use this frame's memory again
        frames++;
        missed += frame.missed;
    }
    std::fprintf(stderr, "edges: %lu frames, %lu missed: %s\n", frames, missed, ddx_error_text(error));
    ddx_store_close(id);
    return error == -ETIMEDOUT && frames ? 0 : 1;
}
