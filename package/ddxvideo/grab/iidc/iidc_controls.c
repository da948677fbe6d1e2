/* SPDX-License-Identifier: GPL-2.0-or-later */
#include "iidc_controls.h"

#include <errno.h>
#include <stdio.h>

enum part { VALUE, AUTO, ONE_PUSH, ON, BLUE, RED, GREEN, MODE, SOURCE, POLARITY, PARTS = 16 };

/* Features with a value, and their names. */
static const struct part_name {
    enum part part;
    const char *suffix;
} part_names[] = {
    {VALUE, ""},   {AUTO, "_auto"},   {ONE_PUSH, "_one_push"}, {ON, "_on"},         {BLUE, "_blue"},
    {RED, "_red"}, {GREEN, "_green"}, {MODE, "_mode"},         {SOURCE, "_source"}, {POLARITY, "_polarity"},
};

#define PART_NAMES (sizeof part_names / sizeof *part_names)

static uint32_t id_of(dc1394feature_t feature, enum part part) {
    return (uint32_t)(feature - DC1394_FEATURE_MIN) * PARTS + part;
}

static dc1394feature_t feature_of(uint32_t id) {
    return DC1394_FEATURE_MIN + id / PARTS;
}

static enum part part_of(uint32_t id) {
    return (enum part)(id % PARTS);
}

static bool has_mode(const dc1394feature_info_t *info, dc1394feature_mode_t mode) {
    for (unsigned i = 0; i < info->modes.num && i < DC1394_FEATURE_MODE_NUM; i++)
        if (info->modes.modes[i] == mode)
            return true;
    return false;
}

/* The parts of a feature. */
static bool has_part(const dc1394feature_info_t *info, enum part part) {
    bool balance = info->id == DC1394_FEATURE_WHITE_BALANCE, shading = info->id == DC1394_FEATURE_WHITE_SHADING;
    bool trigger = info->id == DC1394_FEATURE_TRIGGER;

    switch (part) {
    case VALUE: return !balance && !shading && !trigger;
    case AUTO: return !trigger && has_mode(info, DC1394_FEATURE_MODE_AUTO);
    case ONE_PUSH: return !trigger && has_mode(info, DC1394_FEATURE_MODE_ONE_PUSH_AUTO);
    case ON: return info->on_off_capable;
    case BLUE:
    case RED: return balance || shading;
    case GREEN: return shading;
    case MODE: return trigger && info->trigger_modes.num > 0;
    case SOURCE: return trigger && info->trigger_sources.num > 0;
    case POLARITY: return trigger && info->polarity_capable;
    default: return false;
    }
}

static int value_of(const dc1394feature_info_t *info, enum part part) {
    bool shading = info->id == DC1394_FEATURE_WHITE_SHADING;

    switch (part) {
    case AUTO: return info->current_mode == DC1394_FEATURE_MODE_AUTO;
    case ON: return info->is_on == DC1394_ON;
    case BLUE: return (int)(shading ? info->B_value : info->BU_value);
    case RED: return (int)(shading ? info->R_value : info->RV_value);
    case GREEN: return (int)info->G_value;
    case MODE: return (int)(info->trigger_mode - DC1394_TRIGGER_MODE_MIN);
    case SOURCE: return (int)(info->trigger_source - DC1394_TRIGGER_SOURCE_MIN);
    case POLARITY: return info->trigger_polarity != 0;
    case VALUE: /* the library does not shift this value into place */
        return (int)(info->id == DC1394_FEATURE_TEMPERATURE ? info->target_value >> 12 : info->value);
    default: return 0;
    }
}

/* Numbers in a range; other parts are switches, a button, and the trigger's modes and sources by their order. */
static bool is_number(enum part part) {
    return part == VALUE || part == BLUE || part == RED || part == GREEN;
}

static void describe(struct controls *controls, int i, const dc1394feature_info_t *info) {
    enum part part = part_of(controls->id[i]);
    bool number = is_number(part);

    controls->kind[i] = part == ONE_PUSH ? CONTROL_BUTTON : CONTROL_NUMBER;
    controls->list.parameter[i].minimum = number ? (int)info->min : 0;
    controls->list.parameter[i].maximum = number           ? (int)info->max
                                          : part == MODE   ? DC1394_TRIGGER_MODE_NUM - 1
                                          : part == SOURCE ? DC1394_TRIGGER_SOURCE_NUM - 1
                                                           : 1;
    controls->list.parameter[i].step = 1;
    controls->list.parameter[i].value = value_of(info, part);
    controls->list.parameter[i].flags =
        (number && info->current_mode != DC1394_FEATURE_MODE_MANUAL && info->modes.num ? DDX_VIDEO_PARAMETER_AUTOMATIC
                                                                                       : 0) |
        (number && info->modes.num && !has_mode(info, DC1394_FEATURE_MODE_MANUAL) ? DDX_VIDEO_PARAMETER_READ_ONLY : 0);
}

