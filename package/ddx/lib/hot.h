/* SPDX-License-Identifier: LGPL-2.1-or-later */
/*
 * When a frame comes, the code that delivers it is usually not in the cache. So the functions of the frame path are
 * placed side by side, without rarely used code between them.
 */
#ifndef DDX_HOT_H
#define DDX_HOT_H

#define DDX_HOT __attribute__((hot))
#define DDX_COLD __attribute__((cold, noinline))

#endif
