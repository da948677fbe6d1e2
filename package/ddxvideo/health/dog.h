/* SPDX-License-Identifier: GPL-2.0-or-later */
/* The hardware watchdog: it resets the machine unless it is fed. Once opened it cannot be called off. */
#ifndef DDXHEALTH_DOG_H
#define DDXHEALTH_DOG_H

struct dog {
    const char *path;
    int file; /* -1: not there */
    int timeout; /* seconds; as the hardware took it */
};

/* Open it, if it is there: drivers may come later, so call it again. 0 when it is open, else -errno. */
int dog_open(struct dog *dog, int timeout);

void dog_feed(const struct dog *dog);

#endif
