/* SPDX-License-Identifier: GPL-2.0-or-later */
/* Finds, lists and opens cameras on FireWire and USB. */
#ifndef DDXVIDEO_BUS_H
#define DDXVIDEO_BUS_H

#include <dc1394/dc1394.h>
#include <stdbool.h>
#include <stddef.h>
#include <stdint.h>

/* The requested camera. */
struct bus_wish {
    uint64_t guid; /* 0: not known yet; then this number in the order of GUIDs counts: */
    unsigned number;
};

/* "2" or "00b09d0100abcdef" (16 digits, with or without 0x). False: neither. */
bool bus_parse(const char *text, struct bus_wish *wish);

/*
 * Look for the camera and open it. 0; -ENODEV: it is not there; -EBUSY: it is there, or may be; with the reason in one
 * line at `why`. After success the wish has the GUID, so that the same camera is found after it was unplugged.
 */
int bus_open(struct bus_wish *wish, dc1394_t **library, dc1394camera_t **device, char *why, size_t size);

void bus_close(dc1394_t *library, dc1394camera_t *device);

/* Changes when a device comes or goes, or gets another owner. */
uint64_t bus_devices(void);

/* Changes when a device comes or goes, but not when mdev sets its rights. */
uint64_t bus_files(void);

/* Print all cameras with their modes and rates. Returns the exit status. */
int bus_list(void);

#endif
