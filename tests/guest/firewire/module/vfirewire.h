/* SPDX-License-Identifier: GPL-2.0 */
/*
 * A FireWire bus without hardware: one card with up to five IIDC cameras. The kernel's firewire-core does the rest, so
 * /dev/fw*, isochronous reception and bus resets are real.
 */
#ifndef VFIREWIRE_H
#define VFIREWIRE_H

#include <linux/list.h>
#include <linux/sched.h>
#include <linux/spinlock.h>
#include <linux/types.h>
#include <linux/wait.h>
#include <linux/workqueue.h>

#include "card_driver.h"

#define VF_CAMERAS 5
#define VF_REGISTERS 0x400 /* quadlets of a camera's command registers */
#define VF_CSRS 4          /* bus manager, bandwidth, channels high and low: served by an OHCI controller itself */

#define VF_FRAMERATE 0x600
#define VF_MODE 0x604
#define VF_FORMAT 0x608
#define VF_ISO 0x60c
#define VF_ISO_EN 0x614
#define VF_FORMAT7 0xa00               /* registers of format 7, mode 0 */
#define VF_PACKET (VF_FORMAT7 + 0x44)  /* upper half: bytes per packet */
#define VF_PACKETS (VF_FORMAT7 + 0x48) /* packets per frame */

/* Frames of a camera: numbers from `first` on, counted since its transmission was switched on. */
struct vf_frames {
    unsigned int first, count;
};

struct vf_camera {
    unsigned int index;
    bool plugged;
    bool silent;                   /* does not answer requests */
    unsigned int session;          /* how often the transmission was switched on */
    struct vf_frames lose;         /* these are not sent */
    struct vf_frames tear;         /* these lack a packet */
    struct vf_frames reset;        /* a bus reset before each of these */
    unsigned int sent, lost, torn; /* since the transmission was switched on */
    u32 registers[VF_REGISTERS];
    struct task_struct *task;
    wait_queue_head_t wake;
};

struct vf_bus {
    struct fw_card card;
    spinlock_t lock; /* protects all that follows */
    struct work_struct reset;
    bool closing;
    int generation;
    unsigned int nodes;                 /* cameras found by the last bus reset */
    struct vf_camera *node[VF_CAMERAS]; /* by node number; the card has the number after the last camera's */
    u32 csr[VF_CSRS];
    __be32 rom[256];
    struct list_head contexts; /* that are receiving */
    unsigned int cameras;
    struct vf_camera camera[VF_CAMERAS];
};

extern struct vf_bus vf_bus;
extern const struct fw_card_driver vf_driver;

u64 vf_cycle(void);          /* 125 us each; arbitrary origin */
u32 vf_timestamp(u64 cycle); /* as in the header of an isochronous packet */
void vf_schedule_reset(void);

void vf_send_request(struct fw_card *card, struct fw_packet *packet);
void vf_send_response(struct fw_card *card, struct fw_packet *packet);

/* A camera's address space: return an RCODE_. */
void vf_camera_power_on(struct vf_camera *camera);
int vf_camera_read(struct vf_camera *camera, u64 offset, __be32 *data, size_t length);
int vf_camera_write(struct vf_camera *camera, u64 offset, const __be32 *data, size_t length);

int vf_stream_start(struct vf_camera *camera);
void vf_stream_stop(struct vf_camera *camera);

/* A packet of a picture. */
struct vf_packet {
    unsigned int camera, number; /* of the frame */
    unsigned int offset, length; /* in the frame, in bytes */
    unsigned int channel, sy;
    u64 cycle;
};
void vf_iso_receive(const struct vf_packet *packet);
struct fw_iso_context *vf_iso_allocate(struct fw_card *card, int type, int channel, size_t header_size);
void vf_iso_free(struct fw_iso_context *base);
int vf_iso_start(struct fw_iso_context *base, s32 cycle, u32 sync, u32 tags);
int vf_iso_stop(struct fw_iso_context *base);
int vf_iso_set_channels(struct fw_iso_context *base, u64 *channels);
int vf_iso_queue(struct fw_iso_context *base, struct fw_iso_packet *packet, struct fw_iso_buffer *buffer,
                 unsigned long payload);
void vf_iso_flush_queue(struct fw_iso_context *base);
int vf_iso_flush_completions(struct fw_iso_context *base);

#endif
