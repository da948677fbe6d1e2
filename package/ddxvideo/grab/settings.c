/* SPDX-License-Identifier: GPL-2.0-or-later */
#include "settings.h"

#include <errno.h>

#define AGAIN_NS INT64_C(100000000)    /* some cameras change a control with each frame */
#define REFUSED_NS INT64_C(1000000000) /* between two attempts to create an item that the store refuses */

void settings_begin(struct grabber *grabber) {
    controls_begin(&grabber->controls, grabber->camera);
    grabber->changed = true;
    grabber->settings = 0;
}

static void serve(struct grabber *grabber) {
    DDX_REQUEST request;
    char text[DDX_ANSWER_TEXT] = "";
    int status;

    if (ddx_requests_take(grabber->requests, &request))
        return;
    if (!camera_is_open(grabber->camera)) {
        status = -ENODEV;
        snprintf(text, sizeof text, "the camera is not there now: %.128s", grabber->state);
    } else {
        status = controls_change(&grabber->controls, grabber->camera, &request, text);
        grabber->changed = true;
    }
    /* Before the answer, so that a program that gets it finds the new values. */
    if (!status && grabber->parameters && !ddxvideo_parameters_write(grabber->parameters, &grabber->controls.list))
        grabber->changed = false;
    ddx_requests_answer(grabber->requests, status, text);
}

/* Creates the two items, if needed; reports each new error once. 0 or -errno. */
static int open_items(struct grabber *grabber) {
    static int said;
    int error = 0;

    if (!grabber->parameters)
        error = ddxvideo_parameters_create(grabber->id, grabber->name, &grabber->parameters);
    bool refused = error;
    if (!grabber->requests && !(grabber->requests = ddx_requests_open(grabber->id, grabber->name)))
        error = -errno;
    if (error && error != said)
        say("%s%s: %s", grabber->name, refused ? ".parameters" : ": its settings cannot be changed",
            ddx_error_text(error));
    said = error;
    return error;
}

void settings_tick(struct grabber *grabber) {
    int64_t now = ddx_time_now();

    if (grabber->requests)
        serve(grabber);
    if (!grabber->changed || now < grabber->settings)
        return;
    grabber->settings = now + (open_items(grabber) ? REFUSED_NS : AGAIN_NS);
    if (grabber->parameters && !ddxvideo_parameters_write(grabber->parameters, &grabber->controls.list))
        grabber->changed = grabber->requests == NULL;
}

void settings_end(struct grabber *grabber) {
    ddx_requests_close(grabber->requests);
    ddx_store_done_item(grabber->parameters);
}