void features_list(dc1394camera_t *device, struct controls *controls) {
    dc1394featureset_t all;

    if (dc1394_feature_get_all(device, &all))
        return;
    for (unsigned f = 0; f < DC1394_FEATURE_NUM; f++) {
        const dc1394feature_info_t *info = &all.feature[f];

        for (unsigned p = 0; info->available && p < PART_NAMES; p++) {
            char name[64];

            if (!has_part(info, part_names[p].part))
                continue;
            snprintf(name, sizeof name, "%s%s", dc1394_feature_get_string(info->id), part_names[p].suffix);
            int i = controls_add(controls, id_of(info->id, part_names[p].part), name);
            if (i < 0)
                return;
            describe(controls, i, info);
            controls->list.parameter[i].initial = controls->list.parameter[i].value; /* no register has it */
        }
    }
}

void features_refresh(dc1394camera_t *device, struct controls *controls) {
    dc1394featureset_t all;

    if (dc1394_feature_get_all(device, &all))
        return;
    for (int i = 0; i < controls->list.count; i++)
        describe(controls, i, &all.feature[feature_of(controls->id[i]) - DC1394_FEATURE_MIN]);
}

static dc1394error_t set_balance(dc1394camera_t *device, enum part part, uint32_t value) {
    uint32_t blue, red;
    dc1394error_t error = dc1394_feature_whitebalance_get_value(device, &blue, &red);

    return error
               ? error
               : dc1394_feature_whitebalance_set_value(device, part == BLUE ? value : blue, part == RED ? value : red);
}

static dc1394error_t set_shading(dc1394camera_t *device, enum part part, uint32_t value) {
    uint32_t red, green, blue;
    dc1394error_t error = dc1394_feature_whiteshading_get_value(device, &red, &green, &blue);

    return error ? error
                 : dc1394_feature_whiteshading_set_value(device, part == RED ? value : red,
                                                         part == GREEN ? value : green, part == BLUE ? value : blue);
}

/* Sets manual control, and register values instead of values with a unit. */
static dc1394error_t set_number(dc1394camera_t *device, dc1394feature_t feature, enum part part, uint32_t value) {
    dc1394feature_info_t info = {.id = feature};
    dc1394error_t error = dc1394_feature_get(device, &info);

    if (!error && info.current_mode != DC1394_FEATURE_MODE_MANUAL && has_mode(&info, DC1394_FEATURE_MODE_MANUAL))
        error = dc1394_feature_set_mode(device, feature, DC1394_FEATURE_MODE_MANUAL);
    if (!error && info.absolute_capable && info.abs_control)
        error = dc1394_feature_set_absolute_control(device, feature, DC1394_OFF);
    if (error)
        return error;
    switch (feature) {
    case DC1394_FEATURE_WHITE_BALANCE: return set_balance(device, part, value);
    case DC1394_FEATURE_WHITE_SHADING: return set_shading(device, part, value);
    case DC1394_FEATURE_TEMPERATURE: return dc1394_feature_temperature_set_value(device, value);
    default: return dc1394_feature_set_value(device, feature, value);
    }
}

static dc1394error_t set_mode(dc1394camera_t *device, dc1394feature_t feature, dc1394feature_mode_t mode) {
    return dc1394_feature_set_mode(device, feature, mode);
}

int features_set(dc1394camera_t *device, uint32_t id, int value) {
    dc1394feature_t feature = feature_of(id);
    uint32_t number = (uint32_t)value;
    dc1394error_t error;

    if (feature > DC1394_FEATURE_MAX)
        return -EINVAL;
    switch (part_of(id)) {
    case AUTO: error = set_mode(device, feature, value ? DC1394_FEATURE_MODE_AUTO : DC1394_FEATURE_MODE_MANUAL); break;
    case ONE_PUSH: error = set_mode(device, feature, DC1394_FEATURE_MODE_ONE_PUSH_AUTO); break;
    case ON: error = dc1394_feature_set_power(device, feature, value ? DC1394_ON : DC1394_OFF); break;
    case MODE: error = dc1394_external_trigger_set_mode(device, DC1394_TRIGGER_MODE_MIN + number); break;
    case SOURCE: error = dc1394_external_trigger_set_source(device, DC1394_TRIGGER_SOURCE_MIN + number); break;
    case POLARITY: error = dc1394_external_trigger_set_polarity(device, DC1394_TRIGGER_ACTIVE_MIN + number); break;
    default: error = set_number(device, feature, part_of(id), number);
    }
    return error ? -EIO : 0;
}

bool features_changes_rate(uint32_t id) {
    dc1394feature_t feature = feature_of(id);

    return feature == DC1394_FEATURE_FRAME_RATE || feature == DC1394_FEATURE_SHUTTER ||
           feature == DC1394_FEATURE_EXPOSURE || feature == DC1394_FEATURE_TRIGGER;
}
