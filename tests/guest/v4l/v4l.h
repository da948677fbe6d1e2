/* SPDX-License-Identifier: GPL-2.0-or-later */
/*
 * Simulated cameras and helpers that run in the guest: one static program with a subcommand for each. Shares no code
 * with the programs under test. A failure is one line and exit status 1.
 */
#ifndef V4L_H
#define V4L_H

#include <linux/videodev2.h>
#include <stdint.h>
#include <stdio.h>

int control(int argc, char **argv); /* controls of a device, by name */
int feed(int argc, char **argv);    /* a Y4M file into an output device */
int hold(int argc, char **argv);    /* keep a camera busy */
int iidc(int argc, char **argv);    /* be a USB camera of the IIDC standard */
int uvc(int argc, char **argv);     /* be a USB camera */

__attribute__((format(printf, 1, 2), noreturn)) void fail(const char *format, ...);

int open_device(const char *path);
void call(int fd, unsigned long request, void *argument, const char *what); /* ioctl() that must succeed */
void *map(int fd, const struct v4l2_buffer *buffer);
void sleep_ms(long ms);
int64_t now_ms(void);

/* A 4:2:0 file in memory, frame by frame. */
struct clip {
    unsigned char *data;
    size_t size, frame_size;
    unsigned width, height, frames;
};
void file_read(struct clip *clip, const char *path); /* only the bytes */
void clip_read(struct clip *clip, const char *path);
const unsigned char *clip_frame(const struct clip *clip, unsigned number);

#endif
