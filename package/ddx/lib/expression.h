/* SPDX-License-Identifier: LGPL-2.1-or-later */
/* Constant integer expressions, as in array bounds after the preprocessor: "(1920*1080)/4". */
#ifndef DDX_EXPRESSION_H
#define DDX_EXPRESSION_H

#include <stdint.h>

/* Evaluate the expression at *text and move *text after it. -EINVAL: not understood, overflow, division by zero. */
int ddx_expression(const char **text, int64_t *value);

#endif
