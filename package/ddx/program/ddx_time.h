/* SPDX-License-Identifier: GPL-2.0-or-later */
/* Durations in ns, the unit of all times of the store. */
#ifndef DDX_TIME_H
#define DDX_TIME_H

#include <stdint.h>

#define MS INT64_C(1000000)
#define SECOND INT64_C(1000000000)

#endif
