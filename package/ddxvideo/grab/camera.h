/* SPDX-License-Identifier: GPL-2.0-or-later */
/*
 * One camera, of whatever kind: the grabber calls these functions, each folder beside this file has a set of them.
 * None of them waits for a frame.
 */
#ifndef DDXVIDEO_CAMERA_H
#define DDXVIDEO_CAMERA_H

#include <ddxvideo.h>
#include <stddef.h>

#include "pixels.h"
#include "video_layout.h"

struct controls; /* of controls.h; handed on to the camera of that kind */

/* A frame in the camera's memory, until it is given back. */
struct camera_frame {
    const void *data;
    size_t size;       /* bytes that the camera filled */
    int64_t time;      /* of its capture, ns of CLOCK_MONOTONIC; 0: the camera does not know it */
    bool damaged;      /* some of it is missing or wrong */
    uint32_t sequence; /* counts the camera's frames, the lost ones included, and wraps */
    unsigned slot;     /* which of the camera's buffers holds it */
};

struct camera {
    const struct camera_functions *call;
    /* before it is opened */
    const char *name;  /* in messages */
    int width, height; /* that are asked for; 0: as the camera is set */
    bool fields;       /* both fields of a picture are needed */
    const struct video_layout *layout; /* of the result: cameras prefer what has the same samples */
    /* filled by open() */
    int fd;        /* readable when a frame is there, POLLPRI when an event is; -1: closed */
    char card[64]; /* the camera's own name */
    struct pixels pixels;
    struct ddxvideo_geometry geometry; /* of the camera's pictures, not of the result */
    int64_t period;                    /* between two frames, ns; 0: unknown. The grabber measures it then. */
    bool triggered;                    /* from outside: when no frames come, nothing is wrong */
};

/* What has happened to a camera beside its frames. */
enum camera_event { CAMERA_NOTHING, CAMERA_CONTROLS_CHANGED, CAMERA_OTHER_SIGNAL };

struct camera_functions {
    /*
     * Open the camera, set it up and start the stream. 0, or -errno with the reason in one line at `why`; then it is
     * closed. -EINVAL: this camera cannot do what is asked. -ENODEV: it is not there.
     */
    int (*open)(struct camera *camera, char *why, size_t size);
    /* Stop the stream and let the camera go; allowed when it is closed. */
    void (*close)(struct camera *camera);
    /*
     * The next frame, in the order of the numbers: one that came early waits for those before it until due(). `now`
     * INT64_MAX: only those that wait so. -EAGAIN: no frame yet; -ENODEV: unplugged; others: the stream is broken.
     */
    int (*take)(struct camera *camera, int64_t now, struct camera_frame *frame);
    /* Give a frame back. 0, or as take(). */
    int (*give)(struct camera *camera, const struct camera_frame *frame);
    /* When to call take() at the latest, even if the descriptor is not readable; INT64_MAX: no frame waits. */
    int64_t (*due)(const struct camera *camera);
    /* All events that are there; brings the list up to date. NULL: this kind has none. */
    enum camera_event (*events)(struct camera *camera, struct controls *controls);
    /* Fill the empty list, by controls_add(). */
    void (*list)(struct camera *camera, struct controls *controls);
    /* Look at all listed controls again: range, flags, value. */
    void (*refresh)(struct camera *camera, struct controls *controls);
    /* Set a control. 0, or -errno. */
    int (*set)(struct camera *camera, uint32_t id, int value);
};

static inline bool camera_is_open(const struct camera *camera) {
    return camera->fd >= 0;
}

#endif
