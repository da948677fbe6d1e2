/* SPDX-License-Identifier: GPL-2.0-or-later */
/*
 * The calibration of a stereo pair: OpenCV's YAML with the matrices M1 D1 M2 D2 R1 R2 P1 P2, as written by
 * cv2.FileStorage. M is a camera's matrix, D its distortion; R and P are results of cv2.stereoRectify().
 */
#ifndef DDXVIDEO_STEREO_CALIBRATION_H
#define DDXVIDEO_STEREO_CALIBRATION_H

#include <stdbool.h>

#define CALIBRATION_DISTORTION 12 /* k1 k2 p1 p2 k3 k4 k5 k6 s1 s2 s3 s4; 0 if the file lacks one */
#define CALIBRATION_ERROR_MAX 512

enum eye { LEFT, RIGHT };

struct calibration {
    int width, height; /* of one camera's pictures; 0: not in the file */
    struct calibration_eye {
        double camera[9], distortion[CALIBRATION_DISTORTION], rotation[9], projection[12]; /* row by row */
    } eye[2];
    double baseline; /* distance between the cameras, above 0, in the file's unit */
};

/* False, with a line in `error`, if the file cannot be used. */
bool calibration_read(struct calibration *calibration, const char *path, char error[CALIBRATION_ERROR_MAX]);

/* Whether it is for pictures of this size; without a size in the file: whether its centres are in the picture. */
bool calibration_fits(const struct calibration *calibration, int width, int height);

#endif
