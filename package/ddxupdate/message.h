/* SPDX-License-Identifier: GPL-2.0-or-later */
#ifndef DDXUPDATE_MESSAGE_H
#define DDXUPDATE_MESSAGE_H

/* One line to stderr, "ddxupdate: <message>". Returns `result`. */
__attribute__((format(printf, 2, 3))) int fail(int result, const char *format, ...);

#endif
