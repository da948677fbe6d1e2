/* SPDX-License-Identifier: GPL-2.0-or-later */
#ifndef TESTS_H
#define TESTS_H

int test_walk(const char *only); /* points whose name contains this, or NULL for all */
int test_random(unsigned kills, unsigned seed);
int test_worker(void);
int test_hostile(void);
int test_restart(void);
int test_pins(void);
int test_crowd(void);
int test_epochs(void);
int test_retired(void);
int test_mute(void);
int test_stop(void);
int test_stranger(void);

#endif
