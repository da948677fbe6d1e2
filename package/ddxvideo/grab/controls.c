/* SPDX-License-Identifier: GPL-2.0-or-later */
#include "controls.h"

#include <ctype.h>
#include <errno.h>
#include <inttypes.h>
#include <stdio.h>
#include <string.h>

void controls_name(char to[32], const char *from) {
    unsigned length = 0;

    for (; *from && length < 31; from++) {
        if (isalnum((unsigned char)*from))
            to[length++] = (char)tolower((unsigned char)*from);
        else if (length && to[length - 1] != '_')
            to[length++] = '_';
    }
    while (length && to[length - 1] == '_')
        length--;
    to[length] = 0;
}

static int find_name(const struct controls *controls, const char *name) {
    for (int i = 0; i < controls->list.count; i++)
        if (!strcmp(controls->list.parameter[i].name, name))
            return i;
    return -1;
}

int controls_find(const struct controls *controls, uint32_t id) {
    for (int i = 0; i < controls->list.count; i++)
        if (controls->id[i] == id)
            return i;
    return -1;
}

int controls_add(struct controls *controls, uint32_t id, const char *from) {
    char name[32], wanted[32];
    int i = controls->list.count;

    if (i == DDX_VIDEO_PARAMETERS_MAX)
        return -1;
    controls_name(wanted, from);
    strcpy(name, wanted);
    for (unsigned twin = 2; find_name(controls, name) >= 0; twin++)
        snprintf(name, sizeof name, "%.27s_%u", wanted, twin % 100);
    strcpy(controls->list.parameter[i].name, name);
    controls->list.count++;
    controls->id[i] = id;
    return i;
}

void controls_begin(struct controls *controls, struct camera *camera) {
    for (unsigned i = 0; i < controls->asked_count; i++)
        camera->call->set(camera, controls->asked[i].id, controls->asked[i].value); /* may be another camera */
    memset(&controls->list, 0, sizeof controls->list);
    camera->call->list(camera, controls);
}

/* A bit mask takes any bits of its maximum. Other values must fit: the driver would take the nearest step. */
static bool is_allowed(const struct controls *controls, int i, int64_t value) {
    int64_t minimum = controls->list.parameter[i].minimum, maximum = controls->list.parameter[i].maximum;

    if (controls->kind[i] == CONTROL_BITS)
        return !(value & ~(int64_t)(uint32_t)maximum);
    return value >= minimum && value <= maximum && (value - minimum) % controls->list.parameter[i].step == 0;
}

static void tell_range(const struct controls *controls, int i, int64_t value, char text[DDX_ANSWER_TEXT]) {
    const char *name = controls->list.parameter[i].name;
    int minimum = controls->list.parameter[i].minimum, maximum = controls->list.parameter[i].maximum;
    char steps[32] = "";

    if (controls->list.parameter[i].step > 1)
        snprintf(steps, sizeof steps, " in steps of %d", controls->list.parameter[i].step);
    if (controls->kind[i] == CONTROL_BITS)
        snprintf(text, DDX_ANSWER_TEXT, "%s: takes the bits of %#x, not %" PRId64, name, (unsigned)maximum, value);
    else
        snprintf(text, DDX_ANSWER_TEXT, "%s: takes a whole number from %d to %d%s, not %" PRId64, name, minimum,
                 maximum, steps, value);
}

int controls_check(const struct controls *controls, const DDX_REQUEST *request, char text[DDX_ANSWER_TEXT]) {
    for (unsigned k = 0; k < request->count; k++) {
        const char *name = request->change[k].name;
        int i = find_name(controls, name);

        if (i < 0) {
            snprintf(text, DDX_ANSWER_TEXT, "%s: no such parameter", name);
            return -EINVAL;
        }
        if (controls->list.parameter[i].flags & DDX_VIDEO_PARAMETER_READ_ONLY) {
            snprintf(text, DDX_ANSWER_TEXT, "%s: cannot be changed now", name);
            return -EACCES;
        }
        if (!is_allowed(controls, i, request->change[k].value)) {
            tell_range(controls, i, request->change[k].value, text);
            return -ERANGE;
        }
    }
    return 0;
}

/* The newest last: they are set again in this order, and a value may switch off an automatic one before it. */
static void remember(struct controls *controls, uint32_t id, int value) {
    unsigned i = 0;

    while (i < controls->asked_count && controls->asked[i].id != id)
        i++;
    if (i == DDX_VIDEO_PARAMETERS_MAX)
        return;
    if (i < controls->asked_count)
        memmove(&controls->asked[i], &controls->asked[i + 1],
                (--controls->asked_count - i) * sizeof controls->asked[0]);
    controls->asked[controls->asked_count].id = id;
    controls->asked[controls->asked_count++].value = value;
}

/* Restores the former values, the last one first. */
static void undo(const struct controls *controls, struct camera *camera, const DDX_REQUEST *request, unsigned made) {
    while (made-- > 0) {
        int i = find_name(controls, request->change[made].name);

        if (controls->kind[i] != CONTROL_BUTTON)
            camera->call->set(camera, controls->id[i], controls->list.parameter[i].value);
    }
}

int controls_change(struct controls *controls, struct camera *camera, const DDX_REQUEST *request,
                    char text[DDX_ANSWER_TEXT]) {
    int error = controls_check(controls, request, text);

    for (unsigned k = 0; !error && k < request->count; k++) {
        int i = find_name(controls, request->change[k].name);

        error = camera->call->set(camera, controls->id[i], (int)request->change[k].value);
        if (error) {
            snprintf(text, DDX_ANSWER_TEXT, "%s: the camera refuses: %s", request->change[k].name, strerror(-error));
            undo(controls, camera, request, k);
        }
    }
    if (error)
        return error;
    for (unsigned k = 0; k < request->count; k++) {
        int i = find_name(controls, request->change[k].name);

        if (controls->kind[i] != CONTROL_BUTTON)
            remember(controls, controls->id[i], (int)request->change[k].value);
    }
    camera->call->refresh(camera, controls); /* one may change others, such as its automatic mode */
    return 0;
}
