/* SPDX-License-Identifier: GPL-2.0-or-later */
#include "calibration.h"

#include <ctype.h>
#include <errno.h>
#include <math.h>
#include <stdarg.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

#define FILE_MAX 65536
#define VALUES_MAX 14 /* OpenCV's longest distortion; its last two are the tilt of the sensor */
#define VALUE_MAX 1e6
#define EXACT 1e-3 /* tolerance for single precision and rounding in the file */

struct reading {
    const char *path;
    char *error;
    char text[FILE_MAX];
};

__attribute__((format(printf, 2, 3))) static bool fail(const struct reading *reading, const char *format, ...) {
    int length = snprintf(reading->error, CALIBRATION_ERROR_MAX, "%.300s: ", reading->path);
    va_list arguments;

    va_start(arguments, format);
    vsnprintf(reading->error + length, CALIBRATION_ERROR_MAX - (size_t)length, format, arguments);
    va_end(arguments);
    return false;
}

static bool read_text(struct reading *reading) {
    FILE *file = fopen(reading->path, "re");

    if (!file)
        return fail(reading, "%s; ddxvideocalib makes a calibration", strerror(errno));
    size_t length = fread(reading->text, 1, sizeof reading->text - 1, file);
    int error = ferror(file) ? errno : 0;
    bool whole = fgetc(file) == EOF;
    fclose(file);
    if (error)
        return fail(reading, "%s", strerror(error));
    if (!whole || memchr(reading->text, 0, length))
        return fail(reading, "is no calibration; ddxvideocalib makes one");
    return true;
}

/* The text after `key:` at the start of a line, or NULL. */
static const char *value_of(const struct reading *reading, const char *key) {
    size_t length = strlen(key);

    for (const char *line = reading->text; line; line = strchr(line, '\n')) {
        line += *line == '\n';
        if (!strncmp(line, key, length) && line[length] == ':')
            return line + length + 1;
    }
    return NULL;
}

/* Skips blanks and the word after them. */
static bool take_word(const char **at, const char *word) {
    size_t length = strlen(word);

    while (isspace((unsigned char)**at))
        (*at)++;
    if (strncmp(*at, word, length) != 0)
        return false;
    *at += length;
    return true;
}

static bool take_count(const char **at, const char *word, int *count) {
    char *end;

    if (!take_word(at, word))
        return false;
    long value = strtol(*at, &end, 10);
    *count = value < 0 || value > 100000 ? 0 : (int)value;
    *at = end;
    return *count > 0;
}

/* 0: the matrix ends here, or has no number here; NaN and infinity are written `.Nan` and `.Inf`. */
static bool take_number(const char **at, double *number) {
    char *end;

    *number = strtod(*at, &end);
    if (end == *at || !isfinite(*number) || fabs(*number) > VALUE_MAX)
        return false;
    *at = end;
    return true;
}

/* The values of a matrix, and its rows and columns. */
static bool read_matrix(const struct reading *reading, const char *key, double values[VALUES_MAX], int *rows,
                        int *columns) {
    const char *at = value_of(reading, key);

    if (!at)
        return fail(reading, "%s is missing; M1 D1 M2 D2 R1 R2 P1 P2 are needed, see ddxvideocalib", key);
    if (!take_word(&at, "!!opencv-matrix") || !take_count(&at, "rows:", rows) || !take_count(&at, "cols:", columns) ||
        !take_word(&at, "dt:") || !(take_word(&at, "d") || take_word(&at, "f")) || !take_word(&at, "data:") ||
        !take_word(&at, "["))
        return fail(reading, "%s is no matrix as OpenCV writes it", key);
    if (*rows > VALUES_MAX || *columns > VALUES_MAX || *rows * *columns > VALUES_MAX)
        return fail(reading, "%s has %d rows and %d columns, which is too many", key, *rows, *columns);
    for (int i = 0; i < *rows * *columns; i++)
        if ((i && !take_word(&at, ",")) || !take_number(&at, &values[i]))
            return fail(reading, "%s: value %d of %d is not a number that can be", key, i + 1, *rows * *columns);
    return take_word(&at, "]") || fail(reading, "%s has more than %d values", key, *rows * *columns);
}

static bool read_sized(const struct reading *reading, const char *key, double *to, int rows, int columns) {
    double values[VALUES_MAX];
    int has_rows, has_columns;

    if (!read_matrix(reading, key, values, &has_rows, &has_columns))
        return false;
    if (has_rows != rows || has_columns != columns)
        return fail(reading, "%s has %d rows and %d columns, not %d and %d", key, has_rows, has_columns, rows, columns);
    memcpy(to, values, (size_t)(rows * columns) * sizeof *to);
    return true;
}

