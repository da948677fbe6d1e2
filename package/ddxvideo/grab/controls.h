/* SPDX-License-Identifier: GPL-2.0-or-later */
/* The camera's controls: listed as parameters, followed by its events, changed on request. */
#ifndef DDXVIDEO_CONTROLS_H
#define DDXVIDEO_CONTROLS_H

#include <ddx_request.h>
#include <ddxvideo.h>
#include <linux/videodev2.h>
#include <stdbool.h>

struct controls {
    DDX_VIDEO_PARAMETERS list;
    uint32_t id[DDX_VIDEO_PARAMETERS_MAX]; /* the driver's, of each parameter */
    uint32_t type[DDX_VIDEO_PARAMETERS_MAX];
    /* What was asked for: a camera that was unplugged has forgotten it. */
    struct {
        uint32_t id;
        int value;
    } asked[DDX_VIDEO_PARAMETERS_MAX];
    unsigned asked_count;
};

/* "White Balance, Automatic" becomes "white_balance_automatic". */
void controls_name(char to[32], const char *from);

/* All controls of a camera that was opened, after what was asked for before has been set; listens to their events. */
void controls_begin(struct controls *controls, int fd);

/* A control has changed: look at it again. */
void controls_follow(struct controls *controls, int fd, uint32_t id);

/*
 * Whether the changes are possible, by the list alone. 0; -EINVAL, -ERANGE, -EACCES with the reason in text, see
 * ddx_request().
 */
int controls_check(const struct controls *controls, const DDX_REQUEST *request, char text[DDX_ANSWER_TEXT]);

/* Check, and make them. Also what the driver says: another -errno. */
int controls_change(struct controls *controls, int fd, const DDX_REQUEST *request, char text[DDX_ANSWER_TEXT]);

#endif
