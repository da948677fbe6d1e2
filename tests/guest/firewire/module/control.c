// SPDX-License-Identifier: GPL-2.0
/*
 * /sys/module/vfirewire/parameters/do: commands of a test to the bus:
 *   reset                   a bus reset now
 *   plug CAMERA 0|1         pull the cable, or plug it in
 *   silent CAMERA 0|1       do not answer requests
 *   lose CAMERA FIRST COUNT these frames are not sent; they count from 0 when the transmission is switched on
 *   tear CAMERA FIRST COUNT these frames lack a packet
 *   reset CAMERA FIRST COUNT a bus reset before each of these frames
 * Reading it returns a line for each camera, with counts since its transmission was switched on.
 */
#include <linux/moduleparam.h>
#include <linux/string.h>

#include "vfirewire.h"

static void plug(struct vf_camera *camera, bool in) {
    vf_camera_power_on(camera);
    scoped_guard(spinlock_irqsave, &vf_bus.lock) camera->plugged = in;
    vf_schedule_reset();
}

static int set_switch(struct vf_camera *camera, const char *what, unsigned int on) {
    if (!strcmp(what, "plug"))
        plug(camera, on);
    else if (!strcmp(what, "silent"))
        WRITE_ONCE(camera->silent, on);
    else
        return -EINVAL;
    return 0;
}

static int set_frames(struct vf_camera *camera, const char *what, unsigned int first, unsigned int count) {
    const struct vf_frames frames = {first, count};

    guard(spinlock_irqsave)(&vf_bus.lock);
    if (!strcmp(what, "lose"))
        camera->lose = frames;
    else if (!strcmp(what, "tear"))
        camera->tear = frames;
    else if (!strcmp(what, "reset"))
        camera->reset = frames;
    else
        return -EINVAL;
    return 0;
}

static int command(const char *text, const struct kernel_param *parameter) {
    unsigned int camera, first, count;
    char what[8];
    int words;

    if (!vf_bus.cameras) /* being loaded */
        return -EBUSY;
    if (sysfs_streq(text, "reset")) {
        vf_schedule_reset();
        return 0;
    }
    words = sscanf(text, "%7s %u %u %u", what, &camera, &first, &count);
    if (words < 3 || camera >= vf_bus.cameras)
        return -EINVAL;
    if (words == 3)
        return set_switch(&vf_bus.camera[camera], what, first);
    return set_frames(&vf_bus.camera[camera], what, first, count);
}

static int state(char *text, const struct kernel_param *parameter) {
    int length = 0;
    unsigned int i;

    guard(spinlock_irqsave)(&vf_bus.lock);
    for (i = 0; i < vf_bus.cameras; i++) {
        const struct vf_camera *camera = &vf_bus.camera[i];

        length += scnprintf(text + length, PAGE_SIZE - length, "%u plugged %u on %u sent %u lost %u torn %u\n", i,
                            camera->plugged, camera->registers[VF_ISO_EN / 4] >> 31, camera->sent, camera->lost,
                            camera->torn);
    }
    return length;
}

static const struct kernel_param_ops operations = {.set = command, .get = state};
module_param_cb(do, &operations, NULL, 0644);