static bool read_distortion(const struct reading *reading, const char *key, double to[CALIBRATION_DISTORTION]) {
    double values[VALUES_MAX];
    int rows, columns;

    if (!read_matrix(reading, key, values, &rows, &columns))
        return false;
    int count = rows * columns;
    bool known = count == 4 || count == 5 || count == 8 || count == 12 || count == 14;
    if (!known || (rows > 1 && columns > 1))
        return fail(reading, "%s has %d rows and %d columns; one of 4, 5, 8, 12 or 14 values is needed", key, rows,
                    columns);
    if (count == 14 && (values[12] != 0 || values[13] != 0))
        return fail(reading, "%s has a tilt of the sensor, which is not supported; calibrate without it", key);
    for (int i = 0; i < CALIBRATION_DISTORTION; i++)
        to[i] = i < count ? values[i] : 0;
    return true;
}

static bool is_rotation(const double r[9]) {
    for (int i = 0; i < 3; i++)
        for (int j = 0; j < 3; j++) {
            double product = r[3 * i] * r[3 * j] + r[3 * i + 1] * r[3 * j + 1] + r[3 * i + 2] * r[3 * j + 2];

            if (fabs(product - (i == j)) > EXACT)
                return false;
        }
    return true;
}

static bool read_eye(const struct reading *reading, struct calibration_eye *eye, char number) {
    const char m[] = {'M', number, 0}, d[] = {'D', number, 0}, r[] = {'R', number, 0}, p[] = {'P', number, 0};

    if (!read_sized(reading, m, eye->camera, 3, 3) || !read_distortion(reading, d, eye->distortion) ||
        !read_sized(reading, r, eye->rotation, 3, 3) || !read_sized(reading, p, eye->projection, 3, 4))
        return false;
    if (eye->camera[0] < 1 || eye->camera[4] < 1)
        return fail(reading, "%s has no focal length", m);
    if (eye->projection[0] < 1 || eye->projection[5] < 1)
        return fail(reading, "%s has no focal length", p);
    return is_rotation(eye->rotation) || fail(reading, "%s is no rotation", r);
}

static bool is_near(double a, double b) {
    return fabs(a - b) <= EXACT * (1 + fabs(a));
}

/* After rectification both eyes must have the same rows. */
static bool check_pair(const struct reading *reading, struct calibration *calibration) {
    const double *left = calibration->eye[LEFT].projection, *right = calibration->eye[RIGHT].projection;

    if (!is_near(left[0], right[0]) || !is_near(left[5], right[5]) || !is_near(left[6], right[6]) ||
        !is_near(left[3], 0))
        return fail(reading, "P1 and P2 do not belong together");
    if (fabs(right[7]) > fabs(right[3]))
        return fail(reading, "the cameras are one above the other; only those side by side are supported");
    calibration->baseline = -right[3] / right[0];
    return calibration->baseline > 0 ||
           fail(reading, "P2 says that the second camera is not to the right of the first; exchange both");
}

static bool read_size(const struct reading *reading, struct calibration *calibration) {
    const char *width = value_of(reading, "image_width"), *height = value_of(reading, "image_height");

    calibration->width = calibration->height = 0;
    if (!width && !height)
        return true;
    return (width && height && take_count(&width, "", &calibration->width) &&
            take_count(&height, "", &calibration->height)) ||
           fail(reading, "image_width and image_height are no size of pictures");
}

bool calibration_read(struct calibration *calibration, const char *path, char error[CALIBRATION_ERROR_MAX]) {
    struct reading *reading = calloc(1, sizeof *reading);

    if (!reading) {
        snprintf(error, CALIBRATION_ERROR_MAX, "%.300s: %s", path, strerror(ENOMEM));
        return false;
    }
    reading->path = path;
    reading->error = error;
    bool good = read_text(reading) && read_eye(reading, &calibration->eye[LEFT], '1') &&
                read_eye(reading, &calibration->eye[RIGHT], '2') && check_pair(reading, calibration) &&
                read_size(reading, calibration);
    free(reading);
    return good;
}

bool calibration_fits(const struct calibration *calibration, int width, int height) {
    if (calibration->width)
        return calibration->width == width && calibration->height == height;
    for (int i = 0; i < 2; i++) {
        const double *camera = calibration->eye[i].camera;

        if (!(camera[2] > 0 && camera[2] < width && camera[5] > 0 && camera[5] < height))
            return false;
    }
    return true;
}
