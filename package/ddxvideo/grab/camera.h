/* SPDX-License-Identifier: GPL-2.0-or-later */
/*
 * The interface of a camera: the grabber calls these functions, and each folder beside this file has a set of them.
 * None of them waits for a frame.
 */
#ifndef DDXVIDEO_CAMERA_H
#define DDXVIDEO_CAMERA_H

#include <ddxvideo.h>
#include <stddef.h>

#include "pixels.h"
#include "video_layout.h"

struct controls; /* see controls.h */

/* A frame in the camera's memory, until it is given back. */
struct camera_frame {
    const void *data;
    size_t size;       /* bytes that the camera filled */
    int64_t time;      /* of its capture, ns of CLOCK_MONOTONIC; 0: not known */
    bool damaged;      /* a part is missing or wrong */
    uint32_t sequence; /* counts the camera's frames, the lost ones included, and wraps */
    unsigned slot;     /* number of the camera's buffer */
};

struct camera {
    const struct camera_functions *call;
    /* set before open(): */
    const char *name;                  /* in messages */
    int width, height;                 /* requested; 0: as the camera is set */
    bool fields;                       /* both fields of a picture are needed */
    const struct video_layout *layout; /* of the result: cameras prefer formats with the same samples */
    /* set by open(): */
    int fd;        /* readable when a frame is there, POLLPRI when an event is; -1: closed */
    char card[64]; /* the camera's own name */
    struct pixels pixels;
    struct ddxvideo_geometry geometry; /* of the camera's pictures, not of the result */
    int64_t period;                    /* between two frames, ns; 0: unknown. The grabber measures it then. */
    bool triggered;                    /* externally: a lack of frames is no fault */
};

/* Events of a camera besides its frames. */
enum camera_event { CAMERA_NOTHING, CAMERA_CONTROLS_CHANGED, CAMERA_OTHER_SIGNAL };

struct camera_functions {
    /*
     * Open the camera, set it up and start the stream. 0, or -errno with the reason in one line at `why`; then it is
     * closed. -EINVAL: this camera cannot do what is requested. -ENODEV: it is not there.
     */
    int (*open)(struct camera *camera, char *why, size_t size);
    /* Stop the stream and close the camera; allowed when it is closed. */
    void (*close)(struct camera *camera);
    /*
     * The next frame, in the order of the numbers: a frame that came early waits for those before it until due(). `now`
     * INT64_MAX: waiting frames only. -EAGAIN: no frame yet; -ENODEV: unplugged; others: the stream is broken.
     */
    int (*take)(struct camera *camera, int64_t now, struct camera_frame *frame);
    /* Give a frame back. 0, or as take(). */
    int (*give)(struct camera *camera, const struct camera_frame *frame);
    /* The latest time for take(), even if the descriptor is not readable; INT64_MAX: no frame waits. */
    int64_t (*due)(const struct camera *camera);
    /* Handle all pending events, and update the list. NULL: this kind has none. */
    enum camera_event (*events)(struct camera *camera, struct controls *controls);
    /* Fill the empty list, by controls_add(). */
    void (*list)(struct camera *camera, struct controls *controls);
    /* Read all listed controls again: range, flags, value. */
    void (*refresh)(struct camera *camera, struct controls *controls);
    /* Set a control. 0, or -errno. */
    int (*set)(struct camera *camera, uint32_t id, int value);
};

static inline bool camera_is_open(const struct camera *camera) {
    return camera->fd >= 0;
}

#endif
