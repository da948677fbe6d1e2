/* SPDX-License-Identifier: GPL-2.0-or-later */
/* The registers of an IIDC 1.31 camera: configuration ROM, modes of FORMAT0, one mode of FORMAT7, two features. */
#ifndef IIDC_REGISTERS_H
#define IIDC_REGISTERS_H

#include <stdbool.h>
#include <stddef.h>
#include <stdint.h>

#define IIDC_CODINGS 11
#define IIDC_LARGEST ((size_t)1 << 22) /* bytes of a frame */

struct iidc_registers {
    uint64_t guid;
    unsigned width, height; /* of the sensor */
    bool counter, bayer;    /* capabilities */
    unsigned depth;         /* of samples of 16 bits */
    bool counter_on, sending;
    uint32_t rate, mode, format, iso;        /* as the host wrote them */
    uint32_t position, size, coding, packet; /* the same, of FORMAT7 */
    uint32_t feature[4];                     /* brightness, and others up to white balance */
};

/* The picture that it sends now. */
struct iidc_picture {
    unsigned sensor_width, sensor_height, left, top, width, height, coding, bits;
};

void iidc_reset(struct iidc_registers *registers, uint64_t guid, unsigned width, unsigned height);
void iidc_option(struct iidc_registers *registers, const char *word);
bool iidc_read(const struct iidc_registers *registers, uint32_t address, uint32_t *value);
void iidc_write(struct iidc_registers *registers, uint32_t address, uint32_t value);
struct iidc_picture iidc_picture(const struct iidc_registers *registers);

#endif
