/* SPDX-License-Identifier: GPL-2.0-or-later */
/*
 * Preloaded: any opened file acts as a hardware watchdog; each feeding writes a byte to the file $FOOD.
 */
#define _GNU_SOURCE
#include <fcntl.h>
#include <linux/watchdog.h>
#include <stdarg.h>
#include <stdlib.h>
#include <sys/syscall.h>
#include <unistd.h>

int ioctl(int fd, unsigned long request, ...) {
    va_list rest;
    va_start(rest, request);
    void *argument = va_arg(rest, void *);
    va_end(rest);
    if (request == WDIOC_SETTIMEOUT)
        return 0;
    if (request != WDIOC_KEEPALIVE)
        return (int)syscall(SYS_ioctl, fd, request, argument);
    int food = open(getenv("FOOD"), O_WRONLY | O_CREAT | O_APPEND, 0600);
    int result = food >= 0 && write(food, ".", 1) == 1 ? 0 : -1;
    close(food);
    return result;
}
