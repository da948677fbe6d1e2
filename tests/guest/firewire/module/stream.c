// SPDX-License-Identifier: GPL-2.0
/*
 * A camera's pictures, frame by frame, each delivered when its last packet is due. The packets have their planned
 * times, even on a machine that is late.
 */
#include <linux/delay.h>
#include <linux/jiffies.h>
#include <linux/kthread.h>
#include <linux/math64.h>

#include "vfirewire.h"

struct stream {
    unsigned int session, packets, packet_size, channel;
    unsigned int cycles, frames; /* bus cycles per that number of frames */
};

static bool is_on(const struct vf_camera *camera) {
    return camera->plugged && camera->registers[VF_ISO_EN / 4] >> 31;
}

/* A mode of format 0 has a rate. */
static void set_format0(const u32 *registers, struct stream *stream) {
    static const unsigned int bytes[] = {57600, 153600, 460800, 614400, 921600, 307200, 614400, 614400};
    unsigned int rate = min(registers[VF_FRAMERATE / 4] >> 29, 5u);

    stream->packets = 3840 >> rate;
    stream->packet_size = bytes[registers[VF_MODE / 4] >> 29] / stream->packets;
    stream->cycles = 12800;
    stream->frames = 3 << rate;
}

/* In format 7, frames follow each other without a gap. */
static void set_format7(const u32 *registers, struct stream *stream) {
    stream->packets = stream->cycles = registers[VF_PACKETS / 4];
    stream->packet_size = registers[VF_PACKET / 4] >> 16;
    stream->frames = 1;
}

/* Reads the camera's settings; false when it is off. */
static bool begin(struct vf_camera *camera, struct stream *stream) {
    guard(spinlock_irqsave)(&vf_bus.lock);
    stream->session = camera->session;
    if (camera->registers[VF_FORMAT / 4] >> 29 == 7)
        set_format7(camera->registers, stream);
    else
        set_format0(camera->registers, stream);
    stream->channel = camera->registers[VF_ISO / 4] >> 28;
    if (!is_on(camera))
        return false;
    camera->sent = camera->lost = camera->torn = 0;
    return true;
}

static bool goes_on(struct vf_camera *camera, unsigned int session) {
    return !kthread_should_stop() && READ_ONCE(camera->session) == session;
}

static bool contains(const struct vf_frames *frames, unsigned int number) {
    return number - frames->first < frames->count;
}

/* The packet of a frame that is missing; none: -1, all: -2. */
static int missing(struct vf_camera *camera, const struct stream *stream, unsigned int number) {
    guard(spinlock_irqsave)(&vf_bus.lock);
    if (contains(&camera->lose, number)) {
        camera->lost++;
        return -2;
    }
    camera->sent++;
    if (!contains(&camera->tear, number))
        return -1;
    camera->torn++;
    return stream->packets / 2;
}

/* The reset is complete before the frame is sent. */
static void reset_bus(const struct vf_camera *camera, unsigned int number) {
    bool wanted;

    scoped_guard(spinlock_irqsave, &vf_bus.lock) wanted = contains(&camera->reset, number);
    if (wanted) {
        vf_schedule_reset();
        flush_work(&vf_bus.reset);
    }
}

static void send_frame(struct vf_camera *camera, const struct stream *stream, unsigned int number, u64 cycle) {
    int lack = missing(camera, stream, number);
    unsigned int i;

    for (i = 0; i < stream->packets && lack != -2; i++) {
        struct vf_packet packet = {
            .camera = camera->index,
            .number = number,
            .offset = i * stream->packet_size,
            .length = stream->packet_size,
            .channel = stream->channel,
            .sy = i == 0,
            .cycle = cycle + i,
        };

        if ((int)i != lack)
            vf_iso_receive(&packet);
    }
}

/* Sleeps until a cycle; false when the stream was stopped before. */
static bool sleep_until(struct vf_camera *camera, unsigned int session, u64 cycle) {
    s64 left;

    while ((left = cycle - vf_cycle()) > 0 && goes_on(camera, session))
        wait_event_interruptible_timeout(camera->wake, !goes_on(camera, session), usecs_to_jiffies(left * 125) + 1);
    return goes_on(camera, session);
}

static void run(struct vf_camera *camera, const struct stream *stream) {
    u64 first = vf_cycle();
    unsigned int number;

    for (number = 0;; number++) {
        u64 cycle = first + div_u64((u64)number * stream->cycles, stream->frames);

        if (!sleep_until(camera, stream->session, cycle + stream->packets))
            return;
        reset_bus(camera, number);
        send_frame(camera, stream, number, cycle);
    }
}

static int stream(void *data) {
    struct vf_camera *camera = data;
    struct stream now;

    while (!kthread_should_stop()) {
        if (begin(camera, &now))
            run(camera, &now);
        else
            wait_event_interruptible(camera->wake, !goes_on(camera, now.session));
    }
    return 0;
}

int vf_stream_start(struct vf_camera *camera) {
    camera->task = kthread_run(stream, camera, "vfirewire-%u", camera->index);
    if (!IS_ERR(camera->task))
        return 0;
    camera->task = NULL;
    return -ENOMEM;
}

void vf_stream_stop(struct vf_camera *camera) {
    if (camera->task)
        kthread_stop(camera->task);
    camera->task = NULL;
}
