/* SPDX-License-Identifier: GPL-2.0-or-later */
/* Requested settings are set again when the camera comes back, in the order of the last requests. */
#include "controls.h"
#include "check.h"

enum { GAIN = 5, GAIN_AUTO };

static char set_text[200];

static int set(struct camera *camera, uint32_t id, int value) {
    (void)camera;
    sprintf(set_text + strlen(set_text), "%s=%d ", id == GAIN ? "gain" : "auto", value);
    return 0;
}

static void list(struct camera *camera, struct controls *controls) {
    (void)camera;
    for (uint32_t id = GAIN; id <= GAIN_AUTO; id++) {
        int i = controls_add(controls, id, id == GAIN ? "Gain" : "Gain Auto");
        controls->list.parameter[i].maximum = 100;
        controls->list.parameter[i].step = 1;
    }
}

static void refresh(struct camera *camera, struct controls *controls) {
    (void)camera;
    (void)controls;
}

static const struct camera_functions functions = {.set = set, .list = list, .refresh = refresh};
static struct camera camera = {.call = &functions};
static struct controls controls;

static void ask(const char *name, int value) {
    DDX_REQUEST request = {.count = 1};
    char text[DDX_ANSWER_TEXT];
    strcpy(request.change[0].name, name);
    request.change[0].value = value;
    *set_text = 0;
    CHECK_EQUAL(controls_change(&controls, &camera, &request, text), 0);
}

static void check_set_again(const char *wanted) {
    *set_text = 0;
    controls_begin(&controls, &camera);
    CHECK(!strcmp(set_text, wanted));
}

int main(void) {
    controls_begin(&controls, &camera);
    ask("gain", 10);
    ask("gain_auto", 1);
    check_set_again("gain=10 auto=1 ");
    ask("gain", 20); /* which switches the automatic off */
    check_set_again("auto=1 gain=20 ");
    for (int i = 0; i < 3 * DDX_VIDEO_PARAMETERS_MAX; i++)
        ask(i % 2 ? "gain" : "gain_auto", i % 2);
    check_set_again("auto=0 gain=1 ");
    return 0;
}
