/* SPDX-License-Identifier: GPL-2.0-or-later */
/* The columns of a field: one for a number, one for each element of an array, one for a text or a large array. */
#ifndef DDXLOG_COLUMN_H
#define DDXLOG_COLUMN_H

#include <form.h>
#include <stdio.h>

#define COLUMN_ELEMENTS_MAX 64 /* arrays with more are one column: their size and CRC32 */

/* Write the names, or the values, each after a comma. */
void column_names(FILE *file, const struct form_leaf *leaf);
void column_values(FILE *file, const struct form_leaf *leaf, const unsigned char *message);

#endif
