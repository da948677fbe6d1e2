/* SPDX-License-Identifier: GPL-2.0-or-later */
/* A camera's controls: listed as parameters, changed on request. */
#ifndef DDXVIDEO_CONTROLS_H
#define DDXVIDEO_CONTROLS_H

#include <ddx_request.h>
#include <ddxvideo.h>
#include <stdint.h>

#include "camera.h"

enum control_kind {
    CONTROL_NUMBER,
    CONTROL_BITS,  /* any bits of the maximum */
    CONTROL_BUTTON /* pressed by any value; has none itself */
};

struct controls {
    DDX_VIDEO_PARAMETERS list;
    uint32_t id[DDX_VIDEO_PARAMETERS_MAX]; /* the camera's, of each parameter */
    enum control_kind kind[DDX_VIDEO_PARAMETERS_MAX];
    /* What was asked for: a camera that was unplugged has forgotten it. */
    struct {
        uint32_t id;
        int value;
    } asked[DDX_VIDEO_PARAMETERS_MAX];
    unsigned asked_count;
};

/* "White Balance, Automatic" becomes "white_balance_automatic". */
void controls_name(char to[32], const char *from);

/* One more parameter, named after `name`; its number in the list, or -1: the list is full. */
int controls_add(struct controls *controls, uint32_t id, const char *name);

/* The parameter of this id; -1: there is none. */
int controls_find(const struct controls *controls, uint32_t id);

/* All controls of a camera that was opened, after what was asked for before has been set. */
void controls_begin(struct controls *controls, struct camera *camera);

/*
 * Whether the changes are possible, by the list alone. 0; -EINVAL, -ERANGE, -EACCES with the reason in text, see
 * ddx_request().
 */
int controls_check(const struct controls *controls, const DDX_REQUEST *request, char text[DDX_ANSWER_TEXT]);

/* Check, and make them. Also what the camera says: another -errno. */
int controls_change(struct controls *controls, struct camera *camera, const DDX_REQUEST *request,
                    char text[DDX_ANSWER_TEXT]);

#endif
