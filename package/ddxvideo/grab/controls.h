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
    CONTROL_BUTTON /* pressed by any value; has no value */
};

struct controls {
    DDX_VIDEO_PARAMETERS list;
    uint32_t id[DDX_VIDEO_PARAMETERS_MAX]; /* the camera's id of each parameter */
    enum control_kind kind[DDX_VIDEO_PARAMETERS_MAX];
    /* Requested values: a camera that was unplugged has forgotten them. */
    struct {
        uint32_t id;
        int value;
    } asked[DDX_VIDEO_PARAMETERS_MAX];
    unsigned asked_count;
};

/* "White Balance, Automatic" becomes "white_balance_automatic". */
void controls_name(char to[32], const char *from);

/* Add a parameter, named after `name`. Its number in the list; -1: the list is full. */
int controls_add(struct controls *controls, uint32_t id, const char *name);

/* The parameter of this id; -1: there is none. */
int controls_find(const struct controls *controls, uint32_t id);

/* List all controls of a camera that was opened, after setting the requested values again. */
void controls_begin(struct controls *controls, struct camera *camera);

/*
 * Check by the list whether the changes are possible. 0; -EINVAL, -ERANGE, -EACCES with the reason in text, see
 * ddx_request().
 */
int controls_check(const struct controls *controls, const DDX_REQUEST *request, char text[DDX_ANSWER_TEXT]);

/* Check the changes, and make them. The camera may refuse with another -errno. */
int controls_change(struct controls *controls, struct camera *camera, const DDX_REQUEST *request,
                    char text[DDX_ANSWER_TEXT]);

#endif
