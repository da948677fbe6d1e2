/* SPDX-License-Identifier: LGPL-2.1-or-later */
#include "expression.h"

#include <ctype.h>
#include <errno.h>
#include <stdbool.h>
#include <stdlib.h>
#include <string.h>

#define DEPTH_MAX 32

/* Binary operators, the tightest last. */
static const struct {
    char sign[3];
    int level;
} operators[] = {{"|", 1}, {"^", 2}, {"&", 3}, {"<<", 4}, {">>", 4}, {"+", 5}, {"-", 5}, {"*", 6}, {"/", 6}, {"%", 6}};

static int binary(const char **text, int level, int depth, int64_t *value);

static void skip_space(const char **text) {
    while (isspace((unsigned char)**text))
        (*text)++;
}

static int primary(const char **text, int depth, int64_t *value) {
    skip_space(text);
    if (depth > DEPTH_MAX)
        return -EINVAL;
    char c = **text;
    if (c == '(') {
        (*text)++;
        int result = binary(text, 1, depth + 1, value);
        skip_space(text);
        if (result || **text != ')')
            return -EINVAL;
        (*text)++;
        return 0;
    }
    if (c == '-' || c == '+' || c == '~') {
        (*text)++;
        int result = primary(text, depth + 1, value);
        if (!result && c == '-' && __builtin_sub_overflow((int64_t)0, *value, value))
            return -EINVAL;
        if (c == '~')
            *value = ~*value;
        return result;
    }
    if (!isdigit((unsigned char)c))
        return -EINVAL;
    char *end;
    errno = 0;
    *value = strtoll(*text, &end, 0);
    if (errno)
        return -EINVAL;
    while (*end && strchr("uUlL", *end))
        end++;
    *text = end;
    return 0;
}

static int apply(const char *sign, int64_t *left, int64_t right) {
    bool shift_ok = right >= 0 && right < 62 && *left >= 0;

    switch (*sign) {
    case '|': *left |= right; return 0;
    case '^': *left ^= right; return 0;
    case '&': *left &= right; return 0;
    case '<':
        if (!shift_ok || *left > INT64_MAX >> right)
            return -EINVAL;
        *left <<= right;
        return 0;
    case '>':
        if (!shift_ok)
            return -EINVAL;
        *left >>= right;
        return 0;
    case '+': return __builtin_add_overflow(*left, right, left) ? -EINVAL : 0;
    case '-': return __builtin_sub_overflow(*left, right, left) ? -EINVAL : 0;
    case '*': return __builtin_mul_overflow(*left, right, left) ? -EINVAL : 0;
    default: break;
    }
    if (right == 0 || (right == -1 && *left == INT64_MIN))
        return -EINVAL;
    *left = *sign == '/' ? *left / right : *left % right;
    return 0;
}

static int binary(const char **text, int level, int depth, int64_t *value) {
    int result = primary(text, depth, value);

    while (!result) {
        size_t i = 0, count = sizeof operators / sizeof operators[0];

        skip_space(text);
        while (i < count && strncmp(*text, operators[i].sign, strlen(operators[i].sign)) != 0)
            i++;
        if (i == count || operators[i].level < level)
            return 0;
        *text += strlen(operators[i].sign);
        int64_t right;
        result = binary(text, operators[i].level + 1, depth + 1, &right);
        if (!result)
            result = apply(operators[i].sign, value, right);
    }
    return result;
}

int ddx_expression(const char **text, int64_t *value) {
    return binary(text, 1, 0, value);
}
