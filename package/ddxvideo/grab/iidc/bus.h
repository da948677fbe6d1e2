/* SPDX-License-Identifier: GPL-2.0-or-later */
/* The cameras on FireWire and USB: found, listed, opened. */
#ifndef DDXVIDEO_BUS_H
#define DDXVIDEO_BUS_H

#include <dc1394/dc1394.h>
#include <stdbool.h>
#include <stddef.h>
#include <stdint.h>

/* Which camera is meant. */
struct bus_wish {
    uint64_t guid; /* 0: not known yet, the one with this number by order of the GUIDs: */
    unsigned number;
};

/* "2" or "00b09d0100abcdef" (16 digits, with or without 0x). False: neither. */
bool bus_parse(const char *text, struct bus_wish *wish);

/*
 * Look for the camera and open it. 0, -ENODEV: it is not there, -EBUSY: it is there, or may be; the reason in one line
 * at `why`. Afterwards the wish has its GUID, so that the same camera is looked for after it was unplugged.
 */
int bus_open(struct bus_wish *wish, dc1394_t **library, dc1394camera_t **device, char *why, size_t size);

void bus_close(dc1394_t *library, dc1394camera_t *device);

/* Changes when a device comes or goes, or is given to another user. */
uint64_t bus_devices(void);

/* Changes when a device comes or goes, but not when mdev sets the rights of one. */
uint64_t bus_files(void);

/* Print all cameras and what they can do; the program's exit status. */
int bus_list(void);

#endif
