/* SPDX-License-Identifier: LGPL-2.1-or-later */
/*
 * Whenever a frame comes, the code that delivers it is cold: the machine did something else meanwhile. So the functions
 * of the frame path lie side by side, and what is rare is not among them.
 */
#ifndef DDX_HOT_H
#define DDX_HOT_H

#define DDX_HOT __attribute__((hot))
#define DDX_COLD __attribute__((cold, noinline))

#endif
