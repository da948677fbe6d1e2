/* SPDX-License-Identifier: GPL-2.0-or-later */
/* The addresses of this machine, and their changes. */
#ifndef DDXPANEL_ADDRESS_H
#define DDXPANEL_ADDRESS_H

#include <stdint.h>

/* A socket that is readable after the kernel has changed addresses or interfaces; or -errno. */
int address_watch(void);

/* Forget the changes that wait at the socket. What they were is not read: address_sum() looks itself. */
void address_forget(int watch);

/*
 * A number for the present set of addresses, with their interfaces: another set has another one. 0: there are none but
 * those of the loopback and of interfaces that are down.
 */
uint64_t address_sum(void);

#endif
