/* SPDX-License-Identifier: GPL-2.0-or-later */
#include "publish.h"

#include <errno.h>

#define CREATE_AGAIN_NS INT64_C(500000000)

/* Reports each new error of the store once; 0: none. */
static void complain(const struct grabber *grabber, const char *item, int error) {
    static int said;

    if (error == -EPROTOTYPE && !*item && error != said)
        say("%s: its readers have it open in a layout other than %s; restart them, until then its frames are lost",
            grabber->name, grabber->camera->layout->name);
    else if (error && error != said)
        say("%s%s: %s", grabber->name, item, ddx_error_text(error));
    said = error;
}

/* Creates the items for the current geometry, if needed. False if that is not possible now. */
static bool have_items(struct grabber *grabber) {
    const struct ddxvideo_geometry *wanted = &grabber->geometry;
    int64_t now = ddx_time_now();
    const struct ddxvideo_geometry *made = &grabber->created;
    bool same_size = wanted->width == made->width && wanted->height == made->height;

    if (grabber->video && same_size && video_layout_of(wanted->format) == video_layout_of(made->format))
        return true;
    if (now < grabber->create)
        return false;
    grabber->create = now + CREATE_AGAIN_NS;
    ddx_store_done_item(grabber->video);
    grabber->video = NULL;
    int error = ddxvideo_create(grabber->id, grabber->name, wanted, &grabber->video);
    if (error) {
        complain(grabber, "", error);
        return false;
    }
    if (!grabber->created.width)
        ddx_stats_published(grabber->book, ddx_store_written(grabber->video));
    grabber->created = *wanted;
    if (!grabber->counter)
        error = ddxvideo_counter_create(grabber->id, grabber->name, &grabber->counter);
    complain(grabber, ".frame", error);
    return true;
}

static int write_frame(struct grabber *grabber, const struct camera_frame *from, uint64_t position, int64_t time) {
    struct ddxvideo_frame frame;
    int error = ddxvideo_loan(grabber->video, &grabber->geometry, &frame);

    if (error)
        return error;
    error = converter_run(&grabber->converter, from->data, from->size,
                          frame.plane, frame.stride);
    if (error) {
        ddx_store_cancel(grabber->video);
        return error;
    }
    frame.stamp = (struct ddxvideo_stamp){.frame = (int)(position & INT32_MAX),
                                          .time = time,
                                          .wall_offset = ddxvideo_wall_offset(),
                                          .source_sequence = from->sequence,
                                          .source_lost = (int64_t)grabber->count.lost};
    ddx_stats_publishing(grabber->book, ddx_store_written(grabber->video) + 1);
    error = ddxvideo_publish(grabber->video, &frame);
    if (!error && grabber->counter)
        ddxvideo_counter_write(grabber->counter, frame.stamp.frame);
    return error;
}

void publish(struct grabber *grabber, const struct camera_frame *from, uint64_t position, int64_t time) {
    ddx_stats_in(grabber->book, 1, 0);
    if (!have_items(grabber)) {
        ddx_stats_lost(grabber->book, LOST_STORE, 1);
        return;
    }
    int error = write_frame(grabber, from, position, time);
    if (!error)
        ddx_stats_out(grabber->book, 1, ddx_time_now() - time);
    else if (error == -EBADMSG)
        ddx_stats_lost(grabber->book, LOST_ERROR, 1);
    else
        ddx_stats_lost(grabber->book, LOST_STORE, 1);
    if (error != -EBADMSG)
        complain(grabber, "", error);
}

void publish_end(struct grabber *grabber) {
    ddx_store_done_item(grabber->counter);
    ddx_store_done_item(grabber->video);
}
