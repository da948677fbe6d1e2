/* SPDX-License-Identifier: GPL-2.0-or-later */
/* A whole screen as a surface, without X: two buffers and page flips of the kernel's DRM, so no picture is torn. */
#ifndef DDXVIDEO_SCREEN_H
#define DDXVIDEO_SCREEN_H

#include "surface.h"

/*
 * Open a screen that no other program uses. The text console returns after surface_close(), and after the program's
 * death. Drivers may need some 100 ms to ask the monitors. The screen is the caller's until surface_close(); a program
 * has one at a time. NULL, with the reason in *error as a static text, valid until the next call: no screen, no
 * monitor, no such output or mode, in use, no permission. A caller may try again at any time.
 *
 * An error of surface_lock() or surface_show() means that the screen is lost (its monitor was unplugged, say): close
 * the surface, and open another one.
 *
 * Keys are read, and the terminal is changed, only while the program is in the foreground of its terminal: in the
 * background neither is touched, and SIGTTIN and SIGTTOU do not occur. There are no events of a pointer, and
 * SURFACE_CLOSE means that the terminal is gone.
 */
struct surface *screen_open(const struct screen_choice *choice, const char **error);

/* The connector's name and the mode, such as "HDMI-A-1, 1920x1080 at 60 Hz". Valid until surface_close(). */
const char *screen_name(const struct surface *surface);

#endif
